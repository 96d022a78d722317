//! The truth on the command line: what the ray tracer sees in the mirrors of a frame that was drawn. It gives the images
//! `reference_position` and `reference_color`, the accuracy figures of `--stats`, and the method `ray_trace`.
//!
//! All of it starts from the frame's own surface (positions, normals, colours of its pixels) and from the points that it was
//! drawn from, as discs: the same input as the methods have. Only `--truth exact` asks the built-in scene's formulas.
//! docs/accuracy.md tells what each figure means.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::anyhow;
use cloud::{Bounds, Chunk, Cloud, Progress};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use render::{Aov, AovImage, ColorPlan, ColorSource, Objects, PointStore, Renderer};
use scene::five_mirrors::Variant;
use scene::{Camera, ColorBy, Lighting, Method, Mirror, Settings, SpotLight};
use study::{
    Accuracy, Exact, Hit, Illumination, MirrorImage, MirrorPoint, PixelRays, Surfels, Truth, accuracy_exact,
    accuracy_same_input, image_error, linear_from_srgb, primary, radiance, reflected,
};

use crate::command_line::RenderArguments;
use crate::failure::usage;
use crate::loading::{Input, Request};
use crate::progress_bar;

/// The method's name.
pub const RAY_TRACE: &str = "ray_trace";

/// Lights that count, as in `render::Objects`.
const MOST_LIGHTS: usize = 4;

/// An image of the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// World position of what each mirror pixel's reflected ray meets; coverage.
    Position,
    /// Traced radiance of all pixels, linear RGB.
    Color,
}

impl Reference {
    pub const ALL: [Self; 2] = [Self::Position, Self::Color];

    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "reference_position",
            Self::Color => "reference_color",
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
    /// The exact truth of something else than a built-in scene as it is.
    pub fn new(
        arguments: &RenderArguments,
        references: Vec<(Reference, PathBuf)>,
        request: &Request,
    ) -> anyhow::Result<Self> {
        let variant = if arguments.truth == Some(Truth::Exact) { Some(built_in(request)?) } else { None };
        let unnamed = (!references.is_empty() && arguments.stats.is_some()).then_some(Truth::SameInput);
        let is_method = arguments.method.as_deref() == Some(RAY_TRACE);
        Ok(Self { is_method, references, truth: arguments.truth.or(unnamed), variant })
    }

    /// Whether the method makes this image.
    pub fn makes(&self, aov: Aov) -> bool {
        self.is_method && matches!(aov, Aov::MirrorPosition | Aov::MirrorAlbedo | Aov::MirrorNormal)
    }

    fn is_anything(&self) -> bool {
        self.is_method || !self.references.is_empty() || self.truth.is_some()
    }
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
        Self { cloud, specular_intensity: mirror.specular_intensity, plan, up: DVec3::Z }
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
    let first = tracer.first_hits(&frame)?;
    let mut outcome = Outcome::default();
    let mut color = renderer.read_aov(Aov::Color)?;
    if asked.is_method {
        let start = Instant::now();
        let traced = tracer.colors(&frame, |pixel| frame.is_mirror(pixel));
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
    let needs_color = asked.references.iter().any(|(reference, _)| *reference == Reference::Color);
    let reference =
        if needs_color || asked.truth == Some(Truth::SameInput) { tracer.colors(&frame, |_| true) } else { Vec::new() };
    let image = frame.image(picture.size, &tracer.rays, &found);
    let colors = color.data.as_chunks::<3>().0;
    outcome.accuracy = match (asked.truth, asked.variant) {
        (Some(Truth::Exact), Some(variant)) => Some(tracer.judge_exact(&image, &frame, variant, colors)?),
        (Some(_), _) => {
            let progress = Progress::default();
            let judge = || accuracy_same_input(&image, &tracer.surfels, &progress);
            let mut accuracy = progress_bar::watch("judging", &progress, judge)?;
            let mirror: Vec<bool> = (0..frame.len()).map(|pixel| frame.is_mirror(pixel)).collect();
            accuracy.image = Some(image_error(picture.size[0] as usize, &mirror, colors, &reference));
            Some(accuracy)
        }
        (None, _) => None,
    };
    outcome.references = asked
        .references
        .iter()
        .map(|(wanted, path)| {
            let (channels, data) = match wanted {
                Reference::Position => (Aov::MirrorPosition.channels(), positions(&first, tracer.origin)),
                Reference::Color => (Aov::Color.channels(), reference.as_flattened().to_vec()),
            };
            (path.clone(), AovImage { size: picture.size, channels, data })
        })
        .collect();
    Ok(outcome)
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
            surface: 0,
            point: 0,
        })
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
    settings: &'a Settings,
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
            study::Part { chunks, specular_intensity: part.specular_intensity, plain: [red, green, blue] }
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
            settings,
        })
    }

    fn illumination(&self) -> Illumination<'_> {
        let settings = self.settings;
        let lamp = match settings.light.by {
            Lighting::Auto if self.lights.is_empty() => Some(settings.light.headlight),
            Lighting::Headlight => Some(settings.light.headlight),
            Lighting::Colors => Some(0.0),
            Lighting::Auto | Lighting::Lights | Lighting::Sun => None,
        };
        let [red, green, blue, _] = settings.view.background.bytes().map(linear_from_srgb);
        Illumination {
            lights: &self.lights,
            lamp: lamp.map(f64::from),
            bounces: settings.reflection.bounces,
            mirror: &settings.mirror,
            background: DVec3::new(red, green, blue),
        }
    }

    /// What the reflected ray of each mirror pixel meets.
    fn first_hits(&self, frame: &Frame) -> anyhow::Result<Vec<Option<Hit>>> {
        let point = |pixel: usize| {
            let hit = frame.hit(pixel, &self.rays).filter(|_| frame.is_mirror(pixel))?;
            let incoming = self.rays.viewpoint().toward(hit.position);
            Some(MirrorPoint { position: hit.position, normal: hit.normal, incoming })
        };
        let points: Vec<Option<MirrorPoint>> = (0..frame.len()).map(point).collect();
        let mirrors: Vec<MirrorPoint> = points.iter().copied().flatten().collect();
        let progress = Progress::default();
        let follow = || reflected(&self.surfels, &mirrors, 1, &progress);
        let reflections = progress_bar::watch("tracing", &progress, follow).ok_or_else(cancelled)?;
        let mut reflections = reflections.into_iter();
        Ok(points.iter().map(|point| point.and_then(|_| reflections.next()?.first)).collect())
    }

    /// Radiance of the frame's surface at the pixels that are `wanted`, linear; NaN at the others.
    fn colors(&self, frame: &Frame, wanted: impl Fn(usize) -> bool + Sync) -> Vec<[f32; 3]> {
        let illumination = self.illumination();
        let progress = Progress::default();
        progress.set_total(frame.len() as u64);
        let color = |pixel: usize| {
            progress.add(1);
            let hit = frame.hit(pixel, &self.rays).filter(|_| wanted(pixel));
            let light =
                hit.map(|hit| radiance(&self.surfels, &hit, self.rays.viewpoint().toward(hit.position), &illumination));
            light.unwrap_or(DVec3::NAN).as_vec3().to_array()
        };
        progress_bar::watch("lighting", &progress, || (0..frame.len()).into_par_iter().map(color).collect())
    }

    /// By rays through the pixels' centres into exact surfaces, over the pixels that are mirrors in both.
    fn judge_exact(
        &self,
        image: &MirrorImage,
        frame: &Frame,
        variant: Variant,
        colors: &[[f32; 3]],
    ) -> anyhow::Result<Accuracy> {
        let exact = Exact::five_mirrors(variant);
        let progress = Progress::default();
        let judge = || accuracy_exact(image, &self.rays, &exact, &progress);
        let mut accuracy = progress_bar::watch("judging", &progress, judge)?;
        // The formulas know the scene's own colours only.
        if !matches!(self.settings.color.by, ColorBy::Auto | ColorBy::Rgb) {
            return Ok(accuracy);
        }
        let progress = Progress::default();
        let seen = progress_bar::watch("tracing", &progress, || primary(&exact, &self.rays, &progress));
        let seen = seen.ok_or_else(cancelled)?;
        let illumination = self.illumination();
        let color = |(pixel, hit): (usize, &Option<Hit>)| {
            let hit = hit.filter(|hit| frame.is_mirror(pixel) && hit.specular_intensity > 0.0)?;
            Some(radiance(&exact, &hit, self.rays.ray(pixel).direction, &illumination).as_vec3().to_array())
        };
        let reference: Vec<Option<[f32; 3]>> = seen.par_iter().enumerate().map(color).collect();
        let mirror: Vec<bool> = reference.iter().map(Option::is_some).collect();
        let reference: Vec<[f32; 3]> = reference.into_iter().map(|color| color.unwrap_or([f32::NAN; 3])).collect();
        accuracy.image = Some(image_error(self.rays.size[0] as usize, &mirror, colors, &reference));
        Ok(accuracy)
    }
}

/// Nobody can stop the tracer here; said all the same instead of assumed.
fn cancelled() -> anyhow::Error {
    anyhow!("tracing the truth ended before it was done")
}
