//! Builds the nodes of the octree from buckets, from the root down, several buckets at once.
//!
//! The node of level L takes one point of each cell of level L + 7. A cell of that size lies within a bucket as long as
//! the bucket is at most seven levels below the node, so each bucket chooses for the nodes above it on its own. The
//! distribution has counted those cells, and their number decides how much they are thinned. For nodes still further
//! up, whose cells hold whole buckets, the largest bucket in a cell gives the cell's point.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use cloud::{CHUNK_POINTS, Progress};

use crate::buckets::{Bucket, KNOWN_LEVELS};
use crate::lattice::{Cell, DEPTH, KEY_LEVELS, Placing};
use crate::page;
use crate::pages::{Page, Written};
use crate::records::Layout;
use crate::selection::{Candidate, Thinning, count_cells, sorted, take};
use crate::storage::Storage;
use crate::{Error, Result};

/// A node's cells are this many levels below it: 128 along each edge.
const CELL_LEVELS: u8 = 7;
/// A node with this many points or fewer has no children.
const LEAF_POINTS: usize = 40_000;
/// The largest number of cells that give a node a point.
const NODE_CELLS: u64 = 50_000;
/// A child with fewer points is joined to its parent.
const FEW_POINTS: usize = 2_000;
/// The memory in bytes that a bucket takes for each point besides its record: keys while they are sorted, then
/// candidates.
pub const BYTES_PER_POINT: u64 = 16 + 24 + 8;

/// The input of the nodes, and where their pages are written.
pub struct Tree<'a> {
    pub layout: &'a Layout,
    pub placing: Placing,
    pub temporary: &'a Storage,
    pub pages: &'a Storage,
    pub progress: &'a Progress,
}

/// A node above the buckets, until all below it are done.
#[derive(Default)]
struct Ancestor {
    /// The number of children that are not done.
    waiting: usize,
    /// The records that buckets chose, with the buckets' numbers.
    parts: Vec<(usize, Vec<u8>)>,
    /// The records of children with few points.
    small: Vec<(Cell, Vec<u8>)>,
    /// Whether it has children that are nodes.
    divided: bool,
}

/// The points that a bucket gives to its ancestor at one level.
#[derive(Clone, Copy)]
enum Share {
    Nothing,
    /// One point, for a cell that holds the whole bucket.
    One,
    /// One point for each cell `depth` levels below the bucket.
    Cells {
        depth: u8,
        thinning: Thinning,
    },
}

/// The bytes that are lent to the buckets being worked on.
struct Memory {
    free: Mutex<u64>,
    returned: Condvar,
}

/// The state that all threads share.
struct Work<'a> {
    tree: &'a Tree<'a>,
    buckets: &'a [Bucket],
    /// For each bucket, its share for each level above it.
    shares: Vec<Vec<Share>>,
    ancestors: Mutex<HashMap<Cell, Ancestor>>,
    written: Mutex<Vec<Written>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Tree<'_> {
    /// Writes the pages of all nodes. `buckets` are in the order of the Morton curve. Uses about `memory` bytes, or the
    /// memory of one bucket.
    pub fn build(&self, buckets: &[Bucket], memory: u64) -> Result<Vec<Written>> {
        let work = Work {
            tree: self,
            buckets,
            shares: shares(buckets),
            ancestors: Mutex::new(ancestors(buckets)),
            written: Mutex::default(),
        };
        let bytes_per_point = BYTES_PER_POINT + self.layout.stride() as u64;
        let lent = Memory { free: Mutex::new(memory), returned: Condvar::new() };
        let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
        let failure = Mutex::new(None);
        let run = || {
            while !stop.load(Ordering::Relaxed)
                && let index = next.fetch_add(1, Ordering::Relaxed)
                && let Some(bucket) = buckets.get(index)
            {
                let bytes = (bucket.points * bytes_per_point).min(memory);
                lent.borrow(bytes);
                let outcome = work.bucket(index);
                lent.give_back(bytes);
                if let Err(error) = outcome {
                    locked(&failure).get_or_insert(error);
                    stop.store(true, Ordering::Relaxed);
                }
            }
        };
        let threads = std::thread::available_parallelism().map_or(1, usize::from).min(buckets.len());
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(run);
            }
            run();
        });
        match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(error) => Err(error),
            None => Ok(work.written.into_inner().unwrap_or_else(PoisonError::into_inner)),
        }
    }
}

impl Memory {
    fn borrow(&self, bytes: u64) {
        let mut free = locked(&self.free);
        while *free < bytes {
            free = self.returned.wait(free).unwrap_or_else(PoisonError::into_inner);
        }
        *free -= bytes;
    }

    fn give_back(&self, bytes: u64) {
        *locked(&self.free) += bytes;
        self.returned.notify_all();
    }
}

/// For each bucket, what it gives to each level above it.
fn shares(buckets: &[Bucket]) -> Vec<Vec<Share>> {
    let mut cells: HashMap<Cell, u64> = HashMap::new();
    // For each cell that holds whole buckets, the largest bucket in it; the first of equal ones.
    let mut largest: HashMap<Cell, (u64, usize)> = HashMap::new();
    let known = |bucket: &Bucket, level: u8| {
        let depth = (level + CELL_LEVELS).checked_sub(bucket.cell.level)?;
        debug_assert!(depth <= KNOWN_LEVELS);
        Some(depth)
    };
    for (index, bucket) in buckets.iter().enumerate() {
        for level in 0..bucket.cell.level {
            match known(bucket, level) {
                Some(depth) => *cells.entry(bucket.cell.ancestor(level)).or_default() += bucket.occupied(depth),
                None => {
                    let most = largest.entry(bucket.cell.ancestor(level + CELL_LEVELS)).or_insert((0, index));
                    if bucket.points > most.0 {
                        *most = (bucket.points, index);
                    }
                }
            }
        }
    }
    let mut before: HashMap<Cell, u64> = HashMap::new();
    let mut share = |index: usize, bucket: &Bucket, level: u8| match known(bucket, level) {
        Some(depth) => {
            let cell = bucket.cell.ancestor(level);
            let before = before.entry(cell).or_default();
            let thinning = Thinning::new(cells[&cell], NODE_CELLS, *before);
            *before += bucket.occupied(depth);
            Share::Cells { depth, thinning }
        }
        None if largest[&bucket.cell.ancestor(level + CELL_LEVELS)].1 == index => Share::One,
        None => Share::Nothing,
    };
    let all = |(index, bucket): (usize, &Bucket)| (0..bucket.cell.level).map(|l| share(index, bucket, l)).collect();
    buckets.iter().enumerate().map(all).collect()
}

/// The nodes above the buckets.
fn ancestors(buckets: &[Bucket]) -> HashMap<Cell, Ancestor> {
    let mut ancestors: HashMap<Cell, Ancestor> = HashMap::new();
    for bucket in buckets {
        let mut cell = bucket.cell;
        while let Some(parent) = cell.parent() {
            let ancestor = ancestors.entry(parent).or_default();
            ancestor.waiting += 1;
            if ancestor.waiting > 1 {
                break;
            }
            cell = parent;
        }
    }
    ancestors
}

impl Work<'_> {
    fn bucket(&self, index: usize) -> Result<()> {
        let bucket = &self.buckets[index];
        let layout = self.tree.layout;
        if bucket.heap {
            return self.heap_bucket(index);
        }
        let records = bucket.load(self.tree.temporary)?;
        let count = (records.len() / layout.stride()) as u32;
        let mut points = sorted(layout, &self.tree.placing, &records, 0..count, bucket.cell.level);
        let mut left = points.len();
        for (level, share) in (0..bucket.cell.level).zip(&self.shares[index]) {
            let mut taken = Vec::new();
            match *share {
                Share::Nothing => continue,
                Share::One => left = take(&mut points[..left], 0, Thinning::new(1, 1, 0), &mut taken),
                Share::Cells { depth, thinning } => {
                    left = take(&mut points[..left], depth, thinning, &mut taken);
                    // A node with points below it is never without points.
                    if taken.is_empty() && left > FEW_POINTS {
                        left = take(&mut points[..left], 0, Thinning::new(1, 1, 0), &mut taken);
                    }
                }
            }
            self.give(bucket.cell.ancestor(level), index, self.gather(&records, &taken));
        }
        points.truncate(left);
        let small = if left < FEW_POINTS && bucket.cell.level > 0 {
            Some(self.gather(&records, &points))
        } else {
            self.grow(&records, bucket.cell, &mut points, bucket.cell.level)?;
            None
        };
        self.tree.progress.add(bucket.points);
        self.done(bucket.cell, small)
    }

    /// Writes a bucket whose points are all in one place and too many to be in memory at once.
    fn heap_bucket(&self, index: usize) -> Result<()> {
        let bucket = &self.buckets[index];
        let stride = self.tree.layout.stride();
        let mut levels = self.shares[index].iter().zip(0..).filter(|(share, _)| !matches!(share, Share::Nothing));
        let mut node = 0;
        let mut rest = Vec::new();
        bucket.read(self.tree.temporary, CHUNK_POINTS * stride, |records| {
            rest.extend_from_slice(records);
            for (_, level) in levels.by_ref() {
                self.give(bucket.cell.ancestor(level), index, rest.split_off(rest.len() - stride));
            }
            while rest.len() >= CHUNK_POINTS * stride {
                let more = rest.split_off(CHUNK_POINTS * stride);
                self.write_records(heap_cell(bucket.cell, node), &rest)?;
                node += 1;
                rest = more;
            }
            Ok(())
        })?;
        if !rest.is_empty() {
            self.write_records(heap_cell(bucket.cell, node), &rest)?;
        }
        self.tree.progress.add(bucket.points);
        self.done(bucket.cell, None)
    }

    fn gather(&self, records: &[u8], points: &[Candidate]) -> Vec<u8> {
        let stride = self.tree.layout.stride();
        let mut gathered = Vec::with_capacity(points.len() * stride);
        for point in points {
            let start = point.index as usize * stride;
            gathered.extend_from_slice(&records[start..start + stride]);
        }
        gathered
    }

    fn give(&self, ancestor: Cell, bucket: usize, records: Vec<u8>) {
        if let Some(ancestor) = locked(&self.ancestors).get_mut(&ancestor) {
            ancestor.parts.push((bucket, records));
        }
    }

    /// Writes the node of `cell` and those below it. The keys of `points` are below level `base`, the cell's level or
    /// the one above.
    fn grow(&self, records: &[u8], cell: Cell, points: &mut [Candidate], base: u8) -> Result<()> {
        let layout = self.tree.layout;
        if self.tree.progress.is_cancelled() {
            return Err(Error::Cancelled);
        }
        if points.len() <= LEAF_POINTS {
            return self.write(records, cell, points);
        }
        if cell.level + CELL_LEVELS > DEPTH || self.in_one_place(records, points) {
            let piece = |(node, points)| self.write(records, heap_cell(cell, node), points);
            return points.chunks(CHUNK_POINTS).enumerate().try_for_each(piece);
        }
        let level = cell.level - base;
        if level + CELL_LEVELS > KEY_LEVELS {
            let indices = points.iter().map(|point| point.index);
            let mut points = sorted(layout, &self.tree.placing, records, indices, cell.level);
            return self.grow(records, cell, &mut points, cell.level);
        }
        let mut taken = Vec::new();
        let thinning = Thinning::new(count_cells(points, level + CELL_LEVELS), NODE_CELLS, 0);
        let left = take(points, level + CELL_LEVELS, thinning, &mut taken);
        let shift = 3 * u32::from(KEY_LEVELS - level - 1);
        let mut absorbed = false;
        for child in points[..left].chunk_by_mut(|a, b| a.key >> shift == b.key >> shift) {
            if child.len() < FEW_POINTS && taken.len() + child.len() <= CHUNK_POINTS {
                taken.extend_from_slice(child);
                absorbed = true;
            } else {
                let octant = (child[0].key >> shift & 7) as usize;
                self.grow(records, cell.child(octant), child, base)?;
            }
        }
        if absorbed {
            taken.sort_by_key(|point| point.key);
        }
        self.write(records, cell, &taken)
    }

    fn in_one_place(&self, records: &[u8], points: &[Candidate]) -> bool {
        let (layout, stride) = (self.tree.layout, self.tree.layout.stride());
        let at = |point: &Candidate| layout.at(&records[point.index as usize * stride..][..stride]);
        match points {
            [first, .., last] => first.key == last.key && points.iter().all(|point| at(point) == at(first)),
            _ => true,
        }
    }

    /// Informs the node above that a child is done. If the child has too few points for a node, `small` is its records.
    fn done(&self, mut cell: Cell, mut small: Option<Vec<u8>>) -> Result<()> {
        while let Some(parent) = cell.parent() {
            let ancestor = {
                let mut ancestors = locked(&self.ancestors);
                let Some(ancestor) = ancestors.get_mut(&parent) else { return Ok(()) };
                match small.take() {
                    Some(records) => ancestor.small.push((cell, records)),
                    None => ancestor.divided = true,
                }
                ancestor.waiting -= 1;
                if ancestor.waiting > 0 {
                    return Ok(());
                }
                ancestors.remove(&parent).unwrap_or_default()
            };
            small = self.finish(parent, ancestor)?;
            cell = parent;
        }
        Ok(())
    }

    /// Writes a node above the buckets; if it has too few points, returns their records for its parent instead.
    fn finish(&self, cell: Cell, mut ancestor: Ancestor) -> Result<Option<Vec<u8>>> {
        let stride = self.tree.layout.stride();
        ancestor.parts.sort_by_key(|(bucket, _)| *bucket);
        let mut records = ancestor.parts.into_iter().flat_map(|(_, records)| records).collect::<Vec<u8>>();
        ancestor.small.sort_by_key(|(cell, records)| (records.len(), cell.octant()));
        for (child, small) in ancestor.small {
            if records.len() + small.len() <= CHUNK_POINTS * stride {
                records.extend(small);
            } else {
                self.write_records(child, &small)?;
                ancestor.divided = true;
            }
        }
        if !ancestor.divided && records.len() < FEW_POINTS * stride && cell.level > 0 {
            return Ok(Some(records));
        }
        self.write_records(cell, &records)?;
        Ok(None)
    }

    fn write_records(&self, cell: Cell, records: &[u8]) -> Result<()> {
        let layout = self.tree.layout;
        let count = (records.len() / layout.stride()) as u32;
        let points = sorted(layout, &self.tree.placing, records, 0..count, cell.level.min(DEPTH));
        self.write(records, cell, &points)
    }

    /// Writes a node. `points` are in the order of the Morton curve.
    fn write(&self, records: &[u8], cell: Cell, points: &[Candidate]) -> Result<()> {
        let (place, bytes) = page::encode(self.tree.layout, &self.gather(records, points));
        let checksum = crc32fast::hash(&bytes);
        let offset = self.tree.pages.append(&bytes)?;
        let page = Page { place, offset, checksum };
        locked(&self.written).push(Written { cell, points: points.len() as u32, page });
        Ok(())
    }
}

/// The cell of a node of points that no cell separates: the first node is `cell`, and each has eight below it.
fn heap_cell(cell: Cell, node: usize) -> Cell {
    if node == 0 { cell } else { heap_cell(cell, (node - 1) / 8).child((node - 1) % 8) }
}
