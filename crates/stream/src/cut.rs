//! The cut: the nodes that a view needs, and the number of batches of each, within a budget of points and bytes.
//!
//! A *measure* says how far apart, in pixels, the points of a node are on the screen; 0 where the node does not matter.
//! It can be any function, so that a mirror can ask by reflected size; [`ViewMeasure`] is that of a camera. A node is
//! wanted where the points of its parent are further apart than the finest distance asked for, and the coarsest places
//! come first. That order does not depend on the budget: a larger budget only goes further along it, so it never shows
//! less of any place.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use cloud::Bounds;
use glam::{DMat3, DVec2, DVec3};

use crate::{BATCHES, Node, NodeId, Octree, prefix};

/// The most that a cut may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    pub points: u64,
    /// The size of the decoded points in bytes.
    pub bytes: u64,
}

/// A cloud that a cut is made of.
#[derive(Clone, Copy, Debug)]
pub struct Tree<'a> {
    /// The caller's number of the cloud.
    pub cloud: usize,
    pub octree: &'a Octree,
    /// The size of one decoded point in bytes, without `exact_positions`.
    pub point_bytes: u64,
}

/// A node of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted {
    pub cloud: usize,
    pub node: NodeId,
    /// The number of batches, 1 ..= [`BATCHES`].
    pub batches: usize,
}

/// A node whose parent is in the cut. The greatest comes next.
struct Candidate {
    /// The distance between the parent's points in pixels; infinite for a root.
    pixels: f64,
    level: u8,
    /// The index in the list of trees.
    tree: usize,
    node: NodeId,
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        // Coarse levels first, then the order of trees and nodes: the cut does not depend on the order in which the
        // heap is filled.
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
    /// Takes the batches of a node out of the budget: all of them, or as many as there is room for. Returns their
    /// number.
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

/// The cut of all trees together: parents before children, coarse to fine; the last node may have only a part of its
/// batches. Each root is in it whatever its measure, so that no cloud is ever without points; if not even the roots
/// fit, each gives the same number of batches.
///
/// `measure` receives the tree's `cloud`, the tree and a node, and returns the distance in pixels between neighbouring
/// points of the node's level; nodes with 0 or NaN are not wanted. Takes a few milliseconds for 100 thousand nodes.
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

/// The number of batches that each root can give.
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
        // The parent's points are twice as far apart as the node's own.
        let pixels = 2.0 * measure(cloud, octree, node);
        if pixels > finest_pixels && pixels > 0.0 {
            // No node is more urgent than its parent.
            let pixels = pixels.min(parent_pixels);
            heap.push(Candidate { pixels, level: node.level, tree, node: id });
        }
    }
}

/// The measure of a camera: the distance between a node's points at the nearest place of its bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMeasure {
    /// The position in world coordinates.
    eye: DVec3,
    /// Normals, which point into the picture, and offsets: a position `p` is in view where `normal.dot(p - eye) >=
    /// offset` for all.
    planes: Vec<(DVec3, f64)>,
    scale: PixelScale,
    /// The weight of nodes outside the picture, 0 to 1.
    unseen: f64,
}

/// How large things appear.
#[derive(Clone, Copy, Debug, PartialEq)]
enum PixelScale {
    /// Perspective: pixels per radian.
    PerRadian(f64),
    /// Parallel rays: pixels per world unit.
    PerUnit(f64),
}

impl ViewMeasure {
    /// `view_from_world` has the rows right, up and forward, as `scene::Camera` gives them. `tangents` are those of
    /// half the picture's angles (half its width and height at a distance of 1). `height` is the picture's height in
    /// pixels. `unseen` is the weight of nodes outside the picture, 0 to 1.
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

    /// A view with parallel rays. `half` is half the picture's width and height in world units. Points behind the eye
    /// are in view, too.
    pub fn parallel(eye: DVec3, view_from_world: DMat3, half: DVec2, height: f64, unseen: f64) -> Self {
        let [right, up, _] = rows(view_from_world);
        let planes = vec![(right, -half.x), (-right, -half.x), (up, -half.y), (-up, -half.y)];
        let per_unit = height / (2.0 * half.y.max(f64::MIN_POSITIVE));
        Self { eye, planes, scale: PixelScale::PerUnit(per_unit), unseen: unseen.clamp(0.0, 1.0) }
    }

    /// The distance in pixels between neighbouring points of the node's level, where it is nearest; weighted by
    /// `unseen` outside the picture.
    pub fn pixels(&self, octree: &Octree, node: &Node) -> f64 {
        if node.bounds.is_empty() {
            return 0.0;
        }
        let spacing = octree.spacing_at(node.level);
        let pixels = match self.scale {
            PixelScale::PerUnit(scale) => scale * spacing,
            PixelScale::PerRadian(scale) => {
                let nearest = self.eye.clamp(node.bounds.min, node.bounds.max);
                // The eye is never nearer than one spacing, so all levels count the same around it.
                scale * spacing / nearest.distance(self.eye).max(spacing)
            }
        };
        if self.is_seen(node.bounds) { pixels } else { pixels * self.unseen }
    }

    /// Whether a part of the box may lie in the picture.
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
