//! Builds all tests in one go, runs their programs side by side, and keeps how long each test took.
//!
//! Cargo runs one test program after the other. Many of them share one software adapter among their tests, wait for a
//! window, or compute on one core, so half of the machine would idle. Here each program runs its tests one by one,
//! and one program more than there are cores runs at a time. The tests of a program take turns, so the time from one
//! line of its output to the next is the time of one test.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::io::{BufRead as _, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, ensure};
use cargo_metadata::{Message, Metadata, MetadataCommand, Package, TargetKind};

/// The test programs that take longest, longest first. They start first, so that none of them runs alone at the end.
const LONGEST: [&str; 12] = [
    "app",
    "tests::window",
    "render::laws",
    "render",
    "study::indirect",
    "tests::reach",
    "fuzz::minute",
    "tests::recording",
    "tests::baseline",
    "render::gloss",
    "tests::truth",
    "ghost::found",
];

/// A program that cargo built from tests.
#[derive(Clone, Debug)]
pub struct TestProgram {
    /// The crate and the target, for example `render::laws`.
    pub name: String,
    program: PathBuf,
    /// The folder of the package, in which cargo runs it.
    folder: PathBuf,
}

/// The time of one test, or of all tests of a program where `test` is empty.
#[derive(Clone, Debug)]
pub struct TestTime {
    pub program: String,
    pub test: String,
    pub time: Duration,
    /// The time on processors of a whole program and of what it ran, where the system says it. Other work on the machine
    /// makes `time` longer, and this hardly.
    pub processor: Option<Duration>,
}

/// What became of the tests.
#[derive(Debug, Default)]
pub struct Outcome {
    pub passed: usize,
    pub ignored: usize,
    /// The programs that failed, each with the tests that failed in it.
    pub failed: Vec<String>,
    pub times: Vec<TestTime>,
}

/// What cargo built.
pub struct Built {
    /// Whether everything was built.
    pub is_whole: bool,
    pub tests: Vec<TestProgram>,
    /// The program of this project, which the end-to-end tests run.
    pub glint: Option<PathBuf>,
}

/// Reads what cargo prints under `--message-format=json` while it builds tests, and lists their programs.
///
/// # Errors
/// If cargo does not start, or its output cannot be read.
pub fn build(mut cargo: Command) -> Result<Built> {
    let mut child = cargo.stdout(Stdio::piped()).spawn().context("cargo does not start")?;
    let output = BufReader::new(child.stdout.take().context("cargo's output")?);
    let (mut tests, mut glint) = (Vec::new(), None);
    for message in Message::parse_stream(output) {
        let Message::CompilerArtifact(artifact) = message? else { continue };
        let Some(program) = artifact.executable else { continue };
        if !artifact.profile.test {
            glint = glint.or((artifact.target.name == "glint").then(|| program.into()));
            continue;
        }
        let folder = artifact.manifest_path.parent().context("a manifest lies in a folder")?;
        let package = folder.file_name().context("the folder of a package has a name")?.to_owned();
        let is_unit = artifact.target.kind.iter().any(|kind| matches!(kind, TargetKind::Lib | TargetKind::Bin));
        let name = if is_unit { package.to_string() } else { format!("{package}::{}", artifact.target.name) };
        tests.push(TestProgram { name, program: program.into(), folder: folder.into() });
    }
    let rank = |name: &str| LONGEST.iter().position(|long| *long == name).unwrap_or(LONGEST.len());
    tests.sort_by_key(|test| (rank(&test.name), test.name.clone()));
    Ok(Built { is_whole: child.wait()?.success(), tests, glint })
}

/// Runs the programs, `at_once` of them at a time, with `variables` in their environment. Prints a line for each
/// program that ends, and the whole output of each that fails.
///
/// # Errors
/// If a program does not start.
pub fn run(programs: &[TestProgram], at_once: usize, variables: &[(&str, OsString)]) -> Result<Outcome> {
    let waiting = Mutex::new(programs.iter());
    let outcome = Mutex::new(Outcome::default());
    let problem = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..at_once {
            scope.spawn(|| {
                loop {
                    let next = waiting.lock().unwrap_or_else(PoisonError::into_inner).next();
                    let Some(program) = next else { return };
                    match run_one(program, variables) {
                        Ok(own) => report(program, own, &mut outcome.lock().unwrap_or_else(PoisonError::into_inner)),
                        Err(error) => *problem.lock().unwrap_or_else(PoisonError::into_inner) = Some(error),
                    }
                }
            });
        }
    });
    match problem.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(outcome.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

/// What one program printed and how it ended.
struct Finished {
    status: ExitStatus,
    output: String,
    errors: String,
    lines: TestLines,
    time: Duration,
    processor: Option<Duration>,
}

fn run_one(program: &TestProgram, variables: &[(&str, OsString)]) -> Result<Finished> {
    let mut command = Command::new(&program.program);
    command.arg("--test-threads=1").current_dir(&program.folder).env("CARGO_MANIFEST_DIR", &program.folder);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.envs(variables.iter().cloned());
    let start = Instant::now();
    let mut child = command.spawn().with_context(|| format!("{} does not start", program.program.display()))?;
    let (stdout, stderr) = (child.stdout.take().context("piped")?, child.stderr.take().context("piped")?);
    let errors = std::thread::spawn(move || text_of(stderr));
    let mut lines = TestLines::new(start);
    let mut output = String::new();
    let mut reader = BufReader::new(stdout);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line)? > 0 {
        let text = String::from_utf8_lossy(&line);
        lines.read(text.trim_end(), Instant::now());
        output.push_str(&text);
        line.clear();
    }
    let errors = errors.join().unwrap_or_default();
    let processor = std::fs::read_to_string(format!("/proc/{}/stat", child.id()));
    let processor = processor.ok().and_then(|stat| processor_time(&stat));
    let status = child.wait()?;
    Ok(Finished { status, output, errors, lines, time: start.elapsed(), processor })
}

/// The time on processors of a program and of the programs that it has waited for, by Linux's `/proc/PID/stat`: fields 14
/// to 17, in hundredths of a second.
fn processor_time(stat: &str) -> Option<Duration> {
    // The name of the program stands in brackets and may have any character.
    let (_, fields) = stat.rsplit_once(')')?;
    let mut fields = fields.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<u64>().ok();
    Some(Duration::from_millis((ticks()? + ticks()? + ticks()? + ticks()?) * 10))
}

fn text_of(mut stream: impl Read) -> String {
    let mut bytes = Vec::new();
    // What was read before a failure counts.
    let _ = stream.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Prints how a program ended, and adds its tests to the outcome of all.
fn report(program: &TestProgram, finished: Finished, outcome: &mut Outcome) {
    let Finished { status, output, errors, lines, time, processor } = finished;
    let is_good = status.success() && lines.failed.is_empty();
    let word = if is_good { "ok" } else { "FAILED" };
    let on_processors = processor.map_or(String::new(), |time| format!(", {:.1} s on processors", time.as_secs_f64()));
    let tests = lines.passed + lines.failed.len();
    println!("{word:>6} {:7.1} s  {} ({tests} tests{on_processors})", time.as_secs_f64(), program.name);
    // A skipped test says so on standard output of the test, which is shown only under --nocapture.
    if !is_good {
        println!("---- {} ({status}) ----\n{output}{errors}---- end of {} ----", program.name, program.name);
        let tests = if lines.failed.is_empty() { status.to_string() } else { lines.failed.join(", ") };
        outcome.failed.push(format!("{}: {tests}", program.name));
    }
    outcome.passed += lines.passed;
    outcome.ignored += lines.ignored;
    let named = |(test, time)| TestTime { program: program.name.clone(), test, time, processor: None };
    outcome.times.extend(lines.times.into_iter().map(named));
    outcome.times.push(TestTime { program: program.name.clone(), test: String::new(), time, processor });
}

/// Reads the lines of a test program that runs its tests one by one.
struct TestLines {
    last: Instant,
    passed: usize,
    ignored: usize,
    failed: Vec<String>,
    times: Vec<(String, Duration)>,
}

impl TestLines {
    fn new(start: Instant) -> Self {
        Self { last: start, passed: 0, ignored: 0, failed: Vec::new(), times: Vec::new() }
    }

    /// Takes a line that arrived at `now`: `test NAME ... RESULT`, or any other line.
    fn read(&mut self, line: &str, now: Instant) {
        let Some((name, result)) = line.strip_prefix("test ").and_then(|line| line.split_once(" ... ")) else { return };
        // `test NAME - should panic ... ok`
        let name = name.split(" - ").next().unwrap_or(name).to_owned();
        match result.split([' ', ',']).next() {
            Some("ok") => self.passed += 1,
            Some("ignored") => self.ignored += 1,
            // Everything else counts as a failure, so that no new word of the test harness hides one.
            _ => self.failed.push(name.clone()),
        }
        self.times.push((name, now.saturating_duration_since(self.last)));
        self.last = now;
    }
}

/// A table of times, longest first: the seconds of each program, with those on processors, then of each test.
pub fn table(times: &[TestTime]) -> String {
    let mut sorted: Vec<&TestTime> = times.iter().collect();
    sorted.sort_by_key(|time| (!time.test.is_empty(), std::cmp::Reverse(time.time)));
    let mut text = String::from("program,test,seconds,on processors\n");
    for TestTime { program, test, time, processor } in sorted {
        let processor = processor.map_or(String::new(), |time| format!("{:.2}", time.as_secs_f64()));
        let _ = writeln!(text, "{program},{test},{:.2},{processor}", time.as_secs_f64());
    }
    text
}

/// The programs that the changes since `commit` can touch: those of the changed packages, of all packages that depend
/// on them, and the end-to-end tests.
///
/// # Errors
/// If git or cargo cannot be asked.
pub fn touched(programs: Vec<TestProgram>, root: &Path, commit: &str) -> Result<Vec<TestProgram>> {
    let metadata = MetadataCommand::new().manifest_path(root.join("Cargo.toml")).no_deps().exec()?;
    let packages = touched_packages(&metadata, root, &changed_files(root, commit)?);
    let is_touched = |program: &TestProgram| packages.iter().any(|folder| program.folder.ends_with(folder));
    Ok(programs.into_iter().filter(is_touched).collect())
}

/// The files that differ from `commit`, with paths from the root, untracked ones too.
fn changed_files(root: &Path, commit: &str) -> Result<Vec<String>> {
    let mut files = Vec::new();
    for words in [&["diff", "--name-only", "-z", commit][..], &["ls-files", "--others", "--exclude-standard", "-z"]] {
        let output = Command::new("git").args(words).current_dir(root).output().context("git does not start")?;
        ensure!(output.status.success(), "git {}: {}", words.join(" "), String::from_utf8_lossy(&output.stderr));
        files.extend(String::from_utf8_lossy(&output.stdout).split_terminator('\0').map(str::to_owned));
    }
    Ok(files)
}

/// The folders of the packages, from the root, that the changed files can touch.
fn touched_packages(metadata: &Metadata, root: &Path, files: &[String]) -> BTreeSet<PathBuf> {
    let folder_of = |package: &Package| {
        let folder = package.manifest_path.parent().map(|folder| folder.as_std_path().to_owned()).unwrap_or_default();
        folder.strip_prefix(root).map(Path::to_owned).unwrap_or(folder)
    };
    let mut touched: BTreeSet<&str> = BTreeSet::new();
    for file in files {
        let owner = metadata.packages.iter().find(|package| Path::new(file).starts_with(folder_of(package)));
        let owner = owner.map(|package| package.name.as_str());
        let readers = OUTSIDE.iter().filter(|(start, _)| file.starts_with(start)).flat_map(|(_, readers)| *readers);
        touched.extend(owner.into_iter().chain(readers.copied()));
    }
    // Packages that depend on a touched one, for their tests too, until none is added.
    loop {
        let names_touched = |package: &&Package| package.dependencies.iter().any(|one| touched.contains(&*one.name));
        let more: Vec<_> =
            metadata.packages.iter().filter(names_touched).map(|package| package.name.as_str()).collect();
        let before = touched.len();
        touched.extend(more);
        if touched.len() == before {
            break;
        }
    }
    // The end-to-end tests run the program and read all sources. Some tests compare pages of docs with the code.
    touched.extend((!files.is_empty()).then_some("tests"));
    touched.extend(files.iter().any(|file| file.starts_with("docs/")).then_some(READERS_OF_DOCS).into_iter().flatten());
    metadata.packages.iter().filter(|package| touched.contains(package.name.as_str())).map(folder_of).collect()
}

/// Files outside of packages, by what their paths begin with, and the packages that they are compiled into.
const OUTSIDE: [(&str, &[&str]); 4] = [
    ("shaders/", &["render"]),
    ("assets/", &["glint", "study"]),
    ("Cargo.", &["param", "cloud", "measure", "xtask"]),
    (".cargo/", &["param", "cloud", "measure", "xtask"]),
];

/// The packages whose tests compare pages of docs with what the code says.
const READERS_OF_DOCS: [&str; 4] = ["glint", "render", "scene", "codec"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_of_a_test_is_that_between_two_lines() {
        let start = Instant::now();
        let mut lines = TestLines::new(start);
        let at = |seconds| start + Duration::from_secs(seconds);
        lines.read("running 3 tests", at(0));
        lines.read("test laws::one ... ok", at(2));
        lines.read("test laws::two - should panic ... ok", at(3));
        lines.read("test three ... ignored, takes an hour", at(3));
        lines.read("test four ... FAILED", at(9));
        assert_eq!((lines.passed, lines.ignored), (2, 1));
        assert_eq!(lines.failed, ["four"]);
        let seconds: Vec<_> = lines.times.iter().map(|(name, time)| (name.as_str(), time.as_secs())).collect();
        assert_eq!(seconds, [("laws::one", 2), ("laws::two", 1), ("three", 0), ("four", 6)]);
    }

    #[test]
    fn a_test_with_an_unknown_result_counts_as_failed() {
        let mut lines = TestLines::new(Instant::now());
        lines.read("test one ... vanished", Instant::now());
        assert_eq!((lines.passed, lines.failed.len()), (0, 1));
    }

    fn folders_touched_by(file: &str) -> Vec<String> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap();
        let metadata = MetadataCommand::new().manifest_path(root.join("Cargo.toml")).no_deps().exec().unwrap();
        let folders = touched_packages(&metadata, root, &[file.to_owned()]);
        folders.iter().map(|folder| folder.display().to_string()).collect()
    }

    #[test]
    fn a_change_touches_its_package_and_those_that_depend_on_it() {
        assert_eq!(folders_touched_by("crates/study/src/chart.rs"), ["app", "crates/fuzz", "crates/study", "tests"]);
        let by_shader = folders_touched_by("shaders/blend.wgsl");
        assert!(by_shader.contains(&"crates/render".to_owned()) && by_shader.contains(&"app".to_owned()));
        assert!(!by_shader.contains(&"crates/codec".to_owned()));
    }

    #[test]
    fn a_new_dependency_touches_every_package() {
        let metadata = MetadataCommand::new().no_deps().exec().unwrap();
        assert_eq!(folders_touched_by("Cargo.lock").len(), metadata.packages.len());
    }

    #[test]
    fn times_are_listed_by_program_and_test_from_the_longest() {
        let time = |program: &str, test: &str, seconds| TestTime {
            program: program.into(),
            test: test.into(),
            time: Duration::from_secs(seconds),
            processor: test.is_empty().then(|| Duration::from_secs(seconds * 2)),
        };
        let times = [time("render", "one", 2), time("render", "two", 3), time("render", "", 5), time("app", "", 7)];
        let expected = "program,test,seconds,on processors\napp,,7.00,14.00\nrender,,5.00,10.00\nrender,two,3.00,\n\
                        render,one,2.00,\n";
        assert_eq!(table(&times), expected);
    }

    #[test]
    fn the_time_on_processors_is_that_of_a_program_and_of_those_that_it_ran() {
        let stat = "77 (a (b) c) S 1 77 77 0 -1 4194304 900 0 0 0 150 25 1000 5 20 0 1 0 88 1 2";
        assert_eq!(processor_time(stat), Some(Duration::from_millis(11_800)));
        assert_eq!(processor_time("77 (a) S 1"), None);
    }
}
