//! Passes the latest view and requests to the threads of a job: to make, stop or close.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use cloud::{Bounds, Placement, PointTest, SurfelOptions};
use codec::PageNodes;
use glam::DVec2;
use scene::{Camera, CloudSettings, Projection, Stream, ViewSettings};
use stream::{MirrorBound, NodeId, Pages, ViewMeasure};

use crate::chunk_key::Part;
use crate::task::{CloudTask, CloudTasks};
use crate::tiles::{Fit, FoundTile, TileProblem};

/// The longest time for which anything waits for a picture.
const LONGEST_FRAME: Duration = Duration::from_secs(2);

/// The view that streamed clouds are loaded for, and its budgets.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamView {
    pub camera: Camera,
    /// The width and height of the picture in pixels.
    pub size: [u32; 2],
    pub view: ViewSettings,
    pub stream: Stream,
    /// The mirrors of the scene, as far as the choice of nodes knows them (`mirrors::bound`).
    pub mirrors: Vec<MirrorBound>,
    /// The clouds that are not shown, by the job's own numbers.
    pub hidden: BTreeSet<usize>,
    /// How clouds have been moved, by the job's own numbers.
    pub placed: BTreeMap<usize, Placement>,
    /// Decides which points are shown: nodes without any are not wanted.
    pub test: PointTest,
    /// The names of the attributes that the picture needs (`asked_attributes`). Clouds keep them, besides those that
    /// other views asked for and the usual ones, as far as their files have them. An index of ours without them is made
    /// again; until then its cloud is streamed from the old one.
    pub asked: BTreeSet<String>,
    /// The share of the job's budgets that may be used, 0 to 1.
    pub share: f64,
    /// Whether it is shown as the first view would be: what only earlier views needed goes, so that the points that are
    /// there in the end depend on this view alone.
    pub is_alone: bool,
}

impl StreamView {
    /// The measure of how large places appear in the view.
    pub(crate) fn measure(&self) -> ViewMeasure {
        let Self { camera, size: [width, height], view, stream, .. } = self;
        let tangent = (f64::from(view.field_of_view).to_radians() * 0.5).tan();
        let (height, unseen) = (f64::from(*height), f64::from(stream.unseen));
        let half = DVec2::new(tangent * f64::from(*width) / height.max(1.0), tangent);
        let measure = match view.projection {
            Projection::Perspective => {
                ViewMeasure::perspective(camera.eye, camera.view_from_world(), half, height, unseen)
            }
            Projection::Orthographic => {
                ViewMeasure::parallel(camera.eye, camera.view_from_world(), half * camera.distance(), height, unseen)
            }
        };
        measure.with_mirrors(self.mirrors.iter().copied())
    }
}

/// Passes the latest view of the streamed clouds, and requests in their order, to the threads of a job.
#[derive(Default)]
pub struct Mailbox {
    mail: Mutex<Mail>,
    changed: Condvar,
}

#[derive(Default)]
struct Mail {
    /// The latest view, with its number.
    view: Option<(u64, StreamView)>,
    /// Decides which points are shown until the first view.
    first_test: PointTest,
    /// What clouds have of their own until the first view.
    first_settings: Vec<CloudSettings>,
    /// The requests for the streaming thread.
    stream_requests: Vec<StreamRequest>,
    /// The requests for the thread that makes indexes.
    index_requests: Vec<IndexRequest>,
    tasks: CloudTasks,
    /// When drawing of the first picture began, while it goes on.
    drawing_since: Option<Instant>,
    is_over: bool,
    /// Whether anything came since the streaming thread last looked.
    is_news: bool,
}

/// A request to the streaming thread.
pub(crate) enum StreamRequest {
    /// Streams a cloud, or an index of it with more data than before.
    Arrive(Box<Arrival>),
    /// Stops streaming a cloud.
    Close(usize),
    /// Keeps this many points of the budget for the preview of a cloud, until its index arrives.
    KeepRoom { cloud: usize, points: u64 },
    /// Says whether every index is complete.
    Complete(bool),
    /// One page of the list of nodes of a cloud was read: the parent and the octant of its topmost node.
    List { cloud: usize, place: (NodeId, u8), found: stream::Result<PageNodes> },
    /// A tile of a cloud was opened, or cannot be.
    Tile { cloud: usize, tile: usize, found: Result<FoundTile, TileProblem> },
    /// Stops opening tiles until the view changes.
    StopTiles,
}

/// What came since the streaming thread last looked.
pub(crate) struct News {
    /// The latest view with its number, if it is another one.
    pub(crate) view: Option<(u64, StreamView)>,
    pub(crate) requests: Vec<StreamRequest>,
}

/// A request to the thread that makes indexes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum IndexRequest {
    /// Makes the index of a cloud again, because its pages are damaged.
    Mend(usize),
    /// Continues the stopped task of a cloud.
    Resume(usize),
    /// Has clouds keep the attributes with these names, too.
    Keep(BTreeSet<String>),
}

/// A cloud with an index, or with an index that has more data.
pub struct Arrival {
    pub cloud: usize,
    /// The name that a person gave.
    pub input: String,
    /// The name of the cloud.
    pub name: String,
    /// How the chunks of a tile become those of its catalogue; `None` for all other clouds.
    pub(crate) fit: Option<Fit>,
    pub pages: Arc<Pages>,
    /// Whether the pages are in the cache, so that they can be made again.
    pub is_own: bool,
    /// The number of points that the files announce and do not have, or that could not be read for the pages.
    pub missing: u64,
    pub was_built: bool,
    /// The options for nodes without normals and radii; `None` for provisional, even radii until they are known.
    pub estimate: Option<SurfelOptions>,
    /// The number of points of each preview chunk; they are removed as soon as the cut is complete.
    pub previews: HashMap<Part, u64>,
}

impl Mailbox {
    /// Sets the view. Returns its number, which `StreamStats` repeat; setting the same view again gives the same
    /// number.
    pub fn set_view(&self, view: StreamView) -> u64 {
        let mut mail = self.mail();
        let number = match &mail.view {
            Some((number, known)) if *known == view => return *number,
            Some((number, _)) => number + 1,
            None => 1,
        };
        let known = mail.view.as_ref().map(|(_, known)| &known.asked);
        if !known.is_some_and(|known| view.asked.is_subset(known)) && !view.asked.is_empty() {
            self.request_index(&mut mail, IndexRequest::Keep(view.asked.clone()));
        }
        mail.view = Some((number, view));
        self.notify(&mut mail);
        number
    }

    /// The place among some boxes of a cloud's files of the one that the latest view asks for first; that of the first one
    /// before any view. Empty boxes come last.
    pub(crate) fn first_seen(&self, cloud: usize, boxes: &[Bounds]) -> usize {
        let mail = self.mail();
        let Some((_, view)) = &mail.view else { return 0 };
        let (measure, placement) = (view.measure(), view.placed.get(&cloud));
        let rank = |bounds: &Bounds| {
            let placed = placement.map_or(*bounds, |placement| placement.bounds(*bounds));
            if bounds.is_empty() { (true, f64::INFINITY) } else { measure.rank(placed) }
        };
        let ranked = boxes.iter().map(rank).enumerate();
        let first = ranked.min_by(|(_, (unseen, far)), (_, (other_unseen, other_far))| {
            unseen.cmp(other_unseen).then(far.total_cmp(other_far))
        });
        first.map_or(0, |(place, _)| place)
    }

    /// Sets which points are shown until the first view, and how clouds are moved, by their own settings.
    pub fn set_first_test(&self, test: PointTest, settings: Vec<CloudSettings>) {
        let mut mail = self.mail();
        mail.first_test = test;
        mail.first_settings = settings;
    }

    pub(crate) fn first_test(&self) -> PointTest {
        self.mail().first_test.clone()
    }

    /// How the cloud from this input with this name is moved until the first view.
    pub(crate) fn first_placement(&self, input: &str, name: &str) -> Option<Placement> {
        self.mail().first_settings.iter().find(|own| own.is_of(input, name))?.placement()
    }

    /// Stops streaming a cloud of the job.
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

    /// Keeps this many points of the budget for the preview of a cloud, until its index arrives.
    pub(crate) fn keep_room(&self, cloud: usize, points: u64) {
        let mut mail = self.mail();
        let points = if mail.tasks.is_closed(cloud) { 0 } else { points };
        self.ask(&mut mail, StreamRequest::KeepRoom { cloud, points });
    }

    /// Says that drawing of the first picture begins or ends: reading gives way to it.
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

    /// Plans a task for a cloud. The task is already stopped if the cloud is closed or all tasks are stopped.
    pub fn plan(&self, cloud: usize, task: CloudTask) -> Arc<CloudTask> {
        let mut mail = self.mail();
        let is_over = mail.is_over;
        let task = mail.tasks.plan(cloud, task);
        if is_over {
            mail.tasks.stop(cloud);
        }
        task
    }

    /// The last task that was planned for a cloud.
    pub(crate) fn task(&self, cloud: usize) -> Option<Arc<CloudTask>> {
        self.mail().tasks.latest(cloud)
    }

    /// Stops the task of a cloud.
    pub fn stop(&self, cloud: usize) {
        self.mail().tasks.stop(cloud);
    }

    /// Stops all tasks, and the opening of tiles for the present view.
    pub fn stop_all(&self) {
        let mut mail = self.mail();
        mail.tasks.stop_all();
        self.ask(&mut mail, StreamRequest::StopTiles);
    }

    /// Resumes the stopped task of a cloud, once no other task is running.
    pub fn resume(&self, cloud: usize) {
        let mut mail = self.mail();
        mail.tasks.go_on();
        self.request_index(&mut mail, IndexRequest::Resume(cloud));
    }

    /// Has a cloud streamed, or an index of it with more data.
    pub(crate) fn arrive(&self, arrival: Arrival) {
        let mut mail = self.mail();
        // The new index is not damaged.
        mail.index_requests.retain(|request| *request != IndexRequest::Mend(arrival.cloud));
        if !mail.tasks.is_closed(arrival.cloud) {
            self.ask(&mut mail, StreamRequest::Arrive(Box::new(arrival)));
        }
    }

    /// Says that no more indexes are being made, and waits for requests. `None` when the streaming has ended.
    pub fn wait_for_requests(&self) -> Option<Vec<IndexRequest>> {
        let mut mail = self.mail();
        let is_complete = mail.index_requests.is_empty();
        self.ask(&mut mail, StreamRequest::Complete(is_complete));
        let waits = |mail: &mut Mail| !mail.is_over && mail.index_requests.is_empty();
        let mut mail = self.changed.wait_while(mail, waits).unwrap_or_else(PoisonError::into_inner);
        if mail.is_over {
            return None;
        }
        // New requests are not affected by earlier stops.
        mail.tasks.go_on();
        Some(std::mem::take(&mut mail.index_requests))
    }

    /// Asks that the index of a cloud be made again.
    pub(crate) fn report_damage(&self, cloud: usize) {
        self.request_index(&mut self.mail(), IndexRequest::Mend(cloud));
    }

    fn request_index(&self, mail: &mut Mail, request: IndexRequest) {
        if !mail.index_requests.contains(&request) {
            mail.index_requests.push(request);
        }
        // Sent at once: a caller that waits for completion must not see it between two states.
        self.ask(mail, StreamRequest::Complete(false));
    }

    fn ask(&self, mail: &mut Mail, request: StreamRequest) {
        mail.stream_requests.push(request);
        self.notify(mail);
    }

    /// Passes on one page of the list of nodes of a cloud.
    pub(crate) fn pass_list(&self, cloud: usize, place: (NodeId, u8), found: stream::Result<PageNodes>) {
        self.ask(&mut self.mail(), StreamRequest::List { cloud, place, found });
    }

    /// Passes on a tile that was opened.
    pub(crate) fn pass_tile(&self, cloud: usize, tile: usize, found: Result<FoundTile, TileProblem>) {
        self.ask(&mut self.mail(), StreamRequest::Tile { cloud, tile, found });
    }

    pub(crate) fn wake(&self) {
        self.notify(&mut self.mail());
    }

    fn notify(&self, mail: &mut Mail) {
        mail.is_news = true;
        self.changed.notify_all();
    }

    /// Waits for news, at most `limit`; `known` is the number of the last view. `None` when the streaming has ended.
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
