//! The planes that small patches lie in, largest first.

use cloud::{hash, smallest_eigenvector};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::surface_map::Patch;

/// A plane: the places p with `normal` . p = `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A unit vector.
    pub normal: DVec3,
    pub offset: f64,
}

impl Plane {
    pub fn height(&self, place: DVec3) -> f64 {
        self.normal.dot(place) - self.offset
    }

    pub fn mirrored(&self, place: DVec3) -> DVec3 {
        place - self.normal * (2.0 * self.height(place))
    }

    /// The plane with its normal to the side of a place.
    pub fn facing(self, place: DVec3) -> Self {
        if self.height(place) < 0.0 { Self { normal: -self.normal, offset: -self.offset } } else { self }
    }

    /// The planes that make each of two planes the mirror image of the other.
    pub fn bisectors(&self, other: &Self) -> impl Iterator<Item = Self> {
        [1.0, -1.0].into_iter().filter_map(|sign| {
            let normal = self.normal + other.normal * sign;
            let length = normal.length();
            let plane = Self { normal: normal / length, offset: (self.offset + other.offset * sign) / length };
            (length > 1e-3).then_some(plane)
        })
    }
}

/// The most planes that are looked for.
const MOST_PLANES: usize = 40;
/// The patches from which the largest of the next planes is looked for.
const SEEDS: usize = 48;
/// The fewest patches of a plane, and the share of all that they are at least.
const FEWEST_PATCHES: usize = 12;
const LEAST_SHARE: f64 = 0.001;
/// The cosine of the angle between the normals of a plane and of its patches.
const ALIGNED: f64 = 0.995;
/// How far a patch is from its plane at most, in edges of its cell.
const THICK: f64 = 0.2;

pub fn planes(patches: &[Patch]) -> Vec<Plane> {
    let fewest = FEWEST_PATCHES.max((patches.len() as f64 * LEAST_SHARE) as usize);
    let (mut rest, mut found) = (patches.to_vec(), Vec::new());
    while found.len() < MOST_PLANES && rest.len() >= fewest {
        let seeds: Vec<usize> = (0..SEEDS as u64).map(|seed| (hash(seed) % rest.len() as u64) as usize).collect();
        let of = |patch: &Patch| Plane {
            normal: patch.normal.as_dvec3(),
            offset: patch.normal.as_dvec3().dot(patch.center),
        };
        let count = |seed: &usize| {
            let plane = of(&rest[*seed]);
            rest.iter().filter(|patch| is_of(patch, &plane)).count()
        };
        let counts: Vec<usize> = seeds.par_iter().map(count).collect();
        let Some(best) = (0..seeds.len()).max_by_key(|index| (counts[*index], usize::MAX - index)) else { break };
        if counts[best] < fewest {
            break;
        }
        let mut plane = of(&rest[seeds[best]]);
        for _ in 0..3 {
            let own: Vec<DVec3> = rest.iter().filter(|patch| is_of(patch, &plane)).map(|patch| patch.center).collect();
            plane = fitted(&own).unwrap_or(plane);
        }
        let before = rest.len();
        rest.retain(|patch| !is_of(patch, &plane));
        if before - rest.len() < fewest {
            rest.remove(seeds[best].min(rest.len() - 1));
            continue;
        }
        found.push(plane);
    }
    found
}

fn is_of(patch: &Patch, plane: &Plane) -> bool {
    patch.normal.as_dvec3().dot(plane.normal).abs() > ALIGNED
        && plane.height(patch.center).abs() < THICK * f64::from(patch.edge)
}

fn fitted(places: &[DVec3]) -> Option<Plane> {
    let mean = places.iter().sum::<DVec3>() / places.len() as f64;
    let outer = |place: &DVec3| {
        let off = *place - mean;
        DMat3::from_cols(off * off.x, off * off.y, off * off.z)
    };
    let normal = smallest_eigenvector(places.iter().map(outer).fold(DMat3::ZERO, |sum, own| sum + own))?;
    Some(Plane { normal, offset: normal.dot(mean) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bisector_makes_each_plane_the_mirror_image_of_the_other() {
        let plane = |normal: DVec3, offset| Plane { normal: normal.normalize(), offset };
        for other in [plane(DVec3::new(0.2, 1.0, 0.1), 7.0), plane(DVec3::NEG_Y, 3.0), plane(DVec3::Y, 4.0)] {
            let own = plane(DVec3::Y, -1.0);
            let mut count = 0;
            for bisector in own.bisectors(&other) {
                count += 1;
                for place in [DVec3::ZERO, DVec3::new(3.0, 0.0, 1.0), DVec3::new(-2.0, 0.0, 4.0)] {
                    let on = place - own.normal * own.height(place);
                    assert!(other.height(bisector.mirrored(on)).abs() < 1e-9, "{other:?} {bisector:?}");
                }
            }
            assert!(count > 0);
        }
    }
}
