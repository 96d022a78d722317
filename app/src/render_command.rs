//! `glint render`: the picture that the viewer would show, without a window, by the same loading, colours and passes.
//!
//! All that a person can have mistyped is checked before the first point is read. Chunks are put in the order of the file,
//! so that the picture does not depend on which thread was faster.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use cloud::{Cloud, Progress};
use glam::DVec3;
use param::Choice as _;
use render::{Aov, ColorPlan, FrameStats, Gpu, Objects, PointStore, Renderer};
use scene::{Camera, SceneFile, Settings, StandardView};
use serde::Serialize;

use crate::command_line::RenderArguments;
use crate::failure::usage;
use crate::loading::{self, Event, Request};
use crate::{listing, picture_file, progress_bar};

/// Renders; the exit status is 2 if one of several inputs could not be read and the picture shows the others.
///
/// # Errors
/// Bad usage, nothing that can be read, no adapter, a file that cannot be written.
pub fn run(arguments: &RenderArguments) -> anyhow::Result<u8> {
    check_method(&arguments.method)?;
    if arguments.bounces > 0 {
        return Err(usage("--bounces: this version does not follow reflections yet; leave it out, or give 0"));
    }
    let images = images(arguments)?;
    let request = loading::resolve(&arguments.inputs);
    request.check()?;
    spare_inputs(arguments, &request)?;
    let mut settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
    let viewpoint = Viewpoint::new(arguments.camera.as_deref(), &request, &mut settings)?;
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    if let Some(seed) = arguments.seed {
        settings.scene.seed = seed;
    }
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    let largest = gpu.device.limits().max_texture_dimension_2d;
    if arguments.size.iter().any(|side| *side > largest) {
        let [width, height] = arguments.size;
        return Err(usage(format!("--size {width}x{height}: {} draws at most {largest} pixels a side", gpu.info.name)));
    }
    request.warnings.iter().for_each(|warning| crate::complain(&format!("warning: {warning}")));

    let (mut clouds, failures) = load(request, &settings)?;
    if clouds.is_empty() && failures > 0 {
        // All that is to be said has been said.
        return Ok(2);
    }
    let outline: Vec<DVec3> = clouds.iter().flat_map(|loaded| cloud::robust_outline(&loaded.cloud.chunks)).collect();
    let Some(up) = clouds.iter().find(|loaded| !loaded.cloud.is_empty()).map(|loaded| loaded.up) else {
        return Err(usage(format!("{}: no points to show", arguments.inputs.join(", "))));
    };
    let camera = viewpoint.camera(&outline, up, &settings, arguments.size);
    let mut store = PointStore::new(gpu.clone());
    store.reserve(clouds.iter().map(|loaded| loaded.cloud.len()).sum());
    for loaded in &mut clouds {
        upload(&mut store, loaded, &settings)?;
    }

    let mut renderer = Renderer::new(gpu.clone())?;
    let mut draw = || {
        // Every frame is made from scratch, so that its time is that of all its passes.
        renderer.forget();
        renderer.render(&store, &camera, &settings, Objects::default(), arguments.size)
    };
    let mut frames = vec![draw()?];
    if arguments.stats.is_some() || arguments.frames.is_some() {
        // The frame before was the one to warm up.
        frames = (0..arguments.frames.unwrap_or(1)).map(|_| draw()).collect::<render::Result<_>>()?;
    }
    if renderer.read_aov(Aov::Depth)?.data.iter().all(|depth| depth.is_nan()) {
        crate::complain("warning: the picture is empty, the camera looks past all points");
    }
    picture_file::write_png(&arguments.output, arguments.size, &renderer.read_picture()?)?;
    for (aov, path) in &images {
        picture_file::write_exr(path, &renderer.read_aov(*aov)?)?;
    }
    if let Some(path) = &arguments.stats {
        let mirror = renderer.read_aov(Aov::Mirror)?;
        let stats =
            Stats::new(arguments, &gpu, &settings, &frames, mirror.data.iter().filter(|value| **value > 0.0).count());
        picture_file::write_text(path, &(serde_json::to_string_pretty(&stats)? + "\n"))?;
    }
    Ok(if failures > 0 { 2 } else { 0 })
}

fn check_method(name: &str) -> anyhow::Result<()> {
    let available: Vec<&str> = listing::METHODS.iter().map(|method| method.name).collect();
    if available.contains(&name) {
        return Ok(());
    }
    let problem = if listing::LATER_METHODS.contains(&name) { "is not in this version yet" } else { "is unknown" };
    Err(usage(format!("--method: `{name}` {problem}; available: {}", available.join(", "))))
}

/// AOVs of INTERFACE that belong to parts of the program this version does not have.
const LATER_AOVS: [&str; 9] = [
    "mirror_position",
    "mirror_albedo",
    "mirror_normal",
    "regions",
    "curvature",
    "direct",
    "indirect",
    "reference_position",
    "reference_color",
];

/// The images of `--aov`, once it is sure that every file of the run has a place of its own.
fn images(arguments: &RenderArguments) -> anyhow::Result<Vec<(Aov, PathBuf)>> {
    let mut files = vec![arguments.output.clone()];
    needs_extension(&arguments.output, "png")?;
    let mut images = Vec::new();
    for (name, path) in &arguments.aov {
        let Some(aov) = Aov::ALL.into_iter().find(|aov| aov.name() == name) else {
            let problem = if LATER_AOVS.contains(&name.as_str()) { "is not in this version yet" } else { "is unknown" };
            let available = Aov::ALL.map(Aov::name).join(", ");
            return Err(usage(format!("--aov: `{name}` {problem}; available: {available}")));
        };
        let path = PathBuf::from(path);
        needs_extension(&path, "exr")?;
        files.push(path.clone());
        images.push((aov, path));
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
            return Err(usage(format!("{}: named for two outputs", file.display())));
        }
        places.push(place);
    }
    Ok(images)
}

/// Refuses outputs that would replace something the run reads.
fn spare_inputs(arguments: &RenderArguments, request: &Request) -> anyhow::Result<()> {
    let clouds = request.inputs.iter().map(|input| PathBuf::from(input.name()));
    let words = arguments.inputs.iter().chain(&arguments.camera).map(PathBuf::from);
    // Both the name that was given and, of a link, the file behind it.
    let read: Vec<PathBuf> = clouds
        .chain(words)
        .filter(|path| path.is_file())
        .flat_map(|path| [Some(picture_file::place(&path)), path.canonicalize().ok()])
        .flatten()
        .collect();
    let images = arguments.aov.iter().map(|(_, path)| Path::new(path));
    for output in images.chain([arguments.output.as_path()]).chain(arguments.stats.as_deref()) {
        if read.contains(&picture_file::place(output)) {
            return Err(usage(format!("{}: named for an input and an output", output.display())));
        }
    }
    Ok(())
}

fn needs_extension(path: &Path, extension: &str) -> anyhow::Result<()> {
    if path.extension().is_some_and(|actual| actual.eq_ignore_ascii_case(extension)) {
        return Ok(());
    }
    Err(usage(format!("{}: the name must end in .{extension}, which is what will be in it", path.display())))
}

/// Where the picture is taken from.
enum Viewpoint {
    Camera(Camera),
    /// From this side, everything in the picture.
    Framing(StandardView),
}

impl Viewpoint {
    /// `word` is the value of `--camera`; parameters that come with a camera file are applied to `settings`.
    fn new(word: Option<&str>, request: &Request, settings: &mut Settings) -> anyhow::Result<Self> {
        let own = request.view.as_ref().and_then(|view| view.camera);
        let Some(word) = word else {
            return Ok(own.map_or(Self::Framing(StandardView::Isometric), Self::Camera));
        };
        if word == "scene" {
            let none =
                || usage("--camera scene: the inputs bring no camera; only scene files and built-in scenes have one");
            return own.map(Self::Camera).ok_or_else(none);
        }
        if let Some(index) = StandardView::NAMES.iter().position(|name| *name == word) {
            let view = StandardView::from_index(index as u32).unwrap_or(StandardView::Isometric);
            return Ok(Self::Framing(view));
        }
        let path = Path::new(word);
        if !path.exists() {
            let names = StandardView::NAMES.join(", ");
            return Err(usage(format!("--camera {word}: no such file, and none of {names}, scene")));
        }
        let view = SceneFile::read(path)?.view();
        view.warnings.iter().for_each(|warning| crate::complain(&format!("warning: {word}: {warning}")));
        for (key, value) in view.settings.differing() {
            settings.set_text(&key, &value)?;
        }
        view.camera.map(Self::Camera).ok_or_else(|| usage(format!("--camera {word}: there is no [camera] in it")))
    }

    fn camera(&self, outline: &[DVec3], up: DVec3, settings: &Settings, size: [u32; 2]) -> Camera {
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        match self {
            Self::Camera(camera) => *camera,
            Self::Framing(view) => Camera::framing(outline, *view, up, settings.view.field_of_view, aspect),
        }
    }
}

/// A cloud that is in memory.
struct Loaded {
    cloud: Cloud,
    source: Option<Arc<codec::Source>>,
    material: render::Material,
    up: DVec3,
    provisional_radius: f32,
}

/// How long the receiver waits before it looks at the progress again.
const INTERVAL: Duration = Duration::from_millis(100);

/// All inputs in memory, chunks in the order of the file, with normals and radii; and how many inputs failed, which are
/// reported as they fail.
fn load(request: Request, settings: &Settings) -> anyhow::Result<(Vec<Loaded>, usize)> {
    let job = loading::start(request.inputs, settings);
    let mut clouds: Vec<Loaded> = Vec::new();
    let mut failures = 0;
    let bar = progress_bar::points("reading");
    let warn = |name: &str, warnings: &[String]| {
        for warning in warnings {
            bar.suspend(|| crate::complain(&format!("warning: {name}: {warning}")));
        }
    };
    let mut surfels_begun = false;
    loop {
        if !surfels_begun && job.surfel_progress.total() > 0 {
            surfels_begun = true;
            bar.reset();
            bar.set_message("normals");
        }
        progress_bar::update(&bar, if surfels_begun { &job.surfel_progress } else { &job.progress });
        match job.events.recv_timeout(INTERVAL) {
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(anyhow!("loading ended before it was done")),
            Ok(Event::Opened {
                name, source, attributes, grid, material, up, provisional_radius, warnings, ..
            }) => {
                warn(&name, &warnings);
                let cloud = Cloud { name, attributes, grid, chunks: Vec::new() };
                clouds.push(Loaded { cloud, source, material, up, provisional_radius });
            }
            Ok(Event::Chunk { cloud, chunk }) => clouds[cloud].cloud.chunks.push(chunk),
            Ok(Event::Read { cloud, summary }) => {
                let opened = clouds[cloud].source.as_ref().map(|source| source.info().warnings.clone());
                let opened = opened.unwrap_or_default();
                let new: Vec<String> =
                    summary.warnings.into_iter().filter(|warning| !opened.contains(warning)).collect();
                let cloud = &mut clouds[cloud].cloud;
                cloud.chunks.sort_by_key(|chunk| chunk.first_point);
                warn(&cloud.name, &new);
            }
            Ok(Event::Surfels { cloud, surfels }) => {
                for (chunk, surfels) in clouds[cloud].cloud.chunks.iter_mut().zip(surfels) {
                    chunk.normals = Some(Arc::new(surfels.normals));
                    chunk.radii = Some(Arc::new(surfels.radii));
                }
            }
            Ok(Event::Failed { error, .. }) => {
                failures += 1;
                bar.suspend(|| crate::complain(&error));
            }
            Ok(Event::Finished) => break,
        }
    }
    bar.finish_and_clear();
    Ok((clouds, failures))
}

/// Puts a cloud on the GPU in the colours that the settings ask for.
fn upload(store: &mut PointStore, loaded: &mut Loaded, settings: &Settings) -> anyhow::Result<()> {
    let (plan, warning) = ColorPlan::new(&loaded.cloud, &settings.color, loaded.up);
    if let Some(warning) = warning {
        crate::complain(&format!("warning: {warning}"));
    }
    if let (Some(attribute), Some(source)) = (plan.missing_column(&loaded.cloud), &loaded.source) {
        let progress = Progress::default();
        let mut columns =
            progress_bar::watch("reading", &progress, || loading::read_column(source, attribute, &progress))?;
        for chunk in &mut loaded.cloud.chunks {
            chunk.columns[attribute] = columns.remove(&chunk.first_point);
        }
    }
    let id = store.add_cloud(loaded.material);
    store.set_provisional_radius(id, loaded.provisional_radius);
    let classification = loaded.cloud.attributes.iter().position(|attribute| attribute.name == "classification");
    let mut chunks = Vec::with_capacity(loaded.cloud.chunks.len());
    for chunk in &loaded.cloud.chunks {
        let classes = classification.and_then(|index| chunk.columns.get(index)?.as_deref());
        let classes = if let Some(cloud::Column::U8(classes)) = classes { Some(classes.as_slice()) } else { None };
        chunks.push(store.add_chunk(id, chunk, classes)?);
    }
    store.set_color(id, &loaded.cloud, &chunks, &plan, loaded.up)?;
    Ok(())
}

/// `--stats`: names and order are fixed, and figures of reflections are null until there are some.
#[derive(Serialize)]
struct Stats {
    adapter: AdapterStats,
    clock: &'static str,
    size: [u32; 2],
    method: String,
    /// What `--set` must say for this picture: what differs from the defaults, and what was said.
    set: BTreeMap<String, serde_json::Value>,
    points: PointStats,
    /// Medians over the frames.
    passes: Vec<PassStats>,
    frame_ms: f64,
    frames: usize,
    mirror_pixels: usize,
    coverage: Option<f64>,
    closed_coverage: Option<f64>,
    hit_rate: Option<f64>,
    regions: Option<u64>,
    bounces: u32,
    memory: MemoryStats,
    accuracy: Option<f64>,
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
    ms: f64,
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
        let pass_median = |name: &str| {
            let of_name = |frame: &FrameStats| {
                frame.passes.iter().filter(|pass| pass.name == name).map(|pass| pass.milliseconds).sum::<f64>()
            };
            median(frames.iter().map(of_name).collect())
        };
        let mut passes: Vec<PassStats> = Vec::new();
        for pass in last.iter().flat_map(|frame| &frame.passes) {
            if passes.iter().all(|listed| listed.name != pass.name) {
                passes.push(PassStats { name: pass.name, ms: pass_median(pass.name) });
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
            method: arguments.method.clone(),
            set: set_values(settings, &said),
            points: PointStats {
                scene: last.map_or(0, |frame| frame.points_resident),
                drawn: last.map_or(0, |frame| frame.points_drawn),
            },
            passes,
            frame_ms: median(frames.iter().map(|frame| frame.frame_milliseconds).collect()),
            frames: frames.len(),
            mirror_pixels,
            coverage: None,
            closed_coverage: None,
            hit_rate: None,
            regions: None,
            bounces: 0,
            memory: MemoryStats {
                gpu_bytes: last.map_or(0, |frame| frame.gpu_bytes),
                host_peak_bytes: host_peak_bytes(),
            },
            accuracy: None,
        }
    }
}

fn set_values(settings: &Settings, said: &[&str]) -> BTreeMap<String, serde_json::Value> {
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

/// The middle value, or the mean of the two middle ones; 0 for none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        count => (values[(count - 1) / 2] + values[count / 2]) * 0.5,
    }
}

/// The most memory this process has held, where the system tells (Linux).
fn host_peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kilobytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(kilobytes.trim().trim_end_matches("kB").trim().parse::<u64>().ok()? * 1024)
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::command_line::{Command, CommandLine};
    use crate::failure::exit_status;

    /// What `glint render` says to bad words, all of which must be found before an adapter is looked for.
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
        let later = refusal(&[scene, "-o", "a.png", "--method", "sscr"]);
        assert_eq!(later, "--method: `sscr` is not in this version yet; available: none");
        assert!(refusal(&[scene, "-o", "a.png", "--method", "ssrc"]).contains("is unknown; available: none"));
        assert!(refusal(&[scene, "-o", "a.png", "--bounces", "2"]).contains("--bounces"));
        assert!(refusal(&[scene, "-o", "a.jpg"]).contains(".png"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "mirror_position=b.exr"]).contains("not in this version yet"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "dept=b.exr"]).contains("available: depth, normal"));
        assert!(refusal(&[scene, "-o", "a.png", "--aov", "depth=b.png"]).contains(".exr"));
        assert!(
            refusal(&[scene, "-o", "a.png", "--aov", "depth=b.exr", "--aov", "normal=b.exr"]).contains("two outputs")
        );
        assert!(refusal(&[scene, "-o", "a.png", "--set", "splat.sise=1"]).contains("did you mean `splat.size`?"));
        assert!(refusal(&[scene, "-o", "a.png", "--set", "splat.size=99"]).contains("0.05 to 20"));
        assert!(refusal(&[scene, "-o", "a.png", "--camera", "frnt"]).contains("front, back"));
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
        let viewpoint = Viewpoint::new(path.to_str(), &Request::default(), &mut settings).unwrap();
        settings.set_text("splat.size", "4").unwrap();
        assert_eq!((settings.splat.size, settings.edl.strength), (4.0, 2.0));
        let seen = viewpoint.camera(&[], DVec3::Z, &settings, [8, 8]);
        assert!(seen.eye.distance(camera.eye) < 1e-12);
    }

    #[test]
    fn medians_are_the_middle() {
        assert_eq!(median(vec![3.0, 1.0, 50.0]), 3.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 50.0]), 3.0);
        assert_eq!(median(Vec::new()), 0.0);
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
