//! Which points of a chunk of the store are shown, and figures of these.

use std::ops::Range;

use cloud::{Bounds, Chunk, CloudLayout, NO_RADIUS, PointTest, ShownPoints, unpack_radius};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use scene::Splat;

use crate::layout::BLOCK_POINTS;

/// Figures of the shown points of a chunk, or of a run of `BLOCK_POINTS` of its points.
pub(super) struct Extent {
    pub points: u32,
    pub bounds: Bounds,
    /// The largest known splat radius in world units.
    pub largest_radius: f32,
    pub lacks_radii: bool,
}

/// Figures of the shown points of a chunk.
pub(super) struct Shown {
    pub which: ShownPoints,
    pub whole: Extent,
    /// Those of each run of the chunk. Points that follow one another in a file mostly lie beside one another, too.
    pub runs: Vec<Extent>,
    /// The bounds without the points that are far away from most of the chunk.
    pub core: Bounds,
    /// Some of the points of the core, as offsets from the chunk's origin.
    pub sample: Vec<Vec3>,
}

impl Extent {
    /// The radius of the largest splat in world units; `provisional` is that of points whose own is not known yet.
    pub fn largest_splat(&self, provisional: f32, splat: &Splat) -> f64 {
        let provisional = if self.lacks_radii { provisional } else { 0.0 };
        f64::from(self.largest_radius.max(provisional)) * f64::from(splat.size)
    }

    fn of(points: &Chunk, which: &ShownPoints, range: Range<usize>) -> Self {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut count, mut largest, mut lacks_radii) = (0, None, points.radii.is_none());
        for index in range.filter(|index| which.has(*index)) {
            let position = Vec3::from(points.positions[index]);
            if position.is_finite() {
                (low, high) = (low.min(position), high.max(position));
            }
            if let Some(radii) = &points.radii {
                // Packed radii grow with the radius.
                largest = largest.max(Some(radii[index]));
                lacks_radii |= radii[index] == NO_RADIUS;
            }
            count += 1;
        }
        let bounds = match low.cmple(high).all() {
            true => Bounds { min: points.origin + low.as_dvec3(), max: points.origin + high.as_dvec3() },
            false => Bounds::EMPTY,
        };
        let largest_radius = largest.and_then(unpack_radius).unwrap_or(0.0);
        Self { points: count, bounds, largest_radius, lacks_radii }
    }

    fn union(self, other: &Self) -> Self {
        Self {
            points: self.points + other.points,
            bounds: self.bounds.union(other.bounds),
            largest_radius: self.largest_radius.max(other.largest_radius),
            lacks_radii: self.lacks_radii | other.lacks_radii,
        }
    }
}

impl Shown {
    pub fn of(points: &Chunk, which: ShownPoints) -> Self {
        let firsts = (0..points.len()).step_by(BLOCK_POINTS as usize);
        let run = |first: usize| Extent::of(points, &which, first..points.len().min(first + BLOCK_POINTS as usize));
        let runs: Vec<Extent> = firsts.map(run).collect();
        let whole = runs.iter().fold(Extent::of(points, &which, 0..0), Extent::union);
        let (core, sample) = (whole.bounds, Vec::new());
        let mut shown = Self { which, whole, runs, core, sample };
        let Bounds { min, max } = shown.whole.bounds;
        if !shown.whole.bounds.is_empty() {
            let [low, high] = [min, max].map(|corner| (corner - points.origin).as_vec3());
            let far = low.abs().max(high.abs()).max_element();
            let reach = reach_of_most(points, &shown.which).filter(|reach| FAR * reach < far);
            let reach = reach.map_or(f32::INFINITY, |reach| FAR * reach);
            let is_near = |position: &Vec3| position.abs().max_element() <= reach;
            shown.core = match reach.is_finite() {
                false => shown.whole.bounds,
                true => shown.bounds_where(points, |position| is_near(&(position - points.origin).as_vec3())),
            };
            let indices = (0..points.len()).step_by(points.len().div_ceil(SCENE_SAMPLE).max(1));
            let some = indices.filter(|index| shown.which.has(*index)).map(|index| Vec3::from(points.positions[index]));
            shown.sample = some.filter(is_near).collect();
        }
        shown
    }

    /// The bounds of those of the shown points that are in such places.
    pub fn bounds_where(&self, points: &Chunk, holds: impl Fn(DVec3) -> bool) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        let places = self.which.indices(points.len()).map(|index| points.position(index));
        places.filter(|place| holds(*place)).for_each(|place| bounds.include(place));
        bounds
    }

    /// The bits of the points, for a page of the store.
    pub fn words(&self, points: usize) -> Vec<u32> {
        let words = points.div_ceil(u32::BITS as usize);
        match &self.which {
            ShownPoints::All => vec![u32::MAX; words],
            ShownPoints::None => vec![0; words],
            ShownPoints::Some(bits) => bits.clone(),
        }
    }
}

/// Points this many times as far from their chunk's origin as nine tenths of it are strays of a file, such as points at
/// 0, 0, 0 among coordinates of a map.
pub(super) const FAR: f32 = 64.0;
/// The number of points that tell how far most are from the origin.
const SAMPLE: usize = 99;
/// The number of points of a chunk that decide where the scene is.
const SCENE_SAMPLE: usize = 128;

/// The distance from the origin, along any axis, within which nine tenths of some of the shown points are.
fn reach_of_most(points: &Chunk, which: &ShownPoints) -> Option<f32> {
    let step = points.len().div_ceil(SAMPLE).max(1);
    let some = (0..points.len()).step_by(step).filter(|index| which.has(*index));
    let mut reaches: Vec<f32> =
        some.map(|index| Vec3::from(points.positions[index]).abs().max_element()).filter(|r| r.is_finite()).collect();
    let rank = (reaches.len() * 9 / 10).min(reaches.len().checked_sub(1)?);
    Some(*reaches.select_nth_unstable_by(rank, f32::total_cmp).1)
}

/// The bounds of the shown points of a cloud without its strays.
pub(super) fn scene_bounds(chunks: &[(&Chunk, &Shown)]) -> Bounds {
    let all = chunks.iter().map(|(_, shown)| shown.core).fold(Bounds::EMPTY, Bounds::union);
    let sample = chunks.iter().flat_map(|(points, shown)| {
        let weight = f64::from(shown.whole.points) / shown.sample.len().max(1) as f64;
        shown.sample.iter().map(move |offset| (points.origin + offset.as_dvec3(), weight))
    });
    let Some(fence) = cloud::scene_fence(sample.collect()) else { return all };
    let is_within = |bounds: &Bounds| bounds.is_empty() || fence.contains(bounds.min) && fence.contains(bounds.max);
    if is_within(&all) {
        return all;
    }
    let of_chunk = |(points, shown): &(&Chunk, &Shown)| {
        if is_within(&shown.core) { shown.core } else { shown.bounds_where(points, |place| fence.contains(place)) }
    };
    chunks.par_iter().map(of_chunk).reduce(|| Bounds::EMPTY, Bounds::union)
}

/// Which points of a chunk with these bounds a test shows.
pub(super) fn shown_of(test: &PointTest, layout: Option<&CloudLayout>, points: &Chunk, bounds: Bounds) -> ShownPoints {
    match layout.filter(|_| !test.shows_all()) {
        Some(layout) => test.of(layout).shown(points, bounds),
        None => ShownPoints::All,
    }
}
