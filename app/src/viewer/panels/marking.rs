//! The panel that turns points of a cloud into a mirror: which points, how many they are, how they reflect.

use cloud::Scalar;
use egui::{RichText, Ui};
use scene::PointChoice;

use crate::shared::language::{text, translated};
use crate::viewer::loaded::streams;
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::typed::{typed_limit, typed_number};
use crate::viewer::look::widgets::{choice, length, name_label, number_field_in_words, number_slider, plain, slider};
use crate::viewer::objects::Marking;
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::panels::mirrors;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::draft::{Draft, NORMALS_WAYS, NormalsWay, WAYS, Way};
use crate::viewer::session::Session;

/// Draws the choice of points, and the list of points that reflect already.
pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    existing(ui, session, actions);
    if session.loaded.clouds.is_empty() {
        ui.label(RichText::new(text!("Open a cloud to turn some of its points into a mirror.")).color(theme::WEAK));
        return;
    }
    let radius = session.bounds().radius();
    let picked = session.tools.pick.as_ref().map(|pick| (pick.point.chunk.cloud, pick.world));
    let mut draft = session.tools.draft.clone();
    if draft.edge == 0.0 && radius > 0.0 {
        // The box starts at a tenth of the scene's radius, and the neighbourhood at about a dozen points of a scan.
        (draft.edge, draft.radius) = (radius * 0.1, radius * 0.005);
    }
    let known = draft.cloud.filter(|key| session.loaded.clouds.iter().any(|entry| entry.key == *key));
    let at_pick = picked.map(|(key, _)| key).filter(|key| session.loaded.clouds.iter().any(|entry| entry.key == *key));
    let mut key = match draft.way {
        Way::Box => at_pick.or(known),
        _ => known,
    }
    .unwrap_or(session.loaded.clouds[0].key);
    choice(
        ui,
        text!("Cloud"),
        &mut key,
        session.loaded.clouds.iter().map(|entry| (entry.key, entry.cloud.name.as_str())),
    );
    draft.cloud = Some(key);
    let Some(entry) = session.loaded.cloud(key) else { return };
    if entry.streamed.is_some() {
        ui.label(RichText::new(format!("{} {}.", entry.cloud.name, streams::NOT_MARKED)).color(theme::WEAK));
    } else {
        choose(ui, session, entry, &mut draft, actions);
    }
    draft.suit_material(&session.tools.draft);
    if draft != session.tools.draft {
        actions.push(Action::ChangeDraft(Box::new(draft)));
    }
}

/// Lets the user choose points of a cloud, and how they will reflect.
fn choose(ui: &mut Ui, session: &Session, entry: &CloudEntry, draft: &mut Draft, actions: &mut Vec<Action>) {
    let radius = session.bounds().radius();
    let picked = session.tools.pick.as_ref().map(|pick| pick.world);
    choice(ui, text!("Points"), &mut draft.way, WAYS.into_iter().map(|(way, name)| (way, translated(name))));
    which_points(ui, draft, entry, radius, picked.is_some());
    choice(
        ui,
        text!("Normals"),
        &mut draft.normals,
        NORMALS_WAYS.into_iter().map(|(way, name, _)| (way, translated(name))),
    )
    .on_hover_text(
        NORMALS_WAYS.iter().find(|(way, ..)| *way == draft.normals).map_or("", |(.., help)| translated(help)),
    );
    match draft.normals {
        NormalsWay::Smooth => length(ui, text!("Radius"), &mut draft.radius, radius * 0.2),
        NormalsWay::Fit => {
            slider(ui, text!("Neighbours"), number_slider(&mut draft.neighbours, 3..=64));
        }
        NormalsWay::Own | NormalsWay::Flatten => {}
    }
    slider(ui, text!("Reflectance"), number_slider(&mut draft.specular_intensity, 0.0..=1.0));
    slider(ui, text!("Specular power"), number_slider(&mut draft.specular_power, 0.0..=100_000.0).logarithmic(true))
        .on_hover_text(text!("Sharpness of the highlights that they show of lights; 0: none"));
    if draft.specular_power > 0.0 {
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("Highlights only"));
            ui.checkbox(&mut draft.gloss, "")
                .labelled_by(label.id)
                .on_hover_text(text!("The points shine by this power, and reflect nothing sharply"));
        });
    }
    if !(draft.gloss && draft.specular_power > 0.0) {
        mirrors::refraction(ui, &mut draft.refraction);
    }
    let wanted = draft.wanted(entry, picked);
    let count = wanted.as_ref().and_then(|wanted| match &draft.counted {
        Some((counted, result)) if counted.points == wanted.points && counted.cloud == wanted.cloud => {
            Some(result.clone())
        }
        _ => None,
    });
    let mut is_possible = false;
    match (&wanted, &count) {
        (None, _) => {
            ui.label(RichText::new(text!("Pick a point first, or choose an attribute.")).color(theme::WEAK));
        }
        (Some(_), Some(Ok(count))) => {
            is_possible = *count > 0;
            ui.label(text!("{count} of {points} points", count = grouped(*count), points = grouped(entry.points)));
        }
        (Some(_), Some(Err(error))) => {
            ui.colored_label(theme::ERROR, error);
        }
        (Some(wanted), None) => {
            ui.label(RichText::new(text!("counting")).color(theme::WEAK));
            if !draft.is_counting {
                draft.is_counting = true;
                actions.push(Action::CountPoints(entry.key, Box::new(wanted.clone())));
            }
        }
    }
    let button = ui.add_enabled(is_possible, egui::Button::new(text!("Turn into a mirror")));
    if let (true, Some(points)) = (button.clicked(), wanted) {
        actions.push(Action::Mark(Box::new(Marking { key: entry.key, points })));
    }
}

fn which_points(ui: &mut Ui, draft: &mut Draft, entry: &CloudEntry, scene_radius: f64, has_pick: bool) {
    match draft.way {
        Way::All => {}
        Way::Class => {
            let classes = entry.figures.as_ref().map_or(&[][..], |figures| &figures.classes);
            if let (false, Some((first, _))) = (classes.iter().any(|(class, _)| *class == draft.class), classes.first())
            {
                draft.class = *first;
            }
            let names: Vec<(u8, String)> = classes
                .iter()
                .map(|(class, _)| (*class, format!("{class} {}", translated(render::class_name(*class)))))
                .collect();
            choice(ui, text!("Class"), &mut draft.class, names.iter().map(|(class, name)| (*class, name.as_str())));
            if classes.is_empty() {
                ui.label(RichText::new(text!("This cloud has no classes.")).small().color(theme::WEAK));
            }
        }
        Way::Box => {
            length(ui, text!("Edge"), &mut draft.edge, scene_radius * 2.0);
            if !has_pick {
                ui.label(RichText::new(text!("Click on a point: the box is around it.")).small().color(theme::WEAK));
            }
        }
        Way::Attribute => {
            let attributes = &entry.cloud.attributes;
            let before = draft.attribute.clone();
            if !attributes.iter().any(|attribute| attribute.name == draft.attribute) {
                draft.attribute = attributes.first().map_or(String::new(), |attribute| attribute.name.clone());
            }
            let mut index = attributes.iter().position(|attribute| attribute.name == draft.attribute).unwrap_or(0);
            choice(ui, text!("Attribute"), &mut index, attributes.iter().map(|a| a.name.as_str()).enumerate());
            draft.attribute = attributes.get(index).map_or(String::new(), |attribute| attribute.name.clone());
            if draft.attribute != before
                && let Some((low, high)) = cloud::percentile_range(&entry.cloud.chunks, Scalar::Column(index), 0.0, 1.0)
            {
                (draft.low, draft.high) = (low, high);
            }
            ui.horizontal(|ui| {
                let label = name_label(ui, text!("From, to"));
                let speed = ((draft.high - draft.low).abs() * 0.005).max(1e-6);
                let is_whole = attributes.get(index).is_some_and(|attribute| attribute.column_type.is_whole());
                let read = if is_whole { typed_limit } else { typed_number };
                for value in [&mut draft.low, &mut draft.high] {
                    ui.add(number_field_in_words(value, plain::<f64>, read).speed(speed)).labelled_by(label.id);
                }
            });
        }
    }
}

/// Lists the points that reflect, each with a button to end that, and shows what is being computed.
fn existing(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    for marking in &session.scene.objects.markings {
        let Some(entry) = session.loaded.cloud(marking.key) else { continue };
        ui.horizontal(|ui| {
            let points = &marking.points;
            let what = match &points.points {
                PointChoice::All => text!("all").into(),
                PointChoice::Class(class) => text!("class {class}", class),
                PointChoice::Box { .. } => text!("a box").into(),
                PointChoice::Attribute { name, low, high } => text!("{name} {low} to {high}", name, low, high),
            };
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let button = ui.small_button("×").on_hover_text(text!("These points are no mirror any more"));
                if button.accessible_name(text!("End {what} of {cloud}", what, cloud = entry.cloud.name)).clicked() {
                    actions.push(Action::Unmark(Box::new(marking.clone())));
                }
                ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                    ui.add(egui::Label::new(format!("{}: {what}", entry.cloud.name)).truncate());
                });
            });
        });
    }
    for entry in &session.loaded.clouds {
        let Some((_, progress)) = &entry.marking else { continue };
        ui.horizontal(|ui| {
            let share = progress.done() as f32 / progress.total().max(1) as f32;
            ui.add(egui::ProgressBar::new(share).text(text!("normals")).desired_width(150.0).desired_height(14.0));
            if ui.small_button(text!("Stop")).clicked() {
                actions.push(Action::StopMarking(entry.key));
            }
        });
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Chunk, Column, ColumnType, Progress};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::MirrorPoints;
    use world::{Change, Event, Opened, Part};

    use super::*;
    use crate::viewer::loaded::Loaded;
    use crate::viewer::objects::figures::{Basis, Figures};
    use crate::viewer::picture::messages::Command;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::{Found, Work};

    /// Six points, two of them water, with what a worker thread would have found out about them.
    fn lake() -> Session {
        let mut session = Session::new(Preferences::default());
        let job = session.loaded.add_job(&[], Arc::default(), Arc::default(), session.outside.now);
        let attributes = vec![Attribute { name: "classification".into(), column_type: ColumnType::U8 }];
        let (name, input) = ("lake.laz".into(), "scans/lake.laz".into());
        let opened = Opened { name, input, attributes, expected_points: 6, up: DVec3::Z, ..Opened::default() };
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Opened { cloud: 0, opened }, beside));
        let mut chunk = Chunk::new(0, DVec3::ZERO, (0..6).map(|i| [i as f32, 0.1 * (i * i) as f32, 0.0]).collect());
        chunk.columns = vec![Some(Arc::new(Column::U8(vec![2, 2, 9, 9, 2, 1])))];
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(job, Event::Chunk { cloud: 0, part: Part::Block(0), chunk }, beside)
        });
        session.with_loaded(|loaded, beside| loaded.on_loading(job, Event::Finished, beside));
        let (key, cloud) = (session.loaded.clouds[0].key, session.loaded.clouds[0].cloud.clone());
        let (color, test) = (session.scene.settings.color.clone(), session.scene.objects.test());
        let figures = Box::new(Figures::of(&cloud, &color, &test, DVec3::Z));
        let basis =
            Basis { color, test, doublings: 0, is_read: true, late_columns: 0, columns: 0, surfels: 0, rests: 0 };
        session.on_found(Found::Figures { key, basis, figures });
        session.scene.history.watch(&session.scene.settings, &session.scene.objects, false, session.outside.now);
        session
    }

    /// Does the work that the session asks of worker threads.
    fn work(session: &mut Session) {
        for effect in std::mem::take(&mut session.outside.effects) {
            match effect {
                Effect::Work(Work::CountPoints { cloud, wanted, .. }) => {
                    let marked = world::mirrors::mark(&cloud, None, &wanted, &Progress::default());
                    let result = marked.map(|marked| marked.map_or(0, |marked| marked.count));
                    session.on_found(Found::Counted { wanted, result: result.map_err(|error| error.to_string()) });
                }
                Effect::Work(Work::MarkPoints { key, cloud, wanted, progress, .. }) => {
                    let mark = |wanted| world::mirrors::mark(&cloud, None, wanted, &progress).unwrap();
                    let result = Ok(wanted.iter().map(mark).collect());
                    session.on_found(Found::Marked { key, wanted, result });
                }
                Effect::Render(command) => session.outside.push(Effect::Render(command)),
                _ => {}
            }
        }
    }

    /// The number of reflecting points that the render thread last heard of.
    fn marked(session: &mut Session) -> Option<u64> {
        let effects = std::mem::take(&mut session.outside.effects);
        effects.into_iter().rev().find_map(|effect| match effect {
            Effect::Render(Command::Change(Change::Mark { marked, .. })) => {
                Some(marked.iter().map(|marked| marked.count).sum())
            }
            _ => None,
        })
    }

    #[test]
    fn water_is_counted_turned_into_a_mirror_and_back_by_undo() {
        let mut harness = Harness::builder().with_size([340.0, 500.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            lake(),
        );
        harness.run_ok();
        assert!(harness.query_by_label("counting").is_some());
        work(harness.state_mut());
        harness.run_ok();
        assert!(harness.query_by_label("2 of 6 points").is_some(), "class 9 is not what is offered");
        harness.get_by_label("Turn into a mirror").click();
        harness.run_ok();
        let marking = harness.state().scene.objects.markings[0].clone();
        assert_eq!(marking.points.refraction, Some(scene::WATER), "water is clear");
        assert_eq!((marking.points.points, marking.points.cloud.as_str()), (PointChoice::Class(9), "scans/lake.laz"));
        harness.state_mut().with_loaded(Loaded::sync_objects);
        work(harness.state_mut());
        assert_eq!(marked(harness.state_mut()), Some(2));
        // Nothing is sent again as long as nothing changes.
        harness.state_mut().with_loaded(Loaded::sync_objects);
        assert!(marked(harness.state_mut()).is_none());
        harness.state_mut().act(Action::Undo);
        harness.state_mut().with_loaded(Loaded::sync_objects);
        work(harness.state_mut());
        assert_eq!(marked(harness.state_mut()), Some(0));
    }

    #[test]
    fn stopping_leaves_what_reflected_before() {
        let mut session = lake();
        let key = session.loaded.clouds[0].key;
        let points = MirrorPoints::whole("scans/lake.laz".into());
        session.scene.edit_objects(session.outside.now, |objects| {
            objects.markings.push(Marking { key, points: points.clone() })
        });
        session.with_loaded(Loaded::sync_objects);
        session.on_found(Found::Marked { key, wanted: vec![points], result: Ok(None) });
        assert!(session.scene.objects.markings.is_empty());
        session.with_loaded(Loaded::sync_objects);
        assert!(session.loaded.clouds[0].marking.is_none(), "it begins again");
    }
}
