//! Work that other threads or processes do, with what it needs and what it finds.

pub mod comparisons;
pub mod contact_sheet;
pub mod ghosts;
pub mod point_errors;
pub mod process;
pub mod slices;
pub mod study_file;
pub mod sweep_files;
pub mod sweep_range;
pub mod tasks;
