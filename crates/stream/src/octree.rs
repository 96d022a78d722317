//! Where points lie in a tree of cubes and how many there are: all that is known of a cloud before its pages are read.

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Bounds, Placement};
use glam::DVec3;

/// A node of one octree: an index into [`Octree::nodes`], or a number behind those in one of its pages.
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
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Octree {
    /// The lower corner of the root's cube, in world coordinates.
    pub corner: DVec3,
    /// The width of the root's cube in world units.
    pub width: f64,
    /// The distance between neighbouring points of the root in world units; it halves with each level.
    pub spacing: f64,
    /// The nodes that are always known.
    pub nodes: Vec<Node>,
    /// What is known of others as long as views need them, in files whose lists of nodes are read page by page.
    pub paged: Paged,
}

/// The nodes of pages of a list of nodes, which come and go.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paged {
    /// The nodes of each page that is there, by the number of the first. No number is used twice, and a page comes after
    /// that of the nodes above it.
    pub pages: BTreeMap<u32, Arc<Vec<Node>>>,
    /// The children that pages have which are not there, by parent and octant, with the bounds of their points.
    pub unread: BTreeMap<(NodeId, u8), Bounds>,
    /// The bounds of the points without strays, from the nodes of the first page; `None` if it has all.
    pub scene: Option<Bounds>,
    /// The octrees of the open tiles, by their places in a catalogue. Its octree has a root without points; `unread` has the
    /// boxes of the closed tiles, by their places instead of parents.
    pub tiles: BTreeMap<u32, Arc<Octree>>,
}

impl Octree {
    /// An octree whose nodes are all known.
    pub fn new(corner: DVec3, width: f64, spacing: f64, nodes: Vec<Node>) -> Self {
        Self { corner, width, spacing, nodes, paged: Paged::default() }
    }

    /// Whether it is that of a catalogue: no nodes below the root, which has no points, but tiles.
    pub fn is_of_tiles(&self) -> bool {
        let is_bare = self.nodes.len() == 1 && self.nodes[0].points == 0 && !self.paged.unread.is_empty();
        is_bare || !self.paged.tiles.is_empty()
    }

    /// A node that is there.
    ///
    /// # Panics
    /// If its page is not there.
    pub fn node(&self, id: NodeId) -> &Node {
        self.get(id).unwrap_or_else(|| panic!("node {} is not there", id.0))
    }

    /// A node, unless its page is not there.
    pub fn get(&self, id: NodeId) -> Option<&Node> {
        let known = self.nodes.get(id.0 as usize);
        known.or_else(|| {
            let (first, page) = self.paged.pages.range(..=id.0).next_back()?;
            page.get((id.0 - first) as usize)
        })
    }

    /// A node to change, unless its page is not there.
    pub(crate) fn get_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        if (id.0 as usize) < self.nodes.len() {
            return self.nodes.get_mut(id.0 as usize);
        }
        let (first, page) = self.paged.pages.range_mut(..=id.0).next_back()?;
        Arc::make_mut(page).get_mut((id.0 - first) as usize)
    }

    /// The nodes with their points turned and moved, in level boxes about the turned ones.
    #[must_use]
    pub fn placed(&self, placement: &Placement) -> Self {
        let cube = placement.bounds(Bounds { min: self.corner, max: self.corner + self.width });
        let place = |node: &Node| Node { bounds: placement.bounds(node.bounds), ..node.clone() };
        let nodes = self.nodes.iter().map(place).collect();
        let pages = self.paged.pages.iter().map(|(first, page)| (*first, Arc::new(page.iter().map(place).collect())));
        let unread = self.paged.unread.iter().map(|(place, bounds)| (*place, placement.bounds(*bounds)));
        let scene = self.paged.scene.map(|bounds| placement.bounds(bounds));
        let tiles = self.paged.tiles.iter().map(|(tile, octree)| (*tile, Arc::new(octree.placed(placement))));
        let paged = Paged { pages: pages.collect(), unread: unread.collect(), scene, tiles: tiles.collect() };
        Self { corner: cube.min, width: cube.size().max_element(), spacing: self.spacing, nodes, paged }
    }

    /// The bounds of the points without strays, from the nodes that have none below them.
    pub fn scene_bounds(&self) -> Bounds {
        if let Some(scene) = self.paged.scene {
            return scene;
        }
        let leaves = || self.nodes.iter().filter(|node| node.children.iter().all(Option::is_none));
        let ends = leaves().filter(|leaf| !leaf.bounds.is_empty()).flat_map(|leaf| {
            let weight = leaf.total as f64 / 2.0;
            [(leaf.bounds.min, weight), (leaf.bounds.max, weight)]
        });
        let all = self.nodes.first().map_or(Bounds::EMPTY, |root| root.bounds);
        let Some(fence) = cloud::scene_fence(ends.collect()) else { return all };
        // Strays count to the cells at the cube's sides.
        let cube = Bounds { min: self.corner, max: self.corner + self.width };
        let fence = Bounds { min: fence.min.max(cube.min), max: fence.max.min(cube.max) };
        let within =
            leaves().map(|leaf| Bounds { min: leaf.bounds.min.max(fence.min), max: leaf.bounds.max.min(fence.max) });
        within.filter(|bounds| !bounds.is_empty()).fold(Bounds::EMPTY, Bounds::union)
    }

    /// The number of points of all nodes.
    pub fn points(&self) -> u64 {
        self.nodes.first().map_or(0, |root| root.total)
    }

    /// The distance between neighbouring points of a node of that level, in world units.
    pub fn spacing_at(&self, level: u8) -> f64 {
        self.spacing / f64::from(level).exp2()
    }

    /// All nodes that are there with their ids.
    pub fn ids(&self) -> impl Iterator<Item = (NodeId, &Node)> {
        let known = std::iter::once((0, self.nodes.as_slice()));
        let pages = known.chain(self.paged.pages.iter().map(|(first, page)| (*first, page.as_slice())));
        pages.flat_map(|(first, page)| (first..).map(NodeId).zip(page))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(bounds: Bounds, points: u32, level: u8) -> Node {
        let (total, first_point) = (u64::from(points), 0);
        Node { level, bounds, points, is_exact: false, total, first_point, parent: None, children: [None; 8] }
    }

    #[test]
    fn far_points_do_not_widen_the_bounds_of_a_scene() {
        let leaf = |index: u32| {
            let min = DVec3::new(f64::from(index % 8), f64::from(index / 8), 0.0);
            node(Bounds { min, max: min + DVec3::new(0.9, 0.9, 2.0) }, 5000, 1)
        };
        let mut octree = Octree::new(DVec3::ZERO, 1e4, 1.0, Vec::new());
        octree.nodes.push(node(Bounds { min: DVec3::ZERO, max: DVec3::splat(9e3) }, 9000, 0));
        octree.nodes[0].children[0] = Some(NodeId(1));
        octree.nodes.extend((0..64).map(leaf));
        octree.nodes.push(node(Bounds { min: DVec3::splat(9e3), max: DVec3::splat(9e3) }, 1, 1));
        let scene = octree.scene_bounds();
        assert_eq!((scene.min, scene.max), (DVec3::ZERO, DVec3::new(7.9, 7.9, 2.0)));
        // A stray in the cell at the side of a cube that leaves it out.
        octree.width = 8.0;
        octree.nodes[64].bounds.max = DVec3::splat(9e3);
        octree.nodes.pop();
        let scene = octree.scene_bounds();
        assert!(scene.max.x == 8.0 && scene.max.y == 8.0 && scene.max.z < 5.0, "{scene:?}");
        octree.nodes.truncate(1);
        octree.nodes[0].children[0] = None;
        assert_eq!(octree.scene_bounds(), octree.nodes[0].bounds);
    }
}
