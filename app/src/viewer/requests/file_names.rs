//! Names of files that the viewer proposes.

use std::path::{Path, PathBuf};

use crate::viewer::objects::clouds::short_name;

/// Returns a name for files: `office` for `scans/office.laz`, `five-mirrors-sphere` for a built-in scene.
pub fn picture_name(input: &str) -> String {
    let name = short_name(input);
    if name.contains('/') {
        return name.replace('/', "-");
    }
    Path::new(name).file_stem().map_or(name.into(), |stem| stem.to_string_lossy().into_owned())
}

/// Returns `glint-NAME-1.png`, or the same with the first number that is free.
pub fn free_path(folder: &Path, name: &str, extension: &str) -> PathBuf {
    let path = |number: u32| folder.join(format!("glint-{name}-{number}.{extension}"));
    (1..u32::MAX).map(path).find(|path| !path.exists()).unwrap_or_else(|| path(0))
}
