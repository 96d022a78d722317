//! Recordings: the folder of their pictures, and what the pictures are of.

mod description;
mod error;
mod folder;

pub use description::{Adapter, Description};
pub use error::{Error, Result};
pub use folder::Folder;
