//! Tests jobs with streamed clouds by their events.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use cloud::{Bounds, Chunk, Placement};
use glam::{DQuat, DVec3};
use scene::Camera;

use super::*;
use crate::budget::most_points;
use crate::chunk_key::Part;
use crate::event::IndexState;
use crate::mailbox::StreamView;
use crate::reading::Loading;
use crate::source::open_file;

/// Longer than any job here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// A wavy square of coloured points from `corner` on, one unit wide, as binary PLY.
fn hills(path: &Path, points: u32, corner: [f32; 2]) -> Input {
    let mut file = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    .into_bytes();
    // Steps of the golden ratio and of the plastic number fill a square evenly.
    for index in 0..points {
        let [x, y] = [0.754_877_666, 0.569_840_29].map(|step: f64| (f64::from(index) * step).fract() as f32);
        let position = [corner[0] + x, corner[1] + y, 0.05 * (9.0 * x).sin()];
        file.extend(position.iter().flat_map(|value| value.to_le_bytes()));
        file.extend([200, 150, 100]);
    }
    std::fs::write(path, file).unwrap();
    Input::File(path.to_owned())
}

fn settings(pages: scene::Paging, point_budget: u32) -> Settings {
    let mut settings = Settings::default();
    settings.stream.pages = pages;
    settings.stream.detail = 0.01;
    settings.view.point_budget = point_budget;
    settings
}

fn viewpoint(settings: &Settings) -> StreamView {
    let camera = Camera::looking(DVec3::new(1.0, 0.5, 0.0), DVec3::Z, 2.0, DVec3::Y);
    let (view, stream) = (settings.view.clone(), settings.stream.clone());
    StreamView {
        camera,
        size: [400, 300],
        view,
        stream,
        mirrors: Vec::new(),
        hidden: Default::default(),
        placed: Default::default(),
        test: Default::default(),
        asked: Default::default(),
        share: 1.0,
        is_alone: false,
    }
}

/// What a receiver has got: the number of points by cloud and part.
#[derive(Default)]
struct Received {
    chunks: BTreeMap<(usize, Part), u64>,
    most: u64,
    most_preview: u64,
    read: Vec<usize>,
    failed: usize,
}

impl Received {
    fn points(&self) -> u64 {
        self.chunks.values().sum()
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Chunk { cloud, part, chunk } => {
                self.chunks.insert((cloud, part), chunk.len() as u64);
            }
            Event::Dropped { cloud, part } => {
                assert!(self.chunks.remove(&(cloud, part)).is_some(), "what is not there cannot go");
            }
            Event::Read { cloud, .. } => self.read.push(cloud),
            Event::Failed { .. } => self.failed += 1,
            _ => {}
        }
        let previews = self.chunks.iter().filter(|((_, part), _)| matches!(part, Part::Preview(_)));
        self.most_preview = self.most_preview.max(previews.map(|(_, points)| points).sum());
        self.most = self.most.max(self.points());
    }

    /// Receives until everything that a view needs has come.
    fn settle(&mut self, job: &Job, view_number: u64) {
        loop {
            let event = job.events.recv_timeout(PATIENCE).expect("the view is settled");
            if matches!(event, Event::Stream(stats) if stats.is_settled && stats.view_number == view_number) {
                return;
            }
            self.take(event);
        }
    }
}

#[test]
fn previews_and_cuts_of_all_clouds_together_keep_the_budget() {
    const BUDGET: u32 = 60_000;
    let folder = tempfile::tempdir().unwrap();
    let inputs: Vec<Input> = (0..3_u8)
        .map(|index| hills(&folder.path().join(format!("{index}.ply")), 150_000, [f32::from(index), 0.0]))
        .collect();
    let settings = settings(scene::Paging::Always, BUDGET);
    let cache = || Ok(Cache::new(folder.path().join("cache"), u64::MAX));
    // One of them already has an index.
    let first = start_with(inputs[..1].to_vec(), &settings, BTreeSet::new(), true, cache());
    let view_number = first.mailbox.set_view(viewpoint(&settings));
    Received::default().settle(&first, view_number);
    drop(first);

    let job = start_with(inputs, &settings, BTreeSet::new(), true, cache());
    let view_number = job.mailbox.set_view(viewpoint(&settings));
    let mut received = Received::default();
    received.settle(&job, view_number);
    assert!(received.most_preview > 0, "there was none: the test would prove nothing");
    assert!(received.most <= u64::from(BUDGET), "{} points at once", received.most);
    let points = received.points();
    assert!((55_000..=60_000).contains(&points), "{points}: in the end the cut has all of the budget");
    assert!(received.chunks.keys().all(|(_, part)| matches!(part, Part::Node(_))), "a preview stays");
    received.read.sort();
    assert_eq!(received.read, [0, 1, 2]);
}

#[test]
fn a_folder_of_laz_begins_with_the_first_points_of_its_chunks() {
    const TILES: u8 = 3;
    let folder = tempfile::tempdir().unwrap();
    let tile = |index: u8| {
        let input = hills(&folder.path().join("tile.ply"), 120_000, [f32::from(index), 0.0]);
        let source = Arc::new(codec::open(&input.files()[0]).unwrap());
        let path = folder.path().join(format!("{index}.laz"));
        codec::export(&[source], &Default::default(), &[], &path, 256 << 20, &Progress::default()).unwrap().unwrap();
        path
    };
    let files: Vec<_> = (0..TILES).map(tile).collect();
    let input = Input::Tiles { folder: folder.path().to_owned(), files };
    let settings = settings(scene::Paging::Auto, 60_000);
    let cache = Ok(Cache::new(folder.path().join("cache"), u64::MAX));
    let job = start_with(vec![input], &settings, BTreeSet::new(), true, cache);
    let view_number = job.mailbox.set_view(viewpoint(&settings));
    let mut received = Received::default();
    let mut first = Vec::new();
    while first.len() < usize::from(TILES) {
        let event = job.events.recv_timeout(PATIENCE).expect("there are previews");
        if let Event::Chunk { part, chunk, .. } = &event {
            assert!(matches!(part, Part::Preview(_)) && chunk.radii.is_some() && chunk.colors.is_some());
            // A chunk has 50,000 points.
            assert_eq!(chunk.len(), 3, "one tile, before anything else");
            first.push((chunk.bounds().center().x * 0.99).floor() as u8);
        }
        received.take(event);
    }
    assert_eq!(first, [0, 1, 2], "of each tile");
    received.settle(&job, view_number);
    assert!(received.chunks.keys().all(|(_, part)| matches!(part, Part::Node(_))), "first points stay");
    assert!((55_000..=60_000).contains(&received.points()), "{}", received.points());
    assert_eq!(received.failed, 0);
}

#[test]
fn clouds_of_one_folder_are_named_by_their_first_files() {
    let settings = settings(scene::Paging::Always, 60_000);
    let above = tempfile::tempdir().unwrap();
    let names = |places: &[f32]| {
        let folder = tempfile::Builder::new().prefix("survey").rand_bytes(0).tempdir_in(&above).unwrap();
        let tile = |(index, place): (usize, &f32)| {
            let input = hills(&folder.path().join("tile.ply"), 1000, [*place, 0.0]);
            let source = Arc::new(codec::open(&input.files()[0]).unwrap());
            let path = folder.path().join(format!("{index}.laz"));
            let progress = Progress::default();
            codec::export(&[source], &Default::default(), &[], &path, 256 << 20, &progress).unwrap().unwrap();
            path
        };
        let files = places.iter().enumerate().map(tile).collect();
        let input = Input::Tiles { folder: folder.path().to_owned(), files };
        let cache = Ok(Cache::new(folder.path().join("cache"), u64::MAX));
        let job = start_with(vec![input], &settings, BTreeSet::new(), true, cache);
        let view_number = job.mailbox.set_view(viewpoint(&settings));
        let mut received = Received::default();
        let mut names = Vec::new();
        while received.read.len() < names.len().max(1) {
            let event = job.events.recv_timeout(PATIENCE).expect("the clouds are read");
            if let Event::Opened { opened, .. } = &event {
                names.push(opened.name.clone());
            }
            received.take(event);
        }
        received.settle(&job, view_number);
        names
    };
    assert_eq!(names(&[0.0, 1.0]), ["survey"]);
    let far = [0.0, 1.0, 2.0, 9000.0, 9001.0, 1e6];
    assert_eq!(names(&far), ["survey: 0.laz and 2 more", "survey: 3.laz and 1 more", "5.laz"]);
}

#[test]
fn files_of_a_streamed_cloud_are_known_as_they_were_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let input = hills(&path, 3_000, [0.0; 2]);
    let settings = settings(scene::Paging::Always, 5_000_000);
    let cache = Ok(Cache::new(folder.path().join("cache"), u64::MAX));
    let job = start_with(vec![input], &settings, BTreeSet::new(), true, cache);
    let opened = loop {
        if let Event::Opened { opened, .. } = job.events.recv_timeout(PATIENCE).expect("the cloud is opened") {
            break opened;
        }
    };
    let (entry, _) = crate::Assembly::open(crate::CloudKey(0), opened);
    assert!(entry.source.is_none() && entry.check_unchanged().is_ok());
    std::fs::write(&path, "another file").unwrap();
    let told = entry.check_unchanged().unwrap_err().to_string();
    assert!(told.ends_with("it has been changed since it was opened; open it again"), "{told}");
}

#[test]
fn a_preview_keeps_what_the_gpu_may_hold() {
    let folder = tempfile::tempdir().unwrap();
    let input = hills(&folder.path().join("a.ply"), 150_000, [0.0; 2]);
    let mut settings = settings(scene::Paging::Always, 5_000_000);
    // Some forty thousand points.
    settings.stream.gpu_bytes.0 = 2 << 20;
    let most = most_points(&settings.view, &settings.stream);
    let job = start_with(
        vec![input],
        &settings,
        BTreeSet::new(),
        true,
        Ok(Cache::new(folder.path().join("cache"), u64::MAX)),
    );
    let view_number = job.mailbox.set_view(viewpoint(&settings));
    let mut received = Received::default();
    received.settle(&job, view_number);
    assert!((1..=most / 2).contains(&received.most_preview), "{}", received.most_preview);
    assert!(received.most <= most, "{} points at once, at most {most}", received.most);
}

#[test]
fn what_was_stopped_is_made_after_all() {
    const BUDGET: u32 = 400_000;
    let folder = tempfile::tempdir().unwrap();
    let input = hills(&folder.path().join("a.ply"), 600_000, [0.0; 2]);
    let settings = settings(scene::Paging::Always, BUDGET);
    let job = start_with(
        vec![input],
        &settings,
        BTreeSet::new(),
        true,
        Ok(Cache::new(folder.path().join("cache"), u64::MAX)),
    );
    // The preview waits for a picture, and meanwhile the index is stopped.
    job.mailbox.draw_first(true);
    let mut received = Received::default();
    while received.read.is_empty() {
        let event = job.events.recv_timeout(PATIENCE).expect("it ends");
        if matches!(event, Event::Task { .. }) {
            // By then it mostly waits. If it does not wait yet, there is no preview to be made anew.
            std::thread::sleep(Duration::from_millis(200));
            job.mailbox.stop_all();
            job.mailbox.draw_first(false);
        }
        assert!(!matches!(event, Event::Pages { pages: IndexState::Indexed { .. }, .. }), "it was not stopped");
        received.take(event);
    }
    assert!(received.points() < u64::from(BUDGET) / 4, "{}: more than the beginning of a preview", received.points());
    job.mailbox.resume(0);
    let view_number = job.mailbox.set_view(viewpoint(&settings));
    received.settle(&job, view_number);
    assert!(received.most_preview > u64::from(BUDGET) / 4, "{}: the preview stayed what it was", received.most_preview);
    assert!(received.chunks.keys().all(|(_, part)| matches!(part, Part::Node(_))), "a preview stays");
    assert!((360_000..=400_000).contains(&received.points()), "{}", received.points());

    // A stop of all tasks does not keep an index from being mended.
    job.mailbox.stop_all();
    job.mailbox.report_damage(0);
    loop {
        let event = job.events.recv_timeout(PATIENCE).expect("it is mended");
        if let Event::Task { task, .. } = &event {
            assert!(!task.progress.is_cancelled());
            break;
        }
        received.take(event);
    }
    let mut moved = viewpoint(&settings);
    moved.camera.eye += DVec3::splat(0.1);
    let view_number = job.mailbox.set_view(moved);
    received.settle(&job, view_number);
    assert!((360_000..=400_000).contains(&received.points()) && received.failed == 0, "{}", received.points());
    assert!(!job.mailbox.is_closed(0));
}

/// Points on a line, each with a number of its own as `user_data`.
fn numbered(path: &Path, points: u8) -> Input {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {points}\n");
    text += "property float x\nproperty float y\nproperty float z\nproperty uchar user_data\nend_header\n";
    (0..points).for_each(|point| text += &format!("{} {} 0 {point}\n", f32::from(point) * 0.01, point % 7));
    std::fs::write(path, text).unwrap();
    Input::File(path.to_owned())
}

#[test]
fn an_attribute_that_a_later_view_asks_for_comes_while_the_points_stay() {
    let folder = tempfile::tempdir().unwrap();
    let input = numbered(&folder.path().join("a.ply"), 200);
    let settings = settings(scene::Paging::Always, 100_000);
    let cache = || Ok(Cache::new(folder.path().join("cache"), u64::MAX));
    let asked = || BTreeSet::from(["of_no_file".to_owned(), "user_data".to_owned()]);
    let job = start_with(vec![input.clone()], &settings, BTreeSet::new(), true, cache());
    let first = job.mailbox.set_view(viewpoint(&settings));
    let mut received = Received::default();
    received.settle(&job, first);
    assert_eq!(received.points(), 200);
    let view_number = job.mailbox.set_view(StreamView { asked: asked(), ..viewpoint(&settings) });
    assert!(view_number > first);
    let (mut attributes, mut values) = (Vec::new(), Vec::new());
    loop {
        let event = job.events.recv_timeout(PATIENCE).expect("the view is settled");
        match &event {
            Event::Pages { pages: IndexState::Indexed { attributes: new, was_built, .. }, .. } => {
                assert!(attributes.is_empty() && *was_built || *new == attributes);
                attributes.clone_from(new);
            }
            Event::Pages { .. } => panic!("the cloud has an index all the time"),
            Event::Dropped { .. } => assert!(!attributes.is_empty(), "points go before others are there"),
            // Sent twice: before and after the normals are estimated from all points.
            Event::Chunk { chunk, .. } => {
                let column = chunk.columns[0].as_ref().unwrap();
                values = (0..chunk.len()).map(|point| column.value(point)).collect();
            }
            Event::Stream(stats) if stats.is_settled && stats.view_number == view_number => break,
            _ => {}
        }
        received.take(event);
    }
    let names: Vec<&str> = attributes.iter().map(|attribute| attribute.name.as_str()).collect();
    assert_eq!((names, received.points(), received.failed), (vec!["user_data"], 200, 0));
    values.sort_unstable_by(f64::total_cmp);
    assert_eq!(values, (0..200).map(f64::from).collect::<Vec<_>>());
    drop(job);
    // The next job that is asked for it finds that index.
    let job = start_with(vec![input], &settings, asked(), true, cache());
    loop {
        let event = job.events.recv_timeout(PATIENCE).expect("the index is found");
        if let Event::Pages { pages: IndexState::Indexed { attributes: found, was_built, .. }, .. } = event {
            assert_eq!((found, was_built), (attributes, false));
            break;
        }
    }
}

#[test]
fn a_file_that_fails_on_the_way_comes_to_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    hills(&path, 10, [0.0; 2]);
    let (sender, events) = sync_channel(CHUNKS_UNDER_WAY);
    let loader = Loader {
        sender,
        progress: Arc::default(),
        mailbox: Arc::default(),
        settings: Settings::default(),
        has_preview: true,
        cache: Err("none".into()),
        also: Mutex::default(),
    };
    let chunks = vec![Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 4])];
    let source = open_file(&path, 1 << 30).unwrap().remove(0);
    let loading =
        Loading { cloud: 7, source, up: DVec3::Z, chunks, place: None, has_kept_surfels: false, is_read: true };
    loader.end(&loading, Err(codec::Error::unsuitable(&path, "the disk is broken"))).unwrap();
    drop(loader);
    // With streamed clouds the job goes on: the window can only go by the event that this one cloud is complete.
    let Ok(Event::Failed { input, error, .. }) = events.recv() else { panic!("it is not said") };
    assert!(input.ends_with("a.ply") && error.contains("broken"), "{error}");
    let Ok(Event::Read { cloud: 7, summary }) = events.recv() else { panic!("there is no end to it") };
    assert_eq!((summary.points, summary.cancelled), (4, false));
}

#[test]
fn the_file_that_is_looked_at_is_read_first() {
    let mailbox = Mailbox::default();
    let cube = |x: f64, z: f64| Bounds { min: DVec3::new(x, 0.0, z), max: DVec3::new(x + 1.0, 1.0, z + 1.0) };
    // The eye is at (1, 0.5, 2) and looks down.
    let [behind, far, near, aside] = [cube(0.5, 2.5), cube(0.5, -4.0), cube(0.5, -0.5), cube(9.0, -0.5)];
    let boxes = [Bounds::EMPTY, behind, far, near, aside];
    assert_eq!(mailbox.first_seen(0, &boxes), 0, "there is no view yet");
    let mut view = viewpoint(&settings(scene::Paging::Always, 1_000));
    mailbox.set_view(view.clone());
    assert_eq!(mailbox.first_seen(0, &boxes), 3, "the nearest one in the picture");
    assert_eq!(mailbox.first_seen(0, &boxes[..3]), 2, "in the picture, however near others are");
    assert_eq!(mailbox.first_seen(0, &[Bounds::EMPTY, behind, aside]), 1, "the nearest one outside");
    assert_eq!(mailbox.first_seen(0, &[Bounds::EMPTY]), 0);
    view.placed.insert(0, Placement::new(DQuat::IDENTITY, DVec3::ZERO, DVec3::new(-8.5, 0.0, 0.0)));
    mailbox.set_view(view);
    assert_eq!(mailbox.first_seen(0, &boxes), 4, "the cloud was moved");
    assert_eq!(mailbox.first_seen(1, &boxes), 3, "another one was not");
}

#[test]
fn reading_gives_way_to_the_first_picture() {
    let mailbox = Mailbox::default();
    let order = Mutex::new(Vec::new());
    mailbox.draw_first(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            mailbox.give_way();
            order.lock().unwrap().push("read");
        });
        std::thread::sleep(Duration::from_millis(50));
        order.lock().unwrap().push("drawn");
        mailbox.draw_first(false);
    });
    assert_eq!(order.into_inner().unwrap(), ["drawn", "read"]);
    // At other times, and at the end, nothing waits.
    mailbox.give_way();
    mailbox.draw_first(true);
    mailbox.end();
    mailbox.give_way();
}

#[test]
fn a_cloud_whose_index_cannot_be_written_is_shown_by_an_even_share_until_it_can() {
    const BUDGET: u32 = 100_000;
    let folder = tempfile::tempdir().unwrap();
    let input = hills(&folder.path().join("a.ply"), 300_000, [0.0; 2]);
    let settings = settings(scene::Paging::Always, BUDGET);
    // A file is in the way of the cache's folder.
    let in_the_way = folder.path().join("cache");
    std::fs::write(&in_the_way, "").unwrap();
    let cache = Cache::new(in_the_way.clone(), u64::MAX);
    let job = start_with(vec![input], &settings, BTreeSet::new(), true, Ok(cache));
    let (mut received, mut last_x, mut told) = (Received::default(), 0.0_f64, String::new());
    while received.read.is_empty() {
        let event = job.events.recv_timeout(PATIENCE).expect("it ends");
        match &event {
            Event::Chunk { chunk, .. } => last_x = last_x.max(chunk.bounds().max.x),
            Event::Failed { error, is_usage, .. } => {
                assert!(!is_usage, "{error}");
                told.clone_from(error);
            }
            _ => {}
        }
        received.take(event);
    }
    assert!(told.contains("until then an even share of the cloud's points is read and shown"), "{told}");
    let most = crate::budget::most_preview_points(&settings);
    assert!((most * 9 / 10..=most).contains(&received.points()) && last_x > 0.99, "{} of {most}", received.points());
    let task = job.mailbox.task(0).unwrap();
    assert_eq!(task.status(), crate::task::TaskStatus::Stopped);
    // Where it still cannot be written, what is shown stays.
    let shown = received.points();
    job.mailbox.resume(0);
    while received.read.len() < 2 {
        received.take(job.events.recv_timeout(PATIENCE).expect("it ends"));
    }
    assert_eq!((received.points(), received.failed), (shown, 2));
    std::fs::remove_file(in_the_way).unwrap();
    job.mailbox.resume(0);
    let view_number = job.mailbox.set_view(viewpoint(&settings));
    received.settle(&job, view_number);
    assert!(received.chunks.keys().all(|(_, part)| matches!(part, Part::Node(_))), "a preview stays");
    assert_eq!(received.failed, 2);
}
