//! Reads text with a point on each line: PTS and PTX of scanners, which may hold several scans, and tables (XYZ, CSV) whose
//! columns are named or guessed.

mod decimals;
mod rows;
pub mod table;

use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;

use cloud::ColumnType;
use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::address::is_address;
use crate::brief::brief;
use crate::bytes::Bytes;
use crate::format::Format;
use crate::info::{Info, Scan};
use crate::ply::reader::Reader;
use crate::ply::rows::{Block, Rows, locate_lines};
use crate::ply::{Made, RowSource};
use crate::{Error, Result};
use rows::{Cells, TextRows};
use table::{Style, Table, UnnamedTable};

/// The length in bytes of the start of a file from which its format and columns are recognised.
const START_BYTES: u64 = 64 << 10;
/// The most scans of a file.
const MOST_SCANS: usize = 10_000;
/// So many lines are counted by one thread, which reads no more than them.
const FEW_LINES: u64 = 60_000;

/// What a text is, by its first lines.
enum Kind {
    Ptx,
    Pts,
    Table,
}

/// The start of a text, from which its kind and its columns are recognised.
struct Start {
    bytes: Vec<u8>,
    /// The length of the mark before it, which says that it is UTF-8.
    mark: u64,
    newline: u8,
}

impl Start {
    /// `None` if the file is no text.
    fn of(file: &Bytes) -> std::io::Result<Option<Self>> {
        let mut bytes = Vec::new();
        file.section(0, file.length().min(START_BYTES)).read_to_end(&mut bytes)?;
        // Bytes of numbers, or a text of 16 bits.
        if bytes.contains(&0) {
            return Ok(None);
        }
        let mark = if bytes.starts_with(b"\xef\xbb\xbf") { 3 } else { 0 };
        bytes.drain(..mark);
        let newline = if !bytes.contains(&b'\n') && bytes.contains(&b'\r') { b'\r' } else { b'\n' };
        Ok(Some(Self { bytes, mark: mark as u64, newline }))
    }

    fn kind(&self) -> Kind {
        let lines = || self.bytes.split(|byte| *byte == self.newline).filter(|line| !line.trim_ascii().is_empty());
        let counts: Vec<usize> = lines().take(11).map(|line| count_of(line).unwrap_or(0)).collect();
        let is_lone = |line: usize| counts.get(line) == Some(&1) && lines().nth(line).and_then(whole).is_some();
        if is_lone(0) && is_lone(1) && counts.get(2..6) == Some(&[3; 4]) && counts.get(6..10) == Some(&[4; 4]) {
            return Kind::Ptx;
        }
        let is_pts = is_lone(0) && counts.get(1).is_none_or(|count| (3..=7).contains(count)) && counts.len() > 1;
        if is_pts { Kind::Pts } else { Kind::Table }
    }
}

/// Opens the scans of a text of points; `None` if the file is none.
///
/// # Errors
/// If it is one that cannot be read.
pub fn open(file: &Arc<Bytes>) -> Option<Result<Vec<RowSource>>> {
    let path = file.path();
    let start = match Start::of(file) {
        Ok(start) => start?,
        Err(error) => return Some(Err(Error::io(path, error))),
    };
    let (mark, newline) = (start.mark, start.newline);
    let table = match start.kind() {
        Kind::Ptx => return Some(open_ptx(file, mark, newline)),
        Kind::Pts => return Some(open_pts(file, mark, newline)),
        Kind::Table => Table::of(&start.bytes, newline, table::named(path))?,
    };
    Some(table.map_err(|problem| Error::malformed(path, "columns", problem)).and_then(|table| {
        let lines = (mark + table.start, file.length());
        let rows = locate_lines(file, lines, newline, u64::MAX, (true, table.has_comments));
        let rows = rows.map_err(|error| Error::io(path, error))?;
        let mut info = Info::of_rows(path, Format::Xyz, table.names());
        info.warnings.extend(table.warnings.clone());
        let maker = TextRows::new(table.style, &table.columns, newline, table.has_comments, None, table.sign);
        let maker = Box::new(maker);
        let made = Made { maker, rows, is_text: true, newline, color_scale: None, info };
        Ok(vec![RowSource::made(file.clone(), made)?])
    }))
}

/// Finds out whether a file of the disk is a table whose columns nothing names: neither a person nor a line of the file. Reads
/// its start only. What cannot be read is none.
pub fn unnamed_table(path: &Path) -> Option<UnnamedTable> {
    if is_address(path) || table::named(path).is_some() {
        return None;
    }
    let start = Start::of(&Bytes::open(path).ok()?).ok()??;
    match start.kind() {
        _ if is_other(&start.bytes) => None,
        Kind::Ptx | Kind::Pts => None,
        Kind::Table => UnnamedTable::of(&start.bytes, start.newline),
    }
}

/// Whether a text is one of another format.
fn is_other(start: &[u8]) -> bool {
    crate::ply::is_ply(start) || crate::pcd::is_pcd(start)
}

/// The number of numbers in a line, with blanks between them; `None` if something else is among them.
fn count_of(line: &[u8]) -> Option<usize> {
    Some(Style::BLANKS.numbers(line)?.len())
}

/// The whole number that is alone in a line.
fn whole(line: &[u8]) -> Option<u64> {
    std::str::from_utf8(line.trim_ascii()).ok()?.parse().ok()
}

/// The rows of `count` lines from an offset on.
fn lines_of(file: &Bytes, start: u64, newline: u8, count: u64) -> std::io::Result<Rows> {
    if count > FEW_LINES {
        return locate_lines(file, (start, file.length()), newline, count, (true, false));
    }
    let mut reader = Reader::new(file, start, file.length());
    let rows = reader.skip_lines(count, newline)?;
    let end = reader.position();
    let block = (rows > 0).then_some(Block { offset: start, end, first_row: 0, rows });
    Ok(Rows { blocks: block.into_iter().collect(), count: rows, end, problem: None })
}

/// The columns of a scanner's text by their number.
fn columns_of(count: usize) -> Option<Vec<Option<(String, ColumnType)>>> {
    let (place, float, color) = (ColumnType::F64, ColumnType::F32, ColumnType::U16);
    let all = [
        ("x", place),
        ("y", place),
        ("z", place),
        ("intensity", float),
        ("red", color),
        ("green", color),
        ("blue", color),
    ];
    let chosen: &[usize] = match count {
        3 => &[0, 1, 2],
        4 => &[0, 1, 2, 3],
        6 => &[0, 1, 2, 4, 5, 6],
        7 => &[0, 1, 2, 3, 4, 5, 6],
        _ => return None,
    };
    Some(chosen.iter().map(|index| Some((all[*index].0.to_owned(), all[*index].1))).collect())
}

/// The lines of a scanner's text before its points, read one by one.
struct Lines<'a> {
    reader: Reader<'a>,
    file: &'a Bytes,
    newline: u8,
}

impl<'a> Lines<'a> {
    fn new(file: &'a Bytes, offset: u64, newline: u8) -> Self {
        Self { reader: Reader::short(file, offset, file.length()), file, newline }
    }

    fn fail(&self, problem: String) -> Error {
        Error::malformed(self.file.path(), format!("byte {}", self.reader.position()), problem)
    }

    /// The next line that is not blank; `None` at the end.
    fn next(&mut self) -> Result<Option<Vec<u8>>> {
        let line = self.reader.line(self.newline).map_err(|error| Error::io(self.file.path(), error))?;
        Ok(line.map(|(line, _)| line.to_vec()))
    }

    /// A count that is alone in its line; `None` at the end of the file.
    fn count(&mut self, what: &str) -> Result<Option<u64>> {
        let Some(line) = self.next()? else { return Ok(None) };
        let count = whole(&line).ok_or_else(|| {
            self.fail(format!(
                "`{}`, expected the number of {what}",
                brief(&String::from_utf8_lossy(line.trim_ascii()))
            ))
        })?;
        Ok(Some(count))
    }

    /// Skips lines of as many numbers as a point may have; returns how many there were.
    fn skip_points(&mut self) -> Result<u64> {
        let mut skipped = 0;
        loop {
            let before = self.reader.position();
            match self.next()? {
                Some(line) if count_of(&line).is_some_and(|count| (3..=7).contains(&count)) => skipped += 1,
                _ => {
                    self.reader = Reader::short(self.file, before, self.file.length());
                    return Ok(skipped);
                }
            }
        }
    }

    /// `N` finite numbers.
    fn numbers<const N: usize>(&mut self, what: &str) -> Result<[f64; N]> {
        let line = self.next()?.unwrap_or_default();
        let found = Style::BLANKS.numbers(&line).and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
        found.filter(|numbers| numbers.iter().all(|number| number.is_finite())).ok_or_else(|| {
            let told = brief(&String::from_utf8_lossy(line.trim_ascii()));
            self.fail(format!("`{told}`, expected the {N} numbers of {what}"))
        })
    }
}

/// A scan of a text: where it is, and how its points are read.
struct Found {
    rows: Rows,
    declared: u64,
    /// The number of points behind those that are declared.
    more: u64,
    cells: Option<Cells>,
    position: Option<DVec3>,
}

fn open_pts(file: &Arc<Bytes>, mut at: u64, newline: u8) -> Result<Vec<RowSource>> {
    let mut scans = Vec::new();
    loop {
        let mut lines = Lines::new(file, at, newline);
        let Some(declared) = lines.count("points")? else { break };
        let rows = lines_of(file, lines.reader.position(), newline, declared);
        let rows = rows.map_err(|error| Error::io(file.path(), error))?;
        at = rows.end.max(lines.reader.position());
        let mut rest = Lines::new(file, at, newline);
        // A number that no point follows is no count.
        let more = if rows.count > 0 { rest.skip_points()? } else { 0 };
        at = rest.reader.position();
        scans.push(Found { rows, declared, more, cells: None, position: None });
        check_scans(file, scans.len())?;
    }
    made(file, Format::Pts, newline, scans)
}

fn open_ptx(file: &Arc<Bytes>, mut at: u64, newline: u8) -> Result<Vec<RowSource>> {
    let mut scans = Vec::new();
    loop {
        let mut lines = Lines::new(file, at, newline);
        let Some(columns) = lines.count("columns of the scanner's grid")? else { break };
        let grid_rows = lines.count("rows of the scanner's grid")?.unwrap_or(0);
        let declared = columns
            .checked_mul(grid_rows)
            .ok_or_else(|| lines.fail(format!("a grid of {columns} columns and {grid_rows} rows")))?;
        for what in ["the scanner's place", "the scanner's first axis", "its second axis", "its third axis"] {
            lines.numbers::<3>(what)?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            *row = lines.numbers("a row of the transformation")?;
        }
        // Points are rows that are multiplied from the left, so that rows of the matrix are the axes.
        let axis = |row: usize| DVec3::new(matrix[row][0], matrix[row][1], matrix[row][2]);
        let pose = DAffine3 { matrix3: DMat3::from_cols(axis(0), axis(1), axis(2)), translation: axis(3) };
        let rows = lines_of(file, lines.reader.position(), newline, declared);
        let rows = rows.map_err(|error| Error::io(file.path(), error))?;
        at = rows.end.max(lines.reader.position());
        let cells = Some(Cells { rows: grid_rows, pose });
        scans.push(Found { rows, declared, more: 0, cells, position: Some(pose.translation) });
        check_scans(file, scans.len())?;
    }
    made(file, Format::Ptx, newline, scans)
}

/// The turn that a matrix of six digits is; `None` if it scales or mirrors.
fn turn_of(matrix: DMat3) -> Option<DQuat> {
    let is_turn = (matrix.transpose() * matrix).abs_diff_eq(DMat3::IDENTITY, 1e-4) && matrix.determinant() > 0.0;
    is_turn.then(|| DQuat::from_mat3(&matrix).normalize())
}

fn check_scans(file: &Bytes, count: usize) -> Result<()> {
    if count <= MOST_SCANS {
        return Ok(());
    }
    Err(Error::malformed(file.path(), "scans", format!("more than {MOST_SCANS} of them")))
}

fn made(file: &Arc<Bytes>, format: Format, newline: u8, scans: Vec<Found>) -> Result<Vec<RowSource>> {
    let of = scans.len();
    let source = |(number, found): (usize, Found)| {
        let Found { rows, declared, more, cells, position } = found;
        let mut info = Info::of_rows(file.path(), format, String::new());
        if rows.count < declared {
            let what = if cells.is_some() { "cells" } else { "points" };
            info.missing = declared - rows.count;
            info.warnings.push(format!("{} of {declared} {what} are missing: the file ends early", info.missing));
        }
        if more > 0 {
            info.warnings.push(format!("{more} points behind the {declared} of its count are left out"));
        }
        let first = match rows.blocks.first() {
            Some(block) => Lines::new(file, block.offset, newline).next()?,
            None => None,
        };
        let count = first.as_ref().map_or(3, |line| Style::BLANKS.tokens(line).count());
        let columns = columns_of(count).ok_or_else(|| {
            let place = rows.blocks.first().map_or(0, |block| block.offset);
            let problem = format!("{count} numbers of a point, expected 3, 4, 6 or 7");
            Error::malformed(file.path(), format!("byte {place}"), problem)
        })?;
        let turn = cells.and_then(|cells| turn_of(cells.pose.matrix3)).unwrap_or(DQuat::IDENTITY);
        info.scan = Some(Scan { name: format!("scan {}", number + 1), number, of, position, turn, times: [None; 2] });
        let maker = Box::new(TextRows::new(Style::BLANKS, &columns, newline, false, cells, None));
        let made = Made { maker, rows, is_text: true, newline, color_scale: None, info };
        RowSource::made(file.clone(), made).map(RowSource::doubting_scanner)
    };
    scans.into_iter().enumerate().map(source).collect()
}
