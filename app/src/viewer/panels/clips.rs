//! The panel of clip volumes and filters: adds, selects, switches, names, copies and deletes them, and edits their
//! numbers.

use std::collections::BTreeSet;

use cloud::STRAY;
use egui::{RichText, Ui};
use render::{ColorSource, class_name};
use scene::{Clip, ClipShape, Filter, Keep, Object};

use crate::shared::export::FORMATS;
use crate::shared::language::{text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::typed::{typed_limit, typed_number};
use crate::viewer::look::widgets::{choice, eye, name_field, name_label, number_field_in_words, tall_menu, three};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::{ObjectId, PlacedClip};
use crate::viewer::panels::mirrors::{from_angles, remember_angles, remembered_angles};
use crate::viewer::requests::action::{Action, Clipping, Export};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        add_menu(ui, actions);
        if session.tools.prism.is_some() {
            let end = ui.button(text!("Close the polygon")).on_hover_text(text!("Makes a prism of the corners"));
            actions.extend(end.clicked().then_some(Action::Clip(Clipping::EndPrism)));
        }
        filter_menu(ui, session, actions);
    });
    let clips = &session.scene.objects.clips;
    let visibility = &session.scene.objects.visibility;
    if clips.is_empty() && visibility.shows_all() {
        ui.label(RichText::new(text!("Nothing is clipped or filtered.")).color(theme::WEAK));
    }
    hidden_classes(ui, &visibility.hidden_classes, actions);
    for placed in clips {
        ui.push_id(placed.id.0, |ui| row(ui, session, placed, actions));
    }
    let inner = clips.iter().filter(|placed| placed.clip.on && placed.clip.keep == Keep::Inside).count();
    if inner > 1 {
        let text = text!("Shown is what lies in any of the {count} volumes that show their inside.", count = inner);
        ui.add(egui::Label::new(RichText::new(text).color(theme::WEAK)).wrap());
    }
    let selected = session.scene.selected.and_then(|id| clips.iter().find(|placed| placed.id == id));
    if let Some(PlacedClip { id, clip }) = selected {
        ui.separator();
        ui.push_id(id.0, |ui| numbers(ui, session, *id, clip.clone(), actions));
    }
    filters(ui, session, actions);
    export(ui, session, actions);
}

/// Says which classes are hidden: they are as good as clipped, and the list of classes is in another tab.
fn hidden_classes(ui: &mut Ui, hidden: &BTreeSet<u8>, actions: &mut Vec<Action>) {
    if hidden.is_empty() {
        return;
    }
    ui.horizontal(|ui| {
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let all = ui.small_button(text!("Show all")).on_hover_text(text!("Shows the points of all classes"));
            actions.extend(all.clicked().then(|| Action::ShowClasses(hidden.iter().copied().collect(), true)));
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let names: Vec<String> =
                    hidden.iter().map(|class| format!("{class} {}", translated(class_name(*class)))).collect();
                let text = text!("Hidden: {names}", names = names.join(", ").trim_end());
                ui.add(egui::Label::new(RichText::new(text).color(theme::ACCENT)).truncate());
            });
        });
    });
}

/// Saves what is left of the points.
fn export(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(writing) = &session.loaded.writing else {
        let ask = Action::Export(Export::Ask);
        let text = text!("Save what is shown ({ask})", ask = bindings::shortcut(&ask));
        let button = ui.add_enabled(!session.loaded.clouds.is_empty(), egui::Button::new(text));
        let help = text!("Writes the points that are shown to a new file: {formats}", formats = FORMATS.0);
        let button = button.on_hover_text(help);
        actions.extend(button.clicked().then_some(ask));
        return;
    };
    ui.horizontal(|ui| {
        let share = writing.progress.done() as f32 / writing.progress.total().max(1) as f32;
        let bar = egui::ProgressBar::new(share).text(text!("saving")).desired_width(150.0).desired_height(14.0);
        ui.add(bar).on_hover_text(writing.path.display().to_string());
        actions.extend(ui.small_button(text!("Stop")).clicked().then_some(Action::Export(Export::Stop)));
    });
    ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
}

fn add_menu(ui: &mut Ui, actions: &mut Vec<Action>) {
    ui.menu_button(text!("Add clip"), |ui| {
        let mut add = |ui: &mut Ui, text: &str, clipping: Clipping| {
            let action = Action::Clip(clipping);
            let shortcut = bindings::shortcut(&action);
            let text = if shortcut.is_empty() { text.to_owned() } else { format!("{text} ({shortcut})") };
            actions.extend(ui.button(text).clicked().then_some(action));
        };
        add(ui, text!("Box about everything"), Clipping::AroundAll(ClipShape::Box));
        add(ui, text!("Box about the last pick"), Clipping::AroundPick);
        add(ui, text!("Box about what I see"), Clipping::AroundView);
        add(ui, text!("Sphere"), Clipping::AroundAll(ClipShape::Sphere));
        add(ui, text!("Slab"), Clipping::AroundAll(ClipShape::Slab));
        add(ui, text!("Prism drawn on the picture"), Clipping::DrawPrism);
    });
}

/// A clip in the list: the eye switches it, a click on the name selects it, and the word says which side is shown.
fn row(ui: &mut Ui, session: &Session, PlacedClip { id, clip }: &PlacedClip, actions: &mut Vec<Action>) {
    let change = |clip: Clip| Action::ChangeObject(*id, Box::new(Object::Clip(clip)));
    ui.horizontal(|ui| {
        if eye(ui, clip.on, &clip.name).clicked() {
            actions.push(change(Clip { on: !clip.on, ..clip.clone() }));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let delete = ui.small_button("×").on_hover_text(text!("Delete"));
            if delete.accessible_name(text!("Delete {clip}", clip = clip.name)).clicked() {
                actions.extend([Action::Select(Some(*id)), Action::Delete]);
            }
            if ui.small_button(text!("Copy")).accessible_name(text!("Copy {clip}", clip = clip.name)).clicked() {
                actions.extend([Action::Select(Some(*id)), Action::Duplicate]);
            }
            let (word, other) = match clip.keep {
                Keep::Inside => (text!("inside"), Keep::Outside),
                Keep::Outside => (text!("outside"), Keep::Inside),
            };
            let keep = ui.small_button(word).on_hover_text(text!(
                "Which points are shown: those inside of the volume, or those outside. A click changes it"
            ));
            if keep.accessible_name(text!("{clip} shows its {word}", clip = clip.name, word)).clicked() {
                actions.push(change(Clip { keep: other, ..clip.clone() }));
            }
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let is_selected = session.scene.selected == Some(*id);
                if ui.selectable_label(is_selected, &clip.name).clicked() {
                    actions.push(Action::Select(if is_selected { None } else { Some(*id) }));
                }
            });
        });
    });
}

/// Edits the numbers of a clip. A change is taken only if the numbers still describe a clip.
fn numbers(ui: &mut Ui, session: &Session, id: ObjectId, mut clip: Clip, actions: &mut Vec<Action>) {
    let before = clip.clone();
    let step = clip.size.max_element() * 0.005;
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Name"));
        let free_name = |wanted: &str| session.scene.objects.free_name("clip", wanted, Some(id));
        name_field(ui, &mut clip.name, 150.0, free_name).labelled_by(label.id);
    });
    if !matches!(clip.shape, ClipShape::Prism(_)) {
        let shapes = [ClipShape::Box, ClipShape::Sphere, ClipShape::Slab];
        let mut chosen = shapes.iter().position(|shape| *shape == clip.shape).unwrap_or(0);
        choice(ui, text!("Shape"), &mut chosen, shapes.iter().map(|shape| translated(shape.name())).enumerate());
        clip.shape = shapes[chosen].clone();
    }
    choice(
        ui,
        text!("Shows"),
        &mut clip.keep,
        [(Keep::Inside, text!("inside")), (Keep::Outside, text!("outside"))].into_iter(),
    );
    if let Some(position) = three(ui, text!("Position"), clip.position, step, "") {
        clip.position = position;
    }
    if let Some(size) = three(ui, text!("Size"), clip.size, step, "") {
        clip.size = size;
    }
    let angles = remembered_angles(ui, clip.rotation, session.up());
    if let Some(angles) = three(ui, text!("Yaw pitch roll"), angles, 0.5, "°") {
        clip.rotation = from_angles(angles, session.up());
        remember_angles(ui, clip.rotation, angles);
    }
    if clip != before && clip.problem().is_none() {
        actions.push(Action::ChangeObject(id, Box::new(Object::Clip(clip))));
    }
}

/// Adds a filter of an attribute, at first over all its values. The attribute shown in colours gets the range of the
/// histogram's handles.
fn filter_menu(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let known = &session.scene.objects.visibility.filters;
    let mut names: Vec<&str> = Vec::new();
    for attribute in session.loaded.clouds.iter().flat_map(|entry| entry.offered()) {
        let name = attribute.name.as_str();
        if !names.contains(&name) && known.iter().all(|filter| filter.attribute != name) {
            names.push(name);
        }
    }
    let tells_strays = session.scene.settings.surface.radii == scene::SurfaceRadii::Spread;
    if tells_strays && !names.contains(&STRAY) && known.iter().all(|filter| filter.attribute != STRAY) {
        names.push(STRAY);
    }
    ui.menu_button(text!("Add filter"), |ui| {
        if names.is_empty() {
            ui.label(text!("no attributes"));
        }
        tall_menu(ui, |ui| {
            for name in names {
                if ui.button(name).clicked() {
                    let (low, high) = handles_of(session, name).unwrap_or(usual_range(name));
                    let added = Filter { attribute: name.to_owned(), low, high };
                    actions.push(Action::Clip(Clipping::Filter(known.iter().cloned().chain([added]).collect())));
                    ui.close();
                }
            }
        });
    });
}

/// The range of a new filter: all values, but of strays the points on surfaces.
fn usual_range(attribute: &str) -> (f64, f64) {
    if attribute == STRAY { (0.0, 0.0) } else { (f64::NEG_INFINITY, f64::INFINITY) }
}

/// The values at the handles of the histogram, if it shows this attribute.
fn handles_of(session: &Session, attribute: &str) -> Option<(f64, f64)> {
    session.loaded.clouds.iter().filter(|entry| entry.is_visible).find_map(|entry| {
        let plan = &entry.figures.as_ref()?.plan;
        let ColorSource::Column(column) = plan.source else { return None };
        (entry.cloud.attributes.get(column)?.name == attribute).then_some((plan.low, plan.high))
    })
}

/// A button that hides all points outside of the handles of a cloud's histogram, or shows them again. Returns where the
/// handles are to be afterwards, as shares of the points.
pub fn range_button(ui: &mut Ui, session: &Session, entry: &CloudEntry, actions: &mut Vec<Action>) -> Option<[f32; 2]> {
    let plan = &entry.figures.as_ref()?.plan;
    let ColorSource::Column(column) = plan.source else { return None };
    let attribute = entry.cloud.attributes.get(column)?.name.clone();
    let (low, high) = (plan.low, plan.high);
    let mut filters = session.scene.objects.visibility.filters.clone();
    let known = filters.iter().position(|filter| filter.attribute == attribute);
    let wanted = ui.horizontal(|ui| {
        let help = text!(
            "Hides the points of all clouds whose {attribute} is outside of the handles, as a filter of the tab Data",
            attribute
        );
        if ui.small_button(text!("Show this range only")).on_hover_text(help).clicked() {
            known.map(|index| filters.remove(index));
            filters.push(Filter { attribute: attribute.clone(), low, high });
            // The handles are shares of the points that are shown, which are fewer then.
            return Some((filters, [0.0, 1.0]));
        }
        let index = known?;
        let all =
            ui.small_button(text!("Show all")).on_hover_text(text!("Deletes the filter of {attribute}", attribute));
        filters.remove(index);
        let usual = scene::Color::default();
        all.clicked().then_some((filters, [usual.low, usual.high]))
    });
    let (filters, handles) = wanted.inner?;
    actions.push(Action::Clip(Clipping::Filter(filters)));
    Some(handles)
}

/// The filters, with their ranges. The button takes the range from the histogram's handles.
fn filters(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let before = &session.scene.objects.visibility.filters;
    let mut filters = before.clone();
    let mut gone = None;
    for (index, filter) in filters.iter_mut().enumerate() {
        ui.push_id(("filter", index), |ui| {
            ui.horizontal(|ui| {
                let label = name_label(ui, filter.attribute.as_str());
                let (low, high) = (filter.low, filter.high);
                let mut attributes = session.loaded.clouds.iter().flat_map(|entry| &entry.cloud.attributes);
                let is_whole = attributes.any(|own| own.name == filter.attribute && own.column_type.is_whole());
                let written = |value, decimals| match value {
                    f64::NEG_INFINITY => text!("lowest").into(),
                    f64::INFINITY => text!("highest").into(),
                    value => egui::emath::format_with_decimals_in_range(value, decimals),
                };
                let read = |typed: &str| match typed.trim() {
                    lowest if lowest == text!("lowest") => Some(f64::NEG_INFINITY),
                    highest if highest == text!("highest") => Some(f64::INFINITY),
                    typed if is_whole => typed_limit(typed),
                    typed => typed_number(typed),
                };
                let drag = |value| {
                    number_field_in_words(value, written, read).speed((high - low).abs().min(1e3) * 0.005 + 1e-3)
                };
                ui.add(drag(&mut filter.low).range(f64::NEG_INFINITY..=high)).labelled_by(label.id);
                ui.label(text!("to"));
                ui.add(drag(&mut filter.high).range(low..=f64::INFINITY)).labelled_by(label.id);
                let delete = ui.small_button("×").on_hover_text(text!("Delete"));
                if delete
                    .accessible_name(text!("Delete the filter of {attribute}", attribute = filter.attribute))
                    .clicked()
                {
                    gone = Some(index);
                }
                if let Some((low, high)) = handles_of(session, &filter.attribute) {
                    let take = ui.small_button("<>").on_hover_text(text!("Takes the range of the histogram's handles"));
                    if take
                        .accessible_name(text!("Range of {attribute} from the histogram", attribute = filter.attribute))
                        .clicked()
                    {
                        (filter.low, filter.high) = (low, high);
                    }
                }
            });
        });
    }
    gone.map(|index| filters.remove(index));
    if filters != *before {
        actions.push(Action::Clip(Clipping::Filter(filters)));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::{Attribute, Column, ColumnType};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::objects::figures::Figures;
    use crate::viewer::requests::action::Measuring;
    use crate::viewer::requests::outside::{Asked, Effect};
    use crate::viewer::requests::work::Work;

    fn harness() -> Harness<'static, Session> {
        Harness::builder().with_size([380.0, 900.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            Session::with_two_points(),
        )
    }

    fn clips(harness: &Harness<'static, Session>) -> Vec<Clip> {
        harness.state().scene.objects.clips.iter().map(|placed| placed.clip.clone()).collect()
    }

    fn add(harness: &mut Harness<'static, Session>, label: &str) {
        harness.get_by_label("Add clip").click();
        harness.run_ok();
        harness.get_by_label(label).click();
        harness.run_ok();
    }

    #[test]
    fn clips_are_added_switched_turned_inside_out_copied_deleted_and_undone() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Box about everything");
        add(&mut harness, "Sphere");
        let names = |harness: &Harness<'static, Session>| -> Vec<String> {
            clips(harness).into_iter().map(|clip| clip.name).collect()
        };
        assert_eq!(names(&harness), ["box", "sphere"]);
        let bounds = harness.state().bounds();
        assert!((clips(&harness)[0].position - bounds.center()).length() < 1e-9);
        harness.get_by_label("Show box").click();
        harness.run_ok();
        assert!(!clips(&harness)[0].on && clips(&harness)[1].on);
        harness.get_by_label("sphere shows its inside").click();
        harness.run_ok();
        assert_eq!(clips(&harness)[1].keep, Keep::Outside);
        assert!(!harness.state().scene.objects.test().shows_all());
        harness.get_by_label("Copy sphere").click();
        harness.run_ok();
        assert_eq!(names(&harness), ["box", "sphere", "sphere 2"]);
        harness.get_by_label("Delete box").click();
        harness.run_ok();
        assert_eq!(names(&harness), ["sphere", "sphere 2"]);
        harness.state_mut().act(Action::Undo);
        harness.state_mut().act(Action::Undo);
        assert_eq!(names(&harness), ["box", "sphere"]);
    }

    #[test]
    fn a_box_about_a_pick_needs_a_pick_and_a_prism_three_corners() {
        let mut harness = harness();
        harness.run_ok();
        add(&mut harness, "Box about the last pick (J)");
        assert_eq!(clips(&harness), []);
        add(&mut harness, "Prism drawn on the picture (Ctrl+J)");
        let session = harness.state_mut();
        session.scene.view_size = [400, 300];
        for pixel in [[100, 100], [300, 100], [200, 250]] {
            session.act(Action::PointAt(Some(pixel)));
            session.act(Action::Pick);
        }
        let corners = |session: &Session| session.tools.prism.as_ref().map(|draft| draft.corners.len());
        assert_eq!(corners(session), Some(3));
        // Backspace and undo take the last corner back, and Enter closes no polygon of two.
        session.act(Action::Undo);
        session.act(Action::Measuring(Measuring::End));
        assert_eq!(corners(session), Some(2));
        session.act(Action::Measuring(Measuring::RemoveCorner));
        assert_eq!(corners(session), Some(1));
        for pixel in [[300, 100], [200, 250]] {
            session.act(Action::PointAt(Some(pixel)));
            session.act(Action::Pick);
        }
        assert_eq!((corners(session), session.scene.objects.clips.len()), (Some(3), 0));
        session.act(Action::PointAt(Some([101, 101])));
        session.act(Action::Pick);
        assert!(session.tools.prism.is_none());
        let clip = session.scene.objects.clips[0].clip.clone();
        assert_eq!(clip.problem(), None);
        // What is seen within the polygon is inside, at every depth.
        let volume = clip.volume().volume;
        let lens = session.scene.lens();
        for (pixel, is_in) in [([200.0, 150.0], true), ([110.0, 200.0], false), ([200.0, 90.0], false)] {
            let (origin, direction) = lens.ray(pixel.into());
            for depth in [0.1, 1.0, 50.0] {
                assert_eq!(volume.contains(origin + direction * depth), is_in, "{pixel:?} {depth}");
            }
        }
    }

    #[test]
    fn the_points_that_are_shown_are_saved_where_a_person_says_and_that_is_stopped() {
        let mut harness = harness();
        harness.run_ok();
        harness.get_by_label_contains("Save what is shown").hover();
        harness.run_ok();
        harness.step();
        let help = "Writes the points that are shown to a new file: LAZ, LAS, COPC, E57, PLY, CSV";
        assert!(harness.query_by_label(help).is_some());
        harness.get_by_label_contains("Save what is shown").click();
        harness.run_ok();
        let proposed = harness.state().outside.effects.iter().find_map(|effect| match effect {
            Effect::AskPlace(Asked::Points, place) => Some(place.clone()),
            _ => None,
        });
        let place = proposed.expect("a place");
        assert!(place.ends_with("glint-cloud-1.laz"), "{place:?}");
        harness.state_mut().act(Action::Export(Export::To(place)));
        let is_asked = |effect: &Effect| matches!(effect, Effect::Work(Work::Export { .. }));
        assert_eq!(harness.state().outside.effects.iter().filter(|effect| is_asked(effect)).count(), 1);
        harness.run_steps(2);
        harness.get_by_label("Stop").click();
        harness.run_steps(2);
        let writing = harness.state().loaded.writing.as_ref().expect("a file that is written");
        assert!(writing.progress.is_cancelled());
    }

    #[test]
    fn hidden_classes_are_named_among_clips_and_filters_and_shown_again() {
        let mut harness = harness();
        harness.run_ok();
        assert!(harness.query_by_label("Nothing is clipped or filtered.").is_some());
        harness.state_mut().act(Action::ShowClasses(vec![2, 6, 70], false));
        harness.run_ok();
        assert!(harness.query_by_label("Nothing is clipped or filtered.").is_none());
        assert!(harness.query_by_label("Hidden: 2 ground, 6 building, 70").is_some());
        harness.get_by_label("Show all").click();
        harness.run_ok();
        assert!(harness.state().scene.objects.visibility.shows_all());
        assert!(harness.query_by_label("Nothing is clipped or filtered.").is_some());
    }

    #[test]
    fn filters_are_added_and_deleted() {
        let mut harness = harness();
        harness.run_ok();
        let filter = Filter { attribute: "intensity".into(), low: 3.0, high: 7.0 };
        harness.state_mut().act(Action::Clip(Clipping::Filter(vec![filter])));
        harness.run_ok();
        assert!(!harness.state().scene.objects.test().shows_all());
        harness.get_by_label("Delete the filter of intensity").click();
        harness.run_ok();
        assert!(harness.state().scene.objects.visibility.filters.is_empty());
    }

    #[test]
    fn the_ends_of_a_filter_are_typed_as_its_attribute_is() {
        for (column_type, low) in [(ColumnType::U32, 500_000.0), (ColumnType::F64, 500.0)] {
            let mut harness = harness();
            let attribute = Attribute { name: "gps".into(), column_type };
            harness.state_mut().loaded.clouds[0].cloud.attributes.push(attribute);
            let filter = Filter { attribute: "gps".into(), low: 3.0, high: 1e6 };
            harness.state_mut().act(Action::Clip(Clipping::Filter(vec![filter])));
            harness.run_ok();
            harness.get_all_by_role(egui::accesskit::Role::SpinButton).next().unwrap().focus();
            harness.run_ok();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.event(egui::Event::Text("500.000".into()));
            harness.run_ok();
            harness.key_press(egui::Key::Enter);
            harness.run_ok();
            assert_eq!(harness.state().scene.objects.visibility.filters[0].low, low, "{column_type:?}");
        }
    }

    #[test]
    fn the_range_of_the_histogram_becomes_a_filter_and_is_let_go_again() {
        let mut session = Session::with_two_points();
        let (color, test, up) = {
            let color = &mut session.scene.settings.color;
            (color.by, color.attribute) = (scene::ColorBy::Attribute, "intensity".into());
            (color.clone(), session.scene.objects.test(), session.up())
        };
        let entry = &mut session.loaded.clouds[0];
        let attribute = Attribute { name: "intensity".into(), column_type: ColumnType::F32 };
        entry.cloud.attributes.push(attribute);
        entry.put_late_column(0, [(0, Arc::new(Column::F32(vec![3.0, 7.0])))].into());
        entry.figures = Some(Figures::of(&entry.cloud, &color, &test, up));
        let mut harness = Harness::builder().with_size([380.0, 300.0]).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| super::super::colors::show(ui, session, actions));
            },
            session,
        );
        harness.run_ok();
        assert!(harness.query_by_label("Show all").is_none());
        harness.get_by_label("Show this range only").click();
        harness.run_ok();
        let filters = |harness: &Harness<'_, Session>| harness.state().scene.objects.visibility.filters.clone();
        let (low, high) = handles_of(harness.state(), "intensity").unwrap();
        assert_eq!(filters(&harness), [Filter { attribute: "intensity".into(), low, high }]);
        let handles = |harness: &Harness<'_, Session>| {
            let color = &harness.state().scene.settings.color;
            [color.low, color.high]
        };
        assert_eq!(handles(&harness), [0.0, 1.0], "the ramp goes over all that is shown");
        harness.get_by_label("Show this range only").click();
        harness.run_ok();
        assert_eq!(filters(&harness).len(), 1, "it takes the place of the one before");
        harness.get_by_label("Show all").click();
        harness.run_ok();
        let usual = scene::Color::default();
        assert_eq!((filters(&harness).len(), handles(&harness)), (0, [usual.low, usual.high]));
    }
}
