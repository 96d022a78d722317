use glam::DVec3;
use scene::{Mirror, Object, Shape};

use super::tests::{add_ball, film, later, path};
use super::*;
use crate::viewer::requests::action::PathPreset;
use crate::viewer::session::Session;

#[test]
fn a_track_that_names_nothing_is_told_and_the_scene_stays() {
    let mut session = Session::with_two_points();
    add_ball(&mut session);
    film(&mut session, Film::Add(PathPreset::MirrorSweep));
    session.scene.edit_objects(session.outside.now, |objects| objects.mirrors.clear());
    let settings = session.scene.settings.clone();
    film(&mut session, Film::Scrub(1.0));
    later(&mut session, 0.1);
    let told = &session.outside.messages.all.last().unwrap().text;
    assert!(told.contains("path `mirror sweep`, track 1: no mirror is called `ball`"), "{told}");
    assert!(session.scene.posed.is_none() && session.scene.settings == settings);
}

/// The keys of the tracks of the path.
fn keys(session: &Session) -> Vec<&str> {
    path(session).tracks.iter().map(|track| track.key.as_str()).collect()
}

#[test]
fn tracks_of_a_light_that_is_removed_go_and_those_of_later_ones_get_their_new_numbers() {
    let mut session = Session::with_two_points();
    for _ in 0..3 {
        session.act(Action::AddSpot);
    }
    film(&mut session, Film::Add(PathPreset::View));
    for number in [2, 3, 1] {
        film(&mut session, Film::Key(format!("lights.{number}.intensity")));
    }
    film(&mut session, Film::Key("sun.elevation".into()));
    let third = session.scene.objects.lights[2].id;
    session.scene.selected = Some(session.scene.objects.lights[0].id);
    session.act(Action::Delete);
    assert_eq!(keys(&session), ["lights.1.intensity", "lights.2.intensity", "sun.elevation"]);
    assert_eq!(session.scene.objects.named("light", "2").unwrap().0, third);
    let told = &session.outside.messages.all.last().unwrap().text;
    assert_eq!(told, "Tracks of paths that are removed with it: 1");
    session.act(Action::Undo);
    let all = ["lights.2.intensity", "lights.3.intensity", "lights.1.intensity", "sun.elevation"];
    assert_eq!((keys(&session), session.scene.objects.lights.len()), (all.to_vec(), 3), "one step of undo");
    session.act(Action::Redo);
    assert_eq!(keys(&session).len(), 3);
}

#[test]
fn tracks_follow_an_object_that_is_renamed_and_names_stay_apart() {
    let mut session = Session::with_two_points();
    add_ball(&mut session);
    add_ball(&mut session);
    let second = session.scene.selected.unwrap();
    film(&mut session, Film::Add(PathPreset::View));
    film(&mut session, Film::Key("mirrors.ball.position".into()));
    film(&mut session, Film::Key("mirrors.ball 2.position".into()));
    later(&mut session, 1.0);
    let rename = |session: &mut Session, name: &str| {
        let renamed = Mirror { name: name.into(), ..session.scene.objects.mirror(second).unwrap().clone() };
        session.act(Action::ChangeObject(second, Box::new(Object::Mirror(renamed))));
        later(session, 1.0);
        later(session, 1.0);
    };
    rename(&mut session, "v1.5 ball");
    assert_eq!(keys(&session), ["mirrors.ball.position", "mirrors.v1.5 ball.position"]);
    film(&mut session, Film::Scrub(0.0));
    later(&mut session, 0.1);
    assert!(session.scene.posed.is_some() && session.outside.messages.all.is_empty());
    film(&mut session, Film::Toggle);
    rename(&mut session, "ball");
    assert_eq!(keys(&session), ["mirrors.ball.position", "mirrors.ball 2.position"], "a name is given once");
    session.act(Action::Undo);
    assert_eq!(keys(&session), ["mirrors.ball.position", "mirrors.v1.5 ball.position"]);
    assert_eq!(session.scene.objects.mirror(second).unwrap().name, "v1.5 ball", "in the same step");
}

#[test]
fn the_tracks_of_a_mirror_that_a_scene_brought_go_with_it_when_that_is_closed() {
    let mut session = Session::with_two_points();
    let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
    let opened = world::Opened { name: "b.ply".into(), input: "b.ply".into(), ..Default::default() };
    let opened = world::Event::Opened { cloud: 0, opened };
    session.with_loaded(|loaded, beside| loaded.on_loading(job, opened, beside));
    let of_scene = Mirror::standing(Shape::Sphere, DVec3::X, DVec3::Z, DVec3::Z, 0.5);
    let of_scene = Mirror { name: "its own".into(), ..of_scene };
    session.scene.bring_mirror(of_scene, Some("b.ply".into()), &mut session.outside);
    film(&mut session, Film::Add(PathPreset::View));
    for key in ["mirrors.its own.position", "sun.elevation"] {
        film(&mut session, Film::Key(key.into()));
    }
    assert_eq!(keys(&session).len(), 2);
    let key = session.loaded.clouds.iter().find(|entry| entry.input == "b.ply").unwrap().key;
    session.act(Action::RemoveCloud(key));
    let told = &session.outside.messages.all.last().unwrap().text;
    assert_eq!(told, "Tracks of paths that are removed with it: 1");
    assert_eq!(keys(&session), ["sun.elevation"]);
}
