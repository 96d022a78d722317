//! What the threads of a job are told: from where streamed clouds are looked at, and what is to be made, stopped or closed.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cloud::SurfelOptions;
use scene::{Camera, Stream, ViewSettings};
use stream::Pages;

use crate::chunk_key::Part;
use crate::task::{CloudTask, CloudTasks};

/// Nothing gives way to a picture for longer than this.
const LONGEST_FRAME: Duration = Duration::from_secs(2);

/// From where streamed clouds are looked at, and with which budgets.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamView {
    pub camera: Camera,
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    pub view: ViewSettings,
    pub stream: Stream,
    /// Clouds that are not looked at, by the job's own numbers.
    pub hidden: BTreeSet<usize>,
    /// Of the budgets that the job may have, 0 to 1.
    pub share: f64,
    /// What only earlier views needed goes at once, so that what is there in the end depends on this view alone.
    pub is_alone: bool,
}

/// What the threads of a job are told: the latest view of the streamed clouds, and requests in their order.
#[derive(Default)]
pub struct Mailbox {
    mail: Mutex<Mail>,
    changed: Condvar,
}

#[derive(Default)]
struct Mail {
    /// The latest view, with its number.
    view: Option<(u64, StreamView)>,
    /// For the thread that streams.
    stream_requests: Vec<StreamRequest>,
    /// For the thread that makes indexes.
    index_requests: Vec<IndexRequest>,
    tasks: CloudTasks,
    /// Since when the first picture is being drawn.
    drawing_since: Option<Instant>,
    is_over: bool,
    /// Something came since the thread that streams looked last.
    is_news: bool,
}

/// What the thread that streams is to do.
pub(crate) enum StreamRequest {
    /// Streams a cloud, or more of it than before.
    Arrive(Box<Arrival>),
    /// Streams a cloud no more.
    Close(usize),
    /// Keeps this many points of the budget for the preview of a cloud, until its index arrives.
    KeepRoom { cloud: usize, points: u64 },
    /// Takes note of whether every index is complete.
    Complete(bool),
}

/// What came since the thread that streams looked last.
pub(crate) struct News {
    /// The latest view with its number, if that is another.
    pub(crate) view: Option<(u64, StreamView)>,
    pub(crate) requests: Vec<StreamRequest>,
}

/// What is to be made of a cloud while nothing else is on its way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndexRequest {
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

impl Mailbox {
    /// Shows the clouds from another place. The number of the view, by which `StreamStats` name it; the same viewpoint again is the
    /// same view.
    pub fn set_view(&self, view: StreamView) -> u64 {
        let mut mail = self.mail();
        let number = match &mail.view {
            Some((number, known)) if *known == view => return *number,
            Some((number, _)) => number + 1,
            None => 1,
        };
        mail.view = Some((number, view));
        self.notify(&mut mail);
        number
    }

    /// Streams that cloud of the job no more.
    pub fn close(&self, cloud: usize) {
        let mut mail = self.mail();
        mail.tasks.close(cloud);
        mail.stream_requests
            .retain(|request| !matches!(request, StreamRequest::Arrive(arrival) if arrival.cloud == cloud));
        self.ask(&mut mail, StreamRequest::Close(cloud));
    }

    pub fn is_closed(&self, cloud: usize) -> bool {
        self.mail().tasks.is_closed(cloud)
    }

    /// Ends the streaming.
    pub fn end(&self) {
        let mut mail = self.mail();
        mail.is_over = true;
        mail.tasks.stop_all();
        self.notify(&mut mail);
    }

    /// Keeps so many points of the budget for the preview of a cloud, until its index arrives.
    pub(crate) fn keep_room(&self, cloud: usize, points: u64) {
        let mut mail = self.mail();
        let points = if mail.tasks.is_closed(cloud) { 0 } else { points };
        self.ask(&mut mail, StreamRequest::KeepRoom { cloud, points });
    }

    /// The first picture begins or ends to be drawn: reading gives way to it.
    pub fn draw_first(&self, begins: bool) {
        let mut mail = self.mail();
        mail.drawing_since = begins.then(|| mail.drawing_since.unwrap_or_else(Instant::now));
        self.changed.notify_all();
    }

    /// Waits while the first picture is being drawn.
    pub(crate) fn give_way(&self) {
        let mut mail = self.mail();
        while let Some(since) = mail.drawing_since.filter(|_| !mail.is_over) {
            let Some(left) = LONGEST_FRAME.checked_sub(since.elapsed()) else { return };
            mail = self.changed.wait_timeout(mail, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Something that will be made for a cloud: already stopped, if that is so of all that is made.
    pub fn plan(&self, cloud: usize, task: CloudTask) -> Arc<CloudTask> {
        let mut mail = self.mail();
        let is_over = mail.is_over;
        let task = mail.tasks.plan(cloud, task);
        if is_over {
            mail.tasks.stop(cloud);
        }
        task
    }

    /// The last thing that was planned for a cloud.
    pub(crate) fn task(&self, cloud: usize) -> Option<Arc<CloudTask>> {
        self.mail().tasks.latest(cloud)
    }

    /// Stops what is made for a cloud.
    pub fn stop(&self, cloud: usize) {
        self.mail().tasks.stop(cloud);
    }

    /// Stops all that is made.
    pub fn stop_all(&self) {
        self.mail().tasks.stop_all();
    }

    /// Makes what was stopped of a cloud after all, when nothing else is made.
    pub fn resume(&self, cloud: usize) {
        let mut mail = self.mail();
        mail.tasks.go_on();
        self.request_index(&mut mail, IndexRequest::Resume(cloud));
    }

    /// Has a cloud streamed, or more of it.
    pub(crate) fn arrive(&self, arrival: Arrival) {
        let mut mail = self.mail();
        // What was damaged is so no more.
        mail.index_requests.retain(|request| *request != IndexRequest::Mend(arrival.cloud));
        if !mail.tasks.is_closed(arrival.cloud) {
            self.ask(&mut mail, StreamRequest::Arrive(Box::new(arrival)));
        }
    }

    /// Says that nothing more is on its way, and waits until something is to be made. `None` when the streaming has ended.
    pub fn wait_for_requests(&self) -> Option<Vec<IndexRequest>> {
        let mut mail = self.mail();
        let is_complete = mail.index_requests.is_empty();
        self.ask(&mut mail, StreamRequest::Complete(is_complete));
        let waits = |mail: &mut Mail| !mail.is_over && mail.index_requests.is_empty();
        let mut mail = self.changed.wait_while(mail, waits).unwrap_or_else(PoisonError::into_inner);
        if mail.is_over {
            return None;
        }
        // What is wished for now is not what was stopped before.
        mail.tasks.go_on();
        Some(std::mem::take(&mut mail.index_requests))
    }

    /// Says that the pages of a cloud are to be made again.
    pub(crate) fn report_damage(&self, cloud: usize) {
        self.request_index(&mut self.mail(), IndexRequest::Mend(cloud));
    }

    fn request_index(&self, mail: &mut Mail, request: IndexRequest) {
        if !mail.index_requests.contains(&request) {
            mail.index_requests.push(request);
        }
        // At once: who waits for the end of it must not see it between two states.
        self.ask(mail, StreamRequest::Complete(false));
    }

    fn ask(&self, mail: &mut Mail, request: StreamRequest) {
        mail.stream_requests.push(request);
        self.notify(mail);
    }

    pub(crate) fn wake(&self) {
        self.notify(&mut self.mail());
    }

    fn notify(&self, mail: &mut Mail) {
        mail.is_news = true;
        self.changed.notify_all();
    }

    /// Waits until there is news, `limit` at most; `known` is the number of the last view. `None` when the streaming has ended.
    pub(crate) fn wait(&self, limit: Duration, known: u64) -> Option<News> {
        let waited = self.changed.wait_timeout_while(self.mail(), limit, |mail| !mail.is_news);
        let mut mail = waited.unwrap_or_else(PoisonError::into_inner).0;
        mail.is_news = false;
        let view = mail.view.clone().filter(|(number, _)| *number != known);
        (!mail.is_over).then(|| News { view, requests: std::mem::take(&mut mail.stream_requests) })
    }

    fn mail(&self) -> MutexGuard<'_, Mail> {
        self.mail.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::task::{TaskKind, TaskStatus};

    #[test]
    fn what_is_made_is_stopped_for_one_cloud_or_for_all() {
        let mailbox = Mailbox::default();
        let plan = |cloud| mailbox.plan(cloud, CloudTask::new(TaskKind::Index, 1));
        let tasks = [0, 1, 2, 3].map(plan);
        let are_stopped = || tasks.each_ref().map(|task| task.status() == TaskStatus::Stopped);
        mailbox.stop(0);
        mailbox.close(1);
        assert_eq!(are_stopped(), [true, true, false, false]);
        assert!(plan(0).is_pending() && !plan(1).is_pending(), "nothing is made of what is closed");
        mailbox.stop_all();
        assert_eq!(are_stopped(), [true; 4]);
        assert!(!plan(2).is_pending());
        mailbox.resume(2);
        assert_eq!(mailbox.wait_for_requests(), Some(vec![IndexRequest::Resume(2)]));
        let task = plan(2);
        assert!(task.is_pending());
        mailbox.end();
        assert!(!task.is_pending() && mailbox.wait_for_requests().is_none());
    }
}
