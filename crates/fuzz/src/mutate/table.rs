//! Changes words and lines of texts with a point on each line, and of headers before points.

use super::noise;
use crate::dice::Dice;

const WORDS: [&str; 34] = [
    "0",
    "-1",
    "1",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "1000000000",
    "1e9",
    "1e400",
    "nan",
    "inf",
    "1,5",
    "1.5",
    ".",
    "\"1\"",
    "\"",
    "",
    "x",
    "Y",
    "z [m]",
    "rgb",
    "_",
    "#",
    "//",
    "\u{feff}",
    "F",
    "U",
    "8",
    "ascii",
    "binary",
    "binary_compressed",
];
const SEPARATORS: [&str; 6] = [" ", ",", ";", "\t", ", ", "  "];
/// The most bytes that copies take.
const MOST: usize = 32 << 10;

/// Changes a word or a line, or what separates the words of all lines; or bytes.
pub fn change(dice: &Dice, bytes: &mut Vec<u8>) {
    if dice.one_in(5) {
        return noise(dice, bytes, 0);
    }
    let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    // The first lines say what the others are.
    let picked = dice.below(if dice.one_in(2) { lines.len() } else { lines.len().min(14) });
    let Some(line) = lines.get_mut(picked) else { return };
    match dice.below(10) {
        0..5 => *line = with_word(dice, line),
        5 => *line = line.repeat(dice.pick(&[2, 3, 50, 2000]).min(MOST / line.len().max(1))),
        6 => drop(lines.remove(picked)),
        7 => {
            let other = dice.below(lines.len());
            lines.swap(picked, other);
        }
        8 => {
            let copy = lines[..dice.below(lines.len() + 1)].concat();
            lines.insert(picked, copy);
        }
        _ => {
            let separator = dice.pick(&SEPARATORS);
            for line in &mut lines {
                let end = if line.last() == Some(&b'\n') { "\n" } else { "" };
                let words: Vec<String> = String::from_utf8_lossy(line).split_whitespace().map(str::to_owned).collect();
                *line = (words.join(separator) + end).into_bytes();
            }
        }
    }
    *bytes = lines.concat();
}

fn with_word(dice: &Dice, line: &[u8]) -> Vec<u8> {
    let text = String::from_utf8_lossy(line).into_owned();
    let separator = if text.contains(',') { "," } else { " " };
    let mut words: Vec<String> = text.trim_end().split(separator).map(str::to_owned).collect();
    let at = dice.below(words.len());
    match dice.below(4) {
        0 => drop(words.remove(at)),
        1 => words.insert(at, dice.pick(&WORDS).to_owned()),
        _ => words[at] = dice.pick(&WORDS).to_owned(),
    }
    (words.join(separator) + "\n").into_bytes()
}
