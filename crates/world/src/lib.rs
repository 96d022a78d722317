//! What is open: from words on the command line to points in memory and on the GPU, the same way for the window, the picture
//! file and `glint info`.
//!
//! [`resolve`] tells what each word names. [`start`] opens and reads it on threads of its own and hands [`Event`]s over as they
//! come. Where clouds are streamed, the [`Lookout`] tells those threads from where they are looked at.

mod budget;
mod cache;
mod director;
mod error;
mod event;
mod indexing;
mod job;
mod loader;
mod lookout;
pub mod mirrors;
mod reading;
mod source;
mod stage;
mod words;

pub use budget::{half_of, most_points, most_preview_points};
pub use cache::{cache, delete};
pub use error::{Error, Result};
pub use event::{Event, Kept, Paged, StreamStats};
pub use job::{Job, start, start_unseen};
pub use lookout::{Lookout, Viewpoint, Wish};
pub use source::{file_warnings, open_file, parts, read_column, surfel_options, up_of};
pub use stage::{LEAST_TIME, Making, Stage, Standing};
pub use words::{Input, Request, built_in_name, built_in_names, resolve};
