//! How much larger splats are drawn where only a part of a place's points is.
//!
//! Radii of pages are those of all points together. A node of which, with all that lies below it, only a part is drawn covers
//! the same surface with fewer splats, each of which stands for a larger share of area. Per octant of a node the share grows by
//! (all points) / (points drawn), the radius by its square root. Packed radii are logarithms, so that is a sum; it goes in
//! quarters of an octave, rounded up, so that few chunks change as others come and go. Where all is drawn nothing changes.
//!
//! Trees and facades have more points than the surface that is seen of them, and a scanner's surroundings more than the rest of
//! their octant. What a node shows is spaced evenly all the same, so no radius grows beyond [`LARGEST_SPACINGS`].

use std::collections::BTreeMap;
use std::sync::Arc;

use cloud::{Chunk, NO_RADIUS, pack_radius};
use glam::{DVec3, Vec3};

use crate::{NodeId, Octree};

/// Steps of a packed radius that double it.
const STEPS_PER_OCTAVE: u16 = 2048;
/// A quarter of an octave: 19 % larger.
const QUARTER: u16 = STEPS_PER_OCTAVE / 4;

/// Radius of the largest splats that scaling makes, in distances between the node's points: 1.13 gives splats of an even surface the
/// overlap that those of full density have (`cloud::SPLAT_OVERLAP`).
const LARGEST_SPACINGS: f64 = 1.15;

/// A node's own points by octant.
pub type Octants = [u32; 8];
/// By octant: quarters of an octave that radii grow by.
pub type Quarters = [u8; 8];

/// What is drawn of a node itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// All of its own points.
    pub own: Octants,
    /// Those of them that are drawn.
    pub drawn: Octants,
}

/// Middle of a node's cube, world coordinates.
pub fn cube_center(octree: &Octree, id: NodeId) -> DVec3 {
    // The octants on the way up, which is as long as the tree is deep: a damaged tree's parents still come before their children.
    let mut octants = Vec::new();
    let mut child = id;
    while let Some(parent) = octree.node(child).parent.filter(|parent| *parent < child) {
        octants.push(octree.node(parent).children.iter().position(|other| *other == Some(child)).unwrap_or(0));
        child = parent;
    }
    let mut width = octree.width;
    let mut center = octree.corner + DVec3::splat(width / 2.0);
    for octant in octants.into_iter().rev() {
        width /= 2.0;
        let side = |bit: usize| if octant >> bit & 1 == 1 { width / 2.0 } else { -width / 2.0 };
        center += DVec3::new(side(0), side(1), side(2));
    }
    center
}

/// The octants of a chunk's points, in their order. Points that are not finite count as the first.
fn octants(chunk: &Chunk, center: DVec3) -> impl Iterator<Item = usize> {
    let center = (center - chunk.origin).as_vec3();
    chunk.positions.iter().map(move |position| Vec3::from(*position).cmpge(center).bitmask() as usize)
}

/// How many of a chunk's points lie in which octant of the cube with that middle.
pub fn count_octants(chunk: &Chunk, center: DVec3) -> Octants {
    let mut counts = [0; 8];
    octants(chunk, center).for_each(|octant| counts[octant] += 1);
    counts
}

/// For each node that is drawn, how much its radii grow. Nodes that are not in `drawn` have no point on the screen.
pub fn radius_quarters(octree: &Octree, drawn: &BTreeMap<NodeId, Drawn>) -> BTreeMap<NodeId, Quarters> {
    // Drawn points in the cubes of all nodes that are drawn or have such a node below them; children come after their parents.
    let mut below: BTreeMap<NodeId, u64> = BTreeMap::new();
    let mut queue: std::collections::BTreeSet<NodeId> = drawn.keys().copied().collect();
    let mut quarters = BTreeMap::new();
    while let Some(id) = queue.pop_last() {
        let node = octree.node(id);
        let parts = drawn.get(&id).copied().unwrap_or_default();
        let in_children =
            node.children.map(|child| child.and_then(|child| below.get(&child)).copied().unwrap_or_default());
        if drawn.contains_key(&id) {
            quarters.insert(
                id,
                std::array::from_fn(|octant| {
                    let hidden = node.children[octant].map_or(0, |child| octree.node(child).total);
                    quarters_of(
                        u64::from(parts.own[octant]) + hidden,
                        u64::from(parts.drawn[octant]) + in_children[octant],
                    )
                }),
            );
        }
        let own: u64 = parts.drawn.iter().map(|count| u64::from(*count)).sum();
        below.insert(id, own + in_children.iter().sum::<u64>());
        queue.extend(node.parent.filter(|parent| *parent < id));
    }
    quarters
}

/// The least q for which 2^(q / 4) is no less than the root of total / drawn; 0 where nothing is drawn.
fn quarters_of(total: u64, drawn: u64) -> u8 {
    let (total, drawn) = (u128::from(total), u128::from(drawn));
    if drawn == 0 {
        return 0;
    }
    // In whole numbers, so that "all drawn" is exactly that: 2^q drawn^2 >= total^2. Totals are below 2^63.
    let squared = total.saturating_mul(total);
    (0..128)
        .find(|q| (drawn * drawn).checked_shl(*q).is_none_or(|s| s >> q != drawn * drawn || s >= squared))
        .unwrap_or(127) as u8
}

/// The radius up to which [`scaled`] makes those of a node larger whose points are so far apart, world units, if `drawn` of its
/// `own` points are drawn.
pub fn largest_radius(spacing: f64, own: u64, drawn: usize) -> u16 {
    let thinned = (own as f64 / (drawn as f64).max(1.0)).sqrt();
    pack_radius((LARGEST_SPACINGS * spacing * thinned) as f32)
}

/// The chunk with larger radii, none of them made larger than `largest`; the same one where nothing changes. Points without a
/// radius stay so.
pub fn scaled(chunk: &Chunk, center: DVec3, quarters: &Quarters, largest: u16) -> Chunk {
    let mut chunk = chunk.clone();
    if let Some(radii) = &chunk.radii
        && *quarters != [0; 8]
    {
        let steps = quarters.map(|quarters| u16::from(quarters) * QUARTER);
        let grown = radii.iter().zip(octants(&chunk, center)).map(|(radius, octant)| match *radius {
            NO_RADIUS => NO_RADIUS,
            radius => radius.saturating_add(steps[octant]).min(radius.max(largest)),
        });
        chunk.radii = Some(Arc::new(grown.collect()));
    }
    chunk
}

/// Radii that were estimated from a node's own points, made those of full density: what [`scaled`] grows by is taken off.
pub fn to_full_density(radii: &mut [u16], chunk: &Chunk, octree: &Octree, id: NodeId) {
    let center = cube_center(octree, id);
    let own = count_octants(chunk, center);
    let node = octree.node(id);
    let steps: [i32; 8] = std::array::from_fn(|octant| {
        let total = f64::from(own[octant]) + node.children[octant].map_or(0, |child| octree.node(child).total) as f64;
        // No own points: no radius to change.
        let scale = if own[octant] == 0 { 1.0 } else { (total / f64::from(own[octant])).sqrt() };
        (scale.log2() * f64::from(STEPS_PER_OCTAVE)).round() as i32
    });
    for (radius, octant) in radii.iter_mut().zip(octants(chunk, center)).filter(|(radius, _)| **radius != NO_RADIUS) {
        *radius = (i32::from(*radius) - steps[octant]).max(1) as u16;
    }
}

#[cfg(test)]
#[path = "radius_scale_tests.rs"]
mod tests;
