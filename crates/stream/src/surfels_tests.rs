use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use cloud::{Orientation, unpack_normal};
use glam::Vec3;

use super::*;
use crate::surfel_file::HEAD_BYTES;
use crate::{BuildOptions, Cache, build};

const OPTIONS: SurfelOptions = SurfelOptions {
    neighbours: 16,
    orientation: Orientation::Up(Vec3::Z),
    radii: cloud::RadiusRule::Spread,
    seen_from: None,
};

/// Hills on a millimetre grid with 5 points a square metre, and a sparse corner.
fn hills(points: u64) -> Vec<[i32; 3]> {
    let size = (points as f64 / 5.0).sqrt();
    let unit = |seed: u64| (cloud::hash(seed) >> 11) as f64 / (1_u64 << 53) as f64;
    let place = |i: u64| {
        let (mut x, mut y) = (unit(2 * i) * size, unit(2 * i + 1) * size);
        if i.is_multiple_of(20) {
            (x, y) = (x * 0.5 + 1.1 * size, y * 0.5 + 1.1 * size);
        }
        let z = 9.0 * (x / 40.0).sin() * (y / 30.0).cos();
        [x, y, z].map(|metres| (metres * 1000.0).round() as i32)
    };
    (0..points).map(place).collect()
}

fn write_las(path: &Path, points: &[[i32; 3]]) {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(7).unwrap();
    let transform = |offset| las::Transform { scale: 0.001, offset };
    builder.transforms = las::Vector { x: transform(431_000.0), y: transform(5_412_000.0), z: transform(0.0) };
    let mut writer = las::Writer::from_path(path, builder.into_header().unwrap()).unwrap();
    for [x, y, z] in points {
        let point = las::Point {
            x: f64::from(*x) * 0.001 + 431_000.0,
            y: f64::from(*y) * 0.001 + 5_412_000.0,
            z: f64::from(*z) * 0.001,
            color: Some(las::Color::new(1, 2, 3)),
            gps_time: Some(0.0),
            ..Default::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
}

/// A folder with an index of hills.
fn indexed(points: u64) -> (tempfile::TempDir, Arc<codec::Source>, Pages) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hills.las");
    write_las(&path, &hills(points));
    let source = Arc::new(codec::open(&path).unwrap());
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let options = BuildOptions { memory: 64 << 20, ..Default::default() };
    let pages = build(std::slice::from_ref(&source), &cache, &options, &Progress::default(), &|_| {}).unwrap();
    (folder, source, pages)
}

fn all(pages: &Pages) -> Vec<Chunk> {
    pages.octree().ids().map(|(node, _)| pages.read(node).unwrap()).collect()
}

fn reopened(pages: &Pages) -> Pages {
    Pages::open(pages.folder()).unwrap()
}

/// The packed normal and radius of each place in millimetres.
fn by_place<'a>(chunks: impl Iterator<Item = (&'a Chunk, &'a [u32], &'a [u16])>) -> HashMap<[i64; 3], (u32, u16)> {
    let mut found = HashMap::new();
    for (chunk, normals, radii) in chunks {
        for index in 0..chunk.len() {
            let place = (chunk.position(index) * 1000.0).round().to_array().map(|value| value as i64);
            found.insert(place, (normals[index], radii[index]));
        }
    }
    found
}

fn paged(chunks: &[Chunk]) -> HashMap<[i64; 3], (u32, u16)> {
    by_place(
        chunks.iter().map(|chunk| (chunk, &chunk.normals.as_ref().unwrap()[..], &chunk.radii.as_ref().unwrap()[..])),
    )
}

/// What `cloud::estimate` computes from the whole file in memory.
fn in_memory(source: &codec::Source) -> HashMap<[i64; 3], (u32, u16)> {
    let chunks = Mutex::new(Vec::new());
    let selection = codec::Selection { positions: true, ..Default::default() };
    source.read(&selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let chunks = chunks.into_inner().unwrap();
    let surfels = cloud::estimate(&chunks, &OPTIONS, &Progress::default()).unwrap();
    by_place(chunks.iter().zip(&surfels).map(|(chunk, surfels)| (chunk, &surfels.normals[..], &surfels.radii[..])))
}

/// The share of the points whose normal differs by more than half a degree, or whose radius by more than a thousandth.
fn differing(paged: &HashMap<[i64; 3], (u32, u16)>, memory: &HashMap<[i64; 3], (u32, u16)>) -> f64 {
    assert_eq!(paged.len(), memory.len());
    let differs = |(place, (normal, radius)): &(&[i64; 3], &(u32, u16))| {
        let (expected_normal, expected_radius) = memory[*place];
        let turned = match (unpack_normal(*normal), unpack_normal(expected_normal)) {
            (Some(a), Some(b)) => a.dot(b) < 0.99996,
            (a, b) => a != b,
        };
        turned || radius.abs_diff(expected_radius) > 3
    };
    paged.iter().filter(differs).count() as f64 / paged.len() as f64
}

#[test]
fn surfels_of_one_group_are_those_of_the_cloud_in_memory() {
    let (_folder, source, pages) = indexed(60_000);
    assert!(!pages.has_surfels());
    assert!(all(&pages).iter().all(|chunk| chunk.normals.is_none() && chunk.radii.is_none()));
    let progress = Progress::default();
    estimate_surfels(&pages, &OPTIONS, 1 << 30, &progress).unwrap();
    assert_eq!((progress.done(), progress.total()), (60_000, 60_000));
    let pages = reopened(&pages);
    assert!(pages.has_surfels());
    let chunks = all(&pages);
    // Equal chunks give the same result to the bit.
    let mut bare = chunks.clone();
    bare.iter_mut().for_each(|chunk| (chunk.normals, chunk.radii) = (None, None));
    let expected = cloud::estimate(&bare, &OPTIONS, &Progress::default()).unwrap();
    for (chunk, expected) in chunks.iter().zip(&expected) {
        assert_eq!(chunk.normals.as_deref(), Some(&expected.normals));
        assert_eq!(chunk.radii.as_deref(), Some(&expected.radii));
    }
    // The file's chunks have other origins and another order: the result is the same but for rounding and ties.
    let share = differing(&paged(&chunks), &in_memory(&source));
    assert!(share < 1e-3, "{share}");
}

#[test]
fn seams_between_groups_do_not_show() {
    let (_folder, source, pages) = indexed(200_000);
    let count = groups(pages.octree(), &weights(&pages), 20_000).len();
    assert!(count >= 8, "{count}");
    estimate_in_groups(&pages, &OPTIONS, 20_000, &Progress::default()).unwrap();
    let share = differing(&paged(&all(&reopened(&pages))), &in_memory(&source));
    assert!(share < 1e-3, "{share}");
}

#[test]
fn groups_hold_every_place_once_and_keep_their_limit() {
    let (_folder, _, pages) = indexed(200_000);
    let octree = pages.octree();
    let groups = groups(octree, &weights(&pages), 30_000);
    for group in &groups {
        let points: u64 = group.nodes.iter().map(|node| octree.node(*node).total).sum();
        assert!(points <= 30_000, "{points}");
    }
    for chunk in all(&pages) {
        for index in (0..chunk.len()).step_by(50) {
            let position = chunk.position(index);
            let holding = groups
                .iter()
                .flat_map(|group| &group.cells)
                .filter(|cell| holds(&space(octree, **cell, Cell::ROOT), position));
            assert_eq!(holding.count(), 1, "{position}");
        }
    }
    for stray in [DVec3::splat(1e9), DVec3::splat(-1e9), octree.corner, octree.corner + octree.width / 2.0] {
        let holding = groups
            .iter()
            .flat_map(|group| &group.cells)
            .filter(|cell| holds(&space(octree, **cell, Cell::ROOT), stray));
        assert_eq!(holding.count(), 1, "{stray}");
    }
}

#[test]
fn an_estimate_that_was_killed_goes_on_from_the_groups_that_are_done() {
    let (_folder, _, pages) = indexed(100_000);
    let identity = identity(pages.key(), pages.octree(), &OPTIONS);
    let mut build = Build::start(&pages, &OPTIONS, 20_000, &identity).unwrap();
    for index in 0..3 {
        let own = build.estimate(&build.groups[index], &Progress::default()).unwrap();
        build.done.write_all(&write_entry(index, own)).unwrap();
    }
    // The estimate is killed while it writes an entry.
    build.done.write_all(&write_entry(3, 17)[..9]).unwrap();
    drop(build);
    assert!(!reopened(&pages).has_surfels(), "what is not complete is not there");
    let again = Build::start(&pages, &OPTIONS, 20_000, &identity).unwrap();
    assert_eq!(again.is_done.iter().filter(|done| **done).count(), 3);
    drop(again);
    estimate_in_groups(&pages, &OPTIONS, 20_000, &Progress::default()).unwrap();
    let resumed = all(&reopened(&pages));

    let other = SurfelOptions { neighbours: 8, ..OPTIONS };
    let fresh = Build::start(&pages, &other, 20_000, &super::identity(pages.key(), pages.octree(), &other)).unwrap();
    assert!(fresh.is_done.iter().all(|done| !done), "other options are another estimate");
    drop(fresh);
    clear(pages.folder()).unwrap();
    std::fs::remove_file(pages.folder().join(SURFELS)).unwrap();
    estimate_in_groups(&pages, &OPTIONS, 20_000, &Progress::default()).unwrap();
    for (resumed, whole) in resumed.iter().zip(all(&reopened(&pages))) {
        assert_eq!((&resumed.normals, &resumed.radii), (&whole.normals, &whole.radii));
    }
}

#[test]
fn other_options_replace_what_is_there_and_the_same_do_not() {
    let (_folder, _, pages) = indexed(30_000);
    let estimate = |options: &SurfelOptions| {
        estimate_surfels(&reopened(&pages), options, 1 << 30, &Progress::default()).unwrap();
        std::fs::metadata(pages.folder().join(SURFELS)).unwrap().modified().unwrap()
    };
    let first = estimate(&OPTIONS);
    assert_eq!(estimate(&OPTIONS), first);
    let down = SurfelOptions {
        neighbours: 8,
        orientation: Orientation::Toward(DVec3::new(431_000.0, 5_412_000.0, -1e6)),
        radii: cloud::RadiusRule::Narrow,
        seen_from: None,
    };
    assert_ne!(estimate(&down), first);
    let pages = reopened(&pages);
    let made = pages.surfel_options().map(|options| (options.orientation, options.radii));
    assert_eq!(made, Some((down.orientation, down.radii)));
    let normals = all(&pages).into_iter().flat_map(|chunk| chunk.normals.unwrap().to_vec());
    assert!(normals.filter_map(unpack_normal).all(|normal| normal.z < 0.0));
    let leftovers = [UNFINISHED, DONE].map(|name| pages.folder().join(name).exists());
    assert_eq!(leftovers, [false; 2]);
}

#[test]
fn a_cancelled_estimate_leaves_no_surfels_and_can_be_made_again() {
    let (_folder, _, pages) = indexed(30_000);
    let progress = Progress::default();
    progress.cancel();
    assert!(matches!(estimate_surfels(&pages, &OPTIONS, 1 << 30, &progress), Err(Error::Cancelled)));
    assert!(!reopened(&pages).has_surfels());
    estimate_surfels(&pages, &OPTIONS, 1 << 30, &Progress::default()).unwrap();
    assert!(reopened(&pages).has_surfels());
}

#[test]
fn damaged_surfels_are_an_error_or_as_if_they_were_not_there() {
    let (_folder, _, pages) = indexed(30_000);
    estimate_surfels(&pages, &OPTIONS, 1 << 30, &Progress::default()).unwrap();
    let path = pages.folder().join(SURFELS);
    let good = std::fs::read(&path).unwrap();
    let with = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        reopened(&pages)
    };
    for place in [0, 9, 13, 20, 40, HEAD_BYTES - 1, HEAD_BYTES + 1] {
        let mut bytes = good.clone();
        bytes[place] ^= 0x40;
        assert!(!with(&bytes).has_surfels(), "byte {place}");
    }
    assert!(!with(&good[..good.len() - 1]).has_surfels());
    assert!(!with(&[]).has_surfels());
    let mut bytes = good.clone();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    let pages = with(&bytes);
    let reads: Vec<bool> = pages.octree().ids().map(|(node, _)| pages.read(node).is_ok()).collect();
    assert_eq!(reads.iter().filter(|good| !**good).count(), 1, "the last node's");
    assert!(!reads[reads.len() - 1]);
}

#[test]
fn the_coarsest_levels_tell_the_orientation() {
    let (_folder, _, pages) = indexed(200_000);
    let coarse = coarsest(&pages, 0).unwrap();
    assert_eq!(coarse.len(), 1);
    assert_eq!(cloud::guess_orientation(&coarse, Vec3::Z), Orientation::Up(Vec3::Z));
    assert_eq!(coarsest(&pages, u64::MAX).unwrap().len(), pages.octree().nodes.len());
}

#[test]
fn a_hundred_thousand_points_at_one_place_are_one_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("heap.las");
    let mut points = hills(30_000);
    // Nodes so far down that no group divides them: two places with many points, a millimetre apart, and one point far
    // away.
    points.extend((0..150_000).map(|index| [50_000 + index % 2, 50_000, 1000]));
    points.push([2_000_000_000, 2_000_000_000, 0]);
    write_las(&path, &points);
    let source = Arc::new(codec::open(&path).unwrap());
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let pages =
        build(std::slice::from_ref(&source), &cache, &BuildOptions::default(), &Progress::default(), &|_| {}).unwrap();
    let identity = identity(pages.key(), pages.octree(), &OPTIONS);
    let build = Build::start(&pages, &OPTIONS, 20_000, &identity).unwrap();
    for group in &build.groups {
        let seen: usize = build.load(group).unwrap().iter().map(|part| part.chunk.len()).sum();
        assert!(seen < 40_000, "{seen} points at once");
    }
    drop(build);
    let progress = Progress::default();
    estimate_in_groups(&pages, &OPTIONS, 20_000, &progress).unwrap();
    assert_eq!(progress.done(), progress.total());
    // Points that share a page or a chunk with the far point may be a few centimetres off.
    let (mut paged, mut memory) = (paged(&all(&reopened(&pages))), in_memory(&source));
    paged.retain(|place, _| memory.contains_key(place));
    memory.retain(|place, _| paged.contains_key(place));
    assert!(paged.len() > 29_990, "{}", paged.len());
    let share = differing(&paged, &memory);
    assert!(share < 1e-3, "{share}");
}

#[cfg(unix)]
#[test]
fn an_estimate_whose_index_is_replaced_or_deleted_touches_nothing_else() {
    let is_replaced = |result: Result<()>| match result {
        Err(Error::Damaged { problem, .. }) => problem.contains("replaced or deleted"),
        _ => false,
    };
    for replaced in [true, false] {
        let (_folder, _, pages) = indexed(60_000);
        let folder = pages.folder().to_owned();
        let identity = identity(pages.key(), pages.octree(), &OPTIONS);
        let mut build = Build::start(&pages, &OPTIONS, 20_000, &identity).unwrap();
        let aside = folder.with_extension("aside");
        std::fs::rename(&folder, &aside).unwrap();
        let theirs = ["nodes", "pages", UNFINISHED, DONE];
        if replaced {
            // The same index, made by another program that estimates, too.
            std::fs::create_dir(&folder).unwrap();
            for name in &theirs[..2] {
                std::fs::copy(aside.join(name), folder.join(name)).unwrap();
            }
            theirs[2..].iter().for_each(|name| std::fs::write(folder.join(name), "theirs").unwrap());
        } else {
            std::fs::remove_dir_all(&aside).unwrap();
        }
        let progress = Progress::default();
        assert!(is_replaced(build.run(&progress).and_then(|()| build.finish(&identity))));
        drop(build);
        assert!(is_replaced(estimate_surfels(&pages, &OPTIONS, 1 << 30, &progress)));
        if replaced {
            assert_eq!(std::fs::read_dir(&folder).unwrap().count(), theirs.len());
            assert!(theirs[2..].iter().all(|name| std::fs::read(folder.join(name)).unwrap() == b"theirs"));
        } else {
            assert!(!folder.exists());
        }
    }
}
