//! Moves mirrors that are roughly known to where unfolded points fit the surfaces of the scan.
//!
//! A suggested mirror is off by centimetres and degrees; points unfolded by it are off by more. The distances of unfolded
//! points from surfaces show how to move it (Gauss and Newton with damping, after Levenberg and Marquardt; weights fall with
//! the distance, on a scale that shrinks from round to round).

use glam::{DQuat, DVec3};
use rayon::prelude::*;
use scene::{Mirror, Shape};

use crate::surface_map::SurfaceMap;
use crate::unfold::{Mirrors, Reflector};

/// The most numbers by which a mirror is moved.
const MOST_NUMBERS: usize = 7;
/// The points by which a mirror is moved at least.
const FEWEST_POINTS: usize = 60;
/// The points by which a mirror is moved at most.
const MOST_POINTS: usize = 1000;
/// The cosine between a surface and the axis of a cylinder up to which it says where the cylinder is.
pub(crate) const TELLS: f64 = 0.9;
/// The cosine between the normals of a surface and of a plane mirror from which on it says where the mirror is.
const TELLS_OF_PLANE: f64 = 0.3;
/// How far apart the places are that are tried for a column across the line of sight, in radii.
const TRIED_EVERY: f64 = 0.03;
/// Points are unfolded by a mirror that is larger than the one that is known, in shares of its size.
const LARGER: f64 = 1.0;
/// The scales of distances from round to round, in edges of the map's finest cells.
const SCALES: [f64; 6] = [8.0, 4.0, 2.0, 1.0, 0.5, 0.2];

type Row = [f64; MOST_NUMBERS];

/// The mirror turned and moved by numbers in world units: a plane by two turns (as lengths at its rim) and along its normal, a
/// sphere by its place and radius, a cylinder across its axis by its place and two turns and by its radius, any other by its
/// place, three turns and its size.
fn changed(mirror: &Mirror, numbers: &Row) -> Mirror {
    let [a, b, c, d, e, f, g] = *numbers;
    let Mirror { rotation, position, size, .. } = mirror;
    let turned = |turn: DVec3| (*rotation * DQuat::from_scaled_axis(turn / *size)).normalize();
    match mirror.shape {
        Shape::Plane { .. } => Mirror {
            rotation: turned(DVec3::new(a, b, 0.0)),
            position: *position + *rotation * DVec3::Z * c,
            ..mirror.clone()
        },
        Shape::Sphere => Mirror { position: *position + DVec3::new(a, b, c), size: size + d, ..mirror.clone() },
        Shape::Cylinder { height } => Mirror {
            position: *position + *rotation * DVec3::new(a, b, 0.0),
            rotation: turned(DVec3::new(c, d, 0.0) / height),
            size: size + e,
            ..mirror.clone()
        },
        _ => Mirror {
            position: *position + DVec3::new(a, b, c),
            rotation: turned(DVec3::new(d, e, f)),
            size: size + g,
            ..mirror.clone()
        },
    }
}

fn numbers_of(mirror: &Mirror) -> usize {
    match mirror.shape {
        Shape::Plane { .. } => 3,
        Shape::Sphere => 4,
        Shape::Cylinder { .. } => 5,
        _ => MOST_NUMBERS,
    }
}

/// The station that may have seen a point, and the point.
pub(crate) type Seen = (DVec3, DVec3);

/// The points by which a mirror is moved.
pub(crate) fn some_of(seen: &[Seen]) -> Vec<Seen> {
    seen.iter().copied().step_by(seen.len().div_ceil(MOST_POINTS).max(1)).collect()
}

/// A mirror where points fit best.
pub(crate) fn moved(given: &Mirror, seen: &[Seen], map: &SurfaceMap) -> Mirror {
    let edge = map.edge();
    let mut mirror = given.clone();
    for scale in SCALES {
        for _ in 0..6 {
            match step(&mirror, seen, map, scale * edge) {
                Some(next) => mirror = next,
                None => break,
            }
        }
    }
    mirror
}

/// A mirror moved from where it stands to where points fit best, also a thin column. There must be points.
pub(crate) fn fitted(mirror: &Mirror, seen: &[Seen], map: &SurfaceMap) -> Mirror {
    let rough = moved(mirror, seen, map);
    let Shape::Cylinder { .. } = mirror.shape else { return rough };
    // Floors and ceilings have put the axis upright. A thin column that is off by a tenth of its radius throws points far
    // from their walls, so places about it are tried.
    let axis = rough.rotation * DVec3::Z;
    let toward = (seen[0].0 - mirror.position).reject_from_normalized(axis).normalize_or_zero();
    let place = |across: i32, along: i32| {
        let off = axis.cross(toward) * f64::from(across) + toward * (2.0 * f64::from(along));
        Mirror { position: mirror.position + off * (TRIED_EVERY * mirror.size), size: mirror.size, ..rough.clone() }
    };
    let tried = (-10..=10).flat_map(|across| (-5..=5).map(move |along| (across, along)));
    let tried: Vec<Mirror> = tried.map(|(across, along)| place(across, along)).collect();
    let few: Vec<Seen> = seen.iter().copied().step_by(4).collect();
    let score = |mirror: &Mirror| {
        let fits = fits(mirror, &few, map).into_iter().filter(|(_, tells)| *tells);
        fits.map(|(distance, _)| 1.0 / (1.0 + (distance / map.edge()).powi(2))).sum::<f64>()
    };
    let scores: Vec<f64> = tried.par_iter().map(score).collect();
    let best = scores.iter().zip(&tried).max_by(|a, b| a.0.total_cmp(b.0)).map(|(_, mirror)| mirror);
    moved(best.unwrap_or(&rough), seen, map)
}

/// How far each point is from a surface when it is unfolded by a mirror.
pub(crate) fn distances(mirror: &Mirror, seen: &[Seen], map: &SurfaceMap) -> Vec<Option<f64>> {
    let mirrors = unfolding(mirror);
    seen.iter().map(|(station, point)| Some(map.nearest(unfolded(&mirrors, *station, *point)?)?.distance)).collect()
}

/// How far points are from a surface when they are unfolded by a mirror, if they are near one, and whether that says where
/// the mirror is. A cylinder unfolds the points of a surface across its axis, as a floor is across a column's, to the same
/// surface wherever it stands, and an upright plane does so with floors, too.
pub(crate) fn fits(mirror: &Mirror, seen: &[Seen], map: &SurfaceMap) -> Vec<(f64, bool)> {
    let mirrors = unfolding(mirror);
    let axis = mirror.rotation * DVec3::Z;
    let tells = |surface: DVec3| match mirror.shape {
        Shape::Plane { .. } => axis.dot(surface).abs() > TELLS_OF_PLANE,
        Shape::Cylinder { .. } => axis.dot(surface).abs() < TELLS,
        _ => true,
    };
    let fit = |(station, point): &Seen| {
        let fit = map.nearest(unfolded(&mirrors, *station, *point)?)?;
        Some((fit.distance, tells(fit.patch.normal.as_dvec3())))
    };
    seen.iter().filter_map(fit).collect()
}

/// A mirror by which also points beside it are unfolded, as far as its shape goes on there.
fn unfolding(mirror: &Mirror) -> Mirrors {
    let mut larger = mirror.clone();
    match &mut larger.shape {
        Shape::Plane { .. } => larger.size *= 1.0 + LARGER,
        Shape::Cylinder { height } => *height *= 1.0 + LARGER,
        _ => {}
    }
    Mirrors::new(vec![Reflector { is_open: false, ..Reflector::exact(larger) }])
}

fn unfolded(mirrors: &Mirrors, station: DVec3, point: DVec3) -> Option<DVec3> {
    mirrors
        .ways(station, point, 0.0)
        .into_iter()
        .find(|way| way.mirrors[0] == 1 && way.mirrors[1] == 0)
        .map(|way| way.place)
}

/// One step of Gauss and Newton; `None` if too few points say where to go, or if it does not get better.
fn step(mirror: &Mirror, seen: &[Seen], map: &SurfaceMap, scale: f64) -> Option<Mirror> {
    let count = numbers_of(mirror);
    let small = 1e-4 * mirror.size;
    let number = |index: usize, value: f64| {
        let mut numbers = [0.0; MOST_NUMBERS];
        numbers[index] = value;
        unfolding(&changed(mirror, &numbers))
    };
    let own = unfolding(mirror);
    let others: Vec<[Mirrors; 2]> = (0..count).map(|index| [number(index, small), number(index, -small)]).collect();
    let (mut matrix, mut side, mut used) = ([[0.0; MOST_NUMBERS]; MOST_NUMBERS], [0.0; MOST_NUMBERS], 0);
    for (station, point) in seen {
        let Some(fit) = unfolded(&own, *station, *point).and_then(|place| map.nearest(place)) else { continue };
        let normal = fit.patch.normal.as_dvec3();
        let slope = |[more, less]: &[Mirrors; 2]| {
            let ends = [more, less].map(|mirrors| unfolded(mirrors, *station, *point));
            Some(normal.dot(ends[0]? - ends[1]?) / (2.0 * small))
        };
        let mut row = [0.0; MOST_NUMBERS];
        let slopes: Option<Vec<f64>> = others.iter().map(slope).collect();
        let Some(slopes) = slopes else { continue };
        row[..count].copy_from_slice(&slopes);
        let weight = 1.0 / (1.0 + (fit.distance / scale).powi(2)).powi(2);
        for a in 0..count {
            side[a] -= weight * row[a] * fit.distance;
            for b in 0..count {
                matrix[a][b] += weight * row[a] * row[b];
            }
        }
        used += 1;
    }
    if used < FEWEST_POINTS {
        return None;
    }
    let cost = |mirror: &Mirror| {
        // What is near no surface costs as much as what is far from one.
        let loss =
            |distance: Option<f64>| distance.map_or(1.0, |distance| 1.0 - 1.0 / (1.0 + (distance / scale).powi(2)));
        distances(mirror, seen, map).into_iter().map(loss).sum::<f64>()
    };
    let before = cost(mirror);
    [1e-3, 1e-1, 10.0].into_iter().find_map(|damping| {
        let mut damped = matrix;
        (0..count).for_each(|index| damped[index][index] *= 1.0 + damping);
        let numbers = solved(damped, side, count)?;
        let is_small = numbers.iter().all(|number| number.abs() < 0.5 * mirror.size);
        let next = changed(mirror, &numbers);
        (is_small && next.size > 0.0 && cost(&next) < before * (1.0 - 1e-6)).then_some(next)
    })
}

/// The solution of a system of equations, by elimination with pivots; `None` if it has no single one.
fn solved(mut matrix: [Row; MOST_NUMBERS], mut side: Row, count: usize) -> Option<Row> {
    for column in 0..count {
        let pivot = (column..count).max_by(|a, b| matrix[*a][column].abs().total_cmp(&matrix[*b][column].abs()))?;
        matrix.swap(column, pivot);
        side.swap(column, pivot);
        if matrix[column][column].abs() < 1e-300 {
            return None;
        }
        for row in column + 1..count {
            let factor = matrix[row][column] / matrix[column][column];
            (column..count).for_each(|at| matrix[row][at] -= factor * matrix[column][at]);
            side[row] -= factor * side[column];
        }
    }
    let mut solution = [0.0; MOST_NUMBERS];
    for row in (0..count).rev() {
        let known: f64 = (row + 1..count).map(|at| matrix[row][at] * solution[at]).sum();
        solution[row] = (side[row] - known) / matrix[row][row];
    }
    solution.iter().all(|number| number.is_finite()).then_some(solution)
}
