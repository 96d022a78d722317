//! Lists of nodes that are read page by page: what a page of COPC or EPT may say.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::ops::Range;

use super::copc::{CopcNode, Key};

pub const ROOT: Key = (0, [0; 3]);
/// The memory of a node in bytes while a cloud is open, in all tables.
const NODE_BYTES: u64 = 512;

/// The most nodes that may be in memory: they take an eighth of `memory`, which is that of decoders and lists together.
pub fn most_nodes(memory: u64) -> usize {
    usize::try_from(memory / 8 / NODE_BYTES).unwrap_or(usize::MAX).max(1024)
}

/// A page of a list of nodes, which has a node and all below it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CopcPage {
    /// The level of its topmost node, and its cell.
    pub level: u32,
    pub cell: [u32; 3],
    /// Its bytes in a COPC file.
    pub(super) place: Range<u64>,
}

impl CopcPage {
    pub(super) fn of(level: u32, cell: [u32; 3], place: Range<u64>) -> Self {
        Self { level, cell, place }
    }

    /// A page that is a file of its own.
    pub(crate) fn of_file((level, cell): Key) -> Self {
        Self { level, cell, place: 0..0 }
    }
}

/// What a page lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PageNodes {
    /// The topmost node and those below it, level by level, sorted by cell within a level; the list has the parent of every
    /// other node, and of those of further pages.
    pub nodes: Vec<CopcNode>,
    pub further: Vec<CopcPage>,
}

impl PageNodes {
    /// What the page of the node `top` lists: nodes with points, and pages that have further ones.
    ///
    /// # Errors
    /// If they are not at or below `top`, one is there twice, one lies in a further page, or more than `most` would be in
    /// memory.
    pub(crate) fn of(
        top: Key,
        nodes: Vec<CopcNode>,
        further: Vec<CopcPage>,
        most: usize,
    ) -> std::result::Result<Self, String> {
        let name = |(level, [x, y, z]): Key| format!("node {level}-{x}-{y}-{z}");
        let mut links = HashSet::new();
        for CopcPage { level, cell, .. } in &further {
            let key = (*level, *cell);
            if key == top {
                return Err("it names itself for its own node".into());
            }
            if !is_below(key, top) {
                return Err(format!("{} is not below it", name(key)));
            }
            if !links.insert(key) {
                return Err(format!("{} is there twice", name(key)));
            }
        }
        let mut known = HashMap::from([(top, CopcNode::empty(top))]);
        let mut listed = HashSet::new();
        for node in nodes {
            let key = (node.level, node.cell);
            if !is_below(key, top) {
                return Err(format!("{} is not below it", name(key)));
            }
            if !listed.insert(key) {
                return Err(format!("{} is there twice", name(key)));
            }
            known.insert(key, node);
        }
        let above_links = links.iter().filter_map(|link| with_those_above(*link).nth(1));
        let keys: Vec<Key> = listed.into_iter().chain(above_links).collect();
        for key in keys {
            for key in with_those_above(key).take_while(|key| key.0 >= top.0) {
                if links.contains(&key) {
                    return Err(format!("{} is there and in another page", name(key)));
                }
                if let Entry::Vacant(place) = known.entry(key) {
                    place.insert(CopcNode::empty(key));
                }
            }
            if known.len() > most {
                return Err(format!("more than {most} nodes, the most that fit in the memory for lists of nodes"));
            }
        }
        let mut nodes: Vec<CopcNode> = known.into_values().collect();
        nodes.sort_unstable_by_key(|node| (node.level, node.cell));
        Ok(Self { nodes, further })
    }
}

/// Whether a node is `top` or below it.
pub fn is_below((level, cell): Key, (top_level, top): Key) -> bool {
    level >= top_level && cell.map(|cell| cell >> (level - top_level)) == top
}

/// A node, the one above it, and so on up to the root.
pub fn with_those_above(key: Key) -> impl Iterator<Item = Key> {
    std::iter::successors(Some(key), |(level, cell)| (*level > 0).then(|| (level - 1, cell.map(|cell| cell / 2))))
}
