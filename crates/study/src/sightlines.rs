//! How far a splatted surface is from the scan that it is made of.
//!
//! A range scan is its own truth: between the scanner and a point there is nothing, and at the point there is
//! something. Some of the points are held out, a surface is made of the others, and the sightline of each point that
//! was held out is cast through it: by the ray tracer ([`Ruler::traced`]), and by what the renderer draws from the
//! scanner's place ([`Ruler::drawn`]).

use std::f64::consts::FRAC_PI_2;

use cloud::{Chunk, Cloud, NO_RADIUS, Progress, SurfelOptions, error_along, hash, stretch_ratio, unpack_radius};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use render::{Aov, Renderer};
use scene::{Blank, Camera, ColorBy, Lighting, Method, Projection, Settings};
use serde::Serialize;
use trace::{Geometry as _, Hit, Ray, linear_from_srgb};

use crate::intervals::{Interval, Stated, intervals, spacing};
use crate::metrics::{Percentiles, delta_e};
use crate::scanner::{self, Scanner, ScannerFrom};
use crate::subject::Subject;
use crate::truth::TracedScene;

/// A surface this near to a point is the point's own, as a share of its distance from the scanner.
pub const TOLERANCE: f64 = 0.01;

/// The size of a picture from the scanner's place, in pixels.
pub const PICTURE: [u32; 2] = [1280, 960];

/// The most pictures from above, and the most pixels along a side of one.
const MOST_PICTURES: f64 = 16.0;
const LARGEST_PICTURE: u32 = 2048;

/// Why a surface cannot be judged.
#[derive(Debug, thiserror::Error)]
pub enum SightlineError {
    #[error("a share of {0} is held out, expected one above 0 and below 1")]
    Share(f64),
    #[error("a scanner at {0}, expected three finite numbers")]
    Place(DVec3),
    #[error("{0} points, too few to hold some out and make a surface of the rest")]
    FewPoints(usize),
    #[error("no point that is held out has a sightline: all of them are where the scanner stands")]
    NoRays,
    #[error("cancelled")]
    Cancelled,
    #[error(transparent)]
    Render(#[from] render::Error),
}

pub type SightlineResult<Value> = Result<Value, SightlineError>;

/// How points are held out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldOut {
    /// The share of the points, above 0 and below 1.
    pub share: f64,
    pub seed: u64,
}

impl Default for HoldOut {
    fn default() -> Self {
        Self { share: 0.5, seed: 1 }
    }
}

impl HoldOut {
    /// Whether the point of this number in its file is held out. It does not depend on the other points.
    fn takes(&self, point: u64) -> bool {
        // 53 bits: the digits of an f64.
        let unit = (hash(hash(self.seed).wrapping_add(point)) >> 11) as f64 / (1_u64 << 53) as f64;
        unit < self.share
    }
}

/// A scan, or several that were joined.
#[derive(Clone, Debug, Default)]
pub struct Scan {
    /// All points, with the normals that the file has, and the columns of returns and times if there are any.
    pub cloud: Cloud,
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// The scanner's places that the file or the scene names.
    pub places: Vec<DVec3>,
}

impl Scan {
    /// The place of the scanner, if it is named and the only one.
    pub fn scanner(&self) -> Option<DVec3> {
        let [place] = self.places[..] else { return None };
        Some(place)
    }
}

/// A point that was held out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldPoint {
    pub position: DVec3,
    /// The linear red, green and blue, if the file has colours.
    pub color: Option<[f32; 3]>,
    /// The time of its pulse, if the file has times; else 0.
    pub time: f64,
}

/// The figures of a surface. Shares of the rays, and errors of those within, in metres per metre of distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sightlines {
    pub rays: usize,
    /// The surface is within 1 % of the point's distance.
    pub within: f64,
    /// The surface stands before the point, in space that the scanner saw to be free.
    pub in_front: f64,
    /// The ray meets a surface, but behind the point.
    pub behind: f64,
    /// The ray meets nothing.
    pub open: f64,
    pub depth_error: DepthError,
    pub colour_error: ColourError,
}

/// Distances between the surface and the points, whatever their sign, of the rays within; none if there are none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DepthError {
    pub median: Option<f64>,
    pub p95: Option<f64>,
}

/// The differences of colour (CIEDE2000) of the rays within; none where the file has no colours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ColourError {
    pub median: Option<f64>,
}

/// What a ray met on its way to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Met {
    /// How far behind the point the surface is, relative to the point's distance; below 0 before it. Infinite if the
    /// ray met nothing.
    error: f64,
    /// The linear colour of the surface.
    color: [f32; 3],
}

impl Met {
    const NOTHING: Self = Self { error: f64::INFINITY, color: [0.0; 3] };

    fn is_within(&self) -> bool {
        self.error.abs() <= TOLERANCE
    }

    /// The better of what was met from two places: a point is seen from one of them at least. From another place a wall
    /// may stand before it, which says nothing, so a surface that is met before the point counts last.
    fn or(self, other: Self) -> Self {
        let rank = |met: &Self| match met.error {
            error if error.abs() <= TOLERANCE => 0,
            f64::INFINITY => 2,
            error if error > 0.0 => 1,
            _ => 3,
        };
        let order = rank(&other).cmp(&rank(&self)).then(other.error.abs().total_cmp(&self.error.abs()));
        if order.is_lt() { other } else { self }
    }
}

impl Sightlines {
    fn of(points: &[HeldPoint], met: &[Option<Met>]) -> SightlineResult<Self> {
        let known: Vec<(&HeldPoint, &Met)> =
            points.iter().zip(met).filter_map(|(point, met)| Some((point, met.as_ref()?))).collect();
        if known.is_empty() {
            return Err(SightlineError::NoRays);
        }
        let share = |is_counted: &dyn Fn(&Met) -> bool| {
            known.iter().filter(|(_, met)| is_counted(met)).count() as f64 / known.len() as f64
        };
        let within = || known.iter().filter(|(_, met)| met.is_within());
        let depth = Percentiles::of(within().map(|(_, met)| met.error.abs()).collect());
        let colors = within().filter_map(|(point, met)| Some((point.color?, met.color)));
        let (expected, seen): (Vec<[f32; 3]>, Vec<[f32; 3]>) = colors.unzip();
        let color = Percentiles::of(delta_e(&seen, &expected).into_iter().map(f64::from).collect());
        let number = |value: f64| value.is_finite().then_some(value);
        Ok(Self {
            rays: known.len(),
            within: share(&Met::is_within),
            in_front: share(&|met| met.error < -TOLERANCE),
            behind: share(&|met| met.error > TOLERANCE && met.error.is_finite()),
            open: share(&|met| met.error == f64::INFINITY),
            depth_error: DepthError { median: number(depth.median), p95: number(depth.p95) },
            colour_error: ColourError { median: number(color.median) },
        })
    }
}

/// Divides a cloud: the points that are held out, and the others without radii, in chunks of which none is empty.
/// Points that are not finite are left out. Of pulses with several returns only the first is held out: between the
/// scanner and a later one there was something.
fn divide(cloud: &Cloud, hold_out: HoldOut) -> SightlineResult<(Vec<HeldPoint>, Vec<Chunk>)> {
    if !(hold_out.share > 0.0 && hold_out.share < 1.0) {
        return Err(SightlineError::Share(hold_out.share));
    }
    let column = |name: &str| cloud.column_of(name);
    let (returns, times) = (column("return_number"), column("gps_time"));
    let divided: Vec<(Vec<HeldPoint>, Chunk)> = cloud
        .chunks
        .par_iter()
        .map(|chunk| {
            let of = |index: Option<usize>| chunk.columns.get(index?)?.as_deref();
            let (returns, times) = (of(returns), of(times));
            let is_first = |point: usize| returns.is_none_or(|returns| returns.value(point) <= 1.0);
            let (mut held, mut rest) = (Vec::new(), Vec::new());
            for point in (0..chunk.len()).filter(|point| chunk.position(*point).is_finite()) {
                if !is_first(point) || !hold_out.takes(chunk.first_point + point as u64) {
                    rest.push(point as u32);
                    continue;
                }
                let linear =
                    |[red, green, blue, _]: [u8; 4]| [red, green, blue].map(|value| linear_from_srgb(value) as f32);
                held.push(HeldPoint {
                    position: chunk.position(point),
                    color: chunk.colors.as_ref().map(|colors| linear(colors[point])),
                    time: times.map_or(0.0, |times| times.value(point)),
                });
            }
            (held, Chunk { radii: None, ..chunk.select(&rest) })
        })
        .collect();
    let (mut held, mut rest) = (Vec::new(), Vec::new());
    for (points, chunk) in divided {
        held.extend(points);
        rest.extend((!chunk.is_empty()).then_some(chunk));
    }
    let points = held.len() + rest.iter().map(Chunk::len).sum::<usize>();
    // A plane needs three points.
    if held.is_empty() || points - held.len() < 3 {
        return Err(SightlineError::FewPoints(points));
    }
    Ok((held, rest))
}

/// The surface of a part of a scan, and the sightlines that judge it.
pub struct Ruler {
    held: Vec<HeldPoint>,
    pub scanner: Scanner,
    pub from: ScannerFrom,
    /// The points that are not held out, as they are drawn.
    subject: Subject,
    traced: TracedScene,
    up: DVec3,
    /// How sure the surface is of itself, one list for each chunk of the subject.
    errors: Vec<Vec<f32>>,
}

impl Ruler {
    /// Makes a surface of the points that are not held out, as the program makes it: normals that the file lacks and
    /// all radii are estimated from these points alone. `places` are the scanner's, if they are known better than the
    /// scan shows.
    ///
    /// # Errors
    /// A share that holds out nothing or everything, too few points, no memory on the GPU, or cancelled.
    pub fn new(
        scan: &Scan,
        hold_out: HoldOut,
        places: &[DVec3],
        options: impl FnOnce(&[Chunk]) -> SurfelOptions,
        settings: &Settings,
        gpu: &std::sync::Arc<render::Gpu>,
        progress: &Progress,
    ) -> anyhow::Result<Self> {
        if let Some(place) = places.iter().find(|place| !place.is_finite()) {
            return Err(SightlineError::Place(*place).into());
        }
        let (held, mut rest) = divide(&scan.cloud, hold_out)?;
        let estimated = cloud::estimate(&rest, &options(&rest), progress).ok_or(SightlineError::Cancelled)?;
        for (chunk, surfels) in rest.iter_mut().zip(estimated) {
            chunk.normals = Some(surfels.normals.into());
            chunk.radii = Some(surfels.radii.into());
            chunk.columns.clear();
        }
        let errors = cloud::surface_errors(&rest, &Progress::default()).ok_or(SightlineError::Cancelled)?;
        let part = scene::five_mirrors::SampledPart { chunks: rest, mirror: None };
        let camera = Camera { eye: DVec3::ZERO, pivot: DVec3::X, up: DVec3::Z };
        let settings = pictured(settings);
        let subject = Subject::sampled(gpu, vec![part], Vec::new(), camera, None, &settings)?;
        let traced = TracedScene::new(&subject.parts, None, settings.splat.size, progress)?;
        let (scanner, from) = match places {
            [] => scanner::find(scan, &traced, hold_out.seed),
            places => (Scanner::Places(places.to_vec()), ScannerFrom::Flag),
        };
        Ok(Self { held, scanner, from, subject, traced, up: scan.up, errors })
    }

    /// The points that are held out.
    pub fn held(&self) -> &[HeldPoint] {
        &self.held
    }

    /// Casts the sightlines by the ray tracer, through the points as discs.
    ///
    /// # Errors
    /// No point has a sightline.
    pub fn traced(&self) -> SightlineResult<Sightlines> {
        Ok(self.traced_with_intervals()?.0)
    }

    /// The figures of sightlines, and how often the intervals that the surface states for its error held.
    ///
    /// # Errors
    /// Those of `traced`.
    pub fn traced_with_intervals(&self) -> SightlineResult<(Sightlines, Vec<Interval>)> {
        type Cast = (Met, Option<Stated>);
        let best = |known: Cast, other: Cast| if known.0.or(other.0) == known.0 { known } else { other };
        let cast = |point: &HeldPoint, from: DVec3| {
            let way = point.position - from;
            let distance = way.length();
            let direction = way / distance;
            let ray = Ray::from_eye(from - self.traced.origin, direction);
            (distance > 0.0).then(|| match self.traced.surfels.nearest(&ray) {
                Some(hit) => {
                    let met = Met { error: hit.distance / distance - 1.0, color: hit.albedo.as_vec3().into() };
                    (met, Some(self.stated(&hit, direction, distance)))
                }
                None => (Met::NOTHING, None),
            })
        };
        let found: Vec<Option<Cast>> = self
            .held
            .par_iter()
            .map(|point| self.scanner.places_of(point).into_iter().filter_map(|from| cast(point, from)).reduce(best))
            .collect();
        let met: Vec<Option<Met>> = found.iter().map(|found| found.as_ref().map(|(met, _)| *met)).collect();
        let is_within = |(met, stated): &Cast| stated.filter(|_| met.is_within());
        let stated: Vec<Stated> = found.iter().flatten().filter_map(is_within).collect();
        Ok((Sightlines::of(&self.held, &met)?, intervals(&stated)))
    }

    /// What the surface states of its error where a sightline meets it.
    fn stated(&self, hit: &Hit, direction: DVec3, distance: f64) -> Stated {
        let (chunk, point) = (hit.surface as usize, hit.point as usize);
        let packed = self.subject.parts[0].cloud.chunks[chunk].radii.as_ref().map_or(NO_RADIUS, |radii| radii[point]);
        let radius = unpack_radius(packed).map_or(f64::NAN, f64::from);
        Stated {
            error: hit.distance - distance,
            half_width: error_along(self.errors[chunk][point].into(), hit.normal, direction),
            distance,
            incidence: hit.normal.dot(direction).abs().min(1.0).acos().to_degrees(),
            spacing: spacing(radius, stretch_ratio(packed).into()),
        }
    }

    /// Takes the depth at each sightline's pixel from pictures that the renderer draws from the scanner's places;
    /// `None` for a scanner that flew, since no picture is seen from all along a flight.
    ///
    /// # Errors
    /// No point has a sightline, or the device was lost.
    pub fn drawn(&mut self, renderer: &mut Renderer, settings: &Settings) -> SightlineResult<Option<Sightlines>> {
        let mut settings = pictured(settings);
        let mut met: Vec<Option<Met>> = vec![None; self.held.len()];
        let distance = match &self.scanner {
            Scanner::Flight(_) => return Ok(None),
            Scanner::Above { distance, .. } => {
                settings.view.projection = Projection::Orthographic;
                Some(*distance)
            }
            Scanner::Places(_) => None,
        };
        for Picture { camera, field_of_view, size } in self.pictures(f64::from(settings.view.field_of_view)) {
            settings.view.field_of_view = field_of_view as f32;
            self.subject.camera = camera;
            self.subject.render(renderer, &settings, size)?;
            let positions = renderer.read_aov_from(Aov::Position, self.traced.origin)?.data;
            let albedo = renderer.read_aov(Aov::Albedo)?.data;
            let (lens, origin) = (Lens::new(&camera, field_of_view, size, distance.is_some()), self.traced.origin);
            self.held.par_iter().zip(&mut met).for_each(|(point, met)| {
                let Some((pixel, depth)) = lens.pixel(point.position) else { return };
                let three = |image: &[f32]| std::array::from_fn::<f32, 3, _>(|axis| image[pixel * 3 + axis]);
                let seen = DVec3::from(three(&positions).map(f64::from)) + origin;
                let beyond = (seen - point.position).dot(camera.forward());
                let error = beyond / distance.unwrap_or(depth);
                let here = if seen.is_finite() { Met { error, color: three(&albedo) } } else { Met::NOTHING };
                *met = Some(met.map_or(here, |known| known.or(here)));
            });
        }
        Sightlines::of(&self.held, &met).map(Some)
    }

    /// The pictures in which the sightlines are seen. `field_of_view` is that of a picture of the usual size, in
    /// degrees.
    fn pictures(&self, field_of_view: f64) -> Vec<Picture> {
        match &self.scanner {
            Scanner::Places(places) => {
                places.iter().flat_map(|place| self.pictures_from(*place, field_of_view)).collect()
            }
            Scanner::Above { down, .. } => self.pictures_along(*down, field_of_view),
            Scanner::Flight(_) => Vec::new(),
        }
    }

    /// One picture if it shows all points, else the faces of a cube.
    fn pictures_from(&self, eye: DVec3, field_of_view: f64) -> Vec<Picture> {
        let ways: Vec<DVec3> = self.held.iter().filter_map(|point| (point.position - eye).try_normalize()).collect();
        let mut distances: Vec<f64> = self.held.iter().map(|point| point.position.distance(eye)).collect();
        if ways.is_empty() {
            return Vec::new();
        }
        let middle = distances.len() / 2;
        // The near plane of a picture is a share of the distance to the pivot.
        let reach = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        let tangent = (field_of_view.to_radians() * 0.5).tan();
        let aspect = f64::from(PICTURE[0]) / f64::from(PICTURE[1]);
        let forward = ways.iter().sum::<DVec3>().normalize_or(DVec3::X);
        let whole = [self.up, DVec3::X, DVec3::Y, DVec3::Z].into_iter().find_map(|up| {
            let camera = Camera { eye, pivot: eye + forward * reach, up };
            let rows = camera.view_from_world();
            let is_seen = |way: &DVec3| {
                let view = rows * *way;
                view.z > 0.0 && view.x.abs() < tangent * aspect * view.z && view.y.abs() < tangent * view.z
            };
            let is_steady = forward.dot(up).abs() < 0.99;
            (is_steady && ways.iter().all(is_seen)).then_some(Picture { camera, field_of_view, size: PICTURE })
        });
        if let Some(picture) = whole {
            return vec![picture];
        }
        // Pixels as large as those of the one picture.
        let side = (f64::from(PICTURE[1]) / tangent).round() as u32;
        let face = |forward: DVec3| {
            let up = if forward.z == 0.0 { DVec3::Z } else { DVec3::Y };
            let camera = Camera { eye, pivot: eye + forward * reach, up };
            Picture { camera, field_of_view: FRAC_PI_2.to_degrees(), size: [side; 2] }
        };
        DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]).map(face).collect()
    }

    /// Pictures in parallel projection that together show all points, with two pixels to the usual distance of points.
    fn pictures_along(&self, forward: DVec3, field_of_view: f64) -> Vec<Picture> {
        let up = forward.any_orthonormal_vector();
        let rows = Camera { eye: DVec3::ZERO, pivot: forward, up }.view_from_world();
        let mut bounds = cloud::Bounds::EMPTY;
        self.held.iter().for_each(|point| bounds.include(rows * point.position));
        let size = bounds.size();
        let area = (size.x * size.y).max(f64::MIN_POSITIVE);
        let fine = (area / self.held.len() as f64).sqrt() * 0.5;
        let most = f64::from(LARGEST_PICTURE).powi(2) * MOST_PICTURES;
        let pixel = fine.max((area / most).sqrt());
        let counts = [size.x, size.y].map(|length| (length / pixel / f64::from(LARGEST_PICTURE)).floor() as u32 + 1);
        let lengths = [size.x / f64::from(counts[0]), size.y / f64::from(counts[1])];
        let pixels = lengths.map(|length| (length / pixel).ceil() as u32 + 2);
        let tangent = (field_of_view.to_radians() * 0.5).tan();
        let reach = f64::from(pixels[1]) * pixel * 0.5 / tangent;
        let places = (0..counts[0]).flat_map(|column| (0..counts[1]).map(move |row| [column, row]));
        let picture = |[column, row]: [u32; 2]| {
            let across = |first: f64, index: u32, length: f64| first + (f64::from(index) + 0.5) * length;
            let middle = DVec3::new(
                across(bounds.min.x, column, lengths[0]),
                across(bounds.min.y, row, lengths[1]),
                bounds.min.z - reach * 0.1 - size.z * 0.1,
            );
            let eye = rows.transpose() * middle;
            let camera = Camera { eye, pivot: eye + forward * reach, up };
            Picture { camera, field_of_view, size: pixels }
        };
        places.map(picture).collect()
    }
}

/// The parameters of pictures that only depth and colour are read from.
fn pictured(settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    settings.view.projection = Projection::Perspective;
    settings.view.resolution = 1.0;
    settings.color.by = if settings.color.by == ColorBy::Auto { ColorBy::Rgb } else { settings.color.by };
    // Colours are compared with those of the file.
    settings.color.blank = Blank::Black;
    settings.light.by = Lighting::Colors;
    settings.gi.bounces = 0;
    settings.reflection.method = Method::None;
    settings
}

/// A picture from a scanner's place.
#[derive(Clone, Copy, Debug)]
struct Picture {
    camera: Camera,
    /// The vertical field of view in degrees.
    field_of_view: f64,
    size: [u32; 2],
}

/// Where points are in a picture.
struct Lens {
    eye: DVec3,
    rows: DMat3,
    /// The pixels per unit of the picture's plane: at distance 1, or anywhere in parallel projection.
    focal: f64,
    is_parallel: bool,
    size: [u32; 2],
}

impl Lens {
    fn new(camera: &Camera, field_of_view: f64, size: [u32; 2], is_parallel: bool) -> Self {
        let tangent = (field_of_view.to_radians() * 0.5).tan();
        let reach = if is_parallel { camera.distance() } else { 1.0 };
        let focal = f64::from(size[1]) * 0.5 / (tangent * reach);
        Self { eye: camera.eye, rows: camera.view_from_world(), focal, is_parallel, size }
    }

    /// The pixel that a position is in, and its depth; `None` outside of the picture.
    fn pixel(&self, position: DVec3) -> Option<(usize, f64)> {
        let view = self.rows * (position - self.eye);
        if !(self.is_parallel || view.z > 0.0) {
            return None;
        }
        let scale = self.focal / if self.is_parallel { 1.0 } else { view.z };
        let [width, height] = self.size.map(f64::from);
        let (x, y) = (width * 0.5 + view.x * scale, height * 0.5 - view.y * scale);
        let is_inside = x >= 0.0 && x < width && y >= 0.0 && y < height;
        is_inside.then_some((y as usize * self.size[0] as usize + x as usize, view.z))
    }
}
