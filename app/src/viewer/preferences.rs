//! What is kept from one start to the next: recent files, the window's size, parameters. A small TOML file that a person may
//! edit or delete; a broken one is reported and replaced.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::PathBuf;

use scene::{Settings, whole_file};
use serde::{Deserialize, Serialize};

use crate::{environment, picture_file};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// Logical pixels.
    pub window: [u32; 2],
    pub panel_is_open: bool,
    /// Newest first, as given to the command line.
    pub recent: Vec<String>,
    /// Parameters that differ from their defaults.
    pub parameters: BTreeMap<String, String>,
}

impl Default for Preferences {
    fn default() -> Self {
        Self { window: [1280, 800], panel_is_open: true, recent: Vec::new(), parameters: BTreeMap::new() }
    }
}

/// As many as fit in a menu.
const RECENT_FILES: usize = 12;

/// What belongs to the data at hand and not to the person: not kept.
const NOT_KEPT: [&str; 9] = [
    "color.",
    "light.by",
    "light.show",
    "scene.",
    "stream.overlay",
    "stream.pages",
    "sun.",
    "tone.exposure",
    "view.up",
];

impl Preferences {
    fn path() -> Option<PathBuf> {
        Some(environment::settings_folder()?.join("viewer.toml"))
    }

    /// What was kept, and what was wrong with it.
    pub fn load() -> (Self, Option<String>) {
        let Some(path) = Self::path() else { return (Self::default(), None) };
        match whole_file::read(&path) {
            Ok(text) => match toml::from_str(&text) {
                Ok(preferences) => (preferences, None),
                Err(error) => {
                    let problem = param::shortened(error.message(), param::MOST_QUOTED * 4);
                    let text = format!("{}: {problem}; the defaults are used instead", path.display());
                    (Self::default(), Some(text))
                }
            },
            Err(scene::Error::Unreadable { kind: ErrorKind::NotFound, .. }) => (Self::default(), None),
            Err(error) => (Self::default(), Some(format!("{error}; the defaults are used instead"))),
        }
    }

    /// # Errors
    /// If the folder or file cannot be written; names it.
    pub fn save(&self) -> anyhow::Result<()> {
        let Some(path) = Self::path() else { return Ok(()) };
        let folder = path.parent().unwrap_or(&path);
        std::fs::create_dir_all(folder).map_err(|reason| codec::Error::not_written(folder, reason))?;
        picture_file::write_text(&path, &toml::to_string(self)?)
    }

    pub fn remember_file(&mut self, name: &str) {
        self.recent.retain(|recent| recent != name);
        self.recent.insert(0, name.to_string());
        self.recent.truncate(RECENT_FILES);
    }

    pub fn remember_settings(&mut self, settings: &Settings) {
        let kept = |(key, _): &(String, String)| !NOT_KEPT.iter().any(|start| key.starts_with(start));
        self.parameters = settings.differing().into_iter().filter(kept).collect();
    }

    /// The defaults with what was kept, and what of it is no longer understood.
    pub fn settings(&self) -> (Settings, Vec<String>) {
        let mut settings = Settings::default();
        let mut warnings = Vec::new();
        for (key, text) in &self.parameters {
            if let Err(error) = settings.set_text(key, text) {
                warnings.push(error.to_string());
            }
        }
        (settings, warnings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_come_back_but_not_what_belongs_to_the_data() {
        let mut settings = Settings::default();
        settings.set_text("splat.size", "2.5").unwrap();
        settings.set_text("color.by", "class").unwrap();
        settings.set_text("light.by", "colors").unwrap();
        let mut preferences = Preferences::default();
        preferences.remember_settings(&settings);
        let (back, warnings) = preferences.settings();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!(back.splat.size, 2.5);
        assert_eq!((back.color, back.light), (scene::Color::default(), scene::Light::default()));
        let text = toml::to_string(&preferences).unwrap();
        assert_eq!(toml::from_str::<Preferences>(&text).unwrap(), preferences);
    }

    #[test]
    fn the_newest_file_is_first_and_listed_once() {
        let mut preferences = Preferences::default();
        for index in 0..20 {
            preferences.remember_file(&format!("{index}.laz"));
        }
        preferences.remember_file("15.laz");
        assert_eq!(preferences.recent.len(), RECENT_FILES);
        assert_eq!(preferences.recent[..3], ["15.laz", "19.laz", "18.laz"]);
    }
}
