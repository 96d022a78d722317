//! Turns input into actions: reads the window's input over the picture, and finds the actions in the table of bindings.

pub mod gizmo;
pub mod outlines;
pub mod typed_ahead;

use std::collections::HashSet;
use std::path::Path;
use std::time::Duration;

use egui::{Event, MouseWheelUnit, Response, Ui};
use glam::{DVec2, DVec3};

use crate::viewer::requests::action::{Action, Filing, Measuring};
use crate::viewer::requests::bindings;
use crate::viewer::requests::bindings::Trigger;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::{Placing, Wanted};

/// The cursor rests when it has not moved for this long. Then the point under it is looked up.
const HOVER_DELAY: Duration = Duration::from_millis(60);

/// An arrow key turns the camera as a drag of so many points of the window a second does: by a radian.
const ARROW_SPEED: f64 = 200.0;
/// The longest time between two paints for which held keys move the camera, in seconds: slow paints do not slow it.
const LONGEST_STEP: f32 = 0.5;
/// How much faster it turns at most while the key for moving fast is down.
const MOST_ARROW_FACTOR: f64 = 2.0;

/// What is done before any widget sees the input of a frame of the window. Returns whether the palette was asked for from a
/// field of text, which takes the key for a letter or more else; `open_palette` opens it once the field has the rest.
pub fn before_widgets(ui: &Ui, session: &Session) -> bool {
    let was_by_key = ui.data(|data| data.get_temp(last_input())).unwrap_or(false);
    let is_by_key = ui.input(|input| {
        input.events.iter().fold(was_by_key, |before, event| match event {
            Event::Key { pressed: true, .. } => true,
            Event::PointerMoved(_) | Event::PointerButton { .. } | Event::MouseWheel { .. } => false,
            _ => before,
        })
    });
    ui.data_mut(|data| data.insert_temp(last_input(), is_by_key));
    begin_number(ui);
    let is_free =
        !has_dialog(session) && session.path_prompt.is_none() && session.unnamed.is_empty() && !session.document.asks();
    let asks = |event: &mut Event| pressed(event, session) == Some(Action::TogglePalette);
    is_free && ui.ctx().text_edit_focused() && ui.input_mut(|input| input.events.extract_if(.., asks).count()) > 0
}

/// Opens the palette from a field of text, where what is typed counts.
pub fn open_palette(ui: &Ui, actions: &mut Vec<Action>) {
    if let Some(field) = ui.memory(|memory| memory.focused()) {
        ui.memory_mut(|memory| memory.surrender_focus(field));
    }
    actions.push(Action::TogglePalette);
}

/// Where egui keeps whether the last input was that of a key.
fn last_input() -> egui::Id {
    egui::Id::unique("the last input was a key")
}

/// Whether a person has last used the keyboard, and not the mouse.
pub fn is_by_keyboard(ui: &Ui) -> bool {
    ui.data(|data| data.get_temp(last_input())).unwrap_or(false)
}

/// Whether the widget that has the keyboard is a slider: of those that can have it, only sliders are dragged and not clicked.
fn is_on_slider(ui: &Ui) -> bool {
    let focused = ui.memory(|memory| memory.focused()).and_then(|id| ui.ctx().read_response(id));
    focused.is_some_and(|response| response.sense.senses_drag() && !response.sense.senses_click())
}

/// Hands what begins a number from a slider to its field, which is the next widget and has the keyboard a frame later.
fn begin_number(ui: &Ui) {
    let place = egui::Id::unique("a number that was begun on a slider");
    if let Some(typed) = ui.data_mut(|data| data.remove_temp::<Vec<Event>>(place)) {
        ui.input_mut(|input| drop(input.events.splice(0..0, typed)));
        return;
    }
    let begins = |event: &Event| matches!(event, Event::Text(text) if text.starts_with(|letter: char| letter.is_ascii_digit() || "-−.,".contains(letter)));
    let is_plain = ui.input(|input| !input.modifiers.command && !input.modifiers.alt);
    let Some(first) = ui.input(|input| input.events.iter().position(begins)).filter(|_| is_plain && is_on_slider(ui))
    else {
        return;
    };
    let typed: Vec<Event> = ui.input_mut(|input| {
        // The key comes right before its text, and is no shortcut, with Shift neither: some keyboards need that for digits.
        let is_key = |event: &Event| matches!(event, Event::Key { pressed: true, .. });
        let first = first - usize::from(input.events[..first].last().is_some_and(is_key));
        input.events.extract_if(first.., |event| matches!(event, Event::Text(_) | Event::Key { .. })).collect()
    });
    ui.memory_mut(|memory| memory.move_focus(egui::FocusDirection::Next));
    ui.data_mut(|data| data.insert_temp(place, typed));
    ui.ctx().request_repaint();
}

/// Whether a dialog takes the keys that none of its fields takes, too.
fn has_dialog(session: &Session) -> bool {
    session.palette.is_some() || session.tools.picture_draft.is_some() || session.filming.recording.asked.is_some()
}

/// Turns all input over the picture and from the keyboard since the last frame of the window into actions. `picture` is
/// the response of the picture's rectangle, which senses clicks and drags. `is_taken` says that the mouse is on a
/// handle.
pub fn handle(ui: &Ui, picture: &Response, is_taken: bool, session: &Session, actions: &mut Vec<Action>) {
    let has_saved = save_typed(ui, actions);
    let is_typing = ui.ctx().text_edit_focused() || has_saved;
    let was_typing = ui.data(|data| data.get_temp(typing())).unwrap_or(false);
    ui.data_mut(|data| data.insert_temp(typing(), is_typing));
    let scale = f64::from(ui.ctx().pixels_per_point());
    // Once a note has its place, keys are its text, which must not act before its field is there.
    let awaits_text = |placing: &Placing| placing.wanted == Wanted::Note && placing.has_begun();
    if is_typing || list_has_keys(ui) || session.tools.measurements.placing.as_ref().is_some_and(awaits_text) {
        hold(session, [false; 3], actions);
        if session.palette.is_none() && session.path_prompt.is_none() && !session.document.asks() {
            let asked = ui.input(|input| input.events.iter().find_map(|event| saving(event, session)));
            if let Some(action) = asked {
                save_after_typing(ui, action, actions);
            }
        }
    } else if !has_dialog(session) {
        let mut events = ui.input(|input| input.events.clone());
        if session.document.asks() {
            // Esc answers the question; what is pressed after it, in the same frame of the window, acts.
            let is_esc = |event: &Event| matches!(event, Event::Key { key: egui::Key::Escape, pressed: true, .. });
            let after = events.iter().rposition(is_esc).map_or(events.len(), |esc| esc + 1);
            events.drain(..after);
        }
        if was_typing {
            // What comes before the end of a text, in the same frame of the window, belongs to the text.
            let is_end = |event: &Event| match event {
                Event::Key { key, pressed, .. } => {
                    *pressed && matches!(key, egui::Key::Enter | egui::Key::Tab | egui::Key::Escape)
                }
                Event::PointerButton { pressed, .. } => *pressed,
                _ => false,
            };
            let end = events.iter().position(is_end).unwrap_or(0);
            events.drain(..end);
        }
        let mut shortcuts: HashSet<egui::Key> = ui.data(|data| data.get_temp(shortcut_keys())).unwrap_or_default();
        keys(ui, &events, session, was_typing, &mut shortcuts, actions);
        if !session.document.asks() {
            held(ui, session, &shortcuts, actions);
        }
        ui.data_mut(|data| data.insert_temp(shortcut_keys(), shortcuts));
    } else {
        hold(session, [false; 3], actions);
    }
    if !is_taken {
        drags(picture, session, scale, actions);
    }
    if picture.contains_pointer() {
        wheel(ui, session, actions);
    }
    hover(ui, picture, session, scale, actions);
    let placing = session.tools.measurements.placing.as_ref();
    if is_taken {
        // A click on a handle does nothing else.
    } else if picture.double_clicked() && placing.is_some_and(Placing::has_begun) {
        // The first click of the double-click was the last point.
        actions.push(Action::Measuring(Measuring::End));
    } else if picture.double_clicked() && placing.is_none() {
        // The first click of a double-click was not meant as a pick.
        actions.push(Action::UndoPick);
        actions.extend(bindings::action(Trigger::DoubleClick, session.scene.mode));
    } else if picture.clicked() {
        actions.extend(bindings::action(Trigger::Click, session.scene.mode));
    }
    let rests = [
        session.scene.navigation.time_to_rest(session.outside.now),
        session.scene.navigation.pivot_mark(session.outside.now).map(|(_, left)| left),
    ];
    if let Some(soonest) = rests.into_iter().flatten().min() {
        ui.ctx().request_repaint_after(soonest);
    }
}

/// Moves the camera by drags and the wheel over another picture from the same camera.
pub fn navigate(ui: &Ui, picture: &Response, session: &Session, actions: &mut Vec<Action>) {
    drags(picture, session, f64::from(ui.ctx().pixels_per_point()), actions);
    if picture.contains_pointer() {
        wheel(ui, session, actions);
    }
}

/// Where egui keeps the keys that went down as part of a shortcut, until they come up. Ctrl may come up before the S of
/// Ctrl+S, and the S alone would move the camera.
fn shortcut_keys() -> egui::Id {
    egui::Id::unique("keys of shortcuts")
}

/// Whether a key belongs to the widget that has the keyboard: it presses the widget, moves its value, or goes to
/// another one.
fn is_of_widget(ui: &Ui, key: egui::Key) -> bool {
    use egui::Key;
    let has_focus = ui.memory(|memory| memory.focused().is_some());
    let is_taken =
        matches!(key, Key::Enter | Key::Space | Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown);
    has_focus && is_taken
}

/// Where egui keeps the field that has the keyboard and the action that saves the scene, from the frame of the window in
/// which a person asks for it until the next one.
fn waits_to_save() -> egui::Id {
    egui::Id::unique("saves after typing")
}

/// Takes the keyboard from the field that has it, so that what is typed there counts, and saves in the next frame of the
/// window.
fn save_after_typing(ui: &Ui, action: Action, actions: &mut Vec<Action>) {
    let Some(field) = ui.memory(|memory| memory.focused()) else { return actions.push(action) };
    ui.memory_mut(|memory| memory.surrender_focus(field));
    ui.data_mut(|data| data.insert_temp(waits_to_save(), Some((field, action))));
    ui.ctx().request_repaint();
}

/// Saves if a person asked for it in the frame of the window before, and gives the keyboard back to the field. Returns
/// whether there was one.
fn save_typed(ui: &Ui, actions: &mut Vec<Action>) -> bool {
    let waiting = ui.data_mut(|data| data.remove_temp::<Option<(egui::Id, Action)>>(waits_to_save()));
    let Some((field, action)) = waiting.flatten() else { return false };
    ui.memory_mut(|memory| memory.request_focus(field));
    actions.push(action);
    true
}

/// The action of a key that saves the scene, which means nothing to a text.
fn saving(event: &Event, session: &Session) -> Option<Action> {
    pressed(event, session).filter(|action| matches!(action, Action::File(Filing::Save | Filing::SaveAs)))
}

/// The action of a key that goes down.
fn pressed(event: &Event, session: &Session) -> Option<Action> {
    let Event::Key { key, pressed: true, modifiers, .. } = event else { return None };
    bindings::action(Trigger::Key((*modifiers).into(), *key), session.scene.mode)
}

/// Where egui keeps whether a text was being typed in the last frame of the window.
fn typing() -> egui::Id {
    egui::Id::unique("a text was being typed")
}

/// Whether a list or a menu is open, or was in the last frame of the window: arrows choose in it, and the Esc that has
/// closed it does nothing else.
fn list_has_keys(ui: &Ui) -> bool {
    let place = egui::Id::unique("a list was open");
    let is_open = egui::Popup::is_any_open(ui.ctx());
    let was_open = ui.data(|data| data.get_temp(place)).unwrap_or(false);
    ui.data_mut(|data| data.insert_temp(place, is_open));
    is_open || was_open
}

/// `was_typing` says that a text was being typed until now: the Esc that has ended that does nothing else.
fn keys(
    ui: &Ui,
    events: &[Event],
    session: &Session,
    was_typing: bool,
    shortcuts: &mut HashSet<egui::Key>,
    actions: &mut Vec<Action>,
) {
    for event in events.iter().cloned() {
        let command = |key| Trigger::Key(egui::Modifiers::COMMAND.into(), key);
        match event {
            Event::Key { key, pressed: true, .. } if is_of_widget(ui, key) => {}
            Event::Key { key: egui::Key::Escape, pressed: true, .. } if was_typing => {}
            Event::Key { key, physical_key, pressed: true, repeat, modifiers } => {
                let mode = session.scene.mode;
                let of_key = bindings::action(Trigger::Key(modifiers.into(), key), mode);
                // With Shift, the number row has other characters, and on each keyboard other ones.
                let of_digit = digit(physical_key.unwrap_or(key)).and_then(|digit| {
                    Some(bindings::action(Trigger::Digit(modifiers.into()), mode)?.with_digit(digit))
                });
                if of_key.is_some() || of_digit.is_some() {
                    shortcuts.insert(key);
                } else {
                    shortcuts.remove(&key);
                }
                // A key that is kept down repeats steps, not toggles.
                let of_key =
                    of_key.filter(|action| !repeat || matches!(action, Action::PointSize(_) | Action::Zoom(_)));
                // Where Shift comes up before the digit, the digit's character never does, and its next press counts as
                // a repetition.
                actions.extend(of_key.or(of_digit));
            }
            Event::Key { key, pressed: false, .. } => {
                shortcuts.remove(&key);
            }
            Event::Copy => actions.extend(bindings::action(command(egui::Key::C), session.scene.mode)),
            Event::Paste(text)
                if bindings::action(command(egui::Key::V), session.scene.mode) == Some(Action::PasteView) =>
            {
                actions.push(pasted(text));
            }
            _ => {}
        }
    }
}

/// What a text from the clipboard stands for: a view, or an address.
fn pasted(text: String) -> Action {
    let word = text.trim();
    let is_address = codec::is_address(Path::new(word)) && !word.contains(char::is_whitespace);
    if is_address { Action::Open(word.into()) } else { Action::Paste(text) }
}

/// The digit of a key of the number row.
fn digit(key: egui::Key) -> Option<u8> {
    use egui::Key;
    let row =
        [Key::Num0, Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];
    (0..).zip(row).find(|(_, known)| *known == key).map(|(digit, _)| digit)
}

/// Informs the session of what is held down, if that has changed.
fn hold(session: &Session, [raw_colors, truth, kept]: [bool; 3], actions: &mut Vec<Action>) {
    if [raw_colors, truth, kept] != [session.raw_colors, session.truth.is_held, session.kept.is_held] {
        actions.push(Action::Hold { raw_colors, truth, kept });
    }
}

fn held(ui: &Ui, session: &Session, shortcuts: &HashSet<egui::Key>, actions: &mut Vec<Action>) {
    let mode = session.scene.mode;
    let (held, seconds) =
        ui.input(|input| (bindings::held(input, shortcuts, mode).collect::<Vec<_>>(), input.stable_dt));
    let is_held = [Action::RawColors, Action::ShowTruth, Action::ShowKept].map(|action| held.contains(&action));
    hold(session, is_held, actions);
    let (mut direction, mut turn) = (DVec3::ZERO, DVec2::ZERO);
    for action in &held {
        match action {
            Action::Fly(step) => direction += DVec3::from(step.map(f64::from)),
            Action::Orbit(step) | Action::Look(step) => turn += *step,
            _ => {}
        }
    }
    if is_of_widget(ui, egui::Key::ArrowLeft) {
        turn = DVec2::ZERO;
    }
    if direction == DVec3::ZERO && turn == DVec2::ZERO {
        return;
    }
    let factor = match () {
        () if held.contains(&Action::Fast) => 5.0,
        () if held.contains(&Action::Slow) => 0.2,
        () => 1.0,
    };
    // The camera flies a quarter of the scene's radius per second, so it crosses the scene in eight seconds.
    let speed = session.bounds().radius().max(1e-6) * 0.25 * f64::from(session.scene.navigation.speed).exp2() * factor;
    // The camera must not jump after a pause of the window.
    let seconds = f64::from(seconds.min(LONGEST_STEP));
    if direction != DVec3::ZERO {
        actions.push(Action::Travel(direction * speed * seconds));
    }
    if turn != DVec2::ZERO {
        let way = turn * ARROW_SPEED * factor.min(MOST_ARROW_FACTOR) * seconds;
        actions.push(if session.scene.is_flying() { Action::Look(way) } else { Action::Orbit(way) });
    }
    ui.ctx().request_repaint();
}

fn drags(picture: &Response, session: &Session, scale: f64, actions: &mut Vec<Action>) {
    for button in [egui::PointerButton::Primary, egui::PointerButton::Secondary, egui::PointerButton::Middle] {
        if picture.drag_started_by(button) {
            actions.push(Action::BeginDrag);
        }
        if picture.dragged_by(button) {
            let delta = picture.drag_delta();
            let delta = DVec2::new(f64::from(delta.x), f64::from(delta.y));
            let action = bindings::action(Trigger::Drag(button), session.scene.mode);
            actions.extend(action.map(|action| action.dragged(delta, scale)));
        }
    }
    if picture.drag_stopped() {
        actions.push(Action::EndDrag);
    }
}

fn wheel(ui: &Ui, session: &Session, actions: &mut Vec<Action>) {
    for event in ui.input(|input| input.events.clone()) {
        let Event::MouseWheel { unit, delta, modifiers, .. } = event else { continue };
        // Shift and Alt turn the wheel sideways on some systems.
        let turned = delta.x + delta.y;
        let notches = match unit {
            MouseWheelUnit::Line => turned,
            // Browsers use the same ratio.
            MouseWheelUnit::Point => turned / 50.0,
            MouseWheelUnit::Page => turned * 10.0,
        };
        let action = bindings::action(Trigger::Wheel(modifiers.into()), session.scene.mode);
        actions.extend(action.map(|action| action.scaled(notches)));
    }
}

/// Looks up what the cursor points at once it rests.
fn hover(ui: &Ui, picture: &Response, session: &Session, scale: f64, actions: &mut Vec<Action>) {
    let position = picture.hover_pos().filter(|_| picture.contains_pointer());
    let pixel = position.map(|position| {
        let from_corner = position - picture.rect.min;
        [from_corner.x, from_corner.y].map(|distance| (f64::from(distance.max(0.0)) * scale) as u32)
    });
    let (navigation, now) = (&session.scene.navigation, session.outside.now);
    let is_new = navigation.cursor.map(|(known, _)| known) != pixel;
    if is_new || pixel.is_none() && navigation.hovered.is_some() {
        actions.push(Action::PointAt(pixel));
    }
    let Some(pixel) = pixel else { return };
    let since = navigation.cursor.filter(|_| !is_new).map_or(now, |(_, since)| since);
    let rested = now.saturating_duration_since(since);
    let is_known = navigation.hovered.is_some_and(|(known, _)| known == pixel);
    let is_busy = navigation.asked.is_some() || session.frames.under_way > 0 || navigation.time_to_rest(now).is_some();
    if is_known || session.frames.shown.is_none() || picture.dragged() {
        return;
    }
    if rested < HOVER_DELAY {
        ui.ctx().request_repaint_after(HOVER_DELAY - rested);
    } else if !is_busy {
        actions.push(Action::AskHover);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_from_the_clipboard_is_opened_and_other_texts_are_views() {
        let opened = pasted(" https://host/a.copc.laz\n".into());
        assert!(matches!(opened, Action::Open(path) if path == Path::new("https://host/a.copc.laz")));
        for text in ["https://host/a.laz https://host/b.laz", "[camera]\neye = [0, 0, 0]", "a.laz", ""] {
            assert!(matches!(pasted(text.into()), Action::Paste(own) if own == text), "{text}");
        }
    }
}
