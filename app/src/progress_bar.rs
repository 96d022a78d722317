//! How far a long task is, on standard error, where that is a terminal; silent otherwise.

use std::fmt::Write;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use cloud::Progress;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use world::{Making, Stage, Standing};

/// Often enough to look alive, seldom enough to cost nothing.
const INTERVAL: Duration = Duration::from_millis(100);

/// A bar that counts points, hidden where standard error is no terminal.
pub fn points(task: &'static str) -> ProgressBar {
    let template = "{msg:>10} {bar:40} {human_pos} of {human_len} points, {rate}, {eta} left";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    let rate = |state: &ProgressState, text: &mut dyn Write| {
        let _ = write!(text, "{:.2} M/s", state.per_sec() / 1e6);
    };
    ProgressBar::new(0).with_style(style.with_key("rate", rate)).with_message(task)
}

/// Shows how far `progress` is.
pub fn update(bar: &ProgressBar, progress: &Progress) {
    let total = progress.total();
    if total > 0 {
        bar.set_length(total);
        bar.set_position(progress.done().min(total));
    }
}

/// Shows how far a stage is; `place` says which of several it is.
pub fn show(bar: &ProgressBar, stage: &Stage, place: &str) {
    let task = match (stage.standing(), stage.making) {
        (Standing::Elsewhere, Making::Index) => "another program makes the index",
        (Standing::Elsewhere, Making::Surfels) => "another program makes the normals",
        (_, Making::Index) => "indexing",
        (_, Making::Surfels) => "normals",
    };
    bar.set_length(stage.points());
    bar.set_position(stage.done());
    bar.set_message(format!("{task}{place}"));
}

/// Runs `work` on this thread, and shows `progress` meanwhile.
pub fn watch<Result>(task: &'static str, progress: &Progress, work: impl FnOnce() -> Result) -> Result {
    watch_by(task, |bar| update(bar, progress), work)
}

/// Runs the work of a stage on this thread, and shows how far it is meanwhile.
pub fn watch_stage<Result>(stage: &Stage, place: &str, work: impl FnOnce(&Progress) -> Result) -> Result {
    watch_by("", |bar| show(bar, stage, place), || stage.run(work))
}

fn watch_by<Result>(task: &'static str, show: impl Fn(&ProgressBar) + Sync, work: impl FnOnce() -> Result) -> Result {
    let bar = points(task);
    if bar.is_hidden() {
        return work();
    }
    let (done, is_done) = channel::<()>();
    let result = std::thread::scope(|scope| {
        let (bar, show) = (&bar, &show);
        scope.spawn(move || {
            while is_done.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                show(bar);
            }
        });
        let result = work();
        drop(done);
        result
    });
    bar.finish_and_clear();
    result
}
