//! Where a picture is seen from: the value of `--camera`, a scene's own camera, or a view of everything.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::Context as _;
use glam::DVec3;
use param::Choice as _;
use scene::{Camera, SceneFile, Settings, StandardView, whole_file};
use world::Request;

use crate::system::failure::usage;
use crate::system::terminal;

/// How the camera of the picture is found.
pub enum Viewpoint {
    Camera(Camera),
    /// The camera stands where `view.start` says.
    Start,
    /// The camera looks from this side and has everything in the picture.
    Framing(StandardView),
}

impl Viewpoint {
    /// `word` is the value of `--camera`. Parameters from a camera file go into `settings`, its mirrors and lights into
    /// `request`.
    ///
    /// # Errors
    /// The word names no view, or a file that cannot be read.
    pub fn new(word: Option<&OsStr>, request: &mut Request, settings: &mut Settings) -> anyhow::Result<Self> {
        let own = request.view.as_ref().and_then(|view| view.camera);
        let Some(word) = word else {
            return Ok(own.map_or(Self::Start, Self::Camera));
        };
        if word == "scene" {
            let none =
                || usage("--camera scene: the inputs bring no camera; only scene files and built-in scenes have one");
            return own.map(Self::Camera).ok_or_else(none);
        }
        if let Some(index) = StandardView::NAMES.iter().position(|name| word == *name) {
            let view = StandardView::from_index(index as u32).unwrap_or(StandardView::Isometric);
            return Ok(Self::Framing(view));
        }
        let path = Path::new(word);
        let (file, word) = if word == "-" {
            let name = "standard input";
            let file = SceneFile::parse(&whole_file::read_from(std::io::stdin(), name)?);
            (file.with_context(|| format!("--camera -: {name}"))?, "-".to_owned())
        } else if path.exists() {
            (SceneFile::read(path)?.0, scene::shown(path))
        } else {
            let (word, names) = (scene::shown(path), StandardView::NAMES.join(", "));
            return Err(usage(format!(
                "--camera {word}: no such file, and none of {names}, scene, - (standard input)"
            )));
        };
        let view = file.view();
        request.refurnish(&file);
        terminal::warn(view.warnings.iter().map(|warning| format!("{word}: {warning}")));
        for (key, value) in view.settings.differing() {
            settings.set_text(&key, &value)?;
        }
        view.camera.map(Self::Camera).ok_or_else(|| usage(format!("--camera {word}: there is no [camera] in it")))
    }

    /// `room` is a camera in the room, if the scene is one.
    pub fn camera(
        &self,
        outline: &[DVec3],
        up: DVec3,
        room: Option<Camera>,
        settings: &Settings,
        size: [u32; 2],
    ) -> Camera {
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        let first = |side| world::first_camera(side, room, outline, up, &settings.view, aspect);
        match self {
            Self::Camera(camera) => *camera,
            Self::Start => first(None),
            Self::Framing(side) => first(Some(*side)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_of_a_camera_file_yield_to_set() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("view.toml");
        let mut settings = Settings::default();
        settings.splat.size = 3.0;
        settings.edl.strength = 2.0;
        let camera = Camera::looking(DVec3::ONE, DVec3::X, 5.0, DVec3::Z);
        std::fs::write(&path, SceneFile::new(Vec::new(), camera, &settings).to_text()).unwrap();
        let mut settings = Settings::default();
        let viewpoint = Viewpoint::new(Some(path.as_os_str()), &mut Request::default(), &mut settings).unwrap();
        settings.set_text("splat.size", "4").unwrap();
        assert_eq!((settings.splat.size, settings.edl.strength), (4.0, 2.0));
        let seen = viewpoint.camera(&[], DVec3::Z, None, &settings, [8, 8]);
        assert!(seen.eye.distance(camera.eye) < 1e-12);
    }
}
