//! `cargo xtask test`, `test --modes` and `baseline`: what is checked and tested, in which order, and with which variables.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus};
use std::time::Instant;

use anyhow::{Context as _, Result};

use crate::shell::{cargo, exit_code, installed, provide, root, status, target_folder};
use crate::suite::{self, Built};
use crate::{needs, swiftshader};

/// Which tests `cargo xtask test` runs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Selection {
    All,
    /// The tests that the changes since the last tested commit can touch.
    Changed,
}

/// A check before the tests: a command of cargo.
struct Check {
    name: &'static str,
    arguments: &'static [&'static str],
    /// Whether the check is left out if its tool is missing: rustup's minimal profile comes without it.
    optional: bool,
}

const CHECKS: [Check; 3] = [
    Check { name: "format", arguments: &["fmt", "--all", "--check"], optional: true },
    Check {
        name: "lint",
        arguments: &["clippy", "--release", "--workspace", "--all-targets", "--locked", "--", "-D", "warnings"],
        optional: true,
    },
    Check {
        name: "links between comments",
        arguments: &[
            "doc",
            "--release",
            "--workspace",
            "--no-deps",
            "--document-private-items",
            "--locked",
            "--config",
            "build.rustdocflags=[\"-Dwarnings\"]",
        ],
        optional: false,
    },
];

/// How many of the longest tests `--times` prints.
const LONGEST_PRINTED: usize = 40;

/// `cargo xtask test`: the checks, one build, and the tests.
pub fn test(selection: Selection, prints_times: bool) -> Result<ExitCode> {
    provide(needs::needs_to_test())?;
    if let Err(problem) = provide(needs::needs_to_decode()) {
        eprintln!("xtask: {problem:#}\nxtask: going on; no test decodes films.");
    }
    let root = root()?;
    let commit = clean_commit(&root);
    let mut clock = Clock { start: Instant::now(), steps: Vec::new() };
    if !checks_pass(&root, &mut clock)? {
        return Ok(ExitCode::FAILURE);
    }
    println!("== build");
    let mut building = cargo();
    building.args(["test", "--release", "--workspace", "--locked", "--no-run"]);
    building.arg("--message-format=json-render-diagnostics").current_dir(&root);
    let Built { is_whole, tests: mut programs, glint } = suite::build(building)?;
    clock.note("build");
    if !is_whole {
        println!("== build failed ({})", clock.steps.join(", "));
        return Ok(ExitCode::FAILURE);
    }
    let tested = target_folder(&root).join("tested");
    if selection == Selection::Changed {
        let commit = std::fs::read_to_string(&tested)
            .with_context(|| format!("{}: `cargo xtask test` writes it when it passes", tested.display()))?;
        programs = suite::touched(programs, &root, commit.trim())?;
    }
    // One more than cores: programs that open windows, fetch files or wait for a clock leave their core free meanwhile.
    let at_once = 1 + std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    println!("== test: {} programs, {at_once} at a time", programs.len());
    let mut environment = environment(&root)?;
    environment.extend(glint.map(|program| ("GLINT_TEST_PROGRAM", program.into_os_string())));
    let mut outcome = suite::run(&programs, at_once, &environment)?;
    clock.note("test");
    let mut comments = cargo();
    comments.args(["test", "--release", "--workspace", "--locked", "--doc", "--quiet"]).current_dir(&root);
    if !status(&mut comments)?.success() {
        outcome.failed.push("tests in comments".into());
    }
    clock.note("tests in comments");
    let times = suite::table(&outcome.times);
    std::fs::write(target_folder(&root).join("test-times.csv"), &times)?;
    if prints_times {
        let longest = |is_test: bool| times.lines().skip(1).filter(move |line| line.contains(",,") != is_test);
        longest(false).chain(longest(true).take(LONGEST_PRINTED)).for_each(|line| println!("{line}"));
    }
    for failure in &outcome.failed {
        println!("== failed: {failure}");
    }
    let is_passed = outcome.failed.is_empty();
    println!("== {} ({})", if is_passed { "passed" } else { "failed" }, clock.steps.join(", "));
    println!("{} passed, {} failed, {} skipped", outcome.passed, outcome.failed.len(), outcome.ignored);
    // What changed while the tests ran was not tested as a whole.
    if let Some(commit) = commit.filter(|before| is_passed && clean_commit(&root).as_ref() == Some(before))
        && selection == Selection::All
    {
        std::fs::write(tested, commit)?;
    }
    Ok(if is_passed { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Whether all checks before the build pass.
fn checks_pass(root: &Path, clock: &mut Clock) -> Result<bool> {
    for Check { name, arguments, optional } in CHECKS {
        let line = format!("cargo {}", arguments.join(" "));
        if optional && !installed(arguments[0]) {
            println!("== {name}: skipped, cargo {} is not installed", arguments[0]);
            continue;
        }
        println!("== {name}: {line}");
        let status = status(cargo().args(arguments).current_dir(root))?;
        clock.note(name);
        if !status.success() {
            println!("== {name} failed ({}): {line}", clock.steps.join(", "));
            return Ok(false);
        }
    }
    Ok(true)
}

/// The steps of a run, each with its seconds.
struct Clock {
    start: Instant,
    steps: Vec<String>,
}

impl Clock {
    /// Notes that the step `name` has ended.
    fn note(&mut self, name: &str) {
        self.steps.push(format!("{name} {:.0} s", self.start.elapsed().as_secs_f64()));
        self.start = Instant::now();
    }
}

/// The variables that tests see beside those of this process. Where CI is set, what tests lack is a failure.
fn environment(root: &Path) -> Result<Vec<(&'static str, OsString)>> {
    let mut environment = Vec::new();
    if let Some(folder) = runtime_folder()? {
        environment.push(("XDG_RUNTIME_DIR", folder.into()));
    }
    // Programs keep all cores busy. Threads of software Vulkan beside them would only wake and wait for one another,
    // which takes a quarter of the time of many small passes.
    if std::env::var_os("LP_NUM_THREADS").is_none() {
        environment.push(("LP_NUM_THREADS", "0".into()));
    }
    if std::env::var_os("CI").is_some() {
        environment.push(("GLINT_REQUIRE_GPU", "1".into()));
        if std::env::var_os("GLINT_TEST_DATA").is_some() || root.join("../shared/data").is_dir() {
            environment.push(("GLINT_REQUIRE_DATA", "1".into()));
        }
    }
    Ok(environment)
}

/// The last commit, if the working tree is as it left it.
fn clean_commit(root: &Path) -> Option<String> {
    let git = |words: &[&str]| {
        let output = Command::new("git").args(words).current_dir(root).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    git(&["status", "--porcelain"]).filter(String::is_empty).and_then(|_| git(&["rev-parse", "HEAD"]))
}

/// What an adapter can act like: words of the variable GLINT_ACT_LIKE (crates/render/src/gpu.rs).
const MODES: [&str; 6] = [
    "narrow-atomics",
    "blind-atomics",
    "gpu-clock",
    "low-limits",
    "no-timestamps,gpu-clock",
    "narrow-atomics,gpu-clock,low-limits",
];

pub fn test_modes() -> Result<ExitCode> {
    provide(needs::needs_to_test())?;
    let mut failed = Vec::new();
    for mode in MODES {
        println!("== {mode}");
        if !test_renderer([("GLINT_ACT_LIKE", mode)])?.success() {
            failed.push(mode);
        }
    }
    println!("== {} modes, failed: {}", MODES.len(), if failed.is_empty() { "none".into() } else { failed.join("; ") });
    Ok(if failed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

pub fn test_swiftshader() -> Result<ExitCode> {
    provide(needs::needs_to_test())?;
    let manifest = swiftshader::manifest(&target_folder(&root()?))?;
    // The newer name of the variable, and the older one.
    let manifest = manifest.as_path();
    Ok(exit_code(test_renderer(["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].map(|variable| (variable, manifest)))?))
}

/// Runs the renderer's tests with these variables.
fn test_renderer<V: AsRef<std::ffi::OsStr>>(
    variables: impl IntoIterator<Item = (&'static str, V)>,
) -> Result<ExitStatus> {
    let root = root()?;
    let runtime = runtime_folder()?;
    let mut command = cargo();
    // The whole workspace is selected, so that dependencies are compiled with the features they always have.
    command.args(["test", "--release", "--workspace", "--locked", "--no-fail-fast"]);
    for test in render_tests(&root)? {
        command.args(["--test", &test]);
    }
    command.current_dir(&root).envs(variables).env("GLINT_REQUIRE_GPU", "1");
    command.envs(runtime.as_ref().map(|folder| ("XDG_RUNTIME_DIR", folder)));
    status(&mut command)
}

/// The names of the renderer's tests.
fn render_tests(root: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(root.join("crates/render/tests"))? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "rs") {
            names.extend(path.file_stem().and_then(|name| name.to_str()).map(str::to_owned));
        }
    }
    names.sort();
    Ok(names)
}

pub fn baseline() -> Result<ExitCode> {
    provide(needs::needs_to_test())?;
    let mut command = cargo();
    command.args(["test", "--release", "--workspace", "--locked", "--test", "baseline"]);
    command.current_dir(root()?).env("UPDATE", "1").env("GLINT_REQUIRE_GPU", "1");
    Ok(exit_code(status(&mut command)?))
}

/// A private folder for `XDG_RUNTIME_DIR` where the system gives none (containers, CI): without it Mesa and the Wayland
/// libraries complain on standard error in every test. One per checkout, so nothing piles up.
pub fn runtime_folder() -> Result<Option<PathBuf>> {
    if std::env::var_os("XDG_RUNTIME_DIR").is_some() {
        return Ok(None);
    }
    let folder = root()?.join("target/runtime");
    let mut builder = std::fs::DirBuilder::new();
    // The specification asks for access by its owner alone. It is one of Unix.
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(&folder)?;
    Ok(Some(folder))
}
