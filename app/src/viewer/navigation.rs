//! From the hand to the camera: reads the window's input over the picture, finds the action in the table of bindings and
//! moves the camera. Zooming goes toward the point under the cursor, which the render thread looks up; until it answers,
//! the wheel's turns are gathered, and if it does not within a moment the plane of the pivot stands in.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use egui::{Event, MouseWheelUnit, Response, Ui};
use glam::{DVec2, DVec3};

use super::bindings::{self, Action, Mode, Trigger};
use super::lens::to_vector;
use super::pick::Pick;
use super::render_thread::{Command, PickPurpose};
use super::state::State;

/// Radians per pixel of the mouse: a half turn takes 630 pixels, about half a window.
const RADIANS_PER_PIXEL: f64 = 0.005;
/// Distance that is left after a notch of the wheel.
const ZOOM_PER_NOTCH: f64 = 0.85;
/// The camera rests when it has not moved for so long: then the picture is refined.
const REST: Duration = Duration::from_millis(150);
/// Longest wait for the point under the cursor: a zoom that starts later than this feels stuck.
const ZOOM_PATIENCE: Duration = Duration::from_millis(120);
/// The cursor rests when it has not moved for so long: then the point under it is looked up.
const HOVER_DELAY: Duration = Duration::from_millis(60);
/// Pixels that the cursor may drift while the point under it still counts as the same.
const SAME_PLACE: f64 = 4.0;
/// How long the pivot stays marked.
const PIVOT_MARK: Duration = Duration::from_millis(700);

/// What navigation remembers from one frame of the window to the next.
#[derive(Default)]
pub struct Navigation {
    last_move: Option<Instant>,
    /// Cursor over the picture, pixels, and since when.
    cursor: Option<([u32; 2], Instant)>,
    /// What the cursor points at: pixel and world position, if there is a point.
    pub hovered: Option<([u32; 2], Option<DVec3>)>,
    asked: Option<[u32; 2]>,
    pending_zoom: f32,
    zoom_since: Option<Instant>,
    pivot_shown: Option<Instant>,
    /// Doublings of the speed of flight.
    pub speed: f32,
    /// Keys that went down as part of a shortcut, until they come up: Ctrl may come up before the S of Ctrl+S, which must not
    /// fly then.
    shortcut_keys: HashSet<egui::Key>,
    /// Picks before the click that may become a double-click.
    picks_before: Vec<Pick>,
}

impl Navigation {
    pub fn camera_moved(&mut self, now: Instant) {
        self.last_move = Some(now);
        self.hovered = None;
    }

    /// `None` if the camera rests.
    pub fn time_to_rest(&self, now: Instant) -> Option<Duration> {
        REST.checked_sub(now.saturating_duration_since(self.last_move?)).filter(|left| !left.is_zero())
    }

    pub fn show_pivot(&mut self, now: Instant) {
        self.pivot_shown = Some(now);
    }

    /// How long the pivot stays marked.
    pub fn pivot_mark(&self, now: Instant) -> Option<Duration> {
        PIVOT_MARK.checked_sub(now.saturating_duration_since(self.pivot_shown?)).filter(|left| !left.is_zero())
    }

    pub fn on_hover(&mut self, pixel: [u32; 2], world: Option<DVec3>) {
        self.hovered = Some((pixel, world));
        self.asked = None;
    }

    /// The point under the cursor, if it was looked up there: outer `None` if it was not.
    fn anchor(&self) -> Option<Option<DVec3>> {
        let (cursor, _) = self.cursor?;
        let (pixel, world) = self.hovered?;
        let apart = to_vector(cursor).distance(to_vector(pixel));
        (apart <= SAME_PLACE).then_some(world)
    }
}

/// Handles everything that was done over the picture and on the keyboard since the last frame of the window.
/// `picture` is the response of the picture's rectangle, which senses clicks and drags.
pub fn handle(ui: &Ui, picture: &Response, state: &mut State) {
    let is_typing = ui.ctx().text_edit_focused();
    let scale = f64::from(ui.ctx().pixels_per_point());
    if !is_typing {
        keys(ui, state);
        held(ui, state);
    } else {
        state.raw_colors = false;
        state.hold_truth(false);
    }
    if !state.gizmo.has_mouse() {
        drags(picture, state, scale);
    }
    if picture.contains_pointer() {
        wheel(ui, state);
    }
    hover(ui, picture, state, scale);
    if state.gizmo.has_mouse() {
        // A click on a handle is meant for nothing else.
    } else if picture.double_clicked() {
        // Its first click was not meant as a pick.
        state.picks = std::mem::take(&mut state.navigation.picks_before);
        act(state, bindings::action(Trigger::DoubleClick, state.mode));
    } else if picture.clicked() {
        state.navigation.picks_before = state.picks.clone();
        act(state, bindings::action(Trigger::Click, state.mode));
    }
    let rests = [state.navigation.time_to_rest(state.now), state.navigation.pivot_mark(state.now)];
    if let Some(soonest) = rests.into_iter().flatten().min() {
        ui.ctx().request_repaint_after(soonest);
    }
}

fn act(state: &mut State, action: Option<Action>) {
    if let Some(action) = action {
        state.act(action);
    }
}

fn keys(ui: &Ui, state: &mut State) {
    for event in ui.input(|input| input.events.clone()) {
        let command = |key| Trigger::Key(egui::Modifiers::COMMAND.into(), key);
        match event {
            Event::Key { key, pressed: true, repeat, modifiers, .. } => {
                let action = bindings::action(Trigger::Key(modifiers.into(), key), state.mode);
                let shortcuts = &mut state.navigation.shortcut_keys;
                if action.is_some() {
                    shortcuts.insert(key);
                } else {
                    shortcuts.remove(&key);
                }
                // A key that is kept down repeats steps, not toggles.
                act(state, action.filter(|action| !repeat || matches!(action, Action::PointSize(_))));
            }
            Event::Key { key, pressed: false, .. } => {
                state.navigation.shortcut_keys.remove(&key);
            }
            Event::Copy => act(state, bindings::action(command(egui::Key::C), state.mode)),
            Event::Paste(text) if bindings::action(command(egui::Key::V), state.mode) == Some(Action::PasteView) => {
                state.paste_view(&text);
            }
            _ => {}
        }
    }
}

fn held(ui: &Ui, state: &mut State) {
    let shortcuts = &state.navigation.shortcut_keys;
    let (actions, seconds) = ui.input(|input| (bindings::held(input, shortcuts).collect::<Vec<_>>(), input.stable_dt));
    state.raw_colors = actions.contains(&Action::RawColors);
    state.hold_truth(actions.contains(&Action::ShowTruth));
    let mut direction = DVec3::ZERO;
    for action in &actions {
        if let Action::Fly(step) = action {
            direction += DVec3::from(step.map(f64::from));
        }
    }
    if direction == DVec3::ZERO {
        return;
    }
    let factor = match () {
        () if actions.contains(&Action::Fast) => 5.0,
        () if actions.contains(&Action::Slow) => 0.2,
        () => 1.0,
    };
    // A quarter of the scene's radius a second: from end to end in eight seconds.
    let speed = state.bounds().radius().max(1e-6) * 0.25 * f64::from(state.navigation.speed).exp2() * factor;
    // After a pause of the window no jump.
    let seconds = f64::from(seconds.min(0.1));
    state.camera.fly(direction * speed * seconds);
    moved(state);
    ui.ctx().request_repaint();
}

/// The camera was moved by hand.
fn moved(state: &mut State) {
    state.camera_is_placed = true;
    state.navigation.camera_moved(state.now);
}

fn drags(picture: &Response, state: &mut State, scale: f64) {
    for button in [egui::PointerButton::Primary, egui::PointerButton::Secondary, egui::PointerButton::Middle] {
        if !picture.dragged_by(button) {
            continue;
        }
        let delta = picture.drag_delta();
        let delta = DVec2::new(f64::from(delta.x), f64::from(delta.y));
        let action = bindings::action(Trigger::Drag(button), state.mode);
        if delta != DVec2::ZERO {
            let angles = delta * -RADIANS_PER_PIXEL;
            match action {
                Some(Action::Orbit) => state.camera.orbit(angles.x, angles.y),
                Some(Action::Look) => state.camera.look(angles.x, angles.y),
                Some(Action::Pan) => {
                    let height = f64::from(state.view_size[1].max(1));
                    state.camera.pan(delta * scale, state.settings.view.field_of_view, height);
                }
                _ => continue,
            }
            moved(state);
        }
        if matches!(action, Some(Action::Orbit | Action::Pan)) {
            state.navigation.show_pivot(state.now);
        }
    }
}

fn wheel(ui: &Ui, state: &mut State) {
    for event in ui.input(|input| input.events.clone()) {
        let Event::MouseWheel { unit, delta, modifiers, .. } = event else { continue };
        // Shift and Alt turn the wheel sideways on some systems.
        let turned = delta.x + delta.y;
        let notches = match unit {
            MouseWheelUnit::Line => turned,
            // As browsers do.
            MouseWheelUnit::Point => turned / 50.0,
            MouseWheelUnit::Page => turned * 10.0,
        };
        let action = bindings::action(Trigger::Wheel(modifiers.into()), state.mode);
        act(state, action.map(|action| action.scaled(notches)));
    }
    if let Some(since) = state.navigation.zoom_since {
        state.apply_pending_zoom(state.now.saturating_duration_since(since) >= ZOOM_PATIENCE);
        ui.ctx().request_repaint_after(ZOOM_PATIENCE);
    }
}

/// Looks up what the cursor points at once it rests.
fn hover(ui: &Ui, picture: &Response, state: &mut State, scale: f64) {
    let position = picture.hover_pos().filter(|_| picture.contains_pointer());
    let pixel = position.map(|position| {
        let from_corner = position - picture.rect.min;
        [from_corner.x, from_corner.y].map(|distance| (f64::from(distance.max(0.0)) * scale) as u32)
    });
    let (navigation, now) = (&mut state.navigation, state.now);
    let Some(pixel) = pixel else {
        (navigation.cursor, navigation.hovered) = (None, None);
        return;
    };
    if navigation.cursor.is_none_or(|(old, _)| old != pixel) {
        navigation.cursor = Some((pixel, now));
    }
    let rested = navigation.cursor.map_or(Duration::ZERO, |(_, since)| now.saturating_duration_since(since));
    let is_known = navigation.hovered.is_some_and(|(known, _)| known == pixel);
    let is_busy = navigation.asked.is_some() || state.frames.under_way > 0 || navigation.time_to_rest(now).is_some();
    if is_known || state.frames.shown.is_none() || picture.dragged() {
        return;
    }
    if rested < HOVER_DELAY {
        ui.ctx().request_repaint_after(HOVER_DELAY - rested);
    } else if !is_busy {
        state.ask_hover();
    }
}

impl State {
    /// Pixel under the cursor.
    pub fn cursor(&self) -> Option<[u32; 2]> {
        self.navigation.cursor.map(|(pixel, _)| pixel)
    }

    fn ask_hover(&mut self) {
        if let Some(pixel) = self.cursor() {
            self.navigation.asked = Some(pixel);
            self.render(Command::Pick { pixel, purpose: PickPurpose::Hover });
        }
    }

    /// Turns of the wheel: done at once if the point under the cursor is known, else when it is.
    pub fn zoom(&mut self, notches: f32) {
        self.navigation.pending_zoom += notches;
        self.navigation.zoom_since.get_or_insert(self.now);
        if self.navigation.anchor().is_none() && self.navigation.asked.is_none() {
            self.ask_hover();
        }
        self.apply_pending_zoom(false);
    }

    /// `at_once`: even if the point under the cursor is not known.
    pub fn apply_pending_zoom(&mut self, at_once: bool) {
        let anchor = self.navigation.anchor();
        if self.navigation.zoom_since.is_none() || !at_once && anchor.is_none() {
            return;
        }
        let notches = std::mem::take(&mut self.navigation.pending_zoom);
        self.navigation.zoom_since = None;
        let on_plane = || self.cursor().map_or(self.camera.pivot, |pixel| self.lens().on_pivot_plane(to_vector(pixel)));
        let toward = anchor.flatten().unwrap_or_else(on_plane);
        self.camera.zoom_toward(toward, ZOOM_PER_NOTCH.powf(f64::from(notches)));
        let hovered = self.navigation.hovered;
        moved(self);
        // The point stays under the cursor: that is what zooming toward it means.
        self.navigation.hovered = hovered.map(|(pixel, world)| (self.cursor().unwrap_or(pixel), world));
    }

    /// Whether the wheel steers flight.
    pub fn is_flying(&self) -> bool {
        self.mode == Mode::Fly
    }
}
