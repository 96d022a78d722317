//! What clouds and their chunks are known by, from the event that brings them to their place on the GPU.

use stream::NodeId;

/// A cloud. A number is never used twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CloudKey(pub u32);

/// Which points of a cloud a chunk holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Part {
    /// Some points of all places, shown while the index is made. Previews are numbered as they come.
    Preview(u32),
    /// The points of a file from that record on, as far as the reader's block goes: the same in every read.
    Block(u64),
    /// The points of a node of the cloud's octree.
    Node(NodeId),
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
