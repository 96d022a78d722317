//! Runs targets and checks the memory that they take. `parsers` finds contradictions, and the callers catch panics.

use std::io;
use std::sync::{Mutex, PoisonError};

use peak_alloc::PeakAlloc;
use rayon::{ThreadPool, ThreadPoolBuilder};
use tempfile::TempDir;

use crate::target::Target;

/// Counts the memory that every program with this crate allocates.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Held during a run: memory is counted for the whole program, so only one run can be measured at a time.
static TURN: Mutex<()> = Mutex::new(());

/// The bytes of memory that a run may take however small its input is: room for a block of records and its chunk.
const LEAST_CEILING: usize = 64 << 20;
/// How many more bytes of memory a run may take for each byte of its input.
const BYTES_PER_BYTE: usize = 10;
/// A folder whose files are in memory: on a disk they would be the slowest part of a run.
const MEMORY_FOLDER: &str = "/dev/shm";

/// A place to run targets: a folder for their files, and a pool of one thread, so that the same input takes the same
/// memory each time. The thread is the one that made the bench: handing inputs to another one would take longer than
/// most parsers do.
pub struct Bench {
    folder: TempDir,
    pool: ThreadPool,
}

impl Bench {
    /// # Errors
    /// If there is no place for files, or the thread has a bench already.
    pub fn new() -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        let builder = builder.prefix("glint-fuzz-");
        let folder = builder.tempdir_in(MEMORY_FOLDER).or_else(|_| builder.tempdir())?;
        let pool = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().map_err(io::Error::other)?;
        Ok(Self { folder, pool })
    }

    /// Runs `target` on `bytes` and returns how many points were decoded. Call it from the thread that made the bench.
    ///
    /// # Errors
    /// Reports what the parser did that it must not do.
    ///
    /// # Panics
    /// If the parser panics.
    pub fn run(&self, target: &Target, bytes: &[u8]) -> Result<u64, String> {
        let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        let before = MEMORY.current_usage();
        MEMORY.reset_peak_usage();
        let outcome = self.pool.install(|| (target.run)(self.folder.path(), bytes));
        let peak = MEMORY.peak_usage().saturating_sub(before);
        let ceiling = LEAST_CEILING + BYTES_PER_BYTE * bytes.len();
        match outcome {
            Ok(_) if peak > ceiling => {
                Err(format!("{} bytes of input took {peak} bytes of memory, expected {ceiling} at most", bytes.len()))
            }
            outcome => outcome,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A target that takes a thousand times the memory of its input.
    fn greedy(_: &std::path::Path, bytes: &[u8]) -> Result<u64, String> {
        Ok(std::hint::black_box(vec![1_u8; 1000 * bytes.len()]).len() as u64)
    }

    #[test]
    fn memory_above_the_ceiling_is_a_finding() {
        let bench = Bench::new().unwrap();
        let target = Target { name: "greedy", run: greedy, mutate: |_, _| (), repair: |_| () };
        assert_eq!(bench.run(&target, &[0; 1000]), Ok(1_000_000));
        let problem = bench.run(&target, &[0; 100_000]).unwrap_err();
        assert!(problem.starts_with("100000 bytes of input took 100"), "{problem}");
    }
}
