//! The memory of reading, as counted by the allocator: it grows with the file, not with the file's claims.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use cloud::{Chunk, Progress};
use codec::{Selection, Source};
use las_files::{Chunks, compress, descriptor, las_file, points};
use peak_alloc::PeakAlloc;
use real_data::test_data;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const MB: usize = 1_000_000;

/// The allocator counts the bytes of all threads, so one test runs at a time.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The most bytes in use at a time beyond those before.
fn most_bytes<T>(work: impl FnOnce() -> T) -> (usize, T) {
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let result = work();
    (ALLOCATOR.peak_usage().saturating_sub(before), result)
}

/// Reads all columns of every point and drops them; returns the bytes that this took, and the number of points or the
/// error.
fn read_all(path: &Path, memory: u64) -> (usize, Result<u64, String>) {
    most_bytes(|| {
        let source = codec::open_within(path, memory).map_err(|error| error.to_string())?;
        read(&source, vec![true; source.info().attributes.len()])
    })
}

fn read(source: &Source, attributes: Vec<bool>) -> Result<u64, String> {
    let selection = Selection { positions: true, colors: true, normals: true, attributes };
    let summary = source.read(&selection, &Progress::default(), &|chunk: Chunk| drop(chunk));
    let summary = summary.map_err(|error| error.to_string())?;
    let _ = source.triangles();
    match summary.warnings.first() {
        Some(warning) if summary.points == 0 => Err(warning.clone()),
        _ => Ok(summary.points),
    }
}

/// A file that is removed with the test.
fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    file
}

/// A LAZ file of points with `extra` extra bytes, described or not.
fn with_extra_bytes(format: u8, count: usize, extra: usize, vlrs: &[(&str, u16, Vec<u8>)]) -> Vec<u8> {
    let mut all = points(format, count);
    let value = |point: usize, byte: usize| (point * 31 + byte) as u8;
    for (point, record) in all.iter_mut().enumerate() {
        record.extra_bytes = (0..extra).map(|byte| value(point, byte)).collect();
    }
    compress(&las_file((1, 4), format, &all, vlrs), &Chunks::Fixed(4))
}

/// The file with `count` more items of a kind, size and version in its LASzip record, which the points do not have.
fn with_false_items(laz: &[u8], count: u16, [kind, size, version]: [u16; 3]) -> Vec<u8> {
    let user = laz.windows(14).position(|bytes| bytes == b"laszip encoded").unwrap();
    let (length_at, data) = (user + 18, user + 52);
    let u16_at = |at: usize| u16::from_le_bytes([laz[at], laz[at + 1]]);
    let end = data + usize::from(u16_at(length_at));
    let mut bytes = laz[..end].to_vec();
    for _ in 0..count {
        [kind, size, version].into_iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    }
    bytes[length_at..length_at + 2].copy_from_slice(&(u16_at(length_at) + 6 * count).to_le_bytes());
    bytes[data + 32..data + 34].copy_from_slice(&(u16_at(data + 32) + count).to_le_bytes());
    let start = u32::from_le_bytes(laz[96..100].try_into().unwrap()) + 6 * u32::from(count);
    bytes[96..100].copy_from_slice(&start.to_le_bytes());
    bytes.extend(&laz[end..]);
    bytes
}

#[test]
fn items_that_do_not_fit_the_record_are_refused_before_a_decoder_takes_memory() {
    let _alone = alone();
    for format in [3, 7] {
        let laz = compress(&las_file((1, 4), format, &points(format, 100), &[]), &Chunks::Fixed(50));
        // Extra bytes, the first item, and the version of both.
        let (kind, first, version) = if format == 3 { (0, 6, 2) } else { (14, 10, 3) };
        let cases = [
            (1, kind, u16::MAX, "bytes in all"),
            (40, kind, u16::MAX, "bytes in all"),
            (5_000, kind, 0, "is there twice"),
            (1, first, 0, "of kind"),
            (1, 14 - kind, 0, "does not go with the first"),
        ];
        for (count, kind, size, problem) in cases {
            let file = file(&with_false_items(&laz, count, [kind, size, version]));
            let (bytes, read) = read_all(file.path(), u64::MAX);
            let error = read.unwrap_err();
            assert!(error.contains("LASzip record") && error.contains(problem), "{error}");
            assert!(bytes < MB, "{count} of kind {kind}: {bytes} bytes");
        }
    }
}

#[test]
fn long_points_are_decoded_by_as_few_decoders_as_fit_the_memory() {
    const EXTRA: usize = 10_000;
    let _alone = alone();
    let file = file(&with_extra_bytes(1, 100, EXTRA, &[]));
    let (one, read) = read_all(file.path(), 30 * MB as u64);
    assert_eq!(read, Ok(100));
    assert!(one < 35 * MB, "one at a time: {one} bytes");
    let (bytes, read) = read_all(file.path(), 20 * MB as u64);
    let error = read.unwrap_err();
    assert!(error.contains("stream.host_bytes") && bytes < 2 * MB, "{bytes} bytes: {error}");
}

#[test]
fn layers_of_extra_bytes_take_memory_when_they_are_wanted() {
    // Three triples of doubles for each descriptor, so that all bytes are columns.
    const DESCRIPTORS: usize = 300;
    let _alone = alone();
    let names = (0..DESCRIPTORS).flat_map(|index| descriptor(&format!("extra {index}"), 30, None)).collect();
    let file = file(&with_extra_bytes(6, 40, DESCRIPTORS * 24, &[("LASF_Spec", 4, names)]));
    let source = codec::open_within(file.path(), 20 * MB as u64).unwrap();
    let (bytes, points) = most_bytes(|| read(&source, Vec::new()));
    assert!(points == Ok(40) && bytes < 20 * MB, "positions alone: {bytes} bytes, {points:?}");
    let all = vec![true; source.info().attributes.len()];
    let (bytes, points) = most_bytes(|| read(&source, all.clone()));
    let error = points.unwrap_err();
    assert!(error.contains("stream.host_bytes") && bytes < 20 * MB, "{bytes} bytes: {error}");
    let source = codec::open_within(file.path(), 80 * MB as u64).unwrap();
    let (bytes, points) = most_bytes(|| read(&source, all));
    assert!(points == Ok(40) && bytes < 80 * MB, "all: {bytes} bytes, {points:?}");
}

#[test]
fn a_chunk_of_one_point_takes_no_decoder() {
    let _alone = alone();
    for format in [3, 7] {
        let las = las_file((1, 4), format, &points(format, 300), &[]);
        let [one, two] = [1, 2].map(|points| file(&compress(&las, &Chunks::Fixed(points))));
        let [(of_one, read_one), (of_two, read_two)] = [one, two].map(|file| read_all(file.path(), u64::MAX));
        assert_eq!((read_one, read_two), (Ok(300), Ok(300)));
        assert!(of_one < MB / 2 && of_two > of_one + MB / 4, "{of_one} bytes, {of_two} of chunks of two");
    }
}

#[test]
fn lines_that_leave_out_numbers_take_no_more_than_some_of_their_points_do() {
    let _alone = alone();
    let ply = |properties: usize, lines: usize| {
        let properties: String = (0..properties).map(|index| format!("property double p{index}\n")).collect();
        let axes = "property double x\nproperty double y\nproperty double z\n";
        let header = format!("ply\nformat ascii 1.0\nelement vertex {lines}\n{axes}{properties}end_header\n");
        file(&[header.as_bytes(), "0\n".repeat(lines).as_bytes()].concat())
    };
    // In a file of few lines the missing numbers are read as missing; a file of many is refused.
    let few = ply(4_000, 250);
    let (bytes, read) = read_all(few.path(), u64::MAX);
    assert_eq!(read, Ok(250));
    assert!(bytes < 64 * MB, "{bytes} bytes");
    let (bytes, read) = read_all(ply(4_000, 10_000).path(), u64::MAX);
    let error = read.unwrap_err();
    assert!(bytes < 2 * MB && error.contains("4003 properties"), "{bytes} bytes: {error}");
    let error = read_all(ply(4_094, 1).path(), u64::MAX).1.unwrap_err();
    assert!(error.contains("header line 4100") && error.contains("more than 4096 properties"), "{error}");
}

/// The files below a folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|item| item.unwrap().path()).collect();
    paths.sort();
    paths.into_iter().flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

#[test]
fn no_file_takes_more_than_64_mb_and_ten_times_its_length() {
    let Some(data) = test_data() else { return };
    let _alone = alone();
    // The first read starts the threads.
    rayon_is_ready();
    let mut read = 0;
    for path in [data.clone(), data.join("../attacks")].iter().filter(|folder| folder.exists()).flat_map(|f| files(f)) {
        let length = std::fs::metadata(&path).unwrap().len() as usize;
        let (bytes, points) = read_all(&path, 64 * MB as u64);
        read += usize::from(points.is_ok());
        assert!(bytes <= 64 * MB + 10 * length, "{}: {bytes} bytes for {length}: {points:?}", path.display());
    }
    assert!(read > 50, "{read} files were read");
}

fn rayon_is_ready() {
    let file = file(&compress(&las_file((1, 2), 1, &points(1, 1_000), &[]), &Chunks::Fixed(10)));
    assert_eq!(read_all(file.path(), u64::MAX).1, Ok(1_000));
}
