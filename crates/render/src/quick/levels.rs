//! A pyramid of keys over a picture, into which each point is put once.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

/// Level 0 has a cell for each pixel, each further one a cell for four of the level before. The cells of the last one are
/// half as wide as the largest splat.
pub const LEVELS: usize = 6;
/// How far the pyramid reaches beyond the picture, in pixels: splats whose middles are outside show at its border.
const MARGIN: usize = 32;
/// The key of a cell without a point.
pub const EMPTY: u64 = u64::MAX;

/// The share of the depth by which splats of a coarser level must be nearer to hide those of a finer one.
pub const NEARER: f32 = 0.985;

/// Neighbours that are nearer than a cell's point by this share of its depth are in front of it.
pub const IN_FRONT: f32 = 0.98;
/// So many of the eight neighbours in front make a cell of the finest level a gap in their surface.
const AROUND_PIXEL: usize = 4;
/// So many of the eight do at the other levels, where the points of a surface fill one cell in three at the least.
const AROUND_CELL: usize = 2;

/// The nearest point of each cell.
#[derive(Default)]
pub struct Levels {
    cells: Vec<AtomicU64>,
    /// The keys of the cells, and those that gaps have taken from their neighbours: to see which are gaps, the cells must
    /// stay as they are.
    keys: Vec<u64>,
    heights: [usize; LEVELS],
    /// The first cell of each level, and the number of cells in a row of it.
    starts: [usize; LEVELS],
    widths: [usize; LEVELS],
    size: [u32; 2],
    /// The pixels along each side with the margins.
    reach: [f32; 2],
}

/// The keys of the nearest points in four directions from a pixel.
#[derive(Clone, Copy)]
pub struct Sides {
    top_left: u64,
    top_right: u64,
    bottom_left: u64,
    bottom_right: u64,
}

impl Sides {
    pub const EMPTY: Self = Self { top_left: EMPTY, top_right: EMPTY, bottom_left: EMPTY, bottom_right: EMPTY };

    /// The depth of the nearest surface that may surround the pixel: points that are as near or nearer lie on opposite
    /// sides of it. On a surface that leads away from the eye, nearer points lie on one side. No number without any.
    #[inline(always)]
    pub fn surrounding_depth(self) -> f32 {
        let falling = self.top_left.max(self.bottom_right);
        let rising = self.top_right.max(self.bottom_left);
        depth_of(falling.min(rising))
    }
}

/// The key of a point: points that are nearer have lower ones, and of points that are equally near the one with the larger
/// identity. The depth must not be negative.
#[inline(always)]
pub fn key_of(depth: f32, identity: u32) -> u64 {
    u64::from(depth.to_bits()) << 32 | u64::from(!identity)
}

#[inline(always)]
pub fn depth_of(key: u64) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

#[inline(always)]
pub fn identity_of(key: u64) -> u32 {
    !(key as u32)
}

/// The level whose cells are a quarter to half as wide as a splat with this diameter in pixels. Smaller cells keep more of
/// the points, whose mean a pixel shows, and leave more gaps.
#[inline(always)]
pub fn level_of(diameter: f32) -> usize {
    // The exponent of the number is its binary logarithm, rounded down.
    let exponent = ((diameter * 0.5).to_bits() >> 23) as i32 - 127;
    exponent.clamp(0, LEVELS as i32 - 1) as usize
}

impl Levels {
    /// Empties all cells, for a picture of this size.
    pub fn begin(&mut self, size: [u32; 2]) {
        if self.size != size {
            // `reaching` gives four by four cells of each level.
            let enough = |edge: u32| (edge as usize + 2 * MARGIN).max(4 << (LEVELS - 1));
            let cells = size.map(|edge| enough(edge).next_multiple_of(1 << (LEVELS - 1)));
            let mut start = 0;
            for level in 0..LEVELS {
                (self.starts[level], self.widths[level], self.heights[level]) =
                    (start, cells[0] >> level, cells[1] >> level);
                start += (cells[0] >> level) * (cells[1] >> level);
            }
            self.reach = size.map(|edge| (edge as usize + 2 * MARGIN) as f32);
            (self.size, self.cells) = (size, Vec::new());
            self.cells.resize_with(start, || AtomicU64::new(EMPTY));
            self.keys = vec![EMPTY; start];
        }
        let clear = |cells: &mut [AtomicU64]| cells.iter_mut().for_each(|cell| *cell.get_mut() = EMPTY);
        self.cells.par_chunks_mut(1 << 16).for_each(clear);
    }

    /// Puts a point into the cell of a place in pixels, if the pyramid reaches as far.
    #[inline(always)]
    pub fn put(&self, level: usize, x: f32, y: f32, key: u64) {
        let margin = MARGIN as f32;
        let (x, y) = (x + margin, y + margin);
        if !(x >= 0.0 && y >= 0.0 && x < self.reach[0] && y < self.reach[1]) {
            return;
        }
        let cell = &self.cells[self.starts[level] + (y as usize >> level) * self.widths[level] + (x as usize >> level)];
        // Most points lie behind what the cell has.
        if key < cell.load(Ordering::Relaxed) {
            cell.fetch_min(key, Ordering::Relaxed);
        }
    }

    /// Gives cells that see through a gap between others the key of the nearest of those. The finest level has a cell for
    /// each pixel, where an outline shows, and wants more of them around.
    pub fn close_gaps(&mut self) {
        for level in 0..LEVELS {
            let (start, width, height) = (self.starts[level], self.widths[level], self.heights[level]);
            let cells = &self.cells[start..start + width * height];
            let enough = if level == 0 { AROUND_PIXEL } else { AROUND_CELL };
            let row = |(y, keys): (usize, &mut [u64])| {
                let row = |y: usize| &cells[y * width..(y + 1) * width];
                let here = row(y);
                if y == 0 || y + 1 == height {
                    return;
                }
                let (above, below) = (row(y - 1), row(y + 1));
                for x in 1..width - 1 {
                    let own = here[x].load(Ordering::Relaxed);
                    let nearer = if own == EMPTY { EMPTY } else { key_of(depth_of(own) * IN_FRONT, u32::MAX) };
                    let mut count = 0;
                    let mut front = EMPTY;
                    for other in [
                        &above[x - 1],
                        &above[x],
                        &above[x + 1],
                        &here[x - 1],
                        &here[x + 1],
                        &below[x - 1],
                        &below[x],
                        &below[x + 1],
                    ] {
                        let other = other.load(Ordering::Relaxed);
                        count += usize::from(other < nearer);
                        front = if other < front { other } else { front };
                    }
                    keys[x] = if count >= enough { front } else { own };
                }
            };
            self.keys[start..start + width * height].par_chunks_mut(width).with_min_len(8).enumerate().for_each(row);
        }
    }

    /// The key of the cell of a level that contains a pixel.
    #[inline(always)]
    pub fn key(&self, level: usize, x: usize, y: usize) -> u64 {
        let (x, y) = (x + MARGIN, y + MARGIN);
        self.keys[self.starts[level] + (y >> level) * self.widths[level] + (x >> level)]
    }

    /// The nearest key of two levels, and its level. The splats of a coarser level hide those of a finer one only if they
    /// are nearer: beside one another on a surface, the finer ones show more.
    #[inline(always)]
    pub fn nearer(coarse: (u64, usize), fine: u64, level: usize) -> (u64, usize) {
        let hides = fine == EMPTY || depth_of(coarse.0) < depth_of(fine) * NEARER;
        if coarse.0 != EMPTY && hides { coarse } else { (fine, level) }
    }

    /// The nearest key of all levels at a pixel.
    pub fn nearest(&self, x: usize, y: usize) -> u64 {
        let levels = (0..LEVELS).rev();
        levels.fold((EMPTY, 0), |nearest, level| Self::nearer(nearest, self.key(level, x, y), level)).0
    }

    /// The places of the cell of a level that contains a pixel, and of the three beside it that are nearest to the pixel,
    /// among the cells of all levels but the finest. `level` is at least 1.
    #[inline(always)]
    pub fn around(&self, level: usize, x: usize, y: usize) -> [usize; 4] {
        let half = 1 << (level - 1);
        let (left, top) = ((x + MARGIN - half) >> level, (y + MARGIN - half) >> level);
        let width = self.widths[level];
        let first = self.starts[level] - self.starts[1] + top * width + left;
        [first, first + 1, first + width, first + width + 1]
    }

    /// The first of four by four cells of a level, whose splats may reach a pixel, among the cells of all levels but the
    /// finest, and the number of cells in a row: a splat is at most four cells wide. `level` is at least 1.
    #[inline(always)]
    pub fn reaching(&self, level: usize, x: usize, y: usize) -> [usize; 2] {
        let half = 1 << (level - 1);
        let (width, height) = (self.widths[level], self.heights[level]);
        // At the border of the pyramid, the nearest four.
        let first = |at: usize, cells: usize| ((at + MARGIN - half) >> level).clamp(1, cells - 3) - 1;
        [self.starts[level] - self.starts[1] + first(y, height) * width + first(x, width), width]
    }

    /// The depth of the point in a cell, which is numbered among those of all levels but the finest. It is no number where
    /// there is no point.
    #[inline(always)]
    pub fn coarse_depth(&self, cell: usize) -> f32 {
        depth_of(self.cells[self.starts[1] + cell].load(Ordering::Relaxed))
    }

    /// Takes in the nearest points of a level around a pixel whose splats may reach it. `level` is at least 1.
    #[inline(always)]
    pub fn look_around(&self, level: usize, x: usize, y: usize, mut sides: Sides) -> Sides {
        let [first, width] = self.reaching(level, x, y);
        let two = |cell: usize| {
            let [left, right] = [&self.cells[cell], &self.cells[cell + 1]];
            left.load(Ordering::Relaxed).min(right.load(Ordering::Relaxed))
        };
        let quarter = |cell: usize| two(cell).min(two(cell + width));
        let top = self.starts[1] + first;
        let bottom = top + 2 * width;
        let (mut above, mut below) = ([quarter(top), quarter(top + 2)], [quarter(bottom), quarter(bottom + 2)]);
        // Beside the picture there may be as much as on the other side.
        let reach = 2 << level;
        if x < reach || x + reach > self.size[0] as usize {
            (above, below) = ([above[0].min(above[1]); 2], [below[0].min(below[1]); 2]);
        }
        if y < reach || y + reach > self.size[1] as usize {
            above = [above[0].min(below[0]), above[1].min(below[1])];
            below = above;
        }
        sides.top_left = sides.top_left.min(above[0]);
        sides.top_right = sides.top_right.min(above[1]);
        sides.bottom_left = sides.bottom_left.min(below[0]);
        sides.bottom_right = sides.bottom_right.min(below[1]);
        sides
    }

    /// The keys of the cells of all levels but the finest.
    pub fn coarse(&self) -> impl IndexedParallelIterator<Item = u64> {
        self.cells[self.starts[1]..].par_iter().map(|cell| cell.load(Ordering::Relaxed))
    }
}
