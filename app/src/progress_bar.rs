//! How far a long task is, on standard error, where that is a terminal; silent otherwise.

use std::fmt::Write;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use cloud::Progress;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

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

/// Runs `work` on this thread, and shows `progress` meanwhile.
pub fn watch<Result>(task: &'static str, progress: &Progress, work: impl FnOnce() -> Result) -> Result {
    let bar = points(task);
    if bar.is_hidden() {
        return work();
    }
    let (done, is_done) = channel::<()>();
    let result = std::thread::scope(|scope| {
        let bar = &bar;
        scope.spawn(move || {
            while is_done.recv_timeout(INTERVAL) == Err(RecvTimeoutError::Timeout) {
                update(bar, progress);
            }
        });
        let result = work();
        drop(done);
        result
    });
    bar.finish_and_clear();
    result
}
