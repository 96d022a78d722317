//! Clouds larger than memory: an octree of pages on disk, which of them a view needs, and their way into memory under a budget.
//!
//! An [`Octree`] says where points lie and how many; [`Pages`] reads the points of one of its nodes. Each point is stored once:
//! inner nodes hold an even subset of what lies in their cube, and what is drawn of a place is all nodes from the root down to
//! where the view stops. A page's points come in batches: any prefix of them is an even subset, too.

mod batches;
mod cut;
mod error;
mod octree;
mod radius_scale;
mod streamer;
#[cfg(test)]
mod test_trees;

pub use batches::{BATCHES, prefix, rank_of_batch};
pub use cut::{Budget, Tree, ViewMeasure, Wanted, choose};
pub use error::{Error, Result};
pub use octree::{Node, NodeId, Octree};
pub use streamer::{Change, Missing, Page, PagedCloud, StreamStats, Streamer};
