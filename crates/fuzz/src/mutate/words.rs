//! Changes words, numbers and marks of JSON and of the heads of servers' answers.

use super::noise;
use crate::dice::Dice;
use crate::parsers::{join, split};

const WORDS: [&str; 32] = [
    "0",
    "-1",
    "1",
    "31",
    "255",
    "65536",
    "16777217",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "1e300",
    "1e999",
    "0.001",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    "\"X\"",
    "\"0-0-0-0\"",
    "\"1-1-1-1\"",
    "\"31-0-0-0\"",
    "\"../../etc/passwd\"",
    "\"laszip\"",
    "\"binary\"",
    "\"float\"",
    "206",
    "302",
    "location: /",
    "chunked",
    "gzip",
    "\r\n",
];
/// The most bytes that copies take.
const MOST: usize = 32 << 10;

/// The words of a text, what stands in quotes as one, and all other characters one by one.
fn words(text: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let (mut is_quoted, mut goes_on) = (false, false);
    for c in text.chars() {
        let is_word = is_quoted || c.is_alphanumeric() || matches!(c, '.' | '-' | '_');
        match words.last_mut() {
            Some(last) if goes_on && (is_word || c == '"' && is_quoted) => last.push(c),
            _ => words.push(c.to_string()),
        }
        if c == '"' {
            is_quoted = !is_quoted;
        }
        goes_on = is_quoted || is_word && c != '"';
    }
    words
}

/// Changes a word; or bytes.
pub fn change(dice: &Dice, bytes: &mut Vec<u8>) {
    if dice.one_in(6) {
        return noise(dice, bytes, 0);
    }
    let mut words = words(&String::from_utf8_lossy(bytes));
    let at = dice.below(words.len());
    let Some(word) = words.get_mut(at) else { return };
    match dice.below(8) {
        0 => drop(words.remove(at)),
        1 => *word = word.repeat(dice.pick(&[2, 50, 2000]).min(MOST / word.len().max(1))),
        2 => {
            let other = dice.below(words.len());
            words.swap(at, other);
        }
        3 => {
            let copy = words[at..(at + dice.below(40)).min(words.len())].concat();
            words.insert(at, copy);
        }
        _ => *word = dice.pick(&WORDS).to_owned(),
    }
    *bytes = words.concat().into_bytes();
}

/// Changes one of the three files of an EPT, which come as one.
pub fn ept(dice: &Dice, bytes: &mut Vec<u8>) {
    let mut files = split(bytes).map(<[u8]>::to_vec);
    match dice.below(8) {
        0..4 => change(dice, &mut files[0]),
        4..7 => change(dice, &mut files[1]),
        _ => noise(dice, &mut files[2], 0),
    }
    *bytes = join([&files[0], &files[1], &files[2]]);
}

/// Changes the head of an answer, or bytes behind it.
pub fn answer(dice: &Dice, bytes: &mut Vec<u8>) {
    const END: &[u8] = b"\r\n\r\n";
    let end = bytes.windows(END.len()).position(|bytes| bytes == END).unwrap_or(bytes.len());
    if dice.one_in(4) {
        return noise(dice, bytes, end);
    }
    let body = bytes.split_off(end);
    change(dice, bytes);
    bytes.extend(body);
}
