//! Changes lines of a PLY header, and rows of text or bytes.

use super::noise;
use crate::dice::Dice;

const END: &[u8] = b"end_header";
const TYPES: [&str; 24] = [
    "char",
    "uchar",
    "short",
    "ushort",
    "int",
    "uint",
    "float",
    "double",
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "float32",
    "float64",
    "long",
    "ulong",
    "bool",
    "list uchar int",
    "list double float",
    "list int8 double",
    "list uint uchar",
    "list",
];
const NUMBERS: [&str; 30] = [
    "0",
    "-1",
    "1",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "18446744073709551616",
    "9223372036854775807",
    "99999999999999999999999999",
    "1e9",
    "nan",
    "0x10",
    "2147483647",
    "2147483648",
    "+5",
    "5.5",
    "",
    "1 2",
    "1000000000000",
    "inf",
    "-nan",
    "1e400",
    "1e-400",
    "--1",
    "1e",
    ".",
    "-",
    "\0",
    "65536",
    "65537",
];
const NAMES: [&str; 18] = [
    "x",
    "y",
    "z",
    "red",
    "alpha",
    "nx",
    "f_dc_0",
    "scale_0",
    "rot_0",
    "opacity",
    "vertex_indices",
    "vertex",
    "face",
    "tristrips",
    "\x1b]0;evil\x07",
    "\u{202e}",
    "intensity",
    "X",
];

/// Where the header ends; the end of `bytes` if the header does not end.
fn end(bytes: &[u8]) -> usize {
    bytes.windows(END.len()).position(|window| window == END).unwrap_or(bytes.len())
}

/// Changes a word of the header, or a line.
pub fn header(dice: &Dice, bytes: &mut Vec<u8>) {
    let end = end(bytes);
    let mut lines: Vec<Vec<u8>> = bytes[..end].split_inclusive(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
    let picked = dice.below(lines.len());
    let Some(line) = lines.get_mut(picked) else { return };
    match dice.below(10) {
        0..5 => *line = word(dice, line),
        5 => {
            let copies = dice.pick(&[2, 3, 50, 2000]);
            *line = line.repeat(copies);
        }
        6 => drop(lines.remove(picked)),
        7 => {
            let other = dice.below(lines.len());
            lines.swap(picked, other);
        }
        8 => {
            let long = format!("obj_info {}\n", "z".repeat(70_000));
            let odd = [
                "comment x\n",
                long.as_str(),
                "element vertex 5\nproperty float x\n",
                "element q 1000000000000\n",
                "element q 18446744073709551615\nproperty list uchar int l\n",
                "end_header\n",
                "\0",
                "format binary_big_endian 1.0\n",
            ];
            lines.insert(picked, dice.pick(&odd).as_bytes().to_vec());
        }
        _ => {
            let ending = dice.pick(&["\r\n", "\r", "\n\n", " \n", ""]);
            let first = if dice.one_in(2) { 0 } else { picked };
            for line in &mut lines[first..] {
                if line.pop_if(|byte| *byte == b'\n').is_some() {
                    line.extend_from_slice(ending.as_bytes());
                }
            }
        }
    }
    drop(bytes.splice(..end, lines.concat()));
}

/// Returns the line with one of its words replaced.
fn word(dice: &Dice, line: &[u8]) -> Vec<u8> {
    let line = String::from_utf8_lossy(line).into_owned();
    let mut words: Vec<String> = line.split_whitespace().map(str::to_owned).collect();
    let picked = dice.below(words.len());
    let long = "q".repeat(dice.pick(&[300, 10_000]));
    let number = (dice.draw() >> dice.below(64)).to_string();
    let Some(word) = words.get_mut(picked) else { return line.into_bytes() };
    let kinds = ["ascii", "binary_little_endian", "binary_big_endian", "binary"];
    *word = match word.as_str() {
        known if kinds.contains(&known) => dice.pick(&kinds).into(),
        known if TYPES.contains(&known) => dice.pick(&TYPES).into(),
        known if known.parse::<f64>().is_ok() && dice.one_in(2) => number,
        known if known.parse::<f64>().is_ok() => dice.pick(&NUMBERS).into(),
        _ if dice.one_in(6) => long,
        _ if dice.one_in(6) => dice.pick(&TYPES).into(),
        _ => dice.pick(&NAMES).into(),
    };
    let ending = if line.ends_with('\n') { "\n" } else { "" };
    (words.join(" ") + ending).into_bytes()
}

/// Changes numbers in rows of text, or bytes.
pub fn rows(dice: &Dice, bytes: &mut Vec<u8>) {
    let start = (end(bytes) + END.len() + 1).min(bytes.len());
    let is_text = bytes.windows(12).take(400).any(|window| window == b"format ascii");
    if !is_text || dice.one_in(4) {
        if dice.one_in(2) {
            return noise(dice, bytes, start);
        }
        let values = [
            f32::NAN.to_le_bytes(),
            f32::INFINITY.to_le_bytes(),
            3e38_f32.to_le_bytes(),
            [0xff; 4],
            i32::MAX.to_le_bytes(),
            f32::NEG_INFINITY.to_be_bytes(),
        ];
        let at = start + dice.below(bytes.len() - start);
        return super::put(bytes, at, &dice.pick(&values));
    }
    for _ in 0..dice.pick(&[1, 3]) {
        let from = start + dice.below(bytes.len().saturating_sub(start));
        let is_space = |byte: &u8| byte.is_ascii_whitespace();
        let Some(first) = bytes.iter().skip(from).position(|byte| !is_space(byte)).map(|at| from + at) else { return };
        let length = bytes[first..].iter().position(is_space).unwrap_or(bytes.len() - first);
        let long = [format!("0.{}1", "0".repeat(400)), "1".repeat(2000), "9".repeat(400)];
        let text = if dice.one_in(8) { long[dice.below(3)].as_str() } else { dice.pick(&NUMBERS) };
        drop(bytes.splice(first..first + length, text.bytes()));
    }
}
