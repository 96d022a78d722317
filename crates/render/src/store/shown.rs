//! Which points of a chunk of the store are shown, and figures of these.

use cloud::{Bounds, Chunk, CloudLayout, NO_RADIUS, PointTest, ShownPoints, unpack_radius};
use glam::Vec3;

/// Figures of the shown points of a chunk.
pub(super) struct Shown {
    pub which: ShownPoints,
    pub points: u32,
    pub bounds: Bounds,
    /// The bounds without the points that are far away from most of the chunk.
    pub core: Bounds,
    /// The largest known splat radius in world units.
    pub largest_radius: f32,
    pub lacks_radii: bool,
}

impl Shown {
    pub fn of(points: &Chunk, which: ShownPoints) -> Self {
        let (bounds, core) = (Bounds::EMPTY, Bounds::EMPTY);
        let mut shown = Self { which, points: 0, bounds, core, largest_radius: 0.0, lacks_radii: true };
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let (mut count, mut largest, mut lacks_radii) = (0, None, points.radii.is_none());
        for index in shown.which.indices(points.len()) {
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
        if low.cmple(high).all() {
            shown.bounds = Bounds { min: points.origin + low.as_dvec3(), max: points.origin + high.as_dvec3() };
            let far = low.abs().max(high.abs()).max_element();
            shown.core = match reach_of_most(points, &shown.which).filter(|reach| FAR * reach < far) {
                None => shown.bounds,
                Some(reach) => bounds_within(points, &shown.which, FAR * reach),
            };
        }
        shown.largest_radius = largest.and_then(unpack_radius).unwrap_or(0.0);
        (shown.points, shown.lacks_radii) = (count, lacks_radii);
        shown
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

/// The distance from the origin, along any axis, within which nine tenths of some of the shown points are.
fn reach_of_most(points: &Chunk, which: &ShownPoints) -> Option<f32> {
    let step = points.len().div_ceil(SAMPLE).max(1);
    let some = (0..points.len()).step_by(step).filter(|index| which.has(*index));
    let mut reaches: Vec<f32> =
        some.map(|index| Vec3::from(points.positions[index]).abs().max_element()).filter(|r| r.is_finite()).collect();
    let rank = (reaches.len() * 9 / 10).min(reaches.len().checked_sub(1)?);
    Some(*reaches.select_nth_unstable_by(rank, f32::total_cmp).1)
}

fn bounds_within(points: &Chunk, which: &ShownPoints, reach: f32) -> Bounds {
    let mut bounds = Bounds::EMPTY;
    let is_near = |index: &usize| Vec3::from(points.positions[*index]).abs().max_element() <= reach;
    which.indices(points.len()).filter(is_near).for_each(|index| bounds.include(points.position(index)));
    bounds
}

/// Which points of a chunk with these bounds a test shows.
pub(super) fn shown_of(test: &PointTest, layout: Option<&CloudLayout>, points: &Chunk, bounds: Bounds) -> ShownPoints {
    match layout.filter(|_| !test.shows_all()) {
        Some(layout) => test.of(layout).shown(points, bounds),
        None => ShownPoints::All,
    }
}
