//! The loop without coverage: it runs the same inputs in the same order each time, as many as the time allows.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use crate::bench::Bench;
use crate::dice::Dice;
use crate::target::Target;

/// Something that a target must not do, and the input that made it do so.
#[derive(Debug)]
pub struct Finding {
    pub input: Vec<u8>,
    pub problem: String,
}

/// Runs `target` on the seeds as they are, then on changed seeds until `time` is over. Returns the number of runs.
///
/// # Errors
/// The first finding.
pub fn sweep(bench: &Bench, target: &Target, seeds: &[Vec<u8>], time: Duration) -> Result<u64, Box<Finding>> {
    let start = Instant::now();
    let mut runs = 0;
    for seed in seeds {
        check(bench, target, seed)?;
        runs += 1;
    }
    let name = target.name.bytes().fold(0, |hash, byte| cloud::hash(hash ^ u64::from(byte)));
    while !seeds.is_empty() && start.elapsed() < time {
        let dice = Dice::new(name ^ runs);
        let mut input = seeds[dice.below(seeds.len())].clone();
        target.mutate(&dice, &mut input, seeds);
        check(bench, target, &input)?;
        runs += 1;
    }
    Ok(runs)
}

fn check(bench: &Bench, target: &Target, input: &[u8]) -> Result<(), Box<Finding>> {
    let finding = |problem| Box::new(Finding { input: input.to_owned(), problem });
    match catch_unwind(AssertUnwindSafe(|| bench.run(target, input))) {
        Ok(outcome) => outcome.map(|_| ()).map_err(finding),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic");
            Err(finding(format!("a panic: {text}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Panics on a byte that no seed has.
    fn picky(_: &std::path::Path, bytes: &[u8]) -> Result<u64, String> {
        assert!(!bytes.contains(&b'!'), "found it");
        Ok(0)
    }

    #[test]
    fn a_panic_is_a_finding_and_the_same_one_each_time() {
        let bench = Bench::new().unwrap();
        let mutate = |dice: &Dice, bytes: &mut Vec<u8>| bytes.push(dice.byte());
        let target = Target { name: "picky", run: picky, mutate, repair: |_| () };
        let find = || sweep(&bench, &target, &[b"abc".to_vec()], Duration::from_secs(60)).unwrap_err();
        let first = find();
        assert!(first.input.contains(&b'!') && first.problem == "a panic: found it", "{first:?}");
        assert_eq!(find().input, first.input);
    }
}
