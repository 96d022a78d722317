//! Clouds whose points were all seen from one place. Between that place and a point there is nothing, so a disc that
//! hides a point behind it is too large.

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use crate::{Chunk, Progress, Surfels, hash, pack_radius, spread_sample, unpack_normal, unpack_radius};

/// A point is behind a disc if it is further away than where its sightline meets the disc's plane, by this share of the
/// distance: nearer ones are of the same surface, as rough as it is measured.
const BEHIND: f32 = 0.01;
/// A disc that would hide a point ends at this share of the way to that point's sightline. The border of the surface is
/// somewhere on that way.
const WAY: f32 = 0.5;
/// Discs are made so much wider before: one that hides no point closes holes, and stands in free space nowhere that is
/// known.
const WIDER: f32 = 1.2;
/// The least share of a radius that is left.
const LEAST_LEFT: f32 = 0.2;
/// The most cells that a disc is searched in along an axis, to either side: larger discs are larger than any surface
/// that is sampled around them.
const MOST_CELLS: f32 = 4.0;

/// The most points that a disc is searched for: several times as many as there are in so many cells of a depth image.
/// In any other cloud a direction may have any number of points.
const MOST_SEARCHED: usize = 1 << 14;

/// The number of points by which a depth image is told, some of each cell of directions.
const PER_CELL: usize = 4;
/// In a depth image, this share of the points that are neighbours as seen from the origin are near to one another ...
const SAME_SURFACE: f64 = 0.9;
/// ... which is: their distances differ by less than this share of what those of any two points differ by.
const NEAR: f64 = 0.25;
/// Distances that differ by less tell nothing: the origin is far from the scan.
const LEAST_DEPTH: f64 = 0.02;
/// In a depth image, pixels are evenly spread: this share of the points is in cells with at most three times as many
/// points as the middle one.
const EVEN: f64 = 0.9;

/// Whether a cloud is a depth image: each direction from the origin meets one surface, and the points are spread evenly
/// over the directions.
pub fn is_depth_image(chunks: &[Chunk]) -> bool {
    let sample: Vec<DVec3> = spread_sample(chunks).filter(|point| point.length_squared() > 0.0).collect();
    if sample.len() < 100 {
        return false;
    }
    let cells = |fineness: f64| {
        let cell = |point: &DVec3| (point.normalize() * fineness).floor().as_ivec3().to_array();
        let mut placed: Vec<([i32; 3], f64)> = sample.iter().map(|point| (cell(point), point.length())).collect();
        placed.sort_by_key(|(cell, _)| *cell);
        placed
    };
    // As fine as a few points in each cell allow.
    let is_fine = |placed: &[([i32; 3], f64)]| placed.chunk_by(|a, b| a.0 == b.0).count() * PER_CELL > placed.len();
    let fineness = (0..24).map(|power| 2.0_f64.powi(power)).find(|fineness| is_fine(&cells(*fineness)));
    let Some(placed) = fineness.map(cells) else { return false };
    let apart = |a: f64, b: f64| (a - b).abs() / a.min(b);
    let near: Vec<f64> =
        placed.windows(2).filter(|two| two[0].0 == two[1].0).map(|two| apart(two[0].1, two[1].1)).collect();
    let mut any: Vec<f64> = (0..sample.len())
        .map(|index| {
            let other = hash(index as u64) as usize % sample.len();
            apart(sample[index].length(), sample[other].length())
        })
        .collect();
    let middle = any.len() / 2;
    let usual = *any.select_nth_unstable_by(middle, f64::total_cmp).1;
    let same = near.iter().filter(|apart| **apart < NEAR * usual).count();
    let mut counts: Vec<usize> = placed.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).collect();
    counts.sort_unstable();
    let most = 3 * counts[counts.len() / 2];
    let even: usize = counts.iter().filter(|count| **count <= most).sum();
    usual > LEAST_DEPTH && same as f64 >= SAME_SURFACE * near.len() as f64 && even as f64 >= EVEN * placed.len() as f64
}

/// The points by their direction from a place.
struct Directions {
    /// Cells of the space of unit vectors, and the points in each, relative to the place; in order.
    points: Vec<([i32; 3], Vec3)>,
    /// The number of cells in a length of 1.
    fineness: f32,
}

impl Directions {
    fn new(chunks: &[Chunk], place: DVec3, fineness: f32) -> Self {
        let located = chunks.par_iter().flat_map_iter(|chunk| {
            (0..chunk.len()).filter_map(move |index| {
                let way = (chunk.position(index) - place).as_vec3();
                Some((cell(way.try_normalize()?, fineness).to_array(), way))
            })
        });
        let mut points: Vec<([i32; 3], Vec3)> = located.collect();
        // The place breaks ties, so that the order does not depend on that of the chunks.
        points.par_sort_unstable_by_key(|(cell, way)| (*cell, way.to_array().map(f32::to_bits)));
        Self { points, fineness }
    }

    /// The points whose directions are in cells up to `steps` cells beside that of a direction, and maybe others; but
    /// no more than `MOST_SEARCHED`.
    fn near(&self, direction: Vec3, steps: i32) -> impl Iterator<Item = Vec3> {
        let middle = cell(direction, self.fineness);
        let rows = (-steps..=steps).flat_map(move |x| (-steps..=steps).map(move |y| middle + IVec3::new(x, y, -steps)));
        let ways = rows.flat_map(move |first| {
            let last = (first + IVec3::Z * (2 * steps)).to_array();
            let start = self.points.partition_point(|(cell, _)| *cell < first.to_array());
            self.points[start..].iter().take_while(move |(cell, _)| *cell <= last).map(|(_, way)| *way)
        });
        ways.take(MOST_SEARCHED)
    }
}

fn cell(direction: Vec3, fineness: f32) -> IVec3 {
    (direction * fineness).floor().as_ivec3()
}

/// Makes discs smaller that would hide other points from the place that all of them were seen from, and the others a
/// little wider. `None` when cancelled.
pub(crate) fn carve(chunks: &[Chunk], surfels: &mut [Surfels], place: DVec3, progress: &Progress) -> Option<()> {
    let points = || chunks.iter().zip(surfels.iter());
    let angle = |chunk: &Chunk, surfels: &Surfels, index: usize| {
        Some(unpack_radius(surfels.radii[index])? / (chunk.position(index) - place).as_vec3().length())
    };
    let mut angles: Vec<f32> = points()
        .flat_map(|(chunk, surfels)| (0..chunk.len()).step_by(64).filter_map(move |at| angle(chunk, surfels, at)))
        .filter(|angle| *angle > 0.0 && angle.is_finite())
        .collect();
    let middle = angles.len() / 2;
    if angles.is_empty() {
        return Some(());
    }
    let usual = *angles.select_nth_unstable_by(middle, f32::total_cmp).1;
    // A usual disc reaches into the cells beside its own.
    let directions = Directions::new(chunks, place, (0.5 / usual).clamp(1.0, 1e6));
    chunks.par_iter().zip(surfels).for_each(|(chunk, surfels)| {
        if progress.is_cancelled() {
            return;
        }
        for index in 0..chunk.len() {
            let way = (chunk.position(index) - place).as_vec3();
            let known = unpack_radius(surfels.radii[index]).zip(unpack_normal(surfels.normals[index]));
            let Some((radius, normal)) = known.map(|(radius, normal)| (WIDER * radius, normal)) else { continue };
            let nearest = nearest_hidden(&directions, way, radius, normal);
            let share = if nearest < radius { (WAY * nearest / radius).max(LEAST_LEFT) } else { 1.0 };
            surfels.radii[index] = pack_radius(radius * share);
        }
    });
    (!progress.is_cancelled()).then_some(())
}

/// How far from its middle a disc is met by the nearest of the sightlines that it hides; its radius if it hides none.
fn nearest_hidden(directions: &Directions, way: Vec3, radius: f32, normal: Vec3) -> f32 {
    let distance = way.length();
    let cells = (radius / (distance - radius).max(0.0) * directions.fineness).ceil();
    if !(cells >= 1.0 && distance.is_finite()) {
        return radius;
    }
    let behind = |other: Vec3| {
        // The sightline is in units of itself: 1 is the other point.
        let share = way.dot(normal) / other.dot(normal);
        let is_behind = share > 0.0 && share < 1.0 - BEHIND;
        if is_behind { (other * share - way).length() } else { f32::INFINITY }
    };
    directions.near(way / distance, cells.min(MOST_CELLS) as i32).map(behind).fold(radius, f32::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Orientation, RadiusRule, SurfelOptions, estimate};

    /// The edge of a wall 2 m away, left of x = 0, before another wall 3 m away. As seen from the origin the points are
    /// a grid, half a step aside from the edge.
    fn walls(step: f32) -> (Vec<Chunk>, Vec<bool>) {
        let count = (0.8 / step) as i32;
        let slope = |i: i32| (i as f32 + 0.5) * step;
        let mut positions = Vec::new();
        for (i, j) in (-count..count).flat_map(|i| (-count..count).map(move |j| (i, j))) {
            let depth = if i < 0 { 2.0 } else { 3.0 };
            positions.push([slope(i) * depth, slope(j) * depth, depth]);
        }
        let is_rim = positions.iter().map(|[x, y, z]| *z == 2.0 && *x > -2.0 * step && y.abs() < 1.0).collect();
        (positions.chunks(1000).map(|part| Chunk::new(0, DVec3::ZERO, part.to_vec())).collect(), is_rim)
    }

    fn radii(chunks: &[Chunk], seen_from: Option<DVec3>) -> Vec<f32> {
        let options = SurfelOptions {
            radii: RadiusRule::Full,
            seen_from,
            ..SurfelOptions::new(Orientation::Toward(DVec3::ZERO))
        };
        let surfels = estimate(chunks, &options, &Progress::default()).unwrap();
        surfels.iter().flat_map(|surfels| surfels.radii.iter().map(|radius| unpack_radius(*radius).unwrap())).collect()
    }

    #[test]
    fn discs_end_before_they_hide_a_point_that_was_seen() {
        let step = 0.02;
        let (chunks, is_rim) = walls(step);
        let (full, carved) = (radii(&chunks, None), radii(&chunks, Some(DVec3::ZERO)));
        assert_eq!(is_rim.iter().filter(|rim| **rim).count(), 50);
        for ((full, carved), is_rim) in full.iter().zip(&carved).zip(&is_rim) {
            // The rim is half a step before the edge, and the nearest sightline half a step behind it.
            let expected = WAY * 2.0 * step;
            assert!(!is_rim || *full > expected, "{full}");
            assert!(!is_rim || (carved / expected - 1.0).abs() < 0.01, "{carved} instead of {expected}");
            assert!(*carved <= WIDER * *full * 1.001);
        }
        // The wall behind hides nothing, and neither does the one before it further than a disc from its edge.
        let is_wider = |(full, carved): &(&f32, &f32)| (**carved / (WIDER * **full) - 1.0).abs() < 1e-3;
        let wider = full.iter().zip(&carved).filter(is_wider).count();
        assert!(wider > full.len() * 95 / 100, "{wider} of {}", full.len());
    }

    #[test]
    fn carving_does_not_depend_on_chunks_and_stops_when_it_is_cancelled() {
        let (chunks, _) = walls(0.02);
        let whole: Vec<[f32; 3]> = chunks.iter().flat_map(|chunk| chunk.positions.iter().copied()).collect();
        let whole = [Chunk::new(0, DVec3::ZERO, whole)];
        assert_eq!(radii(&whole, Some(DVec3::ZERO)), radii(&chunks, Some(DVec3::ZERO)));
        let progress = Progress::default();
        let mut surfels = estimate(&chunks, &SurfelOptions::new(Orientation::Up(Vec3::Z)), &progress).unwrap();
        progress.cancel();
        assert!(carve(&chunks, &mut surfels, DVec3::ZERO, &progress).is_none());
    }

    #[test]
    fn a_disc_is_searched_for_few_of_the_points_that_lie_in_one_direction() {
        let line = (0..MOST_SEARCHED * 3).map(|index| [0.0, 0.0, 1.0 + index as f32 * 1e-4]).collect();
        let directions = Directions::new(&[Chunk::new(0, DVec3::ZERO, line)], DVec3::ZERO, 100.0);
        assert_eq!(directions.near(Vec3::Z, 4).count(), MOST_SEARCHED);
        assert_eq!(directions.near(Vec3::X, 4).count(), 0);
    }

    #[test]
    fn only_an_even_picture_from_the_origin_is_a_depth_image() {
        let (chunks, _) = walls(0.01);
        assert!(is_depth_image(&chunks));
        // The wall behind goes on where the other one hides it.
        let mut seen_through = chunks.clone();
        let hidden = |[x, y, z]: [f32; 3]| (z == 2.0).then_some([x * 1.5, y * 1.5, 3.0]);
        let positions = chunks.iter().flat_map(|chunk| chunk.positions.iter().copied().filter_map(hidden)).collect();
        seen_through.push(Chunk::new(0, DVec3::ZERO, positions));
        assert!(!is_depth_image(&seen_through));
    }
}
