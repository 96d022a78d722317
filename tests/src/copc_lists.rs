//! Writes the list of nodes of a COPC file anew: in pages of some levels each.

use std::collections::BTreeMap;

/// The level of a node and its cell.
pub type Key = (u32, [u32; 3]);

const ENTRY: usize = 32;
/// The offset of the place of the root page.
const ROOT: usize = 375 + 54 + 40;

/// A COPC file with another list of nodes.
pub struct Listed {
    pub bytes: Vec<u8>,
    /// The first byte of each page and its length, by its topmost node.
    pub pages: BTreeMap<Key, (usize, usize)>,
    /// The first byte of each entry: that of a node, or of a further page.
    pub entries: BTreeMap<(Key, bool), usize>,
}

/// The same file with pages of this many levels, in a record that is longer by this many entries.
///
/// # Panics
/// If the file is no COPC file, or the record of its pages is not the last one.
pub fn in_pages(file: &[u8], levels: u32, more_entries: usize) -> Listed {
    let nodes = nodes_of(file);
    let page_of = |(level, cell): Key| {
        let top = level / levels * levels;
        (top, cell.map(|cell| cell >> (level - top)))
    };
    let mut pages: BTreeMap<Key, Vec<[u8; ENTRY]>> = BTreeMap::from([((0, [0; 3]), Vec::new())]);
    for (key, entry) in &nodes {
        pages.entry(page_of(*key)).or_default().push(*entry);
        let mut top = page_of(*key);
        while top.0 > 0 {
            top = page_of((top.0 - 1, top.1.map(|cell| cell / 2)));
            pages.entry(top).or_default();
        }
    }
    let links: Vec<Key> = pages.keys().copied().filter(|top| top.0 > 0).collect();
    let above = |(level, cell): Key| page_of((level - 1, cell.map(|cell| cell / 2)));
    let mut places = BTreeMap::new();
    let mut end = file.len();
    for (top, entries) in &pages {
        let length = ENTRY * (entries.len() + links.iter().filter(|link| above(**link) == *top).count());
        places.insert(*top, (end, length));
        end += length;
    }
    let mut bytes = file.to_vec();
    let mut entries = BTreeMap::new();
    for (top, own) in &pages {
        for entry in own {
            entries.insert((key_of(entry), false), bytes.len());
            bytes.extend_from_slice(entry);
        }
        for link in links.iter().filter(|link| above(**link) == *top) {
            entries.insert((*link, true), bytes.len());
            let (offset, length) = places[link];
            bytes.extend(entry(*link, offset as u64, length as i32, -1));
        }
    }
    bytes.resize(bytes.len() + ENTRY * more_entries, 0);
    let (offset, length) = places[&(0, [0; 3])];
    bytes[ROOT..ROOT + 8].copy_from_slice(&(offset as u64).to_le_bytes());
    bytes[ROOT + 8..ROOT + 16].copy_from_slice(&(length as u64).to_le_bytes());
    let record = last_record(file);
    let length = (bytes.len() - record - 60) as u64;
    bytes[record + 20..record + 28].copy_from_slice(&length.to_le_bytes());
    Listed { bytes, pages: places, entries }
}

/// An entry of a page.
pub fn entry((level, cell): Key, offset: u64, length: i32, points: i32) -> [u8; ENTRY] {
    let mut entry = [0; ENTRY];
    for (place, value) in [level, cell[0], cell[1], cell[2]].into_iter().enumerate() {
        entry[4 * place..][..4].copy_from_slice(&value.to_le_bytes());
    }
    entry[16..24].copy_from_slice(&offset.to_le_bytes());
    entry[24..28].copy_from_slice(&length.to_le_bytes());
    entry[28..32].copy_from_slice(&points.to_le_bytes());
    entry
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes[at..at + N].try_into().expect("as many bytes")
}

fn key_of(entry: &[u8]) -> Key {
    let [level, x, y, z] = std::array::from_fn(|place| u32::from_le_bytes(number(entry, 4 * place)));
    (level, [x, y, z])
}

/// The entries of all nodes with points.
fn nodes_of(file: &[u8]) -> BTreeMap<Key, [u8; ENTRY]> {
    let place = |at: usize| u64::from_le_bytes(number(file, at)) as usize;
    let mut nodes = BTreeMap::new();
    let mut waiting = vec![(place(ROOT), place(ROOT + 8))];
    while let Some((offset, length)) = waiting.pop() {
        for entry in file[offset..offset + length].chunks_exact(ENTRY) {
            match i32::from_le_bytes(number(entry, 28)) {
                -1 => {
                    let length = i32::from_le_bytes(number(entry, 24)) as usize;
                    waiting.push((u64::from_le_bytes(number(entry, 16)) as usize, length));
                }
                0 => {}
                _ => drop(nodes.insert(key_of(entry), number(entry, 0))),
            }
        }
    }
    nodes
}

/// The offset of the last extended record, which is that of the pages.
fn last_record(file: &[u8]) -> usize {
    let mut at = u64::from_le_bytes(number(file, 235)) as usize;
    let count = u32::from_le_bytes(number(file, 243));
    for _ in 1..count {
        at += 60 + u64::from_le_bytes(number(file, at + 20)) as usize;
    }
    assert_eq!(&file[at + 2..at + 6], b"copc", "the record of pages is the last one");
    at
}
