//! Reads PCD of the Point Cloud Library: as text, binary, and compressed by LZF.
//!
//! Compressed points are columns, one after the other. They are decompressed to a temporary file without a name when the file
//! is opened, so that threads read any part of any column.

mod lzf;

use std::io::{self, BufReader, BufWriter, Read as _, Write as _};
use std::sync::Arc;

use cloud::ColumnType;
use glam::{DQuat, DVec3};

use crate::brief::brief;
use crate::bytes::Bytes;
use crate::format::Format;
use crate::info::{Info, Scan};
use crate::ply::header::{Element, Kind, Property};
use crate::ply::maker::{RowMaker, put_integer, put_number};
use crate::ply::number;
use crate::ply::reader::{Reader, is_blank};
use crate::ply::rows::{Block, Rows, chunk_points, locate_lines};
use crate::ply::{Made, RowSource};
use crate::{Error, Result};

/// The longest header, and the most numbers of a point.
const MOST_HEADER: u64 = 64 << 10;
const MOST_NUMBERS: usize = 1024;
/// A compressed byte stands for less than this many.
const MOST_EXPANSION: u64 = 100;
/// The number of points whose rows are made at a time.
const POINTS_AT_ONCE: usize = 4096;

/// Whether a file that starts so is PCD.
pub fn is_pcd(start: &[u8]) -> bool {
    start.starts_with(b"# .PCD") || start.starts_with(b"VERSION") || start.starts_with(b"FIELDS ")
}

/// A number of a point as the file has it.
#[derive(Clone, Debug, PartialEq)]
struct Number {
    name: String,
    column_type: ColumnType,
    /// The bytes before it in a binary row.
    offset: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

#[derive(Debug)]
struct Header {
    version: String,
    numbers: Vec<Number>,
    points: u64,
    position: Option<DVec3>,
    data: Data,
    /// The offset of the points.
    length: u64,
}

impl Header {
    fn stride(&self) -> usize {
        self.numbers.last().map_or(0, |last| last.offset + last.column_type.size())
    }

    /// Parses the start of a file. The error has the line, from 1, and what is wrong in it.
    fn parse(start: &[u8]) -> std::result::Result<Self, (usize, String)> {
        let (mut version, mut position) = (String::new(), None);
        let (mut fields, mut sizes, mut types, mut counts): (Vec<String>, Vec<String>, Vec<String>, Vec<String>) =
            Default::default();
        let (mut points, mut size) = (None, [None, None]);
        let mut at = 0;
        for (number, line) in start.split_inclusive(|byte| *byte == b'\n').enumerate() {
            let fail = |problem: String| (number + 1, problem);
            at += line.len();
            let text = String::from_utf8_lossy(line.trim_ascii());
            let mut words = text.split_ascii_whitespace().map(str::to_owned);
            let Some(key) = words.next().filter(|key| !key.starts_with('#')) else { continue };
            let words: Vec<String> = words.collect();
            let whole = || {
                let word = words.first().map(String::as_str).unwrap_or_default();
                word.parse::<u64>().map_err(|_| fail(format!("{key} is `{}`, expected a whole number", brief(word))))
            };
            match key.as_str() {
                "VERSION" => version = words.first().map(|word| brief(word)).unwrap_or_default(),
                "FIELDS" | "COLUMNS" => fields = words,
                "SIZE" => sizes = words,
                "TYPE" => types = words,
                "COUNT" => counts = words,
                "WIDTH" => size[0] = Some(whole()?),
                "HEIGHT" => size[1] = Some(whole()?),
                "POINTS" => points = Some(whole()?),
                "VIEWPOINT" => {
                    let numbers: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
                    // One that is left as it was says nothing.
                    position = numbers
                        .filter(|numbers| numbers.len() == 7 && *numbers != [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
                        .map(|numbers| DVec3::new(numbers[0], numbers[1], numbers[2]))
                        .filter(|place| place.is_finite());
                }
                "DATA" => {
                    let data = match words.first().map(String::as_str) {
                        Some("ascii") => Data::Ascii,
                        Some("binary") => Data::Binary,
                        Some("binary_compressed") => Data::Compressed,
                        other => {
                            let other = brief(other.unwrap_or_default());
                            return Err(fail(format!(
                                "DATA is `{other}`, none of ascii, binary and binary_compressed"
                            )));
                        }
                    };
                    let numbers = numbers_of(&fields, &sizes, &types, &counts).map_err(fail)?;
                    let area = || Some(size[0]?.saturating_mul(size[1].unwrap_or(1)));
                    let points =
                        points.or_else(area).ok_or_else(|| fail("neither POINTS nor WIDTH before DATA".into()))?;
                    return Ok(Self { version, numbers, points, position, data, length: at as u64 });
                }
                other => return Err(fail(format!("`{}` is no keyword of PCD", brief(other)))),
            }
        }
        Err((1, format!("no line DATA in the first {} bytes", start.len())))
    }
}

fn numbers_of(
    fields: &[String],
    sizes: &[String],
    types: &[String],
    counts: &[String],
) -> std::result::Result<Vec<Number>, String> {
    if fields.is_empty() || sizes.len() != fields.len() || types.len() != fields.len() {
        let (fields, sizes, types) = (fields.len(), sizes.len(), types.len());
        return Err(format!("{fields} FIELDS, {sizes} SIZE and {types} TYPE, expected as many of each"));
    }
    let mut numbers = Vec::new();
    let mut offset = 0;
    for (index, name) in fields.iter().enumerate() {
        let column_type = match (types[index].as_str(), sizes[index].as_str()) {
            ("F", "4") => ColumnType::F32,
            ("F", "8") => ColumnType::F64,
            ("U", "1") => ColumnType::U8,
            ("U", "2") => ColumnType::U16,
            ("U", "4") => ColumnType::U32,
            ("U", "8") => ColumnType::U64,
            ("I", "1") => ColumnType::I8,
            ("I", "2") => ColumnType::I16,
            ("I", "4") => ColumnType::I32,
            ("I", "8") => ColumnType::I64,
            (kind, size) => {
                return Err(format!("{} is of type {} and size {}", brief(name), brief(kind), brief(size)));
            }
        };
        let count = match counts.get(index).map(|count| count.parse::<usize>()) {
            None => 1,
            Some(Ok(count)) if count <= MOST_NUMBERS => count,
            Some(_) => return Err(format!("COUNT of {} is `{}`", brief(name), brief(&counts[index]))),
        };
        for number in 0..count {
            let name = if count == 1 { brief(name) } else { format!("{}_{number}", brief(name)) };
            numbers.push(Number { name, column_type, offset });
            offset += column_type.size();
        }
        if numbers.len() > MOST_NUMBERS {
            return Err(format!("more than {MOST_NUMBERS} numbers of a point"));
        }
    }
    if numbers.is_empty() { Err("points without numbers".into()) } else { Ok(numbers) }
}

/// Opens a file.
///
/// # Errors
/// If its header or its compressed points cannot be read.
pub fn open(file: &Arc<Bytes>) -> Result<RowSource> {
    let path = file.path();
    let io_error = |error| Error::io(path, error);
    let mut start = Vec::new();
    file.section(0, file.length().min(MOST_HEADER)).read_to_end(&mut start).map_err(io_error)?;
    let header = Header::parse(&start)
        .map_err(|(line, problem)| Error::malformed(path, format!("header line {line}"), problem))?;
    let kind = match header.data {
        Data::Ascii => "ascii",
        Data::Binary => "binary",
        Data::Compressed => "binary_compressed",
    };
    let mut info = Info::of_rows(path, Format::Pcd, format!("{} {kind}", header.version).trim().to_owned());
    let maker = Maker::new(header, file).map_err(|error| {
        let place = "compressed points";
        match error.kind() {
            io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
                Error::malformed(path, place, error.to_string())
            }
            _ => io_error(error),
        }
    })?;
    let rows = maker.rows(file).map_err(io_error)?;
    info.warnings.clone_from(&maker.warnings);
    let header = &maker.header;
    if rows.count < header.points {
        info.missing = header.points - rows.count;
        info.warnings.push(format!("{} of {} points are missing: the file ends early", info.missing, header.points));
    }
    let name = "scan 1".to_owned();
    info.scan = header.position.map(|place| Scan {
        name,
        number: 0,
        of: 1,
        position: Some(place),
        turn: DQuat::IDENTITY,
        times: [None; 2],
    });
    let is_text = header.data == Data::Ascii;
    let maker = Box::new(maker);
    let made = Made { maker, rows, is_text, newline: b'\n', color_scale: None, info };
    RowSource::made(file.clone(), made).map(RowSource::doubting_scanner)
}

/// What a property is made of: a number of the file, or a byte of one that holds a colour.
#[derive(Clone, Copy, Debug)]
enum Origin {
    Number(usize),
    Channel { number: usize, shift: u32 },
}

/// Finds the bytes of a number of the file in columns, or in rows: by its number among those of a point and the index of the
/// point.
type Look<'a> = dyn for<'v> Fn(&'v [Vec<u8>], usize, usize) -> &'v [u8] + 'a;

struct Maker {
    header: Header,
    element: Element,
    origins: Vec<Origin>,
    /// Compressed points, decompressed: all values of the first number, of the second, and so on.
    columns: Option<Bytes>,
    /// What is to be said of fields of the same name.
    warnings: Vec<String>,
}

impl Maker {
    fn new(header: Header, file: &Bytes) -> io::Result<Self> {
        let (mut properties, mut origins) = (Vec::new(), Vec::new());
        for (index, number) in header.numbers.iter().enumerate() {
            let mut add = |name: &str, column_type: ColumnType, origin: Origin| {
                properties.push(Property { name: name.to_owned(), kind: Kind::Scalar(column_type) });
                origins.push(origin);
            };
            let lower = number.name.to_lowercase();
            match lower.as_str() {
                // Numbers that fill rows up.
                name if name == "_"
                    || name.starts_with("_") && number.name.trim_start_matches('_').parse::<u32>().is_ok() => {}
                "rgb" | "rgba" if number.column_type.size() == 4 => {
                    for (name, shift) in [("red", 16), ("green", 8), ("blue", 0)] {
                        add(name, ColumnType::U8, Origin::Channel { number: index, shift });
                    }
                }
                "x" | "y" | "z" => add(&lower, number.column_type, Origin::Number(index)),
                _ => add(&number.name, number.column_type, Origin::Number(index)),
            }
        }
        let mut element = Element { name: "points".into(), count: header.points, properties };
        let warnings = element.tell_apart("field");
        let columns = match header.data {
            Data::Compressed if header.points > 0 => Some(decompressed(&header, file)?),
            _ => None,
        };
        Ok(Self { header, element, origins, columns, warnings })
    }

    fn rows(&self, file: &Bytes) -> io::Result<Rows> {
        let Header { length: start, points, data, .. } = self.header;
        let stride = self.header.stride() as u64;
        let there = match data {
            Data::Ascii => return locate_lines(file, (start, file.length()), b'\n', points, (true, false)),
            Data::Binary => (file.length() - start) / stride,
            Data::Compressed => points,
        };
        let count = points.min(there);
        let block_points = chunk_points(&self.element) as u64;
        let block = |first_row: u64| {
            let rows = block_points.min(count - first_row);
            let (offset, end) = (start + first_row * stride, start + (first_row + rows) * stride);
            Block { offset, end, first_row, rows }
        };
        let blocks = (0..count).step_by(block_points as usize).map(block).collect();
        Ok(Rows { blocks, count, end: start + count * stride, problem: None })
    }

    /// Writes a property of some points into rows of `stride` bytes, from `at` of each. `value` gives the bytes of a number of
    /// the file, little-endian.
    fn fill<'a>(
        &self,
        property: usize,
        rows: &mut [u8],
        (at, stride): (usize, usize),
        value: &dyn Fn(usize, usize) -> &'a [u8],
    ) {
        for (index, row) in rows.chunks_exact_mut(stride).enumerate() {
            match self.origins[property] {
                Origin::Number(number) => {
                    let own = value(number, index);
                    row[at..at + own.len()].copy_from_slice(own);
                }
                // Of the four bytes of a colour, blue is the first.
                Origin::Channel { number, shift } => row[at] = value(number, index)[shift as usize / 8],
            }
        }
    }
}

/// The columns of a compressed file.
fn decompressed(header: &Header, file: &Bytes) -> io::Result<Bytes> {
    let invalid = |problem: String| io::Error::new(io::ErrorKind::InvalidData, problem);
    let words: [u8; 8] = file.bytes_at(header.length)?.ok_or_else(|| invalid("the file ends before them".into()))?;
    let word = |at: usize| u64::from(u32::from_le_bytes([words[at], words[at + 1], words[at + 2], words[at + 3]]));
    let (packed, whole) = (word(0), word(4));
    let expected = header.points.saturating_mul(header.stride() as u64);
    if whole != expected {
        return Err(invalid(format!("{whole} bytes, expected {expected} for {} points", header.points)));
    }
    if whole / MOST_EXPANSION > packed {
        return Err(invalid(format!("{packed} bytes for {whole}, which is less than LZF can take")));
    }
    let from = header.length + 8;
    let mut input = BufReader::new(file.section(from, from.saturating_add(packed).min(file.length())));
    let own = tempfile::tempfile()?;
    let mut output = BufWriter::new(own);
    lzf::decompress(&mut input, &mut output, whole)?;
    output.flush()?;
    let own = output.into_inner().map_err(io::IntoInnerError::into_error)?;
    Bytes::of_file(file.path(), own)
}

impl RowMaker for Maker {
    fn element(&self) -> &Element {
        &self.element
    }

    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)> {
        let kept: Vec<(usize, ColumnType)> = std::iter::zip(0.., &self.element.properties)
            .filter(|(index, _)| keep[*index])
            .filter_map(|(index, property)| match property.kind {
                Kind::Scalar(scalar) => Some((index, scalar)),
                Kind::List { .. } => None,
            })
            .collect();
        let stride: usize = kept.iter().map(|(_, column_type)| column_type.size()).sum();
        let numbers = &self.header.numbers;
        let mut made = Vec::new();
        let mut fill = |count: usize, value: &Look<'_>, columns: &[Vec<u8>]| {
            made.clear();
            made.resize(count * stride, 0);
            let mut at = 0;
            for (property, column_type) in &kept {
                self.fill(*property, &mut made, (at, stride), &|number, index| value(columns, number, index));
                at += column_type.size();
            }
            give(&made);
        };
        if self.header.data == Data::Ascii {
            return self.make_of_text(file, block, &kept, give);
        }
        let mut rows = 0;
        if let Some(columns) = &self.columns {
            let is_needed = |number: usize| {
                kept.iter().any(|(property, _)| match self.origins[*property] {
                    Origin::Number(own) | Origin::Channel { number: own, .. } => own == number,
                })
            };
            while rows < block.rows {
                let count = (block.rows - rows).min(POINTS_AT_ONCE as u64);
                let mut values = vec![Vec::new(); numbers.len()];
                for (number, own) in numbers.iter().enumerate().filter(|(number, _)| is_needed(*number)) {
                    let size = own.column_type.size() as u64;
                    let from = own.offset as u64 * self.header.points + (block.first_row + rows) * size;
                    values[number].resize((count * size) as usize, 0);
                    if columns.read_at(from, &mut values[number])? < values[number].len() {
                        return Err(io::ErrorKind::UnexpectedEof.into());
                    }
                }
                fill(
                    count as usize,
                    &|columns, number, index| {
                        let size = numbers[number].column_type.size();
                        &columns[number][index * size..][..size]
                    },
                    &values,
                );
                rows += count;
            }
            return Ok((rows, 0));
        }
        let own_stride = self.header.stride();
        let mut reader = Reader::new(file, block.offset, block.end);
        while rows < block.rows {
            let piece = reader.rows(own_stride)?;
            if piece.is_empty() {
                break;
            }
            let count = (piece.len() / own_stride).min((block.rows - rows) as usize);
            fill(
                count,
                &|columns, number, index| {
                    let Number { offset, column_type, .. } = &numbers[number];
                    &columns[0][index * own_stride + offset..][..column_type.size()]
                },
                &[piece.to_vec()],
            );
            rows += count as u64;
        }
        Ok((rows, 0))
    }
}

impl Maker {
    /// Makes points of a block of lines of text, as `make` does of binary rows.
    fn make_of_text(
        &self,
        file: &Bytes,
        block: Block,
        kept: &[(usize, ColumnType)],
        give: &mut dyn FnMut(&[u8]),
    ) -> io::Result<(u64, u64)> {
        let mut reader = Reader::new(file, block.offset, block.end);
        let (mut rows, mut damaged) = (0, 0);
        let mut packed = Vec::new();
        while rows < block.rows {
            let run = reader.lines(b'\n')?.to_vec();
            if run.is_empty() {
                break;
            }
            for line in run.split(|byte| *byte == b'\n').filter(|line| !is_blank(line)) {
                if rows == block.rows {
                    break;
                }
                rows += 1;
                let all = line.split(|byte| *byte <= b' ').filter(|token| !token.is_empty());
                let tokens: Vec<&[u8]> = all.collect();
                let mut is_whole = true;
                for (property, column_type) in kept {
                    let at = packed.len();
                    packed.resize(at + column_type.size(), 0);
                    let (number, shift) = match self.origins[*property] {
                        Origin::Number(number) => (number, None),
                        Origin::Channel { number, shift } => (number, Some(shift)),
                    };
                    let token = tokens.get(number).copied().unwrap_or_default();
                    let is_float = matches!(self.header.numbers[number].column_type, ColumnType::F32 | ColumnType::F64);
                    match (shift, is_float) {
                        // A colour is the bits of a float.
                        (Some(shift), true) => {
                            let value = number::parse_f32(token).0;
                            is_whole &= value.is_some();
                            packed[at] = (value.unwrap_or(0.0).to_bits() >> shift) as u8;
                        }
                        (Some(shift), false) => {
                            let value = number::parse_integer(token).0;
                            is_whole &= value.is_some();
                            packed[at] = (value.unwrap_or(0) >> shift) as u8;
                        }
                        (None, true) => {
                            let value = number::parse_f64(token).0;
                            is_whole &= value.is_some();
                            put_number(&mut packed[at..], *column_type, value.unwrap_or(f64::NAN));
                        }
                        (None, false) => {
                            let value = number::parse_integer(token).0;
                            is_whole &= value.is_some();
                            let within = value.unwrap_or(0).clamp(i64::MIN.into(), i64::MAX.into()) as i64;
                            put_integer(&mut packed[at..], *column_type, within);
                        }
                    }
                }
                damaged += u64::from(!is_whole);
            }
            if !packed.is_empty() {
                give(&packed);
                packed.clear();
            }
        }
        Ok((rows, damaged))
    }
}
