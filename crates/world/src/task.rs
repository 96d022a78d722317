//! A long task for one cloud, its index or its normals and radii: progress, rate, and the request to stop it.

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

/// A task, shared by the thread that works on it and by observers.
#[derive(Debug)]
pub struct CloudTask {
    pub kind: TaskKind,
    /// The number of points of the cloud.
    points: u64,
    /// The progress in steps of the work, of which a point may have several. Cancelling it stops the task.
    pub progress: Arc<Progress>,
    /// 0: waits for others; 1: in progress; 2: over.
    turn: AtomicU8,
    /// When progress was first observed, and the number of points done then.
    pace_from: Mutex<Option<(Instant, u64)>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TaskStatus {
    /// Other tasks come first.
    Queued,
    /// Another program does the same work.
    Elsewhere,
    UnderWay,
    Stopped,
    /// Complete, or failed.
    Over,
}

impl CloudTask {
    pub fn new(kind: TaskKind, points: u64) -> Self {
        Self { kind, points, progress: Arc::default(), turn: AtomicU8::new(0), pace_from: Mutex::default() }
    }

    /// Marks the task as begun.
    pub fn begin(&self) {
        self.turn.store(1, Ordering::Relaxed);
    }

    /// Does the work of this task.
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

    /// Whether the task can still be stopped.
    pub fn is_pending(&self) -> bool {
        matches!(self.status(), TaskStatus::Queued | TaskStatus::Elsewhere | TaskStatus::UnderWay)
    }

    /// The number of points of the cloud.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// The share of the work that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        let (done, total) = (self.progress.done(), self.progress.total());
        if total > 0 { (done as f64 / total as f64).min(1.0) } else { 0.0 }
    }

    /// The share that is done as a number of points.
    pub fn done(&self) -> u64 {
        (self.points as f64 * self.share()) as u64
    }

    /// The points per second since progress was first observed: it counts neither the time before nor points that an
    /// earlier run had done.
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

/// The tasks of a job's clouds.
#[derive(Default)]
pub(crate) struct CloudTasks {
    /// The latest task of each cloud.
    latest: BTreeMap<usize, Arc<CloudTask>>,
    /// Whether all tasks are stopped, also those still to be planned.
    is_stopped: bool,
    /// The clouds for which no more tasks run.
    closed: HashSet<usize>,
}

impl CloudTasks {
    /// Plans a task; it is already stopped if its cloud is closed or all tasks are.
    pub fn plan(&mut self, cloud: usize, task: CloudTask) -> Arc<CloudTask> {
        let task = Arc::new(task);
        self.latest.insert(cloud, task.clone());
        if self.is_stopped || self.is_closed(cloud) {
            self.stop(cloud);
        }
        task
    }

    /// The last task planned for a cloud.
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

    /// Lets tasks that are planned from now on run.
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
        // Two passes over a million points, of which a quarter is already done.
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
