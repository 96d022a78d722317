//! Where the cost models are kept: a file for each adapter, beside the preferences. A file may be deleted at any time;
//! the program then measures anew.

use std::io::ErrorKind;
use std::path::PathBuf;

use render::Gpu;
use scene::whole_file;
use study::{CostModel, file_name};

use crate::{environment, picture_file, terminal};

/// The file of an adapter. Drivers time differently, so that the backend is part of its name.
fn path(gpu: &Gpu) -> Option<PathBuf> {
    let adapter = file_name(&format!("{} {}", gpu.info.name, gpu.info.backend));
    Some(environment::settings_folder()?.join("costs").join(format!("{adapter}.json")))
}

/// The model that was kept for the adapter, and what was wrong with its file; an empty model if there is none.
pub fn load(gpu: &Gpu) -> (CostModel, Option<String>) {
    let Some(path) = path(gpu) else { return (CostModel::default(), None) };
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
pub fn save(gpu: &Gpu, model: &CostModel) -> anyhow::Result<()> {
    let Some(path) = path(gpu) else { return Ok(()) };
    let folder = path.parent().unwrap_or(&path);
    std::fs::create_dir_all(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
    picture_file::write_text(&path, &model.to_text())
}

/// Keeps the model, or warns where that fails: the work that it was measured for is not lost.
pub fn save_or_warn(gpu: &Gpu, model: &CostModel) {
    if let Err(error) = save(gpu, model) {
        terminal::warn([format!("{error:#}")]);
    }
}
