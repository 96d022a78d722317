//! Points sorted roughly: buckets, which are cells of the octree small enough to be held in memory, kept in one temporary
//! file.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};

use crate::Result;
use crate::lattice::{Cell, DEPTH, KEY_LEVELS, Placing, below, morton};
use crate::records::Layout;
use crate::storage::Storage;

/// Levels below a bucket whose occupied cells are known: nodes of the seven levels above it choose among these.
pub const KNOWN_LEVELS: u8 = 6;
/// Cells of the last of them, a bit each.
const KNOWN_BYTES: usize = 1 << (3 * KNOWN_LEVELS as usize - 3);
/// Most levels one distribution goes down.
const MOST_DEPTH: u8 = KEY_LEVELS - KNOWN_LEVELS;
/// Cells that a bucket is cut into at most, as far as a sample tells.
const MOST_CELLS: u64 = 4096;
/// Cells of a distribution that are worth its pass however little memory there is.
const FEWEST_CELLS: u64 = 64;
/// A bucket of this level is not cut any further: a node of it could not tell enough cells apart.
pub const LAST_LEVEL: u8 = DEPTH - 7;
/// Bytes a bucket is written in.
const BLOCK_BYTES: usize = 128 << 10;

/// The points in one cell.
pub struct Bucket {
    pub cell: Cell,
    pub points: u64,
    /// Where in the temporary file its records are: offset, bytes.
    extents: Vec<(u64, u32)>,
    /// Records that are not written yet.
    buffer: Vec<u8>,
    /// Cells with points in them, by levels below it.
    occupied: [u32; KNOWN_LEVELS as usize + 1],
    /// Cannot be cut: its points are in one place.
    pub heap: bool,
}

impl Bucket {
    fn new(cell: Cell) -> Self {
        let occupied = [1, 0, 0, 0, 0, 0, 0];
        Self { cell, points: 0, extents: Vec::new(), buffer: Vec::new(), occupied, heap: false }
    }

    /// Cells `depth` levels below it that have points in them; `depth` up to `KNOWN_LEVELS`.
    pub fn occupied(&self, depth: u8) -> u64 {
        if self.heap { 1 } else { u64::from(self.occupied[usize::from(depth)]) }
    }

    fn flush(&mut self, storage: &Storage) -> Result<()> {
        if !self.buffer.is_empty() {
            let offset = storage.append(&self.buffer)?;
            self.extents.push((offset, self.buffer.len() as u32));
            self.buffer.clear();
        }
        Ok(())
    }

    /// Its records, at most `bytes` at once (a block at least).
    pub fn read(&self, storage: &Storage, bytes: usize, mut give: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let mut records = Vec::with_capacity(bytes.min(self.extents.iter().map(|extent| extent.1 as usize).sum()));
        for &(offset, length) in &self.extents {
            if !records.is_empty() && records.len() + length as usize > bytes {
                give(&records)?;
                records.clear();
            }
            let start = records.len();
            records.resize(start + length as usize, 0);
            storage.read(offset, &mut records[start..])?;
        }
        if !self.buffer.is_empty() {
            records.extend_from_slice(&self.buffer);
        }
        give(&records)
    }

    /// All its records.
    pub fn load(&self, storage: &Storage) -> Result<Vec<u8>> {
        let length: usize = self.extents.iter().map(|extent| extent.1 as usize).sum();
        let mut records = vec![0; length];
        let mut rest = records.as_mut_slice();
        for &(offset, length) in &self.extents {
            let (now, later) = rest.split_at_mut(length as usize);
            storage.read(offset, now)?;
            rest = later;
        }
        records.extend_from_slice(&self.buffer);
        Ok(records)
    }

    /// Makes it one of its parent's, with that of a neighbour.
    fn merge(&mut self, child: Self) {
        self.points += child.points;
        self.extents.extend(child.extents);
        self.buffer.extend(child.buffer);
        self.heap |= child.heap;
        for (all, own) in self.occupied[1..].iter_mut().zip(child.occupied) {
            *all += own;
        }
    }
}

/// A bucket that points are still added to.
struct Open {
    bucket: Bucket,
    /// Which of the cells `KNOWN_LEVELS` below it have points.
    occupied: Box<[u8; KNOWN_BYTES]>,
}

impl Open {
    fn close(self) -> Bucket {
        let Self { mut bucket, occupied } = self;
        let any = |bytes: &&[u8]| bytes.iter().any(|byte| *byte != 0);
        bucket.occupied = std::array::from_fn(|depth| match usize::from(KNOWN_LEVELS) - depth {
            0 => occupied.iter().map(|byte| byte.count_ones()).sum(),
            up => occupied.chunks(1 << (3 * up - 3)).filter(any).count() as u32,
        });
        bucket
    }
}

/// Cells that points can be sorted into with `memory` bytes, half of it for the records that are not written yet.
pub fn most_cells(memory: u64) -> u64 {
    (memory / (2 * KNOWN_BYTES as u64)).max(FEWEST_CELLS)
}

/// Sorts records into the buckets of one level below a cell. Used by many threads at once.
pub struct Distribution<'a> {
    pub layout: &'a Layout,
    pub placing: Placing,
    storage: &'a Storage,
    base: Cell,
    depth: u8,
    /// Bytes a bucket keeps in memory.
    block: usize,
    buckets: RwLock<HashMap<u64, Arc<Mutex<Open>>>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Distribution<'a> {
    /// Into cells `depth` levels below `base`, with about `memory` bytes for some `expected` buckets.
    pub fn new(
        layout: &'a Layout,
        placing: Placing,
        storage: &'a Storage,
        base: Cell,
        depth: u8,
        expected: u64,
        memory: u64,
    ) -> Self {
        let depth = depth.min(MOST_DEPTH);
        let block = (memory / expected.max(1)).clamp(4 << 10, BLOCK_BYTES as u64) as usize;
        Self { layout, placing, storage, base, depth, block, buckets: RwLock::default() }
    }

    /// Adds records that lie in the base.
    pub fn add(&self, records: &[u8]) -> Result<()> {
        let stride = self.layout.stride();
        let known = 3 * u32::from(KNOWN_LEVELS);
        let shift = 3 * u32::from(KEY_LEVELS - self.depth - KNOWN_LEVELS);
        // Neighbours in the file are mostly neighbours in space: few cells per chunk, and the next point is in the same one.
        let mut slots: HashMap<u64, u32> = HashMap::new();
        let mut cells: Vec<(u64, usize)> = Vec::new();
        let mut points: Vec<(u32, u32)> = Vec::with_capacity(records.len() / stride);
        let (mut last, mut slot) = (u64::MAX, 0);
        for record in records.chunks_exact(stride) {
            let key = morton(below(self.placing.place(self.layout.at(record)), self.base.level)) >> shift;
            if key >> known != last {
                last = key >> known;
                slot = *slots.entry(last).or_insert_with(|| {
                    cells.push((last, 0));
                    cells.len() as u32 - 1
                });
            }
            cells[slot as usize].1 += 1;
            points.push((slot, key as u32 & ((1 << known) - 1)));
        }
        let mut starts = Vec::with_capacity(cells.len());
        let mut sum = 0;
        for &(_, count) in &cells {
            starts.push(sum);
            sum += count;
        }
        let mut grouped = vec![0; sum * stride];
        let mut bits = vec![0; sum];
        let mut next = starts.clone();
        for (record, &(slot, bit)) in records.chunks_exact(stride).zip(&points) {
            let index = &mut next[slot as usize];
            grouped[*index * stride..(*index + 1) * stride].copy_from_slice(record);
            bits[*index] = bit;
            *index += 1;
        }
        for (&(cell, count), &start) in cells.iter().zip(&starts) {
            let end = start + count;
            self.add_to(cell, &grouped[start * stride..end * stride], &bits[start..end])?;
        }
        Ok(())
    }

    fn bucket(&self, cell: u64) -> Arc<Mutex<Open>> {
        if let Some(bucket) = self.buckets.read().unwrap_or_else(PoisonError::into_inner).get(&cell) {
            return bucket.clone();
        }
        let mut buckets = self.buckets.write().unwrap_or_else(PoisonError::into_inner);
        let new = || Open {
            bucket: Bucket::new(self.base.descendant(self.depth, cell)),
            occupied: Box::new([0; KNOWN_BYTES]),
        };
        buckets.entry(cell).or_insert_with(|| Arc::new(Mutex::new(new()))).clone()
    }

    fn add_to(&self, cell: u64, records: &[u8], bits: &[u32]) -> Result<()> {
        let open = self.bucket(cell);
        let Open { bucket, occupied } = &mut *locked(&open);
        bucket.points += bits.len() as u64;
        for bit in bits {
            occupied[(bit / 8) as usize] |= 1 << (bit % 8);
        }
        if bucket.buffer.len() + records.len() >= self.block {
            bucket.flush(self.storage)?;
        }
        if records.len() >= self.block {
            let offset = self.storage.append(records)?;
            bucket.extents.push((offset, records.len() as u32));
        } else {
            bucket.buffer.extend_from_slice(records);
        }
        Ok(())
    }

    pub fn finish(self) -> Vec<Bucket> {
        let buckets = self.buckets.into_inner().unwrap_or_else(PoisonError::into_inner).into_values();
        let open = buckets.filter_map(Arc::into_inner);
        open.map(|open| open.into_inner().unwrap_or_else(PoisonError::into_inner).close()).collect()
    }
}

/// Cuts a bucket that is too large for memory: distributed again, further down, and all of it on the disk.
pub fn split(
    bucket: &Bucket,
    layout: &Layout,
    placing: Placing,
    storage: &Storage,
    most_points: u64,
    memory: u64,
) -> Result<Vec<Bucket>> {
    let (depth, cells) =
        split_depth(bucket, layout, placing, storage, most_points, most_cells(memory).min(MOST_CELLS))?;
    let depth = depth.min(LAST_LEVEL - bucket.cell.level);
    let distribution = Distribution::new(layout, placing, storage, bucket.cell, depth, cells, memory);
    bucket.read(storage, (memory / 4) as usize, |records| distribution.add(records))?;
    let mut parts = distribution.finish();
    for part in &mut parts {
        part.flush(storage)?;
        part.buffer.shrink_to_fit();
    }
    Ok(parts)
}

/// Levels to go down so that no part is too large, as far as a sample of it tells; and the parts this makes.
fn split_depth(
    bucket: &Bucket,
    layout: &Layout,
    placing: Placing,
    storage: &Storage,
    most_points: u64,
    most_cells: u64,
) -> Result<(u8, u64)> {
    const BLOCKS: usize = 64;
    let stride = layout.stride();
    let mut keys = Vec::new();
    let mut records = Vec::new();
    for &(offset, length) in bucket.extents.iter().step_by(bucket.extents.len().div_ceil(BLOCKS).max(1)) {
        records.resize(length as usize, 0);
        storage.read(offset, &mut records)?;
        let key = |record: &[u8]| morton(below(placing.place(layout.at(record)), bucket.cell.level));
        keys.extend(records.chunks_exact(stride).map(key));
    }
    keys.sort_unstable();
    let most = (keys.len() as u64).saturating_mul(most_points) / 2 / bucket.points.max(1);
    let mut parts = 1;
    for depth in 1..=MOST_DEPTH {
        let shift = 3 * u32::from(KEY_LEVELS - depth);
        let runs = || keys.chunk_by(|a, b| a >> shift == b >> shift);
        let count = runs().count() as u64;
        if count > most_cells {
            return Ok(((depth - 1).max(1), parts));
        }
        parts = count;
        if runs().all(|run| run.len() as u64 <= most.max(1)) {
            return Ok((depth, parts));
        }
    }
    Ok((MOST_DEPTH, parts))
}

/// Joins neighbours that are small: buckets of up to `most_points`, along the Morton curve.
pub fn merge(buckets: Vec<Bucket>, most_points: u64) -> Vec<Bucket> {
    let mut merged = Vec::new();
    let mut levels: Vec<Vec<Bucket>> = Vec::new();
    for bucket in buckets {
        let level = usize::from(bucket.cell.level);
        if levels.len() <= level {
            levels.resize_with(level + 1, Vec::new);
        }
        levels[level].push(bucket);
    }
    // Cells with a bucket below them that stays one.
    let mut divided: HashSet<Cell> = HashSet::new();
    for level in (1..levels.len()).rev() {
        let mut families: HashMap<Cell, Vec<Bucket>> = HashMap::new();
        for bucket in std::mem::take(&mut levels[level]) {
            let parent = bucket.cell.ancestor(bucket.cell.level - 1);
            families.entry(parent).or_default().push(bucket);
        }
        divided = divided.into_iter().map(|cell: Cell| cell.ancestor((level - 1) as u8)).collect();
        for (parent, mut children) in families {
            let points: u64 = children.iter().map(|child| child.points).sum();
            // One that is alone gets no larger in its parent's place.
            let fits = children.len() == 1 || points <= most_points && children.iter().all(|child| !child.heap);
            if !fits || divided.contains(&parent) {
                divided.insert(parent);
                merged.append(&mut children);
                continue;
            }
            children.sort_by_key(|child| child.cell.octant());
            let mut bucket = Bucket::new(parent);
            children.into_iter().for_each(|child| bucket.merge(child));
            levels[level - 1].push(bucket);
        }
    }
    merged.extend(levels.into_iter().next().unwrap_or_default());
    merged.sort_by_key(|bucket| bucket.cell.rank());
    merged
}
