//! The truth on the command line: what the ray tracer sees in the mirrors of a frame that was drawn. It gives the images
//! `reference_position`, `reference_color` and `reference_indirect`, the accuracy figures of `--stats`, and the method `ray_trace`.
//!
//! All of it starts from the frame's own surface (positions, normals, colours of its pixels) and from the points that it was
//! drawn from, as discs: the same input as the methods have. Only `--truth exact` asks the surfaces behind the points, which are
//! a built-in scene's formulas or the triangles of meshes, for the figures and for the images of light.
//! docs/accuracy.md tells what each figure means.

use std::path::PathBuf;
use std::sync::Arc;

use cloud::Progress;
use param::Choice as _;
use render::{Aov, AovImage, Renderer};
use scene::{ColorBy, Settings};
pub use study::RAY_TRACE;
use study::{Accuracy, Faces, Subject, TracedScene, Tracer, Truth, View, light_error, mirrors_of};
use world::{Input, Request};

use crate::command_line::RenderArguments;
use crate::failure::usage;
use crate::progress_bar;

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
    /// Points are drawn in colours that the truth does not know.
    has_other_colors: bool,
}

impl Asked {
    /// # Errors
    /// The exact truth of something else than a built-in scene as it is or meshes, or the light of a built-in scene in other
    /// colours than its own.
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

    /// Gives a scene of meshes its triangles, if the truth is to know them.
    ///
    /// # Errors
    /// Faces that cannot be read, or of which there is nothing to see.
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

fn no_surfaces(what: &str) -> anyhow::Error {
    usage(format!(
        "--truth exact: only a built-in scene alone, with its own mirrors, and meshes (PLY files with faces) have surfaces to trace; \
         {what}; \
         --truth same_input judges any scene by the points that it is drawn from"
    ))
}

/// Whether all clouds are meshes, none of whose points are mirrors.
fn is_of_meshes(request: &Request) -> bool {
    let is_mesh = |input: &Input| match input {
        Input::File(path) => codec::open(path).is_ok_and(|source| source.is_mesh()),
        _ => false,
    };
    !request.inputs.is_empty() && request.mirror_points.is_empty() && request.inputs.iter().all(is_mesh)
}

/// Gives a scene of meshes its triangles as the surfaces behind its points; `sources` as in `LoadedSubject`.
///
/// # Errors
/// Faces that cannot be read.
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

/// Does what is asked with the frame of `subject` that `renderer` holds; as a method it puts what mirrors show into the renderer's
/// picture.
///
/// # Errors
/// The device was lost.
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
    let first = if asked.is_method {
        let progress = Progress::default();
        let traced = progress_bar::watch("tracing", &progress, || tracer.ray_trace(&mut drawn, &progress))?;
        renderer.present(&subject.store, settings, &drawn.color)?;
        let mirrors = drawn.surface.mirror.iter().filter(|mirror| **mirror > 0.0).count();
        let coverage = traced.first.iter().flatten().count() as f64 / mirrors.max(1) as f64;
        let coverage = (bounces > 0).then_some(coverage);
        outcome.method = Some(MethodFigures { milliseconds: traced.milliseconds, coverage, bounces });
        let images = [Aov::MirrorPosition, Aov::MirrorAlbedo, Aov::MirrorNormal];
        let images = images.into_iter().filter_map(|aov| Some((aov, tracer.mirror_image(aov, &traced.first)?)));
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
        // Figures need that of the mirrors only.
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
                tracer.mirror_image(Aov::MirrorPosition, first)
            }
            Reference::Color => {
                Some(AovImage { size, channels: Aov::Color.channels(), data: color.as_flattened().to_vec() })
            }
            Reference::Indirect => {
                Some(AovImage { size, channels: Aov::Color.channels(), data: indirect.as_flattened().to_vec() })
            }
        };
        outcome.references.extend(image.map(|image| (path.clone(), image)));
    }
    Ok(outcome)
}
