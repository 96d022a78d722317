//! A COPC file is an index as it is: its pages hold the points that reading the file as LAZ gives.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use cloud::{Chunk, Cloud, Progress, SurfelOptions};
use codec::{Selection, Source};
use glam::DVec3;
use real_data::test_data;
use stream::{BATCHES, Budget, Missing, NodeChange, NodeId, Page, PagedCloud, Pages, Streamer, Wanted, prefix};

const FILES: [&str; 3] =
    ["lone_star_las14_pf6.copc.laz", "ellipsoid_las14_pf7.copc.laz", "simple_with_hierarchy_page.copc.laz"];

fn data(name: &str) -> Option<PathBuf> {
    Some(test_data()?.join("copc").join(name))
}

/// How often each point occurs: grid integers, colour and attributes.
type Bag = BTreeMap<([i64; 3], Option<[u8; 4]>, Vec<u64>), u32>;

fn add(bag: &mut Bag, source: &Source, chunk: &Chunk, columns: &[usize]) {
    let grid = source.info().grid.unwrap();
    let cloud = Cloud { grid: Some(grid), ..Cloud::default() };
    for index in 0..chunk.len() {
        let at = ((cloud.world_position(chunk, index) - grid.offset) / grid.scale).round();
        let value = |column: &usize| chunk.columns[*column].as_ref().unwrap().value(index).to_bits();
        let color = chunk.colors.as_ref().map(|colors| colors[index]);
        let point = (at.to_array().map(|value| value as i64), color, columns.iter().map(value).collect());
        *bag.entry(point).or_default() += 1;
    }
}

fn points_of_file(source: &Source, pages: &Pages) -> Bag {
    let info = source.info();
    let selection =
        Selection { positions: true, colors: true, normals: false, attributes: vec![true; info.attributes.len()] };
    let column = |kept: &cloud::Attribute| info.attributes.iter().position(|other| other == kept).unwrap();
    let columns: Vec<usize> = pages.attributes().iter().map(column).collect();
    let bag = Mutex::new(Bag::new());
    let emit = |chunk: Chunk| add(&mut bag.lock().unwrap(), source, &chunk, &columns);
    source.read(&selection, &Progress::default(), &emit).unwrap();
    bag.into_inner().unwrap()
}

#[test]
fn pages_of_a_copc_file_hold_its_points_in_their_nodes() {
    for name in FILES {
        let Some(path) = data(name) else { return };
        let source = Arc::new(codec::open(&path).unwrap());
        let octree = Pages::copc(&source, &BTreeSet::new()).unwrap().octree().clone();
        // What no index keeps comes when it is asked for; what every one keeps, or no file has, changes nothing.
        let asked = BTreeSet::from(["gps_time", "intensity", "of_no_file"].map(String::from));
        let usual = Pages::copc(&source, &BTreeSet::new()).unwrap();
        let pages = Pages::copc(&source, &asked).unwrap();
        assert_eq!((usual.octree(), pages.octree(), octree.points()), (&octree, &octree, source.info().points));
        let names: Vec<&str> = pages.attributes().iter().map(|attribute| attribute.name.as_str()).collect();
        assert_eq!(names, ["intensity", "classification", "return_number", "gps_time"], "{name}");
        assert_eq!(usual.attributes(), &pages.attributes()[..3]);
        let columns: Vec<usize> = (0..pages.attributes().len()).collect();
        let mut bag = Bag::new();
        for (id, node) in octree.ids() {
            let chunk = pages.read(id).unwrap();
            assert_eq!((chunk.len() as u32, chunk.first_point), (node.points, node.first_point), "{name}");
            assert!(node.points == 0 || pages.page_bytes(id) > 0);
            let step = source.info().grid.unwrap().scale;
            let inside = |index: usize| {
                let position = chunk.position(index);
                position.cmpge(node.bounds.min - step).all() && position.cmple(node.bounds.max + step).all()
            };
            assert!((0..chunk.len()).all(inside), "{name}: {node:?}");
            let below = |child: &NodeId| octree.node(*child).total;
            assert_eq!(node.total, u64::from(node.points) + node.children.iter().flatten().map(below).sum::<u64>());
            for child in node.children.iter().flatten() {
                assert_eq!((octree.node(*child).parent, octree.node(*child).level), (Some(id), node.level + 1));
            }
            add(&mut bag, &source, &chunk, &columns);
        }
        assert!(bag == points_of_file(&source, &pages), "{name}");
    }
}

#[test]
fn a_prefix_of_a_node_is_an_even_subset_of_it() {
    let Some(path) = data("ellipsoid_las14_pf7.copc.laz") else { return };
    let source = Arc::new(codec::open(&path).unwrap());
    let chunk = Pages::copc(&source, &BTreeSet::new()).unwrap().read(NodeId(0)).unwrap();
    assert!(chunk.len() > cloud::CHUNK_POINTS, "a node larger than other chunks");
    // Cells of an eighth of the width: a quarter of the points has about a quarter of each cell's.
    let bounds = chunk.bounds();
    let cells = |points: usize| {
        let mut counts = BTreeMap::<[i32; 3], f64>::new();
        for index in 0..points {
            let at = ((chunk.position(index) - bounds.min) / bounds.size().max_element() * 8.0).floor();
            *counts.entry(at.as_ivec3().to_array()).or_default() += 1.0;
        }
        counts
    };
    let (all, quarter) = (cells(chunk.len()), cells(prefix(chunk.len(), BATCHES / 4)));
    for (cell, count) in all.iter().filter(|(_, count)| **count > 200.0) {
        let share = quarter.get(cell).unwrap_or(&0.0) / count;
        assert!((0.2..0.3).contains(&share), "{cell:?}: {share} of {count}");
    }
}

/// A plain file has no pages, and one with empty nodes streams like any other.
#[test]
fn a_copc_file_streams_whole_with_nodes_that_are_empty() {
    let Some(path) = data("ellipsoid_las14_pf7_plain.laz") else { return };
    assert!(Pages::copc(&Arc::new(codec::open(&path).unwrap()), &BTreeSet::new()).is_none());

    let path = data("simple_with_hierarchy_page.copc.laz").unwrap();
    // The root's points are moved to a node that did not exist, so the root has no points.
    let mut file = std::fs::read(path).unwrap();
    let root = u64::from_le_bytes(file[469..477].try_into().unwrap()) as usize;
    let entries = u64::from_le_bytes(file[477..485].try_into().unwrap()) as usize / 32;
    let keys: Vec<[u8; 16]> = (0..entries).map(|index| file[root + 32 * index..][..16].try_into().unwrap()).collect();
    assert_eq!(keys[0], [0; 16]);
    let free = (0..8_i32).map(|octant| {
        let key = [1, octant & 1, octant >> 1 & 1, octant >> 2];
        let bytes: Vec<u8> = key.iter().flat_map(|number: &i32| number.to_le_bytes()).collect();
        <[u8; 16]>::try_from(bytes).unwrap()
    });
    let free = free.into_iter().find(|key| !keys.contains(key)).unwrap();
    file[root..root + 16].copy_from_slice(&free);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty_root.copc.laz");
    std::fs::write(&path, file).unwrap();

    let source = Arc::new(codec::open(&path).unwrap());
    let pages =
        Arc::new(Pages::copc(&source, &BTreeSet::new()).unwrap_or_else(|| panic!("{:?}", source.info().warnings)));
    let octree = Arc::new(pages.octree().clone());
    assert_eq!(octree.nodes[0].points, 0);
    let budget = Budget { points: u64::MAX, bytes: 1 << 30 };
    let streamer = Streamer::new(1, budget, || {}).unwrap();
    let orientation = cloud::Orientation::AwayFrom(DVec3::ZERO);
    let reader = pages.clone();
    let paged = PagedCloud {
        octree: octree.clone(),
        point_bytes: pages.point_bytes(),
        missing: Missing::Estimate(SurfelOptions {
            neighbours: 8,
            orientation,
            radii: cloud::RadiusRule::Full,
            seen_from: None,
        }),
        read: Arc::new(move |node| Ok(Page { chunk: reader.read(node)?, disk_bytes: reader.page_bytes(node) as u64 })),
    };
    streamer.add(0, paged);
    streamer.want(octree.ids().map(|(node, _)| Wanted { cloud: 0, node, batches: BATCHES }).collect());
    let mut shown = BTreeMap::new();
    let mut follow = |until: &dyn Fn(&BTreeMap<NodeId, usize>) -> bool| {
        let start = std::time::Instant::now();
        while !until(&shown) && start.elapsed().as_secs() < 60 {
            for change in streamer.changes() {
                match change {
                    NodeChange::Put { node, chunk, .. } => drop(shown.insert(node, chunk.len())),
                    NodeChange::Drop { node, .. } => assert!(shown.remove(&node).is_some()),
                    change => panic!("{change:?}"),
                }
            }
        }
        shown.clone()
    };
    let all = follow(&|_| streamer.stats().settled);
    assert_eq!(all.values().sum::<usize>(), 1065);
    assert!(all.values().all(|points| *points > 0));
    streamer.want(Vec::new());
    streamer.set_budget(Budget { points: 0, bytes: 0 });
    assert_eq!(follow(&|shown| shown.is_empty()), BTreeMap::new());
}
