//! Where preferences are kept. A broken file is reported and replaced.

use std::io::ErrorKind;
use std::path::PathBuf;

pub use scene::Preferences;
use scene::whole_file;

use crate::system::{environment, picture_file};

fn path() -> Option<PathBuf> {
    Some(environment::settings_folder()?.join("viewer.toml"))
}

/// The folder of unsaved work.
pub fn unsaved_folder() -> Option<PathBuf> {
    Some(environment::settings_folder()?.join("unsaved"))
}

/// What was kept, and what was wrong with it.
pub fn load() -> (Preferences, Option<String>) {
    let Some(path) = path() else { return (Preferences::default(), None) };
    match whole_file::read(&path) {
        Ok(text) => match Preferences::parse(&text) {
            Ok(preferences) => (preferences, None),
            Err(error) => {
                let text = format!("{}: {error}; the defaults are used instead", path.display());
                (Preferences::default(), Some(text))
            }
        },
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => (Preferences::default(), None),
        Err(error) => (Preferences::default(), Some(format!("{error}; the defaults are used instead"))),
    }
}

/// # Errors
/// If the folder or file cannot be written; names it.
pub fn save(preferences: &Preferences) -> anyhow::Result<()> {
    let Some(path) = path() else { return Ok(()) };
    let folder = path.parent().unwrap_or(&path);
    std::fs::create_dir_all(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
    picture_file::write_text(&path, &preferences.to_text())
}
