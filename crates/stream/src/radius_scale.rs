//! How much larger splats are drawn where only a part of a place's points is.
//!
//! Radii of pages are those of all points together. A node of which, with all that lies below it, only a part is drawn covers
//! the same surface with fewer splats, each of which stands for a larger share of area. Per octant of a node the share grows by
//! (all points) / (points drawn), the radius by its square root. Packed radii are logarithms, so that is a sum; it goes in eighths
//! of an octave, so that few chunks change as others come and go. Where all is drawn nothing changes.
//!
//! That is right on average. Trees and facades have more points than the surface that is seen of them, and a scanner's
//! surroundings more than the rest of their octant. What is drawn is spaced evenly all the same, so radii that grow stay within
//! [`LARGEST_SPACINGS`] and [`SMALLEST_SPACINGS`].

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use cloud::{Chunk, NO_RADIUS, pack_radius};
use glam::{DVec3, Vec3};

use crate::{NodeId, Octree};

/// Steps of a packed radius that double it.
const STEPS_PER_OCTAVE: u16 = 2048;
const EIGHTH: u16 = STEPS_PER_OCTAVE / 8;

/// Radii that grow stay between these, in distances between the points that are drawn at a place. One point of each cell of a
/// grid is drawn, and a surface meets up to 1.5 cells for each that it would fill. 0.8 leaves no holes; pictures of a tenth of the
/// points come nearer to those of all than with 0.88, 1 and 1.15 (docs/performance.md).
pub const LARGEST_SPACINGS: f64 = 0.8;
const SMALLEST_SPACINGS: f64 = 0.6;

/// A node's own points by octant.
pub type Octants = [u32; 8];
/// How radii grow. More of each is more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Growth {
    /// Of an octave.
    eighths: u8,
    /// Packed: no radius is made larger than this, and none is left smaller.
    largest: u16,
    smallest: u16,
}

/// By octant.
pub type Growths = [Growth; 8];

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

/// Distances between the points that are drawn at a place, world units.
#[derive(Clone, Copy, Default)]
struct Spacings {
    /// Of all places the largest.
    all: f64,
    /// Of those where some points are not drawn; 0 where there are none.
    thinned: f64,
}

/// What is drawn in a node's cube.
struct Inside {
    points: u64,
    spacings: Spacings,
}

/// For each node that is drawn, how much its radii grow. Nodes that are not in `drawn` have no point on the screen.
pub fn growths(octree: &Octree, drawn: &BTreeMap<NodeId, Drawn>) -> BTreeMap<NodeId, Growths> {
    // Of all nodes that are drawn or have such a node below them; children come after their parents.
    let mut inside: BTreeMap<NodeId, Inside> = BTreeMap::new();
    let mut queue: BTreeSet<NodeId> = drawn.keys().copied().collect();
    let mut growths = BTreeMap::new();
    while let Some(id) = queue.pop_last() {
        let node = octree.node(id);
        let parts = drawn.get(&id).copied().unwrap_or_default();
        let points = |octants: &Octants| octants.iter().map(|count| u64::from(*count)).sum::<u64>();
        let own_spacing =
            octree.spacing_at(node.level) * (points(&parts.own) as f64 / points(&parts.drawn).max(1) as f64).sqrt();
        let octants: [Inside; 8] = std::array::from_fn(|octant| {
            let child = node.children[octant];
            let below = child.and_then(|child| inside.get(&child));
            let spacings = match (child, below) {
                (None, _) => Spacings { all: own_spacing, thinned: 0.0 },
                (Some(_), None) => Spacings { all: own_spacing, thinned: own_spacing },
                (Some(_), Some(Inside { spacings: Spacings { all, thinned }, .. })) => {
                    Spacings { all: all.min(own_spacing), thinned: thinned.min(own_spacing) }
                }
            };
            Inside { points: u64::from(parts.drawn[octant]) + below.map_or(0, |below| below.points), spacings }
        });
        if drawn.contains_key(&id) {
            growths.insert(
                id,
                std::array::from_fn(|octant| {
                    let hidden = node.children[octant].map_or(0, |child| octree.node(child).total);
                    let Inside { points, spacings } = octants[octant];
                    Growth::new(u64::from(parts.own[octant]) + hidden, points, spacings)
                }),
            );
        }
        let spacings = if drawn.contains_key(&id) {
            let occupied = octants.iter().zip(parts.own).filter(|(_, own)| *own > 0).map(|(inside, _)| inside.spacings);
            occupied
                .fold(Spacings::default(), |a, b| Spacings { all: a.all.max(b.all), thinned: a.thinned.max(b.thinned) })
        } else {
            Spacings { all: f64::INFINITY, thinned: f64::INFINITY }
        };
        inside.insert(id, Inside { points: octants.iter().map(|inside| inside.points).sum(), spacings });
        queue.extend(node.parent.filter(|parent| *parent < id));
    }
    growths
}

impl Growth {
    fn new(total: u64, drawn: u64, spacings: Spacings) -> Self {
        if drawn == 0 || total <= drawn {
            return Self::default();
        }
        let packed = |spacings: f64| pack_radius(spacings as f32);
        Self {
            // Twice the octaves of the radius are those of the area.
            eighths: (4.0 * (total as f64 / drawn as f64).log2()).round() as u8,
            largest: packed(LARGEST_SPACINGS * spacings.all),
            smallest: packed(SMALLEST_SPACINGS * spacings.thinned),
        }
    }

    /// The same whatever the spacing, for radii that were estimated at that spacing.
    pub fn unbounded(self) -> Self {
        Self { largest: u16::MAX, smallest: 0, ..self }
    }

    pub fn larger(self, other: Self) -> Self {
        Self {
            eighths: self.eighths.max(other.eighths),
            largest: self.largest.max(other.largest),
            smallest: self.smallest.max(other.smallest),
        }
    }

    /// Whether radii are larger than `other` makes them by less than a half of an octave: 41 %.
    pub fn is_near(self, other: Self) -> bool {
        let less = |a: u16, b: u16| a.saturating_sub(b) < STEPS_PER_OCTAVE / 2;
        less(u16::from(self.eighths) * EIGHTH, u16::from(other.eighths) * EIGHTH)
            && less(self.largest, other.largest)
            && less(self.smallest, other.smallest)
    }

    fn apply(self, radius: u16) -> u16 {
        let grown = radius.saturating_add(u16::from(self.eighths) * EIGHTH);
        grown.max(self.smallest).min(self.largest).max(radius)
    }
}

/// The chunk with larger radii; the same one where nothing changes. Points without a radius stay so.
pub fn scaled(chunk: &Chunk, center: DVec3, growths: &Growths) -> Chunk {
    let mut chunk = chunk.clone();
    if let Some(radii) = &chunk.radii
        && *growths != Growths::default()
    {
        let grown = radii.iter().zip(octants(&chunk, center)).map(|(radius, octant)| match *radius {
            NO_RADIUS => NO_RADIUS,
            radius => growths[octant].apply(radius),
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
