//! The law of origins: in whatever order a file has its points, each is where it is to within the file's grid, or to
//! the digits that f32 has for a cloud of this size. Points far from the others cost only their own precision.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;

use std::path::Path;
use std::sync::Mutex;

use cloud::{Chunk, Cloud, Progress, Random};
use codec::{Selection, Source, write_copc};
use glam::DVec3;
use las_files::{Chunks, OFFSETS, SCALE, compress, las_file, points};

const SITE: DVec3 = DVec3::new(OFFSETS[0], OFFSETS[1], OFFSETS[2]);
const COUNT: usize = 70_000;
/// The size of the room in metres.
const SIZE: f64 = 8.0;

/// Steps of the grid of a room of 8 m, of which some points are far away, and whether they are.
fn room(far: usize) -> Vec<([i64; 3], bool)> {
    let mut random = Random(5);
    let mut place = |index: usize| match index < far {
        // Two in three at one place, as pulses without an echo are.
        true if !index.is_multiple_of(3) => ([-2_000_000_000; 3], true),
        true => ([0, 1, 2].map(|_| random.below(1 << 31) as i64 - (1 << 30)), true),
        false => ([0, 1, 2].map(|_| random.below((SIZE / SCALE) as u64) as i64), false),
    };
    (0..COUNT).map(&mut place).collect()
}

fn world(steps: [i64; 3]) -> DVec3 {
    SITE + DVec3::from(steps.map(|step| step as f64)) * SCALE
}

/// Orders of the points: far ones first, last, spread through the file, and at random.
fn orders(count: usize, far: usize) -> Vec<Vec<usize>> {
    let first: Vec<usize> = (0..count).collect();
    let last = first.iter().rev().copied().collect();
    let every = count / far.max(1);
    let (mut strays, mut others) = (0..far, far..count);
    let next = |at: usize| if at.is_multiple_of(every) { strays.next() } else { None }.or_else(|| others.next());
    let mut spread: Vec<usize> = (0..count).filter_map(next).collect();
    spread.extend(strays.chain(others));
    let mut random = Random(8);
    let mut shuffled = first.clone();
    for at in (1..count).rev() {
        shuffled.swap(at, random.below(at as u64 + 1) as usize);
    }
    vec![first, last, spread, shuffled]
}

fn read(source: &Source) -> Cloud {
    let chunks = Mutex::new(Vec::new());
    let selection = Selection { positions: true, ..Selection::default() };
    source.read(&selection, &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    let mut chunks = chunks.into_inner().unwrap();
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    Cloud { grid: source.info().grid, chunks, ..Cloud::default() }
}

/// Checks the points of a file whose point `index` is `points[order[index]]`.
fn check(path: &Path, points: &[([i64; 3], bool)], order: &[usize], what: &str) {
    let source = codec::open(path).unwrap();
    let cloud = read(&source);
    assert_eq!(cloud.len(), order.len() as u64, "{what}");
    for chunk in &cloud.chunks {
        for index in 0..chunk.len() {
            let (steps, is_far) = points[order[chunk.first_point as usize + index]];
            let (found, exact) = (chunk.position(index), cloud.world_position(chunk, index));
            let off = (found - world(steps)).abs().max_element();
            // Of 2,000 km, f32 has 12 cm.
            assert!(off < if is_far { 0.13 } else { SCALE / 2.0 }, "{what}: {found} is {off} off");
            assert!((exact - world(steps)).abs().max_element() < 1e-8, "{what}: {exact}");
        }
    }
}

#[test]
fn points_of_any_file_in_any_order_are_where_they_are_to_within_the_grid() {
    let folder = tempfile::tempdir().unwrap();
    for far in [1, 200, COUNT / 4] {
        let room = room(far);
        for (number, order) in orders(COUNT, far).iter().enumerate() {
            let what = |format: &str| format!("{format}, {far} far points in order {number}");
            let path = |name: &str| folder.path().join(name);
            let mut doubles = format!(
                "ply\nformat binary_little_endian 1.0\nelement vertex {COUNT}\nproperty double x\nproperty double y\n\
                 property double z\nend_header\n"
            )
            .into_bytes();
            let places = order.iter().flat_map(|index| world(room[*index].0).to_array());
            places.for_each(|value| doubles.extend_from_slice(&value.to_le_bytes()));
            std::fs::write(path("doubles.ply"), doubles).unwrap();
            check(&path("doubles.ply"), &room, order, &what("PLY doubles"));

            let mut records = points(1, COUNT);
            for (record, index) in records.iter_mut().zip(order) {
                let place = world(room[*index].0);
                (record.x, record.y, record.z) = (place.x, place.y, place.z);
            }
            let las = las_file((1, 2), 1, &records, &[]);
            std::fs::write(path("points.las"), &las).unwrap();
            check(&path("points.las"), &room, order, &what("LAS"));
            if far == 200 {
                std::fs::write(path("points.laz"), compress(&las, &Chunks::Fixed(50_000))).unwrap();
                check(&path("points.laz"), &room, order, &what("LAZ"));
            }
        }
    }
}

#[test]
fn points_of_the_nodes_of_a_copc_file_are_where_they_are_to_within_the_grid() {
    let folder = tempfile::tempdir().unwrap();
    let room = room(200);
    for (number, order) in orders(COUNT, 200).iter().enumerate() {
        let mut records = points(1, COUNT);
        for (record, index) in records.iter_mut().zip(order) {
            let place = world(room[*index].0);
            // Recognises which point a record is.
            (record.x, record.y, record.z, record.gps_time) = (place.x, place.y, place.z, Some(*index as f64));
        }
        let (input, output) = (folder.path().join("in.las"), folder.path().join(format!("{number}.copc.laz")));
        std::fs::write(&input, las_file((1, 2), 1, &records, &[])).unwrap();
        write_copc(&[input], &output, 256 << 20, &Progress::default()).unwrap();
        let source = codec::open(&output).unwrap();
        let time = source.info().attributes.iter().position(|attribute| attribute.name == "gps_time").unwrap();
        let attributes = (0..source.info().attributes.len()).map(|index| index == time).collect();
        let selection = Selection { positions: true, attributes, ..Selection::default() };
        let (mut seen, mut off_grid) = (0, 0);
        for node in &source.copc().unwrap().nodes {
            let chunk = source.read_copc_node(node, &selection).unwrap();
            seen += chunk.len();
            for index in 0..chunk.len() {
                let (steps, is_far) = room[chunk.columns[time].as_ref().unwrap().value(index) as usize];
                let off = (chunk.position(index) - world(steps)).abs().max_element();
                off_grid += usize::from(!is_far && off > SCALE / 2.0);
            }
        }
        // Coarse nodes have a point of the room among those that are far away.
        assert!(seen == COUNT && off_grid < 20, "order {number}: {seen} points, {off_grid} off the grid");
    }
}

#[test]
fn strays_among_floats_of_a_map_leave_the_others_near_their_origin() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("floats.ply");
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 5000\nproperty float x\nproperty float y\n\
                  property float z\nend_header\n";
    let mut random = Random(4);
    let place = |index: usize, random: &mut Random| match index {
        0 => [0.0; 3],
        2500 => [0.001, -1.7, 0.3],
        _ => [50_000.0, 20_000.0, -3.0].map(|start| (start + random.below(8192) as f64 / 1024.0) as f32),
    };
    let places: Vec<[f32; 3]> = (0..5000).map(|index| place(index, &mut random)).collect();
    let bytes = places.iter().flatten().flat_map(|value| value.to_le_bytes());
    std::fs::write(&path, header.bytes().chain(bytes).collect::<Vec<u8>>()).unwrap();
    let cloud = read(&codec::open(&path).unwrap());
    let chunk = &cloud.chunks[0];
    assert!((chunk.origin - DVec3::new(50_004.0, 20_004.0, 0.0)).abs().max_element() < 8.0, "{}", chunk.origin);
    for (index, place) in places.iter().enumerate() {
        let place = DVec3::from(place.map(f64::from));
        assert_eq!(cloud.world_position(chunk, index), place);
        assert!(index == 2500 || chunk.position(index) == place, "{index}: {}", chunk.position(index));
    }
}
