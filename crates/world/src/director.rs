//! The thread that streams the clouds of a job: chooses the nodes that the view needs, and reports what has been
//! loaded.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use cloud::{Bounds, Cover, Placement, PointTest};
use glam::DVec2;
use scene::{Projection, Settings};
use stream::{
    Budget, Cut, Missing, Node, NodeChange, Octree, Page, PagedCloud, Streamer, Tree, ViewMeasure, Wanted, choose,
};

use crate::budget::{CUT_PART, half_of, most_points};
use crate::chunk_key::Part;
use crate::error::is_of_inputs;
use crate::event::{Event, IndexEntry, IndexState, StreamStats};
use crate::lists::Lists;
use crate::mailbox::{Arrival, Mailbox, News, StreamRequest, StreamView};

/// The share of the memory for decoded points that a cut may use: the remainder is for reads in progress and for nodes
/// that may be wanted again.
const CUT_SHARE: f64 = 0.75;
/// The time between two reports.
const REPORT_INTERVAL: Duration = Duration::from_millis(200);
/// The width in pixels at which all clouds together are seen until the first view is set.
const WIDTH_UNSEEN: f64 = 1000.0;

/// The thread that streams the clouds of a job.
pub struct Director {
    mailbox: Arc<Mailbox>,
    events: SyncSender<Event>,
    streamer: Streamer,
    clouds: BTreeMap<usize, StreamedCloud>,
    view_number: u64,
    viewpoint: Option<StreamView>,
    /// A view that is to be as the first one: it waits until what is shown before the first view is complete again.
    awaited: Option<StreamView>,
    demand: f64,
    /// The settings, until a view brings others.
    settings: Settings,
    is_complete: bool,
    /// The number of preview points of each cloud whose index is still to be made.
    previews: BTreeMap<usize, u64>,
    /// The number of points that were resident beside the last cut.
    beside_cut: u64,
    reported: (Instant, StreamStats),
}

/// A cloud that is streamed.
struct StreamedCloud {
    /// The name that a person gave.
    input: String,
    /// The name of the cloud.
    name: String,
    octree: Arc<Octree>,
    /// The octree with its nodes where the last view has them, or the first one will, if they are moved.
    placed: Option<(Placement, Octree)>,
    /// The list of its nodes, if it is read page by page.
    lists: Option<Lists>,
    /// What the receiver was last told of its index.
    state: IndexState,
    /// Whether its pages can be made again.
    is_own: bool,
    point_bytes: u64,
    /// The number of points of each chunk that the receiver has.
    resident: HashMap<Part, u64>,
    /// Chunks from before the streamer began anew. They are removed when the next cut is complete, unless that contains
    /// them.
    stale: HashMap<Part, u64>,
    /// The summary that the receiver gets when the first cut is complete.
    summary: Option<codec::Summary>,
    /// Whether a part of it could not be read and its pages are being made again.
    is_damaged: bool,
    /// Whether the receiver knows that a part of it cannot be shown.
    is_reported: bool,
}

impl StreamedCloud {
    /// Whether its pages are being made again.
    fn is_awaited(&self) -> bool {
        self.is_own && self.is_damaged
    }

    /// Moves its nodes to where a view has them.
    fn place(&mut self, placement: Option<&Placement>) {
        if self.placed.as_ref().map(|(placement, _)| placement) != placement {
            self.placed = placement.map(|placement| (*placement, self.octree.placed(placement)));
        }
    }

    fn nodes(&self) -> &Octree {
        self.placed.as_ref().map_or(&self.octree, |(_, octree)| octree)
    }
}

/// The number of threads that read from servers, at least.
const FAR_WORKERS: usize = 6;

impl Director {
    /// Makes the state of the thread. `is_far` says that points are read from servers.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn new(
        mailbox: Arc<Mailbox>,
        events: SyncSender<Event>,
        settings: &Settings,
        is_far: bool,
    ) -> std::io::Result<Self> {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        // Threads that wait for a server take no core.
        let workers = if is_far { cores.max(FAR_WORKERS) } else { cores };
        let waker = mailbox.clone();
        let nothing = Budget { points: 0, bytes: 0 };
        let streamer = Streamer::new(workers, nothing, move || waker.wake())?;
        let reported = (Instant::now(), StreamStats::default());
        Ok(Self {
            mailbox,
            events,
            streamer,
            clouds: BTreeMap::new(),
            view_number: 0,
            viewpoint: None,
            awaited: None,
            demand: 0.0,
            settings: settings.clone(),
            is_complete: false,
            previews: BTreeMap::new(),
            beside_cut: 0,
            reported,
        })
    }

    /// Streams until the mailbox ends it, or until the receiver is gone.
    pub fn run(mut self) {
        while self.step().is_some() {}
        self.mailbox.end();
    }

    fn step(&mut self) -> Option<()> {
        let News { view, requests } = self.mailbox.wait(REPORT_INTERVAL, self.view_number)?;
        let mut is_other = view.is_some();
        if let Some((number, viewpoint)) = view {
            self.view_number = number;
            (self.viewpoint, self.awaited) =
                if viewpoint.is_alone { (None, Some(viewpoint)) } else { (Some(viewpoint), None) };
        }
        if is_other {
            // What found no room for the view before may find some now.
            self.clouds.values_mut().filter_map(|streamed| streamed.lists.as_mut()).for_each(Lists::try_again);
        }
        for request in requests {
            is_other |= !matches!(request, StreamRequest::KeepRoom { .. } | StreamRequest::Complete(_));
            self.handle(request)?;
        }
        self.show_lists()?;
        is_other |= self.beside_cut() != self.beside_cut;
        if is_other {
            self.choose()?;
        }
        let changes = self.streamer.changes();
        let is_quiet = changes.is_empty();
        for change in changes {
            self.pass_on(change)?;
        }
        self.report(is_quiet && !is_other)
    }

    fn handle(&mut self, request: StreamRequest) -> Option<()> {
        match request {
            StreamRequest::Arrive(arrival) => {
                self.previews.remove(&arrival.cloud);
                self.add(*arrival)?;
            }
            StreamRequest::Close(cloud) => {
                self.previews.remove(&cloud);
                self.clouds.remove(&cloud);
                self.streamer.remove(cloud);
            }
            StreamRequest::KeepRoom { cloud, points } => drop(self.previews.insert(cloud, points)),
            StreamRequest::Complete(is_complete) => self.is_complete = is_complete,
            StreamRequest::List { cloud, place, found } => {
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let Some(problem) = streamed.lists.as_mut().and_then(|lists| lists.put(place, found)) else {
                    return Some(());
                };
                let input = streamed.input.clone();
                self.send(Event::Failed { input, error: problem, is_usage: true })?;
            }
        }
        Some(())
    }

    /// Passes on the octrees that have changed, as other pages of lists of nodes are there.
    fn show_lists(&mut self) -> Option<()> {
        let mut states = Vec::new();
        for (cloud, streamed) in &mut self.clouds {
            let changed = streamed.lists.as_mut().and_then(Lists::changed_octree);
            let (Some(octree), IndexState::Indexed { octree: told, .. }) = (changed, &mut streamed.state) else {
                continue;
            };
            *told = octree.clone();
            self.streamer.know(*cloud, octree.clone());
            (streamed.octree, streamed.placed) = (octree, None);
            states.push((*cloud, streamed.state.clone()));
        }
        states.into_iter().try_for_each(|(cloud, pages)| self.send(Event::Pages { cloud, pages }))
    }

    fn add(&mut self, arrival: Arrival) -> Option<()> {
        let Arrival { cloud, input, name, pages, is_own, was_built, estimate, previews, mut warnings } = arrival;
        let mut before = self.clouds.remove(&cloud);
        let lists = match before.as_mut().and_then(|before| before.lists.take()) {
            Some(lists) => lists.again(&pages),
            None => Lists::new(&pages),
        };
        let octree = lists.as_ref().map_or_else(|| Arc::new(pages.octree().clone()), |lists| lists.octree().clone());
        let (attributes, grid, has_surfels) = (pages.attributes().to_vec(), pages.grid(), pages.has_surfels());
        let entry = is_own.then(|| IndexEntry { folder: pages.folder().to_owned(), bytes: pages.bytes() });
        let point_bytes = pages.point_bytes();
        warnings.extend_from_slice(pages.warnings());
        let summary = codec::Summary {
            points: octree.points(),
            bounds: octree.nodes.first().map(|root| root.bounds),
            warnings,
            cancelled: false,
        };
        let is_again = before.as_ref().is_some_and(|before| before.summary.is_none());
        let (mut resident, mut stale) = before.map(|before| (before.resident, before.stale)).unwrap_or_default();
        resident.extend(&previews);
        stale.extend(previews);
        let read = move |node| {
            let chunk = pages.read(node)?;
            Ok(Page { chunk, disk_bytes: pages.page_bytes(node) as u64 })
        };
        let missing = estimate.map_or(Missing::Provisional, Missing::Estimate);
        let paged = PagedCloud { octree: octree.clone(), point_bytes, missing, read: Arc::new(read) };
        self.streamer.replace(cloud, paged);
        let summary = (!is_again).then_some(summary);
        let octree_shown = octree.clone();
        let state = IndexState::Indexed { octree: octree_shown, attributes, grid, was_built, has_surfels, entry };
        let streamed = StreamedCloud {
            input,
            name,
            octree,
            placed: None,
            lists,
            state: state.clone(),
            is_own,
            point_bytes,
            resident,
            stale,
            summary,
            is_damaged: false,
            is_reported: false,
        };
        self.clouds.insert(cloud, streamed);
        self.send(Event::Pages { cloud, pages: state })
    }

    /// The number of resident points that belong to no cut, which use a part of the budget.
    fn beside_cut(&self) -> u64 {
        let stale = self.clouds.values().flat_map(|streamed| streamed.stale.values());
        self.previews.values().chain(stale).sum()
    }

    /// Removes stale chunks until at most `most` points are outside the cut; the finest first, as coarser ones remain
    /// in their place.
    fn drop_stale(&mut self, most: u64) -> Option<()> {
        let mut excess = self.beside_cut().saturating_sub(most);
        if excess == 0 {
            return Some(());
        }
        let level = |streamed: &StreamedCloud, part: Part| match part {
            Part::Node(node) => streamed.octree.get(node).map_or(u8::MAX, |node| node.level),
            Part::Preview(_) | Part::Block(_) => u8::MAX,
        };
        let stale = self
            .clouds
            .iter()
            .flat_map(|(cloud, streamed)| streamed.stale.keys().map(|part| (level(streamed, *part), *part, *cloud)));
        let mut stale: Vec<_> = stale.collect();
        stale.sort_unstable();
        while let Some((_, part, cloud)) = stale.pop().filter(|_| excess > 0) {
            let streamed = self.clouds.get_mut(&cloud)?;
            excess = excess.saturating_sub(streamed.stale.remove(&part).unwrap_or(0));
            streamed.resident.remove(&part);
            self.send(Event::Dropped { cloud, part })?;
        }
        Some(())
    }

    /// Asks the streamer for the cut of the latest view, within the budget that the points outside the cut leave.
    fn choose(&mut self) -> Option<()> {
        // What is shown before a view that is to be as the first one has its budgets and detail, as before the first one.
        let (view, stream, share) = match self.viewpoint.as_ref().or(self.awaited.as_ref()) {
            Some(viewpoint) => (viewpoint.view.clone(), viewpoint.stream.clone(), viewpoint.share),
            None => (self.settings.view.clone(), self.settings.stream.clone(), 1.0),
        };
        let most = most_points(&view, &stream);
        let points = (most as f64 * share) as u64;
        self.drop_stale(points / CUT_PART)?;
        self.beside_cut = self.beside_cut();
        let bytes = half_of(stream.host_bytes) as f64;
        let budget = |part: f64| {
            let points = points.saturating_sub(self.beside_cut).max(points / CUT_PART);
            Budget { points, bytes: (bytes * share * part) as u64 }
        };
        self.streamer.set_budget(budget(1.0));
        for (cloud, streamed) in &mut self.clouds {
            let placement = match &self.viewpoint {
                Some(viewpoint) => viewpoint.placed.get(cloud).copied(),
                None => self.mailbox.first_placement(&streamed.input, &streamed.name),
            };
            streamed.place(placement.as_ref());
        }
        let is_hidden =
            |cloud: &usize| self.viewpoint.as_ref().is_some_and(|viewpoint| viewpoint.hidden.contains(cloud));
        let trees: Vec<Tree> = self
            .clouds
            .iter()
            .filter(|(cloud, streamed)| !streamed.is_awaited() && !is_hidden(cloud))
            .map(|(cloud, streamed)| Tree {
                cloud: *cloud,
                octree: streamed.nodes(),
                point_bytes: streamed.point_bytes,
            })
            .collect();
        let detail = f64::from(stream.detail);
        let first_test = || self.mailbox.first_test();
        let test = self.viewpoint.as_ref().map_or_else(first_test, |viewpoint| viewpoint.test.clone());
        let measure = self.viewpoint.as_ref().map(measure);
        let all = trees.iter().filter_map(|tree| tree.octree.nodes.first());
        let all = all.fold(Bounds::EMPTY, |all, root| all.union(root.bounds));
        let scale = WIDTH_UNSEEN / all.size().max_element().max(f64::MIN_POSITIVE);
        let pixels = |octree: &Octree, node: &Node| match &measure {
            _ if shows_nothing(&test, node.bounds) => 0.0,
            Some(measure) => measure.pixels(octree, node),
            None => octree.spacing_at(node.level) * scale,
        };
        let cut = |budget: Budget| choose(&trees, |_, octree, node| pixels(octree, node), budget, detail);
        let Cut { wanted, unread, next } = cut(budget(CUT_SHARE));
        let whole = Budget { points: most, bytes: (bytes * CUT_SHARE) as u64 };
        let demand =
            if share < 1.0 { demand(&cut(whole).wanted, &trees, whole) } else { demand(&wanted, &trees, whole) };
        let demand = (demand + self.beside_cut as f64 / most.max(1) as f64).min(1.0);
        let needed = wanted.iter().map(|wanted| (wanted.cloud, wanted.node)).chain(next);
        let needed: Vec<_> = needed.collect();
        for (cloud, streamed) in &mut self.clouds {
            let Some(lists) = &mut streamed.lists else { continue };
            let nodes = needed.iter().filter(|(other, _)| other == cloud).map(|(_, node)| *node);
            let places = unread.iter().filter(|(other, ..)| other == cloud).map(|(_, node, octant)| (*node, *octant));
            lists.want(nodes, places, *cloud, &self.mailbox);
        }
        self.streamer.show_only_wanted(self.awaited.is_some());
        self.streamer.want(wanted);
        self.demand = demand;
        Some(())
    }

    fn pass_on(&mut self, change: NodeChange) -> Option<()> {
        match change {
            NodeChange::Put { cloud, node, chunk } => {
                let part = Part::Node(node);
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let points = chunk.len() as u64;
                streamed.resident.insert(part, points);
                if streamed.is_awaited() {
                    streamed.stale.insert(part, points);
                } else {
                    streamed.stale.remove(&part);
                }
                self.send(Event::Chunk { cloud, part, chunk })
            }
            NodeChange::Drop { cloud, node } => {
                let part = Part::Node(node);
                if let Some(streamed) = self.clouds.get_mut(&cloud) {
                    streamed.resident.remove(&part);
                    streamed.stale.remove(&part);
                }
                self.send(Event::Dropped { cloud, part })
            }
            NodeChange::Failed { cloud, error, .. } => {
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let is_damage = matches!(
                    error,
                    stream::Error::Damaged { .. } | stream::Error::PageSize { .. } | stream::Error::Io { .. }
                );
                let is_mendable = is_damage && streamed.is_own;
                let is_told = if is_mendable { &mut streamed.is_damaged } else { &mut streamed.is_reported };
                if std::mem::replace(is_told, true) {
                    return Some(());
                }
                if !is_mendable {
                    let (input, is_usage) = (streamed.input.clone(), is_of_inputs(&error));
                    return self.send(Event::Failed { input, error: error.to_string(), is_usage });
                }
                tracing::warn!(cloud, %error, "pages are made again");
                // The chunks shown stay until then. Pages cannot be made again while somebody has them open.
                streamed.stale = streamed.resident.clone();
                self.streamer.remove(cloud);
                // Sent before the thread that mends the index can report about it.
                self.send(Event::Pages { cloud, pages: IndexState::Indexing })?;
                self.mailbox.report_damage(cloud);
                Some(())
            }
        }
    }

    /// Reports what has been loaded, if that has changed, and finishes a cut that is complete.
    fn report(&mut self, is_quiet: bool) -> Option<()> {
        let shown = self.streamer.stats();
        let lists = self.clouds.values().filter_map(|streamed| streamed.lists.as_ref());
        let lists_waiting: usize = lists.map(Lists::waiting).sum();
        let is_awaited = lists_waiting > 0 || self.clouds.values().any(StreamedCloud::is_awaited);
        let mut is_there = is_quiet && shown.settled && !is_awaited;
        if is_there && self.clouds.values().any(|streamed| !streamed.stale.is_empty()) {
            // The cut replaces the stale chunks.
            is_there = false;
            self.drop_stale(self.previews.values().sum())?;
            self.mailbox.wake();
        }
        if is_there && self.awaited.is_some() {
            is_there = false;
            if self.is_complete {
                self.viewpoint = self.awaited.take();
                self.choose()?;
                self.mailbox.wake();
            }
        }
        if is_there {
            let read = |(cloud, streamed): (&usize, &mut StreamedCloud)| Some((*cloud, streamed.summary.take()?));
            let read: Vec<_> = self.clouds.iter_mut().filter_map(read).collect();
            for (cloud, summary) in read {
                self.send(Event::Read { cloud, summary })?;
            }
        }
        let stats = StreamStats {
            view_number: self.view_number,
            is_settled: is_there && self.is_complete,
            nodes: shown.shown_nodes,
            points_resident: shown.shown_points,
            points_total: self.clouds.values().map(|streamed| streamed.octree.points()).sum(),
            host_bytes: shown.bytes,
            nodes_waiting: shown.waiting_nodes + lists_waiting,
            demand: self.demand,
            disk_bytes_per_second: shown.disk_bytes_per_second,
            points_per_second: shown.points_per_second,
        };
        let (when, last) = &self.reported;
        let is_due = stats.is_settled || when.elapsed() >= REPORT_INTERVAL;
        if stats != *last && is_due {
            self.reported = (Instant::now(), stats);
            self.send(Event::Stream(stats))?;
        }
        Some(())
    }

    fn send(&self, event: Event) -> Option<()> {
        self.events.send(event).ok()
    }
}

/// The share of a budget that a cut takes.
fn demand(cut: &[Wanted], trees: &[Tree], budget: Budget) -> f64 {
    let trees: BTreeMap<usize, &Tree> = trees.iter().map(|tree| (tree.cloud, tree)).collect();
    let (mut points, mut bytes, mut largest) = (0, 0, 0);
    for Wanted { cloud, node, batches } in cut {
        let Tree { octree, point_bytes, .. } = trees[cloud];
        let node = octree.node(*node);
        let (whole, point_bytes) = (node.points, node.point_bytes(*point_bytes));
        let taken = stream::prefix(whole as usize, *batches) as u64;
        points += taken;
        bytes += taken * point_bytes;
        largest = largest.max(u64::from(whole) * point_bytes);
    }
    // Nodes are read whole, and the streamer needs room for more than one of them.
    let share = |taken: u64, most: u64| taken as f64 / most.max(1) as f64;
    share(points, budget.points).max(share(bytes + 2 * largest, budget.bytes)).min(1.0)
}

/// Whether a test shows no point in the bounds of a node. Its points are decoded a little beside their places.
fn shows_nothing(test: &PointTest, bounds: Bounds) -> bool {
    let rounding = bounds.size().max_element() * f64::from(f32::EPSILON);
    let bounds = Bounds { min: bounds.min - rounding, max: bounds.max + rounding };
    test.cover(bounds) == Cover::Outside
}

/// The measure of how large places appear in a view.
fn measure(viewpoint: &StreamView) -> ViewMeasure {
    let StreamView { camera, size: [width, height], view, stream, .. } = viewpoint;
    let tangent = (f64::from(view.field_of_view).to_radians() * 0.5).tan();
    let (height, unseen) = (f64::from(*height), f64::from(stream.unseen));
    let half = DVec2::new(tangent * f64::from(*width) / height.max(1.0), tangent);
    let measure = match view.projection {
        Projection::Perspective => ViewMeasure::perspective(camera.eye, camera.view_from_world(), half, height, unseen),
        Projection::Orthographic => {
            ViewMeasure::parallel(camera.eye, camera.view_from_world(), half * camera.distance(), height, unseen)
        }
    };
    measure.with_mirrors(viewpoint.mirrors.iter().copied())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;
    use std::sync::mpsc::{Receiver, sync_channel};

    use cloud::Progress;
    use scene::Camera;
    use stream::{BuildOptions, Cache, Pages};

    use super::*;

    /// The index of a square with this many points.
    fn square(folder: &Path, name: &str, points: u32) -> Arc<Pages> {
        let path = folder.join(name);
        let mut text = format!("ply\nformat ascii 1.0\nelement vertex {points}\n");
        text += "property float x\nproperty float y\nproperty float z\nend_header\n";
        for index in 0..points {
            let [x, y] = [0.754_877_67, 0.569_840_3].map(|step: f64| (f64::from(index) * step).fract());
            text += &format!("{x:.6} {y:.6} 0\n");
        }
        std::fs::write(&path, text).unwrap();
        let sources = [Arc::new(codec::open(&path).unwrap())];
        let cache = Cache::new(folder.join("cache"), u64::MAX);
        let pages = stream::build(&sources, &cache, &BuildOptions::default(), &Progress::default(), &|_| ());
        Arc::new(pages.unwrap())
    }

    /// The number of points of both clouds that are loaded when a view is settled, and the share of the whole budget
    /// that it would take.
    fn settled(
        events: &Receiver<Event>,
        there: &mut [BTreeMap<Part, usize>; 2],
        view_number: u64,
    ) -> ([usize; 2], f64) {
        loop {
            match events.recv().unwrap() {
                Event::Chunk { cloud, part, chunk } => drop(there[cloud].insert(part, chunk.len())),
                Event::Dropped { cloud, part } => drop(there[cloud].remove(&part)),
                Event::Stream(stats) if stats.is_settled && stats.view_number == view_number => {
                    return (there.each_ref().map(|chunks| chunks.values().sum()), stats.demand);
                }
                _ => {}
            }
        }
    }

    #[test]
    fn clouds_that_are_hidden_or_moved_out_of_sight_leave_their_budget_to_the_others_and_come_back() {
        const BUDGET: usize = 60_000;
        let folder = tempfile::tempdir().unwrap();
        let mailbox = Arc::<Mailbox>::default();
        let (sender, events) = sync_channel(1000);
        let mut settings = Settings::default();
        settings.view.point_budget = BUDGET as u32;
        settings.stream.detail = 0.01;
        for cloud in [0, 1] {
            mailbox.arrive(Arrival {
                cloud,
                input: String::new(),
                name: String::new(),
                pages: square(folder.path(), &format!("{cloud}.ply"), 100_000),
                is_own: true,
                was_built: true,
                estimate: None,
                previews: HashMap::new(),
                warnings: Vec::new(),
            });
        }
        let camera =
            Camera::looking(glam::DVec3::new(0.5, 0.5, 2.0), glam::DVec3::new(0.5, 0.5, 0.0), 2.0, glam::DVec3::Y);
        let moved = Placement::new(glam::DQuat::IDENTITY, glam::DVec3::ZERO, glam::DVec3::Z * 50.0);
        let director = Director::new(mailbox.clone(), sender, &settings, false).unwrap();
        let seen = std::thread::scope(|scope| {
            scope.spawn(|| director.run());
            scope.spawn(|| mailbox.wait_for_requests());
            let set_view = |hidden: &[usize], away: &[usize], share: f64| {
                let (view, stream) = (settings.view.clone(), settings.stream.clone());
                let hidden = hidden.iter().copied().collect();
                mailbox.set_view(StreamView {
                    camera,
                    size: [800, 600],
                    view,
                    stream,
                    mirrors: Vec::new(),
                    hidden,
                    // Behind the eye.
                    placed: away.iter().map(|cloud| (*cloud, moved)).collect(),
                    test: PointTest::default(),
                    asked: BTreeSet::new(),
                    share,
                    is_alone: false,
                })
            };
            let mut there = [BTreeMap::new(), BTreeMap::new()];
            let none = &[][..];
            let views =
                [(none, none, 1.0), (&[0], none, 1.0), (none, none, 1.0), (none, &[0], 1.0), (none, none, 1.0 / 3.0)];
            let seen = views.map(|(hidden, away, share)| settled(&events, &mut there, set_view(hidden, away, share)));
            mailbox.end();
            seen
        });
        let [(both, demand), (one, _), (again, _), (alone, _), (third, demand_of_third)] = seen;
        assert!(both.iter().all(|points| (20_000..40_000).contains(points)), "{both:?}");
        assert!(one[1] > 50_000 && one[0] + one[1] <= BUDGET, "{one:?}");
        assert!(again.iter().all(|points| (20_000..40_000).contains(points)), "{again:?}");
        // Of a cloud that is moved out of sight only the root stays.
        assert!(alone[1] > both[1] && alone[0] < 17_000, "{alone:?} {both:?}");
        assert!(third.iter().sum::<usize>() <= BUDGET / 3, "{third:?}");
        assert!(demand > 0.9 && demand_of_third > 0.9, "{demand} {demand_of_third}");
    }
}
