//! A k-d tree over points, for searches about any place.

use cloud::Bounds;
use glam::DVec3;

/// The most points of a leaf. Fewer cost more planes, more cost more distances.
const LEAF_POINTS: usize = 12;
/// A part of the tree with fewer points is built by one thread.
const ALONE: usize = 1 << 14;

/// Points in an order in which each plane of the tree divides its part in halves.
#[derive(Clone, Debug, Default)]
pub struct PointTree {
    points: Vec<DVec3>,
    /// The plane of each part, followed by those of its lower and of its upper half.
    planes: Vec<Plane>,
    bounds: Option<Bounds>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Plane {
    at: f64,
    axis: usize,
}

/// A part of the tree: its points and its planes.
#[derive(Clone, Copy)]
struct Part<'a> {
    points: &'a [DVec3],
    planes: &'a [Plane],
}

impl<'a> Part<'a> {
    /// The plane and the two halves; `None` for a leaf.
    fn halves(self) -> Option<(Plane, Self, Self)> {
        let (plane, planes) = self.planes.split_first()?;
        let (lower, upper) = self.points.split_at(self.points.len() / 2);
        let (of_lower, of_upper) = planes.split_at(planes.len() / 2);
        Some((*plane, Self { points: lower, planes: of_lower }, Self { points: upper, planes: of_upper }))
    }
}

impl PointTree {
    /// Points that are not finite are left out.
    pub fn new(mut points: Vec<DVec3>) -> Self {
        points.retain(|point| point.is_finite());
        let leaves = points.len().div_ceil(LEAF_POINTS).next_power_of_two();
        let mut planes = vec![Plane::default(); leaves - 1];
        let bounds = bounds_of(&points);
        divide(&mut points, &mut planes);
        Self { points, planes, bounds: (!bounds.is_empty()).then_some(bounds) }
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

    fn whole(&self) -> Part<'_> {
        Part { points: &self.points, planes: &self.planes }
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

    /// Calls `visit` with each point within `radius`, its border included.
    pub fn within(&self, place: DVec3, radius: f64, visit: &mut impl FnMut(DVec3)) {
        let Some(bounds) = self.bounds.filter(|_| place.is_finite()) else { return };
        gather(self.whole(), place, outside_of(bounds, place), radius * radius, visit);
    }

    /// Calls `visit` with the height above `place` of each point in a cylinder about `place` that reaches `reach` along
    /// `axis`, a unit vector, to both sides.
    pub fn in_cylinder(&self, place: DVec3, axis: DVec3, radius: f64, reach: f64, visit: &mut impl FnMut(f64)) {
        let Some(bounds) = self.bounds.filter(|_| place.is_finite()) else { return };
        let cylinder = Cylinder { place, axis, radius, reach };
        cylinder.gather(self.whole(), bounds, visit);
    }
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

fn divide(points: &mut [DVec3], planes: &mut [Plane]) {
    let Some((plane, planes)) = planes.split_first_mut() else { return };
    let middle = points.len() / 2;
    let axis = bounds_of(points).size().max_position();
    if middle < points.len() {
        let at = points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis];
        *plane = Plane { at, axis };
    }
    let is_large = points.len() > ALONE;
    let (lower, upper) = points.split_at_mut(middle);
    let (of_lower, of_upper) = planes.split_at_mut(planes.len() / 2);
    if is_large {
        rayon::join(|| divide(lower, of_lower), || divide(upper, of_upper));
    } else {
        divide(lower, of_lower);
        divide(upper, of_upper);
    }
}

/// `outside` is how far the place is outside of the part along each axis.
fn search(part: Part<'_>, place: DVec3, outside: DVec3, least: f64, best: &mut f64) {
    let Some((plane, lower, upper)) = part.halves() else {
        for point in part.points {
            let squared = point.distance_squared(place);
            if squared < *best && squared > least {
                *best = squared;
            }
        }
        return;
    };
    let beyond = place[plane.axis] - plane.at;
    let (near, far) = if beyond < 0.0 { (lower, upper) } else { (upper, lower) };
    search(near, place, outside, least, best);
    let mut outside = outside;
    outside[plane.axis] = beyond.abs();
    if outside.length_squared() < *best {
        search(far, place, outside, least, best);
    }
}

fn gather(part: Part<'_>, place: DVec3, outside: DVec3, squared: f64, visit: &mut impl FnMut(DVec3)) {
    if outside.length_squared() > squared {
        return;
    }
    let Some((plane, lower, upper)) = part.halves() else {
        return part
            .points
            .iter()
            .filter(|point| point.distance_squared(place) <= squared)
            .for_each(|point| visit(*point));
    };
    let beyond = place[plane.axis] - plane.at;
    let (near, far) = if beyond < 0.0 { (lower, upper) } else { (upper, lower) };
    gather(near, place, outside, squared, visit);
    let mut outside = outside;
    outside[plane.axis] = beyond.abs();
    gather(far, place, outside, squared, visit);
}

struct Cylinder {
    place: DVec3,
    axis: DVec3,
    radius: f64,
    reach: f64,
}

impl Cylinder {
    fn gather(&self, part: Part<'_>, bounds: Bounds, visit: &mut impl FnMut(f64)) {
        let offset = bounds.center() - self.place;
        let along = offset.dot(self.axis).clamp(-self.reach, self.reach);
        let most = self.radius + bounds.size().length() * 0.5;
        if (offset - self.axis * along).length_squared() > most * most {
            return;
        }
        let Some((Plane { at, axis }, lower, upper)) = part.halves() else {
            for point in part.points {
                let offset = *point - self.place;
                let height = offset.dot(self.axis);
                let across = offset.length_squared() - height * height;
                if height.abs() <= self.reach && across <= self.radius * self.radius {
                    visit(height);
                }
            }
            return;
        };
        let (mut of_lower, mut of_upper) = (bounds, bounds);
        of_lower.max[axis] = at;
        of_upper.min[axis] = at;
        self.gather(lower, of_lower, visit);
        self.gather(upper, of_upper, visit);
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
                let mut found = 0;
                tree.within(place, 1.5, &mut |point| {
                    assert!(point.distance(place) <= 1.5);
                    found += 1;
                });
                assert_eq!(found, points.iter().filter(|point| point.distance_squared(place) <= 2.25).count());
                let axis = DVec3::new(0.36, 0.48, 0.8);
                let is_in = |point: &&DVec3| {
                    let offset = **point - place;
                    let height = offset.dot(axis);
                    height.abs() <= 3.0 && offset.length_squared() - height * height <= 0.25
                };
                let mut heights = 0;
                tree.in_cylinder(place, axis, 0.5, 3.0, &mut |_| heights += 1);
                assert_eq!(heights, points.iter().filter(is_in).count());
            }
            assert_eq!(tree.distance(DVec3::NAN), None);
        }
        assert_eq!(PointTree::new(Vec::new()).distance(DVec3::ZERO), None);
    }
}
