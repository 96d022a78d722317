//! The scalars of vertices as columns, for a file that is written of them.

use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Column, ColumnType, PointTest, Progress};
use glam::Vec3;
use param::shown;

use super::PlySource;
use super::columns::{ChunkBuilder, RowDecoder, color_column, column};
use crate::Selection;
use crate::export::columns::{Piece, place};
use crate::in_order::InOrder;

impl PlySource {
    /// The scalars of a vertex. If colours are `wide`, they have 16 bits, and the names by which LAS files have them.
    pub fn column_fields(&self, wide: bool) -> Vec<Attribute> {
        let field = |(index, scalar): (usize, &super::Scalar)| match self.channel(index).filter(|_| wide) {
            Some(channel) => Attribute { name: ["red", "green", "blue"][channel].into(), column_type: ColumnType::U16 },
            None => {
                // Where points are moved far, a float that held their place in the file does not hold the new one.
                let is_moved = self.info.placement.is_some() && self.roles.position.contains(&index);
                let column_type = if is_moved { ColumnType::F64 } else { scalar.scalar };
                Attribute { name: scalar.name.clone(), column_type }
            }
        };
        self.scalars.iter().enumerate().map(field).collect()
    }

    /// The channel of colour that a scalar is. The numbers of Gaussian splats are more than colours.
    fn channel(&self, index: usize) -> Option<usize> {
        let colors = self.roles.colors.filter(|_| !self.roles.is_splats)?;
        colors.iter().position(|color| *color == index)
    }

    /// Passes the columns of `column_fields` to `rows_of`; the rows that it makes of the points that are shown go to
    /// `order`, in the order of the file. Points without a place are not shown. Returns what could not be read.
    pub fn read_columns_in_order(
        &self,
        test: &PointTest,
        wide: bool,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let packing = self.packing(vec![true; self.element().properties.len()]);
        let layout = cloud::CloudLayout { attributes: self.info.attributes.clone(), grid: None };
        let attributes = test.reads(&layout.attributes);
        let selection = Selection { positions: true, colors: false, normals: false, attributes };
        let plan = RowDecoder::new(&self.scalars, &self.roles, &selection, &packing);
        let test = test.of(&layout);
        let piece_of = |first_point: u64, rows: &[u8]| {
            let points = rows.len() / packing.stride;
            let mut builder = ChunkBuilder::new(&plan, 0, points);
            builder.push(rows);
            let (mut chunk, mut bounds) = builder.finish();
            if let Some(placement) = &self.info.placement {
                chunk = chunk.placed(placement, None);
                bounds = chunk.bounds();
            }
            let shown = test.shown(&chunk, bounds);
            let has_place = |index: &usize| Vec3::from(chunk.positions[*index]).is_finite();
            let kept: Vec<u32> = shown.indices(points).filter(has_place).map(|index| index as u32).collect();
            let columns = self.scalars.iter().enumerate().map(|(index, scalar)| {
                match (self.channel(index).filter(|_| wide), self.roles.color_scale) {
                    (Some(channel), Some(scales)) => color_column(rows, scalar, &packing, scales[channel]),
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
            let what = "vertices have text that is not a number, or too few numbers";
            problems.push(format!("{}: {damaged} {what}", shown(&self.info.path)));
        }
        problems
    }
}

/// The size in bytes of the rows that are made into columns at once.
const PIECE_BYTES: usize = 1 << 20;
