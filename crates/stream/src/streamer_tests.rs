#[path = "streamer_reading_tests.rs"]
mod reading_tests;
#[path = "streamer_room_tests.rs"]
mod room_tests;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Weak;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use cloud::{Chunk, Progress, SurfelOptions, pack_radius, provisional_radius};
use glam::{DMat3, DVec2, DVec3, Vec3};

use super::nodes::SCALED_RADIUS_BYTES;
use super::*;
use crate::radius_scale::LARGEST_SPACINGS;
use crate::test_trees::{page, random, terrain, terrain_page};
use crate::{BATCHES, Node, NodeId, Octree, Result, Tree, ViewMeasure, prefix};

/// What a cut wants of trees whose nodes are all there.
fn choose(trees: &[Tree], measure: impl Fn(usize, &Octree, &Node) -> f64, budget: Budget, finest: f64) -> Vec<Wanted> {
    let cut = crate::choose(trees, measure, budget, finest);
    assert!(cut.unread.is_empty());
    cut.wanted
}

/// The size of a point of a test page in bytes: position, normal, radius; and the radius once more.
const POINT_BYTES: u64 = 12 + 4 + 2;
const DECODED_POINT_BYTES: u64 = POINT_BYTES + SCALED_RADIUS_BYTES;
const PLENTY: Budget = Budget { points: u64::MAX, bytes: u64::MAX };

fn paged(octree: &Arc<Octree>, page: impl Fn(&Octree, NodeId) -> Result<Chunk> + Send + Sync + 'static) -> PagedCloud {
    let tree = octree.clone();
    let read = move |node| Ok(Page { chunk: page(&tree, node)?, disk_bytes: 100 });
    PagedCloud { octree: octree.clone(), point_bytes: POINT_BYTES, missing: Missing::Provisional, read: Arc::new(read) }
}

fn readable(octree: &Arc<Octree>) -> PagedCloud {
    paged(octree, |octree, node| Ok(page(octree, node)))
}

fn everything(cloud: usize, octree: &Octree) -> Vec<Wanted> {
    octree.ids().map(|(node, _)| Wanted { cloud, node, batches: BATCHES }).collect()
}

/// The chunks that a drawer has.
#[derive(Default)]
struct Drawer {
    chunks: BTreeMap<(usize, NodeId), Chunk>,
    failed: Vec<(usize, NodeId, String)>,
    /// The number of chunks that were put for the first time, and again.
    puts: [usize; 2],
}

impl Drawer {
    fn apply(&mut self, change: NodeChange) {
        match change {
            NodeChange::Put { cloud, node, chunk } => {
                let old = self.chunks.insert((cloud, node), chunk);
                self.puts[usize::from(old.is_some())] += 1;
            }
            NodeChange::Drop { cloud, node } => {
                assert!(self.chunks.remove(&(cloud, node)).is_some(), "dropped what is not there");
            }
            NodeChange::Failed { cloud, node, error } => self.failed.push((cloud, node, error.to_string())),
            NodeChange::Mended { cloud, node } => {
                let told = self.failed.iter().position(|(other, own, _)| (*other, *own) == (cloud, node));
                self.failed.remove(told.expect("mended what was not missing"));
            }
        }
    }

    fn points(&self) -> u64 {
        self.chunks.values().map(|chunk| chunk.len() as u64).sum()
    }

    /// Takes changes until the streamer has settled; returns their number.
    fn settle(&mut self, streamer: &Streamer) -> usize {
        let mut count = 0;
        for _ in 0..20_000 {
            for change in streamer.changes() {
                count += 1;
                self.apply(change);
            }
            if streamer.stats().settled {
                return count;
            }
            std::thread::sleep(Duration::from_micros(500));
        }
        panic!("does not settle: {:?}", streamer.stats());
    }
}

/// The cut of a view straight down on the terrain from a height.
fn cut_from(octree: &Octree, eye: DVec3, points: u64) -> Vec<Wanted> {
    let down = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::NEG_Z).transpose();
    let view = ViewMeasure::perspective(eye, down, DVec2::ONE, 1000.0, 0.25);
    let trees = [Tree { cloud: 0, octree, point_bytes: DECODED_POINT_BYTES }];
    choose(&trees, |_, octree, node| view.pixels(octree, node), Budget { points, bytes: u64::MAX }, 1.0)
}

#[test]
fn all_that_is_wanted_comes_as_it_was_read() {
    let octree = Arc::new(random(5, 60));
    let streamer = Streamer::new(4, PLENTY, || {}).unwrap();
    streamer.add(3, readable(&octree));
    streamer.want(everything(3, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(drawer.points(), octree.points());
    for (id, _) in octree.ids() {
        let (chunk, read) = (&drawer.chunks[&(3, id)], page(&octree, id));
        assert_eq!((&chunk.positions, &chunk.normals, &chunk.radii), (&read.positions, &read.normals, &read.radii));
    }
    let stats = streamer.stats();
    assert_eq!((stats.shown_points, stats.shown_nodes), (octree.points(), octree.nodes.len()));
    assert_eq!(stats.bytes, octree.points() * DECODED_POINT_BYTES);
    assert_eq!(stats.points_per_second, octree.points() as f64);
    assert_eq!(stats.disk_bytes_per_second, 100.0 * octree.nodes.len() as f64);
}

#[test]
fn the_same_cut_again_changes_nothing() {
    let octree = Arc::new(terrain(4));
    let streamer = Streamer::new(2, Budget { points: 30_000, bytes: u64::MAX }, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    let cut = || cut_from(&octree, DVec3::new(300.0, 300.0, 200.0), 30_000);
    let mut drawer = Drawer::default();
    streamer.want(cut());
    assert!(drawer.settle(&streamer) > 50);
    for _ in 0..3 {
        streamer.want(cut());
        assert_eq!(drawer.settle(&streamer), 0);
    }
}

/// A reader that knows which of its chunks are still in use.
#[derive(Default)]
struct Ledger(Mutex<Vec<Weak<Vec<[f32; 3]>>>>);

impl Ledger {
    fn read(&self, octree: &Octree, node: NodeId) -> Chunk {
        let chunk = terrain_page(octree, node);
        self.0.lock().unwrap().push(Arc::downgrade(&chunk.positions));
        chunk
    }

    fn held_points(&self) -> u64 {
        let mut chunks = self.0.lock().unwrap();
        chunks.retain(|chunk| chunk.strong_count() > 0);
        chunks.iter().filter_map(Weak::upgrade).map(|positions| positions.len() as u64).sum()
    }
}

/// For each of `probes`, whether a chunk's discs cover it.
fn covered(chunk: &Chunk, probes: &[Vec3]) -> Vec<bool> {
    let radii = chunk.radii.as_ref().unwrap();
    let splats: Vec<(Vec3, f32)> = (0..chunk.len())
        .map(|index| (chunk.position(index).as_vec3(), cloud::unpack_radius(radii[index]).unwrap()))
        .collect();
    let is_covered =
        |probe: &Vec3| splats.iter().any(|(middle, radius)| middle.distance_squared(*probe) <= radius * radius);
    probes.iter().map(is_covered).collect()
}

#[test]
fn a_flight_blinks_nowhere_and_keeps_every_ceiling() {
    let octree = Arc::new(terrain(5));
    let points = 20_000;
    assert!(octree.points() > 15 * points, "the budget is small");
    let budget = Budget { points, bytes: 30_000 * DECODED_POINT_BYTES };
    let ledger = Arc::new(Ledger::default());
    let streamer = Streamer::new(3, budget, || {}).unwrap();
    let reader = ledger.clone();
    streamer.add(0, paged(&octree, move |octree, node| Ok(reader.read(octree, node))));

    let probe = |index: u64| {
        let share = |salt: u64| (cloud::hash(index * 2 + salt) >> 40) as f32 / (1 << 24) as f32;
        Vec3::new(share(0), share(1), 0.0) * 1024.0
    };
    let probes: Vec<Vec3> = (0..400).map(probe).collect();
    let mut drawer = Drawer::default();
    let mut coverage: BTreeMap<(usize, NodeId), Vec<bool>> = BTreeMap::new();
    let (mut drops, mut is_covered) = (0, vec![false; probes.len()]);
    for step in 0..90 {
        let turn = f64::from(step) * 0.15;
        let eye =
            DVec3::new(512.0 + 400.0 * turn.cos(), 512.0 + 400.0 * turn.sin(), 60.0 + f64::from(step % 30) * 10.0);
        streamer.want(cut_from(&octree, eye, points));
        // Most steps end before everything has come.
        for _ in 0..if step % 10 == 9 { 2000 } else { 3 } {
            let changes = streamer.changes();
            assert!(streamer.stats().bytes <= budget.bytes, "{:?}", streamer.stats());
            let dropped = changes.iter().filter(|change| matches!(change, NodeChange::Drop { .. })).count() as u64;
            // Whoever has them: the drawer still has the chunks that it is to drop.
            assert!(ledger.held_points() * DECODED_POINT_BYTES <= budget.bytes + dropped * 256 * DECODED_POINT_BYTES);
            for change in changes {
                let put = match &change {
                    NodeChange::Put { cloud, node, chunk } => Some(((*cloud, *node), covered(chunk, &probes))),
                    NodeChange::Drop { cloud, node } => {
                        drops += 1;
                        coverage.remove(&(*cloud, *node));
                        None
                    }
                    NodeChange::Failed { .. } | NodeChange::Mended { .. } => panic!("{change:?}"),
                };
                drawer.apply(change);
                coverage.extend(put);
                assert!(drawer.points() <= points, "{} points", drawer.points());
                for (id, node) in octree.ids() {
                    let is_shown = |id: NodeId| drawer.chunks.contains_key(&(0, id));
                    assert!(!is_shown(id) || node.parent.is_none_or(is_shown), "{id:?} without its parent");
                }
                for (index, before) in is_covered.iter_mut().enumerate() {
                    let now = coverage.values().any(|covered| covered[index]);
                    assert!(now || !*before, "a hole opens at {}", probes[index]);
                    *before = now;
                }
            }
            if streamer.stats().settled {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(step % 10 != 9 || streamer.stats().settled);
    }
    assert!(is_covered.iter().all(|covered| *covered));
    assert!(drops > 500, "{drops} drops prove nothing");
    drop(streamer);
    assert!(ledger.held_points() <= points, "chunks leak");
}

#[test]
fn a_cut_back_and_forth_reads_nothing_twice_where_there_is_memory() {
    let octree = Arc::new(terrain(4));
    let reads = Arc::new(AtomicUsize::new(0));
    let count = reads.clone();
    let streamer = Streamer::new(2, Budget { points: 20_000, bytes: u64::MAX }, || {}).unwrap();
    streamer.add(
        0,
        paged(&octree, move |octree, node| {
            count.fetch_add(1, Ordering::Relaxed);
            Ok(terrain_page(octree, node))
        }),
    );
    let mut drawer = Drawer::default();
    for _ in 0..4 {
        for eye in [DVec3::new(100.0, 100.0, 100.0), DVec3::new(900.0, 900.0, 100.0)] {
            streamer.want(cut_from(&octree, eye, 20_000));
            drawer.settle(&streamer);
        }
    }
    let once = reads.load(Ordering::Relaxed);
    assert!(once <= octree.nodes.len() && once > 100, "{once} reads of {} nodes", octree.nodes.len());
}

#[test]
fn what_is_not_wanted_stays_until_its_place_is_needed() {
    let octree = Arc::new(terrain(3));
    let streamer = Streamer::new(2, Budget { points: octree.points(), bytes: u64::MAX }, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    let all = everything(0, &octree);
    let mut drawer = Drawer::default();
    streamer.want(all.clone());
    drawer.settle(&streamer);
    streamer.want(all[..1].to_vec());
    assert_eq!(drawer.settle(&streamer), 0);
    assert_eq!(drawer.points(), octree.points());
    // The first half of the nodes is wanted last. The others are dropped first.
    let half = all.len() / 2;
    streamer.want(all[..half].to_vec());
    streamer.want(all[..1].to_vec());
    streamer.set_budget(Budget { points: half as u64 * 256, bytes: u64::MAX });
    drawer.settle(&streamer);
    let shown: Vec<NodeId> = drawer.chunks.keys().map(|(_, node)| *node).collect();
    assert_eq!(shown, (0..half as u32).map(NodeId).collect::<Vec<_>>());
}

#[test]
fn nothing_but_what_is_wanted_is_shown_where_that_is_asked_for() {
    let octree = Arc::new(terrain(4));
    let shown_from = |eyes: &[DVec3]| {
        let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
        streamer.show_only_wanted(true);
        streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
        let mut drawer = Drawer::default();
        for eye in eyes {
            streamer.want(cut_from(&octree, *eye, 20_000));
            drawer.settle(&streamer);
        }
        let chunks = drawer.chunks.into_iter();
        chunks.map(|(key, chunk)| (key, chunk.positions, chunk.radii)).collect::<Vec<_>>()
    };
    let [near, far, last] = [100.0, 900.0, 500.0].map(|place| DVec3::new(place, place, 100.0));
    assert_eq!(shown_from(&[near, far, last]), shown_from(&[last]));
}

#[test]
fn a_smaller_budget_is_kept_at_once_and_a_larger_one_used() {
    let octree = Arc::new(terrain(3));
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    streamer.want(everything(0, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    for points in [10_000, 1000, 100, 16, 5000, 256 * 3 + 16, 20_000] {
        streamer.set_budget(Budget { points, bytes: u64::MAX });
        streamer.changes().into_iter().for_each(|change| drawer.apply(change));
        assert!(drawer.points() <= points);
        drawer.settle(&streamer);
        // Whole nodes, and batches of the last one.
        assert_eq!(drawer.points(), points / 16 * 16);
    }
    for nodes in [40, 3, 60] {
        // One node is kept free.
        let bytes = (nodes + 1) * 256 * DECODED_POINT_BYTES;
        streamer.set_budget(Budget { points: u64::MAX, bytes });
        drawer.settle(&streamer);
        assert!(streamer.stats().bytes <= bytes);
        assert!(drawer.chunks.len() as u64 >= nodes);
    }
    streamer.set_budget(PLENTY);
    drawer.settle(&streamer);
    assert_eq!(drawer.points(), octree.points());
}

#[test]
fn a_budget_with_room_for_nothing_settles_with_nothing() {
    let octree = Arc::new(random(5, 60));
    for budget in [Budget { points: 0, bytes: u64::MAX }, Budget { points: u64::MAX, bytes: 100 }] {
        let streamer = Streamer::new(2, budget, || {}).unwrap();
        streamer.add(0, readable(&octree));
        streamer.want(everything(0, &octree));
        let mut drawer = Drawer::default();
        drawer.settle(&streamer);
        assert_eq!((drawer.points(), streamer.stats().bytes), (0, 0));
    }
}

#[test]
fn a_root_alone_is_drawn_with_larger_splats() {
    let octree = Arc::new(terrain(3));
    let streamer = Streamer::new(1, Budget { points: 256, bytes: u64::MAX }, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    streamer.want(everything(0, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    // The first of 1 + 4 + 16 + 64 nodes of equal size: scaled by the root of 85 its radii would be 1.13 spacings.
    let (root, full) = (&drawer.chunks[&(0, NodeId(0))], terrain_page(&octree, NodeId(0)));
    let largest = pack_radius((LARGEST_SPACINGS * octree.spacing) as f32);
    assert!(full.radii.unwrap().iter().all(|radius| *radius < largest - 2048));
    assert!(root.radii.as_ref().unwrap().iter().all(|radius| *radius == largest));
    assert_eq!((&root.positions, &root.normals), (&full.positions, &full.normals));
}

#[test]
fn what_has_settled_does_not_depend_on_the_order_that_it_came_in() {
    let octree = Arc::new(terrain(4));
    let settled = |workers: usize, salt: u64| {
        let streamer = Streamer::new(workers, Budget { points: 33_000, bytes: u64::MAX }, || {}).unwrap();
        let slowly = move |octree: &Octree, node: NodeId| {
            std::thread::sleep(Duration::from_micros(cloud::hash(u64::from(node.0) ^ salt) % 700));
            Ok(terrain_page(octree, node))
        };
        streamer.add(0, paged(&octree, slowly));
        streamer.want(cut_from(&octree, DVec3::new(300.0, 200.0, 80.0), 33_000));
        let mut drawer = Drawer::default();
        drawer.settle(&streamer);
        drawer.chunks
    };
    let first = settled(1, 0);
    assert!(first.len() > 100);
    for salt in 1..4 {
        let other = settled(5, salt << 32);
        assert!(first.keys().eq(other.keys()));
        for (a, b) in first.values().zip(other.values()) {
            assert_eq!((&a.positions, &a.radii), (&b.positions, &b.radii));
        }
    }
}

#[test]
fn a_chunk_with_other_radii_shares_its_positions_with_the_one_before() {
    let octree = Arc::new(terrain(1));
    let streamer = Streamer::new(1, PLENTY, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    let mut drawer = Drawer::default();
    let mut root = |nodes: usize| {
        streamer.want(everything(0, &octree)[..nodes].to_vec());
        drawer.settle(&streamer);
        drawer.chunks[&(0, NodeId(0))].clone()
    };
    let (alone, among) = (root(1), root(5));
    assert_ne!(alone.radii, among.radii);
    assert!(Arc::ptr_eq(&alone.positions, &among.positions));
}

#[test]
#[ignore = "prints how long calls take, and how many chunks are put"]
fn time_of_calls() {
    let octree = Arc::new(terrain(7));
    let points = 256 * 4000;
    let streamer = Streamer::new(2, Budget { points, bytes: u64::MAX }, || {}).unwrap();
    let slowly = |octree: &Octree, node| {
        std::thread::sleep(Duration::from_millis(2));
        Ok(terrain_page(octree, node))
    };
    streamer.add(0, paged(&octree, slowly));
    let mut drawer = Drawer::default();
    let (mut wants, mut takes) = (Vec::new(), Vec::new());
    for step in 0..200 {
        let eye = DVec3::new(100.0 + 4.0 * f64::from(step), 300.0, 60.0);
        let cut = cut_from(&octree, eye, points);
        let started = Instant::now();
        streamer.want(cut);
        wants.push(started.elapsed().as_secs_f64() * 1e3);
        for _ in 0..4 {
            let started = Instant::now();
            let changes = streamer.changes();
            takes.push(started.elapsed().as_secs_f64() * 1e3);
            changes.into_iter().for_each(|change| drawer.apply(change));
            std::thread::sleep(Duration::from_millis(4));
        }
    }
    wants.sort_by(f64::total_cmp);
    takes.sort_by(f64::total_cmp);
    let ends = |times: &[f64]| (times[times.len() / 2], times[times.len() - 1]);
    println!("{} nodes, {} shown", octree.nodes.len(), drawer.chunks.len());
    println!("{} chunks came, {} puts of other radii", drawer.puts[0], drawer.puts[1]);
    println!("want: median and longest {:.2?} ms; changes: {:.2?} ms", ends(&wants), ends(&takes));
}
