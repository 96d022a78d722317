//! Turns point records into the columns of a chunk. Records come in tiles that stay in the first-level cache while one
//! column after the other is filled from them.

use std::sync::Arc;

use cloud::{Bounds, Chunk, Column, Grid, amid};
use glam::DVec3;

use super::layout::{Layout, bytes};

/// The number of records per tile: 36 KiB of point format 7, and enough that a decoder's calls per tile cost nothing.
pub const TILE_RECORDS: usize = 1024;
const F32_STEPS: f64 = Grid::F32_STEPS as f64;

/// The conversion of 16-bit colour fields to 8 bits, one rule for a whole file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorDepth {
    /// The fields hold 0 to 255.
    Eight,
    /// 0 to 1023.
    Ten,
    /// 0 to 4095.
    Twelve,
    Sixteen,
}

impl ColorDepth {
    /// The depth of colours of which this is full brightness.
    pub fn of(full: f64) -> Self {
        match full {
            ..256.0 => Self::Eight,
            ..1024.0 => Self::Ten,
            ..4096.0 => Self::Twelve,
            _ => Self::Sixteen,
        }
    }

    /// The value of full brightness.
    pub fn most(self) -> u16 {
        match self {
            Self::Eight => 255,
            Self::Ten => 1023,
            Self::Twelve => 4095,
            Self::Sixteen => u16::MAX,
        }
    }

    /// The value of a field with 8 bits.
    #[inline(always)]
    pub fn narrow(self, value: u16) -> u8 {
        match self {
            Self::Eight => value.min(255) as u8,
            Self::Ten => (value >> 2).min(255) as u8,
            Self::Twelve => (value >> 4).min(255) as u8,
            Self::Sixteen => (value >> 8) as u8,
        }
    }

    /// The value of a field with 16 bits.
    pub fn widen(self, value: u16) -> u16 {
        // The upper bits again fill the lower ones, so that full brightness stays full.
        match self {
            Self::Eight => value.min(255) * 257,
            Self::Ten => value.min(1023) << 6 | value.min(1023) >> 4,
            Self::Twelve => value.min(4095) << 4 | value.min(4095) >> 8,
            Self::Sixteen => value,
        }
    }
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
    lowest: [i32; 3],
    highest: [i32; 3],
    /// The coordinates as the file has them: where the origin lies is known when all have been read.
    raw: Vec<[i32; 3]>,
    colors: Vec<[u8; 4]>,
    columns: Vec<Option<Column>>,
}

/// The origin of offsets. Per axis, `offset = (raw - own_raw) * scale + rest`: the difference of two 32-bit integers is
/// exact in f64, and `rest` is the offset from the origin of the point that the origin is at.
struct Anchor {
    origin: DVec3,
    own_raw: DVec3,
    rest: DVec3,
}

impl Anchor {
    /// `None` without points.
    fn new(raw: &[[i32; 3]], grid: &Grid) -> Option<Self> {
        let place = |index: usize| DVec3::from(raw[index].map(f64::from));
        let own_raw = place(amid(raw.len(), place)?.index);
        let world = own_raw * grid.scale + grid.offset;
        // Whole units keep origins short; where a unit has more than a million grid steps (degrees), that would use up
        // the 24 bits of an f32 offset, and the origin is the point itself.
        let origin = DVec3::select(grid.scale.abs().cmpge(DVec3::splat(1e-6)), world.round(), world);
        Some(Self { origin, own_raw, rest: world - origin })
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
            lowest: [i32::MAX; 3],
            highest: [i32::MIN; 3],
            raw: Vec::with_capacity(if plan.positions { capacity } else { 0 }),
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
                macro_rules! extend {
                    ($depth:expr) => {
                        self.colors.extend(fields.map(|color| {
                            let [r, g, b] = color.map(|value| $depth.narrow(value));
                            [r, g, b, 255]
                        }))
                    };
                }
                // A loop for each depth, which the compiler can turn into vectors.
                match depth {
                    ColorDepth::Eight => extend!(ColorDepth::Eight),
                    ColorDepth::Ten => extend!(ColorDepth::Ten),
                    ColorDepth::Twelve => extend!(ColorDepth::Twelve),
                    ColorDepth::Sixteen => extend!(ColorDepth::Sixteen),
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
        let (mut lowest, mut highest) = (self.lowest, self.highest);
        self.raw.extend(records.inspect(|raw| {
            for axis in 0..3 {
                lowest[axis] = lowest[axis].min(raw[axis]);
                highest[axis] = highest[axis].max(raw[axis]);
            }
        }));
        (self.lowest, self.highest) = (lowest, highest);
    }

    /// The chunk, its number of points (which a chunk without positions does not have), and its bounds in the file's
    /// own coordinates.
    pub fn finish(self) -> (Chunk, u64, Bounds) {
        let grid = &self.plan.grid;
        let world = |raw: [i32; 3]| DVec3::from(raw.map(f64::from)) * grid.scale + grid.offset;
        let mut bounds = Bounds::EMPTY;
        let mut chunk = match Anchor::new(&self.raw, grid) {
            None => Chunk::new(self.first_point, DVec3::ZERO, Vec::new()),
            Some(anchor) => {
                let (lowest, highest) = (self.lowest, self.highest);
                [lowest, highest].into_iter().for_each(|corner| bounds.include(world(corner)));
                let reach =
                    |corner: [i32; 3]| (DVec3::from(corner.map(f64::from)) - anchor.own_raw).abs().max_element();
                let is_wide = reach(lowest).max(reach(highest)) >= F32_STEPS;
                let exact = is_wide.then(|| Arc::new(self.raw.iter().map(|raw| world(*raw).to_array()).collect()));
                let (own, scale, rest) = (anchor.own_raw.to_array(), grid.scale.to_array(), anchor.rest.to_array());
                // In place: an offset takes the room of its integers.
                let offset = |raw: [i32; 3]| -> [f32; 3] {
                    std::array::from_fn(|axis| ((f64::from(raw[axis]) - own[axis]) * scale[axis] + rest[axis]) as f32)
                };
                let offsets = self.raw.into_iter().map(offset).collect();
                Chunk { exact_positions: exact, ..Chunk::new(self.first_point, anchor.origin, offsets) }
            }
        };
        chunk.colors = self.plan.colors.map(|_| Arc::new(self.colors));
        chunk.columns = self.columns.into_iter().map(|column| column.map(Arc::new)).collect();
        (chunk, self.points as u64, bounds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_every_depth_get_narrower_and_wider_and_stay_full() {
        for (depth, full) in [
            (ColorDepth::Eight, 255),
            (ColorDepth::Ten, 1023),
            (ColorDepth::Twelve, 4095),
            (ColorDepth::Sixteen, 65_535),
        ] {
            assert_eq!(ColorDepth::of(f64::from(full)), depth);
            assert_eq!([0, full / 2, full].map(|value| depth.narrow(value)), [0, 127, 255]);
            assert_eq!([0, full].map(|value| depth.widen(value)), [0, 65_535]);
            assert!((0..full).all(|value| depth.widen(value) < depth.widen(value + 1)));
            // What lies above is clamped.
            assert_eq!((depth.narrow(65_535), depth.widen(65_535)), (255, 65_535));
        }
    }
}
