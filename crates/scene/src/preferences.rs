//! The preferences that are kept from one start to the next: recent files, the window's size, parameters. They are a
//! small TOML file that a person may edit or delete. The caller decides where it is.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{Error, Settings, whole_file};

/// What the window is recorded into.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CaptureFormat {
    /// MP4 with H.264 where that can be made, else with AV1.
    #[default]
    Mp4,
    Av1,
    H264,
    Gif,
    /// A folder of pictures.
    Pictures,
}

/// The language of the window's texts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Language {
    /// The system's, or English where the program does not speak that.
    #[default]
    System,
    English,
    German,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// The window's size in logical pixels.
    pub window: [u32; 2],
    pub panel_is_open: bool,
    /// The name of the panel's tab that is open.
    pub tab: String,
    /// The recent files, newest first: whole paths, and addresses.
    pub recent: Vec<String>,
    /// The scene files that were saved or opened, newest first.
    pub sessions: Vec<String>,
    /// Whether the window opens the last of them where nothing is named.
    pub reopens: bool,
    pub capture: CaptureFormat,
    pub language: Language,
    /// The parameters that differ from their defaults.
    pub parameters: BTreeMap<String, String>,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            window: [1280, 800],
            panel_is_open: true,
            tab: String::new(),
            recent: Vec::new(),
            sessions: Vec::new(),
            reopens: false,
            capture: CaptureFormat::default(),
            language: Language::default(),
            parameters: BTreeMap::new(),
        }
    }
}

/// The number of recent files that fit in a menu.
const RECENT_FILES: usize = 12;

impl Preferences {
    /// Parses preferences.
    ///
    /// # Errors
    /// Not TOML, or not of this form: what is wrong, in a line.
    pub fn parse(text: &str) -> Result<Self, Error> {
        whole_file::from_toml(text)
            .map_err(|error| Error::Preferences { problem: param::shortened(error.message(), param::MOST_QUOTED * 4) })
    }

    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    pub fn remember_file(&mut self, name: &str) {
        put_first(&mut self.recent, name);
    }

    /// Remembers a scene file by its absolute path.
    pub fn remember_session(&mut self, path: &str) {
        put_first(&mut self.sessions, path);
    }

    pub fn remember_settings(&mut self, settings: &Settings) {
        self.parameters = settings.only(|field| field.uses.kept).differing().into_iter().collect();
    }

    /// The defaults with the kept parameters, and warnings about those that are no longer understood.
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

fn put_first(names: &mut Vec<String>, name: &str) {
    names.retain(|known| known != name);
    names.insert(0, name.to_string());
    names.truncate(RECENT_FILES);
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
        let mut preferences =
            Preferences { capture: CaptureFormat::Gif, language: Language::German, ..Preferences::default() };
        preferences.remember_settings(&settings);
        let (back, warnings) = preferences.settings();
        assert!(warnings.is_empty(), "{warnings:?}");
        assert_eq!(back.splat.size, 2.5);
        assert_eq!((back.color, back.light), (crate::Color::default(), crate::Light::default()));
        assert_eq!(Preferences::parse(&preferences.to_text()).unwrap(), preferences);
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
