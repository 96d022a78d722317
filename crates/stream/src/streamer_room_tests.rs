//! Tests of nodes that cannot be read, or that the memory has no room for.

use super::*;

#[test]
fn a_node_that_cannot_be_read_is_reported_once_and_stops_no_other() {
    let octree = Arc::new(terrain(3));
    let streamer = Streamer::new(3, PLENTY, || {}).unwrap();
    streamer.add(
        0,
        paged(&octree, |octree, node| match node.0 {
            1 => Err(Error::damaged("pages".as_ref(), "checksum")),
            2 => panic!("a decoder gives up"),
            3 => Ok(terrain_page(octree, node).select(&[0, 1])),
            _ => Ok(terrain_page(octree, node)),
        }),
    );
    let mut drawer = Drawer::default();
    for _ in 0..3 {
        streamer.want(everything(0, &octree));
        drawer.settle(&streamer);
    }
    drawer.failed.sort_by_key(|(_, node, _)| *node);
    let found: Vec<(u32, &str)> = drawer.failed.iter().map(|(_, node, error)| (node.0, error.as_str())).collect();
    assert_eq!(found[0], (1, "pages: checksum"));
    assert!(found[1].0 == 2 && found[1].1.contains("a decoder gives up"));
    assert_eq!(found[2], (3, "a page has 2 points instead of 256"));
    assert_eq!(found.len(), 3);
    assert_eq!(drawer.points(), octree.points() - 3 * 256, "what lies below them is there");
    assert_eq!(streamer.stats().bytes, drawer.points() * DECODED_POINT_BYTES);
}

#[test]
fn a_node_too_large_for_the_memory_hides_neither_what_is_below_it_nor_other_clouds() {
    let mut octree = terrain(2);
    let large = octree.nodes[0].children[1].unwrap();
    octree.nodes[large.0 as usize].points = 1_000_000;
    let (crowded, even) = (Arc::new(octree), Arc::new(terrain(1)));
    let budget = Budget { points: u64::MAX, bytes: 4 << 20 };
    let streamer = Streamer::new(2, budget, || {}).unwrap();
    streamer.add(0, readable(&crowded));
    streamer.add(1, readable(&even));
    streamer.want(everything(0, &crowded).into_iter().chain(everything(1, &even)).collect());
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(drawer.failed.len(), 1, "{:?}", drawer.failed);
    assert_eq!(drawer.points(), 256 * (crowded.nodes.len() - 1 + even.nodes.len()) as u64);
    // Still too large, which is said once; then with room for it, it comes, and what was said is taken back.
    for (bytes, told, more) in [(5 << 20, 1, 0), (1 << 30, 0, 1_000_000)] {
        streamer.set_budget(Budget { points: u64::MAX, bytes });
        drawer.settle(&streamer);
        let points = 256 * (crowded.nodes.len() - 1 + even.nodes.len()) as u64 + more;
        assert_eq!((drawer.failed.len(), drawer.points()), (told, points));
    }
}

/// A cloud whose chunks take more than twice the stated size.
fn swollen(octree: &Arc<Octree>) -> PagedCloud {
    paged(octree, |octree, node| {
        let chunk = terrain_page(octree, node);
        let exact = (0..chunk.len()).map(|index| chunk.position(index).to_array()).collect();
        Ok(Chunk { exact_positions: Some(Arc::new(exact)), ..chunk })
    })
}

#[test]
fn pages_larger_than_was_said_settle_with_as_many_as_there_is_room_for() {
    let octree = Arc::new(terrain(4));
    let swollen_bytes = 256 * (DECODED_POINT_BYTES + 24);
    for workers in [1, 4] {
        for nodes in [30, 100] {
            let budget = Budget { points: u64::MAX, bytes: nodes * swollen_bytes };
            let streamer = Streamer::new(workers, budget, || {}).unwrap();
            streamer.add(0, swollen(&octree));
            let mut drawer = Drawer::default();
            for _ in 0..2 {
                streamer.want(everything(0, &octree));
                drawer.settle(&streamer);
                assert!(streamer.stats().bytes <= budget.bytes);
                // One node is kept free.
                assert_eq!((drawer.chunks.len() as u64, drawer.failed.len()), (nodes - 1, 0));
            }
        }
    }
}

#[test]
fn a_node_that_turns_out_too_large_is_reported_and_its_room_given_back() {
    let mut octree = terrain(2);
    let large = octree.nodes[0].children[1].unwrap();
    octree.nodes[large.0 as usize].points = 4096;
    let octree = Arc::new(octree);
    let cost = 4096 * DECODED_POINT_BYTES;
    let streamer = Streamer::new(2, Budget { points: u64::MAX, bytes: 3 * cost }, || {}).unwrap();
    streamer.add(0, swollen(&octree));
    streamer.want(everything(0, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(drawer.failed.iter().map(|(_, node, _)| *node).collect::<Vec<_>>(), [large]);
    assert_eq!(drawer.points(), 256 * (octree.nodes.len() as u64 - 1));
}

#[test]
fn what_is_shown_goes_when_it_is_too_large_for_a_smaller_budget() {
    let octree = Arc::new(terrain(2));
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    streamer.add(0, readable(&octree));
    streamer.want(everything(0, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    streamer.set_budget(Budget { points: u64::MAX, bytes: 256 * DECODED_POINT_BYTES - 1 });
    drawer.settle(&streamer);
    assert_eq!((drawer.points(), streamer.stats().bytes), (0, 0));
}

#[test]
fn nodes_that_keep_exact_positions_are_charged_for_them() {
    let mut octree = terrain(2);
    octree.nodes.iter_mut().for_each(|node| node.is_exact = node.level < 2);
    let cut = |bytes| {
        let trees = [Tree { cloud: 0, octree: &octree, point_bytes: POINT_BYTES }];
        choose(&trees, |_, _, _| 1.0, Budget { points: u64::MAX, bytes }, 0.0)
    };
    let shown = 5 * 256 * (POINT_BYTES + 24);
    assert_eq!(cut(shown + 3 * 256 * POINT_BYTES).iter().map(|wanted| wanted.batches).sum::<usize>(), 8 * BATCHES);
}

#[test]
fn nodes_that_could_not_be_read_come_once_they_can_be() {
    let octree = Arc::new(terrain(3));
    let is_down = Arc::new(AtomicBool::new(true));
    let reads = Arc::new(AtomicUsize::new(0));
    let (down, count) = (is_down.clone(), reads.clone());
    let paged = paged(&octree, move |octree, node| {
        count.fetch_add(1, Ordering::Relaxed);
        let is_lost = node.0.is_multiple_of(3) && down.load(Ordering::Relaxed);
        if is_lost {
            Err(Error::io("far".as_ref(), std::io::Error::other("no server")))
        } else {
            Ok(page(octree, node))
        }
    });
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    let mut drawer = Drawer::default();
    streamer.add(0, paged);
    streamer.want(everything(0, &octree));
    drawer.settle(&streamer);
    let lost = octree.ids().filter(|(node, _)| node.0.is_multiple_of(3)).count();
    assert_eq!((drawer.failed.len(), drawer.points() < octree.points()), (lost, true));
    // Neither before its time nor for the same cut is anything asked for again.
    let before = reads.load(Ordering::Relaxed);
    streamer.try_again(Instant::now(), true);
    streamer.want(everything(0, &octree));
    drawer.settle(&streamer);
    assert_eq!(reads.load(Ordering::Relaxed), before);
    // In vain, and said once.
    let mut now = Instant::now();
    for seconds in [2, 3, 5, 9, 17] {
        now += Duration::from_secs(seconds);
        streamer.try_again(now, false);
        drawer.settle(&streamer);
    }
    assert_eq!((reads.load(Ordering::Relaxed), drawer.failed.len()), (before + 5 * lost, lost));
    is_down.store(false, Ordering::Relaxed);
    now += Duration::from_secs(70);
    streamer.try_again(now, false);
    drawer.settle(&streamer);
    assert_eq!(drawer.failed.len(), lost, "they are given up until another view needs them");
    streamer.try_again(now, true);
    drawer.settle(&streamer);
    assert_eq!((drawer.failed.len(), drawer.points()), (0, octree.points()));
}
