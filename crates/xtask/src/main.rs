//! `cargo xtask run` and `cargo xtask test`: from a fresh clone to a window, and to a tested tree, in one command each.
//! `cargo xtask baseline` writes the checksums that pictures are compared with. `cargo xtask fuzz` looks for inputs
//! that break parsers. `cargo xtask package` makes packages for Linux, and `cargo xtask systems` checks the sources for
//! other systems.
//!
//! Those that run the program first look for what the system lacks (`needs`) and install it where that is allowed.
//! Everything else is left to cargo, in the one profile the project uses, so that running, checking and testing share
//! what they compile.

mod fuzz;
mod needs;
mod notices;
mod package;
mod suite;
mod swiftshader;
mod systems;
mod testing;

use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus, Stdio};

use anyhow::{Context as _, Result, bail, ensure};

use fuzz::Fuzzing;
use needs::{Display, Machine, Need, Remedy};
use testing::Selection;

const HELP: &str = "\
cargo xtask run [INPUT...]   Open the viewer on point clouds (.las, .laz, .ply), scene files (.toml) or built-in scenes.
                             Without INPUT: the built-in scene courtyard/pool. Without a display: renders the same to
                             glint.png in the current folder.
cargo xtask baseline         Write the checksums of pictures in tests/baseline anew, for this machine's adapter. Only where a
                             change is meant to change pictures; `cargo xtask test` fails where they differ.
cargo xtask fuzz [TARGET] [--minutes N]
                             Try odd inputs on the parsers, led by their coverage: TARGET, or all of crates/fuzz/seeds, for
                             10 minutes or N in all. Needs a C++ compiler. What breaks something is kept in target/fuzz/found.
cargo xtask package          Build a .deb and a .tar.gz of the program in target/package: with menu entry, icon, file types,
                             thumbnailer and the licences of all crates in it. Needs dpkg-deb, tar and objdump; fails where the
                             program needs a newer glibc than 2.35.
cargo xtask package --try    The same; then install the .deb in a bare Debian system in target/bare, and open a file there by its
                             type, on a virtual screen. Needs root, debootstrap, and a mirror of Debian that it finds.
cargo xtask systems          Type-check everything for Windows and macOS. Where the standard library of one of them is not
                             installed: our own sources by that of this system, with each cfg as it is there.
cargo xtask test --modes     Run the renderer's tests while the adapter acts like lesser ones: without 64-bit atomics, without
                             reading them (Metal, DirectX), timed by its own clock in one submit, with the limits that
                             WebGPU promises, and without timestamps.
cargo xtask test --swiftshader
                             Run the renderer's tests on SwiftShader, another Vulkan for processors, if it is found.
cargo xtask test             Check formatting and lints (where rustfmt and clippy are installed) and the links in comments, build
                             and run all tests. Keeps the seconds of each test in target/test-times.csv, and the commit that
                             passed in target/tested. Changes that are not committed leave that file as it was.
cargo xtask test --times     Do the same, and print the tests and the test programs that took longest.
cargo xtask test --changed   Run only the tests that the changes since the commit in target/tested can touch.

run, test and baseline look for what the system lacks first (Vulkan loader and driver, window libraries; for tests also Xvfb, xdotool,
ImageMagick and spirv-val) and install it with apt-get when run as root or where sudo asks for no password; otherwise they print
the line to type and stop.

Environment of `test`: GLINT_TEST_DATA names the folder of real and malformed point cloud files that tests read (default:
../shared/data beside the checkout). Tests that lack a Vulkan adapter or these files say that they are skipped;
GLINT_REQUIRE_GPU and GLINT_REQUIRE_DATA, when set, make that a failure. CI, when set, sets the first of them, and the
second where GLINT_TEST_DATA is set or ../shared/data exists.

Environment of `fuzz`: the files in the folder that GLINT_TEST_DATA names are seeds besides those that are kept.

Options of the program itself: cargo run --release --package glint -- --help";

/// Rendered when no INPUT is given and there is no display; the viewer opens it by itself.
const FIRST_SCENE: &str = "courtyard/pool";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        ["--help" | "-h" | "help", ..] | [_, "--help" | "-h"] => {
            println!("{HELP}");
            Ok(ExitCode::SUCCESS)
        }
        ["run", inputs @ ..] if inputs.iter().all(|input| !input.starts_with('-')) => run(inputs),
        ["test"] => testing::test(Selection::All, false),
        ["test", "--times"] => testing::test(Selection::All, true),
        ["test", "--changed"] => testing::test(Selection::Changed, false),
        ["test", "--modes"] => testing::test_modes(),
        ["test", "--swiftshader"] => testing::test_swiftshader(),
        ["baseline"] => testing::baseline(),
        ["package"] => package(false),
        ["package", "--try"] => package(true),
        ["systems"] => systems(),
        ["fuzz", words @ ..] => match Fuzzing::parse(words) {
            Some(fuzzing) => fuzz(&fuzzing),
            None => return misunderstood(),
        },
        _ => return misunderstood(),
    };
    result.unwrap_or_else(|error| {
        eprintln!("xtask: {error:#}");
        ExitCode::FAILURE
    })
}

fn misunderstood() -> ExitCode {
    eprintln!("{HELP}");
    ExitCode::from(2)
}

fn run(inputs: &[&str]) -> Result<ExitCode> {
    let display = Display::from_environment(std::env::consts::OS, |name| std::env::var(name).ok());
    provide(needs::needs_to_run(display))?;
    let mut command = cargo();
    // By its manifest, so that INPUT and glint.png are relative to where the user stands.
    command.args(["run", "--release", "--locked", "--package", "glint", "--manifest-path"]);
    command.arg(root()?.join("Cargo.toml")).arg("--");
    if display == Display::None {
        let inputs = if inputs.is_empty() { &[FIRST_SCENE] } else { inputs };
        println!(
            "No display (neither DISPLAY nor WAYLAND_DISPLAY is set): rendering {} to glint.png",
            inputs.join(" ")
        );
        command.arg("render").args(inputs).args(["-o", "glint.png"]);
    } else {
        command.args(inputs);
    }
    Ok(exit_code(status(&mut command)?))
}

fn package(is_tried: bool) -> Result<ExitCode> {
    let root = root()?;
    let mut command = cargo();
    command.args(["build", "--release", "--locked", "--package", "glint"]).current_dir(&root);
    let status = status(&mut command)?;
    if !status.success() {
        return Ok(exit_code(status));
    }
    let target = target_folder(&root);
    let made = package::package(cargo, &root, &target)?;
    for path in &made {
        println!("{}", path.display());
    }
    if !is_tried {
        return Ok(ExitCode::SUCCESS);
    }
    let mut command = Command::new("sh");
    command.arg(root.join("crates/xtask/bare_system.sh")).arg(&made[0]).arg(target.join("bare"));
    Ok(exit_code(self::status(&mut command)?))
}

fn systems() -> Result<ExitCode> {
    let root = root()?;
    let failed = systems::check(cargo, &root, &target_folder(&root))?;
    println!("== failed: {}", if failed.is_empty() { "none".into() } else { failed.join(", ") });
    Ok(if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn fuzz(fuzzing: &Fuzzing) -> Result<ExitCode> {
    let files = std::env::var_os("GLINT_TEST_DATA").map(PathBuf::from);
    let is_clean = fuzz::fuzz(cargo(), &root()?, fuzzing, files.as_deref())?;
    Ok(if is_clean { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Installs what is missing, or says how to. Fails if the user has to act first.
fn provide(needs: Vec<Need>) -> Result<()> {
    let machine = Machine::look();
    let missing = machine.missing(needs);
    if missing.is_empty() {
        return Ok(());
    }
    let names = names(&missing);
    let root = succeeds(Command::new("sh").args(["-c", "test $(id -u) -eq 0"]));
    let sudo = !root && machine.has("sudo") && succeeds(Command::new("sudo").args(["-n", "true"]));
    match needs::remedy(&missing, &machine, root, sudo) {
        Remedy::Install(commands) => {
            println!("Missing: {names}. Installing:");
            for words in commands {
                println!("  {}", words.join(" "));
                let status = status(Command::new(&words[0]).args(&words[1..]))?;
                ensure!(status.success(), "`{}` failed ({status}); see its messages above", words.join(" "));
            }
            let missing = Machine::look().missing(missing);
            ensure!(missing.is_empty(), "still missing after the installation: {}", self::names(&missing));
            Ok(())
        }
        Remedy::Tell(line) => bail!("missing: {names}. Type this, then run the command again:\n  {line}"),
        Remedy::Unknown => {
            eprintln!("xtask: not found, and there is no apt-get to install it with: {names}. Going on without.");
            Ok(())
        }
    }
}

fn names(needs: &[Need]) -> String {
    needs.iter().map(|need| need.what).collect::<Vec<_>>().join(", ")
}

/// The cargo that runs this program.
fn cargo() -> Command {
    Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
}

/// The checkout this program was built in.
fn root() -> Result<PathBuf> {
    let own = std::env::var_os("CARGO_MANIFEST_DIR").context("start this with `cargo xtask`")?;
    // Not canonical: such a path of Windows begins with a mark behind which `..` and `/` mean nothing.
    Ok(Path::new(&own).ancestors().nth(2).context("this is not in crates/xtask of a checkout")?.to_owned())
}

/// Where cargo puts what it builds.
fn target_folder(root: &Path) -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), |folder| root.join(folder))
}

fn installed(subcommand: &str) -> bool {
    succeeds(cargo().args([subcommand, "--version"]))
}

fn succeeds(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

fn status(command: &mut Command) -> Result<ExitStatus> {
    command.status().with_context(|| format!("{} does not start", command.get_program().display()))
}

/// The exit status of a child as this program's own; a signal counts as failure.
fn exit_code(status: ExitStatus) -> ExitCode {
    status.code().and_then(|code| u8::try_from(code).ok()).map_or(ExitCode::FAILURE, ExitCode::from)
}
