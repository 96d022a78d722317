//! Finds the rows of the vertex element in the file, and turns them into packed rows: scalars only, at fixed places,
//! which `columns` decodes alike for all encodings.
//!
//! Rows without lists in a binary file are packed rows already. When the file is opened, binary rows with lists are
//! walked once and lines of text are counted once (by all threads), because nothing else shows where a row is and how
//! many there really are: some 5 % of the time of reading them.

use std::io;

use cloud::{CHUNK_POINTS, ColumnType};
use rayon::prelude::*;

use super::header::{Element, Encoding, Header, Kind, Property};
use super::maker::RowMaker;
use super::number;
use super::reader::{PIECE_BYTES, Reader, count_lines};
use crate::brief::brief;
use crate::bytes::Bytes;

/// The most bytes of the scalars of a chunk: whole chunks of rows up to 256 bytes.
const CHUNK_BYTES: usize = 16 << 20;
/// Packed rows of text are passed on when they have this many bytes. A line that leaves out numbers is shorter than its
/// row.
const PACKED_BYTES: usize = 4 * PIECE_BYTES;

/// The most points of a chunk.
pub fn chunk_points(element: &Element) -> usize {
    let size = |property: &Property| match property.kind {
        Kind::Scalar(scalar) => scalar.size(),
        Kind::List { .. } => 0,
    };
    let stride: usize = element.properties.iter().map(size).sum();
    CHUNK_POINTS.min(CHUNK_BYTES / stride.max(1)).max(1)
}

/// Consecutive rows of the file. Each block becomes one chunk, except text blocks with rows of uneven length.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    pub offset: u64,
    pub end: u64,
    pub first_row: u64,
    pub rows: u64,
}

/// The rows of the vertex element that the file really has.
#[derive(Debug, Default)]
pub struct Rows {
    pub blocks: Vec<Block>,
    pub count: u64,
    /// The offset of the byte after the last row.
    pub end: u64,
    /// Why there are fewer rows than the header says, unless the file just ends.
    pub problem: Option<String>,
}

/// Finds the rows of element `index`.
pub fn locate(file: &Bytes, header: &Header, index: usize) -> io::Result<Rows> {
    let element = &header.elements[index];
    let mut reader = Reader::new(file, header.length, file.length());
    let (_, problem) = skip_elements(&mut reader, header, &header.elements[..index])?;
    let start = reader.position();
    if problem.is_some() || element.properties.is_empty() {
        return Ok(Rows { end: start, problem, ..Rows::default() });
    }
    match (header.encoding, element.stride()) {
        (Encoding::Ascii, _) => {
            locate_lines(file, (start, file.length()), header.newline, element.count, (false, false))
        }
        (_, Some(stride)) => Ok(locate_strided(start, file.length(), stride, element.count, chunk_points(element))),
        (encoding, None) => {
            let mut rows = Rows::default();
            let mut block_start = start;
            while rows.count < element.count {
                let wanted = (element.count - rows.count).min(chunk_points(element) as u64);
                let (found, problem) = skip_list_rows(&mut reader, encoding, element, wanted, rows.count)?;
                if found > 0 {
                    let end = reader.position();
                    rows.blocks.push(Block { offset: block_start, end, first_row: rows.count, rows: found });
                    rows.count += found;
                }
                block_start = reader.position();
                rows.problem = problem;
                if found < wanted {
                    break;
                }
            }
            rows.end = block_start;
            Ok(rows)
        }
    }
}

fn locate_strided(start: u64, file_length: u64, stride: u64, count: u64, block_rows: usize) -> Rows {
    let count = count.min((file_length - start) / stride);
    let blocks = (0..count)
        .step_by(block_rows)
        .map(|first_row| {
            let rows = (count - first_row).min(block_rows as u64);
            let offset = start + first_row * stride;
            Block { offset, end: offset + rows * stride, first_row, rows }
        })
        .collect();
    Rows { blocks, count, end: start + count * stride, problem: None }
}

/// Cuts text at line ends into blocks of about a chunk each, and counts their lines in parallel. It begins at byte
/// `start` and stops after `count` lines. `keeps_last` says whether a last line without an end counts as whole, and
/// `has_comments` whether comments count as nothing.
pub fn locate_lines(
    file: &Bytes,
    (start, length): (u64, u64),
    newline: u8,
    count: u64,
    (keeps_last, has_comments): (bool, bool),
) -> io::Result<Rows> {
    if count == 0 {
        return Ok(Rows { end: start, ..Rows::default() });
    }
    // Lines are assumed to be about as long as the first ones; a block aims at 15/16 of a chunk, so that a somewhat
    // denser one still fits. 16 MiB bound the work between two checks of the cancel flag.
    let (head, head_lines) = {
        let mut reader = Reader::new(file, start, length);
        let head = reader.lines(newline)?;
        (head.len() as u64, count_lines(head, newline, has_comments).max(1))
    };
    let block_bytes = (head * (CHUNK_POINTS as u64 * 15 / 16) / head_lines).clamp(64 << 10, 16 << 20);
    // The number of blocks counted at a time: enough for all threads, few enough to stop soon after the last vertex.
    let wave_blocks = rayon::current_num_threads() * 8;

    let mut rows = Rows::default();
    let mut at = start;
    while rows.count < count && at < length {
        let mut cuts = vec![at];
        while cuts.len() <= wave_blocks && at < length {
            at = next_line(file, at.saturating_add(block_bytes), length, newline)?;
            cuts.push(at);
        }
        let counts: Vec<u64> = cuts
            .par_windows(2)
            .map(|cut| Reader::new(file, cut[0], cut[1]).with_comments(has_comments).skip_lines(u64::MAX, newline))
            .collect::<io::Result<_>>()?;
        for (cut, &lines) in cuts.windows(2).zip(&counts) {
            let wanted = lines.min(count - rows.count);
            if wanted > 0 {
                rows.blocks.push(Block { offset: cut[0], end: cut[1], first_row: rows.count, rows: wanted });
                rows.count += wanted;
            }
        }
    }
    rows.end = length;
    if let Some(last) = rows.blocks.last_mut() {
        if rows.count == count {
            // The last block may extend into the data after the vertices.
            let mut reader = Reader::new(file, last.offset, last.end).with_comments(has_comments);
            reader.skip_lines(last.rows, newline)?;
            last.end = reader.position();
            rows.end = last.end;
        } else if !keeps_last && Reader::short(file, length - 1, length).take(1)? != Some(&[newline]) {
            // A last line that is cut off may end inside a number, and a wrong coordinate is worse than none.
            last.rows -= 1;
            rows.count -= 1;
        }
    }
    rows.blocks.retain(|block| block.rows > 0);
    Ok(rows)
}

/// The offset after the first line end at or after `offset`, at most `end`.
fn next_line(file: &Bytes, offset: u64, end: u64, newline: u8) -> io::Result<u64> {
    if offset >= end {
        return Ok(end);
    }
    let mut reader = Reader::short(file, offset, end);
    loop {
        match reader.take(1)? {
            Some(&[byte]) if byte == newline => return Ok(reader.position()),
            Some(_) => {}
            None => return Ok(end),
        }
    }
}

/// Skips whole elements. Returns the number of rows of the last of them, and what is wrong with the first incomplete
/// one.
pub fn skip_elements(reader: &mut Reader, header: &Header, elements: &[Element]) -> io::Result<(u64, Option<String>)> {
    let mut found = 0;
    for element in elements {
        let mut problem = None;
        found = match (header.encoding, element.stride()) {
            _ if element.properties.is_empty() => element.count,
            (Encoding::Ascii, _) => reader.skip_lines(element.count, header.newline)?,
            (_, Some(stride)) => {
                let there = element.count.min((reader.end() - reader.position()) / stride);
                reader.skip(there * stride)?;
                there
            }
            (encoding, None) => {
                let (found, list_problem) = skip_list_rows(reader, encoding, element, element.count, 0)?;
                problem = list_problem;
                found
            }
        };
        if found < element.count {
            let name = brief(&element.name);
            let problem = problem.unwrap_or_else(|| format!("the file ends in {name} {found} of {}", element.count));
            return Ok((found, Some(problem)));
        }
    }
    Ok((found, None))
}

/// Skips `count` binary rows that hold lists. Stops before the first that is not whole, and says why unless the file
/// just ends.
fn skip_list_rows(
    reader: &mut Reader,
    encoding: Encoding,
    element: &Element,
    count: u64,
    first_row: u64,
) -> io::Result<(u64, Option<String>)> {
    for row in 0..count {
        for property in &element.properties {
            let length = match property.kind {
                Kind::Scalar(scalar) => scalar.size() as u64,
                Kind::List { length, item } => {
                    let Some(bytes) = reader.take(length.size())? else { return Ok((row, None)) };
                    match list_length(bytes, length, encoding) {
                        Ok(items) => items.saturating_mul(item.size() as u64),
                        Err(items) => {
                            let (name, list, row) = (brief(&element.name), brief(&property.name), first_row + row);
                            let problem = format!("{name} {row} has a list {list} of length {items}");
                            return Ok((row, Some(problem)));
                        }
                    }
                }
            };
            if !reader.skip(length)? {
                return Ok((row, None));
            }
        }
    }
    Ok((count, None))
}

/// Some thousand packed rows from all over the file, from which its conventions are decided.
pub fn sample(file: &Bytes, rows: &Rows, packing: &Packing) -> io::Result<Vec<u8>> {
    let mut sample = Vec::new();
    let stride = packing.stride.max(1) as u64;
    for mut block in sample_blocks(file, rows, packing.header, packing.file_stride())? {
        block.rows = block.rows.min((SAMPLE_BYTES / stride).max(1));
        if let Some(stride) = packing.file_stride() {
            block.end = block.offset + block.rows * stride;
        }
        packing.read(file, block, |piece| sample.extend_from_slice(piece))?;
    }
    Ok(sample)
}

/// The most blocks of a thorough sample, and about how many rows of each are taken.
const THOROUGH_BLOCKS: usize = 16;
const THOROUGH_ROWS: u64 = 9000;

/// Packed rows from all over whole blocks, which are some from all over the file.
pub fn thorough_sample(file: &Bytes, rows: &Rows, packing: &Packing) -> io::Result<Vec<u8>> {
    let mut sample = Vec::new();
    for block in rows.blocks.iter().step_by(rows.blocks.len().div_ceil(THOROUGH_BLOCKS).max(1)) {
        // Regular scans repeat after an even number of points.
        let step = (block.rows / THOROUGH_ROWS) as usize | 1;
        packing.read(file, *block, |piece| {
            let some = piece.chunks_exact(packing.stride.max(1)).step_by(step);
            some.for_each(|row| sample.extend_from_slice(row));
        })?;
    }
    Ok(sample)
}

/// The number of places of a sample, of rows at each, and the most bytes of their packed rows.
const SAMPLE_PLACES: u64 = 64;
const SAMPLE_ROWS: u64 = 16;
const SAMPLE_BYTES: u64 = 64 << 10;

/// The places from which a sample is taken. `stride` is the size of a row of the file in bytes, if all have the same.
pub fn sample_blocks(file: &Bytes, rows: &Rows, header: &Header, stride: Option<u64>) -> io::Result<Vec<Block>> {
    let Some(start) = rows.blocks.first().map(|block| block.offset) else { return Ok(Vec::new()) };
    let mut sample = Vec::new();
    for place in 0..SAMPLE_PLACES {
        let spread = |length: u64| (u128::from(length) * u128::from(place) / u128::from(SAMPLE_PLACES)) as u64;
        if let Some(stride) = stride {
            let first_row = spread(rows.count);
            let count = SAMPLE_ROWS.min(rows.count - first_row);
            let offset = start + first_row * stride;
            sample.push(Block { offset, end: offset + count * stride, first_row, rows: count });
        } else if header.encoding == Encoding::Ascii {
            // Any line end starts a row.
            let offset = start + spread(rows.end - start);
            let offset = if place == 0 { offset } else { next_line(file, offset, rows.end, header.newline)? };
            let end = next_line(file, offset + 4096, rows.end, header.newline)?.min(rows.end);
            sample.push(Block { offset, end, first_row: 0, rows: SAMPLE_ROWS });
        } else if let Some(block) = rows.blocks.get(place as usize * rows.blocks.len().div_ceil(64)) {
            // Only the start of a block is known to be the start of a row.
            sample.push(Block { rows: block.rows.min(64 * SAMPLE_ROWS), ..*block });
        }
    }
    Ok(sample)
}

/// A binary list's length, or the negative number that stands in its place.
#[inline]
pub fn list_length(bytes: &[u8], length: ColumnType, encoding: Encoding) -> Result<u64, i64> {
    let value = integer(bytes, length, encoding);
    u64::try_from(value).map_err(|_| value as i64)
}

/// A binary scalar of an integer type.
#[inline]
pub fn integer(bytes: &[u8], scalar: ColumnType, encoding: Encoding) -> i128 {
    let mut raw = 0_u64;
    for index in 0..bytes.len() {
        let byte = if encoding == Encoding::BigEndian { bytes[index] } else { bytes[bytes.len() - 1 - index] };
        raw = raw << 8 | u64::from(byte);
    }
    match scalar {
        ColumnType::I8 => i128::from(raw as i8),
        ColumnType::I16 => i128::from(raw as i16),
        ColumnType::I32 => i128::from(raw as i32),
        ColumnType::I64 => i128::from(raw as i64),
        _ => i128::from(raw),
    }
}

/// The longest list that a record shows whole.
const RECORD_ITEMS: usize = 64;

/// Every property of a vertex as text: the file's own in ascii, else the shortest exact decimal. `None` if the row is
/// gone.
pub fn record(
    file: &Bytes,
    header: &Header,
    element: &Element,
    block: Block,
    row: u64,
) -> io::Result<Option<Vec<(String, String)>>> {
    let mut reader = Reader::new(file, block.offset, block.end);
    let before = row - block.first_row;
    let mut record = Vec::new();
    if header.encoding == Encoding::Ascii {
        reader.skip_lines(before, header.newline)?;
        let Some((line, _)) = reader.line(header.newline)? else { return Ok(None) };
        let mut tokens = line.split(|&byte| byte <= b' ').filter(|token| !token.is_empty());
        let text = |token: &[u8]| String::from_utf8_lossy(token).into_owned();
        for property in &element.properties {
            let first = tokens.next();
            let value = match (first, property.kind) {
                (None, _) => "missing".into(),
                (Some(token), Kind::Scalar(_)) => Some(text(token)).filter(|text| !is_nan(text)).unwrap_or_default(),
                (Some(length), Kind::List { .. }) => {
                    let items = number::parse_integer(length).0.unwrap_or(0).clamp(0, line.len() as i128) as usize;
                    let shown: Vec<_> = tokens.by_ref().take(items).take(RECORD_ITEMS).map(text).collect();
                    let rest = tokens.by_ref().take(items - shown.len().min(items)).count();
                    list_text(&shown, shown.len() + rest)
                }
            };
            record.push((property.name.clone(), value));
        }
        return Ok(Some(record));
    }
    match element.stride() {
        Some(stride) => _ = reader.skip(before * stride)?,
        None => _ = skip_list_rows(&mut reader, header.encoding, element, before, block.first_row)?,
    }
    for property in &element.properties {
        let value = match property.kind {
            Kind::Scalar(scalar) => {
                let Some(bytes) = reader.take(scalar.size())? else { return Ok(None) };
                Some(scalar_text(bytes, scalar, header.encoding)).filter(|text| !is_nan(text)).unwrap_or_default()
            }
            Kind::List { length, item } => {
                let Some(bytes) = reader.take(length.size())? else { return Ok(None) };
                let Ok(items) = list_length(bytes, length, header.encoding) else { return Ok(None) };
                let mut shown = Vec::new();
                for _ in 0..items.min(RECORD_ITEMS as u64) {
                    let Some(bytes) = reader.take(item.size())? else { return Ok(None) };
                    shown.push(scalar_text(bytes, item, header.encoding));
                }
                reader.skip((items - shown.len() as u64).saturating_mul(item.size() as u64))?;
                list_text(&shown, items as usize)
            }
        };
        record.push((property.name.clone(), value));
    }
    Ok(Some(record))
}

/// Whether this is the text of no number, which stands for "no value".
fn is_nan(text: &str) -> bool {
    text.parse::<f64>().is_ok_and(f64::is_nan)
}

fn list_text(shown: &[String], items: usize) -> String {
    let more = if items > shown.len() { format!(", ... {items} in all") } else { String::new() };
    format!("[{}{more}]", shown.join(", "))
}

/// A scalar of a row that was made, as text; nothing for NaN.
pub fn scalar_text_le(bytes: &[u8], scalar: ColumnType) -> String {
    Some(scalar_text(bytes, scalar, Encoding::LittleEndian)).filter(|text| !is_nan(text)).unwrap_or_default()
}

fn scalar_text(bytes: &[u8], scalar: ColumnType, encoding: Encoding) -> String {
    let raw = integer(bytes, ColumnType::U64, encoding) as u64;
    match scalar {
        ColumnType::F32 => f32::from_bits(raw as u32).to_string(),
        ColumnType::F64 => f64::from_bits(raw).to_string(),
        _ => integer(bytes, scalar, encoding).to_string(),
    }
}

/// How a row of the file becomes a packed row: the properties in file order, and which of them are kept.
pub struct Packing<'a> {
    pub header: &'a Header,
    properties: &'a [Property],
    keep: Vec<bool>,
    /// The size of a packed row in bytes.
    pub stride: usize,
    /// Where a property is in the packed row; `None` for a list or one that is not kept.
    pub offsets: Vec<Option<usize>>,
    /// Whether packed rows are big-endian. Text is packed little-endian; binary rows keep their order.
    pub big_endian: bool,
    is_strided: bool,
    /// What makes the rows, if the file does not have them as such.
    maker: Option<&'a dyn RowMaker>,
}

impl<'a> Packing<'a> {
    /// `keep` has one entry per property. Rows that are packed already keep everything. `element` is that of
    /// `maker`, if there is one.
    pub fn new(header: &'a Header, element: &'a Element, maker: Option<&'a dyn RowMaker>, mut keep: Vec<bool>) -> Self {
        let is_strided = maker.is_none() && header.encoding != Encoding::Ascii && element.stride().is_some();
        let mut stride = 0;
        let offsets = std::iter::zip(&element.properties, &mut keep)
            .map(|(property, keep)| match property.kind {
                Kind::Scalar(scalar) if *keep || is_strided => {
                    *keep = true;
                    stride += scalar.size();
                    Some(stride - scalar.size())
                }
                _ => {
                    *keep = false;
                    None
                }
            })
            .collect();
        // Text after the last kept property is skipped with its line; binary rows are walked to the end.
        let used = match header.encoding {
            Encoding::Ascii => keep.iter().rposition(|&keep| keep).map_or(0, |last| last + 1),
            _ => keep.len(),
        };
        let big_endian = maker.is_none() && header.encoding == Encoding::BigEndian;
        let properties = &element.properties[..used];
        Self { header, properties, keep, stride, offsets, big_endian, is_strided, maker }
    }

    /// Whether the rows are of another format than PLY.
    pub fn is_made(&self) -> bool {
        self.maker.is_some_and(|maker| maker.stride().is_none())
    }

    /// The size of a row of the file in bytes, if all have the same.
    fn file_stride(&self) -> Option<u64> {
        let own = self.is_strided.then_some(self.stride);
        self.maker.map_or(own, RowMaker::stride).map(|stride| stride as u64)
    }

    /// Reads `block` and passes its packed rows to `give` in pieces. Returns how many rows were read and how many of
    /// them were damaged: text with a missing number or a token that is no number, which becomes NaN, or 0 for an
    /// integer.
    pub fn read(&self, file: &Bytes, block: Block, mut give: impl FnMut(&[u8])) -> io::Result<(u64, u64)> {
        if let Some(maker) = self.maker {
            return if self.stride > 0 { maker.make(file, block, &self.keep, &mut give) } else { Ok((0, 0)) };
        }
        let mut reader = Reader::new(file, block.offset, block.end);
        let (mut rows, mut damaged) = (0, 0);
        let mut packed = Vec::new();
        while rows < block.rows && self.stride > 0 {
            if self.is_strided {
                let piece = reader.rows(self.stride)?;
                if piece.is_empty() {
                    break;
                }
                rows += (piece.len() / self.stride) as u64;
                give(piece);
                continue;
            }
            packed.clear();
            if self.header.encoding == Encoding::Ascii {
                let newline = self.header.newline;
                let run = reader.lines(newline)?;
                if run.is_empty() {
                    break;
                }
                let mut rest = run;
                while rows < block.rows
                    && let Some((whole, used)) = self.pack_line(rest, newline, &mut packed)
                {
                    rows += 1;
                    damaged += u64::from(!whole);
                    rest = &rest[used..];
                    if packed.len() >= PACKED_BYTES {
                        give(&packed);
                        packed.clear();
                    }
                }
            } else {
                while rows < block.rows && packed.len() < PIECE_BYTES {
                    if !self.pack_list_row(&mut reader, &mut packed)? {
                        break;
                    }
                    rows += 1;
                }
                if packed.is_empty() {
                    break;
                }
            }
            give(&packed);
        }
        Ok((rows, damaged))
    }

    /// Appends the packed row of the first line of `text` that is not blank. Returns whether it had all its numbers,
    /// and the number of bytes used; `None` at the end of the text.
    #[inline]
    pub fn pack_line(&self, text: &[u8], newline: u8, packed: &mut Vec<u8>) -> Option<(bool, usize)> {
        let mut at = 0;
        while *text.get(at)? <= b' ' {
            at += 1;
        }
        let mut whole = true;
        for (property, &keep) in std::iter::zip(self.properties, &self.keep) {
            match property.kind {
                Kind::Scalar(scalar) if keep => {
                    at = next_token(text, at, newline);
                    // A number ends at white space; at a line end there is an empty token, which is no number.
                    let (length, valid) = pack_number(&text[at..], scalar, packed);
                    at += length;
                    whole &= valid;
                }
                Kind::Scalar(_) => {
                    at = next_token(text, at, newline);
                    at += number::token_length(&text[at..]);
                }
                Kind::List { .. } => {
                    at = next_token(text, at, newline);
                    let (items, length) = number::parse_integer(&text[at..]);
                    at += length;
                    for _ in 0..items.unwrap_or(0) {
                        at = next_token(text, at, newline);
                        let length = number::token_length(&text[at..]);
                        if length == 0 {
                            whole = false;
                            break;
                        }
                        at += length;
                    }
                }
            }
        }
        // Continues with the next line.
        let end = text[at..].iter().position(|&byte| byte == newline);
        Some((whole, end.map_or(text.len(), |end| at + end + 1)))
    }

    /// Appends the packed row of the next binary row with lists; returns false if it is not whole.
    fn pack_list_row(&self, reader: &mut Reader, packed: &mut Vec<u8>) -> io::Result<bool> {
        let start = packed.len();
        for (property, &keep) in std::iter::zip(self.properties, &self.keep) {
            let whole = match property.kind {
                Kind::Scalar(scalar) if keep => {
                    reader.take(scalar.size())?.map(|bytes| packed.extend_from_slice(bytes)).is_some()
                }
                Kind::Scalar(scalar) => reader.skip(scalar.size() as u64)?,
                Kind::List { length, item } => {
                    let encoding = self.header.encoding;
                    let items = reader.take(length.size())?.and_then(|bytes| list_length(bytes, length, encoding).ok());
                    match items {
                        Some(items) => reader.skip(items.saturating_mul(item.size() as u64))?,
                        None => false,
                    }
                }
            };
            if !whole {
                packed.truncate(start);
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// The start of the line's next token, or the end of the line.
#[inline]
pub fn next_token(text: &[u8], mut at: usize, newline: u8) -> usize {
    while let Some(&byte) = text.get(at)
        && byte <= b' '
        && byte != newline
    {
        at += 1;
    }
    at
}

/// Appends the number at the start of `text` in its declared type, little-endian. Returns its length, and whether it
/// was a number. An integer beyond its type becomes the nearest value of the type.
#[inline]
fn pack_number(text: &[u8], scalar: ColumnType, packed: &mut Vec<u8>) -> (usize, bool) {
    macro_rules! pack_integer {
        ($integer:ty) => {{
            let (value, length) = number::parse_integer(text);
            let (least, most) = (i128::from(<$integer>::MIN), i128::from(<$integer>::MAX));
            packed.extend_from_slice(&(value.unwrap_or(0).clamp(least, most) as $integer).to_le_bytes());
            (length, value.is_some())
        }};
    }
    match scalar {
        ColumnType::F32 => {
            let (value, length) = number::parse_f32(text);
            packed.extend_from_slice(&value.unwrap_or(f32::NAN).to_le_bytes());
            (length, value.is_some())
        }
        ColumnType::F64 => {
            let (value, length) = number::parse_f64(text);
            packed.extend_from_slice(&value.unwrap_or(f64::NAN).to_le_bytes());
            (length, value.is_some())
        }
        ColumnType::U8 => pack_integer!(u8),
        ColumnType::I8 => pack_integer!(i8),
        ColumnType::U16 => pack_integer!(u16),
        ColumnType::I16 => pack_integer!(i16),
        ColumnType::U32 => pack_integer!(u32),
        ColumnType::I32 => pack_integer!(i32),
        ColumnType::U64 => pack_integer!(u64),
        ColumnType::I64 => pack_integer!(i64),
    }
}
