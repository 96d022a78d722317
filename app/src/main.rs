//! `glint`: parses the command line, runs the command, and ends with an exit status that scripts rely on: 0 success, 1
//! the work failed, 2 bad usage or unreadable input, 3 no display or adapter, 130 interrupted (143 by SIGTERM, 129 by
//! SIGHUP).

mod commands;
mod overlays;
mod shared;
mod system;
mod viewer;

use std::path::{Path, PathBuf};

use clap::{CommandFactory as _, Parser as _};
use commands::{compare, export, ghosts, index, info, listing, measure, profile, record, render, study, surfaces};
use shared::command_line::{self, Command, CommandLine};
use system::failure::{self, NoScreen};
use system::terminal::complain;
use system::{environment, fetching, interrupt, progress_bar, terminal};

fn main() {
    quiet_wayland();
    log_if_asked();
    // A panic is a bug in the program. The user gets one line that names its place, not a back-trace.
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or(String::new(), |place| format!(" at {}:{}", place.file(), place.line()));
        let message = panic.payload_as_str().unwrap_or("no message");
        complain(&format!("internal error{place}: {message}"));
    }));
    let status = match CommandLine::try_parse() {
        Ok(line) => std::panic::catch_unwind(move || run(line)).map_or(failure::FAILED, ended),
        // Help and version are results, not errors.
        Err(error) if !error.use_stderr() => ended(terminal::print(error.render().to_string().lines()).map(|()| 0)),
        Err(error) => {
            complain(&command_line::brief(error));
            failure::UNUSABLE
        }
    };
    interrupt::leave(status)
}

/// Reports an error, if there is one, and returns the exit status. Any error after Ctrl-C, or after a signal to end, counts
/// as an interruption.
fn ended(outcome: anyhow::Result<u8>) -> u8 {
    outcome.unwrap_or_else(|error| {
        let error = if interrupt::is_wanted() { failure::Interrupted.into() } else { error };
        complain(&failure::message(&error));
        match failure::exit_status(&error) {
            failure::INTERRUPTED => interrupt::status(),
            status => status,
        }
    })
}

/// Runs the command and returns its exit status. That may differ from 0 without an error: `info` returns 2 if one of
/// several files is unreadable.
fn run(line: CommandLine) -> anyhow::Result<u8> {
    if let Some(folder) = world::pipelines_folder() {
        ::render::keep_pipelines_in(folder);
    }
    if !line.columns.is_empty() {
        codec::name_columns(&line.columns).map_err(|problem| failure::usage(format!("--columns: {problem}")))?;
    }
    use_network(line.authorization)?;
    let command = line.command.unwrap_or(Command::View(line.view));
    // The viewer sets a handler of its own, since its window has to be woken.
    if !matches!(command, Command::View(_)) {
        interrupt::catch(|| {});
    }
    match command {
        Command::View(arguments) => {
            // The names are checked before the display: a wrong name is an error on every machine.
            let mut request = world::resolve(&arguments.inputs);
            mistaken(&request)?;
            request.check()?;
            let start = viewer::Start::new(&arguments, &mut request)?;
            if !environment::has_display() {
                let name = arguments.inputs.first().map_or_else(|| PathBuf::from(world::first_scene()), PathBuf::from);
                return Err(NoScreen(format!(
                    "no display (neither DISPLAY nor WAYLAND_DISPLAY is set); to write a picture instead: \
                     glint render {} -o picture.png",
                    scene::shown(&name)
                ))
                .into());
            }
            viewer::run(request, start, arguments.gpu.gpu)?;
            Ok(0)
        }
        Command::Info(arguments) => info::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Index(arguments) => index::run(&arguments),
        Command::Methods(arguments) => listing::methods(arguments.json).map(|()| 0),
        Command::Scenes(arguments) => listing::scenes(arguments.json).map(|()| 0),
        Command::Study(arguments) => study::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Profile(arguments) => profile::run(&arguments),
        Command::Measure(arguments) => measure::run(&arguments),
        Command::Surfaces(arguments) => surfaces::run(&arguments),
        Command::Ghosts(arguments) => ghosts::run(&arguments),
        Command::Doctor(arguments) => listing::doctor(arguments.json, arguments.gpu.gpu.as_deref()).map(|()| 0),
    }
}

/// Says how addresses are opened, should there be any.
///
/// # Errors
/// If the authorization, the limit or one of the servers is none.
fn use_network(authorization: Option<String>) -> anyhow::Result<()> {
    const LIMIT: &str = "GLINT_FETCHED_BYTES";
    const SERVERS: &str = "GLINT_SERVERS";
    let mut network = codec::Network { folder: world::fetched_folder(), authorization, ..Default::default() };
    if let Some(text) = std::env::var_os(LIMIT).filter(|text| !text.is_empty()) {
        let limit = text.to_str().and_then(|text| text.parse::<param::Bytes>().ok());
        network.limit = limit.ok_or_else(|| failure::usage(format!("{LIMIT}: expected bytes, such as 10 GiB")))?.0;
    }
    let servers = std::env::var_os(SERVERS).unwrap_or_default();
    for server in servers.to_string_lossy().split_whitespace() {
        if !codec::trust_address(Path::new(server)) {
            let problem = "expected addresses such as http://data.lan:8080, with blanks between them";
            return Err(failure::usage(format!("{SERVERS}: `{}`: {problem}", scene::shown(Path::new(server)))));
        }
    }
    network.watch = Box::new(|address, bytes| {
        let is_wanted = bytes.is_none_or(|(done, total)| {
            progress_bar::fetched(done, total);
            fetching::note(address, done, total)
        });
        is_wanted && !interrupt::is_wanted()
    });
    codec::use_network(network).map_err(|problem| failure::usage(format!("--authorization: {problem}")))
}

/// Refuses a first word that names nothing to open and is nearly the name of a command.
///
/// # Errors
/// It is; names the command.
fn mistaken(request: &world::Request) -> anyhow::Result<()> {
    let Some(world::Input::Unknown { name: word, .. }) = request.inputs.first() else { return Ok(()) };
    let line = CommandLine::command();
    match param::nearest(word, line.get_subcommands().map(clap::Command::get_name)) {
        Some(near) => {
            Err(failure::usage(format!("{word}: neither a file nor a command; did you mean `glint {near}`?")))
        }
        None => Ok(()),
    }
}

/// Vulkan drivers look for a Wayland compositor. Without XDG_RUNTIME_DIR (in containers, cron, ssh) the Wayland library
/// prints an error about that, which does not matter here. With a folder that does not exist it finds no compositor and
/// prints nothing. The environment can be changed safely only for a new process, so the program replaces itself, once.
#[cfg(target_os = "linux")]
fn quiet_wayland() {
    use std::os::unix::process::CommandExt as _;
    const VARIABLE: &str = "XDG_RUNTIME_DIR";
    if std::env::var_os(VARIABLE).is_none_or(|folder| folder.is_empty()) {
        let mut words = std::env::args_os();
        let name = words.next().unwrap_or_else(|| "glint".into());
        // `exec` returns only if it fails. Then the message of the Wayland library is the only harm.
        let _ =
            std::process::Command::new("/proc/self/exe").arg0(name).args(words).env(VARIABLE, "/nonexistent").exec();
    }
}

#[cfg(not(target_os = "linux"))]
fn quiet_wayland() {}

/// Logs to standard error what the environment variable GLINT_LOG selects (`debug`, `codec=trace`). Logs nothing if it
/// is not set.
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
