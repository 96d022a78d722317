//! What the program shares with the machine: the terminal, files, signals, memory, and how failures are reported.

pub mod costs;
pub mod environment;
pub mod failure;
pub mod fetching;
pub mod film;
pub mod interrupt;
pub mod peak_memory;
pub mod picture_file;
pub mod progress_bar;
pub mod terminal;
