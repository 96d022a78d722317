//! Clouds whose points were all seen from one place. Between that place and a point there is nothing, so a disc or an
//! ellipse that hides a point behind it is too large.

use glam::{DMat3, DVec3, IVec3, Vec3};
use rayon::prelude::*;

use crate::shape::smallest_eigenvector;
use crate::{
    Chunk, NO_NORMAL, Progress, Stretch, Surfels, hash, pack_ellipse, pack_normal, spread_sample, stray_kind,
    stretch_ratio, unpack_normal, unpack_radius, unpack_stretch,
};

/// A point is behind a disc if it is further away than where its sightline meets the disc's plane, by this share of the
/// distance: nearer ones are of the same surface, as rough as it is measured.
const BEHIND: f32 = 0.01;
/// A disc that would hide a point ends at this share of the way to that point's sightline. The border of the surface is
/// somewhere on that way.
const WAY: f32 = 0.65;
/// Discs are made so much wider before: one that hides no point closes holes, and stands in free space nowhere that is
/// known.
const WIDER: f32 = 1.5;
/// No disc is wider than so many usual ones as seen from the place, or, aslant, than one that is that wide where it is
/// seen least: where points are farther apart than that, the place saw nothing between them.
const WIDEST: f32 = 2.0;
/// Discs whose normals have a smaller cosine to the sightline are taken for ones with this.
const MOST_ASLANT: f32 = 0.25;
/// The ratio of an ellipse that a longer one may become.
const ROUNDER: f32 = 3.0;
/// What is left of a radius, or of the long half axis of an ellipse as a share of the short one, at least.
const LEAST_LEFT: f32 = 0.2;
/// The most cells that a disc is searched in along an axis, to either side: larger discs are larger than any surface
/// that is sampled around them.
const MOST_CELLS: usize = 4;
/// The most points that a disc is searched for: several times as many as there are in so many cells of a depth image.
/// In any other cloud a direction may have any number of points.
const MOST_SEARCHED: usize = 1 << 14;
/// The number of cells that a thread works on without a pause.
const CELLS_AT_ONCE: usize = 256;

/// A plane is fitted to the points whose directions differ by less than so many usual discs' radii, some 25: in a depth
/// image these are evenly spread, while the nearest in space are those that the noise of the depths brings together.
const FITTED: f32 = 2.5;
/// Of these, those whose distances differ by less than this share are of the same surface ...
const SAME_DEPTH: f32 = 0.03;
/// ... and so many of them make a plane.
const LEAST_FITTED: f32 = 5.0;

/// The most times that the cells of directions are halved.
const FINEST: i32 = 19;
/// The number of points that decide a depth image, some of each cell of directions.
const PER_CELL: usize = 4;
/// In a depth image, this share of the points that are neighbours as seen from its place are near to one another ...
const SAME_SURFACE: f64 = 0.9;
/// ... which is: their distances differ by less than this share of what those of any two points differ by.
const NEAR: f64 = 0.25;
/// Distances that differ by less say nothing: the place is far from the scan.
const LEAST_DEPTH: f64 = 0.02;
/// In a depth image, pixels are evenly spread: this share of the points is in cells with at most three times as many
/// points as the middle one.
const EVEN: f64 = 0.9;
/// Of a grid of azimuth and elevation, whose columns draw together at the zenith, 0.88 are; of points that are spread
/// evenly over the walls of a room 0.77, and of the scans of two stations together 0.65. Less than `EVEN` is enough only
/// where the place is known.
const EVEN_OF_KNOWN: f64 = 0.83;

/// Whether a cloud is a depth image: each direction from the origin meets one surface, and the points are spread evenly
/// over the directions.
pub fn is_depth_image(chunks: &[Chunk]) -> bool {
    is_evenly_seen(chunks, DVec3::ZERO, EVEN)
}

/// Whether all points of a cloud are what the scanner saw whose place its file names: one of several scans of a file, and
/// not a cloud that was put together of them or thinned out.
pub fn is_seen_from(chunks: &[Chunk], place: DVec3) -> bool {
    is_evenly_seen(chunks, place, EVEN_OF_KNOWN)
}

fn is_evenly_seen(chunks: &[Chunk], place: DVec3, least: f64) -> bool {
    let sample = spread_sample(chunks).map(|point| point - place);
    let sample: Vec<DVec3> = sample.filter(|point| point.length_squared() > 0.0).collect();
    if sample.len() < 100 {
        return false;
    }
    let seen: Vec<(Vec3, f64)> = sample.iter().map(|point| (point.normalize().as_vec3(), point.length())).collect();
    let cells = |power: i32| {
        let fineness = 2.0_f32.powi(power);
        let mut placed: Vec<(u64, f64)> =
            seen.iter().map(|(direction, distance)| (key(cell(*direction, fineness)), *distance)).collect();
        placed.sort_by_key(|(cell, _)| *cell);
        placed
    };
    // As fine as a few points in each cell allow. Each power divides cells, so there are no fewer of them.
    let is_fine = |placed: &[(u64, f64)]| placed.chunk_by(|a, b| a.0 == b.0).count() * PER_CELL > placed.len();
    let (mut coarse, mut fine) = (-1, FINEST);
    while fine - coarse > 1 {
        let middle = (coarse + fine) / 2;
        if is_fine(&cells(middle)) { fine = middle } else { coarse = middle }
    }
    let placed = cells(fine);
    if !is_fine(&placed) {
        return false;
    }
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
    usual > LEAST_DEPTH && same as f64 >= SAME_SURFACE * near.len() as f64 && even as f64 >= least * placed.len() as f64
}

/// A point as seen from a place.
#[derive(Clone, Copy)]
struct Seen {
    /// The cell of its direction.
    cell: u64,
    way: Vec3,
    /// Where the point is: its chunk, and its index there.
    chunk: u32,
    index: u32,
}

/// The points by their direction from a place.
struct Directions {
    /// In the order of their cells.
    points: Vec<Seen>,
    /// The cells that have points, in order, and the first point of each.
    cells: Vec<(u64, u32)>,
    /// The number of cells in a length of 1.
    fineness: f32,
}

impl Directions {
    fn new(chunks: &[Chunk], place: DVec3, fineness: f32) -> Self {
        let located = chunks.par_iter().enumerate().flat_map_iter(|(number, chunk)| {
            (0..chunk.len()).filter_map(move |index| {
                let way = (chunk.position(index) - place).as_vec3();
                let cell = cell(way.try_normalize()?, fineness);
                Some(Seen { cell: key(cell), way, chunk: number as u32, index: index as u32 })
            })
        });
        let mut points: Vec<Seen> = located.collect();
        // The place breaks ties, so that the order does not depend on that of the chunks.
        let bits = |seen: &Seen| seen.way.to_array().map(f32::to_bits);
        points.par_sort_unstable_by(|a, b| a.cell.cmp(&b.cell).then_with(|| bits(a).cmp(&bits(b))));
        let mut cells: Vec<(u64, u32)> = Vec::new();
        for (seen, first) in points.iter().zip(0..) {
            if cells.last().is_none_or(|(cell, _)| *cell != seen.cell) {
                cells.push((seen.cell, first));
            }
        }
        Self { points, cells, fineness }
    }

    /// The points whose directions are in cells up to `steps` cells beside that of a direction, but no more than
    /// `MOST_SEARCHED`.
    fn near(&self, direction: Vec3, steps: i32) -> impl Iterator<Item = Vec3> {
        let middle = cell(direction, self.fineness);
        let rows = (-steps..=steps).flat_map(move |x| (-steps..=steps).map(move |y| middle + IVec3::new(x, y, -steps)));
        let ways = rows.flat_map(move |first| {
            let (start, last) = (key(first), key(first + IVec3::Z * (2 * steps)));
            let found = self.cells.partition_point(|(cell, _)| *cell < start);
            let start = self.cells.get(found).map_or(self.points.len(), |(_, start)| *start as usize);
            self.points[start..].iter().take_while(move |seen| seen.cell <= last).map(|seen| seen.way)
        });
        ways.take(MOST_SEARCHED)
    }
}

fn cell(direction: Vec3, fineness: f32) -> IVec3 {
    (direction * fineness).floor().as_ivec3()
}

/// The number of a cell. Those of a row along z are consecutive.
fn key(cell: IVec3) -> u64 {
    let part = |along: i32| (along + (1 << 20)) as u64;
    part(cell.x) << 42 | part(cell.y) << 21 | part(cell.z)
}

/// Fits normals, where the file has none, to the points around in the picture, makes discs smaller that would hide
/// other points from the place that all of them were seen from, and the others wider. `None` when cancelled.
pub(crate) fn carve(chunks: &[Chunk], surfels: &mut [Surfels], place: DVec3, progress: &Progress) -> Option<()> {
    let points = || chunks.iter().zip(surfels.iter());
    let angle = |chunk: &Chunk, surfels: &Surfels, index: usize| {
        Some(unpack_radius(surfels.radii[index])? / (chunk.position(index) - place).as_vec3().length())
    };
    let mut angles: Vec<f32> = points()
        .flat_map(|(chunk, surfels)| (0..chunk.len()).filter_map(move |at| angle(chunk, surfels, at)))
        .filter(|angle| *angle > 0.0 && angle.is_finite())
        .collect();
    let middle = angles.len() / 2;
    if angles.is_empty() {
        return Some(());
    }
    let usual = *angles.select_nth_unstable_by(middle, f32::total_cmp).1;
    // A usual disc reaches into the cells beside its own.
    let directions = Directions::new(chunks, place, (0.5 / usual).clamp(1.0, 1e6));
    let limit = (FITTED * usual).powi(2);
    let cells: Vec<&[Seen]> = directions.points.chunk_by(|a, b| a.cell == b.cell).collect();
    let known: &[Surfels] = surfels;
    let carve_cell = |cell: &[Seen], lists: &mut Lists, carved: &mut Vec<(u32, u16)>| {
        lists.iter_mut().for_each(|list| list.points.clear());
        let middle = cell[0].way.normalize();
        for seen in cell {
            let (chunk, index) = (seen.chunk as usize, seen.index as usize);
            let (mut normal, radius) = (known[chunk].normals[index], known[chunk].radii[index]);
            let is_own = chunks[chunk].normals.as_ref().is_some_and(|normals| normals[index] != NO_NORMAL);
            // An ellipse lies in the plane of the rows beside its point, which are farther apart than the pixels around.
            let is_ellipse = stretch_ratio(radius) > 1.0;
            if !(is_own || is_ellipse)
                && let Some(fitted) = fitted_normal(&lists[0].filled(&directions, middle, 1).points, seen.way, limit)
            {
                let towards = unpack_normal(normal).unwrap_or(-seen.way);
                normal = pack_normal(if fitted.dot(towards) < 0.0 { -fitted } else { fitted });
            }
            let sized = unpack_radius(radius).filter(|_| stray_kind(radius) == 0).zip(unpack_normal(normal));
            let carve = sized.map(|(long, normal)| {
                let stretch = unpack_stretch(radius, normal);
                let distance = seen.way.length();
                let cosine = seen.way.dot(normal).abs() / distance;
                // Rows that graze a surface were measured, however far apart they are.
                let aslant = if stretch.is_some() { cosine } else { cosine.max(MOST_ASLANT) };
                let long = (WIDER * long).min(WIDEST * usual * distance / aslant);
                let splat = Splat { way: seen.way, normal, long, stretch };
                splat.carved(&directions, lists, middle)
            });
            carved.push((normal, carve.unwrap_or(radius)));
        }
    };
    let carved: Vec<Vec<(u32, u16)>> = cells
        .par_chunks(CELLS_AT_ONCE)
        .map(|cells| {
            let (mut lists, mut carved) = (Lists::default(), Vec::new());
            for cell in cells.iter().filter(|_| !progress.is_cancelled()) {
                carve_cell(cell, &mut lists, &mut carved);
            }
            carved
        })
        .collect();
    if progress.is_cancelled() {
        return None;
    }
    for (seen, (normal, radius)) in directions.points.iter().zip(carved.into_iter().flatten()) {
        let surfels = &mut surfels[seen.chunk as usize];
        surfels.normals[seen.index as usize] = normal;
        surfels.radii[seen.index as usize] = radius;
    }
    Some(())
}

/// The points of the cells around a cell, by how many cells away they are at most; empty until they are asked for.
type Lists = [Around; MOST_CELLS];

/// The points of some cells.
#[derive(Default)]
struct Around {
    points: Vec<Beside>,
    /// The distance of the most distant one.
    farthest: f32,
}

/// A point as seen from the place, its direction, and its distance.
struct Beside {
    way: Vec3,
    direction: Vec3,
    distance: f32,
}

impl Around {
    /// Adds the points of the cells up to `steps` cells beside that of a direction, in which there are some.
    fn filled(&mut self, directions: &Directions, middle: Vec3, steps: usize) -> &Self {
        if self.points.is_empty() {
            self.points.extend(directions.near(middle, steps as i32).map(|way| {
                let distance = way.length();
                Beside { way, direction: way / distance, distance }
            }));
            self.farthest = self.points.iter().map(|point| point.distance).fold(0.0, f32::max);
        }
        self
    }
}

/// The normal of the plane through the points of one surface that are near the direction of a point: their directions
/// differ by less than the root of `limit`. Its sign is arbitrary.
fn fitted_normal(around: &[Beside], way: Vec3, limit: f32) -> Option<Vec3> {
    let distance = way.length();
    let direction = way / distance;
    let (mut count, mut sum, mut diagonal, mut mixed) = (0.0_f32, Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
    for other in around {
        let is_near = (other.direction - direction).length_squared() < limit;
        if is_near && (other.distance - distance).abs() < SAME_DEPTH * distance {
            // In units of the distance, so that nothing under- or overflows.
            let offset = (other.way - way) / distance;
            count += 1.0;
            sum += offset;
            diagonal += offset * offset;
            mixed += Vec3::new(offset.y * offset.z, offset.z * offset.x, offset.x * offset.y);
        }
    }
    if count < LEAST_FITTED {
        return None;
    }
    let mean = sum / count;
    let diagonal = (diagonal / count - mean * mean).as_dvec3();
    let mixed = (mixed / count - Vec3::new(mean.y * mean.z, mean.z * mean.x, mean.x * mean.y)).as_dvec3();
    let covariance = DMat3::from_cols(
        DVec3::new(diagonal.x, mixed.z, mixed.y),
        DVec3::new(mixed.z, diagonal.y, mixed.x),
        DVec3::new(mixed.y, mixed.x, diagonal.z),
    );
    smallest_eigenvector(covariance).map(|normal| normal.as_vec3())
}

/// A splat and the way to its middle from the place.
struct Splat {
    way: Vec3,
    normal: Vec3,
    /// The radius of a disc, or the long half axis of an ellipse.
    long: f32,
    stretch: Option<Stretch>,
}

impl Splat {
    /// The packed radius of the largest splat that ends before each sightline that this one hides. Where that has to be
    /// much shorter it is a rounder one, but never wider. `middle` is a direction in the point's cell, about which the
    /// lists are.
    fn carved(&self, directions: &Directions, lists: &mut Lists, middle: Vec3) -> u16 {
        let Stretch { axis, ratio } = self.stretch.unwrap_or(Stretch { axis: Vec3::ZERO, ratio: 1.0 });
        let short = self.long / ratio;
        let ratios = [ratio, ratio.min(ROUNDER), 1.0];
        // For each ratio the square of the long half axis of the ellipse through the nearest sightline.
        let mut ends = [f32::INFINITY; 3];
        self.visit_hidden(directions, lists, middle, |offset| {
            let along = offset.dot(axis).powi(2);
            let across = offset.length_squared() - along;
            for (end, ratio) in ends.iter_mut().zip(ratios) {
                *end = end.min(along + ratio * ratio * across);
            }
        });
        let carved = ends.into_iter().zip(ratios).map(|(end, ratio)| {
            let (end, longest) = (end.sqrt(), short * ratio);
            let long = if end < longest { (WAY * end).max(LEAST_LEFT * short) } else { longest };
            (long, ratio)
        });
        let area = |(long, ratio): (f32, f32)| long * long / ratio;
        let (long, ratio) = carved.fold((0.0, 1.0), |most, own| if area(own) > area(most) { own } else { most });
        pack_ellipse(long, Stretch { axis, ratio }, self.normal)
    }

    /// Visits the places, as seen from the middle of the splat, where its plane is met by the sightlines that it may
    /// hide.
    fn visit_hidden(&self, directions: &Directions, lists: &mut Lists, middle: Vec3, mut visit: impl FnMut(Vec3)) {
        let distance = self.way.length();
        // Half of how wide the splat is at most as seen from the place: a floor that is grazed is long in space alone.
        let half = self.stretch.map_or(self.long, |Stretch { axis, ratio }| {
            let across = 1.0 - (axis.dot(self.way) / distance).powi(2);
            self.long * (across + ratio.powi(-2)).max(0.0).sqrt()
        });
        let steps = (half / (distance - self.long).max(0.0) * directions.fineness).ceil();
        if !(steps >= 1.0 && distance.is_finite()) {
            return;
        }
        let steps = (steps as usize).min(MOST_CELLS);
        let around = lists[steps - 1].filled(directions, middle, steps);
        // All of the splat is at least this far away, so that it hides nothing that is nearer.
        if around.farthest * (1.0 - BEHIND) < distance - self.long {
            return;
        }
        let along = self.way.dot(self.normal);
        for other in &around.points {
            // The sightline is in units of itself: 1 is the other point.
            let share = along / other.way.dot(self.normal);
            if share > 0.0 && share < 1.0 - BEHIND {
                visit(other.way * share - self.way);
            }
        }
    }
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
            assert!(!is_rim || (carved / expected - 1.0).abs() < 0.012, "{carved} instead of {expected}");
            assert!(*carved <= WIDER * *full * 1.012);
        }
        // The wall behind hides nothing, and neither does the one before it further than a disc from its edge.
        let is_wider = |(full, carved): &(&f32, &f32)| (**carved / (WIDER * **full) - 1.0).abs() < 0.012;
        let wider = full.iter().zip(&carved).filter(is_wider).count();
        assert!(wider > full.len() * 95 / 100, "{wider} of {}", full.len());
    }

    /// A wall, and a row of points far apart before the open, of which nothing is behind.
    #[test]
    fn discs_of_points_with_nothing_between_them_are_no_wider_than_twice_usual_ones() {
        let step = 0.02;
        let mut positions: Vec<[f32; 3]> =
            (0..2500).map(|index| [(index % 50) as f32 * 2.0 * step, (index / 50) as f32 * 2.0 * step, 2.0]).collect();
        positions.extend((1..20).map(|index| [-0.3 * index as f32, 0.1 * (index % 3) as f32, 2.0]));
        let chunks = [Chunk::new(0, DVec3::ZERO, positions)];
        let (full, carved) = (radii(&chunks, None), radii(&chunks, Some(DVec3::ZERO)));
        let angle = |index: usize, radii: &[f32]| radii[index] / chunks[0].position(index).length() as f32;
        let mut usual: Vec<f32> = (0..2500).map(|index| angle(index, &full)).collect();
        let usual = *usual.select_nth_unstable_by(1250, f32::total_cmp).1;
        for index in 2500..2519 {
            let [full, carved] = [&full, &carved].map(|radii| angle(index, radii) / usual);
            // The normal of the row's points is that of the wall: they are seen aslant by the cosine of their angle.
            let aslant = (2.0 / chunks[0].position(index).length() as f32).max(MOST_ASLANT);
            assert!(full > 3.0 && carved <= 1.05 * WIDEST / aslant, "{index}: {full} {carved}");
        }
    }

    #[test]
    fn normals_of_a_noisy_wall_are_those_of_the_picture_unless_the_file_has_some() {
        // The plane z = 2 + 0.4 x, eight millimetres from pixel to pixel, with depths that are as much off.
        let depth = |x: f32, index: u64| {
            2.0 / (1.0 - 0.4 * x) * (1.0 + 0.004 * (2.0 * hash(index) as f32 / u64::MAX as f32 - 1.0))
        };
        let pixel = |index: u64| {
            let [x, y] = [index % 120, index / 120].map(|along| (along as f32 - 59.5) * 0.004);
            let depth = depth(x, index);
            [x * depth, y * depth, depth]
        };
        let mut chunks = vec![Chunk::new(0, DVec3::ZERO, (0..120 * 120).map(pixel).collect())];
        let facing = Vec3::new(0.4, 0.0, -1.0).normalize();
        let normals = |chunks: &[Chunk], seen_from: Option<DVec3>| {
            let options = SurfelOptions { seen_from, ..SurfelOptions::new(Orientation::Toward(DVec3::ZERO)) };
            estimate(chunks, &options, &Progress::default()).unwrap().swap_remove(0).normals
        };
        let usual_angle = |normals: Vec<u32>| {
            let mut angles: Vec<f32> =
                normals.into_iter().map(|normal| unpack_normal(normal).unwrap().angle_between(facing)).collect();
            let middle = angles.len() / 2;
            angles.select_nth_unstable_by(middle, f32::total_cmp).1.to_degrees()
        };
        let (nearest, fitted) = (usual_angle(normals(&chunks, None)), usual_angle(normals(&chunks, Some(DVec3::ZERO))));
        assert!(fitted < 6.0 && fitted < 0.7 * nearest, "{fitted} degrees instead of {nearest}");
        let own = vec![pack_normal(Vec3::X); chunks[0].len()];
        chunks[0].normals = Some(own.clone().into());
        assert_eq!(normals(&chunks, Some(DVec3::ZERO)), own);
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
