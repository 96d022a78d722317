//! Which parts of a cloud are loaded, and whether its file has more points somewhere.

use std::sync::Arc;

use cloud::{Bounds, Placement};
use stream::{NodeId, Octree};

use crate::chunk_key::Part;

/// The parts of a cloud that are loaded, and the index of a streamed cloud, by which those are known that are not.
#[derive(Clone, Default)]
pub struct LoadedParts {
    /// In order, with the bounds of their points.
    pub parts: Vec<(Part, Bounds)>,
    /// Of a streamed cloud its index, once there is one.
    pub streamed: Option<Option<Arc<Octree>>>,
    /// Whether points of a cloud in memory are missing, nobody knows where. Those that are there are as near to one another
    /// as in the file.
    pub is_cut: bool,
    /// How its points are moved.
    pub placement: Option<Placement>,
}

impl LoadedParts {
    /// Whether the file has points that are not loaded in nodes for whose bounds `is_near` holds. Bounds are those of the
    /// file. What is loaded is then a choice of one point from each cell of space, whose noise is not that of all points.
    pub fn lack(&self, is_near: &dyn Fn(Bounds) -> bool) -> bool {
        let Some(octree) = &self.streamed else { return false };
        // Of a cloud whose index is being made there is a preview.
        let Some(octree) = octree else { return true };
        let is_loaded = |part: Part| self.parts.binary_search_by_key(&part, |(part, _)| *part).is_ok();
        if octree.paged.tiles.is_empty() {
            return lacks_points(octree, NodeId(0), is_near, &|id| is_loaded(Part::Node(id)));
        }
        let mut closed = octree.paged.unread.values();
        let lacks = |(tile, octree): (&u32, &Arc<Octree>)| {
            lacks_points(octree, NodeId(0), is_near, &|id| is_loaded(Part::Tile(*tile, id)))
        };
        closed.any(|bounds| is_near(*bounds)) || octree.paged.tiles.iter().any(lacks)
    }
}

/// Whether a node that is near, or one below it, is not loaded.
fn lacks_points(
    octree: &Octree,
    id: NodeId,
    is_near: &dyn Fn(Bounds) -> bool,
    is_loaded: &dyn Fn(NodeId) -> bool,
) -> bool {
    let Some(node) = octree.get(id).filter(|node| !node.bounds.is_empty() && is_near(node.bounds)) else {
        return false;
    };
    // What the page of a list of nodes has that is not there is not loaded.
    let mut unread = octree.paged.unread.range((id, 0)..=(id, u8::MAX));
    let is_missing = node.points > 0 && !is_loaded(id) || unread.any(|(_, bounds)| is_near(*bounds));
    is_missing || node.children.iter().flatten().any(|child| lacks_points(octree, *child, is_near, is_loaded))
}
