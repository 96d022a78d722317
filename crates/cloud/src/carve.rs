//! Clouds whose points were seen from known places. Between a point and the place that it was seen from there is nothing,
//! so a disc or an ellipse that hides a point behind it is too large.

use std::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use glam::{DVec3, IVec3, Mat4, Vec2, Vec3, Vec4};
use rayon::prelude::*;

use crate::neighbours::Points;
use crate::picture::{Four, Picture, REACH, Seen, Side};
use crate::surfels::{SeenFrom, Stored};
use crate::{
    Chunk, NO_NORMAL, Progress, Stretch, hash, pack_ellipse, pack_normal, spread_sample, stray_kind, stretch_ratio,
    unpack_normal, unpack_radius, unpack_stretch,
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

/// Whether the points of each chunk are what the scanner saw from the chunk's station.
pub fn are_seen_from_stations(chunks: &[Chunk]) -> bool {
    let mut stations: Vec<DVec3> = Vec::new();
    for chunk in chunks {
        match chunk.station {
            Some(station) if !stations.contains(&station) => stations.push(station),
            Some(_) => {}
            None => return false,
        }
    }
    let is_seen = |station: &DVec3| {
        let own: Vec<Chunk> = chunks.iter().filter(|chunk| chunk.station == Some(*station)).cloned().collect();
        is_seen_from(&own, *station)
    };
    !stations.is_empty() && stations.iter().all(is_seen)
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

fn cell(direction: Vec3, fineness: f32) -> IVec3 {
    (direction * fineness).floor().as_ivec3()
}

/// The number of a cell. Those of a row along z are consecutive.
fn key(cell: IVec3) -> u64 {
    let part = |along: i32| (along + (1 << 20)) as u64;
    part(cell.x) << 42 | part(cell.y) << 21 | part(cell.z)
}

/// What was seen from a place, and the median radius of its discs, as seen from there: an angle in radians.
struct View {
    picture: Picture,
    usual: f32,
}

impl View {
    /// `None` if no point of the chunks that `is_seen` names has a radius, strays aside.
    fn new(points: &Points, stored: &[Stored], place: DVec3, is_seen: impl Fn(usize) -> bool + Sync) -> Option<Self> {
        let seen = points.chunks().par_iter().zip(stored).enumerate().filter(|(number, _)| is_seen(*number));
        let angles = seen.flat_map_iter(|(_, (chunk, (_, radii)))| {
            let angle = move |(index, radius): (usize, &AtomicU16)| {
                let packed = radius.load(Ordering::Relaxed);
                let radius = unpack_radius(packed).filter(|_| stray_kind(packed) == 0)?;
                Some(radius / (chunk.position(index) - place).as_vec3().length())
            };
            radii.iter().enumerate().filter_map(angle).filter(|angle| *angle > 0.0 && angle.is_finite())
        });
        let mut angles: Vec<f32> = angles.collect();
        if angles.is_empty() {
            return None;
        }
        let middle = angles.len() / 2;
        let usual = *angles.select_nth_unstable_by(middle, f32::total_cmp).1;
        Some(Self { picture: Picture::new(points, place, usual, is_seen), usual })
    }
}

/// Fits normals, where the file has none and the neighbours are `rough`, to the points around in the picture, makes discs
/// smaller that would hide points from the place that these were seen from, and the others wider. `None` when cancelled.
pub(crate) fn carve(
    points: &Points,
    stored: &[Stored],
    rough: &[AtomicU32],
    seen_from: SeenFrom,
    progress: &Progress,
) -> Option<()> {
    let place_of = |chunk: &Chunk| match seen_from {
        SeenFrom::Place(place) => Some(place),
        SeenFrom::Stations => chunk.station,
    };
    let mut places: Vec<DVec3> = Vec::new();
    for place in points.chunks().iter().filter_map(place_of) {
        if !places.contains(&place) {
            places.push(place);
        }
    }
    let view =
        |place: &DVec3| View::new(points, stored, *place, |chunk| place_of(&points.chunks()[chunk]) == Some(*place));
    let views: Vec<View> = places.iter().filter(|_| !progress.is_cancelled()).filter_map(view).collect();
    let carving = Carving { points, stored, rough, views: &views };
    for view in &views {
        for side in &view.picture.sides {
            let own = side.own_points().filter(|_| !progress.is_cancelled());
            own.for_each(|(index, seen)| carving.carve(view, side, index, seen));
        }
    }
    (!progress.is_cancelled()).then_some(())
}

/// The carving of a part of a cloud.
struct Carving<'a> {
    points: &'a Points<'a>,
    stored: &'a [Stored],
    /// A bit for each point, in words of 32: whether its neighbours are rough.
    rough: &'a [AtomicU32],
    views: &'a [View],
}

impl Carving<'_> {
    /// Carves the point with this running index, which was seen on a side of a view.
    fn carve(&self, view: &View, side: &Side, running: u32, seen: &Seen) {
        let (chunk, index) = self.points.locate(running);
        let chunk_points = &self.points.chunks()[chunk];
        let (normals, radii) = &self.stored[chunk];
        let radius = radii[index].load(Ordering::Relaxed);
        let mut normal = unpack_normal(normals[index].load(Ordering::Relaxed));
        let way = side.turned_back(seen.tangent.extend(1.0) / seen.inverse);
        let is_own = chunk_points.normals.as_ref().is_some_and(|normals| normals[index] != NO_NORMAL);
        // An ellipse lies in the plane of the rows beside its point, which are farther apart than the pixels around.
        let is_ellipse = stretch_ratio(radius) > 1.0;
        let is_rough = self.rough[running as usize / 32].load(Ordering::Relaxed) >> (running % 32) & 1 == 1;
        if is_rough
            && !(is_own || is_ellipse)
            && let Some(fitted) = fitted_normal(side, seen, FITTED * view.usual)
        {
            let fitted = side.turned_back(fitted);
            let towards = normal.unwrap_or(-way);
            let packed = pack_normal(if fitted.dot(towards) < 0.0 { -fitted } else { fitted });
            normals[index].store(packed, Ordering::Relaxed);
            normal = unpack_normal(packed);
        }
        let sized = unpack_radius(radius).filter(|_| stray_kind(radius) == 0).zip(normal);
        let Some((long, normal)) = sized else { return };
        let stretch = unpack_stretch(radius, normal);
        let distance = way.length();
        let cosine = way.dot(normal).abs() / distance;
        // Rows that graze a surface were measured, however far apart they are.
        let aslant = if stretch.is_some() { cosine } else { cosine.max(MOST_ASLANT) };
        let long = (WIDER * long).min(WIDEST * view.usual * distance / aslant);
        let splat = Splat { normal, long, stretch };
        let way_from = |of: &View| {
            if std::ptr::eq(of, view) { way } else { (chunk_points.position(index) - of.picture.place).as_vec3() }
        };
        let views = self.views.iter().map(|of| (of, way_from(of)));
        radii[index].store(splat.carved(views), Ordering::Relaxed);
    }
}

/// The normal of the plane through the points of one surface that are within an angle of a point, in the coordinates of
/// the side. On a plane one over the distance along the axis is linear in the tangents, and the noise of a scanner is
/// along its rays. Its sign is arbitrary.
fn fitted_normal(side: &Side, seen: &Seen, angle: f32) -> Option<Vec3> {
    let (length, limit) = (1.0 + seen.tangent.length_squared(), angle * angle * (1.0 + seen.tangent.length_squared()));
    let (towards, scale) = (seen.tangent / length, seen.inverse.recip());
    // The sums of the ways aside, of how much nearer points are, and of 1; and of these times the ways aside.
    let (mut sums, mut by_x, mut by_y) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
    side.visit_around(seen.tangent, angle, |Four { x, y, inverse }| {
        let (x, y) = (x - seen.tangent.x, y - seen.tangent.y);
        // In units of the inverse, so that nothing under- or overflows.
        let nearer = inverse * scale - 1.0;
        // By how much the way to it is longer than that to the point, where both are 1 along the axis.
        let longer = x * towards.x + y * towards.y;
        let is_near = (x * x + y * y - longer * longer * length).cmplt(Vec4::splat(limit));
        let is_same = is_near & (nearer - longer).abs().cmplt(Vec4::splat(SAME_DEPTH));
        let of_same = |lanes| Vec4::select(is_same, lanes, Vec4::ZERO);
        // One after another, so that sums do not depend on which four are visited together.
        let points = Mat4::from_cols(of_same(x), of_same(y), of_same(nearer), of_same(Vec4::ONE)).transpose();
        for point in [points.x_axis, points.y_axis, points.z_axis, points.w_axis] {
            sums += point;
            by_x += point * point.x;
            by_y += point * point.y;
        }
    });
    let (count, sum, mixed) = (sums.w, sums.truncate(), Vec2::new(by_x.z, by_y.z));
    let squares = Vec3::new(by_x.x, by_y.y, by_x.y);
    if count < LEAST_FITTED {
        return None;
    }
    let mean = sum / count;
    let squares = squares / count - Vec3::new(mean.x * mean.x, mean.y * mean.y, mean.x * mean.y);
    let mixed = mixed / count - mean.truncate() * mean.z;
    let determinant = squares.x * squares.y - squares.z * squares.z;
    if determinant.is_nan() || determinant <= 1e-3 * squares.x.max(squares.y).powi(2) {
        return None;
    }
    let slope =
        Vec2::new(squares.y * mixed.x - squares.z * mixed.y, squares.x * mixed.y - squares.z * mixed.x) / determinant;
    let at_point = 1.0 + mean.z - slope.dot(mean.truncate());
    slope.extend(at_point - slope.dot(seen.tangent)).try_normalize()
}

/// A splat.
struct Splat {
    normal: Vec3,
    /// The radius of a disc, or the long half axis of an ellipse.
    long: f32,
    stretch: Option<Stretch>,
}

impl Splat {
    /// The packed radius of the largest splat that ends before each sightline that this one hides in views, each with the
    /// way to its middle from there. Where that has to be much shorter it is a rounder one, but never wider.
    fn carved<'a>(&self, views: impl Iterator<Item = (&'a View, Vec3)>) -> u16 {
        let Stretch { axis, ratio } = self.stretch.unwrap_or(Stretch { axis: Vec3::ZERO, ratio: 1.0 });
        let short = self.long / ratio;
        let ratios = [ratio, ratio.min(ROUNDER), 1.0];
        // For each ratio the square of the long half axis of the ellipse through the nearest sightline.
        let mut ends = [f32::INFINITY; 3];
        for (view, way) in views {
            self.visit_hidden(view, way, |offset| {
                let along = offset.dot(axis).powi(2);
                let across = offset.length_squared() - along;
                for (end, ratio) in ends.iter_mut().zip(ratios) {
                    *end = end.min(along + ratio * ratio * across);
                }
            });
        }
        if ends[0] == f32::INFINITY {
            return pack_ellipse(short * ratio, Stretch { axis, ratio }, self.normal);
        }
        let carved = ends.into_iter().zip(ratios).map(|(end, ratio)| {
            let (end, longest) = (end.sqrt(), short * ratio);
            let long = if end < longest { (WAY * end).max(LEAST_LEFT * short) } else { longest };
            (long, ratio)
        });
        let area = |(long, ratio): (f32, f32)| long * long / ratio;
        let (long, ratio) = carved.fold((0.0, 1.0), |most, own| if area(own) > area(most) { own } else { most });
        pack_ellipse(long, Stretch { axis, ratio }, self.normal)
    }

    /// Visits the places, as seen from the middle of the splat, where its plane is met by the sightlines of a view that it
    /// may hide.
    fn visit_hidden(&self, view: &View, way: Vec3, mut visit: impl FnMut(Vec3)) {
        let distance = way.length();
        // Half of how wide the splat is at most as seen from the place: a floor that is grazed is long in space alone.
        let half = self.stretch.map_or(self.long, |Stretch { axis, ratio }| {
            let across = 1.0 - (axis.dot(way) / distance).powi(2);
            self.long * (across + ratio.powi(-2)).max(0.0).sqrt()
        });
        let angle = (half / (distance - self.long).max(0.0)).min(REACH * view.usual);
        let along = way.dot(self.normal);
        if !(angle > 0.0 && distance.is_finite() && along != 0.0) {
            return;
        }
        let side = view.picture.side(way);
        let (along, normal) = (along.abs(), side.turned(self.normal * along.signum()));
        let way = side.turned(way);
        side.visit_around(way.truncate() / way.z, angle, |Four { x, y, inverse }| {
            // How far along the sightline it meets the plane, times this, is `along`.
            let slope = x * normal.x + y * normal.y + normal.z;
            let mut hidden = (slope * (1.0 - BEHIND)).cmpgt(along * inverse).bitmask();
            while hidden != 0 {
                let lane = hidden.trailing_zeros() as usize;
                hidden &= hidden - 1;
                visit(side.turned_back(Vec3::new(x[lane], y[lane], 1.0) * (along / slope[lane]) - way));
            }
        });
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
            seen_from: seen_from.map(SeenFrom::Place),
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
            let seen_from = seen_from.map(SeenFrom::Place);
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
        let (points, seen_from) = (Points::new(&chunks), SeenFrom::Place(DVec3::ZERO));
        progress.cancel();
        let stored: Vec<Stored> = chunks.iter().map(|_| Stored::default()).collect();
        assert!(carve(&points, &stored, &[], seen_from, &progress).is_none());
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
