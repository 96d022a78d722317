//! Changes fields of E57 files: the header, the description, heads of sections and packets, and packed values.

use super::{noise, number, put, put_double, put_integer};
use crate::dice::Dice;

const PAGE: usize = 1024;

/// The part of the file with the description: XML, which pages cut.
fn description(bytes: &[u8]) -> std::ops::Range<usize> {
    let start = (number(bytes, 24, 8) as usize).min(bytes.len());
    start..start.saturating_add(number(bytes, 32, 8) as usize).min(bytes.len())
}

/// Changes one of them.
pub fn change(dice: &Dice, bytes: &mut [u8]) {
    let xml = description(bytes);
    match dice.below(10) {
        0 | 1 => put_integer(dice, bytes, dice.pick(&[16, 24, 32, 40]), 8),
        2..6 => {
            // A digit or a letter of the description, so that its length stays.
            let at = xml.start + dice.below(xml.len());
            let digits: Vec<usize> = xml.clone().filter(|at| bytes[*at].is_ascii_digit()).collect();
            let at = if dice.one_in(4) || digits.is_empty() { at } else { digits[dice.below(digits.len())] };
            put(bytes, at, &[dice.pick(b"0019-.eN <>/\"&")]);
        }
        6 | 7 => {
            // The section of the first scan begins after the header.
            let at = 48 + 8 * dice.below(4);
            if dice.one_in(2) {
                put_integer(dice, bytes, at, 8)
            } else {
                put_integer(dice, bytes, 80 + 2 * dice.below(16), 2)
            }
        }
        8 => put_double(dice, bytes, 80 + 4 * dice.below(xml.start.saturating_sub(80) / 4)),
        _ => noise(dice, bytes, 48),
    }
}

/// Computes the checksums of all pages.
pub fn repair(bytes: &mut Vec<u8>) {
    bytes.truncate(bytes.len() / PAGE * PAGE);
    for page in bytes.chunks_exact_mut(PAGE) {
        let (content, sum) = page.split_at_mut(PAGE - 4);
        sum.copy_from_slice(&checksum(content).to_be_bytes());
    }
}

/// CRC-32C, bit by bit.
fn checksum(content: &[u8]) -> u32 {
    !content.iter().fold(!0_u32, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0x82f6_3b78 } else { sum >> 1 })
    })
}
