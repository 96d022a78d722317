//! The way of a cut into memory: worker threads that read pages in the order of their importance, a cache of decoded chunks
//! under a byte ceiling, and the changes that whoever draws has to make, in an order in which nothing blinks.
//!
//! - A chunk is *shown* from the [`Change::Put`] that hands it over to its [`Change::Drop`]. ShownNode nodes are closed towards the
//!   root: a child comes after its parent and goes before it, so no place that had points loses all of them.
//! - Where points come, their chunks are put first and the radii of those that stand for them shrink afterwards; where points go,
//!   the radii of those that stay grow first.
//! - What the last cut does not want stays shown until the budget needs its place, or goes at once where nothing else is to be
//!   shown; the least recently wanted goes first. It stays in memory after that as long as there is room.
//! - The ceiling counts all decoded chunks: shown, kept and being read. A chunk that is dropped counts no more from the call of
//!   [`Streamer::changes`] that says so, though the caller may hold it for a little longer.

use std::any::Any;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::panic::AssertUnwindSafe;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cloud::{Chunk, Progress, SurfelOptions, pack_radius, provisional_radius};
use glam::DVec3;

use crate::radius_scale::{
    Drawn, Field, Octants, Radii, count_first_octants, count_octants, cube_center, is_near, larger, to_full_density,
};
use crate::{BATCHES, Budget, Error, NodeId, Octree, Result, Wanted, prefix};

/// Rates are taken over this long.
const RATE_TIME: Duration = Duration::from_secs(1);
/// A chunk's radii are held twice where they are scaled.
const SCALED_RADIUS_BYTES: u64 = 2;

/// What a reader gives.
pub struct Page {
    /// All points of a node in the order of their batches.
    pub chunk: Chunk,
    /// That were read for it from the disk.
    pub disk_bytes: u64,
}

/// A cloud whose pages can be read.
#[derive(Clone)]
pub struct PagedCloud {
    pub octree: Arc<Octree>,
    /// Bytes of a decoded point, its normal and radius included, without `exact_positions`.
    pub point_bytes: u64,
    pub missing: Missing,
    /// Called by several threads at a time. Radii that it gives are those of full density.
    pub read: Arc<dyn Fn(NodeId) -> Result<Page> + Send + Sync>,
}

impl PagedCloud {
    /// Bytes of a whole node in memory.
    fn cost(&self, node: NodeId) -> u64 {
        let node = self.octree.node(node);
        let point_bytes = node.point_bytes(self.point_bytes).saturating_add(SCALED_RADIUS_BYTES);
        u64::from(node.points).saturating_mul(point_bytes)
    }
}

/// What is done for nodes whose pages have no radii.
#[derive(Clone, Copy, Debug)]
pub enum Missing {
    /// Normals and radii are estimated from the node's own points.
    Estimate(SurfelOptions),
    /// One radius for all of a node's points, after its density. Normals stay missing.
    Provisional,
}

/// What has changed for whoever draws: to be done in this order.
#[derive(Debug)]
pub enum Change {
    /// The chunk of a node comes, or takes another form.
    Put { cloud: usize, node: NodeId, chunk: Chunk },
    /// The chunk of a node goes.
    Drop { cloud: usize, node: NodeId },
    /// The node cannot be read, and is not tried again; the others go on.
    Failed { cloud: usize, node: NodeId, error: Error },
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamStats {
    /// Nodes and points that are shown.
    pub shown_nodes: usize,
    pub shown_points: u64,
    /// Of decoded chunks: shown, kept and being read.
    pub bytes: u64,
    /// Nodes that are wanted and not shown yet.
    pub waiting_nodes: usize,
    /// Over the last second.
    pub disk_bytes_per_second: f64,
    pub points_per_second: f64,
    /// All that is wanted is shown, or cannot be read.
    pub settled: bool,
}

/// Brings nodes into memory and says what to draw. All calls return at once: reading is done by threads of its own.
pub struct Streamer {
    shared: Arc<Shared>,
    workers: Vec<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    /// There may be something to read, or room for it.
    work: Condvar,
    wake: Box<dyn Fn() + Send + Sync>,
}

impl Streamer {
    /// With so many threads. `wake` is called by them whenever [`Streamer::changes`] has something to do; it must not
    /// drop the streamer.
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

    /// A cloud under a number that is free.
    pub fn add(&self, cloud: usize, paged: PagedCloud) {
        self.replace(cloud, paged);
    }

    /// Another way to read the cloud, as when its radii are known now. What is shown stays until its nodes are read again; if the
    /// octree is another one, it is dropped.
    pub fn replace(&self, cloud: usize, paged: PagedCloud) {
        self.shared.lock().replace(cloud, paged);
        self.shared.work.notify_all();
    }

    /// Forgets a cloud. No change of it follows: the caller drops what it has of it.
    pub fn remove(&self, cloud: usize) {
        let mut state = self.shared.lock();
        state.asked.retain(|wanted| wanted.cloud != cloud);
        state.remove(cloud);
        drop(state);
        self.shared.work.notify_all();
    }

    /// What to show from now on, the most important first, parents before children, as [`crate::choose`] gives it. Takes the
    /// place of the last one: what is no longer wanted and not being read yet will not be read. What goes beyond the budget is
    /// left out, and so are nodes without their parent.
    pub fn want(&self, wanted: Vec<Wanted>) {
        self.shared.lock().want(wanted);
        self.shared.work.notify_all();
    }

    /// Whether nothing is to be shown but what the last cut wants: then what is there at the end does not depend on earlier cuts.
    pub fn show_only_wanted(&self, only_wanted: bool) {
        self.shared.lock().only_wanted = only_wanted;
    }

    /// Points that are shown and bytes of decoded chunks, at most.
    pub fn set_budget(&self, budget: Budget) {
        let mut state = self.shared.lock();
        state.set_budget(budget);
        drop(state);
        self.shared.work.notify_all();
    }

    /// What has changed since the last call. To be called after each wake, and after a new cut or budget: what is in memory
    /// already comes at once. Where a chunk shares its `positions` with the one that it takes the place of, only its radii are
    /// other ones.
    pub fn changes(&self) -> Vec<Change> {
        let changes = self.shared.lock().changes();
        if !changes.is_empty() {
            self.shared.work.notify_all();
        }
        changes
    }

    pub fn stats(&self) -> StreamStats {
        self.shared.lock().stats()
    }
}

impl Drop for Streamer {
    fn drop(&mut self) {
        self.shared.lock().stopped = true;
        self.shared.work.notify_all();
        for worker in self.workers.drain(..) {
            // It caught its own panics.
            let _ = worker.join();
        }
    }
}

impl Shared {
    /// The state is made sense of by short functions that do not panic half-way.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What each thread does.
    fn work(&self) {
        while let Some(job) = self.next_job() {
            let page = std::panic::catch_unwind(AssertUnwindSafe(|| job.load()));
            let page = page.unwrap_or_else(|panic| Err(Error::Panicked(message(panic.as_ref()))));
            self.lock().finish(job, page);
            self.work.notify_all();
            (self.wake)();
        }
    }

    /// Waits for one; `None` at the end.
    fn next_job(&self) -> Option<Job> {
        let mut state = self.lock();
        while !state.stopped {
            if let Some(job) = state.next_job() {
                return Some(job);
            }
            // No room although there is something to read: the caller is to make it by dropping chunks.
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

/// A node to read.
struct Job {
    cloud: usize,
    node: NodeId,
    /// Of the cloud when the job was given out.
    generation: u64,
    paged: PagedCloud,
    /// Set aside for it.
    bytes: u64,
}

/// A decoded node.
#[derive(Clone)]
struct Loaded {
    node: NodeId,
    /// All of its points, or those of its first batches; radii are those of full density.
    chunk: Chunk,
    /// Of the node's cube.
    center: DVec3,
    /// Of all of the node's points.
    own: Octants,
    /// Radii are those of the node's own points, made those of full density.
    is_estimated: bool,
    disk_bytes: u64,
}

/// A node as it was handed over.
struct ShownNode {
    loaded: Loaded,
    generation: u64,
    drawn: Octants,
    /// That it is drawn with.
    radii: Radii,
}

#[derive(Default)]
struct Entry {
    /// Batches; 0: not wanted.
    wanted: usize,
    /// The number of the last cut that wanted it. No child's is larger than its parent's.
    wanted_at: u64,
    in_flight: bool,
    failed: bool,
    /// Not shown, or to take the place of what is shown. All points, of the cloud's generation.
    loaded: Option<Loaded>,
    shown: Option<ShownNode>,
}

struct Held {
    paged: PagedCloud,
    /// Counts replacements.
    generation: u64,
    /// What is shown follows it.
    field: Field,
    /// Nodes that are shown with larger radii than need be.
    loose: BTreeSet<NodeId>,
    entries: BTreeMap<NodeId, Entry>,
}

struct State {
    budget: Budget,
    workers: usize,
    clouds: BTreeMap<usize, Held>,
    /// The last cut, whole and as far as the budget goes.
    asked: Vec<Wanted>,
    wanted: Vec<Wanted>,
    /// Nothing else stays shown.
    only_wanted: bool,
    cuts: u64,
    generations: u64,
    /// Nodes to be read, next first.
    queue: VecDeque<(usize, NodeId)>,
    bytes: u64,
    shown_points: u64,
    shown_nodes: usize,
    /// To be handed over before anything else.
    pending: Vec<Change>,
    /// When, bytes, points.
    reads: VecDeque<(Instant, u64, u64)>,
    asks_for_room: bool,
    stopped: bool,
}

impl Job {
    fn load(&self) -> Result<Loaded> {
        let Page { mut chunk, disk_bytes } = (self.paged.read)(self.node)?;
        let octree = &self.paged.octree;
        let node = octree.node(self.node);
        if chunk.len() != node.points as usize {
            return Err(Error::PageSize { found: chunk.len() as u64, expected: u64::from(node.points) });
        }
        chunk.first_point = node.first_point;
        let is_estimated = chunk.radii.is_none() && matches!(self.paged.missing, Missing::Estimate(_));
        self.paged.missing.fill(&mut chunk, octree, self.node);
        let center = cube_center(octree, self.node);
        Ok(Loaded { node: self.node, own: count_octants(&chunk, center), center, is_estimated, chunk, disk_bytes })
    }
}

impl Missing {
    /// Radii of full density, where the chunk has none.
    fn fill(self, chunk: &mut Chunk, octree: &Octree, id: NodeId) {
        if chunk.radii.is_some() {
            return;
        }
        match self {
            Self::Estimate(options) => {
                let surfels = cloud::estimate(std::slice::from_ref(chunk), &options, &Progress::default());
                if let Some(mut surfels) = surfels.and_then(|mut surfels| surfels.pop()) {
                    to_full_density(&mut surfels.radii, chunk, octree, id);
                    chunk.normals = Some(Arc::new(surfels.normals));
                    chunk.radii = Some(Arc::new(surfels.radii));
                }
            }
            Self::Provisional => {
                let node = octree.node(id);
                let radius = pack_radius(provisional_radius(node.bounds, node.total));
                chunk.radii = Some(Arc::new(vec![radius; chunk.len()]));
            }
        }
    }
}

impl Loaded {
    fn bytes(&self) -> u64 {
        self.chunk.size_in_bytes() as u64 + self.chunk.len() as u64 * SCALED_RADIUS_BYTES
    }

    /// The radii that the field gives its points.
    fn radii(&self, id: NodeId, field: &Field) -> Radii {
        field.radii(id, &self.chunk, !self.is_estimated)
    }

    /// Its first so many points.
    fn first(self, points: usize) -> Self {
        if points >= self.chunk.len() {
            return self;
        }
        let indices: Vec<u32> = (0..points as u32).collect();
        Self { chunk: self.chunk.select(&indices), ..self }
    }
}

impl ShownNode {
    fn new(loaded: Loaded, generation: u64, radii: Radii) -> Self {
        let drawn = count_octants(&loaded.chunk, loaded.center);
        Self { loaded, generation, drawn, radii }
    }

    fn points(&self) -> u64 {
        self.loaded.chunk.len() as u64
    }

    fn put(&self, cloud: usize) -> Change {
        let chunk = Chunk { radii: self.radii.clone(), ..self.loaded.chunk.clone() };
        Change::Put { cloud, node: self.loaded.node, chunk }
    }

    /// `None` for a node without points, which was never put.
    fn leave(&self, cloud: usize) -> Option<Change> {
        (!self.loaded.chunk.is_empty()).then_some(Change::Drop { cloud, node: self.loaded.node })
    }

    /// Puts it anew with these radii, if they are other ones.
    fn rescale(&mut self, cloud: usize, radii: Radii, changes: &mut Vec<Change>) {
        if radii != self.radii {
            self.radii = radii;
            changes.push(self.put(cloud));
        }
    }
}

impl Entry {
    fn is_of_use(&self) -> bool {
        self.wanted > 0 || self.in_flight || self.failed || self.loaded.is_some() || self.shown.is_some()
    }

    /// Whether children may be shown: its points are there, or never will be.
    fn is_present(&self) -> bool {
        self.shown.is_some() || self.failed
    }
}

impl Held {
    fn entry(&self, node: NodeId) -> Option<&Entry> {
        self.entries.get(&node)
    }

    /// Points that are to be shown of a wanted node.
    fn wanted_points(&self, node: NodeId, wanted: usize) -> usize {
        prefix(self.paged.octree.node(node).points as usize, wanted)
    }

    /// Whether what is shown of a wanted node is what is wanted, or more.
    fn is_satisfied(&self, node: NodeId, entry: &Entry) -> bool {
        let points = self.wanted_points(node, entry.wanted) as u64;
        let enough = |shown: &ShownNode| shown.generation == self.generation && shown.points() >= points;
        entry.failed || entry.shown.as_ref().is_some_and(enough)
    }
}

/// The nodes that are dropped, shrunk and added to reach the wanted cut.
#[derive(Default)]
struct NodeChanges {
    drops: BTreeSet<(usize, NodeId)>,
    /// Points that remain.
    shrinks: BTreeMap<(usize, NodeId), usize>,
    /// Parents before children, with their points.
    arrivals: Vec<(usize, NodeId, usize)>,
}

/// Where the radii of a cloud are to lead.
struct Target {
    field: Field,
    /// Whose radii may be other ones than they are.
    nodes: BTreeSet<NodeId>,
    /// Those that were worked out.
    radii: BTreeMap<NodeId, Radii>,
}

impl Target {
    /// Of what is to be shown of a node.
    fn of(&mut self, id: NodeId, loaded: &Loaded) -> Radii {
        let radii = loaded.radii(id, &self.field);
        self.radii.insert(id, radii.clone());
        radii
    }
}

/// Where room can be made, the next last.
enum Victim {
    Drop(usize, NodeId),
    Shrink(usize, NodeId, usize),
}

impl State {
    fn new(budget: Budget, workers: usize) -> Self {
        Self {
            budget,
            workers,
            clouds: BTreeMap::new(),
            asked: Vec::new(),
            wanted: Vec::new(),
            only_wanted: false,
            cuts: 0,
            generations: 0,
            queue: VecDeque::new(),
            bytes: 0,
            shown_points: 0,
            shown_nodes: 0,
            pending: Vec::new(),
            reads: VecDeque::new(),
            asks_for_room: false,
            stopped: false,
        }
    }

    fn replace(&mut self, cloud: usize, paged: PagedCloud) {
        let same = self.clouds.get(&cloud).is_some_and(|held| held.paged.octree == paged.octree);
        if !same {
            let drops = self.remove(cloud);
            self.pending.extend(drops);
        }
        // What was wrong with the pages before is not what these are.
        self.pending.retain(|change| !matches!(change, Change::Failed { cloud: other, .. } if *other == cloud));
        self.generations += 1;
        let generation = self.generations;
        let before = self.clouds.remove(&cloud).map(|held| (held.entries, held.field, held.loose));
        let (mut entries, field, loose) = before.unwrap_or_default();
        for entry in entries.values_mut() {
            // What is being read for the old generation will be thrown away.
            (entry.in_flight, entry.failed) = (false, false);
            self.bytes -= entry.loaded.take().map_or(0, |loaded| loaded.bytes());
        }
        self.clouds.insert(cloud, Held { paged, generation, field, loose, entries });
        self.accept();
    }

    /// Gives the drops of what was shown, children first.
    fn remove(&mut self, cloud: usize) -> Vec<Change> {
        let mut drops = Vec::new();
        for entry in self.clouds.remove(&cloud).into_iter().flat_map(|held| held.entries.into_values()).rev() {
            self.bytes -= entry.loaded.map_or(0, |loaded| loaded.bytes());
            if let Some(shown) = entry.shown {
                self.bytes -= shown.loaded.bytes();
                self.shown_points -= shown.points();
                self.shown_nodes -= 1;
                drops.extend(shown.leave(cloud));
            }
        }
        self.pending.retain(|change| match change {
            Change::Put { cloud: other, .. }
            | Change::Drop { cloud: other, .. }
            | Change::Failed { cloud: other, .. } => *other != cloud,
        });
        self.accept();
        drops
    }

    fn want(&mut self, asked: Vec<Wanted>) {
        self.asked = asked;
        self.cuts += 1;
        self.accept();
    }

    fn set_budget(&mut self, budget: Budget) {
        if budget.bytes > self.budget.bytes {
            // What was too large may be no more.
            let entries = self.clouds.values_mut().flat_map(|held| held.entries.values_mut());
            entries.for_each(|entry| entry.failed = false);
        }
        self.budget = budget;
        self.accept();
    }

    /// Takes over the last cut as far as the budget goes.
    fn accept(&mut self) {
        for held in self.clouds.values_mut() {
            held.entries.values_mut().for_each(|entry| entry.wanted = 0);
        }
        let mut points = self.budget.points;
        // One node more than is wanted must find room: it may have to be read to take the place of what is shown of it.
        let most = self.budget.bytes / 2;
        let cost_of = |wanted: &Wanted| {
            let paged = &self.clouds.get(&wanted.cloud)?.paged;
            paged.octree.nodes.get(wanted.node.0 as usize).map(|_| paged.cost(wanted.node))
        };
        let reserve = self.asked.iter().filter_map(cost_of).filter(|cost| *cost <= most).max().unwrap_or(0);
        let mut bytes = self.budget.bytes.saturating_sub(reserve);
        self.wanted.clear();
        for Wanted { cloud, node: id, batches } in &self.asked {
            let Some(held) = self.clouds.get_mut(cloud) else { continue };
            let Some(node) = held.paged.octree.nodes.get(id.0 as usize) else { continue };
            let is_wanted = |id: NodeId| held.entry(id).is_some_and(|entry| entry.wanted > 0);
            // What is too large is not wanted itself, so that what is shown of it can go.
            let may_have_children = |id: NodeId| held.entry(id).is_some_and(|entry| entry.wanted > 0 || entry.failed);
            if !node.parent.is_none_or(may_have_children) || is_wanted(*id) || *batches == 0 {
                continue;
            }
            let cost = held.paged.cost(*id);
            if cost > most {
                let entry = held.entries.entry(*id).or_default();
                entry.wanted_at = self.cuts;
                if !std::mem::replace(&mut entry.failed, true) {
                    let error = Error::TooLarge { bytes: cost, budget: self.budget.bytes };
                    self.pending.push(Change::Failed { cloud: *cloud, node: *id, error });
                }
                continue;
            }
            let fits = |batches: &usize| prefix(node.points as usize, *batches) as u64 <= points;
            let asked = (*batches).min(BATCHES);
            let batches = (1..=asked).rev().find(fits).filter(|_| cost <= bytes).unwrap_or(0);
            if batches > 0 {
                points -= prefix(node.points as usize, batches) as u64;
                bytes -= cost;
                let entry = held.entries.entry(*id).or_default();
                (entry.wanted, entry.wanted_at) = (batches, self.cuts);
                self.wanted.push(Wanted { cloud: *cloud, node: *id, batches });
            }
            if batches < asked {
                break;
            }
        }
        for held in self.clouds.values_mut() {
            held.entries.retain(|_, entry| entry.is_of_use());
        }
        let is_missing = |wanted: &&Wanted| {
            let held = &self.clouds[&wanted.cloud];
            let entry = &held.entries[&wanted.node];
            !entry.in_flight && entry.loaded.is_none() && !held.is_satisfied(wanted.node, entry)
        };
        self.queue = self.wanted.iter().filter(is_missing).map(|wanted| (wanted.cloud, wanted.node)).collect();
        self.asks_for_room = false;
    }

    /// The next node to read, if there is one and room for it.
    fn next_job(&mut self) -> Option<Job> {
        let (cloud, node) = *self.queue.front()?;
        let bytes = self.clouds.get(&cloud)?.paged.cost(node);
        self.evict(bytes);
        if self.bytes + bytes > self.budget.bytes {
            return None;
        }
        self.queue.pop_front();
        self.bytes += bytes;
        let held = self.clouds.get_mut(&cloud)?;
        held.entries.entry(node).or_default().in_flight = true;
        Some(Job { cloud, node, generation: held.generation, paged: held.paged.clone(), bytes })
    }

    /// Forgets kept chunks, the least recently wanted first, until so many bytes more have room.
    fn evict(&mut self, bytes: u64) {
        if self.bytes.saturating_add(bytes) <= self.budget.bytes {
            return;
        }
        for (_, Reverse(node), cloud) in self.kept() {
            if self.bytes.saturating_add(bytes) <= self.budget.bytes {
                return;
            }
            let entry = self.clouds.get_mut(&cloud).and_then(|held| held.entries.get_mut(&node));
            let loaded = entry.and_then(|entry| entry.loaded.take());
            self.bytes -= loaded.map_or(0, |loaded| loaded.bytes());
        }
    }

    /// Decoded chunks that nobody wants, least recently wanted first and children before their parents.
    fn kept(&self) -> Vec<(u64, Reverse<NodeId>, usize)> {
        self.unwanted(|entry| entry.loaded.is_some())
    }

    fn unwanted(&self, matches: impl Fn(&Entry) -> bool) -> Vec<(u64, Reverse<NodeId>, usize)> {
        let mut found: Vec<_> = self
            .clouds
            .iter()
            .flat_map(|(cloud, held)| held.entries.iter().map(move |(node, entry)| (*cloud, *node, entry)))
            .filter(|(_, _, entry)| entry.wanted == 0 && matches(entry))
            .map(|(cloud, node, entry)| (entry.wanted_at, Reverse(node), cloud))
            .collect();
        found.sort_unstable();
        found
    }

    fn finish(&mut self, job: Job, loaded: Result<Loaded>) {
        self.bytes -= job.bytes;
        if let Ok(loaded) = &loaded {
            self.forget_reads();
            self.reads.push_back((Instant::now(), loaded.disk_bytes, loaded.chunk.len() as u64));
        }
        let Some(held) = self.clouds.get_mut(&job.cloud).filter(|held| held.generation == job.generation) else {
            return;
        };
        let Some(entry) = held.entries.get_mut(&job.node) else { return };
        entry.in_flight = false;
        match loaded {
            Ok(loaded) => {
                self.bytes += loaded.bytes();
                let points = loaded.chunk.len() as u64;
                let excess = loaded.bytes().saturating_sub(held.paged.cost(job.node));
                entry.loaded = Some(loaded);
                if excess > 0 {
                    // The cut was promised for less than its pages take: as much of it as there is room for.
                    held.paged.point_bytes += excess.div_ceil(points);
                    self.accept();
                }
            }
            Err(error) => {
                entry.failed = true;
                self.pending.push(Change::Failed { cloud: job.cloud, node: job.node, error });
            }
        }
    }

    fn forget_reads(&mut self) {
        while self.reads.front().is_some_and(|(when, ..)| when.elapsed() > RATE_TIME) {
            self.reads.pop_front();
        }
    }

    fn changes(&mut self) -> Vec<Change> {
        let mut changes = std::mem::take(&mut self.pending);
        self.asks_for_room = false;
        let plan = self.plan();
        let mut targets = self.targets(&plan);
        self.grow_radii(&plan, &mut targets, &mut changes);
        self.drop_and_shrink(&plan, &mut targets, &mut changes);
        self.show(&plan, &mut targets, &mut changes);
        self.shrink_radii(targets, &mut changes);
        self.evict(0);
        // A node without points is shown so that those below it can be, but there is nothing to draw.
        changes.retain(|change| !matches!(change, Change::Put { chunk, .. } if chunk.is_empty()));
        changes
    }

    fn shown(&self, cloud: usize, node: NodeId) -> Option<&ShownNode> {
        self.clouds.get(&cloud)?.entry(node)?.shown.as_ref()
    }

    fn shown_mut(&mut self, cloud: usize, node: NodeId) -> Option<&mut ShownNode> {
        self.clouds.get_mut(&cloud)?.entries.get_mut(&node)?.shown.as_mut()
    }

    /// Where room can be made without losing what is wanted: nodes that are not, then batches that are not. The next is last.
    fn victims(&self) -> Vec<Victim> {
        let mut victims: Vec<Victim> = self
            .wanted
            .iter()
            .filter_map(|Wanted { cloud, node, batches }| {
                let points = self.clouds.get(cloud)?.wanted_points(*node, *batches);
                let shown = self.shown(*cloud, *node)?;
                (shown.points() > points as u64).then_some(Victim::Shrink(*cloud, *node, points))
            })
            .collect();
        let unwanted = self.unwanted(|entry| entry.shown.is_some());
        victims.extend(unwanted.into_iter().rev().map(|(_, Reverse(node), cloud)| Victim::Drop(cloud, node)));
        victims
    }

    fn plan(&self) -> NodeChanges {
        let mut plan = NodeChanges::default();
        let mut victims = self.victims();
        let mut points = self.shown_points;
        let mut bytes = self.bytes - self.kept_bytes();
        let upcoming = self.queue.iter().take(self.workers);
        let upcoming: u64 = upcoming.filter_map(|(cloud, node)| Some(self.clouds.get(cloud)?.paged.cost(*node))).sum();
        let mut make_room = |plan: &mut NodeChanges, points: &mut u64, bytes: &mut u64| {
            let Some(victim) = victims.pop() else { return false };
            let (cloud, node, left) = match victim {
                Victim::Drop(cloud, node) => (cloud, node, 0),
                Victim::Shrink(cloud, node, left) => (cloud, node, left as u64),
            };
            let Some(shown) = self.shown(cloud, node) else { return true };
            *points -= shown.points() - left;
            if left == 0 {
                *bytes -= shown.loaded.bytes();
                plan.drops.insert((cloud, node));
            } else {
                plan.shrinks.insert((cloud, node), left as usize);
            }
            true
        };
        let has_room = |points: u64, bytes: u64| {
            points <= self.budget.points && bytes.saturating_add(upcoming) <= self.budget.bytes
        };
        while (self.only_wanted || !has_room(points, bytes)) && make_room(&mut plan, &mut points, &mut bytes) {}

        let mut coming = BTreeSet::new();
        for Wanted { cloud, node: id, batches } in &self.wanted {
            let Some(held) = self.clouds.get(cloud) else { continue };
            let Some(entry) = held.entry(*id).filter(|entry| entry.loaded.is_some()) else { continue };
            let node = held.paged.octree.node(*id);
            let is_present = |parent: NodeId| {
                coming.contains(&(*cloud, parent)) || held.entry(parent).is_some_and(Entry::is_present)
            };
            if held.is_satisfied(*id, entry) || !node.parent.is_none_or(is_present) {
                continue;
            }
            let wanted = held.wanted_points(*id, *batches);
            let replaced = match plan.shrinks.remove(&(*cloud, *id)) {
                Some(left) => left as u64,
                None => entry.shown.as_ref().map_or(0, ShownNode::points),
            };
            points -= replaced;
            let mut fits = points + wanted as u64 <= self.budget.points;
            while !fits && make_room(&mut plan, &mut points, &mut bytes) {
                fits = points + wanted as u64 <= self.budget.points;
            }
            if !fits {
                points += replaced;
                continue;
            }
            points += wanted as u64;
            coming.insert((*cloud, *id));
            plan.arrivals.push((*cloud, *id, wanted));
        }
        plan
    }

    fn kept_bytes(&self) -> u64 {
        let entries = self.clouds.values().flat_map(|held| held.entries.values());
        entries.filter(|entry| entry.wanted == 0).filter_map(|entry| entry.loaded.as_ref()).map(Loaded::bytes).sum()
    }

    /// Where a plan leads, for the clouds that it changes or whose radii are larger than need be.
    fn targets(&self, plan: &NodeChanges) -> BTreeMap<usize, Target> {
        let loose = self.clouds.iter().filter(|(_, held)| !held.loose.is_empty()).map(|(cloud, _)| *cloud);
        let touched: BTreeSet<usize> = loose
            .chain(plan.drops.iter().map(|(cloud, _)| *cloud))
            .chain(plan.shrinks.keys().map(|(cloud, _)| *cloud))
            .chain(plan.arrivals.iter().map(|(cloud, ..)| *cloud))
            .collect();
        let target = |cloud: usize| {
            let held = self.clouds.get(&cloud)?;
            let field = Field::new(&held.paged.octree, &self.drawn_after(cloud, plan));
            let nodes = field.changed(&held.field, &held.paged.octree);
            Some((cloud, Target { field, nodes, radii: BTreeMap::new() }))
        };
        touched.into_iter().filter_map(target).collect()
    }

    /// What is shown of a cloud when the plan is done.
    fn drawn_after(&self, cloud: usize, plan: &NodeChanges) -> BTreeMap<NodeId, Drawn> {
        let Some(held) = self.clouds.get(&cloud) else { return BTreeMap::new() };
        let mut drawn = BTreeMap::new();
        let prefix_of = |loaded: &Loaded, points: usize| {
            if points == loaded.chunk.len() {
                return loaded.own;
            }
            count_first_octants(&loaded.chunk, loaded.center, points)
        };
        for (id, entry) in &held.entries {
            let Some(shown) = &entry.shown else { continue };
            let own = shown.loaded.own;
            let remaining = match plan.shrinks.get(&(cloud, *id)) {
                Some(points) => prefix_of(&shown.loaded, *points),
                None => shown.drawn,
            };
            if !plan.drops.contains(&(cloud, *id)) {
                drawn.insert(*id, Drawn { own, drawn: remaining });
            }
        }
        for (_, id, points) in plan.arrivals.iter().filter(|(other, ..)| *other == cloud) {
            if let Some(loaded) = held.entry(*id).and_then(|entry| entry.loaded.as_ref()) {
                drawn.insert(*id, Drawn { own: loaded.own, drawn: prefix_of(loaded, *points) });
            }
        }
        drawn
    }

    /// Of nodes that stay, where more must be covered than before.
    fn grow_radii(&mut self, plan: &NodeChanges, targets: &mut BTreeMap<usize, Target>, changes: &mut Vec<Change>) {
        for (cloud, target) in targets {
            for id in &target.nodes {
                if let Some(shown) = self.shown_mut(*cloud, *id)
                    && !plan.shrinks.contains_key(&(*cloud, *id))
                {
                    let radii = shown.loaded.radii(*id, &target.field);
                    shown.rescale(*cloud, larger(&shown.radii, &radii), changes);
                    target.radii.insert(*id, radii);
                }
            }
        }
    }

    fn drop_and_shrink(
        &mut self,
        plan: &NodeChanges,
        targets: &mut BTreeMap<usize, Target>,
        changes: &mut Vec<Change>,
    ) {
        for ((cloud, id), points) in &plan.shrinks {
            let Some(entry) = self.clouds.get_mut(cloud).and_then(|held| held.entries.get_mut(id)) else { continue };
            let Some(shown) = entry.shown.take() else { continue };
            self.bytes -= shown.loaded.bytes();
            self.shown_points -= shown.points();
            let loaded = shown.loaded.first(*points);
            let radii = targets.get_mut(cloud).and_then(|target| target.of(*id, &loaded));
            let shown = ShownNode::new(loaded, shown.generation, larger(&radii, &shown.radii));
            self.bytes += shown.loaded.bytes();
            self.shown_points += shown.points();
            changes.push(shown.put(*cloud));
            entry.shown = Some(shown);
        }
        // Children come after their parents in the set, and go before them.
        for (cloud, id) in plan.drops.iter().rev() {
            let Some(held) = self.clouds.get_mut(cloud) else { continue };
            let Some(entry) = held.entries.get_mut(id) else { continue };
            let Some(shown) = entry.shown.take() else { continue };
            self.shown_points -= shown.points();
            self.shown_nodes -= 1;
            changes.extend(shown.leave(*cloud));
            let is_whole = shown.points() == u64::from(held.paged.octree.node(*id).points);
            if is_whole && shown.generation == held.generation && entry.loaded.is_none() {
                entry.loaded = Some(shown.loaded);
            } else {
                self.bytes -= shown.loaded.bytes();
            }
        }
    }

    fn show(&mut self, plan: &NodeChanges, targets: &mut BTreeMap<usize, Target>, changes: &mut Vec<Change>) {
        for (cloud, id, points) in &plan.arrivals {
            let Some(held) = self.clouds.get_mut(cloud) else { continue };
            let generation = held.generation;
            let Some(entry) = held.entries.get_mut(id) else { continue };
            let Some(loaded) = entry.loaded.take() else { continue };
            self.bytes -= loaded.bytes();
            let loaded = loaded.first(*points);
            let mut radii = targets.get_mut(cloud).and_then(|target| target.of(*id, &loaded));
            match entry.shown.take() {
                Some(old) => {
                    self.bytes -= old.loaded.bytes();
                    self.shown_points -= old.points();
                    // Its radii shrink after its children have come.
                    radii = larger(&radii, &old.radii);
                }
                None => self.shown_nodes += 1,
            }
            let shown = ShownNode::new(loaded, generation, radii);
            self.bytes += shown.loaded.bytes();
            self.shown_points += shown.points();
            changes.push(shown.put(*cloud));
            entry.shown = Some(shown);
        }
    }

    /// Of nodes that have less to cover than before: exactly when all has come.
    fn shrink_radii(&mut self, targets: BTreeMap<usize, Target>, changes: &mut Vec<Change>) {
        let is_all = self.waiting_nodes() == 0;
        for (cloud, target) in targets {
            let Some(held) = self.clouds.get_mut(&cloud) else { continue };
            // Most chunks would otherwise be put again with every few that come.
            let mut loose = std::mem::take(&mut held.loose);
            loose.extend(target.radii.keys());
            loose.retain(|id| {
                let Some(shown) = held.entries.get_mut(id).and_then(|entry| entry.shown.as_mut()) else { return false };
                let radii = match target.radii.get(id) {
                    Some(radii) => radii.clone(),
                    None if is_all => shown.loaded.radii(*id, &target.field),
                    None => return true,
                };
                if is_all || !is_near(&shown.radii, &radii) {
                    shown.rescale(cloud, radii, changes);
                    return false;
                }
                shown.radii != radii
            });
            (held.field, held.loose) = (target.field, loose);
        }
    }

    /// Nodes that are wanted and not there as they are wanted.
    fn waiting_nodes(&self) -> usize {
        let waits = |wanted: &&Wanted| {
            let held = self.clouds.get(&wanted.cloud);
            let entry = held.and_then(|held| Some((held, held.entry(wanted.node)?)));
            entry.is_some_and(|(held, entry)| !held.is_satisfied(wanted.node, entry))
        };
        self.wanted.iter().filter(waits).count()
    }

    fn stats(&mut self) -> StreamStats {
        self.forget_reads();
        let waiting_nodes = self.waiting_nodes();
        let seconds = RATE_TIME.as_secs_f64();
        StreamStats {
            shown_nodes: self.shown_nodes,
            shown_points: self.shown_points,
            bytes: self.bytes,
            waiting_nodes,
            disk_bytes_per_second: self.reads.iter().map(|(_, bytes, _)| *bytes).sum::<u64>() as f64 / seconds,
            points_per_second: self.reads.iter().map(|(.., points)| *points).sum::<u64>() as f64 / seconds,
            settled: waiting_nodes == 0
                && self.pending.is_empty()
                && self.clouds.values().all(|held| held.loose.is_empty())
                && self.shown_points <= self.budget.points
                && self.bytes <= self.budget.bytes,
        }
    }
}

#[cfg(test)]
#[path = "streamer_tests.rs"]
mod tests;
