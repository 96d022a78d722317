//! A recording that the window asks for. `glint record` makes it in a process of its own, from a copy of the scene: so
//! the window does not wait, and what it exports is what the command makes.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::PathBuf;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use serde_json::json;

use super::wanted::Wanted;
use crate::progress_bar::Stage;
use crate::viewer::loaded::Loaded;
use crate::viewer::messages::Level;
use crate::viewer::outside::Outside;
use crate::viewer::scene::Scene;
use crate::viewer::views::free_path;
use crate::viewer::work::Work;

/// Ends the process of a recording: it ends when its standard input does.
pub type Leash = Arc<Mutex<Option<ChildStdin>>>;

/// How a recording that has ended ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ended {
    /// What the command has said of its result.
    Done(String),
    Stopped,
    Failed(String),
}

#[derive(Default)]
pub struct Recording {
    /// The dialog, while it is open.
    pub asked: Option<Wanted>,
    pub under_way: Option<UnderWay>,
}

pub struct UnderWay {
    pub output: String,
    pub stage: Option<Stage>,
    /// When the stage began, and what of it was done then.
    since: (Instant, u64),
    leash: Leash,
    pub is_stopping: bool,
}

impl UnderWay {
    /// The seconds that are left of the stage, if its pace is known.
    pub fn seconds_left(&self, now: Instant) -> Option<f64> {
        let stage = self.stage.as_ref()?;
        let (since, before) = self.since;
        let done = stage.done.checked_sub(before).filter(|done| *done > 0)?;
        let passed = now.saturating_duration_since(since).as_secs_f64();
        Some(passed / done as f64 * stage.total.saturating_sub(stage.done) as f64)
    }
}

impl Recording {
    /// Opens the dialog for a path of the scene.
    pub fn ask(&mut self, path: &str, scene: &Scene) {
        let kept = self.asked.take().map(|wanted| Wanted { path: path.to_owned(), ..wanted });
        let name: String = path.chars().map(|letter| if letter.is_alphanumeric() { letter } else { '-' }).collect();
        let output = free_path("".as_ref(), &name, "mp4").display().to_string();
        // Sides of films are even numbers of pixels.
        let size = scene.view_size.map(|side| (side & !1).max(16));
        let (subframes, shutter, supersample) = (1, 0.5, 1);
        self.asked = Some(kept.unwrap_or(Wanted {
            path: path.to_owned(),
            output,
            size,
            fps: 30,
            frames: [0, 0],
            is_h264: false,
            subframes,
            shutter,
            supersample,
        }));
    }

    /// Begins what the dialog asks for.
    pub fn start(&mut self, scene: &Scene, loaded: &Loaded, adapter: Option<&str>, outside: &mut Outside) {
        if self.under_way.is_some() {
            return outside.note("A recording is under way");
        }
        let Some(wanted) = self.asked.take() else { return };
        let file = scene.whole_file(loaded);
        if file.clouds.is_empty() {
            return outside.note("There is no scene to record yet");
        }
        let leash = Leash::default();
        let words = wanted.words(adapter);
        outside.log(json!({ "event": "recording", "output": wanted.output }));
        outside.work(Work::Record { scene: file.to_text(), words, leash: leash.clone() });
        let since = (outside.now, 0);
        self.under_way = Some(UnderWay { output: wanted.output, stage: None, since, leash, is_stopping: false });
    }

    pub fn stop(&mut self) {
        if let Some(under_way) = &mut self.under_way {
            under_way.is_stopping = true;
            under_way.leash.lock().unwrap_or_else(PoisonError::into_inner).take();
        }
    }

    pub fn on_stage(&mut self, stage: Stage, outside: &Outside) {
        if let Some(under_way) = &mut self.under_way {
            if under_way.stage.as_ref().is_none_or(|before| before.task != stage.task) {
                under_way.since = (outside.now, stage.done);
            }
            under_way.stage = Some(stage);
        }
    }

    pub fn on_end(&mut self, ended: Ended, outside: &mut Outside) {
        let Some(under_way) = self.under_way.take() else { return };
        outside.log(json!({ "event": "recorded", "output": under_way.output, "ended": format!("{ended:?}") }));
        match ended {
            Ended::Done(told) => outside.note(format!("Recorded: {told}")),
            Ended::Stopped => outside.note(format!(
                "Recording stopped; what is done of {} stays, and the same recording goes on from there",
                under_way.output
            )),
            Ended::Failed(problem) => outside.say(Level::Error, format!("Recording: {problem}")),
        }
    }
}

/// Runs `glint record` on a scene, tells its progress, and returns how it ended.
pub fn run(scene: &str, words: &[OsString], leash: &Leash, tell: impl Fn(Stage)) -> Ended {
    let file = match ScratchFile::new(scene) {
        Ok(file) => file,
        Err(problem) => return Ended::Failed(problem),
    };
    let started = std::env::current_exe().and_then(|program| {
        let mut command = Command::new(program);
        command.arg("record").arg(&file.path).args(words).arg("--report");
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()
    });
    let mut child = match started {
        Ok(child) => child,
        Err(error) => return Ended::Failed(format!("glint record cannot be started: {error}")),
    };
    *leash.lock().unwrap_or_else(PoisonError::into_inner) = child.stdin.take();
    let complaints = child.stderr.take().map(|mut errors| {
        std::thread::spawn(move || {
            let mut text = String::new();
            // Bytes that are no text end it.
            let _ = errors.read_to_string(&mut text);
            text
        })
    });
    let mut told = Vec::new();
    for line in child.stdout.take().into_iter().flat_map(|output| BufReader::new(output).lines().map_while(Result::ok))
    {
        match serde_json::from_str::<Stage>(&line) {
            Ok(stage) => tell(stage),
            Err(_) => told.push(line),
        }
    }
    let status = child.wait();
    let was_stopped = leash.lock().unwrap_or_else(PoisonError::into_inner).take().is_none();
    let complaints = complaints.and_then(|thread| thread.join().ok()).unwrap_or_default();
    let plain = |text: &str| text.lines().map(|line| line.trim_start_matches("glint: ")).collect::<Vec<_>>().join("; ");
    match status {
        Ok(status) if status.success() => {
            told.extend((!complaints.is_empty()).then(|| plain(&complaints)));
            Ended::Done(told.join("; "))
        }
        Ok(status) if was_stopped && status.code() == Some(i32::from(crate::failure::INTERRUPTED)) => Ended::Stopped,
        Ok(status) if complaints.is_empty() => Ended::Failed(format!("glint record ended with {status}")),
        Ok(_) => Ended::Failed(plain(&complaints)),
        Err(error) => Ended::Failed(error.to_string()),
    }
}

/// A scene file for as long as a recording needs it.
struct ScratchFile {
    path: PathBuf,
}

impl ScratchFile {
    fn new(text: &str) -> Result<Self, String> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("glint-recording-{}-{number}.toml", std::process::id()));
        crate::picture_file::write_text(&path, text).map_err(|error| format!("{error:#}"))?;
        Ok(Self { path })
    }
}

impl Drop for ScratchFile {
    fn drop(&mut self) {
        // A file that is left over is small, and the system clears that folder.
        let _ = std::fs::remove_file(&self.path);
    }
}
