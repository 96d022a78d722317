//! Reads the nodes of a COPC file as pages: no index has to be made, only the points within a node are reordered.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, PoisonError, RwLock};

use cloud::{Bounds, Chunk, Grid};
use codec::{Copc, CopcNode, CopcPage, PageNodes, Selection, Source};
use glam::{DVec3, UVec3, Vec3};

use crate::batches;
use crate::lattice::{KEY_LEVELS, morton};
use crate::{Error, Node, NodeId, Octree, Result};

/// A COPC file that is read node by node.
pub struct CopcPages {
    pub source: Arc<Source>,
    selection: Selection,
    /// The indices of the selected columns among those of the file.
    columns: Vec<usize>,
    /// The nodes that are always known, in the octree's order.
    nodes: Vec<CopcNode>,
    /// The nodes of the pages that are there, by the number of the first.
    paged: RwLock<BTreeMap<u32, Vec<CopcNode>>>,
}

impl CopcPages {
    /// `columns` are the indices of the file's attributes that chunks get, in their order.
    pub fn new(source: Arc<Source>, nodes: Vec<CopcNode>, columns: Vec<usize>) -> Self {
        let attributes = (0..source.info().attributes.len()).map(|index| columns.contains(&index)).collect();
        let selection = Selection { positions: true, colors: source.info().has_colors, normals: false, attributes };
        Self { source, selection, columns, nodes, paged: RwLock::default() }
    }

    fn node(&self, id: NodeId) -> Option<CopcNode> {
        if let Some(known) = self.nodes.get(id.0 as usize) {
            return Some(known.clone());
        }
        let paged = self.paged.read().unwrap_or_else(PoisonError::into_inner);
        let (first, page) = paged.range(..=id.0).next_back()?;
        page.get((id.0 - first) as usize).cloned()
    }

    /// Adds the nodes of a page, or removes them.
    pub fn set_page(&self, first: u32, nodes: Option<Vec<CopcNode>>) {
        let mut paged = self.paged.write().unwrap_or_else(PoisonError::into_inner);
        match nodes {
            Some(nodes) => paged.insert(first, nodes),
            None => paged.remove(&first),
        };
    }

    /// Takes over the pages that are there of the same file.
    pub fn take_pages(&self, other: &Self) {
        let pages = other.paged.read().unwrap_or_else(PoisonError::into_inner).clone();
        *self.paged.write().unwrap_or_else(PoisonError::into_inner) = pages;
    }

    /// The size of a node in the file in bytes; 0 if its page is not there.
    pub fn page_bytes(&self, node: NodeId) -> usize {
        self.node(node).map_or(0, |node| node.bytes as usize)
    }

    /// The points of a node in batch order.
    pub fn read(&self, id: NodeId, octree: &Octree) -> Result<Chunk> {
        let Some(node) = self.node(id) else {
            let gone = std::io::Error::other("the list of its nodes is no longer in memory");
            return Err(Error::Io { path: self.source.info().path.clone(), reason: gone });
        };
        let mut chunk = self.source.read_copc_node(&node, &self.selection)?;
        let mut columns = std::mem::take(&mut chunk.columns);
        // The chunk of a node without points has no columns.
        chunk.columns = self.columns.iter().map(|column| columns.get_mut(*column).and_then(Option::take)).collect();
        let cube = cube(octree.corner, octree.width, node.level, node.cell);
        let mut chunk = chunk.select(&in_batches(&chunk, &cube));
        chunk.first_point = number(node.level, node.cell);
        Ok(chunk)
    }
}

/// A number that identifies a node, whatever other nodes are known: coarse levels come first.
fn number(level: u32, cell: [u32; 3]) -> u64 {
    /// Room for the points of most nodes.
    const POINTS_BITS: u32 = 16;
    let finest = u32::from(KEY_LEVELS);
    let known = level.min(finest);
    let above: u64 = (0..known).map(|level| 1_u64 << (3 * level)).fold(0, u64::wrapping_add);
    above.wrapping_add(morton(cell.map(|cell| cell >> (level - known)))) << POINTS_BITS
}

/// Where the nodes of a COPC file lie.
pub struct Frame {
    corner: DVec3,
    width: f64,
    grid: Grid,
    /// The bounds of the header.
    bounds: Option<Bounds>,
}

impl Frame {
    pub fn new(copc: &Copc, grid: Grid, bounds: Option<Bounds>) -> Self {
        Self { corner: copc.corner, width: copc.width, grid, bounds }
    }

    pub fn bounds(&self, level: u32, cell: [u32; 3]) -> Bounds {
        let cube = cube(self.corner, self.width, level, cell);
        let common = self
            .bounds
            .map(|header| Bounds { min: header.min.max(cube.min), max: header.max.min(cube.max) })
            .unwrap_or(cube);
        // The two boxes have nothing in common where headers round, or lie.
        if common.is_empty() { cube } else { common }
    }

    /// The nodes of a list that has the parent of each but the first before it, numbered from `first` on; `above` is the
    /// parent of the first.
    pub fn nodes(&self, list: &[CopcNode], first: u32, above: Option<NodeId>) -> Vec<Node> {
        let mut nodes: Vec<Node> = Vec::with_capacity(list.len());
        let mut indices: HashMap<(u32, [u32; 3]), usize> = HashMap::with_capacity(list.len());
        for (index, node) in list.iter().enumerate() {
            let parent = indices.get(&above_of(node.level, node.cell)).copied().filter(|_| node.level > 0);
            if let Some(parent) = parent {
                nodes[parent].children[usize::from(octant(node.cell))] = Some(NodeId(first + index as u32));
            }
            let bounds = self.bounds(node.level, node.cell);
            nodes.push(Node {
                level: node.level as u8,
                bounds,
                points: node.points,
                is_exact: !self.grid.fits_f32(bounds),
                total: u64::from(node.points),
                first_point: number(node.level, node.cell),
                parent: parent.map(|parent| NodeId(first + parent as u32)).or(above.filter(|_| index == 0)),
                children: [None; 8],
            });
            indices.insert((node.level, node.cell), index);
        }
        for index in (1..nodes.len()).rev() {
            if let Some(parent) = nodes[index].parent.and_then(|NodeId(parent)| parent.checked_sub(first)) {
                nodes[parent as usize].total += nodes[index].total;
            }
        }
        nodes
    }

    /// The places of further pages below the nodes of a list: parent and octant, with the bounds and the page.
    pub fn links<'a>(
        &self,
        PageNodes { nodes, further }: &'a PageNodes,
        first: u32,
    ) -> Vec<((NodeId, u8), Bounds, &'a CopcPage)> {
        let find = |page: &CopcPage| {
            let above = above_of(page.level, page.cell);
            nodes.binary_search_by_key(&above, |node| (node.level, node.cell)).ok()
        };
        let link = |page: &'a CopcPage| {
            let parent = NodeId(first + find(page)? as u32);
            Some(((parent, octant(page.cell)), self.bounds(page.level, page.cell), page))
        };
        further.iter().filter_map(link).collect()
    }
}

fn above_of(level: u32, cell: [u32; 3]) -> (u32, [u32; 3]) {
    (level.saturating_sub(1), cell.map(|cell| cell / 2))
}

/// The octant of a cell in the one above it.
fn octant(cell: [u32; 3]) -> u8 {
    (0..3).map(|axis| ((cell[axis] & 1) as u8) << axis).sum()
}

/// The octree of a COPC file. Nodes that only have others below them have no points. `points` are those of the file.
pub fn octree(copc: &Copc, frame: &Frame, points: u64) -> Octree {
    let with = |nodes: Vec<Node>| Octree::new(copc.corner, copc.width, copc.spacing, nodes);
    let mut octree = with(frame.nodes(&copc.nodes, 0, None));
    if copc.first < copc.nodes.len() || !copc.further.is_empty() {
        // The same whichever other pages are there.
        octree.paged.scene = Some(with(frame.nodes(&copc.nodes[..copc.first], 0, None)).scene_bounds());
    }
    if !copc.further.is_empty() {
        let first = PageNodes { nodes: copc.nodes.clone(), further: copc.further.clone() };
        octree.paged.unread = frame.links(&first, 0).into_iter().map(|(place, bounds, _)| (place, bounds)).collect();
        octree.nodes[0].total = points;
    }
    octree
}

fn cube(corner: DVec3, width: f64, level: u32, cell: [u32; 3]) -> Bounds {
    let width = width / f64::from(level).exp2();
    let min = corner + width * UVec3::from(cell).as_dvec3();
    Bounds { min, max: min + width }
}

/// The points of a chunk in the order that pages keep.
fn in_batches(chunk: &Chunk, cube: &Bounds) -> Vec<u32> {
    let cells = f64::from(1_u32 << KEY_LEVELS);
    let factor = cells / (cube.max.x - cube.min.x);
    let start = (chunk.origin - cube.min) * factor;
    let key = |position: &[f32; 3]| {
        let at = (Vec3::from(*position).as_dvec3() * factor + start).clamp(DVec3::ZERO, DVec3::splat(cells - 1.0));
        morton(at.to_array().map(|at| at as u32))
    };
    let mut ranked: Vec<(u64, u32)> = chunk.positions.iter().map(key).zip(0..).collect();
    ranked.sort_unstable();
    batches::order(ranked.len()).map(|rank| ranked[rank].1).collect()
}
