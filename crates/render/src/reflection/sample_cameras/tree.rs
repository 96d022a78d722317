//! A binary tree of planes over reflected rays (Popescu, Sacks and Mei 2006): a leaf has a pinhole for the rays that pass
//! its part of space, or the rays themselves where no plane parts them. Plain data in and out: no GPU.
//!
//! What is parted are the gaps between four rays (the paper's unit frustums). A gap goes to both sides of a plane that
//! it crosses, so every point of a gap reaches a leaf that has it.

use std::sync::atomic::{AtomicBool, Ordering};

use cloud::Bounds;
use glam::{DVec2, DVec3};

use super::pinhole::{Pinhole, mean_direction};
use crate::layout::{CAMERA_LEAF, CAMERA_LIST, CAMERA_OPEN, CameraLeaf, CameraNode, CameraRay};

/// The most planes above a leaf.
const DEEPEST: u32 = 40;
/// The most copies of a gap, on average over any part of the tree.
const MOST_COPIES: f64 = 128.0;
/// Rays of neighbouring pixels whose mirror points are farther apart than so many times the median belong to different
/// surfaces.
const DEPTH_STEP: f64 = 4.0;
/// Rays that go along the axis of a pinhole or a list by less than this are not projected by it: `LEAST_ALONG` of
/// shaders/shared/bundle.wgsl.
pub const LEAST_ALONG: f64 = 0.15;
/// The most parts of a list: six directions are enough for any rays, were they chosen well. Shaders know it.
const MOST_PARTS: usize = 8;
/// Planes reach this share of the rays' extent to both sides, because the shader rounds.
const THICKNESS: f64 = 1e-5;

/// A reflected ray, relative to the eye.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub tail: DVec3,
    pub direction: DVec3,
    /// The camera's line of sight, mirrored where the ray is: a picture across it is, for flat mirrors, that of the camera.
    pub sight: DVec3,
    /// The distance at which it leaves the scene.
    pub reach: f64,
    /// The middle of its pixel.
    pub at: DVec2,
    /// The number of its mirror.
    pub mirror: usize,
}

impl Ray {
    pub fn head(&self) -> DVec3 {
        self.tail + self.direction * self.reach
    }
}

/// The rays of every few pixels, row by row.
pub struct RayMap {
    pub columns: usize,
    pub rays: Vec<Option<Ray>>,
}

impl RayMap {
    /// `scene` is the box about all points relative to the eye, `mirror_of` numbers the mirror of a place, and `forward` is
    /// the line of sight of an eye at the origin, if the rays come from there.
    pub fn new(
        columns: usize,
        given: &[CameraRay],
        scene: Bounds,
        forward: Option<DVec3>,
        mirror_of: impl Fn(DVec3) -> usize,
    ) -> Self {
        let tails = given.iter().filter(|ray| is_ray(ray)).map(|ray| ray.point.truncate().as_dvec3());
        // Mirrors may stand outside of the points' box: rays then go through it.
        let scene = tails.fold(scene, |all, tail| Bounds { min: all.min.min(tail), max: all.max.max(tail) });
        let ray = |ray: &CameraRay| {
            let tail = ray.point.truncate().as_dvec3();
            let direction = ray.direction.truncate().as_dvec3().normalize_or_zero();
            let side = DVec3::select(direction.cmpgt(DVec3::ZERO), scene.max, scene.min);
            let reach = ((side - tail) / direction).min_element().max(1e-3 * scene.radius());
            let at = DVec2::new(ray.point.w.into(), ray.direction.w.into());
            let normal = (direction - tail.normalize_or_zero()).normalize_or_zero();
            let sight = forward.map_or(direction, |forward| forward - 2.0 * forward.dot(normal) * normal);
            is_ray(ray).then(|| Ray { tail, direction, sight, reach, at, mirror: mirror_of(tail) })
        };
        Self { columns, rays: given.iter().map(ray).map(|ray| ray.filter(|ray| ray.reach.is_finite())).collect() }
    }

    /// The numbers of the four rays of the gap right below a ray.
    pub fn corners(&self, gap: usize) -> [usize; 4] {
        [gap, gap + 1, gap + self.columns, gap + self.columns + 1]
    }

    /// The gaps of each mirror: between four rays of it, none of them across a step of depth. Each is numbered as its
    /// first ray.
    pub fn gaps(&self) -> Vec<Vec<u32>> {
        let mut of_mirrors: Vec<Vec<(u32, f64)>> = Vec::new();
        for gap in 0..self.rays.len() {
            if (gap + 1) % self.columns == 0 || gap + self.columns + 1 >= self.rays.len() {
                continue;
            }
            let [Some(a), Some(b), Some(c), Some(d)] = self.corners(gap).map(|ray| self.rays[ray]) else { continue };
            if [b, c, d].iter().any(|ray| ray.mirror != a.mirror) {
                continue;
            }
            let edges = [(a, b), (a, c), (b, d), (c, d)].map(|(one, other)| one.tail.distance(other.tail));
            if of_mirrors.len() <= a.mirror {
                of_mirrors.resize(a.mirror + 1, Vec::new());
            }
            of_mirrors[a.mirror].push((gap as u32, edges.into_iter().fold(0.0, f64::max)));
        }
        let whole = |gaps: Vec<(u32, f64)>| {
            let mut edges: Vec<f64> = gaps.iter().map(|(_, edge)| *edge).collect();
            let middle = edges.len() / 2;
            let median = if edges.is_empty() { 0.0 } else { *edges.select_nth_unstable_by(middle, f64::total_cmp).1 };
            gaps.into_iter().filter(|(_, edge)| *edge <= DEPTH_STEP * median).map(|(gap, _)| gap).collect()
        };
        of_mirrors.into_iter().map(whole).collect()
    }
}

fn is_ray(ray: &CameraRay) -> bool {
    ray.direction.truncate() != glam::Vec3::ZERO && ray.point.is_finite() && ray.direction.is_finite()
}

/// How a tree is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Pixels.
    pub accuracy: f64,
    /// Points nearer to the mirror than this do not count in an error.
    pub near: f64,
    pub split_gain: f64,
    pub longest_list: usize,
}

/// What projects the points of a part of space.
#[derive(Debug)]
pub enum Leaf {
    Pinhole(Box<Pinhole>),
    /// Gaps, each in the plane across the axis of its part: rays of a list may go everywhere.
    List {
        middle: DVec3,
        parts: Vec<(DVec3, Vec<u32>)>,
    },
    /// Nothing.
    Open,
}

pub enum Node {
    Leaf { leaf: Leaf, left: Vec<u32>, rays: usize },
    Plane { normal: DVec3, offset: f64, sides: Box<[Node; 2]> },
}

/// The trees of all mirrors, as a shader reads them, and what there is to say of them.
#[derive(Debug, Default)]
pub struct Trees {
    pub count: usize,
    pub nodes: Vec<CameraNode>,
    pub leaves: Vec<CameraLeaf>,
    pub gaps: Vec<[u32; 4]>,
    /// A bit for each ray: whether leaves stand for the gap of its number.
    pub standing: Vec<u32>,
    pub pinholes: usize,
    pub lists: usize,
    /// Rays in all leaves together, and in the trees.
    pub copies: usize,
    pub rays: usize,
}

/// Makes a tree of each mirror's rays; `None` once `is_cancelled` is set.
pub fn plant(map: &RayMap, rules: &Rules, is_cancelled: &AtomicBool) -> Option<Trees> {
    let builder = Builder { map, rules, is_cancelled };
    let mut trees = Trees { standing: vec![0; map.rays.len().div_ceil(32)], ..Trees::default() };
    let mirrors: Vec<Vec<u32>> = map.gaps().into_iter().filter(|gaps| !gaps.is_empty()).collect();
    trees.count = mirrors.len();
    trees.nodes.resize(mirrors.len(), CameraNode::default());
    for (number, gaps) in mirrors.into_iter().enumerate() {
        trees.rays += builder.rays_of(&gaps).len();
        gaps.iter().for_each(|gap| trees.standing[*gap as usize / 32] |= 1 << (gap % 32));
        let root = builder.node(gaps, 1.0, 0)?;
        let root = trees.add(root, map);
        (trees.nodes[number].above, trees.nodes[number].below) = (root, root);
    }
    (!is_cancelled.load(Ordering::Relaxed)).then_some(trees)
}

impl Trees {
    /// Adds a node with all below it, which are no deeper than `DEEPEST`. Returns its number, or that of a leaf.
    fn add(&mut self, node: Node, map: &RayMap) -> u32 {
        match node {
            Node::Plane { normal, offset, sides } => {
                let number = self.nodes.len();
                self.nodes.push(CameraNode::default());
                let [above, below] = sides.map(|side| self.add(side, map));
                let plane = normal.as_vec3().extend(offset as f32);
                self.nodes[number] = CameraNode { plane, above, below, ..CameraNode::default() };
                number as u32
            }
            Node::Leaf { leaf, left, rays } => {
                self.copies += rays;
                for gap in left {
                    self.standing[gap as usize / 32] &= !(1 << (gap % 32));
                }
                let number = self.leaves.len() as u32;
                match leaf {
                    Leaf::Open => self.leaves.push(CameraLeaf { kind: CAMERA_OPEN, ..CameraLeaf::default() }),
                    Leaf::Pinhole(pinhole) => {
                        self.pinholes += 1;
                        self.leaves.push(pinhole.to_gpu());
                    }
                    Leaf::List { middle, parts } => {
                        self.lists += 1;
                        let last = number as usize + parts.len() - 1;
                        for (axis, gaps) in parts {
                            let at = self.leaves.len();
                            self.leaves.push(CameraLeaf {
                                kind: CAMERA_LIST,
                                first: self.gaps.len() as u32,
                                count: gaps.len() as u32,
                                next: if at < last { at as u32 + 1 } else { 0 },
                                middle: middle.as_vec3().extend(0.0),
                                axis: axis.as_vec3().extend(0.0),
                                ..CameraLeaf::default()
                            });
                            let corners = |gap: &u32| map.corners(*gap as usize).map(|ray| ray as u32);
                            self.gaps.extend(gaps.iter().map(corners));
                        }
                    }
                }
                CAMERA_LEAF | number
            }
        }
    }
}

pub struct Builder<'a> {
    pub map: &'a RayMap,
    pub rules: &'a Rules,
    pub is_cancelled: &'a AtomicBool,
}

impl Builder<'_> {
    /// The rays of gaps, each once, in order.
    fn rays_of(&self, gaps: &[u32]) -> Vec<Ray> {
        let mut numbers: Vec<usize> = gaps.iter().flat_map(|gap| self.map.corners(*gap as usize)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers.into_iter().filter_map(|number| self.map.rays[number]).collect()
    }

    /// The node for these gaps, of which each has so many copies by now; `None` once cancelled.
    pub fn node(&self, gaps: Vec<u32>, copies: f64, depth: u32) -> Option<Node> {
        /// Below so many gaps both sides are made by one thread.
        const WORTH_A_THREAD: usize = 256;
        if self.is_cancelled.load(Ordering::Relaxed) {
            return None;
        }
        let rays = self.rays_of(&gaps);
        let count = rays.len();
        if let Some(pinhole) = Pinhole::fit(&rays, self.rules.near)
            && pinhole.error <= self.rules.accuracy
        {
            return Some(Node::Leaf { leaf: Leaf::Pinhole(Box::new(pinhole)), left: Vec::new(), rays: count });
        }
        let axis = mean_direction(&rays, |ray| ray.direction);
        let middle = rays.iter().map(|ray| ray.tail).sum::<DVec3>() / count.max(1) as f64;
        let normal = axis.and_then(|axis| plane_along(&rays, middle, axis)).filter(|_| depth < DEEPEST);
        drop(rays);
        if let Some(normal) = normal {
            let [above, below] = self.sides(&gaps, normal, middle);
            let copies = copies * (above.len() + below.len()) as f64 / gaps.len() as f64;
            let is_worth_it = above.len().max(below.len()) < gaps.len()
                && above.len().max(below.len()) as f64 <= self.rules.split_gain * gaps.len() as f64;
            if is_worth_it && copies <= MOST_COPIES {
                let is_large = gaps.len() > WORTH_A_THREAD;
                drop(gaps);
                let make = |gaps| self.node(gaps, copies, depth + 1);
                let (above, below) =
                    if is_large { rayon::join(|| make(above), || make(below)) } else { (make(above), make(below)) };
                let sides = Box::new([above?, below?]);
                return Some(Node::Plane { normal, offset: middle.dot(normal), sides });
            }
        }
        Some(self.list(gaps, count, middle))
    }

    /// A leaf with the rays themselves, in parts that each go along one direction; what is left then goes along none, or
    /// everything if there are too many gaps.
    fn list(&self, gaps: Vec<u32>, rays: usize, middle: DVec3) -> Node {
        let mut left = gaps;
        let mut parts = Vec::new();
        while left.len() <= self.rules.longest_list && !left.is_empty() && parts.len() < MOST_PARTS {
            let of_left = self.rays_of(&left);
            let mean = mean_direction(&of_left, |ray| ray.direction);
            // Where rays go to all sides, none may go along their mean.
            let tried = mean.into_iter().chain(of_left.first().map(|ray| ray.direction));
            let part = tried.map(|axis| (axis, self.along(&left, axis))).find(|(_, [listed, _])| !listed.is_empty());
            let Some((axis, [listed, rest])) = part else { break };
            parts.push((axis, listed));
            left = rest;
        }
        let leaf = if parts.is_empty() { Leaf::Open } else { Leaf::List { middle, parts } };
        Node::Leaf { leaf, left, rays }
    }

    /// The gaps all of whose rays go along an axis, and the others.
    fn along(&self, gaps: &[u32], axis: DVec3) -> [Vec<u32>; 2] {
        let goes_along = |ray: usize| self.map.rays[ray].is_some_and(|ray| ray.direction.dot(axis) >= LEAST_ALONG);
        let (listed, rest) =
            gaps.iter().copied().partition(|gap| self.map.corners(*gap as usize).into_iter().all(goes_along));
        [listed, rest]
    }

    /// The gaps before and behind a plane.
    fn sides(&self, gaps: &[u32], normal: DVec3, middle: DVec3) -> [Vec<u32>; 2] {
        let mut sides = [Vec::new(), Vec::new()];
        for gap in gaps {
            let corners = self.map.corners(*gap as usize).map(|ray| self.map.rays[ray]);
            let ends = corners.into_iter().flatten().flat_map(|ray| [ray.tail, ray.head()]);
            let (mut low, mut high, mut reach) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
            for end in ends {
                let beyond = (end - middle).dot(normal);
                (low, high, reach) = (low.min(beyond), high.max(beyond), reach.max((end - middle).abs().max_element()));
            }
            if high > -THICKNESS * reach {
                sides[0].push(*gap);
            }
            if low < THICKNESS * reach {
                sides[1].push(*gap);
            }
        }
        sides
    }
}

/// The normal of the plane through the middle of the tails, along the mean direction, and across the tails' diameter;
/// `None` if they lie along that direction.
fn plane_along(rays: &[Ray], middle: DVec3, axis: DVec3) -> Option<DVec3> {
    let farthest = |from: DVec3| {
        let away = |ray: &&Ray| ray.tail.distance_squared(from);
        rays.iter().max_by(|a, b| away(a).total_cmp(&away(b))).map(|ray| ray.tail)
    };
    // The farthest of the farthest: nearly the diameter.
    let first = farthest(middle)?;
    let second = farthest(first)?;
    let first = farthest(second)?;
    let across = (second - first).reject_from_normalized(axis);
    (across.length() > 1e-9 * (1.0 + middle.length())).then(|| across.normalize())
}
