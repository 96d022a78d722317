//! LAS and LAZ in process against the bare loops that bound them: the same bytes to the same columns with no checks, no
//! choice of columns, no chunks passed on. Compare the figures of a pair (bare, ours) with each other: the machine may
//! be busy.
//!
//! `GLINT_BENCH_POINTS` sets the size (default 2 million); points per second are divan's items per second.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed bench")]

#[path = "../tests/las_files/mod.rs"]
mod las_files;

use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex};

use cloud::{Chunk, Progress};
use codec::{Bytes, Selection, Source};
use divan::counter::ItemsCount;
use las_files::{Chunks, compress, terrain};
use laz::laszip::{ChunkTable, ChunkTableEntry};
use laz::{DecompressionSelection, LazVlr};
use rayon::prelude::*;

const RECORD: usize = 36;
const CHUNK: usize = 65_536;

struct Files {
    _folder: tempfile::TempDir,
    points: usize,
    las: PathBuf,
    laz: PathBuf,
}

/// Written once, read from a warm cache.
static FILES: LazyLock<Files> = LazyLock::new(|| {
    let points = std::env::var("GLINT_BENCH_POINTS").ok().and_then(|n| n.parse().ok()).unwrap_or(2_000_000);
    let folder = tempfile::tempdir().unwrap();
    let (las, laz) = (folder.path().join("terrain.las"), folder.path().join("terrain.laz"));
    let bytes = terrain(points);
    std::fs::write(&las, &bytes).unwrap();
    std::fs::write(&laz, compress(&bytes, &Chunks::Fixed(50_000))).unwrap();
    Files { _folder: folder, points, las, laz }
});

fn main() {
    divan::main();
}

/// The positions and colours of one run of records.
type Columns = (Vec<[f32; 3]>, Vec<[u8; 4]>);

fn decode(records: &[u8]) -> Columns {
    let word =
        |record: &[u8], at: usize| i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]);
    let count = records.len() / RECORD;
    // Zeroed by the operating system, so that the loop only stores.
    let (mut positions, mut colors) = (vec![[0.0; 3]; count], vec![[0; 4]; count]);
    for ((record, position), color) in records.chunks_exact(RECORD).zip(&mut positions).zip(&mut colors) {
        *position = [0, 4, 8].map(|at| (f64::from(word(record, at)) * 0.001) as f32);
        *color = [record[31], record[33], record[35], 255];
    }
    (positions, colors)
}

fn points_start(path: &Path) -> u64 {
    let mut word = [0; 4];
    Bytes::open(path).unwrap().read_at(96, &mut word).unwrap();
    u32::from_le_bytes(word).into()
}

fn bare_las(files: &Files) -> Vec<Columns> {
    let file = Bytes::open(&files.las).unwrap();
    let start = points_start(&files.las);
    let blocks = files.points.div_ceil(CHUNK);
    let read = |buffer: &mut Vec<u8>, block: usize| {
        let count = CHUNK.min(files.points - block * CHUNK);
        buffer.resize(CHUNK * RECORD, 0);
        let bytes = &mut buffer[..count * RECORD];
        file.read_at(start + (block * CHUNK * RECORD) as u64, bytes).unwrap();
        decode(bytes)
    };
    (0..blocks).into_par_iter().map_init(Vec::new, read).collect()
}

/// The limit for LAZ: `laz` decompresses the file's chunks in parallel, a batch of them at a time, then the same loop.
fn bare_laz(files: &Files, selection: DecompressionSelection) -> Vec<Columns> {
    let bytes = std::fs::read(&files.laz).unwrap();
    let start = points_start(&files.laz) as usize;
    let record =
        bytes.windows(LazVlr::USER_ID.len()).position(|window| window == LazVlr::USER_ID.as_bytes()).unwrap() - 2 + 54;
    let vlr = LazVlr::from_buffer(&bytes[record..]).unwrap();
    let mut source = std::io::Cursor::new(&bytes);
    source.set_position(start as u64);
    let table = ChunkTable::read_from(&mut source, &vlr).unwrap();
    let mut entries: Vec<ChunkTableEntry> = table.as_ref().to_vec();
    let whole: u64 = entries.iter().rev().skip(1).map(|entry| entry.point_count).sum();
    entries.last_mut().unwrap().point_count = files.points as u64 - whole;
    let mut rest = &bytes[start + 8..];
    let mut columns = Vec::new();
    let mut records = Vec::new();
    // 40 chunks are 72 MB of records: more at a time would only cost page faults.
    for batch in entries.chunks(40) {
        let length: u64 = batch.iter().map(|entry| entry.byte_count).sum();
        let (compressed, after) = rest.split_at(length as usize);
        rest = after;
        let count: u64 = batch.iter().map(|entry| entry.point_count).sum();
        records.resize(count as usize * RECORD, 0);
        laz::par_decompress_selective(compressed, &mut records, &vlr, batch, selection).unwrap();
        columns.par_extend(records.par_chunks(50_000 * RECORD).map(decode));
    }
    columns
}

fn ours(path: &Path, selection: impl Fn(&Source) -> Selection) -> Vec<Chunk> {
    let source = codec::open(path).unwrap();
    let chunks = Mutex::new(Vec::new());
    source.read(&selection(&source), &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    chunks.into_inner().unwrap()
}

fn picture(_: &Source) -> Selection {
    Selection { positions: true, colors: true, ..Selection::default() }
}

/// All that a record has, each once: coordinates, colours and flags are among the attributes, too.
fn everything(source: &Source) -> Selection {
    let again = ["x", "y", "z", "red", "green", "blue"];
    let flags = [
        "synthetic",
        "key_point",
        "withheld",
        "overlap",
        "scanner_channel",
        "scan_direction_flag",
        "edge_of_flight_line",
    ];
    let is_read = |name: &str| !again.contains(&name) && !flags.contains(&name);
    let attributes = source.info().attributes.iter().map(|attribute| is_read(&attribute.name)).collect();
    Selection { attributes, ..picture(source) }
}

fn picture_layers() -> DecompressionSelection {
    DecompressionSelection::base().decompress_z().decompress_rgb()
}

/// Runs `read` on the files, counted in points.
fn points<T>(bencher: divan::Bencher<'_, '_>, read: impl Fn(&Files) -> T + Sync) {
    let files = &*FILES;
    bencher.counter(ItemsCount::new(files.points)).bench(|| read(files));
}

#[divan::bench]
fn las_picture_bare(bencher: divan::Bencher<'_, '_>) {
    points(bencher, bare_las);
}

#[divan::bench]
fn las_picture_ours(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| ours(&files.las, picture));
}

#[divan::bench]
fn las_everything_ours(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| ours(&files.las, everything));
}

#[divan::bench(sample_count = 10)]
fn laz_picture_bare(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| bare_laz(files, picture_layers()));
}

#[divan::bench(sample_count = 10)]
fn laz_picture_ours(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| ours(&files.laz, picture));
}

#[divan::bench(sample_count = 10)]
fn laz_everything_bare(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| bare_laz(files, DecompressionSelection::all()));
}

#[divan::bench(sample_count = 10)]
fn laz_everything_ours(bencher: divan::Bencher<'_, '_>) {
    points(bencher, |files| ours(&files.laz, everything));
}
