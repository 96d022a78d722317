//! Reads the points of a LAZ file: finds the compressed chunks and decodes streams of records from them.
//!
//! The chunk table shows where each chunk starts, so that any of them can be decoded on its own. Where it is missing (a
//! writer that was stopped, a file cut short, LAZ of before 2011), layered chunks are found by their own headers, and
//! point-wise ones are decoded in one go from the start. `laz` does the decoding; it trusts its input, so sizes are
//! checked before and panics are caught around it.

use std::io::{BufReader, Read as _};

use laz::laszip::{ChunkTable, CompressorType};
use laz::{DecompressionSelection, LazVlr};

use super::header::Header;
use super::items;
use crate::bytes::{Bytes, Section};
use crate::guarded::guarded;
use crate::{Error, Result};

/// The number of bytes read ahead of the decoder.
const READ_AHEAD: usize = 64 << 10;
/// The fewest bytes of a layer that are read for its first points.
const BEGINNING: u64 = 512;
/// The size in bytes of the offset to the chunk table, which comes before the first chunk.
const TABLE_OFFSET_LENGTH: u64 = 8;
/// The fewest points of chunks that are read without a chunk table: each chunk starts with a new decoder, which takes a
/// millisecond to set up, the time of a thousand points. LASzip makes chunks of 50,000.
const FEWEST_POINTS_WITHOUT_TABLE: u32 = 1_000;
/// The most points of a chunk that are counted by decoding them while a file is opened; a larger chunk counts as it says.
const MOST_COUNTED: u64 = 10_000_000;

/// A run of points that is decoded from its start.
#[derive(Clone, Copy, Debug)]
pub struct CompressedChunk {
    pub first_point: u64,
    pub points: u64,
    /// The offset in the file in bytes.
    pub offset: u64,
    /// The largest possible length in bytes.
    pub length: u64,
}

/// What a layered chunk says of itself.
struct LayeredChunk {
    points: u64,
    /// The length in bytes.
    length: u64,
    /// The number of layers that are not empty.
    filled: u64,
}

/// The compressed part of a file.
pub struct Compressed {
    vlr: LazVlr,
    record_length: usize,
    /// The memory in bytes that decoders may take together.
    memory: u64,
    /// The number of layers per chunk; `None` for point-wise compression.
    layers: Option<u64>,
    pub chunks: Vec<CompressedChunk>,
    /// The number of points after which the coder starts anew in a single chunk without a table.
    restart_after: Option<u64>,
}

impl Compressed {
    /// Finds the chunks, unless a list of nodes says where they are. `memory` bounds what decoders take, in bytes.
    pub fn open(
        file: &Bytes,
        header: &Header,
        memory: u64,
        has_nodes: bool,
        warnings: &mut Vec<String>,
    ) -> Result<Self> {
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
        let is_layered = items::check(vlr.items(), header.record_length).map_err(malformed)?;
        let layers = is_layered.then(|| items::layer_count(vlr.items()));
        let record_length = header.record_length;
        let mut compressed = Self { vlr, record_length, memory, layers, chunks: Vec::new(), restart_after: None };
        compressed
            .check_memory(DecompressionSelection::base(), None)
            .map_err(|problem| Error::unsuitable(file.path(), problem))?;

        if has_nodes {
            return Ok(compressed);
        }
        if laszip_kind(record) == CompressorType::PointWise as u16 {
            // Without a table there is no offset to it either: the first record starts at once. The header's count has
            // to be believed.
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
            None if compressed.vlr.chunk_size() < FEWEST_POINTS_WITHOUT_TABLE => {
                return Err(malformed(format!(
                    "a chunk size of {} without a usable chunk table, expected {FEWEST_POINTS_WITHOUT_TABLE} or more: the \
                     record is damaged or the file is cut short; copy it again",
                    compressed.vlr.chunk_size()
                )));
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

    /// Makes one chunk of all points; `count` decodes them once to count them, as nothing else says their number.
    fn one_chunk(&mut self, file: &Bytes, offset: u64, promised: u64, count: bool) {
        let points = if promised > 0 { promised } else { u64::MAX };
        let mut chunk =
            CompressedChunk { first_point: 0, points, offset, length: file.length().saturating_sub(offset) };
        if count {
            chunk.points = self.decodable_points(file, &chunk);
        }
        if chunk.points > 0 {
            self.chunks.push(chunk);
        }
    }

    /// The number of points of a chunk, at most those that it says, by decoding it. Some at the end may be made of the rest of
    /// the coder's bytes.
    fn decodable_points(&self, file: &Bytes, chunk: &CompressedChunk) -> u64 {
        let Ok(mut stream) = self.stream(file, chunk, DecompressionSelection::base()) else { return 0 };
        let mut record = vec![0; self.record_length];
        (0..chunk.points).take_while(|_| stream.decode(&mut record).1.is_ok()).count() as u64
    }

    /// Checks that one decoder of `layers` fits in memory. `filled` is the number of the chunk's layers that are not
    /// empty, if it is known.
    fn check_memory(&self, layers: DecompressionSelection, filled: Option<u64>) -> std::result::Result<(), String> {
        let bytes = items::decoder_bytes(self.vlr.items(), self.layers.is_some(), layers, filled);
        if bytes <= self.memory.max(items::BASE_BYTES) {
            return Ok(());
        }
        Err(format!(
            "points of {} bytes take {} MB to decode, the memory for that is {} MB: stream.host_bytes is too small for it",
            self.record_length,
            bytes.div_ceil(1_000_000),
            self.memory / 1_000_000
        ))
    }

    /// The number of decoders of `layers` that may run at a time: one per thread, if they fit in memory.
    pub fn decoders(&self, layers: DecompressionSelection) -> usize {
        let bytes = items::decoder_bytes(self.vlr.items(), self.layers.is_some(), layers, None);
        (self.memory / bytes).clamp(1, rayon::current_num_threads() as u64) as usize
    }

    fn chunks_from_table(
        &mut self,
        file: &Bytes,
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
            // A table of fixed-size chunks does not have the size of the last one, which holds the remaining points.
            if last && !self.vlr.uses_variable_size_chunks() {
                let left = promised.saturating_sub(first_point);
                points = if (1..=points).contains(&left) {
                    left
                } else if let (0, Some(found)) = (left, self.layered_chunk(file, offset, file.length())) {
                    found.points
                } else if promised == 0 && self.layers.is_none() && points <= MOST_COUNTED {
                    let chunk = CompressedChunk { first_point, points, offset, length: entry.byte_count };
                    self.decodable_points(file, &chunk)
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
        if promised == 0 && first_point > 0 {
            warnings.push(format!(
                "the header says 0 points, the compressed data hold {first_point}: the last few may be made of its end"
            ));
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

    /// Follows layered chunks from one to the next by the counts and sizes with which each starts.
    fn chunks_from_their_headers(&mut self, file: &Bytes, data_start: u64, promised: u64) {
        let most = if self.vlr.uses_variable_size_chunks() { u64::MAX } else { u64::from(self.vlr.chunk_size()) };
        let promised = if promised == 0 { u64::MAX } else { promised };
        let (mut offset, mut first_point) = (data_start, 0);
        while first_point < promised
            && let Some(LayeredChunk { points, length, .. }) = self.layered_chunk(file, offset, file.length())
            && (1..=most).contains(&points)
        {
            let points_kept = points.min(promised - first_point);
            self.chunks.push(CompressedChunk { first_point, points: points_kept, offset, length });
            offset += length;
            first_point += points;
        }
    }

    /// Reads the head of the layered chunk at `offset`, if it ends before `end`. The chunk is a raw first record, the
    /// number of points, the size of each layer, the layers.
    fn layered_chunk(&self, file: &Bytes, offset: u64, end: u64) -> Option<LayeredChunk> {
        let sizes_start = offset.checked_add(self.record_length as u64)?;
        let head_length = 4 + 4 * self.layers?;
        if sizes_start.checked_add(head_length)? > end {
            return None;
        }
        let mut head = vec![0; usize::try_from(head_length).ok()?];
        if file.read_at(sizes_start, &mut head).ok()? < head.len() {
            return None;
        }
        let (&[points, ref sizes @ ..], []) = head.as_chunks::<4>() else { return None };
        let sizes = || sizes.iter().map(|size| u64::from(u32::from_le_bytes(*size)));
        let length = self.record_length as u64 + head_length + sizes().sum::<u64>();
        let filled = sizes().filter(|size| *size > 0).count() as u64;
        let points = u64::from(u32::from_le_bytes(points));
        (offset + length <= end).then_some(LayeredChunk { points, length, filled })
    }

    /// Whether it is known where the chunks start, which nothing says where points are decoded in one go.
    pub fn has_known_chunks(&self) -> bool {
        self.restart_after.is_none()
    }

    /// Reads the first record of a chunk, which is not compressed. False if there is no such chunk: one whose head says that
    /// it has fewer points is another one.
    pub fn first_record(&self, file: &Bytes, chunk: &CompressedChunk, record: &mut [u8]) -> bool {
        let end = chunk.offset.saturating_add(chunk.length).min(file.length());
        let is_there = chunk.offset.checked_add(record.len() as u64).is_some_and(|record_end| record_end <= end);
        let has_points =
            || self.layered_chunk(file, chunk.offset, end).is_some_and(|found| found.points >= chunk.points);
        is_there
            && (self.layers.is_none() || has_points())
            && file.read_at(chunk.offset, record).is_ok_and(|read| read == record.len())
    }

    /// The number of points that the head of a layered chunk tells; `None` if it is no such chunk.
    pub fn told_points(&self, file: &Bytes, chunk: &CompressedChunk) -> Option<u64> {
        let end = chunk.offset.checked_add(chunk.length)?.min(file.length());
        self.layered_chunk(file, chunk.offset, end).map(|found| found.points)
    }

    /// A layered chunk cut down to the beginnings of the layers with the colours, as a file of its own: about as much as
    /// the first `points` points take. Decoding ends with an error where they take more. `None` if there is no such chunk.
    pub fn beginning_of_colors(&self, file: &Bytes, chunk: &CompressedChunk, points: u64) -> Option<Bytes> {
        let end = chunk.offset.checked_add(chunk.length)?.min(file.length());
        let LayeredChunk { points: all, .. } = self.layered_chunk(file, chunk.offset, end)?;
        let mut bytes = vec![0; self.record_length + 4 + 4 * self.layers? as usize];
        let mut at = chunk.offset + bytes.len() as u64;
        file.read_at(chunk.offset, &mut bytes).ok()?;
        let kept = items::layers_of_colors(self.vlr.items())?;
        for layer in 0..self.layers? {
            let place = self.record_length + 4 + 4 * layer as usize;
            let size = u64::from(u32::from_le_bytes(*bytes[place..].first_chunk()?));
            // Half as much again as the average of the chunk, and what the coder holds.
            let share = (size as f64 * points as f64 / all.max(1) as f64 * 1.5) as u64 + BEGINNING;
            let wanted = if kept.contains(&layer) { size.min(share) } else { 0 };
            bytes[place..place + 4].copy_from_slice(&(wanted as u32).to_le_bytes());
            let start = bytes.len();
            bytes.resize(start + wanted as usize, 0);
            file.read_at(at, &mut bytes[start..]).ok()?;
            at += size;
        }
        Some(Bytes::of_memory(file.path(), bytes))
    }

    /// Starts decoding `chunk`; of a layered one only `layers`.
    pub fn stream<'a>(
        &'a self,
        file: &'a Bytes,
        chunk: &CompressedChunk,
        layers: DecompressionSelection,
    ) -> std::result::Result<Stream<'a>, String> {
        let end = (chunk.offset + chunk.length).min(file.length());
        file.fetch(chunk.offset, end.saturating_sub(chunk.offset)).map_err(|error| error.to_string())?;
        let mut points = chunk.points;
        // `laz` allocates according to the layer sizes, so they must fit the chunk.
        if self.layers.is_some() {
            let Some(found) = self.layered_chunk(file, chunk.offset, end) else {
                // A file that has been written to since it was opened is not read any further; that is then the reason.
                file.check_same().map_err(|error| error.to_string())?;
                return Err("the chunk's layers are longer than the chunk, or the file is cut short".into());
            };
            self.check_memory(layers, Some(found.filled))?;
            points = points.min(found.points);
        }
        let section = file.section(chunk.offset, end);
        let source = if points == 1 {
            RecordSource::First(section)
        } else {
            let source = BufReader::with_capacity(READ_AHEAD, section);
            let decoder = guarded(|| items::decoder(self.vlr.items(), self.layers.is_some(), source, layers))??;
            RecordSource::Decoder(decoder)
        };
        Ok(Stream { compressed: self, source, left: points, decoded: 0 })
    }
}

/// Records decoded from one compressed chunk.
pub struct Stream<'a> {
    compressed: &'a Compressed,
    source: RecordSource<'a>,
    left: u64,
    decoded: u64,
}

/// Where records come from.
enum RecordSource<'a> {
    /// The first record of a chunk is not compressed. If it is the only one, no decoder is set up, which would take as
    /// long as a thousand points: files may have a chunk for every point.
    First(Section<'a>),
    Decoder(items::Decoder<'a, BufReader<Section<'a>>>),
}

impl Stream<'_> {
    /// The number of records that are left, according to the file.
    pub fn left(&self) -> u64 {
        self.left
    }

    /// Fills `records` with the next records. If there are fewer, it returns the reason too; the stream has then ended.
    pub fn decode(&mut self, records: &mut [u8]) -> (usize, std::result::Result<(), String>) {
        let length = self.compressed.record_length;
        let mut decoded = 0;
        let decoder = match &mut self.source {
            RecordSource::First(section) => {
                let Some(record) = records.get_mut(..length).filter(|_| self.left > 0) else { return (0, Ok(())) };
                if let Err(error) = section.read_exact(record) {
                    return (0, Err(error.to_string()));
                }
                self.left -= 1;
                return (1, Ok(()));
            }
            RecordSource::Decoder(decoder) => decoder,
        };
        let outcome = guarded(|| {
            for record in records.chunks_exact_mut(length) {
                if let Some(points) = self.compressed.restart_after
                    && self.decoded > 0
                    && self.decoded.is_multiple_of(points)
                {
                    decoder.restart(self.compressed.vlr.items())?;
                }
                decoder.decode_next(record).map_err(|error| error.to_string())?;
                self.decoded += 1;
                decoded += 1;
            }
            Ok(())
        });
        self.left = self.left.saturating_sub(decoded as u64);
        (decoded, outcome.and_then(|result| result))
    }
}

/// The compressor's number, the first field of the record (`LazVlr` has read it, but keeps it private).
fn laszip_kind(record: &[u8]) -> u16 {
    record.first_chunk().map_or(0, |&bytes| u16::from_le_bytes(bytes))
}

/// The chunk table, if the file has one that fits it.
fn read_table(file: &Bytes, header: &Header, vlr: &LazVlr) -> std::io::Result<Option<ChunkTable>> {
    let points_start = header.data_start + TABLE_OFFSET_LENGTH;
    let believable =
        |offset: &u64| *offset >= points_start && offset.checked_add(8).is_some_and(|end| end <= file.length());
    let offset_at = |position: u64| file.bytes_at(position).map(|bytes| bytes.map(u64::from_le_bytes));
    // A writer that could not seek back leaves the offset in the last eight bytes of the file.
    let offset = match offset_at(header.data_start)?.filter(believable) {
        Some(offset) => Some(offset),
        None => offset_at(file.length().saturating_sub(8))?.filter(believable),
    };
    let Some(offset) = offset else { return Ok(None) };
    // The version, then the number of chunks. Each chunk starts with an uncompressed record, which bounds their number.
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
