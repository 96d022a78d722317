//! The events of a job that loads clouds.

use std::path::PathBuf;
use std::sync::Arc;

use cloud::{Attribute, Chunk, Grid, Surfels};
use glam::DVec3;
use scene::Mirror;
use stream::Octree;

use crate::chunk_key::Part;
use crate::task::CloudTask;

/// The properties of a cloud that are known before its points come.
#[derive(Clone, Default)]
pub struct Opened {
    pub name: String,
    /// The input as on the command line or in the scene file.
    pub input: String,
    pub source: Option<Arc<codec::Source>>,
    /// The files of the cloud that were opened by their names. Those of catalogues come later.
    pub files: Arc<Vec<codec::NamedFile>>,
    pub attributes: Vec<Attribute>,
    /// The attributes that the files have. A streamed cloud has some of them, and more when it is asked for them
    /// (`StreamView::asked`).
    pub offered: Vec<Attribute>,
    pub grid: Option<Grid>,
    /// The coordinate system, as the file names it.
    pub crs: Option<String>,
    /// The units of the coordinates, as far as the file names them.
    pub units: codec::Units,
    /// The number of points that a full read should yield.
    pub expected_points: u64,
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// Where the scanner stood, in the coordinates of the file, if one place is known.
    pub scanner: Option<DVec3>,
    /// The radius of points whose own is not known yet, in world units; 0 if not even the extent is known.
    pub provisional_radius: f32,
    pub warnings: Vec<String>,
}

/// An event of a job. `cloud` counts from 0 within the job.
pub enum Event {
    /// A header was read, or a built-in scene begun.
    Opened { cloud: usize, opened: Opened },
    /// Some points of a cloud; they replace those of the same part.
    Chunk { cloud: usize, part: Part, chunk: Chunk },
    /// The cloud is streamed: its chunks are the points that the last view needs, and they come and go. Follows
    /// `Opened`, and is sent again when more is known.
    Pages { cloud: usize, pages: IndexState },
    /// A task was planned for the cloud; it replaces the cloud's earlier task.
    Task { cloud: usize, task: Arc<CloudTask> },
    /// The chunk of that part is no longer needed.
    Dropped { cloud: usize, part: Part },
    /// What has been loaded of all streamed clouds; sent when that changes, a few times a second at most.
    Stream(StreamStats),
    /// A mirror of a built-in scene, and the points that represent it.
    Mirror { input: String, mirror: Mirror, samples: Vec<Chunk> },
    /// All chunks of the cloud have been sent; for a streamed one, all that the first view needs.
    Read { cloud: usize, summary: codec::Summary },
    /// Normals and radii that the file lacks, one per chunk in the order of their parts.
    Surfels { cloud: usize, surfels: Vec<Surfels> },
    /// An input, or the remainder of it, cannot be shown; the others go on.
    Failed {
        input: String,
        error: String,
        /// Whether the input is at fault, and not the disk or the program.
        is_usage: bool,
    },
    /// What `Failed` has said to be missing has come, or is no longer wanted or read anew if not
    /// `has_come`: `problem` is what was said.
    Mended { input: String, problem: String, has_come: bool },
    /// The last event; with streamed clouds it is sent when they are closed. A channel that closes without it means
    /// that the loading thread died.
    Finished,
}

/// The state of the index of a streamed cloud.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one per streamed cloud")]
pub enum IndexState {
    /// The index is being made, or will be (`Event::Task`). Chunks that come meanwhile are a preview: some points from
    /// all over the cloud.
    Indexing,
    /// The index is complete. Sent again when normals and radii have been estimated.
    Indexed {
        octree: Arc<Octree>,
        /// The attributes in the order of the chunks' columns.
        attributes: Vec<Attribute>,
        /// The grid of the points' coordinates, if the file has one.
        grid: Option<Grid>,
        /// Whether this job made it, instead of finding it in the cache or in the file.
        was_built: bool,
        /// Whether normals and radii were estimated from all points; until then each node's are estimated from its own.
        has_surfels: bool,
        /// The entry in the cache; `None` for a COPC file, which is its own index.
        entry: Option<IndexEntry>,
    },
}

impl IndexState {
    /// The index's entry in the cache, if it has one.
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
    /// The size on the disk in bytes.
    pub bytes: u64,
}

/// What has been loaded of all streamed clouds of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamStats {
    /// The number of the view that these figures answer, from `Mailbox::set_view`; 0 before the first one.
    pub view_number: u64,
    /// Whether nothing remains to be done for the view: all nodes that it needs are resident, and every index is
    /// complete.
    pub is_settled: bool,
    /// The number of resident nodes.
    pub nodes: usize,
    pub points_resident: u64,
    /// The number of points of all streamed clouds that have an index.
    pub points_total: u64,
    /// The memory in bytes of nodes that are resident or kept for later.
    pub host_bytes: u64,
    /// The number of nodes that are wanted but not resident yet, with the tiles that are to be opened for them.
    pub nodes_waiting: usize,
    /// Of clouds whose tiles are opened as views need them: the number of tiles that are open of those that the view needs,
    /// that of those, and that of all.
    pub tiles: [usize; 3],
    /// The share of the whole budgets that the view would take, 0 to 1.
    pub demand: f64,
    /// The bytes read per second, over the last second.
    pub disk_bytes_per_second: f64,
    /// The points decoded per second, over the last second.
    pub points_per_second: f64,
    /// The number of points of nodes that were to be read and cannot be.
    pub points_missing: u64,
    /// The number of these nodes, with the lists of nodes and the tiles that cannot be read.
    pub nodes_missing: usize,
    /// Whether some of them may come later: a server or a disk has failed.
    pub may_come: bool,
}
