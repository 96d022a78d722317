//! Passes whole records of a file on, some thousand at once: to files that are written of them.

use std::collections::BTreeMap;
use std::io;
use std::sync::{Mutex, PoisonError};

use cloud::{ChunkTest, CloudLayout, Placement, PointTest, Progress, ShownPoints};
use laz::DecompressionSelection;
use param::shown;

use super::columns::{ChunkBuilder, ReadPlan};
use super::{Block, LasSource, tile_records};
use crate::in_order::InOrder;

/// The number of tiles of records that are passed on at once.
const PIECE_TILES: usize = 16;

/// For each problem, the first point where it occurs and how often it occurs.
#[derive(Default)]
struct Failures(Mutex<BTreeMap<String, (u64, u64)>>);

impl Failures {
    fn add(&self, point: u64, problem: String) {
        let mut failures = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (first, count) = failures.entry(problem).or_insert((point, 0));
        (*first, *count) = (point.min(*first), *count + 1);
    }

    fn described(self, source: &LasSource) -> Vec<String> {
        let path = shown(&source.info.path);
        let describe = |(problem, (point, count)): (String, (u64, u64))| match count {
            1 => format!("{path}: record {point}: {problem}"),
            _ => format!("{path}: {count} times, first at record {point}: {problem}"),
        };
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().map(describe).collect()
    }
}

/// Decides which records of a file are shown.
pub struct RecordTest<'a> {
    plan: ReadPlan<'a>,
    test: ChunkTest,
    placement: Option<Placement>,
}

impl RecordTest<'_> {
    pub fn shown(&self, records: &[u8]) -> ShownPoints {
        let mut builder = ChunkBuilder::new(&self.plan, 0, records.len() / self.plan.layout.record_length);
        builder.push(records);
        let (chunk, _, bounds) = builder.finish();
        let Some(placement) = &self.placement else { return self.test.shown(&chunk, bounds) };
        let chunk = chunk.placed(placement, Some(self.plan.grid));
        self.test.shown(&chunk, chunk.bounds())
    }
}

impl LasSource {
    /// The test of this file's records; `None` if all are shown.
    pub fn record_test(&self, test: &PointTest) -> Option<RecordTest<'_>> {
        if test.shows_all() {
            return None;
        }
        let layout = CloudLayout { attributes: self.info.attributes.clone(), grid: self.info.grid };
        let attributes = test.reads(&layout.attributes);
        let plan = ReadPlan { layout: &self.layout, grid: self.grid, positions: true, colors: None, attributes };
        Some(RecordTest { plan, test: test.of(&layout), placement: self.info.placement })
    }

    /// Passes whole records to `emit`, from worker threads, some thousand at once. Returns `None` if it was cancelled,
    /// else what could not be read.
    ///
    /// # Errors
    /// What `emit` returned.
    pub fn read_records(
        &self,
        progress: &Progress,
        emit: &(dyn Fn(&[u8]) -> io::Result<()> + Sync),
    ) -> io::Result<Option<Vec<String>>> {
        let failures = Failures::default();
        let failed: Mutex<Option<io::Error>> = Mutex::new(None);
        let locked = |error: io::Error| *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        let stopped = || progress.is_cancelled() || failed.lock().unwrap_or_else(PoisonError::into_inner).is_some();
        self.for_each_block(DecompressionSelection::all(), |buffer, block| {
            if stopped() {
                return;
            }
            let mut give = |_: u64, records: &[u8]| match emit(records) {
                Ok(()) => progress.add((records.len() / self.layout.record_length) as u64),
                Err(error) => locked(error),
            };
            self.read_block(block, buffer, &stopped, &mut give, &failures);
        });
        if let Some(error) = failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        Ok((!progress.is_cancelled()).then(|| failures.described(self)))
    }

    /// Passes whole records, and the index of the first of them, to `rows_of`, from several threads; the rows that it
    /// makes of them go to `order`, in the order of the file. Returns what could not be read.
    pub fn read_records_in_order(
        &self,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: impl Fn(u64, &[u8]) -> io::Result<Vec<u8>> + Sync,
    ) -> Vec<String> {
        let layers = DecompressionSelection::all();
        let decoders = self.compressed.as_ref().map_or(usize::MAX, |compressed| compressed.decoders(layers));
        let failures = Failures::default();
        order.blocks(self.blocks.len(), decoders.min(rayon::current_num_threads()), &|index, rows, buffer| {
            let mut give = |point: u64, records: &[u8]| {
                match rows_of(point, records) {
                    Ok(made) => rows.give(&made),
                    Err(error) => order.fail(error),
                }
                progress.add((records.len() / self.layout.record_length) as u64);
            };
            self.read_block(&self.blocks[index], buffer, &|| order.is_stopped(), &mut give, &failures);
        });
        failures.described(self)
    }

    fn read_block(
        &self,
        block: &Block,
        buffer: &mut Vec<u8>,
        stopped: &dyn Fn() -> bool,
        give: &mut dyn FnMut(u64, &[u8]),
        failures: &Failures,
    ) {
        let length = self.layout.record_length;
        let Some(compressed) = &self.compressed else {
            buffer.resize(block.points as usize * length, 0);
            match self.file.read_at(self.data_start + block.first_point * length as u64, buffer) {
                Ok(read) => {
                    give(block.first_point, &buffer[..read - read % length]);
                    if read < buffer.len() {
                        failures.add(block.first_point, "the file has become shorter since it was opened".into());
                    }
                }
                Err(error) => failures.add(block.first_point, error.to_string()),
            }
            return;
        };
        let tile = PIECE_TILES * tile_records(length);
        buffer.resize(tile * length, 0);
        for chunk in &compressed.chunks[block.chunks.clone()] {
            let mut stream = match compressed.stream(&self.file, chunk, DecompressionSelection::all()) {
                Ok(stream) => stream,
                Err(problem) => {
                    failures.add(chunk.first_point, problem + self.drop_damaged(chunk));
                    continue;
                }
            };
            let mut point = chunk.first_point;
            while stream.left() > 0 && !stopped() {
                let wanted = stream.left().min(tile as u64) as usize;
                let (decoded, outcome) = stream.decode(&mut buffer[..wanted * length]);
                give(point, &buffer[..decoded * length]);
                point += decoded as u64;
                if let Err(problem) = outcome {
                    let more = self.drop_damaged(chunk);
                    failures.add(point, format!("{problem} (the rest of this compressed chunk is skipped){more}"));
                    break;
                }
            }
            if stream.left() == 0 && point < chunk.first_point + chunk.points {
                failures.add(point, "the compressed chunk holds fewer points than announced".into());
            }
        }
    }
}
