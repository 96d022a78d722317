//! `glint`: reads the command line, does what it says, and ends with the exit status that docs and scripts rely on:
//! 0 done, 1 the work failed, 2 bad usage or unreadable input, 3 nothing to show it on.

mod command_line;
mod failure;
mod index_command;
mod info;
mod listing;
mod picture_file;
mod progress_bar;
mod render_command;
mod study_command;
mod subject;
mod truth;
mod viewer;

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser as _;
use command_line::{Command, CommandLine};
use failure::NoScreen;

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
            let _ = error.print();
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            complain(&command_line::brief(&error));
            return ExitCode::from(2);
        }
    };
    match std::panic::catch_unwind(move || run(line)) {
        Ok(Ok(status)) => ExitCode::from(status),
        Ok(Err(error)) => {
            complain(&format!("{error:#}"));
            ExitCode::from(failure::exit_status(&error))
        }
        Err(_) => ExitCode::FAILURE,
    }
}

/// The exit status; what is not an error may still have one that is not 0 (`info` of files of which one is unreadable).
fn run(line: CommandLine) -> anyhow::Result<u8> {
    match line.command.unwrap_or(Command::View(line.view)) {
        Command::View(arguments) => {
            // Checked before the display: a wrong name is wrong everywhere.
            let request = world::resolve(&arguments.inputs);
            request.check()?;
            if !has_display() {
                let name = arguments.inputs.first().map_or("five-mirrors/sphere", String::as_str);
                return Err(NoScreen(format!(
                    "no display (neither DISPLAY nor WAYLAND_DISPLAY is set)\n\
                     to write a picture instead: glint render {name} -o picture.png"
                ))
                .into());
            }
            viewer::run(request, arguments.gpu.gpu)?;
            Ok(0)
        }
        Command::Info(arguments) => info::run(&arguments),
        Command::Render(arguments) => render_command::run(&arguments),
        Command::Index(arguments) => index_command::run(&arguments),
        Command::Methods(arguments) => listing::methods(arguments.json).map(|()| 0),
        Command::Scenes(arguments) => listing::scenes(arguments.json).map(|()| 0),
        Command::Study(arguments) => study_command::run(&arguments),
        Command::Doctor(arguments) => listing::doctor(arguments.json, arguments.gpu.gpu.as_deref()).map(|()| 0),
    }
}

/// Whether there is a desktop to open a window on. Windows and macOS always have one.
pub fn has_display() -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(not(all(unix, not(target_os = "macos")))) || set("DISPLAY") || set("WAYLAND_DISPLAY")
}

/// Writes a result to standard output. A reader that has seen enough (`| head`) is no error.
///
/// # Errors
/// If the output cannot be written, as on a full disk.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut output = std::io::stdout().lock();
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(anyhow::Error::from(error).context("standard output"))
        }
        _ => Ok(()),
    }
}

/// Writes an error or a warning to standard error. There is nobody to tell if that fails.
pub fn complain(message: &str) {
    let _ = writeln!(std::io::stderr(), "glint: {message}");
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

/// Where settings and recent files are kept: `GLINT_CONFIG_DIR`, else the platform's place; `None` without a home.
pub fn settings_folder() -> Option<PathBuf> {
    let platform = || Some(directories::ProjectDirs::from("", "", "glint")?.config_dir().to_owned());
    std::env::var_os("GLINT_CONFIG_DIR").map(PathBuf::from).or_else(platform)
}

/// Logs to standard error what the environment variable GLINT_LOG selects (`debug`, `codec=trace`); nothing without it.
fn log_if_asked() {
    use tracing_subscriber::layer::SubscriberExt as _;
    use tracing_subscriber::util::SubscriberInitExt as _;

    let Ok(selection) = std::env::var("GLINT_LOG") else { return };
    match selection.parse::<tracing_subscriber::filter::Targets>() {
        Ok(targets) => {
            let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
            tracing_subscriber::registry().with(lines).with(targets).init();
        }
        Err(error) => complain(&format!("warning: GLINT_LOG: {error}; nothing is logged")),
    }
}
