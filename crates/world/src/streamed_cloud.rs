//! A cloud that is streamed, as the director has it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use cloud::Placement;
use stream::{NodeId, Octree};

use crate::chunk_key::Part;
use crate::event::IndexState;
use crate::lists::Lists;

/// A cloud that is streamed.
pub(crate) struct StreamedCloud {
    /// The name that a person gave.
    pub(crate) input: String,
    /// The name of the cloud.
    pub(crate) name: String,
    pub(crate) octree: Arc<Octree>,
    /// The octree with its nodes where the last view has them, or the first one will, if they are moved.
    pub(crate) placed: Option<(Placement, Octree)>,
    /// The list of its nodes, if it is read page by page.
    pub(crate) lists: Option<Lists>,
    /// What the receiver was last told of its index.
    pub(crate) state: IndexState,
    /// Whether its pages can be made again.
    pub(crate) is_own: bool,
    pub(crate) point_bytes: u64,
    /// The number of points of each chunk that the receiver has.
    pub(crate) resident: HashMap<Part, u64>,
    /// Chunks from before the streamer began anew. They are removed when the next cut is complete, unless that contains
    /// them.
    pub(crate) stale: HashMap<Part, u64>,
    /// The summary that the receiver gets when the first cut is complete.
    pub(crate) summary: Option<codec::Summary>,
    /// Whether a part of it could not be read and its pages are being made again.
    pub(crate) is_damaged: bool,
    /// The nodes that cannot be read, whether each may come later, and what the receiver was told of them.
    pub(crate) missing: BTreeMap<NodeId, bool>,
    pub(crate) told: Option<String>,
}

impl StreamedCloud {
    /// What was told of nodes and of lists of nodes that are missing: it is no longer so where all is read anew.
    pub(crate) fn take_told(&mut self) -> impl Iterator<Item = String> + use<> {
        let of_lists = self.lists.as_mut().and_then(Lists::take_told);
        self.told.take().into_iter().chain(of_lists)
    }

    /// The number of points of nodes that cannot be read.
    pub(crate) fn points_missing(&self) -> u64 {
        let points = |node: &NodeId| self.octree.get(*node).map_or(0, |node| u64::from(node.points));
        self.missing.keys().map(points).sum()
    }

    /// For each node and each list of nodes that cannot be read, whether it may come later.
    pub(crate) fn missing(&self) -> impl Iterator<Item = bool> {
        self.missing.values().copied().chain(self.lists.iter().flat_map(Lists::missing))
    }

    /// Whether its pages are being made again.
    pub(crate) fn is_awaited(&self) -> bool {
        self.is_own && self.is_damaged
    }

    /// Moves its nodes to where a view has them.
    pub(crate) fn place(&mut self, placement: Option<&Placement>) {
        if self.placed.as_ref().map(|(placement, _)| placement) != placement {
            self.placed = placement.map(|placement| (*placement, self.octree.placed(placement)));
        }
    }

    pub(crate) fn nodes(&self) -> &Octree {
        self.placed.as_ref().map_or(&self.octree, |(_, octree)| octree)
    }
}
