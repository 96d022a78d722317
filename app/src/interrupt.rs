//! Ctrl-C: the work under way is stopped, clears away what it has begun, and the program ends with a status of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use cloud::Progress;

use crate::failure::{INTERRUPTED, Interrupted};
use crate::terminal::complain;

static IS_WANTED: AtomicBool = AtomicBool::new(false);

/// What cannot be stopped for that long, like a driver that compiles shaders, is left behind.
const PATIENCE: Duration = Duration::from_secs(20);

/// From here on Ctrl-C asks the work to end, and calls `wake` for what does not look here; the second time, or when the work does
/// not end, it ends the program at once.
pub fn catch(wake: impl Fn() + Send + 'static) {
    let stop = move || {
        if IS_WANTED.swap(true, Ordering::Relaxed) {
            end();
        }
        wake();
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            end();
        });
    };
    // Where that cannot be caught it ends the program; the next one clears away what was begun.
    if let Err(error) = ctrlc::set_handler(stop) {
        tracing::debug!(%error, "Ctrl-C");
    }
}

fn end() -> ! {
    complain(&Interrupted.to_string());
    std::process::exit(i32::from(INTERRUPTED))
}

/// Whether Ctrl-C was pressed.
pub fn is_wanted() -> bool {
    IS_WANTED.load(Ordering::Relaxed)
}

/// Between two steps of the work.
///
/// # Errors
/// If Ctrl-C was pressed.
pub fn check() -> anyhow::Result<()> {
    if is_wanted() { Err(Interrupted.into()) } else { Ok(()) }
}

/// Has work stop that looks at `progress`, if Ctrl-C was pressed.
pub fn pass_on(progress: &Progress) {
    if is_wanted() {
        progress.cancel();
    }
}
