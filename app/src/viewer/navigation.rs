//! From the hand to the camera: reads the window's input over the picture, finds the action in the table of bindings and
//! moves the camera. Zooming goes toward the point under the cursor, which the render thread looks up; until it answers,
//! the wheel's turns are gathered, and if it does not within a moment the plane of the pivot stands in.

use std::collections::HashSet;
use std::time::{Duration, Instant};

use egui::{Event, MouseWheelUnit, Response, Ui};
use glam::{DVec2, DVec3};

use super::action::{Action, Mode};
use super::bindings::{self, Trigger};
use super::lens::to_vector;
use super::pick::Pick;
use super::render_thread::{Command, PickPurpose};
use super::session::Session;

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
    /// Picks before the click that may become a double-click.
    pub picks_before: Vec<Pick>,
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

    /// The cursor is over another pixel of the picture now, or over none.
    pub fn point_at(&mut self, pixel: Option<[u32; 2]>, now: Instant) {
        self.cursor = pixel.map(|pixel| (pixel, now));
        if pixel.is_none() {
            self.hovered = None;
        }
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

/// Turns everything that was done over the picture and on the keyboard since the last frame of the window into actions.
/// `picture` is the response of the picture's rectangle, which senses clicks and drags. `is_taken`: the mouse is on a handle.
pub fn handle(ui: &Ui, picture: &Response, is_taken: bool, session: &Session, actions: &mut Vec<Action>) {
    let is_typing = ui.ctx().text_edit_focused();
    let scale = f64::from(ui.ctx().pixels_per_point());
    if is_typing {
        hold(session, false, false, actions);
    } else {
        let mut shortcuts: HashSet<egui::Key> = ui.data(|data| data.get_temp(shortcut_keys())).unwrap_or_default();
        keys(ui, session, &mut shortcuts, actions);
        held(ui, session, &shortcuts, actions);
        ui.data_mut(|data| data.insert_temp(shortcut_keys(), shortcuts));
    }
    if !is_taken {
        drags(picture, session, scale, actions);
    }
    if picture.contains_pointer() {
        wheel(ui, session, actions);
    }
    hover(ui, picture, session, scale, actions);
    if is_taken {
        // A click on a handle is meant for nothing else.
    } else if picture.double_clicked() {
        // Its first click was not meant as a pick.
        actions.push(Action::UndoPick);
        actions.extend(bindings::action(Trigger::DoubleClick, session.mode));
    } else if picture.clicked() {
        actions.extend(bindings::action(Trigger::Click, session.mode));
    }
    let rests =
        [session.navigation.time_to_rest(session.outside.now), session.navigation.pivot_mark(session.outside.now)];
    if let Some(soonest) = rests.into_iter().flatten().min() {
        ui.ctx().request_repaint_after(soonest);
    }
}

/// Where egui keeps the keys that went down as part of a shortcut, until they come up: Ctrl may come up before the S of Ctrl+S,
/// which must not fly then.
fn shortcut_keys() -> egui::Id {
    egui::Id::unique("keys of shortcuts")
}

fn keys(ui: &Ui, session: &Session, shortcuts: &mut HashSet<egui::Key>, actions: &mut Vec<Action>) {
    for event in ui.input(|input| input.events.clone()) {
        let command = |key| Trigger::Key(egui::Modifiers::COMMAND.into(), key);
        match event {
            Event::Key { key, pressed: true, repeat, modifiers, .. } => {
                let action = bindings::action(Trigger::Key(modifiers.into(), key), session.mode);
                if action.is_some() {
                    shortcuts.insert(key);
                } else {
                    shortcuts.remove(&key);
                }
                // A key that is kept down repeats steps, not toggles.
                actions.extend(action.filter(|action| !repeat || matches!(action, Action::PointSize(_))));
            }
            Event::Key { key, pressed: false, .. } => {
                shortcuts.remove(&key);
            }
            Event::Copy => actions.extend(bindings::action(command(egui::Key::C), session.mode)),
            Event::Paste(text) if bindings::action(command(egui::Key::V), session.mode) == Some(Action::PasteView) => {
                actions.push(Action::Paste(text));
            }
            _ => {}
        }
    }
}

/// What is held down, where that has changed.
fn hold(session: &Session, raw_colors: bool, truth: bool, actions: &mut Vec<Action>) {
    if (raw_colors, truth) != (session.raw_colors, session.truth.is_held) {
        actions.push(Action::Hold { raw_colors, truth });
    }
}

fn held(ui: &Ui, session: &Session, shortcuts: &HashSet<egui::Key>, actions: &mut Vec<Action>) {
    let (held, seconds) = ui.input(|input| (bindings::held(input, shortcuts).collect::<Vec<_>>(), input.stable_dt));
    hold(session, held.contains(&Action::RawColors), held.contains(&Action::ShowTruth), actions);
    let mut direction = DVec3::ZERO;
    for action in &held {
        if let Action::Fly(step) = action {
            direction += DVec3::from(step.map(f64::from));
        }
    }
    if direction == DVec3::ZERO {
        return;
    }
    let factor = match () {
        () if held.contains(&Action::Fast) => 5.0,
        () if held.contains(&Action::Slow) => 0.2,
        () => 1.0,
    };
    // A quarter of the scene's radius a second: from end to end in eight seconds.
    let speed = session.bounds().radius().max(1e-6) * 0.25 * f64::from(session.navigation.speed).exp2() * factor;
    // After a pause of the window no jump.
    let seconds = f64::from(seconds.min(0.1));
    actions.push(Action::Travel(direction * speed * seconds));
    ui.ctx().request_repaint();
}

fn drags(picture: &Response, session: &Session, scale: f64, actions: &mut Vec<Action>) {
    for button in [egui::PointerButton::Primary, egui::PointerButton::Secondary, egui::PointerButton::Middle] {
        if picture.dragged_by(button) {
            let delta = picture.drag_delta();
            let delta = DVec2::new(f64::from(delta.x), f64::from(delta.y));
            let action = bindings::action(Trigger::Drag(button), session.mode);
            actions.extend(action.map(|action| action.dragged(delta, scale)));
        }
    }
}

fn wheel(ui: &Ui, session: &Session, actions: &mut Vec<Action>) {
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
        let action = bindings::action(Trigger::Wheel(modifiers.into()), session.mode);
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
    let (navigation, now) = (&session.navigation, session.outside.now);
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

impl Session {
    /// Pixel under the cursor.
    pub fn cursor(&self) -> Option<[u32; 2]> {
        self.navigation.cursor.map(|(pixel, _)| pixel)
    }

    /// The camera was moved by hand.
    fn camera_moved_by_hand(&mut self) {
        self.camera_is_placed = true;
        self.navigation.camera_moved(self.outside.now);
    }

    /// Drags the picture by points of the window; by pixels of the picture to pan.
    pub fn drag_camera(&mut self, drag: &Action) {
        let (Action::Orbit(delta) | Action::Look(delta) | Action::Pan(delta)) = drag else { return };
        if *delta != DVec2::ZERO {
            let angles = *delta * -RADIANS_PER_PIXEL;
            match drag {
                Action::Orbit(_) => self.camera.orbit(angles.x, angles.y),
                Action::Look(_) => self.camera.look(angles.x, angles.y),
                _ => {
                    let height = f64::from(self.view_size[1].max(1));
                    self.camera.pan(*delta, self.settings.view.field_of_view, height);
                }
            }
            self.camera_moved_by_hand();
        }
        if !matches!(drag, Action::Look(_)) {
            self.navigation.show_pivot(self.outside.now);
        }
    }

    /// World units right, up, forward.
    pub fn travel(&mut self, way: DVec3) {
        self.camera.fly(way);
        self.camera_moved_by_hand();
    }

    pub fn ask_hover(&mut self) {
        if let Some(pixel) = self.cursor() {
            self.navigation.asked = Some(pixel);
            self.outside.render(Command::Pick { pixel, purpose: PickPurpose::Hover });
        }
    }

    /// Turns of the wheel: done at once if the point under the cursor is known, else when it is.
    pub fn zoom(&mut self, notches: f32) {
        self.navigation.pending_zoom += notches;
        self.navigation.zoom_since.get_or_insert(self.outside.now);
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
        self.camera_moved_by_hand();
        // The point stays under the cursor: that is what zooming toward it means.
        self.navigation.hovered = hovered.map(|(pixel, world)| (self.cursor().unwrap_or(pixel), world));
    }

    /// Zooms toward the plane of the pivot where the point under the cursor has been waited for long enough. Returns when to look
    /// again.
    pub fn end_zoom_wait(&mut self) -> Option<Duration> {
        self.cursor()?;
        let waited = self.outside.now.saturating_duration_since(self.navigation.zoom_since?);
        let left = ZOOM_PATIENCE.checked_sub(waited).filter(|left| !left.is_zero());
        self.apply_pending_zoom(left.is_none());
        left.filter(|_| self.navigation.zoom_since.is_some())
    }

    /// Whether the wheel steers flight.
    pub fn is_flying(&self) -> bool {
        self.mode == Mode::Fly
    }
}
