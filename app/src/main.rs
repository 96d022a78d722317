//! `glint`: reads the command line, does what it says, and ends with the exit status that docs and scripts rely on:
//! 0 done, 1 the work failed, 2 bad usage or unreadable input, 3 nothing to show it on, 130 interrupted.

mod command_line;
mod environment;
mod failure;
mod index_command;
mod info;
mod interrupt;
mod listing;
mod picture_file;
mod progress_bar;
mod record_command;
mod render_command;
mod study_command;
mod subject;
mod terminal;
mod truth;
mod viewer;

use std::path::Path;
use std::process::ExitCode;

use clap::Parser as _;
use command_line::{Command, CommandLine};
use failure::NoScreen;
use terminal::complain;

fn main() -> ExitCode {
    quiet_wayland();
    log_if_asked();
    // A panic is a defect of ours; a person gets one line that tells where, not a back-trace.
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or(String::new(), |place| format!(" at {}:{}", place.file(), place.line()));
        let message = panic.payload_as_str().unwrap_or("no message");
        complain(&format!("internal error{place}: {message}"));
    }));
    let line = match CommandLine::try_parse() {
        Ok(line) => line,
        Err(error) if !error.use_stderr() => {
            // Help or version: a result, not an error.
            return ended(terminal::print(error.render().to_string().lines()).map(|()| 0));
        }
        Err(error) => {
            complain(&command_line::brief(error));
            return ExitCode::from(failure::UNUSABLE);
        }
    };
    std::panic::catch_unwind(move || run(line)).map_or(ExitCode::from(failure::FAILED), ended)
}

/// Says what is wrong, if anything is. Whatever failed after Ctrl-C failed because of it.
fn ended(outcome: anyhow::Result<u8>) -> ExitCode {
    ExitCode::from(outcome.unwrap_or_else(|error| {
        let error = if interrupt::is_wanted() { failure::Interrupted.into() } else { error };
        complain(&failure::message(&error));
        failure::exit_status(&error)
    }))
}

/// The exit status; what is not an error may still have one that is not 0 (`info` of files of which one is unreadable).
fn run(line: CommandLine) -> anyhow::Result<u8> {
    let command = line.command.unwrap_or(Command::View(line.view));
    // The window has to be woken.
    if !matches!(command, Command::View(_)) {
        interrupt::catch(|| {});
    }
    match command {
        Command::View(arguments) => {
            // Checked before the display: a wrong name is wrong everywhere.
            let request = world::resolve(&arguments.inputs);
            request.check()?;
            if !environment::has_display() {
                let name = arguments.inputs.first().map_or("five-mirrors/sphere".as_ref(), Path::new);
                return Err(NoScreen(format!(
                    "no display (neither DISPLAY nor WAYLAND_DISPLAY is set); to write a picture instead: \
                     glint render {} -o picture.png",
                    scene::shown(name)
                ))
                .into());
            }
            viewer::run(request, arguments.gpu.gpu)?;
            Ok(0)
        }
        Command::Info(arguments) => info::run(&arguments),
        Command::Render(arguments) => render_command::run(&arguments),
        Command::Record(arguments) => record_command::run(&arguments),
        Command::Index(arguments) => index_command::run(&arguments),
        Command::Methods(arguments) => listing::methods(arguments.json).map(|()| 0),
        Command::Scenes(arguments) => listing::scenes(arguments.json).map(|()| 0),
        Command::Study(arguments) => study_command::run(&arguments),
        Command::Doctor(arguments) => listing::doctor(arguments.json, arguments.gpu.gpu.as_deref()).map(|()| 0),
    }
}

/// Vulkan drivers look for a Wayland compositor, and where there is no XDG_RUNTIME_DIR (containers, cron, ssh) its library
/// prints an error about that, which means nothing here. With a folder that does not exist it finds nothing, silently. The
/// environment can only be changed safely for a new program, so the program replaces itself, once.
#[cfg(target_os = "linux")]
fn quiet_wayland() {
    use std::os::unix::process::CommandExt as _;
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(VARIABLE).is_none_or(|folder| folder.is_empty()) {
        let mut words = std::env::args_os();
        let name = words.next().unwrap_or_else(|| "glint".into());
        // Returns only if it fails, and then the message is all that is wrong.
        let _ =
            std::process::Command::new("/proc/self/exe").arg0(name).args(words).env(VARIABLE, "/nonexistent").exec();
    }
}

#[cfg(not(target_os = "linux"))]
fn quiet_wayland() {}

/// Logs to standard error what the environment variable GLINT_LOG selects (`debug`, `codec=trace`); nothing without it.
fn log_if_asked() {
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;

    let Ok(selection) = std::env::var("GLINT_LOG") else { return };
    match selection.parse::<tracing_subscriber::filter::Targets>() {
        Ok(targets) => {
            let lines = tracing_subscriber::fmt::layer().with_ansi(false).with_writer(terminal::Log);
            tracing_subscriber::registry().with(lines).with(targets).init();
        }
        Err(error) => complain(&format!("warning: GLINT_LOG: {error}; nothing is logged")),
    }
}
