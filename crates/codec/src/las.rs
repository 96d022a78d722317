//! Reads LAS and LAZ: LAS 1.0 to 1.4 (ASPRS LAS 1.4 R15), point formats 0 to 10, LASzip compression. COPC is read as
//! plain LAZ, or node by node (`copc`).
//!
//! A file is a list of blocks, each of which becomes one chunk or a few: runs of records in LAS, compressed chunks in
//! LAZ. Positioned reads fetch the blocks, and all cores decode them straight to columns, in an order that spreads over
//! the file, so that the first chunks show its whole extent.

mod again;
mod byte_colors;
mod color_sample;
pub mod column_records;
mod columns;
mod compressed;
mod copc;
pub mod copc_writer;
mod extra_layers;
mod first_points;
mod gps_times;
mod header;
mod items;
mod layout;
mod node_pages;
mod output_head;
pub mod output_records;
pub mod plain_writer;
mod point_layers;
mod record_columns;
pub mod record_export;
pub mod systems;
mod whole_records;

use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use cloud::{Bounds, CHUNK_POINTS, Chunk, Column, Grid, Progress};
use laz::DecompressionSelection;
use rayon::iter::{IndexedParallelIterator as _, IntoParallelIterator as _, ParallelIterator as _};

use crate::bytes::Bytes;
use crate::error::AS_BEFORE;
use crate::{Error, Format, Info, Result, Selection, Summary};
use again::place_of;
use columns::{ChunkBuilder, ColorDepth, ReadPlan, TILE_RECORDS};
use compressed::{Compressed, CompressedChunk};
pub use copc::{Copc, CopcNode, DEEPEST, Key};
use header::Header;
use layout::{Layout, Reading, bytes};
pub use node_pages::{CopcPage, PageNodes, is_below, most_nodes};

/// The most bytes of records that a thread holds at once: whole chunks of records up to 256 bytes.
const BLOCK_BYTES: usize = 16 << 20;
/// The most bytes of records that a thread decodes at once: more than the longest record.
const TILE_BYTES: usize = 1 << 20;

/// Whether a LAS file says that it is COPC.
pub fn is_copc(file: &Bytes) -> bool {
    copc::is_claimed(file)
}

pub struct LasSource {
    pub(crate) info: Info,
    file: Arc<Bytes>,
    layout: Layout,
    grid: Grid,
    data_start: u64,
    compressed: Option<Compressed>,
    blocks: Vec<Block>,
    /// The range of the colours; `None` for a file without colours, or with nothing but black.
    colors: Option<ColorDepth>,
    copc: Option<Copc>,
    /// The file with all its compressed chunks, once it is read from end to end, if the list of its nodes is read page by
    /// page; or why it cannot be read so.
    whole: OnceLock<std::result::Result<Box<LasSource>, String>>,
    memory: u64,
    /// The Extra Bytes descriptors, one after the other.
    descriptors: Vec<u8>,
    /// Major, minor.
    version: (u8, u8),
    global_encoding: u16,
    /// Whether GPS time is standard time instead of seconds of a week.
    standard_time: bool,
    /// For each variable length record, whether it is extended, and its bytes in the file, head included.
    records: Vec<(bool, Range<u64>)>,
}

/// The input of one task.
struct Block {
    first_point: u64,
    points: u64,
    /// For LAZ, the compressed chunks of the block.
    chunks: Range<usize>,
    /// The number of points per emitted chunk.
    piece: usize,
}

/// Collects the results of the tasks of one read.
struct Tally<'a> {
    progress: &'a Progress,
    emit: &'a (dyn Fn(Chunk) + Sync),
    total: Mutex<Total>,
}

struct Total {
    points: u64,
    bounds: Bounds,
    /// The failure nearest to the start of the file: its point and the reason.
    failure: Option<(u64, String)>,
}

impl Tally<'_> {
    fn deliver(&self, builder: ChunkBuilder<'_>) {
        let (chunk, points, bounds) = builder.finish();
        if points == 0 {
            return;
        }
        {
            let mut total = self.total.lock().unwrap_or_else(PoisonError::into_inner);
            total.points += points;
            total.bounds = total.bounds.union(bounds);
        }
        self.progress.add(points);
        (self.emit)(chunk);
    }

    fn fail(&self, point: u64, reason: String) {
        let mut total = self.total.lock().unwrap_or_else(PoisonError::into_inner);
        if total.failure.as_ref().is_none_or(|(first, _)| point < *first) {
            total.failure = Some((point, reason));
        }
    }
}

impl LasSource {
    /// `memory` bounds what decoders of compressed points take, in bytes.
    pub fn open(file: Bytes, memory: u64) -> Result<Self> {
        Self::open_shared(Arc::new(file), memory, None, false)
    }

    /// Opens a file that is read whole, and whose colours have the range of those of `model`, if there is one: a tile of a
    /// cloud.
    pub fn open_like(file: Bytes, memory: u64, model: Option<&Self>) -> Result<Self> {
        Self::open_shared(Arc::new(file), memory, model, true)
    }

    /// `is_whole` says that all points will be read, so that the compressed chunks are found rather than the nodes.
    fn open_shared(file: Arc<Bytes>, memory: u64, model: Option<&Self>, is_whole: bool) -> Result<Self> {
        let (source, is_doubtful) = Self::open_once(file.clone(), memory, model, is_whole)?;
        if !(is_doubtful && file.fetch_again(0..file.length())) {
            return Ok(source);
        }
        let (mut source, is_as_before) = Self::open_once(file, memory, model, is_whole)?;
        source.info.warnings.last_mut().filter(|_| is_as_before).into_iter().for_each(|told| told.push_str(AS_BEFORE));
        Ok(source)
    }

    /// Opens a file, and says whether the lists of its points look as if they were damaged on their way from a server.
    fn open_once(file: Arc<Bytes>, memory: u64, model: Option<&Self>, is_whole: bool) -> Result<(Self, bool)> {
        let mut warnings = Vec::new();
        let header = Header::read(&file, &mut warnings)?;
        let layout = Layout::new(header.point_format, header.record_length, &header.descriptors, &mut warnings);
        let of_header = warnings.len();
        let (compressed, copc) = open_compressed(&file, &header, memory, is_whole, &mut warnings)?;
        let is_doubtful = warnings.len() > of_header && (header.copc_info.is_some() || file.is_short_remote());
        let (points, blocks) = match &compressed {
            Some(_) if copc.as_ref().is_some_and(|copc| !copc.further.is_empty()) => (header.points, Vec::new()),
            Some(compressed) => {
                (compressed.chunks.iter().map(|chunk| chunk.points).sum(), compressed_blocks(compressed))
            }
            None => {
                let points = plain_points(&file, &header, &mut warnings);
                (points, plain_blocks(points, header.record_length))
            }
        };
        if points < header.points {
            warnings.push(format!(
                "the header says {} points, the file has {points}: {} are missing (file cut short?)",
                header.points,
                header.points - points
            ));
        }
        let format = if header.compressed { Format::Laz } else { Format::Las };
        let info = Info {
            point_format: Some(header.point_format),
            points,
            missing: header.points.saturating_sub(points),
            bounds: header.bounds.filter(|_| points > 0),
            properties: layout.property_attributes(),
            attributes: layout.column_attributes(),
            grid: Some(header.grid),
            crs: header.crs,
            epsg: header.epsg,
            units: header.units,
            warnings,
            ..Info::of_rows(file.path(), format, format!("{}.{}", header.version.0, header.version.1))
        };
        let mut source = Self {
            info,
            file,
            layout,
            grid: header.grid,
            data_start: header.data_start,
            compressed,
            blocks,
            colors: None,
            copc,
            whole: OnceLock::new(),
            memory,
            descriptors: header.descriptors,
            version: header.version,
            global_encoding: header.global_encoding,
            standard_time: header.standard_time,
            records: header.records,
        };
        if let Some(model) = model {
            source.colors = model.colors.filter(|_| source.layout.red.is_some());
            source.info.has_colors = source.colors.is_some();
        } else if let Some(red) = source.layout.red
            && points > 0
        {
            let sample = source.color_sample(red)?;
            source.info.has_colors = !sample.is_black();
            if sample.is_black() {
                source.info.warnings.push("all colours are zero: shown as a cloud without colours".into());
            } else {
                let range = sample.of_integers();
                source.colors = Some(ColorDepth::of(range.full));
                source.info.warnings.extend(range.warning);
            }
        }
        Ok((source, is_doubtful))
    }

    pub fn info(&self) -> &Info {
        &self.info
    }

    pub fn bytes(&self) -> &Bytes {
        &self.file
    }

    /// Whether its colours have more than 8 bits.
    pub fn has_wide_colors(&self) -> bool {
        self.colors.is_some_and(|depth| depth != ColorDepth::Eight)
    }

    pub fn copc(&self) -> Option<&Copc> {
        self.copc.as_ref()
    }

    /// One page of the list of nodes.
    pub fn read_copc_page(&self, page: &CopcPage) -> Result<PageNodes> {
        let read = || {
            let fetched = self.file.fetch(page.place.start, page.place.end.saturating_sub(page.place.start));
            fetched.map_err(|error| Error::io(self.file.path(), error))?;
            let read = self.copc.as_ref().ok_or_else(|| "no list of nodes".to_owned());
            read.and_then(|copc| copc.read_page(&self.file, page)).map_err(|problem| {
                let (level, [x, y, z]) = (page.level, page.cell);
                Error::malformed(self.file.path(), format!("page {level}-{x}-{y}-{z} of the list of nodes"), problem)
            })
        };
        self.twice(page.place.clone(), read)
    }

    /// The file with all its compressed chunks, which a file whose list of nodes is read page by page has not before this.
    ///
    /// # Errors
    /// If they cannot be found.
    pub fn whole(&self) -> Result<&Self> {
        if self.copc.as_ref().is_none_or(|copc| copc.further.is_empty()) {
            return Ok(self);
        }
        let open = || {
            let opened = Self::open_shared(self.file.clone(), self.memory, Some(self), true);
            opened.map(Box::new).map_err(|error| error.to_string())
        };
        match self.whole.get_or_init(open) {
            Ok(whole) => Ok(whole),
            Err(problem) => Err(Error::unsuitable(self.file.path(), format!("it cannot be read whole: {problem}"))),
        }
    }

    fn plan(&self, selection: &Selection) -> (ReadPlan<'_>, DecompressionSelection) {
        let mut attributes = selection.attributes.clone();
        attributes.resize(self.layout.attributes.len(), false);
        let plan = ReadPlan {
            layout: &self.layout,
            grid: self.grid,
            positions: selection.positions,
            colors: self.colors.filter(|_| selection.colors),
            attributes,
        };
        let layers = self.layout.layers(plan.positions, plan.colors.is_some(), &plan.attributes);
        (plan, layers)
    }

    pub fn read_copc_node(&self, node: &CopcNode, selection: &Selection) -> Result<Chunk> {
        let (plan, layers) = self.plan(selection);
        let Some((compressed, chunk)) = self.compressed.as_ref().zip(node.chunk()) else {
            return Ok(ChunkBuilder::new(&plan, 0, 0).finish().0);
        };
        self.twice(place_of(&[chunk]), || {
            let read = self.read_chunks(compressed, &[chunk], &plan, layers)?;
            // The bytes are there by now.
            match compressed.told_points(&self.file, &chunk) {
                Some(points) if points != chunk.points => {
                    let place = format!("byte {}", chunk.offset);
                    let problem = format!("{points} points, the list of nodes says {}", chunk.points);
                    Err(Error::malformed(self.file.path(), place, problem))
                }
                _ => Ok(read),
            }
        })
    }

    /// Brings a compressed chunk that is about to be read.
    fn fetch(&self, chunk: &CompressedChunk) -> Result<()> {
        self.file.fetch(chunk.offset, chunk.length).map_err(|error| Error::io(self.file.path(), error))
    }

    /// All points of a compressed file in one chunk.
    ///
    /// # Errors
    /// If some of them cannot be read, or are not compressed.
    pub fn read_whole(&self, selection: &Selection) -> Result<Chunk> {
        let Some(compressed) = &self.compressed else {
            return Err(Error::unsuitable(self.file.path(), "its points are not compressed"));
        };
        let (plan, layers) = self.plan(selection);
        self.twice(place_of(&compressed.chunks), || self.read_chunks(compressed, &compressed.chunks, &plan, layers))
    }

    /// The points of some compressed chunks, which follow one another, in one chunk.
    fn read_chunks(
        &self,
        compressed: &Compressed,
        chunks: &[CompressedChunk],
        plan: &ReadPlan<'_>,
        layers: DecompressionSelection,
    ) -> Result<Chunk> {
        let malformed =
            |point: u64, problem: String| Error::malformed(self.file.path(), format!("record {point}"), problem);
        let first_point = chunks.first().map_or(0, |chunk| chunk.first_point);
        let points: u64 = chunks.iter().map(|chunk| chunk.points).sum();
        // A chunk may claim any number of points, so vectors grow as points arrive.
        let mut builder = ChunkBuilder::new(plan, first_point, points.min(CHUNK_POINTS as u64) as usize);
        let length = self.layout.record_length;
        let mut buffer = vec![0; tile_records(length) * length];
        for chunk in chunks {
            self.fetch(chunk)?;
            let mut stream = compressed
                .stream(&self.file, chunk, layers)
                .map_err(|problem| malformed(chunk.first_point, problem))?;
            while stream.left() > 0 {
                let wanted = stream.left().min(tile_records(length) as u64) as usize;
                let (decoded, outcome) = stream.decode(&mut buffer[..wanted * length]);
                builder.push(&buffer[..decoded * length]);
                outcome.map_err(|problem| malformed(builder.next_point(), problem))?;
            }
        }
        if builder.len() as u64 != points {
            return Err(malformed(builder.next_point(), "the node holds fewer points than announced".into()));
        }
        Ok(builder.finish().0)
    }

    pub fn read(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        self.whole()?.read_blocks(selection, progress, emit)
    }

    fn read_blocks(
        &self,
        selection: &Selection,
        progress: &Progress,
        emit: &(dyn Fn(Chunk) + Sync),
    ) -> Result<Summary> {
        let (plan, layers) = self.plan(selection);
        let total = Mutex::new(Total { points: 0, bounds: Bounds::EMPTY, failure: None });
        let tally = Tally { progress, emit, total };
        progress.set_total(self.info.points);
        self.for_each_block(layers, |buffer, block| match &self.compressed {
            _ if progress.is_cancelled() => {}
            None => self.read_plain(block, &plan, buffer, &tally),
            Some(compressed) => self.read_compressed(compressed, block, &plan, layers, buffer, &tally),
        });

        let Total { points, bounds, failure } = tally.total.into_inner().unwrap_or_else(PoisonError::into_inner);
        let cancelled = progress.is_cancelled() && points < self.info.points;
        let mut warnings = Vec::new();
        match failure {
            Some((point, reason)) if points == 0 => {
                return Err(Error::malformed(self.file.path(), format!("record {point}"), reason));
            }
            Some((point, reason)) => {
                let missing = match self.info.points.saturating_sub(points) {
                    0 => "some".to_owned(),
                    missing => missing.to_string(),
                };
                warnings.push(format!("record {point}: {reason}; {missing} points are missing, {points} were read"));
            }
            None => {}
        }
        Ok(Summary { points, missing: 0, bounds: (!bounds.is_empty()).then_some(bounds), warnings, cancelled })
    }

    /// Calls `work` with every block and a buffer that each thread reuses. Runs on all threads, but on no more than
    /// there is memory for decoders of `layers`.
    fn for_each_block(&self, layers: DecompressionSelection, work: impl Fn(&mut Vec<u8>, &Block) + Sync) {
        let most = self.compressed.as_ref().map_or(usize::MAX, |compressed| compressed.decoders(layers));
        // Threads take blocks one by one and in this order, so that early chunks spread over the file.
        let waiting = Mutex::new(spread(self.blocks.len()));
        let next = || waiting.lock().unwrap_or_else(PoisonError::into_inner).next();
        (0..most.min(rayon::current_num_threads())).into_par_iter().with_max_len(1).for_each(|_| {
            let mut buffer = Vec::new();
            while let Some(index) = next() {
                work(&mut buffer, &self.blocks[index]);
            }
        });
    }

    fn read_plain(&self, block: &Block, plan: &ReadPlan<'_>, buffer: &mut Vec<u8>, tally: &Tally<'_>) {
        let length = self.layout.record_length;
        let offset = self.data_start + block.first_point * length as u64;
        // A block is at most BLOCK_BYTES and lies within the file.
        let wanted = block.points as usize * length;
        if buffer.len() < wanted {
            buffer.resize(wanted, 0);
        }
        let read = match self.file.read_at(offset, &mut buffer[..wanted]) {
            Ok(read) => read,
            Err(error) => return tally.fail(block.first_point, error.to_string()),
        };
        let records = read / length;
        let mut builder = ChunkBuilder::new(plan, block.first_point, records);
        builder.push(&buffer[..records * length]);
        tally.deliver(builder);
        if read < wanted {
            tally.fail(block.first_point + records as u64, "the file has become shorter since it was opened".into());
        }
    }

    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        let place = || format!("record {point}");
        let malformed = |problem: String| Error::malformed(self.file.path(), place(), problem);
        if point >= self.info.points {
            return Err(malformed(format!("the file has {} points, counted from 0", self.info.points)));
        }
        let length = self.layout.record_length;
        let mut record = vec![0; length];
        match &self.compressed {
            None => {
                let offset = self.data_start + point * length as u64;
                let read =
                    self.file.read_at(offset, &mut record).map_err(|error| Error::io(self.file.path(), error))?;
                if read < length {
                    return Err(malformed("the file has become shorter since it was opened".into()));
                }
            }
            Some(compressed) => {
                let compressed = self.whole()?.compressed.as_ref().unwrap_or(compressed);
                let chunk = chunk_of(&compressed.chunks, point)
                    .ok_or_else(|| malformed("in no compressed chunk of the file".into()))?;
                let mut stream =
                    compressed.stream(&self.file, chunk, DecompressionSelection::all()).map_err(malformed)?;
                if stream.left() <= point - chunk.first_point {
                    return Err(malformed("its compressed chunk holds fewer points than announced".into()));
                }
                for _ in chunk.first_point..=point {
                    stream.decode(&mut record).1.map_err(malformed)?;
                }
            }
        }
        Ok(self
            .layout
            .properties
            .iter()
            .map(|property| (property.name.clone(), self.text(&property.reading, &record)))
            .collect())
    }

    /// One value of one record as a person reads it.
    fn text(&self, reading: &Reading, record: &[u8]) -> String {
        match *reading {
            Reading::Coordinate { axis } => {
                let raw = i32::from_le_bytes(bytes(record, axis * 4));
                coordinate_text(raw, self.grid.scale[axis], self.grid.offset[axis])
            }
            Reading::Opaque { at, length } => {
                let hexadecimal = record[at..at + length].iter().map(|byte| format!("{byte:02x}"));
                format!("0x{}", hexadecimal.collect::<String>())
            }
            // A float may round it.
            Reading::Sparse { at, file_type, no_data, scaling: None } if !no_data.is_at(record, at, file_type) => {
                self.text(&Reading::Value { at, file_type }, record)
            }
            _ => {
                let mut column = Column::with_capacity(reading.column_type(), 1);
                reading.append(&mut column, record, record.len(), &self.grid);
                column.text(0)
            }
        }
    }
}

/// The compressed part of a file, if it has one, and its octree, if it is COPC and that is usable. With a list of nodes that
/// is read page by page the compressed chunks are not known.
fn open_compressed(
    file: &Bytes,
    header: &Header,
    memory: u64,
    is_whole: bool,
    warnings: &mut Vec<String>,
) -> Result<(Option<Compressed>, Option<Copc>)> {
    if !header.compressed {
        return Ok((None, None));
    }
    let is_paged = !is_whole && Copc::is_paged(file, header, memory);
    let first = if is_paged { Copc::read(file, header, None, memory) } else { Ok(None) };
    if let Ok(Some(copc)) = first {
        return Ok((Some(Compressed::open(file, header, memory, true, warnings)?), Some(copc)));
    }
    let compressed = Compressed::open(file, header, memory, false, warnings)?;
    let copc = match first {
        Ok(_) if is_whole => Ok(None),
        Ok(_) => Copc::read(file, header, Some(&compressed.chunks), memory),
        Err(problem) => Err(problem),
    };
    let copc = copc.unwrap_or_else(|problem| {
        warnings.push(format!(
            "the COPC index is not usable: {problem}; read as plain LAZ (was it saved by a tool that does not know COPC?)"
        ));
        None
    });
    Ok((Some(compressed), copc))
}

/// The number of records of a LAS file: the header's count, less the records that the file is too short for.
fn plain_points(file: &Bytes, header: &Header, warnings: &mut Vec<String>) -> u64 {
    let present = (file.length() - header.data_start) / header.record_length as u64;
    if header.points == 0 && present > 0 && header.points_are_last {
        warnings.push(format!("the header says 0 points, but {present} records follow it (writer stopped?): read"));
        return present;
    }
    header.points.min(present)
}

fn plain_blocks(points: u64, record_length: usize) -> Vec<Block> {
    let piece = CHUNK_POINTS.min(BLOCK_BYTES / record_length);
    let block = |index: u64| {
        let first_point = index * piece as u64;
        Block { first_point, points: (points - first_point).min(piece as u64), chunks: 0..0, piece }
    };
    (0..points.div_ceil(piece as u64)).map(block).collect()
}

/// Blocks of a compressed file: tiny neighbouring chunks (COPC has many) share a block; a large one is emitted in equal
/// pieces.
fn compressed_blocks(compressed: &Compressed) -> Vec<Block> {
    /// A block of this size takes no further chunks: from here on drawing and normals cost little per chunk.
    const ENOUGH: u64 = CHUNK_POINTS as u64 / 4;
    let most = CHUNK_POINTS as u64;
    let mut blocks: Vec<Block> = Vec::new();
    for (index, chunk) in compressed.chunks.iter().enumerate() {
        match blocks.last_mut() {
            Some(block) if block.points < ENOUGH && chunk.points <= most - block.points => {
                block.points += chunk.points;
                block.chunks.end = index + 1;
            }
            _ => {
                let pieces = chunk.points.div_ceil(most).max(1);
                let piece = chunk.points.div_ceil(pieces) as usize;
                let chunks = index..index + 1;
                blocks.push(Block { first_point: chunk.first_point, points: chunk.points, chunks, piece });
            }
        }
    }
    for block in blocks.iter_mut().filter(|block| block.chunks.len() > 1) {
        block.piece = CHUNK_POINTS;
    }
    blocks
}

fn chunk_of(chunks: &[CompressedChunk], point: u64) -> Option<&CompressedChunk> {
    let after = chunks.partition_point(|chunk| chunk.first_point <= point);
    chunks[..after].last().filter(|chunk| point - chunk.first_point < chunk.points)
}

/// The number of records decoded per call of the decompressor; fewer where records are long.
fn tile_records(record_length: usize) -> usize {
    TILE_RECORDS.min(TILE_BYTES / record_length)
}

/// `0..count` in bit-reversed order: every prefix is spread evenly over the range.
fn spread(count: usize) -> impl Iterator<Item = usize> + Send {
    let bits = count.next_power_of_two().trailing_zeros();
    let reversed = move |index: usize| if bits == 0 { index } else { index.reverse_bits() >> (usize::BITS - bits) };
    (0..count.next_power_of_two()).map(reversed).filter(move |&index| index < count)
}

/// The number of decimals that write each coordinate on a grid in full.
pub fn coordinate_decimals(grid: &Grid) -> [usize; 3] {
    [0, 1, 2].map(|axis| decimals(grid.scale[axis]).max(decimals(grid.offset[axis])))
}

/// A coordinate with all decimals that the scale and the offset give it. Zeros beyond those of the scale come from the
/// offset, and say nothing.
fn coordinate_text(raw: i32, scale: f64, offset: f64) -> String {
    let (own, all) = (decimals(scale), decimals(scale).max(decimals(offset)));
    let text = format!("{:.all$}", f64::from(raw) * scale + offset);
    let zeros = text.len() - text.trim_end_matches('0').len();
    text[..text.len() - zeros.min(all - own)].trim_end_matches('.').to_owned()
}

/// The number of decimals that write `step` in full, up to 12 (a coordinate of seven digits has no more).
fn decimals(step: f64) -> usize {
    format!("{step}").split_once('.').map_or(0, |(_, decimals)| decimals.len()).min(12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_block_comes_once_and_the_first_ones_spread_over_the_file() {
        for count in [0, 1, 2, 3, 7, 64, 1000] {
            let mut order: Vec<usize> = spread(count).collect();
            if count == 1000 {
                assert!(order[..8].iter().any(|&index| index > 800) && order[..8].iter().any(|&index| index < 200));
                let mut first: Vec<usize> = order[..16].to_vec();
                first.sort_unstable();
                assert!(first.windows(2).all(|pair| pair[1] - pair[0] <= 128), "{first:?}");
            }
            order.sort_unstable();
            assert!(order.into_iter().eq(0..count), "{count}");
        }
    }

    #[test]
    fn zeros_that_only_the_offset_asks_for_are_not_written() {
        assert_eq!(coordinate_text(564_201, 0.0001, 0.0), "56.4201");
        assert_eq!(coordinate_text(5000, 0.01, 6.420_100_000_000_4), "56.4201");
        assert_eq!(coordinate_text(5000, 0.01, 0.123_456_789), "50.123456789");
        assert_eq!(coordinate_text(5000, 0.01, 0.0), "50.00", "those of the scale are");
        assert_eq!(coordinate_text(5, 10.0, 0.5), "50.5");
        assert_eq!(coordinate_text(5, 10.0, 0.000_000_000_000_4), "50");
    }

    #[test]
    fn coordinates_are_written_with_the_decimals_of_their_grid() {
        assert_eq!(decimals(0.01), 2);
        assert_eq!(decimals(0.000_25), 5);
        assert_eq!(decimals(1e-7), 7);
        assert_eq!(decimals(1.0), 0);
        assert_eq!(decimals(0.304_800_609_601_219_24), 12);
    }
}
