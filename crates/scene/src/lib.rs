//! What is looked at and how: camera, parameters, scene files, built-in scenes.

mod camera;
mod file;
pub mod five_mirrors;
mod settings;

pub use camera::{Camera, Projection, StandardView};
pub use file::{Error, SceneFile, View};
pub use settings::{
    Atomics, Color, ColorBy, Edl, Light, Quality, Ramp, SceneSettings, Settings, Splat, Surface, SurfaceOrientation,
    UpAxis, ViewSettings,
};
