//! A chunk's points as a tree of oriented discs that rays are traced through on the GPU: made when the chunk comes in, never
//! changed after.
//!
//! The tree is binary, split at the median along the longest axis, and laid out in preorder with skip links, so that a ray
//! walks it without a stack (Smits 1998). Leaves hold up to `LEAF` discs of eight bytes: position in 1024 steps of the leaf's
//! box, octahedral normal in 11 + 11 bits, radius in steps of 2 % relative to the box. On a leaf some four discs wide, a step
//! is a hundredth of a disc's radius.

use cloud::{Chunk, NO_RADIUS, unpack_normal, unpack_radius};
use glam::Vec3;

/// Discs in a leaf at most. Fewer make more nodes, more make more disc tests; see docs/performance.md.
pub(crate) const LEAF: usize = 8;
/// A tree over a multiple of this many points has fewer nodes than its share of one each: all leaves but one are full, and
/// inner nodes are one fewer than leaves.
pub(crate) const POINTS_PER_NODE: u64 = LEAF as u64 / 2;
/// Bits of a leaf's count of discs.
const COUNT_BITS: u32 = 8;
const INNER: u32 = u32::MAX;

/// As shaders/shared/surfel_tree.wgsl has it. Positions are relative to the chunk's origin; nodes and discs count from the
/// chunk's first.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Node {
    /// Box of the discs.
    pub low: Vec3,
    /// The node that follows when a ray misses this one.
    pub skip: u32,
    pub high: Vec3,
    /// First disc and count of a leaf; `INNER` else.
    pub leaf: u32,
}

pub(crate) struct SurfelTree {
    pub nodes: Vec<Node>,
    pub surfels: Vec<[u32; 2]>,
    /// Index in the chunk of each disc.
    pub order: Vec<u32>,
}

struct Disc {
    position: Vec3,
    radius: f32,
    normal: Option<Vec3>,
}

impl SurfelTree {
    /// `provisional_radius`: of points whose own is not known yet, world units.
    pub fn new(chunk: &Chunk, provisional_radius: f32) -> Self {
        let radius = |index: usize| {
            let packed = chunk.radii.as_ref().map_or(NO_RADIUS, |radii| radii[index]);
            unpack_radius(packed).unwrap_or(provisional_radius)
        };
        let is_finite = |index: &u32| chunk.positions[*index as usize].iter().all(|v| v.is_finite());
        let mut order: Vec<u32> = (0..chunk.len() as u32).filter(is_finite).collect();
        let disc = |index: u32| Disc {
            position: Vec3::from(chunk.positions[index as usize]),
            radius: radius(index as usize),
            normal: chunk.normals.as_ref().and_then(|normals| unpack_normal(normals[index as usize])),
        };
        let mut tree = Self { nodes: Vec::new(), surfels: Vec::with_capacity(order.len()), order: Vec::new() };
        if !order.is_empty() {
            tree.build(&mut order, &disc);
        }
        tree.order = order;
        tree
    }

    fn build(&mut self, order: &mut [u32], disc: &impl Fn(u32) -> Disc) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut least, mut most) = (low, high);
        for &index in order.iter() {
            let Disc { position, radius, normal } = disc(index);
            (least, most) = (least.min(position), most.max(position));
            // A disc reaches r sqrt(1 - n^2) along each axis.
            let reach = normal.map_or(Vec3::ONE, |n| (Vec3::ONE - n * n).max(Vec3::ZERO).map(f32::sqrt)) * radius;
            (low, high) = (low.min(position - reach), high.max(position + reach));
        }
        // Rounding in the shader, and flat boxes: a ray must not slip between a wall's two faces.
        let margin = (high - low).max_element() * 1e-3 + low.abs().max(high.abs()).max_element() * 1e-6;
        let (low, high) = (low - margin, high + margin);
        let node = self.nodes.len();
        self.nodes.push(Node { low, skip: 0, high, leaf: INNER });
        if order.len() <= LEAF {
            self.nodes[node].leaf = (self.surfels.len() as u32) << COUNT_BITS | order.len() as u32;
            self.surfels.extend(order.iter().map(|&index| pack(&disc(index), low, high)));
        } else {
            let extent = most - least;
            let axis = if extent.x >= extent.max_element() {
                0
            } else if extent.y >= extent.z {
                1
            } else {
                2
            };
            // Left halves of whole leaves keep the leaves full.
            let half = (order.len() / 2).next_multiple_of(LEAF).min(order.len() - 1);
            let key = |index: &u32| disc(*index).position[axis];
            order.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            let (left, right) = order.split_at_mut(half);
            self.build(left, disc);
            self.build(right, disc);
        }
        self.nodes[node].skip = self.nodes.len() as u32;
    }
}

/// Steps of a position along each axis of its leaf's box.
const STEPS: f32 = 1023.0;
/// Radius = diagonal of the leaf's box x 2^(-k / 32): k is a byte, a step 2 %.
const RADIUS_STEPS: f32 = 32.0;
const HAS_NORMAL: u32 = 1 << 30;

fn pack(disc: &Disc, low: Vec3, high: Vec3) -> [u32; 2] {
    let extent = high - low;
    let place = (disc.position - low) / extent.max(Vec3::splat(f32::MIN_POSITIVE));
    let [x, y, z] = (place * STEPS).round().clamp(Vec3::ZERO, Vec3::splat(STEPS)).to_array().map(|v| v as u32);
    let ratio = (extent.length() / disc.radius.max(f32::MIN_POSITIVE)).log2() * RADIUS_STEPS;
    // Rounded down: to the larger radius.
    let radius = ratio.clamp(0.0, 255.0) as u32;
    let normal = disc.normal.map_or(0, |normal| HAS_NORMAL | octahedral(normal) << 8);
    [x | y << 10 | z << 20, normal | radius]
}

/// 11 + 11 bits.
fn octahedral(normal: Vec3) -> u32 {
    let flat = normal / (normal.x.abs() + normal.y.abs() + normal.z.abs());
    let (x, y) = if flat.z >= 0.0 {
        (flat.x, flat.y)
    } else {
        ((1.0 - flat.y.abs()).copysign(flat.x), (1.0 - flat.x.abs()).copysign(flat.y))
    };
    let [x, y] = [x, y].map(|v| ((v * 0.5 + 0.5) * 2047.0).round().clamp(0.0, 2047.0) as u32);
    x | y << 11
}

/// A tree over boxes (lower and upper corners), in the same layout; a leaf is the index of a box.
pub(crate) fn tree_over_boxes(boxes: &[(Vec3, Vec3)]) -> Vec<Node> {
    fn build(nodes: &mut Vec<Node>, order: &mut [u32], boxes: &[(Vec3, Vec3)]) {
        let join = |(low, high): (Vec3, Vec3), index: &u32| {
            let (other_low, other_high) = boxes[*index as usize];
            (low.min(other_low), high.max(other_high))
        };
        let (low, high) = order.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), join);
        let node = nodes.len();
        let leaf = if let [index] = order { *index } else { INNER };
        nodes.push(Node { low, skip: 0, high, leaf });
        if order.len() > 1 {
            let middle = |index: u32| boxes[index as usize].0 + boxes[index as usize].1;
            let extent = high - low;
            let axis = (0..3).max_by(|a, b| extent[*a].total_cmp(&extent[*b])).unwrap_or(0);
            let half = order.len() / 2;
            order.select_nth_unstable_by(half, |a, b| middle(*a)[axis].total_cmp(&middle(*b)[axis]).then(a.cmp(b)));
            let (left, right) = order.split_at_mut(half);
            build(nodes, left, boxes);
            build(nodes, right, boxes);
        }
        nodes[node].skip = nodes.len() as u32;
    }
    let mut nodes = Vec::new();
    let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
    if !order.is_empty() {
        build(&mut nodes, &mut order, boxes);
    }
    nodes
}
