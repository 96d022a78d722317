//! Changes fields of an index: `nodes`, `pages` and `surfels` (crates/stream: pages.rs, page.rs, surfels.rs), and their
//! checksums.

use super::{noise, number, put, put_double, put_integer};
use crate::dice::Dice;
use crate::parsers::{join, split};

/// Bytes before the body of `nodes` and of the head of `surfels`: magic, version, checksum.
const HEAD: usize = 16;
/// Offsets in `nodes`: key, flags, doubles, points left out, number of attributes.
const KEY: usize = HEAD;
const FLAGS: usize = KEY + 16;
const FIRST_DOUBLE: usize = FLAGS + 4;
const DOUBLES: usize = 10;
const SKIPPED: usize = FIRST_DOUBLE + 8 * DOUBLES;
const ATTRIBUTES: usize = SKIPPED + 8;
/// The bytes of a node in the table, and the offsets and sizes of its fields.
const NODE: usize = 72;
const LEVEL: usize = 0;
const OCTANT: usize = 1;
const PARENT: usize = 4;
const POINTS: usize = 8;
const OFFSET: usize = 12;
const CHECKSUM: usize = 20;
const CORNER: usize = 24;
const FAR: usize = 48;
/// Offsets in `surfels`: nodes, points, neighbours, kind, direction, estimator, checksums.
const SURFEL_NODES: usize = KEY + 16;
const SURFEL_POINTS: usize = SURFEL_NODES + 4;
const NEIGHBOURS: usize = SURFEL_POINTS + 8;
const KIND: usize = NEIGHBOURS + 4;
const DIRECTION: usize = KIND + 1;
const ESTIMATOR: usize = DIRECTION + 24;
const SURFEL_CHECKSUMS: usize = ESTIMATOR + 4;
/// Bytes of a point's normal and radius.
const SURFEL: usize = 6;

const TYPES: [(&str, usize); 10] = [
    ("u8", 1),
    ("i8", 1),
    ("u16", 2),
    ("i16", 2),
    ("u32", 4),
    ("i32", 4),
    ("u64", 8),
    ("i64", 8),
    ("f32", 4),
    ("f64", 8),
];

/// Where the table of nodes is in `nodes`.
struct Table {
    /// The offsets of the lengths of texts: types and names of attributes, warnings.
    texts: Vec<usize>,
    /// Bytes of a point besides its position.
    widths: usize,
    /// Of the number of nodes.
    start: usize,
    count: usize,
}

impl Table {
    fn find(nodes: &[u8]) -> Option<Self> {
        let mut at = ATTRIBUTES;
        let mut texts = Vec::new();
        let mut widths = usize::from(*nodes.get(FLAGS + 2)?) + if *nodes.get(FLAGS + 3)? == 0 { 0 } else { 4 };
        for is_attribute in [true, false] {
            let count = number(nodes, at, 4);
            at += 4;
            for index in 0..if is_attribute { 2 * count } else { count } {
                let length = number(nodes, at, 4) as usize;
                let text = nodes.get(at + 4..(at + 4).checked_add(length)?)?;
                if is_attribute && index % 2 == 0 {
                    widths += TYPES.iter().find(|(name, _)| name.as_bytes() == text).map_or(0, |(_, size)| *size);
                }
                texts.push(at);
                at += 4 + length;
            }
        }
        let count = number(nodes, at, 4) as usize;
        let is_whole = count.checked_mul(NODE)?.checked_add(at + 4)? == nodes.len();
        is_whole.then_some(Self { texts, widths, start: at, count })
    }

    fn node(&self, index: usize) -> usize {
        self.start + 4 + NODE * index
    }
}

/// Bytes that the position of a point takes in a page.
fn position_bytes(nodes: &[u8], node: usize) -> usize {
    let bits = (0..3).map(|axis| {
        let at = |place: usize| number(nodes, node + place + 8 * axis, 8) as i64;
        u64::BITS - at(FAR).abs_diff(at(CORNER)).leading_zeros()
    });
    match bits.sum::<u32>() {
        bits @ 0..=128 => bits.div_ceil(8) as usize,
        _ => 24,
    }
}

/// Computes the checksums of the bytes again, and copies into `surfels` what it repeats of the index.
pub fn repair(bytes: &mut Vec<u8>) {
    let [nodes, pages, surfels] = split(bytes);
    let (mut nodes, mut surfels) = (nodes.to_vec(), surfels.to_vec());
    if let Some(table) = Table::find(&nodes) {
        let mut points_before = 0;
        for index in 0..table.count {
            let node = table.node(index);
            let points = number(&nodes, node + POINTS, 4) as usize;
            let start = usize::try_from(number(&nodes, node + OFFSET, 8)).unwrap_or(usize::MAX);
            let length = points.saturating_mul(position_bytes(&nodes, node) + table.widths);
            if let Some(page) = start.checked_add(length).and_then(|end| pages.get(start..end)) {
                put(&mut nodes, node + CHECKSUM, &crc32fast::hash(page).to_le_bytes());
            }
            let start = SURFEL_CHECKSUMS + 4 * table.count + SURFEL * points_before;
            if let Some(block) = surfels.get(start..start.saturating_add(SURFEL * points)) {
                let checksum = crc32fast::hash(block);
                put(&mut surfels, SURFEL_CHECKSUMS + 4 * index, &checksum.to_le_bytes());
            }
            points_before += points;
        }
        let key = nodes[KEY..KEY + 16].to_vec();
        put(&mut surfels, KEY, &key);
        put(&mut surfels, SURFEL_NODES, &(table.count as u32).to_le_bytes());
        put(&mut surfels, SURFEL_POINTS, &(points_before as u64).to_le_bytes());
        let end = SURFEL_CHECKSUMS + 4 * table.count;
        if let Some(head) = surfels.get(HEAD..end) {
            let checksum = crc32fast::hash(head);
            put(&mut surfels, HEAD - 4, &checksum.to_le_bytes());
        }
    }
    if let Some(body) = nodes.get(HEAD..) {
        let checksum = crc32fast::hash(body);
        put(&mut nodes, HEAD - 4, &checksum.to_le_bytes());
    }
    let all = join([&nodes, pages, &surfels]);
    *bytes = all;
}

/// Changes the summary or the table of nodes.
pub fn nodes(dice: &Dice, bytes: &mut Vec<u8>) {
    let [nodes, pages, surfels] = split(bytes);
    let (mut nodes, pages, surfels) = (nodes.to_vec(), pages.to_vec(), surfels.to_vec());
    change_nodes(dice, &mut nodes);
    *bytes = join([&nodes, &pages, &surfels]);
}

fn change_nodes(dice: &Dice, nodes: &mut Vec<u8>) {
    let Some(table) = Table::find(nodes) else { return noise(dice, nodes, HEAD) };
    let node = table.node(dice.below(table.count));
    match dice.below(20) {
        0 => {
            let at = FLAGS + dice.below(4);
            put(nodes, at, &[dice.pick(&[0, 1, 3, 4, 255])]);
        }
        1 => {
            let at = FIRST_DOUBLE + 8 * dice.below(DOUBLES);
            put_double(dice, nodes, at);
        }
        2 => put_integer(dice, nodes, SKIPPED, 8),
        3 => put_integer(dice, nodes, ATTRIBUTES, 4),
        4 if !table.texts.is_empty() => put_integer(dice, nodes, dice.pick(&table.texts), 4),
        5 if !table.texts.is_empty() => {
            // An attribute gets another type, if the text is the name of its type.
            let at = dice.pick(&table.texts);
            let name = dice.pick(&TYPES).0;
            let length = number(nodes, at, 4) as usize;
            drop(nodes.splice(at + 4..at + 4 + length, name.bytes()));
            put(nodes, at, &(name.len() as u32).to_le_bytes());
        }
        6 => put_integer(dice, nodes, table.start, 4),
        7 => put_integer(dice, nodes, node + LEVEL, 1),
        8 => put(nodes, node + OCTANT, &[dice.pick(&[0, 1, 7, 8, 255])]),
        9 => put_integer(dice, nodes, node + PARENT, 4),
        10 | 11 => put_integer(dice, nodes, node + POINTS, 4),
        12 => put_integer(dice, nodes, node + OFFSET, 8),
        13 | 14 => {
            let at = node + dice.pick(&[CORNER, FAR]) + 8 * dice.below(3);
            put_integer(dice, nodes, at, 8);
        }
        15 => put_integer(dice, nodes, node + CHECKSUM, 4),
        16 => {
            // The node gets no extent, so that points take no bytes, or the widest extent there is.
            let (corner, far) = dice.pick(&[(0, 0), (i64::MIN, i64::MAX), (i64::MAX, i64::MAX), (-1, 0)]);
            for axis in 0..3 {
                put(nodes, node + CORNER + 8 * axis, &i64::to_le_bytes(corner));
                put(nodes, node + FAR + 8 * axis, &i64::to_le_bytes(far));
            }
        }
        17 => {
            // Children below the last node, and so on down.
            let Some(mut copy) = nodes.get(node..node + NODE).map(<[u8]>::to_vec) else { return };
            let mut parent = (node - table.start) / NODE;
            for index in table.count..table.count + dice.pick(&[1, 8, 70, 1000]) {
                copy[LEVEL] = nodes[table.node(parent)].wrapping_add(1);
                copy[OCTANT] = (index % 8) as u8;
                put(&mut copy, PARENT, &(parent as u32).to_le_bytes());
                nodes.extend_from_slice(&copy);
                if index % 8 == 7 {
                    parent = dice.below(index);
                }
            }
            let count = ((nodes.len() - table.start - 4) / NODE) as u32;
            put(nodes, table.start, &count.to_le_bytes());
        }
        18 => {
            drop(nodes.drain(node..(node + NODE).min(nodes.len())));
            put(nodes, table.start, &(table.count.saturating_sub(1) as u32).to_le_bytes());
        }
        _ => noise(dice, nodes, table.start),
    }
}

/// Changes the bytes of pages, and now and then the fields that say where they are.
pub fn pages(dice: &Dice, bytes: &mut Vec<u8>) {
    if dice.one_in(4) {
        return nodes(dice, bytes);
    }
    let [nodes, pages, surfels] = split(bytes);
    let (nodes, mut pages, surfels) = (nodes.to_vec(), pages.to_vec(), surfels.to_vec());
    match dice.below(4) {
        0 => super::cut(dice, &mut pages),
        1 => pages.extend(std::iter::repeat_n(dice.byte(), dice.pick(&[1, 100, 10_000]))),
        _ => noise(dice, &mut pages, 0),
    }
    *bytes = join([&nodes, &pages, &surfels]);
}

/// Changes the head of `surfels`, or the normals and radii.
pub fn surfels(dice: &Dice, bytes: &mut Vec<u8>) {
    if dice.one_in(6) {
        return nodes(dice, bytes);
    }
    let [nodes, pages, surfels] = split(bytes);
    let (nodes, pages, mut surfels) = (nodes.to_vec(), pages.to_vec(), surfels.to_vec());
    match dice.below(8) {
        0 => put_integer(dice, &mut surfels, NEIGHBOURS, 4),
        1 => put(&mut surfels, KIND, &[dice.pick(&[0, 1, 2, 3, 255])]),
        2 => {
            let at = DIRECTION + 8 * dice.below(3);
            put_double(dice, &mut surfels, at);
        }
        3 => put_integer(dice, &mut surfels, ESTIMATOR, 4),
        4 => super::cut(dice, &mut surfels),
        5 => noise(dice, &mut surfels, 0),
        _ => noise(dice, &mut surfels, SURFEL_CHECKSUMS),
    }
    *bytes = join([&nodes, &pages, &surfels]);
}
