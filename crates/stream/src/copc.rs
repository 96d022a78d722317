//! Reads the nodes of a COPC file as pages: no index has to be made, only the points within a node are reordered.

use std::sync::Arc;

use cloud::{Bounds, Chunk, Grid};
use codec::{Copc, CopcNode, Selection, Source};
use glam::{DVec3, UVec3, Vec3};

use crate::batches;
use crate::lattice::{KEY_LEVELS, morton};
use crate::{Node, NodeId, Octree, Result};

/// A COPC file that is read node by node.
pub struct CopcPages {
    source: Arc<Source>,
    selection: Selection,
    /// The indices of the selected columns among those of the file.
    columns: Vec<usize>,
    /// The nodes, in the octree's order.
    nodes: Vec<CopcNode>,
}

impl CopcPages {
    /// `columns` are the indices of the file's attributes that chunks get, in their order.
    pub fn new(source: Arc<Source>, nodes: Vec<CopcNode>, columns: Vec<usize>) -> Self {
        let attributes = (0..source.info().attributes.len()).map(|index| columns.contains(&index)).collect();
        let selection = Selection { positions: true, colors: source.info().has_colors, normals: false, attributes };
        Self { source, selection, columns, nodes }
    }

    /// The size of a node in the file in bytes.
    pub fn page_bytes(&self, node: usize) -> usize {
        self.nodes[node].bytes as usize
    }

    /// The points of a node in batch order.
    pub fn read(&self, node: usize, octree: &Octree) -> Result<Chunk> {
        let CopcNode { level, cell, .. } = self.nodes[node];
        let mut chunk = self.source.read_copc_node(&self.nodes[node], &self.selection)?;
        let mut columns = std::mem::take(&mut chunk.columns);
        chunk.columns = self.columns.iter().map(|column| columns[*column].take()).collect();
        let cube = cube(octree.corner, octree.width, level, cell);
        let mut chunk = chunk.select(&in_batches(&chunk, &cube));
        chunk.first_point = octree.nodes[node].first_point;
        Ok(chunk)
    }
}

/// The octree of a COPC file. Nodes that only have others below them have no points.
pub fn octree(copc: &Copc, grid: &Grid, header_bounds: Option<Bounds>) -> Octree {
    let bounds = |node: &CopcNode| {
        let cube = cube(copc.corner, copc.width, node.level, node.cell);
        let common = header_bounds
            .map(|header| Bounds { min: header.min.max(cube.min), max: header.max.min(cube.max) })
            .unwrap_or(cube);
        // The two boxes have nothing in common where headers round, or lie.
        if common.is_empty() { cube } else { common }
    };
    let mut nodes: Vec<Node> = Vec::with_capacity(copc.nodes.len());
    let mut first_point = 0;
    for (index, node) in copc.nodes.iter().enumerate() {
        // Nodes come level by level, sorted by their cell, and every parent is in the list.
        let parent = (node.level > 0).then(|| {
            let parent = (node.level - 1, node.cell.map(|cell| cell / 2));
            copc.nodes.binary_search_by_key(&parent, |node| (node.level, node.cell)).unwrap_or(0)
        });
        if let Some(parent) = parent {
            let octant = (0..3).map(|axis| ((node.cell[axis] & 1) as usize) << axis).sum::<usize>();
            nodes[parent].children[octant] = Some(NodeId(index as u32));
        }
        let bounds = bounds(node);
        nodes.push(Node {
            level: node.level as u8,
            bounds,
            points: node.points,
            is_exact: !grid.fits_f32(bounds),
            total: u64::from(node.points),
            first_point,
            parent: parent.map(|parent| NodeId(parent as u32)),
            children: [None; 8],
        });
        first_point += u64::from(node.points);
    }
    for index in (1..nodes.len()).rev() {
        if let Some(NodeId(parent)) = nodes[index].parent {
            nodes[parent as usize].total += nodes[index].total;
        }
    }
    Octree { corner: copc.corner, width: copc.width, spacing: copc.spacing, nodes }
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
