//! What takes its time for one cloud, its index or its normals and radii: how far it is, how fast it goes, and the wish to stop it.

use std::collections::{BTreeMap, HashSet};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use cloud::Progress;

/// A rate over less time is noise.
pub const LEAST_TIME: Duration = Duration::from_millis(500);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskKind {
    Index,
    /// Normals and radii.
    Surfels,
}

/// Shared by who makes it and who watches.
#[derive(Debug)]
pub struct CloudTask {
    pub kind: TaskKind,
    /// Of the cloud.
    points: u64,
    /// In steps of whoever makes it, of which there may be several to a point. Cancelling it stops the task.
    pub progress: Arc<Progress>,
    /// 0: others come first; 1: under way; 2: over.
    turn: AtomicU8,
    /// When it was first seen to go on, and how many points were done then.
    pace_from: Mutex<Option<(Instant, u64)>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskStatus {
    /// Others come first.
    Queued,
    /// Another program makes the same.
    Elsewhere,
    UnderWay,
    Stopped,
    /// Made, or failed.
    Over,
}

impl CloudTask {
    pub fn new(kind: TaskKind, points: u64) -> Self {
        Self { kind, points, progress: Arc::default(), turn: AtomicU8::new(0), pace_from: Mutex::default() }
    }

    /// It is its turn.
    pub fn begin(&self) {
        self.turn.store(1, Ordering::Relaxed);
    }

    /// Does the work that this task is about.
    pub fn run<Result>(&self, work: impl FnOnce(&Progress) -> Result) -> Result {
        self.begin();
        let result = work(&self.progress);
        self.turn.store(2, Ordering::Relaxed);
        result
    }

    pub fn status(&self) -> TaskStatus {
        match self.turn.load(Ordering::Relaxed) {
            _ if self.progress.is_cancelled() => TaskStatus::Stopped,
            0 => TaskStatus::Queued,
            1 if self.progress.is_waiting() => TaskStatus::Elsewhere,
            1 => TaskStatus::UnderWay,
            _ => TaskStatus::Over,
        }
    }

    /// Whether there is something left to stop.
    pub fn is_pending(&self) -> bool {
        matches!(self.status(), TaskStatus::Queued | TaskStatus::Elsewhere | TaskStatus::UnderWay)
    }

    /// Of the cloud.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Share that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        let (done, total) = (self.progress.done(), self.progress.total());
        if total > 0 { (done as f64 / total as f64).min(1.0) } else { 0.0 }
    }

    /// The same in points.
    pub fn done(&self) -> u64 {
        (self.points as f64 * self.share()) as u64
    }

    /// Points a second since it was first seen to go on: neither what others took before it nor what was there from an earlier
    /// time counts.
    pub fn pace(&self) -> Option<f64> {
        self.pace_at(Instant::now())
    }

    fn pace_at(&self, now: Instant) -> Option<f64> {
        if self.status() != TaskStatus::UnderWay || self.progress.done() == 0 {
            return None;
        }
        let done = self.done();
        let mut from = self.pace_from.lock().unwrap_or_else(PoisonError::into_inner);
        let (start, before) = *from.get_or_insert((now, done));
        let time = now.duration_since(start);
        (time >= LEAST_TIME && done > before).then(|| (done - before) as f64 / time.as_secs_f64())
    }
}

/// What is made for the clouds of a job.
#[derive(Default)]
pub(crate) struct CloudTasks {
    /// By cloud.
    latest: BTreeMap<usize, Arc<CloudTask>>,
    /// Nothing more is to be made.
    is_stopped: bool,
    /// Nothing is made for these any more.
    closed: HashSet<usize>,
}

impl CloudTasks {
    /// Already stopped, if that is so of the cloud or of all that is made.
    pub fn plan(&mut self, cloud: usize, task: CloudTask) -> Arc<CloudTask> {
        let task = Arc::new(task);
        self.latest.insert(cloud, task.clone());
        if self.is_stopped || self.is_closed(cloud) {
            self.stop(cloud);
        }
        task
    }

    /// What was planned last for a cloud.
    pub fn latest(&self, cloud: usize) -> Option<Arc<CloudTask>> {
        self.latest.get(&cloud).cloned()
    }

    pub fn stop(&self, cloud: usize) {
        self.latest.get(&cloud).iter().for_each(|task| task.progress.cancel());
    }

    pub fn stop_all(&mut self) {
        self.is_stopped = true;
        self.latest.values().for_each(|task| task.progress.cancel());
    }

    /// What is planned from now on is made.
    pub fn go_on(&mut self) {
        self.is_stopped = false;
    }

    pub fn close(&mut self, cloud: usize) {
        self.closed.insert(cloud);
        self.stop(cloud);
    }

    pub fn is_closed(&self, cloud: usize) -> bool {
        self.closed.contains(&cloud)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_is_that_of_the_points_since_it_goes_on() {
        // Two passes over a million points, of which a quarter is there already.
        let task = CloudTask::new(TaskKind::Index, 1_000_000);
        assert_eq!(task.status(), TaskStatus::Queued);
        task.run(|progress| {
            let start = Instant::now();
            let after = |seconds: f64| task.pace_at(start + Duration::from_secs_f64(seconds));
            progress.set_waiting(true);
            assert_eq!((task.status(), after(50.0)), (TaskStatus::Elsewhere, None));
            progress.set_waiting(false);
            progress.set_total(2_000_000);
            assert_eq!(after(99.0), None, "nothing is done yet");
            progress.add(500_000);
            assert_eq!((task.done(), after(100.0), after(100.1)), (250_000, None, None));
            progress.add(1_000_000);
            assert_eq!((task.share(), after(102.0)), (0.75, Some(250_000.0)));
        });
        assert_eq!((task.status(), task.pace()), (TaskStatus::Over, None));
        let stopped = CloudTask::new(TaskKind::Surfels, 1);
        stopped.progress.cancel();
        stopped.run(|_| ());
        assert!(stopped.status() == TaskStatus::Stopped && !stopped.is_pending());
    }
}
