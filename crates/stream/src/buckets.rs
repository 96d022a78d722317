//! Sorts points roughly into buckets: cells of the octree small enough to fit in memory, stored in one temporary file.

use std::collections::{HashMap, HashSet};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};

use crate::Result;
use crate::lattice::{Cell, DEPTH, KEY_LEVELS, Placing, below, morton};
use crate::records::Layout;
use crate::storage::Storage;

/// The number of levels below a bucket whose occupied cells are known: nodes of the seven levels above it choose among
/// these.
pub const KNOWN_LEVELS: u8 = 6;
/// The size in bytes of a bitmap of the cells of the lowest of these levels.
const KNOWN_BYTES: usize = 1 << (3 * KNOWN_LEVELS as usize - 3);
/// The largest number of levels that one distribution goes down.
const MOST_DEPTH: u8 = KEY_LEVELS - KNOWN_LEVELS;
/// The largest number of cells that a bucket is split into, as estimated from a sample.
const MOST_CELLS: u64 = 4096;
/// The least number of cells that is worth a distribution, however little memory there is.
const FEWEST_CELLS: u64 = 64;
/// A bucket of this level is not split further: its nodes could not distinguish enough cells.
pub const LAST_LEVEL: u8 = DEPTH - 7;
/// The size in bytes of the blocks in which a bucket is written.
const BLOCK_BYTES: usize = 128 << 10;

/// The points in one cell.
pub struct Bucket {
    pub cell: Cell,
    pub points: u64,
    /// The offsets and sizes in bytes of its records in the temporary file.
    extents: Vec<(u64, u32)>,
    /// The records that are not written yet.
    buffer: Vec<u8>,
    /// For each number of levels below the bucket, the number of cells that hold points.
    occupied: [u32; KNOWN_LEVELS as usize + 1],
    /// Whether it cannot be split because its points are in one place.
    pub heap: bool,
}

impl Bucket {
    fn new(cell: Cell) -> Self {
        let occupied = [1, 0, 0, 0, 0, 0, 0];
        Self { cell, points: 0, extents: Vec::new(), buffer: Vec::new(), occupied, heap: false }
    }

    /// The number of cells `depth` levels below it that hold points; `depth` is at most `KNOWN_LEVELS`.
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

    /// Passes its records to `give`, at most `bytes` at once (but at least a block).
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

    /// Adds the records of a child to this bucket of its parent.
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
    /// A bitmap of the cells `KNOWN_LEVELS` below it that hold points.
    occupied: Box<[u8; KNOWN_BYTES]>,
}

impl Open {
    fn new(cell: Cell) -> Self {
        Self { bucket: Bucket::new(cell), occupied: Box::new([0; KNOWN_BYTES]) }
    }

    /// Adds a child to this bucket of its parent.
    fn merge(&mut self, child: Self) {
        // Eight cells, which are a byte, become one.
        let start = child.bucket.cell.octant() * KNOWN_BYTES / 8;
        for (index, byte) in child.occupied.iter().enumerate() {
            self.occupied[start + index / 8] |= u8::from(*byte != 0) << (index % 8);
        }
        self.bucket.merge(child.bucket);
    }

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

/// The number of cells that points can be sorted into with `memory` bytes; half of them hold records that are not
/// written yet.
pub fn most_cells(memory: u64) -> u64 {
    (memory / (2 * KNOWN_BYTES as u64)).max(FEWEST_CELLS)
}

/// Sorts records into the buckets of one level below a cell. Many threads use it at once. Moves up a level when there
/// are more buckets than expected, as where points fill space rather than lie on surfaces.
pub struct Distribution<'a> {
    pub layout: &'a Layout,
    pub placing: Placing,
    storage: &'a Storage,
    base: Cell,
    /// The largest number of buckets.
    most: usize,
    /// The number of bytes that a bucket keeps in memory.
    block: usize,
    level: RwLock<Level>,
}

struct Level {
    /// The number of levels below the base.
    depth: u8,
    buckets: HashMap<u64, Mutex<Open>>,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<'a> Distribution<'a> {
    /// Sorts into cells `depth` levels below `base`, or fewer levels so that there are no more than `expected` buckets
    /// (but at least eight). Their records take about `memory` bytes, and their bitmaps as much.
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
        let level = RwLock::new(Level { depth, buckets: HashMap::new() });
        Self { layout, placing, storage, base, most: expected as usize, block, level }
    }

    /// Adds records that lie in the base cell.
    pub fn add(&self, records: &[u8]) -> Result<()> {
        let stride = self.layout.stride();
        let known = 3 * u32::from(KNOWN_LEVELS);
        let depth = self.level.read().unwrap_or_else(PoisonError::into_inner).depth;
        let shift = 3 * u32::from(KEY_LEVELS - depth - KNOWN_LEVELS);
        // Neighbours in the file are mostly neighbours in space: a chunk has few cells, and the next point is usually
        // in the same one.
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
            self.add_to(depth, cell, &grouped[start * stride..end * stride], &bits[start..end])?;
        }
        Ok(())
    }

    /// Adds the records of one cell `depth` levels below the base; `bits` are the numbers of their cells further below.
    fn add_to(&self, depth: u8, cell: u64, records: &[u8], bits: &[u32]) -> Result<()> {
        loop {
            let level = self.level.read().unwrap_or_else(PoisonError::into_inner);
            // The level may have moved up since the cell was found.
            let up = 3 * u32::from(depth - level.depth);
            if let Some(open) = level.buckets.get(&(cell >> up)) {
                let Open { bucket, occupied } = &mut *locked(open);
                for bit in bits {
                    let known = 3 * u32::from(KNOWN_LEVELS);
                    let bit = (cell << known | u64::from(*bit)) >> up & ((1 << known) - 1);
                    occupied[(bit / 8) as usize] |= 1 << (bit % 8);
                }
                return self.append(bucket, records, bits.len());
            }
            drop(level);
            self.open(depth, cell)?;
        }
    }

    fn append(&self, bucket: &mut Bucket, records: &[u8], points: usize) -> Result<()> {
        bucket.points += points as u64;
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

    /// Makes a bucket for a cell `depth` levels below the base.
    fn open(&self, depth: u8, cell: u64) -> Result<()> {
        let mut level = self.level.write().unwrap_or_else(PoisonError::into_inner);
        loop {
            let at = cell >> (3 * u32::from(depth - level.depth));
            if level.buckets.contains_key(&at) {
                return Ok(());
            }
            if level.buckets.len() < self.most || level.depth <= 1 {
                let open = Open::new(self.base.descendant(level.depth, at));
                level.buckets.insert(at, Mutex::new(open));
                return Ok(());
            }
            self.go_up(&mut level)?;
        }
    }

    /// Moves up a level: joins all buckets of each parent.
    fn go_up(&self, level: &mut Level) -> Result<()> {
        level.depth -= 1;
        let depth = level.depth;
        for (cell, child) in std::mem::take(&mut level.buckets) {
            let parent = || Mutex::new(Open::new(self.base.descendant(depth, cell >> 3)));
            let parent = level.buckets.entry(cell >> 3).or_insert_with(parent);
            let parent = parent.get_mut().unwrap_or_else(PoisonError::into_inner);
            parent.merge(child.into_inner().unwrap_or_else(PoisonError::into_inner));
            if parent.bucket.buffer.len() >= self.block {
                parent.bucket.flush(self.storage)?;
            }
        }
        Ok(())
    }

    pub fn finish(self) -> Vec<Bucket> {
        let buckets = self.level.into_inner().unwrap_or_else(PoisonError::into_inner).buckets.into_values();
        buckets.map(|open| open.into_inner().unwrap_or_else(PoisonError::into_inner).close()).collect()
    }
}

/// Splits a bucket that is too large for memory: distributes it again further down, all of it on the disk.
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
    let distribution = Distribution::new(layout, placing, storage, bucket.cell, depth, 2 * cells, memory);
    bucket.read(storage, (memory / 4) as usize, |records| distribution.add(records))?;
    let mut parts = distribution.finish();
    for part in &mut parts {
        part.flush(storage)?;
        part.buffer.shrink_to_fit();
    }
    Ok(parts)
}

/// The number of levels to go down so that no part is too large, estimated from a sample; and the number of parts.
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

/// Joins small neighbours to buckets of up to `most_points`, along the Morton curve.
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
    // The cells above buckets that are not joined any further.
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
            // A single child gets no larger in its parent's place.
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

#[cfg(test)]
mod tests {
    use cloud::{Chunk, Grid};
    use glam::DVec3;

    use super::*;
    use crate::lattice::Lattice;

    #[test]
    fn points_that_fill_space_come_to_no_more_buckets_than_were_expected() {
        const SIDE: u32 = 64;
        let folder = tempfile::tempdir().unwrap();
        let storage = Storage::create(&folder.path().join("records"), u64::MAX).unwrap();
        let layout = Layout { wide: false, color_bytes: 0, normals: false, attributes: Vec::new() };
        let grid = Grid::new(DVec3::ONE, DVec3::splat(0.5));
        let lattice = Lattice { grid, corner: DVec3::ZERO, width: f64::from(SIDE) };
        let slab = |x: u32| {
            let place = |index: u32| [x, index / SIDE, index % SIDE].map(|at| at as f32);
            let chunk = Chunk::new(0, DVec3::splat(0.5), (0..SIDE * SIDE).map(place).collect());
            layout.encode(&chunk, &lattice, &[]).records
        };
        let sorted = |depth: u8, expected: u64| {
            let distribution =
                Distribution::new(&layout, lattice.placing(), &storage, Cell::ROOT, depth, expected, 1 << 20);
            std::thread::scope(|scope| {
                for first in 0..4 {
                    let (distribution, slab) = (&distribution, &slab);
                    scope.spawn(move || (first..SIDE).step_by(4).for_each(|x| distribution.add(&slab(x)).unwrap()));
                }
            });
            let mut buckets = distribution.finish();
            buckets.sort_by_key(|bucket| bucket.cell.rank());
            let told = |bucket: &Bucket| {
                let mut records: Vec<[u8; 12]> = bucket.load(&storage).unwrap().as_chunks().0.to_vec();
                records.sort_unstable();
                (bucket.cell, bucket.points, bucket.occupied, records)
            };
            buckets.iter().map(told).collect::<Vec<_>>()
        };
        let expected = 512;
        let buckets = sorted(5, expected);
        assert_eq!(buckets.len() as u64, expected);
        assert!(buckets == sorted(3, expected), "as if it had started there");
        assert!(
            buckets
                .iter()
                .all(|(_, points, occupied, _)| *points == 512 && *occupied == [1, 8, 64, 512, 512, 512, 512])
        );
    }
}
