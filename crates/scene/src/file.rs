//! Scene files: which clouds, seen from where, with which parameters. TOML, small enough to read and to paste.
//!
//! ```toml
//! clouds = ["office.laz", "five-mirrors/sphere"]
//! [camera]
//! eye = [1.0, 2.0, 3.0]
//! pivot = [0.0, 0.0, 0.0]
//! up = [0.0, 0.0, 1.0]
//! [parameters]
//! "splat.size" = 2.0
//! ```
//! The same text without `clouds` is what "copy view" puts on the clipboard and what `--camera` reads.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::{Camera, Settings};

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("not a scene: {problem}")]
    Malformed { problem: String },
}

/// A scene file as it is written. Relative cloud paths are relative to the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Paths of clouds, or names of built-in scenes.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub clouds: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Parameters that differ from their defaults, `group.name` to value.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, toml::Value>,
}

/// A view read from text: camera and parameters, with what was not understood.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    pub camera: Option<Camera>,
    pub settings: Settings,
    /// Unknown keys and values out of range; the rest was taken.
    pub warnings: Vec<String>,
}

impl SceneFile {
    pub fn new(clouds: Vec<String>, camera: Camera, settings: &Settings) -> Self {
        let parameters = settings.differing().into_iter().map(|(key, text)| {
            let value = toml::Value::String(text.clone());
            // Numbers and switches are written as such, so that a person may edit them without quotes.
            let plain = text.parse().map(toml::Value::Integer).or_else(|_| text.parse().map(toml::Value::Float));
            let plain = plain.or_else(|_| text.parse().map(toml::Value::Boolean));
            let is_text = key == "color.attribute";
            (key, if is_text { value } else { plain.unwrap_or(value) })
        });
        Self { clouds, camera: Some(camera), parameters: parameters.collect() }
    }

    /// # Errors
    /// Not TOML, or not of this form: with the line.
    pub fn parse(text: &str) -> Result<Self, Error> {
        let file: Self = toml::from_str(text)
            .map_err(|error| Error::Malformed { problem: error.to_string().trim_end().replace('\n', " ") })?;
        let is_finite = |camera: &Camera| camera.eye.is_finite() && camera.pivot.is_finite() && camera.up.is_finite();
        if !file.camera.as_ref().is_none_or(is_finite) {
            return Err(Error::Malformed { problem: "the camera has coordinates that are not finite".into() });
        }
        Ok(file)
    }

    /// # Errors
    /// Not readable, or not a scene; names the file.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path).map_err(|source| Error::Io { path: path.to_owned(), source })?;
        let mut file =
            Self::parse(&text).map_err(|error| Error::Malformed { problem: format!("{}: {error}", path.display()) })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for cloud in &mut file.clouds {
            let beside = folder.join(&*cloud);
            if beside.exists() {
                *cloud = beside.to_string_lossy().into_owned();
            }
        }
        Ok(file)
    }

    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    /// Camera and parameters; what is not understood becomes a warning, never a failure.
    pub fn view(&self) -> View {
        let mut settings = Settings::default();
        let mut warnings = Vec::new();
        for (key, value) in &self.parameters {
            let text = match value {
                toml::Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            if let Err(error) = settings.set_text(key, &text) {
                warnings.push(error.to_string());
            }
        }
        let camera = self
            .camera
            .map(|camera| Camera::looking(camera.pivot, camera.eye - camera.pivot, camera.distance(), camera.up));
        View { camera, settings, warnings }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_view_survives_its_text_to_the_last_digit() {
        let mut settings = Settings::default();
        settings.set_text("splat.size", "0.3").unwrap();
        settings.set_text("splat.quality", "nearest").unwrap();
        settings.set_text("color.attribute", "7").unwrap();
        let camera = Camera::looking(
            DVec3::new(635_619.123_456_7, 848_899.7, 406.59),
            DVec3::new(1.0, -0.7, 0.3),
            123.456,
            DVec3::Z,
        );
        let text = SceneFile::new(vec!["a.laz".into()], camera, &settings).to_text();
        let back = SceneFile::parse(&text).unwrap();
        assert_eq!(back.clouds, ["a.laz"]);
        let view = back.view();
        assert!(view.warnings.is_empty(), "{:?}", view.warnings);
        assert_eq!(view.settings, settings);
        let back = view.camera.unwrap();
        assert!(back.eye.distance(camera.eye) < 1e-9 && back.pivot == camera.pivot, "{text}");
    }

    #[test]
    fn unknown_parameters_are_warned_of_and_the_rest_is_taken() {
        let view =
            SceneFile::parse("[parameters]\n\"splat.size\" = 2\n\"splat.colour\" = 3\n\"edl.strength\" = 99.0\n")
                .unwrap()
                .view();
        assert_eq!(view.settings.splat.size, 2.0);
        assert_eq!(view.warnings.len(), 2, "{:?}", view.warnings);
    }

    #[test]
    fn broken_scenes_say_where() {
        let error = SceneFile::parse("clouds = [").unwrap_err().to_string();
        assert!(error.contains("line 1"), "{error}");
        assert!(SceneFile::parse("cluods = []").unwrap_err().to_string().contains("cluods"));
        assert!(SceneFile::parse("[camera]\neye=[nan,0,0]\npivot=[0,0,0]\nup=[0,0,1]").is_err());
    }
}
