//! LAS and LAZ files to one COPC file (specification 1.0, copc.io), in bounded memory.
//!
//! 1. *Distribute*: every input is decoded once, its points become records of the file to write, and these go to buckets: cells
//!    of one level of the octree, in memory or a temporary file.
//! 2. *Build*: bucket by bucket, points are dealt to nodes (`tree`). Those that nodes above the buckets keep are put aside.
//! 3. *Write*: a node's records, by time, are compressed to a chunk of their own.

mod buckets;
mod file;
mod tree;

use std::collections::HashSet;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use cloud::{Bounds, Grid, Progress};
use glam::DVec3;
use laz::record::{LayeredPointRecordCompressor, RecordCompressor as _};
use laz::{LazVlr, LazVlrBuilder};
use rayon::iter::{
    IndexedParallelIterator as _, IntoParallelIterator as _, IntoParallelRefIterator as _, ParallelIterator as _,
};

use super::layout::bytes;
use super::output_records::{
    Statistics, Target, Upgrade, check_alike, check_items, common_grid, far_outside, leading, leave_out_waves,
    one_at_a_time, say_black, say_rounded_angles, time, upgrades, warn_of,
};
use super::systems::System;
use super::{Copc, LasSource};
use crate::brief::vector;
use crate::export::names::short_file_name;
use crate::export::words::Words;
use crate::{Error, Result, Selection, Source};
use buckets::{Buckets, Spill};
use file::CopcFile;
use tree::{Cube, Filled, Keyed};

/// The average number of points of a bucket, where there is enough memory.
const BUCKET_POINTS: u64 = 1_000_000;
/// The deepest level of the first buckets: a surface occupies some thousand of its cells.
const DEEPEST_BUCKETS: u32 = 5;
/// The number of levels by which a bucket that is too large is divided.
const DIVIDED_LEVELS: u32 = 3;
/// The least size in bytes of record lists that are built at once, however little memory there is.
const LEAST_BUCKET_BYTES: u64 = 8 << 20;

/// What was written.
#[derive(Clone, Debug, Default)]
pub struct CopcSummary {
    pub points: u64,
    /// The number of points of the inputs that could not be read.
    pub missing: u64,
    pub nodes: usize,
    /// What the file has otherwise than the inputs.
    pub changes: Vec<String>,
    /// What was wrong with the inputs.
    pub warnings: Vec<String>,
}

/// Writes the points of LAS and LAZ files to a COPC file, with all attributes of each point except wave packets.
///
/// Point formats 0 to 5 become 6 or 7. Coordinates are on the first file's grid, with the finest steps of any. The
/// other records of the first file are kept. `memory` bounds the bytes held at once, provided that the points of any
/// one place fit in it; temporary files lie in the folder of `output`. `output` is replaced when the new file is
/// complete; until then it is unchanged. `progress` counts each point when it is read and when it is written.
///
/// Returns `None` if it was cancelled; nothing is written then.
///
/// # Errors
/// Inputs that cannot be read or cannot be in one file; an output that is an input or cannot be written.
pub fn write_copc(inputs: &[PathBuf], output: &Path, memory: u64, progress: &Progress) -> Result<Option<CopcSummary>> {
    let sources = open(inputs, output, memory / 2)?;
    let sources = leading(&sources.iter().map(LasSource::whole).collect::<Result<Vec<_>>>()?);
    let mut words = Words::default();
    let plan = OutputFormat::new(&sources, memory / 2, &mut words)?;
    let mut warnings = Vec::new();
    warn_of(&sources, &mut warnings);
    let points: u64 = sources.iter().map(|source| source.info.points).sum();
    let before = progress.done();
    progress.set_total(before + 2 * points);

    let io = |error: io::Error| Error::not_written(output, error);
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let spill = Spill::new(folder, (memory / 4) as usize).map_err(io)?;
    let mut job =
        Job { plan, output, memory, progress, spill: &spill, cube: Cube::new(DVec3::ZERO, DVec3::ZERO, NO_GRID) };
    let mut bounds = header_bounds(&sources, progress)?;
    let level = bucket_level(points);
    let mut is_again = false;
    let (buckets, statistics) = loop {
        job.cube = Cube::new(bounds.min, bounds.max, job.plan.grid);
        let buckets = Buckets::new(&spill, 1 << (3 * level));
        let mut found = Vec::new();
        let Some(statistics) = job.distribute(&sources, level, &buckets, &mut found)? else { return Ok(None) };
        let true_bounds = statistics.bounds(job.plan.grid);
        if statistics.points == 0 {
            return Err(Error::unsuitable(output, "not written: the inputs have no points"));
        }
        if job.cube.holds(true_bounds.min) && job.cube.holds(true_bounds.max) {
            warnings.append(&mut found);
            break (buckets, statistics);
        }
        if is_again || !(true_bounds.max - true_bounds.min).is_finite() {
            return Err(Error::unsuitable(
                output,
                format!(
                    "not written: no cube holds coordinates from {} to {}",
                    vector(true_bounds.min),
                    vector(true_bounds.max)
                ),
            ));
        }
        is_again = true;
        // Some points are outside the headers' bounds: distribute once more with the true bounds.
        progress.set_total(before + 2 * points + statistics.points);
        bounds = true_bounds;
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    let file = builder
        .prefix(&format!(".{}.", short_file_name(&name)))
        .suffix(".unfinished")
        .tempfile_in(folder)
        .map_err(io)?;
    let mut writer = CopcFile::start(file, &job.plan, &sources).map_err(io)?;
    if !job.build(level, &buckets, &mut writer).map_err(io)? {
        return Ok(None);
    }
    let nodes = writer.nodes();
    let announced = sources.iter().map(|source| source.info.points.saturating_add(source.info.missing));
    let missing = announced.fold(0, u64::saturating_add).saturating_sub(statistics.points);
    let file = writer.finish(&job.plan, sources[0], &job.cube, &statistics).map_err(io)?;
    file.persist(output).map_err(|error| io(error.error))?;
    say_rounded_angles(&sources, &job.plan.upgrades, &mut words);
    Ok(Some(CopcSummary { points: statistics.points, missing, nodes, changes: words.lines(), warnings }))
}

const NO_GRID: Grid = Grid::new(DVec3::ONE, DVec3::ZERO);

fn open(inputs: &[PathBuf], output: &Path, memory: u64) -> Result<Vec<LasSource>> {
    let same = |input: &Path| match (input.canonicalize(), output.canonicalize()) {
        (Ok(input), Ok(output)) => input == output,
        _ => false,
    };
    if inputs.is_empty() {
        return Err(Error::unsuitable(output, "not written: there are no inputs"));
    }
    let open = |input: &PathBuf| match crate::open_within(input, memory)? {
        _ if same(input) => {
            Err(Error::unsuitable(output, "this is one of the inputs; choose another name for the output"))
        }
        Source::Las(source) => Ok(source),
        Source::Rows(_) | Source::Ept(_) => {
            Err(Error::unsuitable(input, "no LAS or LAZ file; `glint export FILE -o OUT.copc.laz` writes COPC of it"))
        }
    };
    inputs.iter().map(open).collect()
}

/// The bounds from the headers, or from the points where a header has none.
fn header_bounds(sources: &[&LasSource], progress: &Progress) -> Result<Bounds> {
    let mut bounds = Bounds::EMPTY;
    for source in sources.iter().filter(|source| source.info.points > 0) {
        let own = match source.info.bounds {
            Some(bounds) => Some(bounds),
            None => {
                let selection = Selection { positions: true, ..Selection::default() };
                let own = Progress::default();
                source
                    .read(&selection, &own, &|_| {
                        if progress.is_cancelled() {
                            own.cancel()
                        }
                    })?
                    .bounds
            }
        };
        bounds = bounds.union(own.unwrap_or(Bounds::EMPTY));
    }
    Ok(if bounds.is_empty() { Bounds { min: DVec3::ZERO, max: DVec3::ZERO } } else { bounds })
}

/// The level of the buckets for this many points: on a surface, four times as many cells are occupied one level further
/// down.
fn bucket_level(points: u64) -> u32 {
    (0..DEEPEST_BUCKETS).find(|level| points >> (2 * level) <= BUCKET_POINTS).unwrap_or(DEEPEST_BUCKETS)
}

/// The format of points in the file that is written.
struct OutputFormat {
    target: Target,
    grid: Grid,
    upgrades: Vec<Upgrade>,
    vlr: LazVlr,
    /// A lock for threads that compress one after the other because several at a time would take too much memory.
    turn: Option<Mutex<()>>,
    system: System,
    /// Whether GPS time is standard time; `None` if there is none.
    has_standard_time: Option<bool>,
}

impl OutputFormat {
    /// Chooses the format. `memory` bounds what compressing takes, in bytes.
    fn new(sources: &[&LasSource], memory: u64, words: &mut Words) -> Result<Self> {
        let first = sources[0];
        let has_standard_time = check_alike(sources, words)?;
        leave_out_waves(sources, "COPC cannot have wave packets", words);
        say_black(sources, "", words);
        let formats = sources.iter().filter_map(|source| source.info.point_format);
        let target = Target::new(formats, first.layout.record_length - first.base_length());
        let grid = common_grid(sources);
        let upgrades = upgrades(sources, target, grid, words);
        let items = check_items(&first.info.path, target, memory)?;
        let turn = one_at_a_time(&items, memory);
        let vlr = LazVlrBuilder::new(items).with_variable_chunk_size().build();
        let system = System::new(Some(first), target.format).map_err(|error| Error::io(&first.info.path, error))?;
        system.word.iter().for_each(|word| words.say(&first.info.path, word));
        Ok(Self { target, grid, upgrades, vlr, turn, system, has_standard_time })
    }
}

struct Job<'a> {
    plan: OutputFormat,
    output: &'a Path,
    memory: u64,
    progress: &'a Progress,
    spill: &'a Spill,
    cube: Cube,
}

impl Job<'_> {
    fn key(&self, record: &[u8]) -> u64 {
        self.cube.key([0, 4, 8].map(|at| i32::from_le_bytes(bytes(record, at))))
    }

    /// Puts the records of all inputs into `buckets`, cells of `level`; returns `None` if it was cancelled.
    fn distribute(
        &self,
        sources: &[&LasSource],
        level: u32,
        buckets: &Buckets<'_>,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Statistics>> {
        let total = Mutex::new(Statistics::default());
        for (source, upgrade) in sources.iter().zip(&self.plan.upgrades) {
            let emit = |records: &[u8]| -> io::Result<()> {
                let mut own = Statistics::default();
                let mut upgraded =
                    Vec::with_capacity(records.len() / upgrade.record_length * self.plan.target.record_length());
                for record in records.chunks_exact(upgrade.record_length) {
                    if !upgrade.push(record, &mut upgraded) {
                        return Err(far_outside());
                    }
                }
                let length = self.plan.target.record_length();
                upgraded.chunks_exact(length).for_each(|record| own.add(record, self.plan.target.format));
                self.deal(&upgraded, level, 0, buckets)?;
                total.lock().unwrap_or_else(PoisonError::into_inner).merge(&own);
                Ok(())
            };
            match source.read_records(self.progress, &emit).map_err(|error| Error::not_written(self.output, error))? {
                Some(mut found) => warnings.append(&mut found),
                None => return Ok(None),
            }
        }
        Ok(Some(total.into_inner().unwrap_or_else(PoisonError::into_inner)))
    }

    /// Appends records to the bucket of their cell of `level`; the first bucket has the code `first`.
    fn deal(&self, records: &[u8], level: u32, first: u64, buckets: &Buckets<'_>) -> io::Result<()> {
        let length = self.plan.target.record_length();
        let mut places: Vec<(u64, u32)> = (0_u32..)
            .zip(records.chunks_exact(length))
            .map(|(index, record)| (tree::code(self.key(record), level) - first, index))
            .collect();
        places.sort_unstable();
        let mut run = Vec::new();
        for bucket in places.chunk_by(|a, b| a.0 == b.0) {
            run.clear();
            bucket.iter().for_each(|place| run.extend_from_slice(record(records, place.1, length)));
            buckets.append(bucket[0].0 as usize, &run)?;
        }
        Ok(())
    }

    /// The bytes of records that each thread may build at once: they exist twice, with keys and compressed.
    fn most_bytes(&self) -> u64 {
        (self.memory / 6 / rayon::current_num_threads() as u64).max(LEAST_BUCKET_BYTES)
    }

    /// Writes the nodes of all buckets, cells of `level`, and those above; returns `false` if it was cancelled.
    fn build(&self, level: u32, buckets: &Buckets<'_>, file: &mut CopcFile) -> io::Result<bool> {
        let mut above = vec![Above { levels: 0..level, first: 0, lists: Buckets::new(self.spill, lists_of(level)) }];
        let occupied: Vec<usize> = (0..buckets.len()).filter(|bucket| buckets.bytes(*bucket) > 0).collect();
        for group in occupied.chunks(rayon::current_num_threads()) {
            if self.progress.is_cancelled() {
                return Ok(false);
            }
            let (small, large): (Vec<usize>, Vec<usize>) =
                group.iter().partition(|bucket| buckets.bytes(**bucket) <= self.most_bytes());
            let built = small.into_par_iter().map(|bucket| self.build_records(&buckets.take(bucket)?, level, None));
            for built in built.collect::<io::Result<Vec<Built>>>()? {
                self.write(&built, &above, file)?;
            }
            for bucket in large {
                if !self.build_large((buckets, bucket), level, bucket as u64, &mut above, &mut HashSet::new(), file)? {
                    return Ok(false);
                }
            }
        }
        above.pop().map_or(Ok(true), |above| self.write_above(&above, file))
    }

    /// Builds a list of records of one cell of `level`, part by part if it is too large for memory; returns `false` if
    /// it was cancelled.
    fn build_large<'a>(
        &'a self,
        (buckets, bucket): (&Buckets<'_>, usize),
        level: u32,
        code: u64,
        above: &mut Vec<Above<'a>>,
        claimed: &mut HashSet<(u32, u64)>,
        file: &mut CopcFile,
    ) -> io::Result<bool> {
        let below = level + DIVIDED_LEVELS;
        // Cells are divided no further than keys go: points at one place are then one node, however many they are.
        if buckets.bytes(bucket) <= self.most_bytes() || below + tree::CELL_LEVELS > tree::KEY_LEVELS {
            let built = self.build_records(&buckets.take(bucket)?, level, Some(claimed))?;
            self.write(&built, above, file)?;
            return Ok(!self.progress.is_cancelled());
        }
        let first = code << (3 * DIVIDED_LEVELS);
        let parts = Buckets::new(self.spill, 1 << (3 * DIVIDED_LEVELS));
        buckets.drain(bucket, |records| self.deal(records, below, first, &parts))?;
        let lists = Buckets::new(self.spill, lists_of(DIVIDED_LEVELS));
        above.push(Above { levels: level..below, first: code, lists });
        for part in (0..parts.len()).filter(|part| parts.bytes(*part) > 0) {
            if !self.build_large((&parts, part), below, first + part as u64, above, claimed, file)? {
                return Ok(false);
            }
        }
        above.pop().map_or(Ok(true), |above| self.write_above(&above, file))
    }

    /// Builds the nodes of records of one cell of `level`. Nodes above get none of the cells in `claimed`; the cells
    /// that they get are added to it.
    fn build_records(
        &self,
        records: &[u8],
        level: u32,
        mut claimed: Option<&mut HashSet<(u32, u64)>>,
    ) -> io::Result<Built> {
        let length = self.plan.target.record_length();
        let mut points = self.sorted(records);
        let first_key = points.first().map_or(0, |point| point.0);
        let above = (0..level).map(|above| {
            let cells = above + tree::CELL_LEVELS;
            let taken = tree::take(&mut points, cells, |code| match &mut claimed {
                // A cell that is no larger than that of the records is in no other list.
                Some(claimed) if cells < level => claimed.insert((cells, code)),
                _ => true,
            });
            taken.iter().flat_map(|point| record(records, point.1, length)).copied().collect()
        });
        let above: Vec<Vec<u8>> = above.collect();
        let mut nodes = Vec::new();
        tree::fill(points, level, &mut nodes);
        let nodes = nodes.into_par_iter().map(|node| self.compress(&node, records)).collect::<io::Result<_>>()?;
        Ok(Built { nodes, above, first_key })
    }

    /// The sorted keys of records; the records' bytes decide among equal keys, so that the file is the same each time.
    fn sorted(&self, records: &[u8]) -> Vec<Keyed> {
        let length = self.plan.target.record_length();
        let keyed = (0_u32..).zip(records.chunks_exact(length)).map(|(index, record)| (self.key(record), index));
        let mut points: Vec<Keyed> = keyed.collect();
        points.sort_unstable_by(|a, b| {
            a.0.cmp(&b.0).then_with(|| record(records, a.1, length).cmp(record(records, b.1, length)))
        });
        points
    }

    /// Compresses a node's chunk, sorted by time as scanners write it: such neighbours have most in common.
    fn compress(&self, node: &Filled, records: &[u8]) -> io::Result<Compressed> {
        let length = self.plan.target.record_length();
        if node.points.len() > Copc::MOST_POINTS as usize {
            return Err(io::Error::other(format!("more than {} points lie at one place", Copc::MOST_POINTS)));
        }
        let mut order: Vec<u32> = node.points.iter().map(|point| point.1).collect();
        let scanned = |index: u32| {
            let record = record(records, index, length);
            (time(record), record[14])
        };
        order.sort_by(|a, b| {
            let (a, b) = (scanned(*a), scanned(*b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        });
        let _turn = self.plan.turn.as_ref().map(|turn| turn.lock().unwrap_or_else(PoisonError::into_inner));
        let mut compressor = LayeredPointRecordCompressor::new(Vec::new());
        compressor.set_fields_from(self.plan.vlr.items()).map_err(io::Error::other)?;
        for index in order {
            compressor.compress_next(record(records, index, length))?;
        }
        compressor.done()?;
        let points = node.points.len() as u32;
        Ok(Compressed { level: node.level, code: node.code, points, chunk: compressor.into_inner() })
    }

    fn write(&self, built: &Built, above: &[Above<'_>], file: &mut CopcFile) -> io::Result<()> {
        for (level, records) in (0_u32..).zip(&built.above).filter(|(_, records)| !records.is_empty()) {
            let code = tree::code(built.first_key, level);
            if let Some(above) = above.iter().find(|above| above.levels.contains(&level)) {
                above.lists.append(above.list(level, code), records)?;
            }
        }
        built.nodes.iter().try_for_each(|node| self.write_node(node, file))
    }

    fn write_above(&self, above: &Above<'_>, file: &mut CopcFile) -> io::Result<bool> {
        for level in above.levels.clone() {
            let depth = level - above.levels.start;
            let first = above.first << (3 * depth);
            let codes =
                (first..first + (1 << (3 * depth))).filter(|code| above.lists.bytes(above.list(level, *code)) > 0);
            for codes in codes.collect::<Vec<u64>>().chunks(rayon::current_num_threads()) {
                if self.progress.is_cancelled() {
                    return Ok(false);
                }
                let compress = |code: &u64| {
                    let records = above.lists.take(above.list(level, *code))?;
                    self.compress(&Filled { level, code: *code, points: self.sorted(&records) }, &records)
                };
                let nodes = codes.par_iter().with_max_len(1).map(compress).collect::<io::Result<Vec<Compressed>>>()?;
                nodes.iter().try_for_each(|node| self.write_node(node, file))?;
            }
        }
        Ok(true)
    }

    fn write_node(&self, node: &Compressed, file: &mut CopcFile) -> io::Result<()> {
        self.progress.add(u64::from(node.points));
        file.push(node)
    }
}

/// The records of the nodes above buckets, which come in parts.
struct Above<'a> {
    levels: Range<u32>,
    /// The code of the one node of the first level.
    first: u64,
    lists: Buckets<'a>,
}

impl Above<'_> {
    /// The index of a node's list; lists are sorted by level.
    fn list(&self, level: u32, code: u64) -> usize {
        let depth = level - self.levels.start;
        lists_of(depth) + (code - (self.first << (3 * depth))) as usize
    }
}

/// The number of nodes of an octree with this many levels.
fn lists_of(levels: u32) -> usize {
    ((1 << (3 * levels)) - 1) / 7
}

fn record(records: &[u8], index: u32, length: usize) -> &[u8] {
    &records[index as usize * length..][..length]
}

/// The result of building a list of records: nodes, and records for the nodes above, by level.
struct Built {
    nodes: Vec<Compressed>,
    above: Vec<Vec<u8>>,
    first_key: u64,
}

/// A node in the form in which it is written.
struct Compressed {
    level: u32,
    code: u64,
    points: u32,
    chunk: Vec<u8>,
}
