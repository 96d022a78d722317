//! The first points of compressed chunks are those of the file, and a damaged or lying file gives no others.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cloud::{Chunk, Cloud, Progress};
use codec::{Format, Selection, Source};
use las_files::{Chunks, compress, las_file, points};

/// Everything of a point as bits: the place in steps of the grid, the colour, and all attributes.
type Bits = ([i64; 3], [u8; 4], Vec<u64>);

fn everything(source: &Source) -> Selection {
    let attributes = vec![true; source.info().attributes.len()];
    Selection { positions: true, colors: true, normals: true, attributes }
}

/// The points of a chunk whose place is wanted.
fn bits(source: &Source, chunk: &Chunk, is_wanted: impl Fn(&[i64; 3]) -> bool) -> Vec<Bits> {
    let cloud = Cloud { grid: source.info().grid, ..Cloud::default() };
    let grid = cloud.grid.unwrap();
    let of = |index: usize| {
        let at = ((cloud.world_position(chunk, index) - grid.offset) / grid.scale).round();
        let place = at.to_array().map(|value| value as i64);
        if !is_wanted(&place) {
            return None;
        }
        let color = chunk.colors.as_ref().map_or([0; 4], |colors| colors[index]);
        let values = chunk.columns.iter().flatten().map(|column| column.value(index).to_bits());
        Some((place, color, values.collect()))
    };
    (0..chunk.len()).filter_map(of).collect()
}

fn all(source: &Source) -> Vec<Bits> {
    let chunks = Mutex::new(Vec::new());
    source.read(&everything(source), &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    chunks.iter().flat_map(|chunk| bits(source, chunk, |_| true)).collect()
}

fn first(source: &Source, most: usize) -> Option<Vec<Bits>> {
    source.first_points(&everything(source), most).map(|chunk| bits(source, &chunk, |_| true))
}

fn open(bytes: &[u8]) -> (tempfile::NamedTempFile, Source) {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let source = codec::open(file.path()).unwrap();
    (file, source)
}

fn laz(format: u8, chunks: &Chunks<'_>) -> Vec<u8> {
    let version = if format < 6 { (1, 3) } else { (1, 4) };
    compress(&las_file(version, format, &points(format, 2_500), &[]), chunks)
}

fn picked(all: &[Bits], indices: &[usize]) -> Vec<Bits> {
    indices.iter().map(|index| all[*index].clone()).collect()
}

/// The offset in the file of the first chunk.
fn data_start(laz: &[u8]) -> usize {
    u32::from_le_bytes(*laz[96..].first_chunk().unwrap()) as usize + 8
}

#[test]
fn the_first_points_of_every_format_are_those_that_decoding_gives() {
    for format in 0..=10 {
        let (_file, source) = open(&laz(format, &Chunks::Fixed(400)));
        let all = all(&source);
        assert_eq!(all.len(), 2_500);
        let starts = [0, 400, 800, 1200, 1600, 2000, 2400];
        assert_eq!(first(&source, usize::MAX), Some(picked(&all, &starts)), "format {format}");
        assert_eq!(first(&source, 3), Some(picked(&all, &[0, 800, 1600])), "format {format}");
        assert_eq!(first(&source, 0), None);
        let places = source.first_points(&Selection { positions: true, ..Default::default() }, 100).unwrap();
        assert!(places.colors.is_none() && places.columns.iter().all(Option::is_none), "nothing else was asked for");
    }
}

#[test]
fn chunks_of_any_size_give_theirs() {
    for format in [3, 7] {
        let (_file, source) = open(&laz(format, &Chunks::Variable(&[1, 1200, 299, 1000])));
        assert_eq!(first(&source, 9), Some(picked(&all(&source), &[0, 1, 1201, 1500])), "format {format}");
    }
}

#[test]
fn a_file_without_compressed_chunks_has_none() {
    let (_file, source) = open(&las_file((1, 4), 7, &points(7, 100), &[]));
    assert_eq!((source.info().format, first(&source, 9)), (Format::Las, None));
}

#[test]
fn a_damaged_table_of_chunks_gives_none_unless_the_chunks_say_where_they_are() {
    for (format, expected) in [(3, 0), (7, 3)] {
        let mut bytes = laz(format, &Chunks::Fixed(1000));
        let offset = data_start(&bytes) - 8;
        bytes[offset..offset + 8].copy_from_slice(&u64::MAX.to_le_bytes());
        let length = bytes.len();
        bytes[length - 8..].fill(255);
        let (_file, source) = open(&bytes);
        assert!(source.info().warnings.iter().any(|warning| warning.contains("chunk table")), "{format}");
        let starts: Vec<Bits> =
            [0, 1000, 2000].iter().take(expected).map(|index| all(&source)[*index].clone()).collect();
        assert_eq!(first(&source, 9).unwrap_or_default(), starts, "format {format}");
    }
}

#[test]
fn points_and_chunks_that_are_not_where_the_file_says_are_left_out() {
    // The first record of the file is far outside of the header's bounds.
    for format in [3, 7] {
        let mut bytes = laz(format, &Chunks::Fixed(1000));
        let start = data_start(&bytes);
        bytes[start..start + 4].copy_from_slice(&i32::MAX.to_le_bytes());
        let (_file, source) = open(&bytes);
        assert_eq!(first(&source, 9).unwrap().len(), 2, "format {format}");
    }
    // The head of the first chunk says that it has one point.
    let mut bytes = laz(7, &Chunks::Fixed(1000));
    let count = data_start(&bytes) + 36;
    bytes[count..count + 4].copy_from_slice(&1_u32.to_le_bytes());
    let (_file, source) = open(&bytes);
    assert_eq!(first(&source, 9).unwrap().len(), 2);
}

#[test]
fn a_file_that_is_cut_or_garbled_anywhere_gives_no_more_points_than_chunks() {
    let mut noise = cloud::Random(11);
    for format in [3, 7] {
        let whole = laz(format, &Chunks::Fixed(400));
        for _ in 0..150 {
            let mut bytes = whole.clone();
            let at = data_start(&bytes) - 8;
            for _ in 0..noise.below(12) {
                let place = at + noise.below((whole.len() - at) as u64) as usize;
                bytes[place] = noise.draw() as u8;
            }
            bytes.truncate(whole.len() - noise.below(400) as usize);
            let file = tempfile::NamedTempFile::new().unwrap();
            std::fs::write(file.path(), &bytes).unwrap();
            let Ok(source) = codec::open(file.path()) else { continue };
            let Some(bounds) = source.info().bounds else { continue };
            if let Some(chunk) = source.first_points(&everything(&source), usize::MAX) {
                let slack = 2.0 * las_files::SCALE;
                assert!(chunk.len() <= whole.len() / 20, "{} points", chunk.len());
                let inside = |index| {
                    let place = chunk.position(index);
                    place.cmpge(bounds.min - slack).all() && place.cmple(bounds.max + slack).all()
                };
                assert!((0..chunk.len()).all(inside));
            }
        }
    }
}

fn laz_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            laz_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "laz") {
            found.push(path);
        }
    }
}

#[test]
fn the_first_points_of_real_files_are_points_of_theirs() {
    let Some(folder) = real_data::test_data() else { return };
    let mut files = Vec::new();
    ["airborne", "las_matrix", "terrestrial", "same_cloud_four_files"]
        .iter()
        .map(|name| folder.join(name))
        .filter(|folder| folder.is_dir())
        .for_each(|folder| laz_files(&folder, &mut files));
    let mut with_chunks = 0;
    for path in &files {
        let source = codec::open(path).unwrap();
        let Some(first) = first(&source, 1000) else { continue };
        // Millions of points are compared by place, and by all they have only where the place is one of the first points.
        let places: HashSet<[i64; 3]> = first.iter().map(|point| point.0).collect();
        let near = Mutex::new(HashSet::new());
        let keep = |chunk: Chunk| near.lock().unwrap().extend(bits(&source, &chunk, |place| places.contains(place)));
        source.read(&everything(&source), &Progress::default(), &keep).unwrap();
        let near: HashSet<Bits> = near.into_inner().unwrap();
        assert!(first.iter().all(|point| near.contains(point)), "{}", path.display());
        let points = source.info().points as usize;
        assert!(first.len() >= (points / 50_000).min(1000), "{}: {} of {points}", path.display(), first.len());
        with_chunks += 1;
    }
    assert!(with_chunks >= files.len() / 2, "{with_chunks} of {}", files.len());
}
