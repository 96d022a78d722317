//! Reads lists of nodes page by page, as views need their nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::AssertUnwindSafe;
use std::sync::Arc;
use std::time::Instant;

use codec::PageNodes;
use stream::{Again, NodeId, NodeTable, Octree, Pages};

use crate::error::may_come;
use crate::mailbox::Mailbox;

/// The number of pages of one cloud that are read at once.
const AT_ONCE: usize = 8;

/// The parent and the octant of the topmost node of a page.
type Place = (NodeId, u8);

/// The list of nodes of a cloud, as far as views need it.
pub(crate) struct Lists {
    pages: Arc<Pages>,
    table: NodeTable,
    /// The pages that are being read.
    asked: BTreeSet<Place>,
    /// The pages that the latest cut needs and that are still to be read.
    waiting: Vec<Place>,
    /// The pages for which there was no room beside what the view needs.
    refused: BTreeSet<Place>,
    /// The pages that could not be read, and whether they may come later.
    failed: BTreeMap<Place, (Again, bool)>,
    is_changed: bool,
    /// What the receiver was told of pages that are missing.
    told: Option<String>,
    /// Whether the receiver knows that there is no room for a page.
    is_limit_told: bool,
}

/// What is to be said once a page was read, or could not be.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Said {
    Problem(String),
    /// What was said before is no longer true.
    Mended(String),
}

impl Lists {
    /// `None` for a cloud whose nodes are all known.
    pub(crate) fn new(pages: &Arc<Pages>) -> Option<Self> {
        Some(Self {
            pages: pages.clone(),
            table: NodeTable::new(pages)?,
            asked: BTreeSet::new(),
            waiting: Vec::new(),
            refused: BTreeSet::new(),
            failed: BTreeMap::new(),
            is_changed: false,
            told: None,
            is_limit_told: false,
        })
    }

    /// These lists for a cloud that is read anew, with further attributes.
    pub(crate) fn again(self, pages: &Arc<Pages>) -> Option<Self> {
        Some(Self { table: self.table.again(pages)?, pages: pages.clone(), ..self })
    }

    /// Takes what the receiver was told of pages that are missing.
    pub(crate) fn take_told(&mut self) -> Option<String> {
        self.told.take()
    }

    pub(crate) fn octree(&self) -> &Arc<Octree> {
        self.table.octree()
    }

    /// The octree, if it has changed since the last call.
    pub(crate) fn changed_octree(&mut self) -> Option<Arc<Octree>> {
        std::mem::take(&mut self.is_changed).then(|| self.table.octree().clone())
    }

    /// The number of pages that the latest cut still needs.
    pub(crate) fn waiting(&self) -> usize {
        self.asked.len().max(self.waiting.len())
    }

    /// For each page that could not be read, whether it may come later.
    pub(crate) fn missing(&self) -> impl Iterator<Item = bool> {
        self.failed.values().map(|(_, may_come)| *may_come)
    }

    /// Forgets that there was no room.
    pub(crate) fn try_again(&mut self) {
        self.refused.clear();
    }

    /// Whether pages that could not be read are to be read again now.
    pub(crate) fn ask_again(&mut self, now: Instant, is_other_view: bool) -> bool {
        let due = self.failed.values_mut().filter_map(|(again, _)| again.ask(now, is_other_view).then_some(()));
        due.count() > 0
    }

    /// Says what the latest cut needs: nodes, and pages, the most important first, of which some are now read on threads of
    /// their own.
    pub(crate) fn want(
        &mut self,
        nodes: impl Iterator<Item = NodeId>,
        places: impl Iterator<Item = Place>,
        cloud: usize,
        mailbox: &Arc<Mailbox>,
    ) {
        self.table.use_nodes(nodes);
        let is_given_up = |place: &Place| self.failed.get(place).is_some_and(|(again, _)| again.waits());
        self.waiting = places.filter(|place| !self.refused.contains(place) && !is_given_up(place)).collect();
        for place in self.waiting.clone() {
            if self.asked.len() >= AT_ONCE {
                return;
            }
            let Some(page) = self.table.page(place).cloned().filter(|_| self.asked.insert(place)) else { continue };
            let (pages, answer) = (self.pages.clone(), mailbox.clone());
            let read = move || {
                let read = std::panic::catch_unwind(AssertUnwindSafe(|| pages.read_list(&page)));
                let panicked = |_| Err(stream::Error::Panicked("a list of nodes".into()));
                answer.pass_list(cloud, place, read.unwrap_or_else(panicked));
            };
            if let Err(error) = std::thread::Builder::new().name("list of nodes".into()).spawn(read) {
                let path = self.pages.folder().to_owned();
                mailbox.pass_list(cloud, place, Err(stream::Error::Io { path, reason: error }));
            }
        }
    }

    /// Takes in a page that was read. Returns what is to be said of it, once for each kind of problem.
    pub(crate) fn put(&mut self, place: Place, found: stream::Result<PageNodes>) -> Option<Said> {
        if !self.asked.remove(&place) {
            return None;
        }
        self.waiting.retain(|waiting| *waiting != place);
        let found = match found {
            Ok(found) => found,
            Err(error) => {
                let before = self.failed.get(&place).map(|(again, _)| *again);
                let again = Again::after(before, error.may_pass(), Instant::now());
                self.failed.insert(place, (again, may_come(&error)));
                let problem = format!("{error}; the points below that node are missing");
                let is_new = self.told.is_none();
                return is_new.then(|| Said::Problem(self.told.insert(problem).clone()));
            }
        };
        self.failed.remove(&place);
        if self.table.put(place, found) {
            self.is_changed = true;
            // Of pages whose parents have gone nothing is missing.
            self.failed.retain(|place, _| self.table.page(*place).is_some());
            return self.told.take_if(|_| self.failed.is_empty()).map(Said::Mended);
        }
        self.refused.insert(place);
        let (path, size) = (scene::shown(self.pages.folder()), self.table.size());
        let problem = format!("{path}: the list of nodes that the view needs is larger than the memory for it");
        let problem =
            format!("{problem} ({size} nodes are there): finer points are left out (stream.host_bytes decides)");
        (!std::mem::replace(&mut self.is_limit_told, true)).then_some(Said::Problem(problem))
    }
}
