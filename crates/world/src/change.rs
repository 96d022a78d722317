//! The changes to be made on the GPU.

use std::sync::Arc;

use cloud::{Bounds, Chunk, CloudLayout, PointTest};
use glam::DVec3;
use render::ColorPlan;
use scene::Mirror;

use crate::chunk_key::{ChunkKey, CloudKey, Part};
use crate::mirrors::Marked;

pub enum Change {
    Open {
        cloud: CloudKey,
        /// The radius of points whose own is not known, in world units.
        provisional_radius: f32,
    },
    /// Reserves room for this many points of all clouds together; replaces any earlier number.
    Expect {
        points: u64,
    },
    /// Sets the bounds that contain the whole cloud.
    Bounds {
        cloud: CloudKey,
        bounds: Bounds,
    },
    /// Adds the chunk, or replaces the one with the same key.
    Put {
        key: ChunkKey,
        chunk: Chunk,
        layout: Arc<CloudLayout>,
    },
    TakeOut {
        key: ChunkKey,
    },
    /// Shows chunks in one colour each, or (`None`) in their own again.
    Tint {
        tints: Vec<(ChunkKey, Option<[u8; 4]>)>,
    },
    /// Colours a cloud; `chunks` have the column that the plan needs.
    Color {
        cloud: CloudKey,
        chunks: Vec<(Part, Chunk)>,
        plan: ColorPlan,
        up: DVec3,
    },
    /// Enlarges the points of a cloud: those that are put from now on have `size` times their radii.
    Size {
        cloud: CloudKey,
        size: f32,
    },
    Show {
        cloud: CloudKey,
        is_visible: bool,
    },
    /// Sets which points of all clouds are shown.
    Visibility {
        test: PointTest,
    },
    /// Sets which points of a cloud reflect, by lists for these chunks; they become clouds of their own on the GPU.
    Mark {
        cloud: CloudKey,
        chunks: Vec<(Part, Chunk)>,
        layout: Arc<CloudLayout>,
        marked: Arc<Vec<Marked>>,
    },
    /// Adds the points that represent a mirror, or replaces those with the same key.
    Mirror {
        cloud: CloudKey,
        mirror: Mirror,
        samples: Vec<Chunk>,
    },
    Close {
        cloud: CloudKey,
    },
}
