//! The points of a LAZ file: where the compressed chunks lie, and streams of records out of them.
//!
//! The chunk table tells where each chunk starts, so that any of them can be decoded on its own. Where it is missing
//! (a writer that was stopped, a file cut short, LAZ of before 2011), layered chunks are found by their own headers, and
//! point-wise ones are decoded in one go from the start. Decoding is `laz`'s; it trusts its input, so sizes are checked
//! before and panics are caught around it.

use std::cell::Cell;
use std::io::{BufReader, Cursor};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

use laz::laszip::{ChunkTable, CompressorType};
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use laz::{DecompressionSelection, LazItemType, LazVlr};

use super::header::Header;
use crate::positioned_file::{PositionedFile, Section};
use crate::{Error, Result};

/// Bytes read ahead of the decoder.
const READ_AHEAD: usize = 64 << 10;
/// Bytes of the offset to the chunk table, which come before the first chunk.
const TABLE_OFFSET_LENGTH: u64 = 8;

/// A run of points that is decoded from its start.
#[derive(Clone, Copy, Debug)]
pub struct CompressedChunk {
    pub first_point: u64,
    pub points: u64,
    /// Byte of the file.
    pub offset: u64,
    /// Bytes at most.
    pub length: u64,
}

/// The compressed part of a file.
pub struct Compressed {
    vlr: LazVlr,
    record_length: usize,
    /// Layers per chunk; `None` for point-wise compression.
    layers: Option<u64>,
    pub chunks: Vec<CompressedChunk>,
    /// Points after which the one chunk without a table starts the coder anew.
    restart_after: Option<u64>,
}

impl Compressed {
    pub fn open(file: &PositionedFile, header: &Header, warnings: &mut Vec<String>) -> Result<Self> {
        let malformed = |problem: String| Error::malformed(file.path(), "LASzip record", problem);
        let Some(record) = &header.laszip else {
            return Err(malformed("missing, although the point format says the points are compressed".into()));
        };
        // Compressor, then coder; LASzip has only ever had arithmetic coding, coder 0.
        if let Some(&[low, high]) = record.get(2..4)
            && (low, high) != (0, 0)
        {
            let coder = u16::from_le_bytes([low, high]);
            return Err(malformed(format!("coder {coder}, expected 0 (arithmetic): written by a newer LASzip?")));
        }
        let vlr = LazVlr::from_buffer(record).map_err(|error| {
            malformed(format!("{error}: not compression this version knows; decompress the file with its own tool"))
        })?;
        let layers = vlr.items().first().is_some_and(|item| item.version() >= 3).then(|| layer_count(&vlr));
        let mut compressed =
            Self { vlr, record_length: header.record_length, layers, chunks: Vec::new(), restart_after: None };
        compressed.check_items().map_err(malformed)?;

        if laszip_kind(record) == CompressorType::PointWise as u16 {
            // No table, so no offset to one: the first record starts at once. The header's count has to be believed.
            compressed.one_chunk(file, header.data_start, header.points, header.points == 0);
            return Ok(compressed);
        }
        let data_start = header.data_start + TABLE_OFFSET_LENGTH;
        match read_table(file, header, &compressed.vlr).map_err(|error| Error::io(file.path(), error))? {
            Some(table) => compressed.chunks_from_table(file, &table, data_start, header.points, warnings),
            None if compressed.layers.is_some() => {
                compressed.chunks_from_their_headers(file, data_start, header.points);
                let found = match compressed.chunks.len() {
                    0 => "no compressed chunk is whole, so there is nothing to read; copy or write it again".to_owned(),
                    count => format!("{count} whole chunks found without it"),
                };
                warnings.push(format!("the chunk table is missing or damaged (file cut short?): {found}"));
            }
            None if compressed.vlr.uses_variable_size_chunks() => {
                return Err(malformed(
                    "chunks of variable size without a usable chunk table: the file is cut short; copy it again".into(),
                ));
            }
            None => {
                warnings.push(
                    "the chunk table is missing or damaged (file cut short?): points are decoded one by one".into(),
                );
                compressed.restart_after = Some(u64::from(compressed.vlr.chunk_size()));
                compressed.one_chunk(file, data_start, header.points, true);
            }
        }
        Ok(compressed)
    }

    /// All points as one chunk; `count` decodes them once to see how many there are, as nothing else tells.
    fn one_chunk(&mut self, file: &PositionedFile, offset: u64, promised: u64, count: bool) {
        let points = if promised > 0 { promised } else { u64::MAX };
        let mut chunk =
            CompressedChunk { first_point: 0, points, offset, length: file.length().saturating_sub(offset) };
        if count {
            let mut decoded = 0;
            if let Ok(mut stream) = self.stream(file, &chunk, DecompressionSelection::base()) {
                let mut record = vec![0; self.record_length];
                while decoded < points && stream.decode(&mut record).1.is_ok() {
                    decoded += 1;
                }
            }
            chunk.points = decoded;
        }
        if chunk.points > 0 {
            self.chunks.push(chunk);
        }
    }

    /// Whether `laz` can decode these items and gets records of the header's length from them.
    fn check_items(&self) -> std::result::Result<(), String> {
        if self.vlr.items().is_empty() {
            return Err("no items, expected what a point is made of".into());
        }
        let decoded = guarded(|| {
            let decompressor = self.decompressor(Cursor::new([]), DecompressionSelection::all());
            decompressor.map(|decompressor| decompressor.record_size())
        })??;
        if decoded != self.record_length {
            return Err(format!("items of {decoded} bytes in all, expected the {} of a record", self.record_length));
        }
        Ok(())
    }

    fn chunks_from_table(
        &mut self,
        file: &PositionedFile,
        table: &ChunkTable,
        data_start: u64,
        promised: u64,
        warnings: &mut Vec<String>,
    ) {
        let entries = table.as_ref();
        let mut offset = data_start;
        let mut first_point = 0_u64;
        for (index, entry) in entries.iter().enumerate() {
            let mut points = entry.point_count;
            let last = index + 1 == entries.len();
            // A table of fixed-size chunks says nothing of the last one, which holds what is left.
            if last && !self.vlr.uses_variable_size_chunks() {
                let left = promised.saturating_sub(first_point);
                points = if (1..=points).contains(&left) {
                    left
                } else if let (0, Some((found, _))) = (left, self.layered_chunk(file, offset, file.length())) {
                    found
                } else {
                    points
                };
            }
            if points > 0 && entry.byte_count > 0 {
                self.chunks.push(CompressedChunk { first_point, points, offset, length: entry.byte_count });
            }
            offset += entry.byte_count;
            first_point = first_point.saturating_add(points);
        }
        if promised > 0 && first_point > promised {
            warnings.push(format!(
                "the header says {promised} points, the chunk table {first_point}: the first {promised} are read"
            ));
            self.chunks.retain_mut(|chunk| {
                chunk.points = chunk.points.min(promised.saturating_sub(chunk.first_point));
                chunk.points > 0
            });
        }
    }

    /// Follows layered chunks from one to the next by the counts and sizes each starts with.
    fn chunks_from_their_headers(&mut self, file: &PositionedFile, data_start: u64, promised: u64) {
        let most = if self.vlr.uses_variable_size_chunks() { u64::MAX } else { u64::from(self.vlr.chunk_size()) };
        let promised = if promised == 0 { u64::MAX } else { promised };
        let (mut offset, mut first_point) = (data_start, 0);
        while first_point < promised
            && let Some((points, length)) = self.layered_chunk(file, offset, file.length())
            && (1..=most).contains(&points)
        {
            let points_kept = points.min(promised - first_point);
            self.chunks.push(CompressedChunk { first_point, points: points_kept, offset, length });
            offset += length;
            first_point += points;
        }
    }

    /// Points and bytes of the layered chunk at `offset`, if it ends before `end`: a raw first record, the number of
    /// points, the size of each layer, the layers.
    fn layered_chunk(&self, file: &PositionedFile, offset: u64, end: u64) -> Option<(u64, u64)> {
        let sizes_start = offset.checked_add(self.record_length as u64)?;
        let head_length = 4 + 4 * self.layers?;
        if sizes_start.checked_add(head_length)? > end {
            return None;
        }
        let mut head = vec![0; usize::try_from(head_length).ok()?];
        if file.read_at(sizes_start, &mut head).ok()? < head.len() {
            return None;
        }
        let mut words =
            head.chunks_exact(4).map(|word| u64::from(u32::from_le_bytes([word[0], word[1], word[2], word[3]])));
        let points = words.next()?;
        let length = self.record_length as u64 + head_length + words.sum::<u64>();
        (offset + length <= end).then_some((points, length))
    }

    fn decompressor<'a, R: std::io::Read + std::io::Seek + Send + Sync + 'a>(
        &self,
        source: R,
        layers: DecompressionSelection,
    ) -> std::result::Result<Box<dyn RecordDecompressor<R> + 'a>, String> {
        let mut decompressor: Box<dyn RecordDecompressor<R> + 'a> = if self.layers.is_some() {
            Box::new(LayeredPointRecordDecompressor::new(source))
        } else {
            Box::new(SequentialPointRecordDecompressor::new(source))
        };
        decompressor.set_fields_from(self.vlr.items()).map_err(|error| error.to_string())?;
        decompressor.set_selection(layers);
        Ok(decompressor)
    }

    /// Starts decoding `chunk`; of a layered one only `layers`.
    pub fn stream<'a>(
        &'a self,
        file: &'a PositionedFile,
        chunk: &CompressedChunk,
        layers: DecompressionSelection,
    ) -> std::result::Result<Stream<'a>, String> {
        let end = (chunk.offset + chunk.length).min(file.length());
        let mut points = chunk.points;
        // `laz` allocates what the layer sizes say, so they must fit the chunk.
        if self.layers.is_some() {
            let (found, _) = self
                .layered_chunk(file, chunk.offset, end)
                .ok_or("the chunk's layers are longer than the chunk, or the file is cut short")?;
            points = points.min(found);
        }
        let source = BufReader::with_capacity(READ_AHEAD, file.section(chunk.offset, end));
        let decompressor = guarded(|| self.decompressor(source, layers))??;
        Ok(Stream { compressed: self, decompressor, left: points, decoded: 0 })
    }
}

/// Records out of one compressed chunk.
pub struct Stream<'a> {
    compressed: &'a Compressed,
    decompressor: Box<dyn RecordDecompressor<BufReader<Section<'a>>> + 'a>,
    left: u64,
    decoded: u64,
}

impl Stream<'_> {
    /// Records still to come, as far as the file says.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Fills `records` with the next records. Fewer than asked for come with the reason; the stream has then ended.
    pub fn decode(&mut self, records: &mut [u8]) -> (usize, std::result::Result<(), String>) {
        let length = self.compressed.record_length;
        let mut decoded = 0;
        let outcome = guarded(|| {
            for record in records.chunks_exact_mut(length) {
                if let Some(points) = self.compressed.restart_after
                    && self.decoded > 0
                    && self.decoded.is_multiple_of(points)
                {
                    self.decompressor.reset();
                    self.decompressor
                        .set_fields_from(self.compressed.vlr.items())
                        .map_err(|error| error.to_string())?;
                }
                self.decompressor.decompress_next(record).map_err(|error| error.to_string())?;
                self.decoded += 1;
                decoded += 1;
            }
            Ok(())
        });
        self.left = self.left.saturating_sub(decoded as u64);
        (decoded, outcome.and_then(|result| result))
    }
}

/// The compressor's number, the first field of the record (`LazVlr` has read it, but keeps it to itself).
fn laszip_kind(record: &[u8]) -> u16 {
    record.first_chunk().map_or(0, |&bytes| u16::from_le_bytes(bytes))
}

/// Layers of a chunk: nine for the base of a point, one per colour set, wave packet and extra byte.
fn layer_count(vlr: &LazVlr) -> u64 {
    let layers = |item: &laz::LazItem| match item.item_type() {
        LazItemType::Point14 => 9,
        LazItemType::RGBNIR14 => 2,
        LazItemType::Byte14(count) => u64::from(count),
        _ => 1,
    };
    vlr.items().iter().map(layers).sum()
}

/// The chunk table, if it is there and fits the file.
fn read_table(file: &PositionedFile, header: &Header, vlr: &LazVlr) -> std::io::Result<Option<ChunkTable>> {
    let points_start = header.data_start + TABLE_OFFSET_LENGTH;
    let believable =
        |offset: &u64| *offset >= points_start && offset.checked_add(8).is_some_and(|end| end <= file.length());
    let offset_at = |position: u64| file.bytes_at(position).map(|bytes| bytes.map(u64::from_le_bytes));
    // A writer that could not go back leaves the offset in the last eight bytes of the file.
    let offset = match offset_at(header.data_start)?.filter(believable) {
        Some(offset) => Some(offset),
        None => offset_at(file.length().saturating_sub(8))?.filter(believable),
    };
    let Some(offset) = offset else { return Ok(None) };
    // Version, number of chunks. Each chunk starts with an uncompressed record, which bounds their number.
    let Some([_, _, _, _, a, b, c, d]) = file.bytes_at(offset)? else { return Ok(None) };
    let most = (offset - points_start) / header.record_length as u64 + 1;
    if u64::from(u32::from_le_bytes([a, b, c, d])) > most {
        return Ok(None);
    }
    let variable = vlr.uses_variable_size_chunks();
    let mut source = BufReader::new(file.section(offset, file.length()));
    let Ok(Ok(mut table)) = guarded(|| ChunkTable::read(&mut source, variable)) else { return Ok(None) };
    if !variable {
        let mut sized = ChunkTable::with_capacity(table.len());
        for entry in &table {
            sized.push(laz::laszip::ChunkTableEntry { point_count: u64::from(vlr.chunk_size()), ..*entry });
        }
        table = sized;
    }
    let end = (&table).into_iter().try_fold(points_start, |end, entry| end.checked_add(entry.byte_count));
    Ok(end.is_some_and(|end| end <= offset).then_some(table))
}

/// Runs a decoder on bytes that may be garbage. `laz` indexes and divides by what it decodes, so garbage can make it
/// panic; that panic ends the decoding of one chunk and becomes a message. (It needs unwinding: `panic = "abort"` in a
/// profile would end the program instead.)
///
/// The default panic hook would print to standard error before the unwinding starts. It is replaced, once, by one that
/// says nothing for panics of a thread that is in here and passes all others on.
fn guarded<T>(decode: impl FnOnce() -> T) -> std::result::Result<T, String> {
    thread_local! {
        static GUARDED: Cell<bool> = const { Cell::new(false) };
    }
    static QUIET_HOOK: Once = Once::new();
    QUIET_HOOK.call_once(|| {
        let previous = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !GUARDED.get() {
                previous(info);
            }
        }));
    });
    GUARDED.set(true);
    let outcome = panic::catch_unwind(AssertUnwindSafe(decode));
    GUARDED.set(false);
    outcome.map_err(|_| "not valid compressed data".into())
}
