//! The truth on the command line: the ray tracer finds what the mirrors of a drawn frame show. It makes the images
//! `reference_position`, `reference_color` and `reference_indirect`, the accuracy figures of `--stats`, and the method
//! `ray_trace`.
//!
//! Tracing starts from the frame's own surface (positions, normals and colours of its pixels). Rays meet the points
//! that the frame was drawn from, as discs: the same input as the methods have. With `--truth exact`, rays for the
//! figures and for the images of light meet the surfaces behind the points instead: the formulas of a built-in scene,
//! or the triangles of meshes. docs/accuracy.md says what each figure means.

use std::path::PathBuf;
use std::sync::Arc;

use cloud::Progress;
use param::Choice as _;
use render::{Aov, AovImage, Renderer};
use scene::{ColorBy, Settings};
pub use study::RAY_TRACE;
use study::{Accuracy, Faces, Subject, TracedScene, Tracer, Truth, View, light_error, mirrors_of};
use world::{Input, Request};

use crate::shared::command_line::RenderArguments;
use crate::system::failure::usage;
use crate::system::{picture_file, progress_bar};

/// An image that the ray tracer makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// For each mirror pixel: the world position that its reflected ray meets, and the coverage.
    Position,
    /// Traced radiance of all pixels, linear RGB.
    Color,
    /// Indirect light that each pixel's own surface sends out, without its mirror reflection, linear RGB.
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

/// What the command line asks of the ray tracer.
#[derive(Debug, Default)]
pub struct Asked {
    /// Whether the ray tracer is the reflection method.
    is_method: bool,
    references: Vec<(Reference, PathBuf)>,
    /// The truth that the figures of `--stats` are measured against.
    truth: Option<Truth>,
    /// Whether points are drawn in colours that the truth does not know.
    has_other_colors: bool,
}

impl Asked {
    /// # Errors
    /// If the exact truth is asked of anything but an unchanged built-in scene or meshes, or if images of light are
    /// asked of a built-in scene in other colours than its own.
    pub fn new(
        arguments: &RenderArguments,
        references: Vec<(Reference, PathBuf)>,
        request: &Request,
        settings: &Settings,
    ) -> anyhow::Result<Self> {
        let is_exact = arguments.truth == Some(Truth::Exact);
        let is_built_in = request.built_in().is_some();
        if is_exact && !is_built_in && !is_of_meshes(request) {
            let names: Vec<String> = request.inputs.iter().map(Input::name).collect();
            return Err(no_surfaces(&format!("this is {}", names.join(", "))));
        }
        let has_other_colors = is_exact && is_built_in && !has_own_colors(settings);
        let lit = references.iter().find(|(reference, _)| *reference != Reference::Position);
        if let (Some((lit, _)), true) = (lit, has_other_colors) {
            return Err(usage(format!(
                "--truth exact: the formulas behind `{}` have the scene's own colours, color.by is {}; \
                 --truth same_input traces points in the colours that they are drawn in",
                lit.name(),
                settings.color.by.name()
            )));
        }
        let unnamed = (!references.is_empty() && arguments.stats.is_some()).then_some(Truth::SameInput);
        let is_method = arguments.method.as_deref() == Some(RAY_TRACE);
        Ok(Self { is_method, references, truth: arguments.truth.or(unnamed), has_other_colors })
    }

    /// Gives a scene of meshes its triangles, if the exact truth is asked for.
    ///
    /// # Errors
    /// If the faces cannot be read, or no face can be seen.
    pub fn find_surfaces(&self, subject: &mut Subject, sources: &[Option<Arc<codec::Source>>]) -> anyhow::Result<()> {
        if self.truth != Some(Truth::Exact) {
            return Ok(());
        }
        find_surfaces(subject, sources)?;
        match subject.exact {
            Some(_) => Ok(()),
            None => Err(no_surfaces("no face of this has an area and all its points in memory")),
        }
    }

    /// Whether the ray tracer makes this image as the reflection method.
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

fn no_surfaces(what: &str) -> anyhow::Error {
    usage(format!(
        "--truth exact: only a built-in scene alone, with its own mirrors, and meshes (PLY files with faces) have surfaces to trace; \
         {what}; \
         --truth same_input judges any scene by the points that it is drawn from"
    ))
}

/// Whether all clouds are meshes and none of their points are mirrors.
fn is_of_meshes(request: &Request) -> bool {
    let is_mesh = |input: &Input| match input {
        Input::File(path) => codec::open(path).is_ok_and(|source| source.is_mesh()),
        _ => false,
    };
    !request.inputs.is_empty() && request.mirror_points.is_empty() && request.inputs.iter().all(is_mesh)
}

/// Gives a scene of meshes its triangles as the surfaces behind its points. `sources` are those of `LoadedSubject`.
///
/// # Errors
/// If the faces cannot be read.
pub fn find_surfaces(subject: &mut Subject, sources: &[Option<Arc<codec::Source>>]) -> anyhow::Result<()> {
    let meshes: Option<Vec<_>> = sources.iter().map(|source| source.as_deref().filter(|file| file.is_mesh())).collect();
    let (Some(meshes), None) = (meshes, &subject.exact) else { return Ok(()) };
    let faces = |file: &codec::Source| Ok(Faces { triangles: file.triangles()?, has_normals: file.info().has_normals });
    let faces: Vec<Faces> = meshes.into_iter().map(faces).collect::<codec::Result<_>>()?;
    subject.exact = subject.surfaces_of_meshes(&faces);
    Ok(())
}

/// Whether points show the colours of the built-in scenes' formulas.
fn has_own_colors(settings: &Settings) -> bool {
    matches!(settings.color.by, ColorBy::Auto | ColorBy::Rgb)
}

/// The results of the ray tracer.
#[derive(Default)]
pub struct Outcome {
    pub references: Vec<(Reference, PathBuf, AovImage)>,
    /// The images of the method, which replace the renderer's.
    images: Vec<(Aov, AovImage)>,
    pub accuracy: Option<Accuracy>,
    pub method: Option<MethodFigures>,
}

impl Outcome {
    /// The method's image that replaces the renderer's, if there is one.
    pub fn image(&self, aov: Aov) -> Option<&AovImage> {
        self.images.iter().find(|(made, _)| *made == aov).map(|(_, image)| image)
    }
}

/// The figures of the method `ray_trace`.
#[derive(Clone, Copy, Debug)]
pub struct MethodFigures {
    /// The time to trace and light what the mirror pixels show, over all bounces, on all cores.
    pub milliseconds: f64,
    /// The stops that were fitted to the picture with its reflections, if any were.
    pub exposure: Option<f32>,
    /// The share of mirror pixels whose ray meets a point; `None` if no reflections are followed.
    pub coverage: Option<f64>,
    pub bounces: u32,
}

/// Makes what `asked` names from the frame of `subject` that `renderer` holds. As the method, it puts the reflections
/// into the renderer's picture.
///
/// # Errors
/// If the device was lost.
pub fn trace(
    asked: &Asked,
    subject: &Subject,
    settings: &Settings,
    size: [u32; 2],
    renderer: &mut Renderer,
) -> anyhow::Result<Outcome> {
    if !asked.is_anything() {
        return Ok(Outcome::default());
    }
    let scene = TracedScene::new(&subject.parts, subject.exact.clone(), settings.splat.size, &Progress::default())?;
    let view = View { camera: &subject.camera, settings, objects: subject.objects(), size };
    let tracer = Tracer::new(&scene, view);
    let mut drawn = tracer.drawn(renderer)?;
    let bounces = settings.reflection.bounces;
    let watch = |task, work: &dyn Fn(&Progress) -> study::Result<Vec<[f32; 3]>>| {
        let progress = Progress::default();
        progress_bar::watch(task, &progress, || work(&progress))
    };
    let mut outcome = Outcome::default();
    let origin = picture_file::origin(&subject.camera);
    let first = if asked.is_method {
        let progress = Progress::default();
        let traced = progress_bar::watch("tracing", &progress, || tracer.ray_trace(&mut drawn, &progress))?;
        let exposure = renderer.present(settings, &drawn.color, true)?.map(|exposure| exposure.stops);
        let mirrors = drawn.surface.mirror.iter().filter(|mirror| **mirror > 0.0).count();
        let coverage = traced.first.iter().flatten().count() as f64 / mirrors.max(1) as f64;
        let coverage = (bounces > 0).then_some(coverage);
        outcome.method = Some(MethodFigures { milliseconds: traced.milliseconds, exposure, coverage, bounces });
        let images = [Aov::MirrorPosition, Aov::MirrorAlbedo, Aov::MirrorNormal];
        let images = images.into_iter().filter_map(|aov| Some((aov, tracer.mirror_image(aov, &traced.first, origin)?)));
        outcome.images = images.collect();
        let color = AovImage { size, channels: Aov::Color.channels(), data: drawn.color.as_flattened().to_vec() };
        outcome.images.push((Aov::Color, color));
        Some(traced.first)
    } else {
        None
    };
    let truth = asked.truth.unwrap_or(Truth::SameInput);
    let own = tracer.seen(&drawn.surface);
    let seen = match truth {
        Truth::Exact => {
            let progress = Progress::default();
            &progress_bar::watch("tracing", &progress, || tracer.exactly_seen(&progress))?
        }
        Truth::SameInput => &own,
    };
    let color = if asked.asks_for(Reference::Color) {
        watch("lighting", &|progress| tracer.colors(truth, seen, progress))?
    } else if asked.truth.is_some() {
        // The figures need the light of the mirror pixels only.
        let mirrors = mirrors_of(seen);
        watch("lighting", &|progress| tracer.colors(truth, &mirrors, progress))?
    } else {
        Vec::new()
    };
    let indirect = if asked.asks_for(Reference::Indirect) {
        watch("gathering", &|progress| tracer.indirect(truth, seen, progress))?
    } else {
        Vec::new()
    };
    if asked.truth.is_some() {
        let progress = Progress::default();
        let mut accuracy = progress_bar::watch("judging", &progress, || tracer.judge(truth, &drawn, &progress))?;
        if !asked.has_other_colors {
            accuracy.image = Some(tracer.image_error(&drawn, seen, &color));
        }
        if asked.asks_for(Reference::Indirect) {
            let image = renderer.read_aov(Aov::Indirect)?.data;
            let is_drawn: Vec<bool> = own.iter().map(Option::is_some).collect();
            accuracy.indirect = Some(light_error(&is_drawn, image.as_chunks::<3>().0, &indirect));
        }
        outcome.accuracy = Some(accuracy);
    }
    for (wanted, path) in &asked.references {
        let image = match wanted {
            Reference::Position => {
                let first = match &first {
                    Some(first) => first,
                    None => {
                        let progress = Progress::default();
                        &progress_bar::watch("tracing", &progress, || tracer.first_hits(&own, &progress))?
                    }
                };
                tracer.mirror_image(Aov::MirrorPosition, first, origin)
            }
            Reference::Color => {
                Some(AovImage { size, channels: Aov::Color.channels(), data: color.as_flattened().to_vec() })
            }
            Reference::Indirect => {
                Some(AovImage { size, channels: Aov::Color.channels(), data: indirect.as_flattened().to_vec() })
            }
        };
        outcome.references.extend(image.map(|image| (*wanted, path.clone(), image)));
    }
    Ok(outcome)
}
