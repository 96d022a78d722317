//! What the columns of a table of numbers are: what separates them, which sign stands before decimals, and what they mean,
//! by a line of names or by the values of the first lines.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};

use cloud::ColumnType;

use super::decimals::{Sign, signs};
use crate::brief::brief;
use crate::export::names::tell_apart;
use crate::ply::number;
use crate::ply::reader::is_comment;

/// A name that stands for a column which is not read.
pub const SKIP: &str = "skip";
/// The most columns of a table.
const MOST_COLUMNS: usize = 256;
/// The number of lines from which the columns are guessed.
const LOOKED_AT: usize = 500;

/// The names that a person has given to the columns of all tables, in order.
static NAMED: RwLock<Option<Vec<String>>> = RwLock::new(None);
/// Names for the columns of single files, by canonical paths; these come before the names for all.
static NAMED_OF: RwLock<BTreeMap<PathBuf, Vec<String>>> = RwLock::new(BTreeMap::new());

/// Takes these names for the columns of all tables that are opened from now on, in place of their own lines of names and of
/// guesses. `skip` leaves a column out; columns beyond the names are left out, too.
///
/// # Errors
/// In words, if x, y or z is missing or a name is given twice.
pub fn name_columns(names: &[String]) -> Result<(), String> {
    let names = column_names(names)?;
    *NAMED.write().unwrap_or_else(PoisonError::into_inner) = Some(names);
    Ok(())
}

/// Whether `name_columns` was called.
pub fn are_columns_named() -> bool {
    NAMED.read().unwrap_or_else(PoisonError::into_inner).is_some()
}

/// Takes these names for the columns of one file, as `name_columns` does for all.
///
/// # Errors
/// Those of `name_columns`.
pub fn name_columns_of(path: &Path, names: &[String]) -> Result<(), String> {
    let names = column_names(names)?;
    NAMED_OF.write().unwrap_or_else(PoisonError::into_inner).insert(canonical(path), names);
    Ok(())
}

/// The names that columns have here by names that a person gives.
///
/// # Errors
/// In words, if x, y or z is missing or a name is given twice.
pub fn column_names(names: &[String]) -> Result<Vec<String>, String> {
    let names = meanings(names);
    let given = |name: &str| names.iter().filter(|own| *own == name).count();
    if let Some(axis) = ["x", "y", "z"].into_iter().find(|axis| given(axis) == 0) {
        return Err(format!("no column {axis}; expected x, y and z, like x,y,z,intensity,r,g,b"));
    }
    if let Some(twice) = names.iter().find(|name| *name != SKIP && given(name) > 1) {
        return Err(format!("the column {} is named twice; `{SKIP}` leaves a column out", brief(twice)));
    }
    Ok(names)
}

fn canonical(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

/// The names that a person has given to the columns of a file.
pub fn named(path: &Path) -> Option<Vec<String>> {
    let of_files = NAMED_OF.read().unwrap_or_else(PoisonError::into_inner);
    let of_file = if of_files.is_empty() { None } else { of_files.get(&canonical(path)).cloned() };
    of_file.or_else(|| NAMED.read().unwrap_or_else(PoisonError::into_inner).clone())
}

/// How a line is divided into numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Style {
    /// What stands between columns; white space where there is none.
    pub separator: Option<u8>,
    pub has_decimal_comma: bool,
}

impl Style {
    pub const BLANKS: Self = Self { separator: None, has_decimal_comma: false };

    /// The style of some lines.
    fn of(lines: &[&[u8]]) -> Self {
        let of_all = |wanted: &dyn Fn(&[u8]) -> bool| !lines.is_empty() && lines.iter().all(|line| wanted(line));
        let is_decimal = |token: &[u8]| {
            let comma = token.iter().position(|byte| *byte == b',');
            let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
            comma.is_some_and(|at| at > 0 && is_digit(token.get(at - 1)) && is_digit(token.get(at + 1)))
                && token.iter().filter(|byte| **byte == b',').count() == 1
                && !token.contains(&b'.')
        };
        // Numbers with a decimal comma stand apart by something else than one.
        let commas = |separator: Option<u8>| {
            let style = Self { separator, has_decimal_comma: true };
            let all = lines.iter().flat_map(|line| style.tokens(line));
            let with_comma = all.clone().filter(|token| is_decimal(token)).count();
            let odd = all.filter(|token| token.contains(&b',') && !is_decimal(token)).count();
            with_comma > 0 && odd == 0
        };
        let plain = |separator: Option<u8>| Self { separator, has_decimal_comma: commas(separator) };
        if of_all(&|line| line.contains(&b';')) {
            return plain(Some(b';'));
        }
        // Where nothing but tabs divides a line, two of them stand about an empty cell, unless they do in all lines.
        let by_tabs = plain(Some(b'\t'));
        let has_cells = |line: &[u8]| {
            let is_cell = |token: &[u8]| {
                !token.iter().any(|byte| byte.is_ascii_whitespace() || *byte == b',' && !by_tabs.has_decimal_comma)
            };
            by_tabs.tokens(line).count() >= 3 && by_tabs.tokens(line).all(is_cell)
        };
        let mut filled: Vec<bool> = Vec::new();
        for (column, token) in lines.iter().flat_map(|line| by_tabs.tokens(line).enumerate()) {
            filled.resize(filled.len().max(column + 1), false);
            filled[column] |= !token.is_empty();
        }
        if of_all(&has_cells) && !filled.contains(&false) {
            return by_tabs;
        }
        let words = |line: &[u8]| Self::BLANKS.tokens(line).count();
        if of_all(&|line| words(line) >= 3) && (commas(None) || !of_all(&|line| line.contains(&b','))) {
            return plain(None);
        }
        if of_all(&|line| line.contains(&b',')) {
            return Self { separator: Some(b','), has_decimal_comma: false };
        }
        Self::BLANKS
    }

    /// The columns of a line, without blanks and quotes around them.
    pub fn tokens(self, line: &[u8]) -> impl Iterator<Item = &[u8]> + Clone {
        // A tab at the beginning of a line divides an empty cell from the next one.
        let is_edge = |byte: &u8| byte.is_ascii_whitespace() && (*byte != b'\t' || self.separator != Some(b'\t'));
        let start = line.iter().position(|byte| !is_edge(byte)).unwrap_or(line.len());
        let end = line.iter().rposition(|byte| !is_edge(byte)).map_or(start, |last| last + 1);
        let line = &line[start..end];
        // At the end of a line a separator may stand after the last column.
        let line = self.separator.and_then(|separator| line.strip_suffix(&[separator])).unwrap_or(line);
        let is_end = move |byte: &u8| match self.separator {
            Some(separator) => *byte == separator,
            None => *byte <= b' ',
        };
        let tokens = line.split(is_end).filter(move |token| self.separator.is_some() || !token.is_empty());
        tokens.map(|token| {
            let token = token.trim_ascii();
            token.strip_prefix(b"\"").and_then(|token| token.strip_suffix(b"\"")).map_or(token, <[u8]>::trim_ascii)
        })
    }

    /// The number of a column; `None` if its text is none.
    #[inline]
    pub fn number(self, token: &[u8]) -> Option<f64> {
        let parse = |token: &[u8]| {
            let (value, length) = number::parse_f64(token);
            value.filter(|_| length == token.len())
        };
        if self.has_decimal_comma && token.contains(&b',') {
            let point = |byte: &u8| if *byte == b',' { b'.' } else { *byte };
            return parse(&token.iter().map(point).collect::<Vec<u8>>());
        }
        parse(token)
    }

    /// The numbers of a line; `None` if one is none.
    pub fn numbers(self, line: &[u8]) -> Option<Vec<f64>> {
        self.tokens(line).map(|token| self.number(token)).collect()
    }
}

/// The columns of a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    pub style: Style,
    /// The name and the type of each column that is read; `None` for others.
    pub columns: Vec<Option<(String, ColumnType)>>,
    /// The offset of the first line of numbers.
    pub start: u64,
    /// Whether lines that look like comments are none of its rows.
    pub has_comments: bool,
    /// What numbers behind the first lines must agree with.
    pub sign: Option<Sign>,
    /// A doubt about what columns mean, and what is lost of their numbers.
    pub warnings: Vec<String>,
}

/// What is found at the start of a table: how its lines are divided, and what says the names of the columns.
struct Head<'a> {
    style: Style,
    /// The offset of the first line of numbers, and the first lines.
    start: usize,
    has_comments: bool,
    numbers: Vec<&'a [u8]>,
    /// The values of each column in these lines, as far as they are numbers.
    samples: Vec<Vec<f64>>,
    names: Names,
}

/// What says the names of the columns of a table.
enum Names {
    /// A line of the file.
    Line(Vec<String>),
    /// Nothing, and why a line before the numbers does not, if one is there.
    Nothing(Option<String>),
}

/// A table whose columns no line names as they must be.
#[derive(Clone, Debug, PartialEq)]
pub struct UnnamedTable {
    /// The texts of the first lines, column by column of a line.
    pub lines: Vec<Vec<String>>,
    /// What the columns are taken for.
    pub names: Vec<String>,
    /// What that is by, or what is wrong with the line of names, in words.
    pub by: String,
}

/// The number of lines that a person is shown.
const SHOWN: usize = 8;

impl Table {
    /// The columns of a file that begins so; `named` are the names that a person gave them. `None` if it is no table of
    /// numbers; the error says, in words, why the columns are not known.
    pub fn of(start: &[u8], newline: u8, named: Option<Vec<String>>) -> Option<Result<Self, String>> {
        let head = Head::of(start, newline, named.is_some())?;
        let (names, mut warnings) = match (named, head.names) {
            (Some(named), _) => (named, Vec::new()),
            (None, Names::Line(mut names)) => match check_names(&names) {
                Ok(()) => {
                    let told = tell_apart(names.iter_mut().filter(|name| *name != SKIP), "column");
                    (names, told)
                }
                Err(problem) => return Some(Err(format!("{problem}; --columns names them"))),
            },
            (None, Names::Nothing(Some(problem))) => return Some(Err(format!("{problem}; --columns names them"))),
            (None, Names::Nothing(None)) => {
                let Guess { names, is_sure, .. } = guessed(&head.samples);
                let taken = names.join(",");
                let warning = format!("its columns are not named and are taken for {taken}; --columns names others");
                (names, if is_sure { Vec::new() } else { vec![warning] })
            }
        };
        let sign = match signs(&head.numbers, head.style, &names, (start, newline)) {
            Ok((sign, doubt)) => {
                warnings.extend(doubt);
                sign
            }
            Err(problem) => return Some(Err(problem)),
        };
        // The channels of a colour have one type.
        let mut channels = std::iter::zip(&names, &head.samples).filter(|(name, _)| is_color(name));
        let are_whole = channels.all(|(_, values)| values.iter().all(|value| is_word(*value)));
        let column = |(name, values): (&String, &Vec<f64>)| {
            let own = column_type(name, values, are_whole);
            // A whole number has no value that stands for a missing one.
            let (long, is_full) = (long_type(values), values.len() == head.numbers.len());
            let own = long.filter(|_| own == ColumnType::F64 && is_full && !is_place(name)).unwrap_or(own);
            // Beyond 64 bits are numbers that stand for no value.
            if name != SKIP && long.is_some() && !matches!(own, ColumnType::I64 | ColumnType::U64) {
                warnings.push(format!("{}: whole numbers beyond 2^53 lose digits as doubles", brief(name)));
            }
            (name != SKIP).then(|| (name.clone(), own))
        };
        let columns = std::iter::zip(&names, &head.samples).map(column).collect();
        let (start, has_comments) = (head.start as u64, head.has_comments);
        Some(Ok(Self { style: head.style, columns, start, has_comments, sign, warnings }))
    }

    /// The names of its columns, as `--columns` gives them.
    pub fn names(&self) -> String {
        let name =
            |column: &Option<(String, ColumnType)>| column.as_ref().map_or(SKIP.to_owned(), |(name, _)| name.clone());
        self.columns.iter().map(name).collect::<Vec<_>>().join(",")
    }
}

impl UnnamedTable {
    /// The table of a file that begins so; `None` if it is none, or a line names its columns and they can be read.
    pub fn of(start: &[u8], newline: u8) -> Option<Self> {
        let head = Head::of(start, newline, true)?;
        // Lines with texts among their numbers are a table only where all have the same columns.
        let has_texts = head.samples.iter().any(|values| values.len() < head.numbers.len());
        if has_texts && head.numbers.iter().any(|line| head.style.tokens(line).count() != head.samples.len()) {
            return None;
        }
        let Guess { names: mut taken, by, .. } = guessed(&head.samples);
        let are_texts = |values: &Vec<f64>| values.is_empty();
        let texts = std::iter::zip(&mut taken, &head.samples).filter(|(_, values)| are_texts(values));
        texts.for_each(|(name, _)| SKIP.clone_into(name));
        let left_out = if head.samples.iter().any(are_texts) { "; texts are left out" } else { "" };
        let doubt = |names: &[String]| signs(&head.numbers, head.style, names, (start, newline)).err();
        let (names, by) = match head.names {
            Names::Line(names) => {
                let problem = check_names(&names).err().or_else(|| doubt(&names))?;
                (names, problem)
            }
            Names::Nothing(problem) => {
                let problem = problem.or_else(|| doubt(&taken)).unwrap_or_else(|| "No line names the columns".into());
                (taken, format!("{problem}. Taken for {by}{left_out}"))
            }
        };
        let text = |token: &[u8]| brief(&decoded(token));
        let line = |line: &&[u8]| head.style.tokens(line).take(head.samples.len()).map(text).collect();
        Some(Self { lines: head.numbers.iter().take(SHOWN).map(line).collect(), names, by })
    }
}

impl<'a> Head<'a> {
    /// `has_names` says whether a person gave the columns names, so that texts may stand among the numbers.
    fn of(start: &'a [u8], newline: u8, has_names: bool) -> Option<Self> {
        let mut lines = Vec::new();
        let mut at = 0;
        for line in start.split_inclusive(|byte| *byte == newline) {
            if !line.trim_ascii().is_empty() {
                lines.push((at, line));
            }
            at += line.len();
        }
        // The end of a cut line may be a number by chance.
        if lines.len() > 1 && lines.last().is_some_and(|(_, line)| line.last() != Some(&newline)) && at > LONG {
            lines.pop();
        }
        // Lines of names, and comments, stand before the first line of numbers.
        let is_of_numbers = |line: &[u8]| {
            [None, Some(b','), Some(b';')].into_iter().any(|separator| {
                [false, true].into_iter().any(|has_decimal_comma| {
                    let style = Style { separator, has_decimal_comma };
                    let all = style.tokens(line).filter(|token| !token.is_empty());
                    all.clone().count() >= 3 && all.clone().all(|token| style.number(token).is_some())
                })
            })
        };
        let mixed = |line: &[u8]| {
            // A line with a text among its numbers is of the table where names are given.
            let numbers = Style::of(&[line]);
            numbers.tokens(line).filter(|token| numbers.number(token).is_some()).count() >= 3
        };
        let first = lines.iter().take(MOST_BEFORE).position(|(_, line)| is_of_numbers(line));
        let is_mixed = first.is_none();
        let first = first.or_else(|| lines.iter().take(MOST_BEFORE).position(|(_, line)| mixed(line)))?;
        // Names of points may look like comments.
        let of_first = Style::of(&[lines[first].1]);
        let has_comments = of_first.tokens(lines[first].1).next().is_some_and(|token| of_first.number(token).is_some());
        let rows = lines[first..].iter().map(|(_, line)| *line).filter(|line| !(has_comments && is_comment(line)));
        let numbers: Vec<&[u8]> = rows.take(LOOKED_AT).collect();
        let style = Style::of(&numbers);
        // The first line may end with an empty cell between tabs.
        let some = if style.separator == Some(b'\t') { &numbers[..] } else { &numbers[..1] };
        let count = some.iter().map(|line| style.tokens(line).count()).max()?;
        if !(3..=MOST_COLUMNS).contains(&count) {
            return None;
        }
        let samples: Vec<Vec<f64>> = (0..count)
            .map(|column| {
                let value = |line: &&[u8]| style.tokens(line).nth(column).and_then(|token| style.number(token));
                numbers.iter().filter_map(value).collect()
            })
            .collect();
        let names = lines[..first].iter().rev().find_map(|(_, line)| names_of(line, style, count));
        if is_mixed && names.is_none() && !has_names {
            return None;
        }
        let is_lone_count = first == 1 && lines[0].1.trim_ascii().iter().all(u8::is_ascii_digit);
        let names = match names {
            Some(names) => Names::Line(names),
            // A line before the numbers that gives no names for the columns.
            None if first > 0 && !is_lone_count && !is_comment(lines[first - 1].1) => {
                let line = brief(&decoded(lines[first - 1].1.trim_ascii()));
                Names::Nothing(Some(format!("`{line}` does not name the {count} columns of the lines below it")))
            }
            None => Names::Nothing(None),
        };
        Some(Self { style, start: lines[first].0, has_comments, numbers, samples, names })
    }
}

/// The length in bytes of a start of a file that may end inside of a line.
const LONG: usize = 60 << 10;
/// The most lines before the first one of numbers.
const MOST_BEFORE: usize = 50;

/// What the bytes from 128 to 159 are in the older texts of Windows.
const WINDOWS: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}', '‘', '’',
    '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

/// The text that bytes are: UTF-8, or else the code page 1252 of Windows.
pub fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let character = |byte: &u8| match byte {
        0x80..0xa0 => WINDOWS[usize::from(byte - 0x80)],
        byte => char::from(*byte),
    };
    std::str::from_utf8(bytes).map_or_else(|_| bytes.iter().map(character).collect(), Cow::from)
}

/// The names in a line, if it names each column.
fn names_of(line: &[u8], style: Style, count: usize) -> Option<Vec<String>> {
    let mut text = line.trim_ascii();
    while let Some(rest) = [&b"#"[..], b"//", b"%", b"!"].iter().find_map(|mark| text.strip_prefix(*mark)) {
        text = rest.trim_ascii_start();
    }
    // Names may be separated otherwise than numbers.
    let styles = [style.separator, Some(b','), Some(b';'), Some(b'\t'), None];
    let styles = styles.map(|separator| Style { separator, has_decimal_comma: false });
    let of_style = |style: Style| {
        let names = meanings(&style.tokens(text).map(decoded).collect::<Vec<_>>());
        // Attributes may be called `nan` and `inf`, but a comment or a line without values may have such words, too.
        let has_no_value = names.iter().any(|name| name.parse().is_ok_and(|value: f64| !value.is_finite()));
        let is_number = |name: &String| name.parse().is_ok_and(f64::is_finite);
        let are_names = names.len() == count && !names.iter().any(|name| name.is_empty() || is_number(name));
        (are_names && (!has_no_value || check_names(&names).is_ok())).then_some(names)
    };
    styles.into_iter().find_map(of_style)
}

/// The names that columns have here. Beside a column that is called x, y or z itself, others of that meaning keep their own
/// names.
fn meanings(names: &[impl AsRef<str>]) -> Vec<String> {
    let own: Vec<&str> = names.iter().map(|name| name.as_ref().trim().trim_matches('"').trim()).collect();
    // A unit stands behind a name.
    let bare =
        |name: &&str| name.split(['[', '(']).next().map(|bare| bare.trim().to_lowercase().replace([' ', '-'], "_"));
    let bare: Vec<String> = own.iter().map(|name| bare(name).unwrap_or_default()).collect();
    let is_further =
        |name: &str, known: &str| is_place(known) && name != known && bare.iter().any(|name| name == known);
    let name =
        |(own, bare): (&str, &String)| meaning(bare).filter(|known| !is_further(bare, known)).unwrap_or(own).to_owned();
    std::iter::zip(own, &bare).map(name).collect()
}

/// What a name in lower case without a unit stands for, if it is not of an attribute.
fn meaning(name: &str) -> Option<&'static str> {
    Some(match name {
        "x" | "easting" | "east" | "e" | "coord_x" | "x_coord" | "x_coordinate" | "point_x" => "x",
        "y" | "northing" | "north" | "n" | "coord_y" | "y_coord" | "y_coordinate" | "point_y" => "y",
        "z" | "height" | "elevation" | "h" | "coord_z" | "z_coord" | "z_coordinate" | "point_z" | "altitude" => "z",
        // German programs.
        "rechtswert" | "ost" | "rw" => "x",
        "hochwert" | "nord" | "hw" => "y",
        "höhe" | "hoehe" => "z",
        "r" | "red" | "rf" => "red",
        "g" | "green" | "gf" => "green",
        "b" | "blue" | "bf" => "blue",
        "i" | "intensity" | "scalar_intensity" => "intensity",
        "nx" | "normal_x" | "normalx" => "nx",
        "ny" | "normal_y" | "normaly" => "ny",
        "nz" | "normal_z" | "normalz" => "nz",
        SKIP | "_" => SKIP,
        _ => return None,
    })
}

fn check_names(names: &[String]) -> Result<(), String> {
    let shown = || brief(&names.join(", "));
    for axis in ["x", "y", "z"] {
        match names.iter().filter(|name| *name == axis).count() {
            1 => {}
            0 => return Err(format!("the columns {} have no {axis}", shown())),
            _ => return Err(format!("the columns {} have {axis} twice", shown())),
        }
    }
    Ok(())
}

/// What columns without names are taken for.
struct Guess {
    names: Vec<String>,
    /// What that is by, in words.
    by: &'static str,
    is_sure: bool,
}

/// Whether the first column counts the lines, and no axis of the place behind it stands still, as that of a grid would.
fn has_numbers_of_points(samples: &[Vec<f64>]) -> bool {
    let counts = |column: &[f64]| column.len() > 2 && column.windows(2).all(|pair| pair[1] == pair[0] + 1.0);
    let moves = |column: &Vec<f64>| column.iter().any(|value| *value != column[0]);
    samples.len() > 3 && counts(&samples[0]) && samples[0][0].fract() == 0.0 && samples[1..3].iter().all(moves)
}

/// Larger numbers are no intensities, but times.
const MOST_INTENSE: f64 = 1e6;

/// What columns without names mean, by the values of some lines.
fn guessed(samples: &[Vec<f64>]) -> Guess {
    if has_numbers_of_points(samples) {
        let Guess { names, .. } = guessed_columns(&samples[1..]);
        let next = names.into_iter().enumerate().map(|(place, name)| match name.starts_with("column_") {
            true => format!("column_{}", place + 2),
            false => name,
        });
        let names = std::iter::once("number".to_owned()).chain(next).collect();
        return Guess {
            names,
            by: "the number of each point, as the first column counts, and what follows",
            is_sure: false,
        };
    }
    guessed_columns(samples)
}

/// What columns without names mean, none of which holds the numbers of the points.
fn guessed_columns(samples: &[Vec<f64>]) -> Guess {
    let count = samples.len();
    let is_color = |columns: &[usize]| {
        let mut all = columns.iter().flat_map(|column| &samples[*column]).peekable();
        all.peek().is_some() && all.all(|value| value.fract() == 0.0 && (0.0..=255.0).contains(value))
    };
    let is_share = |columns: &[usize]| {
        columns.iter().flat_map(|column| &samples[*column]).all(|value| (0.0..=1.0).contains(value))
    };
    let is_wide_color =
        |columns: &[usize]| columns.iter().flat_map(|column| &samples[*column]).all(|value| is_word(*value));
    let is_normal = |columns: &[usize]| {
        let rows = columns.iter().map(|column| samples[*column].len()).min().unwrap_or(0);
        rows > 0
            && (0..rows).all(|row| {
                let square: f64 = columns.iter().map(|column| samples[*column][row].powi(2)).sum();
                (square - 1.0).abs() < 0.02 || square == 0.0
            })
    };
    let mut names: Vec<String> = (0..count).map(|column| format!("column_{}", column + 1)).collect();
    let name = |names: &mut Vec<String>, columns: &[usize], own: &[&str]| {
        std::iter::zip(columns, own).for_each(|(column, own)| names[*column] = (*own).to_owned());
    };
    const COLOR: [&str; 3] = ["red", "green", "blue"];
    const NORMAL: [&str; 3] = ["nx", "ny", "nz"];
    const INTENSITY: &str = "a place, a colour of whole numbers from 0 to 255, and an intensity beside it";
    const COLOR_AND_NORMAL: &str = "a place, a colour of whole numbers from 0 to 255, and a normal of length 1";
    name(&mut names, &[0, 1, 2], &["x", "y", "z"]);
    let (by, is_sure) = match count {
        3 => ("a place by the order of its three columns", true),
        4 if samples[3].iter().all(|value| value.abs() <= MOST_INTENSE) => {
            name(&mut names, &[3], &["intensity"]);
            ("a place and an intensity, as most files of four columns have", true)
        }
        6 if is_color(&[3, 4, 5]) => {
            name(&mut names, &[3, 4, 5], &COLOR);
            ("a place and a colour of whole numbers from 0 to 255", true)
        }
        6 if is_normal(&[3, 4, 5]) => {
            name(&mut names, &[3, 4, 5], &NORMAL);
            ("a place and a normal, since the last three columns have the length 1", true)
        }
        6 if is_share(&[3, 4, 5]) || is_wide_color(&[3, 4, 5]) => {
            name(&mut names, &[3, 4, 5], &COLOR);
            ("a place and a colour, of shares from 0 to 1 or whole numbers of 16 bits", true)
        }
        7 if is_color(&[4, 5, 6]) && !is_color(&[3]) => {
            name(&mut names, &[3, 4, 5, 6], &["intensity", COLOR[0], COLOR[1], COLOR[2]]);
            (INTENSITY, true)
        }
        7 if is_color(&[3, 4, 5]) && !is_color(&[6]) => {
            name(&mut names, &[3, 4, 5, 6], &[COLOR[0], COLOR[1], COLOR[2], "intensity"]);
            (INTENSITY, true)
        }
        7 if is_color(&[3, 4, 5, 6]) => {
            name(&mut names, &[3, 4, 5, 6], &["intensity", COLOR[0], COLOR[1], COLOR[2]]);
            ("a place, an intensity and a colour; all four could be of a colour", false)
        }
        9 if is_color(&[3, 4, 5]) && is_normal(&[6, 7, 8]) => {
            name(&mut names, &[3, 4, 5, 6, 7, 8], &[COLOR[0], COLOR[1], COLOR[2], NORMAL[0], NORMAL[1], NORMAL[2]]);
            (COLOR_AND_NORMAL, true)
        }
        9 if is_normal(&[3, 4, 5]) && is_color(&[6, 7, 8]) => {
            name(&mut names, &[3, 4, 5, 6, 7, 8], &[NORMAL[0], NORMAL[1], NORMAL[2], COLOR[0], COLOR[1], COLOR[2]]);
            (COLOR_AND_NORMAL, true)
        }
        _ => {
            if let Some(first) = (3..count.saturating_sub(2)).find(|first| is_color(&[*first, first + 1, first + 2])) {
                name(&mut names, &[first, first + 1, first + 2], &COLOR);
                ("a place by the order, and a colour where three columns are whole numbers from 0 to 255", false)
            } else {
                ("a place by the order; the values of the others say nothing", false)
            }
        }
    };
    Guess { names, by, is_sure }
}

fn is_color(name: &str) -> bool {
    matches!(name, "red" | "green" | "blue")
}

/// Whether a value is a whole number of 16 bits.
fn is_word(value: f64) -> bool {
    value.fract() == 0.0 && (0.0..=65_535.0).contains(&value)
}

pub fn is_place(name: &str) -> bool {
    matches!(name, "x" | "y" | "z")
}

/// Whether values are whole numbers of which a double does not hold all.
fn are_long(values: &[f64]) -> bool {
    values.iter().all(|value| value.fract() == 0.0) && values.iter().any(|value| value.abs() >= 2_f64.powi(53))
}

/// The type of whole numbers of which a double does not hold all; `None` for other numbers, and beyond 64 bits.
fn long_type(values: &[f64]) -> Option<ColumnType> {
    // The greatest numbers of a type become the double behind them.
    let within = |least: f64, most: f64| values.iter().all(|value| (least..=most).contains(value));
    match () {
        () if !are_long(values) => None,
        () if within(-(2_f64.powi(63)), 2_f64.powi(63)) => Some(ColumnType::I64),
        () if within(0.0, 2_f64.powi(64)) => Some(ColumnType::U64),
        () => None,
    }
}

/// The type of a column with these values: doubles, but floats for what has few digits, and whole numbers for colours that
/// are whole.
fn column_type(name: &str, values: &[f64], has_whole_colors: bool) -> ColumnType {
    // A float is written with as few digits as tell it from others, so a number that comes back needs no double.
    let is_float = |value: &f64| (*value as f32).to_string().parse() == Ok(*value);
    match name {
        name if is_color(name) && has_whole_colors => ColumnType::U16,
        "red" | "green" | "blue" | "nx" | "ny" | "nz" => ColumnType::F32,
        "intensity" if values.iter().all(is_float) => ColumnType::F32,
        // Digits that a float does not hold would be lost.
        _ => ColumnType::F64,
    }
}
