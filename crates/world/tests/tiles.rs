//! Opens catalogues of tiles from a server.
#![allow(clippy::unwrap_used, reason = "what cannot be read is a failed test")]

#[path = "../../../tests/src/real_data.rs"]
mod real_data;
#[path = "../../../tests/src/server.rs"]
#[allow(dead_code, reason = "other tests use all of it")]
mod server;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use scene::{Paging, Settings};
use server::{Habits, Server};
use world::{Event, IndexState, Input, Part};

#[test]
fn the_boxes_of_all_tiles_are_known_before_the_tiles_are_fetched() {
    let Some(data) = real_data::test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = std::fs::read(data.join("copc/ellipsoid_las14_pf7.copc.laz")).unwrap();
    let paths: Vec<PathBuf> = (0..12).map(|number| folder.path().join(format!("{number}.copc.laz"))).collect();
    paths.iter().for_each(|path| std::fs::write(path, &model).unwrap());
    let sources: Vec<codec::Source> = paths.iter().map(|path| codec::open(path).unwrap()).collect();
    let tile = |source| {
        let info = codec::Source::info(source);
        codec::CatalogueTile { info, points: info.points, bounds: info.bounds.unwrap() }
    };
    let catalogue = folder.path().join("all.vpc");
    codec::write_catalogue(&sources.iter().map(tile).collect::<Vec<_>>(), &catalogue).unwrap();
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
