//! Decides which node of the octree a point goes to.
//!
//! Points have keys: 21 bits per axis of their place in the root's cube, interleaved, so that a cell of any level is a
//! range of keys. A node keeps one point per cell seven levels below it (128 cells along its edge), the one nearest to
//! the cell's middle; its children take the others.

use cloud::Grid;
use glam::{DVec3, IVec3};

/// The number of cell levels that a key distinguishes.
pub const KEY_LEVELS: u32 = 21;
/// The number of levels between a node and the cells of which it keeps a point.
pub const CELL_LEVELS: u32 = 7;
/// The most points that are one node without children.
const LEAF: usize = 65_536;
/// Children with fewer points than this stay in their parent.
const FEW: usize = 4_000;
/// The most points that a node keeps; with more it takes larger cells.
const MOST: usize = 50_000;

/// The root's cube on the grid of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cube {
    pub corner: DVec3,
    pub width: f64,
    grid: Grid,
}

impl Cube {
    /// A cube that contains everything between two corners, both included.
    pub fn new(lowest: DVec3, highest: DVec3, grid: Grid) -> Self {
        // Far from the origin a step of the grid may be less than the precision of the numbers.
        let largest = lowest.abs().max(highest.abs()).max_element();
        let margin = grid.scale.abs().max(DVec3::splat(4.0 * f64::EPSILON * largest));
        let width = (highest - lowest + 2.0 * margin).max_element();
        Self { corner: lowest - margin, width, grid }
    }

    pub fn holds(&self, point: DVec3) -> bool {
        point.cmpge(self.corner).all() && point.cmplt(self.corner + self.width).all()
    }

    /// The key of a point; for a point outside, the key of the nearest cell.
    pub fn key(&self, raw: [i32; 3]) -> u64 {
        let world = IVec3::from(raw).as_dvec3() * self.grid.scale + self.grid.offset;
        let cells = f64::from(1_u32 << KEY_LEVELS);
        let cell = ((world - self.corner) / self.width * cells).clamp(DVec3::ZERO, DVec3::splat(cells - 1.0));
        interleave(cell.to_array().map(|cell| cell as u32))
    }
}

/// A point: its key, and its index in a list of records.
pub type Keyed = (u64, u32);

/// The code of a cell of `level`: its keys without the bits of further levels.
pub fn code(key: u64, level: u32) -> u64 {
    key >> (3 * (KEY_LEVELS - level))
}

/// Interleaves the bits of x, y and z, x lowest.
fn interleave(cell: [u32; 3]) -> u64 {
    let spread = |value: u32| {
        let mut bits = u64::from(value) & 0x1f_ffff;
        bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x1249_2492_4924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// The number of cells before it in x, y and z.
pub fn cell(code: u64) -> [u32; 3] {
    let gather = |bits: u64| {
        let mut bits = bits & 0x1249_2492_4924_9249;
        bits = (bits | bits >> 2) & 0x10c3_0c30_c30c_30c3;
        bits = (bits | bits >> 4) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits >> 8) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits >> 16) & 0x001f_0000_0000_ffff;
        (bits | bits >> 32) as u32 & 0x1f_ffff
    };
    [gather(code), gather(code >> 1), gather(code >> 2)]
}

/// Takes one point of each cell of `level` for which `free` returns true out of sorted `points`.
pub fn take(points: &mut Vec<Keyed>, level: u32, mut free: impl FnMut(u64) -> bool) -> Vec<Keyed> {
    let mut taken = Vec::new();
    let mut rest = Vec::with_capacity(points.len());
    for run in points.chunk_by(|a, b| code(a.0, level) == code(b.0, level)) {
        if !free(code(run[0].0, level)) {
            rest.extend_from_slice(run);
            continue;
        }
        let nearest = if run.len() == 1 { 0 } else { nearest_to_middle(run, level) };
        taken.push(run[nearest]);
        rest.extend_from_slice(&run[..nearest]);
        rest.extend_from_slice(&run[nearest + 1..]);
    }
    *points = rest;
    taken
}

fn nearest_to_middle(run: &[Keyed], level: u32) -> usize {
    let below = (1_u32 << (KEY_LEVELS - level)) - 1;
    let distance = |(index, point): (usize, &Keyed)| {
        // Twice the distance, so that the middle of an even number of cells is whole.
        let apart = cell(point.0).map(|at| (2 * i64::from(at & below) - i64::from(below)).pow(2));
        (apart.iter().sum::<i64>(), index)
    };
    run.iter().enumerate().map(distance).min().map_or(0, |(_, index)| index)
}

/// A node and its points.
#[derive(Debug)]
pub struct Filled {
    pub level: u32,
    pub code: u64,
    pub points: Vec<Keyed>,
}

/// Makes nodes of sorted `points`, which all lie in one node of `level`, from it downwards.
pub fn fill(mut points: Vec<Keyed>, level: u32, nodes: &mut Vec<Filled>) {
    let Some(first) = points.first() else { return };
    let own_code = code(first.0, level);
    let mut cells = level + CELL_LEVELS;
    if points.len() <= LEAF || cells > KEY_LEVELS {
        nodes.push(Filled { level, code: own_code, points });
        return;
    }
    let occupied = |cells: u32| points.chunk_by(|a, b| code(a.0, cells) == code(b.0, cells)).count();
    while cells > level + 1 && occupied(cells) > MOST {
        cells -= 1;
    }
    let mut own = take(&mut points, cells, |_| true);
    let at = nodes.len();
    nodes.push(Filled { level, code: own_code, points: Vec::new() });
    for child in points.chunk_by(|a, b| code(a.0, level + 1) == code(b.0, level + 1)) {
        if child.len() < FEW {
            own.extend_from_slice(child);
        } else {
            fill(child.to_vec(), level + 1, nodes);
        }
    }
    nodes[at].points = own;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_cells_are_inverse() {
        for place in [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0x1f_ffff, 5, 0x12_3456]] {
            assert_eq!(cell(interleave(place)), place);
        }
        assert_eq!(cell(code(interleave([0x1f_ffff, 0, 1 << 20]), 1)), [1, 0, 1]);
    }

    #[test]
    fn every_point_is_in_one_node_and_in_its_cube() {
        let mut state = 1_u64;
        let mut points: Vec<Keyed> = (0..400_000)
            .map(|index| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                // Half of them are in a corner, many at one place.
                let key = if index % 2 == 0 { state >> 1 } else { state >> 31 };
                (if index % 10 == 0 { 77 } else { key }, index)
            })
            .collect();
        points.sort_unstable();
        let mut nodes = Vec::new();
        fill(points.clone(), 0, &mut nodes);
        assert!(nodes.len() > 5);
        for node in &nodes {
            assert!(node.points.iter().all(|point| code(point.0, node.level) == node.code));
            let parent = |other: &Filled| other.level + 1 == node.level && other.code == node.code >> 3;
            assert!(node.level == 0 || nodes.iter().any(parent));
        }
        let mut all: Vec<Keyed> = nodes.into_iter().flat_map(|node| node.points).collect();
        all.sort_unstable();
        assert!(all == points);
    }
}
