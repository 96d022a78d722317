//! The units of a coordinate system: feet are feet.

mod epsg;
pub(crate) mod geotiff;
pub(crate) mod globe;
mod unit;
pub(crate) mod wkt;

pub use unit::{Unit, Units};
