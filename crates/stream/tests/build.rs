//! An index holds exactly what the files hold, whatever they are and however little memory there is.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use cloud::{Chunk, Cloud, Progress};
use codec::{Selection, Source};
use glam::DVec3;
use stream::{BATCHES, BuildOptions, Cache, NodeId, Pages, Previewed, build, prefix};

mod made_up;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;
use made_up::{OFFSET, Point, SCALE, gps_time, terrain, write_las, write_las_with};
use real_data::test_data;

fn open(path: &Path) -> Arc<Source> {
    Arc::new(codec::open(path).unwrap())
}

fn tiny_memory() -> BuildOptions {
    BuildOptions { memory: 1 << 20, preview_points: 0 }
}

fn index_with(inputs: &[Arc<Source>], folder: &Path, options: &BuildOptions) -> Pages {
    let cache = Cache::new(folder.join("cache"), u64::MAX);
    build(inputs, &cache, options, &Progress::default(), &|_| ()).unwrap()
}

fn index(inputs: &[Arc<Source>], folder: &Path) -> Pages {
    index_with(inputs, folder, &BuildOptions::default())
}

/// A point as bits: coordinates (whole steps of the grid), colour, normal, attributes.
type Bits = ([i64; 3], [u8; 4], u32, Vec<u64>);

/// How often each point occurs.
type Bag = HashMap<Bits, usize>;

const KEPT: [&str; 3] = ["intensity", "classification", "return_number"];

fn add(bag: &mut Bag, cloud: &Cloud, chunk: &Chunk, columns: &[usize]) {
    for index in 0..chunk.len() {
        let world = cloud.world_position(chunk, index);
        if !world.is_finite() {
            continue;
        }
        // In steps of the grid from the world's origin: files may have different offsets.
        let at = cloud.grid.map_or(world, |grid| world / grid.scale);
        let color = chunk.colors.as_ref().map_or([0; 4], |colors| colors[index]);
        let normal = chunk.normals.as_ref().map_or(0, |normals| normals[index]);
        let values = columns.iter().map(|column| chunk.columns[*column].as_ref().unwrap().value(index).to_bits());
        let bits = (at.round().to_array().map(|value| value as i64), color, normal, values.collect());
        *bag.entry(bits).or_default() += 1;
    }
}

/// All points of some files.
fn points_of(inputs: &[Arc<Source>]) -> Bag {
    let bag = Mutex::new(Bag::new());
    for input in inputs {
        let info = input.info();
        let cloud = Cloud { grid: info.grid, ..Cloud::default() };
        let column = |name: &&str| info.attributes.iter().position(|attribute| attribute.name == **name);
        let columns: Vec<usize> = KEPT.iter().filter_map(column).collect();
        let selection = Selection {
            positions: true,
            colors: true,
            normals: true,
            attributes: (0..info.attributes.len()).map(|index| columns.contains(&index)).collect(),
        };
        let emit = |chunk: Chunk| add(&mut bag.lock().unwrap(), &cloud, &chunk, &columns);
        input.read(&selection, &Progress::default(), &emit).unwrap();
    }
    bag.into_inner().unwrap()
}

/// All points of an index; checks each node on the way.
fn points_in(pages: &Pages) -> Bag {
    let cloud = Cloud { grid: pages.grid(), ..Cloud::default() };
    let columns: Vec<usize> = (0..pages.attributes().len()).collect();
    let mut bag = Bag::new();
    let mut first_point = 0;
    for (id, node) in pages.octree().ids() {
        let chunk = pages.read(id).unwrap();
        assert_eq!((chunk.len(), chunk.first_point), (node.points as usize, first_point), "{id:?}");
        assert!((1..=cloud::CHUNK_POINTS).contains(&chunk.len()));
        let bounds = chunk.bounds();
        let slack = (node.bounds.size().max_element() + bounds.max.abs().max_element()) * 1e-7;
        assert!(bounds.min.cmpge(node.bounds.min - slack).all() && bounds.max.cmple(node.bounds.max + slack).all());
        let below: u64 = node.children.iter().flatten().map(|child| pages.octree().node(*child).total).sum();
        assert_eq!(node.total, below + u64::from(node.points));
        first_point += u64::from(node.points);
        add(&mut bag, &cloud, &chunk, &columns);
    }
    bag
}

/// Fails with the points that differ, but not with all of them.
fn assert_same(found: &Bag, expected: &Bag) {
    let count = |bag: &Bag| bag.values().sum::<usize>();
    let wrong = expected.iter().filter(|(point, count)| found.get(*point) != Some(count)).take(3).collect::<Vec<_>>();
    assert!(wrong.is_empty(), "of {} points in {}: {wrong:?}", count(expected), count(found));
    assert_eq!(count(found), count(expected));
}

fn assert_holds_all(inputs: &[Arc<Source>], pages: &Pages) {
    assert_same(&points_in(pages), &points_of(inputs));
}

#[test]
fn every_point_of_a_las_file_is_in_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    write_las(&path, &terrain(300_000));
    let inputs = [open(&path)];
    let pages = index(&inputs, folder.path());
    assert!(pages.octree().nodes.len() > 4);
    assert_holds_all(&inputs, &pages);
}

#[test]
fn an_index_keeps_what_it_is_asked_for_beside_the_one_without() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    let points = terrain(30_000);
    write_las(&path, &points);
    let inputs = [open(&path)];
    let usual = index(&inputs, folder.path());
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let keeping = |names: &[&str]| cache.keeping(names.iter().map(|name| String::from(*name)).collect());
    // What every index keeps, or no file has, needs no other one.
    let same = keeping(&["intensity", "of_no_file"]).open(&inputs).unwrap().unwrap();
    assert_eq!((same.folder(), same.attributes()), (usual.folder(), usual.attributes()));
    let asked = keeping(&["gps_time", "of_no_file"]);
    assert!(asked.open(&inputs).unwrap().is_none());
    let pages = build(&inputs, &asked, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    assert_ne!(pages.key(), usual.key());
    let names: Vec<&str> = pages.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    assert_eq!(names, ["intensity", "classification", "return_number", "gps_time"]);
    // Every point has its own time still: that of its intensity.
    let mut times = 0;
    for (id, _) in pages.octree().ids() {
        let chunk = pages.read(id).unwrap();
        let [intensity, time] = [0, 3].map(|column| chunk.columns[column].clone().unwrap());
        assert!((0..chunk.len()).all(|point| time.value(point) == intensity.value(point) * 0.25));
        times += chunk.len();
    }
    assert_eq!((times, gps_time(&points[9])), (points.len(), 2.25));
    // The two indexes stay, and are found by what is asked for.
    for (cache, found) in [(cache.clone(), &usual), (asked, &pages)] {
        assert_eq!(cache.open(&inputs).unwrap().unwrap().folder(), found.folder());
    }
}

#[test]
fn little_memory_gives_the_same_index() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    write_las(&path, &terrain(400_000));
    let inputs = [open(&path)];
    let pages = index_with(&inputs, folder.path(), &tiny_memory());
    assert_holds_all(&inputs, &pages);
}

#[test]
fn every_point_of_the_test_data_is_in_one_node() {
    let Some(folder) = test_data() else { return };
    let mut seen = 0;
    for section in ["airborne", "terrestrial", "las_matrix", "copc", "same_cloud_four_files"] {
        let Ok(files) = std::fs::read_dir(folder.join(section)) else { continue };
        for path in files.flatten().map(|file| file.path()).filter(|path| path.extension().is_some_and(|e| e != "ply"))
        {
            // Large files take a while; their formats occur in the small ones, too.
            let Some(source) = codec::open(&path).ok().filter(|source| (1..300_000).contains(&source.info().points))
            else {
                continue;
            };
            let inputs = [Arc::new(source)];
            let cache = tempfile::tempdir().unwrap();
            let pages = index_with(&inputs, cache.path(), &BuildOptions { memory: 8 << 20, preview_points: 0 });
            println!("{}: {} nodes", path.display(), pages.octree().nodes.len());
            assert_eq!(pages.grid().map(|grid| grid.scale), inputs[0].info().grid.map(|grid| grid.scale));
            let info = inputs[0].info();
            let size = pages.octree().nodes[0].bounds.size();
            if (size / info.grid.unwrap().scale).max_element() < (1 << 23) as f64 {
                assert_holds_all(&inputs, &pages);
            } else {
                // The file's own chunks are too coarse.
                assert_same_places(&inputs, &pages, size.max_element() * 0.5_f64.powi(22));
            }
            seen += 1;
        }
    }
    assert!(seen > 20, "{seen} files");
}

/// Pairs each point of a file with one of an index whose place differs by `tolerance` at most.
fn assert_same_places(inputs: &[Arc<Source>], pages: &Pages, tolerance: f64) {
    type Rest = ([u8; 4], u32);
    let points = |chunk: &Chunk| -> Vec<(DVec3, Rest)> {
        let color = |index: usize| chunk.colors.as_ref().map_or([255; 4], |colors| colors[index]);
        let normal = |index: usize| chunk.normals.as_ref().map_or(cloud::NO_NORMAL, |normals| normals[index]);
        let place = |index: usize| match &chunk.exact_positions {
            Some(exact) => DVec3::from(exact[index]),
            None => chunk.position(index),
        };
        let all = (0..chunk.len()).map(|index| (place(index), (color(index), normal(index))));
        all.filter(|(place, _)| place.is_finite()).collect()
    };
    let cell = |place: DVec3, shift: DVec3| (place / (4.0 * tolerance) + shift).floor().to_array().map(|v| v as i64);
    let mut found: HashMap<[i64; 3], Vec<(DVec3, Rest)>> = HashMap::new();
    for (id, _) in pages.octree().ids() {
        for point in points(&pages.read(id).unwrap()) {
            found.entry(cell(point.0, DVec3::ZERO)).or_default().push(point);
        }
    }
    let found = Mutex::new(found);
    for input in inputs {
        let take = |chunk: Chunk| {
            let mut found = found.lock().unwrap();
            for (place, rest) in points(&chunk) {
                let near = (0..8).map(|corner| {
                    let side = |bit: usize| if corner >> bit & 1 == 0 { -0.5 } else { 0.5 };
                    cell(place, DVec3::new(side(0), side(1), side(2)))
                });
                let mut near = near;
                let taken = near.any(|cell| {
                    let Some(candidates) = found.get_mut(&cell) else { return false };
                    let same = |(other, its): &(DVec3, Rest)| other.distance(place) <= tolerance && *its == rest;
                    candidates.iter().position(same).is_some_and(|index| {
                        candidates.swap_remove(index);
                        true
                    })
                });
                assert!(taken, "{place} {rest:?} of {}", input.info().path.display());
            }
        };
        let selection = Selection { positions: true, colors: true, normals: true, attributes: Vec::new() };
        input.read(&selection, &Progress::default(), &take).unwrap();
    }
    assert_eq!(found.into_inner().unwrap().values().map(Vec::len).sum::<usize>(), 0);
}

#[test]
fn points_of_ply_files_come_back_to_less_than_their_own_precision() {
    let Some(folder) = test_data() else { return };
    let files = std::fs::read_dir(folder.join("ply")).unwrap();
    let mut seen = 0;
    for path in files.flatten().map(|file| file.path()) {
        let Some(source) = codec::open(&path).ok().filter(|source| (1..150_000).contains(&source.info().points)) else {
            continue;
        };
        let inputs = [Arc::new(source)];
        let cache = tempfile::tempdir().unwrap();
        let pages = index(&inputs, cache.path());
        let bounds = pages.octree().nodes[0].bounds;
        // Half a step of f32 at the far side of the cloud.
        let tolerance =
            bounds.size().max_element() * 0.5_f64.powi(24) + bounds.max.abs().max_element() * 0.5_f64.powi(51);
        println!("{}: {} nodes, {tolerance}", path.display(), pages.octree().nodes.len());
        assert!(pages.grid().is_none());
        assert_same_places(&inputs, &pages, tolerance);
        seen += 1;
    }
    assert!(seen > 10, "{seen} files");
}

#[test]
fn an_index_keeps_the_last_distances_that_were_added_to_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changes.ply");
    let names = ["x", "y", "z", "distance", "other", "distance_2", "distance_far", "level_of_detection"];
    let properties: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let place = |index: u32| [index % 50, index / 50, 0];
    let row = |index: u32| {
        let [x, y, z] = place(index);
        format!("{x} {y} {z} -1 -2 {} -3 {}\n", f64::from(index) * 0.5, index + 7)
    };
    let rows: String = (0..2000).map(row).collect();
    let header = format!("ply\nformat ascii 1.0\nelement vertex 2000\n{properties}end_header\n");
    std::fs::write(&path, header + &rows).unwrap();
    let pages = index(&[open(&path)], folder.path());
    let kept: Vec<&str> = pages.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
    assert_eq!(kept, ["distance_2", "level_of_detection"]);
    let mut seen = 0;
    for (id, _) in pages.octree().ids() {
        let chunk = pages.read(id).unwrap();
        for index in 0..chunk.len() {
            let [x, y, _] = chunk.position(index).round().to_array().map(|value| value as u32);
            let number = f64::from(x + 50 * y);
            let value = |column: usize| chunk.columns[column].as_ref().unwrap().value(index);
            assert_eq!([value(0), value(1)], [number * 0.5, number + 7.0]);
            seen += 1;
        }
    }
    assert_eq!(seen, 2000);
}

#[test]
fn an_attribute_that_one_of_several_files_lacks_has_no_value_there() {
    let folder = tempfile::tempdir().unwrap();
    // Each file has a row of points of its own.
    let write = |row: u32, more: &str, values: &str| {
        let path = folder.path().join(format!("{row}.ply"));
        let rows: String = (0..1000).map(|x| format!("{x} {row} 0 {values}\n")).collect();
        let place = "property float x\nproperty float y\nproperty float z\n";
        let header = format!("ply\nformat ascii 1.0\nelement vertex 1000\n{place}{more}end_header\n");
        std::fs::write(&path, header + &rows).unwrap();
        open(&path)
    };
    let inputs = [
        write(0, "", ""),
        write(1, "property uchar quality\nproperty short height\nproperty uchar classification\n", "9 -7 2"),
        write(2, "property uchar quality\nproperty float height\n", "8 0.5"),
    ];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let asked = cache.keeping(["quality", "height"].map(String::from).into());
    let pages = build(&inputs, &asked, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    let kept: Vec<(&str, &str)> =
        pages.attributes().iter().map(|own| (own.name.as_str(), own.column_type.name())).collect();
    assert_eq!(kept, [("classification", "u8"), ("height", "f64"), ("quality", "f32")]);
    let mut seen = 0;
    for (id, _) in pages.octree().ids() {
        let chunk = pages.read(id).unwrap();
        for index in 0..chunk.len() {
            let value = |column: usize| chunk.columns[column].as_ref().unwrap().text(index);
            let expected =
                [["0", "", ""], ["2", "-7", "9"], ["0", "0.5", "8"]][chunk.position(index).y.round() as usize];
            assert_eq!([value(0), value(1), value(2)], expected);
            seen += 1;
        }
    }
    assert_eq!(seen, 3000);
}

/// The cubes of all nodes: lower corner and width.
fn cubes(pages: &Pages) -> Vec<(DVec3, f64)> {
    let octree = pages.octree();
    let mut cubes = vec![(octree.corner, octree.width)];
    for node in &octree.nodes[1..] {
        let NodeId(parent) = node.parent.unwrap();
        let (corner, width) = cubes[parent as usize];
        let id = NodeId(cubes.len() as u32);
        let octant = octree.nodes[parent as usize].children.iter().position(|child| *child == Some(id)).unwrap();
        let half = width / 2.0;
        let upper = DVec3::new((octant & 1) as f64, (octant >> 1 & 1) as f64, (octant >> 2 & 1) as f64);
        cubes.push((corner + upper * half, half));
    }
    cubes
}

fn cloud_of(count: usize) -> (tempfile::TempDir, [Arc<Source>; 1]) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    write_las(&path, &terrain(count));
    let inputs = [open(&path)];
    (folder, inputs)
}

#[test]
fn points_lie_in_the_cubes_of_their_nodes() {
    let (folder, inputs) = cloud_of(300_000);
    let pages = index_with(&inputs, folder.path(), &tiny_memory());
    for ((id, _), (corner, width)) in pages.octree().ids().zip(cubes(&pages)) {
        let chunk = pages.read(id).unwrap();
        for index in 0..chunk.len() {
            let inside = (chunk.position(index) - corner) / width;
            assert!(inside.cmpge(DVec3::splat(-1e-6)).all() && inside.cmple(DVec3::splat(1.0 + 1e-6)).all(), "{id:?}");
        }
    }
}

#[test]
fn a_prefix_of_batches_has_its_share_in_each_octant() {
    let (folder, inputs) = cloud_of(300_000);
    let pages = index(&inputs, folder.path());
    for ((id, node), (corner, width)) in pages.octree().ids().zip(cubes(&pages)) {
        let chunk = pages.read(id).unwrap();
        let octants = |count: usize| {
            let mut octants = [0_usize; 8];
            for index in 0..count {
                let upper = chunk.position(index).cmpge(corner + width / 2.0);
                octants[upper.bitmask() as usize] += 1;
            }
            octants
        };
        let all = octants(chunk.len());
        for batches in 1..BATCHES {
            let some = octants(prefix(chunk.len(), batches));
            for octant in 0..8 {
                // Each batch is off by less than one point; some lie so near the middle that rounding decides.
                let share = all[octant] as f64 * batches as f64 / BATCHES as f64;
                let off = (some[octant] as f64 - share).abs();
                assert!(off <= batches as f64 + 2.0, "{id:?} of {} points: {share} {some:?}", node.points);
            }
        }
    }
}

#[test]
fn inner_nodes_hold_one_point_of_a_cell() {
    let (folder, inputs) = cloud_of(400_000);
    let pages = index_with(&inputs, folder.path(), &tiny_memory());
    let cubes = cubes(&pages);
    for (id, node) in pages.octree().ids().filter(|(_, node)| node.children.iter().any(Option::is_some)) {
        let (corner, width) = cubes[id.0 as usize];
        let chunk = pages.read(id).unwrap();
        let cell = |index: usize| ((chunk.position(index) - corner) / (width / 128.0)).as_ivec3();
        let cells: std::collections::HashSet<_> = (0..chunk.len()).map(cell).collect();
        // Children of few points are part of their parent; some points lie on the edge of a cell.
        let whole = node.children.iter().flatten().count() >= 4 && node.level == 0;
        let few = if whole { chunk.len() / 1000 } else { 8 * 2000 };
        assert!(cells.len() + few >= chunk.len(), "{} points in {} cells", chunk.len(), cells.len());
    }
}

#[test]
fn nodes_are_neither_tiny_nor_huge() {
    let (folder, inputs) = cloud_of(1_000_000);
    let pages = index(&inputs, folder.path());
    let mut sizes: Vec<u32> = pages.octree().nodes.iter().map(|node| node.points).collect();
    sizes.sort_unstable();
    assert!(sizes[0] >= 1000 && (5_000..50_000).contains(&sizes[sizes.len() / 2]), "{sizes:?}");
    let bytes = pages.octree().ids().map(|(id, _)| pages.page_bytes(id)).sum::<usize>() as f64 / 1e6;
    assert!(bytes <= 14.0, "{bytes} bytes a point: more than position, colour, intensity, class and return take");
}

#[test]
fn points_in_one_place_end_in_nodes_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("heap.las");
    let mut points = terrain(60_000);
    let heap = |index: u32| Point { at: [500_000, 500_000, 50_000], intensity: index as u16, ..Point::default() };
    points.extend((0..200_000).map(heap));
    write_las(&path, &points);
    let inputs = [open(&path)];
    for options in [BuildOptions::default(), tiny_memory()] {
        let cache = tempfile::tempdir().unwrap();
        let pages = index_with(&inputs, cache.path(), &options);
        assert_holds_all(&inputs, &pages);
        assert!(pages.octree().nodes.len() < 80, "{} nodes", pages.octree().nodes.len());
    }
}

#[test]
fn a_cloud_that_is_one_place_is_indexed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("heap.las");
    write_las(&path, &vec![Point::default(); 300_000]);
    let inputs = [open(&path)];
    for options in [BuildOptions::default(), tiny_memory()] {
        let cache = tempfile::tempdir().unwrap();
        let pages = index_with(&inputs, cache.path(), &options);
        assert_holds_all(&inputs, &pages);
        assert!(pages.octree().nodes.len() < 40, "{} nodes", pages.octree().nodes.len());
    }
}

#[test]
fn one_point_ten_thousand_kilometres_away_does_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stray.las");
    let mut points = terrain(200_000);
    points.push(Point { at: [1_000_000_000, 1_000_000_000, 0], ..Point::default() });
    write_las_with(&path, &points, 0.01, OFFSET, |_, _| ());
    let inputs = [open(&path)];
    for options in [BuildOptions::default(), tiny_memory()] {
        let cache = tempfile::tempdir().unwrap();
        let pages = index_with(&inputs, cache.path(), &options);
        assert_holds_all(&inputs, &pages);
        let nodes = &pages.octree().nodes;
        let full = nodes.iter().filter(|node| node.points > 5_000).map(|node| u64::from(node.points)).sum::<u64>();
        assert!(full > 150_000, "most points lie in nodes of some size: {full}");
        assert!(nodes.iter().all(|node| node.level < 24) && nodes.len() < 80, "{} nodes", nodes.len());
    }
}

#[test]
fn points_that_are_no_numbers_are_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nan.ply");
    let mut text = "ply\nformat ascii 1.0\nelement vertex 1000\nproperty float x\nproperty float y\nproperty float z\nend_header\n".to_owned();
    for index in 0..1000 {
        text.push_str(&if index % 10 == 3 { "nan 1 inf\n".into() } else { format!("{index} {} 2\n", index * 7 % 13) });
    }
    std::fs::write(&path, text).unwrap();
    let inputs = [open(&path)];
    let pages = index(&inputs, folder.path());
    assert_eq!((pages.octree().points(), pages.skipped_points()), (900, 100));
    assert_same_places(&inputs, &pages, 1e-5);
}

#[test]
fn several_files_are_one_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, shift: f64| {
        let path = folder.path().join(name);
        write_las_with(&path, &terrain(60_000), SCALE, [OFFSET[0] + shift, OFFSET[1], OFFSET[2]], |_, _| ());
        open(&path)
    };
    // One next to the first, one four thousand kilometres away (its grid integers from there take more than 32 bits).
    for (shift, name) in [(1_000.0, "near"), (4_000_000.0, "far")] {
        let inputs = [file(&format!("{name}-one.las"), 0.0), file(&format!("{name}-two.las"), shift)];
        let pages = index_with(&inputs, folder.path(), &tiny_memory());
        assert!(pages.grid().is_some());
        assert_holds_all(&inputs, &pages);
    }
}

#[test]
fn headers_that_lie_about_bounds_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (number, factor) in [0.1, 1e6].into_iter().enumerate() {
        let path = folder.path().join(format!("liar-{number}.las"));
        write_las_with(&path, &terrain(100_000), SCALE, OFFSET, |least, greatest| {
            for axis in 0..3 {
                greatest[axis] = least[axis] + (greatest[axis] - least[axis]) * factor;
            }
        });
        let inputs = [open(&path)];
        let pages = index(&inputs, folder.path());
        assert_holds_all(&inputs, &pages);
        assert!(pages.octree().nodes.iter().filter(|node| node.points > 5_000).count() > 3);
    }
}

#[test]
fn the_same_files_give_the_same_index() {
    let (folder, inputs) = cloud_of(300_000);
    let indexes = [1, 2].map(|number| index_with(&inputs, &folder.path().join(number.to_string()), &tiny_memory()));
    assert_eq!(indexes[0].octree(), indexes[1].octree());
    for (id, _) in indexes[0].octree().ids() {
        let [one, two] = [0, 1].map(|index| indexes[index].read(id).unwrap());
        assert_eq!((one.origin, &one.positions, &one.colors), (two.origin, &two.positions, &two.colors));
        assert_eq!(one.columns, two.columns);
    }
}

#[test]
fn decoded_points_take_as_many_bytes_as_an_index_says() {
    for (steps, some_exact) in [(1, false), (100, true)] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.las");
        let wider = |point: Point| Point { at: point.at.map(|value| value * steps), ..point };
        write_las(&path, &terrain(300_000).into_iter().map(wider).collect::<Vec<_>>());
        let pages = index(&[open(&path)], folder.path());
        let mut exact = 0;
        for (id, node) in pages.octree().ids() {
            // The index has neither normals nor radii yet.
            let bytes = pages.read(id).unwrap().size_in_bytes() as u64 + 6 * u64::from(node.points);
            assert_eq!(bytes, u64::from(node.points) * node.point_bytes(pages.point_bytes()));
            exact += usize::from(node.is_exact);
        }
        assert_eq!(exact > 0, some_exact);
    }
}

#[test]
fn a_preview_is_thinned_and_progress_counts_all_points_twice() {
    let (folder, inputs) = cloud_of(200_000);
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let shown = Mutex::new(Vec::new());
    let progress = Progress::default();
    let options = BuildOptions { memory: 1 << 24, preview_points: 5_000 };
    let show = |change: Previewed| match change {
        Previewed::Share(chunk) => shown.lock().unwrap().push(chunk),
        Previewed::First(..) | Previewed::FirstGone(_) => panic!("LAS has no compressed chunks"),
    };
    let pages = build(&inputs, &cache, &options, &progress, &show).unwrap();
    let shown = shown.into_inner().unwrap();
    let points: usize = shown.iter().map(Chunk::len).sum();
    assert!((4_990..=5_000).contains(&points), "{points}: no more than were asked for");
    assert_eq!(shown.len(), 1, "not a chunk for each that was read");
    assert!(shown.iter().all(|chunk| chunk.columns.len() == pages.attributes().len() && chunk.colors.is_some()));
    assert_eq!((progress.done(), progress.total()), (400_000, 400_000));
}
