//! What a job tells of the clouds that it loads.

use std::path::PathBuf;
use std::sync::Arc;

use cloud::{Attribute, Chunk, Grid, Surfels};
use glam::DVec3;
use scene::Mirror;
use stream::Octree;

use crate::chunk_key::Part;
use crate::task::CloudTask;

/// What is known of a cloud before its points come.
#[derive(Clone, Default)]
pub struct Opened {
    pub name: String,
    /// As on the command line or in the scene file.
    pub input: String,
    pub source: Option<Arc<codec::Source>>,
    pub attributes: Vec<Attribute>,
    pub grid: Option<Grid>,
    /// Points a full read should yield.
    pub expected_points: u64,
    /// Unit vector.
    pub up: DVec3,
    /// World units, for points whose radius is not known yet; 0 where not even the extent is known.
    pub provisional_radius: f32,
    pub warnings: Vec<String>,
}

/// What a job tells. `cloud` counts from 0 within the job.
pub enum Event {
    /// A header was read, or a built-in scene begun.
    Opened { cloud: usize, opened: Opened },
    /// Some points of a cloud; they take the place of the same part.
    Chunk { cloud: usize, part: Part, chunk: Chunk },
    /// The cloud is streamed: its chunks are those of its points that the last look needs, and come and go. Follows `Opened`,
    /// and comes again when more is known.
    Pages { cloud: usize, pages: IndexState },
    /// Something is or will be made for the cloud, in the place of what was made for it before.
    Task { cloud: usize, task: Arc<CloudTask> },
    /// That part is no more needed.
    Dropped { cloud: usize, part: Part },
    /// What is there of all streamed clouds, whenever that changes, a few times a second at most.
    Stream(StreamStats),
    /// A mirror of a built-in scene, and the points that stand for it.
    Mirror { input: String, mirror: Mirror, samples: Vec<Chunk> },
    /// All chunks of the cloud that will come have been sent; of a streamed one, all that the first look needs.
    Read { cloud: usize, summary: codec::Summary },
    /// Normals and radii that the file lacks, one per chunk in the order of their parts.
    Surfels { cloud: usize, surfels: Vec<Surfels> },
    /// An input, or what is left of it, cannot be shown; the others go on.
    Failed {
        input: String,
        error: String,
        /// The input is at fault, and not the disk or the program.
        is_usage: bool,
    },
    /// The last event; where clouds are streamed, it comes when they are closed. A channel that closes without it means that the loading thread died.
    Finished,
}

/// How far the pages of a streamed cloud are.
#[derive(Clone, Debug)]
pub enum IndexState {
    /// The index is being made, or will be (`Event::Task`). Chunks that come meanwhile are a preview: some points of all places.
    Indexing,
    /// The index is there. Comes again when normals and radii have been worked out.
    Indexed {
        octree: Arc<Octree>,
        /// Of the points' coordinates, where the file has one.
        grid: Option<Grid>,
        /// Made by this job, not found in the cache or in the file.
        was_built: bool,
        /// Whether normals and radii are those of all points; until then each node's are estimated from its own.
        has_surfels: bool,
        /// `None` for a COPC file, which is its own index.
        entry: Option<IndexEntry>,
    },
}

impl IndexState {
    /// The index, where it is in the cache.
    pub fn entry(&self) -> Option<&IndexEntry> {
        match self {
            Self::Indexed { entry, .. } => entry.as_ref(),
            Self::Indexing => None,
        }
    }
}

/// An index in the cache.
#[derive(Clone, Debug)]
pub struct IndexEntry {
    pub folder: PathBuf,
    /// On the disk.
    pub bytes: u64,
}

/// What is there of all streamed clouds of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamStats {
    /// The look that it is about: what `Mailbox::look` gave back; 0 before the first one.
    pub view_number: u64,
    /// Nothing is left to be done for it: all that it needs is there, and every index is complete.
    pub is_settled: bool,
    /// Nodes that are resident.
    pub nodes: usize,
    pub points_resident: u64,
    /// Of all streamed clouds whose index is there.
    pub points_total: u64,
    /// Memory that resident and kept nodes take.
    pub host_bytes: u64,
    /// Nodes that are wanted and not there yet.
    pub nodes_waiting: usize,
    /// Share of the whole budgets that the look would take, 0 to 1.
    pub demand: f64,
    /// Over the last second.
    pub disk_bytes_per_second: f64,
    /// Decoded over the last second.
    pub points_per_second: f64,
}
