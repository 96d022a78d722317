//! The nodes of a COPC file or of EPT whose list is read page by page: which pages are there, and which go when others come.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use codec::{CopcPage, PageNodes};

use crate::copc::Frame;
use crate::{NodeId, Octree, Pages};

/// The pages of a list of nodes that are there, within a number of nodes.
pub struct NodeTable {
    pages: Arc<Pages>,
    frame: Frame,
    octree: Arc<Octree>,
    /// The pages that are there, by the number of their first node.
    there: BTreeMap<u32, There>,
    /// The pages that are not there, by the parent and octant of their topmost node.
    links: HashMap<(NodeId, u8), CopcPage>,
    /// The number of nodes in memory, with those that stand for pages that are not there, and the most of them.
    count: usize,
    most: usize,
    /// The number of the next node. No number is used twice.
    next: u32,
    /// The number of the latest cut.
    turn: u64,
}

/// A page that is there.
struct There {
    page: CopcPage,
    /// The parent and octant of its topmost node.
    above: (NodeId, u8),
    nodes: usize,
    /// The number of its nodes and of further pages.
    size: usize,
    /// The number of the last cut that needed one of its nodes.
    used: u64,
}

impl NodeTable {
    /// The table of a file that was just opened; `None` if all its nodes are known.
    pub fn new(pages: &Arc<Pages>) -> Option<Self> {
        let source = &pages.of_copc()?.source;
        let copc = source.copc().filter(|copc| !copc.further.is_empty())?;
        let frame = Frame::new(copc, source.info().grid?, source.info().bounds);
        let first = PageNodes { nodes: copc.nodes.clone(), further: copc.further.clone() };
        let links = frame.links(&first, 0).into_iter().map(|(place, _, page)| (place, page.clone())).collect();
        let octree = Arc::new(pages.octree().clone());
        let (pages, most, next) = (pages.clone(), copc.most_nodes, copc.nodes.len() as u32);
        let count = copc.nodes.len() + copc.further.len();
        Some(Self { pages, frame, octree, there: BTreeMap::new(), links, count, most, next, turn: 0 })
    }

    /// The same lists for the same file, which was opened again for further attributes.
    pub fn again(mut self, pages: &Arc<Pages>) -> Option<Self> {
        let (own, other) = (pages.of_copc()?, self.pages.of_copc()?);
        if !Arc::ptr_eq(&own.source, &other.source) {
            return Self::new(pages);
        }
        own.take_pages(other);
        self.pages = pages.clone();
        Some(self)
    }

    /// The nodes that are known.
    pub fn octree(&self) -> &Arc<Octree> {
        &self.octree
    }

    /// The page that is not there at a place.
    pub fn page(&self, place: (NodeId, u8)) -> Option<&CopcPage> {
        self.links.get(&place)
    }

    /// Says that a cut needs these nodes.
    pub fn use_nodes(&mut self, nodes: impl IntoIterator<Item = NodeId>) {
        self.turn += 1;
        for NodeId(node) in nodes {
            if let Some((_, there)) = self.there.range_mut(..=node).next_back() {
                there.used = self.turn;
            }
        }
    }

    /// Adds what a page says. Others go if there is no room, those first that no cut has needed for the longest time; those
    /// that the latest cut needs stay. Returns false if there is no room even so: nothing has changed then.
    pub fn put(&mut self, place: (NodeId, u8), found: PageNodes) -> bool {
        let Some(page) = self.links.get(&place).cloned() else { return true };
        let Some(first) = self.next.checked_add(found.nodes.len() as u32).map(|_| self.next) else { return false };
        // The page above has the parent of this one, and must stay.
        let kept = self.there.range(..=place.0.0).next_back().map(|(first, _)| *first);
        let size = found.nodes.len() + found.further.len();
        let free = |table: &Self| table.count + size <= table.most;
        while !free(self) {
            if !self.drop_oldest(kept) {
                return false;
            }
        }
        let nodes = self.frame.nodes(&found.nodes, first, Some(place.0));
        let octree = Arc::make_mut(&mut self.octree);
        if let Some(parent) = octree.get_mut(place.0) {
            parent.children[usize::from(place.1)] = Some(NodeId(first));
        }
        octree.paged.unread.remove(&place);
        self.links.remove(&place);
        for (place, bounds, page) in self.frame.links(&found, first) {
            octree.paged.unread.insert(place, bounds);
            self.links.insert(place, page.clone());
        }
        octree.paged.pages.insert(first, Arc::new(nodes));
        let there = There { page, above: place, nodes: found.nodes.len(), size, used: self.turn };
        self.there.insert(first, there);
        (self.count, self.next) = (self.count + size, first + found.nodes.len() as u32);
        if let Some(copc) = self.pages.of_copc() {
            copc.set_page(first, Some(found.nodes));
        }
        true
    }

    /// Removes the page that was needed the longest time ago, of those that the latest cut does not need and no other page
    /// depends on.
    fn drop_oldest(&mut self, kept: Option<u32>) -> bool {
        let above: BTreeSet<u32> = self
            .there
            .values()
            .filter_map(|there| self.there.range(..=there.above.0.0).next_back())
            .map(|(first, _)| *first)
            .collect();
        let may_go =
            |(first, there): &(&u32, &There)| there.used < self.turn && !above.contains(first) && Some(**first) != kept;
        let oldest = self.there.iter().filter(may_go).min_by_key(|(first, there)| (there.used, **first));
        let Some(first) = oldest.map(|(first, _)| *first) else { return false };
        let Some(There { page, above, nodes, size, .. }) = self.there.remove(&first) else { return false };
        let octree = Arc::make_mut(&mut self.octree);
        octree.paged.pages.remove(&first);
        let end = NodeId(first + nodes as u32);
        octree.paged.unread.retain(|(parent, _), _| !(NodeId(first)..end).contains(parent));
        self.links.retain(|(parent, _), _| !(NodeId(first)..end).contains(parent));
        if let Some(parent) = octree.get_mut(above.0) {
            parent.children[usize::from(above.1)] = None;
        }
        octree.paged.unread.insert(above, self.frame.bounds(page.level, page.cell));
        self.links.insert(above, page);
        self.count -= size;
        if let Some(copc) = self.pages.of_copc() {
            copc.set_page(first, None);
        }
        true
    }

    /// The number of nodes in memory, with those that stand for pages that are not there.
    pub fn size(&self) -> usize {
        self.count
    }
}
