//! Plans the way from the shown nodes to the wanted ones: which nodes go, shrink and come, and with which radii, in an
//! order in which nothing blinks.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use super::nodes::{Entry, Loaded, NodeChange, ShownNode};
use super::state::State;
use crate::radius_scale::{Drawn, Field, Radii, count_first_octants, is_near, larger};
use crate::{NodeId, Wanted};

/// The nodes that are dropped, shrunk and added to reach the wanted cut.
#[derive(Default)]
struct CutChanges {
    drops: BTreeSet<(usize, NodeId)>,
    /// For each shrinking node, the number of points that remain.
    shrinks: BTreeMap<(usize, NodeId), usize>,
    /// The nodes to add with their number of points, parents before children.
    arrivals: Vec<(usize, NodeId, usize)>,
}

/// The radii of a cloud when the plan is done.
struct Target {
    field: Field,
    /// The nodes whose radii may change.
    nodes: BTreeSet<NodeId>,
    /// The radii computed so far.
    radii: BTreeMap<NodeId, Radii>,
}

impl Target {
    /// The radii of a node that will be shown.
    fn of(&mut self, id: NodeId, loaded: &Loaded) -> Radii {
        let radii = loaded.radii(id, &self.field);
        self.radii.insert(id, radii.clone());
        radii
    }
}

/// A node from which room can be taken; lists of victims have the next one last.
enum Victim {
    Drop(usize, NodeId),
    Shrink(usize, NodeId, usize),
}

impl State {
    pub(super) fn changes(&mut self) -> Vec<NodeChange> {
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
        changes.retain(|change| !matches!(change, NodeChange::Put { chunk, .. } if chunk.is_empty()));
        changes
    }

    /// Where room can be made without losing wanted points: nodes that are not wanted, then batches that are not. The
    /// next one is last.
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

    fn plan(&self) -> CutChanges {
        let mut plan = CutChanges::default();
        let mut victims = self.victims();
        let mut points = self.shown_points;
        let mut bytes = self.bytes - self.kept_bytes();
        let upcoming = self.queue.iter().take(self.workers);
        let upcoming: u64 = upcoming.filter_map(|(cloud, node)| Some(self.clouds.get(cloud)?.paged.cost(*node))).sum();
        let mut make_room = |plan: &mut CutChanges, points: &mut u64, bytes: &mut u64| {
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

    /// The radii to reach, for the clouds that the plan changes or whose radii are larger than necessary.
    fn targets(&self, plan: &CutChanges) -> BTreeMap<usize, Target> {
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

    /// The nodes of a cloud that are drawn when the plan is done.
    fn drawn_after(&self, cloud: usize, plan: &CutChanges) -> BTreeMap<NodeId, Drawn> {
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

    /// Grows the radii of nodes that stay and must cover more than before.
    fn grow_radii(&mut self, plan: &CutChanges, targets: &mut BTreeMap<usize, Target>, changes: &mut Vec<NodeChange>) {
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
        plan: &CutChanges,
        targets: &mut BTreeMap<usize, Target>,
        changes: &mut Vec<NodeChange>,
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
        // Children come after their parents in the set, and are dropped before them.
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

    fn show(&mut self, plan: &CutChanges, targets: &mut BTreeMap<usize, Target>, changes: &mut Vec<NodeChange>) {
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
                    // A node's radii shrink after its children have come.
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

    /// Shrinks the radii of nodes that have less to cover than before; exactly when all nodes have come.
    fn shrink_radii(&mut self, targets: BTreeMap<usize, Target>, changes: &mut Vec<NodeChange>) {
        let is_all = self.waiting_nodes() == 0;
        for (cloud, target) in targets {
            let Some(held) = self.clouds.get_mut(&cloud) else { continue };
            // Otherwise most chunks would be put again with every few that come.
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
}
