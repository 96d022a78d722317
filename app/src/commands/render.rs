//! `glint render`: writes the picture that the viewer would show, without a window. It loads, colours and draws as the
//! viewer does.
//!
//! Everything that a user may have mistyped is checked before the first point is read.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use param::Choice as _;
use render::{Aov, Frame, FrameStats, Gpu, Renderer};
use scene::{Method, Settings};
use study::{Estimate, Subject};
use world::Request;

use crate::commands::chosen;
use crate::commands::recording::{self, PathChoice, Recorder};
use crate::commands::stats::Stats;
use crate::commands::subject::{self, LoadedSubject};
use crate::commands::surface_error;
use crate::commands::truth::{self, Asked, Reference};
use crate::overlays;
use crate::shared::command_line::RenderArguments;
use crate::shared::viewpoint::Viewpoint;
use crate::system::failure::usage;
use crate::system::progress_bar::Bar;
use crate::system::{interrupt, picture_file, terminal};

/// Renders the picture. Returns exit status 2 if one of several inputs could not be read and the picture shows the
/// others.
///
/// # Errors
/// Fails on bad usage, without an adapter, if no input can be read, if a file cannot be written, or on Ctrl-C.
pub fn run(arguments: &RenderArguments) -> anyhow::Result<u8> {
    let Images { images, references, error } = images(arguments)?;
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
        if error.is_some() {
            return Err(usage(format!("--aov: `{}` is of a view; leave --time out", surface_error::NAME)));
        }
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

    let camera = |outline: &[glam::DVec3], up, room| viewpoint.camera(outline, up, room, &settings, arguments.size);
    let LoadedSubject { mut subject, status, stream, sources, facts, errors, .. } =
        match subject::open(&gpu, request, &settings, arguments.size, error.is_some(), camera)? {
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
        terminal::warn(["the picture is empty: no point that is shown lies before the camera"]);
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
    let camera = &subject.camera;
    picture_file::warn_of_origin(arguments.aov.iter().map(|(name, _)| name.as_str()), picture_file::origin(camera));
    for (aov, path) in &images {
        let origin = picture_file::origin_of(aov.name(), camera);
        match traced.image(*aov) {
            Some(image) => picture_file::write_exr(path, image, origin)?,
            None => {
                let image = renderer.read_aov_from(*aov, picture_file::origin(camera))?;
                terminal::warn(picture_file::cut_warning(*aov, &image));
                picture_file::write_exr(path, &image, origin)?;
            }
        }
    }
    if let Some((path, errors)) = error.as_ref().zip(errors) {
        picture_file::write_exr(path, &errors.image(&renderer, &subject, &settings)?, None)?;
    }
    for (reference, path, image) in &traced.references {
        picture_file::write_exr(path, image, picture_file::origin_of(reference.name(), camera))?;
    }
    if let Some(path) = &arguments.stats {
        let mut stats = Stats::new(arguments, &gpu, &settings, &frames, mirror_pixels(&renderer)?).with(traced);
        (stats.stream, stats.estimate, stats.auto) = (stream, estimate, auto);
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
        terminal::warn(["the picture is empty: no point that is shown lies before the camera"]);
    }
    picture_file::write_png(&arguments.output, arguments.size, &picture.rgba, Some(&adapter))?;
    picture_file::warn_of_origin(aovs.iter().map(|aov| aov.name()), picture_file::origin(&picture.camera));
    for ((aov, path), image) in images.iter().zip(&picture.images) {
        terminal::warn(picture_file::cut_warning(*aov, image));
        picture_file::write_exr(path, image, picture_file::origin_of(aov.name(), &picture.camera))?;
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

/// The images of `--aov` with their files.
struct Images {
    /// The images that the renderer makes.
    images: Vec<(Aov, PathBuf)>,
    /// The images of the truth.
    references: Vec<(Reference, PathBuf)>,
    /// The image of how sure the surface is.
    error: Option<PathBuf>,
}

/// Parses the images of `--aov`. Checks that each output file of the run can be written and has a path of its own.
fn images(arguments: &RenderArguments) -> anyhow::Result<Images> {
    let mut files = vec![arguments.output.clone()];
    needs_extension(&arguments.output, "png")?;
    let (mut images, mut references, mut error) = (Vec::new(), Vec::new(), None);
    for (name, path) in &arguments.aov {
        let aov = Aov::ALL.into_iter().find(|aov| aov.name() == name);
        let reference = Reference::ALL.into_iter().find(|reference| reference.name() == name);
        let is_error = name == surface_error::NAME;
        if aov.is_none() && reference.is_none() && !is_error {
            let names = Aov::ALL.map(Aov::name).into_iter().chain([surface_error::NAME]);
            let names = names.chain(Reference::ALL.map(Reference::name));
            let available = names.collect::<Vec<_>>().join(", ");
            return Err(usage(format!("--aov: `{name}` is unknown; available: {available}")));
        }
        needs_extension(path, "exr")?;
        files.push(path.clone());
        images.extend(aov.map(|aov| (aov, path.clone())));
        references.extend(reference.map(|reference| (reference, path.clone())));
        error = error.or(is_error.then(|| path.clone()));
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
    Ok(Images { images, references, error })
}

/// Refuses outputs that would replace a file that the run reads.
fn spare_inputs(arguments: &RenderArguments, request: &Request) -> anyhow::Result<()> {
    let clouds = request.inputs.iter().flat_map(|input| input.files().iter().cloned());
    let words = arguments.inputs.iter().chain(&arguments.camera).map(PathBuf::from);
    let read: Vec<PathBuf> =
        clouds.chain(words).filter(|path| path.is_file()).map(|path| picture_file::place(&path)).collect();
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

/// Estimates the error of the frame that was drawn last for a picture of this size.
fn estimate(
    subject: &Subject,
    settings: &Settings,
    size: [u32; 2],
    renderer: &mut Renderer,
) -> render::Result<Option<Estimate>> {
    let frame = Frame::new(&subject.camera, settings, subject.objects(), size);
    study::estimate(renderer, &subject.store, frame, study::RAYS, settings.scene.seed.into())
}

/// Counts the pixels that show a mirror, whether or not their reflections were looked for.
fn mirror_pixels(renderer: &Renderer) -> render::Result<usize> {
    Ok(renderer.read_aov(Aov::Mirror)?.data.iter().filter(|value| **value > 0.0).count())
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
}
