//! Chooses the points that represent the others: sorts points and takes one of each cell.

use crate::lattice::{KEY_LEVELS, Placing, below, morton};
use crate::records::Layout;

/// A point that is in no node yet.
#[derive(Clone, Copy, Debug)]
pub struct Candidate {
    /// The rank along the Morton curve below some level.
    pub key: u64,
    /// The position as integers per axis.
    pub at: [u32; 3],
    /// The index of its record.
    pub index: u32,
}

/// Candidates for `indices` along the Morton curve below `level`. Points with equal keys are sorted by the bytes of
/// their records, so that the order of arrival does not matter.
pub fn sorted(
    layout: &Layout,
    placing: &Placing,
    records: &[u8],
    indices: impl ExactSizeIterator<Item = u32>,
    level: u8,
) -> Vec<Candidate> {
    let stride = layout.stride();
    let record = |index: u32| &records[index as usize * stride..(index as usize + 1) * stride];
    let place = |index: u32| below(placing.place(layout.at(record(index))), level);
    let mut keys: Vec<(u64, u32)> = Vec::with_capacity(indices.len());
    keys.extend(indices.map(|index| (morton(place(index)), index)));
    keys.sort_unstable_by_key(|&(key, _)| key);
    for run in keys.chunk_by_mut(|a, b| a.0 == b.0).filter(|run| run.len() > 1) {
        run.sort_unstable_by(|a, b| record(a.1).cmp(record(b.1)));
    }
    keys.into_iter().map(|(key, index)| Candidate { key, at: place(index), index }).collect()
}

/// Decides which cells give a point, evenly, where there are too many cells for a node.
#[derive(Clone, Copy, Debug)]
pub struct Thinning {
    cells: u64,
    limit: u64,
    next: u64,
}

impl Thinning {
    /// Up to `limit` of `cells` cells give a point; `next` is the number of the next cell.
    pub fn new(cells: u64, limit: u64, next: u64) -> Self {
        Self { cells, limit, next }
    }

    #[inline]
    fn takes_next(&mut self) -> bool {
        let rank = self.next;
        self.next += 1;
        let picks = |rank: u64| (u128::from(rank) * u128::from(self.limit) / u128::from(self.cells.max(1))) as u64;
        self.cells <= self.limit || picks(rank + 1) > picks(rank)
    }
}

/// The number of key bits below cells that are `depth` levels under the level of the keys.
fn shift(depth: u8) -> u32 {
    3 * u32::from(KEY_LEVELS - depth)
}

/// The number of cells that hold points.
pub fn count_cells(points: &[Candidate], depth: u8) -> u64 {
    points.chunk_by(|a, b| a.key >> shift(depth) == b.key >> shift(depth)).count() as u64
}

/// Takes the point nearest the middle of each cell `depth` levels under the level of the keys, and moves the others to
/// the front, in order. Returns how many are left.
pub fn take(points: &mut [Candidate], depth: u8, mut thinning: Thinning, taken: &mut Vec<Candidate>) -> usize {
    let shift = shift(depth);
    let cell_mask = ((1_u64 << (KEY_LEVELS - depth)) - 1) as u32;
    let middle = i64::from(cell_mask / 2);
    let distance = |point: &Candidate| -> i64 {
        let offset = |axis: usize| i64::from(point.at[axis] & cell_mask) - middle;
        (0..3).map(|axis| offset(axis) * offset(axis)).sum()
    };
    let (mut left, mut start) = (0, 0);
    while start < points.len() {
        let cell = points[start].key >> shift;
        let (mut best, mut least) = (start, distance(&points[start]));
        let mut end = start + 1;
        while end < points.len() && points[end].key >> shift == cell {
            let distance = distance(&points[end]);
            if distance < least {
                (best, least) = (end, distance);
            }
            end += 1;
        }
        if !thinning.takes_next() {
            best = end;
        }
        for index in start..end {
            if index == best {
                taken.push(points[index]);
            } else {
                points[left] = points[index];
                left += 1;
            }
        }
        start = end;
    }
    left
}
