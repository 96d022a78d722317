use std::collections::{BTreeSet, HashMap};
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};

use cloud::{Placement, Progress};
use scene::Camera;
use stream::{BuildOptions, Cache, NodeId, Pages};

use super::*;

/// The index of a square with this many points.
fn square(folder: &Path, name: &str, points: u32) -> Arc<Pages> {
    let path = folder.join(name);
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {points}\n");
    text += "property float x\nproperty float y\nproperty float z\nend_header\n";
    for index in 0..points {
        let [x, y] = [0.754_877_67, 0.569_840_3].map(|step: f64| (f64::from(index) * step).fract());
        text += &format!("{x:.6} {y:.6} 0\n");
    }
    std::fs::write(&path, text).unwrap();
    let sources = [Arc::new(codec::open(&path).unwrap())];
    let cache = Cache::new(folder.join("cache"), u64::MAX);
    let pages = stream::build(&sources, &cache, &BuildOptions::default(), &Progress::default(), &|_| ());
    Arc::new(pages.unwrap())
}

/// The number of points of both clouds that are loaded when a view is settled, and the share of the whole budget
/// that it would take.
fn settled(events: &Receiver<Event>, there: &mut [BTreeMap<Part, usize>; 2], view_number: u64) -> ([usize; 2], f64) {
    loop {
        match events.recv().unwrap() {
            Event::Chunk { cloud, part, chunk } => drop(there[cloud].insert(part, chunk.len())),
            Event::Dropped { cloud, part } => drop(there[cloud].remove(&part)),
            Event::Stream(stats) if stats.is_settled && stats.view_number == view_number => {
                return (there.each_ref().map(|chunks| chunks.values().sum()), stats.demand);
            }
            _ => {}
        }
    }
}

#[test]
fn clouds_that_are_hidden_or_moved_out_of_sight_leave_their_budget_to_the_others_and_come_back() {
    const BUDGET: usize = 60_000;
    let folder = tempfile::tempdir().unwrap();
    let mailbox = Arc::<Mailbox>::default();
    let (sender, events) = sync_channel(1000);
    let mut settings = Settings::default();
    settings.view.point_budget = BUDGET as u32;
    settings.stream.detail = 0.01;
    for cloud in [0, 1] {
        mailbox.arrive(Arrival {
            cloud,
            input: String::new(),
            name: String::new(),
            fit: None,
            pages: square(folder.path(), &format!("{cloud}.ply"), 100_000),
            is_own: true,
            missing: 0,
            was_built: true,
            estimate: None,
            previews: HashMap::new(),
        });
    }
    let camera = Camera::looking(glam::DVec3::new(0.5, 0.5, 2.0), glam::DVec3::new(0.5, 0.5, 0.0), 2.0, glam::DVec3::Y);
    let moved = Placement::new(glam::DQuat::IDENTITY, glam::DVec3::ZERO, glam::DVec3::Z * 50.0);
    let director = Director::new(mailbox.clone(), sender, &settings, false).unwrap();
    let seen = std::thread::scope(|scope| {
        scope.spawn(|| director.run());
        scope.spawn(|| mailbox.wait_for_requests());
        let set_view = |hidden: &[usize], away: &[usize], share: f64| {
            let (view, stream) = (settings.view.clone(), settings.stream.clone());
            let hidden = hidden.iter().copied().collect();
            mailbox.set_view(StreamView {
                camera,
                size: [800, 600],
                view,
                stream,
                mirrors: Vec::new(),
                hidden,
                // Behind the eye.
                placed: away.iter().map(|cloud| (*cloud, moved)).collect(),
                test: PointTest::default(),
                asked: BTreeSet::new(),
                share,
                is_alone: false,
            })
        };
        let mut there = [BTreeMap::new(), BTreeMap::new()];
        let none = &[][..];
        let views =
            [(none, none, 1.0), (&[0], none, 1.0), (none, none, 1.0), (none, &[0], 1.0), (none, none, 1.0 / 3.0)];
        let seen = views.map(|(hidden, away, share)| settled(&events, &mut there, set_view(hidden, away, share)));
        mailbox.end();
        seen
    });
    let [(both, demand), (one, _), (again, _), (alone, _), (third, demand_of_third)] = seen;
    assert!(both.iter().all(|points| (20_000..40_000).contains(points)), "{both:?}");
    assert!(one[1] > 50_000 && one[0] + one[1] <= BUDGET, "{one:?}");
    assert!(again.iter().all(|points| (20_000..40_000).contains(points)), "{again:?}");
    // Of a cloud that is moved out of sight only the root stays.
    assert!(alone[1] > both[1] && alone[0] < 17_000, "{alone:?} {both:?}");
    assert!(third.iter().sum::<usize>() <= BUDGET / 3, "{third:?}");
    assert!(demand > 0.9 && demand_of_third > 0.9, "{demand} {demand_of_third}");
}

/// The octree of a folder with these pages of its list of nodes, which are read as views need them.
fn paged_lists(folder: &Path, pages: &[(&str, &str)]) -> Arc<Pages> {
    std::fs::create_dir_all(folder.join("ept-hierarchy")).unwrap();
    let axis = |name: &str| format!(r#"{{"name":"{name}","type":"signed","size":4,"scale":0.01,"offset":0}}"#);
    let text = format!(
        r#"{{"bounds":[0,0,0,8,8,8],"dataType":"binary","points":1000000000000,"span":128,"version":"1.0.0","schema":[{}]}}"#,
        ["X", "Y", "Z"].map(axis).join(",")
    );
    std::fs::write(folder.join("ept.json"), text).unwrap();
    std::fs::create_dir_all(folder.join("ept-data")).unwrap();
    std::fs::write(folder.join("ept-data/0-0-0-0.bin"), vec![0; 36]).unwrap();
    for (name, text) in pages {
        std::fs::write(folder.join(format!("ept-hierarchy/{name}.json")), text).unwrap();
    }
    let source = Arc::new(codec::open_within(&folder.join("ept.json"), 4 << 20).unwrap());
    Arc::new(Pages::copc(&source, &BTreeSet::new()).unwrap())
}

#[test]
fn what_was_told_of_lists_and_nodes_is_taken_back_when_they_go() {
    let folder = tempfile::tempdir().unwrap();
    let lists = [("0-0-0-0", r#"{"0-0-0-0":3,"1-0-0-0":-1,"1-1-0-0":-1}"#), ("1-0-0-0", r#"{"1-0-0-0":5}"#)];
    let mailbox = Arc::<Mailbox>::default();
    let (sender, events) = sync_channel(1000);
    let mut director = Director::new(mailbox.clone(), sender, &Settings::default(), false).unwrap();
    let tile = number_of(0, 7);
    let arrival = Arrival {
        cloud: tile,
        input: String::new(),
        name: String::new(),
        fit: None,
        pages: paged_lists(folder.path(), &lists),
        is_own: false,
        missing: 0,
        was_built: false,
        estimate: None,
        previews: HashMap::new(),
    };
    director.add(arrival).unwrap();
    let streamed = director.clouds.get_mut(&tile).unwrap();
    // A node that a list had which has gone, and one that still is there.
    (streamed.missing, streamed.told) = ([(NodeId(0), true), (NodeId(99), true)].into(), Some("a node".to_owned()));
    let places = [(NodeId(0), 0), (NodeId(0), 1)];
    streamed.lists.as_mut().unwrap().want(std::iter::empty(), places.into_iter(), tile, &mailbox);
    let is_there = |director: &Director| !director.clouds[&tile].octree.paged.pages.is_empty();
    let mut said = Vec::new();
    while !is_there(&director) || said.is_empty() {
        director.step().unwrap();
        said.extend(events.try_iter().filter_map(|event| match event {
            Event::Failed { error, .. } => Some(error),
            Event::Mended { problem, .. } => panic!("{problem}"),
            _ => None,
        }));
    }
    assert!(said.len() == 1 && said[0].contains("1-1-0-0"), "{said:?}");
    assert_eq!(director.clouds[&tile].missing, [(NodeId(0), true)].into());
    director.close_tiles(0, vec![7]).unwrap();
    let taken_back = events.try_iter().filter_map(|event| match event {
        Event::Mended { problem, has_come: false, .. } => Some(problem),
        _ => None,
    });
    assert_eq!(taken_back.collect::<Vec<_>>(), ["a node".to_owned(), said[0].clone()]);
}
