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
use world::{Event, IndexState, Input};

#[test]
fn a_catalogue_tells_all_its_boxes_before_its_tiles_are_fetched() {
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
    let (mut boxes, mut shown, mut warnings) = (BTreeSet::new(), BTreeSet::new(), Vec::new());
    for event in &job.events {
        match event {
            Event::Pages { cloud, pages: IndexState::Indexed { octree, .. } } => {
                assert_eq!(octree.points(), sources[0].info().points);
                boxes.insert(cloud);
                is_open.store(boxes.len() == 12, Ordering::Relaxed);
            }
            Event::Chunk { cloud, .. } => {
                assert!(cloud == 0 || boxes.len() == 12, "cloud {cloud} comes before all boxes");
                shown.insert(cloud);
            }
            Event::Read { summary, .. } => warnings.extend(summary.warnings),
            Event::Stream(stats) if stats.is_settled => break,
            Event::Failed { error, .. } => panic!("{error}"),
            _ => {}
        }
    }
    assert_eq!(shown, (0..12).filter(|cloud| *cloud != 7).collect());
    let told = warnings.join("\n");
    assert!(told.contains("a tile is missing") && told.contains("7.copc.laz"), "{told}");
}
