//! Loads the nodes of a cut: worker threads read pages in the order of their importance, a cache keeps decoded chunks
//! within a limit of bytes, and the caller gets the changes to draw in an order in which nothing blinks.
//!
//! - A chunk is *shown* from the [`NodeChange::Put`] that hands it over to its [`NodeChange::Drop`]. The shown nodes are closed
//!   towards the root: a child comes after its parent and goes before it, so no place that had points loses all of them.
//! - Where points come, their chunks are put first, and the radii of the points that represented them shrink afterwards;
//!   where points go, the radii of those that stay grow first.
//! - Nodes that the last cut does not want stay shown until the budget needs their place, or go at once if
//!   [`Streamer::show_only_wanted`] is set; the least recently wanted goes first. They stay in memory after that as long as
//!   there is room.
//! - The limit counts all decoded chunks: shown, kept and being read. A dropped chunk no longer counts from the call of
//!   [`Streamer::changes`] that says so, though the caller may hold it for a little longer.

mod nodes;
mod plan;
mod state;

use std::any::Any;
use std::panic::AssertUnwindSafe;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use nodes::Job;
pub use nodes::{Missing, NodeChange, Page, PagedCloud};
use state::State;
pub use state::StreamerStats;

use crate::{Budget, Error, Octree, Wanted};

/// Loads nodes and says what to draw. All calls return at once: threads of its own read.
pub struct Streamer {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    /// Signals that there may be something to read, or room for it.
    work: Condvar,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl Streamer {
    /// Starts `workers` threads. They call `wake` whenever [`Streamer::changes`] has something to do; it must not drop
    /// the streamer.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub fn new(workers: usize, budget: Budget, wake: impl Fn() + Send + Sync + 'static) -> std::io::Result<Self> {
        let state = Mutex::new(State::new(budget, workers.max(1)));
        let shared = Arc::new(Shared { state, work: Condvar::new(), wake: Box::new(wake) });
        let mut streamer = Self { shared, workers: Vec::new() };
        for index in 0..workers.max(1) {
            let shared = streamer.shared.clone();
            let worker = std::thread::Builder::new().name(format!("pages {index}"));
            streamer.workers.push(worker.spawn(move || shared.work())?);
        }
        Ok(streamer)
    }

    /// Adds a cloud under an unused number.
    pub fn add(&self, cloud: usize, paged: PagedCloud) {
        self.replace(cloud, paged);
    }

    /// Replaces the way in which the cloud is read, for example when its radii are known. Shown nodes stay until they
    /// have been read again; if the octree is another one, they are dropped.
    pub fn replace(&self, cloud: usize, paged: PagedCloud) {
        self.shared.lock().replace(cloud, paged);
        self.shared.work.notify_all();
    }

    /// Replaces the octree of a cloud by one that has the nodes of other pages of its list. What is shown of nodes that it
    /// does not have is dropped.
    pub fn know(&self, cloud: usize, octree: Arc<Octree>) {
        self.shared.lock().know(cloud, octree);
        self.shared.work.notify_all();
    }

    /// Removes a cloud. No change of it follows: the caller drops its chunks.
    pub fn remove(&self, cloud: usize) {
        let mut state = self.shared.lock();
        state.asked.retain(|wanted| wanted.cloud != cloud);
        state.remove(cloud);
        drop(state);
        self.shared.work.notify_all();
    }

    /// Sets the cut: the nodes to show from now on, the most important first, parents before children, as
    /// [`crate::choose`] gives them. It replaces the last one: nodes that are no longer wanted and not being read yet
    /// will not be read. Nodes beyond the budget are left out, and so are nodes without their parent.
    pub fn want(&self, wanted: Vec<Wanted>) {
        self.shared.lock().want(wanted);
        self.shared.work.notify_all();
    }

    /// Whether only nodes of the last cut may be shown: then the final state does not depend on earlier cuts.
    pub fn show_only_wanted(&self, only_wanted: bool) {
        self.shared.lock().only_wanted = only_wanted;
    }

    /// Sets the largest numbers of shown points and of bytes of decoded chunks.
    pub fn set_budget(&self, budget: Budget) {
        let mut state = self.shared.lock();
        state.set_budget(budget);
        drop(state);
        self.shared.work.notify_all();
    }

    /// Has nodes read again that the cut wants and that could not be read, if it is time for that. `is_other_view` says that
    /// the view has changed, which counts where a node was given up.
    pub fn try_again(&self, now: Instant, is_other_view: bool) {
        if self.shared.lock().try_again(now, is_other_view) {
            self.shared.work.notify_all();
        }
    }

    /// The changes since the last call. The caller asks after each wake, and after a new cut or budget: nodes that are
    /// already in memory come at once. If a chunk shares its `positions` with the one that it replaces, only its radii
    /// differ.
    pub fn changes(&self) -> Vec<NodeChange> {
        let changes = self.shared.lock().changes();
        if !changes.is_empty() {
            self.shared.work.notify_all();
        }
        changes
    }

    pub fn stats(&self) -> StreamerStats {
        self.shared.lock().stats()
    }
}

impl Drop for Streamer {
    fn drop(&mut self) {
        self.shared.lock().stopped = true;
        self.shared.work.notify_all();
        for worker in self.workers.drain(..) {
            // The worker has caught its own panics.
            let _ = worker.join();
        }
    }
}

impl Shared {
    /// Locks the state. A poisoned lock is usable: the state is changed by short functions that do not panic half-way.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The loop of each thread.
    fn work(&self) {
        while let Some(job) = self.next_job() {
            let page = std::panic::catch_unwind(AssertUnwindSafe(|| job.load()));
            let page = page.unwrap_or_else(|panic| Err(Error::Panicked(message(panic.as_ref()))));
            self.lock().finish(job, page);
            self.work.notify_all();
            (self.wake)();
        }
    }

    /// Waits for a job; `None` at the end.
    fn next_job(&self) -> Option<Job> {
        let mut state = self.lock();
        while !state.stopped {
            if let Some(job) = state.next_job() {
                return Some(job);
            }
            // There is something to read but no room: the caller is to make room by dropping chunks.
            if !state.queue.is_empty() && !state.asks_for_room {
                state.asks_for_room = true;
                drop(state);
                (self.wake)();
                state = self.lock();
                continue;
            }
            state = self.work.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        None
    }
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| text.to_string());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}

#[cfg(test)]
#[path = "streamer_tests.rs"]
mod tests;
