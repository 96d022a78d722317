//! Reads lists of nodes page by page, as views need their nodes.

use std::collections::BTreeSet;
use std::panic::AssertUnwindSafe;
use std::sync::Arc;

use codec::PageNodes;
use stream::{NodeId, NodeTable, Octree, Pages};

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
    is_changed: bool,
    /// Whether the receiver knows that a page is missing, or that there is no room for one.
    is_told: [bool; 2],
}

impl Lists {
    /// `None` for a cloud whose nodes are all known.
    pub(crate) fn new(pages: &Arc<Pages>) -> Option<Self> {
        let (asked, refused, pages) = (BTreeSet::new(), BTreeSet::new(), pages.clone());
        let table = NodeTable::new(&pages)?;
        Some(Self { pages, table, asked, waiting: Vec::new(), refused, is_changed: false, is_told: [false; 2] })
    }

    /// These lists for a cloud that is read anew, with further attributes.
    pub(crate) fn again(self, pages: &Arc<Pages>) -> Option<Self> {
        Some(Self { table: self.table.again(pages)?, pages: pages.clone(), ..self })
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

    /// Forgets that there was no room.
    pub(crate) fn try_again(&mut self) {
        self.refused.clear();
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
        self.waiting = places.filter(|place| !self.refused.contains(place)).collect();
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
    pub(crate) fn put(&mut self, place: Place, found: stream::Result<PageNodes>) -> Option<String> {
        if !self.asked.remove(&place) {
            return None;
        }
        self.waiting.retain(|waiting| *waiting != place);
        let (kind, problem) = match found {
            Ok(found) => {
                if self.table.put(place, found) {
                    self.is_changed = true;
                    return None;
                }
                self.refused.insert(place);
                let path = scene::shown(self.pages.folder());
                let size = self.table.size();
                let problem = format!("{path}: the list of nodes that the view needs is larger than the memory for it");
                (
                    0,
                    format!(
                        "{problem} ({size} nodes are there): finer points are left out (stream.host_bytes decides)"
                    ),
                )
            }
            Err(error) => {
                self.is_changed = true;
                self.table.leave_out(place);
                (1, format!("{error}; the points below that node are missing"))
            }
        };
        (!std::mem::replace(&mut self.is_told[kind], true)).then_some(problem)
    }
}
