//! Synthetic octrees for tests.

use std::sync::Arc;

use cloud::{Bounds, Chunk};
use glam::DVec3;

use crate::batches::order;
use crate::{Node, NodeId, Octree};

/// The width of all root cubes; their corner is the origin.
const WIDTH: f64 = 1024.0;

/// A terrain: every cell of the lowest layer has a node with `points` points, down to `levels` levels below the root.
pub fn filled(levels: u8, points: u32) -> Octree {
    build(|_, octant| octant < 4, levels, |_| points, usize::MAX)
}

/// Up to `nodes` nodes at random places, of various sizes.
pub fn random(seed: u64, nodes: usize) -> Octree {
    let of = |key: u64, salt: u64| cloud::hash(key ^ seed.wrapping_mul(0x9e37_79b9).wrapping_add(salt << 40));
    build(|key, octant| of(key, octant as u64 + 1) % 3 != 0, 6, |key| 1 + (of(key, 77) % 2000) as u32, nodes)
}

/// Builds a tree level by level. `is_there` and `points` receive a key that is unique to each node.
fn build(is_there: impl Fn(u64, usize) -> bool, levels: u8, points: impl Fn(u64) -> u32, at_most: usize) -> Octree {
    let mut octree = Octree::new(DVec3::ZERO, WIDTH, WIDTH / 128.0, Vec::new());
    let node = |level, corner: DVec3, width: f64, points, parent| Node {
        level,
        bounds: Bounds { min: corner, max: corner + width },
        points,
        is_exact: false,
        total: u64::from(points),
        first_point: 0,
        parent,
        children: [None; 8],
    };
    let mut keys = vec![1_u64];
    octree.nodes.push(node(0, DVec3::ZERO, WIDTH, points(1), None));
    let mut next = 0;
    while next < octree.nodes.len() {
        let (level, corner, key) = (octree.nodes[next].level, octree.nodes[next].bounds.min, keys[next]);
        for octant in (0..8).filter(|octant| level < levels && is_there(key, *octant)) {
            if octree.nodes.len() == at_most {
                break;
            }
            let width = WIDTH / f64::from(level + 1).exp2();
            let side = |bit: usize| (octant >> bit & 1) as f64 * width;
            let corner = corner + DVec3::new(side(0), side(1), side(2));
            let key = key << 3 | octant as u64;
            octree.nodes[next].children[octant] = Some(NodeId(octree.nodes.len() as u32));
            octree.nodes.push(node(level + 1, corner, width, points(key), Some(NodeId(next as u32))));
            keys.push(key);
        }
        next += 1;
    }
    let mut first = 0;
    for node in &mut octree.nodes {
        node.first_point = first;
        first += u64::from(node.points);
    }
    for index in (1..octree.nodes.len()).rev() {
        let (total, parent) = (octree.nodes[index].total, octree.nodes[index].parent);
        if let Some(parent) = parent {
            octree.nodes[parent.0 as usize].total += total;
        }
    }
    octree
}

/// The points of a node, somewhere in its cube, with normals and radii.
pub fn page(octree: &Octree, id: NodeId) -> Chunk {
    let node = octree.node(id);
    let size = node.bounds.size();
    let share = |index: u32, axis: u64| {
        let bits = cloud::hash(u64::from(id.0) << 40 | u64::from(index) << 8 | axis);
        (bits >> 11) as f64 / (1_u64 << 53) as f64
    };
    let position = |index| (size * DVec3::from_array([0, 1, 2].map(|axis| share(index, axis)))).as_vec3().to_array();
    let mut chunk = Chunk::new(node.first_point, node.bounds.min, (0..node.points).map(position).collect());
    chunk.normals = Some(Arc::new((0..node.points).map(|index| index * 7).collect()));
    chunk.radii = Some(Arc::new((0..node.points).map(|index| 20_000 + (index % 100) as u16).collect()));
    chunk
}

/// The number of points along a side of a node of [`terrain`].
const SIDE: u32 = 16;

/// A flat square down to `levels` levels below the root. Nodes hold `SIDE` by `SIDE` points, in the middle of the cells
/// of a grid.
pub fn terrain(levels: u8) -> Octree {
    Octree { spacing: WIDTH / f64::from(SIDE), ..filled(levels, SIDE * SIDE) }
}

/// The points of a node of [`terrain`] in batch order, with the radius that all points together need.
pub fn terrain_page(octree: &Octree, id: NodeId) -> Chunk {
    let node = octree.node(id);
    let cell = node.bounds.size().x / f64::from(SIDE);
    let even_bits = |rank: u32| (0..4).map(|bit| (rank >> (2 * bit) & 1) << bit).sum::<u32>();
    let position = |rank: u32| {
        let place = |index: u32| (f64::from(index) + 0.5) * cell;
        [place(even_bits(rank)) as f32, place(even_bits(rank >> 1)) as f32, 0.0]
    };
    let positions: Vec<[f32; 3]> = order(node.points as usize).map(|rank| position(rank as u32)).collect();
    let area = octree.width * octree.width / octree.points() as f64;
    let radius = cloud::SPLAT_OVERLAP * (area / std::f64::consts::PI).sqrt() as f32;
    let mut chunk = Chunk::new(node.first_point, node.bounds.min, positions);
    chunk.normals = Some(Arc::new(vec![cloud::pack_normal(glam::Vec3::Z); chunk.len()]));
    chunk.radii = Some(Arc::new(vec![cloud::pack_radius(radius); chunk.len()]));
    chunk
}
