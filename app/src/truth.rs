//! The truth on the command line: what the ray tracer sees in the mirrors of a frame that was drawn. It gives the images
//! `reference_position`, `reference_color` and `reference_indirect`, the accuracy figures of `--stats`, and the method `ray_trace`.
//!
//! All of it starts from the frame's own surface (positions, normals, colours of its pixels) and from the points that it was
//! drawn from, as discs: the same input as the methods have. Only `--truth exact` asks the built-in scene's formulas, for the
//! figures and for the images of light.
//! docs/accuracy.md tells what each figure means.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::anyhow;
use cloud::{Bounds, Chunk, Cloud, Progress};
use glam::{DVec3, Vec3};
use param::Choice as _;
use rayon::prelude::*;
use render::{Aov, AovImage, ColorPlan, ColorSource, MOST_LIGHTS, Objects, PointStore, Renderer};
use scene::five_mirrors::Variant;
use scene::{Camera, ColorBy, Lighting, Method, Mirror, Settings, SpotLight};
use study::{
    Accuracy, Exact, Geometry, Gloss, Hit, Illumination, Indirect, MirrorImage, MirrorPoint, PixelRays, Source,
    Sunlight, Surfels, Truth, accuracy_exact, accuracy_same_input, image_error, indirect_picture, light_error,
    linear_from_srgb, primary, radiance, reflected,
};

use crate::command_line::RenderArguments;
use crate::failure::usage;
use crate::loading::{Input, Request};
use crate::progress_bar;

/// The method's name.
pub const RAY_TRACE: &str = "ray_trace";

/// An image of the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// World position of what each mirror pixel's reflected ray meets; coverage.
    Position,
    /// Traced radiance of all pixels, linear RGB.
    Color,
    /// Indirect light that each pixel's own surface sends out, without what it reflects as a mirror, linear RGB.
    Indirect,
}

impl Reference {
    pub const ALL: [Self; 3] = [Self::Position, Self::Color, Self::Indirect];

    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "reference_position",
            Self::Color => "reference_color",
            Self::Indirect => "reference_indirect",
        }
    }
}

/// What is asked of the ray tracer.
#[derive(Debug, Default)]
pub struct Asked {
    /// Is the method.
    is_method: bool,
    references: Vec<(Reference, PathBuf)>,
    /// What the figures of `--stats` are measured by.
    truth: Option<Truth>,
    /// The built-in scene, for the exact truth.
    variant: Option<Variant>,
}

impl Asked {
    /// # Errors
    /// The exact truth of something else than a built-in scene as it is, or the light of one in other colours than its own.
    pub fn new(
        arguments: &RenderArguments,
        references: Vec<(Reference, PathBuf)>,
        request: &Request,
        settings: &Settings,
    ) -> anyhow::Result<Self> {
        let variant = if arguments.truth == Some(Truth::Exact) { Some(built_in(request)?) } else { None };
        let lit = references.iter().find(|(reference, _)| *reference != Reference::Position);
        if let (Some((lit, _)), Some(_), false) = (lit, variant, has_own_colors(settings)) {
            return Err(usage(format!(
                "--truth exact: the formulas behind `{}` have the scene's own colours, color.by is {}\n\
                 --truth same_input traces points in the colours that they are drawn in",
                lit.name(),
                settings.color.by.name()
            )));
        }
        let unnamed = (!references.is_empty() && arguments.stats.is_some()).then_some(Truth::SameInput);
        let is_method = arguments.method.as_deref() == Some(RAY_TRACE);
        Ok(Self { is_method, references, truth: arguments.truth.or(unnamed), variant })
    }

    /// Whether the method makes this image.
    pub fn makes(&self, aov: Aov) -> bool {
        self.is_method && matches!(aov, Aov::MirrorPosition | Aov::MirrorAlbedo | Aov::MirrorNormal)
    }

    fn asks_for(&self, reference: Reference) -> bool {
        self.references.iter().any(|(asked, _)| *asked == reference)
    }

    fn is_anything(&self) -> bool {
        self.is_method || !self.references.is_empty() || self.truth.is_some()
    }
}

/// Whether points show the colours of the built-in scenes' formulas.
fn has_own_colors(settings: &Settings) -> bool {
    matches!(settings.color.by, ColorBy::Auto | ColorBy::Rgb)
}

/// The built-in scene that the inputs are, and nothing beside it.
fn built_in(request: &Request) -> anyhow::Result<Variant> {
    let is_changed = !request.mirrors.is_empty() || !request.mirror_points.is_empty();
    match request.inputs.as_slice() {
        [Input::BuiltIn { variant, without }] if !is_changed && without.is_empty() => Ok(*variant),
        _ => {
            let names: Vec<String> = request.inputs.iter().map(Input::name).collect();
            Err(usage(format!(
                "--truth exact: only a built-in scene alone, with its own mirrors, has formulas to trace; this is {}\n\
                 --truth same_input judges any scene by the points that it is drawn from",
                names.join(", ")
            )))
        }
    }
}

/// Points of one material, as they were uploaded.
pub struct Part {
    pub cloud: Cloud,
    pub specular_intensity: f32,
    pub specular_power: f32,
    pub plan: ColorPlan,
    /// Unit vector.
    pub up: DVec3,
}

impl Part {
    /// The points that stand for a mirror.
    pub fn of_mirror(mirror: &Mirror, samples: &[Chunk]) -> Self {
        let cloud = Cloud { name: mirror.name.clone(), chunks: samples.to_vec(), ..Cloud::default() };
        let own = scene::Color { by: ColorBy::Rgb, ..scene::Color::default() };
        let (plan, _) = ColorPlan::new(&cloud, &own, DVec3::Z);
        let Mirror { specular_intensity, specular_power, .. } = *mirror;
        Self { cloud, specular_intensity, specular_power, plan, up: DVec3::Z }
    }

    /// The colour of points that have none of their own, sRGB.
    fn plain(&self) -> [u8; 4] {
        if self.plan.source == ColorSource::Rgb { [u8::MAX; 4] } else { self.plan.plain }
    }

    /// The points in the colours that they are drawn in, with places from `origin`.
    fn painted(&self, origin: DVec3) -> Vec<Chunk> {
        let ramp = render::ramp_colors(self.plan.ramp);
        let classes = self.cloud.attributes.iter().position(|attribute| attribute.name == "classification");
        let axis = self.up.abs().max_position();
        let on_ramp = |value: f64| {
            let range = self.plan.high - self.plan.low;
            let share = if range > 0.0 { (value - self.plan.low) / range } else { 0.0 };
            ramp[(share.clamp(0.0, 1.0) * 255.0).round() as usize]
        };
        let paint = |chunk: &Chunk| -> Option<Vec<[u8; 4]>> {
            let each = |color: &dyn Fn(usize) -> [u8; 4]| Some((0..chunk.len()).map(color).collect());
            let column = |index: usize| chunk.columns.get(index)?.as_deref();
            match self.plan.source {
                ColorSource::Rgb => chunk.colors.as_ref().map(|colors| colors.to_vec()),
                ColorSource::Plain => None,
                ColorSource::Height => each(&|point| on_ramp(chunk.position(point)[axis])),
                ColorSource::Column(index) => {
                    let values = column(index)?;
                    each(&|point| on_ramp(values.value(point)))
                }
                ColorSource::Class => {
                    let values = column(classes?)?;
                    each(&|point| render::class_color(values.value(point) as u8))
                }
                ColorSource::Normal => {
                    let normals = chunk.normals.as_ref()?;
                    each(&|point| {
                        let normal = cloud::unpack_normal(normals[point]).unwrap_or(Vec3::ZERO);
                        let [red, green, blue] =
                            (normal * 0.5 + 0.5).to_array().map(|share| (share * 255.0).round() as u8);
                        [red, green, blue, u8::MAX]
                    })
                }
            }
        };
        let chunks = self.cloud.chunks.iter();
        chunks
            .map(|chunk| {
                let colors = paint(chunk).map(Arc::new);
                Chunk { origin: chunk.origin - origin, colors, columns: Vec::new(), ..chunk.clone() }
            })
            .collect()
    }
}

/// What was drawn, and how.
#[derive(Clone, Copy)]
pub struct Picture<'a> {
    pub parts: &'a [Part],
    pub store: &'a PointStore,
    pub camera: &'a Camera,
    pub settings: &'a Settings,
    pub objects: Objects<'a>,
    pub size: [u32; 2],
}

/// What the ray tracer had to say.
#[derive(Default)]
pub struct Outcome {
    pub references: Vec<(PathBuf, AovImage)>,
    /// Of the method, in place of the renderer's.
    images: Vec<(Aov, AovImage)>,
    pub accuracy: Option<Accuracy>,
    pub method: Option<MethodFigures>,
}

impl Outcome {
    /// The method's image in place of the renderer's.
    pub fn image(&self, aov: Aov) -> Option<&AovImage> {
        self.images.iter().find(|(made, _)| *made == aov).map(|(_, image)| image)
    }
}

/// The method `ray_trace` in figures.
#[derive(Clone, Copy, Debug)]
pub struct MethodFigures {
    /// Of tracing and lighting what the mirror pixels show, all bounces, on all cores.
    pub milliseconds: f64,
    /// Share of the mirror pixels whose ray meets a point; none where no reflection is followed.
    pub coverage: Option<f64>,
    pub bounces: u32,
}

/// Does what is asked with the frame that `renderer` holds; as a method it puts what mirrors show into the renderer's picture.
///
/// # Errors
/// The device was lost.
pub fn trace(asked: &Asked, picture: &Picture, renderer: &mut Renderer) -> anyhow::Result<Outcome> {
    if !asked.is_anything() {
        return Ok(Outcome::default());
    }
    let tracer = Tracer::new(picture, asked.variant.is_some())?;
    let frame = Frame::read(renderer, tracer.origin)?;
    let bounces = picture.settings.reflection.bounces;
    let drawn = frame.seen(&tracer.rays);
    let first = tracer.first_hits(&drawn)?;
    let mut outcome = Outcome::default();
    let mut color = renderer.read_aov(Aov::Color)?;
    if asked.is_method {
        let start = Instant::now();
        let traced = tracer.colors(&tracer.surfels, &mirrors_of(&drawn));
        let milliseconds = start.elapsed().as_secs_f64() * 1e3;
        let texels = color.data.as_chunks_mut::<3>().0;
        let mirrors = texels.iter_mut().zip(traced).enumerate().filter(|(pixel, _)| frame.is_mirror(*pixel));
        mirrors.for_each(|(_, (texel, traced))| *texel = traced);
        renderer.present(picture.store, picture.settings, texels)?;
        let mirrors = frame.mirror.iter().filter(|mirror| **mirror > 0.0).count();
        let coverage = first.iter().flatten().count() as f64 / mirrors.max(1) as f64;
        outcome.method = Some(MethodFigures { milliseconds, coverage: (bounces > 0).then_some(coverage), bounces });
        outcome.images = method_images(&first, tracer.origin, picture.size);
        outcome.images.push((Aov::Color, color.clone()));
    }
    let found = if bounces == 0 || (!asked.is_method && picture.settings.reflection.method == Method::None) {
        vec![f32::NAN; frame.len() * 4]
    } else if asked.is_method {
        positions(&first, DVec3::ZERO)
    } else {
        renderer.read_aov_from(Aov::MirrorPosition, tracer.origin)?.data
    };
    let image = frame.image(picture.size, &tracer.rays, &found);
    let progress = Progress::default();
    let (reference, mut accuracy) = match (asked.truth, asked.variant) {
        (Some(Truth::Exact), Some(variant)) => {
            let exact = Exact::five_mirrors(variant);
            let judge = || accuracy_exact(&image, &tracer.rays, &exact, &progress);
            let accuracy = progress_bar::watch("judging", &progress, judge)?;
            (tracer.light(asked, &exact, &tracer.exactly_seen(&exact)?)?, Some(accuracy))
        }
        (Some(_), _) => {
            let judge = || accuracy_same_input(&image, &tracer.surfels, &progress);
            let accuracy = progress_bar::watch("judging", &progress, judge)?;
            (tracer.light(asked, &tracer.surfels, &drawn)?, Some(accuracy))
        }
        (None, _) => (tracer.light(asked, &tracer.surfels, &drawn)?, None),
    };
    if let Some(accuracy) = &mut accuracy {
        if asked.variant.is_none() || has_own_colors(picture.settings) {
            let is_judged = |pixel: usize| frame.is_mirror(pixel) && reference.is_mirror[pixel];
            let mirror: Vec<bool> = (0..frame.len()).map(is_judged).collect();
            let colors = color.data.as_chunks::<3>().0;
            accuracy.image = Some(image_error(picture.size[0] as usize, &mirror, colors, &reference.color));
        }
        if asked.asks_for(Reference::Indirect) {
            let drawn = renderer.read_aov(Aov::Indirect)?.data;
            let is_drawn: Vec<bool> = frame.position.as_chunks::<3>().0.iter().map(|at| at[0].is_finite()).collect();
            accuracy.indirect = Some(light_error(&is_drawn, drawn.as_chunks::<3>().0, &reference.indirect));
        }
    }
    outcome.accuracy = accuracy;
    outcome.references = asked
        .references
        .iter()
        .map(|(wanted, path)| {
            let (channels, data) = match wanted {
                Reference::Position => (Aov::MirrorPosition.channels(), positions(&first, tracer.origin)),
                Reference::Color => (Aov::Color.channels(), reference.color.as_flattened().to_vec()),
                Reference::Indirect => (Aov::Color.channels(), reference.indirect.as_flattened().to_vec()),
            };
            (path.clone(), AovImage { size: picture.size, channels, data })
        })
        .collect();
    Ok(outcome)
}

/// What each pixel sees, and the direction of the ray that sees it; none where that is nothing.
type Seen = Vec<Option<(Hit, DVec3)>>;

/// Those of the pixels that see a mirror.
fn mirrors_of(seen: &[Option<(Hit, DVec3)>]) -> Seen {
    seen.iter().map(|seen| seen.filter(|(hit, _)| hit.specular_intensity > 0.0)).collect()
}

/// World positions and coverage of hits whose places are from `origin`.
fn positions(hits: &[Option<Hit>], origin: DVec3) -> Vec<f32> {
    let texel =
        |hit: &Option<Hit>| hit.map_or([f32::NAN; 4], |hit| (hit.position + origin).as_vec3().extend(1.0).to_array());
    hits.iter().flat_map(texel).collect()
}

/// What a method leaves behind of the first bounce.
fn method_images(first: &[Option<Hit>], origin: DVec3, size: [u32; 2]) -> Vec<(Aov, AovImage)> {
    let vectors = |vector: fn(&Hit) -> DVec3| -> Vec<f32> {
        first.iter().flat_map(|hit| hit.as_ref().map_or(DVec3::NAN, vector).as_vec3().to_array()).collect()
    };
    let images = [
        (Aov::MirrorPosition, positions(first, origin)),
        (Aov::MirrorAlbedo, vectors(|hit| hit.albedo)),
        (Aov::MirrorNormal, vectors(|hit| hit.normal)),
    ];
    images.map(|(aov, data)| (aov, AovImage { size, channels: aov.channels(), data })).into()
}

/// A frame's surface, positions from the tracer's origin.
struct Frame {
    mirror: Vec<f32>,
    position: Vec<f32>,
    normal: Vec<f32>,
    albedo: Vec<f32>,
    specular_intensity: Vec<f32>,
    specular_power: Vec<f32>,
}

impl Frame {
    fn read(renderer: &Renderer, origin: DVec3) -> anyhow::Result<Self> {
        let read = |aov| renderer.read_aov_from(aov, origin).map(|image| image.data);
        Ok(Self {
            mirror: read(Aov::Mirror)?,
            position: read(Aov::Position)?,
            normal: read(Aov::Normal)?,
            albedo: read(Aov::Albedo)?,
            specular_intensity: read(Aov::SpecularIntensity)?,
            specular_power: read(Aov::SpecularPower)?,
        })
    }

    fn len(&self) -> usize {
        self.mirror.len()
    }

    fn is_mirror(&self, pixel: usize) -> bool {
        self.mirror[pixel] > 0.0
    }

    /// The surface that a pixel sees, as the end of the eye's ray.
    fn hit(&self, pixel: usize, rays: &PixelRays) -> Option<Hit> {
        let [position, normal, albedo] = [&self.position, &self.normal, &self.albedo].map(|image| {
            let [x, y, z] = [0, 1, 2].map(|axis| f64::from(image[pixel * 3 + axis]));
            DVec3::new(x, y, z)
        });
        position.is_finite().then(|| Hit {
            distance: rays.viewpoint().distance(position),
            position,
            normal: normal.normalize_or_zero(),
            albedo,
            specular_intensity: f64::from(self.specular_intensity[pixel]),
            specular_power: f64::from(self.specular_power[pixel]),
            surface: 0,
            point: 0,
        })
    }

    fn seen(&self, rays: &PixelRays) -> Seen {
        let seen = |pixel: usize| self.hit(pixel, rays).map(|hit| (hit, rays.viewpoint().toward(hit.position)));
        (0..self.len()).map(seen).collect()
    }

    fn image<'a>(&'a self, size: [u32; 2], rays: &PixelRays, mirror_position: &'a [f32]) -> MirrorImage<'a> {
        let Self { mirror, position, normal, .. } = self;
        MirrorImage { size, viewpoint: rays.viewpoint(), mirror, position, normal, mirror_position }
    }
}

/// The scene as the ray tracer has it.
struct Tracer<'a> {
    surfels: Surfels,
    /// What all places are from: near the scene, so that images of 32-bit positions hold them finely.
    origin: DVec3,
    rays: PixelRays,
    lights: Vec<SpotLight>,
    sky_is_open: bool,
    /// The world's up axis.
    up: DVec3,
    settings: &'a Settings,
}

/// What the tracer says of each pixel's light, linear; NaN where nothing is seen or nobody asks.
struct Light {
    is_mirror: Vec<bool>,
    color: Vec<[f32; 3]>,
    indirect: Vec<[f32; 3]>,
}

impl<'a> Tracer<'a> {
    /// `at_world_origin`: in the coordinates of the built-in scenes' formulas.
    fn new(picture: &Picture<'a>, at_world_origin: bool) -> anyhow::Result<Self> {
        let Picture { parts, camera, settings, objects, size, .. } = *picture;
        let chunks = parts.iter().flat_map(|part| &part.cloud.chunks);
        let bounds = chunks.fold(Bounds::EMPTY, |all, chunk| all.union(chunk.bounds()));
        let origin = if at_world_origin || bounds.is_empty() { DVec3::ZERO } else { bounds.center().round() };
        let painted: Vec<Vec<Chunk>> = parts.iter().map(|part| part.painted(origin)).collect();
        let parts = parts.iter().zip(&painted).map(|(part, chunks)| {
            let [red, green, blue, _] = part.plain().map(|value| linear_from_srgb(value) as f32);
            let Part { specular_intensity, specular_power, .. } = *part;
            study::Part { chunks, specular_intensity, specular_power, plain: [red, green, blue] }
        });
        let progress = Progress::default();
        let surfels = Surfels::new(&parts.collect::<Vec<_>>(), settings.splat.size, &progress);
        let lights = objects.lights.iter().take(MOST_LIGHTS).map(|light| SpotLight {
            position: light.position - origin,
            target: light.target - origin,
            ..*light
        });
        let seen = Camera { eye: camera.eye - origin, pivot: camera.pivot - origin, up: camera.up };
        let reach = if bounds.is_empty() { 0.0 } else { 2.0 * bounds.radius() + camera.eye.distance(bounds.center()) };
        Ok(Self {
            surfels: surfels.ok_or_else(cancelled)?,
            origin,
            rays: PixelRays::new(&seen, &settings.view, size, reach),
            lights: lights.collect(),
            sky_is_open: objects.sky_is_open,
            up: camera.up,
            settings,
        })
    }

    fn illumination(&self) -> Illumination<'_> {
        let Settings { light, sun, gi, trace, mirror, reflection, view, .. } = self.settings;
        let source = match light.lighting(!self.lights.is_empty(), self.sky_is_open) {
            Lighting::Lights => Source::Lights(&self.lights),
            Lighting::Sun => Source::Sun(Sunlight::new(sun, self.up)),
            Lighting::Auto | Lighting::Headlight => Source::Headlight(f64::from(light.headlight)),
            Lighting::Colors => Source::Headlight(0.0),
        };
        let [red, green, blue, _] = view.background.bytes().map(linear_from_srgb);
        let (share, power) = (f64::from(light.gloss), f64::from(light.gloss_power));
        Illumination {
            gloss: Gloss { share, power, shape: light.highlight },
            bounces: reflection.bounces,
            background: DVec3::new(red, green, blue),
            indirect: Indirect { bounces: gi.bounces, samples: trace.samples, seed: trace.seed },
            ..Illumination::new(source, mirror)
        }
    }

    /// What the reflected ray of each mirror pixel meets.
    fn first_hits(&self, seen: &[Option<(Hit, DVec3)>]) -> anyhow::Result<Vec<Option<Hit>>> {
        let point = |seen: &Option<(Hit, DVec3)>| {
            let (hit, incoming) = seen.filter(|(hit, _)| hit.specular_intensity > 0.0)?;
            Some(MirrorPoint { position: hit.position, normal: hit.normal, incoming })
        };
        let points: Vec<Option<MirrorPoint>> = seen.iter().map(point).collect();
        let mirrors: Vec<MirrorPoint> = points.iter().copied().flatten().collect();
        let progress = Progress::default();
        let follow = || reflected(&self.surfels, &mirrors, 1, &progress);
        let reflections = progress_bar::watch("tracing", &progress, follow).ok_or_else(cancelled)?;
        let mut reflections = reflections.into_iter();
        Ok(points.iter().map(|point| point.and_then(|_| reflections.next()?.first)).collect())
    }

    /// What the rays through the pixels' centres meet of exact surfaces.
    fn exactly_seen(&self, exact: &Exact) -> anyhow::Result<Seen> {
        let progress = Progress::default();
        let seen = progress_bar::watch("tracing", &progress, || primary(exact, &self.rays, &progress));
        let seen = seen.ok_or_else(cancelled)?.into_iter().enumerate();
        Ok(seen.map(|(pixel, hit)| Some((hit?, self.rays.ray(pixel).direction))).collect())
    }

    /// Radiance of what is seen, linear; NaN where that is nothing.
    fn colors(&self, geometry: &impl Geometry, seen: &[Option<(Hit, DVec3)>]) -> Vec<[f32; 3]> {
        let illumination = self.illumination();
        let progress = Progress::default();
        progress.set_total(seen.len() as u64);
        let color = |(pixel, seen): (usize, &Option<(Hit, DVec3)>)| {
            progress.add(1);
            let light = seen.map(|(hit, direction)| radiance(geometry, &hit, direction, pixel, &illumination));
            light.unwrap_or(DVec3::NAN).as_vec3().to_array()
        };
        progress_bar::watch("lighting", &progress, || seen.par_iter().enumerate().map(color).collect())
    }

    /// The light that is asked for. Figures need that of the mirrors only.
    fn light(&self, asked: &Asked, geometry: &impl Geometry, seen: &[Option<(Hit, DVec3)>]) -> anyhow::Result<Light> {
        let mirrors = mirrors_of(seen);
        let color = if asked.asks_for(Reference::Color) {
            self.colors(geometry, seen)
        } else if asked.truth.is_some() {
            self.colors(geometry, &mirrors)
        } else {
            Vec::new()
        };
        let mut indirect = Vec::new();
        if asked.asks_for(Reference::Indirect) {
            let settings = &self.settings.reflection;
            // As the renderer's own: a mirror is diffuse if nobody looks for what it reflects.
            let bounces = if settings.method == Method::None { 0 } else { settings.bounces };
            let illumination = Illumination { bounces, ..self.illumination() };
            let progress = Progress::default();
            let gather = || indirect_picture(geometry, seen, &illumination, &progress);
            let light = progress_bar::watch("gathering", &progress, gather).ok_or_else(cancelled)?;
            indirect = light.into_iter().map(|light| light.unwrap_or(DVec3::NAN).as_vec3().to_array()).collect();
        }
        Ok(Light { is_mirror: mirrors.iter().map(Option::is_some).collect(), color, indirect })
    }
}

/// Nobody can stop the tracer here; said all the same instead of assumed.
fn cancelled() -> anyhow::Error {
    anyhow!("tracing the truth ended before it was done")
}
