//! `glint record`: writes the pictures along a camera path. Several runs may share the work: each makes the pictures
//! that its folder lacks.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use record::{Adapter, Averaging, Description, Folder};
use render::{Aov, Gpu, Renderer};
use scene::{Camera, PathPlace, Settings};
use serde::Serialize;
use world::Request;

use crate::commands::chosen::{self, AutoStats};
use crate::commands::recording::{self, PathChoice, Recorder};
use crate::commands::render::{check_is_made, check_size};
use crate::commands::subject::{self, LoadedSubject};
use crate::shared::command_line::RecordArguments;
use crate::shared::viewpoint::Viewpoint;
use crate::system::failure::{FAILED, usage};
use crate::system::film::Output;
use crate::system::progress_bar::{self, Bar};
use crate::system::{interrupt, picture_file, terminal};
use crate::viewer::PictureStats;

/// The most frames of a recording: the names of the pictures number them with six digits.
const MOST_FRAMES: u32 = 1_000_000;

/// Records the path. Returns exit status 2 if one of several inputs could not be read and the pictures show the others.
///
/// # Errors
/// Fails on bad usage, without an adapter, if no input can be read, if a file cannot be written, or on Ctrl-C.
pub fn run(arguments: &RecordArguments) -> anyhow::Result<u8> {
    if arguments.report {
        progress_bar::report();
        interrupt::catch_end_of_input();
    }
    let mut request = world::resolve(std::slice::from_ref(&arguments.scene));
    request.check()?;
    let path = PathChoice::new(arguments.path.as_deref(), &request, Path::new(&arguments.scene))?;
    let all = frames(&path, arguments)?;
    let of_shard = |frame: &u32| arguments.shard.is_none_or(|shard| shard.has(*frame as usize));
    let frames = all.iter().copied().filter(of_shard).collect();
    set(&mut request, arguments)?;
    // The session warns of what some clouds lack, and of settings without a cloud.
    let settings = recording::settings(&mut request).clone();
    // Nothing is left out: pictures that are there already are known by all inputs.
    request.clone().leave_out_hidden(world::half_of(settings.stream.host_bytes))?;
    request.check_filters(&settings)?;
    let averaging = Averaging::new(arguments.subframes, arguments.shutter, arguments.supersample);
    let images = images(arguments, recording::settings(&mut request))?;
    path.check_images(images.len())?;
    let output = Output::new(&arguments.output, arguments.codec, arguments.size, arguments.fps)?;
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    check_size(&gpu, averaging.drawn_size(arguments.size))?;
    let place = output.folder.path.clone();
    let is_new = !place.exists();
    if is_new {
        std::fs::create_dir(&place).map_err(|reason| codec::Error::not_written(&place, reason))?;
    }
    let recording =
        Recording { path, all, frames, averaging, images, folder: &output.folder, output: &output, arguments };
    let recorded = recording.run(gpu, request);
    if is_new {
        // The call removes the folder only if there is nothing in it.
        let _ = std::fs::remove_dir(&place);
    }
    recorded
}

/// The frames that `--frames` names, or all.
fn frames(path: &PathChoice, arguments: &RecordArguments) -> anyhow::Result<Vec<u32>> {
    // The last picture is shown until the path ends. The subtraction keeps a rounding error from adding a frame.
    let all = (path.duration() * f64::from(arguments.fps) - 1e-6).ceil().max(1.0) as u32;
    let frames = arguments.frames.clone().unwrap_or(0..all);
    if frames.end > all {
        let Range { start, end } = frames;
        return Err(usage(format!(
            "--frames {start}..{end}: path `{}` has {all} frames at {} a second, from 0 on",
            path.name(),
            arguments.fps
        )));
    }
    if frames.end > MOST_FRAMES {
        return Err(usage(format!("path `{}` has {all} frames, expected at most {MOST_FRAMES}", path.name())));
    }
    Ok(frames.collect())
}

/// The float images of `--aov`.
fn images(arguments: &RecordArguments, settings: &Settings) -> anyhow::Result<Vec<Aov>> {
    let mut images: Vec<Aov> = Vec::new();
    for name in &arguments.aov {
        let Some(aov) = Aov::ALL.into_iter().find(|aov| aov.name() == name) else {
            let available = Aov::ALL.map(Aov::name).join(", ");
            return Err(usage(format!("--aov: `{name}` is unknown; available: {available}")));
        };
        check_is_made(aov, settings, false)?;
        if !images.contains(&aov) {
            images.push(aov);
        }
    }
    if !images.is_empty() && arguments.supersample > 1 {
        return Err(usage("--aov: float values of several pixels are never mixed; leave --supersample out".to_owned()));
    }
    Ok(images)
}

/// Sets the parameters that the command line names.
fn set(request: &mut Request, arguments: &RecordArguments) -> anyhow::Result<()> {
    let mirrors = request.all_mirrors();
    let settings = recording::settings(request);
    if let Some(preset) = arguments.preset {
        *settings = preset.applied(settings, mirrors.iter());
    }
    for (key, value) in &arguments.set {
        settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    Ok(())
}

/// What a picture was drawn by and from, as `frame-000000.json`.
#[derive(Serialize)]
struct FrameStats<'a> {
    adapter: &'a Adapter,
    #[serde(flatten)]
    picture: PictureStats,
}

struct Recording<'a> {
    path: PathChoice,
    /// The frames of all shards.
    all: Vec<u32>,
    /// The frames that this run is to see to.
    frames: Vec<u32>,
    averaging: Averaging,
    /// The float images that are written of each frame.
    images: Vec<Aov>,
    folder: &'a Folder,
    output: &'a Output,
    arguments: &'a RecordArguments,
}

impl Recording<'_> {
    /// Makes the pictures that are not there, and returns the exit status.
    fn run(&self, gpu: Arc<Gpu>, mut request: Request) -> anyhow::Result<u8> {
        let wanted = self.description(&gpu, &mut request);
        let made = self.folder.check(&wanted, self.arguments.mixed)?;
        let auto = match (&made, self.arguments.target.target()) {
            (Some(made), _) => made.auto.clone(),
            (None, Some(_)) => match self.choose(&gpu, &request)? {
                Ok(auto) => Some(serde_json::to_value(auto)?),
                Err(status) => return Ok(status),
            },
            (None, None) => None,
        };
        self.apply(auto.as_ref(), recording::settings(&mut request))?;
        let description = Description { auto, ..wanted };
        // A picture is of what it is drawn by, chosen or not.
        let set = recording::settings(&mut request).differing().into_iter().collect();
        let drawn = Description { set, ..description.clone() };
        let lacking = self.lacking(&self.frames, &drawn)?;
        let status = if lacking.is_empty() {
            0
        } else {
            self.make(&lacking, &drawn, made.is_none().then_some(&description), gpu, request)?
        };
        let (count, folder) = (self.frames.len(), scene::shown(&self.folder.path));
        let there = count - lacking.len();
        let were_there = if there > 0 { format!(", {there} of them were there") } else { String::new() };
        let is_made = status == 0 || lacking.iter().all(|frame| self.folder.picture(*frame).exists());
        if is_made {
            terminal::print([format!("{count} pictures in {folder}{were_there}")])?;
            self.tell_adapters();
        }
        if let (Some(film), true) = (self.output.film(), is_made) {
            let film = scene::shown(film);
            let missing = if self.frames == self.all { 0 } else { self.lacking(&self.all, &drawn)?.len() };
            if missing == 0 {
                let encoded = self.output.encode(&self.all, self.arguments.size, self.arguments.fps, interrupt::check);
                if encoded.is_err() && !interrupt::is_wanted() {
                    terminal::warn([format!("the pictures stay in {folder}; the same command makes the film of them")]);
                }
                encoded?;
                terminal::print([format!("{} pictures in {film}", self.all.len())])?;
            } else {
                terminal::print([format!(
                    "{film} is made by the shard that ends last: {missing} pictures are missing"
                )])?;
            }
        }
        Ok(status)
    }

    /// What the pictures of this run are of, without what is chosen for a target.
    fn description(&self, gpu: &Gpu, request: &mut Request) -> Description {
        Description {
            version: env!("GLINT_VERSION").into(),
            scene: self.path.checksum(request),
            path: self.path.name().to_owned(),
            size: self.arguments.size,
            fps: self.arguments.fps,
            adapter: picture_file::adapter(gpu),
            set: recording::settings(request).differing().into_iter().collect(),
            averaging: self.averaging,
            auto: None,
        }
    }

    /// The frames whose files are not there, or not whole. `drawn` has the parameters that pictures are drawn by.
    ///
    /// # Errors
    /// A picture that is not of this recording, or Ctrl-C.
    fn lacking(&self, frames: &[u32], drawn: &Description) -> anyhow::Result<Vec<u32>> {
        let bar = Bar::pictures("looking");
        let mut lacking = Vec::new();
        for (done, frame) in frames.iter().enumerate() {
            interrupt::check()?;
            bar.set(done as u64, frames.len() as u64);
            let has_image =
                |image: &Aov| picture_file::is_exr(&self.folder.image(*frame, image.name()), self.arguments.size);
            let has_stats = !self.arguments.stats || self.folder.stats(*frame).exists();
            if !(self.folder.has(*frame, drawn)? && self.images.iter().all(has_image) && has_stats) {
                lacking.push(*frame);
            }
        }
        bar.end();
        Ok(lacking)
    }

    /// Says which adapters have drawn the pictures of all shards that are there, if there are several.
    fn tell_adapters(&self) {
        let mut drawn = BTreeMap::<String, u32>::new();
        for source in self.all.iter().filter_map(|frame| self.folder.source(*frame)) {
            *drawn.entry(source).or_default() += 1;
        }
        if drawn.len() > 1 {
            let drawn: Vec<String> = drawn.iter().map(|(source, count)| format!("{count} by {source}")).collect();
            let folder = scene::shown(&self.folder.path);
            terminal::warn([format!(
                "the pictures in {folder} are of several adapters, each of which rounds otherwise: {}",
                drawn.join(", ")
            )]);
        }
    }

    /// The time of a frame on the path, in seconds.
    fn time(&self, frame: u32) -> f64 {
        f64::from(frame) / f64::from(self.arguments.fps)
    }

    /// Lets `auto` choose for the first view of the path. Returns the exit status if inputs cannot be read.
    fn choose(&self, gpu: &Arc<Gpu>, request: &Request) -> anyhow::Result<Result<AutoStats, u8>> {
        let Some(target) = self.arguments.target.target() else { return Err(usage("no target to choose for")) };
        let mut request = request.clone();
        let mut settings = recording::settings(&mut request).clone();
        let mut fixed = chosen::fixed(&self.arguments.set, &settings);
        // The pictures themselves warn of what their labels show.
        settings.overlay.labels = false;
        // Pictures of a recording are those of the window, which are not enlarged.
        fixed.push("view.resolution".to_owned());
        let size = self.averaging.drawn_size(self.arguments.size);
        let viewpoint = Viewpoint::new(None, &mut request, &mut settings)?;
        let first = |outline: &[glam::DVec3], up, room| {
            let view = viewpoint.camera(outline, up, room, &settings, size);
            let mut bounds = cloud::Bounds::EMPTY;
            outline.iter().for_each(|point| bounds.include(*point));
            self.path.first(&PathPlace { view, bounds, up })
        };
        // What cannot be read is reported again when it is recorded.
        let opened = subject::open(gpu, request, &settings, size, false, |outline, up, room| -> Camera {
            first(outline, up, room)
        })?;
        let subject = match opened {
            Ok(LoadedSubject { subject, .. }) => subject,
            Err(status) => return Ok(Err(status)),
        };
        let mut renderer = Renderer::new(gpu.clone())?;
        let mut drawn = settings.drawn();
        chosen::choose(target, &mut drawn, &fixed, &subject, size, gpu, &mut renderer).map(Ok)
    }

    /// Sets what was chosen for a target: in this run, or in the one that began the folder.
    fn apply(&self, auto: Option<&serde_json::Value>, settings: &mut Settings) -> anyhow::Result<()> {
        let name = scene::shown(self.folder.description_file());
        let auto = auto.map(|auto| serde_json::from_value::<AutoStats>(auto.clone()));
        let auto = auto.transpose().map_err(|error| usage(format!("{name}: {error}")))?;
        let made = auto.as_ref().map(|auto| auto.target.clone());
        if made != self.arguments.target.target().map(|target| target.to_string()) {
            let made = made.map_or("for no target of time or error".to_owned(), |made| format!("for {made}"));
            return Err(usage(format!(
                "{name}: its pictures are drawn {made}; ask for the same, or name another folder"
            )));
        }
        for (key, value) in auto.map(|auto| auto.set).unwrap_or_default() {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            settings.set_text(&key, &text).with_context(|| name.clone())?;
        }
        Ok(())
    }

    /// Makes these pictures and returns the exit status. `drawn` has the parameters that they are drawn by; `begun` is
    /// what the folder is to say, if it has no pictures yet.
    ///
    /// # Errors
    /// A picture cannot be made or written, or lacks points that may come later; or Ctrl-C.
    fn make(
        &self,
        frames: &[u32],
        drawn: &Description,
        begun: Option<&Description>,
        gpu: Arc<Gpu>,
        request: Request,
    ) -> anyhow::Result<u8> {
        picture_file::check_place(&self.folder.picture(frames[0]))?;
        let wanted_gpu = self.arguments.gpu.gpu.clone();
        let (size, averaging) = (self.arguments.size, self.averaging);
        let opened = Recorder::open(gpu, wanted_gpu, averaging.drawn_size(size), request, &self.path)?;
        let mut recorder = match opened {
            Ok(recorder) => recorder,
            Err(status) => return Ok(status),
        };
        if let Some(description) = begun {
            let text = serde_json::to_string_pretty(description)? + "\n";
            let is_first = picture_file::write_new_text(&self.folder.description_file(), &text)?;
            // Another run has begun the folder meanwhile.
            let made = if is_first { None } else { self.folder.check(description, self.arguments.mixed)? };
            if made.is_some_and(|made| made.auto != description.auto) {
                let name = scene::shown(self.folder.description_file());
                return Err(usage(format!("{name}: another run has chosen meanwhile; start this run again")));
            }
        }
        let bar = Bar::pictures("recording");
        let (mut is_told, mut is_cut) = (false, false);
        for (done, frame) in frames.iter().enumerate() {
            bar.set(done as u64, frames.len() as u64);
            let (time, fps) = (self.time(*frame), self.arguments.fps);
            let picture = recorder.frame(time, fps, size, averaging, &self.images, &bar)?;
            if recorder.is_cut_off() {
                // A picture that is there is taken as whole by all later runs.
                let problem = format!(
                    "frame {frame} is not made: it lacks points that cannot be read now; the same command goes on from \
                     there once they can be"
                );
                return Err(if recorder.status() == FAILED { anyhow!(problem) } else { usage(problem) });
            }
            let origin = recorder.origin();
            if done == 0 {
                let names = self.images.iter().map(|image| image.name());
                bar.suspend(|| picture_file::warn_of_origin(names, origin));
            }
            for (image, mut values) in self.images.iter().zip(picture.images) {
                let cut = picture_file::cut_warning(*image, &values).filter(|_| !is_cut);
                is_cut |= cut.is_some();
                bar.suspend(|| terminal::warn(cut.map(|warning| format!("frame {frame}: {warning}"))));
                let own = picture_file::origin_of(image.name(), &picture.camera);
                own.iter().for_each(|own| picture_file::move_places(&mut values, *own - origin));
                picture_file::write_exr(&self.folder.image(*frame, image.name()), &values, own.map(|_| origin))?;
            }
            if self.arguments.stats {
                let stats = FrameStats { adapter: &drawn.adapter, picture: recorder.stats(time) };
                let text = serde_json::to_string_pretty(&stats)? + "\n";
                picture_file::write_text(&self.folder.stats(*frame), &text)?;
            }
            // A frame with a picture is whole.
            let (file, own) = (self.folder.picture(*frame), drawn.of_frame(*frame));
            picture_file::write_frame(&file, size, &picture.rgba, Some(&drawn.adapter), Some(&own))?;
            if recorder.is_empty() && !std::mem::replace(&mut is_told, true) {
                let warning = if recorder.hides_all() {
                    subject::ALL_HIDDEN.to_owned()
                } else {
                    format!("frame {frame}: the picture is empty: no point that is shown lies before the camera")
                };
                bar.suspend(|| terminal::warn([warning]));
            }
        }
        bar.end();
        Ok(recorder.status())
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::shared::command_line::{Command, CommandLine};
    use crate::system::failure::exit_status;

    const KEYFRAME: &str = "eye = [0, -5, 1]\npivot = [0, 0, 1]\nup = [0, 0, 1]\n";

    fn arguments(words: &[&str]) -> RecordArguments {
        let all = ["glint", "record"].iter().chain(words);
        match CommandLine::try_parse_from(all).unwrap().command {
            Some(Command::Record(arguments)) => arguments,
            _ => panic!("not a record command"),
        }
    }

    fn path_until(time: &str) -> String {
        format!("[[paths.keyframes]]\ntime = 0\n{KEYFRAME}[[paths.keyframes]]\ntime = {time}\n{KEYFRAME}")
    }

    /// Runs `glint record` with bad words and returns its message. It must refuse them before it looks for an adapter.
    fn refusal(words: &[&str]) -> String {
        let error = run(&arguments(words)).unwrap_err();
        assert_eq!(exit_status(&error), 2, "{error:#}");
        format!("{error:#}")
    }

    #[test]
    fn bad_words_are_refused_by_name_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, paths: &[&str]| {
            let path = folder.path().join(name);
            let paths: String =
                paths.iter().map(|name| format!("[[paths]]\nname = \"{name}\"\n{}", path_until("2"))).collect();
            std::fs::write(&path, format!("clouds = [\"five-mirrors/none\"]\n{paths}")).unwrap();
            path.display().to_string()
        };
        let (none, one, two) = (put("none.toml", &[]), put("one.toml", &["a"]), put("two.toml", &["tour", "way back"]));
        let output = folder.path().join("pictures").display().to_string();
        let refusal = |words: &[&str]| refusal(&[words, &["-o", &output]].concat());
        assert!(refusal(&["five-mirrors/none"]).contains("five-mirrors/none: it has no camera path"));
        assert!(refusal(&[&none]).contains("none.toml: it has no camera path"));
        assert!(refusal(&[&two]).contains("there are several, name one of them: tour, way back, turntable"));
        assert!(refusal(&[&two, "--path", "tuor"]).contains("`tuor` is unknown; available: tour, way back, turntable"));
        assert!(
            refusal(&[&one, "--frames", "50..61"]).contains("--frames 50..61: path `a` has 60 frames at 30 a second")
        );
        assert!(refusal(&[&one, "--set", "splat.sise=1"]).contains("did you mean `splat.size`?"));
        assert!(refusal(&["gone.toml"]).starts_with("gone.toml: "));
        assert!(refusal(&[&one, "--aov", "dept"]).contains("--aov: `dept` is unknown; available: depth, normal"));
        let blind = [&one, "--aov", "mirror_position", "--set", "reflection.method=none"];
        assert!(refusal(&blind).contains("it needs a --method"));
        assert!(refusal(&[&one, "--aov", "depth", "--supersample", "2"]).contains("leave --supersample out"));
        let wipe = put("wipe.toml", &["a"]);
        let states = "[[paths.states]]\n[[paths.states]]\nmethod = \"ray_trace\"\n";
        std::fs::write(&wipe, std::fs::read_to_string(&wipe).unwrap() + states).unwrap();
        assert!(
            refusal(&[&wipe, "--aov", "depth"]).contains("--aov: float images are of one state, and path `a` wipes")
        );
        assert!(!Path::new(&output).exists());
    }

    #[test]
    fn films_that_no_encoder_makes_are_refused_before_any_picture() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |name: &str, words: &str| {
            let output = folder.path().join(name).display().to_string();
            let words = format!("five-mirrors/none --path orbit {words}");
            refusal(&words.split(' ').chain(["-o", output.as_str()]).collect::<Vec<_>>())
        };
        let gif = refusal("a.gif", "--fps 60 --size 64x48");
        assert!(gif.contains("a.gif: the encoder refuses: a GIF shows at most 50 pictures a second, 60 are asked for"));
        let small = refusal("a.mp4", "--size 15x48");
        assert!(small.contains("a.mp4: the encoder refuses: ") && small.contains("15"), "{small}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn frames_are_shown_from_the_beginning_of_a_path_to_its_end() {
        let count = |duration: &str, fps: &str| {
            let file = scene::SceneFile::parse(&format!("[[paths]]\nname = \"a\"\n{}", path_until(duration))).unwrap();
            frames(&PathChoice::Own(file.paths[0].clone()), &arguments(&["a", "-o", "b", "--fps", fps]))
                .map(|frames| frames.len())
        };
        let counts = [("10", "30"), ("1.1", "10"), ("1.01", "10"), ("0.001", "1"), ("0.3", "10")];
        assert_eq!(counts.map(|(duration, fps)| count(duration, fps).unwrap()), [300, 11, 11, 1, 3]);
        let refused = count("100000", "30").unwrap_err().to_string();
        assert!(refused.contains("path `a` has 3000000 frames, expected at most 1000000"), "{refused}");
        let still =
            scene::SceneFile::parse(&format!("[[paths]]\nname = \"a\"\n[[paths.keyframes]]\ntime = 0\n{KEYFRAME}"));
        let still = PathChoice::Own(still.unwrap().paths[0].clone());
        assert_eq!(frames(&still, &arguments(&["a", "-o", "b"])).unwrap(), [0]);
        let built_in = PathChoice::BuiltIn(scene::BuiltInPath::Orbit);
        assert_eq!(frames(&built_in, &arguments(&["a", "-o", "b", "--frames", "3..6"])).unwrap(), [3, 4, 5]);
    }
}
