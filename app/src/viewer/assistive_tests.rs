//! Tests of what assistive programs, such as screen readers, are given: each control has a role and a name.

use std::collections::BTreeSet;

use egui::accesskit::{Action as Asked, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use glam::DVec3;
use scene::{ClipShape, Filter, Measurement, MeasurementKind, Note, Object, Profile, Shape};

use crate::viewer::interface;
use crate::viewer::look::tab::Tab;
use crate::viewer::look::theme;
use crate::viewer::panels::streaming::tests::indexing;
use crate::viewer::requests::action::{Action, Clipping, Filing, Film, KeptStep, Measuring, PathPreset, SavePicture};
use crate::viewer::requests::preferences::Preferences;
use crate::viewer::session::Session;

type Window = Harness<'static, Session>;

/// The whole window, higher than any, so that nothing is scrolled out of it.
fn window(session: Session) -> Window {
    let mut harness = Harness::builder().with_size([1280.0, 6000.0]).with_max_steps(32).build_ui_state(
        |ui, session: &mut Session| {
            theme::apply(ui.ctx());
            let mut actions = interface::show(ui, session, None);
            actions.retain(|action| !matches!(action, Action::Resize(_)));
            session.act_all(actions);
        },
        session,
    );
    harness.run_steps(3);
    harness
}

/// Opens every folded section.
fn unfold(harness: &mut Window) {
    for _ in 0..40 {
        let folded = |node: &egui_kittest::Node<'_>| {
            let data = node.accesskit_node();
            data.role() != Role::ComboBox && data.data().is_expanded() == Some(false)
        };
        let Some(()) = harness.root().children_recursive().find(folded).map(|node| node.click_accesskit()) else {
            return;
        };
        harness.run_steps(8);
    }
    panic!("sections stay folded");
}

/// Adds the controls that have no role or no name that can be read aloud. Returns the number of controls.
fn look(harness: &Window, place: &str, nameless: &mut BTreeSet<String>) -> usize {
    let mut count = 0;
    for node in harness.root().children_recursive() {
        let node = node.accesskit_node();
        if !node.data().supports_action(Asked::Focus) {
            continue;
        }
        count += 1;
        let name = node.label().or_else(|| node.placeholder().map(str::to_owned)).unwrap_or_default();
        let name = if node.role() == Role::Label { node.value().unwrap_or(name) } else { name };
        let has_role = !matches!(node.role(), Role::Unknown | Role::GenericContainer);
        if !has_role || !name.chars().any(char::is_alphanumeric) {
            let at = node.bounding_box().map(|at| [at.x0, at.y0, at.x1, at.y1].map(|side| side as i32));
            nameless.insert(format!("{place}: {:?} {name:?} {:?} at {at:?}", node.role(), node.value()));
        }
    }
    count
}

fn all_kinds() -> Session {
    let mut session = Session::with_two_points();
    for shape in Shape::WITH_FORMULA {
        session.act(Action::AddMirror(shape));
    }
    session.act(Action::AddSpot);
    for shape in [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab] {
        session.act(Action::Clip(Clipping::AroundAll(shape)));
    }
    session.act(Action::Clip(Clipping::Filter(vec![Filter { attribute: "intensity".into(), low: 1.0, high: 2.0 }])));
    let (points, color) = (vec![DVec3::ZERO, DVec3::X], [1.0, 0.5, 0.0]);
    let (kind, name) = (MeasurementKind::Distance, "width".into());
    let measurement = Measurement { name, kind, on: true, color, points, reach: None, level: None };
    let note = Note { text: "a door".into(), on: true, color, position: DVec3::X, camera: None };
    let profile = Profile { name: "wall".into(), ..Profile::new(vec![DVec3::ZERO, DVec3::ONE], 0.25) };
    session.scene.add_objects([Object::Measurement(measurement), Object::Note(note), Object::Profile(profile)]);
    session
}

#[test]
fn every_control_of_every_tab_has_a_role_and_a_name() {
    let mut nameless = BTreeSet::new();
    let streamed = {
        let (session, _) = indexing();
        session
    };
    for (state, session) in
        [("empty", Session::new(Preferences::default())), ("all kinds", all_kinds()), ("streamed", streamed)]
    {
        let mut harness = window(session);
        let selections: Vec<_> = harness.state().scene.objects.all().map(|(id, ..)| id).collect();
        for tab in Tab::ALL {
            harness.state_mut().act(Action::OpenTab(tab));
            harness.run_steps(3);
            unfold(&mut harness);
            for selected in selections.iter().copied().map(Some).chain([None]) {
                harness.state_mut().act(Action::Select(selected));
                harness.run_steps(3);
                harness.state_mut().act(Action::OpenTab(tab));
                harness.run_steps(3);
                unfold(&mut harness);
                let place = format!("{state}, {}, {selected:?}", tab.name());
                assert!(look(&harness, &place, &mut nameless) > 20, "{place}");
            }
        }
    }
    assert!(nameless.is_empty(), "{nameless:#?}");
}

#[test]
fn every_parameter_of_every_method_has_a_name() {
    let mut nameless = BTreeSet::new();
    let mut harness = window(Session::with_two_points());
    harness.state_mut().act(Action::OpenTab(Tab::Tuning));
    harness.run_steps(3);
    unfold(&mut harness);
    for row in scene::METHODS {
        harness.state_mut().scene.settings.reflection.method = row.method;
        harness.run_steps(3);
        look(&harness, row.name, &mut nameless);
    }
    // A word that every group of parameters has: all tables at once.
    harness.state_mut().act(Action::Search("e".into()));
    harness.run_steps(3);
    assert!(look(&harness, "search", &mut nameless) > 100);
    assert!(nameless.is_empty(), "{nameless:#?}");
}

#[test]
fn every_control_of_the_windows_over_the_picture_has_a_role_and_a_name() {
    let mut nameless = BTreeSet::new();
    let openings: Vec<(&str, Vec<Action>)> = vec![
        ("timeline", vec![Action::Film(Film::Add(PathPreset::View))]),
        ("wipe", vec![Action::Film(Film::Add(PathPreset::WipeToTruth))]),
        ("recording", vec![Action::Film(Film::Add(PathPreset::View)), Action::Film(Film::AskRecording)]),
        ("bookmarks", vec![Action::Film(Film::Keep(None)), Action::OpenTab(Tab::Look)]),
        ("palette", vec![Action::TogglePalette]),
        ("prompt", vec![Action::OpenPrompt]),
        ("shortcuts", vec![Action::ToggleShortcuts]),
        ("messages", vec![Action::Open("nothing.here".into()), Action::ListMessages(true)]),
        ("sweep", vec![Action::AskSweep("splat.size".into())]),
        ("chart", vec![Action::ToggleChart]),
        ("picture", vec![Action::SavePicture(SavePicture::Ask)]),
        ("leaving", vec![Action::AddMirror(Shape::Sphere), Action::Quit]),
        (
            "kept",
            vec![Action::Kept(KeptStep::Keep), Action::Kept(KeptStep::ToggleBeside), Action::OpenTab(Tab::Measure)],
        ),
        ("placing", vec![Action::Measuring(Measuring::Begin(MeasurementKind::Area))]),
        ("truth", vec![Action::PinTruth]),
        ("save", vec![Action::File(Filing::Save)]),
    ];
    for (place, actions) in openings {
        let mut harness = window(all_kinds());
        let before = look(&harness, "at rest", &mut nameless);
        harness.state_mut().act_all(actions);
        harness.run_steps(8);
        unfold(&mut harness);
        let after = look(&harness, place, &mut nameless);
        let opens = !matches!(place, "placing" | "truth" | "save");
        assert!(!opens || after != before, "{place} opens nothing");
    }
    let mut harness = window(all_kinds());
    harness.get_by_label("Recent").click();
    harness.run_steps(3);
    look(&harness, "Recent", &mut nameless);
    assert!(nameless.is_empty(), "{nameless:#?}");
}

/// The ring around the control that has the keyboard, if there is one.
fn ring(harness: &Window) -> Option<egui::Rect> {
    let shapes = harness.output().shapes.iter();
    let mut rings = shapes.filter_map(|clipped| match &clipped.shape {
        egui::Shape::Rect(rect) if rect.stroke.color == theme::ACCENT && rect.stroke.width == 1.5 => Some(rect.rect),
        _ => None,
    });
    let first = rings.next();
    assert!(rings.next().is_none(), "one ring");
    first
}

#[test]
fn no_ring_stands_beside_a_window_that_is_still_measured() {
    for opening in [Action::TogglePalette, Action::Quit] {
        let mut harness = window(all_kinds());
        harness.state_mut().act_all([Action::AddMirror(Shape::Sphere), opening.clone()]);
        let mut rings = Vec::new();
        for _ in 0..8 {
            harness.run_steps(1);
            rings.extend(ring(&harness));
        }
        let focused = harness.root().children_recursive().find(|node| node.is_focused()).expect("a control").rect();
        assert!(rings.len() > 2, "{opening:?}");
        for ring in rings {
            assert!(ring.center().distance(focused.center()) < 4.0, "{opening:?}: {ring} {focused}");
        }
    }
}

#[test]
fn a_ring_surrounds_the_control_that_has_the_keyboard_and_nothing_else() {
    let mut harness = window(all_kinds());
    assert_eq!(ring(&harness), None);
    let mut places = Vec::new();
    for _ in 0..30 {
        harness.key_press(egui::Key::Tab);
        harness.run_steps(2);
        let focused = harness.root().children_recursive().find(|node| node.is_focused()).expect("a control").rect();
        let around = ring(&harness).expect("a ring");
        assert!(around.contains_rect(focused.shrink(1.0)), "{around} around {focused}");
        places.push(around);
    }
    places.dedup();
    assert_eq!(places.len(), 30, "Tab leads from one control to the next");
    harness.key_press(egui::Key::Escape);
    harness.run_steps(2);
    assert_eq!(ring(&harness), None);
}
