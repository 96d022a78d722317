//! Photons in a grid of cells, as shading reads them (shaders/shared/thrown.wgsl, whose twin is `Grid::irradiance`).
//!
//! Photons whose distance is small beside the radius within which they are averaged are merged: so a place reads about as
//! many of them whatever their number, and bright spots are no longer loops than others.

use glam::{DVec3, UVec3, Vec3, Vec4};

use crate::layout::Landed;

/// The least cosine between the normals of a place and of where a photon has landed that counts there.
const SAME_SIDE: f32 = 0.5;
/// Photons of a cube of this share of the radius that have landed on the same side of it are merged.
const MERGED: f32 = 0.25;

/// The photons of a scene, merged.
pub(super) struct Grid {
    /// The lower corner of the cells, relative to the photons' origin.
    pub low: Vec3,
    /// The radius within which photons count, and the edge of a cell.
    radius: f32,
    size: UVec3,
    photons: Vec<Photon>,
    /// The number of photons before each cell, and of all.
    pub cells: Vec<u32>,
}

/// A photon, or several: relative to the lower corner of the grid.
#[derive(Clone, Copy)]
struct Photon {
    position: Vec3,
    normal: Vec3,
    power: Vec3,
}

impl Grid {
    /// Sorts photons by their cells, and merges them. A box of `extent` has all of their surfaces; photons beyond lie in
    /// the cells at its edge.
    pub fn new(low: Vec3, extent: Vec3, radius: f32, landed: &mut [Landed]) -> Self {
        let size = (extent / radius).ceil().max(Vec3::ONE).as_uvec3();
        let cell = |photon: &Landed| {
            let place = ((photon.position.truncate() - low) / radius).max(Vec3::ZERO);
            let cell = place.as_uvec3().min(size - 1);
            (cell.z * size.y + cell.y) * size.x + cell.x
        };
        let key = |photon: &Landed| {
            let part = (photon.position.truncate() - low) / (radius * MERGED);
            let normal = photon.normal.truncate();
            let axis = normal.abs().max_position();
            (cell(photon), part.floor().as_ivec3().to_array(), axis, normal[axis] > 0.0)
        };
        landed.sort_by_cached_key(key);
        let mut cells = vec![0; size.element_product() as usize + 1];
        let mut photons = Vec::new();
        for run in landed.chunk_by(|one, other| key(one) == key(other)) {
            photons.push(Photon::merged(run, low));
            cells[cell(&run[0]) as usize + 1] += 1;
        }
        for index in 1..cells.len() {
            cells[index] += cells[index - 1];
        }
        Self { low, radius, size, photons, cells }
    }

    /// The first elements of the photons' buffer; `low` is the lower corner relative to the eye.
    pub fn header(&self, low: Vec3) -> [Vec4; 2] {
        let [columns, rows, layers] = self.size.to_array().map(f32::from_bits);
        [low.extend(self.radius), Vec4::new(columns, rows, layers, 0.0)]
    }

    /// The other elements.
    pub fn vectors(&self) -> impl Iterator<Item = Vec4> {
        self.photons
            .iter()
            .flat_map(|photon| [photon.position, photon.normal, photon.power].map(|part| part.extend(0.0)))
    }

    /// The irradiance at a place relative to the photons' origin.
    pub fn irradiance(&self, position: Vec3, normal: Vec3) -> Vec3 {
        let place = position - self.low;
        let last = self.size.as_ivec3() - 1;
        let cell = (place / self.radius).floor().clamp(Vec3::splat(-2.0), last.as_vec3() + 2.0).as_ivec3();
        let [low, high] = [-1, 1].map(|step| (cell + step).clamp(glam::IVec3::ZERO, last));
        let squared = self.radius * self.radius;
        let mut sum = Vec3::ZERO;
        for (z, y) in (low.z..=high.z).flat_map(|z| (low.y..=high.y).map(move |y| (z, y))) {
            let row = (z * self.size.y as i32 + y) * self.size.x as i32;
            let [first, end] = [row + low.x, row + high.x + 1].map(|cell| self.cells[cell as usize] as usize);
            for photon in &self.photons[first..end] {
                let weight = 1.0 - photon.position.distance_squared(place) / squared;
                if weight > 0.0 && photon.normal.dot(normal) > SAME_SIDE {
                    sum += photon.power * weight;
                }
            }
        }
        sum * (2.0 / (std::f32::consts::PI * squared))
    }
}

impl Photon {
    /// All power of photons that lie close together, at the mean of their places by their power.
    fn merged(run: &[Landed], low: Vec3) -> Self {
        let (mut position, mut normal, mut power, mut weights) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO, 0.0);
        for photon in run {
            let own = photon.power.truncate().as_dvec3();
            // Photons without power count a little, so that there is a mean.
            let weight = own.element_sum() + f64::MIN_POSITIVE;
            position += photon.position.truncate().as_dvec3() * weight;
            normal += photon.normal.truncate().as_dvec3() * weight;
            power += own;
            weights += weight;
        }
        Self {
            position: (position / weights - low.as_dvec3()).as_vec3(),
            normal: normal.normalize_or(DVec3::Z).as_vec3(),
            power: power.as_vec3(),
        }
    }
}
