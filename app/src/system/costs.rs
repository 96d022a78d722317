//! Where the cost models are kept: a file for each adapter, beside the preferences. A file may be deleted at any time;
//! the program then measures anew.

use std::io::ErrorKind;
use std::path::PathBuf;

use scene::whole_file;
use study::{CostModel, file_name};

use crate::system::{environment, picture_file};

fn path(adapter: &str) -> Option<PathBuf> {
    Some(environment::settings_folder()?.join("costs").join(format!("{}.json", file_name(adapter))))
}

/// The model that was kept for the adapter of this name, and what was wrong with its file; an empty model if there is
/// none.
pub fn load(adapter: &str) -> (CostModel, Option<String>) {
    let Some(path) = path(adapter) else { return (CostModel::default(), None) };
    let told = |problem: String| (CostModel::default(), Some(format!("{problem}; times are measured anew")));
    match whole_file::read(&path) {
        Ok(text) => match CostModel::parse(&text) {
            Ok(model) => (model, None),
            Err(problem) => told(format!("{}: {problem}", scene::shown(&path))),
        },
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => (CostModel::default(), None),
        Err(error) => told(error.to_string()),
    }
}

/// Keeps the model of the adapter.
///
/// # Errors
/// If the folder or file cannot be written; names it.
pub fn save(adapter: &str, model: &CostModel) -> anyhow::Result<()> {
    let Some(path) = path(adapter) else { return Ok(()) };
    let folder = path.parent().unwrap_or(&path);
    std::fs::create_dir_all(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
    picture_file::write_text(&path, &model.to_text())
}
