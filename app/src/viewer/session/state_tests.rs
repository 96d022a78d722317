//! Tests of the session without a window and without a render thread.

use std::sync::Arc;

use scene::{MOST_MIRRORS, MirrorPoints, Shape};
use world::{Change, CloudKey, Event, Opened, Part};

use super::*;
use crate::viewer::loaded::Loaded;
use crate::viewer::objects::Marking;
use crate::viewer::picture::messages::{PickPurpose, PickedPoint};
use crate::viewer::requests::action::Clipping;
use crate::viewer::requests::outside::Effect;
use crate::viewer::requests::work::Work;

impl Session {
    /// Returns a session with a cloud of two points that is completely read.
    pub fn with_two_points() -> Self {
        Self::with_points(vec![[0.0; 3], [10.0, 10.0, 0.0]])
    }

    /// A session with a cloud of these points, which are all loaded.
    pub fn with_points(points: Vec<[f32; 3]>) -> Self {
        use world::{Event, Opened, Part};

        let mut session = Self::new(Preferences::default());
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        let (name, input) = ("cloud.ply".into(), "cloud.ply".into());
        let opened = Opened { name, input, expected_points: points.len() as u64, up: DVec3::Z, ..Opened::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud: 0, opened }, beside));
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, points);
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(job, Event::Chunk { cloud: 0, part: Part::Block(0), chunk }, beside)
        });
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Finished, beside));
        session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
        session
    }

    /// Draws a panel and carries out the actions that it returns.
    pub fn show_and_act(&mut self, show: impl FnOnce(&Self, &mut Vec<Action>)) {
        let mut actions = Vec::new();
        show(self, &mut actions);
        self.act_all(actions);
    }
}

/// Returns a session with a cloud of one attribute. Job 0 has read its header and none of its points.
fn opened() -> (Session, CloudKey) {
    let mut session = Session::new(Preferences::default());
    let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    let attributes = vec![cloud::Attribute { name: "intensity".into(), column_type: cloud::ColumnType::U8 }];
    let (name, input) = ("cloud.ply".into(), "cloud.ply".into());
    let opened = Opened { name, input, attributes, expected_points: 3, up: DVec3::Z, ..Opened::default() };
    session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud: 0, opened }, beside));
    let key = session.loaded.clouds[0].key;
    (session, key)
}

#[test]
fn a_file_that_is_open_is_named_when_it_is_opened_again() {
    let mut session = Session::with_two_points();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.ply");
    std::fs::write(&path, "ply\n").unwrap();
    let by_another_way = folder.path().join("./two.ply").display().to_string();
    for (input, is_told) in [("three.ply".into(), false), (path.display().to_string(), true)] {
        session.loaded.clouds[0].input = input;
        session.outside.messages.all.clear();
        session.open(&[&by_another_way]);
        let told = session.outside.messages.all.iter().any(|message| message.text.contains("open already"));
        assert_eq!(told, is_told);
    }
}

#[test]
fn a_column_that_cannot_be_read_is_no_longer_under_way() {
    let (mut session, key) = opened();
    session.loaded.clouds[0].column_reads.insert(0, Some(Arc::default()));
    assert_eq!(session.loaded.columns_under_way().map(|(name, _)| name).collect::<Vec<_>>(), ["intensity"]);
    session.on_found(Found::Column { key, attribute: 0, result: Err("gone".into()) });
    assert_eq!(session.loaded.columns_under_way().count(), 0);
    assert!(session.outside.messages.all.last().is_some_and(|message| message.text == "intensity: gone"));
}

#[test]
fn a_cloud_that_is_opened_as_a_mirror_reflects_when_it_has_come_and_is_no_step_of_undo() {
    let (mut session, key) = opened();
    session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
    session.loaded.await_marking(MirrorPoints::whole("cloud.ply".into()));
    session.loaded.await_marking(MirrorPoints::whole("gone.ply".into()));
    let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Chunk { cloud: 0, part: Part::Block(0), chunk }, beside)
    });
    session.with_loaded(Loaded::sync_objects);
    assert!(session.scene.objects.markings.is_empty(), "its points are still to come");
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Finished, beside));
    assert_eq!(session.scene.objects.markings, [Marking { key, points: MirrorPoints::whole("cloud.ply".into()) }]);
    assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("gone.ply")));
    let scene = &mut session.scene;
    assert_eq!(scene.history.undo(&mut scene.settings, &mut scene.objects, &mut scene.camera), None);
    session.with_loaded(Loaded::sync_objects);
    assert!(session.outside.effects.iter().any(|effect| matches!(effect, Effect::Work(Work::MarkPoints { .. }))));
    session.with_loaded(|loaded, beside| loaded.remove_cloud(key, beside));
    assert!(session.scene.objects.markings.is_empty());
}

#[test]
fn a_cloud_without_points_leaves_the_renderer_too() {
    let (mut session, removed) = opened();
    session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Finished, beside));
    assert!(session.loaded.clouds.is_empty());
    let is_removal = |effect: &Effect| matches!(effect, Effect::Render(Command::Change(Change::Close { cloud })) if *cloud == removed);
    assert!(session.outside.effects.iter().any(is_removal));
}

#[test]
fn a_frame_that_cannot_be_drawn_ends_neither_the_window_nor_later_frames() {
    let (mut session, _) = opened();
    session.on_report(Report::Ready { adapter: "any".into() });
    session.request_frame();
    assert_eq!(session.frames.under_way, 0, "there is nothing to show yet");
    let chunk = cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3], [1.0; 3]]);
    session.with_loaded(|loaded, beside| {
        loaded.on_loading(0, Event::Chunk { cloud: 0, part: Part::Block(0), chunk }, beside)
    });
    session.request_frame();
    assert_eq!(session.frames.under_way, 1);
    assert!(session.frames.requested.as_ref().is_some_and(|request| request.hurried), "the first picture comes soon");
    session.on_report(Report::NotDrawn("too large".into()));
    assert_eq!((session.frames.under_way, session.fatal.as_deref()), (0, None));
}

#[test]
fn mirrors_are_added_up_to_the_number_that_a_scene_may_have() {
    let mut session = Session::new(Preferences::default());
    for _ in 0..MOST_MIRRORS + 2 {
        session.act(Action::AddMirror(Shape::Sphere));
    }
    assert_eq!(session.scene.objects.mirrors.len(), MOST_MIRRORS);
    assert!(session.outside.messages.all.last().is_some_and(|message| message.text.contains("64 mirrors")));
}

#[test]
fn point_size_and_field_of_view_stop_at_their_ranges() {
    let mut session = Session::new(Preferences::default());
    for _ in 0..200 {
        session.act(Action::PointSize(1.0));
        session.act(Action::FieldOfView(-1.0));
    }
    assert_eq!((session.scene.settings.splat.size, session.scene.settings.view.field_of_view), (20.0, 1.0));
}

/// A session that has read clouds with these points.
fn session_of(clouds: &[(&str, Vec<[f32; 3]>)]) -> Session {
    let mut session = Session::new(Preferences::default());
    let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    let mut load = |event| session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
    for (cloud, (name, points)) in clouds.iter().enumerate() {
        let (name, expected_points) = ((*name).to_owned(), points.len() as u64);
        let opened = Opened { input: name.clone(), name, expected_points, up: DVec3::Z, ..Opened::default() };
        load(Event::Opened { cloud, opened });
        let chunk = cloud::Chunk::new(0, DVec3::ZERO, points.clone());
        load(Event::Chunk { cloud, part: Part::Block(0), chunk });
    }
    load(Event::Finished);
    session
}

#[test]
fn a_room_opens_from_inside_and_each_side_is_a_key_away() {
    let mut points = Vec::new();
    for (x, y) in (0..=80).flat_map(|x| (0..=50).map(move |y| (x as f32 * 0.1, y as f32 * 0.1))) {
        points.extend([[x, y, 0.0], [x, y, 3.0]]);
    }
    for z in (0..=30).map(|z| z as f32 * 0.1) {
        points.extend((0..=80).flat_map(|x| [[x as f32 * 0.1, 0.0, z], [x as f32 * 0.1, 5.0, z]]));
        points.extend((0..=50).flat_map(|y| [[0.0, y as f32 * 0.1, z], [8.0, y as f32 * 0.1, z]]));
    }
    let mut session = session_of(&[("room.ply", points)]);
    let asked = std::mem::take(&mut session.outside.effects).into_iter().find_map(|effect| match effect {
        Effect::Work(Work::FindSurroundings { asked, clouds, up }) => Some((asked, clouds[0].chunks.clone(), up)),
        _ => None,
    });
    let (asked, chunks, up) = asked.expect("the surroundings are asked for");
    session.on_found(Found::Surroundings { asked, found: world::AutoLight::around(&chunks, up) });
    let is_inside = |session: &Session| {
        let eye = session.scene.camera.eye;
        eye.cmpgt(DVec3::ZERO).all() && eye.cmplt(DVec3::new(8.0, 5.0, 3.0)).all()
    };
    assert!(is_inside(&session) && session.scene.settings.splat.back_faces, "{:?}", session.scene.camera);
    session.act(Action::DollHouse);
    assert!(!is_inside(&session) && !session.scene.settings.splat.back_faces);
    session.act(Action::GoInside);
    assert!(is_inside(&session) && session.scene.settings.splat.back_faces);
    session.act(Action::Undo);
    assert!(!is_inside(&session) && !session.scene.settings.splat.back_faces, "one step of undo");
}

#[test]
fn of_clouds_that_lie_far_apart_the_largest_is_framed_and_the_distance_of_others_is_said() {
    let near = vec![[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]];
    let session = session_of(&[("far.ply", vec![[1e5, 0.0, 0.0], [1e5 + 3.0, 4.0, 0.0]]), ("near.ply", near)]);
    let camera = session.scene.camera;
    assert!(camera.pivot.length() < 10.0 && camera.eye.length() < 100.0, "{camera:?}");
    let said: Vec<&str> = session.outside.messages.all.iter().map(|message| message.text.as_str()).collect();
    assert!(said.contains(&"far.ply lies 99,997 units away from near.ply"), "{said:?}");
}

#[test]
fn a_filter_of_an_attribute_that_a_cloud_lacks_is_said() {
    let mut session = Session::new(Preferences::default());
    let filter = scene::Filter { attribute: "amplitude".into(), low: 1.0, high: 2.0 };
    session.act(Action::Clip(Clipping::Filter(vec![filter])));
    let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
    let mut load = |event| session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
    load(Event::Opened { cloud: 0, opened: Opened { name: "a.ply".into(), up: DVec3::Z, ..Opened::default() } });
    load(Event::Chunk { cloud: 0, part: Part::Block(0), chunk: cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]]) });
    load(Event::Finished);
    let said: Vec<&str> = session.outside.messages.all.iter().map(|message| message.text.as_str()).collect();
    assert_eq!(said, ["a.ply: no attribute `amplitude` to filter by; Known: stray"]);
}

#[test]
fn settings_that_name_no_cloud_are_said_once() {
    let mut session = Session::new(Preferences::default());
    let own =
        ["a.ply", "b.ply"].map(|name| scene::CloudSettings { on: false, ..scene::CloudSettings::of(name.into()) });
    for _ in 0..2 {
        session.loaded.await_settings(&mut world::Request { cloud_settings: own.to_vec(), ..Default::default() });
        let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let mut load = |event| session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
        load(Event::Opened { cloud: 0, opened: Opened { name: "a.ply".into(), up: DVec3::Z, ..Opened::default() } });
        load(Event::Chunk { cloud: 0, part: Part::Block(0), chunk: cloud::Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]]) });
        load(Event::Finished);
    }
    let said = |session: &Session| -> Vec<String> {
        session.outside.messages.all.iter().map(|message| message.text.clone()).collect()
    };
    assert_eq!(said(&session), ["cloud settings: no cloud is called `b.ply`"]);
    // What is wrong with a file that was named is said once, and not that no cloud is called as it is.
    let mut session = Session::new(Preferences::default());
    session.loaded.await_settings(&mut world::Request { cloud_settings: own.to_vec(), ..Default::default() });
    let inputs = ["a.ply", "b.ply"].map(|name| world::Input::File(name.into()));
    let job = session.loaded.add_job(&inputs, Arc::default(), Arc::default(), session.outside.now);
    let mut load = |event| session.with_loaded(|loaded, beside| loaded.on_loading(job, event, beside));
    load(Event::Opened { cloud: 0, opened: Opened { name: "a.ply".into(), up: DVec3::Z, ..Opened::default() } });
    load(Event::Failed { input: "b.ply".into(), error: "b.ply: cut off".into(), is_usage: true });
    load(Event::Finished);
    assert_eq!(said(&session), ["b.ply: cut off", "a.ply: has no points"]);
}

#[test]
fn what_is_opened_in_an_empty_window_is_no_step_of_undo() {
    let mut session = Session::new(Preferences::default());
    session.step(session.outside.now, false);
    assert!(session.open(&["five-mirrors/sphere"]));
    session.step(session.outside.now, false);
    let (camera, settings) = (session.scene.camera, session.scene.settings.clone());
    assert!(session.scene.camera_is_placed);
    session.act(Action::Undo);
    assert_eq!((session.scene.camera, &session.scene.settings), (camera, &settings));
    assert!(!session.outside.messages.all.iter().any(|message| message.text.starts_with("Undone")));
}

#[test]
fn a_text_that_has_the_keyboard_lets_the_picture_rest_and_is_one_step_of_undo() {
    let mut session = Session::with_two_points();
    let start = session.outside.now;
    let at = |milliseconds| start + Duration::from_millis(milliseconds);
    session.step(start, false);
    let steps = session.scene.history.steps();
    session.is_typing = true;
    session.step(at(0), true);
    session.act(Action::set("splat", "size", param::Value::F32(2.0)));
    session.step(at(10), true);
    assert!(session.scene.navigation.time_to_rest(at(10)).is_some(), "a slider is dragged");
    // The slider is released, and the text keeps the keyboard.
    session.step(at(20), false);
    session.step(at(1000), false);
    assert_eq!(session.scene.navigation.time_to_rest(at(1000)), None);
    assert_eq!(session.scene.history.steps(), steps, "the text may go on");
    session.is_typing = false;
    session.step(at(2000), false);
    assert_eq!(session.scene.history.steps(), steps + 1);
}

#[test]
fn a_comparison_begins_with_the_other_cloud_that_is_open() {
    use crate::viewer::jobs::comparisons::Second;

    let points = vec![[0.0; 3], [1.0, 0.0, 0.0]];
    let session = session_of(&[("a.ply", points.clone()), ("b.ply", points)]);
    assert_eq!(session.loaded.compared_second(), Second::Cloud(session.loaded.clouds[1].key));
    assert_eq!(Session::with_two_points().loaded.compared_second(), Second::File(String::new()));
}

#[test]
fn escape_closes_a_sweep_that_is_set_up_and_then_the_chart() {
    let mut session = Session::with_two_points();
    session.act(Action::ToggleChart);
    session.act(Action::AskSweep("splat.size".into()));
    assert!(session.sweeps.asked.is_some());
    session.act(Action::EndTool);
    assert!(session.sweeps.asked.is_none() && session.tuning.is_open);
    session.act(Action::EndTool);
    assert!(!session.tuning.is_open);
}

#[test]
fn a_parameter_that_is_reset_comes_back_by_undo() {
    let mut session = Session::with_two_points();
    session.step(session.outside.now, false);
    let size = session.scene.settings.splat.size;
    session.scene.edit(session.outside.now, |settings, _| settings.splat.size = 3.0);
    session.act(Action::Reset("splat.size".into()));
    assert_eq!(session.scene.settings.splat.size, size);
    assert!(session.outside.messages.all.last().unwrap().text.starts_with("splat.size is "));
    session.act(Action::Undo);
    assert_eq!(session.scene.settings.splat.size, 3.0);
}

fn click(session: &mut Session) {
    session.act(Action::PointAt(Some([10, 10])));
    session.act(Action::Pick);
}

/// The answer to a click: one of the two points of the cloud, or none.
fn answer(session: &mut Session, index: Option<usize>) {
    let chunk = CloudKey(0).chunk(Part::Block(0));
    let point = index.map(|index| PickedPoint { chunk, index });
    session.on_report(Report::Picked { pixel: [10, 10], purpose: PickPurpose::Select, point });
}

/// Which of the two points each mirror is nearer to.
fn mirrors(session: &Session) -> Vec<usize> {
    let nearer = |place: DVec3| usize::from(place.distance(DVec3::new(10.0, 10.0, 0.0)) < place.length());
    session.scene.objects.mirrors.iter().map(|placed| nearer(placed.mirror.position)).collect()
}

#[test]
fn what_is_added_right_after_a_click_goes_to_the_point_that_was_clicked() {
    let mut session = Session::with_two_points();
    session.scene.view_size = [400, 300];
    click(&mut session);
    answer(&mut session, Some(0));
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::Clip(Clipping::AroundPick));
    session.on_report(Report::Picked { pixel: [10, 10], purpose: PickPurpose::Hover, point: None });
    assert_eq!((mirrors(&session), session.scene.objects.clips.len()), (vec![], 0), "it is not known where to");
    answer(&mut session, Some(1));
    assert_eq!(mirrors(&session), [1]);
    assert!(session.scene.objects.clips[0].clip.volume().volume.contains(DVec3::new(10.0, 10.0, 0.0)));
    // Each goes to the click before it, and where that met nothing, to the point before.
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    answer(&mut session, Some(0));
    assert_eq!(mirrors(&session), [1, 0]);
    answer(&mut session, None);
    assert_eq!(mirrors(&session), [1, 0, 0]);
    // What waits is taken back like what is there.
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::Undo);
    answer(&mut session, Some(1));
    assert_eq!(mirrors(&session), [1, 0, 0]);
    session.act(Action::Undo);
    assert_eq!(mirrors(&session), [1, 0]);
    // What acts on it waits with it, and does not act on what was selected before.
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::Delete);
    answer(&mut session, Some(1));
    assert_eq!(mirrors(&session), [1, 0]);
    // Where nothing can be drawn any more, no answer comes, and nothing is added elsewhere.
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.on_report(Report::Lost("gone".into()));
    assert!(!session.tools.clicked.is_waited_for());
    assert_eq!(mirrors(&session), [1, 0]);
}

#[test]
fn what_waits_for_a_click_is_not_added_to_the_next_scene() {
    let mut session = Session::with_two_points();
    session.scene.view_size = [400, 300];
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.go(Leaving::Open("five-mirrors/none".into()));
    click(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    answer(&mut session, None);
    assert_eq!(mirrors(&session), [0; 0], "this is the answer to the first click");
    answer(&mut session, None);
    assert_eq!(mirrors(&session).len(), 1);
}
