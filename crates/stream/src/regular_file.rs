//! Opens regular files only: what stands in the cache's folder may be a link, a pipe or a folder, which would lead elsewhere or make
//! who opens it wait for ever.

use std::fs::{File, FileType};
use std::io;
use std::path::Path;

/// What is at this path itself, not where it leads to. `None` if nothing is, or it cannot be told.
pub fn kind(path: &Path) -> Option<FileType> {
    std::fs::symlink_metadata(path).ok().map(|metadata| metadata.file_type())
}

/// Whether there is something at this path, be it a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    kind(path).is_some()
}

/// Checks that nothing is at a path, or a regular file: what may be written. Anything else could be another's.
///
/// # Errors
/// If something else is there.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match kind(path) {
        Some(kind) if !kind.is_file() => Err(io::Error::other("not a regular file")),
        _ => Ok(()),
    }
}

/// Opens a regular file, not what a link leads to.
///
/// # Errors
/// If there is none, or it cannot be read.
pub fn open_regular(path: &Path) -> io::Result<File> {
    check_writable(path)?;
    File::open(path)
}
