//! Lists of nodes that are read page by page stay within their memory, and what goes comes back.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use stream::{NodeId, NodeTable, Pages};

/// 1024 nodes fit in an eighth of this.
const MEMORY: u64 = 4 << 20;
const MOST: usize = 1024;
/// The nodes of a page below the root's, and the pages below it.
const NODES: usize = 1 + 8 + 64 + 200;

/// The cells below a cell, so many levels further down.
fn below([x, y, z]: [u32; 3], levels: u32) -> impl Iterator<Item = [u32; 3]> {
    let cells = 1_u32 << levels;
    let at = move |index: u32| [index % cells, index / cells % cells, index / cells / cells];
    (0..cells.pow(3)).map(at).map(move |[a, b, c]| [x * cells + a, y * cells + b, z * cells + c])
}

/// A cloud that claims 10^12 points. Its first page has the root and names eight pages; each of these has [`NODES`] nodes and
/// names one more page.
fn cloud(folder: &Path) -> Arc<Pages> {
    fs::create_dir_all(folder.join("ept-data")).unwrap();
    fs::create_dir_all(folder.join("ept-hierarchy")).unwrap();
    let axis = |name: &str| format!(r#"{{"name":"{name}","type":"signed","size":4,"scale":0.01,"offset":0}}"#);
    let text = format!(
        r#"{{"bounds":[0,0,0,8,8,8],"dataType":"binary","points":1000000000000,"span":128,"version":"1.0.0","schema":[{}]}}"#,
        ["X", "Y", "Z"].map(axis).join(",")
    );
    fs::write(folder.join("ept.json"), text).unwrap();
    fs::write(folder.join("ept-data/0-0-0-0.bin"), vec![0; 36]).unwrap();
    let page = |name: &str, entries: Vec<String>| {
        fs::write(folder.join(format!("ept-hierarchy/{name}.json")), format!("{{{}}}", entries.join(","))).unwrap();
    };
    let name = |level: u32, [x, y, z]: [u32; 3]| format!("{level}-{x}-{y}-{z}");
    let entry = |level: u32, cell: [u32; 3], points: i32| format!(r#""{}":{points}"#, name(level, cell));
    let first = below([0; 3], 1).map(|cell| entry(1, cell, -1));
    page("0-0-0-0", first.chain([entry(0, [0; 3], 3)]).collect());
    for top in below([0; 3], 1) {
        let mut entries = vec![entry(1, top, 5)];
        entries.extend(below(top, 1).map(|cell| entry(2, cell, 5)));
        entries.extend(below(top, 2).map(|cell| entry(3, cell, 5)));
        let fourth: Vec<[u32; 3]> = below(top, 3).collect();
        entries.extend(fourth[..200].iter().map(|cell| entry(4, *cell, 5)));
        let last = fourth[511];
        entries.push(entry(4, last, -1));
        page(&name(1, top), entries);
        page(&name(4, last), vec![entry(4, last, 5)]);
    }
    let source = Arc::new(codec::open_within(&folder.join("ept.json"), MEMORY).unwrap());
    Arc::new(Pages::copc(&source, &BTreeSet::new()).unwrap())
}

fn put(pages: &Pages, table: &mut NodeTable, place: (NodeId, u8)) -> bool {
    let found = pages.read_list(table.page(place).unwrap()).unwrap();
    table.put(place, found)
}

#[test]
fn pages_that_no_view_needs_go_where_others_need_their_room() {
    let folder = tempfile::tempdir().unwrap();
    let pages = cloud(folder.path());
    let mut table = NodeTable::new(&pages).unwrap();
    let root = NodeId(0);
    assert_eq!((table.octree().nodes.len(), table.octree().paged.unread.len(), table.size()), (1, 8, 9));
    assert_eq!(table.octree().points(), 1_000_000_000_000);
    let top = |table: &NodeTable, octant: u8| table.octree().node(root).children[usize::from(octant)];
    for octant in 0..3 {
        table.use_nodes([root]);
        assert!(put(&pages, &mut table, (root, octant)));
    }
    assert_eq!(table.size(), 9 + 3 * (NODES + 1));
    let first = top(&table, 0).unwrap();
    for octant in 0..3 {
        let id = top(&table, octant).unwrap();
        let node = table.octree().node(id);
        assert_eq!((node.parent, node.level, node.points), (Some(root), 1, 5));
        assert!(node.children.iter().flatten().all(|child| table.octree().node(*child).parent == Some(id)));
        // The root's points are not among them.
        assert_eq!(pages.page_bytes(id), 60);
    }
    // The view needs the second and third page, so the first goes for the fourth.
    let needed = [root, top(&table, 1).unwrap(), top(&table, 2).unwrap()];
    table.use_nodes(needed);
    assert!(put(&pages, &mut table, (root, 3)));
    assert!(table.size() <= MOST);
    assert_eq!(top(&table, 0), None);
    assert!(table.octree().get(first).is_none() && pages.page_bytes(first) == 0);
    assert!(table.octree().paged.unread.contains_key(&(root, 0)) && table.page((root, 0)).is_some());
    assert!(needed.iter().all(|id| table.octree().get(*id).is_some()));
    assert!(!table.octree().paged.unread.keys().any(|(parent, _)| table.octree().get(*parent).is_none()));
    // A view that needs all that is there leaves no room for more, and nothing changes.
    table.use_nodes(needed.into_iter().chain(top(&table, 3)));
    let before = table.octree().clone();
    assert!(!put(&pages, &mut table, (root, 0)));
    assert_eq!((table.octree(), table.size()), (&before, 9 + 3 * (NODES + 1)));
    // What went comes back under other numbers.
    table.use_nodes([root]);
    assert!(put(&pages, &mut table, (root, 0)));
    assert!(top(&table, 0).is_some_and(|id| id > first) && table.size() <= MOST);
}

#[test]
fn a_page_stays_as_long_as_one_below_it() {
    let folder = tempfile::tempdir().unwrap();
    let pages = cloud(folder.path());
    let mut table = NodeTable::new(&pages).unwrap();
    let root = NodeId(0);
    assert!(put(&pages, &mut table, (root, 5)));
    let (place, bounds) =
        table.octree().paged.unread.iter().next_back().map(|(place, bounds)| (*place, *bounds)).unwrap();
    assert!(place.0 > root && put(&pages, &mut table, place));
    let last = table.octree().node(place.0).children[usize::from(place.1)].unwrap();
    assert_eq!((table.octree().node(last).level, table.octree().node(last).bounds), (4, bounds));
    // Its topmost page is not needed by itself.
    for octant in [0, 1, 2, 3, 4, 6, 7] {
        table.use_nodes([last]);
        assert!(put(&pages, &mut table, (root, octant)));
        assert!(table.size() <= MOST && table.octree().get(last).is_some(), "{octant}");
        let parents = std::iter::successors(Some(last), |id| table.octree().node(*id).parent);
        assert_eq!(parents.count(), 5);
    }
    // What belongs to no page that is there changes nothing.
    let found = pages.read_list(&codec_page(&table)).unwrap();
    let before = table.octree().clone();
    assert!(table.put((NodeId(u32::MAX), 0), found) && *table.octree() == before);
}

fn codec_page(table: &NodeTable) -> codec::CopcPage {
    let place = *table.octree().paged.unread.keys().next().unwrap();
    table.page(place).unwrap().clone()
}
