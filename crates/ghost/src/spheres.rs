//! Suggests spheres that mirror: round outlines in what a station sees.
//!
//! Ranges jump or change fast where sightlines pass from beside a mirroring ball to its reflections. Each direction with
//! such a change votes for the middles of all circles of some radii that it may be on (Hough). The circle gives the
//! direction of the ball and the ratio of its radius to its distance; the distance is then tried in steps, by how many
//! points within the circle fit a surface when they are unfolded.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use rayon::prelude::*;
use scene::{Mirror, Shape};

use crate::refine::Seen;
use crate::surface_map::SurfaceMap;

/// Pixels around a station, and half as many from pole to pole.
const COLUMNS: usize = 480;
const ROWS: usize = COLUMNS / 2;
/// The edge of a pixel in radians.
const PIXEL: f64 = TAU / COLUMNS as f64;
/// The radii of circles in pixels.
const RADII: std::ops::Range<usize> = 3..26;
/// Ranges of neighbours that differ by more than this share of the nearer one are no surface that is seen aslant.
const JUMP: f64 = 0.08;
/// The share of a circle that votes at least, and the circles that are tried.
const LEAST_VOTES: f64 = 0.3;
const MOST_CIRCLES: usize = 150;
/// The points by which a ball is tried.
const TRIED: usize = 80;
/// Balls of a circle that are tried: distances, each a share farther than the one before.
const DISTANCES: usize = 48;
const FARTHER: f64 = 1.06;

fn pixel(way: DVec3) -> Option<usize> {
    let length = way.length();
    let across = (way.y.atan2(way.x) / TAU + 0.5) * COLUMNS as f64;
    let down = (way.z / length).clamp(-1.0, 1.0).acos() / PI * ROWS as f64;
    (length > 0.0 && length.is_finite())
        .then(|| (down as usize).min(ROWS - 1) * COLUMNS + (across as usize).min(COLUMNS - 1))
}

fn direction(pixel: usize) -> DVec3 {
    let across = ((pixel % COLUMNS) as f64 + 0.5) / COLUMNS as f64;
    let down = ((pixel / COLUMNS) as f64 + 0.5) / ROWS as f64;
    let ((sin, cos), (over, level)) = ((down * PI).sin_cos(), ((across - 0.5) * TAU).sin_cos());
    DVec3::new(sin * level, sin * over, cos)
}

/// Directions at which the range changes fast.
fn edges(station: DVec3, points: &[DVec3]) -> Vec<DVec3> {
    let mut ranges = vec![(0.0, 0.0); COLUMNS * ROWS];
    for place in points {
        if let Some(pixel) = pixel(*place - station) {
            let (sum, count) = &mut ranges[pixel];
            (*sum, *count) = (*sum + place.distance(station), *count + 1.0);
        }
    }
    let range = |pixel: usize| ranges.get(pixel).filter(|(_, count)| *count > 0.0).map(|(sum, count)| sum / count);
    let is_edge = |pixel: &usize| {
        let (row, column) = (pixel / COLUMNS, pixel % COLUMNS);
        let right = row * COLUMNS + (column + 1) % COLUMNS;
        let Some(own) = range(*pixel) else { return false };
        [right, pixel + COLUMNS].into_iter().filter_map(range).any(|other| (own - other).abs() > JUMP * own.min(other))
    };
    (0..COLUMNS * ROWS).filter(is_edge).map(direction).collect()
}

/// A cone about a round outline.
#[derive(Clone, Copy)]
struct Circle {
    axis: DVec3,
    /// The angle between its axis and its side in radians.
    angle: f64,
    votes: f64,
}

fn circles(edges: &[DVec3]) -> Vec<Circle> {
    let of_radius = |radius: usize| {
        let angle = radius as f64 * PIXEL;
        let steps = (TAU * radius as f64 * 1.2) as usize;
        let mut votes = vec![0_u16; COLUMNS * ROWS];
        let mut mine: Vec<usize> = Vec::with_capacity(steps);
        for edge in edges {
            let side = edge.any_orthonormal_vector();
            mine.clear();
            mine.extend((0..steps).filter_map(|step| {
                let turn = DQuat::from_axis_angle(*edge, TAU * step as f64 / steps as f64);
                pixel(*edge * angle.cos() + turn * side * angle.sin())
            }));
            mine.sort_unstable();
            mine.dedup();
            mine.iter().for_each(|pixel| votes[*pixel] += 1);
        }
        // As many pixels as are on the circle.
        let all = TAU * radius as f64;
        let circle =
            |(pixel, votes): (usize, u16)| Circle { axis: direction(pixel), angle, votes: f64::from(votes) / all };
        votes.into_iter().enumerate().map(circle).filter(|circle| circle.votes > LEAST_VOTES).collect::<Vec<_>>()
    };
    let mut all: Vec<Circle> = RADII.into_par_iter().flat_map_iter(of_radius).collect();
    all.sort_by(|a, b| b.votes.total_cmp(&a.votes));
    let mut kept: Vec<Circle> = Vec::new();
    for circle in all {
        let is_near = |known: &Circle| {
            known.axis.angle_between(circle.axis) < 1.5 * PIXEL && (known.angle - circle.angle).abs() < 1.5 * PIXEL
        };
        if kept.len() < MOST_CIRCLES && !kept.iter().any(is_near) {
            kept.push(circle);
        }
    }
    kept
}

/// The place where a point is that was seen in a ball.
fn unfolded(middle: DVec3, radius: f64, station: DVec3, point: DVec3) -> Option<DVec3> {
    let range = point.distance(station);
    let direction = (point - station) / range;
    let (from, along) = (station - middle, (station - middle).dot(direction));
    let distance = -along - (along * along - from.length_squared() + radius * radius).max(0.0).sqrt();
    let met = station + direction * distance;
    let normal = (met - middle) / radius;
    (distance > 0.0 && distance < range)
        .then(|| met + (direction - normal * (2.0 * direction.dot(normal))) * (range - distance))
}

/// Balls that may be mirrors, with the points within their outlines: the best of each circle, those that most points fit
/// first.
pub fn suggested(station: DVec3, points: &[DVec3], map: &SurfaceMap) -> Vec<(Mirror, Vec<Seen>)> {
    let ways: Vec<DVec3> = points.iter().map(|place| (*place - station).normalize()).collect();
    let ball = |circle: &Circle| {
        let cosine = (circle.angle * 0.9).cos();
        let is_within = |(_, way): &(&DVec3, &DVec3)| way.dot(circle.axis) > cosine;
        let within: Vec<DVec3> = points.iter().zip(&ways).filter(is_within).map(|(place, _)| *place).collect();
        if within.len() < TRIED {
            return None;
        }
        let step = within.len() / TRIED;
        let tried: Vec<DVec3> = within.iter().copied().step_by(step).collect();
        let mut ranges: Vec<f64> = tried.iter().map(|place| place.distance(station)).collect();
        ranges.sort_unstable_by(f64::total_cmp);
        let nearest = ranges[ranges.len() / 20];
        let mut best: Option<(f64, DVec3, f64)> = None;
        for widened in [1.0, 1.12, 1.25] {
            let sine = (circle.angle * widened).sin();
            let mut distance = nearest / (1.0 - sine).max(0.1);
            for _ in 0..DISTANCES {
                distance /= FARTHER;
                let (middle, radius) = (station + circle.axis * distance, distance * sine);
                let fits = tried.iter().filter_map(|point| map.nearest(unfolded(middle, radius, station, *point)?));
                let score: f64 = fits.map(|fit| 1.0 / (1.0 + (fit.distance / (2.0 * map.edge())).powi(2))).sum();
                if best.is_none_or(|(known, ..)| score > known) {
                    best = Some((score, middle, radius));
                }
            }
        }
        let (score, middle, radius) = best?;
        let mirror = Mirror { position: middle, ..Mirror::standing(Shape::Sphere, middle, DVec3::Z, DVec3::Z, radius) };
        let seen = within.into_iter().map(|place| (station, place)).collect();
        Some((score / tried.len() as f64, mirror, seen))
    };
    let mut balls: Vec<(f64, Mirror, Vec<Seen>)> =
        circles(&edges(station, points)).par_iter().filter_map(ball).collect();
    balls.sort_by(|a, b| b.0.total_cmp(&a.0));
    balls.into_iter().map(|(_, mirror, seen)| (mirror, seen)).collect()
}
