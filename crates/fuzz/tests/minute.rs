//! Runs all targets for a minute without coverage, on the seeds that are kept. Each target gets the same inputs each
//! time, and more of them on a faster machine. The test has a program of its own, because it counts all memory.

use std::time::Duration;

use fuzz::{Bench, Finding, TARGETS, committed, sweep};

/// The time for all targets together.
const TIME: Duration = Duration::from_secs(60);

#[test]
fn no_parser_panics_takes_too_much_memory_or_contradicts_itself() {
    let bench = Bench::new().expect("a folder for files");
    let mut problems = Vec::new();
    for target in &TARGETS {
        let seeds = committed(target).expect("seeds that can be read");
        match sweep(&bench, target, &seeds, TIME / TARGETS.len() as u32) {
            Ok(runs) => println!("{}: {runs} runs", target.name),
            Err(finding) => {
                let Finding { input, problem } = *finding;
                let path =
                    std::env::temp_dir().join(format!("glint-finding-{}-{:08x}", target.name, crc32fast::hash(&input)));
                std::fs::write(&path, input).expect("a place for what was found");
                problems.push(format!("{}: {problem}; the input is kept as {}", target.name, path.display()));
            }
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}
