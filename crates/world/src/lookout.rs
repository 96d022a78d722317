//! What the loading threads are told: from where streamed clouds are looked at, and what is to be made or stopped.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cloud::SurfelOptions;
use scene::{Camera, Stream, ViewSettings};
use stream::Pages;

use crate::chunk_key::Part;
use crate::stage::Stage;

/// Nothing gives way to a picture for longer than this.
const LONGEST_FRAME: Duration = Duration::from_secs(2);

/// From where streamed clouds are looked at, and with which budgets.
#[derive(Clone, Debug, PartialEq)]
pub struct Viewpoint {
    pub camera: Camera,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    pub view: ViewSettings,
    pub stream: Stream,
    /// Clouds that are not looked at, by the job's own numbers.
    pub hidden: BTreeSet<usize>,
    /// Of the budgets that the job may have, 0 to 1.
    pub share: f64,
}

/// Tells a job where its streamed clouds are looked at from, the latest look counts, what there is to stream, and what is to be
/// made or stopped.
#[derive(Default)]
pub struct Lookout {
    told: Mutex<Told>,
    changed: Condvar,
}

#[derive(Default)]
pub(crate) struct Told {
    pub(crate) looks: u64,
    pub(crate) viewpoint: Option<Viewpoint>,
    pub(crate) closed: HashSet<usize>,
    /// All that were ever closed: what is still made for them is not shown.
    pub(crate) gone: HashSet<usize>,
    pub(crate) arrived: Vec<Arrival>,
    /// Nothing more is on its way.
    pub(crate) is_complete: bool,
    pub(crate) is_over: bool,
    pub(crate) wishes: Vec<Wish>,
    /// The latest of each cloud.
    pub(crate) stages: BTreeMap<usize, Arc<Stage>>,
    /// Nothing more is to be made.
    pub(crate) is_stopped: bool,
    /// Points of the previews of clouds whose index is still to be made.
    pub(crate) previews: BTreeMap<usize, u64>,
    /// Since when the first picture is being drawn.
    pub(crate) drawing_since: Option<Instant>,
    pub(crate) is_news: bool,
}

/// What is to be made of a cloud while nothing else is on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Its pages turned out to be damaged.
    Mend(usize),
    /// What was stopped.
    Resume(usize),
}

/// A cloud whose index is there, or is there with more.
pub struct Arrival {
    pub cloud: usize,
    /// As a person named it.
    pub input: String,
    pub pages: Arc<Pages>,
    /// Of the cache: they can be made again.
    pub is_own: bool,
    pub was_built: bool,
    /// For nodes whose normals and radii are not known; `None` for even provisional ones until they are.
    pub estimate: Option<SurfelOptions>,
    /// Points of the chunks that go as soon as the cut is there.
    pub previews: HashMap<Part, u64>,
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
        told.gone.insert(cloud);
        told.previews.remove(&cloud);
        told.arrived.retain(|arrival| arrival.cloud != cloud);
        told.stop(cloud);
        self.notify(&mut told);
    }

    pub fn is_closed(&self, cloud: usize) -> bool {
        self.told().gone.contains(&cloud)
    }

    /// Ends the streaming.
    pub fn end(&self) {
        let mut told = self.told();
        told.is_over = true;
        told.stop_all();
        self.notify(&mut told);
    }

    /// Keeps so many points of the budget for the preview of a cloud, until its index arrives.
    pub fn keep_room(&self, cloud: usize, points: u64) {
        let mut told = self.told();
        if told.gone.contains(&cloud) || points == 0 {
            told.previews.remove(&cloud);
        } else {
            told.previews.insert(cloud, points);
        }
        self.notify(&mut told);
    }

    /// The first picture begins or ends to be drawn: reading gives way to it.
    pub fn draw_first(&self, begins: bool) {
        let mut told = self.told();
        told.drawing_since = begins.then(|| told.drawing_since.unwrap_or_else(Instant::now));
        self.changed.notify_all();
    }

    /// Waits while the first picture is being drawn.
    pub fn give_way(&self) {
        let mut told = self.told();
        while let Some(since) = told.drawing_since.filter(|_| !told.is_over) {
            let Some(left) = LONGEST_FRAME.checked_sub(since.elapsed()) else { return };
            told = self.changed.wait_timeout(told, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Something that will be made for a cloud: already stopped, if that is so of all that is made.
    pub fn plan(&self, cloud: usize, stage: Stage) -> Arc<Stage> {
        let mut told = self.told();
        let stage = Arc::new(stage);
        told.stages.insert(cloud, stage.clone());
        if told.is_over || told.is_stopped || told.gone.contains(&cloud) {
            told.stop(cloud);
        }
        stage
    }

    /// The last thing that was planned for a cloud.
    pub fn stage(&self, cloud: usize) -> Option<Arc<Stage>> {
        self.told().stages.get(&cloud).cloned()
    }

    /// Stops what is made for a cloud.
    pub fn stop(&self, cloud: usize) {
        self.told().stop(cloud);
    }

    /// Stops all that is made.
    pub fn stop_all(&self) {
        self.told().stop_all();
    }

    /// Makes what was stopped of a cloud after all, when nothing else is made.
    pub fn resume(&self, cloud: usize) {
        let mut told = self.told();
        told.is_stopped = false;
        self.wish(&mut told, Wish::Resume(cloud));
    }

    pub fn arrive(&self, arrival: Arrival) {
        let mut told = self.told();
        told.previews.remove(&arrival.cloud);
        // What was damaged is so no more.
        told.wishes.retain(|wish| *wish != Wish::Mend(arrival.cloud));
        if !told.gone.contains(&arrival.cloud) {
            told.arrived.push(arrival);
            self.notify(&mut told);
        }
    }

    /// Says that nothing more is on its way, and waits until something is to be made. `None` when the streaming has ended.
    pub fn rest(&self) -> Option<Vec<Wish>> {
        let mut told = self.told();
        told.is_complete = told.wishes.is_empty();
        self.notify(&mut told);
        let waits = |told: &mut Told| !told.is_over && told.wishes.is_empty();
        let mut told = self.changed.wait_while(told, waits).unwrap_or_else(PoisonError::into_inner);
        // What is wished for now is not what was stopped before.
        told.is_stopped = told.is_over;
        if told.is_over { None } else { Some(std::mem::take(&mut told.wishes)) }
    }

    /// Says that the pages of a cloud are to be made again.
    pub fn report_damage(&self, cloud: usize) {
        self.wish(&mut self.told(), Wish::Mend(cloud));
    }

    fn wish(&self, told: &mut Told, wish: Wish) {
        if !told.wishes.contains(&wish) {
            told.wishes.push(wish);
        }
        // At once: who looks for the end of it must not see it between two states.
        told.is_complete = false;
        self.notify(told);
    }

    pub(crate) fn wake(&self) {
        self.notify(&mut self.told());
    }

    fn notify(&self, told: &mut Told) {
        told.is_news = true;
        self.changed.notify_all();
    }

    /// Waits until there is news, `limit` at most.
    pub(crate) fn wait(&self, limit: Duration) -> MutexGuard<'_, Told> {
        let waited = self.changed.wait_timeout_while(self.told(), limit, |told| !told.is_news);
        let mut told = waited.unwrap_or_else(PoisonError::into_inner).0;
        told.is_news = false;
        told
    }

    fn told(&self) -> MutexGuard<'_, Told> {
        self.told.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Told {
    fn stop(&self, cloud: usize) {
        self.stages.get(&cloud).iter().for_each(|stage| stage.progress.cancel());
    }

    fn stop_all(&mut self) {
        self.is_stopped = true;
        self.stages.values().for_each(|stage| stage.progress.cancel());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::{Making, Standing};

    #[test]
    fn what_is_made_is_stopped_for_one_cloud_or_for_all() {
        let lookout = Lookout::default();
        let plan = |cloud| lookout.plan(cloud, Stage::new(Making::Index, 1));
        let stages = [0, 1, 2, 3].map(plan);
        let standings = || stages.each_ref().map(|stage| stage.standing() == Standing::Stopped);
        lookout.stop(0);
        lookout.close(1);
        assert_eq!(standings(), [true, true, false, false]);
        assert!(plan(0).is_pending() && !plan(1).is_pending(), "nothing is made of what is closed");
        lookout.stop_all();
        assert_eq!(standings(), [true; 4]);
        assert!(!plan(2).is_pending());
        lookout.resume(2);
        assert_eq!(lookout.rest(), Some(vec![Wish::Resume(2)]));
        let stage = plan(2);
        assert!(stage.is_pending());
        lookout.end();
        assert!(!stage.is_pending() && lookout.rest().is_none());
    }
}
