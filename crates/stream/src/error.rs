//! What can go wrong with pages.

use std::path::{Path, PathBuf};

/// What is wrong and where. Messages are for people: one or two lines.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The message has the reason, so that is not a source: it would be told twice.
    #[error("{path}: {reason}")]
    Io { path: PathBuf, reason: std::io::Error },
    /// A file of the cache; `of_cache` puts the cache's own folder in the place of its name.
    #[error(
        "{path}: the cache cannot be written: {}; GLINT_CACHE_DIR can name another folder",
        codec::why_unwritten(reason)
    )]
    NotWritten { path: PathBuf, reason: std::io::Error },
    /// Pages that are not what was written: they are made again, never trusted.
    #[error("{path}: {problem}")]
    Damaged { path: PathBuf, problem: String },
    #[error(transparent)]
    Input(#[from] codec::Error),
    /// A page that does not belong to its tree.
    #[error("a page has {found} points instead of {expected}")]
    PageSize { found: u64, expected: u64 },
    /// A decoder that cannot cope with what it was given.
    #[error("reading a page came to an unexpected end: {0}")]
    Panicked(String),
    /// Whole nodes are read, and this one does not fit.
    #[error("a node takes {} MiB, half of the memory for points is {} MiB: stream.host_bytes is too small for it", bytes >> 20, budget >> 21)]
    TooLarge { bytes: u64, budget: u64 },
    /// What is kept of all nodes while an index is made grows with the points.
    #[error("an index of {points} points takes {} MiB besides the points at hand, the memory for making it is {} MiB: stream.host_bytes is too small for it", needed >> 20, budget >> 20)]
    TooMany { points: u64, needed: u64, budget: u64 },
    /// Nothing to make pages of.
    #[error("{path}: no points")]
    Empty { path: PathBuf },
    /// A file that was written to while its pages were made.
    #[error("{path}: the file was changed while it was read; open it again when it is complete")]
    Changed { path: PathBuf },
    #[error(
        "{folder}: the cache cannot be written: the disk is full, and the index of this cloud needs about {} MB there; make \
         room, or GLINT_CACHE_DIR can name another folder",
        needed / 1_000_000 + 1
    )]
    Full { folder: PathBuf, needed: u64 },
    /// Something that this program has not made has the name of an index.
    #[error("{path}: this is in the place of an index, and not one that glint has made: move it away or delete it")]
    InTheWay { path: PathBuf },
    #[error("cancelled")]
    Cancelled,
}

pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), reason }
    }

    pub(crate) fn not_written(path: &Path, reason: std::io::Error) -> Self {
        Self::NotWritten { path: path.to_owned(), reason }
    }

    /// There is no more room for what was to be written.
    pub(crate) fn is_full(&self) -> bool {
        use std::io::ErrorKind::{QuotaExceeded, StorageFull};
        matches!(self, Self::NotWritten { reason, .. } if matches!(reason.kind(), StorageFull | QuotaExceeded))
    }

    /// Of what cannot be written the folder that a person knows, instead of a file in it.
    pub(crate) fn of_cache(self, folder: &Path) -> Self {
        match self {
            Self::NotWritten { reason, .. } => Self::not_written(folder, reason),
            other => other,
        }
    }

    pub fn damaged(path: &Path, problem: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), problem: problem.into() }
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
    fn a_cache_that_cannot_be_written_is_called_by_its_folder() {
        let reason = std::io::Error::from(std::io::ErrorKind::ReadOnlyFilesystem);
        let error = Error::not_written(Path::new("/pages/0123/building/records"), reason).of_cache(Path::new("/pages"));
        let told =
            "/pages: the cache cannot be written: its disk can only be read; GLINT_CACHE_DIR can name another folder";
        assert_eq!(error.to_string(), told);
    }
}
