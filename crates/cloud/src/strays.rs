//! Points that are on no surface: lone strays, and mixed pixels.
//!
//! Where an edge splits a ray of a scanner, the range lies between that of the edge and that of what is behind it. Such
//! mixed pixels hang in the air along the lines of sight past the edge, in a thin curtain. A lone stray is of nothing at
//! all, and the other strays about it lie anywhere.

use rayon::prelude::*;

use crate::neighbours::{Points, Surroundings, Tiles};
use crate::shape::Shape;
use crate::{
    Chunk, Cloud, MIXED_RADIUS, Progress, STRAY_RADIUS, pack_radius, stray_kind, unpack_normal, unpack_radius,
};

/// A point may be alone if its radius is so many times the median one of its search tile, some 50 thousand points.
const LARGE: f32 = 2.0;
/// A point is alone if within so many times the distance of its last neighbour ...
const ALONE_REACH: f32 = 4.0;
/// ... there are so many times as many points beside the plane of its neighbours: a surface has 16 times as many there,
/// none of them beside its plane, however uneven it was scanned, and a volume 52 times.
const ALONE: usize = 80;
/// Points are beside the plane from this share of the distance of the last neighbour on.
const BESIDE: f32 = 0.5;
/// A point on no surface is a mixed pixel if so many others of them are within `ALONE_REACH` ...
const COMPANY: usize = 4;
/// ... that are, with the point, thinner than this share of their width.
const THIN: f32 = 0.15;

/// What decides whether a point it is on a surface.
pub(crate) struct Look {
    /// The running index of the point.
    pub index: u32,
    /// The packed radius of its splat.
    pub radius: u16,
    /// The packed normal of the plane of its neighbours.
    pub normal: u32,
    /// The distance of its last neighbour.
    pub reach: f32,
    /// The number of its brick in the tile.
    pub brick: u32,
    /// The distance of its fourth neighbour where its neighbours are rough.
    pub near: Option<f32>,
}

/// A point that is on no surface.
pub(crate) struct Stray {
    /// The running index of the point.
    pub index: u32,
    reach: f32,
}

/// The points of a tile that are on no surface: those that are far from all of their neighbours, and those that are far
/// more apart from one another than the points around all of them. `looks` are of all points of the tile, each with `count`
/// neighbours, in the order of the search.
pub(crate) fn strays_of(tiles: &Tiles, tile: usize, count: usize, looks: &[Look], progress: &Progress) -> Vec<Stray> {
    let stray = |look: &Look| Stray { index: look.index, reach: look.reach };
    let mut strays: Vec<Stray> = looks.iter().filter(|look| stray_kind(look.radius) != 0).map(stray).collect();
    let mut radii: Vec<u16> = looks.iter().map(|look| look.radius).collect();
    let Some(usual) = median_radius(&mut radii) else { return strays };
    let large = pack_radius(LARGE * usual);
    let wanted: Vec<&Look> = looks.iter().filter(|look| look.radius >= large).collect();
    let visit = |number: usize, surroundings: &mut Surroundings<'_, '_, 1>| {
        let (look, most) = (wanted[number], ALONE * count);
        let is_alone = |normal| {
            let beside = surroundings.count_beside(ALONE_REACH * look.reach, normal, BESIDE * look.reach, most);
            beside >= most
        };
        if unpack_normal(look.normal).is_some_and(is_alone) {
            strays.push(stray(look));
        }
    };
    let indices: Vec<u32> = wanted.iter().map(|look| look.index).collect();
    tiles.search_some(tile, &indices, visit, progress);
    strays
}

/// The packed radius of each of the points that are on no surface: `MIXED_RADIUS` of those in a curtain, `STRAY_RADIUS` of
/// the others. `None` when cancelled.
pub(crate) fn kinds_of(points: &Points, strays: &[&Stray], progress: &Progress) -> Option<Vec<u16>> {
    let places: Vec<_> = strays.iter().map(|stray| points.position(stray.index)).collect();
    let chunks = [Chunk::of_places(0, &places)];
    let points = Points::new(&chunks);
    let tiles = Tiles::new(&points, progress)?;
    let mixed_in = |tile: usize| {
        let mut mixed = Vec::new();
        let visit = |index: u32, surroundings: &mut Surroundings<'_, '_, COMPANY>| {
            let others = surroundings.neighbourhood();
            let is_near = others.distance_squared.sqrt() <= ALONE_REACH * strays[index as usize].reach;
            let is_thin = || Shape::of(others).is_some_and(|shape| shape.roughness() < THIN);
            if others.count == COMPANY && is_near && is_thin() {
                mixed.push(index);
            }
        };
        tiles.search::<COMPANY>(tile, COMPANY, visit, progress);
        mixed
    };
    let mixed: Vec<Vec<u32>> = (0..tiles.len()).into_par_iter().map(mixed_in).collect();
    let mut kinds = vec![STRAY_RADIUS; strays.len()];
    mixed.into_iter().flatten().for_each(|index| kinds[index as usize] = MIXED_RADIUS);
    (!progress.is_cancelled()).then_some(kinds)
}

/// The median of packed radii in world units; `None` if there are none, and where it is not known.
pub(crate) fn median_radius(packed: &mut [u16]) -> Option<f32> {
    let middle = packed.len() / 2;
    (!packed.is_empty()).then(|| *packed.select_nth_unstable(middle).1).and_then(unpack_radius)
}

impl Cloud {
    /// The numbers of its lone strays and of its mixed pixels; `None` where nobody has looked for them.
    pub fn strays(&self) -> Option<[u64; 2]> {
        let mut counts = [0; 3];
        for chunk in self.chunks.iter().filter(|chunk| !chunk.is_empty()) {
            chunk.radii.as_ref()?.iter().for_each(|radius| counts[usize::from(stray_kind(*radius))] += 1);
        }
        Some([counts[1], counts[2]])
    }
}
