//! `cargo xtask systems`: type-checks the workspace for Windows and macOS, as far as their standard libraries are
//! installed here. That compiles what is written for them alone, and runs nothing.

use std::path::Path;
use std::process::{Command, ExitStatus};

use anyhow::{Context as _, Result, ensure};

/// A system that the program is meant for, and the C compiler that some crates ask for when they are checked for it.
struct System {
    target: &'static str,
    compiler: Option<&'static str>,
}

const SYSTEMS: [System; 2] = [
    System { target: "x86_64-pc-windows-gnu", compiler: Some("x86_64-w64-mingw32-gcc") },
    System { target: "aarch64-apple-darwin", compiler: None },
];

/// Checks for all systems, `cargo` being a new command of cargo's. Returns the names of those that fail.
///
/// # Errors
/// A tool does not start, or no other system's library is installed.
pub fn check(cargo: impl Fn() -> Command, root: &Path) -> Result<Vec<&'static str>> {
    let (mut checked, mut failed) = (0, Vec::new());
    for System { target, compiler } in &SYSTEMS {
        if !has_library(target)? {
            println!("== {target}: skipped, its standard library is not installed (rustup target add {target})");
            continue;
        }
        // Tests have a crate with C in it.
        let has_compiler = compiler.is_none_or(|name| Command::new(name).arg("--version").output().is_ok());
        let targets = if has_compiler { &["--all-targets"][..] } else { &["--lib", "--bins"] };
        println!("== {target}: cargo check {}", targets.join(" "));
        let mut command = cargo();
        command.args(["check", "--release", "--workspace", "--locked", "--target", target]).args(targets);
        command.current_dir(root);
        checked += 1;
        if !status(&mut command)?.success() {
            failed.push(*target);
        }
    }
    ensure!(checked > 0, "no standard library of another system is installed; rustup target add {}", SYSTEMS[0].target);
    Ok(failed)
}

/// Whether the compiler has the standard library of a target.
fn has_library(target: &str) -> Result<bool> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).args(["--print", "target-libdir", "--target", target]).output();
    let output = output.context("rustc does not start")?;
    let folder = String::from_utf8_lossy(&output.stdout);
    Ok(std::fs::read_dir(folder.trim()).is_ok_and(|mut files| files.next().is_some()))
}

fn status(command: &mut Command) -> Result<ExitStatus> {
    command.status().context("cargo does not start")
}
