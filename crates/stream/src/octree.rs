//! Where points lie in a tree of cubes and how many there are: all that is known of a cloud before its pages are read.

use cloud::{Bounds, Placement};
use glam::DVec3;

/// A node of one octree, as an index into [`Octree::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId(pub u32);

/// A cube and the numbers of the points stored for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The level in the tree; 0 for the root.
    pub level: u8,
    /// The bounds of its finite points and those of all nodes below it, in world coordinates.
    pub bounds: Bounds,
    /// The number of its own points.
    pub points: u32,
    /// Whether its chunk may have `exact_positions`.
    pub is_exact: bool,
    /// The number of its own points and those of all nodes below it.
    pub total: u64,
    /// The number of points of all nodes before it; identifies the chunk.
    pub first_point: u64,
    pub parent: Option<NodeId>,
    /// The child in each octant; bit 0 of the octant is set for the upper half in x, bit 1 in y, bit 2 in z.
    pub children: [Option<NodeId>; 8],
}

impl Node {
    /// The size of a decoded point in bytes; `usual` is the size of one without `exact_positions`.
    pub fn point_bytes(&self, usual: u64) -> u64 {
        usual.saturating_add(if self.is_exact { size_of::<[f64; 3]>() as u64 } else { 0 })
    }
}

/// The nodes of a cloud, parents before their children; the first is the root.
#[derive(Clone, Debug, PartialEq)]
pub struct Octree {
    /// The lower corner of the root's cube, in world coordinates.
    pub corner: DVec3,
    /// The width of the root's cube in world units.
    pub width: f64,
    /// The distance between neighbouring points of the root in world units; it halves with each level.
    pub spacing: f64,
    pub nodes: Vec<Node>,
}

impl Octree {
    pub fn node(&self, id: NodeId) -> &Node {
        &self.nodes[id.0 as usize]
    }

    /// The same nodes with their points turned and moved, in level boxes about the turned ones.
    #[must_use]
    pub fn placed(&self, placement: &Placement) -> Self {
        let cube = placement.bounds(Bounds { min: self.corner, max: self.corner + self.width });
        let place = |node: &Node| Node { bounds: placement.bounds(node.bounds), ..node.clone() };
        let nodes = self.nodes.iter().map(place).collect();
        Self { corner: cube.min, width: cube.size().max_element(), spacing: self.spacing, nodes }
    }

    /// The number of points of all nodes.
    pub fn points(&self) -> u64 {
        self.nodes.first().map_or(0, |root| root.total)
    }

    /// The distance between neighbouring points of a node of that level, in world units.
    pub fn spacing_at(&self, level: u8) -> f64 {
        self.spacing / f64::from(level).exp2()
    }

    /// All nodes with their ids.
    pub fn ids(&self) -> impl Iterator<Item = (NodeId, &Node)> {
        self.nodes.iter().enumerate().map(|(index, node)| (NodeId(index as u32), node))
    }
}
