//! The seeds that are kept beside the sources: small valid inputs, and inputs that once broke something.

use std::io;
use std::path::{Path, PathBuf};

use crate::target::Target;

/// The folder of a target's seeds.
pub fn folder(target: &Target) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds").join(target.name)
}

/// The seeds of a target, sorted by name.
///
/// # Errors
/// If they cannot be read.
pub fn committed(target: &Target) -> io::Result<Vec<Vec<u8>>> {
    let entries = std::fs::read_dir(folder(target))?.collect::<io::Result<Vec<_>>>()?;
    let mut paths: Vec<PathBuf> = entries.into_iter().map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter().map(std::fs::read).collect()
}
