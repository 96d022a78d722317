//! `glint record`: writes pictures along a camera path of a scene file. Each picture is the one that the window shows
//! when the camera rests there, and that `glint render` writes: all points that the view needs are loaded, and the
//! quality is full.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use render::{Gpu, Renderer};
use scene::{Camera, CameraPath, ExposureFit, Settings, View, whole_file};
use serde::{Deserialize, Serialize};
use world::{Input, Request};

use crate::chosen::{self, AutoStats};
use crate::command_line::RecordArguments;
use crate::failure::usage;
use crate::progress_bar::Bar;
use crate::render_command::check_size;
use crate::subject::{self, LoadedSubject};
use crate::viewer::Headless;
use crate::{picture_file, terminal};

/// The most frames of a recording: the names of the pictures number them with six digits.
const MOST_FRAMES: u32 = 1_000_000;

/// The time between opening a scene, which moves the camera, and the beginning of the path. By then the camera rests.
const REST: Duration = Duration::from_secs(1);

/// Records the path. Returns exit status 2 if one of several inputs could not be read and the pictures show the others.
///
/// # Errors
/// Fails on bad usage, without an adapter, if no input can be read, if a file cannot be written, or on Ctrl-C.
pub fn run(arguments: &RecordArguments) -> anyhow::Result<u8> {
    let folder = arguments.output.as_path();
    let mut request = world::resolve(std::slice::from_ref(&arguments.scene));
    request.check()?;
    if folder.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("mp4")) {
        let name = scene::shown(folder);
        return Err(usage(format!("{name}: films are not in this version yet; name a folder for the pictures")));
    }
    let path = path(&request, arguments)?;
    let recording = Recording { frames: frames(&path, arguments)?, path, fps: arguments.fps, folder };
    prepare(&mut request, &recording, arguments)?;
    let gpu = Gpu::headless(arguments.gpu.gpu.as_deref())?;
    check_size(&gpu, arguments.size)?;
    let is_new = !folder.exists();
    if is_new {
        std::fs::create_dir(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
    }
    let recorded = match recording.choose(&gpu, &mut request, arguments) {
        Ok(0) => recording.record(gpu, request, arguments),
        unreadable => unreadable,
    };
    if is_new {
        // This removes the folder only if it holds no pictures.
        let _ = std::fs::remove_dir(folder);
    }
    recorded
}

/// The path that `--path` names, or the only one.
fn path(request: &Request, arguments: &RecordArguments) -> anyhow::Result<CameraPath> {
    let names: Vec<&str> = request.paths.iter().map(|path| path.name.as_str()).collect();
    let available = names.join(", ");
    match (&arguments.path, request.paths.as_slice()) {
        (_, []) => {
            let name = scene::shown(Path::new(&arguments.scene));
            Err(usage(format!(
                "{name}: it has no camera path; add one to a scene file under [[paths]] (docs/scenes.md)"
            )))
        }
        (None, [only]) => Ok(only.clone()),
        (None, _) => Err(usage(format!("--path: there are several, name one of them: {available}"))),
        (Some(wanted), paths) => {
            let known = paths.iter().find(|path| path.name == *wanted);
            known.cloned().ok_or_else(|| usage(format!("--path: `{wanted}` is unknown; available: {available}")))
        }
    }
}

/// The frames that `--frames` names, or all.
fn frames(path: &CameraPath, arguments: &RecordArguments) -> anyhow::Result<Range<u32>> {
    // The last picture is shown until the path ends. The subtraction keeps a rounding error from adding a frame.
    let all = (path.duration() * f64::from(arguments.fps) - 1e-6).ceil().max(1.0) as u32;
    let frames = arguments.frames.clone().unwrap_or(0..all);
    if frames.end > all {
        let Range { start, end } = frames;
        return Err(usage(format!(
            "--frames {start}..{end}: path `{}` has {all} frames at {} a second, from 0 on",
            path.name, arguments.fps
        )));
    }
    if frames.end > MOST_FRAMES {
        return Err(usage(format!("path `{}` has {all} frames, expected at most {MOST_FRAMES}", path.name)));
    }
    Ok(frames)
}

/// Sets the parameters, and puts the camera at the beginning of the path. Automatic light and colour ranges follow from
/// the first view, which must not depend on which frames are recorded.
fn prepare(request: &mut Request, recording: &Recording<'_>, arguments: &RecordArguments) -> anyhow::Result<()> {
    let (settings, warnings) = (Settings::default(), Vec::new());
    let mirrors = request.all_mirrors();
    let view = request.view.get_or_insert(View { camera: None, settings, warnings });
    view.camera = Some(recording.camera(0)?);
    if let Some(preset) = arguments.preset {
        view.settings = preset.applied(&view.settings, mirrors.iter());
    }
    for (key, value) in &arguments.set {
        view.settings.set_text(key, value).with_context(|| format!("--set {key}={value}"))?;
    }
    Ok(())
}

/// What `--budget` or `--error` chose for a recording, for all pictures of its folder.
#[derive(Serialize, Deserialize)]
struct Plan {
    size: [u32; 2],
    auto: AutoStats,
}

/// The file of the plan in the folder of the pictures.
const PLAN: &str = "record.json";

struct Recording<'a> {
    path: CameraPath,
    frames: Range<u32>,
    fps: u32,
    folder: &'a Path,
}

impl Recording<'_> {
    /// The time of a frame on the path, in seconds.
    fn time(&self, frame: u32) -> f64 {
        f64::from(frame) / f64::from(self.fps)
    }

    fn camera(&self, frame: u32) -> anyhow::Result<Camera> {
        self.path.camera(self.time(frame)).ok_or_else(|| anyhow!("path `{}` has no keyframes", self.path.name))
    }

    fn picture(&self, frame: u32) -> PathBuf {
        self.folder.join(format!("frame-{frame:06}.png"))
    }

    /// Sets what `auto` chose for the recording, if a target asks for it: what an earlier run in the same folder wrote
    /// down, else a choice for the first view of the path. Returns the exit status if inputs cannot be read.
    fn choose(&self, gpu: &Arc<Gpu>, request: &mut Request, arguments: &RecordArguments) -> anyhow::Result<u8> {
        let Some(target) = arguments.target.target() else { return Ok(0) };
        let settings = request.view.as_ref().map(|view| view.settings.clone()).unwrap_or_default();
        let path = self.folder.join(PLAN);
        if !path.exists() {
            let mut fixed = chosen::fixed(&arguments.set, &settings);
            // Pictures of a recording are those of the window, which are not enlarged.
            fixed.push("view.resolution".to_owned());
            let (camera, size) = (self.camera(0)?, arguments.size);
            // What cannot be read is reported again when it is recorded.
            let LoadedSubject { subject, .. } =
                match subject::open(gpu, request.clone(), &settings, size, |_, _, _| camera)? {
                    Ok(opened) => opened,
                    Err(status) => return Ok(status),
                };
            let mut renderer = Renderer::new(gpu.clone())?;
            let mut drawn = settings.drawn();
            let auto = chosen::choose(target, &mut drawn, &fixed, &subject, size, gpu, &mut renderer)?;
            let text = serde_json::to_string_pretty(&Plan { size, auto })? + "\n";
            // Another run in the folder may have chosen meanwhile: its choice is the one that counts.
            if !path.exists() {
                picture_file::write_text(&path, &text)?;
            }
        }
        let name = scene::shown(&path);
        let text = whole_file::read(&path)?;
        let plan: Plan = serde_json::from_str(&text).map_err(|error| usage(format!("{name}: {error}")))?;
        let ([width, height], made) = (plan.size, &plan.auto.target);
        if plan.size != arguments.size || *made != target.to_string() {
            return Err(usage(format!(
                "{name}: what is in it was chosen for {made} at {width}x{height}; ask for the same, or name another folder"
            )));
        }
        let view = request.view.as_mut().ok_or_else(|| anyhow!("{name}: there is no view to set it in"))?;
        for (key, value) in &plan.auto.set {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            view.settings.set_text(key, &text).with_context(|| name.clone())?;
        }
        Ok(0)
    }

    /// Writes the pictures and returns the exit status.
    fn record(&self, gpu: Arc<Gpu>, request: Request, arguments: &RecordArguments) -> anyhow::Result<u8> {
        picture_file::check_place(&self.picture(self.frames.start))?;
        let names = request.inputs.iter().map(Input::name).collect::<Vec<_>>().join(", ");
        let opened = Instant::now();
        let mut viewer = Headless::open(gpu, arguments.gpu.gpu.clone(), arguments.size, request, opened)?;
        if self.write(&mut viewer, opened + REST)? {
            let (count, folder) = (self.frames.len(), scene::shown(self.folder));
            terminal::print([format!("{count} pictures in {folder}")])?;
        } else if viewer.status() == 0 {
            return Err(usage(format!("{names}: no points to show")));
        }
        Ok(viewer.status())
    }

    /// Gives the picture at a time the exposures that fit the keyframes before and after it, mixed by time, so that the
    /// exposure does not jump with what comes into view. `fitted` keeps those of keyframes.
    fn expose(
        &self,
        viewer: &mut Headless,
        time: f64,
        now: Instant,
        fitted: &mut BTreeMap<usize, f32>,
        bar: &Bar,
    ) -> anyhow::Result<()> {
        if viewer.tone.fit == ExposureFit::Locked {
            return Ok(());
        }
        let keyframes = &self.path.keyframes;
        let next = keyframes.partition_point(|keyframe| keyframe.time <= time);
        let around = [next.saturating_sub(1), next.min(keyframes.len().saturating_sub(1))];
        let mut stops = [0.0; 2];
        for (stops, index) in stops.iter_mut().zip(around) {
            *stops = match (fitted.get(&index), self.path.camera(keyframes[index].time)) {
                (Some(known), _) => *known,
                (None, Some(camera)) => viewer.exposure(camera, now, bar)?,
                (None, None) => viewer.tone.exposure,
            };
            fitted.insert(index, *stops);
        }
        let [from, to] = around.map(|index| keyframes[index].time);
        let share = if to > from { ((time - from) / (to - from)).clamp(0.0, 1.0) as f32 } else { 0.0 };
        viewer.lock_exposure((stops[0] + (stops[1] - stops[0]) * share).clamp(-10.0, 10.0));
        Ok(())
    }

    /// Writes the pictures. Returns false if there is nothing to show. `start` is the time of the path's beginning on
    /// the clock that the viewer is given; that clock advances with the frames and not with real time.
    fn write(&self, viewer: &mut Headless, start: Instant) -> anyhow::Result<bool> {
        let reading = Bar::points("reading");
        let is_there = viewer.settle(self.camera(0)?, start, &reading)?.is_some();
        reading.end();
        if !is_there {
            return Ok(false);
        }
        let bar = Bar::counted();
        let mut is_told = false;
        let mut fitted = BTreeMap::new();
        for (done, frame) in self.frames.clone().enumerate() {
            bar.set(done as u64, self.frames.len() as u64);
            let now = start + Duration::from_secs_f64(self.time(frame));
            self.expose(viewer, self.time(frame), now, &mut fitted, &bar)?;
            let Some(points) = viewer.write(&self.picture(frame), self.camera(frame)?, now, &bar)? else {
                return Ok(false);
            };
            if points == 0 && !std::mem::replace(&mut is_told, true) {
                let warning = format!("frame {frame}: the picture is empty, the camera looks past all points");
                bar.suspend(|| terminal::warn([warning]));
            }
        }
        bar.end();
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;
    use crate::command_line::{Command, CommandLine};
    use crate::failure::exit_status;

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
        assert!(refusal(&[&two]).contains("there are several, name one of them: tour, way back"));
        assert!(refusal(&[&two, "--path", "tuor"]).contains("`tuor` is unknown; available: tour, way back"));
        assert!(
            refusal(&[&one, "--frames", "50..61"]).contains("--frames 50..61: path `a` has 60 frames at 30 a second")
        );
        assert!(refusal(&[&one, "--set", "splat.sise=1"]).contains("did you mean `splat.size`?"));
        assert!(refusal(&["gone.toml"]).starts_with("gone.toml: "));
        assert!(super::tests::refusal(&[&one, "-o", "a.mp4"]).contains("a.mp4: films are not in this version yet"));
        assert!(!Path::new(&output).exists());
    }

    #[test]
    fn frames_are_shown_from_the_beginning_of_a_path_to_its_end() {
        let count = |duration: &str, fps: &str| {
            let file = scene::SceneFile::parse(&format!("[[paths]]\nname = \"a\"\n{}", path_until(duration))).unwrap();
            frames(&file.paths[0], &arguments(&["a", "-o", "b", "--fps", fps])).map(|frames| frames.end)
        };
        let counts = [("10", "30"), ("1.1", "10"), ("1.01", "10"), ("0.001", "1"), ("0.3", "10")];
        assert_eq!(counts.map(|(duration, fps)| count(duration, fps).unwrap()), [300, 11, 11, 1, 3]);
        let refused = count("100000", "30").unwrap_err().to_string();
        assert!(refused.contains("path `a` has 3000000 frames, expected at most 1000000"), "{refused}");
        assert!(count("1e300", "30").is_err());
        let still =
            scene::SceneFile::parse(&format!("[[paths]]\nname = \"a\"\n[[paths.keyframes]]\ntime = 0\n{KEYFRAME}"));
        assert_eq!(frames(&still.unwrap().paths[0], &arguments(&["a", "-o", "b"])).unwrap(), 0..1);
    }
}
