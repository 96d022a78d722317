//! Points far from all others, and grids that do not agree, spoil neither the places of points nor the nodes in which
//! they lie.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use cloud::{Cloud, Progress, Random};
use glam::DVec3;
use stream::{BuildOptions, Cache, Pages, build};

mod made_up;
use made_up::{Point, terrain, write_las_with};

/// Nodes with fewer points than this are wasteful pages.
const FEW_POINTS: u32 = 1_000;

fn index(paths: &[&Path], options: &BuildOptions) -> Pages {
    let inputs: Vec<_> = paths.iter().map(|path| Arc::new(codec::open(path).unwrap())).collect();
    let cache = tempfile::tempdir().unwrap();
    let cache = Cache::new(cache.keep(), u64::MAX);
    build(&inputs, &cache, options, &Progress::default(), &|_| ()).unwrap()
}

/// The world positions of all points, as exact as they are known.
fn places(pages: &Pages) -> Vec<DVec3> {
    let cloud = Cloud { grid: pages.grid(), ..Cloud::default() };
    let nodes = pages.octree().ids().map(|(node, _)| pages.read(node).unwrap());
    nodes.flat_map(|chunk| (0..chunk.len()).map(|at| cloud.world_position(&chunk, at)).collect::<Vec<_>>()).collect()
}

/// Every point is found within `tolerance` (on each axis) of where it should be, and none twice.
fn assert_places(found: &[DVec3], expected: impl Iterator<Item = DVec3>, tolerance: f64) {
    let cell = |place: DVec3| (place / (2.0 * tolerance)).floor().to_array().map(|value| value as i64);
    let mut cells: HashMap<[i64; 3], Vec<DVec3>> = HashMap::new();
    found.iter().for_each(|place| cells.entry(cell(*place)).or_default().push(*place));
    for place in expected {
        let near = |candidate: &DVec3| (*candidate - place).abs().max_element() <= tolerance;
        // The point's own cell comes first.
        let taken = (13..40).map(|side| side % 27).any(|side| {
            let [x, y, z] = cell(place);
            let candidates = cells.get_mut(&[x + side % 3 - 1, y + side / 3 % 3 - 1, z + side / 9 - 1]);
            candidates.is_some_and(|list| list.iter().position(near).map(|at| list.swap_remove(at)).is_some())
        });
        assert!(taken, "nothing within {tolerance} of {place}");
    }
    assert_eq!(cells.values().map(Vec::len).sum::<usize>(), 0);
}

fn assert_nodes_are_filled(pages: &Pages, points_far_away: usize) {
    let nodes = &pages.octree().nodes;
    let few = nodes.iter().filter(|node| node.points < FEW_POINTS).count();
    let deepest = nodes.iter().map(|node| node.level).max().unwrap();
    println!("{} nodes, {few} of few points, {deepest} levels", nodes.len());
    assert!(few <= points_far_away.min(1) * 24 && deepest <= 32, "{few} of {} nodes have few points", nodes.len());
}

#[test]
fn points_far_away_leave_the_others_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("strays.las");
    let mut noise = Random(9);
    let scale = 0.01;
    let mut points = terrain(400_000);
    points.iter_mut().for_each(|point| point.at = point.at.map(|value| value / 10));
    // Points a thousand kilometres away, the first of all and some among the others.
    for index in 0..100 {
        let far = std::array::from_fn(|_| noise.below(200_000_000) as i32 - 100_000_000);
        points[index * 3_999] = Point { at: far, ..Point::default() };
    }
    let offset = [500_000.0, 5_000_000.0, 0.0];
    write_las_with(&path, &points, scale, offset, |_, _| ());
    for memory in [1 << 30, 1 << 20] {
        let pages = index(&[&path], &BuildOptions { memory, preview_points: 0 });
        let expected = points.iter().map(|point| DVec3::from(point.at.map(f64::from)) * scale + DVec3::from(offset));
        assert_places(&places(&pages), expected, scale / 100.0);
        assert_nodes_are_filled(&pages, 100);
    }
}

#[test]
fn far_points_leave_the_cube_of_the_tree_and_the_bounds_of_the_scene_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    let tree = |far: Option<i32>| {
        let mut points = terrain(300_000);
        points.extend(far.map(|sizes| Point { at: [600_000 * sizes, -500_000 * sizes, 620_000 * sizes], ..points[0] }));
        write_las_with(&path, &points, 0.001, [0.0; 3], |_, _| ());
        let pages = index(&[&path], &BuildOptions::default());
        assert_eq!(places(&pages).len(), points.len());
        pages.octree().clone()
    };
    let before = tree(None);
    for sizes in [10, 100, 1000] {
        let after = tree(Some(sizes));
        assert!((1.0..1.3).contains(&(after.width / before.width)), "{} and {}", before.width, after.width);
        let [own, with_far] = [&before, &after].map(|octree| octree.scene_bounds().size());
        assert!((own - with_far).abs().max_element() < 0.15 * own.max_element(), "{own} and {with_far}");
        assert!(after.nodes.len() <= before.nodes.len() * 3 / 2, "{} and {}", before.nodes.len(), after.nodes.len());
    }
}

/// Writes a binary file with doubles.
fn write_ply(path: &Path, points: &[DVec3]) {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n",
        points.len()
    )
    .into_bytes();
    points.iter().flat_map(DVec3::to_array).for_each(|value| bytes.extend(value.to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn points_of_a_ply_file_that_are_far_away_or_no_numbers_leave_the_others_where_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("strays.ply");
    let mut points: Vec<DVec3> =
        terrain(400_000).iter().map(|point| DVec3::from(point.at.map(f64::from)) / 1e3).collect();
    for (index, far) in [1e6, -1e6, 1e9, -1e9, f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().enumerate() {
        for axis in 0..3 {
            points[(index * 3 + axis) * 16_000][axis] = far;
        }
    }
    write_ply(&path, &points);
    for memory in [1 << 30, 1 << 20] {
        let pages = index(&[&path], &BuildOptions { memory, preview_points: 0 });
        assert_eq!(pages.skipped_points(), 9);
        let near = |place: &DVec3| place.is_finite() && place.abs().max_element() < 1e5;
        let found: Vec<DVec3> = places(&pages).into_iter().filter(near).collect();
        // A lattice of a thousand million steps across the kilometre.
        assert_places(&found, points.iter().copied().filter(near), 1e-4);
        assert_nodes_are_filled(&pages, 12);
    }
}

#[test]
fn tiles_on_different_grids_keep_their_places_to_half_of_their_steps() {
    let tiles = [
        (0.001, [500_000.0, 5_000_000.0, 0.0]),
        // A grid that is a part of the first.
        (0.01, [501_000.0, 5_000_000.12, 7.0]),
        // Grids that are half a step and a third of a step off.
        (0.001, [500_000.000_5, 5_001_000.000_3, 0.0]),
        (0.01, [501_000.003_333, 5_001_000.007, -12.345_678]),
        (0.0001, [500_123.456_789, 5_000_987.654_321, 0.1]),
        // So far away that steps of the finest take more than 32 bits, and f32 no longer distinguishes those of an
        // inner node.
        (0.01, [800_000.0, 5_300_000.0, 0.0]),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (tiles, inexact) in [(&tiles[..2], 0.0), (&tiles[..], 0.5)] {
        let mut expected = Vec::new();
        let mut paths = Vec::new();
        for (number, (scale, offset)) in tiles.iter().enumerate() {
            let points = terrain(30_000);
            let path = folder.path().join(format!("{number}.las"));
            write_las_with(&path, &points, *scale, *offset, |_, _| ());
            expected.extend(points.iter().map(|p| DVec3::from(p.at.map(f64::from)) * *scale + DVec3::from(*offset)));
            paths.push(path);
        }
        let paths: Vec<&Path> = paths.iter().map(|path| path.as_path()).collect();
        let finest = tiles.iter().map(|(scale, _)| *scale).fold(f64::INFINITY, f64::min);
        let pages = index(&paths, &BuildOptions { memory: 1 << 20, preview_points: 0 });
        assert_eq!(pages.grid().unwrap().scale, DVec3::splat(finest));
        assert_places(&places(&pages), expected.into_iter(), finest * inexact + 1e-8);
    }
}
