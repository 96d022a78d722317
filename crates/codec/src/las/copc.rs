//! Reads the octree of a COPC file (specification 1.0, copc.io): LAZ with one compressed chunk per node, and a list of
//! nodes.
//!
//! The list is trusted only if it agrees with the chunk table by which plain LAZ is read: every chunk belongs to
//! exactly one node, and to one with as many points. So reading node by node gives the same points as reading as LAZ,
//! or the list is not used.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

use cloud::Bounds;
use glam::DVec3;

use super::compressed::CompressedChunk;
use super::header::Header;
use super::layout::bytes;
use crate::brief::{number, vector};
use crate::bytes::Bytes;

/// The offset of the info record's data: after a header of 375 bytes and a record's head of 54.
const INFO_START: u64 = 375 + 54;
const INFO_LENGTH: usize = 160;
const ENTRY_LENGTH: usize = 32;
/// The deepest level of nodes: cells are then counted with 31 bits.
pub const DEEPEST: u32 = 30;
/// The most nodes; 5,000,000,000 points have some 200,000.
const MOST_NODES: usize = 1 << 22;
/// The most entries of the list for each compressed chunk: those above it without points, and some next to them.
/// `SPARE_ENTRIES` more are allowed, for very small lists.
const ENTRIES_PER_CHUNK: usize = 64;
const SPARE_ENTRIES: usize = 1 << 10;
/// The most nodes for each compressed chunk, and as many more. Points on a line have two; those of a scan have almost
/// no empty ones.
const NODES_PER_CHUNK: usize = 4;
/// The fraction of the width by which the points' bounds may exceed the cube.
const TOLERANCE: f64 = 0.01;
/// The least spacing as a fraction of the width: nodes of a surface then have fewer points than are read at once.
const LEAST_SPACING: f64 = 1.0 / 65_536.0;

/// An octree of nodes that hold the points of a COPC file, or of EPT, each point once.
#[derive(Clone, Debug, PartialEq)]
pub struct Copc {
    /// The lower corner of the root's cube, in world coordinates.
    pub corner: DVec3,
    /// The width of the root's cube in world units.
    pub width: f64,
    /// The distance between neighbouring points of the root in world units; it halves with each level.
    pub spacing: f64,
    /// The nodes level by level, the root first, sorted by cell within a level; the list has the parent of every node.
    pub nodes: Vec<CopcNode>,
}

/// A node: a cube, and one compressed chunk of the file or one tile unless it is empty.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CopcNode {
    /// The level in the tree; 0 for the root.
    pub level: u32,
    /// The number of cubes of its level that lie before it in x, y and z; below `2^level`.
    pub cell: [u32; 3],
    pub points: u32,
    /// The size in the file in bytes; of a tile about.
    pub bytes: u64,
    /// The index in the list of the file's compressed chunks, in COPC.
    pub(super) chunk: Option<usize>,
}

impl Copc {
    /// The most points of a node; a file that claims more is read as plain LAZ.
    pub const MOST_POINTS: u32 = 1 << 24;

    /// Reads the octree. `None` for a file that does not claim to be COPC; an error says why its index cannot be used.
    pub(super) fn read(file: &Bytes, header: &Header, chunks: &[CompressedChunk]) -> Result<Option<Self>, String> {
        let info = match &header.copc_info {
            None => return Ok(None),
            Some((INFO_START, info)) if info.len() >= INFO_LENGTH => info,
            Some((start, info)) => {
                return Err(format!(
                    "byte {start}: an info record of {} bytes, expected {INFO_LENGTH} at byte {INFO_START}",
                    info.len()
                ));
            }
        };
        let number = |at: usize| f64::from_le_bytes(bytes(info, at));
        let center = DVec3::new(number(0), number(8), number(16));
        let (half, spacing) = (number(24), number(32));
        check_cube(center, half, spacing, header.bounds).map_err(|problem| format!("byte {INFO_START}: {problem}"))?;
        let root = page(u64::from_le_bytes(bytes(info, 40)), u64::from_le_bytes(bytes(info, 48)));
        let pages = header.copc_pages.clone().ok_or("the record of its pages is missing")?;
        let nodes = Self::read_pages(file, pages, root, chunks)?;
        let most = chunks.len().saturating_mul(NODES_PER_CHUNK) + SPARE_ENTRIES;
        let octree = Self::of_nodes(center - half, 2.0 * half, spacing, nodes, most);
        octree.map(Some).ok_or_else(|| format!("more than {most} nodes for {} compressed chunks", chunks.len()))
    }

    /// The octree of nodes with points and of those above them; `None` if these are more than `most` together.
    pub(crate) fn of_nodes(
        corner: DVec3,
        width: f64,
        spacing: f64,
        mut nodes: HashMap<Key, CopcNode>,
        most: usize,
    ) -> Option<Self> {
        if !add_parents(&mut nodes, most) {
            return None;
        }
        let mut nodes: Vec<CopcNode> = nodes.into_values().collect();
        nodes.sort_unstable_by_key(|node| (node.level, node.cell));
        Some(Self { corner, width, spacing, nodes })
    }

    /// The nodes with points of all pages.
    pub(super) fn read_pages(
        file: &Bytes,
        pages: Range<u64>,
        root: Range<u64>,
        chunks: &[CompressedChunk],
    ) -> Result<HashMap<Key, CopcNode>, String> {
        let mut chunk_at: HashMap<u64, usize> =
            chunks.iter().enumerate().map(|(index, chunk)| (chunk.offset, index)).collect();
        let mut nodes = HashMap::new();
        let mut seen = HashSet::new();
        let mut waiting = vec![root];
        let mut bytes_left = pages.end - pages.start;
        let most_entries = (chunks.len().saturating_mul(ENTRIES_PER_CHUNK) + SPARE_ENTRIES).min(MOST_NODES);
        let mut entries_left = most_entries;
        while let Some(page) = waiting.pop() {
            if !seen.insert(page.start) {
                return Err(format!("byte {}: a page that is named twice", page.start));
            }
            if page.start < pages.start || page.end > pages.end || page.start >= page.end {
                return Err(format!(
                    "a page at bytes {} to {}, outside the record of pages at {} to {}",
                    page.start, page.end, pages.start, pages.end
                ));
            }
            // Pages do not overlap, so together they are not longer than the record.
            bytes_left = bytes_left
                .checked_sub(page.end - page.start)
                .ok_or_else(|| format!("byte {}: pages that overlap", page.start))?;
            let entries = (page.end - page.start) as usize / ENTRY_LENGTH;
            entries_left = entries_left
                .checked_sub(entries)
                .ok_or_else(|| format!("more than {most_entries} nodes for {} compressed chunks", chunks.len()))?;
            let mut buffer = vec![0; entries * ENTRY_LENGTH];
            if file.read_at(page.start, &mut buffer).map_err(|error| error.to_string())? < buffer.len() {
                return Err("the file has become shorter".into());
            }
            for entry in buffer.chunks_exact(ENTRY_LENGTH) {
                if let Some(further) = read_entry(entry, &mut chunk_at, chunks, &mut nodes)? {
                    waiting.push(further);
                }
            }
        }
        if let Some(left) = chunk_at.into_values().min() {
            let chunk = &chunks[left];
            return Err(format!("{} points at byte {} belong to no node", chunk.points, chunk.offset));
        }
        Ok(nodes)
    }
}

impl CopcNode {
    pub(super) fn chunk(&self) -> Option<usize> {
        self.chunk
    }

    /// A node whose points are a file of their own.
    pub(crate) fn of_tile(level: u32, cell: [u32; 3], points: u32) -> Self {
        Self { level, cell, points, bytes: 0, chunk: None }
    }
}

/// Whether a LAS file has the record that COPC begins with.
pub fn is_claimed(file: &Bytes) -> bool {
    // The name of a record's author comes after two bytes of its head, which has 54.
    let author = file.bytes_at::<4>(INFO_START - 54 + 2).ok().flatten();
    author.is_some_and(|author| author == *b"copc")
}

/// The level of a node and its cell.
pub type Key = (u32, [u32; 3]);

fn page(offset: u64, length: u64) -> Range<u64> {
    offset..offset.saturating_add(length)
}

/// Checks that a cube can contain points within `bounds`; the error says what is wrong with it.
fn check_cube(center: DVec3, half: f64, spacing: f64, bounds: Option<Bounds>) -> Result<(), String> {
    let (corner, width) = (center - half, 2.0 * half);
    let most = center + half;
    let is_cube = corner.is_finite() && most.is_finite() && width.is_finite() && most.cmpgt(corner).all();
    // A spacing that is not a number lies in no range.
    if !(is_cube && (LEAST_SPACING * width..=width).contains(&spacing)) {
        return Err(format!(
            "no cube: centre {}, half width {}, spacing {}",
            vector(center),
            number(half),
            number(spacing)
        ));
    }
    let cube = Bounds { min: corner - TOLERANCE * width, max: most + TOLERANCE * width };
    match bounds {
        Some(bounds) if !(cube.contains(bounds.min) && cube.contains(bounds.max)) => Err(format!(
            "the cube from {} to {} does not hold the points, which lie from {} to {}",
            vector(corner),
            vector(most),
            vector(bounds.min),
            vector(bounds.max)
        )),
        _ => Ok(()),
    }
}

/// Adds the entry's node to `nodes` if it has points, or returns the page that it names.
fn read_entry(
    entry: &[u8],
    chunk_at: &mut HashMap<u64, usize>,
    chunks: &[CompressedChunk],
    nodes: &mut HashMap<Key, CopcNode>,
) -> Result<Option<Range<u64>>, String> {
    let [level, x, y, z] = std::array::from_fn(|place| i32::from_le_bytes(bytes(entry, 4 * place)));
    let name = format!("node {level}-{x}-{y}-{z}");
    let offset = u64::from_le_bytes(bytes(entry, 16));
    let length = i32::from_le_bytes(bytes(entry, 24));
    let points = i32::from_le_bytes(bytes(entry, 28));
    let cells = |level: u32| 1_u32 << level;
    let level = u32::try_from(level).ok().filter(|level| *level <= DEEPEST);
    let cell = [x, y, z].map(|cell| u32::try_from(cell).unwrap_or(u32::MAX));
    let Some(level) = level.filter(|level| cell.iter().all(|cell| *cell < cells(*level))) else {
        return Err(format!("{name} is outside of the root's cube"));
    };
    if points == -1 {
        let length = u64::try_from(length).map_err(|_| format!("{name}: a page of {length} bytes"))?;
        return Ok(Some(page(offset, length)));
    }
    let points = u32::try_from(points).map_err(|_| format!("{name}: {points} points"))?;
    if points > Copc::MOST_POINTS {
        return Err(format!("{name}: {points} points, at most {} are read at once", Copc::MOST_POINTS));
    }
    // Nodes above those with points are added without being listed.
    if points == 0 {
        return Ok(None);
    }
    let chunk = chunk_at
        .remove(&offset)
        .filter(|chunk| chunks[*chunk].points == u64::from(points))
        .ok_or_else(|| format!("{name}: no compressed chunk of {points} points is at byte {offset}"))?;
    let bytes = chunks[chunk].length;
    match nodes.insert((level, cell), CopcNode { level, cell, points, bytes, chunk: Some(chunk) }) {
        None => Ok(None),
        Some(_) => Err(format!("{name} is there twice")),
    }
}

/// Adds nodes without points above those that have some; returns false if there are then more than `most`.
fn add_parents(nodes: &mut HashMap<Key, CopcNode>, most: usize) -> bool {
    let keys: Vec<Key> = nodes.keys().copied().collect();
    let empty = |(level, cell): Key| CopcNode { level, cell, points: 0, bytes: 0, chunk: None };
    let root = (0, [0; 3]);
    nodes.entry(root).or_insert_with(|| empty(root));
    for (mut level, mut cell) in keys {
        while level > 0 {
            (level, cell) = (level - 1, cell.map(|cell| cell / 2));
            let Entry::Vacant(place) = nodes.entry((level, cell)) else { break };
            place.insert(empty((level, cell)));
        }
        if nodes.len() > most {
            return false;
        }
    }
    true
}
