//! The cut: which nodes a view needs, and how many batches of each, under a point and byte budget.
//!
//! A *measure* says how far apart, in pixels, the points of a node come to lie on the screen: 0 where the node does not matter.
//! It is any function, so that a mirror can ask by reflected size; [`ViewMeasure`] is that of a camera. A node is wanted where the
//! points of its parent would lie further apart than the finest distance asked for, and the coarsest places come first. That
//! order does not depend on the budget: a larger one only goes further along it, so more budget never shows less of any place.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use cloud::Bounds;
use glam::{DMat3, DVec2, DVec3};

use crate::{BATCHES, Node, NodeId, Octree, prefix};

/// What may be used at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    pub points: u64,
    /// Of decoded points.
    pub bytes: u64,
}

/// A cloud that a cut is made of.
#[derive(Clone, Copy, Debug)]
pub struct Tree<'a> {
    /// What the caller calls it.
    pub cloud: usize,
    pub octree: &'a Octree,
    /// Bytes of one decoded point, without `exact_positions`.
    pub point_bytes: u64,
}

/// A part of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    pub cloud: usize,
    pub node: NodeId,
    /// 1 ..= [`BATCHES`].
    pub batches: usize,
}

/// A node whose parent is in the cut. The greatest comes next.
struct Candidate {
    /// Pixels between the parent's points; infinite for a root.
    pixels: f64,
    level: u8,
    /// Place in the list of trees.
    tree: usize,
    node: NodeId,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        // Coarse levels first, then in the order of trees and nodes: the same cut whatever order the heap is filled in.
        let rest = |c: &Self| (c.level, c.tree, c.node);
        self.pixels.total_cmp(&other.pixels).then_with(|| rest(other).cmp(&rest(self)))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl Budget {
    /// Batches of a node that fit, and takes them out. All of them, or as many as there is room for.
    fn take(&mut self, points: u32, batches: usize, point_bytes: u64) -> usize {
        let fits = |batches: usize| {
            let points = prefix(points as usize, batches) as u64;
            points <= self.points && points.saturating_mul(point_bytes) <= self.bytes
        };
        let batches = (0..=batches.min(BATCHES)).rev().find(|batches| fits(*batches)).unwrap_or(0);
        let points = prefix(points as usize, batches) as u64;
        self.points -= points;
        self.bytes -= points.saturating_mul(point_bytes);
        batches
    }
}

/// The cut of all trees together: parents before children, coarse to fine; the last may be a part of a node's batches. Each
/// root is in it whatever its measure, so that no cloud is ever without points; where not even the roots fit, each gives the same
/// number of batches.
///
/// `measure` gets the tree's `cloud`, the tree and a node, and gives the distance in pixels between neighbouring points of the
/// node's level; 0 or NaN: not wanted. Takes a few milliseconds for 100 thousand nodes.
pub fn choose(
    trees: &[Tree],
    measure: impl Fn(usize, &Octree, &Node) -> f64,
    budget: Budget,
    finest_pixels: f64,
) -> Vec<Wanted> {
    let mut left = budget;
    let mut cut = Vec::new();
    let mut heap = BinaryHeap::new();
    let root_batches = root_batches(trees, budget);
    for (tree, Tree { cloud, octree, point_bytes }) in trees.iter().enumerate() {
        let Some(root) = octree.nodes.first() else { continue };
        let batches = left.take(root.points, root_batches.max(1), root.point_bytes(*point_bytes));
        if batches == 0 {
            break;
        }
        cut.push(Wanted { cloud: *cloud, node: NodeId(0), batches });
        if root_batches == BATCHES {
            add_children(&mut heap, &measure, trees, tree, root, f64::INFINITY, finest_pixels);
        }
    }
    while let Some(Candidate { pixels, tree, node: id, .. }) = heap.pop() {
        let Tree { cloud, octree, point_bytes } = trees[tree];
        let node = octree.node(id);
        let batches = left.take(node.points, BATCHES, node.point_bytes(point_bytes));
        if batches > 0 {
            cut.push(Wanted { cloud, node: id, batches });
        }
        if batches < BATCHES {
            break;
        }
        add_children(&mut heap, &measure, trees, tree, node, pixels, finest_pixels);
    }
    cut
}

/// Batches that each root can give.
fn root_batches(trees: &[Tree], budget: Budget) -> usize {
    let fits = |batches: usize| {
        let (mut points, mut bytes) = (0_u64, 0_u64);
        for tree in trees {
            let Some(root) = tree.octree.nodes.first() else { continue };
            let own = prefix(root.points as usize, batches) as u64;
            points = points.saturating_add(own);
            bytes = bytes.saturating_add(own.saturating_mul(root.point_bytes(tree.point_bytes)));
        }
        points <= budget.points && bytes <= budget.bytes
    };
    (0..=BATCHES).rev().find(|batches| fits(*batches)).unwrap_or(0)
}

fn add_children(
    heap: &mut BinaryHeap<Candidate>,
    measure: &impl Fn(usize, &Octree, &Node) -> f64,
    trees: &[Tree],
    tree: usize,
    parent: &Node,
    parent_pixels: f64,
    finest_pixels: f64,
) {
    let Tree { cloud, octree, .. } = trees[tree];
    for id in parent.children.into_iter().flatten() {
        let node = octree.node(id);
        // The parent's points lie twice as far apart as the node's own.
        let pixels = 2.0 * measure(cloud, octree, node);
        if pixels > finest_pixels && pixels > 0.0 {
            // Nothing matters more than what it is a part of.
            let pixels = pixels.min(parent_pixels);
            heap.push(Candidate { pixels, level: node.level, tree, node: id });
        }
    }
}

/// The measure of a camera: the distance between a node's points as seen at the nearest place of its bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMeasure {
    /// World coordinates.
    eye: DVec3,
    /// Normals, into the picture, and offsets: a position `p` is seen where `normal.dot(p - eye) >= offset` for all.
    planes: Vec<(DVec3, f64)>,
    scale: PixelScale,
    /// Weight of nodes outside of the picture, 0 to 1.
    unseen: f64,
}

/// How large things appear.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PixelScale {
    /// Perspective.
    PerRadian(f64),
    /// Parallel rays: pixels per world unit.
    PerUnit(f64),
}

impl ViewMeasure {
    /// `view_from_world` has the rows right, up and forward, as `scene::Camera` gives them; `tangents` are those of half of the
    /// picture's angles (half its width and height at a distance of 1); `height` is the picture's, in pixels. `unseen` is how much
    /// nodes outside of the picture count, 0 to 1.
    pub fn perspective(eye: DVec3, view_from_world: DMat3, tangents: DVec2, height: f64, unseen: f64) -> Self {
        let [right, up, forward] = rows(view_from_world);
        let planes = vec![
            (forward, 0.0),
            (forward * tangents.x + right, 0.0),
            (forward * tangents.x - right, 0.0),
            (forward * tangents.y + up, 0.0),
            (forward * tangents.y - up, 0.0),
        ];
        let per_radian = height / (2.0 * tangents.y.max(f64::MIN_POSITIVE));
        Self { eye, planes, scale: PixelScale::PerRadian(per_radian), unseen: unseen.clamp(0.0, 1.0) }
    }

    /// Parallel rays. `half` is half the picture's width and height in world units; what lies behind the eye is seen, too.
    pub fn parallel(eye: DVec3, view_from_world: DMat3, half: DVec2, height: f64, unseen: f64) -> Self {
        let [right, up, _] = rows(view_from_world);
        let planes = vec![(right, -half.x), (-right, -half.x), (up, -half.y), (-up, -half.y)];
        let per_unit = height / (2.0 * half.y.max(f64::MIN_POSITIVE));
        Self { eye, planes, scale: PixelScale::PerUnit(per_unit), unseen: unseen.clamp(0.0, 1.0) }
    }

    /// Pixels between neighbouring points of the node's level, where it is nearest; less by `unseen` outside of the picture.
    pub fn pixels(&self, octree: &Octree, node: &Node) -> f64 {
        if node.bounds.is_empty() {
            return 0.0;
        }
        let spacing = octree.spacing_at(node.level);
        let pixels = match self.scale {
            PixelScale::PerUnit(scale) => scale * spacing,
            PixelScale::PerRadian(scale) => {
                let nearest = self.eye.clamp(node.bounds.min, node.bounds.max);
                // Nearer than one spacing there is nothing to see of it: about the eye all levels count the same.
                scale * spacing / nearest.distance(self.eye).max(spacing)
            }
        };
        if self.is_seen(node.bounds) { pixels } else { pixels * self.unseen }
    }

    /// Whether any of the box may lie in the picture.
    fn is_seen(&self, bounds: Bounds) -> bool {
        self.planes.iter().all(|(normal, offset)| {
            let furthest = DVec3::select(normal.cmpge(DVec3::ZERO), bounds.max, bounds.min);
            normal.dot(furthest - self.eye) >= *offset
        })
    }
}

fn rows(matrix: DMat3) -> [DVec3; 3] {
    [matrix.row(0), matrix.row(1), matrix.row(2)]
}

#[cfg(test)]
#[path = "cut_tests.rs"]
mod tests;
