//! The plan of studies that settings tried in the window are added to.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use scene::whole_file;

use crate::picture_file;

/// The plan that settings are added to.
pub const STUDY: &str = "study.toml";

/// Appends a group to a plan, which is made if there is none, and writes the scene that it is about beside it: views that are alike
/// share a file.
///
/// # Errors
/// A file that is no plan, or that cannot be read or written; names it.
pub fn add_to_study(plan: &Path, scene: &str, mut group: toml::Table) -> anyhow::Result<()> {
    // Each addition reads the one before it.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let text = match whole_file::read(plan) {
        Ok(text) => text,
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => {
            "title = \"Settings tried in the window\"\n".into()
        }
        Err(error) => return Err(error.into()),
    };
    let known: toml::Table = toml::from_str(&text)
        .map_err(|error| anyhow::anyhow!("{}: is no plan, nothing was added: {}", plan.display(), error.message()))?;
    let groups = known.get("group").and_then(|groups| groups.as_array()).map_or(&[][..], Vec::as_slice);
    let is_name = |name: &str| groups.iter().any(|group| group.get("name").and_then(toml::Value::as_str) == Some(name));
    let mut names = (1..).map(|number| format!("tried-{number}"));
    let name = names.find(|name| !is_name(name)).unwrap_or_default();
    let scene_path = (1..).map(|number| plan.with_file_name(format!("study-view-{number}.toml"))).find_map(|path| {
        match whole_file::read(&path) {
            Ok(text) if text == scene => Some((path, true)),
            Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => Some((path, false)),
            // Another view, or what cannot be read: it stays as it is.
            _ => None,
        }
    });
    let (scene_path, is_there): (PathBuf, bool) = scene_path.unwrap_or_default();
    group.insert("name".into(), toml::Value::String(name));
    group.insert("scenes".into(), toml::Value::Array(vec![toml::Value::String(scene_path.display().to_string())]));
    let groups = toml::Table::from_iter([("group".to_string(), toml::Value::Array(vec![toml::Value::Table(group)]))]);
    let joined = format!("{}\n\n{}", text.trim_end(), toml::to_string(&groups)?);
    study::Plan::parse(&plan.display().to_string(), &joined)
        .map_err(|error| anyhow::anyhow!("nothing was added: {error}"))?;
    if !is_there {
        picture_file::write_text(&scene_path, scene)?;
    }
    picture_file::write_text(plan, &joined)
}
