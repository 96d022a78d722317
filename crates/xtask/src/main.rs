//! `cargo xtask run` and `cargo xtask test`: from a fresh clone to a window, and to a tested tree, in one command each.
//! `cargo xtask baseline` writes the checksums that pictures are compared with. `cargo xtask fuzz` looks for inputs
//! that break parsers, `cargo xtask soak` uses the window at random. `cargo xtask package` makes packages for Linux, and `cargo xtask systems` checks the sources for
//! other systems.
//!
//! Commands that run the program first look for what the system lacks (`needs`) and install it where that is allowed.
//! Everything else is left to cargo, in the one profile the project uses, so that running, checking and testing share
//! what they compile.

mod fuzz;
mod needs;
mod notices;
mod package;
mod shell;
mod soak;
mod suite;
mod swiftshader;
mod systems;
mod testing;

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use anyhow::Result;

use fuzz::Fuzzing;
use needs::Display;
use shell::{cargo, exit_code, provide, root, status, target_folder};
use soak::Soaking;
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
cargo xtask soak [--minutes N] [--seed N]
                             Use the window at random for an hour or N minutes, on a private virtual screen: keys, clicks, drags,
                             files opened and closed. Fails where the program ends, panics, does not answer, or takes more and
                             more memory or open files. The same seed does the same. Writes a table and a chart to target/soak.
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

run, test and baseline look for what the system lacks first (Vulkan loader and driver, window libraries; for tests also Xvfb, xdotool
and spirv-val) and install it with apt-get when run as root or where sudo asks for no password; otherwise they print
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
        ["soak", words @ ..] => match Soaking::parse(words) {
            Some(soaking) => soak::soak(&soaking),
            None => return misunderstood(),
        },
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
    Ok(exit_code(shell::status(&mut command)?))
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
