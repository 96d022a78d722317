//! The errors of making and reading an index.

use std::path::{Path, PathBuf};

use param::shown;

/// Says what is wrong and where, in one or two lines for people.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The message contains the reason. So the reason is not given as `source` as well: it would be printed twice.
    #[error("{}: {reason}", shown(path))]
    Io { path: PathBuf, reason: std::io::Error },
    /// A file of the cache cannot be written; `of_cache` replaces its name by the cache's own folder.
    #[error(
        "{}: the cache cannot be written: {}; GLINT_CACHE_DIR can name another folder",
        shown(path),
        codec::why_unwritten(reason)
    )]
    NotWritten { path: PathBuf, reason: std::io::Error },
    /// The pages on disk are not those that were written. They are made again, never trusted.
    #[error("{}: {problem}", shown(path))]
    Damaged { path: PathBuf, problem: String },
    #[error(transparent)]
    Input(#[from] codec::Error),
    /// A page does not belong to its tree.
    #[error("a page has {found} points instead of {expected}")]
    PageSize { found: u64, expected: u64 },
    /// A decoder could not cope with its input.
    #[error("reading a page came to an unexpected end: {0}")]
    Panicked(String),
    /// Nodes are read whole, and this one does not fit in memory.
    #[error("a node takes {} MiB, half of the memory for points is {} MiB: stream.host_bytes is too small for it", bytes >> 20, budget >> 21)]
    TooLarge { bytes: u64, budget: u64 },
    /// While an index is made, the tables of its nodes and blocks stay in memory; they grow with the number of points.
    #[error("an index of {points} points takes {} MiB besides the points at hand, the memory for making it is {} MiB: stream.host_bytes is too small for it", needed >> 20, budget >> 20)]
    TooMany { points: u64, needed: u64, budget: u64 },
    /// The input has no points to make pages of.
    #[error("{}: no points", shown(path))]
    Empty { path: PathBuf },
    /// A file was written to while its pages were made.
    #[error("{}: the file was changed while it was read; open it again when it is complete", shown(path))]
    Changed { path: PathBuf },
    #[error(
        "{}: the cache cannot be written: the disk is full, and the index of this cloud needs about {} MB there; make room, \
         or GLINT_CACHE_DIR can name another folder",
        shown(folder),
        needed / 1_000_000 + 1
    )]
    Full { folder: PathBuf, needed: u64 },
    /// A file or folder that this program did not make has the name of an index.
    #[error(
        "{}: this is in the place of an index, and not one that glint has made: move it away or delete it",
        shown(path)
    )]
    InTheWay { path: PathBuf },
    #[error("cancelled")]
    Cancelled,
}

pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    pub fn io(path: &Path, reason: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), reason }
    }

    /// Whether a read that failed so may succeed in a moment: servers and disks come back, while wrong data stay wrong.
    pub fn may_pass(&self) -> bool {
        matches!(self, Self::Io { .. } | Self::Input(codec::Error::Io { .. }))
    }

    pub(crate) fn not_written(path: &Path, reason: std::io::Error) -> Self {
        Self::NotWritten { path: path.to_owned(), reason }
    }

    /// Whether the disk or a quota is full.
    pub(crate) fn is_full(&self) -> bool {
        use std::io::ErrorKind::{QuotaExceeded, StorageFull};
        matches!(self, Self::NotWritten { reason, .. } if matches!(reason.kind(), StorageFull | QuotaExceeded))
    }

    /// Replaces the name of a file that cannot be written by the folder of the cache, which a person knows.
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
