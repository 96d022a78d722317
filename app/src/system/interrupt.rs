//! Handles Ctrl-C: asks the work under way to stop and to remove what it has begun, and ends the program with an exit
//! status of its own.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use cloud::Progress;

use crate::system::failure::{INTERRUPTED, Interrupted};
use crate::system::terminal::complain;

static IS_WANTED: AtomicBool = AtomicBool::new(false);

/// Work that has not stopped after this time is abandoned, for example a driver that compiles shaders.
const PATIENCE: Duration = Duration::from_secs(20);

/// From now on Ctrl-C asks the work to stop, and calls `wake` to wake threads that do not call `check`. The program
/// ends at once on a second Ctrl-C, or if the work has not stopped after `PATIENCE`.
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
    // If the handler cannot be set, Ctrl-C ends the program at once, and the next run removes what was begun.
    if let Err(error) = ctrlc::set_handler(stop) {
        tracing::debug!(%error, "Ctrl-C");
    }
}

/// From now on the end of standard input asks the work to stop, too.
pub fn catch_end_of_input() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        IS_WANTED.store(true, Ordering::Relaxed);
        std::thread::sleep(PATIENCE);
        end();
    });
}

fn end() -> ! {
    complain(&Interrupted.to_string());
    std::process::exit(i32::from(INTERRUPTED))
}

/// Whether Ctrl-C was pressed.
pub fn is_wanted() -> bool {
    IS_WANTED.load(Ordering::Relaxed)
}

/// Fails after Ctrl-C; callers call it between two steps of their work.
///
/// # Errors
/// If Ctrl-C was pressed.
pub fn check() -> anyhow::Result<()> {
    if is_wanted() { Err(Interrupted.into()) } else { Ok(()) }
}

/// After Ctrl-C, cancels the work that watches `progress`.
pub fn pass_on(progress: &Progress) {
    if is_wanted() {
        progress.cancel();
    }
}
