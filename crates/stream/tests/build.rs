//! What an index holds is what the files hold, whatever they are and however little memory there is.
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Arc, Mutex};

use cloud::{Chunk, Cloud, Progress};
use codec::{Selection, Source};
use stream::{BuildOptions, Cache, Pages, build};

mod made_up;
use made_up::{Noise, Point, write_las};

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

/// A point as bits: coordinates (grid integers, or steps of `step`), colour, attributes.
type Bits = ([i64; 3], [u8; 4], u32, Vec<u64>);

/// How often each point occurs.
type Bag = HashMap<Bits, usize>;

const KEPT: [&str; 3] = ["intensity", "classification", "return_number"];

fn add(bag: &mut Bag, cloud: &Cloud, chunk: &Chunk, columns: &[usize], step: Option<f64>) {
    for index in 0..chunk.len() {
        let world = cloud.world_position(chunk, index);
        if !world.is_finite() {
            continue;
        }
        let at = match (cloud.grid, step) {
            (Some(grid), None) => (world - grid.offset) / grid.scale,
            (_, step) => world / step.unwrap(),
        };
        let color = chunk.colors.as_ref().map_or([0; 4], |colors| colors[index]);
        let normal = chunk.normals.as_ref().map_or(0, |normals| normals[index]);
        let values = columns.iter().map(|column| chunk.columns[*column].as_ref().unwrap().value(index).to_bits());
        let bits = (at.round().to_array().map(|value| value as i64), color, normal, values.collect());
        *bag.entry(bits).or_default() += 1;
    }
}

/// All points of some files.
fn points_of(inputs: &[Arc<Source>], step: Option<f64>) -> Bag {
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
        let emit = |chunk: Chunk| add(&mut bag.lock().unwrap(), &cloud, &chunk, &columns, step);
        input.read(&selection, &Progress::default(), &emit).unwrap();
    }
    bag.into_inner().unwrap()
}

/// All points of an index; checks each node on the way.
fn points_in(pages: &Pages, step: Option<f64>) -> Bag {
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
        add(&mut bag, &cloud, &chunk, &columns, step);
    }
    bag
}

/// Says which points differ, not all of them.
fn assert_same(found: &Bag, expected: &Bag) {
    let count = |bag: &Bag| bag.values().sum::<usize>();
    let wrong = expected.iter().filter(|(point, count)| found.get(*point) != Some(count)).take(3).collect::<Vec<_>>();
    assert!(wrong.is_empty(), "of {} points in {}: {wrong:?}", count(expected), count(found));
    assert_eq!(count(found), count(expected));
}

fn assert_holds_all(inputs: &[Arc<Source>], pages: &Pages) {
    assert_same(&points_in(pages, None), &points_of(inputs, None));
}

/// A hilly square kilometre.
fn terrain(count: usize) -> Vec<Point> {
    let mut noise = Noise(3);
    let mut coordinate = || noise.below(1_000_000) as i32;
    let height = |x: i32, y: i32| {
        ((f64::from(x) * 3e-5).sin() * 20_000.0 + (f64::from(y) * 5e-5).cos() * 9_000.0) as i32 + 40_000
    };
    let point = |index: usize| {
        let (x, y) = (coordinate(), coordinate());
        Point { at: [x, y, height(x, y)], intensity: index as u16, class: (index % 7) as u8, color: [index as u16; 3] }
    };
    (0..count).map(point).collect()
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
fn little_memory_gives_the_same_index() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("terrain.las");
    write_las(&path, &terrain(400_000));
    let inputs = [open(&path)];
    let pages = index_with(&inputs, folder.path(), &tiny_memory());
    assert_holds_all(&inputs, &pages);
}
