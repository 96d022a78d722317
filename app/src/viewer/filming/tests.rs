use std::time::Duration;

use clap::Parser as _;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::{DVec2, DVec3};
use scene::{Camera, CameraPath, Caption, CaptureFormat, Method, Mirror, Object, Place, SceneFile, Shape};

use super::*;
use crate::commands::recording::{PathChoice, Recorder};
use crate::shared::command_line::{Command, CommandLine};
use crate::system::progress_bar::Bar;
use crate::viewer::bench::{Bench, devices};
use crate::viewer::interface;
use crate::viewer::jobs::process::Ended;
use crate::viewer::look::tab::Tab;
use crate::viewer::requests::action::{Filing, PathPreset};
use crate::viewer::requests::work::{Found, Work};
use crate::viewer::session::Session;
use crate::viewer::tools::facts::facts;

pub(super) fn film(session: &mut Session, film: Film) {
    session.act(Action::Film(film));
}

/// Steps the session so many seconds later.
pub(super) fn later(session: &mut Session, seconds: f64) {
    let now = session.outside.now + Duration::from_secs_f64(seconds);
    session.step(now, false);
}

fn orbit(session: &mut Session) -> Camera {
    session.act(Action::Orbit(DVec2::new(80.0, 20.0)));
    session.scene.camera
}

pub(super) fn path(session: &Session) -> &CameraPath {
    session.filming.timeline.path(&session.scene).unwrap()
}

pub(super) fn add_ball(session: &mut Session) {
    let ball = Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 0.5);
    let id = session.scene.next_object_id();
    let ball = Mirror { name: "ball".into(), position: DVec3::ZERO, ..ball };
    session.scene.edit_objects(session.outside.now, |objects| objects.add(id, Object::Mirror(ball)));
    session.scene.selected = Some(id);
}

fn around(session: &Session) -> Around<'_> {
    let kept = session.kept.settings();
    Around::new(&session.loaded, &session.frames, &session.tuning, kept, session.adapter.as_deref())
}

fn ball(session: &Session) -> DVec3 {
    session.scene.objects.mirrors[0].mirror.position
}

#[test]
fn a_kept_view_is_flown_to_by_its_digit_saved_and_undone() {
    let mut session = Session::with_two_points();
    later(&mut session, 1.0);
    let kept = session.scene.camera;
    film(&mut session, Film::Keep(Some(3)));
    later(&mut session, 1.0);
    let other = orbit(&mut session);
    film(&mut session, Film::FlyToDigit(3));
    later(&mut session, 0.4);
    let between = session.scene.camera;
    assert!(between != kept && between != other, "it flies");
    later(&mut session, 1.0);
    assert_eq!(session.scene.camera, session.scene.objects.bookmarks[0].camera());
    assert!(session.scene.camera.eye.distance(kept.eye) < 1e-9);
    session.act(Action::Undo);
    assert!(session.scene.camera.eye.distance(other.eye) < 1e-9, "back to where the flight began");
    // The same digit keeps another view under the same name, and no digit another one.
    film(&mut session, Film::Keep(Some(3)));
    film(&mut session, Film::Keep(None));
    let bookmarks = &session.scene.objects.bookmarks;
    assert_eq!(bookmarks.iter().map(|bookmark| bookmark.name.as_str()).collect::<Vec<_>>(), ["view", "view 2"]);
    assert!(bookmarks[0].camera().eye.distance(other.eye) < 1e-9);
    let text = session.scene.whole_file(&session.loaded).to_text();
    assert_eq!(SceneFile::parse(&text).unwrap().bookmarks, *bookmarks);
    session.act(Action::Undo);
    assert_eq!(session.scene.objects.bookmarks.len(), 1);
    film(&mut session, Film::RemoveBookmark(0));
    assert!(session.scene.objects.bookmarks.is_empty());
    session.act(Action::Undo);
    assert_eq!(session.scene.objects.bookmarks.len(), 1);
    film(&mut session, Film::FlyToDigit(7));
    assert!(session.outside.messages.all.last().unwrap().text.contains("Ctrl+Shift+7 keeps this one"));
}

#[test]
fn moving_the_camera_by_hand_ends_a_flight() {
    let mut session = Session::with_two_points();
    film(&mut session, Film::Keep(Some(1)));
    orbit(&mut session);
    film(&mut session, Film::FlyToDigit(1));
    later(&mut session, 0.3);
    let by_hand = orbit(&mut session);
    later(&mut session, 0.5);
    assert_eq!(session.scene.camera, by_hand);
}

#[test]
fn a_path_is_played_by_the_clock_and_the_scene_keeps_its_own_values() {
    let mut session = Session::with_two_points();
    add_ball(&mut session);
    let own = session.scene.settings.sun.elevation;
    film(&mut session, Film::Add(PathPreset::View));
    let start = session.scene.camera;
    // A second keyframe and keys of a parameter and of the ball, at two seconds.
    film(&mut session, Film::Scrub(2.0));
    later(&mut session, 0.1);
    let end = orbit(&mut session);
    let mut changed = path(&session).clone();
    changed.set_keyframe(2.0, end);
    film(&mut session, Film::Change(Box::new(changed)));
    for (time, elevation, place) in [(0.0, 10.0, 0.0), (2.0, 50.0, 4.0)] {
        film(&mut session, Film::Scrub(time));
        session.act(Action::set("sun", "elevation", param::Value::F32(elevation)));
        let (id, mut moved) = session.scene.objects.named("mirror", "ball").unwrap();
        if let Object::Mirror(mirror) = &mut moved {
            mirror.position.x = place;
        }
        session.act(Action::ChangeObject(id, Box::new(moved)));
        film(&mut session, Film::Key("sun.elevation".into()));
        film(&mut session, Film::Key("mirrors.ball.position".into()));
    }
    assert_eq!(path(&session).tracks.iter().map(|track| track.times.clone()).collect::<Vec<_>>(), vec![[0.0, 2.0]; 2]);
    session.act(Action::set("sun", "elevation", param::Value::F32(own)));
    later(&mut session, 1.0);
    later(&mut session, 1.0);
    let (elevation, steps) = (session.scene.settings.sun.elevation, session.scene.history.steps());

    film(&mut session, Film::Scrub(0.0));
    film(&mut session, Film::Play);
    later(&mut session, 0.0);
    assert!(session.scene.camera.eye.distance(start.eye) < 1e-9);
    later(&mut session, 1.0);
    assert!(session.filming.timeline.is_playing());
    assert_eq!((session.scene.settings.sun.elevation, ball(&session).x), (30.0, 2.0));
    later(&mut session, 1.5);
    assert!(!session.filming.timeline.is_playing());
    assert_eq!((session.filming.timeline.time, ball(&session).x), (2.0, 4.0));
    assert!(session.scene.camera.eye.distance(end.eye) < 1e-9);
    later(&mut session, 1.0);
    assert_eq!(session.scene.history.steps(), steps, "playing is no step of undo");

    // What is saved, and what undo goes back to, are the scene's own values.
    film(&mut session, Film::Scrub(1.0));
    later(&mut session, 0.1);
    session.act(Action::File(Filing::SaveTo("film.toml".into())));
    assert_eq!(session.scene.settings.sun.elevation, elevation);
    let saved = session.outside.effects.iter().find_map(|effect| match effect {
        Effect::Work(Work::SaveScene { text, .. }) => SceneFile::parse(text).ok(),
        _ => None,
    });
    let saved = saved.expect("a scene file");
    assert_eq!((&saved.paths, saved.mirrors[0].position.x), (&session.scene.objects.paths, 4.0));
    // Repeating goes on from the beginning; a drag of the camera pauses.
    film(&mut session, Film::Repeat(true));
    film(&mut session, Film::Scrub(0.0));
    film(&mut session, Film::Play);
    later(&mut session, 0.0);
    later(&mut session, 2.5);
    assert!(session.filming.timeline.is_playing() && (session.filming.timeline.time - 0.5).abs() < 1e-9);
    orbit(&mut session);
    assert!(!session.filming.timeline.is_playing());
}

#[test]
fn edits_of_a_path_are_undone_and_the_picture_follows() {
    let mut session = Session::with_two_points();
    film(&mut session, Film::Add(PathPreset::View));
    later(&mut session, 1.0);
    let view = session.scene.camera;
    let end = orbit(&mut session);
    let mut changed = path(&session).clone();
    changed.set_keyframe(3.0, end);
    film(&mut session, Film::Change(Box::new(changed.clone())));
    later(&mut session, 1.0);
    later(&mut session, 1.0);
    changed.move_keyframe(1, 4.0);
    film(&mut session, Film::Change(Box::new(changed)));
    film(&mut session, Film::Scrub(3.5));
    later(&mut session, 1.0);
    later(&mut session, 1.0);
    assert_eq!(path(&session).duration(), 4.0);
    let before = session.scene.camera;
    session.act(Action::Undo);
    assert!(session.outside.messages.all.last().unwrap().text.contains("path `path`"));
    later(&mut session, 0.1);
    assert_eq!(path(&session).duration(), 3.0);
    assert!(session.scene.camera != before && session.scene.camera.eye.distance(end.eye) < 1e-9);
    session.act(Action::Undo);
    assert_eq!(path(&session).keyframes.len(), 1);
    session.act(Action::Redo);
    assert_eq!(path(&session).duration(), 3.0);
    film(&mut session, Film::Remove);
    assert!(session.scene.objects.paths.is_empty());
    session.act(Action::Undo);
    assert_eq!(path(&session).keyframes[0].eye, view.eye);
    // Impossible changes are reported and change nothing.
    let known = path(&session).clone();
    film(&mut session, Film::Change(Box::new(CameraPath { keyframes: Vec::new(), ..known.clone() })));
    assert_eq!(*path(&session), known);
    film(&mut session, Film::Key("mirrors.gone.position".into()));
    assert_eq!(*path(&session), known);
}

#[test]
fn every_preset_is_a_path_or_says_what_it_lacks() {
    let mut session = Session::with_two_points();
    let all = [
        PathPreset::View,
        PathPreset::Bookmarks,
        PathPreset::Turntable,
        PathPreset::Orbit,
        PathPreset::Polyline,
        PathPreset::MirrorSweep,
        PathPreset::MethodTour,
        PathPreset::WipeToTruth,
        PathPreset::WipeFromKept,
    ];
    let made =
        |session: &Session| all.map(|preset| presets::path(preset, 1.7, &session.scene, &around(session)).is_ok());
    assert_eq!(made(&session), [true, false, true, false, false, false, true, true, false]);
    add_ball(&mut session);
    film(&mut session, Film::Keep(None));
    orbit(&mut session);
    film(&mut session, Film::Keep(None));
    assert_eq!(made(&session), [true, true, true, true, false, true, true, true, false]);
    let lacking = [PathPreset::Polyline, PathPreset::WipeFromKept];
    for preset in all.into_iter().filter(|preset| !lacking.contains(preset)) {
        film(&mut session, Film::Add(preset));
        assert!(path(&session).check().is_ok(), "{preset:?}");
        film(&mut session, Film::Scrub(1.0));
        later(&mut session, 0.1);
        assert!(session.outside.messages.all.iter().all(|message| message.level != Level::Error), "{preset:?}");
    }
    // Each has a name of its own.
    let mut names: Vec<&str> = session.scene.objects.paths.iter().map(|path| path.name.as_str()).collect();
    names.dedup();
    assert_eq!(names.len(), 7);
}

#[test]
fn a_path_along_the_selected_measurement_flies_at_the_height_that_was_chosen() {
    let mut session = Session::with_two_points();
    let id = session.scene.next_object_id();
    let points = [DVec3::ZERO, DVec3::new(5.0, 0.0, 0.0), DVec3::new(5.0, 5.0, 1.0)];
    let text = "[[measurements]]\nkind = \"polyline\"\npoints = [[0, 0, 0], [5, 0, 0], [5, 5, 1]]\n";
    let line = SceneFile::parse(text).unwrap().measurements.remove(0);
    session.scene.edit_objects(session.outside.now, |objects| objects.add(id, Object::Measurement(line)));
    session.scene.selected = Some(id);
    let up = session.up();
    for height in [1.7, 4.0] {
        film(&mut session, Film::Add(PathPreset::Polyline));
        let eyes: Vec<DVec3> = path(&session).keyframes.iter().map(|keyframe| keyframe.eye).collect();
        let expected: Vec<DVec3> = points.iter().map(|point| *point + up * height).collect();
        assert!(eyes.iter().zip(&expected).all(|(eye, expected)| eye.distance(*expected) < 1e-9), "{eyes:?}");
        film(&mut session, Film::FlyAt(4.0));
        session.scene.selected = Some(id);
    }
}

/// The captions that the picture shows.
fn captions(session: &Session) -> Vec<String> {
    let Session { scene, loaded, tools, .. } = session;
    facts(scene, loaded, &tools.measurements).captions.into_iter().map(|caption| caption.text).collect()
}

fn accuracy(p95: f64) -> study::Accuracy {
    let percentiles = study::Percentiles { median: 0.1, p95, p99: 2.0 };
    study::Accuracy {
        truth: study::Truth::SameInput,
        mirror_pixels: 8,
        coverage: 1.0,
        closed_coverage: 1.0,
        false_fill: 0.0,
        angle_error: percentiles,
        pixel_error: percentiles,
        occlusion_error: 0.0,
        wrong: 0.0,
        recall: None,
        image: None,
        indirect: None,
        surface: None,
    }
}

#[test]
fn a_method_tour_names_each_method_and_tells_what_was_measured_of_this_view_and_nothing_else() {
    let mut session = Session::with_two_points();
    let view = FrameRequest::any();
    session.frames.requested = Some(view.clone());
    session.adapter = Some("a card".into());
    film(&mut session, Film::Add(PathPreset::MethodTour));
    let plain = path(&session).captions.clone();
    assert!(plain.iter().all(|caption| caption.text == "{reflection.method}"), "{plain:?}");
    assert_eq!(plain.len() + 2, scene::METHODS.len(), "all but auto and none");
    let mut measure = |change: &dyn Fn(&mut FrameRequest, &mut scene::Settings), milliseconds: f64, error: f64| {
        let (mut request, mut settings) = (view.clone(), session.scene.settings.clone());
        change(&mut request, &mut settings);
        request.settings = settings.clone();
        session.tuning.add(&request, &settings, vec![[2.0 * milliseconds, milliseconds]], accuracy(error));
    };
    // Of an older size of the window, of another view, and with other settings.
    measure(&|request, settings| (request.size, settings.reflection.method) = ([9, 9], Method::LightField), 6.0, 0.5);
    measure(&|_, settings| settings.reflection.method = Method::Sscr, 7.25, 0.5);
    measure(&|_, settings| settings.reflection.method = Method::SurfelTrace, 9.0, f64::NAN);
    measure(&|request, settings| (request.camera.eye.x, settings.reflection.method) = (9.0, Method::Sscr), 1.0, 0.5);
    measure(&|_, settings| (settings.splat.size, settings.reflection.method) = (1.5, Method::Sscr), 1.0, 0.5);
    film(&mut session, Film::Add(PathPreset::MethodTour));
    let tour = path(&session).clone();
    let of = |method: Method| {
        let place = tour.tracks[0].values.iter().position(|value| value.as_str() == Some(method.row().name)).unwrap();
        tour.captions[place].text.as_str()
    };
    assert_eq!(of(Method::Sscr), "{reflection.method}\n7.2 ms of 14.5 ms, 95 % within 0.50 pixels");
    assert_eq!(of(Method::SurfelTrace), "{reflection.method}\n9.0 ms of 18.0 ms");
    assert_eq!([of(Method::LightField), of(Method::CubemapTrace)], ["{reflection.method}"; 2]);
    let last = tour.captions.last().unwrap();
    assert_eq!((last.text.as_str(), last.place, last.end), ("measured at 8x6 on a card", Place::Top, None));

    // The captions follow the path, with the method that the track sets, and go with it.
    assert!(captions(&session).is_empty());
    film(&mut session, Film::Scrub(4.5));
    later(&mut session, 0.1);
    let shown = captions(&session);
    assert_eq!(shown, ["sscr\n7.2 ms of 14.5 ms, 95 % within 0.50 pixels", "measured at 8x6 on a card"]);
    orbit(&mut session);
    session.act(Action::set("sun", "elevation", param::Value::F32(12.0)));
    assert!(captions(&session).is_empty());
    let saved = SceneFile::parse(&session.scene.whole_file(&session.loaded).to_text()).unwrap();
    assert_eq!(saved.paths[1].captions, tour.captions);
}

#[test]
fn the_window_records_the_pictures_of_the_scene_that_it_saves_to_the_bit() {
    let Some([_, gpu]) = devices() else { return };
    let Some(mut bench) = Bench::with_sphere() else { return };
    let [work, home] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let grid: String = (0..400).map(|i| format!("{} {} 0.1\n", i % 20, i / 20)).collect();
    let head = "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\nproperty float y\nproperty float z\n";
    std::fs::write(home.path().join("grid.ply"), format!("{head}end_header\n{grid}")).unwrap();
    let session = &mut bench.session;
    assert!(session.open(&[home.path().join("grid.ply")]));
    bench.settle();
    let session = &mut bench.session;
    (session.scene.settings.sun.elevation, session.scene.settings.gi.vpls) = (33.3, 16);
    film(session, Film::Add(PathPreset::MirrorSweep));
    let mut captioned = path(session).clone();
    captioned.captions.push(Caption::new("{reflection.method}".into(), 0.0, None));
    film(session, Film::Change(Box::new(captioned)));
    film(session, Film::AskRecording);
    session.outside.effects.clear();
    film(session, Film::StartRecording);
    session.act(Action::File(Filing::SaveTo(home.path().join("saved.toml"))));
    let texts = std::mem::take(&mut session.outside.effects).into_iter().filter_map(|effect| match effect {
        Effect::Work(Work::Record { scene, .. }) => Some(scene),
        Effect::Work(Work::SaveScene { text, .. }) => Some(text),
        _ => None,
    });
    let [handed, saved] = texts.collect::<Vec<_>>().try_into().unwrap();
    assert!(saved != handed && saved.contains("\"grid.ply\""), "beside the scene: {saved}");
    let files = [(work.path().join("scratch.toml"), handed), (home.path().join("saved.toml"), saved)];
    let pictures = files.map(|(file, text)| {
        std::fs::write(&file, text).unwrap();
        let request = world::resolve(std::slice::from_ref(&file));
        let choice = PathChoice::new(Some("mirror sweep"), &request, &file).unwrap();
        let mut recorder = Recorder::open(gpu.clone(), None, [64, 48], request, &choice).unwrap().unwrap();
        let bar = Bar::pictures("recording");
        [0.0, 1.5].map(|time| recorder.picture(time, &[], &bar).unwrap().rgba)
    });
    assert!(pictures[0] == pictures[1], "the saved scene has other pictures");
    assert!(pictures[0][0] != pictures[0][1], "the ball moves");
}

/// Columns of the pictures that the window has of the states at a time of the path, side by side.
fn side_by_side(session: &Session, time: f64) -> Option<Vec<u8>> {
    let (path, timeline) = (path(session), &session.filming.timeline);
    let [width, height] = session.scene.view_size;
    let mut whole = vec![0; (width * height * 4) as usize];
    for (state, columns) in path.parts(time, width) {
        let picture = timeline.wiping.picture(&session.scene, &path.states[state])?;
        for row in 0..height {
            let bytes = [columns.start, columns.end].map(|column| ((row * width + column) * 4) as usize);
            whole[bytes[0]..bytes[1]].copy_from_slice(&picture.rgba[bytes[0]..bytes[1]]);
        }
    }
    Some(whole)
}

#[test]
fn the_window_shows_the_states_of_a_wipe_as_a_recording_has_them() {
    let Some(mut bench) = Bench::with_sphere() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wipe.toml");
    let text = "clouds = [\"five-mirrors/none\"]\n[camera]\neye = [0.0, 0.0, 1.9]\npivot = [0.0, 0.0, 0.0]\n\
                up = [0.0, 1.0, 0.0]\n[parameters]\n\"gi.bounces\" = 0\n\"scene.points\" = 3000\n\"tone.fit\" = \"locked\"\n\
                [[mirrors]]\nname = \"ball\"\nshape = \"sphere\"\nposition = [0.1, 0.0, 0.0]\nsize = 0.6\n";
    std::fs::write(&file, text).unwrap();
    bench.session.act(Action::File(Filing::Open(file.clone())));
    bench.settle();
    film(&mut bench.session, Film::Add(PathPreset::WipeToTruth));
    let mut wiped = path(&bench.session).clone();
    wiped.states.iter_mut().for_each(|state| state.name.clear());
    film(&mut bench.session, Film::Change(Box::new(wiped)));
    film(&mut bench.session, Film::Scrub(3.0));
    let own = bench.session.scene.settings.clone();
    bench.settle();
    let shown = side_by_side(&bench.session, 3.0).expect("pictures of both states");
    // Only the line moves, so nothing is drawn again.
    let drawn = bench.session.frames.requested.clone();
    film(&mut bench.session, Film::Scrub(2.5));
    bench.settle();
    assert!(bench.session.frames.requested == drawn);
    let elsewhere = side_by_side(&bench.session, 2.5).expect("pictures of both states");
    assert!(shown != elsewhere, "the states have pictures of their own");
    std::fs::write(&file, bench.session.scene.whole_file(&bench.session.loaded).to_text()).unwrap();
    film(&mut bench.session, Film::Toggle);
    assert!(bench.session.scene.settings == own, "the scene has its own values again");

    let request = world::resolve(std::slice::from_ref(&file));
    let choice = PathChoice::new(None, &request, &file).unwrap();
    let Some([_, gpu]) = devices() else { return };
    let mut recorder = Recorder::open(gpu, None, [64, 48], request, &choice).unwrap().unwrap();
    let bar = Bar::pictures("recording");
    let mut differing = |time: f64, shown: &[u8]| {
        let picture = recorder.picture(time, &[], &bar).unwrap().rgba;
        picture.chunks_exact(4).zip(shown.chunks_exact(4)).filter(|(recorded, shown)| recorded != shown).count()
    };
    assert_eq!([differing(3.0, &shown), differing(2.5, &elsewhere)], [0, 0]);
}

#[test]
fn a_wipe_from_the_kept_state_holds_what_differs_and_nothing_else() {
    let mut session = Session::with_two_points();
    let kept = session.scene.settings.clone();
    assert!(presets::between(&kept, &kept).is_none());
    let now = &mut session.scene.settings;
    (now.view.background, now.reflection.method) = (param::Color(0x2030_40ff), Method::Sscr);
    now.scene.points += 1;
    let states = presets::between(&kept, &session.scene.settings).unwrap();
    assert_eq!(states[0].method.as_deref(), Some(kept.reflection.method.chosen().row().name));
    assert_eq!(states[1].method.as_deref(), Some("sscr"));
    for (state, settings) in states.iter().zip([&kept, &session.scene.settings]) {
        assert_eq!(state.parameters.keys().collect::<Vec<_>>(), ["view.background"]);
        let mut applied = kept.clone();
        state.apply(&mut applied).unwrap();
        assert_eq!(applied.view.background, settings.view.background);
    }
}

/// The command line, for which a test holds that it makes the same pictures each time.
#[test]
fn record_is_the_command_with_the_scene_that_is_saved() {
    let mut session = Session::with_two_points();
    add_ball(&mut session);
    film(&mut session, Film::Add(PathPreset::MirrorSweep));
    film(&mut session, Film::Scrub(1.0));
    later(&mut session, 0.1);
    film(&mut session, Film::AskRecording);
    let mut wanted = session.filming.recording.asked.clone().unwrap();
    (wanted.size, wanted.fps, wanted.frames, wanted.subframes) = ([320, 240], 25, [10, 20], 4);
    wanted.output = "a film.mp4".into();
    film(&mut session, Film::ChangeRecording(Some(Box::new(wanted))));
    session.outside.effects.clear();
    film(&mut session, Film::StartRecording);
    let asked = std::mem::take(&mut session.outside.effects).into_iter().find_map(|effect| match effect {
        Effect::Work(Work::Record { scene, words, .. }) => Some((scene, words)),
        _ => None,
    });
    let (scene, words) = asked.expect("work for a recording");
    assert_eq!(ball(&session).x, 0.0, "the scene's own values are recorded");
    assert_eq!(scene, session.scene.whole_file(&session.loaded).to_text());
    let line = ["glint", "record", "scene.toml"].map(std::ffi::OsString::from).into_iter().chain(words);
    let Some(Command::Record(arguments)) = CommandLine::try_parse_from(line).unwrap().command else {
        panic!("no record")
    };
    assert_eq!((arguments.size, arguments.fps, arguments.frames), ([320, 240], 25, Some(10..20)));
    assert_eq!((arguments.subframes, arguments.shutter, arguments.supersample), (4, 0.5, 1));
    assert_eq!((arguments.path.as_deref(), arguments.output.to_str()), (Some("mirror sweep"), Some("a film.mp4")));
    // The film reports its progress and its end.
    let stage =
        |done| Found::Recording(crate::system::progress_bar::Stage { task: "recording".into(), done, total: 10 });
    session.on_found(stage(0));
    session.outside.now += Duration::from_secs(4);
    session.on_found(stage(2));
    let under_way = session.filming.recording.under_way.as_ref().unwrap();
    let now = session.outside.now;
    assert_eq!((under_way.rate(now), under_way.seconds_left(now)), (Some(0.5), Some(16.0)));
    film(&mut session, Film::StopRecording);
    session.on_found(Found::Recorded(Ended::Stopped));
    assert!(session.filming.recording.under_way.is_none());
    assert!(session.outside.messages.all.last().unwrap().text.contains("goes on from there"));
    // The dialog asks for the same one, so that it does, whether or not it was closed before.
    film(&mut session, Film::AskRecording);
    film(&mut session, Film::ChangeRecording(None));
    film(&mut session, Film::AskRecording);
    let again = session.filming.recording.asked.clone().unwrap();
    assert_eq!((again.size, again.fps, again.output.as_str()), ([320, 240], 25, "a film.mp4"));
}

fn harness() -> Harness<'static, Session> {
    Harness::builder().with_size([1280.0, 800.0]).with_max_steps(16).build_ui_state(
        |ui, session: &mut Session| {
            let mut actions = interface::show(ui, session, None);
            actions.retain(|action| !matches!(action, Action::Resize(_)));
            session.act_all(actions);
            session.step(session.outside.now, false);
        },
        Session::with_two_points(),
    )
}

#[test]
fn the_window_is_recorded_into_what_was_chosen_last() {
    let mut session = Session::with_two_points();
    for (format, extension) in [(CaptureFormat::Gif, "gif"), (CaptureFormat::Pictures, ""), (CaptureFormat::Mp4, "mp4")]
    {
        film(&mut session, Film::CaptureAs(format));
        assert_eq!(session.preferences.capture, format);
        session.outside.effects.clear();
        film(&mut session, Film::Capture);
        let begun = session.outside.effects.iter().find_map(|effect| match effect {
            Effect::Capture(Some((name, format, _))) => Some((name.clone(), *format)),
            _ => None,
        });
        let (name, begun) = begun.expect("a recording of the window");
        assert_eq!((begun, name.extension().unwrap_or_default().to_str()), (format, Some(extension)));
        session.filming.live = None;
    }
}

#[test]
fn the_timeline_makes_a_path_with_keys_that_are_selected_and_deleted() {
    let mut harness = harness();
    harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::T);
    harness.run_ok();
    assert!(harness.query_by_label_contains("There is no path yet").is_some());
    film(harness.state_mut(), Film::Add(PathPreset::View));
    harness.run_ok();
    harness.get_by_label("Keyframe 1 at 0.00 s");
    // With one view there is no way to go at a speed, and the box says so.
    harness.get_by_label("Constant speed").hover();
    harness.run_ok();
    harness.step();
    let tells = |harness: &Harness<'_, Session>| harness.query_by_label_contains("from another place").is_some();
    assert!(tells(&harness));
    film(harness.state_mut(), Film::Scrub(0.0));
    harness.state_mut().filming.timeline.time = 2.0;
    harness.run_ok();
    harness.get_by_label("+ Keyframe").click();
    harness.run_ok();
    assert_eq!(path(harness.state()).keyframes.len(), 2);
    harness.get_by_label("Keyframe 2 at 2.00 s").click();
    harness.run_ok();
    assert_eq!(harness.state().filming.timeline.time, 2.0);
    harness.get_by_label("Stay").click();
    harness.run_ok();
    assert_eq!(path(harness.state()).duration(), 3.0);
    harness.get_by_label("Delete key").click();
    harness.run_ok();
    assert_eq!(path(harness.state()).keyframes.len(), 2);
    harness.get_by_label("Loop").click();
    harness.run_ok();
    assert!(path(harness.state()).is_loop);
    film(harness.state_mut(), Film::Key("sun.elevation".into()));
    harness.run_ok();
    harness.get_by_label("Delete track sun.elevation").click();
    harness.run_ok();
    assert!(path(harness.state()).tracks.is_empty());
    harness.state_mut().filming.timeline.time = 0.5;
    harness.get_by_label("+ Caption").click();
    harness.run_ok();
    let field = harness.get_by_label("Text of the caption");
    field.focus();
    field.type_text("{");
    harness.run_ok();
    let [caption] = &path(harness.state()).captions[..] else { panic!("one caption") };
    assert!(caption.text.contains('{') && (caption.start, caption.end) == (0.5, Some(3.5)), "{caption:?}");
    harness.get_by_label("Stays").click();
    harness.run_ok();
    assert_eq!(path(harness.state()).captions[0].end, None);
    harness.get_by_label("Caption 1 at 0.50 s");
    harness.get_by_label("Delete key").click();
    harness.run_ok();
    assert!(path(harness.state()).captions.is_empty());
    harness.get_by_label("Record…").click();
    harness.run_ok();
    assert!(harness.query_by_label("Record `path`").is_some());
    // What is typed is the name, and no shortcut.
    let before = harness.state().filming.recording.asked.clone().unwrap().output;
    assert!(harness.ctx.text_edit_focused());
    harness.get_by_label("File or folder").type_text("n");
    harness.run_ok();
    assert_ne!(harness.state().filming.recording.asked.clone().unwrap().output, before);
    // Keys that no field takes do nothing to the scene either, and Esc closes the dialog.
    harness.ctx.memory_mut(|memory| memory.stop_text_input());
    let objects = harness.state().scene.objects.clone();
    harness.key_press(egui::Key::K);
    harness.run_ok();
    assert!(harness.state().scene.objects == objects);
    harness.key_press(egui::Key::Escape);
    harness.run_ok();
    assert!(harness.state().filming.recording.asked.is_none());
    harness.get_by_label("Close the timeline").click();
    harness.run_ok();
    assert!(!harness.state().filming.timeline.is_open);
}

#[test]
fn a_digit_with_shift_keeps_and_flies_whatever_character_shift_makes_of_it() {
    let mut harness = harness();
    harness.state_mut().act(Action::OpenTab(Tab::Look));
    let press = |harness: &mut Harness<'static, Session>, key, physical_key, modifiers| {
        harness.event(egui::Event::Key {
            key,
            physical_key: Some(physical_key),
            pressed: true,
            repeat: false,
            modifiers,
        });
        harness.run_ok();
    };
    let keep = egui::Modifiers::COMMAND | egui::Modifiers::SHIFT;
    press(&mut harness, egui::Key::Exclamationmark, egui::Key::Num1, keep);
    assert_eq!(harness.state().scene.objects.bookmarks[0].digit, Some(1));
    harness.run_ok();
    harness.get_by_label("Fly to view");
    orbit(harness.state_mut());
    press(&mut harness, egui::Key::Exclamationmark, egui::Key::Num1, egui::Modifiers::SHIFT);
    assert!(harness.state().scene.flight.is_some());
    assert_ne!(harness.state().scene.settings.color.by, scene::ColorBy::Rgb, "Shift+1 is not 1");
}

#[test]
fn bookmarks_get_small_pictures_while_nothing_else_is_drawn() {
    let Some(mut bench) = Bench::with_sphere() else { return };
    bench.settle();
    film(&mut bench.session, Film::Keep(None));
    bench.settle();
    bench.session.act(Action::Orbit(DVec2::new(60.0, 0.0)));
    film(&mut bench.session, Film::Keep(None));
    bench.settle();
    let Session { scene, filming, .. } = &bench.session;
    let pictures: Vec<_> =
        scene.objects.bookmarks.iter().map(|bookmark| filming.thumbnails.of(bookmark).expect("a picture")).collect();
    assert!(pictures.len() == 2 && pictures[0].rgba != pictures[1].rgba);
    assert!(pictures[0].rgba.chunks(4).any(|pixel| pixel[..3] != pictures[0].rgba[..3]), "it shows something");
}
