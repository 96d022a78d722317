//! `glint render`: writes the picture that the viewer would show, without a window. It loads, colours and draws as the
//! viewer does.
//!
//! Everything that a user may have mistyped is checked before the first point is read.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use glam::DVec3;
use param::Choice as _;
use render::{Aov, CameraCount, FrameStats, Gpu, MapCount, MapLimit, MapUse, PassStage, Renderer};
use scene::{Camera, Method, SceneFile, Settings, StandardView, Start, whole_file};
use serde::Serialize;
use study::results::Spread;
use study::{Estimate, Subject, View};
use world::Request;

use crate::commands::chosen::{self, AutoStats};
use crate::commands::listing;
use crate::commands::recording::{self, PathChoice, Recorder};
use crate::commands::subject::{self, LoadedSubject};
use crate::commands::truth::{self, Asked, Reference};
use crate::overlays;
use crate::shared::command_line::RenderArguments;
use crate::system::failure::usage;
use crate::system::peak_memory::host_peak_bytes;
use crate::system::progress_bar::Bar;
use crate::system::{interrupt, picture_file, terminal};

/// Renders the picture. Returns exit status 2 if one of several inputs could not be read and the picture shows the
/// others.
///
/// # Errors
/// Fails on bad usage, without an adapter, if no input can be read, if a file cannot be written, or on Ctrl-C.
pub fn run(arguments: &RenderArguments) -> anyhow::Result<u8> {
    let (images, references) = images(arguments)?;
    let mut request = world::resolve(&arguments.inputs);
    request.check()?;
    spare_inputs(arguments, &request)?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let viewpoint = Viewpoint::new(arguments.camera.as_deref(), &mut request, &mut settings)?;
    if let Some(preset) = arguments.preset {
        settings = preset.applied(&settings, request.all_mirrors().iter());
    }
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    if let Some(seed) = arguments.seed {
        settings.scene.seed = seed;
    }
    if let Some(name) = &arguments.method {
        settings.reflection.method = method(name)?;
        if arguments.time.is_some() && name == truth::RAY_TRACE {
            return Err(usage(format!("--time: `{name}` traces no paths; name another method")));
        }
        if arguments.estimate && name == truth::RAY_TRACE {
            return Err(usage(format!(
                "--estimate: `{name}` is exact; ask for a method that is not, or for --truth exact"
            )));
        }
    }
    if let Some(bounces) = arguments.bounces {
        settings.set_text("reflection.bounces", &bounces.to_string()).context("--bounces")?;
    }
    if let Some(time) = arguments.time {
        return at_time(arguments, time, request, settings, &images, &references);
    }
    let mut settings = settings.drawn();
    let target = arguments.target.target();
    chosen::check(target, arguments.method.as_deref())?;
    check_resolution(arguments, &settings)?;
    let asked = Asked::new(arguments, references, &request, &settings)?;
    for (aov, _) in &images {
        check_is_made(*aov, &settings, asked.makes(*aov))?;
    }
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    check_size(&gpu, arguments.size)?;
    terminal::warn(&request.warnings);

    let camera = |outline: &[DVec3], up, room| viewpoint.camera(outline, up, room, &settings, arguments.size);
    let LoadedSubject { mut subject, status, stream, sources, facts } =
        match subject::open(&gpu, request, &settings, arguments.size, camera)? {
            Ok(opened) => opened,
            // The reasons have been reported already.
            Err(status) => return Ok(status),
        };

    asked.find_surfaces(&mut subject, &sources)?;

    let mut renderer = Renderer::new(gpu.clone())?;
    let fixed = fixed(arguments, &settings);
    let choose = |target| chosen::choose(target, &mut settings, &fixed, &subject, arguments.size, &gpu, &mut renderer);
    let auto = target.map(choose).transpose()?;
    let size = study::drawn_size(arguments.size, &settings);
    let mut draw = || -> anyhow::Result<FrameStats> {
        interrupt::check()?;
        // Draw each frame from scratch: work that a frame takes over from the one before would be missing from its
        // time.
        Ok(subject.render(&mut renderer, &settings, size)?)
    };
    let mut frames = vec![draw()?];
    if arguments.stats.is_some() || arguments.frames.is_some() {
        // The frame before was the warm-up.
        frames = (0..arguments.frames.unwrap_or(1)).map(|_| draw()).collect::<anyhow::Result<_>>()?;
    }
    let depth = renderer.read_aov(Aov::Depth)?.data;
    if depth.iter().all(|depth| depth.is_nan()) {
        terminal::warn(["the picture is empty, the camera looks past all points"]);
    }
    let estimate = match arguments.estimate {
        true => estimate(&subject, &settings, arguments.size, &mut renderer)?,
        false => None,
    };
    let traced = truth::trace(&asked, &subject, &settings, size, &mut renderer)?;
    // All output files are written from here on.
    interrupt::check()?;
    let mut picture = study::picture::enlarged(&renderer.read_picture()?, &depth, size, arguments.size);
    overlays::draw(&mut picture, arguments.size, &subject.camera, &settings, &facts);
    picture_file::write_png(&arguments.output, arguments.size, &picture, Some(&picture_file::adapter(&gpu)))?;
    for (aov, path) in &images {
        match traced.image(*aov) {
            Some(image) => picture_file::write_exr(path, image)?,
            None => picture_file::write_exr(path, &renderer.read_aov(*aov)?)?,
        }
    }
    for (path, image) in &traced.references {
        picture_file::write_exr(path, image)?;
    }
    if let Some(path) = &arguments.stats {
        let stats = Stats::new(arguments, &gpu, &settings, &frames, mirror_pixels(&renderer)?);
        let stats = Stats { stream, estimate, auto, ..stats.with(traced) };
        picture_file::write_text(path, &(serde_json::to_string_pretty(&stats)? + "\n"))?;
    }
    Ok(status)
}

/// Writes the picture of a path at a time, as a recording has it.
fn at_time(
    arguments: &RenderArguments,
    time: f64,
    mut request: Request,
    settings: Settings,
    images: &[(Aov, PathBuf)],
    references: &[(Reference, PathBuf)],
) -> anyhow::Result<u8> {
    let name = Path::new(arguments.inputs.first().map_or(OsStr::new(""), |input| input.as_os_str()));
    let path = PathChoice::new(arguments.path.as_deref(), &request, name)?;
    if let Some((reference, _)) = references.first() {
        return Err(usage(format!("--aov: `{}` is traced for a view; leave --time out", reference.name())));
    }
    let asked = Asked::new(arguments, Vec::new(), &request, &settings)?;
    for (aov, _) in images {
        check_is_made(*aov, &settings, asked.makes(*aov))?;
    }
    path.check_images(images.len())?;
    *recording::settings(&mut request) = settings;
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    check_size(&gpu, arguments.size)?;
    let adapter = picture_file::adapter(&gpu);
    let mut recorder = match Recorder::open(gpu, arguments.gpu.gpu.clone(), arguments.size, request, &path)? {
        Ok(recorder) => recorder,
        Err(status) => return Ok(status),
    };
    let bar = Bar::pictures("rendering");
    let aovs: Vec<Aov> = images.iter().map(|(aov, _)| *aov).collect();
    let picture = recorder.picture(time, &aovs, &bar)?;
    bar.end();
    if recorder.is_empty() {
        terminal::warn(["the picture is empty, the camera looks past all points"]);
    }
    picture_file::write_png(&arguments.output, arguments.size, &picture.rgba, Some(&adapter))?;
    for ((_, path), image) in images.iter().zip(&picture.images) {
        picture_file::write_exr(path, image)?;
    }
    Ok(recorder.status())
}

/// Refuses images of float values of a picture that is enlarged: they are never mixed from several pixels.
fn check_resolution(arguments: &RenderArguments, settings: &Settings) -> anyhow::Result<()> {
    match arguments.aov.first() {
        Some((name, _)) if settings.view.resolution < 1.0 => Err(usage(format!(
            "--aov: `{name}` has the size of the picture, view.resolution is {}; leave it at 1",
            settings.view.resolution
        ))),
        _ => Ok(()),
    }
}

/// The parameters that `auto` leaves alone.
fn fixed(arguments: &RenderArguments, settings: &Settings) -> Vec<String> {
    let mut fixed = chosen::fixed(&arguments.set, settings);
    fixed.extend(arguments.bounces.map(|_| "reflection.bounces".to_owned()));
    fixed.extend(arguments.aov.first().map(|_| "view.resolution".to_owned()));
    fixed
}

/// Refuses a picture that is larger than the adapter can draw.
///
/// # Errors
/// If it is larger: bad usage.
pub fn check_size(gpu: &Gpu, [width, height]: [u32; 2]) -> anyhow::Result<()> {
    let largest = gpu.device.limits().max_texture_dimension_2d;
    if width.max(height) > largest {
        return Err(usage(format!("--size {width}x{height}: {} draws at most {largest} pixels a side", gpu.info.name)));
    }
    Ok(())
}

fn method(name: &str) -> anyhow::Result<Method> {
    if name == truth::RAY_TRACE {
        // The renderer draws the surfaces only, and the ray tracer adds the reflections afterwards.
        return Ok(Method::None);
    }
    if let Some(method) = Method::from_name(name) {
        return Ok(method);
    }
    let available = Method::NAMES.join(", ");
    Err(usage(format!("--method: `{name}` is unknown; available: {available}, {}", truth::RAY_TRACE)))
}

/// Refuses an image that these settings do not make, as bad usage. `is_traced` says that the ray tracer makes it.
pub fn check_is_made(aov: Aov, settings: &Settings, is_traced: bool) -> anyhow::Result<()> {
    let (method, name) = (settings.reflection.method, aov.name());
    let is_looked_for = (method != Method::None || is_traced) && settings.reflection.bounces > 0;
    match aov {
        Aov::MirrorPosition | Aov::MirrorAlbedo | Aov::MirrorNormal | Aov::Uncertain if !is_looked_for => Err(usage(
            format!("--aov: `{name}` is of what mirrors show; it needs a --method and at least one of --bounces"),
        )),
        Aov::Curvature | Aov::Regions if !is_looked_for || method != Method::Sscr => Err(usage(format!(
            "--aov: `{name}` is of screen-space curved reflections; it needs --method sscr and at least one of --bounces"
        ))),
        _ => Ok(()),
    }
}

/// The images of `--aov` with their files: those that the renderer makes, and those of the truth.
type Images = (Vec<(Aov, PathBuf)>, Vec<(Reference, PathBuf)>);

/// Parses the images of `--aov`. Checks that each output file of the run can be written and has a path of its own.
fn images(arguments: &RenderArguments) -> anyhow::Result<Images> {
    let mut files = vec![arguments.output.clone()];
    needs_extension(&arguments.output, "png")?;
    let (mut images, mut references) = (Vec::new(), Vec::new());
    for (name, path) in &arguments.aov {
        let aov = Aov::ALL.into_iter().find(|aov| aov.name() == name);
        let reference = Reference::ALL.into_iter().find(|reference| reference.name() == name);
        if aov.is_none() && reference.is_none() {
            let names = Aov::ALL.map(Aov::name).into_iter().chain(Reference::ALL.map(Reference::name));
            let available = names.collect::<Vec<_>>().join(", ");
            return Err(usage(format!("--aov: `{name}` is unknown; available: {available}")));
        }
        needs_extension(path, "exr")?;
        files.push(path.clone());
        images.extend(aov.map(|aov| (aov, path.clone())));
        references.extend(reference.map(|reference| (reference, path.clone())));
    }
    if let Some(path) = &arguments.stats {
        if !picture_file::is_special(path) {
            needs_extension(path, "json")?;
        }
        files.push(path.clone());
    }
    let mut places: Vec<PathBuf> = Vec::new();
    for file in &files {
        picture_file::check_place(file)?;
        let place = picture_file::place(file);
        if places.contains(&place) {
            return Err(usage(format!("{}: named for two outputs", scene::shown(file))));
        }
        places.push(place);
    }
    Ok((images, references))
}

/// Refuses outputs that would replace a file that the run reads.
fn spare_inputs(arguments: &RenderArguments, request: &Request) -> anyhow::Result<()> {
    let clouds = request.inputs.iter().flat_map(|input| input.files().iter().cloned());
    let words = arguments.inputs.iter().chain(&arguments.camera).map(PathBuf::from);
    // Compare with the name that was given and, if that is a link, with the file behind it.
    let read: Vec<PathBuf> = clouds
        .chain(words)
        .filter(|path| path.is_file())
        .flat_map(|path| [Some(picture_file::place(&path)), path.canonicalize().ok()])
        .flatten()
        .collect();
    let images = arguments.aov.iter().map(|(_, path)| path.as_path());
    for output in images.chain([arguments.output.as_path()]).chain(arguments.stats.as_deref()) {
        if read.contains(&picture_file::place(output)) {
            return Err(usage(format!("{}: named for an input and an output", scene::shown(output))));
        }
    }
    Ok(())
}

fn needs_extension(path: &Path, extension: &str) -> anyhow::Result<()> {
    if path.extension().is_some_and(|actual| actual.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    Err(usage(format!("{}: the name must end in .{extension}, which is what will be in it", scene::shown(path))))
}

/// How the camera of the picture is found.
pub enum Viewpoint {
    Camera(Camera),
    /// The camera stands where `view.start` says.
    Start,
    /// The camera looks from this side and has everything in the picture.
    Framing(StandardView),
}

impl Viewpoint {
    /// `word` is the value of `--camera`. Parameters from a camera file go into `settings`, its mirrors and lights into
    /// `request`.
    ///
    /// # Errors
    /// The word names no view, or a file that cannot be read.
    pub fn new(word: Option<&OsStr>, request: &mut Request, settings: &mut Settings) -> anyhow::Result<Self> {
        let own = request.view.as_ref().and_then(|view| view.camera);
        let Some(word) = word else {
            return Ok(own.map_or(Self::Start, Self::Camera));
        };
        if word == "scene" {
            let none =
                || usage("--camera scene: the inputs bring no camera; only scene files and built-in scenes have one");
            return own.map(Self::Camera).ok_or_else(none);
        }
        if let Some(index) = StandardView::NAMES.iter().position(|name| word == *name) {
            let view = StandardView::from_index(index as u32).unwrap_or(StandardView::Isometric);
            return Ok(Self::Framing(view));
        }
        let path = Path::new(word);
        let (file, word) = if word == "-" {
            let name = "standard input";
            let file = SceneFile::parse(&whole_file::read_from(std::io::stdin(), name)?);
            (file.with_context(|| format!("--camera -: {name}"))?, "-".to_owned())
        } else if path.exists() {
            (SceneFile::read(path)?.0, scene::shown(path))
        } else {
            let (word, names) = (scene::shown(path), StandardView::NAMES.join(", "));
            return Err(usage(format!(
                "--camera {word}: no such file, and none of {names}, scene, - (standard input)"
            )));
        };
        let view = file.view();
        request.refurnish(&file);
        terminal::warn(view.warnings.iter().map(|warning| format!("{word}: {warning}")));
        for (key, value) in view.settings.differing() {
            settings.set_text(&key, &value)?;
        }
        view.camera.map(Self::Camera).ok_or_else(|| usage(format!("--camera {word}: there is no [camera] in it")))
    }

    /// `room` is a camera in the room, if the scene is one.
    pub fn camera(
        &self,
        outline: &[DVec3],
        up: DVec3,
        room: Option<Camera>,
        settings: &Settings,
        size: [u32; 2],
    ) -> Camera {
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let framing = |view| Camera::framing(outline, view, up, settings.view.field_of_view, aspect);
        match self {
            Self::Camera(camera) => *camera,
            Self::Start => {
                room.filter(|_| settings.view.start == Start::Auto).unwrap_or_else(|| framing(StandardView::Isometric))
            }
            Self::Framing(view) => framing(*view),
        }
    }
}

/// Estimates the error of the frame that was drawn last for a picture of this size.
fn estimate(
    subject: &Subject,
    settings: &Settings,
    size: [u32; 2],
    renderer: &mut Renderer,
) -> render::Result<Option<Estimate>> {
    let view = View { camera: &subject.camera, settings, objects: subject.objects(), size };
    study::estimate(renderer, &subject.store, view, study::RAYS, settings.scene.seed.into())
}

/// Counts the pixels that show a mirror, whether or not their reflections were looked for.
fn mirror_pixels(renderer: &Renderer) -> render::Result<usize> {
    Ok(renderer.read_aov(Aov::Mirror)?.data.iter().filter(|value| **value > 0.0).count())
}

/// The content of `--stats`; names and order are fixed. Figures of reflections are about the first bounce, and null if
/// no reflections were looked for.
#[derive(Serialize)]
struct Stats {
    adapter: AdapterStats,
    clock: &'static str,
    size: [u32; 2],
    method: &'static str,
    /// What `--set` must say for this picture: the parameters that differ from the defaults, and those that were given.
    set: BTreeMap<String, serde_json::Value>,
    points: PointStats,
    /// The times are medians over the frames.
    passes: Vec<PassStats>,
    frame_ms: f64,
    frames: usize,
    /// The stops that were fitted to the picture, with those of `tone.exposure`.
    #[serde(skip_serializing_if = "Option::is_none")]
    exposure: Option<f32>,
    mirror_pixels: usize,
    coverage: Option<f64>,
    closed_coverage: Option<f64>,
    hit_rate: Option<f64>,
    regions: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unresolved: Option<f64>,
    /// The maps around mirrors, of `cubemap_trace` and `light_field`.
    #[serde(skip_serializing_if = "Option::is_none")]
    maps: Option<MapStats>,
    /// The cells of space of `sample_cameras`.
    #[serde(skip_serializing_if = "Option::is_none")]
    cameras: Option<CameraStats>,
    uncertain: Option<f64>,
    /// The method that found what is seen through glass and water, where there is some.
    #[serde(skip_serializing_if = "Option::is_none")]
    seen_through_by: Option<&'static str>,
    bounces: u32,
    memory: MemoryStats,
    /// Null if all clouds are held in memory.
    stream: Option<subject::StreamReport>,
    accuracy: Option<study::Accuracy>,
    /// Null if it was not asked for, or there is nothing to estimate.
    estimate: Option<Estimate>,
    /// What `--budget` or `--error` let `auto` choose.
    #[serde(skip_serializing_if = "Option::is_none")]
    auto: Option<AutoStats>,
}

#[derive(Serialize)]
struct AdapterStats {
    name: String,
    backend: String,
    kind: &'static str,
}

#[derive(Serialize)]
struct PointStats {
    scene: u64,
    drawn: u64,
}

#[derive(Serialize)]
struct PassStats {
    name: &'static str,
    stage: &'static str,
    ms: f64,
}

#[derive(Serialize)]
struct MapStats {
    drawn: u32,
    /// Fewer are drawn where they do not fit into one binding of the adapter, or into `light_field.memory`.
    asked: u32,
    #[serde(flatten)]
    map_use: Option<MapUseStats>,
}

/// Of `light_field`.
#[derive(Serialize)]
struct MapUseStats {
    /// The maps that were drawn for the last frame, and those that stood before.
    new: u32,
    kept: u32,
    /// The share of what mirror pixels ask for of which no map stood.
    missed: f64,
    bytes: u64,
    /// What limits the maps; null if nothing does.
    limit: Option<&'static str>,
    /// The share of mirror pixels that are predicted to be off by more than `light_field.accuracy`; null if that is 0.
    off: Option<f64>,
    /// The texels that were traced for the last frame; null where maps are made as a whole.
    texels: Option<u32>,
}

#[derive(Serialize)]
struct CameraStats {
    pinholes: u32,
    lists: u32,
    /// How many copies of each ray there are in all cells.
    ray_copies: f32,
    bytes: u64,
    /// The time that making them took.
    ms: f32,
    /// The share of the points found that a list projects.
    listed: f32,
}

impl CameraStats {
    fn new(cameras: &CameraCount) -> Self {
        let CameraCount { pinholes, lists, copies, bytes, milliseconds, listed, .. } = *cameras;
        Self { pinholes, lists, ray_copies: copies, bytes, ms: milliseconds, listed }
    }
}

#[derive(Serialize)]
struct MemoryStats {
    gpu_bytes: u64,
    host_peak_bytes: Option<u64>,
}

impl Stats {
    fn new(
        arguments: &RenderArguments,
        gpu: &Gpu,
        settings: &Settings,
        frames: &[FrameStats],
        mirror_pixels: usize,
    ) -> Self {
        let mut said: Vec<&str> = arguments.set.iter().map(|(key, _)| key.as_str()).collect();
        said.extend(arguments.seed.map(|_| "scene.seed"));
        let last = frames.last();
        let reflection = last.and_then(|frame| frame.reflection);
        let median = |values: Vec<f64>| Spread::of(values).map_or(0.0, |spread| spread.median);
        let pass_median = |name: &str| {
            let of_name = |frame: &FrameStats| {
                frame.passes.iter().filter(|pass| pass.name == name).map(|pass| pass.milliseconds).sum::<f64>()
            };
            median(frames.iter().map(of_name).collect())
        };
        let mut passes: Vec<PassStats> = Vec::new();
        for pass in last.iter().flat_map(|frame| &frame.passes) {
            if passes.iter().all(|listed| listed.name != pass.name) {
                passes.push(PassStats { name: pass.name, stage: pass.stage.name(), ms: pass_median(pass.name) });
            }
        }
        Self {
            adapter: AdapterStats {
                name: gpu.info.name.clone(),
                backend: gpu.info.backend.to_string(),
                kind: render::kind_name(gpu.info.device_type),
            },
            clock: gpu.clock.name(),
            size: arguments.size,
            method: settings.reflection.method.name(),
            set: set_values(settings, &said),
            points: PointStats {
                scene: last.map_or(0, |frame| frame.points_resident),
                drawn: last.map_or(0, |frame| frame.points_drawn),
            },
            passes,
            frame_ms: median(frames.iter().map(|frame| frame.frame_milliseconds).collect()),
            frames: frames.len(),
            exposure: frames.last().and_then(|frame| frame.exposure).map(|exposure| exposure.stops),
            mirror_pixels,
            coverage: reflection.map(|stats| stats.coverage),
            closed_coverage: reflection.map(|stats| stats.closed_coverage),
            hit_rate: reflection.and_then(|stats| stats.hit_rate),
            regions: reflection.and_then(|stats| stats.regions),
            unresolved: reflection.and_then(|stats| stats.unresolved),
            maps: reflection.and_then(|stats| {
                let MapCount { drawn, asked } = stats.maps?;
                let map_use = stats.map_use.map(|MapUse { new, kept, missed, bytes, limit, off, texels }| {
                    let limit = limit.map(MapLimit::name);
                    MapUseStats { new, kept, missed, bytes, limit, off, texels }
                });
                Some(MapStats { drawn, asked, map_use })
            }),
            cameras: reflection.and_then(|stats| stats.cameras).map(|cameras| CameraStats::new(&cameras)),
            uncertain: reflection.map(|stats| stats.uncertain),
            seen_through_by: reflection.and_then(|stats| stats.seen_through_by).map(|method| method.row().name),
            bounces: reflection.map_or(0, |stats| stats.bounces),
            memory: MemoryStats {
                gpu_bytes: last.map_or(0, |frame| frame.gpu_bytes),
                host_peak_bytes: host_peak_bytes(),
            },
            stream: None,
            accuracy: None,
            estimate: None,
            auto: None,
        }
    }

    /// Adds what the ray tracer found. If it is the method, its figures replace those of the renderer.
    fn with(mut self, traced: truth::Outcome) -> Self {
        self.accuracy = traced.accuracy;
        if let Some(method) = traced.method {
            self.method = truth::RAY_TRACE;
            self.set.remove("reflection.method");
            let (name, stage) = (truth::RAY_TRACE, PassStage::Method.name());
            self.passes.push(PassStats { name, stage, ms: method.milliseconds });
            self.frame_ms += method.milliseconds;
            (self.coverage, self.closed_coverage) = (method.coverage, method.coverage);
            self.bounces = method.bounces;
        }
        self
    }
}

pub fn set_values(settings: &Settings, said: &[&str]) -> BTreeMap<String, serde_json::Value> {
    let mut set = BTreeMap::new();
    for params in settings.groups() {
        let group = params.group();
        for (field, value) in group.fields.iter().zip(params.values()) {
            let key = format!("{}.{}", group.name, field.name);
            if value != field.default() || said.contains(&key.as_str()) {
                set.insert(key, listing::value_json(field, &value));
            }
        }
    }
    set
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::shared::command_line::{Command, CommandLine};
    use crate::system::failure::exit_status;

    /// Runs `glint render` with bad words and returns its message. It must refuse them before it looks for an adapter.
    fn refusal(words: &[&str]) -> String {
        let all = ["glint", "render"].iter().chain(words);
        let Some(Command::Render(arguments)) = CommandLine::try_parse_from(all).unwrap().command else {
            panic!("not a render command")
        };
        let error = run(&arguments).unwrap_err();
        assert_eq!(exit_status(&error), 2, "{error:#}");
        format!("{error:#}")
    }

    #[test]
    fn bad_words_are_refused_by_name_before_any_work() {
        let scene = "five-mirrors/sphere";
        assert!(refusal(&[scene, "-o", "a.png", "--method", "ssrc"]).contains("is unknown; available: auto, none"));
        assert!(refusal(&[scene, "-o", "a.png", "--bounces", "9"]).contains("0 to 8"));
        let blind = ["--aov", "mirror_position=b.exr"];
        assert!(refusal(&[&[scene, "-o", "a.png", "--bounces", "0"][..], &blind].concat()).contains("--bounces"));
        assert!(refusal(&[&[scene, "-o", "a.png", "--method", "none"][..], &blind].concat()).contains("--method"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "regions=b.exr"]).contains("--method sscr"));
        assert!(refusal(&[scene, "-o", "a.jpg"]).contains(".png"));
        let exact = ["--truth", "exact", "--stats", "b.json"];
        let two = refusal(&[&[scene, "five-mirrors/torus", "-o", "a.png"], &exact[..]].concat());
        assert!(two.contains("--truth exact") && two.contains("five-mirrors/sphere, five-mirrors/torus"), "{two}");
        let traced = ["--method", "ray_trace", "--aov", "regions=b.exr"];
        assert!(refusal(&[&[scene, "-o", "a.png"], &traced[..]].concat()).contains("--method sscr"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "dept=b.exr"]).contains("available: depth, normal"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "depth=b.png"]).contains(".exr"));
        assert!(
            refusal(&[scene, "-o", "a.png", "--aov", "depth=b.exr", "--aov", "normal=b.exr"]).contains("two outputs")
        );
        assert!(refusal(&[scene, "-o", "a.png", "--set", "splat.sise=1"]).contains("did you mean `splat.size`?"));
        assert!(refusal(&[scene, "-o", "a.png", "--set", "splat.size=99"]).contains("0.05 to 20"));
        assert!(refusal(&[scene, "-o", "a.png", "--camera", "frnt"]).contains("front, back"));
        let exact = [scene, "-o", "a.png", "--stats", "a.json", "--estimate", "--method", "ray_trace"];
        assert!(refusal(&exact).contains("--estimate: `ray_trace` is exact"));
        assert!(refusal(&["no_such.laz", "-o", "a.png"]).contains("no_such.laz: no such file"));
        assert!(refusal(&["five-mirrors/sphre", "-o", "a.png"]).contains("did you mean `five-mirrors/sphere`?"));
    }

    #[test]
    fn outputs_replace_neither_inputs_nor_one_another() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let (cloud, roundabout) = (path("cloud.json"), path("./cloud.json"));
        std::fs::write(&cloud, "").unwrap();
        let picture = path("a.png");
        assert!(refusal(&[&cloud, "-o", &picture, "--stats", &roundabout]).contains("an input and an output"));
        let scene = "five-mirrors/sphere";
        assert!(refusal(&[scene, "-o", &picture, "--stats", &path("cloud.laz")]).contains(".json"));
        let images = [format!("depth={}", path("a.exr")), format!("normal={}", path("./a.exr"))];
        assert!(refusal(&[scene, "-o", &picture, "--aov", &images[0], "--aov", &images[1]]).contains("two outputs"));
    }

    #[test]
    fn parameters_of_a_camera_file_yield_to_set() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("view.toml");
        let mut settings = Settings::default();
        settings.splat.size = 3.0;
        settings.edl.strength = 2.0;
        let camera = Camera::looking(DVec3::ONE, DVec3::X, 5.0, DVec3::Z);
        std::fs::write(&path, SceneFile::new(Vec::new(), camera, &settings).to_text()).unwrap();
        let mut settings = Settings::default();
        let viewpoint = Viewpoint::new(Some(path.as_os_str()), &mut Request::default(), &mut settings).unwrap();
        settings.set_text("splat.size", "4").unwrap();
        assert_eq!((settings.splat.size, settings.edl.strength), (4.0, 2.0));
        let seen = viewpoint.camera(&[], DVec3::Z, None, &settings, [8, 8]);
        assert!(seen.eye.distance(camera.eye) < 1e-12);
    }

    #[test]
    fn stats_name_what_was_set_even_to_its_default() {
        let mut settings = Settings::default();
        settings.set_text("splat.size", "2").unwrap();
        let set = set_values(&settings, &["edl.radius"]);
        assert_eq!(set.keys().collect::<Vec<_>>(), ["edl.radius", "splat.size"]);
        assert_eq!(set["splat.size"], serde_json::json!(2.0));
    }
}
