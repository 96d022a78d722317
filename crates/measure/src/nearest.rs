//! The points nearest to a place, gathered from points that come one after the other.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use cloud::Bounds;
use glam::DVec3;

/// The nearest points to a place so far.
#[derive(Clone, Debug)]
pub struct Nearest {
    place: DVec3,
    most: usize,
    /// The farthest of them is on top.
    found: BinaryHeap<Near>,
}

/// Equal distances are told apart by position, so that the order in which points come does not matter.
#[derive(Clone, Copy, Debug)]
struct Near {
    squared: f64,
    point: DVec3,
}

impl Near {
    fn key(&self) -> [f64; 4] {
        [self.squared, self.point.x, self.point.y, self.point.z]
    }
}

impl Ord for Near {
    fn cmp(&self, other: &Self) -> Ordering {
        let pairs = self.key().into_iter().zip(other.key());
        pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    }
}

impl PartialOrd for Near {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Near {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Near {}

impl Nearest {
    /// Gathers `most` points.
    pub fn new(place: DVec3, most: usize) -> Self {
        Self { place, most, found: BinaryHeap::new() }
    }

    /// Whether a point within the bounds could be nearer than those found so far.
    pub fn wants(&self, bounds: Bounds) -> bool {
        let nearest = self.place.clamp(bounds.min.min(bounds.max), bounds.max);
        !bounds.is_empty() && self.place.distance_squared(nearest) <= self.limit()
    }

    /// The squared distance beyond which points do not count.
    pub(crate) fn limit(&self) -> f64 {
        if self.found.len() < self.most { f64::INFINITY } else { self.found.peek().map_or(-1.0, |last| last.squared) }
    }

    /// Takes a point into account; one that is not finite is left out.
    pub fn add(&mut self, point: DVec3) {
        let squared = self.place.distance_squared(point);
        // NaN fails the comparison.
        if squared.is_finite() && squared <= self.limit() {
            self.found.push(Near { squared, point });
            if self.found.len() > self.most {
                self.found.pop();
            }
        }
    }

    pub fn place(&self) -> DVec3 {
        self.place
    }

    /// The points, the nearest first.
    pub fn points(&self) -> Vec<DVec3> {
        let mut found = self.found.clone().into_vec();
        found.sort();
        found.into_iter().map(|near| near.point).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Dice;

    #[test]
    fn the_nearest_points_are_those_of_a_full_sort_in_any_order() {
        let mut dice = Dice::new(11);
        // On a lattice many distances are equal.
        let mut points: Vec<DVec3> =
            (0..1000).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100))).collect();
        points.push(DVec3::NAN);
        let place = DVec3::new(4.2, 5.0, 5.0);
        let of = |points: &[DVec3]| {
            let mut nearest = Nearest::new(place, 20);
            points.iter().for_each(|point| nearest.add(*point));
            nearest.points()
        };
        let found = of(&points);
        let mut sorted: Vec<f64> = points[..1000].iter().map(|point| point.distance_squared(place)).collect();
        sorted.sort_by(f64::total_cmp);
        assert_eq!(found.iter().map(|point| point.distance_squared(place)).collect::<Vec<_>>(), sorted[..20]);
        for _ in 0..5 {
            points.sort_by_cached_key(|_| (dice.share() * 1e9) as u64);
            assert_eq!(of(&points), found);
        }
    }

    #[test]
    fn boxes_beyond_the_last_point_are_not_wanted() {
        let mut nearest = Nearest::new(DVec3::ZERO, 2);
        let far = Bounds { min: DVec3::splat(3.0), max: DVec3::splat(4.0) };
        assert!(nearest.wants(far) && !nearest.wants(Bounds::EMPTY));
        nearest.add(DVec3::X);
        assert!(nearest.wants(far));
        nearest.add(DVec3::Y * 2.0);
        assert!(!nearest.wants(far));
        assert!(nearest.wants(Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) }));
        assert!(nearest.wants(Bounds { min: DVec3::X * 2.0, max: DVec3::X * 9.0 }));
    }
}
