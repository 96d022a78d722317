//! Figures about a whole cloud that a few stray points do not spoil: the box to frame, and the range and histogram of a
//! scalar to colour by. Percentiles come from a sample of points that are drawn by a hash of their positions, so that a
//! point more or less, or another order of the points, changes next to nothing.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::{Bounds, Chunk, hash};

/// The number of points in a sample: the error of the first percentile is then about a thirtieth of a percent of the
/// points.
const SAMPLE_POINTS: usize = 100_000;
/// The share of the points that may be stray on either side of an axis.
const STRAY: f64 = 0.01;
/// With fewer points than this none is taken for stray.
const FEWEST: usize = 16;

/// A number that each point has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// The value in `Chunk::columns[i]`; chunks without the column are left out.
    Column(usize),
    /// The world coordinate x, y or z (0 ..= 2): height is one of them.
    Axis(usize),
}

impl Scalar {
    fn is_in(self, chunk: &Chunk) -> bool {
        match self {
            Self::Column(column) => chunk.columns.get(column).is_some_and(Option::is_some),
            Self::Axis(axis) => axis < 3,
        }
    }

    /// The value of a point; NaN if it has none.
    fn value(self, chunk: &Chunk, index: usize) -> f64 {
        match self {
            Self::Column(column) => {
                chunk.columns.get(column).and_then(Option::as_ref).map_or(f64::NAN, |column| column.value(index))
            }
            Self::Axis(axis) => chunk.origin[axis] + f64::from(chunk.positions[index][axis]),
        }
    }
}

/// The value that all points have; `None` if values differ, if a chunk lacks the scalar, or if there are fewer than two
/// points.
pub fn constant(chunks: &[Chunk], scalar: Scalar) -> Option<f64> {
    let first = chunks.iter().find(|chunk| !chunk.is_empty()).map(|chunk| scalar.value(chunk, 0))?;
    let is_same = |chunk: &Chunk| scalar.is_in(chunk) && (0..chunk.len()).all(|at| scalar.value(chunk, at) == first);
    let has_several = chunks.iter().map(Chunk::len).sum::<usize>() > 1;
    (has_several && chunks.iter().all(is_same)).then_some(first)
}

/// All points as pairs of a chunk and an index, or of more than `SAMPLE_POINTS` those whose positions have the smallest
/// hashes. So a further point takes the place of one other at most, in whatever order the points come. Points in one small
/// cell of space then count once, unless they are at one place and follow one another.
fn spread_indices<'a>(chunks: impl Iterator<Item = &'a Chunk>) -> Vec<(&'a Chunk, usize)> {
    let mut total = 0;
    let parts: Vec<(u64, &Chunk)> = chunks
        .map(|chunk| {
            let start = total;
            total += chunk.len() as u64;
            (start, chunk)
        })
        .collect();
    if total <= SAMPLE_POINTS as u64 {
        return parts.iter().flat_map(|(_, chunk)| (0..chunk.len()).map(move |index| (*chunk, index))).collect();
    }
    let per_unit = 1.0 / width_of_cell(&parts);
    let mut share = 1.5 * SAMPLE_POINTS as f64 / total as f64;
    loop {
        let most = if share < 1.0 { (share * u64::MAX as f64) as u64 } else { u64::MAX };
        let draw = |(start, chunk): &(u64, &'a Chunk)| {
            let (chunk, start) = (*chunk, *start);
            let mut before = None;
            let mut drawn = Vec::new();
            for (index, offset) in chunk.positions.iter().enumerate() {
                let place = chunk.position(index) * per_unit;
                let key = hash(cell(place.x) ^ hash(cell(place.y) ^ hash(cell(place.z))));
                let is_repeated = before.replace(offset) == Some(offset);
                let key = if is_repeated { hash(key ^ hash(start + index as u64)) } else { key };
                if key <= most {
                    drawn.push((key, chunk, index));
                }
            }
            drawn
        };
        let mut found: Vec<(u64, &Chunk, usize)> = parts.par_iter().flat_map_iter(draw).collect();
        // Of points in one cell the one with the least coordinates stays, whichever comes first.
        let order = |place: DVec3| place.to_array().map(|value| (value + 0.0).to_bits());
        found.par_sort_by(|(key, chunk, index), (other_key, other, at)| {
            key.cmp(other_key).then_with(|| order(chunk.position(*index)).cmp(&order(other.position(*at))))
        });
        found.dedup_by_key(|(key, ..)| *key);
        if found.len() >= SAMPLE_POINTS || most == u64::MAX {
            return found.into_iter().take(SAMPLE_POINTS).map(|(_, chunk, index)| (chunk, index)).collect();
        }
        share *= 4.0;
    }
}

/// The number of the cell of width 1 that a coordinate is in. `f64::floor` is a call into the C library on most processors.
#[inline(always)]
fn cell(coordinate: f64) -> u64 {
    let towards_zero = coordinate as i64;
    let is_above = towards_zero as f64 > coordinate;
    (if is_above { towards_zero.saturating_sub(1) } else { towards_zero }) as u64
}

/// The number of points of a chunk that tell how far most lie from its origin.
const REACH_POINTS: usize = 99;

/// The width of the cells of which each gives one point: a small part of most chunks, far above the rounding of their
/// positions. A power of two of few values, so that it stays where the points change.
fn width_of_cell(parts: &[(u64, &Chunk)]) -> f64 {
    let reach = |chunk: &Chunk| {
        let some = chunk.positions.iter().step_by(chunk.len().div_ceil(REACH_POINTS).max(1));
        let far = some.map(|position| f64::from(Vec3::from(*position).abs().max_element()));
        ranked(far.map(|far| (far, 1)).collect(), 0.9)
    };
    let reaches =
        parts.iter().filter_map(|(_, chunk)| Some((reach(chunk)?, chunk.len()))).filter(|(far, _)| *far > 0.0);
    let reach = ranked(reaches.collect(), 0.5);
    reach.map_or(1.0, |reach| (3.0 * (reach.log2() / 3.0).floor() - 10.0).exp2())
}

/// Of values with weights, the one below which this share of the weight lies; values that are not finite do not count.
fn ranked(mut values: Vec<(f64, usize)>, share: f64) -> Option<f64> {
    values.retain(|(value, _)| value.is_finite());
    values.sort_unstable_by(|(a, _), (b, _)| a.total_cmp(b));
    let mut left = share * values.iter().map(|(_, weight)| *weight as f64).sum::<f64>();
    let is_beyond = |(_, weight): &&(f64, usize)| {
        left -= *weight as f64;
        left < 0.0
    };
    values.iter().find(is_beyond).map(|(value, _)| *value)
}

/// Up to 100 thousand world positions, spread evenly over the points, without those that are not finite. They are the
/// same in every call, and nearly the same for nearly the same points.
pub fn spread_sample(chunks: &[Chunk]) -> impl Iterator<Item = DVec3> {
    let indices = spread_indices(chunks.iter()).into_iter();
    indices.map(|(chunk, index)| chunk.position(index)).filter(|position| position.is_finite())
}

/// The box beyond which points are strays of a scene, whose light, shadow maps and thresholds they shall not change.
/// `sample` are positions with the number of points that each stands for. `None` if too few are known to call any stray.
///
/// As for `robust_bounds`, a point is no stray if it lies within the width of the middle 98 % of the points, and a tenth,
/// of these; and neither is one that lies as near to such points. So the box holds the thin far end of a hall whose
/// scanner stands at the other end, and no point beyond a gap as wide as all the rest.
pub fn scene_fence(mut sample: Vec<(DVec3, f64)>) -> Option<Bounds> {
    sample.retain(|(position, _)| position.is_finite());
    if sample.len() < FEWEST {
        return None;
    }
    let trimmed = (STRAY * sample.iter().map(|(_, weight)| weight).sum::<f64>()).max(1.0);
    let mut core = Bounds::EMPTY;
    for axis in 0..3 {
        sample.sort_unstable_by(|(a, _), (b, _)| a[axis].total_cmp(&b[axis]));
        let end = |from_low: bool| {
            let mut left = trimmed;
            let mut is_trimmed = |weight: f64| {
                left -= weight;
                left >= 0.0
            };
            let mut points = sample.iter();
            let mut next = || if from_low { points.next() } else { points.next_back() };
            let kept = std::iter::from_fn(&mut next).find(|(_, weight)| !is_trimmed(*weight));
            kept.map_or(0.0, |(position, _)| position[axis])
        };
        (core.min[axis], core.max[axis]) = (end(true), end(false));
    }
    loop {
        let fence = fence_about(core);
        let mut grown = core;
        sample
            .iter()
            .filter(|(position, _)| fence.contains(*position))
            .for_each(|(position, _)| grown.include(*position));
        if grown == core {
            return Some(fence);
        }
        core = grown;
    }
}

/// The box within whose sides points are no strays of those in the middle.
fn fence_about(core: Bounds) -> Bounds {
    let margin = core.size() + 0.1 * core.size().max_element();
    Bounds { min: core.min - margin, max: core.max + margin }
}

/// The bounds of a cloud without its stray points; the full bounds if it has none.
///
/// A point is stray if it lies, along some axis, beyond the middle 98 % of the points by more than the width of these
/// plus a tenth of the cloud's: terrain keeps its towers, a room keeps the view through its windows, and points that
/// stay wrongly make a framed picture at most three times too wide. Less than 1 % of the points can be stray.
pub fn robust_bounds(chunks: &[Chunk]) -> Bounds {
    bounds_of_sampled(chunks, spread_sample(chunks).collect())
}

/// The bounds of a cloud without its stray points. `sample` are those of `spread_sample`.
pub(crate) fn bounds_of_sampled(chunks: &[Chunk], mut sample: Vec<DVec3>) -> Bounds {
    let boxes: Vec<Bounds> = chunks.par_iter().map(Chunk::bounds).collect();
    let full = boxes.iter().fold(Bounds::EMPTY, |all, bounds| all.union(*bounds));
    if sample.len() < FEWEST {
        return full;
    }
    let trimmed = ((sample.len() as f64 * STRAY) as usize).max(1);
    let last = sample.len() - 1;
    let mut core = Bounds::EMPTY;
    for axis in 0..3 {
        let by_axis = |a: &DVec3, b: &DVec3| a[axis].total_cmp(&b[axis]);
        core.min[axis] = sample.select_nth_unstable_by(trimmed, by_axis).1[axis];
        core.max[axis] = sample.select_nth_unstable_by(last - trimmed, by_axis).1[axis];
    }
    let fence = fence_about(core);
    if fence.contains(full.min) && fence.contains(full.max) {
        return full;
    }
    let inside = chunks.par_iter().zip(&boxes).map(|(chunk, bounds)| {
        if bounds.is_empty() || fence.contains(bounds.min) && fence.contains(bounds.max) {
            return *bounds;
        }
        let mut kept = Bounds::EMPTY;
        (0..chunk.len()).map(|i| chunk.position(i)).filter(|p| fence.contains(*p)).for_each(|p| kept.include(p));
        kept
    });
    inside.reduce(|| Bounds::EMPTY, Bounds::union)
}

/// The least and greatest of some values without stray ones, for an axis of a chart. A value is stray if it lies beyond
/// the middle 98 % of the values by more than their width and `margin`. `None` if no value is finite.
pub fn robust_range(values: impl Iterator<Item = f64>, margin: f64) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_unstable_by(f64::total_cmp);
    let full = (*values.first()?, *values.last()?);
    if values.len() < FEWEST {
        return Some(full);
    }
    let trimmed = ((values.len() as f64 * STRAY) as usize).max(1);
    let (low, high) = (values[trimmed], values[values.len() - 1 - trimmed]);
    let margin = margin + (high - low);
    let inside = || values.iter().copied().filter(|value| (low - margin..=high + margin).contains(value));
    inside().next().zip(inside().next_back())
}

/// The number of directions of an outline: a point that sticks out between two of them is missed by a hundredth of the
/// size.
const OUTLINE_DIRECTIONS: u64 = 256;

/// The bounds of a cloud without its stray points, and the outermost of the other points in a few hundred directions,
/// which stand for the whole cloud when it is framed. They are taken from a sample of 100 thousand points, and none for a
/// cloud without points.
pub fn robust_extent(chunks: &[Chunk]) -> (Bounds, Vec<DVec3>) {
    let sample: Vec<DVec3> = spread_sample(chunks).collect();
    let fence = bounds_of_sampled(chunks, sample.clone());
    let center = fence.center();
    // In units of the box, so that flat clouds have an outline from every side.
    let size = fence.size().max(DVec3::splat(f64::MIN_POSITIVE));
    let inside = sample.into_iter().filter(|point| fence.contains(*point));
    let sample: Vec<DVec3> = inside.map(|point| (point - center) / size).collect();
    let extreme = |i: u64| {
        // Fibonacci's spiral over the sphere.
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / OUTLINE_DIRECTIONS as f64;
        let (sine, cosine) = (i as f64 * 2.399_963_229_728_653).sin_cos();
        let direction = DVec3::new(cosine * (1.0 - z * z).sqrt(), sine * (1.0 - z * z).sqrt(), z);
        // The last of the farthest points, with one product for each.
        let farthest = |best: Option<(f64, DVec3)>, point: &DVec3| {
            let distance = point.dot(direction);
            let is_nearer = best.is_some_and(|(most, _)| distance.total_cmp(&most).is_lt());
            if is_nearer { best } else { Some((distance, *point)) }
        };
        sample.iter().fold(None, farthest).map(|(_, point)| point)
    };
    let outline = (0..OUTLINE_DIRECTIONS).into_par_iter().filter_map(extreme).map(|point| point * size + center);
    (fence, outline.collect())
}

/// The values below which the shares `low` and `high` (0 ..= 1) of the points lie, from a sample of 100 thousand
/// points. `None` if no value is finite; both are equal for a constant. `(0.0, 1.0)` does not give the full range of a
/// large cloud.
pub fn percentile_range(chunks: &[Chunk], scalar: Scalar, low: f64, high: f64) -> Option<(f64, f64)> {
    let mut values: Vec<f64> = spread_indices(chunks.iter().filter(|chunk| scalar.is_in(chunk)))
        .into_iter()
        .map(|(chunk, index)| scalar.value(chunk, index))
        .filter(|value| value.is_finite())
        .collect();
    let last = values.len().checked_sub(1)?;
    let mut at = |share: f64| {
        let rank = (share.clamp(0.0, 1.0) * last as f64).round() as usize;
        *values.select_nth_unstable_by(rank, f64::total_cmp).1
    };
    Some((at(low), at(high)))
}

/// The least and the greatest finite value of all points; `None` if there are none.
pub fn value_range(chunks: &[Chunk], scalar: Scalar) -> Option<(f64, f64)> {
    let of_chunk = |chunk: &Chunk| {
        let values = (0..chunk.len()).map(|index| scalar.value(chunk, index)).filter(|value| value.is_finite());
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    };
    let widest = |a: (f64, f64), b: (f64, f64)| (a.0.min(b.0), a.1.max(b.1));
    let all = chunks.par_iter().filter(|chunk| scalar.is_in(chunk)).map(of_chunk);
    let (low, high) = all.reduce(|| (f64::INFINITY, f64::NEG_INFINITY), widest);
    (low <= high).then_some((low, high))
}

/// The number of points whose value is in each of `bins` equal steps from `low` to `high` inclusive. Values outside and
/// NaN are not counted; a range of one value puts that value in the first bin.
pub fn histogram(chunks: &[Chunk], scalar: Scalar, (low, high): (f64, f64), bins: usize) -> Vec<u32> {
    let count = |chunk: &Chunk| {
        let mut counts = vec![0; bins];
        if bins == 0 || !scalar.is_in(chunk) {
            return counts;
        }
        let scale = if high > low { bins as f64 / (high - low) } else { 0.0 };
        for value in (0..chunk.len()).map(|index| scalar.value(chunk, index)) {
            if value >= low && value <= high {
                counts[(((value - low) * scale) as usize).min(bins - 1)] += 1;
            }
        }
        counts
    };
    let add = |mut a: Vec<u32>, b: Vec<u32>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        a
    };
    chunks.par_iter().map(count).reduce(|| vec![0; bins], add)
}

#[cfg(test)]
mod outline_tests {
    use super::*;

    #[test]
    fn cells_are_numbered_by_the_largest_whole_number_below() {
        let whole = [0.0, 1.0, 7.0, 1e6, 4e15, 1e18, 9e18, 1e19, 1e300, f64::INFINITY];
        let between = [0.25, 0.5, 1.0 - f64::EPSILON, 3.75, 65_535.5, 4e15 + 0.5, f64::MIN_POSITIVE];
        for coordinate in whole.into_iter().chain(between).flat_map(|value| [value, -value]).chain([f64::NAN]) {
            assert_eq!(cell(coordinate), coordinate.floor() as i64 as u64, "{coordinate}");
        }
    }

    #[test]
    fn a_range_holds_what_sticks_out_and_not_what_is_stray() {
        let slope = || (0..500).map(|at| f64::from(at) * 0.01);
        let heights = |more: &[f64]| robust_range(slope().chain(more.iter().copied()), 20.0);
        assert_eq!(heights(&[]), Some((0.0, 4.99)));
        assert_eq!(heights(&[19.0]), Some((0.0, 19.0)));
        assert_eq!(heights(&[-5e6, f64::NAN, f64::INFINITY, 1e9]), Some((0.0, 4.99)));
        assert_eq!(robust_range([3.0, 1.0, 900.0].into_iter(), 0.0), Some((1.0, 900.0)));
        assert_eq!(robust_range(std::iter::repeat_n(4.0, 500).chain([5.0, 700.0]), 20.0), Some((4.0, 5.0)));
        assert_eq!(robust_range(std::iter::once(f64::NAN), 1.0), None);
    }

    #[test]
    fn an_outline_holds_what_sticks_out_and_not_what_is_stray() {
        let mut positions: Vec<[f32; 3]> = (0..5000)
            .map(|i| {
                let unit = |k: u64| hash(i * 3 + k) as f64 / u64::MAX as f64 * 2.0 - 1.0;
                let direction = DVec3::new(unit(0), unit(1), unit(2)).normalize();
                (direction * DVec3::new(4.0, 2.0, 1.0)).as_vec3().to_array()
            })
            .collect();
        positions.push([900.0, 0.0, 0.0]);
        let (_, outline) = robust_extent(&[Chunk::new(0, DVec3::new(1e6, 0.0, 0.0), positions)]);
        let reach = |axis: DVec3| outline.iter().map(|point| (*point - DVec3::X * 1e6).dot(axis)).fold(0.0, f64::max);
        for (axis, size) in [(DVec3::X, 4.0), (-DVec3::X, 4.0), (DVec3::Y, 2.0), (DVec3::Z, 1.0)] {
            assert!((reach(axis) / size - 1.0).abs() < 0.02, "{axis}: {}", reach(axis));
        }
        assert!(robust_extent(&[]).1.is_empty());
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::Column;

    /// A bumpy square 100 wide at coordinates of seven digits, in chunks of a thousand.
    fn terrain(points: u64) -> Vec<Chunk> {
        let unit = |i: u64| hash(i) as f64 / u64::MAX as f64;
        let position = |i: u64| {
            let (x, y) = (unit(3 * i), unit(3 * i + 1));
            [100.0 * x as f32, 100.0 * y as f32, (5.0 * (x * 9.0).sin() * (y * 7.0).cos()) as f32]
        };
        let origin = DVec3::new(631_000.0, 5_077_000.0, 120.0);
        (0..points.div_ceil(1000))
            .map(|c| Chunk::new(c * 1000, origin, (c * 1000..(c * 1000 + 1000).min(points)).map(position).collect()))
            .collect()
    }

    fn full_bounds(chunks: &[Chunk]) -> Bounds {
        chunks.iter().fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()))
    }

    #[test]
    fn bounds_without_stray_points_are_the_full_bounds() {
        for points in [0, 1, 5, 40, 1000, 250_000] {
            let chunks = terrain(points);
            assert_eq!(robust_bounds(&chunks), full_bounds(&chunks), "{points} points");
        }
    }

    #[test]
    fn a_thousandth_of_stray_points_does_not_move_the_bounds() {
        for (points, stray) in [(40, 1), (20_000, 20), (250_000, 250)] {
            let mut chunks = terrain(points);
            let clean = full_bounds(&chunks);
            let far = |i: u64| {
                let direction = hash(i) as f32 / u64::MAX as f32 - 0.5;
                [1e6 * direction + 2e6, -3e5, 4e4 * direction - 5e5]
            };
            chunks.push(Chunk::new(points, DVec3::new(631_000.0, 5_077_000.0, 0.0), (0..stray).map(far).collect()));
            let robust = robust_bounds(&chunks);
            assert_eq!(robust, clean, "{stray} of {points}");
        }
    }

    fn places(chunks: &[Chunk]) -> std::collections::HashSet<[u64; 3]> {
        spread_sample(chunks).map(|place| place.to_array().map(f64::to_bits)).collect()
    }

    /// The points of some chunks in other chunks, from another first point on.
    fn shifted(chunks: &[Chunk], first: usize, size: usize) -> Vec<Chunk> {
        let mut all: Vec<DVec3> =
            chunks.iter().flat_map(|chunk| (0..chunk.len()).map(|index| chunk.position(index))).collect();
        let start = all.len() - first;
        all.rotate_right(start);
        all.chunks(size).map(|places| Chunk::of_places(0, places)).collect()
    }

    #[test]
    fn one_point_more_changes_one_point_of_the_sample_wherever_it_lies() {
        let chunks = terrain(250_000);
        let before = places(&chunks);
        assert_eq!(before.len(), SAMPLE_POINTS);
        let near = chunks[7].position(3);
        let far = |sizes: f64| near + DVec3::new(0.6, -0.7, 0.4) * 100.0 * sizes;
        for place in [near, near + DVec3::new(0.003, 0.0, 0.0), far(10.0), far(100.0), far(1000.0)] {
            let mut more = chunks.clone();
            more.push(Chunk::of_places(250_000, &[place]));
            assert!(before.difference(&places(&more)).count() <= 1, "{place}");
            // As the first point of the file.
            more.rotate_right(1);
            assert!(before.difference(&places(&more)).count() <= 1, "{place} first");
        }
    }

    #[test]
    fn a_sample_does_not_depend_on_the_order_and_hardly_on_the_chunks_of_the_points() {
        let chunks = shifted(&terrain(250_000), 0, 1000);
        let before = places(&chunks);
        let mut turned = chunks.clone();
        turned.reverse();
        assert!(places(&turned) == before);
        // Other origins round positions otherwise.
        let near = |place: &DVec3| (place * 1024.0).round().to_array().map(|value| value as i64);
        let rounded = |chunks: &[Chunk]| -> std::collections::HashSet<[i64; 3]> {
            spread_sample(chunks).map(|place| near(&place)).collect()
        };
        let other = rounded(&shifted(&chunks, 123_457, 1000));
        let differing = rounded(&chunks).difference(&other).count();
        assert!(differing < SAMPLE_POINTS / 20, "{differing}");
    }

    #[test]
    fn points_at_one_place_fill_no_sample() {
        let mut chunks = terrain(250_000);
        for chunk in &mut chunks {
            let mut positions = chunk.positions.to_vec();
            positions.iter_mut().step_by(2).for_each(|position| *position = [0.0; 3]);
            chunk.positions = Arc::new(positions);
        }
        let found: Vec<DVec3> = spread_sample(&chunks).collect();
        let at_origin = found.iter().filter(|place| **place == chunks[0].origin).count();
        assert!(found.len() == SAMPLE_POINTS && at_origin <= 1, "{at_origin} of {}", found.len());
    }

    #[test]
    fn the_fence_of_a_scene_holds_its_thin_far_end_and_no_far_point() {
        // A hall whose points get fewer with the square of the distance from the scanner, 1 to 60 away.
        let place = |i: u64| {
            let unit = |k: u64| hash(3 * i + k) as f64 / u64::MAX as f64;
            DVec3::new(1.0 / (1.0 - unit(0) * (1.0 - 1.0 / 60.0)), 6.0 * unit(1), 3.0 * unit(2))
        };
        let hall: Vec<(DVec3, f64)> = (0..5000).map(|i| (place(i), 20.0)).collect();
        let far = hall.iter().map(|(place, _)| place.x).fold(0.0, f64::max);
        let clean = scene_fence(hall.clone()).unwrap();
        assert!(clean.max.x > far && far > 50.0, "{clean:?}");
        for sizes in [10.0, 100.0, 1000.0] {
            let mut strayed = hall.clone();
            strayed.push((DVec3::new(0.6, -0.5, 0.6) * 60.0 * sizes, 1.0));
            let fence = scene_fence(strayed).unwrap();
            assert!((fence.max - clean.max).abs().max_element() < 1e-3 * far, "{fence:?}");
        }
        assert_eq!(scene_fence(hall[..15].to_vec()), None);
        let few = |far: f64| (0..40).map(|i| (DVec3::splat(f64::from(i)), 1.0)).chain([(DVec3::splat(far), 1.0)]);
        assert_eq!(scene_fence(few(1e6).collect()), scene_fence(few(1e4).collect()));
    }

    #[test]
    fn points_that_are_not_finite_and_flat_clouds_have_robust_bounds() {
        let mut positions = vec![[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0]];
        positions.extend((0..1000).map(|i| [i as f32, 0.0, 7.0]));
        let bounds = robust_bounds(&[Chunk::new(0, DVec3::ZERO, positions)]);
        assert_eq!(bounds, Bounds { min: DVec3::new(0.0, 0.0, 7.0), max: DVec3::new(999.0, 0.0, 7.0) });
        assert!(robust_bounds(&[Chunk::new(0, DVec3::ZERO, vec![[f32::NAN; 3]; 100])]).is_empty());
    }

    fn with_column(values: Vec<f32>) -> Vec<Chunk> {
        let chunk = |values: &[f32]| Chunk {
            columns: vec![None, Some(Arc::new(Column::F32(values.to_vec())))],
            ..Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; values.len()])
        };
        values.chunks(777).map(chunk).collect()
    }

    #[test]
    fn percentiles_of_a_column_ignore_nan_and_stray_values() {
        let mut values: Vec<f32> = (0..500_000).map(|i| (hash(i) % 1000) as f32).collect();
        values.extend([f32::NAN; 1000]);
        values.extend([1e30, -1e30, f32::INFINITY]);
        let (low, high) = percentile_range(&with_column(values), Scalar::Column(1), 0.02, 0.98).unwrap();
        assert!((low - 20.0).abs() < 3.0 && (high - 980.0).abs() < 3.0, "{low} to {high}");
    }

    #[test]
    fn percentiles_of_constant_missing_and_nan_columns_are_defined() {
        assert_eq!(percentile_range(&with_column(vec![4.0; 5000]), Scalar::Column(1), 0.01, 0.99), Some((4.0, 4.0)));
        assert_eq!(percentile_range(&with_column(vec![f32::NAN; 9]), Scalar::Column(1), 0.01, 0.99), None);
        assert_eq!(percentile_range(&with_column(vec![4.0; 50]), Scalar::Column(0), 0.0, 1.0), None);
        assert_eq!(percentile_range(&with_column(vec![4.0; 50]), Scalar::Column(9), 0.0, 1.0), None);
        assert_eq!(percentile_range(&[], Scalar::Axis(2), 0.0, 1.0), None);
    }

    #[test]
    fn height_percentiles_are_world_coordinates() {
        let (low, high) = percentile_range(&terrain(250_000), Scalar::Axis(1), 0.1, 0.9).unwrap();
        assert!((low - 5_077_010.0).abs() < 1.0 && (high - 5_077_090.0).abs() < 1.0, "{low} to {high}");
    }

    #[test]
    fn histogram_counts_every_value_in_range_once() {
        let mut values: Vec<f32> = (0..10_000).map(|i| (i % 10) as f32).collect();
        values.extend([f32::NAN, -1.0, 10.0]);
        let chunks = with_column(values);
        assert_eq!(histogram(&chunks, Scalar::Column(1), (0.0, 9.0), 10), [1000; 10]);
        assert_eq!(histogram(&chunks, Scalar::Column(1), (0.0, 9.0), 3), [3000, 3000, 4000]);
        assert_eq!(histogram(&chunks, Scalar::Column(1), (3.0, 3.0), 4), [1000, 0, 0, 0]);
        assert_eq!(histogram(&chunks, Scalar::Column(0), (0.0, 9.0), 2), [0, 0]);
        assert_eq!(histogram(&chunks, Scalar::Column(1), (0.0, 9.0), 0), [0; 0]);
    }
}
