use super::*;
use crate::test_trees::{page, random};

/// Of a point of a test page: position, normal, radius.
const POINT_BYTES: u64 = 12 + 4 + 2;
const PLENTY: Budget = Budget { points: u64::MAX, bytes: u64::MAX };

fn paged(octree: &Arc<Octree>) -> PagedCloud {
    let tree = octree.clone();
    let read = move |node| Ok(Page { chunk: page(&tree, node), disk_bytes: 100 });
    PagedCloud { octree: octree.clone(), point_bytes: POINT_BYTES, missing: Missing::Provisional, read: Arc::new(read) }
}

fn everything(cloud: usize, octree: &Octree) -> Vec<Wanted> {
    octree.ids().map(|(node, _)| Wanted { cloud, node, batches: BATCHES }).collect()
}

/// Waits for the streamer to settle, and hands all changes over.
fn settle(streamer: &Streamer, mut each: impl FnMut(Vec<Change>)) {
    for _ in 0..20_000 {
        each(streamer.changes());
        if streamer.stats().settled {
            return;
        }
        std::thread::sleep(Duration::from_micros(500));
    }
    panic!("does not settle: {:?}", streamer.stats());
}

/// What a drawer holds.
#[derive(Default)]
struct Drawer {
    chunks: BTreeMap<(usize, u64), Chunk>,
    failed: Vec<(usize, NodeId)>,
}

impl Drawer {
    fn apply(&mut self, change: Change) {
        match change {
            Change::Put { cloud, chunk } => {
                self.chunks.insert((cloud, chunk.first_point), chunk);
            }
            Change::Drop { cloud, first_point } => {
                assert!(self.chunks.remove(&(cloud, first_point)).is_some(), "dropped what is not there");
            }
            Change::Failed { cloud, node, .. } => self.failed.push((cloud, node)),
        }
    }

    fn points(&self) -> u64 {
        self.chunks.values().map(|chunk| chunk.len() as u64).sum()
    }
}

#[test]
fn all_that_is_wanted_comes_as_it_was_read() {
    let octree = Arc::new(random(5, 60));
    let streamer = Streamer::new(4, PLENTY, || {}).unwrap();
    streamer.add(3, paged(&octree));
    streamer.want(everything(3, &octree));
    let mut drawer = Drawer::default();
    settle(&streamer, |changes| changes.into_iter().for_each(|change| drawer.apply(change)));
    assert_eq!(drawer.points(), octree.points());
    assert_eq!(streamer.stats().shown_points, octree.points());
    for (id, node) in octree.ids() {
        let (chunk, read) = (&drawer.chunks[&(3, node.first_point)], page(&octree, id));
        assert_eq!((&chunk.positions, &chunk.normals, &chunk.radii), (&read.positions, &read.normals, &read.radii));
    }
}
