//! Measurements on points: sections along a line.
//!
//! This crate knows points, and no files, no scene and no GPU. Lengths are in the units of the coordinates.

mod error;
mod section;

pub use error::{Error, Result};
pub use section::{Placed, Section};
