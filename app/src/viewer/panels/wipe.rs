//! Wipes in the timeline and over the picture: which states there are, where the lines stand, and the states' pictures.

use egui::{Align2, Color32, ComboBox, Pos2, Rect, RichText, TextEdit, Ui, pos2, vec2};
use scene::{CameraPath, METHODS, MOST_STATES, Method, RAY_TRACE, WIPE, WipeState, line_value};

use crate::shared::language::text;
use crate::viewer::filming::presets;
use crate::viewer::look::widgets::number_field_in;
use crate::viewer::panels::truth::tag;
use crate::viewer::requests::action::Film;
use crate::viewer::session::Session;

/// How long the line of a new wipe takes to cross the picture, in seconds.
const SECONDS: f64 = 4.0;
const WHOLE: Rect = Rect { min: Pos2::ZERO, max: pos2(1.0, 1.0) };

/// Draws the menu that adds states to a path.
pub fn add(ui: &mut Ui, session: &Session, path: &mut CameraPath, push: &mut impl FnMut(Film)) {
    let menu = ui.menu_button(text!("+ Wipe"), |ui| {
        if path.states.is_empty() {
            if ui.button(text!("Method | truth")).clicked() {
                begin(session, path, presets::to_truth(&session.scene), push);
            }
            let kept = session.kept.settings();
            let states = kept.and_then(|kept| presets::between(kept, &session.scene.settings));
            let button = ui.add_enabled(states.is_some(), egui::Button::new(text!("Kept | now")));
            let help = text!("Keep a state of the picture (Measure, Compare), and change parameters");
            if let (true, Some(states)) = (button.on_disabled_hover_text(help).clicked(), states) {
                begin(session, path, states, push);
            }
            return;
        }
        if path.states.len() < MOST_STATES && ui.button(text!("One state more")).clicked() {
            let [method, _] = presets::to_truth(&session.scene);
            path.set_states([path.states.clone(), vec![method]].concat());
        }
        if ui.button(text!("Remove the wipe")).clicked() {
            path.set_states(Vec::new());
        }
    });
    menu.response.on_hover_text(text!("A line that moves over the picture, with a state of it on each side"));
}

/// Adds states, and a line that crosses the picture from the time of the mark on.
fn begin(session: &Session, path: &mut CameraPath, states: [WipeState; 2], push: &mut impl FnMut(Film)) {
    path.set_states(states.to_vec());
    let time = session.filming.timeline.time;
    for (time, line) in [(time, 1.0), (time + SECONDS, 0.0)] {
        // A track of lines takes any share.
        let _ = path.set_key(WIPE, time, line_value(&[line]));
    }
    push(Film::Scrub(time));
}

/// Draws the line of the timeline with the states of a path, and the places of the lines at the time of the mark.
pub fn row(ui: &mut Ui, session: &Session, path: &mut CameraPath) {
    if path.states.is_empty() {
        return;
    }
    let time = session.filming.timeline.time;
    ui.horizontal(|ui| {
        let (mut states, count) = (path.states.clone(), path.states.len());
        let mut removed = None;
        let mut lines = path.lines(time);
        for (index, state) in states.iter_mut().enumerate() {
            if index > 0 {
                let line = &mut lines[index - 1];
                let mut percent = *line * 100.0;
                let drag = number_field_in(&mut percent, " %").speed(0.2).range(0.0..=100.0).max_decimals(1);
                let help = text!("Where the line stands, of the picture's width: a key at the time of the mark");
                let drag = ui.add(drag).on_hover_text(help).accessible_name(text!("Line {index}", index));
                if drag.changed() {
                    *line = percent / 100.0;
                }
            }
            if one(ui, state, index + 1, count) {
                removed = Some(index);
            }
        }
        if lines != path.lines(time) {
            // A track of lines takes any share.
            let _ = path.set_key(WIPE, time, line_value(&lines));
        }
        removed.into_iter().for_each(|index| drop(states.remove(index)));
        if states != path.states {
            path.set_states(states);
        }
    });
}

/// Draws the fields of the state with a number, of so many. Returns whether it is to be removed.
fn one(ui: &mut Ui, state: &mut WipeState, number: usize, count: usize) -> bool {
    let shown = state.method.as_deref().unwrap_or(text!("as the path"));
    let list = ComboBox::from_id_salt(("state", number)).width(130.0).selected_text(shown).truncate();
    let list = list.show_ui(ui, |ui| {
        ui.selectable_value(&mut state.method, None, text!("as the path"));
        let methods = METHODS.iter().filter(|row| row.method != Method::Auto).map(|row| row.name);
        for method in methods.chain([RAY_TRACE]) {
            ui.selectable_value(&mut state.method, Some(method.to_owned()), method);
        }
    });
    let help = text!("How its mirrors are drawn; `ray_trace` shows what the ray tracer finds in the points");
    list.response.on_hover_text(help).accessible_name(text!("Method of state {number}", number));
    let name = TextEdit::singleline(&mut state.name).desired_width(90.0).hint_text(text!("no name"));
    ui.add(name)
        .on_hover_text(text!("It is written over its part"))
        .accessible_name(text!("Name of state {number}", number));
    if !state.parameters.is_empty() {
        let values = state.parameters.len();
        ui.menu_button(format!("{values} {}", if values == 1 { text!("value") } else { text!("values") }), |ui| {
            let mut removed = None;
            for (key, value) in &state.parameters {
                ui.horizontal(|ui| {
                    if ui.small_button("×").accessible_name(text!("Remove {key}", key)).clicked() {
                        removed = Some(key.clone());
                    }
                    ui.label(RichText::new(format!("{key} = {}", param::shortened(&value.to_string(), 60))).small());
                });
            }
            removed.iter().for_each(|key| drop(state.parameters.remove(key)));
        });
    }
    count > 2 && ui.small_button("×").accessible_name(text!("Remove state {number}", number)).clicked()
}

/// Draws the pictures of the states that the window does not draw now over the picture in `rect`.
pub fn paint(ui: &Ui, rect: Rect, session: &Session) {
    let (scene, timeline) = (&session.scene, &session.filming.timeline);
    let Some((path, time)) = timeline.shown().filter(|_| scene.posed.is_some()) else { return };
    let width = scene.view_size[0];
    for (index, columns) in path.parts(time, width) {
        let x = |column: u32| rect.left() + rect.width() * column as f32 / width.max(1) as f32;
        let part = Rect::from_x_y_ranges(x(columns.start)..=x(columns.end), rect.y_range());
        let painter = ui.painter().with_clip_rect(part);
        let state = &path.states[index];
        match timeline.wiping.picture(scene, state) {
            Some(picture) => drop(painter.image(picture.texture(ui.ctx()), rect, WHOLE, Color32::WHITE)),
            None if index == timeline.wiping.turn && !state.is_traced() => {}
            None => {
                let text = match () {
                    () if timeline.wiping.is_refused(scene, state) => text!("there is no picture of it"),
                    () if state.is_traced() && timeline.wiping.is_tracing() => text!("its mirrors are being traced"),
                    () if state.is_traced() => text!("its mirrors are traced once the picture stands still"),
                    () => text!("it is drawn once the picture stands still"),
                };
                let at = part.left_bottom() + vec2(10.0, -10.0);
                tag(&painter, at, Align2::LEFT_BOTTOM, text);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::interface;
    use crate::viewer::requests::action::{Action, PathPreset};

    #[test]
    fn states_and_their_line_are_changed_in_the_timeline_and_undone() {
        let mut session = Session::with_two_points();
        session.act(Action::Film(Film::Add(PathPreset::WipeToTruth)));
        let mut harness = Harness::builder().with_size([1280.0, 800.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| {
                let mut actions = interface::show(ui, session, None);
                actions.retain(|action| !matches!(action, Action::Resize(_)));
                session.act_all(actions);
                session.step(std::time::Instant::now(), false);
            },
            session,
        );
        harness.run_ok();
        let path = |harness: &Harness<'_, Session>| {
            let session = harness.state();
            session.filming.timeline.path(&session.scene).unwrap().clone()
        };
        let made = path(&harness);
        assert_eq!(made.states.len(), 2);
        harness.get_by_label("Method of state 1").click();
        harness.run_ok();
        harness.get_by_label("sscr").click();
        harness.run_ok();
        assert_eq!(path(&harness).states[0].method.as_deref(), Some("sscr"));
        // A key of the line is where it stands at the time of the mark.
        harness.state_mut().act(Action::Film(Film::Scrub(3.0)));
        harness.state_mut().act(Action::Film(Film::Key(WIPE.into())));
        harness.run_ok();
        let track = &path(&harness).tracks[0];
        assert_eq!((track.times.len(), &track.values[2]), (5, &toml::Value::Float(0.5)));
        harness.get_by_label("+ Wipe").click();
        harness.run_ok();
        harness.get_by_label("One state more").click();
        harness.run_ok();
        let three = path(&harness);
        assert_eq!((three.states.len(), three.lines(0.0), three.check()), (3, vec![1.0, 1.0], Ok(())));
        harness.get_by_label("Remove state 2").click();
        harness.run_ok();
        assert_eq!(path(&harness).states.len(), 2);
        harness.get_by_label("+ Wipe").click();
        harness.run_ok();
        harness.get_by_label("Remove the wipe").click();
        harness.run_ok();
        assert!(path(&harness).states.is_empty() && path(&harness).tracks.is_empty());
        harness.state_mut().act(Action::Undo);
        harness.run_ok();
        assert_eq!(path(&harness).states.len(), 2, "undone");
    }
}
