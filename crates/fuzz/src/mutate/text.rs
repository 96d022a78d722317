//! Changes values, keys and tables of TOML.

use crate::dice::Dice;

const VALUES: [&str; 40] = [
    "0",
    "-0",
    "1",
    "-1",
    "0.5",
    "1e308",
    "-1e308",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "-9223372036854775808",
    "9223372036854775808",
    "4294967296",
    "65536",
    "true",
    "false",
    "\"\"",
    "\"\\u001b[31m\\u0007\"",
    "\"\\u202e\"",
    "\"nan\"",
    "''",
    "\"\"\"\n\n\"\"\"",
    "1979-05-27T07:32:00Z",
    "[]",
    "{}",
    "[[]]",
    "{ a = 1 }",
    "[nan, inf, 0.0]",
    "[0.0, 0.0, 0.0]",
    "[1e300, -1e300, 1e300]",
    "[0.0, 0.0, 0.0, 0.0]",
    "{ from = 0, to = 1, count = 4294967295 }",
    "{ from = 1.0, to = 2.0, count = 100000, scale = \"log\" }",
    "{ from = 1e-300, to = 1e300, count = 3, scale = \"log\" }",
    "\"640x480\"",
    "\"16384x16384\"",
    "\"all\"",
    "\"/dev/zero\"",
];

/// How many copies of a line or table are made.
const COPIES: [usize; 5] = [2, 3, 10, 100, 1000];
/// The most bytes that copies take.
const MOST: usize = 16 << 10;

/// Changes a value, a key, a line or a table.
pub fn change(dice: &Dice, bytes: &mut Vec<u8>) {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let mut lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
    let picked = dice.below(lines.len());
    let Some(line) = lines.get(picked).cloned() else { return };
    match dice.below(12) {
        0..4 => lines[picked] = with_value(dice, &line),
        4 => lines[picked] = inside(dice, &line),
        5 => {
            // Give one key the value of another.
            let other = lines[dice.below(lines.len())].clone();
            if let (Some((key, _)), Some((_, value))) = (line.split_once('='), other.split_once('=')) {
                lines[picked] = format!("{key}={value}");
            }
        }
        6 => drop(lines.remove(picked)),
        7 => lines[picked] = line.repeat(dice.pick(&COPIES).min(MOST / line.len().max(1))),
        8 => {
            let other = dice.below(lines.len());
            lines.swap(picked, other);
        }
        9 => {
            // Repeat a table, up to the next one, many times.
            let is_table = |line: &String| line.trim_start().starts_with('[');
            let first = lines[..=picked].iter().rposition(is_table).unwrap_or(0);
            let end = lines[first + 1..].iter().position(is_table).map_or(lines.len(), |next| first + 1 + next);
            let table = lines[first..end].concat();
            let copies = dice.pick(&COPIES).min(MOST / table.len().max(1));
            lines.insert(end, table.repeat(copies));
        }
        10 => {
            let other = lines[dice.below(lines.len())].clone();
            lines.insert(picked, other);
        }
        _ => {
            let at = dice.below(line.len());
            let mut changed = line.into_bytes();
            changed[at] =
                dice.pick(&[b'"', b'[', b']', b'{', b'}', b'=', b'.', b'#', b'\n', b',', b'0', 0xff, dice.byte()]);
            lines[picked] = String::from_utf8_lossy(&changed).into_owned();
        }
    }
    *bytes = lines.concat().into_bytes();
}

/// Returns the line with another value.
fn with_value(dice: &Dice, line: &str) -> String {
    let Some((key, value)) = line.split_once('=') else { return line.to_owned() };
    let value = value.trim_end();
    let depth = dice.pick(&[3, 60, 130, 5000]);
    match dice.below(10) {
        0 => format!("{key}= {}{value}{}\n", "[".repeat(depth), "]".repeat(depth)),
        1 => format!("{key}= {}{value}{}\n", "{ a = ".repeat(depth), " }".repeat(depth)),
        2 => format!("{key}= \"{}\"\n", "long ".repeat(dice.pick(&[10, 1000, 20_000]))),
        3 => format!(
            "{key}= [{}]\n",
            vec![value; dice.pick(&[2, 3, 4, 50, 1000]).min(MOST / value.len().max(1))].join(", ")
        ),
        4 => {
            format!("{key}= [{}]\n", (0..dice.pick(&[5, 500, 10_000])).map(|n| format!("{n}.5, ")).collect::<String>())
        }
        _ => format!("{key}= {}\n", dice.pick(&VALUES)),
    }
}

/// Returns the line with one of its numbers replaced.
fn inside(dice: &Dice, line: &str) -> String {
    let is_number = |c: char| c.is_ascii_digit() || "+-.".contains(c);
    let starts: Vec<usize> = line
        .char_indices()
        .filter(|(at, c)| is_number(*c) && !line[..*at].ends_with(is_number))
        .map(|(at, _)| at)
        .collect();
    let Some(start) = starts.get(dice.below(starts.len())).copied() else { return line.to_owned() };
    let length = line[start..].find(|c| !is_number(c)).unwrap_or(line.len() - start);
    let random = f64::from_bits(dice.draw()).to_string();
    let number = if dice.one_in(4) { random.as_str() } else { dice.pick(&VALUES[..16]) };
    format!("{}{number}{}", &line[..start], &line[start + length..])
}
