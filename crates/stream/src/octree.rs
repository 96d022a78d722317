//! Where points lie in a tree of cubes, and how many: all that is known of a cloud before its pages are read.

use cloud::Bounds;
use glam::DVec3;

/// A node of one octree: its place in [`Octree::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// A cube and what is stored for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// 0 for the root.
    pub level: u8,
    /// Of its finite points and those of all nodes below it, world coordinates.
    pub bounds: Bounds,
    /// Its own points.
    pub points: u32,
    /// Its chunk may keep `exact_positions`.
    pub is_exact: bool,
    /// Its own points and those of all nodes below it.
    pub total: u64,
    /// Points of all nodes before it: tells chunks apart.
    pub first_point: u64,
    pub parent: Option<NodeId>,
    /// In the octant with bit 0 set for the upper half in x, bit 1 in y, bit 2 in z.
    pub children: [Option<NodeId>; 8],
}

impl Node {
    /// Bytes of a decoded point, where one without `exact_positions` takes so many.
    pub fn point_bytes(&self, usual: u64) -> u64 {
        usual.saturating_add(if self.is_exact { size_of::<[f64; 3]>() as u64 } else { 0 })
    }
}

/// The nodes of a cloud, parents before their children; the first is the root.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    /// Lower corner of the root's cube, world coordinates.
    pub corner: DVec3,
    /// Width of the root's cube, world units.
    pub width: f64,
    /// Distance between neighbouring points of the root, world units; half of it a level further down.
    pub spacing: f64,
    pub nodes: Vec<Node>,
}

impl Octree {
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0 as usize]
    }

    /// Points of all nodes.
    pub fn points(&self) -> u64 {
        self.nodes.first().map_or(0, |root| root.total)
    }

    /// Distance between neighbouring points of a node of that level, world units.
    pub fn spacing_at(&self, level: u8) -> f64 {
        self.spacing / f64::from(level).exp2()
    }

    /// Nodes with what they are called.
    pub fn ids(&self) -> impl Iterator<Item = (NodeId, &Node)> {
        self.nodes.iter().enumerate().map(|(index, node)| (NodeId(index as u32), node))
    }
}
