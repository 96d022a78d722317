//! The state of the streamer: the wanted nodes, the queue of reads for them, and the used part of the budgets.

use std::cmp::Reverse;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::nodes::{CloudNodes, Entry, Job, Loaded, NodeChange, PagedCloud, ShownNode};
use crate::{Again, BATCHES, Budget, Error, NodeId, Octree, Result, Wanted, prefix};

/// The time over which rates are measured.
const RATE_TIME: Duration = Duration::from_secs(1);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StreamerStats {
    /// The numbers of shown nodes and points.
    pub shown_nodes: usize,
    pub shown_points: u64,
    /// The bytes of decoded chunks: shown, kept and being read.
    pub bytes: u64,
    /// The number of nodes that are wanted and not shown yet.
    pub waiting_nodes: usize,
    /// The bytes and points per second, over the last second.
    pub disk_bytes_per_second: f64,
    pub points_per_second: f64,
    /// Whether every wanted node is shown, or cannot be read.
    pub settled: bool,
}

pub(super) struct State {
    pub(super) budget: Budget,
    pub(super) workers: usize,
    pub(super) clouds: BTreeMap<usize, CloudNodes>,
    /// The last cut, whole and as far as the budget goes.
    pub(super) asked: Vec<Wanted>,
    pub(super) wanted: Vec<Wanted>,
    /// Whether no other nodes stay shown.
    pub(super) only_wanted: bool,
    pub(super) cuts: u64,
    pub(super) generations: u64,
    /// The nodes to be read, the next first.
    pub(super) queue: VecDeque<(usize, NodeId)>,
    pub(super) bytes: u64,
    pub(super) shown_points: u64,
    pub(super) shown_nodes: usize,
    /// The changes to be handed over before any others.
    pub(super) pending: Vec<NodeChange>,
    /// The reads of the last second: time, bytes, points.
    pub(super) reads: VecDeque<(Instant, u64, u64)>,
    pub(super) asks_for_room: bool,
    pub(super) stopped: bool,
}

impl State {
    pub(super) fn new(budget: Budget, workers: usize) -> Self {
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

    pub(super) fn replace(&mut self, cloud: usize, paged: PagedCloud) {
        let same = self.clouds.get(&cloud).is_some_and(|held| held.paged.octree == paged.octree);
        if !same {
            let drops = self.remove(cloud);
            self.pending.extend(drops);
        }
        // A failure of the pages before does not apply to these.
        let is_of_before = |change: &NodeChange| match change {
            NodeChange::Failed { cloud: other, .. } | NodeChange::Mended { cloud: other, .. } => *other == cloud,
            NodeChange::Put { .. } | NodeChange::Drop { .. } => false,
        };
        self.pending.retain(|change| !is_of_before(change));
        self.generations += 1;
        let generation = self.generations;
        let before = self.clouds.remove(&cloud).map(|held| (held.entries, held.field, held.loose));
        let (mut entries, field, loose) = before.unwrap_or_default();
        for entry in entries.values_mut() {
            // Nodes that are being read for the old generation will be thrown away.
            (entry.in_flight, entry.failed, entry.is_too_large, entry.again) = (false, false, false, None);
            self.bytes -= entry.loaded.take().map_or(0, |loaded| loaded.bytes());
        }
        self.clouds.insert(cloud, CloudNodes { paged, generation, field, loose, entries });
        self.accept();
    }

    /// Replaces the octree by one with more nodes, or without some: these are dropped.
    pub(super) fn know(&mut self, cloud: usize, octree: Arc<Octree>) {
        let Some(held) = self.clouds.get_mut(&cloud) else { return };
        held.paged.octree = octree;
        let octree = &held.paged.octree;
        let gone: Vec<NodeId> = held.entries.keys().copied().filter(|id| octree.get(*id).is_none()).collect();
        // Children come after their parents.
        for id in gone.into_iter().rev() {
            let Some(entry) = held.entries.remove(&id) else { continue };
            held.loose.remove(&id);
            self.bytes -= entry.loaded.map_or(0, |loaded| loaded.bytes());
            if let Some(shown) = entry.shown {
                self.bytes -= shown.loaded.bytes();
                self.shown_points -= shown.points();
                self.shown_nodes -= 1;
                self.pending.extend(shown.leave(cloud));
            }
        }
        self.accept();
    }

    /// Removes a cloud; returns the drops of its shown nodes, children first.
    pub(super) fn remove(&mut self, cloud: usize) -> Vec<NodeChange> {
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
            NodeChange::Put { cloud: other, .. }
            | NodeChange::Drop { cloud: other, .. }
            | NodeChange::Failed { cloud: other, .. }
            | NodeChange::Mended { cloud: other, .. } => *other != cloud,
        });
        self.accept();
        drops
    }

    pub(super) fn want(&mut self, asked: Vec<Wanted>) {
        self.asked = asked;
        self.cuts += 1;
        self.accept();
    }

    pub(super) fn set_budget(&mut self, budget: Budget) {
        if budget.bytes > self.budget.bytes {
            // A node that was too large may fit now.
            let entries = self.clouds.values_mut().flat_map(|held| held.entries.values_mut());
            entries.for_each(|entry| entry.failed = false);
        }
        self.budget = budget;
        self.accept();
    }

    /// Has wanted nodes read again that could not be read. Returns whether there are any.
    pub(super) fn try_again(&mut self, now: Instant, is_other_view: bool) -> bool {
        let entries = self.clouds.values_mut().flat_map(|held| held.entries.values_mut());
        let mut is_any = false;
        for entry in entries.filter(|entry| entry.failed && entry.wanted > 0) {
            let is_due = entry.again.as_mut().is_some_and(|again| again.ask(now, is_other_view));
            entry.failed = !is_due;
            is_any |= is_due;
        }
        if is_any {
            self.accept();
        }
        is_any
    }

    /// Accepts the last cut as far as the budget goes.
    fn accept(&mut self) {
        for held in self.clouds.values_mut() {
            held.entries.values_mut().for_each(|entry| entry.wanted = 0);
        }
        let mut points = self.budget.points;
        // There must be room for one node more than wanted: it may have to be read to replace its own shown form.
        let most = self.budget.bytes / 2;
        let cost_of = |wanted: &Wanted| {
            let paged = &self.clouds.get(&wanted.cloud)?.paged;
            paged.octree.get(wanted.node).map(|_| paged.cost(wanted.node))
        };
        let reserve = self.asked.iter().filter_map(cost_of).filter(|cost| *cost <= most).max().unwrap_or(0);
        let mut bytes = self.budget.bytes.saturating_sub(reserve);
        self.wanted.clear();
        for Wanted { cloud, node: id, batches } in &self.asked {
            let Some(held) = self.clouds.get_mut(cloud) else { continue };
            let Some(node) = held.paged.octree.get(*id) else { continue };
            let is_wanted = |id: NodeId| held.entry(id).is_some_and(|entry| entry.wanted > 0);
            // A node that is too large is not wanted itself, so that its shown form can go.
            let may_have_children = |id: NodeId| held.entry(id).is_some_and(|entry| entry.wanted > 0 || entry.failed);
            if !node.parent.is_none_or(may_have_children) || is_wanted(*id) || *batches == 0 {
                continue;
            }
            let cost = held.paged.cost(*id);
            if cost > most {
                let entry = held.entries.entry(*id).or_default();
                (entry.wanted_at, entry.failed) = (self.cuts, true);
                if !std::mem::replace(&mut entry.is_too_large, true) {
                    let error = Error::TooLarge { bytes: cost, budget: self.budget.bytes };
                    self.pending.push(NodeChange::Failed { cloud: *cloud, node: *id, error });
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
                // One whose points could not be read is told of once they are there.
                if std::mem::take(&mut entry.is_too_large) && entry.again.is_none() {
                    self.pending.push(NodeChange::Mended { cloud: *cloud, node: *id });
                }
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
    pub(super) fn next_job(&mut self) -> Option<Job> {
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

    /// Forgets kept chunks, the least recently wanted first, until there is room for `bytes` more.
    pub(super) fn evict(&mut self, bytes: u64) {
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

    /// The decoded chunks that are kept but not wanted, least recently wanted first and children before their parents.
    fn kept(&self) -> Vec<(u64, Reverse<NodeId>, usize)> {
        self.unwanted(|entry| entry.loaded.is_some())
    }

    pub(super) fn unwanted(&self, matches: impl Fn(&Entry) -> bool) -> Vec<(u64, Reverse<NodeId>, usize)> {
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

    pub(super) fn finish(&mut self, job: Job, loaded: Result<Loaded>) {
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
                if entry.again.take().is_some() {
                    self.pending.push(NodeChange::Mended { cloud: job.cloud, node: job.node });
                }
                let points = loaded.chunk.len() as u64;
                let excess = loaded.bytes().saturating_sub(held.paged.cost(job.node));
                entry.loaded = Some(loaded);
                if excess > 0 {
                    // The pages take more than the cut assumed: it is accepted again as far as there is room.
                    held.paged.point_bytes += excess.div_ceil(points);
                    self.accept();
                }
            }
            Err(error) => {
                entry.failed = true;
                let before = entry.again.replace(Again::after(entry.again, error.may_pass(), Instant::now()));
                if before.is_none() {
                    self.pending.push(NodeChange::Failed { cloud: job.cloud, node: job.node, error });
                }
            }
        }
    }

    fn forget_reads(&mut self) {
        while self.reads.front().is_some_and(|(when, ..)| when.elapsed() > RATE_TIME) {
            self.reads.pop_front();
        }
    }

    pub(super) fn shown(&self, cloud: usize, node: NodeId) -> Option<&ShownNode> {
        self.clouds.get(&cloud)?.entry(node)?.shown.as_ref()
    }

    pub(super) fn shown_mut(&mut self, cloud: usize, node: NodeId) -> Option<&mut ShownNode> {
        self.clouds.get_mut(&cloud)?.entries.get_mut(&node)?.shown.as_mut()
    }

    /// The bytes of decoded nodes that are kept but not wanted.
    pub(super) fn kept_bytes(&self) -> u64 {
        let entries = self.clouds.values().flat_map(|held| held.entries.values());
        entries.filter(|entry| entry.wanted == 0).filter_map(|entry| entry.loaded.as_ref()).map(Loaded::bytes).sum()
    }

    /// The number of wanted nodes that are not yet shown as wanted.
    pub(super) fn waiting_nodes(&self) -> usize {
        let waits = |wanted: &&Wanted| {
            let held = self.clouds.get(&wanted.cloud);
            let entry = held.and_then(|held| Some((held, held.entry(wanted.node)?)));
            entry.is_some_and(|(held, entry)| !held.is_satisfied(wanted.node, entry))
        };
        self.wanted.iter().filter(waits).count()
    }

    pub(super) fn stats(&mut self) -> StreamerStats {
        self.forget_reads();
        let waiting_nodes = self.waiting_nodes();
        let seconds = RATE_TIME.as_secs_f64();
        StreamerStats {
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
