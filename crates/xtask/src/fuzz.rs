//! `cargo xtask fuzz`: targets of `crates/fuzz` under libFuzzer, one after the other. docs/fuzzing.md says what comes of it.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, Result, bail, ensure};

/// What is to be done.
#[derive(Debug, PartialEq)]
pub struct Fuzzing {
    /// All if there is none.
    pub target: Option<String>,
    /// Together.
    pub time: Duration,
}

/// How long it takes where nothing else is said.
const USUAL_TIME: Duration = Duration::from_secs(10 * 60);
/// A week.
const MOST_MINUTES: f64 = 7.0 * 24.0 * 60.0;

impl Fuzzing {
    /// From the words behind `fuzz`; `None` if they are not understood.
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

/// Targets that take point cloud files, by how their names start, and how the names of such files end: real ones are added to
/// their seeds.
const READ_FILES: [(&str, &str); 4] = [("las_", ".las"), ("laz_", ".laz"), ("copc", ".copc.laz"), ("ply_", ".ply")];
/// Bytes of a real file, at most: decoding longer ones takes the time of hundreds of short ones.
const MOST_FILE_BYTES: u64 = 64 << 10;
/// Bytes of an input, at most, where real files are added and elsewhere.
const MOST_BYTES: [u64; 2] = [2 * MOST_FILE_BYTES, 32 << 10];
/// What libFuzzer itself may take before a run counts as a finding, MiB.
const MOST_RESIDENT: usize = 2048;
/// What a single run may take before it counts as one that does not end, seconds.
const MOST_SECONDS: usize = 60;

/// Builds the targets of the checkout `root` with coverage and runs them; false if something was found.
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
    // The whole workspace, so that what it depends on is compiled with the features it always has.
    cargo.args(["build", "--release", "--workspace", "--locked", "--features", "fuzz/guided", "--bin", "guided"]);
    cargo.current_dir(root).env("RUSTC_WORKSPACE_WRAPPER", root.join("crates/fuzz/coverage.sh"));
    ensure!(super::status(&mut cargo)?.success(), "the targets are not built; they need a C++ compiler besides");

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

/// A target for each folder of seeds.
fn targets(seeds: &Path) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(seeds).with_context(|| format!("{} is not there", seeds.display()))?;
    let paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    let mut names: Vec<String> = paths.iter().filter_map(|path| Some(path.file_name()?.to_str()?.to_owned())).collect();
    names.sort();
    Ok(names)
}

/// Copies the small files whose names end so from a folder and those below it: libFuzzer takes seeds by the folder.
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

/// Passes on what libFuzzer writes; how many runs it made, and whether it ended well.
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

/// The number of runs, from the line of the final figures or, of a run that was cut off, of its last event.
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
