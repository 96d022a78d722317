//! The panel that lists the clouds. Each can be shown or hidden, framed and removed, and have a look of its own.

use egui::{RichText, Ui};
use glam::DVec3;
use param::Params as _;
use scene::{CloudSettings, Color, ColorBy};

use crate::overlays::legend;
use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{eye, name_label, number_slider_in, three};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::figures::Figures;
use crate::viewer::panels::clips::range_button;
use crate::viewer::panels::colors::histogram;
use crate::viewer::panels::parameters::parameter;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    for entry in &session.loaded.clouds {
        ui.push_id(entry.key.0, |ui| {
            ui.horizontal(|ui| {
                if eye(ui, entry.is_visible, &entry.cloud.name).clicked() {
                    actions.push(Action::ShowCloud(entry.key, !entry.is_visible));
                }
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let remove = ui.small_button("×").on_hover_text(text!("Remove"));
                    if remove.accessible_name(text!("Remove {cloud}", cloud = entry.cloud.name)).clicked() {
                        actions.push(Action::RemoveCloud(entry.key));
                    }
                    if ui.small_button(text!("Frame")).on_hover_text(text!("Show all of this cloud")).clicked() {
                        actions.push(Action::FrameCloud(entry.key));
                    }
                    ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                        let name = ui.add(egui::Label::new(&entry.cloud.name).truncate());
                        name.on_hover_text(&entry.input);
                    });
                });
            });
            let points = if entry.streamed.is_some() || entry.is_cut {
                let (points, total) = (grouped(entry.points), grouped(entry.total()));
                let loaded = text!("{points} of {total} points loaded", points, total);
                let hides = entry.is_visible && !session.scene.objects.test().shows_all();
                match entry.figures.as_ref().filter(|_| hides) {
                    // Counted where the view last stood still.
                    Some(figures) => {
                        text!("{loaded}, {shown} shown", loaded, shown = grouped(figures.shown.min(entry.points)))
                    }
                    None => loaded,
                }
            } else if entry.is_read || entry.points >= entry.expected_points {
                text!("{points} points", points = grouped(entry.points))
            } else {
                text!(
                    "{points} of {expected_points} points",
                    points = grouped(entry.points),
                    expected_points = grouped(entry.expected_points)
                )
            };
            let format = entry.source.as_ref().map(|source| {
                let info = source.info();
                let format = info.format.name().to_uppercase();
                let point_format = info.point_format.map_or(String::new(), |number| text!(", format {number}", number));
                format!(" · {format} {}{point_format}", info.version)
            });
            let streamed = if entry.streamed.is_some() { text!(" · streamed") } else { "" };
            // A line of its own would take the keyboard from the numbers below.
            let moving = if entry.is_placing { text!(" · being moved") } else { "" };
            let line = points + &format.unwrap_or_default() + streamed + moving;
            ui.label(RichText::new(line).small().color(theme::WEAK));
            let known = |figures: &Figures| (figures.strays.unwrap_or_default(), figures.noise.flatten());
            let (strays, noise) = entry.figures.as_ref().map_or(([0; 2], None), known);
            let strays = strays.into_iter().zip([text!("stray"), text!("mixed")]).filter(|(count, _)| *count > 0);
            let strays = strays.map(|(count, kind)| format!("{} {kind}", grouped(count)));
            let noise = noise.map(|noise| text!("noise {noise}", noise = crate::shared::numbers::two_digits(noise)));
            let mut line: Vec<String> = strays.chain(noise).collect();
            // Of a streamed cloud that is switched off no points are loaded, and the figures are of those before.
            if !line.is_empty() && entry.points > 0 {
                line.extend(entry.is_partly_loaded().then(|| text!("of the loaded points").to_owned()));
                let quality = ui.label(RichText::new(line.join(" · ")).small().color(theme::WEAK));
                quality.on_hover_text(text!(
                    "Stray points are far from all surfaces, and mixed pixels between two of them (splat.strays; the \
                     attribute `stray` of colours and filters). Noise is how far points are from the \
                     planes through their neighbours, in the file's unit: the standard deviation."
                ));
            }
            let known = session.scene.objects.settings_of(entry.key);
            let has_own = known.is_some_and(|own| own.size != 1.0 || !own.color.is_empty());
            let title = RichText::new(text!("Own look")).small();
            let title = if has_own { title.color(theme::ACCENT) } else { title };
            let section = egui::CollapsingHeader::new(title).id_salt("own look");
            section.show(ui, |ui| own_look(ui, session, entry, actions));
            let title = RichText::new(text!("Place")).small();
            let title = if entry.placement().is_some() { title.color(theme::ACCENT) } else { title };
            egui::CollapsingHeader::new(title).id_salt("place").show(ui, |ui| own_place(ui, session, entry, actions));
        });
    }
}

/// What the cloud has of its own: colours and the size of points. Each can be as the view has it again.
fn own_look(ui: &mut Ui, session: &Session, entry: &CloudEntry, actions: &mut Vec<Action>) {
    let all = &session.scene.settings.color;
    let before = session.loaded.own_settings(entry.key, session.scene.objects.settings_of(entry.key));
    let mut own = before.clone();
    let color = own.color_of(all);
    color_line(ui, &color, "by", &mut own);
    if color.by == ColorBy::Attribute {
        attribute_line(ui, entry, &color, &mut own);
    }
    if let Some(figures) = entry.figures.as_ref().filter(|figures| !figures.histogram.is_empty()) {
        let title = legend::title(&figures.plan, &entry.units);
        let dragged = histogram(ui, figures, &title, color.ramp, color.low, color.high);
        let [low, high] = range_button(ui, session, entry, actions).unwrap_or(dragged.into());
        for (name, before, share) in [("low", color.low, low), ("high", color.high, high)] {
            if share != before {
                own.set_color(name, &share.to_string());
            }
        }
        let has_range = own.color.contains_key("low") || own.color.contains_key("high");
        if has_range && ui.small_button(text!("Range as the view")).clicked() {
            own.color.remove("low");
            own.color.remove("high");
        }
        color_line(ui, &color, "ramp", &mut own);
    }
    color_line(ui, &color, "plain", &mut own);
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Point size"));
        let slider = number_slider_in(&mut own.size, CloudSettings::SIZES, " ×").logarithmic(true);
        ui.add(slider.clamping(egui::SliderClamping::Edits)).labelled_by(label.id);
        as_the_view(ui, text!("Point size"), own.size != 1.0).then(|| own.size = 1.0);
    });
    if own != before {
        actions.push(Action::ChangeCloud(entry.key, Box::new(own)));
    }
}

/// Where the cloud stands, which its file does not know of. The first turn is about the middle of its points.
fn own_place(ui: &mut Ui, session: &Session, entry: &CloudEntry, actions: &mut Vec<Action>) {
    let mut own = session.loaded.own_settings(entry.key, session.scene.objects.settings_of(entry.key));
    let step = (entry.bounds.size().max_element() * 1e-4).clamp(1e-4, 1.0);
    let mut wanted = None;
    if let Some(shift) = three(ui, text!("Move"), own.shift, step, "") {
        wanted = Some(CloudSettings { shift, ..own.clone() });
    }
    if let Some(turn) = three(ui, text!("Turn x y z"), own.turn, 0.05, "°") {
        let middle = entry.bounds.center();
        let middle = entry.placement().map_or(middle, |placement| placement.own_point(middle));
        wanted = Some(CloudSettings { turn, about: own.about.or(Some(middle)), ..own.clone() });
    }
    let is_moved = own.shift != DVec3::ZERO || own.turn != DVec3::ZERO;
    let back = is_moved && {
        let button = ui.small_button(text!("As in the file")).on_hover_text(text!("Takes back the move and the turn"));
        button.accessible_name(text!("{cloud} as in the file", cloud = entry.cloud.name)).clicked()
    };
    if back {
        (own.shift, own.turn, own.about) = (DVec3::ZERO, DVec3::ZERO, None);
        wanted = Some(own);
    }
    if let Some(wanted) = wanted.filter(|wanted| wanted.problem().is_none()) {
        actions.push(Action::ChangeCloud(entry.key, Box::new(wanted)));
    }
}

/// A button that takes back what a cloud has of its own. Returns whether it was clicked.
fn as_the_view(ui: &mut Ui, name: &str, is_own: bool) -> bool {
    is_own && {
        let button = ui.small_button("×").on_hover_text(text!("As the view has it"));
        button.accessible_name(text!("{name} as the view", name)).clicked()
    }
}

/// A colour parameter of the cloud, as the table of parameters has it.
fn color_line(ui: &mut Ui, color: &Color, name: &str, own: &mut CloudSettings) {
    ui.horizontal(|ui| {
        let mut edits = Vec::new();
        parameter(ui, color, name, &mut edits);
        for edit in edits {
            let (Action::SetParameter { value, .. }, Some(field)) =
                (edit, color.group().fields.iter().find(|field| field.name == name))
            else {
                continue;
            };
            own.set_color(name, &field.format(&value));
        }
        if as_the_view(ui, name, own.color.contains_key(name)) {
            own.color.remove(name);
        }
    });
}

fn attribute_line(ui: &mut Ui, entry: &CloudEntry, color: &Color, own: &mut CloudSettings) {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Attribute"));
        let mut chosen = color.attribute.clone();
        let combo = egui::ComboBox::from_id_salt("own attribute").width(130.0).selected_text(&chosen);
        let shown = combo.show_ui(ui, |ui| {
            for attribute in entry.offered() {
                ui.selectable_value(&mut chosen, attribute.name.clone(), &attribute.name);
            }
        });
        shown.response.labelled_by(label.id);
        if chosen != color.attribute {
            own.set_color("attribute", &chosen);
        }
        if as_the_view(ui, text!("attribute"), own.color.contains_key("attribute")) {
            own.color.remove("attribute");
        }
    });
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Column, ColumnType};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use scene::Camera;
    use world::{Change, Part};

    use super::*;
    use crate::shared::measuring;
    use crate::viewer::loaded::Loaded;
    use crate::viewer::objects::clouds::Streamed;
    use crate::viewer::picture::messages::{Command, PickedPoint};
    use crate::viewer::requests::action::Profiling;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::work::{Found, Work};

    /// The panel with a cloud of two points.
    fn harness() -> Harness<'static, Session> {
        let session = Session::with_two_points();
        let mut harness = Harness::builder().with_size([320.0, 200.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        harness
    }

    #[test]
    fn a_cloud_is_hidden_and_shown_by_its_eye_and_removed_by_its_button() {
        let mut harness = harness();
        assert!(harness.query_by_label("2 points").is_some());
        for visible in [false, true] {
            harness.get_by_label("Show cloud.ply").click();
            harness.run_ok();
            assert_eq!(harness.state().loaded.clouds[0].is_visible, visible);
        }
        for is_visible in [false, true] {
            harness.state_mut().act(Action::Undo);
            harness.state_mut().with_loaded(Loaded::sync_visibility);
            assert_eq!(harness.state().loaded.clouds[0].is_visible, is_visible, "undo takes each back");
        }
        harness.get_by_label("Remove cloud.ply").click();
        harness.run_ok();
        assert!(harness.state().loaded.clouds.is_empty() && harness.query_by_label("2 points").is_none());
    }

    /// The figures that the session asks for.
    fn with_figures(session: &mut Session) {
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, .. }) = effect {
                let figures = Box::new(Figures::of(&cloud, &basis.color, &basis.test, up));
                session.on_found(Found::Figures { key, basis, figures });
            }
        }
    }

    #[test]
    fn of_a_streamed_cloud_loaded_points_are_told_and_how_many_of_them_are_shown() {
        let mut harness = harness();
        let entry = &mut harness.state_mut().loaded.clouds[0];
        (entry.streamed, entry.expected_points) = (Some(Streamed::default()), 1234);
        harness.run_ok();
        assert!(harness.query_by_label("2 of 1,234 points loaded · streamed").is_some());
        let session = harness.state_mut();
        session.scene.objects.visibility.hidden_classes.insert(7);
        with_figures(session);
        let figures = session.loaded.clouds[0].figures.as_mut().unwrap();
        (figures.shown, figures.strays) = (1, Some([0, 1]));
        harness.run_ok();
        assert!(harness.query_by_label("2 of 1,234 points loaded, 1 shown · streamed").is_some());
        assert!(harness.query_by_label("1 mixed · of the loaded points").is_some());
        harness.state_mut().loaded.clouds[0].expected_points = 2;
        harness.run_ok();
        assert!(harness.query_by_label("1 mixed").is_some(), "all are loaded");
        harness.state_mut().loaded.clouds[0].points = 0;
        harness.run_ok();
        assert!(harness.query_by_label_contains("1 mixed").is_none(), "it is switched off");
    }

    #[test]
    fn a_cloud_that_could_not_be_read_whole_has_values_of_loaded_points() {
        let mut harness = harness();
        let session = harness.state_mut();
        let entry = &mut session.loaded.clouds[0];
        entry.expected_points = 1234;
        let of = |entry: &CloudEntry| {
            let corners = vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0)];
            let (name, kind, color) = (String::new(), scene::MeasurementKind::Volume, [0.0; 3]);
            let volume = scene::Measurement { name, kind, on: true, color, points: corners, reach: None, level: None };
            let clouds = vec![(entry.cloud.clone(), entry.loaded_parts())];
            measuring::of_clouds(&volume, DVec3::Z, clouds, &Default::default())
        };
        let is_of_loaded = |entry: &CloudEntry| match of(entry) {
            Ok(figures) => measuring::are_of_loaded(&figures),
            Err(problem) => problem.contains("of the loaded points"),
        };
        entry.end(&codec::Summary { points: 2, ..Default::default() });
        assert!(!is_of_loaded(entry) && !entry.is_partly_loaded(), "points without coordinates are in no cloud");
        for (missing, cancelled) in [(1232, false), (0, true)] {
            entry.end(&codec::Summary { points: 2, missing, cancelled, ..Default::default() });
            assert!(is_of_loaded(entry) && entry.is_partly_loaded());
        }
        harness.run_ok();
        assert!(harness.query_by_label_contains("2 of 1,234 points loaded").is_some());
    }

    #[test]
    fn a_cloud_is_coloured_by_its_own_parameters_and_undo_tells_of_which_cloud() {
        let mut harness = harness();
        harness.set_size(egui::vec2(320.0, 600.0));
        harness.get_by_label("Own look").click();
        harness.run_ok();
        harness.get_by_label("By").click();
        harness.run_ok();
        harness.get_by_label("normal").click();
        harness.run_ok();
        let session = harness.state_mut();
        with_figures(session);
        let label = |session: &Session| session.loaded.clouds[0].figures.as_ref().unwrap().plan.label.clone();
        assert_eq!((label(session).as_str(), session.scene.settings.color.by), ("normal", ColorBy::Auto));
        session.act(Action::Undo);
        let told = session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default();
        assert_eq!(told, "Undone: cloud `cloud.ply`");
        with_figures(session);
        assert_eq!(label(session), "plain");
        session.act(Action::Redo);
        harness.run_ok();
        harness.get_by_label("by as the view").click();
        harness.run_ok();
        assert!(harness.state().scene.objects.own_settings.is_empty());
    }

    #[test]
    fn the_range_of_a_clouds_own_histogram_becomes_a_filter_and_leaves_the_views_range_alone() {
        let mut session = Session::with_two_points();
        let entry = &mut session.loaded.clouds[0];
        let attribute = Attribute { name: "intensity".into(), column_type: ColumnType::F32 };
        entry.cloud.attributes.push(attribute);
        entry.put_late_column(0, [(0, Arc::new(Column::F32(vec![3.0, 7.0])))].into());
        let key = entry.key;
        let mut own = session.loaded.own_settings(key, None);
        for (name, text) in [("by", "attribute"), ("attribute", "intensity"), ("low", "0.2"), ("high", "0.9")] {
            own.set_color(name, text);
        }
        session.act(Action::ChangeCloud(key, Box::new(own)));
        with_figures(&mut session);
        let mut harness = Harness::builder().with_size([320.0, 600.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        harness.get_by_label("Own look").click();
        harness.run_ok();
        let range = |harness: &Harness<'_, Session>| {
            let session = harness.state();
            let own = session.scene.objects.color_of(key, &session.scene.settings.color);
            assert_eq!(session.scene.settings.color, Color::default(), "the view's colours stay");
            (own.low, own.high)
        };
        assert_eq!(range(&harness), (0.2, 0.9));
        harness.get_by_label("Show this range only").click();
        harness.run_ok();
        let filters = &harness.state().scene.objects.visibility.filters;
        assert_eq!((filters.len(), filters[0].attribute.as_str()), (1, "intensity"));
        assert_eq!(range(&harness), (0.0, 1.0), "the ramp goes over all that is shown");
    }

    #[test]
    fn points_of_their_own_size_reach_the_render_thread_and_come_back_by_undo() {
        let mut harness = harness();
        let session = harness.state_mut();
        let key = session.loaded.clouds[0].key;
        let own = CloudSettings { size: 3.0, ..session.loaded.own_settings(key, None) };
        session.act(Action::ChangeCloud(key, Box::new(own)));
        let sizes = |session: &mut Session| -> Vec<f32> {
            session.with_loaded(Loaded::sync_visibility);
            let changes = std::mem::take(&mut session.outside.effects).into_iter();
            let size = |effect| match effect {
                Effect::Render(Command::Change(Change::Size { size, .. })) => Some(size),
                _ => None,
            };
            changes.filter_map(size).collect()
        };
        assert_eq!((sizes(session), sizes(session)), (vec![3.0], vec![]));
        session.act(Action::Undo);
        assert_eq!(sizes(session), [1.0]);
        // What is out of range is refused.
        let own = CloudSettings { size: 0.0, ..session.loaded.own_settings(key, None) };
        session.act(Action::ChangeCloud(key, Box::new(own)));
        assert!(sizes(session).is_empty());
    }

    #[test]
    fn a_cloud_is_moved_by_its_own_numbers_and_undo_says_so_and_moves_it_back() {
        let mut harness = harness();
        let session = harness.state_mut();
        let key = session.loaded.clouds[0].key;
        let before: Vec<DVec3> = (0..2).map(|index| session.loaded.clouds[0].cloud.chunks[0].position(index)).collect();
        let middle = session.loaded.clouds[0].bounds.center();
        // Carries out the work that the session asks for; returns the places of the points afterwards.
        let places = |session: &mut Session| -> Vec<DVec3> {
            session.with_loaded(Loaded::sync_visibility);
            for effect in std::mem::take(&mut session.outside.effects) {
                if let Effect::Work(Work::Place { key, own, placement }) = effect {
                    session.on_found(Found::Placed { key, moved: own.placed(placement) });
                }
            }
            let chunk = &session.loaded.clouds[0].cloud.chunks[0];
            (0..2).map(|index| chunk.position(index)).collect()
        };
        session.act(Action::Profile(Profiling::Pick(PickedPoint { chunk: key.chunk(Part::Block(0)), index: 1 })));
        let picked = |session: &Session| session.tools.pick.as_ref().map(|pick| pick.world);
        assert_eq!(picked(session), Some(before[1]));
        let (shift, turn) = (DVec3::new(0.0, 0.0, 4.0), DVec3::new(0.0, 0.0, 180.0));
        let own = session.loaded.own_settings(key, None);
        let own = CloudSettings { shift, turn, about: Some(middle), ..own };
        session.act(Action::ChangeCloud(key, Box::new(own.clone())));
        session.with_loaded(Loaded::sync_visibility);
        assert!(session.loaded.clouds[0].is_placing && session.loaded.clouds[0].is_busy());
        let moved = places(session);
        assert!(!session.loaded.clouds[0].is_placing);
        for (moved, before) in moved.iter().zip(&before) {
            let off = *before - middle;
            let expected = middle + DVec3::new(-off.x, -off.y, off.z + 4.0);
            assert!(moved.distance(expected) < 1e-6, "{moved} {expected}");
        }
        assert!((session.loaded.clouds[0].bounds.center() - middle - shift).length() < 1e-6);
        assert_eq!(picked(session), Some(moved[1]), "the picked point moves along");
        // Bad numbers are refused.
        let odd = CloudSettings { turn: DVec3::NAN, ..own };
        session.act(Action::ChangeCloud(key, Box::new(odd)));
        assert_eq!(places(session), moved);
        session.act(Action::Undo);
        let told = session.outside.messages.all.last().map(|message| message.text.clone()).unwrap_or_default();
        assert_eq!((told.as_str(), places(session)), ("Undone: the place of cloud `cloud.ply`", before.clone()));
        assert_eq!(picked(session), Some(before[1]));
        session.act(Action::Redo);
        assert_eq!(places(session), moved);
        harness.run_ok();
        harness.get_by_label("Place").click();
        harness.run_ok();
        harness.get_by_label("cloud.ply as in the file").click();
        harness.run_ok();
        assert_eq!(places(harness.state_mut()), before);
        assert!(harness.state().scene.objects.own_settings.is_empty());
    }

    #[test]
    fn strays_and_noise_are_told_once_they_are_known() {
        let mut harness = harness();
        let session = harness.state_mut();
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, .. }) = effect {
                let figures = Figures::of(&cloud, &basis.color, &basis.test, up);
                let figures = Box::new(Figures { strays: Some([1234, 56]), noise: Some(Some(0.001_63)), ..figures });
                session.on_found(Found::Figures { key, basis, figures });
            }
        }
        harness.run_ok();
        assert!(harness.query_by_label("1,234 stray · 56 mixed · noise 0.0016").is_some());
    }

    #[test]
    fn frame_looks_at_the_whole_cloud_from_where_one_looks_now_and_is_undone() {
        let mut harness = harness();
        let session = harness.state_mut();
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, .. }) = effect {
                let figures = Box::new(Figures::of(&cloud, &basis.color, &basis.test, up));
                session.on_found(Found::Figures { key, basis, figures });
            }
        }
        session.scene.camera = Camera::looking(DVec3::splat(900.0), DVec3::new(1.0, 2.0, -0.5), 3.0, DVec3::Z);
        let before = session.scene.camera;
        harness.get_by_label("Frame").click();
        harness.run_ok();
        let camera = harness.state().scene.camera;
        assert!(camera.forward().distance(before.forward()) < 1e-6, "{}", camera.forward());
        let lens = harness.state().scene.lens();
        let size = glam::DVec2::from(harness.state().scene.view_size.map(f64::from));
        for corner in [DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0)] {
            let pixel = lens.project(corner).expect("a corner before the eye");
            assert!(pixel.cmpge(glam::DVec2::ZERO).all() && pixel.cmple(size).all(), "{corner} is at {pixel}");
        }
        harness.state_mut().act(Action::Undo);
        assert_eq!(harness.state().scene.camera, before);
    }
}
