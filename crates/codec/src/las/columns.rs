//! Turns point records into the columns of a chunk. Records come in tiles that stay in the first-level cache while one
//! column after the other is filled from them.

use std::sync::Arc;

use cloud::{Bounds, Chunk, Column, Grid};
use glam::{DVec3, Vec3};

use super::layout::{Layout, bytes};

/// The number of records per tile: 36 KiB of point format 7, and enough that a decoder's calls per tile cost nothing.
pub const TILE_RECORDS: usize = 1024;
const F32_STEPS: f64 = Grid::F32_STEPS as f64;
/// The number of records whose median is the origin if the first point is far from most points.
const MEDIAN_RECORDS: usize = 99;

/// The conversion of 16-bit colour fields to 8 bits, one rule for a whole file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorDepth {
    /// The fields hold 0 to 255.
    Eight,
    Sixteen,
}

/// The columns to decode of each chunk of one read.
pub struct ReadPlan<'a> {
    pub layout: &'a Layout,
    pub grid: Grid,
    pub positions: bool,
    /// The range of the colours; `None` to leave colours out.
    pub colors: Option<ColorDepth>,
    /// One entry per attribute of the layout.
    pub attributes: Vec<bool>,
}

/// A chunk that is built from tiles of records.
pub struct ChunkBuilder<'a> {
    plan: &'a ReadPlan<'a>,
    first_point: u64,
    points: usize,
    anchor: Option<Anchor>,
    lowest: [i32; 3],
    highest: [i32; 3],
    positions: Vec<[f32; 3]>,
    /// The exact coordinates; from the first point on that is too far from the others for f32 offsets to hold its grid
    /// step.
    exact_positions: Option<Vec<[f64; 3]>>,
    colors: Vec<[u8; 4]>,
    columns: Vec<Option<Column>>,
}

/// The origin of offsets. Per axis, `offset = (raw - first_raw) * scale + rest`: the difference of two 32-bit integers
/// is exact in f64, and `rest` is the offset of the first point from the origin.
#[derive(Clone, Copy)]
struct Anchor {
    origin: DVec3,
    first_raw: DVec3,
    rest: DVec3,
}

impl Anchor {
    fn new(records: impl Iterator<Item = [i32; 3]> + Clone, grid: &Grid) -> Option<Self> {
        let first = records.clone().next()?;
        let usual: [i32; 3] = std::array::from_fn(|axis| {
            let mut values: Vec<i32> = records.clone().take(MEDIAN_RECORDS).map(|raw| raw[axis]).collect();
            values.sort_unstable();
            values[values.len() / 2]
        });
        let [first, usual] = [first, usual].map(|raw| DVec3::from(raw.map(f64::from)));
        // A first point far away would cost all others their precision.
        let first_raw = if (first - usual).abs().max_element() < F32_STEPS { first } else { usual };
        let world = first_raw * grid.scale + grid.offset;
        // Whole units keep origins short; where a unit has more than a million grid steps (degrees), that would use up
        // the 24 bits of an f32 offset, and the origin is the point itself.
        let origin = DVec3::select(grid.scale.abs().cmpge(DVec3::splat(1e-6)), world.round(), world);
        Some(Self { origin, first_raw, rest: world - origin })
    }
}

impl<'a> ChunkBuilder<'a> {
    pub fn new(plan: &'a ReadPlan<'a>, first_point: u64, capacity: usize) -> Self {
        let column = |(wanted, property): (&bool, &super::layout::Property)| {
            wanted.then(|| Column::with_capacity(property.reading.column_type(), capacity))
        };
        Self {
            plan,
            first_point,
            points: 0,
            anchor: None,
            lowest: [i32::MAX; 3],
            highest: [i32::MIN; 3],
            positions: Vec::with_capacity(if plan.positions { capacity } else { 0 }),
            exact_positions: None,
            colors: Vec::with_capacity(if plan.colors.is_some() { capacity } else { 0 }),
            columns: plan.attributes.iter().zip(&plan.layout.attributes).map(column).collect(),
        }
    }

    pub fn len(&self) -> usize {
        self.points
    }

    /// The index in the file of the next point.
    pub fn next_point(&self) -> u64 {
        self.first_point + self.points as u64
    }

    /// Appends whole records.
    pub fn push(&mut self, records: &[u8]) {
        let plan = self.plan;
        let length = plan.layout.record_length;
        for tile in records.chunks(TILE_RECORDS * length) {
            if plan.positions {
                self.push_positions(tile);
            }
            if let (Some(red), Some(depth)) = (plan.layout.red, plan.colors) {
                let fields = tile.chunks_exact(length).map(|record| {
                    let field: [u8; 6] = bytes(record, red);
                    [0, 2, 4].map(|at| u16::from_le_bytes([field[at], field[at + 1]]))
                });
                match depth {
                    ColorDepth::Eight => self.colors.extend(fields.map(|[r, g, b]| {
                        let clamp = |value: u16| value.min(255) as u8;
                        [clamp(r), clamp(g), clamp(b), 255]
                    })),
                    ColorDepth::Sixteen => self
                        .colors
                        .extend(fields.map(|[r, g, b]| [(r >> 8) as u8, (g >> 8) as u8, (b >> 8) as u8, 255])),
                }
            }
            for (column, property) in self.columns.iter_mut().zip(&plan.layout.attributes) {
                if let Some(column) = column {
                    property.reading.append(column, tile, length, &plan.grid);
                }
            }
            self.points += tile.len() / length;
        }
    }

    fn push_positions(&mut self, tile: &[u8]) {
        let raw = |record: &[u8]| {
            let field: [u8; 12] = bytes(record, 0);
            [0, 4, 8].map(|at| i32::from_le_bytes([field[at], field[at + 1], field[at + 2], field[at + 3]]))
        };
        let records = tile.chunks_exact(self.plan.layout.record_length).map(raw);
        let grid = &self.plan.grid;
        let Some(anchor) = self.anchor.or_else(|| Anchor::new(records.clone(), grid)) else { return };
        self.anchor = Some(anchor);
        let (first_raw, scale, rest) = (anchor.first_raw.to_array(), grid.scale.to_array(), anchor.rest.to_array());
        let (mut lowest, mut highest) = (self.lowest, self.highest);
        let before = self.positions.len();
        self.positions.extend(records.clone().map(|raw| {
            let mut position = [0.0; 3];
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(raw[axis]);
                highest[axis] = highest[axis].max(raw[axis]);
                position[axis] = ((f64::from(raw[axis]) - first_raw[axis]) * scale[axis] + rest[axis]) as f32;
            }
            position
        }));
        (self.lowest, self.highest) = (lowest, highest);
        let world = |raw: DVec3| (raw * grid.scale + grid.offset).to_array();
        let reach = |corner: [i32; 3]| (DVec3::from(corner.map(f64::from)) - anchor.first_raw).abs().max_element();
        if self.exact_positions.is_none() && reach(lowest).max(reach(highest)) >= F32_STEPS {
            let raw = |offset: &[f32; 3]| {
                ((Vec3::from(*offset).as_dvec3() - anchor.rest) / grid.scale).round() + anchor.first_raw
            };
            self.exact_positions = Some(self.positions[..before].iter().map(|offset| world(raw(offset))).collect());
        }
        if let Some(exact) = &mut self.exact_positions {
            exact.extend(records.map(|raw| world(DVec3::from(raw.map(f64::from)))));
        }
    }

    /// The chunk, its number of points (which a chunk without positions does not have), and its bounds in the file's
    /// own coordinates.
    pub fn finish(self) -> (Chunk, u64, Bounds) {
        let mut bounds = Bounds::EMPTY;
        if self.anchor.is_some() {
            for corner in [self.lowest, self.highest] {
                bounds.include(DVec3::from(corner.map(f64::from)) * self.plan.grid.scale + self.plan.grid.offset);
            }
        }
        let origin = self.anchor.map_or(DVec3::ZERO, |anchor| anchor.origin);
        let mut chunk = Chunk::new(self.first_point, origin, self.positions);
        chunk.exact_positions = self.exact_positions.map(Arc::new);
        chunk.colors = self.plan.colors.map(|_| Arc::new(self.colors));
        chunk.columns = self.columns.into_iter().map(|column| column.map(Arc::new)).collect();
        (chunk, self.points as u64, bounds)
    }
}
