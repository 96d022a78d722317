//! `cargo xtask fuzz`: runs targets of `crates/fuzz` under libFuzzer, one after the other. docs/fuzzing.md explains the
//! results.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};

/// What `cargo xtask fuzz` runs.
#[derive(Debug, PartialEq)]
pub struct Fuzzing {
    /// The target to run; `None` for all.
    pub target: Option<String>,
    /// The time for all targets together.
    pub time: Duration,
}

/// The time if the command line gives none.
const USUAL_TIME: Duration = Duration::from_secs(10 * 60);
/// The longest time: a week.
const MOST_MINUTES: f64 = 7.0 * 24.0 * 60.0;

impl Fuzzing {
    /// Parses the words after `fuzz`; `None` if they are not understood.
    pub fn parse(words: &[&str]) -> Option<Self> {
        let mut fuzzing = Self { target: None, time: USUAL_TIME };
        let mut words = words.iter();
        while let Some(word) = words.next() {
            match *word {
                "--minutes" => {
                    let minutes: f64 = words.next()?.parse().ok()?;
                    let is_time = minutes > 0.0 && minutes <= MOST_MINUTES;
                    fuzzing.time = is_time.then(|| Duration::from_secs_f64(60.0 * minutes))?;
                }
                target if fuzzing.target.is_none() && !target.starts_with('-') => fuzzing.target = Some(target.into()),
                _ => return None,
            }
        }
        Some(fuzzing)
    }
}

/// Targets that read point cloud files: how their names start, and how the names of such files end. Real files are
/// added to their seeds.
const READ_FILES: [(&str, &str); 4] = [("las_", ".las"), ("laz_", ".laz"), ("copc", ".copc.laz"), ("ply_", ".ply")];
/// The most bytes of a real file: decoding longer ones takes the time of hundreds of short ones.
const MOST_FILE_BYTES: u64 = 64 << 10;
/// The most bytes of an input, for targets with real files and for the others.
const MOST_BYTES: [u64; 2] = [2 * MOST_FILE_BYTES, 32 << 10];
/// The memory that libFuzzer's process may take before a run counts as a finding, in MiB.
const MOST_RESIDENT: usize = 2048;
/// The time that a single run may take before it counts as one that does not end, in seconds.
const MOST_SECONDS: usize = 60;

/// Builds the targets of the checkout `root` with coverage and runs them. Returns false if something was found.
pub fn fuzz(mut cargo: Command, root: &Path, fuzzing: &Fuzzing, files: Option<&Path>) -> Result<bool> {
    let seeds = root.join("crates/fuzz/seeds");
    let known = targets(&seeds)?;
    let wanted: Vec<&String> = match &fuzzing.target {
        None => known.iter().collect(),
        Some(name) => known.iter().filter(|known| *known == name).collect(),
    };
    if wanted.is_empty() {
        bail!("no target of this name; there are {}", known.join(", "));
    }
    // Build the whole workspace, so that dependencies are compiled with the features they always have.
    cargo.args(["build", "--release", "--workspace", "--locked", "--features", "fuzz/guided", "--bin", "guided"]);
    cargo.current_dir(root).env("RUSTC_WORKSPACE_WRAPPER", root.join("crates/fuzz/coverage.sh"));
    ensure!(crate::shell::status(&mut cargo)?.success(), "the targets are not built; they need a C++ compiler besides");

    let work = root.join("target/fuzz");
    let time = fuzzing.time.div_f64(wanted.len() as f64);
    let mut found = Vec::new();
    let mut total = 0;
    for name in wanted {
        println!("== {name}: {:.0} s", time.as_secs_f64());
        let corpus = work.join("corpus").join(name);
        std::fs::create_dir_all(&corpus)?;
        std::fs::create_dir_all(work.join("found"))?;
        let mut command = Command::new(root.join("target/release/guided"));
        command.env("GLINT_FUZZ_TARGET", name);
        command.arg(format!("-artifact_prefix={}/{name}-", work.join("found").display()));
        let ending = READ_FILES.iter().find(|(start, _)| name.starts_with(start)).map(|(_, ending)| *ending);
        let most = MOST_BYTES[usize::from(ending.is_none())];
        command.args([format!("-max_total_time={}", time.as_secs().max(1)), format!("-max_len={most}")]);
        command.args([format!("-rss_limit_mb={MOST_RESIDENT}"), format!("-timeout={MOST_SECONDS}")]);
        command.arg("-print_final_stats=1").arg(corpus).arg(seeds.join(name));
        if let Some((files, ending)) = files.zip(ending) {
            let copies = work.join("files").join(name);
            std::fs::create_dir_all(&copies)?;
            copy_small(files, ending, &copies)?;
            command.arg(copies);
        }
        let (runs, is_clean) = watch(&mut command)?;
        total += runs;
        println!("== {name}: {runs} runs, {}", if is_clean { "nothing found" } else { "FOUND, see above" });
        found.extend((!is_clean).then_some(name.as_str()));
    }
    println!("== {total} runs, found in: {}", if found.is_empty() { "nothing".into() } else { found.join(", ") });
    Ok(found.is_empty())
}

/// The names of the targets: each has a folder of seeds.
fn targets(seeds: &Path) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(seeds).with_context(|| format!("{} is not there", seeds.display()))?;
    let paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    let mut names: Vec<String> = paths.iter().filter_map(|path| Some(path.file_name()?.to_str()?.to_owned())).collect();
    names.sort();
    Ok(names)
}

/// Copies the small files whose names end in `ending` from a folder and its subfolders, since libFuzzer takes seeds by
/// the folder.
fn copy_small(folder: &Path, ending: &str, to: &Path) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))? {
        let entry = entry?;
        let (path, name) = (entry.path(), entry.file_name());
        let about = entry.metadata()?;
        if about.is_dir() {
            copy_small(&path, ending, to)?;
        } else if about.len() <= MOST_FILE_BYTES && name.to_string_lossy().ends_with(ending) {
            std::fs::copy(&path, to.join(name)).with_context(|| format!("{} is not copied", path.display()))?;
        }
    }
    Ok(())
}

/// Passes on what libFuzzer writes. Returns how many runs it made, and whether it ended well.
fn watch(command: &mut Command) -> Result<(u64, bool)> {
    let mut child = command.stderr(Stdio::piped()).spawn().context("the targets do not start")?;
    let mut runs = 0;
    for line in child.stderr.take().into_iter().flat_map(|stderr| BufReader::new(stderr).lines()) {
        let line = line?;
        runs = runs_in(&line).unwrap_or(runs);
        eprintln!("{line}");
    }
    Ok((runs, child.wait()?.success()))
}

/// The number of runs, from the line of the final figures, or from the last event if the run was cut off.
fn runs_in(line: &str) -> Option<u64> {
    let figure = line.strip_prefix("stat::number_of_executed_units:");
    let event = || line.strip_prefix('#')?.split_whitespace().next();
    figure.map(str::trim).or_else(event)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_target_and_minutes_may_stand_in_any_order() {
        let fuzzing = |target: Option<&str>, seconds| {
            Some(Fuzzing { target: target.map(str::to_owned), time: Duration::from_secs(seconds) })
        };
        assert_eq!(Fuzzing::parse(&[]), fuzzing(None, 600));
        assert_eq!(Fuzzing::parse(&["scene"]), fuzzing(Some("scene"), 600));
        assert_eq!(Fuzzing::parse(&["--minutes", "0.5"]), fuzzing(None, 30));
        assert_eq!(Fuzzing::parse(&["copc", "--minutes", "2"]), fuzzing(Some("copc"), 120));
        assert_eq!(Fuzzing::parse(&["--minutes", "2", "copc"]), fuzzing(Some("copc"), 120));
    }

    #[test]
    fn what_is_not_understood_is_refused() {
        let odd: [&[&str]; 8] = [
            &["--minutes"],
            &["--minutes", "soon"],
            &["--minutes", "0"],
            &["--minutes", "-1"],
            &["--minutes", "nan"],
            &["--minutes", "1e9"],
            &["--seconds", "1"],
            &["scene", "view"],
        ];
        for words in odd {
            assert_eq!(Fuzzing::parse(words), None, "{words:?}");
        }
    }

    #[test]
    fn runs_are_taken_from_the_figures_and_the_events() {
        assert_eq!(runs_in("stat::number_of_executed_units: 1234"), Some(1234));
        assert_eq!(runs_in("#5678\tNEW    cov: 12 ft: 13 corp: 4/5b"), Some(5678));
        assert_eq!(runs_in("Done 12 runs in 1 second(s)"), None);
    }

    #[test]
    fn every_folder_of_seeds_is_a_target() {
        let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds");
        let names = targets(&seeds).unwrap();
        assert!(names.contains(&"las_header".to_owned()) && names.is_sorted(), "{names:?}");
    }
}
