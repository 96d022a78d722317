//! How accurate reflections are.
//!
//! [`metrics`] holds the figures that one picture is judged by, [`flip`] the difference that a person would see; the functions
//! [`accuracy_same_input`] and [`accuracy_exact`] bring a renderer's images and the truth of `trace` together.

mod accuracy;
pub mod flip;
pub mod metrics;
mod stage;

pub use accuracy::{Error, MirrorImage, Result, accuracy_exact, accuracy_same_input};
pub use metrics::{Accuracy, ImageError, Percentiles, Truth, image_error};
pub use stage::Stage;
/// What the truth is traced in and for; the program knows `trace` through here.
pub use trace::{
    Exact, Hit, Illumination, MirrorPoint, Part, PixelRays, Surfels, Viewpoint, linear_from_srgb, primary, radiance,
    reflected,
};
