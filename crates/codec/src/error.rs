//! The errors of this crate: the file, what is wrong and where, what was expected, what to do.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use param::shown;

pub type Result<T> = std::result::Result<T, Error>;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused. The message contains the reason, so it is not given as `source` as well: it would
    /// be printed twice.
    #[error("{}: {reason}", shown(path))]
    Io { path: PathBuf, reason: std::io::Error },
    /// An output cannot be written; the inputs are not at fault.
    #[error("{}: cannot be written: {}; {}", shown(path), why_unwritten(reason), what_then(reason))]
    NotWritten { path: PathBuf, reason: std::io::Error },
    /// The file has no known format. `hint` says what it looks like and what to do.
    #[error("{}: not a file of a known format: {hint}", shown(path))]
    UnknownFormat { path: PathBuf, hint: String },
    /// The file has a known format, but is broken or of a variant that is not read. `place` is a byte, record or line.
    #[error("{}: {place}: {problem}", shown(path))]
    Malformed { path: PathBuf, place: String, problem: String },
    /// The file is valid, but cannot be used for the purpose.
    #[error("{}: {problem}", shown(path))]
    Unsuitable { path: PathBuf, problem: String },
}

/// What is added to the problem with bytes that were fetched once more.
pub(crate) const AS_BEFORE: &str = " (fetched from the server twice, and the same)";

impl Error {
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), reason }
    }

    pub fn not_written(path: &Path, reason: std::io::Error) -> Self {
        Self::NotWritten { path: path.to_owned(), reason }
    }

    pub fn malformed(path: &Path, place: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Malformed { path: path.to_owned(), place: place.into(), problem: problem.into() }
    }

    /// The same failure, where people know the file by another name.
    pub(crate) fn renamed(mut self, from: &[&Path], to: &Path) -> Self {
        let (Self::Io { path, .. }
        | Self::NotWritten { path, .. }
        | Self::UnknownFormat { path, .. }
        | Self::Malformed { path, .. }
        | Self::Unsuitable { path, .. }) = &mut self;
        if from.contains(&path.as_path()) {
            *path = to.to_owned();
        }
        self
    }

    /// The same failure of bytes that a server was asked for twice.
    pub(crate) fn same_again(mut self) -> Self {
        if let Self::Malformed { problem, .. } = &mut self {
            let text = problem.trim_end_matches(AS_BEFORE).len();
            problem.truncate(text);
            problem.push_str(AS_BEFORE);
        }
        self
    }

    pub fn unsuitable(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unsuitable { path: path.to_owned(), problem: problem.into() }
    }
}

/// The reason why something cannot be written, without the names of temporary files.
pub fn why_unwritten(reason: &std::io::Error) -> String {
    match reason.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "the disk is full".into(),
        ErrorKind::ReadOnlyFilesystem => "its disk can only be read".into(),
        ErrorKind::PermissionDenied => "you have no permission to write there".into(),
        ErrorKind::NotFound => "there is no such folder".into(),
        ErrorKind::IsADirectory => "a folder, not a file".into(),
        ErrorKind::AlreadyExists => "a file of this name is there, and is not replaced".into(),
        // An error to which the crate tempfile has added its file's name has no number of the operating system.
        kind if reason.raw_os_error().is_none() && kind != ErrorKind::Other => kind.to_string(),
        _ => reason.to_string(),
    }
}

/// Whether a disk is full, or does not hold a file of this length.
pub(crate) fn is_for_want_of_room(reason: &std::io::Error) -> bool {
    matches!(reason.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge)
}

fn what_then(reason: &std::io::Error) -> &'static str {
    match reason.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "make room there, or name another place",
        ErrorKind::NotFound => "make it first, or name another place",
        _ => "name another place",
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

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_are_told_apart() {
        use std::os::unix::ffi::OsStrExt as _;
        let name = Path::new(std::ffi::OsStr::from_bytes(b"w\xe4ld.las"));
        assert_eq!(Error::unsuitable(name, "odd").to_string(), r"w\xe4ld.las: odd");
        assert!(Error::io(name, std::io::Error::other("broken")).to_string().starts_with(r"w\xe4ld.las: "));
    }

    #[test]
    fn what_cannot_be_written_is_named_once_with_the_reason_and_what_to_do() {
        use std::error::Error as _;
        let inner = std::io::Error::new(ErrorKind::StorageFull, "No space left on device at \".a.laz.x7f.unfinished\"");
        let error = Error::not_written(Path::new("a.laz"), inner);
        assert_eq!(
            error.to_string(),
            "a.laz: cannot be written: the disk is full; make room there, or name another place"
        );
        assert!(error.source().is_none());
        let told = |kind: ErrorKind| why_unwritten(&std::io::Error::new(kind, "at .a.laz.unfinished"));
        assert_eq!(told(ErrorKind::ReadOnlyFilesystem), "its disk can only be read");
        assert_eq!(told(ErrorKind::FileTooLarge), "file too large");
        assert_eq!(why_unwritten(&std::io::Error::other("a point lies outside")), "a point lies outside");
    }
}
