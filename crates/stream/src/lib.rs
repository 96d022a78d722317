//! Streams clouds that are larger than memory: an octree of pages on disk, the choice of the pages that a view needs,
//! and a thread that loads them within a budget.
//!
//! An [`Octree`] says where the points lie and how many there are; [`Pages`] reads the points of one of its nodes. Each
//! point is stored once: an inner node holds an even subset of the points in its cube, and a place is drawn from all
//! nodes from the root down to the level at which the view stops. The points of a page come in batches: any prefix of
//! them is an even subset, too.

mod again;
mod batches;
mod buckets;
mod build;
mod cache;
mod copc;
mod cut;
mod entry;
mod error;
mod kept;
mod lattice;
mod node_table;
mod octree;
mod page;
mod pages;
mod plan;
mod preview;
mod radius_scale;
mod records;
mod regular_file;
mod selection;
mod storage;
mod streamer;
mod surfel_file;
mod surfels;
#[cfg(test)]
mod test_trees;
mod tree;

pub use again::Again;
pub use batches::{BATCHES, prefix, rank_of_batch};
pub use build::{BuildOptions, build, build_in_order, show_share};
pub use cache::Cache;
pub use cut::{Budget, Cut, MirrorBound, MirrorForm, Tree, ViewMeasure, Wanted, choose};
pub use error::{Error, Result};
pub use kept::{KeptSurfels, SurfelPlace};
pub use node_table::NodeTable;
pub use octree::{Node, NodeId, Octree, Paged};
pub use pages::{BUILDER, Pages};
pub use plan::{index_attributes, is_one_grid};
pub use preview::Previewed;
pub use streamer::{Missing, NodeChange, Page, PagedCloud, Streamer, StreamerStats};
pub use surfels::{coarsest, estimate_surfels};
