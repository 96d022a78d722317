use std::time::{Duration, Instant};

use cloud::Progress;
use scene::Camera;

use super::*;
use crate::event::Event;
use crate::job::start;
use crate::mailbox::{StreamRequest, StreamView};

const SIDE: f64 = 100.0;
const POINTS: u32 = 400;

/// A LAS file of points in a square of 100 m.
fn las() -> Vec<u8> {
    let mut bytes = vec![0; 227];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, b"LASF");
    put(24, &[1, 2]);
    put(94, &227_u16.to_le_bytes());
    put(96, &227_u32.to_le_bytes());
    put(105, &20_u16.to_le_bytes());
    put(107, &POINTS.to_le_bytes());
    (0..3).for_each(|axis| put(131 + 8 * axis, &0.01_f64.to_le_bytes()));
    [SIDE, 0.0, SIDE, 0.0, 0.0, 0.0].iter().enumerate().for_each(|(at, end)| put(179 + 8 * at, &end.to_le_bytes()));
    for index in 0..POINTS {
        let place = [index % 20 * 526, index / 20 * 526, 0].map(|step| step.to_le_bytes());
        bytes.extend(place.as_flattened());
        bytes.extend([0; 8]);
    }
    bytes
}

/// A row of COPC files along x, each at its own place.
fn row(folder: &Path, count: usize) -> Vec<PathBuf> {
    let (las_path, model) = (folder.join("model.las"), folder.join("model.copc.laz"));
    std::fs::write(&las_path, las()).unwrap();
    codec::write_copc(std::slice::from_ref(&las_path), &model, 1 << 28, &Progress::default()).unwrap();
    let bytes = std::fs::read(&model).unwrap();
    [las_path, model].into_iter().for_each(|path| std::fs::remove_file(path).unwrap());
    let moved = |index: usize| {
        let path = folder.join(format!("{index:03}.copc.laz"));
        let mut own = bytes.clone();
        // The centre of the cube, the offset of coordinates, and the greatest and least x.
        for at in [375 + 54, 155, 179, 187] {
            let value = f64::from_le_bytes(own[at..at + 8].try_into().unwrap()) + SIDE * index as f64;
            own[at..at + 8].copy_from_slice(&value.to_le_bytes());
        }
        std::fs::write(&path, own).unwrap();
        path
    };
    (0..count).map(moved).collect()
}

fn entries(paths: &[PathBuf]) -> Vec<CatalogueEntry> {
    paths.iter().map(|path| codec::entry_of(path).unwrap()).collect()
}

fn tiles(entries: Vec<CatalogueEntry>, most_open: usize) -> Tiles {
    let settings = Settings::default();
    let tiles: Vec<Tile> = entries.into_iter().map(|entry| Tile::of(entry).unwrap()).collect();
    let model = open_tile(&tiles[0].path, &settings).unwrap();
    Tiles { most_open, ..Tiles::new(0, Path::new("all.vpc"), tiles, model, &settings, BTreeSet::new()) }
}

/// Waits for the tiles that are being opened. Returns those that have gone.
fn settle(tiles: &mut Tiles, mailbox: &Arc<Mailbox>) -> Vec<usize> {
    let mut closed = tiles.open_needed(mailbox);
    while tiles.waiting() > 0 {
        for request in mailbox.wait(Duration::from_secs(60), 0).unwrap().requests {
            let StreamRequest::Tile { tile, found, .. } = request else { panic!("a tile is waited for") };
            closed.extend(tiles.put(tile, found).closed);
        }
        closed.extend(tiles.open_needed(mailbox));
    }
    closed
}

fn open(tiles: &Tiles) -> Vec<usize> {
    let is_open = |index: &usize| matches!(tiles.tiles[*index].state, State::Open(_));
    (0..tiles.tiles.len()).filter(is_open).collect()
}

/// The urgency of tiles for an eye at x.
fn from(x: f64) -> impl Fn(Bounds) -> Option<(bool, f64)> {
    move |bounds| Some((false, (bounds.center().x - x).abs()))
}

#[test]
fn the_nearest_tiles_are_open_within_their_limit_and_those_left_behind_go_first() {
    let folder = tempfile::tempdir().unwrap();
    let mailbox = Arc::<Mailbox>::default();
    let mut tiles = tiles(entries(&row(folder.path(), 12)), 4);
    tiles.need(false, from(150.0));
    // The two nearest, and two of all others.
    assert_eq!((settle(&mut tiles, &mailbox), open(&tiles)), (vec![], vec![1, 2, 3, 10]));
    assert_eq!(tiles.counts(), [4, 12, 12]);
    let warnings = tiles.summary().unwrap().0.warnings;
    assert!(warnings.len() == 1 && warnings[0].contains("12 tiles; 4 are open"), "{warnings:?}");
    // Another view has other tiles near, and the same of all others.
    tiles.need(false, from(750.0));
    assert_eq!((settle(&mut tiles, &mailbox), open(&tiles)), (vec![1, 2], vec![3, 7, 8, 10]));
    // Of those that a view does not need, the ones that were needed the longest time ago go first.
    tiles.need(false, from(150.0));
    settle(&mut tiles, &mailbox);
    tiles.need(false, |bounds| (bounds.min.x > 1050.0).then_some((false, 0.0)));
    assert_eq!((settle(&mut tiles, &mailbox), open(&tiles)), (vec![1], vec![2, 3, 10, 11]));
}

#[test]
fn no_more_tiles_are_opened_once_that_is_stopped_until_the_view_changes() {
    let folder = tempfile::tempdir().unwrap();
    let mailbox = Arc::<Mailbox>::default();
    let mut tiles = tiles(entries(&row(folder.path(), 12)), 12);
    tiles.need(false, from(0.0));
    tiles.open_needed(&mailbox);
    tiles.stop();
    assert_eq!((settle(&mut tiles, &mailbox), open(&tiles).len()), (vec![], AT_ONCE));
    assert!(tiles.summary().unwrap().0.cancelled);
    tiles.try_again();
    settle(&mut tiles, &mailbox);
    assert_eq!(tiles.counts(), [12; 3]);
}

#[test]
fn tiles_that_are_not_as_their_catalogue_says_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let mailbox = Arc::<Mailbox>::default();
    let paths = row(folder.path(), 6);
    // The header of the last one announces points that its octree does not have.
    let mut announcing = std::fs::read(&paths[5]).unwrap();
    announcing[247..255].copy_from_slice(&u64::from(POINTS + 8).to_le_bytes());
    std::fs::write(&paths[5], announcing).unwrap();
    let mut told = entries(&paths);
    std::fs::remove_file(&paths[1]).unwrap();
    std::fs::write(&paths[2], las()).unwrap();
    told[3].points = Some(7);
    told[4].bounds = Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE });
    let mut tiles = tiles(told, 9);
    tiles.need(false, from(0.0));
    settle(&mut tiles, &mailbox);
    let (summary, missing) = tiles.summary().unwrap();
    assert_eq!((missing.len(), summary.missing), (2, 8), "{missing:?}");
    let warnings = [summary.warnings, missing].concat().join("\n");
    for told in [
        "a tile is missing: ",
        "001.copc.laz",
        "002.copc.laz: no COPC file with an octree",
        "7 points of ",
        "004.copc.laz another place than it has",
    ] {
        assert!(warnings.contains(told), "{told}: {warnings}");
    }
    let (points, bounds) = (tiles.tiles[3].points, tiles.tiles[4].bounds);
    assert_eq!((points, bounds.min.x, open(&tiles)), (u64::from(POINTS), 400.0, vec![0, 3, 4, 5]));
    // What is found later is told for some tiles only.
    for index in 0..30 {
        tiles.warn(index % 5, vec!["wrong".into()]);
    }
    assert_eq!((tiles.news().len(), tiles.news().len()), (MOST_TOLD, 0));
}

#[test]
fn tiles_that_were_missing_are_opened_once_they_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let mailbox = Arc::<Mailbox>::default();
    let paths = row(folder.path(), 5);
    let mut tiles = tiles(entries(&paths), 9);
    let away = |index: usize| folder.path().join(format!("away-{index}"));
    [1, 2, 3].into_iter().for_each(|index| std::fs::rename(&paths[index], away(index)).unwrap());
    let back = |index: usize| std::fs::rename(away(index), &paths[index]).unwrap();
    let near = |bounds: Bounds| (bounds.min.x < 350.0).then_some((false, bounds.min.x));
    tiles.need(false, near);
    settle(&mut tiles, &mailbox);
    assert_eq!((open(&tiles), tiles.waiting()), (vec![0], 0));
    // One comes before anything was said.
    let mut now = Instant::now();
    assert!(!tiles.ask_again(now, true), "not at once");
    let mut again = |tiles: &mut Tiles, seconds: u64, is_other_view: bool| {
        now += Duration::from_secs(seconds);
        tiles.need(false, near);
        let is_asked = tiles.ask_again(now, is_other_view);
        tiles.need(false, near);
        settle(tiles, &mailbox);
        is_asked
    };
    back(1);
    assert!(again(&mut tiles, 2, false));
    assert_eq!((open(&tiles), tiles.mended()), (vec![0, 1], vec![]));
    let mut told = tiles.summary().unwrap().1;
    told.sort();
    assert!(told.len() == 2 && told[0].contains("002.copc.laz") && told[1].contains("003.copc.laz"), "{told:?}");
    back(2);
    assert!(again(&mut tiles, 3, false));
    assert_eq!((open(&tiles), tiles.mended()), (vec![0, 1, 2], vec![told[0].clone()]));
    // After some tries in vain, which are not told again, only another view asks once more.
    for seconds in [5, 9, 17] {
        assert!(again(&mut tiles, seconds, false));
    }
    assert_eq!(tiles.news(), Vec::<String>::new());
    back(3);
    assert!(!again(&mut tiles, 70, false) && again(&mut tiles, 0, true));
    assert_eq!((open(&tiles), tiles.mended()), (vec![0, 1, 2, 3], vec![told[1].clone()]));
}

/// What a camera sees in a picture of that size.
fn seen_by(camera: Camera, size: [u32; 2], settings: &Settings) -> StreamView {
    StreamView {
        camera,
        size,
        view: settings.view.clone(),
        stream: settings.stream.clone(),
        mirrors: Vec::new(),
        hidden: BTreeSet::new(),
        placed: BTreeMap::new(),
        test: cloud::PointTest::default(),
        asked: BTreeSet::new(),
        share: 1.0,
        is_alone: false,
    }
}

#[test]
fn a_catalogue_is_one_cloud_of_which_a_view_has_the_tiles_that_it_shows() {
    let folder = tempfile::tempdir().unwrap();
    const SEEN: u32 = 44;
    let first_look: BTreeSet<u32> = (0..64).map(|index| index * 80 / 64).chain([79]).collect();
    assert!(!first_look.contains(&SEEN));
    let files = row(folder.path(), 80);
    let mut settings = Settings::default();
    settings.stream.unseen = 0.0;
    let input = Input::Tiles { folder: folder.path().to_owned(), files };
    let job = start(vec![input], &settings, BTreeSet::new());
    // From above the middle of the tile that is seen.
    let camera = Camera::looking(DVec3::new(SIDE * (f64::from(SEEN) + 0.5), 50.0, 60.0), DVec3::NEG_Z, 60.0, DVec3::Y);
    let view = StreamView { is_alone: true, ..seen_by(camera, [100, 100], &settings) };
    let number = job.mailbox.set_view(view);
    let (mut there, mut opened) = (BTreeMap::new(), 0);
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        assert!(Instant::now() < deadline);
        match job.events.recv().unwrap() {
            Event::Opened { cloud, opened: told } => {
                assert_eq!((cloud, told.expected_points), (0, 80 * u64::from(POINTS)));
                opened += 1;
            }
            Event::Chunk { cloud: 0, part: Part::Tile(tile, node), chunk } => {
                assert_eq!(chunk.first_point >> 47, u64::from(tile));
                there.insert((tile, node), chunk.len());
            }
            Event::Dropped { cloud: 0, part: Part::Tile(tile, node) } => drop(there.remove(&(tile, node))),
            Event::Stream(stats) if stats.is_settled && stats.view_number == number => {
                assert_eq!(stats.tiles, [1, 1, 80]);
                assert_eq!(stats.points_total, 80 * u64::from(POINTS));
                break;
            }
            Event::Failed { error, .. } => panic!("{error}"),
            _ => {}
        }
    }
    let expected = first_look.iter().copied().chain([SEEN]).map(|tile| ((tile, NodeId(0)), POINTS as usize));
    assert_eq!((opened, there), (1, expected.collect()));
}

#[test]
fn what_is_cancelled_before_any_view_stays_so_until_the_second_one() {
    let folder = tempfile::tempdir().unwrap();
    let settings = Settings::default();
    let input = Input::Tiles { folder: folder.path().to_owned(), files: row(folder.path(), 80) };
    let job = start(vec![input], &settings, BTreeSet::new());
    // From so high above that some twenty tiles are seen.
    let set_view = |height: f64| {
        let camera = Camera::looking(DVec3::new(40.0 * SIDE, 50.0, height), DVec3::NEG_Z, height, DVec3::Y);
        job.mailbox.set_view(seen_by(camera, [800, 600], &settings))
    };
    let deadline = Instant::now() + Duration::from_secs(60);
    let next = || {
        assert!(Instant::now() < deadline);
        job.events.recv().unwrap()
    };
    // The first tile that is open.
    while !matches!(next(), Event::Chunk { .. }) {}
    job.mailbox.stop_all();
    let summary = loop {
        if let Event::Read { summary, .. } = next() {
            break summary;
        }
    };
    assert!(summary.cancelled);
    let open = [1500.0, 1600.0].map(|height| {
        let number = set_view(height);
        loop {
            match next() {
                Event::Stream(stats) if stats.is_settled && stats.view_number == number => break stats.tiles[0],
                _ => {}
            }
        }
    });
    assert!(open[0] < open[1], "{open:?}");
}
