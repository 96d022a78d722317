//! Reads the octree of a COPC file (specification 1.0, copc.io): LAZ with one compressed chunk per node, and a list of
//! nodes.
//!
//! A list that fits in the memory for lists is read whole, and trusted only if it agrees with the chunk table by which
//! plain LAZ is read: every chunk belongs to exactly one node, and to one with as many points. So reading node by node
//! gives the same points as reading as LAZ, or the list is not used.
//!
//! Of a longer list only the first page is read at opening, and the others when a view needs their nodes. The chunk table
//! is as long as such a list and is not read; each node is checked against the head of its compressed chunk instead. A page
//! may list nodes at and below its own node alone, so no page can lead back to another, and a chain of them ends with the
//! deepest level.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

use cloud::Bounds;
use glam::DVec3;

use super::compressed::CompressedChunk;
use super::header::Header;
use super::layout::bytes;
use super::node_pages::{CopcPage, PageNodes, ROOT, most_nodes, with_those_above};
use crate::brief::{number, vector};
use crate::bytes::Bytes;

/// The offset of the info record's data: after a header of 375 bytes and a record's head of 54.
const INFO_START: u64 = 375 + 54;
const INFO_LENGTH: usize = 160;
const ENTRY_LENGTH: usize = 32;
/// The deepest level of nodes: cells are then counted with 31 bits.
pub const DEEPEST: u32 = 30;
/// The most nodes of a list from a server that is read whole: 256 KiB, which a slow connection sends in a tenth of a second.
const MOST_NODES_FAR: usize = 1 << 13;
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
    /// The nodes that are known from the opening: those of the first page, then all others if they fit in memory. Each
    /// part comes level by level, sorted by cell within a level. The root is the first, and the list has the parent of
    /// every node.
    pub nodes: Vec<CopcNode>,
    /// The number of nodes of the first page.
    pub first: usize,
    /// The pages that are read when their nodes are needed; none if all nodes are known.
    pub further: Vec<CopcPage>,
    /// The most nodes that may be in memory at once.
    pub most_nodes: usize,
    /// The bytes of the file in which pages lie, and those in which compressed points do.
    pages: Range<u64>,
    data: Range<u64>,
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
    /// The offset of its compressed chunk in the file; 0 in EPT and for nodes without points.
    pub(super) offset: u64,
    /// The number of its first point in the file, if all nodes are known.
    pub(super) first_point: u64,
}

impl Copc {
    /// The most points of a node; a file that claims more is read as plain LAZ.
    pub const MOST_POINTS: u32 = 1 << 24;

    /// Whether a file has a list of nodes that is not read whole. `memory` is that of decoders and lists together.
    pub(super) fn is_paged(file: &Bytes, header: &Header, memory: u64) -> bool {
        let most = most_nodes(memory);
        let most = if file.is_remote() { most.min(MOST_NODES_FAR) } else { most };
        let entries = |pages: &Range<u64>| (pages.end - pages.start) / ENTRY_LENGTH as u64;
        let has_more = header.copc_pages.as_ref().is_some_and(|pages| entries(pages) > most as u64);
        // A list in one page has no other to wait for.
        let is_divided = |(_, info): &(u64, Vec<u8>)| {
            let root = info.get(48..56).map_or(0, |length| u64::from_le_bytes(bytes(length, 0)));
            root / (ENTRY_LENGTH as u64) <= most as u64
        };
        has_more && header.copc_info.as_ref().is_some_and(is_divided)
    }

    /// Reads the octree. `None` for a file that does not claim to be COPC; an error says why its index cannot be used.
    /// `chunks` are the file's compressed chunks, or `None` to read the first page of the list alone.
    pub(super) fn read(
        file: &Bytes,
        header: &Header,
        chunks: Option<&[CompressedChunk]>,
        memory: u64,
    ) -> Result<Option<Self>, String> {
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
        let octree = Self {
            corner: center - half,
            width: 2.0 * half,
            spacing,
            nodes: Vec::new(),
            first: 0,
            further: Vec::new(),
            most_nodes: most_nodes(memory),
            pages,
            data: header.data_start..file.length(),
        };
        let Some(chunks) = chunks else {
            let first = octree.read_page(file, &CopcPage::of(0, [0; 3], root))?;
            return Ok(Some(octree.with_first_page(first)));
        };
        let (nodes, first) = Self::read_pages(file, octree.pages.clone(), root, chunks)?;
        let most = chunks.len().saturating_mul(NODES_PER_CHUNK) + SPARE_ENTRIES;
        let octree = octree.with_nodes(nodes, first, most);
        octree.map(Some).ok_or_else(|| format!("more than {most} nodes for {} compressed chunks", chunks.len()))
    }

    /// An octree of tiles, whose nodes are still to be given.
    pub(crate) fn of_tiles(corner: DVec3, width: f64, spacing: f64, most_nodes: usize) -> Self {
        let (nodes, further) = (Vec::new(), Vec::new());
        Self { corner, width, spacing, nodes, first: 0, further, most_nodes, pages: 0..0, data: 0..0 }
    }

    /// The octree of which only the first page is known.
    pub(crate) fn with_first_page(self, PageNodes { nodes, further }: PageNodes) -> Self {
        Self { first: nodes.len(), nodes, further, ..self }
    }

    /// The octree with these nodes and those above them; `None` if they are more than `most` together. `first` are the
    /// nodes of the first page and those of which others have the points.
    pub(crate) fn with_nodes(self, mut nodes: HashMap<Key, CopcNode>, first: Vec<Key>, most: usize) -> Option<Self> {
        let listed = first;
        let mut first = HashSet::from([ROOT]);
        for key in listed {
            for key in with_those_above(key) {
                if !first.insert(key) {
                    break;
                }
            }
        }
        let keys: Vec<Key> = nodes.keys().copied().chain([ROOT]).chain(first.iter().copied()).collect();
        for key in keys {
            nodes.entry(key).or_insert_with(|| CopcNode::empty(key));
            for above in with_those_above(key).skip(1) {
                let Entry::Vacant(place) = nodes.entry(above) else { break };
                place.insert(CopcNode::empty(above));
            }
            if nodes.len() > most {
                return None;
            }
        }
        let mut nodes: Vec<CopcNode> = nodes.into_values().collect();
        let is_later = |node: &CopcNode| !first.contains(&(node.level, node.cell));
        nodes.sort_unstable_by_key(|node| (is_later(node), node.level, node.cell));
        let first = nodes.iter().take_while(|node| !is_later(node)).count();
        Some(Self { nodes, first, ..self })
    }

    /// The place of a node among those that are known from the opening.
    pub(crate) fn place_of(&self, node: &CopcNode) -> Option<usize> {
        let (first, others) = self.nodes.split_at(self.first);
        let find = |nodes: &[CopcNode]| {
            nodes.binary_search_by_key(&(node.level, node.cell), |node| (node.level, node.cell)).ok()
        };
        find(first).or_else(|| find(others).map(|place| self.first + place))
    }

    /// Reads one page of the list.
    pub(super) fn read_page(&self, file: &Bytes, page: &CopcPage) -> Result<PageNodes, String> {
        let entries = read_entries(file, &page.place, &self.pages, self.most_nodes)?;
        let (mut nodes, mut further) = (Vec::new(), Vec::new());
        for entry in &entries {
            match parse_entry(entry)? {
                Listed::Page(page) => further.push(page),
                Listed::Nothing => {}
                Listed::Node { key: (level, cell), points, offset, length } => {
                    let end = offset.checked_add(length).filter(|end| length > 0 && *end <= self.data.end);
                    if offset < self.data.start || end.is_none() {
                        let (name, end) = (name((level, cell)), self.data.end);
                        return Err(format!(
                            "{name}: {length} bytes at byte {offset}, the points lie at bytes {} to {end}",
                            self.data.start
                        ));
                    }
                    nodes.push(CopcNode { level, cell, points, bytes: length, offset, first_point: 0 });
                }
            }
        }
        PageNodes::of((page.level, page.cell), nodes, further, self.most_nodes)
    }

    /// The nodes with points of all pages, and the nodes that the first page lists, with those of further pages.
    pub(super) fn read_pages(
        file: &Bytes,
        pages: Range<u64>,
        root: Range<u64>,
        chunks: &[CompressedChunk],
    ) -> Result<(HashMap<Key, CopcNode>, Vec<Key>), String> {
        let mut chunk_at: HashMap<u64, usize> =
            chunks.iter().enumerate().map(|(index, chunk)| (chunk.offset, index)).collect();
        let (mut nodes, mut first) = (HashMap::new(), Vec::new());
        let mut seen = HashSet::new();
        let mut waiting = vec![root];
        let mut bytes_left = pages.end - pages.start;
        let most_entries = chunks.len().saturating_mul(ENTRIES_PER_CHUNK) + SPARE_ENTRIES;
        let mut entries_left = most_entries;
        while let Some(page) = waiting.pop() {
            let is_first = seen.is_empty();
            if !seen.insert(page.start) {
                return Err(format!("byte {}: a page that is named twice", page.start));
            }
            let entries = read_entries(file, &page, &pages, entries_left).map_err(|problem| match problem {
                problem if problem.contains(TOO_LONG) => {
                    format!("more than {most_entries} nodes for {} compressed chunks", chunks.len())
                }
                problem => problem,
            })?;
            // Pages do not overlap, so together they are not longer than the record.
            bytes_left = bytes_left
                .checked_sub(page.end - page.start)
                .ok_or_else(|| format!("byte {}: pages that overlap", page.start))?;
            entries_left -= entries.len();
            for entry in &entries {
                match parse_entry(entry)? {
                    Listed::Nothing => {}
                    Listed::Page(CopcPage { level, cell, place }) => {
                        waiting.push(place);
                        // The node itself is one of that page.
                        first.extend((is_first && level > 0).then(|| (level - 1, cell.map(|cell| cell / 2))));
                    }
                    Listed::Node { key: (level, cell), points, offset, .. } => {
                        let name = name((level, cell));
                        let chunk = chunk_at.remove(&offset).map(|chunk| &chunks[chunk]);
                        let chunk = chunk.filter(|chunk| chunk.points == u64::from(points)).ok_or_else(|| {
                            format!("{name}: no compressed chunk of {points} points is at byte {offset}")
                        })?;
                        let (bytes, first_point) = (chunk.length, chunk.first_point);
                        let node = CopcNode { level, cell, points, bytes, offset, first_point };
                        if nodes.insert((level, cell), node).is_some() {
                            return Err(format!("{name} is there twice"));
                        }
                        first.extend(is_first.then_some((level, cell)));
                    }
                }
            }
        }
        if let Some(left) = chunk_at.into_values().min() {
            let chunk = &chunks[left];
            return Err(format!("{} points at byte {} belong to no node", chunk.points, chunk.offset));
        }
        Ok((nodes, first))
    }
}

/// What a page is that is longer than the memory for it.
const TOO_LONG: &str = "nodes fit in the memory for lists of nodes";

/// The entries of a page that has at most `most`.
fn read_entries(
    file: &Bytes,
    page: &Range<u64>,
    pages: &Range<u64>,
    most: usize,
) -> Result<Vec<[u8; ENTRY_LENGTH]>, String> {
    if page.start < pages.start || page.end > pages.end || page.start >= page.end {
        return Err(format!(
            "a page at bytes {} to {}, outside the record of pages at {} to {}",
            page.start, page.end, pages.start, pages.end
        ));
    }
    let entries = (page.end - page.start) / ENTRY_LENGTH as u64;
    let entries = usize::try_from(entries).ok().filter(|entries| *entries <= most);
    let entries = entries.ok_or_else(|| format!("a page of {} bytes, {most} {TOO_LONG}", page.end - page.start))?;
    let mut buffer = vec![[0; ENTRY_LENGTH]; entries];
    let bytes = buffer.as_flattened_mut();
    if file.read_at(page.start, bytes).map_err(|error| error.to_string())? < bytes.len() {
        return Err("the file has become shorter".into());
    }
    Ok(buffer)
}

impl CopcNode {
    /// Its points in the file; `None` for a node without points.
    pub(super) fn chunk(&self) -> Option<CompressedChunk> {
        let Self { points, bytes: length, offset, first_point, .. } = *self;
        (points > 0).then_some(CompressedChunk { first_point, points: u64::from(points), offset, length })
    }

    /// A node whose points are a file of their own.
    pub(crate) fn of_tile((level, cell): Key, points: u32, bytes: u64) -> Self {
        Self { level, cell, points, bytes, offset: 0, first_point: 0 }
    }

    /// A node that only has others below it.
    pub(crate) fn empty(key: Key) -> Self {
        Self::of_tile(key, 0, 0)
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

/// What an entry of a page says.
enum Listed {
    Node {
        key: Key,
        points: u32,
        offset: u64,
        length: u64,
    },
    /// A node that another page lists, with those below it.
    Page(CopcPage),
    /// A node without points; those above others are added without being listed.
    Nothing,
}

fn name((level, [x, y, z]): Key) -> String {
    format!("node {level}-{x}-{y}-{z}")
}

fn parse_entry(entry: &[u8; ENTRY_LENGTH]) -> Result<Listed, String> {
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
        return Ok(Listed::Page(CopcPage::of(level, cell, page(offset, length))));
    }
    let points = u32::try_from(points).map_err(|_| format!("{name}: {points} points"))?;
    if points > Copc::MOST_POINTS {
        return Err(format!("{name}: {points} points, at most {} are read at once", Copc::MOST_POINTS));
    }
    if points == 0 {
        return Ok(Listed::Nothing);
    }
    // A length below zero is none that a compressed chunk has.
    Ok(Listed::Node { key: (level, cell), points, offset, length: u64::try_from(length).unwrap_or(0) })
}
