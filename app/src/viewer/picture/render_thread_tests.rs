use std::sync::mpsc::Receiver;

use cloud::PointTest;
use glam::DVec3;
use scene::{Camera, LightClues, Mirror, MirrorSurface, Quality, Reflection, Shape, SpotLight};

use super::*;
use crate::viewer::bench::{devices, own_device};
use crate::viewer::picture::frame_request::hurried;
use crate::viewer::picture::messages::PickPurpose;
use crate::viewer::picture::pace::Spared;
use crate::viewer::picture::window_texture::tests::Refusal;

/// Software Vulkan compiles for a minute on a busy machine.
const PATIENCE: Duration = Duration::from_secs(240);

/// A render thread that draws on a device, and its reports. The window has a device of its own.
fn start_on(gpu: Arc<Gpu>) -> Option<(RenderThread, Receiver<Report>)> {
    let (sender, reports) = channel();
    let thread = RenderThread::start(own_device()?, |_| Ok(gpu), move |report| drop(sender.send(report)));
    Some((thread.unwrap(), reports))
}

/// A render thread on the device that tests share; `None`, with a note, if there is no adapter.
fn start() -> Option<(RenderThread, Receiver<Report>)> {
    let [_, gpu] = devices()?;
    start_on(gpu)
}

/// A frame that shows only a mirror ball.
fn request(size: [u32; 2]) -> Box<FrameRequest> {
    Box::new(FrameRequest {
        camera: Camera::looking(DVec3::ZERO, DVec3::Y, 4.0, DVec3::Z),
        settings: Settings::default(),
        mirrors: vec![Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0)],
        lights: Vec::new(),
        clues: LightClues::default(),
        size,
        test: PointTest::default(),
        revision: 0,
        spared: None,
        hurried: false,
        light_may_lag: false,
    })
}

#[test]
fn only_the_latest_of_waiting_frames_is_drawn_and_a_failed_one_does_not_end_the_thread() {
    let Some((thread, reports)) = own_device().and_then(start_on) else { return };
    // The frames wait while the shaders are compiled.
    for size in [[32, 24], [40, 30], [48, 36]] {
        thread.send(Command::Frame(request(size)));
    }
    let report = || reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(report(), Report::Ready { .. }));
    let Report::Frame(frame) = report() else { panic!("no frame") };
    assert_eq!((frame.request.size, frame.texture.width(), frame.texture.height()), ([48, 36], 48, 36));

    // The size is wider than any adapter supports.
    thread.send(Command::Frame(request([200_000, 10])));
    assert!(matches!(report(), Report::NotDrawn(_)));

    // Two textures take turns: the window may still show the picture before.
    let again = || {
        thread.send(Command::Frame(request([48, 36])));
        let Report::Frame(again) = report() else { panic!("no frame after a failed one") };
        again.texture
    };
    let other = again();
    assert!(other != frame.texture && again() == frame.texture && again() == other);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.png");
    thread.send(Command::Save { request: request([20, 10]), path: path.clone().into(), facts: Box::default() });
    assert!(matches!(report(), Report::Saved(saved) if saved == path));
    assert_eq!(image::open(&path).unwrap().to_rgb8().dimensions(), (20, 10));
    thread.send(Command::Save {
        request: request([20, 10]),
        path: folder.path().join("missing/picture.png").into(),
        facts: Box::default(),
    });
    assert!(matches!(report(), Report::Problem(problem) if problem.contains("missing")));

    thread.send(Command::Measure(request([48, 36])));
    let Report::Measured { request: measured, stats } = report() else { panic!("not measured") };
    assert_eq!(measured, request([48, 36]));
    assert!(stats.passes.iter().any(|pass| pass.name == "mirror_exact"), "a frame from scratch, not one that was kept");

    // The thread ends after the commands that it has, and sends no further report.
    drop(thread);
    assert!(matches!(reports.recv_timeout(PATIENCE), Err(std::sync::mpsc::RecvTimeoutError::Disconnected)));
}

#[test]
fn the_picture_is_drawn_again_for_another_device_of_the_window() {
    let Some((thread, reports)) = start() else { return };
    let report = || reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(report(), Report::Ready { .. }));
    let another = own_device().unwrap();
    // Before there is a picture, there is nothing to draw again.
    thread.send(Command::ShowOn(own_device().unwrap()));
    thread.send(Command::Frame(request([48, 36])));
    let Report::Frame(first) = report() else { panic!("no frame") };
    thread.send(Command::ShowOn(another.clone()));
    let Report::Frame(again) = report() else { panic!("no frame on the other device") };
    assert!(Arc::ptr_eq(&again.window_gpu, &another) && !Arc::ptr_eq(&first.window_gpu, &another));
    assert!(again.request == first.request);
    thread.end();
}

#[test]
fn a_hurried_frame_spares_the_average_and_further_bounces_and_leaves_the_rest() {
    let reflection = Reflection { bounces: 3, samples: 4, ..Reflection::default() };
    let settings = Settings { reflection, ..Settings::default() };
    let hasty = hurried(&settings, false);
    let Reflection { bounces, samples, .. } = hasty.reflection;
    assert_eq!((hasty.splat.quality, bounces, samples), (Quality::Nearest, 1, 1));
    assert!(hasty.sscr.solve_once, "points are searched for twice");
    let mut back = hasty.clone();
    back.sscr.solve_once = false;
    (back.splat.quality, back.reflection.bounces, back.reflection.samples) = (settings.splat.quality, 3, 4);
    assert_eq!(back, settings);
    assert_eq!(hurried(&settings, true).mirror.surface, MirrorSurface::Exact);
    // Settings without bounces get none.
    let none = Settings { reflection: Reflection { bounces: 0, ..Reflection::default() }, ..settings };
    assert_eq!(hurried(&none, false).reflection.bounces, 0);
}

#[test]
fn mirrors_reflect_in_quick_pictures_once_their_passes_are_compiled_and_say_what_share_of_all() {
    let Some((thread, reports)) = start() else { return };
    let report = || reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(report(), Report::Ready { .. }));
    if !devices().unwrap()[1].is_processor() {
        return eprintln!("skipped: the adapter is no processor");
    }
    let still = request([60, 48]);
    let quick_of = |size: u32, revision: u64| {
        let mut settings = hurried(&still.settings, false);
        settings.environment_map.size = size;
        let spared = Some(Spared { divisor: 2, ..Spared::NOTHING });
        Command::Frame(Box::new(FrameRequest { settings, spared, hurried: true, revision, ..(*still).clone() }))
    };
    let quick = |size: u32| quick_of(size, 0);
    let pixels = |command| {
        thread.send(command);
        let Report::Frame(frame) = report() else { panic!("no frame") };
        assert!(frame.stats.is_quick);
        frame.stats.reflected.map(|share| share.pixels)
    };
    assert_eq!(pixels(quick(64)), None, "nothing is compiled for mirrors");
    // What compiles need be no picture at rest.
    thread.send(Command::Measure(still.clone()));
    assert!(matches!(report(), Report::Measured { .. }));
    assert_eq!(pixels(quick(65)), Some(1.0 / 25.0));
    let rest = || {
        thread.send(Command::Frame(still.clone()));
        assert!(matches!(report(), Report::Frame(frame) if frame.stats.reflected.is_none()));
    };
    rest();
    assert_eq!(pixels(quick(66)), Some(1.0 / 9.0), "the camera stands where it stood");
    rest();
    let own = still.settings.environment_map.size;
    assert_eq!(pixels(quick(own)), Some(1.0), "mirrors show what they show at rest");
    std::thread::sleep(Duration::from_millis(400));
    assert_eq!(
        pixels(quick(own)),
        Some(1.0),
        "for a while, and until a coarse frame is drawn, which no picture waits for"
    );
    // While a coarse frame is under way, others show what mirrors showed before.
    assert!((0..200).any(|_| pixels(quick(own)) == Some(1.0 / 9.0)), "what mirrors show is never drawn anew");
    rest();
    assert_eq!(pixels(quick_of(own, 1)), Some(1.0 / 9.0), "but not other points");
    thread.end();
}

/// A worker on the device that tests share, if that is a processor.
fn worker() -> Option<Worker> {
    let [window_gpu, gpu] = devices()?;
    if !gpu.is_processor() {
        eprintln!("skipped: the adapter is no processor");
        return None;
    }
    Some(Worker::new(gpu, window_gpu, Arc::default(), &channel().1, &|_| {}).unwrap().0)
}

/// A hurried frame of what `still` shows, from an eye beside its own.
fn beside(still: &FrameRequest, step: f64) -> Box<FrameRequest> {
    let camera = Camera { eye: still.camera.eye + DVec3::X * step, ..still.camera };
    let spared = Some(Spared { divisor: 2, ..Spared::NOTHING });
    let settings = hurried(&still.settings, false);
    Box::new(FrameRequest { camera, settings, spared, hurried: true, ..still.clone() })
}

#[test]
fn quick_pictures_go_on_during_a_coarse_frame_which_is_given_up_for_what_needs_none_or_another() {
    let Some(mut worker) = worker() else { return };
    let still = request([60, 48]);
    worker.draw((*still).clone(), Instant::now()).unwrap();
    worker.keep_light(&still).unwrap();
    let shown = beside(&still, 0.0);
    worker.draw((*shown).clone(), Instant::now()).unwrap();
    let is_due = |worker: &Worker, revision: u64| {
        let request = FrameRequest { revision, ..(*shown).clone() };
        worker.moving.is_due(&worker.gpu, &worker.resident.store, &request).is_some()
    };
    let wait = |worker: &Worker| {
        let began = Instant::now();
        while !is_due(worker, 0) {
            assert!(began.elapsed() < PATIENCE, "no coarse frame is ever due");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    // The places of the eyes of pictures that are drawn during the coarse frame, and what is left for afterwards.
    let renew = |worker: &mut Worker, sent: Vec<Command>| {
        let (sender, commands) = channel();
        sent.into_iter().for_each(|command| sender.send(command).unwrap());
        let (told, reports) = channel();
        let finish = |done| drop(told.send(done));
        let mut queue = VecDeque::new();
        let since = worker.renew_coarse(&shown, &commands, &mut queue, Duration::ZERO, &finish).unwrap();
        assert!(since.is_some() && commands.try_recv().is_err(), "no coarse frame, or nobody has looked at what came");
        let place = |done| match done {
            Finished::Drawn(drawn) if drawn.stats.is_quick => drawn.request.camera.eye.x - shown.camera.eye.x,
            _ => panic!("no quick picture"),
        };
        let name = |command: &Command| match command {
            Command::Measure(_) => "measure",
            Command::Frame(request) if request.hurried => "quick",
            Command::Frame(_) => "rest",
            _ => "another",
        };
        (reports.try_iter().map(place).collect::<Vec<_>>(), queue.iter().map(name).collect::<Vec<_>>())
    };
    let quick = |step| Command::Frame(beside(&still, step));
    let measure = || Command::Measure(still.clone());
    wait(&worker);
    let sent = vec![quick(0.25), quick(0.5), measure(), quick(0.75), Command::Frame(still.clone())];
    assert_eq!(renew(&mut worker, sent), (vec![0.5], vec!["measure", "quick", "rest"]));
    assert!(is_due(&worker, 0), "a picture at rest waits for a coarse frame");
    assert_eq!(renew(&mut worker, vec![quick(0.25), quick(0.5), measure()]), (vec![0.5], vec!["measure"]));
    assert!(!is_due(&worker, 0), "what mirrors show is not drawn anew");
    wait(&worker);
    let mut other = beside(&still, 0.0);
    other.settings.environment_map.size += 1;
    assert_eq!(renew(&mut worker, vec![Command::Frame(other)]), (vec![], vec!["quick"]));
    assert!(is_due(&worker, 0), "a picture of other values waits for a coarse frame of the old ones");
    assert!(worker.moving.is_shown, "points are no longer picked from the quick picture on the screen");

    // What fails is not tried after each picture.
    assert!(worker.moving.put_off("no memory") && !worker.moving.put_off("no memory"));
    // Other points are due before the same ones.
    let is_sooner = |_| {
        worker.moving.put_off("no memory");
        std::thread::sleep(Duration::from_millis(200));
        let same = is_due(&worker, 0);
        is_due(&worker, 1) && !same
    };
    assert!((0..20).any(is_sooner), "mirrors go on to show points that are gone");
}

/// A ball in the light of a lamp, as seen from a side along y; each side shows what the other does not.
fn lit_ball(side: f64, red: f32) -> FrameRequest {
    let (position, intensity) = (DVec3::new(0.0, 0.0, 6.0), [red, 40.0, 40.0]);
    let lamp = SpotLight { position, target: DVec3::ZERO, intensity, inner_degrees: 30.0, outer_degrees: 40.0 };
    let camera = Camera::looking(DVec3::ZERO, DVec3::Y * side, 3.0, DVec3::Z);
    let mut request = FrameRequest { camera, mirrors: Vec::new(), lights: vec![lamp], ..*request([160, 120]) };
    request.settings.gi.bounces = 0;
    request
}

/// A worker with the points of the lit ball.
fn worker_with_ball() -> Option<Worker> {
    let mut worker = worker()?;
    let cloud = world::CloudKey(0);
    let direction = |index: u32| {
        let (z, angle) = (f64::from(index) / 2048.0 - 1.0, f64::from(index) * 2.4);
        let ring = (1.0 - z * z).sqrt();
        DVec3::new(ring * angle.cos(), ring * angle.sin(), z)
    };
    let directions: Vec<DVec3> = (0..4096).map(direction).collect();
    let mut chunk = cloud::Chunk::of_places(0, &directions);
    chunk.normals = Some(Arc::new(directions.iter().map(|normal| cloud::pack_normal(normal.as_vec3())).collect()));
    chunk.radii = Some(Arc::new(vec![cloud::pack_radius(0.06); directions.len()]));
    worker.resident.apply(Change::Open { cloud, provisional_radius: 0.06 }).unwrap();
    let key = cloud.chunk(world::Part::Block(0));
    worker.resident.apply(Change::Put { key, chunk, layout: Arc::default() }).unwrap();
    Some(worker)
}

#[test]
fn light_of_earlier_pictures_is_taken_over_as_long_as_the_lamps_stay() {
    let Some(mut worker) = worker_with_ball() else { return };
    // What a view of one side is while the camera moves, after one of that side in the light of a lamp, and one of the other.
    let mut moving_after = |red: Option<f32>| {
        worker.moving = MovingPictures::default();
        for still in red.map(|red| lit_ball(1.0, red)).into_iter().chain([lit_ball(-1.0, 40.0)]) {
            worker.draw(still.clone(), Instant::now()).unwrap();
            worker.keep_light(&still).unwrap();
        }
        let still = lit_ball(1.0, 40.0);
        let drawn = worker.moving.draw(&worker.gpu, &worker.resident.store, &beside(&still, 0.0));
        drawn.expect("a quick picture").1.tight()
    };
    let [none, same, other] = [None, Some(40.0), Some(4.0)].map(&mut moving_after);
    assert!(same != none, "the light of the first view is not taken over");
    assert!(other == none, "the light of another lamp is taken over");
}

#[test]
fn light_that_no_picture_at_rest_knows_comes_from_coarse_frames() {
    let Some(mut worker) = worker_with_ball() else { return };
    let [known, unknown] = [-1.0, 1.0].map(|side| lit_ball(side, 40.0));
    let begin = |worker: &mut Worker, still: &FrameRequest| {
        worker.moving = MovingPictures::default();
        worker.draw(still.clone(), Instant::now()).unwrap();
        worker.keep_light(still).unwrap();
    };
    let quick = |worker: &mut Worker, still: &FrameRequest| {
        let shown = beside(still, 0.0);
        let (stats, rows) = worker.draw_moving(&shown).unwrap();
        assert!(stats.is_quick);
        (rows.tight(), worker.moving.is_due(&worker.gpu, &worker.resident.store, &shown).is_some())
    };
    let apart = |a: &[u8], b: &[u8]| a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum::<u64>();
    begin(&mut worker, &unknown);
    let (right, is_due) = quick(&mut worker, &unknown);
    assert!(!is_due, "a coarse frame is drawn for light that is known");

    begin(&mut worker, &known);
    let (before, is_due) = quick(&mut worker, &unknown);
    assert!(is_due, "no coarse frame is drawn for light that nobody knows");
    let shown = beside(&unknown, 0.0);
    let commands = channel().1;
    worker.renew_coarse(&shown, &commands, &mut VecDeque::new(), COARSE_SLICE, &|_| {}).unwrap().expect("a frame");
    let (after, is_due) = quick(&mut worker, &unknown);
    assert!(!is_due, "coarse frames follow one another at once");
    let [before, after] = [before, after].map(|picture| apart(&picture, &right));
    assert!(after * 2 < before, "pictures are {after} apart with the light of the coarse frame, {before} without it");

    // What fails is not tried after each picture, and unlit points need none.
    begin(&mut worker, &known);
    assert!(worker.moving.put_off("no memory"));
    assert!(!quick(&mut worker, &unknown).1, "a coarse frame that has just failed is tried again");
    let mut unlit = [known, unknown];
    unlit.iter_mut().for_each(|request| request.settings.light.by = scene::Lighting::Colors);
    begin(&mut worker, &unlit[0]);
    assert!(!quick(&mut worker, &unlit[1]).1, "a coarse frame is drawn for points without light");
}

#[test]
fn who_turns_the_head_after_a_rest_finds_what_lies_around_lit() {
    let Some(mut worker) = worker_with_ball() else { return };
    let inside = |direction: DVec3| {
        let still = lit_ball(1.0, 40.0);
        let eye = DVec3::new(0.0, 0.3, 0.0);
        FrameRequest { camera: Camera { eye, pivot: eye + direction, up: DVec3::Z }, ..still }
    };
    let (ahead, back) = (inside(DVec3::Y), inside(-DVec3::Y));
    worker.draw(ahead.clone(), Instant::now()).unwrap();
    worker.keep_light(&ahead).unwrap();
    let needs_coarse = |worker: &mut Worker| {
        let shown = beside(&back, 0.0);
        worker.draw_moving(&shown).unwrap();
        worker.moving.is_due(&worker.gpu, &worker.resident.store, &shown).is_some()
    };
    assert!(needs_coarse(&mut worker), "the light behind the eye is known before anybody has looked");
    // Whatever else is wanted comes first.
    for _ in 0..9 {
        assert!(!worker.prepare_moving(&Arc::new(true.into())).unwrap());
    }
    assert!(needs_coarse(&mut worker), "the light around the eye is drawn although something waits");
    let steps = (1..).find(|_| worker.prepare_moving(&Arc::default()).unwrap());
    assert_eq!(steps, Some(7), "six sides of a cube are drawn, one at a time");
    assert!(!needs_coarse(&mut worker), "the light around the eye is not taken over");
    // It stays where it was drawn.
    worker.draw(back.clone(), Instant::now()).unwrap();
    worker.keep_light(&back).unwrap();
    assert!(worker.prepare_moving(&Arc::default()).unwrap(), "the light around the same eye is drawn again");
}

#[test]
fn the_exposure_goes_on_from_one_kind_of_picture_to_the_next() {
    let Some(mut worker) = worker_with_ball() else { return };
    let [bright, dark] = [40.0, 4.0].map(|red| {
        let mut request = lit_ball(1.0, red);
        request.settings.set_text("tone.fit", "always").unwrap();
        request.lights[0].intensity = [red; 3];
        request
    });
    let mut stops = |request: &FrameRequest| {
        let stats = worker.draw(request.clone(), Instant::now()).unwrap().stats;
        if !request.hurried {
            worker.keep_light(request).unwrap();
        }
        let exposure = stats.exposure.unwrap();
        (exposure.stops, exposure.adapts, stats.is_quick)
    };
    let (first, adapts, _) = stops(&bright);
    assert!(!adapts, "the first picture has the exposure that fits");
    // Ten times darker: 3.3 stops.
    let (second, adapts, _) = stops(&dark);
    assert!(adapts && second > first + 0.2 && second < first + 3.0, "{second} after {first}");
    let (third, _, is_quick) = stops(&beside(&dark, 0.01));
    assert!(is_quick && third > second, "{third} in a quick picture after {second}");
    let (fourth, ..) = stops(&dark);
    assert!(fourth > third, "{fourth} at rest after {third}");
    let next = |_| {
        std::thread::sleep(Duration::from_millis(200));
        stops(&dark)
    };
    let last = (0..30).map(next).find(|(_, adapts, _)| !adapts).expect("the exposure ends").0;
    assert!((last - first - 10.0_f32.log2()).abs() < 0.2, "{last} after {first}");
}

#[test]
fn passes_of_coarse_frames_are_compiled_before_the_camera_moves() {
    let Some(mut worker) = worker() else { return };
    let mut mirror = request([60, 48]);
    mirror.settings.reflection.bounces = 2;
    for still in [*mirror, lit_ball(1.0, 40.0)] {
        worker.draw(still.clone(), Instant::now()).unwrap();
        worker.keep_light(&still).unwrap();
        worker.prepare_moving(&Arc::default()).unwrap();
        for step in [0.0, 0.5] {
            let compiled = worker.shaders.done();
            let coarse = worker.moving.coarse(&beside(&still, step));
            worker.draw_by_passes(&coarse).unwrap();
            assert_eq!(worker.shaders.done(), compiled, "{step}");
        }
    }
}

#[test]
fn samples_of_glossy_mirrors_come_in_steps_and_end_in_the_picture_of_all() {
    let Some((thread, reports)) = start() else { return };
    let report = || reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(report(), Report::Ready { .. }));
    let mut glossy = request([48, 36]);
    glossy.settings.gloss.samples = 7;
    glossy.mirrors[0].specular_power = 20.0;
    // Another ball, which the first one shows.
    let behind = Mirror { position: DVec3::new(0.0, -3.0, 0.5), ..glossy.mirrors[0].clone() };
    glossy.mirrors.push(behind);
    thread.send(Command::Frame(glossy.clone()));
    let samples = || match report() {
        Report::Frame(frame) => (frame.stats.glossy_samples, frame.request.is_whole(&frame.stats)),
        _ => panic!("no frame"),
    };
    assert_eq!([0; 4].map(|_| samples()), [([1, 7], false), ([2, 7], false), ([4, 7], false), ([7, 7], true)]);
    thread.send(Command::Capture { request: glossy.clone(), origin: DVec3::ZERO });
    let Report::Captured(captured) = report() else { panic!("no images") };
    let [_, gpu] = devices().unwrap();
    let mut renderer = Renderer::new(gpu.clone()).unwrap();
    let objects = Objects { mirrors: &glossy.mirrors, ..Objects::default() };
    let store = render::PointStore::new(gpu);
    let stats =
        renderer.render(&store, &render::Frame::new(&glossy.camera, &glossy.settings, objects, glossy.size)).unwrap();
    assert_eq!(stats.glossy_samples, [7, 7]);
    assert!(captured.picture == renderer.read_picture().unwrap(), "another picture than that drawn at once");

    // While something moves, one frame is all, whoever draws it.
    glossy.hurried = true;
    thread.send(Command::Frame(glossy.clone()));
    assert!(samples().1);
    // A frame that is requested meanwhile takes the place of what is left.
    (glossy.hurried, glossy.camera) = (false, Camera::looking(DVec3::ZERO, DVec3::Y, 5.0, DVec3::Z));
    thread.send(Command::Frame(glossy.clone()));
    let other = Box::new(FrameRequest { revision: 1, ..*glossy });
    thread.send(Command::Frame(other.clone()));
    let last = std::iter::from_fn(|| match report() {
        Report::Frame(frame) if frame.request.is_whole(&frame.stats) => None,
        Report::Frame(frame) => Some(frame),
        _ => panic!("no frame"),
    });
    assert!(last.last().is_some_and(|frame| frame.request == *other));
    thread.end();
}

#[test]
fn a_device_that_is_lost_in_the_middle_of_a_frame_is_opened_again_with_all_points() {
    let (Some(window_gpu), Some(gpu)) = (own_device(), own_device()) else { return };
    let mut worker = Worker::new(gpu, window_gpu, Arc::default(), &channel().1, &|_| {}).unwrap().0;
    let cloud = world::CloudKey(0);
    let points: Vec<[f32; 3]> =
        (0..4096).map(|i| [(i % 64) as f32 / 32.0 - 1.0, 0.0, (i / 64) as f32 / 32.0]).collect();
    let chunk = cloud::Chunk::new(0, DVec3::ZERO, points);
    let key = cloud.chunk(world::Part::Block(0));
    worker.resident.apply(Change::Open { cloud, provisional_radius: 0.05 }).unwrap();
    worker.resident.apply(Change::Put { key, chunk, layout: Arc::default() }).unwrap();
    let request = request([48, 36]);
    worker.render(&request, None).unwrap();
    let before = worker.renderer.read_picture().unwrap();

    let (sender, commands) = channel();
    let (told, reports) = channel();
    // The thread ends after the frame.
    let sender = std::cell::RefCell::new(Some(sender));
    let finish = |done| {
        if matches!(done, Finished::Drawn(_) | Finished::Told(Report::NotDrawn(_) | Report::Lost(_))) {
            sender.borrow_mut().take();
        }
        drop(told.send(done));
    };
    // The device goes in the middle of a frame: while the passes of its method are compiled.
    let mut other = request.clone();
    other.settings.reflection.method = scene::Method::SurfelTrace;
    let (lost, shaders) = (worker.gpu.clone(), worker.shaders.clone());
    let compiled = shaders.done();
    let breaker = std::thread::spawn(move || {
        while shaders.done() == compiled {
            std::thread::yield_now();
        }
        lost.device.destroy();
    });
    sender.borrow().as_ref().unwrap().send(Command::Frame(other)).unwrap();
    worker.run(VecDeque::new(), &commands, &Arc::default(), &Arc::default(), &finish);
    breaker.join().unwrap();
    let reports: Vec<Finished> = reports.try_iter().collect();
    let is_told = |done: &Finished| matches!(done, Finished::Told(Report::Problem(_)));
    assert!(reports.iter().any(is_told), "nobody hears of it");
    assert!(reports.iter().any(|done| matches!(done, Finished::Drawn(_))), "the frame is not drawn after all");
    worker.render(&request, None).unwrap();
    assert!(worker.renderer.read_picture().unwrap() == before, "another picture on the new device");

    // Lost again at once, it is given up.
    let again = worker.survive(render::Error::Lost("again".into()), &|_| ());
    assert!(matches!(again, Err(render::Error::Lost(why)) if why == "again"));
}

#[test]
fn a_pick_during_a_frame_that_was_given_up_draws_the_surface_alone() {
    let Some(mut worker) = worker() else { return };
    let cloud = world::CloudKey(0);
    let points = (0..4096).map(|i| [(i % 64) as f32 / 32.0 - 1.0, 2.0, (i / 64) as f32 / 32.0 - 1.0]).collect();
    let chunk = cloud::Chunk::new(0, DVec3::ZERO, points);
    let key = cloud.chunk(world::Part::Block(0));
    worker.resident.apply(Change::Open { cloud, provisional_radius: 0.05 }).unwrap();
    worker.resident.apply(Change::Put { key, chunk, layout: Arc::default() }).unwrap();
    let mut request = request([48, 36]);
    (request.settings.gloss.samples, request.settings.gi.by) = (7, scene::IndirectBy::Rays);
    (request.mirrors[0].specular_power, request.mirrors[0].position) = (20.0, DVec3::new(2.0, 2.0, 0.0));
    worker.draw((*request).clone(), Instant::now()).unwrap();
    let picked = worker.pick([24, 18]).unwrap();
    assert!(picked.is_some() && worker.is_held(&request), "a frame that is held is not drawn again");
    // The next samples are begun, and given up because a button is pressed: their surface is there.
    worker.begin(&request, Some(1));
    let again = worker.pick([24, 18]).unwrap();
    assert!(worker.held.is_none() && again.is_some());
    assert_eq!(again.map(|point| (point.chunk, point.index)), picked.map(|point| (point.chunk, point.index)));
    // A frame of another view is given up in the middle.
    worker.begin(&beside(&request, 0.1), Some(1));
    let again = worker.pick([24, 18]).unwrap();
    assert_eq!(again.map(|point| (point.chunk, point.index)), picked.map(|point| (point.chunk, point.index)));
    let (drawn, _) = worker.held.clone().unwrap();
    assert_eq!((drawn.settings.reflection.method, drawn.settings.gi.bounces), (scene::Method::None, 0));
    assert_eq!(worker.on_screen.as_ref(), Some(&*request), "the picture on the screen stays");
}

#[test]
fn a_pick_is_answered_where_the_device_is_lost() {
    let (Some(window_gpu), Some(gpu)) = (own_device(), own_device()) else { return };
    let mut worker = Worker::new(gpu, window_gpu, Arc::default(), &channel().1, &|_| {}).unwrap().0;
    worker.on_screen = Some(*request([48, 36]));
    worker.gpu.device.destroy();
    let reports = RefCell::new(Vec::new());
    let pick = Command::Pick { pixel: [24, 18], purpose: PickPurpose::Select };
    let outcome = worker.obey(pick, &|report| reports.borrow_mut().push(report));
    assert!(outcome.is_err_and(|error| is_fatal(&error)));
    assert!(matches!(reports.take()[..], [Report::Picked { point: None, .. }]));
}

#[test]
fn a_picture_for_which_the_window_has_no_memory_is_not_drawn_and_the_next_one_is() {
    let Some((thread, reports)) = start() else { return };
    let report = || reports.recv_timeout(PATIENCE).expect("a report");
    assert!(matches!(report(), Report::Ready { .. }));
    thread.send(Command::Frame(request([48, 36])));
    let Report::Frame(first) = report() else { panic!("no frame") };
    let refusal = Refusal::of(&first.window_gpu);
    thread.send(Command::Frame(request([64, 48])));
    let told = report();
    assert!(matches!(&told, Report::NotDrawn(problem) if problem.contains("picture in the window")));
    drop(refusal);
    thread.send(Command::Frame(request([64, 48])));
    let Report::Frame(next) = report() else { panic!("no frame once there is memory") };
    assert_eq!((next.texture.width(), next.texture.height()), (64, 48));
    thread.end();
}
