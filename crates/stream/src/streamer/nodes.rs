//! The nodes of a cloud in memory: how they are read, and in which forms they are kept and shown.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use cloud::{Chunk, Progress, SurfelOptions, pack_radius, provisional_radius};
use glam::DVec3;

use crate::radius_scale::{Field, Octants, Radii, count_octants, cube_center};
use crate::{Again, Error, NodeId, Octree, Result, prefix};

/// The bytes of a point in memory: if radii are scaled, a chunk's radii exist twice.
pub(super) const SCALED_RADIUS_BYTES: u64 = 2;

/// The result of a reader.
pub struct Page {
    /// All points of a node in batch order.
    pub chunk: Chunk,
    /// The number of bytes read from the disk for it.
    pub disk_bytes: u64,
}

/// A cloud whose pages can be read.
#[derive(Clone)]
pub struct PagedCloud {
    pub octree: Arc<Octree>,
    /// The size of a decoded point in bytes, with its normal and radius, without `exact_positions`.
    pub point_bytes: u64,
    pub missing: Missing,
    /// Reads a node; called by several threads at a time. Its radii are those of full density.
    pub read: Arc<dyn Fn(NodeId) -> Result<Page> + Send + Sync>,
}

impl PagedCloud {
    /// The memory of a whole node in bytes.
    pub(super) fn cost(&self, node: NodeId) -> u64 {
        let node = self.octree.node(node);
        let point_bytes = node.point_bytes(self.point_bytes).saturating_add(SCALED_RADIUS_BYTES);
        u64::from(node.points).saturating_mul(point_bytes)
    }
}

/// What to do for nodes whose pages have no radii.
#[derive(Clone, Copy, Debug)]
pub enum Missing {
    /// Estimates normals and radii from the node's own points.
    Estimate(SurfelOptions),
    /// Gives all points of a node one radius, according to its density. Normals stay missing.
    Provisional,
}

/// A change for the caller to draw; changes are applied in their order.
#[derive(Debug)]
pub enum NodeChange {
    /// The chunk of a node is new, or replaces its earlier form.
    Put { cloud: usize, node: NodeId, chunk: Chunk },
    /// The chunk of a node is removed.
    Drop { cloud: usize, node: NodeId },
    /// The node cannot be read; the others go on. It is tried again where that may help, and said once.
    Failed { cloud: usize, node: NodeId, error: Error },
    /// A node that could not be read has been read, or one that was too large has room now.
    Mended { cloud: usize, node: NodeId },
}

/// A node to read.
pub(super) struct Job {
    pub(super) cloud: usize,
    pub(super) node: NodeId,
    /// The generation of the cloud when the job was given out.
    pub(super) generation: u64,
    pub(super) paged: PagedCloud,
    /// The number of bytes reserved for it.
    pub(super) bytes: u64,
}

/// A decoded node.
#[derive(Clone)]
pub(super) struct Loaded {
    pub(super) node: NodeId,
    /// All of its points, or those of its first batches; radii are those of full density, unless they were estimated.
    pub(super) chunk: Chunk,
    /// The middle of the node's cube.
    pub(super) center: DVec3,
    /// The numbers of all of the node's points by octant.
    pub(super) own: Octants,
    /// Whether radii were estimated from the node's own points, so that they are those of its density.
    pub(super) is_estimated: bool,
    pub(super) disk_bytes: u64,
}

/// A node as it was handed over.
pub(super) struct ShownNode {
    pub(super) loaded: Loaded,
    pub(super) generation: u64,
    pub(super) drawn: Octants,
    /// The radii with which it is drawn.
    pub(super) radii: Radii,
}

#[derive(Default)]
pub(super) struct Entry {
    /// The number of wanted batches; 0 if the node is not wanted.
    pub(super) wanted: usize,
    /// The number of the last cut that wanted it. No child's is larger than its parent's.
    pub(super) wanted_at: u64,
    pub(super) in_flight: bool,
    pub(super) failed: bool,
    /// Whether the caller knows that the memory has no room for it.
    pub(super) is_too_large: bool,
    /// The latest read, if it failed.
    pub(super) again: Option<Again>,
    /// The decoded node if it is not shown, or will replace what is shown. All points, of the cloud's generation.
    pub(super) loaded: Option<Loaded>,
    pub(super) shown: Option<ShownNode>,
}

pub(super) struct CloudNodes {
    pub(super) paged: PagedCloud,
    /// The number of replacements so far.
    pub(super) generation: u64,
    /// The growth of radii that the shown chunks follow.
    pub(super) field: Field,
    /// The nodes that are shown with larger radii than necessary.
    pub(super) loose: BTreeSet<NodeId>,
    pub(super) entries: BTreeMap<NodeId, Entry>,
}

impl Job {
    pub(super) fn load(&self) -> Result<Loaded> {
        let Page { mut chunk, disk_bytes } = (self.paged.read)(self.node)?;
        let octree = &self.paged.octree;
        let node = octree.node(self.node);
        if chunk.len() != node.points as usize {
            return Err(Error::PageSize { found: chunk.len() as u64, expected: u64::from(node.points) });
        }
        chunk.first_point = node.first_point;
        let is_estimated = chunk.radii.is_none() && matches!(self.paged.missing, Missing::Estimate(_));
        self.paged.missing.fill(&mut chunk, octree, self.node);
        let center = cube_center(octree, self.node);
        Ok(Loaded { node: self.node, own: count_octants(&chunk, center), center, is_estimated, chunk, disk_bytes })
    }
}

impl Missing {
    /// Adds radii, if the chunk has none: those of the node's own density if they are estimated, else of full density.
    fn fill(self, chunk: &mut Chunk, octree: &Octree, id: NodeId) {
        if chunk.radii.is_some() {
            return;
        }
        match self {
            Self::Estimate(options) => {
                let surfels = cloud::estimate(std::slice::from_ref(chunk), &options, &Progress::default());
                if let Some(surfels) = surfels.and_then(|mut surfels| surfels.pop()) {
                    chunk.normals = Some(Arc::new(surfels.normals));
                    chunk.radii = Some(Arc::new(surfels.radii));
                }
            }
            Self::Provisional => {
                let node = octree.node(id);
                let radius = pack_radius(provisional_radius(node.bounds, node.total));
                chunk.radii = Some(Arc::new(vec![radius; chunk.len()]));
            }
        }
    }
}

impl Loaded {
    pub(super) fn bytes(&self) -> u64 {
        self.chunk.size_in_bytes() as u64 + self.chunk.len() as u64 * SCALED_RADIUS_BYTES
    }

    /// The radii that the field gives its points.
    pub(super) fn radii(&self, id: NodeId, field: &Field) -> Radii {
        match self.is_estimated {
            true => field.radii_of_density(id, &self.chunk, &self.own),
            false => field.radii(id, &self.chunk),
        }
    }

    /// The node with only its first `points` points.
    pub(super) fn first(self, points: usize) -> Self {
        if points >= self.chunk.len() {
            return self;
        }
        let indices: Vec<u32> = (0..points as u32).collect();
        Self { chunk: self.chunk.select(&indices), ..self }
    }
}

impl ShownNode {
    pub(super) fn new(loaded: Loaded, generation: u64, radii: Radii) -> Self {
        let drawn = count_octants(&loaded.chunk, loaded.center);
        Self { loaded, generation, drawn, radii }
    }

    pub(super) fn points(&self) -> u64 {
        self.loaded.chunk.len() as u64
    }

    pub(super) fn put(&self, cloud: usize) -> NodeChange {
        let chunk = Chunk { radii: self.radii.clone(), ..self.loaded.chunk.clone() };
        NodeChange::Put { cloud, node: self.loaded.node, chunk }
    }

    /// Removes the node from the picture; `None` for a node without points, which was never put.
    pub(super) fn leave(&self, cloud: usize) -> Option<NodeChange> {
        (!self.loaded.chunk.is_empty()).then_some(NodeChange::Drop { cloud, node: self.loaded.node })
    }

    /// Puts the node again with these radii, if they differ.
    pub(super) fn rescale(&mut self, cloud: usize, radii: Radii, changes: &mut Vec<NodeChange>) {
        if radii != self.radii {
            self.radii = radii;
            changes.push(self.put(cloud));
        }
    }
}

impl Entry {
    pub(super) fn is_of_use(&self) -> bool {
        let is_told = self.failed || self.is_too_large || self.again.is_some();
        let is_known = is_told || self.loaded.is_some() || self.shown.is_some();
        self.wanted > 0 || self.in_flight || is_known
    }

    /// Whether children may be shown: its points are shown, or never will be.
    pub(super) fn is_present(&self) -> bool {
        self.shown.is_some() || self.failed
    }
}

impl CloudNodes {
    pub(super) fn entry(&self, node: NodeId) -> Option<&Entry> {
        self.entries.get(&node)
    }

    /// The number of points to show of a wanted node.
    pub(super) fn wanted_points(&self, node: NodeId, wanted: usize) -> usize {
        prefix(self.paged.octree.node(node).points as usize, wanted)
    }

    /// Whether all that is wanted of a node is shown, or more.
    pub(super) fn is_satisfied(&self, node: NodeId, entry: &Entry) -> bool {
        let points = self.wanted_points(node, entry.wanted) as u64;
        let enough = |shown: &ShownNode| shown.generation == self.generation && shown.points() >= points;
        entry.failed || entry.shown.as_ref().is_some_and(enough)
    }
}
