//! Where a scan was taken from.
//!
//! A file or a scene may name the scanner's places. A depth image is seen from its origin. Pulses of an airborne scan
//! with several returns are lines through the scanner: those of half a second meet where it was (Gatziolis and
//! McGaughey 2019), and without such pulses the scan is seen from above. Where none of that helps, places are
//! estimated: those from which most points are seen, one after another.

use cloud::{Bounds, Chunk, Orientation, guess_orientation, hash, is_depth_image, robust_bounds, spread_sample};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::Serialize;
use trace::{Geometry as _, Ray};

use crate::sightlines::{HeldPoint, Scan, TOLERANCE};
use crate::truth::TracedScene;

/// Where the places of a scanner are known from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ScannerFrom {
    /// The file or the scene names them.
    File,
    /// The command line names them.
    Flag,
    /// The scan is a depth image, seen from the origin.
    Origin,
    /// Most points are seen from there.
    Estimated,
    /// Pulses with several returns meet there.
    Returns,
    /// The scan is seen from above.
    Above,
}

/// Where a scan was taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Scanner {
    /// Each point was seen from one of these places at least.
    Places(Vec<DVec3>),
    /// The scanner moved, and the time of a point shows where it was.
    Flight(Flight),
    /// The scanner looked down along a unit vector, from this far above each point.
    Above { down: DVec3, distance: f64 },
}

impl Scanner {
    /// The places that a point may have been seen from; none if the scanner's place at its time is not known.
    pub fn places_of(&self, point: &HeldPoint) -> Vec<DVec3> {
        match self {
            Self::Places(places) => places.clone(),
            Self::Flight(flight) => flight.place(point.time).into_iter().collect(),
            Self::Above { down, distance } => vec![point.position - *down * *distance],
        }
    }

    /// The places, those along a flight included; none where only a direction is known.
    pub fn places(&self) -> Vec<DVec3> {
        match self {
            Self::Places(places) => places.clone(),
            Self::Flight(flight) => flight.stops.iter().map(|(_, place)| *place).collect(),
            Self::Above { .. } => Vec::new(),
        }
    }
}

/// Finds where a scan was taken from. `traced` is a surface of some of its points.
pub fn find(scan: &Scan, traced: &TracedScene, seed: u64) -> (Scanner, ScannerFrom) {
    if !scan.places.is_empty() {
        return (Scanner::Places(scan.places.clone()), ScannerFrom::File);
    }
    let chunks = &scan.cloud.chunks;
    if is_depth_image(chunks) {
        return (Scanner::Places(vec![DVec3::ZERO]), ScannerFrom::Origin);
    }
    match guess_orientation(chunks, scan.up.as_vec3()) {
        Orientation::Up(_) => match Flight::of(scan) {
            Some(flight) => (Scanner::Flight(flight), ScannerFrom::Returns),
            None => (above(chunks, scan.up), ScannerFrom::Above),
        },
        Orientation::Toward(_) => (estimated(chunks, scan.up, true, traced, seed), ScannerFrom::Estimated),
        Orientation::AwayFrom(_) => (estimated(chunks, scan.up, false, traced, seed), ScannerFrom::Estimated),
    }
}

/// From above nothing shows the distance. It is taken to be as far as the scan is wide, and at most ten times as far as
/// it is high, so that the tolerance stays below a tenth of its height.
fn above(chunks: &[Chunk], up: DVec3) -> Scanner {
    let size = robust_bounds(chunks).size();
    let height = size.dot(up.abs());
    let distance = if height > 0.0 { size.length().min(10.0 * height) } else { size.length() };
    Scanner::Above { down: -up, distance: distance.max(f64::MIN_POSITIVE) }
}

/// The places of a scanner at times, in seconds, in order.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    stops: Vec<(f64, DVec3)>,
}

/// The seconds of a flight whose pulses are taken to meet in one place.
const STOP: f64 = 0.5;
/// A place is known for this many seconds before and after it.
const KNOWN_FOR: f64 = 1.0;
/// The fewest pulses that make a place.
const FEWEST_PULSES: usize = 50;

impl Flight {
    /// The place at a time, between those before and after it.
    fn place(&self, time: f64) -> Option<DVec3> {
        let next = self.stops.partition_point(|(stop, _)| *stop < time);
        let before = next.checked_sub(1).map(|index| self.stops[index]);
        let after = self.stops.get(next).copied();
        let is_near = |stop: &(f64, DVec3)| (stop.0 - time).abs() <= KNOWN_FOR;
        match (before.filter(is_near), after.filter(is_near)) {
            (Some((first, from)), Some((last, to))) if last > first => {
                Some(from.lerp(to, (time - first) / (last - first)))
            }
            (before, after) => before.or(after).map(|(_, place)| place),
        }
    }

    /// The flight of an airborne scan, if its pulses show it.
    fn of(scan: &Scan) -> Option<Self> {
        let column = |name: &str| scan.cloud.column_of(name);
        let (number, time) = (column("return_number")?, column("gps_time")?);
        let mut returns: Vec<(f64, u8, DVec3)> = Vec::new();
        for chunk in &scan.cloud.chunks {
            let of = |index: usize| chunk.columns.get(index)?.as_deref();
            let (numbers, times) = (of(number)?, of(time)?);
            let known = (0..chunk.len()).map(|at| (times.value(at), numbers.value(at) as u8, chunk.position(at)));
            returns.extend(known.filter(|(time, _, position)| time.is_finite() && position.is_finite()));
        }
        returns.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // The first and the last return of each pulse that has several.
        let pulses = returns.chunk_by(|a, b| a.0 == b.0).filter_map(|pulse| {
            let (first, last) = (pulse.first()?, pulse.last()?);
            let is_whole = first.1 == 1 && last.1 > 1 && pulse.windows(2).all(|two| two[0].1 < two[1].1);
            let direction = (last.2 - first.2).try_normalize()?;
            let is_down = direction.dot(scan.up) < -0.3;
            (is_whole && is_down).then(|| Line {
                time: first.0,
                point: first.2,
                direction,
                length: first.2.distance(last.2),
            })
        });
        let pulses: Vec<Line> = pulses.collect();
        let stop = |pulses: &[Line]| {
            let time = pulses.iter().map(|pulse| pulse.time).sum::<f64>() / pulses.len() as f64;
            Some((time, meeting(pulses, scan.up)?))
        };
        let of_stop = |a: &Line, b: &Line| (a.time / STOP).floor() == (b.time / STOP).floor();
        let stops: Vec<(f64, DVec3)> = pulses.chunk_by(of_stop).filter_map(stop).collect();
        let flight = Self { stops };
        // Most points must have a time within the stops.
        let step = returns.len().div_ceil(10_000).max(1);
        let sample = || returns.iter().step_by(step);
        let known = sample().filter(|(time, ..)| flight.place(*time).is_some()).count();
        (2 * known > sample().count()).then_some(flight)
    }
}

/// A pulse with several returns.
#[derive(Clone, Copy)]
struct Line {
    time: f64,
    /// The first return.
    point: DVec3,
    direction: DVec3,
    /// The distance from the first to the last return.
    length: f64,
}

/// The place that is nearest to all these lines, by least squares; long pulses show directions better and count more.
/// Lines that pass it three times as far away as most are left out. `None` if the lines do not fix it well.
fn meeting(lines: &[Line], up: DVec3) -> Option<DVec3> {
    let nearest = |lines: &[Line]| {
        let (mut matrix, mut sum, middle) = (DMat3::ZERO, DVec3::ZERO, lines[0].point);
        for Line { point, direction, length, .. } in lines {
            let along = DMat3::from_cols(*direction * direction.x, *direction * direction.y, *direction * direction.z);
            let across = (DMat3::IDENTITY - along) * (length * length);
            matrix += across;
            sum += across * (*point - middle);
        }
        let place = matrix.inverse() * sum + middle;
        place.is_finite().then_some(place)
    };
    let miss = |line: &Line, place: DVec3| line.direction.cross(place - line.point).length();
    if lines.len() < FEWEST_PULSES {
        return None;
    }
    let mut kept = lines.to_vec();
    for _ in 0..4 {
        let place = nearest(&kept)?;
        let mut misses: Vec<f64> = lines.iter().map(|line| miss(line, place)).collect();
        let middle = misses.len() / 2;
        let usual = *misses.select_nth_unstable_by(middle, f64::total_cmp).1;
        kept = lines.iter().filter(|line| miss(line, place) <= 3.0 * usual).copied().collect();
    }
    let place = nearest(&kept)?;
    // The scanner is above the ground, and lines differ in direction by more than they miss the place.
    let height = kept.iter().map(|line| (place - line.point).dot(up)).fold(f64::INFINITY, f64::min);
    let middle = kept.iter().map(|line| line.direction).sum::<DVec3>().normalize_or_zero();
    let spread = kept.iter().map(|line| line.direction.cross(middle).length()).fold(0.0, f64::max);
    let error = (kept.iter().map(|line| miss(line, place).powi(2)).sum::<f64>() / kept.len() as f64).sqrt()
        / (kept.len() as f64).sqrt();
    (height > 0.0 && spread * height > 10.0 * error).then_some(place)
}

/// The most places that are estimated, the share of the points that another one must let see, and the number of points
/// that are looked at from each.
const MOST_PLACES: usize = 8;
const WORTH: f64 = 0.01;
const LOOKED_AT: usize = 4000;

/// The places from which most points are seen, one after another: of a grid in the room, or of places around the object.
fn estimated(chunks: &[Chunk], up: DVec3, is_room: bool, traced: &TracedScene, seed: u64) -> Scanner {
    let bounds = robust_bounds(chunks);
    let mut sample: Vec<DVec3> = spread_sample(chunks).filter(|point| bounds.contains(*point)).collect();
    sample.sort_by_key(|point| hash(point.x.to_bits() ^ hash(point.y.to_bits() ^ hash(point.z.to_bits() ^ seed))));
    sample.truncate(LOOKED_AT);
    let places: Vec<DVec3> = if is_room { inside(bounds, up) } else { around(bounds, up).collect() };
    let sees = |place: DVec3| -> Vec<bool> {
        let sees = |point: &DVec3| {
            let distance = point.distance(place);
            let ray = Ray::from_eye(place - traced.origin, (*point - place) / distance);
            let hit = traced.surfels.nearest(&ray);
            hit.is_some_and(|hit| (hit.distance / distance - 1.0).abs() <= TOLERANCE)
        };
        sample.iter().map(sees).collect()
    };
    let seen: Vec<Vec<bool>> = places.par_iter().map(|place| sees(*place)).collect();
    let mut known = vec![false; sample.len()];
    let mut chosen = Vec::new();
    while chosen.len() < MOST_PLACES {
        let gain = |place: &usize| seen[*place].iter().zip(&known).filter(|(sees, known)| **sees && !**known).count();
        // The first of several as good ones.
        let Some(best) = (0..places.len()).rev().max_by_key(gain) else { break };
        if !chosen.is_empty() && (gain(&best) as f64) < WORTH * sample.len() as f64 {
            break;
        }
        known.iter_mut().zip(&seen[best]).for_each(|(known, sees)| *known |= *sees);
        chosen.push(places[best]);
    }
    Scanner::Places(chosen)
}

/// Places in a box: six along each side, at three heights of which the lowest is that of a tripod in a room.
fn inside(bounds: Bounds, up: DVec3) -> Vec<DVec3> {
    let vertical = up.abs().max_position();
    let [first, second] = [(vertical + 1) % 3, (vertical + 2) % 3];
    let mut places = Vec::new();
    for height in [0.35, 0.5, 0.65] {
        for across in 0..6 {
            for along in 0..6 {
                let mut share = DVec3::ZERO;
                share[vertical] = if up[vertical] > 0.0 { height } else { 1.0 - height };
                share[first] = (f64::from(across) + 0.5) / 6.0;
                share[second] = (f64::from(along) + 0.5) / 6.0;
                places.push(bounds.min + bounds.size() * share);
            }
        }
    }
    places
}

/// Places around a box, three of its radii from its middle: every 45 degrees on three levels, and above.
fn around(bounds: Bounds, up: DVec3) -> impl Iterator<Item = DVec3> {
    let (center, reach) = (bounds.center(), 3.0 * bounds.radius());
    let side = up.any_orthonormal_vector();
    let front = up.cross(side);
    let turned = move |tilt: f64, turn: f64| {
        let (turn, tilt) = (turn.to_radians().sin_cos(), tilt.to_radians().sin_cos());
        (side * turn.1 + front * turn.0) * tilt.1 + up * tilt.0
    };
    let ring =
        [-30.0, 0.0, 30.0].into_iter().flat_map(move |tilt| (0..8).map(move |at| turned(tilt, 45.0 * f64::from(at))));
    ring.chain([up]).map(move |direction| center + direction * reach)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Cloud, Column, ColumnType, Random};

    use super::*;

    /// Ground and trees under a flight at 60 m/s, 900 m above; every pulse has two returns, 12 m apart in height.
    fn flown(noise: f64) -> (Scan, impl Fn(f64) -> DVec3) {
        let place = |time: f64| DVec3::new(500_000.0, 5_000_000.0 + 60.0 * (time - 1000.0), 900.0);
        let mut random = Random(1);
        let mut unit = || (random.draw() >> 11) as f64 / (1_u64 << 53) as f64 - 0.5;
        let (mut positions, mut numbers, mut times) = (Vec::new(), Vec::new(), Vec::new());
        let origin = DVec3::new(500_000.0, 5_000_000.0, 0.0);
        for pulse in 0..4000 {
            let time = 1000.0 + f64::from(pulse) * 0.001;
            let ground = DVec3::new(500_000.0 + 200.0 * unit(), place(time).y + 4.0 * unit(), 0.0);
            for (number, height) in [(1, 12.0), (2, 0.0)] {
                let point = place(time) + (ground - place(time)) * (1.0 - height / 900.0);
                let point = point + DVec3::new(unit(), unit(), unit()) * noise;
                positions.push((point - origin).as_vec3().to_array());
                numbers.push(number);
                times.push(time);
            }
        }
        let attribute = |name: &str, column_type| Attribute { name: name.into(), column_type };
        let mut chunk = Chunk::new(0, origin, positions);
        chunk.columns = vec![Some(Arc::new(Column::U8(numbers))), Some(Arc::new(Column::F64(times)))];
        let attributes = vec![attribute("return_number", ColumnType::U8), attribute("gps_time", ColumnType::F64)];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        (Scan { cloud, up: DVec3::Z, places: Vec::new() }, place)
    }

    #[test]
    fn pulses_with_several_returns_tell_where_the_scanner_flew() {
        for (noise, most) in [(0.0, 16.0), (0.05, 30.0)] {
            let (scan, place) = flown(noise);
            let flight = Flight::of(&scan).unwrap();
            for time in [1000.3, 1001.0, 1002.2, 1003.7] {
                let found = flight.place(time).unwrap();
                // In half a second the scanner moves by 30 m.
                assert!(found.distance(place(time)) < most, "{time}: {found}, {}", place(time));
            }
            assert_eq!(flight.place(2000.0), None);
        }
    }

    #[test]
    fn without_times_or_second_returns_there_is_no_flight() {
        let (scan, _) = flown(0.0);
        let mut single = scan.clone();
        single.cloud.chunks[0].columns[0] = Some(Arc::new(Column::U8(vec![1; 8000])));
        let mut timeless = scan.clone();
        timeless.cloud.attributes[1].name = "other".into();
        let mut odd = scan.clone();
        odd.cloud.chunks[0].columns[1] = Some(Arc::new(Column::F64(vec![f64::NAN; 8000])));
        for scan in [single, timeless, odd, Scan::default()] {
            assert_eq!(Flight::of(&scan), None);
        }
    }
}
