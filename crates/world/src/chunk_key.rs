//! The keys of clouds and their chunks, from the event that brings them to their place on the GPU.

use stream::NodeId;

/// A cloud. A number is never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudKey(pub u32);

/// The points of its cloud that a chunk holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Part {
    /// Some points from all over the cloud, shown while the index is made. Previews are numbered in the order of
    /// arrival.
    Preview(u32),
    /// The points of a file from that record to the end of the reader's block, which is the same in every read.
    Block(u64),
    /// The points of a node of the cloud's octree.
    Node(NodeId),
    /// The points of a node of the octree of a tile, by the tile's place in its catalogue.
    Tile(u32, NodeId),
}

/// A chunk of a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ChunkKey {
    pub cloud: CloudKey,
    pub part: Part,
}

impl CloudKey {
    pub fn chunk(self, part: Part) -> ChunkKey {
        ChunkKey { cloud: self, part }
    }
}
