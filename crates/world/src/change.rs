//! What is to be changed on the GPU.

use std::sync::Arc;

use cloud::{Bounds, Chunk};
use glam::DVec3;
use render::ColorPlan;
use scene::{Mirror, Visibility};

use crate::chunk_key::{ChunkKey, CloudKey, Part};
use crate::mirrors::Marked;

pub enum Change {
    Open {
        cloud: CloudKey,
        /// World units.
        provisional_radius: f32,
    },
    /// Reserves room for this many points of all clouds together; replaces any earlier number.
    Expect {
        points: u64,
    },
    /// All of a cloud lies in these bounds.
    Bounds {
        cloud: CloudKey,
        bounds: Bounds,
    },
    /// Adds the chunk, or puts it in the place of the one with the same key. `classes`: the column that holds the classes.
    Put {
        key: ChunkKey,
        chunk: Chunk,
        classes: Option<usize>,
    },
    TakeOut {
        key: ChunkKey,
    },
    /// Shows chunks in one colour each, or (`None`) again in their own.
    Tint {
        tints: Vec<(ChunkKey, Option<[u8; 4]>)>,
    },
    /// Colours a cloud; the column that the plan asks for is that of `chunks`.
    Color {
        cloud: CloudKey,
        chunks: Vec<(Part, Chunk)>,
        plan: ColorPlan,
        up: DVec3,
    },
    Show {
        cloud: CloudKey,
        is_visible: bool,
    },
    /// Says which points of all clouds are shown.
    Visibility {
        visibility: Visibility,
    },
    /// Says which points of a cloud reflect, by lists for these chunks; they are clouds of their own on the GPU.
    Mark {
        cloud: CloudKey,
        chunks: Vec<(Part, Chunk)>,
        classes: Option<usize>,
        marked: Arc<Vec<Marked>>,
    },
    /// Points that stand for a mirror, in the place of those that did under the same key.
    Mirror {
        cloud: CloudKey,
        mirror: Mirror,
        samples: Vec<Chunk>,
    },
    Close {
        cloud: CloudKey,
    },
}
