//! The one error of this crate: file, what is wrong and where, what was expected, what to do.

use std::path::{Path, PathBuf};

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// Not one of ours. `hint` says what it looks like and what to do.
    #[error("{path}: not a LAS, LAZ or PLY file: {hint}")]
    UnknownFormat { path: PathBuf, hint: String },
    /// One of ours, but broken or of a kind that is not read. `place` is a byte, record or line.
    #[error("{path}: {place}: {problem}")]
    Malformed { path: PathBuf, place: String, problem: String },
    /// Nothing is wrong with the file, but it cannot be used for what was asked.
    #[error("{path}: {problem}")]
    Unsuitable { path: PathBuf, problem: String },
}

impl Error {
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }

    pub fn malformed(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), place: place.into(), problem: problem.into() }
    }

    pub fn unsuitable(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unsuitable { path: path.to_owned(), problem: problem.into() }
    }
}
