//! Opens what a person names, from words on the command line to points in memory and on the GPU, in the same way for
//! the window, the picture file and `glint info`.
//!
//! [`resolve`] finds what each word names. [`start`] opens and reads it on threads of its own and sends [`Event`]s. If
//! clouds are streamed, the [`Mailbox`] gives those threads the view to stream for.

mod apart;
mod assembly;
mod budget;
mod cache;
mod certainty;
mod change;
mod chunk_key;
mod director;
mod error;
mod event;
mod filters;
mod indexing;
mod input;
mod job;
mod light;
mod lists;
mod loaded_parts;
mod loader;
mod mailbox;
mod meshes;
pub mod mirrors;
mod opening;
mod reading;
mod resident;
mod source;
mod streamed_cloud;
mod task;
mod tiles;
mod words;

pub use apart::{Apart, Place, far_gap};
pub use assembly::{Assembly, Moved, Own};
pub use budget::{half_of, most_points, most_preview_points};
pub use cache::{cache, delete, fetched_folder, folder_named_by, pipelines_folder};
pub use certainty::surface_errors;
pub use change::Change;
pub use chunk_key::{ChunkKey, CloudKey, Part};
pub use error::{Error, Result};
pub use event::{Event, IndexEntry, IndexState, Opened, StreamStats};
pub use filters::{Offer, check_filters, stray_warning};
pub use input::{Input, built_in_name};
pub use job::{Job, start, start_unseen};
pub use light::{AutoLight, dark_warning};
pub use loaded_parts::LoadedParts;
pub use mailbox::{IndexRequest, Mailbox, StreamView};
pub use meshes::with_mesh;
pub use opening::{Extent, first_camera, first_outline, own_settings, shining};
pub use reading::{points_on_faces, shows_faces};
pub use resident::Resident;
pub use source::{
    asked_attributes, common_scanner, file_warnings, lost_tiles, open_file, open_placed, options_for, other_systems,
    parts, radii_of_shown, read_cloud, read_column, surfel_options, system_warnings, up_of,
};
pub use task::{CloudTask, LEAST_TIME, TaskKind, TaskStatus};
pub use words::{KnownNames, Request, built_in_names, first_scene, no_cloud, resolve, resolve_open, resolve_written};
