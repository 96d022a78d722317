//! The one error of this crate: file, what is wrong and where, what was expected, what to do.

use std::path::{Path, PathBuf};

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused. The message has the reason, so that is not a source: it would be told twice.
    #[error("{path}: {reason}")]
    Io { path: PathBuf, reason: std::io::Error },
    /// The file that was to be made is not there.
    #[error("{path}: cannot be written: {reason}{}", what_to_do(reason))]
    NotWritten { path: PathBuf, reason: std::io::Error },
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
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), reason }
    }

    pub fn not_written(path: &Path, reason: std::io::Error) -> Self {
        Self::NotWritten { path: path.to_owned(), reason: without_temporary_name(reason) }
    }

    pub fn malformed(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), place: place.into(), problem: problem.into() }
    }

    pub fn unsuitable(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unsuitable { path: path.to_owned(), problem: problem.into() }
    }
}

/// What helps where a file cannot be written.
fn what_to_do(reason: &std::io::Error) -> &'static str {
    use std::io::ErrorKind::{PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull};
    match reason.kind() {
        StorageFull | QuotaExceeded => "; make room there or choose another folder",
        PermissionDenied | ReadOnlyFilesystem => "; choose a folder that can be written to",
        _ => "",
    }
}

/// The reason alone where `tempfile` has put the name of a temporary file behind it.
fn without_temporary_name(reason: std::io::Error) -> std::io::Error {
    match reason.to_string().split_once(" at path \"") {
        Some((text, _)) if reason.raw_os_error().is_none() => std::io::Error::new(reason.kind(), text),
        _ => reason,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_is_told_once_also_with_all_sources() {
        use std::error::Error as _;
        let error = Error::io(Path::new("a"), std::io::Error::other("broken"));
        assert_eq!(error.to_string(), "a: broken");
        assert!(error.source().is_none());
    }

    #[test]
    fn what_cannot_be_written_is_named_and_not_a_temporary_file() {
        let reason = tempfile::tempfile_in("/missing").unwrap_err();
        assert!(reason.to_string().contains("/missing"), "{reason}");
        let error = Error::not_written(Path::new("out.copc.laz"), reason).to_string();
        assert!(error.starts_with("out.copc.laz: cannot be written: ") && !error.contains("/missing"), "{error}");
        let full = std::io::Error::from(std::io::ErrorKind::StorageFull);
        assert!(Error::not_written(Path::new("a"), full).to_string().ends_with("choose another folder"));
    }
}
