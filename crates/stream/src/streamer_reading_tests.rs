//! Tests of what happens while pages are read: other cuts, other clouds, and several threads.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::*;

/// A cloud whose reads each wait for a word from the sender; the receiver gets the nodes whose reads begin.
fn gated(octree: &Arc<Octree>) -> (PagedCloud, SyncSender<()>, Receiver<NodeId>) {
    let (open, gate) = sync_channel(1000);
    let (begin, begun) = sync_channel(1000);
    let gate = Mutex::new(gate);
    let paged = paged(octree, move |octree, node| {
        begin.send(node).unwrap();
        gate.lock().unwrap().recv().unwrap();
        Ok(page(octree, node))
    });
    (paged, open, begun)
}

#[test]
fn a_slow_disk_holds_nobody_up() {
    let octree = Arc::new(random(5, 60));
    let (paged, open, begun) = gated(&octree);
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    streamer.add(0, paged);
    let all = everything(0, &octree);
    for count in 0..200 {
        // A streamer that waited for the reads would hang: none of them ends.
        streamer.want(all[..=count % all.len()].to_vec());
        assert!(streamer.changes().is_empty());
    }
    let reading = [begun.recv().unwrap(), begun.recv().unwrap()];
    assert!(begun.try_recv().is_err(), "two workers read {reading:?}");
    assert!(!streamer.stats().settled);
    (0..60).for_each(|_| open.send(()).unwrap());
    streamer.want(all);
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(drawer.points(), octree.points());
}

#[test]
fn a_new_cut_takes_the_place_of_the_queue() {
    let octree = Arc::new(terrain(2));
    let (paged, open, begun) = gated(&octree);
    let streamer = Streamer::new(1, PLENTY, || {}).unwrap();
    streamer.add(0, paged);
    let of = |nodes: &[u32]| -> Vec<Wanted> {
        nodes.iter().map(|node| Wanted { cloud: 0, node: NodeId(*node), batches: BATCHES }).collect()
    };
    streamer.want(of(&[0, 1, 2, 3]));
    assert_eq!(begun.recv().unwrap(), NodeId(0));
    streamer.want(of(&[0, 4, 2]));
    (0..10).for_each(|_| open.send(()).unwrap());
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(begun.try_iter().collect::<Vec<_>>(), [NodeId(4), NodeId(2)], "in this order, and no other");
    assert_eq!(drawer.chunks.len(), 3);
}

#[test]
fn cuts_with_orphans_doubles_and_strangers_are_taken_for_what_is_left_of_them() {
    let octree = Arc::new(terrain(2));
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    streamer.add(0, readable(&octree));
    let of = |cloud, node, batches| Wanted { cloud, node: NodeId(node), batches };
    let orphan = octree.nodes.len() as u32 - 1;
    streamer.want(vec![
        of(0, orphan, 16),
        of(0, 0, 99),
        of(0, 0, 1),
        of(0, 1_000_000, 16),
        of(7, 0, 16),
        of(0, 1, 0),
        of(0, 2, 3),
    ]);
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    let sizes: Vec<usize> = drawer.chunks.values().map(Chunk::len).collect();
    assert_eq!(sizes, [256, prefix(256, 3)]);
}

#[test]
fn a_cloud_that_goes_while_it_is_read_leaves_nothing() {
    let octree = Arc::new(random(5, 60));
    let (paged, open, begun) = gated(&octree);
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    streamer.add(0, paged.clone());
    streamer.add(1, readable(&octree));
    streamer.want([everything(0, &octree), everything(1, &octree)].concat());
    let reading = [begun.recv().unwrap(), begun.recv().unwrap()];
    streamer.remove(0);
    (0..2).for_each(|_| open.send(()).unwrap());
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert!(drawer.chunks.keys().all(|(cloud, _)| *cloud == 1), "{reading:?}");
    assert_eq!(drawer.points(), octree.points());
    // Reads in progress count until they end.
    let ended = (0..10_000).any(|_| {
        std::thread::sleep(Duration::from_millis(1));
        streamer.stats().bytes == drawer.points() * DECODED_POINT_BYTES
    });
    assert!(ended && begun.try_recv().is_err());
    // The number is free again.
    streamer.remove(1);
    assert_eq!((streamer.stats().bytes, streamer.stats().shown_points), (0, 0));
    streamer.add(0, paged);
    streamer.want(everything(0, &octree));
    (0..60).for_each(|_| open.send(()).unwrap());
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    assert_eq!(drawer.points(), octree.points());
}

#[test]
fn a_replaced_cloud_is_read_again_and_never_gone() {
    let octree = Arc::new(terrain(3));
    // Room for one node more than exist.
    let bytes = (octree.points() + 256) * DECODED_POINT_BYTES;
    let streamer = Streamer::new(2, Budget { points: u64::MAX, bytes }, || {}).unwrap();
    let with_radii = |add_radii: bool| {
        paged(&octree, move |octree, node| {
            let mut chunk = terrain_page(octree, node);
            if !add_radii {
                (chunk.normals, chunk.radii) = (None, None);
            }
            Ok(chunk)
        })
    };
    streamer.add(0, with_radii(false));
    streamer.want(everything(0, &octree));
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    let provisional = pack_radius(provisional_radius(octree.nodes[0].bounds, octree.points()));
    let root = &drawer.chunks[&(0, NodeId(0))];
    assert!(root.normals.is_none() && root.radii.as_ref().unwrap().iter().all(|radius| *radius == provisional));

    streamer.replace(0, with_radii(true));
    assert!(!streamer.stats().settled);
    for _ in 0..10_000 {
        for change in streamer.changes() {
            drawer.apply(change);
            assert_eq!(drawer.points(), octree.points());
        }
        assert!(streamer.stats().bytes <= bytes);
        if streamer.stats().settled {
            break;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    for (id, _) in octree.ids() {
        let (chunk, read) = (&drawer.chunks[&(0, id)], terrain_page(&octree, id));
        assert_eq!((&chunk.normals, &chunk.radii), (&read.normals, &read.radii));
    }
    // Another tree under the same number: nothing of the first stays.
    let other = Arc::new(random(5, 20));
    streamer.replace(0, readable(&other));
    streamer.want(everything(0, &other));
    drawer.settle(&streamer);
    assert_eq!(drawer.points(), other.points());
}

#[test]
fn normals_and_radii_that_are_missing_are_estimated() {
    let octree = Arc::new(terrain(2));
    let streamer = Streamer::new(2, PLENTY, || {}).unwrap();
    let bare = paged(&octree, |octree, node| {
        let chunk = terrain_page(octree, node);
        Ok(Chunk { normals: None, radii: None, ..chunk })
    });
    let options = SurfelOptions::new(cloud::Orientation::Up(Vec3::Z));
    streamer.add(0, PagedCloud { missing: Missing::Estimate(options), ..bare });
    streamer.want(everything(0, &octree)[..1].to_vec());
    let mut drawer = Drawer::default();
    drawer.settle(&streamer);
    let root = terrain_page(&octree, NodeId(0));
    let bare = Chunk { normals: None, radii: None, ..root };
    let own = cloud::estimate(&[bare], &options, &Progress::default()).unwrap().remove(0);
    let alone = drawer.chunks[&(0, NodeId(0))].clone();
    assert_eq!(**alone.normals.as_ref().unwrap(), own.normals);
    for (radius, own) in alone.radii.as_ref().unwrap().iter().zip(&own.radii) {
        // Converted to full density and grown by as much, to the nearest eighth of an octave.
        assert!(i32::from(*own).abs_diff(i32::from(*radius)) <= 129, "{radius} for {own}");
    }
    streamer.want(everything(0, &octree));
    drawer.settle(&streamer);
    let among = &drawer.chunks[&(0, NodeId(0))];
    let sum = |chunk: &Chunk| chunk.radii.as_ref().unwrap().iter().map(|radius| i64::from(*radius)).sum::<i64>() / 256;
    let octaves = (sum(&alone) - sum(among)) as f64 / 2048.0;
    assert!((octaves - 0.5 * 21.0_f64.log2()).abs() <= 0.07, "{octaves}");
}

#[test]
fn wakes_whenever_there_is_something_to_take() {
    let octree = Arc::new(terrain(4));
    let (wake, woken) = sync_channel(1);
    let budget = Budget { points: 20_000, bytes: 21_000 * DECODED_POINT_BYTES };
    let streamer = Streamer::new(2, budget, move || {
        let _ = wake.try_send(());
    })
    .unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    let mut drawer = Drawer::default();
    for step in 0..40 {
        let eye = DVec3::new(20.0 * f64::from(step), 500.0, 100.0);
        streamer.want(cut_from(&octree, eye, 20_000));
        // Changes are requested only after a wake, and a first time: kept nodes may be enough.
        streamer.changes().into_iter().for_each(|change| drawer.apply(change));
        while !streamer.stats().settled {
            woken.recv_timeout(Duration::from_secs(20)).expect("nobody wakes the drawer");
            streamer.changes().into_iter().for_each(|change| drawer.apply(change));
        }
    }
    assert!(drawer.points() > 19_000);
}

#[test]
fn many_threads_at_once_come_to_the_same_end() {
    let octree = Arc::new(terrain(4));
    let streamer = Streamer::new(8, Budget { points: 30_000, bytes: 40_000 * DECODED_POINT_BYTES }, || {}).unwrap();
    streamer.add(0, paged(&octree, |octree, node| Ok(terrain_page(octree, node))));
    let drawer = Mutex::new(Drawer::default());
    let is_done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while !is_done.load(Ordering::Relaxed) {
                    // One thread at a time takes changes and applies them.
                    let mut drawer = drawer.lock().unwrap();
                    streamer.changes().into_iter().for_each(|change| drawer.apply(change));
                }
            });
        }
        let lookers: Vec<_> = (0..3)
            .map(|looker| {
                let (streamer, octree) = (&streamer, &octree);
                scope.spawn(move || {
                    for step in 0..100 {
                        let eye = DVec3::new(f64::from(step * 10), f64::from(looker * 400), 50.0);
                        streamer.want(cut_from(octree, eye, 30_000));
                        assert!(streamer.stats().bytes <= 40_000 * DECODED_POINT_BYTES);
                        std::thread::yield_now();
                    }
                })
            })
            .collect();
        lookers.into_iter().for_each(|looker| looker.join().unwrap());
        is_done.store(true, Ordering::Relaxed);
    });
    let cut = cut_from(&octree, DVec3::new(500.0, 500.0, 50.0), 30_000);
    streamer.want(cut.clone());
    let mut drawer = drawer.into_inner().unwrap();
    drawer.settle(&streamer);
    let shown: BTreeSet<NodeId> = drawer.chunks.keys().map(|(_, node)| *node).collect();
    assert!(cut.iter().all(|wanted| shown.contains(&wanted.node)));
    assert_eq!(drawer.points(), streamer.stats().shown_points);
}
