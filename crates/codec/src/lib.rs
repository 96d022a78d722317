//! Reads files as clouds: LAS and LAZ (`las`, `laz`), PLY (`ply`). All formats share one error type. `write_copc` makes
//! COPC files of LAS and LAZ, and `export` files of the points that are shown.
//!
//! `open` reads a header and checks it against the file's size; `Source::read` passes chunks of points to a callback,
//! in parallel, with progress and cancel. Files are not trusted: a header's claim alone never causes an allocation.

mod brief;
mod bytes;
mod color_range;
mod error;
mod export;
mod in_order;
mod info;
mod las;
mod ply;
mod source;
mod units;

pub use bytes::Bytes;
pub use error::{Error, Result, why_unwritten};
pub use export::{Added, ExportFormat, Exported, Runs, Wanted, export, export_chunks, short_file_name};
pub use info::{Format, Info, Selection, Summary};
pub use las::copc_writer::{CopcSummary, write_copc};
pub use las::{Copc, CopcNode};
pub use source::{Source, open, open_within};
pub use units::{Unit, Units};
