//! Tests of the session with a scene file: saving, the question before unsaved work is lost, and work that a crash has
//! left.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use scene::{ClipShape, ColorBy, Filter, Measurement, MeasurementKind, Note, Object, Profile, SceneFile, Shape};

use crate::viewer::requests::action::{Action, Clipping, Filing, Film, PathPreset};
use crate::viewer::requests::autosave::{self, Keeper};
use crate::viewer::requests::outside::{Asked, Effect, News};
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::requests::work::{Found, Work};
use crate::viewer::session::Session;
use crate::viewer::session::document::Leaving;

/// A folder with a cloud of three points and a scene file of it, and a session that has opened that.
fn session() -> (tempfile::TempDir, Session) {
    let folder = tempfile::tempdir().unwrap();
    let cloud = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        end_header\n0 0 0\n1 0 0\n0 1 0\n";
    std::fs::write(folder.path().join("three.ply"), cloud).unwrap();
    std::fs::write(folder.path().join("hall.toml"), "clouds = [\"three.ply\"]\n").unwrap();
    let mut session = Session::new(Preferences::default());
    assert!(session.open(&[folder.path().join("hall.toml")]));
    settle(&mut session);
    (folder, session)
}

/// Loads what is to be loaded and does the work that needs no window, until nothing is left to do. Returns the other
/// effects.
fn settle(session: &mut Session) -> Vec<Effect> {
    let mut left = Vec::new();
    for _ in 0..20 {
        // Longer than a step of undo waits for the next change, and than unsaved work waits to be written.
        let now = session.outside.now + std::time::Duration::from_secs(4);
        session.step(now, false);
        for effect in std::mem::take(&mut session.outside.effects) {
            match effect {
                Effect::Load { inputs } => {
                    let job = world::start(inputs.clone(), &session.scene.settings, Default::default());
                    let (progress, mailbox) = (job.progress.clone(), job.mailbox.clone());
                    let id = session.loaded.add_job(&inputs, progress, mailbox, session.outside.now);
                    job.events.iter().for_each(|event| session.on_news(News::Loading(id, event, None)));
                }
                Effect::Work(work @ (Work::SaveScene { .. } | Work::Keep { .. } | Work::Place { .. })) => {
                    let found = std::cell::RefCell::new(Vec::new());
                    work.run(&session.scene.settings.stream.clone(), |news| found.borrow_mut().push(news));
                    found.into_inner().into_iter().for_each(|news| session.on_found(news));
                }
                other => left.push(other),
            }
        }
    }
    left
}

fn title(session: &Session) -> String {
    session.document.title(session.is_unsaved(), &session.loaded)
}

fn asked_place(effects: &[Effect]) -> Option<PathBuf> {
    effects.iter().find_map(|effect| match effect {
        Effect::AskPlace(Asked::Scene, proposed) => Some(proposed.clone()),
        _ => None,
    })
}

#[test]
fn a_scene_file_is_saved_in_its_place_and_the_title_tells_what_is_unsaved() {
    let (folder, mut session) = session();
    assert_eq!(title(&session), "hall.toml - 3 points - glint");
    session.act(Action::AddMirror(Shape::Sphere));
    assert_eq!(title(&session), "hall.toml* - 3 points - glint");
    session.act(Action::Undo);
    assert_eq!(title(&session), "hall.toml - 3 points - glint", "nothing is left to save");
    session.act(Action::Redo);
    session.act(Action::File(Filing::Save));
    assert_eq!(asked_place(&settle(&mut session)), None, "its place is known");
    assert_eq!(title(&session), "hall.toml - 3 points - glint");
    let text = std::fs::read_to_string(folder.path().join("hall.toml")).unwrap();
    assert!(text.contains("clouds = [\"three.ply\"]") && text.contains("[[mirrors]]"), "{text}");
    // Under another name, where no dialog asks whether a file may be replaced.
    session.act(Action::File(Filing::SaveAs));
    assert!(asked_place(&settle(&mut session)).is_some());
    session.act(Action::File(Filing::SaveTo(folder.path().join("hall"))));
    let said = session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default();
    assert!(said.contains("a file of this name is there"), "{said}");
    session.act(Action::File(Filing::SaveTo(folder.path().join("other"))));
    settle(&mut session);
    assert_eq!(title(&session), "other.toml - 3 points - glint");
    let sessions: Vec<&str> = session.preferences.sessions.iter().filter_map(|path| path.rsplit('/').next()).collect();
    assert_eq!(sessions, ["other.toml", "hall.toml"]);
}

#[test]
fn a_file_that_another_program_has_changed_is_replaced_only_where_a_person_says_so() {
    let (folder, mut session) = session();
    let file = folder.path().join("hall.toml");
    let text = || std::fs::read_to_string(&file).unwrap();
    session.act(Action::AddMirror(Shape::Sphere));
    let change = || {
        let noted = text() + "[[notes]]\ntext = \"a door\"\nposition = [0.0, 0.0, 0.0]\n";
        std::fs::write(&file, &noted).unwrap();
        noted
    };
    let noted = change();
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(session.document.asks_to_replace && session.is_unsaved());
    assert_eq!(text(), noted, "nothing is written yet");
    session.act(Action::File(Filing::Stay));
    assert!(!session.document.asks());
    // Neither where the window was to close.
    session.act(Action::Quit);
    session.act(Action::File(Filing::SaveAndLeave));
    settle(&mut session);
    assert!(session.document.asks_to_replace && !session.wants_to_quit);
    assert_eq!(text(), noted);
    // Elsewhere: the file stays, and the window leaves as it was told to.
    session.act(Action::File(Filing::SaveAs));
    assert!(asked_place(&settle(&mut session)).is_some() && !session.document.asks());
    session.act(Action::File(Filing::SaveTo(folder.path().join("other.toml"))));
    settle(&mut session);
    assert!(session.wants_to_quit && text() == noted);
    // What this window has written is its own, and what it was told to replace is replaced.
    session.act(Action::File(Filing::SaveTo(file.clone())));
    settle(&mut session);
    assert!(text().contains("[[mirrors]]") && !text().contains("[[notes]]"));
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(!session.document.asks() && !session.is_unsaved());
    let noted = change();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert_eq!(text(), noted);
    session.act(Action::File(Filing::Replace));
    settle(&mut session);
    assert!(!session.document.asks() && !session.is_unsaved() && !text().contains("[[notes]]"));
    // A file that is gone is made anew.
    std::fs::remove_file(&file).unwrap();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(!session.is_unsaved() && text().contains("[[mirrors]]"));
}

#[test]
fn a_file_that_was_changed_between_reading_and_opening_is_known_as_it_was_read() {
    let (folder, mut session) = session();
    let file = folder.path().join("hall.toml");
    session = Session::new(session.preferences.clone());
    // A slow start reads the file seconds before the window is there.
    let request = world::resolve(&[&file]);
    let noted = "clouds = [\"three.ply\"]\n[[notes]]\ntext = \"a door\"\nposition = [0.0, 0.0, 0.0]\n";
    std::fs::write(&file, noted).unwrap();
    session.open_request(request);
    settle(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(session.document.asks_to_replace && session.is_unsaved());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), noted);
}

#[cfg(unix)]
#[test]
fn a_scene_behind_a_link_is_saved_in_its_file_and_opens_by_both_names() {
    let (folder, _) = session();
    std::fs::create_dir(folder.path().join("links")).unwrap();
    let (file, link) = (folder.path().join("hall.toml"), folder.path().join("links/hall.toml"));
    std::os::unix::fs::symlink("../hall.toml", &link).unwrap();
    let cloud = folder.path().join("three.ply");
    std::fs::write(&file, format!("clouds = [{:?}]\n", cloud.display().to_string())).unwrap();
    let mut session = Session::new(Preferences::default());
    assert!(session.open(std::slice::from_ref(&link)));
    settle(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(link.is_symlink() && !session.is_unsaved());
    for name in [file, link] {
        let (scene, clouds) = SceneFile::read(&name).unwrap();
        assert_eq!((scene.mirrors.len(), clouds.as_slice()), (1, &[cloud.clone()][..]), "{}", name.display());
    }
}

#[cfg(unix)]
#[test]
fn recent_files_are_found_from_every_folder() {
    let (folder, _) = session();
    let here = std::env::current_dir().unwrap();
    let root: PathBuf = here.components().skip(1).map(|_| "..").collect();
    let cloud = root.join(folder.path().strip_prefix("/").unwrap()).join("three.ply");
    assert!(cloud.is_relative());
    let mut session = Session::new(Preferences::default());
    assert!(session.open(std::slice::from_ref(&cloud)));
    settle(&mut session);
    assert_eq!(session.preferences.recent, [here.join(cloud).display().to_string()]);
}

/// An object of each kind that is drawn over the picture.
fn marks() -> [Object; 3] {
    let (points, color) = (vec![DVec3::ZERO, DVec3::X], [1.0, 0.5, 0.0]);
    let (kind, name) = (MeasurementKind::Distance, "width".into());
    let measurement = Measurement { name, kind, on: true, color, points, reach: None, level: None };
    let note = Note { text: "a door".into(), on: true, color, position: DVec3::X, camera: None };
    let profile = Profile { name: "wall".into(), ..Profile::new(vec![DVec3::ZERO, DVec3::ONE], 0.25) };
    [Object::Measurement(measurement), Object::Note(note), Object::Profile(profile)]
}

#[test]
fn the_last_cloud_takes_all_objects_along() {
    let mut session = Session::with_two_points();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::AddSpot);
    session.act(Action::Clip(Clipping::AroundAll(ClipShape::Box)));
    session.scene.add_objects(marks());
    assert_eq!(session.scene.objects.all().count(), 6);
    session.with_loaded(|loaded, beside| loaded.remove_cloud(loaded.clouds[0].key, beside));
    assert_eq!(session.scene.objects.all().count(), 0);
}

#[test]
fn a_saved_scene_brings_back_everything_that_a_person_has_made() {
    let (folder, mut session) = session();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::AddSpot);
    session.act(Action::Clip(Clipping::AroundAll(ClipShape::Box)));
    let filter = Filter { attribute: "intensity".into(), low: 1.0, high: 2.0 };
    session.act(Action::Clip(Clipping::Filter(vec![filter])));
    session.act(Action::ShowClasses(vec![7], false));
    for object in marks() {
        let id = session.scene.next_object_id();
        session.scene.place(id, object, &mut session.outside);
    }
    session.scene.settings.splat.size = 2.5;
    let key = session.loaded.clouds[0].key;
    let mut own = session.loaded.own_settings(key, None);
    own.size = 1.5;
    own.set_color("by", "height");
    (own.shift, own.turn, own.about) = (DVec3::new(0.5, 0.0, 2.0), DVec3::Z * 30.0, Some(DVec3::X));
    session.act(Action::ChangeCloud(key, Box::new(own)));
    session.act(Action::ShowCloud(key, false));
    session.act(Action::Orbit(DVec2::new(40.0, 10.0)));
    settle(&mut session);
    session.act(Action::Film(Film::Keep(Some(3))));
    session.act(Action::Film(Film::Add(PathPreset::View)));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    let mut other = Session::new(Preferences::default());
    assert!(other.open(&[folder.path().join("hall.toml")]));
    settle(&mut other);
    let objects = |session: &Session| -> Vec<(String, Object)> {
        session.scene.objects.all().map(|(_, name, object)| (name.to_owned(), object)).collect()
    };
    // A light has no name in a file.
    let unnamed = |objects: Vec<(String, Object)>| -> Vec<Object> { objects.into_iter().map(|(_, o)| o).collect() };
    assert_eq!(unnamed(objects(&other)), unnamed(objects(&session)));
    assert_eq!(objects(&other).len(), 6);
    let films = |session: &Session| (session.scene.objects.bookmarks.clone(), session.scene.objects.paths.clone());
    assert!(films(&other) == films(&session) && films(&other).0.len() == 1 && films(&other).1.len() == 1);
    assert_eq!(other.scene.objects.visibility, session.scene.objects.visibility);
    let own = |session: &Session| session.scene.objects.own_settings[0].settings.clone();
    assert_eq!((own(&other).on, own(&other).size, own(&other).color), (false, 1.5, own(&session).color));
    let placement = |session: &Session| session.loaded.clouds[0].placement();
    assert!(placement(&other).is_some() && placement(&other) == placement(&session));
    assert_eq!((other.loaded.clouds[0].is_visible, other.loaded.clouds[0].size), (false, 1.5));
    assert_eq!((&other.scene.settings, other.scene.camera), (&session.scene.settings, session.scene.camera));
    assert!(!other.is_unsaved());
    let before = std::fs::read_to_string(folder.path().join("hall.toml")).unwrap();
    other.act(Action::File(Filing::Save));
    settle(&mut other);
    assert_eq!(std::fs::read_to_string(folder.path().join("hall.toml")).unwrap(), before, "saved again it is the same");
}

#[test]
fn a_file_that_a_person_wrote_keeps_its_comments_when_it_is_saved() {
    let (folder, _) = session();
    let place = folder.path().join("hall.toml");
    std::fs::write(&place, "# The hall, first floor.\nclouds = [\"three.ply\"] # of May\n").unwrap();
    let mut session = Session::new(Preferences::default());
    assert!(session.open(std::slice::from_ref(&place)));
    settle(&mut session);
    session.act(Action::AddMirror(Shape::Sphere));
    for mirrors in [1, 2] {
        session.act(Action::File(Filing::Save));
        settle(&mut session);
        let text = std::fs::read_to_string(&place).unwrap();
        assert!(text.starts_with("# The hall, first floor.\nclouds = [\"three.ply\"] # of May\n"), "{text}");
        assert_eq!(SceneFile::parse(&text).unwrap().mirrors.len(), mirrors);
        session.act(Action::AddMirror(Shape::Sphere));
    }
}

#[test]
fn work_that_cannot_be_kept_is_told_once_and_tried_again() {
    let (_folder, mut session) = session();
    session.document.keeper = Some(Keeper::new("/dev/null/unsaved".into()));
    session.act(Action::AddMirror(Shape::Sphere));
    let tries = |session: &mut Session, seconds: u64| {
        session.outside.effects.clear();
        session.step(session.outside.now + std::time::Duration::from_secs(seconds), false);
        session.outside.effects.iter().filter(|effect| matches!(effect, Effect::Work(Work::Keep { .. }))).count()
    };
    let told = |session: &Session| -> Vec<String> {
        let all = session.outside.messages.all.iter().map(|message| message.text.clone());
        all.filter(|text| text.starts_with("Unsaved work")).collect()
    };
    assert_eq!(tries(&mut session, 4), 1);
    session.document.on_kept(Err("the disk is full".into()), &mut session.outside);
    assert_eq!((tries(&mut session, 4), tries(&mut session, 30)), (0, 1));
    session.document.on_kept(Err("the disk is full".into()), &mut session.outside);
    let [only] = told(&session).try_into().unwrap();
    assert!(only.contains("tried again every 30 s") && only.ends_with("the disk is full"), "{only}");
    assert_eq!(tries(&mut session, 31), 1);
    session.document.on_kept(Ok(()), &mut session.outside);
    assert_eq!(told(&session)[1..], ["Unsaved work is kept against a crash again"]);
    assert_eq!(tries(&mut session, 31), 0);
}

#[test]
fn leaving_with_unsaved_work_asks_and_leaves_only_once_it_is_saved_or_given_up() {
    let (folder, mut session) = session();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::Quit);
    assert!(session.document.asked == Some(Leaving::Quit) && !session.wants_to_quit);
    session.act(Action::File(Filing::Stay));
    assert!(session.document.asked.is_none() && !session.wants_to_quit);
    // The file cannot be written.
    let place = session.document.place.clone().unwrap();
    session.act(Action::Quit);
    session.act(Action::File(Filing::SaveAndLeave));
    session.outside.effects.clear();
    session.on_found(Found::SceneSaved { path: place, result: Err("the disk is full".into()) });
    assert!(session.is_unsaved() && !session.wants_to_quit);
    assert_eq!(asked_place(&session.outside.effects), None, "its place is known");
    let elsewhere = folder.path().join("full/hall.toml");
    session.act(Action::File(Filing::SaveTo(elsewhere.clone())));
    session.outside.effects.clear();
    session.on_found(Found::SceneSaved { path: elsewhere.clone(), result: Err("the disk is full".into()) });
    assert_eq!(asked_place(&session.outside.effects), Some(elsewhere), "the typed path is not lost");
    session.act(Action::Quit);
    session.act(Action::File(Filing::SaveAndLeave));
    settle(&mut session);
    assert!(session.wants_to_quit);
    assert!(std::fs::read_to_string(folder.path().join("hall.toml")).unwrap().contains("[[mirrors]]"));

    session.wants_to_quit = false;
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::Quit);
    session.act(Action::File(Filing::Discard));
    assert!(session.wants_to_quit);
}

#[test]
fn a_scene_without_a_file_asks_for_a_place_and_stays_if_none_is_chosen() {
    let (folder, _) = session();
    let mut session = Session::new(Preferences::default());
    assert!(session.open(&[folder.path().join("three.ply")]));
    settle(&mut session);
    // Looking at a cloud is no work, in whatever colours.
    let key = session.loaded.clouds[0].key;
    let mut own = session.loaded.own_settings(key, None);
    own.set_color("by", "height");
    session.act(Action::Orbit(DVec2::new(40.0, 10.0)));
    session.act(Action::ColorBy(ColorBy::Height));
    session.act(Action::ShowClasses(vec![7], false));
    session.act(Action::ChangeCloud(key, Box::new(own)));
    settle(&mut session);
    assert!(!session.is_unsaved());
    session.act(Action::Quit);
    assert!(session.document.asked.is_none() && std::mem::take(&mut session.wants_to_quit));
    // What a person has placed is, until it is taken away again.
    session.act(Action::Clip(Clipping::AroundAll(ClipShape::Box)));
    session.act(Action::Quit);
    assert!(session.is_unsaved() && session.document.asked.take().is_some() && !session.wants_to_quit);
    session.act(Action::Delete);
    settle(&mut session);
    assert!(session.scene.objects.clips.is_empty() && !session.is_unsaved(), "nothing is left to save");
    session.act(Action::AddMirror(Shape::Sphere));
    assert_eq!(title(&session), "three.ply* - 3 points - glint");
    session.act(Action::Quit);
    session.act(Action::File(Filing::SaveAndLeave));
    assert!(asked_place(&settle(&mut session)).is_some_and(|path| path.ends_with("glint-three-1.toml")));
    session.act(Action::File(Filing::NoPlace));
    session.act(Action::File(Filing::SaveTo(folder.path().join("later.toml"))));
    settle(&mut session);
    assert!(!session.is_unsaved() && !session.wants_to_quit, "the wish to quit went with the dialog");
    // The last cloud takes all objects with it.
    session.act(Action::AddMirror(Shape::Sphere));
    let key = session.loaded.clouds[0].key;
    session.act(Action::RemoveCloud(key));
    assert_eq!((session.document.asked.clone(), session.loaded.clouds.len()), (Some(Leaving::Close(key)), 1));
    session.act(Action::File(Filing::Discard));
    assert!(session.loaded.clouds.is_empty() && session.document.place.is_none() && !session.is_unsaved());
}

#[test]
fn a_cloud_that_cannot_be_read_today_stays_in_the_scene_file() {
    let (folder, mut session) = session();
    std::fs::write(folder.path().join("two.toml"), "clouds = [\"three.ply\", \"gone.laz\"]\n").unwrap();
    session.act(Action::File(Filing::Open(folder.path().join("two.toml"))));
    settle(&mut session);
    assert_eq!(title(&session), "two.toml - 3 points - glint");
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    let text = std::fs::read_to_string(folder.path().join("two.toml")).unwrap();
    assert_eq!(SceneFile::parse(&text).unwrap().clouds, ["three.ply", "gone.laz"]);
}

#[test]
fn another_scene_takes_the_place_of_one_that_is_saved() {
    let (folder, mut session) = session();
    let ball = "clouds = [\"three.ply\"]\n[parameters]\n\"splat.size\" = 3.0\n";
    std::fs::write(folder.path().join("ball.toml"), ball).unwrap();
    session.act(Action::AddMirror(Shape::Sphere));
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    session.act(Action::File(Filing::Open(folder.path().join("gone.toml"))));
    assert_eq!(session.loaded.clouds.len(), 1, "what is open stays when the other cannot be read");
    session.act(Action::File(Filing::Open(folder.path().join("ball.toml"))));
    settle(&mut session);
    assert_eq!(title(&session), "ball.toml - 3 points - glint");
    assert!(session.scene.objects.mirrors.is_empty() && session.loaded.clouds.len() == 1);
    assert_eq!(session.scene.settings.splat.size, 3.0);
}

/// The work that other runs have left.
fn left(folder: &Path) -> usize {
    autosave::abandoned(folder).len()
}

#[test]
fn restored_work_goes_on_naming_a_cloud_that_is_missing_today() {
    let (folder, _) = session();
    let [here, away] = ["three.ply", "four.ply"].map(|name| folder.path().join(name));
    std::fs::copy(&here, &away).unwrap();
    let kept = folder.path().join("unsaved");
    let mut crashed = Session::new(Preferences::default());
    crashed.document.keeper = Some(Keeper::new(kept.clone()));
    assert!(crashed.open(&[&here, &away]));
    settle(&mut crashed);
    crashed.act(Action::AddMirror(Shape::Sphere));
    settle(&mut crashed);
    drop(crashed);
    std::fs::rename(&away, folder.path().join("elsewhere")).unwrap();

    let restored = || {
        let mut session = Session::new(Preferences::default());
        session.document.keeper = Some(Keeper::new(kept.clone()));
        session.document.abandoned = autosave::abandoned(&kept);
        session.act(Action::File(Filing::Restore));
        settle(&mut session);
        session
    };
    assert_eq!(restored().loaded.clouds.len(), 1);
    std::fs::rename(folder.path().join("elsewhere"), &away).unwrap();
    assert_eq!(restored().loaded.clouds.len(), 2, "the work was written anew without the cloud");
}

#[test]
fn unsaved_work_is_kept_restored_after_a_crash_and_gone_when_it_is_saved() {
    let (folder, mut crashed) = session();
    let kept = folder.path().join("unsaved");
    crashed.document.keeper = Some(Keeper::new(kept.clone()));
    settle(&mut crashed);
    assert!(!kept.exists(), "there is nothing to keep");
    crashed.act(Action::AddMirror(Shape::Sphere));
    settle(&mut crashed);
    assert_eq!(left(&kept), 0, "its program runs");
    drop(crashed);
    // Another program saves the same scene.
    let file = folder.path().join("hall.toml");
    let noted = std::fs::read_to_string(&file).unwrap() + "[[notes]]\ntext = \"a door\"\nposition = [0.0, 0.0, 0.0]\n";
    std::fs::write(&file, &noted).unwrap();

    let mut session = Session::new(Preferences::default());
    session.document.keeper = Some(Keeper::new(kept.clone()));
    session.document.abandoned = autosave::abandoned(&kept);
    assert_eq!(session.document.abandoned.len(), 1);
    assert_eq!(left(&kept), 0, "another start is not offered the same");
    session.act(Action::File(Filing::Restore));
    settle(&mut session);
    assert_eq!(title(&session), "hall.toml* - 3 points - glint");
    assert_eq!(session.scene.objects.mirrors.len(), 1);
    let files = |kept: &Path| std::fs::read_dir(kept).unwrap().count();
    assert_eq!(files(&kept), 2, "this program's own file and its lock have replaced those of the other");
    session.act(Action::File(Filing::Save));
    settle(&mut session);
    assert!(session.document.asks_to_replace);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), noted);
    session.act(Action::File(Filing::Replace));
    settle(&mut session);
    assert!(std::fs::read_to_string(&file).unwrap().contains("[[mirrors]]"));
    assert_eq!(files(&kept), 1, "the lock alone");
    session.document.end(false, &session.scene, &session.loaded);
    assert_eq!(files(&kept), 0);
}
