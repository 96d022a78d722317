//! COPC: what is read node by node is what is read as LAZ, and an index that does not fit the file is not used.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

mod las_files;

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use cloud::{Bounds, Chunk, Cloud, Progress};
use codec::{Copc, CopcNode, Selection, Source};
use glam::DVec3;
use las_files::Noise;

const FILES: [&str; 3] =
    ["lone_star_las14_pf6.copc.laz", "ellipsoid_las14_pf7.copc.laz", "simple_with_hierarchy_page.copc.laz"];

fn data(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("GLINT_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder.join("copc").join(name));
    }
    println!("skipped: no test data");
    None
}

fn everything(source: &Source) -> Selection {
    let attributes = vec![true; source.info().attributes.len()];
    Selection { positions: true, colors: true, normals: true, attributes }
}

fn cloud(source: &Source, mut chunks: Vec<Chunk>) -> Cloud {
    chunks.sort_by_key(|chunk: &Chunk| chunk.first_point);
    let info = source.info();
    Cloud { name: String::new(), attributes: info.attributes.clone(), grid: info.grid, chunks }
}

fn read_whole(source: &Source) -> Cloud {
    let chunks = Mutex::new(Vec::new());
    source.read(&everything(source), &Progress::default(), &|chunk| chunks.lock().unwrap().push(chunk)).unwrap();
    cloud(source, chunks.into_inner().unwrap())
}

/// All that is known of each point, in file order.
fn points(cloud: &Cloud) -> Vec<(DVec3, Option<[u8; 4]>, Vec<u64>)> {
    let of = |chunk: &Chunk| {
        let point = |index: usize| {
            let values = chunk.columns.iter().flatten().map(|column| column.value(index).to_bits());
            let color = chunk.colors.as_ref().map(|colors| colors[index]);
            (cloud.world_position(chunk, index), color, values.collect())
        };
        (0..chunk.len()).map(point).collect::<Vec<_>>()
    };
    cloud.chunks.iter().flat_map(of).collect()
}

fn cube(copc: &Copc, node: &CopcNode) -> Bounds {
    let width = copc.width / f64::from(node.level).exp2();
    let corner = copc.corner + width * glam::UVec3::from(node.cell).as_dvec3();
    Bounds { min: corner, max: corner + width }
}

#[test]
fn nodes_hold_every_point_once_in_their_cubes_as_the_file_read_as_laz() {
    for name in FILES {
        let Some(path) = data(name) else { return };
        let source = codec::open(&path).unwrap();
        assert!(source.info().warnings.is_empty(), "{:?}", source.info().warnings);
        let copc = source.copc().unwrap();
        assert_eq!(copc.nodes.iter().map(|node| u64::from(node.points)).sum::<u64>(), source.info().points);
        assert_eq!((copc.nodes[0].level, copc.nodes[0].cell), (0, [0; 3]));
        assert!(copc.nodes.iter().any(|node| node.level > 0), "a root alone would prove nothing");
        for node in copc.nodes.iter().filter(|node| node.level > 0) {
            let parent = (node.level - 1, node.cell.map(|cell| cell / 2));
            assert!(copc.nodes.iter().any(|other| (other.level, other.cell) == parent), "{name}: {node:?}");
        }

        // From several threads, as pages are read.
        let selection = everything(&source);
        let chunks = std::thread::scope(|scope| {
            let read = |nodes: &[CopcNode]| -> Vec<Chunk> {
                nodes.iter().map(|node| source.read_copc_node(node, &selection).unwrap()).collect()
            };
            let (first, second) = copc.nodes.split_at(copc.nodes.len() / 2);
            let other = scope.spawn(move || read(first));
            let mut chunks = read(second);
            chunks.splice(0..0, other.join().unwrap());
            chunks
        });
        let step = source.info().grid.unwrap().scale;
        for (node, chunk) in copc.nodes.iter().zip(&chunks) {
            assert_eq!(chunk.len(), node.points as usize);
            let cube = cube(copc, node);
            let cube = Bounds { min: cube.min - step, max: cube.max + step };
            let of = Cloud { grid: source.info().grid, ..Cloud::default() };
            let outside = (0..chunk.len()).find(|index| !cube.contains(of.world_position(chunk, *index)));
            assert_eq!(outside, None, "{name}: {node:?} {cube:?}");
        }
        let chunks = chunks.into_iter().filter(|chunk| !chunk.is_empty()).collect();
        assert!(points(&cloud(&source, chunks)) == points(&read_whole(&source)), "{name}");
    }
}

#[test]
fn only_what_is_selected_of_a_node_comes() {
    let Some(path) = data("ellipsoid_las14_pf7.copc.laz") else { return };
    let source = codec::open(&path).unwrap();
    let node = &source.copc().unwrap().nodes[0];
    let index = source.info().attributes.iter().position(|attribute| attribute.name == "classification").unwrap();
    let mut attributes = vec![false; index + 1];
    attributes[index] = true;
    let whole = source.read_copc_node(node, &everything(&source)).unwrap();
    let column = source.read_copc_node(node, &Selection { attributes, ..Selection::default() }).unwrap();
    assert_eq!(column.columns[index], whole.columns[index]);
    assert!(column.positions.is_empty() && column.colors.is_none());
    assert_eq!(column.columns.iter().flatten().count(), 1);
}

#[test]
fn a_plain_laz_file_has_no_nodes_and_no_warning() {
    let Some(path) = data("ellipsoid_las14_pf7_plain.laz") else { return };
    let source = codec::open(&path).unwrap();
    assert!(source.copc().is_none() && source.info().warnings.is_empty(), "{:?}", source.info().warnings);
}

/// The info record's field at `at` as it is in `file`.
fn info_field(file: &[u8], at: usize) -> usize {
    u64::from_le_bytes(file[429 + at..][..8].try_into().unwrap()) as usize
}

/// `source` and what it warned of, which must still read as LAZ in full.
fn without_index(bytes: &[u8], expected_points: u64) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    let source = codec::open(file.path()).unwrap();
    assert!(source.copc().is_none());
    assert_eq!(read_whole(&source).len(), expected_points);
    source.info().warnings.join("\n")
}

#[test]
fn an_index_that_does_not_fit_the_file_is_not_used_and_the_file_is_read_as_laz() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let entries = info_field(&file, 48) / 32;
    let entry = |index: usize| root + 32 * index;
    let i32_at = |at: usize| i32::from_le_bytes(file[at..at + 4].try_into().unwrap());
    let link = (0..entries).map(entry).find(|at| i32_at(at + 28) == -1).unwrap();
    let page = u64::from_le_bytes(file[link + 16..link + 24].try_into().unwrap()) as usize;

    let patch = |at: usize, bytes: &[u8]| {
        let mut file = file.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    // The sub-page names the root page: a circle.
    let mut circle = file[link..link + 32].to_vec();
    circle[16..24].copy_from_slice(&(root as u64).to_le_bytes());
    circle[24..28].copy_from_slice(&(32 * entries as i32).to_le_bytes());
    let twice: [u8; 32] = file[entry(1)..entry(2)].try_into().unwrap();
    let cases: [(&str, Vec<u8>, &str); 14] = [
        ("a circle of pages", patch(page + 32, &circle), "a page that is named twice"),
        ("a page outside", patch(link + 16, &(file.len() as u64).to_le_bytes()), "outside the record of pages"),
        ("a page before", patch(link + 16, &375_u64.to_le_bytes()), "outside the record of pages"),
        ("a huge page", patch(link + 24, &i32::MAX.to_le_bytes()), "outside the record of pages"),
        ("a negative page", patch(link + 24, &(-32_i32).to_le_bytes()), "a page of -32 bytes"),
        ("a root page without end", patch(429 + 48, &u64::MAX.to_le_bytes()), "outside the record of pages"),
        ("an empty root page", patch(429 + 48, &0_u64.to_le_bytes()), "outside the record of pages"),
        ("a node past the end", patch(entry(0) + 16, &u64::MAX.to_le_bytes()), "no compressed chunk of"),
        ("a huge count", patch(entry(0) + 28, &i32::MAX.to_le_bytes()), "are read at once"),
        ("another count", patch(entry(0) + 28, &23_i32.to_le_bytes()), "no compressed chunk of 23 points"),
        ("a count below zero", patch(entry(0) + 28, &(-2_i32).to_le_bytes()), "-2 points"),
        ("a node outside", patch(entry(1) + 4, &2_i32.to_le_bytes()), "outside of the root's cube"),
        ("a node twice", patch(entry(2), &twice), "no compressed chunk of"),
        ("no cube", patch(429 + 24, &f64::NAN.to_le_bytes()), "no cube"),
    ];
    for (name, bytes, expected) in cases {
        let warnings = without_index(&bytes, 1065);
        assert!(warnings.contains("the COPC index is not usable") && warnings.contains(expected), "{name}: {warnings}");
    }
    // Nodes that are left out would hide their points.
    let warnings = without_index(&patch(429 + 48, &64_u64.to_le_bytes()), 1065);
    assert!(warnings.contains("belong to no node"), "{warnings}");
}

#[test]
fn a_file_cut_short_gives_the_points_that_are_there() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let warnings = without_index(&file[..root + 40], 1065);
    assert!(warnings.contains("the COPC index is not usable: the record of its pages is missing"), "{warnings}");
}

#[test]
fn no_damaged_byte_of_the_index_brings_the_reader_down() {
    let Some(path) = data("simple_with_hierarchy_page.copc.laz") else { return };
    let file = std::fs::read(path).unwrap();
    let root = info_field(&file, 40);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.copc.laz");
    let mut noise = Noise(3);
    let mut used = 0;
    for _ in 0..150 {
        let mut damaged = file.clone();
        for _ in 0..1 + noise.below(3) {
            let places = [375..589, root - 60..file.len(), 1432..root];
            let place = &places[noise.below(3) as usize];
            damaged[place.start + noise.below(place.len() as u64) as usize] = noise.next() as u8;
        }
        std::fs::write(&path, &damaged).unwrap();
        let Ok(source) = codec::open(&path) else { continue };
        let Some(copc) = source.copc() else { continue };
        used += 1;
        let all: u64 = copc
            .nodes
            .iter()
            .filter_map(|node| source.read_copc_node(node, &everything(&source)).ok())
            .map(|chunk| chunk.len() as u64)
            .sum();
        assert!(all <= source.info().points);
    }
    assert!(used > 10, "too few were read for this to prove anything: {used}");
}
