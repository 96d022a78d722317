//! Reads the hierarchy of EPT page by page: which nodes have points, and how many.
//!
//! A page is a JSON file that is named after a node and lists nodes at and below that one: the number of points of each, or
//! -1 where another page has that node. A page that lists anything else is left out, so a chain of pages goes down the
//! tree with each of them and ends. Names of files are made from the numbers of a node, never from a text of the page.

use std::collections::HashMap;
use std::path::Path;

use crate::address::beside;
use crate::at_once::at_once;
use crate::brief::{self, brief};
use crate::bytes::Bytes;
use crate::las::{Copc, DEEPEST, Key, is_below};
use crate::{Error, Result};

/// The longest page: Entwine's have up to some megabytes.
const MOST_PAGE: u64 = 8 << 20;
/// The most pages that are read of one hierarchy: finer nodes than those of these pages are left out.
const MOST_PAGES: usize = 4096;
/// The number of pages that are read at once.
const PAGES_AT_ONCE: usize = 8;

/// The nodes that have points, with their numbers.
#[derive(Debug, Default)]
pub struct Hierarchy {
    pub nodes: HashMap<Key, u32>,
    /// The nodes that the first page lists, with those of further pages.
    pub first: Vec<Key>,
    pub warnings: Vec<String>,
}

/// The name of a node in pages, and of its files: `level-x-y-z`.
pub fn name((level, [x, y, z]): Key) -> String {
    format!("{level}-{x}-{y}-{z}")
}

/// The node of this name, if there is one in an octree.
fn key(name: &str) -> Option<Key> {
    let mut numbers = name.split('-').map(|number| {
        let is_plain = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
        number.parse::<u32>().ok().filter(|_| is_plain)
    });
    let (level, cell) = (numbers.next()??, [numbers.next()??, numbers.next()??, numbers.next()??]);
    let is_inside = level <= DEEPEST && cell.iter().all(|cell| *cell < 1 << level);
    (numbers.next().is_none() && is_inside).then_some((level, cell))
}

/// Reads the pages below the first one, whose entries are `first`, the coarse ones before the others, until nodes would take
/// more than `most` places. `path` is that of `ept.json`, or the address that a server has sent on to. What is wrong with a
/// page is a warning, and its nodes are left out.
pub fn read(path: &Path, first: Entries, most: usize) -> Hierarchy {
    let mut found = Hierarchy::default();
    let mut first = Some(Ok(first));
    let (mut lost, mut left_out) = (Vec::new(), 0);
    let mut waiting = vec![(0, [0; 3])];
    let mut pages = 0;
    while !waiting.is_empty() {
        let now: Vec<Key> = std::mem::take(&mut waiting);
        let read = match first.take() {
            Some(first) => vec![first],
            None => at_once(&now, PAGES_AT_ONCE, |key| page(path, *key)),
        };
        for (top, page) in now.into_iter().zip(read) {
            pages += 1;
            let page = match page {
                Ok(page) => page,
                Err(error) => {
                    lost.push(format!("the hierarchy below node {} is missing: {}", name(top), reason(&error, path)));
                    continue;
                }
            };
            for (key, points) in page {
                // Another page has the points of the node that it is named after.
                let above = (key.0.saturating_sub(1), key.1.map(|cell| cell / 2));
                let own = match points {
                    Some(0) => continue,
                    Some(points) if found.nodes.len() < most => {
                        found.nodes.insert(key, points);
                        key
                    }
                    None if pages + waiting.len() < MOST_PAGES && found.nodes.len() < most => {
                        waiting.push(key);
                        above
                    }
                    _ => {
                        left_out += 1;
                        continue;
                    }
                };
                found.first.extend((pages == 1).then_some(own));
            }
        }
    }
    found.warnings = param::few(lost, "pages that are missing");
    if left_out > 0 {
        found.warnings.push(format!(
            "the hierarchy is larger than the memory for it: nodes below {} of {pages} pages and {} nodes are left out \
             (stream.host_bytes decides)",
            left_out,
            found.nodes.len()
        ));
    }
    found
}

/// An error without the name of the whole cloud.
fn reason(error: &Error, path: &Path) -> String {
    let folder = path.parent().map(param::shown).unwrap_or_default();
    let text = error.to_string();
    text.strip_prefix(&folder).map_or(text.clone(), |rest| rest.trim_start_matches(['/', '\\']).to_owned())
}

/// What a page says: for each node its number of points, or `None` where another page has it.
pub type Entries = Vec<(Key, Option<u32>)>;

/// Reads the page of the node `top`.
pub fn page(path: &Path, top: Key) -> Result<Entries> {
    let path = beside(path, &format!("ept-hierarchy/{}.json", name(top)));
    Bytes::open_twice(&path, Bytes::open_small, |file| entries(&file, top))
}

fn entries(file: &Bytes, top: Key) -> Result<Entries> {
    let text = file.all(MOST_PAGE)?;
    let fail = |problem: String| Error::malformed(file.path(), format!("page {}", name(top)), problem);
    let entries: HashMap<String, i64> =
        serde_json::from_slice(&text).map_err(|error| fail(format!("not a page: {}", brief::message(&error))))?;
    let mut page = Vec::with_capacity(entries.len());
    for (text, points) in entries {
        let own = key(&text).ok_or_else(|| fail(format!("`{}` is no node", brief(&text))))?;
        if !is_below(own, top) {
            return Err(fail(format!("node {text} is not below it")));
        }
        let points = match points {
            -1 if own == top => return Err(fail("it names itself for its own node".into())),
            -1 => None,
            _ => Some(u32::try_from(points).ok().filter(|points| *points <= Copc::MOST_POINTS).ok_or_else(|| {
                let most = Copc::MOST_POINTS;
                fail(format!("node {text} has {points} points, expected 0 to {most}, or -1 for another page"))
            })?),
        };
        page.push((own, points));
    }
    page.sort_unstable();
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nodes_of_an_octree_have_names() {
        assert_eq!(key("0-0-0-0"), Some((0, [0, 0, 0])));
        assert_eq!(key("3-7-0-4"), Some((3, [7, 0, 4])));
        for text in [
            "",
            "0",
            "0-0-0",
            "0-0-0-0-0",
            "1-2-0-0",
            "31-0-0-0",
            "../../etc/passwd",
            "1--1-0-0",
            "1-+1-0-0",
            "a-b-c-d",
        ] {
            assert_eq!(key(text), None, "{text}");
        }
        assert!(is_below((3, [7, 0, 4]), (1, [1, 0, 1])) && !is_below((3, [7, 0, 4]), (1, [0, 0, 1])));
    }
}
