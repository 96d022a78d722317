//! The thread that streams the clouds of a job: chooses the nodes that the view needs, and reports what has been
//! loaded.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::time::{Duration, Instant};

use cloud::{Bounds, Chunk, Cover, PointTest};
use scene::Settings;
use stream::{
    Budget, Cut, Missing, Node, NodeChange, Octree, Page, PagedCloud, Streamer, Tree, ViewMeasure, Wanted, choose,
};

use crate::budget::{CUT_PART, half_of, most_points};
use crate::chunk_key::Part;
use crate::error::{is_of_inputs, may_come};
use crate::event::{Event, IndexEntry, IndexState, StreamStats};
use crate::lists::{Lists, Said};
use crate::mailbox::{Arrival, Mailbox, News, StreamRequest, StreamView};
use crate::streamed_cloud::StreamedCloud;
use crate::tiles::{Put, SPACINGS, Tiles, first_point_of, number_of, owner_of, part_of};

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
    /// The clouds, and the open tiles of `tiles` by numbers of their own.
    clouds: BTreeMap<usize, StreamedCloud>,
    /// The clouds whose tiles are opened as views need them.
    tiles: BTreeMap<usize, Tiles>,
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
    /// Whether all that the view needs was there when that was last reported.
    is_settled: bool,
    /// Whether another view has come since what could not be read was last asked for.
    view_has_changed: bool,
    /// Whether nothing is asked for again until the view changes.
    is_stopped: bool,
    reported: (Instant, StreamStats),
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
            tiles: BTreeMap::new(),
            view_number: 0,
            viewpoint: None,
            awaited: None,
            demand: 0.0,
            settings: settings.clone(),
            is_complete: false,
            previews: BTreeMap::new(),
            beside_cut: 0,
            is_settled: false,
            view_has_changed: false,
            is_stopped: false,
            reported,
        })
    }

    /// The same with clouds whose tiles are opened as views need them.
    #[must_use]
    pub fn with_tiles(self, tiles: Vec<Tiles>) -> Self {
        Self { tiles: tiles.into_iter().map(|tiles| (tiles.cloud, tiles)).collect(), ..self }
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
        let is_other_view = is_other;
        if is_other_view {
            // What was stopped before any view stays so for the first one. What found no room before may find some now.
            self.is_stopped &= self.view_number == 1;
            self.clouds.values_mut().filter_map(|streamed| streamed.lists.as_mut()).for_each(Lists::try_again);
            self.tiles.values_mut().filter(|_| !self.is_stopped).for_each(Tiles::try_again);
            let asked = self.viewpoint.as_ref().or(self.awaited.as_ref()).map(|viewpoint| &viewpoint.asked);
            let kept = |asked| self.tiles.values_mut().flat_map(|tiles| tiles.keep(asked)).collect();
            let again: Vec<Arrival> = asked.map(kept).unwrap_or_default();
            again.into_iter().try_for_each(|arrival| self.add(arrival))?;
        }
        for request in requests {
            is_other |= !matches!(request, StreamRequest::KeepRoom { .. } | StreamRequest::Complete(_));
            self.handle(request)?;
        }
        self.show_lists()?;
        is_other |= self.beside_cut() != self.beside_cut;
        if is_other || self.tiles.values().any(Tiles::is_new) {
            self.choose()?;
        }
        self.view_has_changed |= is_other_view;
        if self.is_settled && !is_other && !self.is_stopped {
            is_other |= self.try_again()?;
        }
        self.show_tiles()?;
        let changes = self.streamer.changes();
        let is_quiet = changes.is_empty();
        for change in changes {
            self.pass_on(change)?;
        }
        self.report(is_quiet && !is_other)
    }

    /// Has tiles, lists of nodes and nodes read again that could not be read, once all else that the view needs is there.
    /// Returns whether that has changed what is waited for.
    fn try_again(&mut self) -> Option<bool> {
        let (now, is_other_view) = (Instant::now(), std::mem::take(&mut self.view_has_changed));
        let mut is_any = false;
        for lists in self.clouds.values_mut().filter_map(|streamed| streamed.lists.as_mut()) {
            is_any |= lists.ask_again(now, is_other_view);
        }
        for tiles in self.tiles.values_mut() {
            is_any |= tiles.ask_again(now, is_other_view);
        }
        if is_any {
            self.choose()?;
        }
        self.streamer.try_again(now, is_other_view);
        Some(is_any)
    }

    fn handle(&mut self, request: StreamRequest) -> Option<()> {
        match request {
            StreamRequest::Arrive(arrival) => {
                self.previews.remove(&arrival.cloud);
                self.add(*arrival)?;
            }
            StreamRequest::Close(cloud) => {
                self.previews.remove(&cloud);
                self.tiles.remove(&cloud);
                let own: Vec<usize> = self.clouds.keys().copied().filter(|own| owner_of(*own).0 == cloud).collect();
                for own in own {
                    self.clouds.remove(&own);
                    self.streamer.remove(own);
                }
            }
            StreamRequest::KeepRoom { cloud, points } => drop(self.previews.insert(cloud, points)),
            StreamRequest::Complete(is_complete) => self.is_complete = is_complete,
            StreamRequest::StopTiles => {
                self.is_stopped = true;
                self.tiles.values_mut().for_each(Tiles::stop);
            }
            StreamRequest::Tile { cloud, tile, found } => {
                let Some(tiles) = self.tiles.get_mut(&cloud) else { return Some(()) };
                let Put { closed, arrival } = tiles.put(tile, found);
                self.close_tiles(cloud, closed)?;
                arrival.map_or(Some(()), |arrival| self.add(arrival))?;
            }
            StreamRequest::List { cloud, place, found } => {
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let said = streamed.lists.as_mut().and_then(|lists| lists.put(place, found));
                let input = streamed.input.clone();
                match said {
                    Some(Said::Problem(error)) => self.send(Event::Failed { input, error, is_usage: true })?,
                    Some(Said::Mended(problem)) => self.send(Event::Mended { input, problem, has_come: true })?,
                    None => {}
                }
            }
        }
        Some(())
    }

    /// Passes on the octrees that have changed, as other pages of lists of nodes are there.
    fn show_lists(&mut self) -> Option<()> {
        let mut states = Vec::new();
        let mut mended = Vec::new();
        for (cloud, streamed) in &mut self.clouds {
            let changed = streamed.lists.as_mut().and_then(Lists::changed_octree);
            let (Some(octree), IndexState::Indexed { octree: told, .. }) = (changed, &mut streamed.state) else {
                continue;
            };
            *told = octree.clone();
            self.streamer.know(*cloud, octree.clone());
            (streamed.octree, streamed.placed) = (octree, None);
            // Nodes whose lists have gone are not missing.
            streamed.missing.retain(|node, _| streamed.octree.get(*node).is_some());
            if let Some(problem) = streamed.told.take_if(|_| streamed.missing.is_empty()) {
                mended.push(Event::Mended { input: streamed.input.clone(), problem, has_come: false });
            }
            match owner_of(*cloud) {
                (cloud, None) => states.push((cloud, streamed.state.clone())),
                (owner, Some(_)) => {
                    self.tiles.get_mut(&owner).into_iter().for_each(Tiles::change);
                }
            }
        }
        let states = states.into_iter().map(|(cloud, pages)| Event::Pages { cloud, pages });
        states.chain(mended).try_for_each(|event| self.send(event))
    }

    /// Passes on which tiles are open, and what is to be said of tiles.
    fn show_tiles(&mut self) -> Option<()> {
        let mut events = Vec::new();
        for (cloud, tiles) in &mut self.tiles {
            if tiles.has_changed() {
                let own = self.clouds.range(number_of(*cloud, 0)..number_of(*cloud + 1, 0));
                let open = own.filter_map(|(number, own)| Some((owner_of(*number).1? as u32, own.octree.clone())));
                events.push(Event::Pages { cloud: *cloud, pages: tiles.state(open.collect()) });
            }
            let input = tiles.names().0.to_owned();
            let news = tiles.news().into_iter();
            events.extend(news.map(|error| Event::Failed { input: input.clone(), error, is_usage: true }));
            let mended = tiles.mended().into_iter();
            events.extend(mended.map(|problem| Event::Mended { input: input.clone(), problem, has_come: true }));
        }
        events.into_iter().try_for_each(|event| self.send(event))
    }

    /// Closes tiles of a cloud.
    fn close_tiles(&mut self, cloud: usize, tiles: Vec<usize>) -> Option<()> {
        for number in tiles.into_iter().map(|tile| number_of(cloud, tile)) {
            let Some(mut streamed) = self.clouds.remove(&number) else { continue };
            self.streamer.remove(number);
            // When it is opened again, all is read anew.
            for problem in streamed.take_told() {
                self.send(Event::Mended { input: streamed.input.clone(), problem, has_come: false })?;
            }
            for part in streamed.resident.into_keys() {
                self.send(Event::Dropped { cloud, part })?;
            }
        }
        Some(())
    }

    fn add(&mut self, arrival: Arrival) -> Option<()> {
        let Arrival { cloud, input, name, fit, pages, is_own, missing, was_built, estimate, previews } = arrival;
        let mut before = self.clouds.remove(&cloud);
        // All nodes are read anew.
        if let Some(problem) = before.as_mut().and_then(|before| before.told.take()) {
            self.send(Event::Mended { input: input.clone(), problem, has_come: false })?;
        }
        let lists = match before.as_mut().and_then(|before| before.lists.take()) {
            Some(lists) => lists.again(&pages),
            None => Lists::new(&pages),
        };
        let mut octree =
            lists.as_ref().map_or_else(|| Arc::new(pages.octree().clone()), |lists| lists.octree().clone());
        if fit.as_ref().is_some_and(|fit| fit.grid.is_some()) {
            Arc::make_mut(&mut octree).nodes.iter_mut().for_each(|node| node.is_exact = true);
        }
        let (attributes, grid, has_surfels) = (pages.attributes().to_vec(), pages.grid(), pages.has_surfels());
        let entry = is_own.then(|| IndexEntry { folder: pages.folder().to_owned(), bytes: pages.bytes() });
        let point_bytes = pages.point_bytes();
        let summary = codec::Summary {
            points: octree.points(),
            missing,
            bounds: octree.nodes.first().map(|root| root.bounds),
            warnings: pages.warnings().to_vec(),
            cancelled: false,
        };
        let is_again = before.as_ref().is_some_and(|before| before.summary.is_none());
        let (mut resident, mut stale) = before.map(|before| (before.resident, before.stale)).unwrap_or_default();
        resident.extend(&previews);
        stale.extend(previews);
        let read = move |node| {
            let own = pages.read(node)?;
            let chunk = if let Some(fit) = &fit { fit.apply(own) } else { own };
            Ok(Page { chunk, disk_bytes: pages.page_bytes(node) as u64 })
        };
        let missing = estimate.map_or(Missing::Provisional, Missing::Estimate);
        let paged = PagedCloud { octree: octree.clone(), point_bytes, missing, read: Arc::new(read) };
        self.streamer.replace(cloud, paged);
        let mut summary = (!is_again).then_some(summary);
        let (owner, tile) = owner_of(cloud);
        if let Some((tiles, tile)) = self.tiles.get_mut(&owner).zip(tile) {
            // What is to be said of tiles is said of the whole cloud.
            tiles.warn(tile, summary.take().map(|summary| summary.warnings).unwrap_or_default());
        }
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
            missing: BTreeMap::new(),
            told: None,
        };
        self.clouds.insert(cloud, streamed);
        if tile.is_some() {
            return Some(());
        }
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
            Part::Node(node) | Part::Tile(_, node) => streamed.octree.get(node).map_or(u8::MAX, |node| node.level),
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
            self.send(Event::Dropped { cloud: owner_of(cloud).0, part })?;
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
        let beside_cut = self.beside_cut();
        self.beside_cut = beside_cut;
        let bytes = half_of(stream.host_bytes) as f64;
        let budget = |part: f64| {
            let points = points.saturating_sub(beside_cut).max(points / CUT_PART);
            Budget { points, bytes: (bytes * share * part) as u64 }
        };
        self.streamer.set_budget(budget(1.0));
        for (cloud, streamed) in &mut self.clouds {
            let placement = match &self.viewpoint {
                Some(viewpoint) => viewpoint.placed.get(&owner_of(*cloud).0).copied(),
                None => self.mailbox.first_placement(&streamed.input, &streamed.name),
            };
            streamed.place(placement.as_ref());
        }
        let detail = f64::from(stream.detail);
        let first_test = || self.mailbox.first_test();
        let test = self.viewpoint.as_ref().map_or_else(first_test, |viewpoint| viewpoint.test.clone());
        let measure = self.viewpoint.as_ref().map(StreamView::measure);
        self.need_tiles(measure.as_ref(), &test, detail)?;
        let is_shown = |cloud: usize| {
            let (owner, tile) = owner_of(cloud);
            let is_needed = |tile: usize| self.tiles.get(&owner).is_some_and(|tiles| tiles.is_needed(tile));
            tile.is_none_or(is_needed)
                && !self.viewpoint.as_ref().is_some_and(|viewpoint| viewpoint.hidden.contains(&owner))
        };
        let trees: Vec<Tree> = self
            .clouds
            .iter()
            .filter(|(cloud, streamed)| !streamed.is_awaited() && is_shown(**cloud))
            .map(|(cloud, streamed)| Tree {
                cloud: *cloud,
                octree: streamed.nodes(),
                point_bytes: streamed.point_bytes,
            })
            .collect();
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
        let demand = (demand + beside_cut as f64 / most.max(1) as f64).min(1.0);
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

    /// Has the tiles opened that a view needs.
    fn need_tiles(&mut self, measure: Option<&ViewMeasure>, test: &PointTest, detail: f64) -> Option<()> {
        let mut closed = Vec::new();
        for (cloud, tiles) in &mut self.tiles {
            let (input, name) = tiles.names();
            let placement = match &self.viewpoint {
                Some(viewpoint) => viewpoint.placed.get(cloud).copied(),
                None => self.mailbox.first_placement(input, name),
            };
            let is_hidden = self.viewpoint.as_ref().is_some_and(|viewpoint| viewpoint.hidden.contains(cloud));
            tiles.need(measure.is_none(), |own: Bounds| {
                let bounds = placement.map_or(own, |placement| placement.bounds(own));
                if is_hidden || shows_nothing(test, bounds) {
                    return None;
                }
                let Some(measure) = measure else { return Some((false, 0.0)) };
                // Tiles outside of the picture count as nodes there do.
                let spacing = bounds.size().max_element() / SPACINGS;
                let is_needed = measure.sees(bounds) || 2.0 * measure.pixels_of(bounds, spacing) > detail;
                is_needed.then(|| measure.rank(bounds))
            });
            closed.push((*cloud, tiles.open_needed(&self.mailbox)));
        }
        closed.into_iter().try_for_each(|(cloud, closed)| self.close_tiles(cloud, closed))
    }

    fn pass_on(&mut self, change: NodeChange) -> Option<()> {
        match change {
            NodeChange::Put { cloud, node, chunk } => {
                let (owner, part) = part_of(cloud, node);
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let points = chunk.len() as u64;
                streamed.resident.insert(part, points);
                if streamed.is_awaited() {
                    streamed.stale.insert(part, points);
                } else {
                    streamed.stale.remove(&part);
                }
                let chunk = Chunk { first_point: first_point_of(cloud, chunk.first_point), ..chunk };
                self.send(Event::Chunk { cloud: owner, part, chunk })
            }
            NodeChange::Drop { cloud, node } => {
                let (owner, part) = part_of(cloud, node);
                if let Some(streamed) = self.clouds.get_mut(&cloud) {
                    streamed.resident.remove(&part);
                    streamed.stale.remove(&part);
                }
                self.send(Event::Dropped { cloud: owner, part })
            }
            NodeChange::Mended { cloud, node } => {
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                streamed.missing.remove(&node);
                let Some(problem) = streamed.told.take_if(|_| streamed.missing.is_empty()) else { return Some(()) };
                let input = streamed.input.clone();
                self.send(Event::Mended { input, problem, has_come: true })
            }
            NodeChange::Failed { cloud, node, error } => {
                let Some(streamed) = self.clouds.get_mut(&cloud) else { return Some(()) };
                let is_damage = matches!(
                    error,
                    stream::Error::Damaged { .. } | stream::Error::PageSize { .. } | stream::Error::Io { .. }
                );
                if !(is_damage && streamed.is_own) {
                    // Its list may have gone since it was read.
                    if streamed.octree.get(node).is_none() {
                        return Some(());
                    }
                    streamed.missing.insert(node, may_come(&error));
                    if streamed.told.is_some() {
                        return Some(());
                    }
                    let (input, is_usage) = (streamed.input.clone(), is_of_inputs(&error));
                    let error = streamed.told.insert(error.to_string()).clone();
                    return self.send(Event::Failed { input, error, is_usage });
                }
                if std::mem::replace(&mut streamed.is_damaged, true) {
                    return Some(());
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
        let tiles_waiting: usize = self.tiles.values().map(Tiles::waiting).sum();
        let is_awaited = lists_waiting + tiles_waiting > 0 || self.clouds.values().any(StreamedCloud::is_awaited);
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
            let mut read: Vec<_> = self.clouds.iter_mut().filter_map(read).collect();
            let mut failed = Vec::new();
            for (cloud, tiles) in &mut self.tiles {
                let Some((summary, missing)) = tiles.summary() else { continue };
                read.push((*cloud, summary));
                failed.extend(missing.into_iter().map(|error| (tiles.names().0.to_owned(), error)));
            }
            for (cloud, summary) in read {
                self.send(Event::Read { cloud, summary })?;
            }
            for (input, error) in failed {
                self.send(Event::Failed { input, error, is_usage: true })?;
            }
        }
        self.is_settled = is_there && self.is_complete;
        let whole = self.clouds.iter().filter(|(cloud, _)| owner_of(**cloud).1.is_none());
        let of_tiles = self.tiles.values().map(Tiles::points);
        let counts = self.tiles.values().map(Tiles::counts);
        let of_nodes = self.clouds.values().flat_map(StreamedCloud::missing);
        let missing: Vec<bool> = of_nodes.chain(self.tiles.values().flat_map(Tiles::missing)).collect();
        let stats = StreamStats {
            view_number: self.view_number,
            is_settled: self.is_settled,
            nodes: shown.shown_nodes,
            points_resident: shown.shown_points,
            points_total: whole.map(|(_, streamed)| streamed.octree.points()).chain(of_tiles).sum(),
            host_bytes: shown.bytes,
            nodes_waiting: shown.waiting_nodes + lists_waiting + tiles_waiting,
            tiles: counts.fold([0; 3], |all, own| [0, 1, 2].map(|index| all[index] + own[index])),
            demand: self.demand,
            disk_bytes_per_second: shown.disk_bytes_per_second,
            points_per_second: shown.points_per_second,
            points_missing: self.clouds.values().map(StreamedCloud::points_missing).sum(),
            nodes_missing: missing.len(),
            may_come: missing.contains(&true),
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

#[cfg(test)]
#[path = "director_tests.rs"]
mod tests;
