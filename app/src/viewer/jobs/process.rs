//! `glint record` in a process of its own, on a copy of the scene: so the window does not wait, and what it exports is
//! what the command makes.

use std::ffi::OsString;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::PathBuf;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::system::progress_bar::Stage;

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

/// Runs `glint record` on a scene, reports its progress, and returns how it ended.
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
        // By the window, or with it by a signal to end.
        Ok(status) if was_stopped && status.code().is_some_and(|code| code > 128) => Ended::Stopped,
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
        crate::system::picture_file::write_text(&path, text).map_err(|error| format!("{error:#}"))?;
        Ok(Self { path })
    }
}

impl Drop for ScratchFile {
    fn drop(&mut self) {
        // A file that is left over is small, and the system clears that folder.
        let _ = std::fs::remove_file(&self.path);
    }
}
