//! A k-d tree over points, for searches about any place.

use cloud::Bounds;
use glam::{DVec3, Vec3};

use crate::nearest::Nearest;

/// The most points of a leaf. Fewer cost more planes, more cost more distances.
const LEAF_POINTS: usize = 12;
/// A part of the tree with fewer points is built by one thread.
const ALONE: usize = 1 << 14;

/// Points in an order in which each plane of the tree divides its part in halves.
#[derive(Clone, Debug, Default)]
pub struct PointTree {
    points: Vec<DVec3>,
    /// The node of each part, followed by those of its lower and of its upper half.
    nodes: Vec<Node>,
    bounds: Option<Bounds>,
}

/// The plane that divides a part, and the box about the part's points, relative to the least corner of all points and
/// rounded outward.
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    at: f64,
    axis: u32,
    least: Vec3,
    most: Vec3,
}

/// A part of the tree: its points and its nodes.
#[derive(Clone, Copy)]
struct Part<'a> {
    points: &'a [DVec3],
    nodes: &'a [Node],
}

impl<'a> Part<'a> {
    /// The node and the two halves; `None` for a leaf.
    #[inline]
    fn halves(self) -> Option<(&'a Node, Self, Self)> {
        let (node, nodes) = self.nodes.split_first()?;
        let (lower, upper) = self.points.split_at(self.points.len() / 2);
        let (of_lower, of_upper) = nodes.split_at(nodes.len() / 2);
        Some((node, Self { points: lower, nodes: of_lower }, Self { points: upper, nodes: of_upper }))
    }
}

impl PointTree {
    /// Points that are not finite are left out.
    pub fn new(mut points: Vec<DVec3>) -> Self {
        points.retain(|point| point.is_finite());
        let leaves = points.len().div_ceil(LEAF_POINTS).next_power_of_two();
        let mut nodes = vec![Node::default(); leaves - 1];
        let bounds = bounds_of(&points);
        divide(&mut points, &mut nodes, bounds.min);
        Self { points, nodes, bounds: (!bounds.is_empty()).then_some(bounds) }
    }

    pub fn len(&self) -> usize {
        self.points.len()
    }

    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The points in the order of the tree: neighbours in space are mostly near one another.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// The box about all points, empty without points.
    pub fn bounds(&self) -> Bounds {
        self.bounds.unwrap_or(Bounds::EMPTY)
    }

    fn whole(&self) -> Part<'_> {
        Part { points: &self.points, nodes: &self.nodes }
    }

    /// The distance to the nearest point; `None` without points, or for a place that is not finite.
    pub fn distance(&self, place: DVec3) -> Option<f64> {
        self.nearest(place, -1.0)
    }

    /// The distance to the nearest point at another place.
    pub fn distance_to_other(&self, place: DVec3) -> Option<f64> {
        self.nearest(place, 0.0)
    }

    /// The distance to the nearest of the points whose squared distance is above `least`.
    fn nearest(&self, place: DVec3, least: f64) -> Option<f64> {
        let mut best = f64::INFINITY;
        let outside = outside_of(self.bounds?, place);
        if place.is_finite() {
            search(self.whole(), place, outside, least, &mut best);
        }
        best.is_finite().then(|| best.sqrt())
    }

    /// The `most` points nearest to a place, the nearest first.
    pub fn nearest_points(&self, place: DVec3, most: usize) -> Vec<DVec3> {
        let mut nearest = Nearest::new(place, most);
        if let Some(bounds) = self.bounds.filter(|_| place.is_finite()) {
            gather_nearest(self.whole(), outside_of(bounds, place), &mut nearest);
        }
        nearest.points()
    }

    /// Calls `visit` with points, a few at a time, among which are all that are within `radius` of a box.
    pub fn near_box(&self, place: Bounds, radius: f64, visit: &mut impl FnMut(&[DVec3])) {
        if let Some(bounds) = self.bounds.filter(|_| !place.is_empty()) {
            let (least, most) = (place.min - bounds.min, place.max - bounds.min);
            let is_near = |node: &Node| {
                let outside = (node.least.as_dvec3() - most).max(least - node.most.as_dvec3()).max(DVec3::ZERO);
                outside.length_squared() <= radius * radius
            };
            gather(self.whole(), &is_near, visit);
        }
    }

    /// Calls `visit` with points, a few at a time, among which are all that are in a cylinder.
    pub fn near_cylinder(&self, cylinder: &Cylinder, visit: &mut impl FnMut(&[DVec3])) {
        if let Some(bounds) = self.bounds.filter(|_| cylinder.place.is_finite()) {
            let Cylinder { place, axis, radius, reach } = *cylinder;
            let corner = bounds.min - place;
            let (sides, across) = (axis.abs(), (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt));
            let size = sides * reach + across * radius;
            // No plane across one of these directions lies between the cylinder and the box of a node: the sides of the
            // box, the axis, and the way from the axis to the middle of the box.
            let may_touch = |node: &Node| {
                let (least, most) = (node.least.as_dvec3(), node.most.as_dvec3());
                let (half, offset) = ((most - least) * 0.5, corner + (most + least) * 0.5);
                if offset.abs().cmpgt(half + size).any() {
                    return false;
                }
                let along = offset.dot(axis);
                let across = offset - axis * along;
                along.abs() <= reach + half.dot(sides)
                    && across.length_squared() <= radius * across.length() + half.dot(across.abs())
            };
            gather(self.whole(), &may_touch, visit);
        }
    }
}

/// A cylinder about `place` that reaches `reach` along `axis`, a unit vector, to both sides.
#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    pub place: DVec3,
    pub axis: DVec3,
    pub radius: f64,
    pub reach: f64,
}

fn bounds_of(points: &[DVec3]) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    points.iter().for_each(|point| bounds.include(*point));
    bounds
}

/// How far a place is outside of bounds along each axis.
fn outside_of(bounds: Bounds, place: DVec3) -> DVec3 {
    (bounds.min - place).max(place - bounds.max).max(DVec3::ZERO)
}

fn divide(points: &mut [DVec3], nodes: &mut [Node], corner: DVec3) {
    let Some((node, nodes)) = nodes.split_first_mut() else { return };
    let middle = points.len() / 2;
    let bounds = bounds_of(points);
    let axis = bounds.size().max_position();
    if middle < points.len() {
        let at = points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis];
        let (least, most) = ((bounds.min - corner).as_vec3(), (bounds.max - corner).as_vec3());
        *node = Node { at, axis: axis as u32, least: least.map(f32::next_down), most: most.map(f32::next_up) };
    }
    let is_large = points.len() > ALONE;
    let (lower, upper) = points.split_at_mut(middle);
    let (of_lower, of_upper) = nodes.split_at_mut(nodes.len() / 2);
    if is_large {
        rayon::join(|| divide(lower, of_lower, corner), || divide(upper, of_upper, corner));
    } else {
        divide(lower, of_lower, corner);
        divide(upper, of_upper, corner);
    }
}

/// `outside` is how far the place is outside of the part along each axis.
fn gather_nearest(part: Part<'_>, outside: DVec3, nearest: &mut Nearest) {
    let Some((node, lower, upper)) = part.halves() else {
        part.points.iter().for_each(|point| nearest.add(*point));
        return;
    };
    let axis = node.axis as usize;
    let beyond = nearest.place()[axis] - node.at;
    let (near, far) = if beyond < 0.0 { (lower, upper) } else { (upper, lower) };
    gather_nearest(near, outside, nearest);
    let mut outside = outside;
    outside[axis] = beyond.abs();
    if outside.length_squared() <= nearest.limit() {
        gather_nearest(far, outside, nearest);
    }
}

/// `outside` is how far the place is outside of the part along each axis.
fn search(part: Part<'_>, place: DVec3, outside: DVec3, least: f64, best: &mut f64) {
    let Some((node, lower, upper)) = part.halves() else {
        for point in part.points {
            let squared = point.distance_squared(place);
            if squared < *best && squared > least {
                *best = squared;
            }
        }
        return;
    };
    let axis = node.axis as usize;
    let beyond = place[axis] - node.at;
    let (near, far) = if beyond < 0.0 { (lower, upper) } else { (upper, lower) };
    search(near, place, outside, least, best);
    let mut outside = outside;
    outside[axis] = beyond.abs();
    if outside.length_squared() < *best {
        search(far, place, outside, least, best);
    }
}

/// Visits the points of all leaves whose nodes above them are wanted.
fn gather(part: Part<'_>, is_wanted: &impl Fn(&Node) -> bool, visit: &mut impl FnMut(&[DVec3])) {
    match part.halves() {
        None => visit(part.points),
        Some((node, lower, upper)) if is_wanted(node) => {
            gather(lower, is_wanted, visit);
            gather(upper, is_wanted, visit);
        }
        Some(_) => {}
    }
}

impl Cylinder {
    /// The height above its place of a point in it.
    #[inline]
    pub fn height_of(&self, point: DVec3) -> Option<f64> {
        let offset = point - self.place;
        let height = offset.dot(self.axis);
        let across = offset.length_squared() - height * height;
        (height.abs() <= self.reach && across <= self.radius * self.radius).then_some(height)
    }
}

#[cfg(test)]
mod tests {
    use cloud::Random;

    use super::*;

    fn scattered(count: usize, seed: u64) -> Vec<DVec3> {
        let mut random = Random(seed);
        let mut unit = || random.below(1 << 20) as f64 / f64::from(1 << 20);
        // Sheets, clumps and points that are there twice.
        let point = |index: usize| match index % 4 {
            0 => DVec3::new(unit() * 9.0, unit() * 3.0, 0.0),
            1 => DVec3::new(unit(), unit(), unit()) * 0.01 + 2.0,
            2 => DVec3::new((unit() * 8.0).floor(), (unit() * 8.0).floor(), 1.0),
            _ => DVec3::new(unit(), unit(), unit()) * 5.0,
        };
        (0..count).map(point).map(|point| point + DVec3::new(5e5, 5e6, 100.0)).collect()
    }

    #[test]
    fn searches_find_what_looking_at_all_points_finds() {
        for count in [1, 2, 11, 12, 13, 100, 5000] {
            let points = scattered(count, 3);
            let mut with_stray = points.clone();
            with_stray.insert(count / 2, DVec3::NAN);
            let tree = PointTree::new(with_stray);
            assert_eq!(tree.len(), count);
            for place in scattered(60, 4).into_iter().chain(points.iter().copied().take(20)).chain([DVec3::ZERO]) {
                let distances = || points.iter().map(|point| point.distance(place));
                let nearest = distances().fold(f64::INFINITY, f64::min);
                assert_eq!(tree.distance(place), Some(nearest));
                let other = distances().filter(|distance| *distance > 0.0).fold(f64::INFINITY, f64::min);
                assert_eq!(tree.distance_to_other(place), other.is_finite().then_some(other));
                let mut by_distance = points.clone();
                by_distance.sort_by(|a, b| a.distance_squared(place).total_cmp(&b.distance_squared(place)));
                let found = tree.nearest_points(place, 20).into_iter().map(|point| point.distance_squared(place));
                let expected = by_distance.iter().take(20).map(|point| point.distance_squared(place));
                assert!(found.eq(expected), "{count} points, {place}");
                for axis in [DVec3::new(0.36, 0.48, 0.8), DVec3::Y, DVec3::new(0.0, -0.6, 0.8)] {
                    let cylinder = Cylinder { place, axis, radius: 0.5, reach: 3.0 };
                    let is_in = |point: &&DVec3| cylinder.height_of(**point).is_some();
                    let mut found = 0;
                    tree.near_cylinder(&cylinder, &mut |near| found += near.iter().filter(is_in).count());
                    assert_eq!(found, points.iter().filter(is_in).count());
                }
                let block = Bounds { min: place, max: place + DVec3::new(0.5, 0.0, 2.0) };
                let is_near = |point: &&DVec3| point.distance(point.clamp(block.min, block.max)) <= 0.7;
                let mut found = 0;
                tree.near_box(block, 0.7, &mut |near| found += near.iter().filter(is_near).count());
                assert_eq!(found, points.iter().filter(is_near).count());
            }
            assert_eq!(tree.distance(DVec3::NAN), None);
        }
        assert_eq!(PointTree::new(Vec::new()).distance(DVec3::ZERO), None);
    }
}
