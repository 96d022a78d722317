//! What is open: the clouds, the jobs that load them, the points that stand for mirrors, and what is known of the light around
//! them. How it comes and goes is told in `opening`, `streams`, `coloring`, `mirror_points` and `lights`.

pub mod clouds;
pub mod coloring;
pub mod figures;
pub mod light_search;
pub mod lights;
pub mod mirror_points;
pub mod opening;
pub mod streams;

use std::sync::Arc;
use std::time::Instant;

use cloud::Progress;
use glam::DVec3;
use scene::{Mirror, MirrorPoints, Visibility};
use world::{CloudKey, Input, Mailbox};

use crate::viewer::frames::Frames;
use crate::viewer::loaded::clouds::{CloudEntry, JobEntry, Samples, short_name};
use crate::viewer::loaded::light_search::LightSearch;
use crate::viewer::objects::{ObjectId, Objects};
use crate::viewer::outside::Outside;
use crate::viewer::pace::Pace;
use crate::viewer::preferences::Preferences;
use crate::viewer::scene::Scene;
use crate::viewer::theme::grouped;
use crate::viewer::tools::inspection::Inspection;
use crate::viewer::window::render_thread::PickedPoint;

#[derive(Default)]
pub struct Loaded {
    pub clouds: Vec<CloudEntry>,
    pub jobs: Vec<JobEntry>,
    pub samples: Samples,
    /// What is around the points, once they are all there.
    pub light_search: LightSearch,
    /// Of scene files whose clouds are still to come.
    pub awaited_markings: Vec<MirrorPoints>,
    /// Warnings that were given: not twice, though figures are renewed.
    pub warned: Vec<String>,
    pub pace: Pace,
    /// Bytes of all indexes, once they are counted.
    pub cache_size: Option<u64>,
    /// Streamed points are coloured by level.
    pub levels_are_shown: bool,
    /// As the render thread was told.
    pub expected_points: u64,
    pub drawn_visibility: Visibility,
    next_cloud: u32,
    next_job: u32,
}

/// The parts of the session that change with what is loaded, or decide about it.
pub struct Beside<'a> {
    pub scene: &'a mut Scene,
    pub frames: &'a mut Frames,
    pub preferences: &'a mut Preferences,
    pub inspection: Option<&'a Inspection>,
    /// A handle of the gizmo is in somebody's hand.
    pub handle_is_grabbed: bool,
    /// Only final pictures are wanted.
    pub is_recorded: bool,
    pub outside: &'a mut Outside,
}

impl Beside<'_> {
    pub fn mirrors(&self) -> impl Iterator<Item = (ObjectId, &Mirror)> {
        all_mirrors(&self.scene.objects, self.inspection)
    }
}

/// The mirrors of the scene, and the one that is held over it.
pub fn all_mirrors<'a>(
    objects: &'a Objects,
    held: Option<&'a Inspection>,
) -> impl Iterator<Item = (ObjectId, &'a Mirror)> {
    let placed = objects.mirrors.iter().map(|placed| (placed.id, &placed.mirror));
    placed.chain(held.into_iter().filter_map(|held| Some((held.id, held.mirror.as_ref()?))))
}

impl Loaded {
    pub fn cloud(&self, key: CloudKey) -> Option<&CloudEntry> {
        self.clouds.iter().find(|entry| entry.key == key)
    }

    pub fn cloud_mut(&mut self, key: CloudKey) -> Option<&mut CloudEntry> {
        self.clouds.iter_mut().find(|entry| entry.key == key)
    }

    pub fn next_cloud_key(&mut self) -> CloudKey {
        self.next_cloud += 1;
        CloudKey(self.next_cloud - 1)
    }

    /// The job that the window started for `inputs`; returns its number.
    pub fn add_job(&mut self, inputs: &[Input], progress: Arc<Progress>, mailbox: Arc<Mailbox>, now: Instant) -> u32 {
        let id = self.next_job;
        self.next_job += 1;
        self.jobs.push(JobEntry::new(id, inputs, progress, mailbox, now));
        id
    }

    /// Whole clouds to be turned into mirrors when they have come.
    pub fn await_marking(&mut self, points: MirrorPoints) {
        self.awaited_markings.push(points);
    }

    /// World position of a point: the file's own coordinates.
    pub fn world_position(&self, picked: PickedPoint) -> Option<DVec3> {
        let entry = self.cloud(picked.chunk.cloud)?;
        let chunk = entry.chunk(picked.chunk.part).filter(|chunk| picked.index < chunk.len())?;
        Some(entry.cloud.world_position(chunk, picked.index))
    }

    /// Normal of a point, if it has one.
    pub fn normal_at(&self, picked: PickedPoint) -> Option<DVec3> {
        let chunk = self.cloud(picked.chunk.cloud)?.chunk(picked.chunk.part)?;
        let normal = *chunk.normals.as_ref()?.get(picked.index)?;
        Some(cloud::unpack_normal(normal)?.as_dvec3())
    }

    /// The words of the command line that give what is visible.
    pub fn inputs(&self) -> Vec<String> {
        let mut inputs: Vec<String> = Vec::new();
        for entry in self.clouds.iter().filter(|entry| entry.is_visible) {
            if !inputs.contains(&entry.input) {
                inputs.push(entry.input.clone());
            }
        }
        inputs
    }

    /// What the window is called.
    pub fn title(&self) -> String {
        let points = self.all_points();
        match self.inputs().as_slice() {
            [] => "glint".into(),
            [one] => format!("{} - {} points - glint", short_name(one), grouped(points)),
            several => format!("{} clouds - {} points - glint", several.len(), grouped(points)),
        }
    }
}
