//! The nodes of a cloud in memory: how they are read, and in which forms they are kept and shown.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use cloud::{Chunk, Progress, SurfelOptions, pack_radius, provisional_radius};
use glam::DVec3;

use crate::radius_scale::{Field, Octants, Radii, count_octants, cube_center, to_full_density};
use crate::{Error, NodeId, Octree, Result, prefix};

/// A chunk's radii are held twice where they are scaled.
pub(super) const SCALED_RADIUS_BYTES: u64 = 2;

/// What a reader gives.
pub struct Page {
    /// All points of a node in the order of their batches.
    pub chunk: Chunk,
    /// That were read for it from the disk.
    pub disk_bytes: u64,
}

/// A cloud whose pages can be read.
#[derive(Clone)]
pub struct PagedCloud {
    pub octree: Arc<Octree>,
    /// Bytes of a decoded point, its normal and radius included, without `exact_positions`.
    pub point_bytes: u64,
    pub missing: Missing,
    /// Called by several threads at a time. Radii that it gives are those of full density.
    pub read: Arc<dyn Fn(NodeId) -> Result<Page> + Send + Sync>,
}

impl PagedCloud {
    /// Bytes of a whole node in memory.
    pub(super) fn cost(&self, node: NodeId) -> u64 {
        let node = self.octree.node(node);
        let point_bytes = node.point_bytes(self.point_bytes).saturating_add(SCALED_RADIUS_BYTES);
        u64::from(node.points).saturating_mul(point_bytes)
    }
}

/// What is done for nodes whose pages have no radii.
#[derive(Clone, Copy, Debug)]
pub enum Missing {
    /// Normals and radii are estimated from the node's own points.
    Estimate(SurfelOptions),
    /// One radius for all of a node's points, after its density. Normals stay missing.
    Provisional,
}

/// What has changed for whoever draws: to be done in this order.
#[derive(Debug)]
pub enum Change {
    /// The chunk of a node comes, or takes another form.
    Put { cloud: usize, node: NodeId, chunk: Chunk },
    /// The chunk of a node goes.
    Drop { cloud: usize, node: NodeId },
    /// The node cannot be read, and is not tried again; the others go on.
    Failed { cloud: usize, node: NodeId, error: Error },
}

/// A node to read.
pub(super) struct Job {
    pub(super) cloud: usize,
    pub(super) node: NodeId,
    /// Of the cloud when the job was given out.
    pub(super) generation: u64,
    pub(super) paged: PagedCloud,
    /// Set aside for it.
    pub(super) bytes: u64,
}

/// A decoded node.
#[derive(Clone)]
pub(super) struct Loaded {
    pub(super) node: NodeId,
    /// All of its points, or those of its first batches; radii are those of full density.
    pub(super) chunk: Chunk,
    /// Of the node's cube.
    pub(super) center: DVec3,
    /// Of all of the node's points.
    pub(super) own: Octants,
    /// Radii are those of the node's own points, made those of full density.
    pub(super) is_estimated: bool,
    pub(super) disk_bytes: u64,
}

/// A node as it was handed over.
pub(super) struct ShownNode {
    pub(super) loaded: Loaded,
    pub(super) generation: u64,
    pub(super) drawn: Octants,
    /// That it is drawn with.
    pub(super) radii: Radii,
}

#[derive(Default)]
pub(super) struct Entry {
    /// Batches; 0: not wanted.
    pub(super) wanted: usize,
    /// The number of the last cut that wanted it. No child's is larger than its parent's.
    pub(super) wanted_at: u64,
    pub(super) in_flight: bool,
    pub(super) failed: bool,
    /// Not shown, or to take the place of what is shown. All points, of the cloud's generation.
    pub(super) loaded: Option<Loaded>,
    pub(super) shown: Option<ShownNode>,
}

pub(super) struct Held {
    pub(super) paged: PagedCloud,
    /// Counts replacements.
    pub(super) generation: u64,
    /// What is shown follows it.
    pub(super) field: Field,
    /// Nodes that are shown with larger radii than need be.
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
    /// Radii of full density, where the chunk has none.
    fn fill(self, chunk: &mut Chunk, octree: &Octree, id: NodeId) {
        if chunk.radii.is_some() {
            return;
        }
        match self {
            Self::Estimate(options) => {
                let surfels = cloud::estimate(std::slice::from_ref(chunk), &options, &Progress::default());
                if let Some(mut surfels) = surfels.and_then(|mut surfels| surfels.pop()) {
                    to_full_density(&mut surfels.radii, chunk, octree, id);
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
        field.radii(id, &self.chunk, !self.is_estimated)
    }

    /// Its first so many points.
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

    pub(super) fn put(&self, cloud: usize) -> Change {
        let chunk = Chunk { radii: self.radii.clone(), ..self.loaded.chunk.clone() };
        Change::Put { cloud, node: self.loaded.node, chunk }
    }

    /// `None` for a node without points, which was never put.
    pub(super) fn leave(&self, cloud: usize) -> Option<Change> {
        (!self.loaded.chunk.is_empty()).then_some(Change::Drop { cloud, node: self.loaded.node })
    }

    /// Puts it anew with these radii, if they are other ones.
    pub(super) fn rescale(&mut self, cloud: usize, radii: Radii, changes: &mut Vec<Change>) {
        if radii != self.radii {
            self.radii = radii;
            changes.push(self.put(cloud));
        }
    }
}

impl Entry {
    pub(super) fn is_of_use(&self) -> bool {
        self.wanted > 0 || self.in_flight || self.failed || self.loaded.is_some() || self.shown.is_some()
    }

    /// Whether children may be shown: its points are there, or never will be.
    pub(super) fn is_present(&self) -> bool {
        self.shown.is_some() || self.failed
    }
}

impl Held {
    pub(super) fn entry(&self, node: NodeId) -> Option<&Entry> {
        self.entries.get(&node)
    }

    /// Points that are to be shown of a wanted node.
    pub(super) fn wanted_points(&self, node: NodeId, wanted: usize) -> usize {
        prefix(self.paged.octree.node(node).points as usize, wanted)
    }

    /// Whether what is shown of a wanted node is what is wanted, or more.
    pub(super) fn is_satisfied(&self, node: NodeId, entry: &Entry) -> bool {
        let points = self.wanted_points(node, entry.wanted) as u64;
        let enough = |shown: &ShownNode| shown.generation == self.generation && shown.points() >= points;
        entry.failed || entry.shown.as_ref().is_some_and(enough)
    }
}
