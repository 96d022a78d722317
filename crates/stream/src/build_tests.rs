use super::*;

#[test]
fn the_first_distribution_keeps_to_its_memory_however_many_points_there_are() {
    for memory in [64_u64 << 20, 256 << 20, 1 << 30, 16 << 30].map(|bytes| bytes / 4) {
        let depths: Vec<u8> = (3..18).map(|digits| first_depth(10_u64.pow(digits), 400_000, memory)).collect();
        assert!(depths.is_sorted() && depths[0] == 0, "{depths:?}");
        // Cells of 32 KiB each, and as much for records.
        assert!((1_u64 << (2 * depths[depths.len() - 1])) << 16 <= memory, "{depths:?}");
    }
    assert_eq!(first_depth(100_000_000, 400_000, 1 << 28), 5);
}

#[test]
fn more_points_than_memory_has_tables_for_are_told_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(200_000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let index =
        |memory| build(&inputs, &cache, &BuildOptions { memory, preview_points: 0 }, &Progress::default(), &|_| ());
    let error = index(7_999).err().unwrap();
    assert!(matches!(error, Error::TooMany { points: 200_000, needed: 8_000, .. }), "{error}");
    assert!(error.to_string().contains("stream.host_bytes"));
    assert_eq!(cache.size(), 0);
    assert_eq!(index(8_000).unwrap().octree().points(), 200_000);
}

#[test]
fn a_full_disk_is_told_by_its_folder_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(200_000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let options = BuildOptions { memory: 1 << 20, preview_points: 0 };
    let index = |disk| build_on_disk(&inputs, &cache, &options, &Progress::default(), &|_| (), &|_| 0, disk);
    // The first size is too small for the records; the others are large enough for these (which stay in memory
    // where they may), but not for the pages.
    for disk in [10_000, 1_000_000, 2_500_000] {
        let error = index(disk).err().unwrap();
        assert!(matches!(&error, Error::Full { folder, .. } if folder == cache.folder()), "{error}");
        let message = error.to_string();
        assert!(message.contains("cache") && message.contains("9 MB"), "{message}");
        assert_eq!(cache.size(), 0);
    }
    assert_eq!(index(u64::MAX).unwrap().octree().points(), 200_000);
}

fn ply(path: &Path, points: &[[f64; 3]]) -> [Arc<Source>; 1] {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
    text += "property double x\nproperty double y\nproperty double z\nend_header\n";
    points.iter().for_each(|[x, y, z]| text += &format!("{x:e} {y:e} {z:e}\n"));
    std::fs::write(path, text).unwrap();
    [Arc::new(codec::open(path).unwrap())]
}

#[test]
fn points_too_far_away_to_be_true_are_left_out_and_the_others_kept_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let usual = |index: u32| [f64::from(index % 40) * 0.25, f64::from(index / 40) * 0.25, 0.5];
    let strays: [&[[f64; 3]]; 6] = [
        &[[1.7e308, 0.0, 0.0], [-1.7e308, 0.0, 0.0]],
        &[[1e300, 0.0, 0.0]],
        &[[0.0, -1e300, 1e300]],
        &[[3.4e38, -3.4e38, 3.4e38]],
        &[[0.0, 1e25, 0.0]],
        &[[0.0, 1e18, 0.0], [0.0, -1e18, 0.0]],
    ];
    for (number, strays) in strays.into_iter().enumerate() {
        for first in [false, true] {
            let mut points: Vec<[f64; 3]> = (0..1000).map(usual).collect();
            let at = if first { 0 } else { points.len() };
            points.splice(at..at, strays.iter().copied());
            let inputs = ply(&folder.path().join(format!("{number}{first}.ply")), &points);
            let cache = Cache::new(folder.path().join("cache"), u64::MAX);
            let options = BuildOptions::default();
            let pages = build(&inputs, &cache, &options, &Progress::default(), &|_| ()).unwrap();
            let case = format!("{strays:?} {first}");
            assert_eq!((pages.octree().points(), pages.skipped_points()), (1000, strays.len() as u64), "{case}");
            let mut places = Vec::new();
            for (node, _) in pages.octree().ids() {
                let chunk = pages.read(node).unwrap();
                places.extend((0..chunk.len()).map(|index| chunk.position(index)));
            }
            let is_there = |place: [f64; 3]| places.iter().any(|at| at.distance(place.into()) < 1e-6);
            assert!((0..1000).map(usual).all(is_there), "{case}");
        }
    }
}

#[test]
fn extreme_extents_give_an_index_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let line = |scale: f64| (0..1000).map(|index| [f64::from(index) * scale, 0.0, 0.0]).collect::<Vec<_>>();
    let far = (0..1000).map(|index| [1e15 + f64::from(index), 0.0, 0.0]).collect();
    let cases: [(Vec<[f64; 3]>, bool); 9] = [
        (line(1e-310), true),
        (line(5e-324), true),
        (line(1e-35), true),
        (line(1e20), true),
        (line(1e304), false),
        (far, true),
        (vec![[1.0, 2.0, 3.0]], true),
        (vec![[1e-310; 3]], true),
        (vec![[1.7e308; 3], [-1.7e308; 3]], false),
    ];
    for (number, (points, is_held)) in cases.into_iter().enumerate() {
        let inputs = ply(&folder.path().join(format!("{number}.ply")), &points);
        let cache = Cache::new(folder.path().join("cache"), u64::MAX);
        match build(&inputs, &cache, &BuildOptions::default(), &Progress::default(), &|_| ()) {
            Ok(pages) => {
                let kept = pages.octree().points();
                assert_eq!(kept + pages.skipped_points(), points.len() as u64, "{number}");
                assert!(!is_held || kept == points.len() as u64, "{number}: {kept}");
                assert!(pages.octree().ids().all(|(node, _)| pages.read(node).is_ok()), "{number}");
            }
            Err(error) => assert!(!is_held && matches!(error, Error::Empty { .. }), "{number}: {error}"),
        }
    }
}

#[test]
fn a_cloud_without_bounds_in_its_header_is_shown_once_and_counted_as_often_as_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let points: Vec<[f64; 3]> = (0..1000).map(|index| [f64::from(index), 1.0, 2.0]).collect();
    let inputs = ply(&folder.path().join("a.ply"), &points);
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let progress = Progress::default();
    let shown = Mutex::new(Vec::new());
    let show = |change: Previewed| match change {
        Previewed::Share(chunk) => shown.lock().unwrap().push((progress.done(), chunk.len())),
        Previewed::First(..) | Previewed::FirstGone(_) => panic!("only LAZ has first points"),
    };
    build(&inputs, &cache, &BuildOptions::default(), &progress, &show).unwrap();
    assert_eq!(shown.into_inner().unwrap(), [(1000, 1000)], "before it is read again");
    assert_eq!((progress.done(), progress.total()), (3000, 3000));
}

#[test]
#[cfg(unix)]
fn a_damaged_index_is_made_anew_while_somebody_has_it_open_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(1000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let index = || build(&inputs, &cache, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    let names = || std::fs::read_dir(cache.folder()).unwrap().flatten().count();
    let open = index();
    cache.discard(cache.open(&inputs).unwrap().unwrap());
    let anew = index();
    assert!(open.read(crate::NodeId(0)).is_ok() && anew.read(crate::NodeId(0)).is_ok());
    cache.make_room(0);
    assert_eq!(names(), 5, "two entries with their locks");
    drop(open);
    cache.make_room(0);
    assert_eq!(names(), 3, "one is left");
    assert!(cache.open(&inputs).unwrap().is_some());
    drop(anew);
    cache.clear();
    assert_eq!(names(), 1);
}

#[test]
fn who_waits_for_another_builder_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(1000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let lock = cache.try_lock(&cache.entry(&Identity::of(&inputs).unwrap())).unwrap().unwrap();
    let progress = Progress::default();
    std::thread::scope(|scope| {
        let build = scope.spawn(|| build(&inputs, &cache, &BuildOptions::default(), &progress, &|_| ()).unwrap());
        while !progress.is_waiting() {
            assert!(!build.is_finished());
            std::thread::yield_now();
        }
        drop(lock);
        assert_eq!(build.join().unwrap().octree().points(), 1000);
    });
    assert!(!progress.is_waiting());
}

#[test]
fn a_file_that_takes_the_name_of_one_that_is_open_gets_an_index_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let [path, other] = ["a.las", "b.las"].map(|name| folder.path().join(name));
    let mut points = made_up::terrain(1000);
    made_up::write_las(&path, &points);
    // Length and time are those of the file that has the name now, for both.
    points.reverse();
    made_up::write_las(&other, &points);
    let before = [Arc::new(codec::open(&path).unwrap())];
    std::fs::rename(&other, &path).unwrap();
    let after = [Arc::new(codec::open(&path).unwrap())];
    assert_ne!(Identity::of(&before).unwrap().key, Identity::of(&after).unwrap().key);
    assert_eq!(Identity::of(&after).unwrap(), Identity::of(&after).unwrap());
}

#[test]
fn an_index_is_removed_when_nobody_has_it_open() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(1000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let pages = build(&inputs, &cache, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    let entry = pages.folder().to_owned();
    assert_eq!((pages.bytes(), cache.size() > 10_000), (cache.size(), true));
    assert!(!cache.remove(&entry) && cache.open(&inputs).unwrap().is_some());
    drop(pages);
    assert!(!cache.remove(folder.path()), "that is no index");
    assert!(cache.remove(&entry) && cache.open(&inputs).unwrap().is_none() && path.exists());
}

#[test]
fn damaged_surfels_are_forgotten_without_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(60_000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let index = || build(&inputs, &cache, &BuildOptions::default(), &Progress::default(), &|_| ()).unwrap();
    let options = cloud::SurfelOptions {
        neighbours: 8,
        orientation: cloud::Orientation::Up(glam::Vec3::Z),
        radii: cloud::RadiusRule::Full,
        seen_from: None,
    };
    let flip_last = |name: &str| {
        let path = cache.entry(&Identity::of(&inputs).unwrap()).join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(&path, bytes).unwrap();
    };
    crate::estimate_surfels(&index(), &options, 1 << 30, &Progress::default()).unwrap();
    assert!(index().has_surfels());
    flip_last("surfels");
    cache.discard(cache.open(&inputs).unwrap().unwrap());
    assert!(!cache.open(&inputs).unwrap().unwrap().has_surfels());
    crate::estimate_surfels(&index(), &options, 1 << 30, &Progress::default()).unwrap();
    assert!(index().has_surfels());
    // Not when the points are damaged as well.
    flip_last("surfels");
    flip_last("pages");
    cache.discard(cache.open(&inputs).unwrap().unwrap());
    assert!(cache.open(&inputs).unwrap().is_none());
}

#[test]
fn an_index_whose_lock_file_cannot_be_written_is_read_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.las");
    made_up::write_las(&path, &made_up::terrain(1000));
    let inputs = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.path().join("cache"), u64::MAX);
    let index = || build(&inputs, &cache, &BuildOptions::default(), &Progress::default(), &|_| ());
    let lock = crate::cache::lock_path(index().unwrap().folder());
    std::fs::remove_file(&lock).unwrap();
    std::fs::create_dir(&lock).unwrap();
    assert_eq!(index().unwrap().octree().points(), 1000);
}
