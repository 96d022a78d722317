//! The cut: the nodes that a view needs, and the number of batches of each, within a budget of points and bytes.
//!
//! A *measure* says how far apart, in pixels, the points of a node are on the screen; 0 where the node does not matter.
//! It can be any function; [`ViewMeasure`] is that of a camera and of the mirrors in its picture. A node is
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

/// What a view needs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cut {
    pub wanted: Vec<Wanted>,
    /// The children that would come next, but whose pages of the list of nodes are not there: cloud, parent and octant. The
    /// cut leaves as much room for each as its parent takes.
    pub unread: Vec<(usize, NodeId, u8)>,
    /// The first node that found no room: the cut depends on it as well.
    pub next: Option<(usize, NodeId)>,
}

/// A node whose parent is in the cut. The greatest comes next.
struct Candidate {
    /// The distance between the parent's points in pixels; infinite for a root.
    pixels: f64,
    level: u8,
    /// The index in the list of trees.
    tree: usize,
    /// The number of cubes of its level before it in z, y and x.
    cell: [u64; 3],
    place: Place,
}

enum Place {
    Node(NodeId),
    /// A child in an octant of a node, whose page is not there.
    Unread(NodeId, u8),
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        // Coarse levels first, then the order of trees and places: the cut does not depend on the order in which the heap
        // is filled, nor on that in which nodes were read.
        let rest = |c: &Self| (c.level, c.tree, c.cell);
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
) -> Cut {
    let mut left = budget;
    let mut cut = Cut::default();
    let mut heap = BinaryHeap::new();
    let root_batches = root_batches(trees, budget);
    for (tree, Tree { cloud, octree, point_bytes }) in trees.iter().enumerate() {
        let Some(root) = octree.nodes.first() else { continue };
        let batches = left.take(root.points, root_batches.max(1), root.point_bytes(*point_bytes));
        if batches == 0 {
            break;
        }
        cut.wanted.push(Wanted { cloud: *cloud, node: NodeId(0), batches });
        if root_batches == BATCHES {
            let above = Above { tree, id: NodeId(0), cell: [0; 3], pixels: f64::INFINITY };
            add_children(&mut heap, &measure, trees, &above, finest_pixels);
        }
    }
    while let Some(Candidate { pixels, tree, cell, place, .. }) = heap.pop() {
        let Tree { cloud, octree, point_bytes } = trees[tree];
        let id = match place {
            Place::Node(id) => id,
            Place::Unread(parent, octant) => {
                cut.unread.push((cloud, parent, octant));
                parent
            }
        };
        let node = octree.node(id);
        let batches = left.take(node.points, BATCHES, node.point_bytes(point_bytes));
        let is_there = matches!(place, Place::Node(_));
        if batches > 0 && is_there {
            cut.wanted.push(Wanted { cloud, node: id, batches });
        }
        if batches < BATCHES {
            cut.next = Some((cloud, id));
            break;
        }
        if is_there {
            add_children(&mut heap, &measure, trees, &Above { tree, id, cell, pixels }, finest_pixels);
        }
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

/// A node of the cut: its tree, its place there, and how far apart the points of its own parent are in pixels.
struct Above {
    tree: usize,
    id: NodeId,
    cell: [u64; 3],
    pixels: f64,
}

fn add_children(
    heap: &mut BinaryHeap<Candidate>,
    measure: &impl Fn(usize, &Octree, &Node) -> f64,
    trees: &[Tree],
    parent: &Above,
    finest_pixels: f64,
) {
    let Tree { cloud, octree, .. } = trees[parent.tree];
    let own = octree.node(parent.id);
    let mut add = |octant: u8, node: &Node, place: Place| {
        // The parent's points are twice as far apart as the node's own.
        let pixels = 2.0 * measure(cloud, octree, node);
        if pixels > finest_pixels && pixels > 0.0 {
            // No node is more urgent than its parent.
            let pixels = pixels.min(parent.pixels);
            let half = |axis: u8| u64::from(octant >> axis & 1);
            let [z, y, x] = parent.cell;
            let cell = [z.wrapping_mul(2) + half(2), y.wrapping_mul(2) + half(1), x.wrapping_mul(2) + half(0)];
            heap.push(Candidate { pixels, level: node.level, tree: parent.tree, cell, place });
        }
    };
    for (octant, id) in (0_u8..).zip(own.children).filter_map(|(octant, child)| Some((octant, child?))) {
        add(octant, octree.node(id), Place::Node(id));
    }
    for ((id, octant), bounds) in octree.paged.unread.range((parent.id, 0)..=(parent.id, u8::MAX)) {
        let unread = Node { level: own.level + 1, bounds: *bounds, children: [None; 8], ..own.clone() };
        add(*octant, &unread, Place::Unread(*id, *octant));
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
    /// The mirrors that may be in the picture.
    mirrors: Vec<MirrorBound>,
}

/// A mirror as far as a measure knows it. What it shows of a place is as large as a flat mirror shows it at most; only
/// hollow parts may show it larger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorBound {
    /// A ball around it.
    pub center: DVec3,
    pub radius: f64,
    pub form: MirrorForm,
}

/// The form of a mirror.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MirrorForm {
    /// A plane with this unit normal. It shows what a camera at the mirrored eye sees through it.
    Flat(DVec3),
    /// The sphere itself: it may show any place, and spreads the rays.
    Sphere,
    /// A mirror of any other form may show any place.
    Other,
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
        let (scale, unseen) = (PixelScale::PerRadian(per_radian), unseen.clamp(0.0, 1.0));
        Self { eye, planes, scale, unseen, mirrors: Vec::new() }
    }

    /// A view with parallel rays. `half` is half the picture's width and height in world units. Points behind the eye
    /// are in view, too.
    pub fn parallel(eye: DVec3, view_from_world: DMat3, half: DVec2, height: f64, unseen: f64) -> Self {
        let [right, up, _] = rows(view_from_world);
        let planes = vec![(right, -half.x), (-right, -half.x), (up, -half.y), (-up, -half.y)];
        let per_unit = height / (2.0 * half.y.max(f64::MIN_POSITIVE));
        let (scale, unseen) = (PixelScale::PerUnit(per_unit), unseen.clamp(0.0, 1.0));
        Self { eye, planes, scale, unseen, mirrors: Vec::new() }
    }

    /// The measure of a view with the mirrors that may be in its picture.
    pub fn with_mirrors(self, mirrors: impl IntoIterator<Item = MirrorBound>) -> Self {
        let is_seen = |mirror: &MirrorBound| {
            let MirrorBound { center, radius, .. } = mirror;
            self.planes.iter().all(|(normal, offset)| normal.dot(*center - self.eye) + radius >= *offset)
        };
        let mirrors = mirrors.into_iter().filter(is_seen).collect();
        Self { mirrors, ..self }
    }

    /// The distance in pixels between neighbouring points of the node's level, where it is nearest. Outside the picture
    /// it is the largest that a mirror may show, and at least that in the direction of the node weighted by `unseen`.
    pub fn pixels(&self, octree: &Octree, node: &Node) -> f64 {
        if node.bounds.is_empty() {
            return 0.0;
        }
        self.pixels_of(node.bounds, octree.spacing_at(node.level))
    }

    /// The same for points in a box that are `spacing` apart.
    pub fn pixels_of(&self, bounds: Bounds, spacing: f64) -> f64 {
        let pixels = self.pixels_after(self.distance(bounds), spacing, 1.0);
        if self.sees(bounds) {
            return pixels;
        }
        let reflected = self.mirrors.iter().map(|mirror| self.reflected_pixels(mirror, bounds, spacing));
        reflected.fold(pixels * self.unseen, f64::max).min(pixels)
    }

    /// The distance between the eye and the nearest place of a box.
    pub fn distance(&self, bounds: Bounds) -> f64 {
        self.eye.distance(nearest(bounds, self.eye))
    }

    /// How soon a box is read among others, smallest first: those in the picture, then the nearest.
    pub fn rank(&self, bounds: Bounds) -> (bool, f64) {
        (!self.sees(bounds), self.distance(bounds))
    }

    /// The length of `spacing` in pixels at the end of a way of this length, along which rays spread this many times as
    /// much as in front of the eye.
    fn pixels_after(&self, way: f64, spacing: f64, spread: f64) -> f64 {
        match self.scale {
            PixelScale::PerUnit(scale) => scale * spacing / spread,
            // The eye is never nearer than one spacing, so all levels count the same around it.
            PixelScale::PerRadian(scale) => scale * spacing / (way * spread).max(spacing),
        }
    }

    /// The largest distance in pixels at which a mirror may show neighbouring points, `spacing` apart, of a box; 0 if it
    /// does not show the box. Rays that were reflected before are not followed.
    fn reflected_pixels(&self, mirror: &MirrorBound, bounds: Bounds, spacing: f64) -> f64 {
        let MirrorBound { center, radius, form } = *mirror;
        match form {
            MirrorForm::Flat(normal) => {
                let to_eye = normal.dot(self.eye - center);
                let toward_eye = if to_eye < 0.0 { -normal } else { normal };
                if toward_eye.dot(furthest(bounds, toward_eye) - center) <= 0.0 {
                    return 0.0;
                }
                let image = self.eye - 2.0 * to_eye * normal;
                let is_framed = match self.scale {
                    PixelScale::PerRadian(_) => is_in_cone(image, center, radius, bounds),
                    PixelScale::PerUnit(_) => true,
                };
                let way = image.distance(nearest(bounds, image));
                if is_framed { self.pixels_after(way, spacing, 1.0) } else { 0.0 }
            }
            MirrorForm::Sphere | MirrorForm::Other => {
                let before = (self.eye.distance(center) - radius).max(0.0);
                let after = (center.distance(nearest(bounds, center)) - radius).max(0.0);
                let way = before + after;
                // Where a pixel of angle a meets a sphere, the normal turns by a * before / radius and the ray by twice
                // that; parallel rays of width w turn by 2 w / radius. Grazing rays spread more.
                let spread = match (form, self.scale) {
                    (MirrorForm::Sphere, PixelScale::PerRadian(_)) if way > 0.0 => {
                        1.0 + 2.0 * before * after / (radius * way)
                    }
                    (MirrorForm::Sphere, PixelScale::PerUnit(_)) => 1.0 + 2.0 * after / radius,
                    _ => 1.0,
                };
                self.pixels_after(way, spacing, spread)
            }
        }
    }

    /// Whether a part of the box may lie in the picture.
    pub fn sees(&self, bounds: Bounds) -> bool {
        self.planes.iter().all(|(normal, offset)| normal.dot(furthest(bounds, *normal) - self.eye) >= *offset)
    }
}

/// The point of a box that is nearest to a place.
fn nearest(bounds: Bounds, place: DVec3) -> DVec3 {
    place.clamp(bounds.min, bounds.max)
}

/// The corner of a box that is furthest in a direction.
fn furthest(bounds: Bounds, direction: DVec3) -> DVec3 {
    DVec3::select(direction.cmpge(DVec3::ZERO), bounds.max, bounds.min)
}

/// Whether rays from `apex` through a ball may meet a box.
fn is_in_cone(apex: DVec3, center: DVec3, radius: f64, bounds: Bounds) -> bool {
    let angle = |reach: f64, distance: f64| if reach < distance { (reach / distance).asin() } else { f64::INFINITY };
    let (axis, to_box) = (center - apex, bounds.center() - apex);
    let allowed = angle(radius, axis.length()) + angle(bounds.radius(), to_box.length());
    // A wider cone contains everything, also where an apex in a ball leaves no angle to compare.
    allowed >= std::f64::consts::PI || axis.angle_between(to_box) <= allowed
}

fn rows(matrix: DMat3) -> [DVec3; 3] {
    [matrix.row(0), matrix.row(1), matrix.row(2)]
}

#[cfg(test)]
#[path = "cut_tests.rs"]
mod tests;
