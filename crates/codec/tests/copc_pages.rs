//! Lists of nodes that are read page by page: what they give is what the whole list gives, and hostile pages give a clear
//! error and nothing else.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/copc_lists.rs"]
mod copc_lists;
#[path = "../../../tests/src/real_data.rs"]
mod real_data;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Mutex;

use cloud::Progress;
use codec::{CopcNode, CopcPage, PageNodes, Selection, Source};
use copc_lists::{Key, Listed, entry, in_pages};

/// Lists of more than 1024 nodes do not fit in this.
const MEMORY: u64 = 4 << 20;
const MORE: usize = 1100;
const ROOT: Key = (0, [0; 3]);

fn positions() -> Selection {
    Selection { positions: true, ..Selection::default() }
}

/// A file of the test data with one level a page, and a list that is longer than the memory for it.
fn listed(name: &str) -> Option<Listed> {
    let file = fs::read(real_data::test_data()?.join("copc").join(name)).unwrap();
    Some(in_pages(&file, 1, MORE))
}

fn key(node: &CopcNode) -> Key {
    (node.level, node.cell)
}

/// All nodes of a file, page by page.
fn all_nodes(source: &Source) -> BTreeMap<Key, CopcNode> {
    let copc = source.copc().unwrap();
    let mut nodes: BTreeMap<Key, CopcNode> = copc.nodes.iter().map(|node| (key(node), node.clone())).collect();
    let mut waiting = copc.further.clone();
    while let Some(page) = waiting.pop() {
        let PageNodes { nodes: found, further } = source.read_copc_page(&page).unwrap();
        assert_eq!(key(&found[0]), (page.level, page.cell), "a page begins with its own node");
        for node in found {
            assert!(nodes.insert(key(&node), node).is_none(), "no node is in two pages");
        }
        waiting.extend(further);
    }
    nodes
}

#[test]
fn pages_give_the_nodes_and_points_that_the_whole_list_gives() {
    for name in ["lone_star_las14_pf6.copc.laz", "ellipsoid_las14_pf7.copc.laz"] {
        let Some(Listed { bytes, pages, .. }) = listed(name) else { return };
        assert!(pages.len() > 3, "{name}: {}", pages.len());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        let (whole, paged) = (codec::open(&path).unwrap(), codec::open_within(&path, MEMORY).unwrap());
        assert_eq!((&whole.info().warnings, &paged.info().warnings), (&Vec::new(), &Vec::new()));
        let (all, first) = (whole.copc().unwrap(), paged.copc().unwrap());
        assert!(all.further.is_empty() && !first.further.is_empty());
        assert_eq!((all.first, &all.nodes[0].points), (first.nodes.len(), &first.nodes[0].points));
        assert_eq!(whole.info().points, paged.info().points);
        let found = all_nodes(&paged);
        let expected: BTreeMap<Key, &CopcNode> = all.nodes.iter().map(|node| (key(node), node)).collect();
        assert!(found.keys().eq(expected.keys()), "{name}");
        for (key, node) in &found {
            assert_eq!((node.points, node.bytes), (expected[key].points, expected[key].bytes), "{name}: {key:?}");
            let read = |source: &Source, node: &CopcNode| source.read_copc_node(node, &positions()).unwrap();
            let (own, other) = (read(&paged, node), read(&whole, expected[key]));
            assert!(own.positions == other.positions && own.origin == other.origin, "{name}: {key:?}");
        }
        // What needs all points finds them as in any LAZ file.
        let count = Mutex::new(0);
        paged.read(&positions(), &Progress::default(), &|chunk| *count.lock().unwrap() += chunk.len()).unwrap();
        assert_eq!(count.into_inner().unwrap() as u64, whole.info().points);
        assert_eq!(paged.record(1000).unwrap(), whole.record(1000).unwrap());
        let output = folder.path().join("export.laz");
        let wanted = cloud::PointTest::default();
        let sources = [std::sync::Arc::new(paged)];
        codec::export(&sources, &wanted, &[], &output, 1 << 30, &Progress::default()).unwrap();
        assert_eq!(codec::open(&output).unwrap().info().points, whole.info().points);
    }
}

/// What reading a page of these bytes comes to.
fn told(bytes: &[u8], page: impl Fn(&Source) -> CopcPage) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    let source = codec::open_within(file.path(), MEMORY).unwrap();
    let page = page(&source);
    source.read_copc_page(&page).err().map(|error| error.to_string()).unwrap_or_default()
}

fn first_page(source: &Source) -> CopcPage {
    source.copc().unwrap().further[0].clone()
}

#[test]
fn hostile_pages_end_with_a_clear_error() {
    let Some(Listed { bytes, pages, entries }) = listed("lone_star_las14_pf6.copc.laz") else { return };
    let (&(link, _), &at_link) = entries.iter().find(|((_, is_page), _)| *is_page).unwrap();
    let (page, length) = pages[&link];
    let own = entries[&(link, false)];
    let patch = |at: usize, patch: &[u8]| {
        let mut file = bytes.clone();
        file[at..at + patch.len()].copy_from_slice(patch);
        file
    };
    let root = pages[&ROOT];
    let below = (link.0 + 1, link.1.map(|cell| 2 * cell));
    let elsewhere = (link.0, link.1.map(|cell| 1 - cell));
    let other_link = entries.keys().find(|(key, is_page)| *is_page && key.0 == 1 && *key != link).unwrap().0;
    let end = bytes.len() as u64;
    for (name, bytes, expected) in [
        ("itself", patch(own, &entry(link, page as u64, length as i32, -1)), "it names itself for its own node"),
        ("a node elsewhere", patch(own, &entry(elsewhere, 2000, 100, 10)), "is not below it"),
        ("the page of another", patch(at_link + 16, &(pages[&other_link].0 as u64).to_le_bytes()), "is not below it"),
        ("outside", patch(at_link + 16, &end.to_le_bytes()), "outside the record of pages"),
        ("before", patch(at_link + 16, &375_u64.to_le_bytes()), "outside the record of pages"),
        ("nothing", patch(at_link + 24, &0_i32.to_le_bytes()), "outside the record of pages"),
        ("without end", patch(at_link + 24, &i32::MAX.to_le_bytes()), "outside the record of pages"),
        (
            "long",
            patch(at_link, &entry(link, end - 32 * 1100, 32 * 1100, -1)),
            "1024 nodes fit in the memory for lists",
        ),
        ("a chunk past the end", patch(own + 16, &u64::MAX.to_le_bytes()), "the points lie at bytes"),
        ("a chunk of no bytes", patch(own + 24, &(-5_i32).to_le_bytes()), "0 bytes at byte"),
        ("a huge count", patch(own + 28, &i32::MAX.to_le_bytes()), "are read at once"),
        ("no level", patch(own, &(-1_i32).to_le_bytes()), "outside of the root's cube"),
    ] {
        let told = told(&bytes, first_page);
        assert!(told.contains(expected), "{name}: {told}");
        assert!(told.contains(&format!("page {}-{}-{}-{} of the list", link.0, link.1[0], link.1[1], link.1[2])));
    }
    // A circle: a page below names the first one, whose node is above it.
    let circle = patch(own, &entry(below, root.0 as u64, root.1 as i32, -1));
    let below = |source: &Source| source.read_copc_page(&first_page(source)).unwrap().further[0].clone();
    let circle = told(&circle, below);
    assert!(circle.contains("is not below it"), "{circle}");
    // A first page that is of no use leaves the file as it is without nodes.
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), patch(at_link, &entry(ROOT, page as u64, length as i32, -1))).unwrap();
    let source = codec::open_within(file.path(), MEMORY).unwrap();
    let warnings = source.info().warnings.join("\n");
    assert!(source.copc().is_none() && warnings.contains("it names itself for its own node"), "{warnings}");
}

#[test]
fn a_node_whose_chunk_has_another_number_of_points_is_not_read() {
    let Some(Listed { bytes, entries, .. }) = listed("lone_star_las14_pf6.copc.laz") else { return };
    let (&(key_of_node, _), &at) = entries.iter().find(|((key, is_page), _)| key.0 == 1 && !*is_page).unwrap();
    let root = entries[&(ROOT, false)];
    let mut damaged = bytes.clone();
    // The place of the root's points.
    damaged[at + 16..at + 28].copy_from_slice(&bytes[root + 16..root + 28]);
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), damaged).unwrap();
    let source = codec::open_within(file.path(), 1 << 22).unwrap();
    let pages = source.copc().unwrap().further.clone();
    let page = pages.iter().find(|page| (page.level, page.cell) == key_of_node).unwrap();
    let node = source.read_copc_page(page).unwrap().nodes[0].clone();
    let told = source.read_copc_node(&node, &positions()).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(told.contains("points, the list of nodes says"), "{told}");
}

/// A cloud of one tile of three points that claims 10^12 points, and pages of its hierarchy.
fn ept(folder: &Path, pages: &[(&str, &str)]) -> std::path::PathBuf {
    let axis = |name: &str| format!(r#"{{"name":"{name}","type":"signed","size":4,"scale":0.01,"offset":0}}"#);
    let schema = ["X", "Y", "Z"].map(axis).join(",");
    let text = format!(
        r#"{{"bounds":[0,0,0,8,8,8],"dataType":"binary","points":1000000000000,"span":128,"version":"1.0.0","schema":[{schema}]}}"#
    );
    fs::create_dir_all(folder.join("ept-data")).unwrap();
    fs::create_dir_all(folder.join("ept-hierarchy")).unwrap();
    let rows = |count: i32| (0..3 * count).flat_map(|value| (10 * value).to_le_bytes()).collect::<Vec<u8>>();
    fs::write(folder.join("ept-data/0-0-0-0.bin"), rows(3)).unwrap();
    fs::write(folder.join("ept-data/1-0-0-0.bin"), rows(2)).unwrap();
    for (name, text) in pages {
        fs::write(folder.join(format!("ept-hierarchy/{name}.json")), text).unwrap();
    }
    let path = folder.join("ept.json");
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_hierarchy_of_ept_that_claims_more_than_fits_is_read_page_by_page() {
    let folder = tempfile::tempdir().unwrap();
    let path = ept(
        folder.path(),
        &[
            ("0-0-0-0", r#"{"0-0-0-0":3,"1-0-0-0":-1,"1-1-0-0":-1,"1-0-1-0":-1,"1-0-0-1":-1}"#),
            ("1-0-0-0", r#"{"1-0-0-0":2,"2-1-1-1":0,"3-0-0-0":-1}"#),
            ("1-1-0-0", r#"{"1-1-0-0":-1}"#),
            ("1-0-1-0", r#"{"1-0-1-0":2,"0-0-0-0":3}"#),
        ],
    );
    let source = codec::open_within(&path, MEMORY).unwrap();
    let copc = source.copc().unwrap();
    assert_eq!((source.info().points, copc.nodes.len(), copc.further.len()), (1_000_000_000_000, 1, 4));
    let page = |cell: [u32; 3]| copc.further.iter().find(|page| page.cell == cell).unwrap();
    let found = source.read_copc_page(page([0, 0, 0])).unwrap();
    // The parent of a further page is there, too.
    let places: Vec<Key> = found.nodes.iter().map(key).collect();
    assert_eq!(places, [(1, [0; 3]), (2, [0; 3])]);
    assert_eq!((found.further[0].level, found.nodes[0].points), (3, 2));
    assert_eq!(source.read_copc_node(&found.nodes[0], &positions()).unwrap().len(), 2);
    for (cell, problem) in [([1, 0, 0], "it names itself"), ([0, 1, 0], "is not below it"), ([0, 0, 1], "1-0-0-1.json")]
    {
        let told = source.read_copc_page(page(cell)).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(told.contains(problem), "{told}");
    }
    // All points are read as far as their pages can be.
    let summary = source.read(&positions(), &Progress::default(), &|_| ()).unwrap();
    assert_eq!(summary.points, 5);
    let told = summary.warnings.join("\n");
    assert!(told.contains("below node 1-1-0-0 is missing") || told.contains("pages that are missing"), "{told}");
}
