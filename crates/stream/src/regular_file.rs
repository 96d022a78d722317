//! Opens regular files only: a name in the cache's folder may be a link, a pipe or a folder, which would lead elsewhere
//! or block for ever.

use std::fs::{File, FileType};
use std::io;
use std::path::Path;

/// The type of what is at this path itself, without following links. `None` if nothing is there, or if it cannot be
/// found out.
pub fn kind(path: &Path) -> Option<FileType> {
    std::fs::symlink_metadata(path).ok().map(|metadata| metadata.file_type())
}

/// Whether something is at this path, even a link that leads nowhere.
pub fn is_there(path: &Path) -> bool {
    kind(path).is_some()
}

/// Checks that a path may be written: that it is a regular file, or nothing. Anything else could belong to another
/// program.
///
/// # Errors
/// If something else is there.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match kind(path) {
        Some(kind) if !kind.is_file() => Err(io::Error::other("not a regular file")),
        _ => Ok(()),
    }
}

/// Opens a regular file without following links.
///
/// # Errors
/// If there is none, or it cannot be read.
pub fn open_regular(path: &Path) -> io::Result<File> {
    check_writable(path)?;
    File::open(path)
}

/// Whether the open file is still the one with this name. Lock files are removed on Unix only, so elsewhere it always
/// is.
#[cfg(unix)]
pub fn is_current(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let id = |metadata: std::fs::Metadata| (metadata.dev(), metadata.ino());
    match (file.metadata(), std::fs::metadata(path)) {
        (Ok(open), Ok(named)) => id(open) == id(named),
        _ => false,
    }
}

#[cfg(not(unix))]
pub fn is_current(_: &File, _: &Path) -> bool {
    true
}
