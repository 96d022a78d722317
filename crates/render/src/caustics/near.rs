//! The neighbours of photons: how far those lie that landed beside each, and where its surface ends at another one.

use std::ops::Range;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::layout::Landed;

/// The least cosine between the normals of a place and of where a photon has landed that counts there.
pub(super) const SAME_SIDE: f32 = 0.5;
/// The number of neighbours among which a photon spreads its light: fewer leave the light grainy where a mirror's points
/// or bumps throw photons unevenly, more blur it.
pub(super) const NEIGHBOURS: usize = 24;
/// The photons of a leaf of the tree.
const LEAF: usize = 8;
/// Neighbours that lie beyond another surface by more than this share of the radius say that the photon's own surface goes
/// on there. Less is the unevenness of points.
const BEYOND: f32 = 0.1;

/// How a photon's light is spread.
#[derive(Clone, Copy)]
pub(super) struct Spread {
    pub radius: f32,
    /// The line where the photon's surface ends at another one. xyz: the unit vector from the photon to it, in the plane of
    /// its surface; w: how far it is. `Vec4::W` times twice the radius if there is none.
    pub end: Vec4,
}

/// A tree of photons: each range of them is cut in halves along the longest edge of its box (Bentley 1975).
pub(super) struct Tree<'a> {
    photons: &'a [Landed],
    /// The axis across which the range with this middle is cut, and where.
    cuts: Vec<(usize, f32)>,
}

/// What a search has found so far.
struct Found {
    /// The squared distances of the nearest neighbours on the same side and their indices, in rising order.
    same: Vec<(f32, usize)>,
    /// The same of the nearest one on a surface across.
    other: Option<(f32, usize)>,
    /// The squared distance beyond which nothing counts.
    squared: f32,
}

impl<'a> Tree<'a> {
    /// Sorts the photons, so that those that lie close together are close in their order.
    pub fn new(photons: &'a mut [Landed]) -> Self {
        let mut cuts = vec![(0, 0.0); photons.len()];
        sort(photons, &mut cuts);
        Self { photons, cuts }
    }

    /// How the light of each photon is spread, by radii from `least` to `most`.
    pub fn spreads(&self, radii: [f32; 2]) -> Vec<Spread> {
        (0..self.photons.len()).into_par_iter().map(|index| self.spread(index, radii)).collect()
    }

    fn spread(&self, index: usize, [least, most]: [f32; 2]) -> Spread {
        let photon = &self.photons[index];
        let mut found = Found { same: Vec::with_capacity(NEIGHBOURS + 2), other: None, squared: most * most };
        self.search(0..self.photons.len(), photon, &mut found);
        let radius = found.squared.sqrt();
        let end = self.end(photon, radius, &found);
        // All neighbours lie in the part of the disc before the line: the whole one of the same area is smaller.
        let radius = end.map_or(radius, |end| radius * share_before(end.w / radius).sqrt()).max(least);
        let end = end.filter(|end| radius > least && end.w < radius);
        Spread { radius, end: end.unwrap_or(Vec4::W * (2.0 * radius)) }
    }

    fn search(&self, range: Range<usize>, photon: &Landed, found: &mut Found) {
        let position = photon.position.truncate();
        if range.len() <= LEAF {
            for index in range {
                let squared = self.photons[index].position.truncate().distance_squared(position);
                if squared < found.squared {
                    found.meet(squared, index, self.normal(index).dot(photon.normal.truncate()));
                }
            }
            return;
        }
        let middle = range.start + range.len() / 2;
        let (axis, place) = self.cuts[middle];
        let offset = position[axis] - place;
        let (low, high) = (range.start..middle, middle..range.end);
        let (near, far) = if offset < 0.0 { (low, high) } else { (high, low) };
        self.search(near, photon, found);
        if offset * offset < found.squared {
            self.search(far, photon, found);
        }
    }

    fn normal(&self, index: usize) -> Vec3 {
        self.photons[index].normal.truncate()
    }

    /// Where the surface of a photon ends at that of the nearest photon across; `None` if neighbours on its own side lie
    /// beyond.
    fn end(&self, photon: &Landed, radius: f32, found: &Found) -> Option<Vec4> {
        let (squared, other) = found.other?;
        let (position, normal, across) = (photon.position.truncate(), photon.normal.truncate(), self.normal(other));
        let along = across - normal * across.dot(normal);
        let distance = (self.photons[other].position.truncate() - position).dot(across) / along.length();
        let toward = along.normalize_or_zero() * 1_f32.copysign(distance);
        let is_beyond = |(_, index): &(f32, usize)| {
            (self.photons[*index].position.truncate() - position).dot(toward) > distance.abs() + BEYOND * radius
        };
        let ends = squared < radius * radius && distance.abs() < radius && !found.same.iter().any(is_beyond);
        ends.then(|| toward.extend(distance.abs()))
    }
}

impl Found {
    fn meet(&mut self, squared: f32, index: usize, cosine: f32) {
        if cosine <= SAME_SIDE {
            if cosine >= -SAME_SIDE && self.other.is_none_or(|(nearest, _)| squared < nearest) {
                self.other = Some((squared, index));
            }
            return;
        }
        // The photon itself is among them.
        let place = self.same.partition_point(|(before, _)| *before <= squared);
        self.same.insert(place, (squared, index));
        self.same.truncate(NEIGHBOURS + 1);
        if let Some((farthest, _)) = self.same.get(NEIGHBOURS) {
            self.squared = *farthest;
        }
    }
}

/// The share of a unit disc that lies before a line at a distance from its middle.
fn share_before(distance: f32) -> f32 {
    1.0 - (distance.acos() - distance * (1.0 - distance * distance).sqrt()) * std::f32::consts::FRAC_1_PI
}

fn sort(photons: &mut [Landed], cuts: &mut [(usize, f32)]) {
    if photons.len() <= LEAF {
        return;
    }
    let places = || photons.iter().map(|photon| photon.position.truncate());
    let low = places().fold(Vec3::INFINITY, Vec3::min);
    let high = places().fold(Vec3::NEG_INFINITY, Vec3::max);
    let axis = (high - low).max_position();
    let middle = photons.len() / 2;
    photons.select_nth_unstable_by(middle, |one, other| one.position[axis].total_cmp(&other.position[axis]));
    cuts[middle] = (axis, photons[middle].position[axis]);
    let (halves, halves_cuts) = (photons.split_at_mut(middle), cuts.split_at_mut(middle));
    sort(halves.0, halves_cuts.0);
    // No range of the upper half that is cut has its middle at its first photon, so that this cut stays.
    sort(halves.1, halves_cuts.1);
}
