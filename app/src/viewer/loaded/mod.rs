//! What is open: the clouds, the jobs that load them, the points that represent mirrors, and what is known about the
//! light around them. `opening`, `streams`, `coloring`, `mirror_points` and `lights` change it.

pub mod coloring;
mod comparing;
pub mod export;
pub mod ghosts;
pub mod lights;
pub mod mirror_points;
pub mod opening;
mod own_settings;
mod shown_radii;
pub mod streams;

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::{Arc, Weak};
use std::time::Instant;

use cloud::{PointTest, Progress};
use codec::Runs;
use glam::DVec3;
use scene::{CloudSettings, Mirror, MirrorPoints};
use world::{CloudKey, Input, Mailbox};

use crate::shared::language::text;
use crate::viewer::frames::Frames;
use crate::viewer::jobs::comparisons::Comparisons;
use crate::viewer::jobs::ghosts::Ghosts;
use crate::viewer::objects::clouds::{CloudEntry, JobEntry, Samples};
use crate::viewer::objects::inspection::Inspection;
use crate::viewer::objects::{ObjectId, Objects};
use crate::viewer::picture::messages::PickedPoint;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::scene::Scene;
use crate::viewer::scene::light_search::LightSearch;

#[derive(Default)]
pub struct Loaded {
    pub clouds: Vec<CloudEntry>,
    pub jobs: Vec<JobEntry>,
    pub samples: Samples,
    /// What surrounds the points, found out once they are all loaded.
    pub light_search: LightSearch,
    /// The markings of scene files whose clouds are not open yet.
    pub awaited_markings: Vec<MirrorPoints>,
    /// What clouds of scene files have of their own that are not open yet.
    pub awaited_settings: Vec<CloudSettings>,
    /// What was named to be opened, also if it could not be, or was not.
    pub words: HashSet<String>,
    /// The warnings that were already shown: they are not repeated when figures are renewed.
    pub warned: Vec<String>,
    /// The size of all indexes in bytes, once it is measured.
    pub cache_size: Option<u64>,
    /// True while streamed points are coloured by level.
    pub levels_are_shown: bool,
    /// The number of points and the test of what is shown that the render thread last heard of.
    pub expected_points: u64,
    pub drawn_test: PointTest,
    /// The file of exported points that is being written.
    pub writing: Option<Writing>,
    /// The values of comparisons and ghosts that are in a file.
    pub saved_values: Vec<Weak<Runs>>,
    pub comparisons: Comparisons,
    pub ghosts: Ghosts,
    next_cloud: u32,
    next_job: u32,
}

/// A file of exported points that is being written.
pub struct Writing {
    pub path: PathBuf,
    pub progress: Arc<Progress>,
    /// The values of comparisons and ghosts that are written with the points.
    pub added: Vec<Weak<Runs>>,
}

/// Work in the background that ends with the program, and whose result is lost then.
pub struct Running<'a> {
    what: String,
    pub progress: &'a Arc<Progress>,
}

impl Running<'_> {
    /// How far it is, from 0 to 1.
    pub fn share(&self) -> f32 {
        (self.progress.done() as f32 / self.progress.total().max(1) as f32).min(1.0)
    }
}

impl std::fmt::Display for Running<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} ({:.0} %)", self.what, (self.share() * 100.0).floor())
    }
}

/// The parts of the session that change together with what is loaded, or that decide about it.
pub struct Beside<'a> {
    pub scene: &'a mut Scene,
    pub frames: &'a mut Frames,
    pub preferences: &'a mut Preferences,
    pub inspection: Option<&'a Inspection>,
    /// True while someone drags a handle of the gizmo.
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

/// The mirrors of the scene and the inspection mirror.
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

    /// Adds the job that the window started for `inputs`; returns its number.
    pub fn add_job(&mut self, inputs: &[Input], progress: Arc<Progress>, mailbox: Arc<Mailbox>, now: Instant) -> u32 {
        let id = self.next_job;
        self.next_job += 1;
        self.words.extend(inputs.iter().map(Input::name));
        self.jobs.push(JobEntry::new(id, inputs, progress, mailbox, now));
        id
    }

    /// Remembers whole clouds that become mirrors when they are opened.
    pub fn await_marking(&mut self, points: MirrorPoints) {
        self.awaited_markings.push(points);
    }

    /// The world position of a point, in the file's own coordinates.
    pub fn world_position(&self, picked: PickedPoint) -> Option<DVec3> {
        let entry = self.cloud(picked.chunk.cloud)?;
        let chunk = entry.chunk(picked.chunk.part).filter(|chunk| picked.index < chunk.len())?;
        Some(entry.cloud.world_position(chunk, picked.index))
    }

    /// The normal of a point, if it has one.
    pub fn normal_at(&self, picked: PickedPoint) -> Option<DVec3> {
        let chunk = self.cloud(picked.chunk.cloud)?.chunk(picked.chunk.part)?;
        let normal = *chunk.normals.as_ref()?.get(picked.index)?;
        Some(cloud::unpack_normal(normal)?.as_dvec3())
    }

    /// The file that is being written, the comparison and the search for ghosts, those of them that are under way.
    pub fn running(&self) -> Vec<Running<'_>> {
        let writing = self.writing.as_ref().map(|Writing { path, progress, .. }| {
            let name = path.file_name().unwrap_or(path.as_os_str());
            Running { what: text!("{name} is being saved", name = name.display()), progress }
        });
        let comparison = self.comparisons.under_way.as_ref();
        let comparison =
            comparison.map(|(what, progress)| Running { what: text!("{what}: being compared", what), progress });
        let ghosts = self.ghosts.under_way.as_ref();
        let ghosts = ghosts
            .map(|progress| Running { what: text!("ghosts are being looked for or put back").to_owned(), progress });
        writing.into_iter().chain(comparison).chain(ghosts).collect()
    }

    /// The names of the clouds with distances or ghosts that are in no file.
    pub fn unsaved_values(&self) -> impl Iterator<Item = &str> {
        let is_saved = |list: &Arc<Runs>| self.saved_values.iter().any(|saved| saved.as_ptr() == Arc::as_ptr(list));
        let is_lost = move |entry: &&CloudEntry| entry.added.iter().any(|(_, list)| !is_saved(list));
        self.clouds.iter().filter(is_lost).map(|entry| entry.cloud.name.as_str())
    }

    /// The words on the command line that would open what is visible.
    pub fn inputs(&self) -> Vec<String> {
        let mut inputs: Vec<String> = Vec::new();
        for entry in self.clouds.iter().filter(|entry| entry.is_visible) {
            if !inputs.contains(&entry.input) {
                inputs.push(entry.input.clone());
            }
        }
        inputs
    }
}
