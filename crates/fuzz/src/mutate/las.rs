//! Changes fields of LAS and LAZ files (LAS 1.4 R15, LASzip's record, COPC 1.0).

use super::{noise, number, put, put_double, put_integer};
use crate::dice::Dice;

/// The bytes of a record's head before its data, and those of an extended record's.
const HEAD: usize = 54;
const EXTENDED_HEAD: usize = 60;
/// The bytes of an Extra Bytes descriptor, and of an entry of COPC's hierarchy.
const DESCRIPTOR: usize = 192;
const ENTRY: usize = 32;
/// The most bytes that copies of a record take.
const MOST_COPIES: usize = 128 << 10;

/// The offset and size of the header's integers. Those that much depends on are listed twice, so that they change more
/// often.
const INTEGERS: [(usize, usize); 24] = [
    (6, 2),
    (24, 1),
    (25, 1),
    (94, 2),
    (96, 4),
    (96, 4),
    (100, 4),
    (100, 4),
    (104, 1),
    (104, 1),
    (105, 2),
    (105, 2),
    (107, 4),
    (107, 4),
    (111, 4),
    (115, 4),
    (227, 8),
    (235, 8),
    (235, 8),
    (243, 4),
    (247, 8),
    (247, 8),
    (255, 8),
    (375, 2),
];
/// The header's doubles: scale, offset, bounds.
const DOUBLES: std::ops::Range<usize> = 16..28;
const FIRST_DOUBLE: usize = 131 - 8 * 16;

/// Changes one of the header's fixed fields.
pub fn header(dice: &Dice, bytes: &mut [u8]) {
    if dice.one_in(3) {
        let at = FIRST_DOUBLE + 8 * (DOUBLES.start + dice.below(DOUBLES.len()));
        put_double(dice, bytes, at);
    } else {
        let (at, size) = dice.pick(&INTEGERS);
        put_integer(dice, bytes, at, size);
    }
}

/// A variable length record.
struct Record {
    /// The offset of its head.
    start: usize,
    user: Vec<u8>,
    identifier: u64,
    /// The offset of its data.
    data: usize,
    length: usize,
}

impl Record {
    fn is(&self, user: &str, identifier: u64) -> bool {
        self.identifier == identifier && self.user == user.as_bytes()
    }
}

/// The records that the header announces, extended ones last.
fn walk(bytes: &[u8]) -> Vec<Record> {
    let mut records = Vec::new();
    let lists = [
        (number(bytes, 94, 2), number(bytes, 100, 4), HEAD, 2),
        (number(bytes, 235, 8), number(bytes, 243, 4), EXTENDED_HEAD, 8),
    ];
    let is_extended = number(bytes, 25, 1) >= 4;
    for (start, count, head, length_size) in lists.into_iter().take(1 + usize::from(is_extended)) {
        let mut start = usize::try_from(start).unwrap_or(usize::MAX);
        for _ in 0..count.min(100) {
            let Some(bytes_of_head) = start.checked_add(head).and_then(|end| bytes.get(start..end)) else { break };
            let user = bytes_of_head[2..18].split(|byte| *byte == 0).next().unwrap_or_default().to_vec();
            let length = usize::try_from(number(bytes, start + 20, length_size)).unwrap_or(usize::MAX);
            let data = start + head;
            records.push(Record { start, user, identifier: number(bytes, start + 18, 2), data, length });
            start = data.saturating_add(length);
        }
    }
    records
}

/// Changes the heads or the contents of records.
pub fn records(dice: &Dice, bytes: &mut Vec<u8>) {
    let records = walk(bytes);
    let Some(record) = records.get(dice.below(records.len())) else { return header(dice, bytes) };
    let names: [&[u8]; 7] = [
        b"laszip encoded\0\0",
        b"copc\0",
        b"LASF_Spec\0",
        b"LASF_Projection\0",
        &[0xff; 16],
        b"\x1b[31m\n\r",
        b"liblas\0",
    ];
    match dice.below(12) {
        0..3 => put_integer(dice, bytes, record.start + 20, 2),
        3 => put_integer(dice, bytes, record.start + 18, 2),
        4 => put(bytes, record.start + 2, dice.pick(&names)),
        5 => {
            // Repeat the record, once or many times.
            let end = record.data.saturating_add(record.length).min(bytes.len());
            let copies = dice.pick(&[1, 1, 2, 20, 300]).min(MOST_COPIES / (end - record.start).max(1));
            let copy = bytes[record.start..end].repeat(copies);
            let (grown, count) = (copy.len() as u64, number(bytes, 100, 4) + copies as u64);
            let data_start = number(bytes, 96, 4) + grown;
            drop(bytes.splice(end..end, copy));
            put(bytes, 96, &(data_start as u32).to_le_bytes());
            put(bytes, 100, &(count as u32).to_le_bytes());
        }
        _ if record.is("LASF_Spec", 4) && !dice.one_in(4) => descriptor(dice, bytes, record),
        _ if record.length > 0 && dice.one_in(2) => {
            let (at, size) = (record.data + dice.below(record.length), dice.pick(&[1, 2, 4, 8]));
            put_integer(dice, bytes, at, size);
        }
        _ => {
            let end = record.data.saturating_add(record.length).min(bytes.len());
            noise(dice, &mut bytes[..end], record.data.min(end));
        }
    }
}

/// Changes fields of an Extra Bytes descriptor.
fn descriptor(dice: &Dice, bytes: &mut [u8], record: &Record) {
    let start = record.data + DESCRIPTOR * dice.below(record.length / DESCRIPTOR);
    let names: [&[u8]; 5] = [&[0; 32], &[0xff; 32], b"\x1b[2J\x07evil\n\nname", b"intensity\0", "é∞\0".as_bytes()];
    match dice.below(6) {
        0 => put(bytes, start + 2, &[dice.pick(&[0, 1, 8, 9, 10, 11, 20, 30, 31, dice.byte()])]),
        1 => put(bytes, start + 3, &[dice.byte()]),
        2 => put(bytes, start + 4, dice.pick(&names)),
        _ => {
            let field = dice.pick(&[40, 64, 88, 112, 136]);
            put_double(dice, bytes, start + field);
        }
    }
}

/// Changes the records of points, compressed or not, or the lengths that say where they are.
pub fn points(dice: &Dice, bytes: &mut [u8]) {
    match dice.below(8) {
        0 => {
            let (at, size) = dice.pick(&[(96, 4), (105, 2), (107, 4), (247, 8)]);
            put_integer(dice, bytes, at, size);
        }
        _ => {
            let start = number(bytes, 96, 4) as usize;
            noise(dice, bytes, start);
        }
    }
}

/// Changes LASzip's record, the chunk table, or the heads of chunks.
pub fn chunks(dice: &Dice, bytes: &mut [u8]) {
    let records = walk(bytes);
    let Some(record) = records.iter().find(|record| record.is("laszip encoded", 22204)) else {
        return header(dice, bytes);
    };
    let data = record.data;
    let points = number(bytes, 96, 4) as usize;
    let table = usize::try_from(number(bytes, points, 8)).unwrap_or(usize::MAX);
    match dice.below(16) {
        0 => put_integer(dice, bytes, data, 2),
        1 => put_integer(dice, bytes, data + 2, 2),
        2 => put_integer(dice, bytes, data + 8, 4),
        3 | 4 => put_integer(dice, bytes, data + 12, 4),
        5 => put(bytes, data + 12, &dice.pick(&[0, 1, 2, 5, u32::MAX]).to_le_bytes()),
        6 => put_integer(dice, bytes, data + 16, 8),
        7 => put_integer(dice, bytes, data + 24, 8),
        8 => put_integer(dice, bytes, data + 32, 2),
        9 | 10 => {
            let item = dice.below(number(bytes, data + 32, 2).min(64) as usize);
            put_integer(dice, bytes, data + 34 + 6 * item + dice.pick(&[0, 2, 4]), 2);
        }
        11 => put_integer(dice, bytes, points, 8),
        12 => put_integer(dice, bytes, table.saturating_add(4), 4),
        13 => noise(dice, bytes, table),
        14 => {
            // A layered chunk begins with a record, the number of points, and the lengths of layers.
            let first = points + 8 + number(bytes, 105, 2) as usize;
            put_integer(dice, bytes, first + 4 * dice.below(12), 4);
        }
        _ => noise(dice, bytes, points + 8),
    }
}

/// Changes COPC's info record or the pages of its hierarchy.
pub fn copc(dice: &Dice, bytes: &mut Vec<u8>) {
    let records = walk(bytes);
    let Some(info) = records.iter().find(|record| record.is("copc", 1)) else { return chunks(dice, bytes) };
    let Some(pages) = records.iter().find(|record| record.is("copc", 1000)) else { return chunks(dice, bytes) };
    let entries = pages.length / ENTRY;
    let entry = pages.data + ENTRY * dice.below(entries);
    match dice.below(14) {
        0 | 1 => {
            let field = 8 * dice.below(5);
            put_double(dice, bytes, info.data + field);
        }
        2 => put_integer(dice, bytes, info.data + 40, 8),
        3 => put_integer(dice, bytes, info.data + 48, 8),
        4..6 => put_integer(dice, bytes, entry + 4 * dice.below(4), 4),
        6 => put_integer(dice, bytes, entry + 16, 8),
        7 => put_integer(dice, bytes, entry + 24, 4),
        8 => put(bytes, entry + 28, &dice.pick(&[-1, -1, 0, 1, i32::MAX, i32::MIN, -2, 1_000_000]).to_le_bytes()),
        9 => {
            // Make a page name itself.
            put(bytes, entry + 16, &(pages.data as u64).to_le_bytes());
            put(bytes, entry + 24, &(pages.length as u32).to_le_bytes());
            put(bytes, entry + 28, &(-1_i32).to_le_bytes());
        }
        10 => {
            let other = pages.data + ENTRY * dice.below(entries);
            let copy = bytes.get(other..other + ENTRY).unwrap_or_default().to_vec();
            put(bytes, entry, &copy);
        }
        11 => {
            // Add entries at the end of the file, far down the tree or everywhere.
            let copies = dice.pick(&[1, 8, 200, 3000]);
            let mut level = number(bytes, entry, 4) as u32;
            let mut copy = bytes.get(entry..entry + ENTRY).unwrap_or_default().to_vec();
            if pages.data + pages.length == bytes.len() {
                for _ in 0..copies {
                    level = if dice.one_in(2) { level.wrapping_add(1) } else { dice.below(31) as u32 };
                    put(&mut copy, 0, &level.to_le_bytes());
                    put(&mut copy, 4, &(dice.below(1 << level.min(20)) as u32).to_le_bytes());
                    bytes.extend_from_slice(&copy);
                }
                let length = (bytes.len() - pages.data) as u64;
                put(bytes, pages.start + 20, &length.to_le_bytes());
                put(bytes, info.data + 48, &length.to_le_bytes());
            }
        }
        _ => chunks(dice, bytes),
    }
}
