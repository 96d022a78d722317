//! Runs a target under libFuzzer, which follows the coverage. `cargo xtask fuzz` builds this program so that the
//! workspace's own crates count what they execute (coverage.sh), and starts it. `GLINT_FUZZ_TARGET` names the target.
//! Besides what [`fuzz::Bench`] judges, this program limits the CPU time.
#![no_main]

use std::sync::LazyLock;
use std::time::Duration;

use fuzz::{Bench, Dice, Target, committed};
use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use rustix::time::{ClockId, clock_gettime};

/// The CPU time that any run may take, and how much more for each byte of its input and for each point.
const LEAST_TIME: Duration = Duration::from_millis(500);
const TIME_PER_BYTE: Duration = Duration::from_micros(1);
const TIME_PER_POINT: Duration = Duration::from_micros(1);

struct State {
    bench: Bench,
    target: &'static Target,
    seeds: Vec<Vec<u8>>,
}

static STATE: LazyLock<State> = LazyLock::new(|| {
    let name = std::env::var("GLINT_FUZZ_TARGET").unwrap_or_default();
    let state = || {
        let target = Target::named(&name).ok_or_else(|| std::io::Error::other("GLINT_FUZZ_TARGET names no target"))?;
        Ok(State { bench: Bench::new()?, target, seeds: committed(target)? })
    };
    state().unwrap_or_else(|error: std::io::Error| {
        eprintln!("{name}: {error}");
        std::process::exit(2)
    })
});

/// The CPU time that all threads have used so far.
fn cpu_time() -> Duration {
    Duration::try_from(clock_gettime(ClockId::ProcessCPUTime)).unwrap_or_default()
}

/// Runs the target on `bytes`, and reports what is wrong with the run.
fn problem(bytes: &[u8]) -> Option<String> {
    let State { bench, target, .. } = &*STATE;
    let start = cpu_time();
    match bench.run(target, bytes) {
        Err(problem) => Some(problem),
        Ok(points) => {
            let spent = cpu_time().saturating_sub(start);
            let most = LEAST_TIME.as_secs_f64()
                + TIME_PER_BYTE.as_secs_f64() * bytes.len() as f64
                + TIME_PER_POINT.as_secs_f64() * points as f64;
            let is_slow = spent.as_secs_f64() > most;
            is_slow
                .then(|| format!("{} bytes, {points} points: {spent:.1?}, expected {most:.1} s at most", bytes.len()))
        }
    }
}

fuzz_target!(|bytes: &[u8]| {
    if let Some(problem) = problem(bytes) {
        panic!("{}: {problem}", STATE.target.name);
    }
});

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let State { target, seeds, .. } = &*STATE;
    let dice = Dice::new(u64::from(seed));
    let mut bytes = if dice.one_in(5) {
        let size = fuzzer_mutate(data, size, max_size);
        let mut bytes = data[..size].to_vec();
        target.restore(&dice, &mut bytes);
        bytes
    } else {
        let mut bytes = data[..size].to_vec();
        target.mutate(&dice, &mut bytes, seeds);
        bytes
    };
    bytes.truncate(max_size);
    data[..bytes.len()].copy_from_slice(&bytes);
    bytes.len()
});
