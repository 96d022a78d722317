//! Integer coordinates of points, and the cells of the octree in which they lie.

use cloud::Grid;
use glam::DVec3;

/// The number of cell levels that a place distinguishes; it has as many bits per axis.
pub const DEPTH: u8 = 42;
/// The number of levels that one key distinguishes.
pub const KEY_LEVELS: u8 = 21;
const KEY_MASK: u64 = (1 << KEY_LEVELS) - 1;

/// The lattice on which all points of an index lie, `offset + integer * scale`, and the root's cube.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    pub grid: Grid,
    /// The lower corner of the root's cube, in world coordinates.
    pub corner: DVec3,
    /// The width of the root's cube in world units.
    pub width: f64,
}

impl Lattice {
    pub fn world(&self, at: [i64; 3]) -> DVec3 {
        DVec3::from(at.map(|value| value as f64)) * self.grid.scale + self.grid.offset
    }

    /// The conversion from lattice steps to places.
    pub fn placing(&self) -> Placing {
        let cells = f64::from(DEPTH).exp2() / self.width;
        Placing {
            factor: (self.grid.scale * cells).to_array(),
            start: ((self.grid.offset - self.corner) * cells).to_array(),
        }
    }
}

/// Finds the place of a point in the root's cube: `DEPTH` bits per axis.
#[derive(Clone, Copy, Debug)]
pub struct Placing {
    factor: [f64; 3],
    start: [f64; 3],
}

impl Placing {
    /// The place of a point; points outside the cube count to the cells at its sides.
    #[inline]
    pub fn place(&self, at: [i64; 3]) -> [u64; 3] {
        const LAST: u64 = (1 << DEPTH) - 1;
        // `as` turns negative numbers into 0.
        std::array::from_fn(|axis| ((at[axis] as f64 * self.factor[axis] + self.start[axis]) as u64).min(LAST))
    }

    pub fn is_inside(&self, at: [f64; 3]) -> bool {
        let end = f64::from(DEPTH).exp2();
        (0..3).all(|axis| {
            let place = at[axis] * self.factor[axis] + self.start[axis];
            place >= 0.0 && place < end
        })
    }
}

/// The `KEY_LEVELS` bits per axis of a place that follow the first `level`.
#[inline]
pub fn below(place: [u64; 3], level: u8) -> [u32; 3] {
    const SPARE: u8 = DEPTH - KEY_LEVELS;
    place.map(|bits| {
        let bits = if level <= SPARE { bits >> (SPARE - level) } else { bits << (level - SPARE) };
        (bits & KEY_MASK) as u32
    })
}

/// The rank along the Morton curve: bits of x, y, z in turn, x lowest.
#[inline]
pub fn morton(at: [u32; 3]) -> u64 {
    #[inline]
    fn spread(value: u32) -> u64 {
        let mut bits = u64::from(value) & KEY_MASK;
        bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x1249_2492_4924_9249
    }
    spread(at[0]) | spread(at[1]) << 1 | spread(at[2]) << 2
}

/// A cube of the octree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Cell {
    pub level: u8,
    /// The number of cubes of this level before it, per axis.
    pub at: [u64; 3],
}

impl Cell {
    pub const ROOT: Self = Self { level: 0, at: [0; 3] };

    /// The cell of `level` (its own or above) that contains it.
    pub fn ancestor(self, level: u8) -> Self {
        let up = self.level - level.min(self.level);
        Self { level: self.level - up, at: self.at.map(|value| value >> up) }
    }

    /// The cell above; `None` for the root.
    pub fn parent(self) -> Option<Self> {
        (self.level > 0).then(|| self.ancestor(self.level - 1))
    }

    /// The number of the cell among its parent's children.
    pub fn octant(self) -> usize {
        (0..3).map(|axis| ((self.at[axis] & 1) as usize) << axis).sum()
    }

    pub fn child(self, octant: usize) -> Self {
        let at = std::array::from_fn(|axis| self.at[axis] << 1 | (octant as u64 >> axis & 1));
        Self { level: self.level + 1, at }
    }

    /// The cell `levels` below with this rank along the Morton curve.
    pub fn descendant(self, levels: u8, rank: u64) -> Self {
        (0..levels).rev().fold(self, |cell, level| cell.child((rank >> (3 * level) & 7) as usize))
    }

    /// A key that sorts cells along the Morton curve, if none contains another. For levels up to `DEPTH`.
    pub fn rank(self) -> u128 {
        let aligned = self.at.map(|value| value << (DEPTH - self.level.min(DEPTH)));
        let high = morton(below(aligned, 0));
        let low = morton(below(aligned, KEY_LEVELS));
        u128::from(high) << 63 | u128::from(low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_name_the_octants_from_the_root_down() {
        let place = [0b101 << (DEPTH - 3), 0b011 << (DEPTH - 3), 0b110 << (DEPTH - 3)];
        let key = morton(below(place, 0));
        let octant = |level: u8| (key >> (3 * (KEY_LEVELS - 1 - level)) & 7) as usize;
        assert_eq!([octant(0), octant(1), octant(2)], [0b101, 0b110, 0b011]);
        assert_eq!(morton(below(place, 1)) >> 60, octant(1) as u64);
        let cell = Cell::ROOT.descendant(3, key >> (3 * (KEY_LEVELS - 3)));
        assert_eq!(cell, Cell { level: 3, at: [0b101, 0b011, 0b110] });
        assert_eq!((cell.octant(), cell.parent().unwrap().octant()), (0b011, 0b110));
        assert_eq!(cell.rank() >> 123 & 7, 0b101, "126 bits, the first octant highest");
    }
}
