//! How sure a surface is: for each disc the half width of an interval for its error.
//!
//! The interval says where a further measurement along a sightline finds the surface, if the sightline meets this
//! surface at all, in 95 of 100 cases. Its half width along the disc's normal is `WIDTHS` times
//! sqrt(`OF_PLANE` p^2 + (1 - `OF_PLANE`) (a^2 + n^2)), where p is how far the neighbours lie off the disc's plane, a how
//! far the disc's own middle is off the quadric through the neighbours, and n how far the neighbours are off that quadric
//! (all root mean squares). The quadric follows a bent surface, so that a smooth one is not taken for noise. The plane has
//! a part in it because noise that neighbours share bends the quadric along. Along a sightline the half width is longer
//! by 1 / cos(incidence). Both constants are calibrated by sightlines that were held out (docs/study/surfaces.md).
//!
//! A further measurement has noise of its own. The error of a point itself is estimated from its neighbours alone: the
//! formula without a, and with p about the mean of the neighbours. A point that is off the quadric by more than chance does is off
//! by that distance, too.

use glam::{DMat4, DVec3, DVec4};
use rayon::prelude::*;

use crate::neighbours::{Points, Surroundings, Tiles};
use crate::surfels::parts;
use crate::{Chunk, Progress, unpack_normal};

/// The share of sightlines whose error the interval holds.
pub const STATED: f64 = 0.95;
/// The number of neighbours that give a disc's error, as many as make its normal.
const NEIGHBOURS: usize = 16;
/// The half width of the interval in root mean squares: a normal deviate would ask for 1.96 if these were exact.
const WIDTHS: f64 = 2.2;
/// The part of the plane in the variance; the rest is that of the quadric.
const OF_PLANE: f64 = 0.2;
/// A point that is off its neighbours' quadric by more half widths than this does not belong to their surface.
const OUTLYING: f64 = 2.0;
/// What the packing of normals and positions leaves uncertain, in radii of the neighbourhood.
const PACKED: f64 = 5e-5;
/// What is added to the diagonal of normal equations in units of the neighbourhood: for neighbours on a line, the quadric
/// is a constant across it.
const RIDGE: f64 = 1e-6;

/// Half widths of the intervals at a point along a normal, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfWidths {
    /// For a further measurement of the surface.
    pub further: f64,
    /// For the error of the point itself.
    pub point: f64,
}

/// For each point the half width of the interval for the error of its disc along its normal, in world units; one list per
/// chunk. Not a number for points without a normal or without two others. `progress` counts points; `None` when
/// cancelled.
///
/// Needs about 14 bytes a point beside the result while it runs.
pub fn surface_errors(chunks: &[Chunk], progress: &Progress) -> Option<Vec<Vec<f32>>> {
    let mut errors: Vec<Vec<f32>> = chunks.iter().map(|chunk| vec![f32::NAN; chunk.len()]).collect();
    let mut first = 0;
    for part in parts(chunks, u32::MAX as usize) {
        let points = Points::new(part);
        let tiles = Tiles::new(&points, progress)?;
        let found: Vec<Vec<(u32, f32)>> =
            (0..tiles.len()).into_par_iter().map(|tile| errors_of(part, &points, &tiles, tile, progress)).collect();
        if progress.is_cancelled() {
            return None;
        }
        for (index, error) in found.into_iter().flatten() {
            let (chunk, local) = points.locate(index);
            errors[first + chunk][local] = error;
        }
        first += part.len();
    }
    Some(errors)
}

/// The half widths at a point, along the unit normal of its disc, by the offsets of the nearest other points: some 16.
/// Not numbers for fewer than two.
pub fn half_widths(offsets: &[DVec3], normal: DVec3) -> HalfWidths {
    let reach = offsets.iter().map(|offset| offset.length()).fold(0.0, f64::max);
    within_reach(offsets.iter().copied(), reach, normal)
}

/// The half width of the interval along a sightline in the direction of a unit vector, from that along the unit normal.
pub fn error_along(half_width: f64, normal: DVec3, direction: DVec3) -> f64 {
    half_width / normal.dot(direction).abs()
}

/// The points of a tile that have a normal, by their running indices, with their half widths.
fn errors_of(chunks: &[Chunk], points: &Points, tiles: &Tiles, tile: usize, progress: &Progress) -> Vec<(u32, f32)> {
    let mut errors = Vec::with_capacity(tiles.points_of(tile));
    let visit = |index: u32, surroundings: &mut Surroundings<'_, '_, NEIGHBOURS>| {
        let (chunk, local) = points.locate(index);
        let normal = chunks[chunk].normals.as_ref().and_then(|normals| unpack_normal(normals[local]));
        if let Some(normal) = normal {
            let around = surroundings.neighbourhood();
            let (offsets, reach) = (around.offsets().map(|offset| offset.as_dvec3()), around.distance_squared.sqrt());
            errors.push((index, within_reach(offsets, f64::from(reach), normal.as_dvec3()).further as f32));
        }
    };
    tiles.search::<NEIGHBOURS>(tile, NEIGHBOURS, visit, progress);
    progress.add(tiles.points_of(tile) as u64);
    errors
}

/// By the offsets of neighbours no farther than `reach`.
fn within_reach(offsets: impl Iterator<Item = DVec3>, reach: f64, normal: DVec3) -> HalfWidths {
    let across = normal.any_orthonormal_vector();
    let along = normal.cross(across);
    // The normal equations of 1, x^2, x y, y^2 in the plane, in units of the reach.
    let (mut matrix, mut sums, mut squares) = (DMat4::IDENTITY * RIDGE, DVec4::ZERO, 0.0);
    let mut count = 0.0;
    for offset in offsets {
        let offset = offset / reach;
        count += 1.0;
        let (x, y, off) = (offset.dot(across), offset.dot(along), offset.dot(normal));
        let row = DVec4::new(1.0, x * x, x * y, y * y);
        matrix += DMat4::from_cols(row * row.x, row * row.y, row * row.z, row * row.w);
        sums += row * off;
        squares += off * off;
    }
    let plane = squares / count;
    let quadric = matrix.inverse() * sums;
    let free = count - 4.0;
    // Squares of how far the middle is off, and of how far the neighbours are.
    let (middle, bent) = if free > 0.0 && quadric.is_finite() {
        (quadric.x * quadric.x, (squares - quadric.dot(sums)).max(0.0) / free)
    } else {
        (0.0, plane)
    };
    let width = |plane: f64, bent: f64| {
        let variance = OF_PLANE * plane + (1.0 - OF_PLANE) * bent;
        WIDTHS * (variance + PACKED * PACKED).sqrt() * reach
    };
    // The first of the sums is that of the neighbours' distances off the plane.
    let (point, off) = (width(plane - (sums.x / count).powi(2), bent), middle.sqrt() * reach);
    let point = if off > OUTLYING * point { point + off } else { point };
    if count < 2.0 {
        return HalfWidths { further: f64::NAN, point: f64::NAN };
    }
    HalfWidths { further: width(plane, middle + bent), point }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::{Orientation, Random, SurfelOptions, estimate};
    use glam::Vec3;

    /// A number from 0 to 1.
    fn unit(random: &mut Random) -> f64 {
        (random.draw() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Points at random a unit apart on a surface of this height, with the normals that follow from them.
    fn scan(height: impl Fn(f64, f64, &mut Random) -> f64) -> Vec<Chunk> {
        let mut random = Random(7);
        let side = 140.0;
        let mut point = |_| {
            let [x, y] = [0; 2].map(|_| unit(&mut random) * side - side / 2.0);
            DVec3::new(x, y, height(x, y, &mut random)).as_vec3().to_array()
        };
        let positions: Vec<[f32; 3]> = (0..(side * side) as u32).map(&mut point).collect();
        let parts = positions.chunks(7000).enumerate();
        let mut chunks: Vec<Chunk> =
            parts.map(|(at, part)| Chunk::new(7000 * at as u64, DVec3::ZERO, part.to_vec())).collect();
        let options = SurfelOptions::new(Orientation::Up(Vec3::Z));
        let estimated = estimate(&chunks, &options, &Progress::default()).unwrap();
        for (chunk, surfels) in chunks.iter_mut().zip(estimated) {
            chunk.normals = Some(Arc::new(surfels.normals));
        }
        chunks
    }

    fn deviate(random: &mut Random) -> f64 {
        (-2.0 * (1.0 - unit(random)).ln()).sqrt() * (std::f64::consts::TAU * unit(random)).cos()
    }

    /// The half widths of points inside, in order.
    fn sorted(chunks: &[Chunk]) -> Vec<f64> {
        let errors = surface_errors(chunks, &Progress::default()).unwrap();
        let inside = chunks.iter().zip(errors).flat_map(|(chunk, errors)| {
            let is_inside = |at: &usize| chunk.position(*at).truncate().abs().max_element() < 60.0;
            (0..chunk.len()).filter(is_inside).map(|at| f64::from(errors[at])).collect::<Vec<_>>()
        });
        let mut sorted: Vec<f64> = inside.collect();
        sorted.sort_by(f64::total_cmp);
        sorted
    }

    #[test]
    fn half_widths_are_in_proportion_to_noise_and_not_to_spacing() {
        for noise in [0.02, 0.1] {
            let found = sorted(&scan(|_, _, random| noise * deviate(random)));
            let middle = found[found.len() / 2] / noise;
            // A disc is off by the noise, and so is what is measured: 1.96 times the root of two, where neighbours give it.
            assert!((2.4..3.4).contains(&middle), "{middle} of a noise of {noise}");
        }
    }

    #[test]
    fn the_half_width_of_a_point_is_that_of_its_neighbours_unless_it_is_off_their_surface() {
        let mut random = Random(3);
        let (noise, count) = (0.01, 4000);
        let mut widths = Vec::new();
        let mut held = 0;
        for _ in 0..count {
            let own = noise * deviate(&mut random);
            let mut place = || unit(&mut random) * 4.0 - 2.0;
            let places: Vec<[f64; 2]> = (0..NEIGHBOURS).map(|_| [place(), place()]).collect();
            let mut around = |[x, y]: [f64; 2]| DVec3::new(x, y, noise * deviate(&mut random) - own);
            let offsets: Vec<DVec3> = places.into_iter().map(&mut around).collect();
            let found = half_widths(&offsets, DVec3::Z);
            assert!(found.point < found.further || found.point > 2.0 * OUTLYING * noise, "{found:?}");
            held += usize::from(own.abs() <= found.point);
            widths.push(found.point / noise);
            let off: Vec<DVec3> = offsets.iter().map(|offset| *offset + DVec3::Z).collect();
            assert!((0.9..1.3).contains(&half_widths(&off, DVec3::Z).point), "a point 1 off the plane");
        }
        widths.sort_by(f64::total_cmp);
        let held = held as f64 / f64::from(count);
        assert!((0.93..0.97).contains(&held) && (1.9..2.4).contains(&widths[widths.len() / 2]), "{held}, {widths:?}");
    }

    #[test]
    fn a_smooth_bend_is_no_noise() {
        // A radius of 320 spacings: from the plane alone it would be 2.2 times some 0.0046.
        let ball = sorted(&scan(|x, y, _| (80.0_f64 * 80.0 - 0.25 * (x * x + y * y)).sqrt()));
        let flat = sorted(&scan(|_, _, _| 0.0));
        let (ball, flat) = (ball[ball.len() / 2], flat[flat.len() / 2]);
        assert!(ball < 0.008 && flat < 0.001 && flat > 0.0, "{ball}, {flat}");
    }

    #[test]
    fn points_that_say_nothing_have_no_interval() {
        let bare = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0, 0.0, 0.0]]);
        let of = |chunk: Chunk| surface_errors(&[chunk], &Progress::default()).unwrap().remove(0);
        assert!(of(bare.clone()).iter().all(|error| error.is_nan()), "without normals");
        let up = crate::pack_normal(Vec3::Z);
        let two = Chunk { normals: Some(Arc::new(vec![up; 2])), ..bare };
        assert!(of(two).iter().all(|error| error.is_nan()), "of two points");
        assert!(surface_errors(&[], &Progress::default()).unwrap().is_empty());
    }

    #[test]
    fn intervals_are_longer_along_a_slanting_sightline() {
        let slanting = DVec3::new(0.0, 3.0_f64.sqrt() / 2.0, -0.5);
        assert!((error_along(0.1, DVec3::Z, slanting) - 0.2).abs() < 1e-12);
        assert_eq!(error_along(0.1, DVec3::Z, DVec3::X), f64::INFINITY);
    }
}
