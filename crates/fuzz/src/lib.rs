//! Fuzzing of everything that reads bytes from outside: point cloud files, indexes, and the texts that people write.
//!
//! A [`Target`] is a parser with mutators that know its fields. A [`Bench`] runs it on bytes and judges the result: a
//! finding is a panic, more memory than such an input may take, or a result that contradicts itself. Two loops feed it:
//! [`sweep()`] without coverage in `cargo xtask test`, and libFuzzer in `cargo xtask fuzz` (`src/bin/guided.rs`).
//! docs/fuzzing.md explains how to use them.

mod bench;
mod dice;
mod mutate;
mod parsers;
mod seeds;
mod sweep;
mod target;

pub use bench::Bench;
pub use dice::Dice;
pub use parsers::join;
pub use seeds::{committed, folder};
pub use sweep::{Finding, sweep};
pub use target::{MOST_BYTES, TARGETS, Target};
