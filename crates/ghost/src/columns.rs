//! Finds cylinders that mirror, by straight outlines in what a station sees.
//!
//! Columns stand upright, and pipes run from wall to wall: their axes are normals of the largest planes of the scan. About
//! such an axis, a station sees the sides of a column at two angles. Ranges jump along at least one of them, mostly. For
//! each such jump, columns of all widths are tried on both sides of it, at all distances, by how many points are near a
//! surface when they are unfolded. A column unfolds the points of surfaces across its axis, as floors are across an upright
//! one, to these surfaces wherever it stands and however thick it is. So only points that unfold to other surfaces, or to
//! none, say whether a column is there.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;
use scene::{Mirror, Shape};

use crate::gauge::{BEHIND, Sample};
use crate::planes::Plane;
use crate::refine::{Seen, TELLS, fitted, some_of};
use crate::surface_map::SurfaceMap;

/// The most axes that are tried, the first of which is upright; the cosine between two from which on they are one.
const MOST_AXES: usize = 3;
const ONE_AXIS: f64 = 0.9;
/// Cells around an axis, and along it from the opposite of its direction to it.
const AROUND: usize = 960;
const ALONG: usize = 240;
/// Cells at more than this angle from across the axis are too narrow.
const FARTHEST_ALONG: f64 = 1.1;
/// Ranges of neighbours that differ by more than this share of the nearer one are no surface that is seen aslant.
const JUMP: f64 = 0.05;
/// The fewest cells along the axis with a jump, and the most angles at which there are jumps.
const FEWEST_JUMPS: u32 = 10;
const MOST_SIDES: usize = 60;
/// Half the angle between both sides of a column: what is tried first, each a share wider than the one before.
const FIRST_HALF_ANGLE: f64 = 0.02;
const HALF_ANGLES: i32 = 51;
const WIDER: f64 = 1.07;
/// Angles by which a side may be off in radians.
const OFF: [f64; 5] = [-0.0036, -0.0018, 0.0, 0.0018, 0.0036];
/// Distances of an axis that are tried, each a share nearer than the one before.
const DISTANCES: i32 = 30;
const NEARER: f64 = 1.06;
/// The points by which a column is tried, those by which the best are, and how many these are.
const TRIED: usize = 32;
const TRIED_CLOSELY: usize = 400;
const CLOSELY: usize = 12;
/// The share of the score of points that all are on surfaces that a column has at least.
const LEAST_SCORE: f64 = 0.25;
/// The weight that a point near a surface has more than one by chance.
const BY_CHANCE: f64 = 0.2;
/// The cosine at an outline up to which points say little: a beam that grazes a column is spread most.
const GRAZING: f64 = 0.43;
/// The fewest points that fit, and the share of the points that say something that they are at least.
const FEWEST_FITS: usize = 60;
const LEAST_FIT: f64 = 0.7;
/// The most columns that may be expected to fit as well as a mirror by chance.
const CHANCES: f64 = 1e-3;
/// As many groups of points fit whatever is there: the place of a column across its axis and its radius are moved so.
const FREE: usize = 3;
/// The columns beside one that show how many groups of points fit by chance.
const ELSEWHERE: i32 = 8;
/// A column stands on what is below it if its axis has at least this cosine to the vertical, and if no more than one of so
/// many points between does not fit.
const STANDS: f64 = 0.9;
const MISSES: i64 = 3;

/// What a station sees around an axis.
struct View<'a> {
    station: DVec3,
    axis: DVec3,
    across: [DVec3; 2],
    map: &'a SurfaceMap,
    /// The points that are on no surface across the axis, in the order of their angles about it, with these.
    points: Vec<(f64, DVec3)>,
}

impl<'a> View<'a> {
    fn new(station: DVec3, axis: DVec3, samples: &[&Sample], map: &'a SurfaceMap) -> Self {
        let first = axis.any_orthonormal_vector();
        let mut view = Self { station, axis, across: [first, axis.cross(first)], map, points: Vec::new() };
        let is_kept = |sample: &&&Sample| sample.normal.is_none_or(|normal| normal.dot(axis).abs() < TELLS);
        let places = samples.iter().filter(is_kept).map(|sample| sample.place);
        view.points = places.map(|place| (view.angle(place), place)).collect();
        view.points.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        view
    }

    /// The angle at which a place is seen about the axis, from 0 to 2 pi.
    fn angle(&self, place: DVec3) -> f64 {
        let way = place - self.station;
        way.dot(self.across[1]).atan2(way.dot(self.across[0])).rem_euclid(TAU)
    }

    /// The angles at which ranges jump, those first at which they do along most of the axis.
    fn sides(&self) -> Vec<f64> {
        let mut ranges = vec![(0.0, 0.0); AROUND * ALONG];
        for (angle, place) in &self.points {
            let way = *place - self.station;
            let along = (way.dot(self.axis) / way.length()).clamp(-1.0, 1.0).asin();
            if along.abs() < FARTHEST_ALONG {
                let column = ((angle / TAU * AROUND as f64) as usize).min(AROUND - 1);
                let row = (((along / PI + 0.5) * ALONG as f64) as usize).min(ALONG - 1);
                let (sum, count) = &mut ranges[column * ALONG + row];
                (*sum, *count) = (*sum + way.length(), *count + 1.0);
            }
        }
        let range = |column: usize, row: usize| {
            let (sum, count) = ranges[column % AROUND * ALONG + row];
            (count > 0.0).then(|| sum / count)
        };
        let jumps = |column: usize| {
            let is_jump = |row: &usize| {
                let both = range(column, *row).zip(range(column + 1, *row));
                both.is_some_and(|(one, other)| (one - other).abs() > JUMP * one.min(other))
            };
            (0..ALONG).filter(is_jump).count() as u32
        };
        let mut all: Vec<(u32, usize)> = (0..AROUND).map(|column| (jumps(column), column)).collect();
        all.retain(|(jumps, _)| *jumps >= FEWEST_JUMPS);
        all.sort_unstable_by_key(|(jumps, column)| (u32::MAX - jumps, *column));
        all.truncate(MOST_SIDES);
        all.into_iter().map(|(_, column)| (column + 1) as f64 / AROUND as f64 * TAU).collect()
    }

    /// Points that are seen at most so far from an angle: not many more than `most`.
    fn within(&self, middle: f64, half_angle: f64, most: usize) -> Vec<DVec3> {
        let at = |angle: f64| self.points.partition_point(|(known, _)| *known < angle);
        let [low, high] = [middle - half_angle, middle + half_angle];
        // The part beyond 0 or 2 pi is at the other end.
        let parts = [at(low)..at(high), at(low + TAU)..self.points.len(), 0..at(high - TAU)];
        let step = (parts.iter().map(|part| part.len()).sum::<usize>() / most).max(1);
        parts.into_iter().flatten().step_by(step).map(|index| self.points[index].1).collect()
    }

    fn column(&self, Tried { middle, half_angle, distance, .. }: &Tried) -> Column {
        let (sin, cos) = middle.sin_cos();
        let on_axis = self.station + (self.across[0] * cos + self.across[1] * sin) * *distance;
        Column { on_axis, axis: self.axis, radius: distance * half_angle.sin() }
    }

    /// The best column of a half angle that has a side at an angle; `sign` is to which side of it.
    fn beside(&self, side: f64, sign: f64, half_angle: f64) -> Option<Tried> {
        let points = self.within(side + sign * half_angle, half_angle, TRIED);
        if points.len() < TRIED {
            return None;
        }
        let far = |point: &DVec3| (*point - self.station).reject_from_normalized(self.axis).length();
        let mut ranges: Vec<f64> = points.iter().map(far).collect();
        ranges.sort_unstable_by(f64::total_cmp);
        let start = ranges[ranges.len() / 10] / (1.0 - half_angle.sin()).max(0.1);
        let tried = |off: f64, step: i32| {
            let middle = (side + off + sign * half_angle).rem_euclid(TAU);
            let tried = Tried { middle, half_angle, distance: start / NEARER.powi(step), score: 0.0 };
            let score = self.column(&tried).score(self.station, &points, self.map, 2.0 * self.map.edge());
            Tried { score: score / points.len() as f64, ..tried }
        };
        let all = OFF.iter().flat_map(|off| (1..=DISTANCES).map(move |step| tried(*off, step)));
        let best = all.max_by(|a, b| a.score.total_cmp(&b.score))?;
        (best.score > LEAST_SCORE * (1.0 - BY_CHANCE)).then_some(best)
    }

    /// Columns that may be mirrors, the best first, of which no two are nearly one.
    fn tried(&self) -> Vec<Tried> {
        let widths = (0..HALF_ANGLES).map(|step| FIRST_HALF_ANGLE * WIDER.powi(step));
        let both = |half_angle: f64| [(1.0, half_angle), (-1.0, half_angle)];
        let beside = |side: &f64| {
            widths.clone().flat_map(both).filter_map(|(sign, half)| self.beside(*side, sign, half)).collect::<Vec<_>>()
        };
        let mut all: Vec<Tried> = self.sides().par_iter().flat_map_iter(beside).collect();
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut kept: Vec<Tried> = Vec::new();
        for tried in all {
            if kept.len() < CLOSELY && !kept.iter().any(|known| known.is_near(&tried)) {
                kept.push(tried);
            }
        }
        kept
    }

    /// The best column near one.
    fn close(&self, tried: &Tried) -> Column {
        let points = self.within(tried.middle, tried.half_angle, TRIED_CLOSELY);
        let mut best = (f64::NEG_INFINITY, self.column(tried));
        for step in 0..9 * 7 * 7 {
            let [far, turn, wide] = [step % 9 - 4, step / 9 % 7 - 3, step / 63 - 3].map(f64::from);
            let near = Tried {
                middle: tried.middle + 0.015 * turn * tried.half_angle,
                half_angle: tried.half_angle * (1.0 + 0.02 * wide),
                distance: tried.distance * (1.0 + 0.015 * far),
                ..*tried
            };
            let column = self.column(&near);
            let score = column.score(self.station, &points, self.map, self.map.edge());
            if score > best.0 {
                best = (score, column);
            }
        }
        best.1
    }
}

/// A column that may be a mirror, as a station sees it about an axis.
#[derive(Clone, Copy, Debug)]
struct Tried {
    middle: f64,
    half_angle: f64,
    distance: f64,
    score: f64,
}

impl Tried {
    fn is_near(&self, other: &Self) -> bool {
        let apart = (self.middle - other.middle).rem_euclid(TAU);
        apart.min(TAU - apart) < 0.3 * self.half_angle
            && (self.half_angle / other.half_angle).ln().abs() < 0.2
            && (self.distance / other.distance).ln().abs() < 0.2
    }
}

/// A cylinder without ends.
#[derive(Clone, Copy, Debug)]
struct Column {
    on_axis: DVec3,
    /// A unit vector.
    axis: DVec3,
    radius: f64,
}

/// A point that was seen in a column.
#[derive(Clone, Copy, Debug)]
struct Unfolded {
    place: DVec3,
    /// How far along the axis the beam met the column.
    along: f64,
    /// The angle about the axis at which the beam met the column, from its middle, and the rest of the way across the axis.
    turn: f64,
    rest: f64,
}

/// A point, and what it says of a column.
type Said = (Unfolded, Says, DVec3);

/// What an unfolded point says of a column.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Says {
    /// Nothing: the point is near a surface across the axis.
    Nothing,
    /// The point is so far from another surface.
    Near(f64),
    /// The point is far from all surfaces.
    Against,
}

impl Column {
    fn of(mirror: &Mirror) -> Self {
        Self { on_axis: mirror.position, axis: mirror.rotation * DVec3::Z, radius: mirror.size }
    }

    /// What becomes of a point that was seen in it; `None` if the beam missed or grazed it, or ended near it.
    fn unfolded(&self, station: DVec3, point: DVec3, behind: f64) -> Option<Unfolded> {
        let range = point.distance(station);
        let direction = (point - station) / range;
        let across = |way: DVec3| way - self.axis * way.dot(self.axis);
        let (from, way) = (across(station - self.on_axis), across(direction));
        let (a, b) = (way.length_squared(), from.dot(way));
        let root = b * b - a * (from.length_squared() - self.radius * self.radius);
        let distance = (-b - root.max(0.0).sqrt()) / a;
        let met = station + direction * distance;
        let normal = (from + way * distance) / self.radius;
        let is_one = root > 0.0 && distance > 0.0 && range - distance > behind && -way.dot(normal) > GRAZING * a.sqrt();
        let place = met + (direction - normal * (2.0 * direction.dot(normal))) * (range - distance);
        let turn = normal.dot(self.axis.cross(from).normalize_or_zero()).asin();
        let along = (met - self.on_axis).dot(self.axis);
        is_one.then_some(Unfolded { place, along, turn, rest: (range - distance) * a.sqrt() })
    }

    fn says(&self, place: DVec3, map: &SurfaceMap) -> Says {
        match map.nearest(place) {
            Some(fit) if self.axis.dot(fit.patch.normal.as_dvec3()).abs() > TELLS => Says::Nothing,
            Some(fit) => Says::Near(fit.distance.abs()),
            None => Says::Against,
        }
    }

    /// How many more points are near surfaces, at this scale of distances, than by chance.
    fn score(&self, station: DVec3, points: &[DVec3], map: &SurfaceMap, scale: f64) -> f64 {
        let of_point = |point: &DVec3| {
            let Some(seen) = self.unfolded(station, *point, BEHIND * map.edge()) else { return 0.0 };
            match self.says(seen.place, map) {
                Says::Nothing => 0.0,
                Says::Near(distance) => 1.0 / (1.0 + (distance / scale).powi(2)) - BY_CHANCE,
                Says::Against => -BY_CHANCE,
            }
        };
        points.iter().map(of_point).sum()
    }

    /// The mirror of a part of it.
    fn between(&self, [low, high]: [f64; 2]) -> Mirror {
        let side = self.axis.any_orthonormal_vector();
        let rotation = DQuat::from_mat3(&DMat3::from_cols(side, self.axis.cross(side), self.axis));
        let position = self.on_axis + self.axis * (0.5 * (low + high));
        let shape = Shape::Cylinder { height: 0.5 * (high - low) / self.radius };
        Mirror { position, rotation, ..Mirror::standing(shape, position, self.axis, DVec3::Z, self.radius) }
    }

    /// What a point says that was seen in it.
    fn seen(&self, station: DVec3, place: DVec3, map: &SurfaceMap, near: f64) -> Option<Said> {
        let seen = self.unfolded(station, place, BEHIND * map.edge())?;
        let says = match self.says(seen.place, map) {
            Says::Near(distance) if distance > near => Says::Against,
            says => says,
        };
        Some((seen, says, place))
    }

    /// The expected number of columns, of all that are tried, that fit these points by chance as well as this one.
    fn chances(&self, station: DVec3, own: &[Said], map: &SurfaceMap, near: f64) -> f64 {
        let toward = (self.on_axis - station).reject_from_normalized(self.axis);
        let elsewhere = |step: i32| {
            let share = NEARER.powi(-step);
            let other = Self { on_axis: station + toward * share, radius: self.radius * share, ..*self };
            groups(own.iter().filter_map(|(.., place)| other.seen(station, *place, map, near)), near)
        };
        let (fits, all) = groups(own.iter().copied(), near);
        let sums = (1..=ELSEWHERE).map(elsewhere).fold((0, 0), |sum, (fits, all)| (sum.0 + fits, sum.1 + all));
        let by_chance = (sums.0 + 1) as f64 / (sums.1 + 1) as f64;
        // So many choices of the groups that fit, each with so small a probability.
        let choices = (1..=all - fits).map(|count| (fits + count) as f64 / count as f64).map(f64::ln).sum::<f64>();
        let tried = (2 * MOST_SIDES) as f64 * f64::from(HALF_ANGLES);
        tried * (choices + fits.saturating_sub(FREE) as f64 * by_chance.ln()).exp()
    }

    /// The part of it in which points are near surfaces when they are unfolded.
    fn part(&self, station: DVec3, points: &[DVec3], map: &SurfaceMap, near: f64) -> Option<Part> {
        let seen = |place: &DVec3| self.seen(station, *place, map, near);
        let mut all: Vec<Said> = points.par_iter().filter_map(seen).collect();
        all.sort_by(|a, b| a.0.along.total_cmp(&b.0.along));
        // The stretch with the largest surplus of points that fit (Kadane).
        let (mut start, mut sum, mut best) = (0, 0_i64, (0, 0..0));
        for (index, (_, says, _)) in all.iter().enumerate() {
            if sum <= 0 {
                (start, sum) = (index, 0);
            }
            sum += match says {
                Says::Near(_) => 1,
                Says::Against => -1,
                Says::Nothing => 0,
            };
            if sum > best.0 {
                best = (sum, start..index + 1);
            }
        }
        let own = &all[best.1.clone()];
        let margin = 0.25 * map.edge();
        let mut ends = [own.first()?.0.along - margin, own.last()?.0.along + margin];
        let mut distances: Vec<f64> = own
            .iter()
            .filter_map(|(_, says, _)| if let Says::Near(distance) = says { Some(*distance) } else { None })
            .collect();
        let against = own.iter().filter(|(_, says, _)| *says == Says::Against).count();
        let share = distances.len() as f64 / (distances.len() + against) as f64;
        let middle = distances.len() / 2;
        let residual = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        let (mut seen, fits) = (own.to_vec(), distances.len());
        let is_mirror = fits >= FEWEST_FITS && share > LEAST_FIT && self.chances(station, own, map, near) < CHANCES;
        if self.axis.z.abs() > STANDS {
            let below: Vec<_> = if self.axis.z > 0.0 {
                all[..best.1.start].iter().rev().copied().collect()
            } else {
                all[best.1.end..].to_vec()
            };
            let stands_on = standing(&below);
            if let Some((lowest, ..)) = stands_on.last() {
                // The beam that met the column lowest ends on what the column stands on.
                let foot = (lowest.place - self.on_axis).dot(self.axis);
                if self.axis.z > 0.0 {
                    ends[0] = lowest.along.min(foot);
                } else {
                    ends[1] = lowest.along.max(foot);
                }
            }
            seen.extend_from_slice(stands_on);
        }
        let seen = seen.into_iter().map(|(.., place)| (station, place)).collect();
        Some(Part { mirror: self.between(ends), seen, share, residual, fits, is_mirror })
    }
}

/// Points in groups, of each of which most fit or not: how many fit, and how many there are. Where the beam meets a column
/// at nearly one angle about its axis, a point says what all say. A scanner that stands upright sees an upright column in few
/// such angles, each with many points.
fn groups(seen: impl Iterator<Item = Said>, near: f64) -> (usize, usize) {
    let mut all: Vec<(Unfolded, bool)> = seen
        .filter(|(_, says, _)| *says != Says::Nothing)
        .map(|(seen, says, _)| (seen, matches!(says, Says::Near(_))))
        .collect();
    all.sort_by(|a, b| a.0.turn.total_cmp(&b.0.turn));
    let (mut rest, mut fits, mut count) = (&all[..], 0, 0);
    while let Some((first, _)) = rest.first() {
        let own = rest.partition_point(|(seen, _)| (seen.turn - first.turn) * first.rest < near);
        fits += usize::from(2 * rest[..own].iter().filter(|(_, fits)| *fits).count() > own);
        (rest, count) = (&rest[own..], count + 1);
    }
    (fits, count)
}

/// The points, downwards from the part of a column that is known, down to what it stands on.
fn standing(below: &[Said]) -> &[Said] {
    let (mut sum, mut best) = (0_i64, (0, 0));
    for (index, (_, says, _)) in below.iter().enumerate() {
        sum += if *says == Says::Against { -MISSES } else { 1 };
        if sum > best.0 {
            best = (sum, index + 1);
        }
    }
    &below[..best.1]
}

/// A column that mirrors.
pub struct Part {
    pub mirror: Mirror,
    /// The points that were seen in it.
    pub seen: Vec<Seen>,
    /// The share of those that say something that are near a surface, their median distance from it, and their number.
    pub share: f64,
    pub residual: f64,
    pub fits: usize,
    is_mirror: bool,
}

/// The directions in which columns and pipes may run.
fn axes(walls: &[Plane]) -> Vec<DVec3> {
    let mut axes = vec![DVec3::Z];
    for wall in walls {
        if axes.len() < MOST_AXES && axes.iter().all(|axis| axis.dot(wall.normal).abs() < ONE_AXIS) {
            axes.push(wall.normal);
        }
    }
    axes
}

/// Makes a column or pipe as long as another station sees it, and moves it to where the points of both fit best.
pub fn extend(known: &mut Part, station: DVec3, places: &[DVec3], map: &SurfaceMap, near: f64) {
    let column = Column::of(&known.mirror);
    let Some(part) = column.part(station, places, map, near).filter(|part| part.is_mirror) else { return };
    known.seen.extend(part.seen);
    let ends = [&known.mirror, &part.mirror].map(|mirror| {
        let middle = (mirror.position - column.on_axis).dot(column.axis);
        let half = if let Shape::Cylinder { height } = mirror.shape { height * mirror.size } else { 0.0 };
        [middle - half, middle + half]
    });
    let whole = column.between([ends[0][0].min(ends[1][0]), ends[0][1].max(ends[1][1])]);
    known.mirror = fitted(&whole, &some_of(&known.seen), map);
}

/// Columns that mirror, of which no two are one, those with most points first. Unfolded points fit that are nearer to
/// surfaces than `near`.
pub fn columns(station: DVec3, samples: &[&Sample], walls: &[Plane], map: &SurfaceMap, near: f64) -> Vec<Part> {
    let places: Vec<DVec3> = samples.iter().map(|sample| sample.place).collect();
    let of_axis = |axis: DVec3| {
        let view = View::new(station, axis, samples, map);
        let part = |tried: &Tried| {
            let mut column = view.close(tried);
            for near in [2.0 * map.edge(), near] {
                let part = column.part(station, &places, map, near)?;
                column = Column::of(&fitted(&part.mirror, &some_of(&part.seen), map));
            }
            let part = column.part(station, &places, map, near)?;
            part.is_mirror.then_some(part)
        };
        view.tried().par_iter().filter_map(part).collect::<Vec<_>>()
    };
    let mut parts: Vec<Part> = axes(walls).into_iter().flat_map(of_axis).collect();
    parts.sort_by_key(|part| std::cmp::Reverse(part.fits));
    let mut kept: Vec<Part> = Vec::new();
    for part in parts {
        let is_known = |known: &Part| {
            let [one, other] = [known, &part].map(|part| Column::of(&part.mirror));
            (other.on_axis - one.on_axis).reject_from_normalized(one.axis).length() < one.radius + other.radius
        };
        if !kept.iter().any(is_known) {
            kept.push(part);
        }
    }
    kept
}
