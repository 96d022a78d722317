//! The panel of measurements and notes: begins, selects, switches, names, copies and deletes them, and flies to them.

use egui::{RichText, Ui};
use scene::{Measurement, MeasurementKind, Note, Object};

use crate::shared::language::{text, translated};
use crate::shared::measuring::{Figure, are_of_loaded};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{eye, name_label, number_field};
use crate::viewer::objects::{ObjectId, PlacedMeasurement, PlacedNote};
use crate::viewer::requests::action::{Action, Measuring};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::units;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut push = |measuring: Measuring| actions.push(Action::Measuring(measuring));
    ui.horizontal(|ui| {
        measure_menu(ui, &mut push);
        let shortcut = bindings::shortcut(&Action::Measuring(Measuring::BeginNote));
        let note =
            ui.button(text!("Add note")).on_hover_text(text!("The next click places a note ({shortcut})", shortcut));
        if note.clicked() {
            push(Measuring::BeginNote);
        }
        let has_any = !session.scene.objects.measurements.is_empty();
        let copy = ui.add_enabled(has_any, egui::Button::new(text!("Copy all")));
        if copy.on_hover_text(text!("Copies all values as a table")).clicked() {
            push(Measuring::CopyAll);
        }
    });
    placing(ui, session, actions);
    let objects = &session.scene.objects;
    if objects.measurements.is_empty() && objects.notes.is_empty() {
        ui.label(RichText::new(text!("Nothing is measured or noted.")).color(theme::WEAK));
    }
    for placed in &objects.measurements {
        let row = ui.push_id(placed.id.0, |ui| ui.vertical(|ui| measurement_row(ui, session, placed, actions)));
        show_selected(&row.response, session, placed.id);
    }
    for placed in &objects.notes {
        let row = ui.push_id(placed.id.0, |ui| ui.vertical(|ui| note_row(ui, session, placed, actions)));
        show_selected(&row.response, session, placed.id);
    }
    if objects.notes.len() > 1 {
        ui.horizontal(|ui| {
            for (text, step) in [(text!("Previous note"), -1), (text!("Next note"), 1)] {
                let action = Action::Measuring(Measuring::StepNote(step));
                let button = ui.small_button(text).on_hover_text(bindings::shortcut(&action));
                actions.extend(button.clicked().then_some(action));
            }
        });
    }
}

fn measure_menu(ui: &mut Ui, push: &mut impl FnMut(Measuring)) {
    ui.menu_button(text!("Measure"), |ui| {
        for kind in MeasurementKind::ALL {
            let shortcut = bindings::shortcut(&Action::Measuring(Measuring::Begin(kind)));
            if ui.button(format!("{} ({shortcut})", translated(kind.name()))).on_hover_text(help(kind)).clicked() {
                push(Measuring::Begin(kind));
            }
        }
    });
}

fn help(kind: MeasurementKind) -> &'static str {
    match kind {
        MeasurementKind::Point => text!("The coordinates of a point, and spacing and noise around it"),
        MeasurementKind::Distance => text!("From one point to another, with its horizontal and vertical parts"),
        MeasurementKind::Polyline => text!("The length of a line through points"),
        MeasurementKind::Height => text!("How much higher the second point is than the first"),
        MeasurementKind::Angle => text!("The angle at the second of three points"),
        MeasurementKind::Area => text!("The area of a polygon"),
        MeasurementKind::Plane => text!("The plane through the points around one or more clicks"),
        MeasurementKind::Circle => text!("The circle through three or more points"),
        MeasurementKind::Cylinder => text!("The cylinder through the points around one or more clicks"),
        MeasurementKind::Volume => text!("Between the points over a polygon and the plane through its corners"),
    }
}

/// What is being placed: what to click, the value so far, and the ways to end.
fn placing(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(placing) = &session.tools.measurements.placing else { return };
    ui.label(RichText::new(placing.hint()).color(theme::ACCENT));
    let key = bindings::shortcut(&Action::PickMiddle);
    ui.label(RichText::new(text!("{key} picks in the middle of the picture", key)).small().color(theme::WEAK));
    if let Some(figure) = placing.live(session.scene.hovered(), session.up()).first() {
        ui.label(
            RichText::new(format!("{}  {}", translated(figure.name), figure.text(&units(&session.loaded)))).monospace(),
        );
    }
    ui.horizontal_wrapped(|ui| {
        let mut button = |text: &str, action: Action| {
            let shortcut = bindings::shortcut(&action);
            actions.extend(ui.small_button(format!("{text} ({shortcut})")).clicked().then_some(action));
        };
        button(text!("End"), Action::Measuring(Measuring::End));
        button(text!("Back"), Action::Measuring(Measuring::RemoveCorner));
        button(text!("Cancel"), Action::EndTool);
    });
}

/// Scrolls to a row whose object has just been selected: the panel is longer than most windows are high, and a new note
/// waits for its text there.
fn show_selected(row: &egui::Response, session: &Session, id: ObjectId) {
    let known = egui::Id::unique("the selected measurement or note");
    let before: Option<ObjectId> = row.ctx.data(|data| data.get_temp(known)).flatten();
    if session.scene.selected != Some(id) {
        if before == Some(id) {
            row.ctx.data_mut(|data| data.insert_temp(known, None::<ObjectId>));
        }
    } else if before != Some(id) {
        row.ctx.data_mut(|data| data.insert_temp(known, Some(id)));
        row.scroll_to_me(Some(egui::Align::Center));
    }
}

/// A button at the right end of a row.
fn row_button(ui: &mut Ui, text: &str, help: &str) -> bool {
    ui.small_button(text).on_hover_text(help).accessible_name(help).clicked()
}

/// The first line of a row: the eye switches it, a click on the name selects it.
fn row(
    ui: &mut Ui,
    session: &Session,
    (id, name, on): (ObjectId, &str, bool),
    switched: Object,
    copied: String,
    actions: &mut Vec<Action>,
) {
    ui.horizontal(|ui| {
        if eye(ui, on, name).clicked() {
            actions.push(Action::ChangeObject(id, Box::new(switched)));
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if row_button(ui, "×", &text!("Delete {name}", name)) {
                actions.extend([Action::Select(Some(id)), Action::Delete]);
            }
            if row_button(ui, text!("Copy"), &text!("Copy {name}", name)) {
                actions.push(Action::Copy(copied));
            }
            if row_button(ui, text!("Go"), &text!("Fly to {name}", name)) {
                actions.push(Action::Measuring(Measuring::FlyTo(id)));
            }
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                let is_selected = session.scene.selected == Some(id);
                let label = egui::Button::selectable(is_selected, name).truncate();
                if ui.add(label).clicked() {
                    actions.push(Action::Select(if is_selected { None } else { Some(id) }));
                }
            });
        });
    });
}

fn measurement_row(ui: &mut Ui, session: &Session, placed: &PlacedMeasurement, actions: &mut Vec<Action>) {
    let PlacedMeasurement { id, measurement } = placed;
    let (figures, units) = (session.tools.measurements.figures(*id), units(&session.loaded));
    let told = |figure: &Figure| format!("{}  {}", translated(figure.name), figure.text(&units));
    let all = |figures: &Vec<Figure>| figures.iter().map(told).collect::<Vec<_>>().join("\n");
    let copied = figures.and_then(|figures| figures.as_ref().ok()).map(all).unwrap_or_default();
    let switched = Object::Measurement(Measurement { on: !measurement.on, ..measurement.clone() });
    let head = (*id, measurement.name.as_str(), measurement.on);
    row(ui, session, head, switched, format!("{}\n{copied}\n", measurement.name), actions);
    let is_selected = session.scene.selected == Some(*id);
    match figures {
        None => {
            let waits = session.loaded.points_come();
            let text =
                if waits { text!("waits until all points and their normals are there") } else { text!("measuring") };
            ui.label(RichText::new(text).color(theme::WEAK));
        }
        Some(Err(problem)) => drop(ui.colored_label(theme::ERROR, problem)),
        Some(Ok(figures)) => {
            let shown = if is_selected { figures.len() } else { Figure::main_ones(measurement.kind) };
            egui::Grid::new("figures").num_columns(2).spacing([12.0, 1.0]).show(ui, |ui| {
                for figure in figures.iter().take(shown) {
                    ui.label(RichText::new(translated(figure.name)).size(12.0).color(theme::WEAK));
                    let text = RichText::new(figure.text(&units)).monospace().size(12.0);
                    ui.add(egui::Label::new(text).selectable(true));
                    ui.end_row();
                }
            });
            if lacks_certainty(measurement.kind, figures) {
                let text = text!("± unknown: the points shown around its corners are no surface");
                ui.label(RichText::new(text).small().color(theme::WARNING)).on_hover_text(text!(
                    "How certain a value is follows from the points that are shown around its corners. Clips, filters \
                     and hidden classes may hide them."
                ));
            }
            if are_of_loaded(figures) {
                let text = text!(
                    "no ±: not all of the points here are loaded; `glint measure` with the saved scene reads all that \
                     can be read"
                );
                ui.label(RichText::new(text).small().color(theme::WARNING)).on_hover_text(text!(
                    "Of each cell of space of a streamed cloud the point nearest to its middle is loaded first. Noise \
                     has a part in that choice, so how these points scatter does not say how far the value is off. \
                     From nearer, all of them may be loaded. Of a file that is damaged, points are missing for good; \
                     one whose reading was stopped has them all when it is opened again."
                ));
            }
        }
    }
    if is_selected {
        details(ui, session, *id, measurement, actions);
    }
}

/// Whether the values would say how certain they are, if the points around the corners did.
fn lacks_certainty(kind: MeasurementKind, figures: &[Figure]) -> bool {
    let is_of_corners = !kind.has_reach() && kind != MeasurementKind::Volume;
    is_of_corners && figures.first().is_some_and(|figure| figure.deviation.is_none())
}

/// The name, the colour and the numbers of the selected measurement.
fn details(ui: &mut Ui, session: &Session, id: ObjectId, before: &Measurement, actions: &mut Vec<Action>) {
    let mut measurement = before.clone();
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Name"));
        ui.add(egui::TextEdit::singleline(&mut measurement.name).desired_width(130.0)).labelled_by(label.id);
        color(ui, &mut measurement.color);
    });
    if let Some(reach) = &mut measurement.reach {
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("Reach"));
            let drag = number_field(reach).speed(before.reach.unwrap_or(1.0) * 0.01).range(1e-9..=1e9);
            ui.add(drag).labelled_by(label.id);
        });
    }
    if measurement.kind == MeasurementKind::Volume {
        level(ui, &mut measurement, session);
    }
    if session.loaded.clouds.iter().any(|entry| entry.streamed.is_some()) {
        let text = text!("Of the points that are loaded; `glint measure` with the saved scene takes all of them.");
        ui.label(RichText::new(text).small().color(theme::WEAK));
    }
    if measurement != *before {
        actions.push(Action::ChangeObject(id, Box::new(Object::Measurement(measurement))));
    }
}

/// The plane of a volume: through its corners, or level at a height.
fn level(ui: &mut Ui, measurement: &mut Measurement, session: &Session) {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Plane"));
        let mut is_level = measurement.level.is_some();
        if ui.checkbox(&mut is_level, text!("level at")).labelled_by(label.id).changed() {
            let heights = measurement.points.iter().map(|point| point.dot(session.up()));
            measurement.level = is_level.then(|| heights.fold(f64::INFINITY, f64::min));
        }
        if let Some(level) = &mut measurement.level {
            ui.add(number_field(level).speed(0.01)).accessible_name(text!("Height of the plane"));
        }
    });
}

/// A button for a colour.
fn color(ui: &mut Ui, color: &mut [f32; 3]) {
    let mut bytes = color.map(|share| (share * 255.0).round() as u8);
    if ui.color_edit_button_srgb(&mut bytes).accessible_name(text!("Colour")).changed() {
        *color = bytes.map(|byte| f32::from(byte) / 255.0);
    }
}

fn note_row(ui: &mut Ui, session: &Session, PlacedNote { id, note }: &PlacedNote, actions: &mut Vec<Action>) {
    let title = note.title();
    let switched = Object::Note(Note { on: !note.on, ..note.clone() });
    row(ui, session, (*id, title, note.on), switched, note.text.clone(), actions);
    if session.scene.selected != Some(*id) {
        return;
    }
    let mut changed = note.clone();
    let edit = egui::TextEdit::multiline(&mut changed.text).desired_rows(3).desired_width(f32::INFINITY);
    let edit = ui.add(edit.hint_text(text!("What is there to see?"))).accessible_name(text!("Text of the note"));
    // A new note takes the keyboard once: one whose text was undone leaves it to the shortcuts.
    let place = egui::Id::unique("the note that took the keyboard last");
    let has_had = ui.data(|data| data.get_temp::<ObjectId>(place)) == Some(*id);
    if note.text.is_empty() && !has_had && !ui.ctx().text_edit_focused() {
        ui.data_mut(|data| data.insert_temp(place, *id));
        edit.request_focus();
    }
    ui.horizontal(|ui| {
        color(ui, &mut changed.color);
        if ui
            .small_button(text!("This view"))
            .on_hover_text(text!("The note keeps the view that is shown now"))
            .clicked()
        {
            changed.camera = Some(session.scene.camera);
        }
    });
    if changed != *note {
        actions.push(Action::ChangeObject(*id, Box::new(Object::Note(changed))));
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use world::Part;

    use super::*;
    use crate::overlays::lens::Lens;
    use crate::viewer::bench::Bench;
    use crate::viewer::picture::messages::{PickPurpose, PickedPoint, Report};
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::tools::measurements::Placing;

    fn harness() -> Harness<'static, Session> {
        let mut session = Session::with_two_points();
        session.scene.view_size = [400, 300];
        Harness::builder().with_size([380.0, 900.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        )
    }

    fn choose(harness: &mut Harness<'static, Session>, label: &str) {
        harness.get_by_label("Measure").click();
        harness.run_ok();
        harness.get_by_label(label).click();
        harness.run_ok();
    }

    /// A click whose answer is one of the two points of the cloud, or a gap.
    fn click(session: &mut Session, index: Option<usize>) {
        session.act(Action::PointAt(Some([10, 10])));
        session.act(Action::Pick);
        let chunk = session.loaded.clouds[0].key.chunk(Part::Block(0));
        let point = index.map(|index| PickedPoint { chunk, index });
        session.on_report(Report::Picked { pixel: [10, 10], purpose: PickPurpose::Corner, point });
    }

    /// Carries out the measurements that were asked for.
    fn work(session: &mut Session) {
        session.step(session.outside.now, false);
        let (work, rest) = std::mem::take(&mut session.outside.effects)
            .into_iter()
            .partition(|effect| matches!(effect, Effect::Work(crate::viewer::requests::work::Work::Measure { .. })));
        session.outside.effects = rest;
        let found = std::cell::RefCell::new(Vec::new());
        for effect in work {
            let Effect::Work(work) = effect else { continue };
            work.run(&scene::Stream::default(), |one| found.borrow_mut().push(one));
        }
        found.into_inner().into_iter().for_each(|found| session.on_found(found));
    }

    fn measurements(harness: &Harness<'static, Session>) -> Vec<Measurement> {
        let placed = &harness.state().scene.objects.measurements;
        placed.iter().map(|placed| placed.measurement.clone()).collect()
    }

    #[test]
    fn a_new_note_takes_the_keyboard_and_one_whose_text_is_undone_does_not() {
        let mut harness = harness();
        harness.run_ok();
        let session = harness.state_mut();
        session.act(Action::Measuring(Measuring::BeginNote));
        click(session, Some(0));
        harness.run_ok();
        assert!(harness.ctx.text_edit_focused(), "its text can be typed at once");
        harness.event(egui::Event::Text("crack".into()));
        harness.run_ok();
        harness.key_press(egui::Key::Escape);
        harness.run_ok();
        let session = harness.state_mut();
        session.scene.history.settle(&session.scene.settings, &session.scene.objects);
        session.act(Action::Undo);
        harness.run_ok();
        assert_eq!(harness.state().scene.objects.notes[0].note.text, "");
        assert!(!harness.ctx.text_edit_focused(), "keys are shortcuts again");
    }

    #[test]
    fn a_measurement_says_that_it_waits_for_points_and_normals() {
        let mut harness = harness();
        choose(&mut harness, "distance (Alt+2)");
        let session = harness.state_mut();
        let job = session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        [0, 1].into_iter().for_each(|index| click(session, Some(index)));
        work(session);
        harness.run_steps(2);
        let waits = |harness: &Harness<'_, Session>| harness.query_by_label_contains("waits until").is_some();
        assert!(waits(&harness));
        let session = harness.state_mut();
        session.with_loaded(|loaded, beside| loaded.on_loading(job, world::Event::Finished, beside));
        harness.run_steps(2);
        assert!(!waits(&harness) && harness.query_by_label("measuring").is_some());
    }

    #[test]
    fn a_distance_is_clicked_renamed_copied_deleted_and_undone_and_a_gap_is_told() {
        let mut harness = harness();
        harness.run_ok();
        choose(&mut harness, "distance (Alt+2)");
        let session = harness.state_mut();
        let told = |session: &Session| session.outside.messages.all.last().map(|message| message.text.clone());
        assert_eq!(told(session).as_deref(), Some("distance: click 2 points"));
        click(session, Some(0));
        click(session, None);
        let messages = &session.outside.messages.all;
        assert!(messages.iter().any(|message| message.text.contains("there is no point there")), "a gap");
        let placing = session.tools.measurements.placing.as_ref().unwrap();
        let live = placing.live(Some(DVec3::new(3.0, 4.0, 0.0)), DVec3::Z);
        assert_eq!((placing.corners.len(), live[0].value), (1, 5.0));
        assert_eq!(placing.hint(), "distance: click point 2 of 2");
        click(session, Some(1));
        work(session);
        harness.run_ok();
        assert_eq!(measurements(&harness)[0].points, [DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0)]);
        // A cloud of two points gives no uncertainty, and the panel says so.
        assert!(harness.query_by_label_contains("± unknown").is_some());
        assert_eq!(harness.query_all_by_label("14.1421").count(), 2, "and its horizontal part");
        let session = harness.state_mut();
        session.act(Action::Measuring(Measuring::CopyAll));
        let copied = session.outside.effects.iter().find_map(|effect| match effect {
            Effect::Copy(text) => Some(text.clone()),
            _ => None,
        });
        assert!(copied.unwrap().starts_with("distance\tdistance\tdistance\t14.1421\thorizontal\t14.1421"));
        let (id, mut renamed) = (session.scene.objects.measurements[0].id, measurements(&harness).remove(0));
        renamed.name = "the door".into();
        harness.state_mut().act(Action::ChangeObject(id, Box::new(Object::Measurement(renamed))));
        harness.run_ok();
        harness.get_by_label("Fly to the door").click();
        harness.run_ok();
        let camera = harness.state().scene.camera;
        assert!((camera.pivot - DVec3::new(5.0, 5.0, 0.0)).length() < 1e-9, "{camera:?}");
        harness.get_by_label("Delete the door").click();
        harness.run_ok();
        assert_eq!(measurements(&harness), []);
        harness.state_mut().act(Action::Undo);
        assert_eq!(measurements(&harness)[0].name, "the door");
        let told = &harness.state().outside.messages.all;
        assert!(told.last().is_some_and(|message| message.text == "Undone: measurement `the door`"), "undo tells");
    }

    #[test]
    fn every_kind_of_measurement_is_clicked_and_shows_its_closed_form() {
        // A triangle of 3, 4 and 5 with a point above it; a slope of 3 in 4; a column with a radius of 2.
        let mut points = vec![[0.0; 3], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 12.0]];
        let slope = points.len();
        for index in 0..400 {
            let (x, y) = ((index % 20) as f32 * 0.2, (index / 20) as f32 * 0.2);
            points.push([100.0 + x, y, x * 0.75]);
        }
        let column = points.len();
        for index in 0..400 {
            let turn = (index % 40) as f32 * std::f32::consts::TAU / 40.0;
            points.push([200.0 + 2.0 * turn.cos(), 2.0 * turn.sin(), (index / 40) as f32 * 0.25]);
        }
        let mut session = Session::with_points(points);
        session.scene.view_size = [400, 300];
        let mut harness = Harness::builder().with_size([380.0, 2600.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        let (corner, far) = (slope, slope + 399);
        let (along, across) = (slope + 19, slope + 380);
        let slant = 0.75_f64.atan().to_degrees();
        // Under the slope of 3.8 by 3.8, whose mean height is 0.75 * 1.9.
        let volume = 3.8 * 3.8 * 0.75 * 1.9;
        // The button, the points that are clicked, the reach, and a value by its name.
        type Case<'a> = (&'a str, &'a [usize], Option<f64>, &'a str, f64);
        let kinds: [Case<'_>; 10] = [
            ("point (Alt+1)", &[2], None, "y", 4.0),
            ("distance (Alt+2)", &[0, 3], None, "distance", 13.0),
            ("polyline (Alt+3)", &[0, 1, 2], None, "length", 7.0),
            ("height (Alt+4)", &[2, 3], None, "height", 12.0),
            ("angle (Alt+5)", &[1, 0, 2], None, "angle", (4.0_f64 / 3.0).atan().to_degrees()),
            ("area (Alt+6)", &[0, 1, 2], None, "area", 6.0),
            ("plane (Alt+7)", &[corner, far], Some(9.0), "dip", slant),
            ("circle (Alt+8)", &[0, 1, 2], None, "radius", 2.5),
            ("cylinder (Alt+9)", &[column, column + 399], Some(5.0), "radius", 2.0),
            ("volume (Alt+0)", &[corner, along, far, across], None, "volume", volume),
        ];
        for (index, (label, clicks, reach, name, expected)) in kinds.into_iter().enumerate() {
            choose(&mut harness, label);
            let session = harness.state_mut();
            clicks.iter().for_each(|point| click(session, Some(*point)));
            if session.tools.measurements.placing.is_some() {
                session.act(Action::Measuring(Measuring::End));
            }
            let placed = session.scene.objects.measurements[index].clone();
            let level = (placed.measurement.kind == MeasurementKind::Volume).then_some(0.0);
            let changed = Measurement { reach, level, ..placed.measurement };
            session.act(Action::ChangeObject(placed.id, Box::new(Object::Measurement(changed))));
            (0..3).for_each(|_| work(session));
            let figures = session.tools.measurements.figures(placed.id).cloned();
            let figures = figures.unwrap_or_else(|| panic!("{label}: no values"));
            let figures = figures.unwrap_or_else(|problem| panic!("{label}: {problem}"));
            let figure = figures.iter().find(|figure| figure.name == name);
            let figure = figure.unwrap_or_else(|| panic!("{label}: {figures:?}"));
            let tolerance = if name == "volume" { 0.02 * volume } else { 1e-4 };
            assert!((figure.value - expected).abs() < tolerance, "{label}: {figure:?}, expected {expected}");
        }
        harness.run_ok();
        for shown in ["13", "12"] {
            assert!(harness.query_all_by_label_contains(shown).count() > 0, "{shown} is not in the list");
        }
    }

    #[test]
    fn a_click_where_handles_would_be_is_a_corner_while_something_is_placed() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let session = &mut bench.session;
        let placed = session.scene.objects.mirrors[0].clone();
        let request = session.frames.shown.as_ref().map(|shown| shown.request.clone()).unwrap();
        let lens = Lens::new(&request.camera, &request.settings.view, request.size);
        let (origin, direction) = lens.ray(glam::DVec2::new(32.0, 24.0));
        let mirror = scene::Mirror { position: origin + direction * 2.0, ..placed.mirror };
        session.act(Action::ChangeObject(placed.id, Box::new(Object::Mirror(mirror.clone()))));
        session.act(Action::Select(Some(placed.id)));
        session.act(Action::Measuring(Measuring::Begin(MeasurementKind::Distance)));
        let mut harness = Harness::builder()
            .with_size([1100.0, 800.0])
            .with_max_steps(16)
            .build_ui_state(|ui, bench: &mut Bench| bench.show(ui), bench);
        harness.run_ok();
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        let pos = egui::pos2(310.0 + 395.0, 386.0);
        harness.event(egui::Event::PointerMoved(pos));
        harness.run_ok();
        for pressed in [true, false] {
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
            harness.run_ok();
        }
        let session = &harness.state().session;
        assert!(session.tools.measurements.placing.as_ref().is_some_and(Placing::has_begun), "the click is a corner");
        assert_eq!(session.scene.objects.mirrors[0].mirror.position, mirror.position);
    }

    #[test]
    fn a_polyline_takes_points_back_and_ends_with_enter_once_it_has_enough() {
        let mut harness = harness();
        choose(&mut harness, "polyline (Alt+3)");
        let session = harness.state_mut();
        click(session, Some(0));
        session.act(Action::Measuring(Measuring::End));
        assert_eq!(session.scene.objects.measurements.len(), 0, "one point is too few");
        click(session, Some(1));
        click(session, Some(0));
        click(session, Some(0));
        session.act(Action::Measuring(Measuring::RemoveCorner));
        click(session, Some(0));
        session.act(Action::Undo);
        // A double-click ends with the answer to its first click.
        session.act(Action::PointAt(Some([10, 10])));
        session.act(Action::Pick);
        session.act(Action::Measuring(Measuring::End));
        assert_eq!(session.scene.objects.measurements.len(), 0, "a click is not answered yet");
        let point = PickedPoint { chunk: session.loaded.clouds[0].key.chunk(Part::Block(0)), index: 1 };
        session.on_report(Report::Picked { pixel: [10, 10], purpose: PickPurpose::Corner, point: Some(point) });
        work(session);
        harness.run_ok();
        assert_eq!(measurements(&harness)[0].points.len(), 4);
        assert!(harness.query_all_by_label("42.4264").count() > 0);
        // Esc gives the next one up.
        choose(&mut harness, "area (Alt+6)");
        click(harness.state_mut(), Some(0));
        harness.state_mut().act(Action::EndTool);
        assert!(harness.state().tools.measurements.placing.is_none());
        assert_eq!(measurements(&harness).len(), 1);
    }

    #[test]
    fn notes_are_written_stepped_through_saved_and_undone() {
        let mut harness = harness();
        for (index, text) in ["a crack", "a stain"].into_iter().enumerate() {
            harness.get_by_label("Add note").click();
            harness.run_ok();
            click(harness.state_mut(), Some(index));
            harness.run_ok();
            harness.get_by_role(egui::Role::MultilineTextInput).type_text(text);
            harness.run_ok();
        }
        let notes = |harness: &Harness<'static, Session>| -> Vec<Note> {
            harness.state().scene.objects.notes.iter().map(|placed| placed.note.clone()).collect()
        };
        let texts: Vec<String> = notes(&harness).into_iter().map(|note| note.text).collect();
        assert_eq!(texts, ["a crack", "a stain"]);
        assert_eq!(notes(&harness)[1].position, DVec3::new(10.0, 10.0, 0.0));
        let written_in = notes(&harness)[0].camera.unwrap();
        let session = harness.state_mut();
        session.scene.camera.orbit(1.0, 0.2);
        session.act(Action::Measuring(Measuring::StepNote(1)));
        assert_eq!(session.scene.selected, Some(session.scene.objects.notes[0].id), "the first follows the last");
        assert!(session.scene.camera.eye.distance(written_in.eye) < 1e-9, "its own view");
        session.act(Action::Measuring(Measuring::StepNote(-1)));
        assert_eq!(session.scene.selected, Some(session.scene.objects.notes[1].id));
        session.act(Action::Delete);
        assert_eq!(session.scene.objects.notes.len(), 1);
        session.act(Action::Undo);
        assert_eq!(session.scene.objects.notes.len(), 2);
    }
}
