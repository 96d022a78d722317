//! Opens catalogues of tiles from a server.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;
#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests use all of it")]
mod server;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use scene::{Paging, Settings};
use server::{Habits, Server};
use world::{Event, IndexState, Input, Part};

/// A folder of 12 tiles and their catalogue.
fn catalogue(folder: &Path, data: &Path) -> Vec<PathBuf> {
    // Requests are not made again by themselves.
    codec::use_network(codec::Network { waits: &[], ..Default::default() }).unwrap();
    let model = std::fs::read(data.join("copc/ellipsoid_las14_pf7.copc.laz")).unwrap();
    let paths: Vec<PathBuf> = (0..12).map(|number| folder.join(format!("{number}.copc.laz"))).collect();
    paths.iter().for_each(|path| std::fs::write(path, &model).unwrap());
    let sources: Vec<codec::Source> = paths.iter().map(|path| codec::open(path).unwrap()).collect();
    let tile = |source| {
        let info = codec::Source::info(source);
        codec::CatalogueTile { info, points: info.points, bounds: info.bounds.unwrap() }
    };
    codec::write_catalogue(&sources.iter().map(tile).collect::<Vec<_>>(), &folder.join("all.vpc")).unwrap();
    paths
}

#[test]
fn tiles_that_were_missing_come_while_the_scene_is_open() {
    let Some(data) = real_data::test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let paths = catalogue(folder.path(), &data);
    let away = folder.path().join("away");
    std::fs::rename(&paths[7], &away).unwrap();
    // Requests of each kind fail, for heads, lists of nodes and points, but so few that no tile fails at each of its tries.
    let server = Server::of_folder(folder.path(), Habits { fails: 23, ..Habits::default() });
    let address = server.path("all.vpc");
    codec::trust_address(&address);
    let mut settings = Settings::default();
    settings.stream.pages = Paging::Always;
    let job = world::start(vec![Input::File(address)], &settings, BTreeSet::new());
    let (mut shown, mut missing, mut mended) = (BTreeSet::new(), BTreeSet::new(), BTreeSet::new());
    // The first request for it may be one of those that fail.
    let is_of_seven = |problem: &String| problem.contains("/7.copc.laz");
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let event = job.events.recv_timeout(deadline.saturating_duration_since(Instant::now()));
        let problems = match event.unwrap_or_else(|_| panic!("missing: {missing:?}, shown: {shown:?}")) {
            Event::Chunk { part: Part::Tile(tile, _), .. } => {
                shown.insert(tile);
                Vec::new()
            }
            Event::Mended { problem, .. } => {
                assert!(missing.remove(&problem), "{problem}");
                mended.insert(problem);
                Vec::new()
            }
            Event::Stream(stats) if stats.is_settled && missing.is_empty() && mended.iter().any(is_of_seven) => break,
            Event::Read { summary, .. } => summary.warnings,
            Event::Failed { error, .. } => vec![error],
            _ => Vec::new(),
        };
        if away.exists() && problems.iter().any(is_of_seven) {
            std::fs::rename(&away, &paths[7]).unwrap();
        }
        missing.extend(problems);
    }
    assert_eq!(shown, (0..12).collect());
}

#[test]
fn the_boxes_of_all_tiles_are_known_before_the_tiles_are_fetched() {
    let Some(data) = real_data::test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let paths = catalogue(folder.path(), &data);
    std::fs::remove_file(&paths[7]).unwrap();

    // All tiles but the first wait until all boxes have come.
    let is_open = Arc::new(AtomicBool::new(false));
    let gate = is_open.clone();
    let server = Server::of_folder_after(folder.path(), Habits::default(), move |request| {
        while !gate.load(Ordering::Relaxed) && !["/all.vpc", "/0.copc.laz"].contains(&request.path.as_str()) {
            std::thread::sleep(Duration::from_millis(1));
        }
    });
    let address = server.path("all.vpc");
    codec::trust_address(&address);
    let mut settings = Settings::default();
    settings.stream.pages = Paging::Always;
    let job = world::start(vec![Input::File(address)], &settings, BTreeSet::new());
    let (mut has_boxes, mut shown, mut warnings) = (false, BTreeSet::new(), Vec::new());
    for event in &job.events {
        match event {
            Event::Pages { pages: IndexState::Indexed { octree, .. }, .. } => {
                assert_eq!(octree.paged.unread.len() + octree.paged.tiles.len(), 12);
                has_boxes = true;
                is_open.store(true, Ordering::Relaxed);
            }
            Event::Chunk { part: Part::Tile(tile, _), .. } => {
                assert!(has_boxes, "points of tile {tile} come before all boxes");
                shown.insert(tile);
            }
            Event::Read { summary, .. } => warnings.extend(summary.warnings),
            Event::Stream(stats) if stats.is_settled && shown.len() == 11 => break,
            Event::Failed { error, .. } => warnings.push(error.to_string()),
            _ => {}
        }
    }
    assert_eq!(shown, (0..12).filter(|tile| *tile != 7).collect());
    let told = warnings.join("\n");
    assert!(told.contains("a tile is missing") && told.contains("7.copc.laz"), "{told}");
}
