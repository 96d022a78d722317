//! Enlarges splats where only some of a place's points are drawn.
//!
//! The radii in pages are those of all points together. Where only some are drawn, each represents a larger share of
//! the surface: the share grows by (all points) / (points drawn), the radius by its square root. A place is an octant
//! of the deepest node that is drawn there, and the points of all levels in it grow alike. Packed radii are logarithms,
//! so growth is an addition of steps; it goes in eighths of an octave, so that few chunks change as others come and go. Where
//! all points are drawn nothing changes.
//!
//! That is right on average. Trees and facades have more points than their visible surface needs, and the surroundings
//! of a scanner have more than the rest of their place. The points drawn are spaced evenly all the same, so enlarged
//! radii stay within [`LARGEST_SPACINGS`] and [`SMALLEST_SPACINGS`].
//!
//! Radii that were estimated from a node's own points alone are those of that node's density. Where other nodes are drawn
//! at a place as well, they shrink: by the square root of (the node's points there) / (points drawn there). So they do not
//! depend on nodes that are not drawn, which may not even be known.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use cloud::{Chunk, NO_RADIUS, RADIUS_SHAPES, RADIUS_STEPS, grown_radius, pack_radius, stray_kind};
use glam::{DVec3, Vec3};

use crate::{NodeId, Octree};

/// The steps of a radius for an eighth of a doubling.
const EIGHTH: i32 = (RADIUS_STEPS / RADIUS_SHAPES / 8) as i32;

/// The bounds of enlarged radii, in distances between the points that are drawn at a place. One point of each cell of a
/// grid is drawn, and a surface meets up to 1.5 cells for each that it would fill. 0.8 leaves no holes; pictures of a
/// tenth of the points come nearer to those of all than with 0.88 and 1 (docs/performance.md).
pub const LARGEST_SPACINGS: f64 = 0.8;
const SMALLEST_SPACINGS: f64 = 0.6;

/// The number of a node's own points in each octant.
pub type Octants = [u32; 8];
/// How much of a node is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Drawn {
    /// The number of its own points.
    pub own: Octants,
    /// The number of its own points that are drawn.
    pub drawn: Octants,
}

/// The middle of a node's cube in world coordinates.
pub fn cube_center(octree: &Octree, id: NodeId) -> DVec3 {
    // The octants on the way up, as many as the tree is deep: even in a damaged tree parents come before their
    // children.
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

/// The octant of each of a chunk's points. Points that are not finite count as the first octant.
fn octants(chunk: &Chunk, center: DVec3) -> impl Iterator<Item = usize> {
    let center = (center - chunk.origin).as_vec3();
    chunk.positions.iter().map(move |position| Vec3::from(*position).cmpge(center).bitmask() as usize)
}

/// The number of a chunk's points in each octant of the cube with that middle.
pub fn count_octants(chunk: &Chunk, center: DVec3) -> Octants {
    count_first_octants(chunk, center, chunk.len())
}

/// Counts the octants of the chunk's first `points` points.
pub fn count_first_octants(chunk: &Chunk, center: DVec3, points: usize) -> Octants {
    let mut counts = [0; 8];
    octants(chunk, center).take(points).for_each(|octant| counts[octant] += 1);
    counts
}

/// The packed radii of a chunk's points; `None` if they have none.
pub type Radii = Option<Arc<Vec<u16>>>;

/// How much radii grow at each place.
#[derive(Clone, Debug, Default)]
pub struct Field {
    /// The cells, parents before children.
    cells: Vec<Cell>,
    indices: BTreeMap<NodeId, u32>,
}

/// The cube of a node that is drawn, or that has such a node below it.
#[derive(Clone, Debug)]
struct Cell {
    center: DVec3,
    /// The indices of the children's cells; 0, which is no child, where there is none.
    children: [u32; 8],
    /// The growth in octants without a child's cell.
    growths: [Growth; 8],
    /// The share of the points of nodes above that each octant has.
    shares: [f64; 8],
    /// The number of points drawn in octants without a child's cell, as eighths of an octave of a radius.
    drawn: [i16; 8],
}

/// How radii grow at a place.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Growth {
    /// The growth in eighths of an octave.
    eighths: u8,
    /// The bounds as packed radii: no radius is made larger than `largest`, and none is left below `smallest`.
    largest: u16,
    smallest: u16,
}

/// What a node and those above it draw in an octant of a cell.
#[derive(Clone, Copy)]
struct Above {
    /// The number of points, if those of nodes above are spread like this node's own.
    all: f64,
    /// The number of these points that are drawn.
    drawn: f64,
    /// The distance between drawn points in world units.
    spacing: f64,
}

impl Field {
    /// `drawn` has all nodes of which something is drawn.
    pub fn new(octree: &Octree, drawn: &BTreeMap<NodeId, Drawn>) -> Self {
        let above = |id: NodeId| octree.get(id)?.parent.filter(|parent| *parent < id);
        let mut nodes: BTreeSet<NodeId> = BTreeSet::new();
        for id in drawn.keys() {
            let path = std::iter::successors(Some(*id), |id| above(*id));
            for id in path {
                if !nodes.insert(id) {
                    break;
                }
            }
        }
        let mut field = Self::default();
        let mut inside: Vec<[Above; 8]> = Vec::with_capacity(nodes.len());
        for id in nodes {
            let node = octree.node(id);
            let octant_of = |parent: NodeId| octree.node(parent).children.iter().position(|child| *child == Some(id));
            let parent = above(id).and_then(|parent| Some((field.indices[&parent], octant_of(parent)?)));
            let from_above = match parent {
                Some((parent, octant)) => inside[parent as usize][octant],
                None => Above { all: 0.0, drawn: 0.0, spacing: f64::INFINITY },
            };
            let Drawn { own, drawn } = drawn.get(&id).copied().unwrap_or_default();
            let sum = |octants: &Octants| octants.iter().map(|count| f64::from(*count)).sum::<f64>();
            let (own_points, drawn_points) = (sum(&own), sum(&drawn));
            let spacing = match drawn_points > 0.0 {
                true => octree.spacing_at(node.level) * (own_points / drawn_points).sqrt(),
                false => f64::INFINITY,
            };
            // One is added in each octant, so that the share of nodes above never vanishes.
            let shares = own.map(|own| (f64::from(own) + 1.0) / (own_points + 8.0));
            let octants: [Above; 8] = std::array::from_fn(|octant| {
                let share = shares[octant];
                Above {
                    all: from_above.all * share + f64::from(own[octant]),
                    drawn: from_above.drawn * share + f64::from(drawn[octant]),
                    spacing: from_above.spacing.min(spacing),
                }
            });
            let growths = std::array::from_fn(|octant| {
                Growth::new(octants[octant], node.children[octant].map(|child| octree.node(child).total))
            });
            let index = field.cells.len() as u32;
            if let Some((parent, octant)) = parent {
                let parent = &mut field.cells[parent as usize];
                parent.children[octant] = index;
                parent.growths[octant] = Growth::default();
                parent.drawn[octant] = 0;
            }
            let drawn = octants.map(|place| eighths_of(place.drawn));
            field.cells.push(Cell { center: cube_center(octree, id), children: [0; 8], growths, shares, drawn });
            field.indices.insert(id, index);
            inside.push(octants);
        }
        field
    }

    /// The nodes whose points lie in places that have other growths in the other field.
    pub fn changed(&self, other: &Self, octree: &Octree) -> BTreeSet<NodeId> {
        let mut changed = BTreeSet::new();
        let nodes: BTreeSet<&NodeId> = self.indices.keys().chain(other.indices.keys()).collect();
        for id in nodes {
            let growths = |field: &Self| {
                let cell = &field.cells[*field.indices.get(id)? as usize];
                Some((cell.growths, cell.drawn))
            };
            if growths(self) != growths(other) {
                let above = |id: &NodeId| octree.get(*id)?.parent.filter(|parent| parent < id);
                let path = std::iter::successors(Some(*id), above);
                for id in path {
                    if !changed.insert(id) {
                        break;
                    }
                }
            }
        }
        changed
    }

    /// The radii of a node's chunk, none smaller than before; the same vector where nothing changes. Points without a
    /// radius get none, and stray ones stay dots.
    pub fn radii(&self, id: NodeId, chunk: &Chunk) -> Radii {
        self.scaled(id, chunk, |first, position, radius| self.growth(first, position).apply(radius))
    }

    /// The radii of a chunk whose radii were estimated from its node's points alone; `own` are the numbers of these by
    /// octant. None is larger than before, but where only some of the node's points are drawn.
    pub fn radii_of_density(&self, id: NodeId, chunk: &Chunk, own: &Octants) -> Radii {
        self.scaled(id, chunk, |first, position, radius| grown_radius(radius, self.steps(first, position, own)))
    }

    fn scaled(&self, id: NodeId, chunk: &Chunk, scale: impl Fn(u32, DVec3, u16) -> u16) -> Radii {
        let radii = chunk.radii.as_ref()?;
        let Some(&first) = self.indices.get(&id) else { return Some(radii.clone()) };
        let scaled = |index: usize| match radii[index] {
            radius if !has_size(radius) => radius,
            radius => scale(first, chunk.position(index), radius),
        };
        let scaled: Vec<u16> = (0..radii.len()).map(scaled).collect();
        Some(if scaled == **radii { radii.clone() } else { Arc::new(scaled) })
    }

    /// The steps by which the radius of a node's own density changes at a position in its cell.
    fn steps(&self, mut cell: u32, position: DVec3, own: &Octants) -> i32 {
        let mut points = None;
        loop {
            let Cell { center, children, shares, drawn, .. } = &self.cells[cell as usize];
            let octant = position.cmpge(*center).bitmask() as usize;
            let here = points.map_or(f64::from(own[octant]), |points: f64| points * shares[octant]);
            match children[octant] {
                0 => {
                    let octaves = 0.5 * here.max(f64::MIN_POSITIVE).log2();
                    let steps = (octaves * f64::from(RADIUS_STEPS / RADIUS_SHAPES)).round() as i32;
                    return steps - i32::from(drawn[octant]) * EIGHTH;
                }
                child => (cell, points) = (child, Some(here)),
            }
        }
    }

    /// The growth at a position in a cell.
    fn growth(&self, mut cell: u32, position: DVec3) -> Growth {
        loop {
            let Cell { center, children, growths, .. } = &self.cells[cell as usize];
            let octant = position.cmpge(*center).bitmask() as usize;
            match children[octant] {
                0 => return growths[octant],
                child => cell = child,
            }
        }
    }
}

/// The radius of this many points in a place, in eighths of an octave; that of one where there are fewer.
fn eighths_of(points: f64) -> i16 {
    (4.0 * points.max(1.0).log2()).round() as i16
}

/// Whether a packed radius is one, and not a mark of points without a size.
fn has_size(radius: u16) -> bool {
    radius != NO_RADIUS && stray_kind(radius) == 0
}

impl Growth {
    /// `hidden` is the number of points of the child in the octant, which is not drawn.
    fn new(place: Above, hidden: Option<u64>) -> Self {
        let total = place.all + hidden.map_or(0.0, |points| points as f64);
        if total <= place.drawn || place.drawn == 0.0 {
            return Self::default();
        }
        let packed = |spacings: f64| pack_radius((spacings * place.spacing) as f32);
        Self {
            // Twice the radius's octaves are the area's octaves.
            eighths: (4.0 * (total / place.drawn).log2()).round() as u8,
            largest: packed(LARGEST_SPACINGS),
            smallest: if hidden.is_some() { packed(SMALLEST_SPACINGS) } else { 0 },
        }
    }

    fn apply(self, radius: u16) -> u16 {
        let (shape, radius) = (radius % RADIUS_SHAPES, radius / RADIUS_SHAPES * RADIUS_SHAPES);
        let grown = grown_radius(radius, i32::from(self.eighths) * EIGHTH);
        let grown = grown.max(self.smallest).min(self.largest).max(radius);
        grown / RADIUS_SHAPES * RADIUS_SHAPES + shape
    }
}

/// The larger radius of each point of `radii`; `other` may have more or fewer points.
pub fn larger(radii: &Radii, other: &Radii) -> Radii {
    let (radii, other) = (radii.as_ref()?, other.as_deref().map_or(&[][..], |other| other.as_slice()));
    if radii.iter().zip(other).all(|(a, b)| a >= b) {
        return Some(radii.clone());
    }
    let others = other.iter().copied().chain(std::iter::repeat(0));
    Some(Arc::new(radii.iter().zip(others).map(|(a, b)| *a.max(&b)).collect()))
}

/// Whether no radius exceeds its counterpart in `other` by half an octave (41 %) or more.
pub fn is_near(radii: &Radii, other: &Radii) -> bool {
    let (Some(radii), Some(other)) = (radii, other) else { return true };
    let is_below = |radius: u16, other: u16| other >= RADIUS_SHAPES && radius < grown_radius(other, 4 * EIGHTH);
    radii.iter().zip(other.iter()).all(|(radius, other)| radius <= other || is_below(*radius, *other))
}

#[cfg(test)]
#[path = "radius_scale_tests.rs"]
mod tests;
