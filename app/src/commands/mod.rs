//! The commands of `glint`, one in a file, and what only they use.

pub mod chosen;
pub mod compare;
pub mod export;
pub mod ghosts;
pub mod index;
pub mod info;
pub mod listing;
pub mod made_scan;
pub mod measure;
pub mod profile;
pub mod record;
pub mod recording;
pub mod render;
pub mod scans;
pub mod stats;
pub mod study;
pub mod subject;
pub mod surface_error;
pub mod surfaces;
pub mod truth;
