//! The first points of the compressed chunks of a folder of tiles are shown before any point is decoded, and go tile by tile.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

#[path = "../../codec/tests/las_files/mod.rs"]
mod las_files;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex};

use cloud::{Bounds, Chunk, Progress};
use codec::Source;
use las_files::{Chunks, compress, las_file, points};
use stream::{BuildOptions, Cache, Pages, Previewed, build, build_in_order};

const TILES: usize = 4;
const TILE_POINTS: usize = 30_000;
const CHUNK: u32 = 500;

/// Tiles side by side, each with other points.
fn tiles(folder: &Path) -> Vec<Arc<Source>> {
    let tile = |tile: usize| {
        let mut points = points(7, TILE_POINTS);
        points.iter_mut().for_each(|point| point.x += 1000.0 * tile as f64);
        let path = folder.join(format!("{tile}.laz"));
        std::fs::write(&path, compress(&las_file((1, 4), 7, &points, &[]), &Chunks::Fixed(CHUNK))).unwrap();
        Arc::new(codec::open(&path).unwrap())
    };
    (0..TILES).map(tile).collect()
}

/// The places of a chunk's points in millimetres.
fn places(chunk: &Chunk) -> Vec<[i64; 3]> {
    let place = |index| (chunk.position(index) * 1000.0).round().to_array().map(|value| value as i64);
    (0..chunk.len()).map(place).collect()
}

#[test]
fn first_points_come_first_and_no_point_is_shown_twice() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = tiles(folder.path());
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let changes = Mutex::new(Vec::new());
    let progress = Progress::default();
    let options = BuildOptions { memory: 1 << 24, preview_points: 60_000 };
    let show = |change| changes.lock().unwrap().push((progress.done(), change));
    let pages = build(&inputs, &cache, &options, &progress, &show).unwrap();
    let changes = changes.into_inner().unwrap();

    let chunks_of_tile = TILE_POINTS / CHUNK as usize;
    let is_first = |change: &Previewed| matches!(change, Previewed::First(..));
    assert!(changes[..TILES].iter().all(|(done, change)| is_first(change) && *done == 0), "nothing was decoded");
    assert!(!changes[TILES..].iter().any(|(_, change)| is_first(change)));
    let (mut first, mut shown) = (BTreeMap::new(), BTreeSet::new());
    let mut shared = 0;
    for (_, change) in changes {
        match change {
            Previewed::First(group, chunk) => {
                assert_eq!(chunk.len(), chunks_of_tile);
                assert!(chunk.colors.is_some() && chunk.columns.len() == pages.attributes().len());
                let radius = cloud::unpack_radius(chunk.radii.as_ref().unwrap()[0]).unwrap();
                // 60 points on a square of 900 m are 65 m apart; splats overlap.
                assert!((100.0..300.0).contains(&radius), "{radius}");
                assert!(places(&chunk).into_iter().all(|place| shown.insert(place)));
                first.insert(group, chunk);
            }
            Previewed::FirstGone(group) => {
                places(&first.remove(&group).unwrap()).iter().for_each(|place| assert!(shown.remove(place)));
            }
            Previewed::Share(chunk) => {
                assert!(chunk.radii.is_none());
                assert!(places(&chunk).into_iter().all(|place| shown.insert(place)), "a point is shown twice");
                shared += chunk.len();
            }
        }
        assert!(shown.len() <= options.preview_points as usize);
    }
    assert!(first.is_empty(), "first points stay");
    let most = options.preview_points as usize - TILES * chunks_of_tile;
    assert!((most - 10..=most).contains(&shared), "{shared} of {most}");
    // Each tile has its part of the share.
    for tile in 0..TILES as i64 {
        let count = shown.iter().filter(|[x, ..]| (*x / 1_000_000 - 600) == tile).count();
        assert!(count.abs_diff(most / TILES) < 10, "{count} points of tile {tile}");
    }
}

fn assert_same_index(one: &Pages, other: &Pages) {
    assert_eq!(one.octree(), other.octree());
    for (id, _) in one.octree().ids() {
        let [one, other] = [one, other].map(|pages| pages.read(id).unwrap());
        assert_eq!((one.origin, one.positions, one.colors), (other.origin, other.positions, other.colors));
    }
}

#[test]
fn an_index_does_not_depend_on_its_preview() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = tiles(folder.path());
    let made = |preview_points: u64, name: &str| {
        let cache = Cache::new(folder.path().join(name), u64::MAX);
        let options = BuildOptions { memory: 1 << 24, preview_points };
        build(&inputs, &cache, &options, &Progress::default(), &|_| ()).unwrap()
    };
    let [with, without] = [made(60_000, "with"), made(0, "without")];
    assert_same_index(&with, &without);
}

#[test]
fn the_tile_that_is_asked_for_is_read_next_and_the_index_stays_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = tiles(folder.path());
    let options = BuildOptions { memory: 1 << 24, preview_points: 60_000 };
    let cache = |name: &str| Cache::new(folder.path().join(name), u64::MAX);
    let usual = build(&inputs, &cache("usual"), &options, &Progress::default(), &|_| ()).unwrap();
    // Somebody looks at the third tile, and turns to the last one while it is read.
    let (gone, asked) = (Mutex::new(Vec::new()), Mutex::new(Vec::new()));
    let show = |change: Previewed| {
        if let Previewed::FirstGone(group) = change {
            gone.lock().unwrap().push(group);
        }
    };
    let next = |boxes: &[Bounds]| {
        asked.lock().unwrap().push(boxes.to_vec());
        if boxes.len() == TILES { 2 } else { boxes.len() - 1 }
    };
    let turned = build_in_order(&inputs, &cache("turned"), &options, &Progress::default(), &show, &next).unwrap();
    assert_eq!(gone.into_inner().unwrap(), [2, 3, 1, 0]);
    let bounds: Vec<Bounds> = inputs.iter().map(|input| input.info().bounds.unwrap()).collect();
    let left =
        [&[0, 1, 2, 3][..], &[0, 1, 3], &[0, 1], &[0]].map(|left| left.iter().map(|tile| bounds[*tile]).collect());
    assert_eq!(asked.into_inner().unwrap(), left as [Vec<Bounds>; TILES]);
    assert_same_index(&usual, &turned);
    assert_eq!(usual.warnings(), turned.warnings());
}
