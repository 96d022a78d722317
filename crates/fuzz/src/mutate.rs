//! Changes bytes. This file has the changes that know no format; each file below has those that know one.

pub mod e57;
pub mod index;
pub mod las;
pub mod ply;
pub mod table;
pub mod text;
pub mod words;

use crate::dice::Dice;

/// Doubles that arithmetic often handles wrongly.
const DOUBLES: [f64; 22] = [
    0.0,
    -0.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    1e300,
    -1e300,
    1e-300,
    5e-324,
    f64::MAX,
    f64::MIN,
    1e18,
    -1e18,
    9.3e18,
    1.0,
    -1.0,
    1e9,
    2_147_483_647.0,
    -2_147_483_648.0,
    0.01,
    1e-12,
    1e39,
];

/// The unsigned number of `size` bytes at `at`, little end first; 0 if there are not that many bytes.
fn number(bytes: &[u8], at: usize, size: usize) -> u64 {
    let field = at.checked_add(size).and_then(|end| bytes.get(at..end)).unwrap_or_default();
    field.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))
}

/// Writes `field` at `at` if it lies within `bytes`.
fn put(bytes: &mut [u8], at: usize, field: &[u8]) {
    if let Some(place) = at.checked_add(field.len()).and_then(|end| bytes.get_mut(at..end)) {
        place.copy_from_slice(field);
    }
}

/// Replaces the integer of `size` bytes at `at` by one that readers often handle wrongly.
fn put_integer(dice: &Dice, bytes: &mut [u8], at: usize, size: usize) {
    let (now, length) = (number(bytes, at, size), bytes.len() as u64);
    let most = u64::MAX >> (64 - 8 * size);
    let bit = 1_u64 << dice.below(8 * size);
    let choices = [
        0,
        1,
        2,
        7,
        16,
        127,
        191,
        255,
        most,
        most - 1,
        most >> 1,
        (most >> 1) + 1,
        (most >> 1) - 1,
        now.wrapping_add(1),
        now.wrapping_sub(1),
        now.wrapping_mul(2),
        now / 2,
        now ^ 0x80,
        length,
        length.wrapping_sub(1),
        length + 1,
        length.wrapping_sub(8),
        length / 2,
        most.wrapping_sub(length),
        most / 20,
        most / 34,
        dice.draw(),
        dice.draw() >> (64 - 4 * size),
        bit,
        bit - 1,
        most - dice.below(100) as u64,
    ];
    put(bytes, at, &dice.pick(&choices).to_le_bytes()[..size]);
}

/// Replaces the double at `at`.
fn put_double(dice: &Dice, bytes: &mut [u8], at: usize) {
    let value = if dice.one_in(5) { f64::from_bits(dice.draw()) } else { dice.pick(&DOUBLES) };
    put(bytes, at, &value.to_le_bytes());
}

/// Flips a few bits, often near the start.
pub fn flip(dice: &Dice, bytes: &mut [u8]) {
    for _ in 0..dice.pick(&[1, 1, 2, 4, 16, 128]) {
        let end = if dice.one_in(2) { bytes.len() } else { bytes.len().min(600) };
        let at = dice.below(end);
        if let Some(byte) = bytes.get_mut(at) {
            *byte ^= 1 << dice.below(8);
        }
    }
}

/// Cuts the end off.
pub fn cut(dice: &Dice, bytes: &mut Vec<u8>) {
    let length = bytes.len();
    let choices = [dice.below(length + 1), dice.below(length.min(600) + 1), length.saturating_sub(1 + dice.below(64))];
    bytes.truncate(dice.pick(&choices));
}

/// Writes a part of another input over, into or behind this one, or removes a part of this one.
pub fn splice(dice: &Dice, bytes: &mut Vec<u8>, others: &[Vec<u8>]) {
    let Some(other) = others.get(dice.below(others.len())) else { return };
    let (at, from) = (dice.below(bytes.len() + 1), dice.below(other.len() + 1));
    let length = dice.pick(&[8, 64, 512, other.len()]).min(other.len() - from);
    let part = other[from..from + length].iter().copied();
    match dice.below(10) {
        0..4 => drop(bytes.splice(at..(at + length).min(bytes.len()), part)),
        4..7 => drop(bytes.splice(at..at, part)),
        7 | 8 => {
            let end = (at + dice.pick(&[1, 2, 4, 8, 54, 100, 1000])).min(bytes.len());
            drop(bytes.drain(at..end));
        }
        _ => drop(bytes.splice(at.., part)),
    }
}

/// Changes random bytes from `start` on.
fn noise(dice: &Dice, bytes: &mut [u8], start: usize) {
    for _ in 0..dice.pick(&[1, 2, 4, 16, 64, 256]) {
        let at = start.min(bytes.len()) + dice.below(bytes.len().saturating_sub(start));
        if let Some(byte) = bytes.get_mut(at) {
            *byte = dice.pick(&[0, 255, 127, 128, dice.byte(), *byte ^ (1 << dice.below(8))]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_written_past_the_end_of_short_inputs() {
        for seed in 0..2000 {
            let dice = Dice::new(seed);
            for length in [0, 1, 7, 54, 400] {
                let mut bytes = vec![dice.byte(); length];
                flip(&dice, &mut bytes);
                noise(&dice, &mut bytes, length / 2);
                put_integer(&dice, &mut bytes, length.saturating_sub(4), 8);
                put_double(&dice, &mut bytes, usize::MAX);
                assert_eq!(bytes.len(), length);
                splice(&dice, &mut bytes, &[vec![1; 20]]);
                cut(&dice, &mut bytes);
            }
        }
    }
}
