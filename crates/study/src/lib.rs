//! How accurate reflections and indirect light are.
//!
//! [`metrics`] holds the figures that one picture is judged by, [`flip`] the difference that a person would see, [`light`] the
//! figures of indirect light and of what flickers; the functions [`accuracy_same_input`] and [`accuracy_exact`] bring a renderer's images and the truth of `trace` together.

mod accuracy;
pub mod flip;
pub mod light;
pub mod metrics;
mod stage;

pub use accuracy::{Error, MirrorImage, Result, accuracy_exact, accuracy_same_input};
pub use light::{Flicker, LightError, flicker, light_error};
pub use metrics::{Accuracy, ImageError, Percentiles, Truth, image_error};
pub use stage::{IndirectTruth, JudgedLight, Stage, TracedLight};
/// What the truth is traced in and for; the program knows `trace` through here.
pub use trace::{
    Exact, Geometry, Gloss, Hit, Illumination, Indirect, MirrorPoint, Part, PixelRays, Source, Sunlight, Surfels,
    Viewpoint, indirect_picture, linear_from_srgb, primary, radiance, reflected,
};
