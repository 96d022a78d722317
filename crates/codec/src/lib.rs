//! Reads files as clouds: LAS and LAZ (`las`, `laz`), PLY (`ply`), and formats whose points become rows as those of PLY are
//! (`e57`, `pcd`, `text`), and EPT (`ept`). All formats share one error type. `write_copc` makes
//! COPC files of LAS and LAZ, and `export` files of the points that are shown.
//!
//! `open` reads a header and checks it against the file's size; `Source::read` passes chunks of points to a callback,
//! in parallel, with progress and cancel. Files are not trusted: a header's claim alone never causes an allocation.

mod address;
mod at_once;
mod brief;
mod bytes;
mod catalogue;
mod color_range;
mod disk;
mod e57;
mod ept;
mod error;
mod export;
mod format;
mod guarded;
mod in_order;
mod info;
mod las;
mod pcd;
mod ply;
mod remote;
mod source;
mod text;
mod units;

pub use address::{beside, is_address, last_part};
pub use bytes::{Bytes, NamedFile};
pub use catalogue::{
    Entry as CatalogueEntry, Tile as CatalogueTile, entry_of, repeated as repeated_tiles, tiles_of, write_catalogue,
};
pub use error::{Error, Result, why_unwritten};
pub use export::{Added, ExportFormat, Exported, Runs, Wanted, export, export_chunks, missing_points, short_file_name};
pub use format::Format;
pub use info::{Image, Info, Scan, Selection, Summary, system_difference};
pub use las::copc_writer::{CopcSummary, write_copc};
pub use las::{Copc, CopcNode, CopcPage, PageNodes};
pub use remote::{NO_ANSWER, Network, trust_address, use_network};
pub use source::{Source, bounds_of, open, open_scans, open_within};
pub use text::table::{SKIP, UnnamedTable, are_columns_named, column_names, name_columns, name_columns_of};
pub use text::unnamed_table;
pub use units::{Unit, Units};
