//! Handles Ctrl-C, and the signals by which a terminal that is closed or another program ends this one: asks the work
//! under way to stop and to remove what it has begun, and ends the program with an exit status of its own.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

use cloud::Progress;

use crate::system::failure::{INTERRUPTED, Interrupted};
use crate::system::terminal::complain;

/// The exit status that the program shall end with; 0 until it is asked to.
static WANTED: AtomicU8 = AtomicU8::new(0);

/// Work that has not stopped after this time is abandoned, for example a driver that compiles shaders.
const PATIENCE: Duration = Duration::from_secs(20);

/// From now on Ctrl-C and signals to end ask the work to stop, and call `wake` to wake threads that do not call `check`.
/// The program ends at once on a second Ctrl-C, or if the work has not stopped after `PATIENCE`. A terminal that is closed
/// sends its signal twice, and the end of a session two different ones: they only ask again.
pub fn catch(wake: impl Fn() + Send + Sync + 'static) {
    let stop = Arc::new(move |status| {
        if WANTED.compare_exchange(0, status, Ordering::Relaxed, Ordering::Relaxed).is_err() {
            if status == INTERRUPTED {
                end();
            }
            return;
        }
        wake();
        std::thread::spawn(|| {
            std::thread::sleep(PATIENCE);
            end();
        });
    });
    // If no handler can be set, Ctrl-C or the signal ends the program at once.
    #[cfg(unix)]
    let caught = catch_signals(stop);
    #[cfg(not(unix))]
    let caught = ctrlc::set_handler(move || stop(INTERRUPTED));
    if let Err(error) = caught {
        tracing::debug!(%error, "Ctrl-C");
    }
}

/// Calls `stop` for Ctrl-C and each signal to end, with the exit status by which shells report it.
#[cfg(unix)]
fn catch_signals(stop: Arc<impl Fn(u8) + Send + Sync + 'static>) -> std::io::Result<()> {
    use std::io::Read as _;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    let ends_with_terminal = if ends_with_terminal() { Some(SIGHUP) } else { None };
    for signal in [SIGINT, SIGTERM].into_iter().chain(ends_with_terminal) {
        let (mut signals, sender) = std::io::pipe()?;
        signal_hook::low_level::pipe::register(signal, sender)?;
        let stop = stop.clone();
        std::thread::spawn(move || {
            while signals.read_exact(&mut [0]).is_ok() {
                stop(128 + signal as u8);
            }
        });
    }
    Ok(())
}

/// Whether the program ends when its terminal is closed: `nohup` starts programs that do not. Where the system does not
/// say so, nothing is changed about that.
#[cfg(unix)]
fn ends_with_terminal() -> bool {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return false };
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask & 1 << (signal_hook::consts::SIGHUP - 1) == 0)
}

/// From now on the end of standard input asks the work to stop, too.
pub fn catch_end_of_input() {
    std::thread::spawn(|| {
        let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
        let _ = WANTED.compare_exchange(0, INTERRUPTED, Ordering::Relaxed, Ordering::Relaxed);
        std::thread::sleep(PATIENCE);
        end();
    });
}

fn end() -> ! {
    complain(&Interrupted.to_string());
    leave(status())
}

/// Ends the program at once with an exit status. Threads that still compile shaders are left where they are: what a driver
/// takes down on a usual end of a program (LLVM's tables, with software Vulkan) is still used by them, and they crash.
/// Nothing is left in standard output: what is written there is written out at once.
pub fn leave(status: u8) -> ! {
    #[cfg(unix)]
    signal_hook::low_level::exit(i32::from(status));
    #[cfg(not(unix))]
    std::process::exit(i32::from(status))
}

/// Whether Ctrl-C was pressed, or a signal has asked the program to end.
pub fn is_wanted() -> bool {
    WANTED.load(Ordering::Relaxed) != 0
}

/// The exit status after an interruption: 130 after Ctrl-C.
pub fn status() -> u8 {
    match WANTED.load(Ordering::Relaxed) {
        0 => INTERRUPTED,
        wanted => wanted,
    }
}

/// Fails after Ctrl-C; callers call it between two steps of their work.
///
/// # Errors
/// If Ctrl-C was pressed, or a signal has asked the program to end.
pub fn check() -> anyhow::Result<()> {
    if is_wanted() { Err(Interrupted.into()) } else { Ok(()) }
}

/// After Ctrl-C, cancels the work that watches `progress`.
pub fn pass_on(progress: &Progress) {
    if is_wanted() {
        progress.cancel();
    }
}
