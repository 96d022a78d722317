//! The folder in which the indexes of streamed clouds are kept.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use scene::Stream;
use stream::Cache;

use crate::error::{Error, Result};
use crate::event::IndexEntry;

/// Readers and builders of an index that is closed end within this time.
const CLOSING_TIME: Duration = Duration::from_secs(10);

/// The folder that an environment variable names; `None` if it is empty or not set.
pub fn folder_named_by(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable).filter(|folder| !folder.is_empty()).map(PathBuf::from)
}

/// The cache of indexes: `GLINT_CACHE_DIR`, else the platform's folder.
///
/// # Errors
/// If there is none.
pub fn cache(settings: &Stream) -> Result<Cache> {
    let platform = || Some(directories::ProjectDirs::from("", "", "glint")?.cache_dir().join("pages"));
    let folder = folder_named_by("GLINT_CACHE_DIR").or_else(platform).ok_or(Error::NoCacheFolder)?;
    Ok(Cache::new(folder, settings.cache_bytes.0))
}

/// The folder of what drivers compile, beside the cache of indexes; `None` if the platform has none.
pub fn pipelines_folder() -> Option<PathBuf> {
    let platform = || Some(directories::ProjectDirs::from("", "", "glint")?.cache_dir().to_path_buf());
    Some(folder_named_by("GLINT_CACHE_DIR").or_else(platform)?.join("pipelines"))
}

/// The folder of what was fetched from servers, beside the cache of indexes; `None` if the platform has none.
pub fn fetched_folder() -> Option<PathBuf> {
    Some(pipelines_folder()?.with_file_name("fetched"))
}

/// Deletes an index of the cache when nobody has it open any more.
///
/// # Errors
/// If somebody still has it open.
pub fn delete(settings: &Stream, entry: &IndexEntry) -> Result<()> {
    let cache = cache(settings)?;
    let start = Instant::now();
    while !cache.remove(&entry.folder) {
        if start.elapsed() > CLOSING_TIME {
            return Err(Error::IndexInUse { folder: entry.folder.clone() });
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}
