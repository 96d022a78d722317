use std::collections::BTreeSet;
use std::path::Path;
use std::sync::mpsc::{Receiver, sync_channel};

use cloud::Progress;
use scene::Camera;
use stream::{BuildOptions, Cache, Pages};

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
