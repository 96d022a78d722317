//! Clouds that are drawn from pages: what a view needs of them, and what of that is there.
//!
//! A job of `loading` tells the window or the headless command about streamed clouds by the same events as about any cloud.
//! The other way it is told where they look from: the [`Lookout`].

use std::collections::HashSet;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use scene::{Camera, Stream, ViewSettings};
use stream::Octree;

/// From where streamed clouds are looked at, and with which budgets.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    pub camera: Camera,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    pub view: ViewSettings,
    pub stream: Stream,
}

/// How far the pages of a streamed cloud are.
#[derive(Clone, Debug)]
pub enum Paged {
    /// The index is being made (`Job::progress`). Chunks that come meanwhile are a preview: some points of all places.
    Indexing,
    /// The index is there. Comes again when normals and radii have been worked out (`Job::surfel_progress`).
    Indexed {
        octree: Arc<Octree>,
        /// Made by this job, not found in the cache or in the file.
        was_built: bool,
        /// Whether normals and radii are those of all points; until then each node's are estimated from its own.
        has_surfels: bool,
    },
}

/// What is there of all streamed clouds of a job.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamStats {
    /// The look that it is about: what `Lookout::look` gave back; 0 before the first one.
    pub look: u64,
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
    /// Over the last second.
    pub disk_bytes_per_second: f64,
    /// Decoded over the last second.
    pub points_per_second: f64,
}

/// Tells the streaming thread of a job where its clouds are looked at from. The latest look counts.
#[derive(Default)]
pub struct Lookout {
    told: Mutex<Told>,
    changed: Condvar,
}

#[derive(Default)]
struct Told {
    looks: u64,
    viewpoint: Option<Viewpoint>,
    closed: HashSet<usize>,
    is_over: bool,
    is_news: bool,
}

impl Lookout {
    /// The number of the look, by which `StreamStats` name it. The same viewpoint again is the same look.
    pub fn look(&self, viewpoint: Viewpoint) -> u64 {
        let mut told = self.told();
        if told.viewpoint.as_ref() != Some(&viewpoint) {
            told.looks += 1;
            told.viewpoint = Some(viewpoint);
            self.notify(&mut told);
        }
        told.looks
    }

    /// Streams that cloud of the job no more.
    pub fn close(&self, cloud: usize) {
        let mut told = self.told();
        told.closed.insert(cloud);
        self.notify(&mut told);
    }

    /// Ends the streaming.
    pub fn end(&self) {
        let mut told = self.told();
        told.is_over = true;
        self.notify(&mut told);
    }

    /// Wakes who waits.
    pub fn wake(&self) {
        self.notify(&mut self.told());
    }

    fn notify(&self, told: &mut Told) {
        told.is_news = true;
        self.changed.notify_all();
    }

    /// Waits until there is news, `limit` at most.
    fn wait(&self, limit: Duration) -> MutexGuard<'_, Told> {
        let waited = self.changed.wait_timeout_while(self.told(), limit, |told| !told.is_news);
        let mut told = waited.unwrap_or_else(PoisonError::into_inner).0;
        told.is_news = false;
        told
    }

    fn told(&self) -> MutexGuard<'_, Told> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
