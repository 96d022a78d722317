//! The study plan to which settings tried in the window are added.

use std::io::ErrorKind;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use scene::{Settings, whole_file};

use crate::system::picture_file;

/// The file name of the plan.
pub const STUDY: &str = "study.toml";

/// Appends a group to a plan, which is created if it does not exist, and writes the group's scene beside it. Equal
/// views share a file.
///
/// # Errors
/// The plan or the scene cannot be read or written, or the file is not a plan. The error names the file.
pub fn add_to_study(plan: &Path, scene: &str, mut group: toml::Table) -> anyhow::Result<()> {
    // Additions run one at a time, because each reads the result of the one before.
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
    let scene_names = (1..).map(|number| format!("study-view-{number}.toml"));
    let mut scene_names = scene_names.filter_map(|name| match whole_file::read(&plan.with_file_name(&name)) {
        Ok(text) if text == scene => Some((name, true)),
        Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => Some((name, false)),
        // The file holds another view or cannot be read: it stays as it is.
        _ => None,
    });
    let (scene_name, is_there): (String, bool) = scene_names.next().unwrap_or_default();
    let scene_path = plan.with_file_name(&scene_name);
    group.insert("name".into(), toml::Value::String(name));
    // Scenes lie beside their plan, so that both may be moved together.
    group.insert("scenes".into(), toml::Value::Array(vec![toml::Value::String(scene_name)]));
    let groups = toml::Table::from_iter([("group".to_string(), toml::Value::Array(vec![toml::Value::Table(group)]))]);
    let joined = format!("{}\n\n{}", text.trim_end(), toml::to_string(&groups)?);
    study::Plan::parse(&plan.display().to_string(), &joined)
        .map_err(|error| anyhow::anyhow!("nothing was added: {error}"))?;
    if !is_there {
        picture_file::write_text(&scene_path, scene)?;
    }
    picture_file::write_text(plan, &joined)
}

/// A group of a study's plan with the parameters and the size of the picture. The caller adds its name and scene.
pub fn group_of(written: &Settings, [width, height]: [u32; 2]) -> toml::Table {
    // The group names method and scene itself.
    let is_set = |key: &String| key != "reflection.method" && !key.starts_with("scene.");
    let differing: Vec<String> = written.differing().into_iter().map(|(key, _)| key).filter(is_set).collect();
    let values = written.all().into_iter().filter(|(key, _)| differing.contains(key));
    let text = |key: &str| {
        let texts = written.differing().into_iter();
        texts.filter(|(known, _)| known == key).map(|(_, text)| text).next().unwrap_or_default()
    };
    let value = |key: &str, value: &param::Value| match value {
        param::Value::Bool(on) => toml::Value::Boolean(*on),
        param::Value::U32(number) => toml::Value::Integer((*number).into()),
        // The number is written as its text: the shortest that reads back as the same number.
        param::Value::F32(_) => text(key).parse().map_or(toml::Value::String(text(key)), toml::Value::Float),
        _ => toml::Value::String(text(key)),
    };
    let set: toml::Table = values.map(|(key, known)| (key.clone(), value(&key, &known))).collect();
    let method = param::Choice::name(written.reflection.method);
    let list = |text: String| toml::Value::Array(vec![toml::Value::String(text)]);
    let mut group = toml::Table::new();
    group.insert("methods".into(), list(method.into()));
    let sweep = toml::Table::from_iter([("size".to_string(), list(format!("{width}x{height}")))]);
    group.insert("sweep".into(), toml::Value::Table(sweep));
    if !set.is_empty() {
        group.insert("set".into(), toml::Value::Table(set));
    }
    group
}
