//! Recordings: the folder of their pictures, what the pictures are of, and films that play them.

mod average;
mod description;
mod error;
mod ffmpeg;
mod film;
mod folder;
mod gif;
mod mp4;
mod source;
mod yuv;

pub use average::{Average, Averaging};
pub use description::{Adapter, Description};
pub use error::{Error, Result};
pub use film::{Film, Format};
pub use folder::Folder;
pub use source::{RECORDING, SOURCE, add_text};
