//! Made scans of a tripod, whose surfaces are known exactly: rooms, halls, a street and a church.
//!
//! A scanner on a tripod sends rays at even angles, so its points are dense beside it and sparse at the end of a hall.
//! Rays go out on a grid of azimuth and elevation from each station, and none goes down by more than 60 degrees. Their
//! ranges may have noise; some of them lie between those of two neighbours, where a ray is split by an edge ("mixed
//! pixels"); others are of nothing at all (strays). A sphere, a plane and a ring beside the camera mirror what was
//! scanned. They stand in the scene only when it is looked at: no ray of a scanner meets them.
//!
//! Lengths are metres, and z points up.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, TAU};
use std::sync::Arc;

use cloud::{CHUNK_POINTS, Chunk, unit};
use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::mirror::MIRROR_GREY;
use crate::solid::{self, Form, Solid};
use crate::surface_points::srgb;
use crate::{Camera, Mirror, Settings, Shape};

/// The made scans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tripod {
    Even,
    Room,
    Mixed,
    Four,
    Hall,
    Hall30,
    Hall40,
    Street,
    Church,
}

/// How a scan was made.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Survey {
    stations: usize,
    /// The standard deviation of ranges.
    noise: f64,
    /// The shares of the rays that are mixed pixels, and strays.
    mixed: f64,
    strays: f64,
    /// Points evenly by area instead of rays, of what the stations see.
    is_even: bool,
}

const CLEAN: Survey = Survey { stations: 1, noise: 0.0, mixed: 0.0, strays: 0.0, is_even: false };

impl Tripod {
    pub const ALL: [Self; 9] = [
        Self::Even,
        Self::Room,
        Self::Mixed,
        Self::Four,
        Self::Hall,
        Self::Hall30,
        Self::Hall40,
        Self::Street,
        Self::Church,
    ];

    /// The second part of the name, as in `tripod/hall`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Even => "even",
            Self::Room => "room",
            Self::Mixed => "mixed",
            Self::Four => "four",
            Self::Hall => "hall",
            Self::Hall30 => "hall-30",
            Self::Hall40 => "hall-40",
            Self::Street => "street",
            Self::Church => "church",
        }
    }

    pub fn help(self) -> &'static str {
        match self {
            Self::Even => "a made scan, points evenly by area: a room of 8 m",
            Self::Room => "a made scan: the room of 8 m from one station",
            Self::Mixed => "a made scan: the room from two stations, 3 mm noise, 0.1 % mixed pixels",
            Self::Four => "a made scan: the room from four stations, 1 mm noise, 0.1 % mixed pixels, 0.05 % strays",
            Self::Hall => "a made scan: a hall of 24 m from one station at its end",
            Self::Hall30 => "a made scan: a hall of 30 m from one station at its end",
            Self::Hall40 => "a made scan: a hall of 40 m from two stations at its end, 2 mm noise",
            Self::Street => {
                "a made scan: a street of 60 m from four stations, 3 mm noise, 0.1 % mixed pixels, 0.05 % strays"
            }
            Self::Church => "a made scan: a vaulted church of 30 m from two stations, 1 mm noise, 0.1 % mixed pixels",
        }
    }

    fn survey(self) -> Survey {
        match self {
            Self::Even => Survey { is_even: true, ..CLEAN },
            Self::Room | Self::Hall | Self::Hall30 => CLEAN,
            Self::Mixed => Survey { stations: 2, noise: 0.003, mixed: 1e-3, ..CLEAN },
            Self::Four => Survey { stations: 4, noise: 0.001, mixed: 1e-3, strays: 5e-4, ..CLEAN },
            Self::Hall40 => Survey { stations: 2, noise: 0.002, ..CLEAN },
            Self::Street => Survey { stations: 4, noise: 0.003, mixed: 1e-3, strays: 5e-4, ..CLEAN },
            Self::Church => Survey { stations: 2, noise: 0.001, mixed: 1e-3, ..CLEAN },
        }
    }

    /// The places of the scanner.
    pub fn stations(self) -> Vec<DVec3> {
        let places = match self {
            Self::Street => [[4.0, 5.0, 1.8], [12.0, 7.5, 1.8], [20.0, 5.0, 1.8], [28.0, 7.5, 1.8]],
            Self::Church => [[3.0, 5.4, 1.6], [11.0, 4.0, 1.6], [19.0, 5.4, 1.6], [27.0, 4.0, 1.6]],
            _ => [[2.9, 2.6, 1.55], [6.9, 5.1, 1.55], [1.1, 5.2, 1.55], [7.2, 0.6, 1.55]],
        };
        places.into_iter().take(self.survey().stations).map(DVec3::from).collect()
    }

    /// The length of the hall, if it is one.
    fn length(self) -> f64 {
        match self {
            Self::Hall => 24.0,
            Self::Hall30 => 30.0,
            Self::Hall40 => 40.0,
            _ => 8.0,
        }
    }

    /// How far camera and mirrors are moved from their places in the room of 8 m.
    fn shift(self) -> DVec3 {
        match self {
            Self::Street => DVec3::new(42.8, 6.0, 0.0),
            Self::Church => DVec3::new(16.8, 4.0, 0.0),
            _ => DVec3::X * ((self.length() - 8.0) * 0.6),
        }
    }

    /// What is scanned.
    pub fn solids(self) -> Vec<Solid> {
        match self {
            Self::Street => street(),
            Self::Church => church(),
            _ => hall(self.length(), self.shift().x),
        }
    }

    pub fn mirrors(self) -> Vec<Mirror> {
        let mirror = |name: &str, shape, position: [f64; 3], rotation, size| Mirror {
            name: name.to_owned(),
            shape,
            position: DVec3::from(position) + self.shift(),
            rotation,
            size,
            color: [MIRROR_GREY; 3],
            specular_intensity: 1.0,
            specular_power: 0.0,
            refraction: None,
            as_points: false,
            method: None,
        };
        // The mirror's z axis is turned to -y, and its y axis to z.
        let upright = DQuat::from_xyzw(FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2);
        let (sin, cos) = 65.0_f64.to_radians().sin_cos();
        let leaning = DQuat::from_rotation_arc(DVec3::Z, DVec3::new(sin * -0.8, sin * -0.6, cos));
        vec![
            mirror("sphere", Shape::Sphere, [4.4, 3.9, 1.0], DQuat::IDENTITY, 0.4),
            mirror("plane", Shape::Plane { height: 0.7 / 0.9 }, [3.4, 5.96, 1.6], upright, 0.9),
            mirror("torus", Shape::Torus { tube: 0.13 / 0.42 }, [5.6, 2.9, 1.55], leaning, 0.42),
        ]
    }

    pub fn camera(self) -> Camera {
        let [eye, pivot] = [[1.2, 1.0, 1.6], [5.2, 3.9, 1.3]].map(|place| DVec3::from(place) + self.shift());
        Camera::from_eye(eye, pivot, DVec3::Z)
    }

    /// The parameters that belong to the scene: rays 0.2 degrees apart.
    pub fn settings(self) -> Settings {
        let mut settings = Settings::default();
        settings.scene.points = 1_350_000 * self.survey().stations as u32;
        settings
    }

    /// Whether some station sees this place on the surface of the solids.
    pub fn is_scanned(self, solids: &[Solid], place: DVec3) -> bool {
        self.stations().into_iter().any(|station| sees(solids, station, place))
    }
}

/// The lowest and the highest elevation of a ray.
const ELEVATIONS: [f64; 2] = [-FRAC_PI_2 * 2.0 / 3.0, FRAC_PI_2];
/// A ray that ends before a place by more than this share of its distance does not see it.
const REACHED: f64 = 1e-6;

fn sees(solids: &[Solid], station: DVec3, place: DVec3) -> bool {
    let (way, distance) = (place - station, place.distance(station));
    let direction = way / distance;
    let is_free = |hit: solid::SolidHit| hit.distance >= distance * (1.0 - REACHED);
    direction.z >= ELEVATIONS[0].sin() && solid::nearest(solids, station, direction).is_none_or(is_free)
}

/// A number in 0 .. 1 for each ray, of the draw of this name.
#[derive(Clone, Copy)]
struct Dice {
    seed: u64,
}

impl Dice {
    fn new(seed: u64, station: usize, draw: u64) -> Self {
        Self { seed: seed.wrapping_mul(1 << 16).wrapping_add(station as u64 * 256 + draw) }
    }

    fn throw(self, ray: usize) -> f64 {
        unit(self.seed, ray as u64)
    }
}

/// The draws of a station.
mod draw {
    pub const TURN: u64 = 0;
    pub const NOISE: u64 = 1;
    pub const NOISE_TOO: u64 = 2;
    pub const MIXED: u64 = 3;
    pub const BETWEEN: u64 = 4;
    pub const STRAY: u64 = 5;
    pub const ANYWHERE: u64 = 6;
    pub const FACE: u64 = 7;
    pub const ACROSS: u64 = 8;
    pub const ALONG: u64 = 9;
}

/// A point of a scan and its linear albedo.
type Point = (DVec3, [f64; 3]);

/// The points of a scan, in the order of its rays, without normals and radii: `rays` are those of all stations
/// together. The same seed gives the same points.
pub fn scan(tripod: Tripod, rays: u64, seed: u64) -> Vec<Chunk> {
    let (survey, solids, stations) = (tripod.survey(), tripod.solids(), tripod.stations());
    let scans: Vec<(Option<DVec3>, Vec<Point>)> = if survey.is_even {
        vec![(None, evenly(&solids, &stations, rays as usize, seed))]
    } else {
        let share = rays as f64 / stations.len() as f64;
        let of_station =
            |(index, station): (usize, &DVec3)| (Some(*station), swept(&survey, &solids, *station, share, seed, index));
        stations.iter().enumerate().map(of_station).collect()
    };
    let mut chunks = Vec::new();
    let mut first_point = 0;
    for (station, points) in scans {
        let chunk = |(index, points): (usize, &[Point])| {
            let places: Vec<DVec3> = points.iter().map(|(place, _)| *place).collect();
            let colors = Some(Arc::new(points.iter().map(|(_, albedo)| srgb(*albedo)).collect()));
            Chunk { colors, station, ..Chunk::of_places(first_point + (index * CHUNK_POINTS) as u64, &places) }
        };
        chunks.par_extend(points.par_chunks(CHUNK_POINTS).enumerate().map(chunk));
        first_point += points.len() as u64;
    }
    chunks
}

/// The numbers of directions and of elevations of a station with so many rays, as far apart each way.
fn grid(rays: f64) -> [usize; 2] {
    let range = ELEVATIONS[1] - ELEVATIONS[0];
    let columns = (rays * TAU / range).sqrt().round().max(12.0);
    [columns as usize, (columns * range / TAU).round() as usize]
}

/// Neighbours whose ranges differ by less are on one surface.
const EDGE: f64 = 0.1;

/// What disturbs the ranges of a scanner.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Disturbance {
    /// The standard deviation of ranges.
    pub noise: f64,
    /// The share of the rays that are mixed pixels.
    pub mixed: f64,
    /// The share of the rays that measure nothing that is there.
    pub strays: f64,
}

/// A point that a scanner measured.
#[derive(Clone, Copy, Debug)]
pub struct Measured<T> {
    /// The direction of its ray, a unit vector.
    pub direction: DVec3,
    pub range: f64,
    /// Whether the range is of one surface: the point is no mixed pixel and no stray.
    pub is_whole: bool,
    /// What the ray met.
    pub met: T,
}

/// What a scanner measures at a station: `rays` go out on the grid of angles, and `meet` gives the range of a ray and what
/// it met. `number` is that of the station, which the random draws depend on.
pub fn sweep<T: Copy + Send + Sync>(
    disturbance: &Disturbance,
    rays: f64,
    seed: u64,
    number: usize,
    meet: impl Fn(usize, DVec3) -> Option<(f64, T)> + Sync,
) -> Vec<Measured<T>> {
    let dice = |draw| Dice::new(seed, number, draw);
    let [columns, rows] = grid(rays);
    let step = TAU / columns as f64;
    let turn = dice(draw::TURN).throw(0);
    let direction = |ray: usize| {
        let (sin, cos) = (ELEVATIONS[0] + ((ray / columns) as f64 + 0.5) * step).sin_cos();
        let (across, along) = (((ray % columns) as f64 + turn) * step).sin_cos();
        DVec3::new(cos * along, cos * across, sin)
    };
    let hits: Vec<Option<(f64, T)>> =
        (0..rows * columns).into_par_iter().map(|ray| meet(ray, direction(ray))).collect();
    let range = |ray: usize| hits[ray].map(|(range, _)| range);
    // The range beyond the edge that splits a ray and the next one of its row.
    let beyond = |ray: usize| {
        let next = if ray % columns + 1 == columns { ray + 1 - columns } else { ray + 1 };
        range(next).filter(|next| range(ray).is_some_and(|own| (own - next).abs() > EDGE))
    };
    let normal = |ray: usize| {
        let [one, other] = [draw::NOISE, draw::NOISE_TOO].map(|draw| dice(draw).throw(ray));
        // Box and Muller (1958).
        (-2.0 * (1.0 - one).ln()).sqrt() * (TAU * other).cos()
    };
    let measured = |ray: usize| -> Option<f64> {
        let own = range(ray)?;
        Some(own + if disturbance.noise > 0.0 { disturbance.noise * normal(ray) } else { 0.0 })
    };
    let mut ranges: Vec<Option<f64>> = (0..hits.len()).into_par_iter().map(measured).collect();
    let mut is_mixed = vec![false; hits.len()];
    if disturbance.mixed > 0.0 {
        let split = |ray: usize| beyond(ray).map(|beyond| (dice(draw::MIXED).throw(ray), ray, beyond));
        let mut split: Vec<(f64, usize, f64)> = (0..hits.len()).into_par_iter().filter_map(split).collect();
        split.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        split.truncate((disturbance.mixed * hits.len() as f64) as usize);
        for (_, ray, beyond) in split {
            ranges[ray] = range(ray).map(|own| own + (beyond - own) * dice(draw::BETWEEN).throw(ray));
            is_mixed[ray] = true;
        }
    }
    let point = |ray: usize| {
        let (range, (_, met)) = (ranges[ray]?, hits[ray]?);
        let is_stray = disturbance.strays > 0.0 && dice(draw::STRAY).throw(ray) < disturbance.strays;
        // From near the scanner to half as far again as the surface.
        let range = if is_stray { range * (0.1 + 1.4 * dice(draw::ANYWHERE).throw(ray)) } else { range };
        Some(Measured { direction: direction(ray), range, is_whole: !(is_stray || is_mixed[ray]), met })
    };
    (0..hits.len()).into_par_iter().filter_map(point).collect()
}

/// What the scanner measures at a station of a made scan.
fn swept(survey: &Survey, solids: &[Solid], station: DVec3, rays: f64, seed: u64, number: usize) -> Vec<Point> {
    let disturbance = Disturbance { noise: survey.noise, mixed: survey.mixed, strays: survey.strays };
    let meet = |_, direction: DVec3| {
        let hit = solid::nearest(solids, station, direction)?;
        Some((hit.distance, solids[hit.solid].albedo_at(station + direction * hit.distance)))
    };
    let measured = sweep(&disturbance, rays, seed, number, meet);
    measured.into_iter().map(|point| (station + point.direction * point.range, point.met)).collect()
}

/// Points at random, evenly by area, on what the stations see.
fn evenly(solids: &[Solid], stations: &[DVec3], count: usize, seed: u64) -> Vec<Point> {
    let faces: Vec<Face> = solids.iter().enumerate().flat_map(|(solid, own)| faces(solid, own)).collect();
    let mut total = 0.0;
    let ends: Vec<f64> = faces
        .iter()
        .map(|face| {
            total += face.area;
            total
        })
        .collect();
    let [face, across, along] = [draw::FACE, draw::ACROSS, draw::ALONG].map(|draw| Dice::new(seed, 0, draw));
    let tried = |index: usize| -> Option<Point> {
        let chosen = ends.partition_point(|end| *end < face.throw(index) * total).min(faces.len() - 1);
        let (place, normal) = faces[chosen].at(across.throw(index), along.throw(index));
        let is_seen = |station: &DVec3| (*station - place).dot(normal) > 0.0 && sees(solids, *station, place);
        stations.iter().any(is_seen).then(|| (place, solids[faces[chosen].solid].albedo_at(place)))
    };
    let (mut points, mut first) = (Vec::with_capacity(count), 0);
    // The faces that stations see are a good part of all; a station in a closed block would see none.
    while points.len() < count && first < 64 * count {
        let found: Vec<Point> = (first..first + count).into_par_iter().filter_map(tried).collect();
        points.extend(found);
        first += count;
    }
    points.truncate(count);
    points
}

/// A side of a solid.
struct Face {
    solid: usize,
    area: f64,
    form: Side,
}

enum Side {
    Flat {
        corner: DVec3,
        edges: [DVec3; 2],
        normal: DVec3,
    },
    /// The part of a cylinder from `from` by `turn`, about the axis.
    Round {
        start: DVec3,
        axis: DVec3,
        from: DVec3,
        turn: f64,
        outward: f64,
    },
}

impl Face {
    /// The place at shares of the face's width and height, and the normal there.
    fn at(&self, across: f64, along: f64) -> (DVec3, DVec3) {
        match self.form {
            Side::Flat { corner, edges, normal } => (corner + edges[0] * across + edges[1] * along, normal),
            Side::Round { start, axis, from, turn, outward } => {
                let spoke = DQuat::from_axis_angle(axis.normalize(), turn * across) * from;
                (start + spoke + axis * along, spoke.normalize() * outward)
            }
        }
    }
}

fn faces(solid: usize, own: &Solid) -> Vec<Face> {
    match own.form {
        Form::Block { low, high } => {
            let size = high - low;
            let side = |(axis, normal): (usize, DVec3)| {
                let edges = [(axis + 1) % 3, (axis + 2) % 3].map(|other| DVec3::AXES[other] * size[other]);
                let corner = if normal[axis] > 0.0 { low + DVec3::AXES[axis] * size[axis] } else { low };
                Face { solid, area: edges[0].length() * edges[1].length(), form: Side::Flat { corner, edges, normal } }
            };
            let sides = (0..3).flat_map(|axis| [DVec3::AXES[axis], -DVec3::AXES[axis]].map(|normal| (axis, normal)));
            sides.map(side).collect()
        }
        Form::Column { middle, radius, height } => {
            let form = Side::Round {
                start: middle,
                axis: DVec3::Z * height,
                from: DVec3::X * radius,
                turn: TAU,
                outward: 1.0,
            };
            vec![Face { solid, area: TAU * radius * height, form }]
        }
        Form::Vault { start, radius, length } => {
            let turn = TAU / 2.0;
            let form = Side::Round { start, axis: DVec3::X * length, from: DVec3::Y * radius, turn, outward: -1.0 };
            vec![Face { solid, area: turn * radius * length, form }]
        }
    }
}

// Linear red, green and blue.
const CLAY: [f64; 3] = [0.52, 0.45, 0.32];
const CHALK: [f64; 3] = [0.79, 0.79, 0.75];
const RUST: [f64; 3] = [0.6, 0.1, 0.07];
const SKY: [f64; 3] = [0.1, 0.32, 0.6];
const LEAF: [f64; 3] = [0.21, 0.52, 0.13];
const STRAW: [f64; 3] = [0.69, 0.6, 0.21];
const LILAC: [f64; 3] = [0.32, 0.13, 0.52];
const OAK: [f64; 3] = [0.45, 0.21, 0.07];
const IRON: [f64; 3] = [0.07, 0.07, 0.07];
const STONE: [f64; 3] = [0.45, 0.43, 0.4];
const BRASS: [f64; 3] = [0.79, 0.32, 0.03];

/// The thickness of walls.
const WALL: f64 = 0.15;

/// A hall of 6 by 3 m with a table, a cupboard and a column at `shift`, and a doorway to a corridor at its far end.
fn hall(length: f64, shift: f64) -> Vec<Solid> {
    let far = length + 2.0 + 2.0 * WALL;
    let mut solids = vec![
        Solid::block([-WALL, -WALL, -WALL], [far, 6.0 + WALL, 0.0], CLAY),
        Solid::block([-WALL, -WALL, 3.0], [far, 6.0 + WALL, 3.0 + WALL], CHALK),
        Solid::block([-WALL, -WALL, 0.0], [0.0, 6.0 + WALL, 3.0], RUST),
        Solid::block([0.0, -WALL, 0.0], [far, 0.0, 3.0], SKY),
        Solid::block([0.0, 6.0, 0.0], [far, 6.0 + WALL, 3.0], LEAF),
        // The wall at the far end, beside its door and above it.
        Solid::block([length, 0.0, 0.0], [length + WALL, 2.5, 3.0], STRAW),
        Solid::block([length, 3.5, 0.0], [length + WALL, 6.0, 3.0], STRAW),
        Solid::block([length, 2.5, 2.1], [length + WALL, 3.5, 3.0], STRAW),
        Solid::block([far - WALL, 0.0, 0.0], [far, 6.0, 3.0], LILAC),
    ];
    let mut put = |low: [f64; 3], high: [f64; 3], albedo| {
        let moved = |[x, y, z]: [f64; 3]| [x + shift, y, z];
        solids.push(Solid::block(moved(low), moved(high), albedo));
    };
    put([5.0, 0.8, 0.72], [6.6, 1.6, 0.75], OAK);
    for [x, y] in [[5.05, 0.85], [6.5, 0.85], [5.05, 1.5], [6.5, 1.5]] {
        put([x, y, 0.0], [x + 0.05, y + 0.05, 0.72], IRON);
    }
    put([2.2, 4.9, 0.0], [2.8, 5.5, 1.1], STONE);
    let middle = DVec3::new(6.0 + shift, 4.3, 0.0);
    solids.push(Solid { form: Form::Column { middle, radius: 0.22, height: 3.0 }, albedo: BRASS });
    solids
}

/// A street of 60 by 12 m between houses, with pavements, cars and lamp posts, under the open sky.
fn street() -> Vec<Solid> {
    let mut solids = vec![
        Solid::block([-2.0, -1.0, -0.3], [62.0, 13.0, 0.0], STONE),
        Solid::block([-2.0, -1.0, 0.0], [62.0, 1.8, 0.12], CHALK),
        Solid::block([-2.0, 10.2, 0.0], [62.0, 13.0, 0.12], CHALK),
    ];
    let house = |x: f64, width: f64, height: f64, albedo, is_left: bool| {
        let (front, back) = if is_left { (12.0, 20.0) } else { (-8.0, 0.0) };
        Solid::block([x, front, 0.0], [x + width, back, height], albedo)
    };
    let rows = [
        (-2.0, 11.5, 8.0, RUST, 9.5, STRAW),
        (10.0, 9.0, 10.5, CHALK, 7.0, CLAY),
        (19.5, 11.0, 7.5, STRAW, 11.0, LILAC),
        (32.0, 8.5, 9.0, CLAY, 8.5, RUST),
        (40.5, 12.5, 11.0, LEAF, 10.0, CHALK),
        (54.5, 7.5, 8.5, LILAC, 9.0, SKY),
    ];
    for (x, width, left_height, left, right_height, right) in rows {
        solids.push(house(x, width, left_height, left, true));
        solids.push(house(x, width, right_height, right, false));
    }
    for (x, y, albedo) in [(9.0, 2.0, SKY), (24.0, 8.4, RUST), (35.0, 2.0, IRON), (50.5, 8.4, BRASS)] {
        solids.push(Solid::block([x, y, 0.3], [x + 4.2, y + 1.7, 0.9], albedo));
        solids.push(Solid::block([x + 0.9, y + 0.1, 0.9], [x + 3.3, y + 1.6, 1.45], albedo));
    }
    for x in [7.0, 22.0, 37.0, 48.5, 57.0] {
        let middle = DVec3::new(x, 10.5, 0.0);
        solids.push(Solid { form: Form::Column { middle, radius: 0.08, height: 6.0 }, albedo: IRON });
    }
    solids
}

/// A nave of 30 by 10 m under a barrel vault, with two rows of columns, pews and an altar.
fn church() -> Vec<Solid> {
    let mut solids = vec![
        Solid::block([-WALL, -WALL, -WALL], [30.0 + WALL, 10.0 + WALL, 0.0], STONE),
        Solid::block([-WALL, -WALL, 0.0], [0.0, 10.0 + WALL, 11.5], CHALK),
        Solid::block([30.0, -WALL, 0.0], [30.0 + WALL, 10.0 + WALL, 11.5], STRAW),
        Solid::block([0.0, -WALL, 0.0], [30.0, 0.0, 6.0], CHALK),
        Solid::block([0.0, 10.0, 0.0], [30.0, 10.0 + WALL, 6.0], CHALK),
        Solid { form: Form::Vault { start: DVec3::new(0.0, 5.0, 6.0), radius: 5.0, length: 30.0 }, albedo: SKY },
        // The altar and its step.
        Solid::block([25.0, 2.5, 0.0], [30.0, 7.5, 0.15], CLAY),
        Solid::block([27.0, 4.0, 0.15], [28.0, 6.0, 1.15], BRASS),
    ];
    for x in [4.0, 9.0, 14.0, 19.0, 24.0] {
        for y in [1.5, 8.5] {
            let middle = DVec3::new(x, y, 0.0);
            solids.push(Solid { form: Form::Column { middle, radius: 0.3, height: 11.5 }, albedo: STONE });
        }
    }
    for row in 0..6 {
        let x = 5.5 + 1.6 * f64::from(row);
        for y in [2.2, 5.6] {
            solids.push(Solid::block([x, y, 0.4], [x + 0.4, y + 2.2, 0.45], OAK));
            solids.push(Solid::block([x, y, 0.0], [x + 0.05, y + 2.2, 0.9], OAK));
        }
    }
    solids
}

#[cfg(test)]
#[path = "tripod_tests.rs"]
mod tests;
