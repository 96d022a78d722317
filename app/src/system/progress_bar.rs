//! Shows the progress of a long task on standard error if that is a terminal, else nothing. Passes Ctrl-C on to the
//! task.

use std::fmt::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use cloud::Progress;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use serde::{Deserialize, Serialize};
use world::{CloudTask, TaskKind, TaskStatus};

use crate::system::interrupt;
use crate::system::terminal::{self, escaped};

/// The time between two updates: short enough that the bar moves and Ctrl-C acts at once, long enough to cost nothing.
const INTERVAL: Duration = Duration::from_millis(100);

/// The progress of a task, as a line of JSON reports it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stage {
    pub task: String,
    pub done: u64,
    pub total: u64,
}

static IS_REPORTED: AtomicBool = AtomicBool::new(false);
/// What was reported last, and when.
static REPORTED: Mutex<Option<(Stage, Instant)>> = Mutex::new(None);

/// From now on all bars also write their progress to standard output, as lines of JSON.
pub fn report() {
    IS_REPORTED.store(true, Ordering::Relaxed);
}

/// Reports progress, but not more often than people can read.
fn report_stage(stage: Stage) {
    let mut reported = REPORTED.lock().unwrap_or_else(PoisonError::into_inner);
    let is_early = |(before, at): &(Stage, Instant)| {
        before.task == stage.task && (before.done == stage.done || at.elapsed() < INTERVAL)
    };
    if !reported.as_ref().is_some_and(is_early) {
        // Whoever reads no more wants no more.
        if let Ok(line) = serde_json::to_string(&stage) {
            let _ = terminal::print([line]);
        }
        *reported = Some((stage, Instant::now()));
    }
}

/// A progress bar on the terminal, if there is one.
pub struct Bar(ProgressBar);

impl Bar {
    /// A bar that counts points.
    pub fn points(task: &str) -> Self {
        let template = "{msg:>10} {bar:40} {human_pos} of {human_len} points, {rate}, {eta} left";
        let rate = |state: &ProgressState, text: &mut dyn Write| {
            let _ = write!(text, "{:.2} M/s", state.per_sec() / 1e6);
        };
        let bar = Self(ProgressBar::new(0).with_style(style(template).with_key("rate", rate)));
        bar.set_task(task);
        bar
    }

    /// A bar that counts bytes.
    fn bytes(task: &str) -> Self {
        let template = "{msg:>10} {bar:40} {bytes} of {total_bytes}, {bytes_per_sec}, {eta} left";
        let bar = Self(ProgressBar::new(0).with_style(style(template)));
        bar.set_task(task);
        bar
    }

    /// A bar that counts the pictures of a recording.
    pub fn pictures(task: &str) -> Self {
        let template = "{msg:>10} {bar:40} {pos} of {len} pictures, {rate}, {eta} left";
        let rate = |state: &ProgressState, text: &mut dyn Write| {
            let _ = write!(text, "{:.2}/s", state.per_sec());
        };
        let bar = Self(ProgressBar::new(0).with_style(style(template).with_key("rate", rate)));
        bar.set_task(task);
        bar
    }

    /// A bar that counts settings of a study.
    pub fn counted() -> Self {
        Self(ProgressBar::new(0).with_style(style("{bar:40} {pos} of {len}, {eta} left  {msg}")))
    }

    pub fn set_task(&self, task: &str) {
        self.0.set_message(escaped(task).into_owned());
    }

    pub fn set(&self, done: u64, total: u64) {
        self.0.set_length(total);
        self.0.set_position(done);
        if IS_REPORTED.load(Ordering::Relaxed) {
            report_stage(Stage { task: self.0.message(), done, total });
        }
    }

    /// Shows the state of `progress`.
    pub fn update(&self, progress: &Progress) {
        let total = progress.total();
        if total > 0 {
            self.set(progress.done().min(total), total);
        }
    }

    /// Shows the progress of a task; `place` says which of several it is.
    pub fn show(&self, task: &CloudTask, place: &str) {
        let text = match (task.status(), task.kind) {
            (TaskStatus::Elsewhere, TaskKind::Index) => "another program makes the index",
            (TaskStatus::Elsewhere, TaskKind::Surfels) => "another program makes the normals",
            (_, TaskKind::Index) => "indexing",
            (_, TaskKind::Surfels) => "normals",
        };
        self.set(task.done(), task.points());
        self.set_task(&format!("{text}{place}"));
    }

    /// Hides the bar while `say` writes to the terminal.
    pub fn suspend(&self, say: impl FnOnce()) {
        self.0.suspend(say);
    }

    pub fn end(&self) {
        self.0.finish_and_clear();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// Shows how much of a file was fetched from its address.
pub fn fetched(done: u64, total: u64) {
    static BAR: Mutex<Option<Bar>> = Mutex::new(None);
    let mut bar = BAR.lock().unwrap_or_else(PoisonError::into_inner);
    bar.get_or_insert_with(|| Bar::bytes("fetching")).set(done, total);
    if done >= total {
        bar.take().iter().for_each(Bar::end);
    }
}

/// Runs `work` on this thread and shows `progress` while it runs. Ctrl-C cancels it.
pub fn watch<Result>(task: &str, progress: &Progress, work: impl FnOnce() -> Result) -> Result {
    watch_by(task, progress, |bar| bar.update(progress), work)
}

/// Runs `work` on this thread, and shows nothing of its progress. Ctrl-C cancels it.
pub fn watch_unseen<Result>(progress: &Progress, work: impl FnOnce() -> Result) -> Result {
    watch_by("", progress, |_| {}, work)
}

/// Runs the work of a task on this thread and shows the task's progress. Ctrl-C cancels it.
pub fn watch_task<Result>(task: &CloudTask, place: &str, work: impl FnOnce(&Progress) -> Result) -> Result {
    watch_by("", &task.progress, |bar| bar.show(task, place), || task.run(work))
}

fn watch_by<Result>(
    task: &str,
    progress: &Progress,
    show: impl Fn(&Bar) + Sync,
    work: impl FnOnce() -> Result,
) -> Result {
    let bar = Bar::points(task);
    let (done, is_done) = channel::<()>();
    let result = std::thread::scope(|scope| {
        let (bar, show) = (&bar, &show);
        interrupt::pass_on(progress);
        scope.spawn(move || {
            while is_done.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                interrupt::pass_on(progress);
                show(bar);
            }
        });
        let result = work();
        drop(done);
        result
    });
    bar.end();
    result
}
