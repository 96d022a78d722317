//! What mirrors throw from lamps and the sun onto surfaces: photons where they have landed.
//!
//! The irradiance at a place is the power of the photons within a radius about it, over the area of a disc of that
//! radius (Jensen 1996). Photons count if they landed on a surface that faces the same way within 60 degrees, so light
//! passes neither through a wall nor around a corner. The estimate is blurred over the disc, and too low within a radius
//! of a surface's edge, where part of the disc has no surface; both vanish with the radius.

use std::collections::HashMap;
use std::ops::Range;

use glam::{DVec3, Vec3};

use crate::Hit;

/// The least cosine between the normals of a place and of where a photon landed that counts there.
const SAME_SIDE: f32 = 0.5;

/// A photon where it has landed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Photon {
    pub position: DVec3,
    /// The direction in which it arrived, a unit vector.
    pub direction: Vec3,
    /// The unit normal of the surface, on the side where it arrived.
    pub normal: Vec3,
    /// The power: irradiance times area.
    pub power: Vec3,
}

/// The photons of a scene's caustics.
#[derive(Clone, Debug)]
pub struct Caustics {
    radius: f64,
    /// Cell by cell, in the order in which they were traced.
    photons: Vec<Photon>,
    /// The photons of each cell, whose edges are two radii long.
    cells: HashMap<[i64; 3], Range<usize>>,
}

impl Caustics {
    pub(crate) fn new(mut photons: Vec<Photon>, radius: f64) -> Self {
        let cell = |photon: &Photon| cell_at(photon.position, radius);
        photons.sort_by_cached_key(cell);
        let mut first = 0;
        let mut cells = HashMap::new();
        for run in photons.chunk_by(|one, other| cell(one) == cell(other)) {
            cells.insert(cell(&run[0]), first..first + run.len());
            first += run.len();
        }
        Self { radius, photons, cells }
    }

    /// The sum over what arrives at a hit: `sent` says what the surface sends on of a unit of irradiance from a
    /// direction, a unit vector away from the surface.
    pub(crate) fn sum(&self, hit: &Hit, sent: impl Fn(DVec3) -> DVec3) -> DVec3 {
        let normal = hit.normal.as_vec3();
        let [low, high] = [-self.radius, self.radius].map(|step| cell_at(hit.position + step, self.radius));
        let mut sum = DVec3::ZERO;
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let range = self.cells.get(&[x, y, z]).cloned().unwrap_or_default();
                    let counts = |photon: &&Photon| {
                        photon.normal.dot(normal) > SAME_SIDE
                            && photon.position.distance_squared(hit.position) <= self.radius * self.radius
                    };
                    for photon in self.photons[range].iter().filter(counts) {
                        sum += photon.power.as_dvec3() * sent(-photon.direction.as_dvec3());
                    }
                }
            }
        }
        sum / (std::f64::consts::PI * self.radius * self.radius)
    }
}

fn cell_at(position: DVec3, radius: f64) -> [i64; 3] {
    (position / (2.0 * radius)).floor().to_array().map(|edge| edge as i64)
}
