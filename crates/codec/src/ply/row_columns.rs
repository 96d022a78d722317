//! The scalars of vertices as columns, for a file that is written of them.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use cloud::{Chunk, Column, ColumnType, Progress};
use glam::Vec3;
use param::shown;

use super::RowSource;
use super::columns::{ChunkBuilder, RowDecoder, Scale, color_column, column};
use super::header::Kind;
use crate::Selection;
use crate::export::columns::{Colors, Field, Meaning, Piece, Reading, place};
use crate::in_order::InOrder;

impl RowSource {
    /// The scalars of a vertex. Coordinates and normals have the names that most files give them, and colours that are
    /// not the file's own those of LAS files.
    pub fn column_fields(&self, colors: Colors) -> Vec<Field> {
        let field = |(index, scalar): (usize, &super::Scalar)| {
            let place_in = |places: Option<[usize; 3]>| places?.iter().position(|place| *place == index);
            let (color, own) = (self.channel(index), scalar.scalar);
            if let Some(axis) = place_in(Some(self.roles.position)) {
                // Where points are moved far, a float that held their place in the file does not hold the new one.
                let column_type = if self.info.placement.is_some() { ColumnType::F64 } else { own };
                return Field::new(["x", "y", "z"][axis], column_type, Meaning::Coordinate);
            }
            match (color, place_in(self.roles.normals), colors) {
                (Some(_), _, Colors::Own) => Field::new(&scalar.name, own, Meaning::Color),
                (Some(color), _, _) => {
                    let column_type = if colors == Colors::Bytes { ColumnType::U8 } else { ColumnType::U16 };
                    Field::new(["red", "green", "blue"][color], column_type, Meaning::Color)
                }
                (None, Some(axis), _) => Field::new(["nx", "ny", "nz"][axis], own, Meaning::Other),
                (None, None, _) => Field::new(&scalar.name, own, Meaning::Other),
            }
        };
        self.scalars.iter().enumerate().map(field).collect()
    }

    /// Whether its colours and those of another file have the same names, types and scale.
    pub fn has_colors_like(&self, other: &Self) -> bool {
        let kind = |source: &Self| {
            let scalar = |index: usize| (source.scalars[index].name.clone(), source.scalars[index].scalar);
            (source.roles.colors.map(|colors| colors.map(scalar)), source.roles.color_scale)
        };
        kind(self) == kind(other)
    }

    /// Whether its colours are more than bytes. Bytes may lie in wider fields, as those of a text do.
    pub fn has_wide_colors(&self) -> bool {
        let is_byte = Scale::Linear { factor: 1.0, bias: 0.0 };
        let is_wide = |index: usize| {
            let scale = self.channel(index).map(|channel| self.roles.color_scale.map(|scales| scales[channel]));
            let own = self.scalars[index].scalar;
            scale.is_some_and(|scale| own.size() > 1 && !(own.is_whole() && scale == Some(is_byte)))
        };
        (0..self.scalars.len()).any(is_wide)
    }

    /// Whether its vertices have lists, which are no columns.
    pub fn has_lists(&self) -> bool {
        self.element().properties.iter().any(|property| matches!(property.kind, Kind::List { .. }))
    }

    /// The channel of colour that a scalar is. The numbers of Gaussian splats are more than colours.
    fn channel(&self, index: usize) -> Option<usize> {
        let colors = self.roles.colors.filter(|_| !self.roles.is_splats)?;
        colors.iter().position(|color| *color == index)
    }

    /// Says how many points have no place, besides those that are damaged.
    pub(super) fn placeless_warning(&self, points: u64, damaged: u64) -> Option<String> {
        let points = points.saturating_sub(damaged);
        (points > 0).then(|| format!("{points} {} have no finite coordinates and are left out", self.noun()))
    }

    /// Passes the columns of `column_fields` to `rows_of`; the rows that it makes of the points that are shown go to
    /// `order`, in the order of the file. Points without a place are not shown. Returns what could not be read.
    pub fn read_columns_in_order(
        &self,
        wish: &Reading<'_>,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let packing = self.packing(vec![true; self.element().properties.len()]);
        let test = wish.test;
        let layout = cloud::CloudLayout { attributes: self.info.attributes.clone(), grid: None };
        let attributes = test.reads(&layout.attributes);
        let selection = Selection { positions: true, colors: false, normals: false, attributes };
        let plan = RowDecoder::new(&self.scalars, &self.roles, &selection, &packing);
        let test = test.of(&layout);
        let placeless = AtomicU64::new(0);
        let piece_of = |first_point: u64, rows: &[u8]| {
            let points = rows.len() / packing.stride;
            let mut builder = ChunkBuilder::new(&plan, 0, points);
            builder.push(rows);
            let (mut chunk, mut bounds) = builder.finish();
            if let Some(placement) = &self.info.placement {
                chunk = chunk.placed(placement, None);
                bounds = chunk.bounds();
            }
            placeless.fetch_add(placeless_points(&chunk), Ordering::Relaxed);
            let shown = test.shown(&chunk, bounds);
            let has_place = |index: &usize| Vec3::from(chunk.positions[*index]).is_finite();
            let kept: Vec<u32> = shown.indices(points).filter(has_place).map(|index| index as u32).collect();
            let columns = self.scalars.iter().enumerate().map(|(index, scalar)| {
                match (self.channel(index), self.roles.color_scale) {
                    _ if !wish.needs(index) => Column::with_capacity(scalar.scalar, 0),
                    (Some(channel), Some(scales)) if wish.colors == Colors::Bytes => {
                        match color_column(rows, scalar, &packing, scales[channel]) {
                            Column::U16(values) => {
                                Column::U8(values.into_iter().map(|value| (value >> 8) as u8).collect())
                            }
                            column => column,
                        }
                    }
                    (Some(channel), Some(scales)) if wish.colors == Colors::Words => {
                        color_column(rows, scalar, &packing, scales[channel])
                    }
                    _ => column(rows, scalar, &packing),
                }
            });
            let mut columns: Vec<Column> = if kept.is_empty() { Vec::new() } else { columns.collect() };
            if let Some(placement) = self.info.placement.as_ref().filter(|_| !kept.is_empty()) {
                place(&mut columns, self.roles.position, self.roles.normals, placement);
            }
            Piece { first_point, points, columns, kept }
        };
        let problems = Mutex::new((Vec::new(), 0));
        order.blocks(self.rows.blocks.len(), rayon::current_num_threads(), &|index, out, _| {
            let block = self.rows.blocks[index];
            let mut first_point = block.first_row;
            let counts = packing.read(&self.file, block, |mut rows| {
                // Pieces of some megabytes, so that a thread holds little.
                let most = (PIECE_BYTES / packing.stride).max(1) * packing.stride;
                while !rows.is_empty() && !order.is_stopped() {
                    let (now, later) = rows.split_at(most.min(rows.len()));
                    let piece = piece_of(first_point, now);
                    let points = piece.points as u64;
                    if !piece.kept.is_empty() {
                        out.give(&rows_of(piece));
                    }
                    progress.add(points);
                    first_point += points;
                    rows = later;
                }
            });
            let mut problems = problems.lock().unwrap_or_else(PoisonError::into_inner);
            match counts {
                Ok((_, damaged)) => problems.1 += damaged,
                Err(error) => problems.0.push(format!("{}: {error}", shown(&self.info.path))),
            }
        });
        let (mut problems, damaged) = problems.into_inner().unwrap_or_else(PoisonError::into_inner);
        if damaged > 0 {
            problems.push(format!("{}: {damaged} {} {}", shown(&self.info.path), self.noun(), self.damage()));
        }
        let warning = self.placeless_warning(placeless.into_inner(), damaged);
        problems.extend(warning.map(|warning| format!("{}: {warning}", shown(&self.info.path))));
        problems
    }
}

/// The points whose coordinates are not all finite.
pub fn placeless_points(chunk: &Chunk) -> u64 {
    chunk.positions.iter().filter(|place| !Vec3::from(**place).is_finite()).count() as u64
}

/// The size in bytes of the rows that are made into columns at once.
const PIECE_BYTES: usize = 1 << 20;
