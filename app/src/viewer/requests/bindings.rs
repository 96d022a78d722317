//! One table that says what every key and mouse gesture does. The input code finds actions in it, and the shortcut
//! sheet lists it. No other place names a key.

use std::collections::HashSet;

use egui::{Key, PointerButton};
use glam::DVec2;
use scene::{ColorBy, MeasurementKind, Shape, StandardView};

use crate::shared::language::{text, translated};
use crate::viewer::requests::action::{
    Action, Clipping, Export, Filing, Film, Handles, KeptStep, Measuring, Mode, SavePicture,
};

/// The modifier keys that a gesture needs; no others may be down. `ctrl` is the command key on a Mac.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Modifiers {
    ctrl: bool,
    shift: bool,
    alt: bool,
}

const NONE: Modifiers = Modifiers { ctrl: false, shift: false, alt: false };
const CTRL: Modifiers = Modifiers { ctrl: true, ..NONE };
const SHIFT: Modifiers = Modifiers { shift: true, ..NONE };
const ALT: Modifiers = Modifiers { alt: true, ..NONE };
const CTRL_SHIFT: Modifiers = Modifiers { ctrl: true, shift: true, alt: false };

impl From<egui::Modifiers> for Modifiers {
    fn from(modifiers: egui::Modifiers) -> Self {
        Self { ctrl: modifiers.command, shift: modifiers.shift, alt: modifiers.alt }
    }
}

/// A press of a key, or a gesture of the mouse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    Key(Modifiers, Key),
    /// A key that acts for as long as it is down, whatever the modifiers.
    Hold(Key),
    /// Modifiers that change what held keys do.
    Modifier(Modifiers),
    /// Any digit of the number row: the action gets it.
    Digit(Modifiers),
    /// A digit of the number pad, which egui does not tell apart from the number row.
    Numpad(Modifiers, u8),
    Wheel(Modifiers),
    Drag(PointerButton),
    Click,
    DoubleClick,
}

/// A row of the table. If `mode` is set, the row holds only for that way of navigating.
pub struct Binding {
    pub section: &'static str,
    pub mode: Option<Mode>,
    pub trigger: Trigger,
    pub action: Action,
    pub text: &'static str,
}

const fn bind(section: &'static str, trigger: Trigger, action: Action, text: &'static str) -> Binding {
    Binding { section, mode: None, trigger, action, text }
}

const fn bind_in(mode: Mode, section: &'static str, trigger: Trigger, action: Action, text: &'static str) -> Binding {
    Binding { section, mode: Some(mode), trigger, action, text }
}

const MOVE: &str = "Moving";
const VIEWS: &str = "Views";
const COLORS: &str = "Colours and points";
const FILES: &str = "Files and pictures";
const OBJECTS: &str = "Mirrors, lights and clips";
const MEASURE: &str = "Measurements and notes";
const TOOLS: &str = "Tools and window";

/// The table. Rows with the same section and text share a row of the shortcut sheet.
pub const BINDINGS: &[Binding] = {
    use Action as A;
    use Trigger::{Click, Digit, DoubleClick, Drag, Hold, Modifier, Numpad, Wheel};
    &[
        bind_in(
            Mode::Orbit,
            MOVE,
            Drag(PointerButton::Primary),
            A::Orbit(DVec2::ZERO),
            "Orbit; in a room: look around",
        ),
        bind_in(Mode::Fly, MOVE, Drag(PointerButton::Primary), A::Look(DVec2::ZERO), "Look around (fly)"),
        bind(MOVE, Drag(PointerButton::Secondary), A::Pan(DVec2::ZERO), "Pan"),
        bind(MOVE, Drag(PointerButton::Middle), A::Pan(DVec2::ZERO), "Pan"),
        bind_in(Mode::Orbit, MOVE, Wheel(NONE), A::Zoom(1.0), "Zoom toward the point under the cursor"),
        bind_in(Mode::Fly, MOVE, Wheel(NONE), A::FlySpeed(1.0), "Speed (fly)"),
        bind(MOVE, Hold(Key::W), A::Fly([0, 0, 1]), "Forward, back"),
        bind(MOVE, Hold(Key::S), A::Fly([0, 0, -1]), "Forward, back"),
        bind(MOVE, Hold(Key::A), A::Fly([-1, 0, 0]), "Left, right"),
        bind(MOVE, Hold(Key::D), A::Fly([1, 0, 0]), "Left, right"),
        bind(MOVE, Hold(Key::Q), A::Fly([0, -1, 0]), "Down, up"),
        bind(MOVE, Hold(Key::E), A::Fly([0, 1, 0]), "Down, up"),
        bind_in(Mode::Orbit, MOVE, Hold(Key::ArrowLeft), A::Orbit(LEFT), "Orbit, as a drag does"),
        bind_in(Mode::Orbit, MOVE, Hold(Key::ArrowRight), A::Orbit(RIGHT), "Orbit, as a drag does"),
        bind_in(Mode::Orbit, MOVE, Hold(Key::ArrowUp), A::Orbit(UP), "Orbit, as a drag does"),
        bind_in(Mode::Orbit, MOVE, Hold(Key::ArrowDown), A::Orbit(DOWN), "Orbit, as a drag does"),
        bind_in(Mode::Fly, MOVE, Hold(Key::ArrowLeft), A::Look(LEFT), "Look around, as a drag does (fly)"),
        bind_in(Mode::Fly, MOVE, Hold(Key::ArrowRight), A::Look(RIGHT), "Look around, as a drag does (fly)"),
        bind_in(Mode::Fly, MOVE, Hold(Key::ArrowUp), A::Look(UP), "Look around, as a drag does (fly)"),
        bind_in(Mode::Fly, MOVE, Hold(Key::ArrowDown), A::Look(DOWN), "Look around, as a drag does (fly)"),
        bind(MOVE, key(Key::PageUp), A::Zoom(1.0), "Nearer"),
        bind(MOVE, key(Key::PageDown), A::Zoom(-1.0), "Farther"),
        bind(MOVE, Modifier(SHIFT), A::Fast, "Move fast"),
        bind(MOVE, Modifier(CTRL), A::Slow, "Move slowly"),
        bind(MOVE, key(Key::V), A::ToggleMode, "Orbit or fly"),
        bind(MOVE, DoubleClick, A::PivotHere, "Nearer to what is under the cursor"),
        bind(MOVE, key(Key::F), A::PivotHere, "Nearer to what is under the cursor"),
        bind(VIEWS, key(Key::Home), A::FrameAll, "Frame all"),
        bind(VIEWS, key(Key::R), A::FrameAll, "Frame all"),
        bind(VIEWS, key(Key::N), A::GoInside, "Inside of the room"),
        bind(VIEWS, key(Key::O), A::DollHouse, "The room as a doll's house"),
        bind(VIEWS, Numpad(NONE, 1), A::LookFrom(StandardView::Front), "From the front"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num1), A::LookFrom(StandardView::Front), "From the front"),
        bind(VIEWS, Numpad(CTRL, 1), A::LookFrom(StandardView::Back), "From the back"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num2), A::LookFrom(StandardView::Back), "From the back"),
        bind(VIEWS, Numpad(NONE, 3), A::LookFrom(StandardView::Right), "From the right"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num3), A::LookFrom(StandardView::Right), "From the right"),
        bind(VIEWS, Numpad(CTRL, 3), A::LookFrom(StandardView::Left), "From the left"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num4), A::LookFrom(StandardView::Left), "From the left"),
        bind(VIEWS, Numpad(NONE, 7), A::LookFrom(StandardView::Top), "From the top"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num7), A::LookFrom(StandardView::Top), "From the top"),
        bind(VIEWS, Numpad(CTRL, 7), A::LookFrom(StandardView::Bottom), "From the bottom"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num8), A::LookFrom(StandardView::Bottom), "From the bottom"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num6), A::LookFrom(StandardView::Isometric), "From a corner"),
        bind(VIEWS, Numpad(NONE, 5), A::ToggleProjection, "Perspective or orthographic"),
        bind(VIEWS, Trigger::Key(CTRL, Key::Num5), A::ToggleProjection, "Perspective or orthographic"),
        bind(VIEWS, key(Key::Z), A::LastView, "Back to the last view"),
        bind(VIEWS, Trigger::Key(SHIFT, Key::Z), A::NextView, "Forth to the next view again"),
        bind(VIEWS, Digit(CTRL_SHIFT), A::Film(Film::Keep(None)), "Keep the view as a bookmark"),
        bind(VIEWS, Digit(SHIFT), A::Film(Film::FlyToDigit(0)), "Fly to the kept view"),
        bind(VIEWS, Wheel(SHIFT), A::FieldOfView(1.0), "Field of view"),
        bind(COLORS, key(Key::Num1), A::ColorBy(ColorBy::Rgb), "Colour by RGB"),
        bind(COLORS, key(Key::Num2), A::ColorBy(ColorBy::Height), "Colour by height"),
        bind(COLORS, key(Key::Num3), A::ColorBy(ColorBy::Intensity), "Colour by intensity"),
        bind(COLORS, key(Key::Num4), A::ColorBy(ColorBy::Class), "Colour by class"),
        bind(COLORS, key(Key::Num5), A::ColorBy(ColorBy::ReturnNumber), "Colour by return number"),
        bind(COLORS, key(Key::Num6), A::ColorBy(ColorBy::Normal), "Colour by normal"),
        bind(COLORS, key(Key::Num7), A::ColorBy(ColorBy::GpsTime), "Colour by GPS time"),
        bind(COLORS, key(Key::Num8), A::ColorBy(ColorBy::Attribute), "Colour by the chosen attribute"),
        bind(COLORS, key(Key::Num9), A::ColorBy(ColorBy::Plain), "One colour"),
        bind(COLORS, key(Key::Num0), A::ColorBy(ColorBy::Auto), "Colour as the file suggests"),
        bind(COLORS, key(Key::L), A::ToggleEdl, "Eye-dome lighting"),
        bind(COLORS, Trigger::Key(SHIFT, Key::L), A::NextLight, "What lights the points: the next choice"),
        bind(COLORS, key(Key::U), A::ToggleLight, "The data's own colours, no light; again: lit"),
        bind(COLORS, Hold(Key::H), A::RawColors, "The same while held, without eye-dome lighting"),
        bind(COLORS, Wheel(ALT), A::PointSize(1.0), "Point size"),
        bind(COLORS, key(Key::Plus), A::PointSize(1.0), "Points larger"),
        bind(COLORS, key(Key::Equals), A::PointSize(1.0), "Points larger"),
        bind(COLORS, key(Key::Minus), A::PointSize(-1.0), "Points smaller"),
        bind(FILES, Trigger::Key(CTRL, Key::O), A::OpenDialog, "Open files"),
        bind(FILES, Trigger::Key(CTRL_SHIFT, Key::O), A::OpenPrompt, "Open by typing a path"),
        bind(FILES, Trigger::Key(CTRL, Key::Period), A::StopAll, "Stop loading, saving and comparing"),
        bind(FILES, Trigger::Key(CTRL, Key::Q), A::Quit, "Quit"),
        bind(FILES, key(Key::F12), A::SavePicture(SavePicture::AtOnce), "Save the picture"),
        bind(FILES, Trigger::Key(SHIFT, Key::F12), A::Film(Film::Capture), "Record the window; again: end it"),
        bind(
            FILES,
            Trigger::Key(CTRL, Key::F12),
            A::SavePicture(SavePicture::Ask),
            "Save the picture at any size, with name and place",
        ),
        bind(FILES, Trigger::Key(CTRL, Key::E), A::Export(Export::Ask), "Save the points that are shown"),
        bind(FILES, Trigger::Key(CTRL, Key::C), A::CopyView, "Copy the view as text"),
        bind(FILES, Trigger::Key(CTRL, Key::V), A::PasteView, "Paste a view, or open an address"),
        bind(FILES, Trigger::Key(CTRL_SHIFT, Key::C), A::CopyCommandLine, "Copy the command line of this picture"),
        bind(FILES, Trigger::Key(CTRL, Key::S), A::File(Filing::Save), "Save the scene"),
        bind(FILES, Trigger::Key(CTRL_SHIFT, Key::S), A::File(Filing::SaveAs), "Save the scene under another name"),
        bind(OBJECTS, key(Key::B), A::AddMirror(Shape::Sphere), "Add a mirror ball at the picked point"),
        bind(
            OBJECTS,
            key(Key::P),
            A::AddMirror(Shape::Plane { height: 0.75 }),
            "Add a plane mirror at the picked point",
        ),
        bind(OBJECTS, key(Key::K), A::AddSpot, "Add a spot light at the camera"),
        bind(OBJECTS, key(Key::J), A::Clip(Clipping::AroundPick), "Add a clip box about the last pick"),
        bind(OBJECTS, Trigger::Key(SHIFT, Key::J), A::Clip(Clipping::AroundView), "Add a clip box about what is seen"),
        bind(OBJECTS, Trigger::Key(CTRL, Key::J), A::Clip(Clipping::DrawPrism), "Draw a clip prism; again: give it up"),
        bind(OBJECTS, key(Key::G), A::Gizmo(Handles::Move), "Handles to move; again: all"),
        bind(OBJECTS, key(Key::T), A::Gizmo(Handles::Turn), "Handles to turn; again: all"),
        bind(OBJECTS, key(Key::Y), A::Gizmo(Handles::Scale), "Handle to scale; again: all"),
        bind(OBJECTS, Trigger::Key(CTRL, Key::D), A::Duplicate, "Copy the selected object"),
        bind(OBJECTS, key(Key::Delete), A::Delete, "Delete the selected object"),
        bind(OBJECTS, key(Key::M), A::Inspect, "Inspection mirror at the cursor; click pins it"),
        bind(OBJECTS, Wheel(CTRL), A::InspectDistance(1.0), "Its distance"),
        bind(OBJECTS, Wheel(CTRL_SHIFT), A::InspectTilt(1.0), "Its tilt"),
        bind(TOOLS, Click, A::Pick, "Pick a point or a mirror; the next point while measuring"),
        bind(TOOLS, Trigger::Key(SHIFT, Key::M), A::PickMiddle, "Pick in the middle of the picture"),
        bind(MEASURE, key(Key::I), A::Measuring(Measuring::Again), "A distance, or what was measured last"),
        bind(MEASURE, measure(Key::Num1), begin(MeasurementKind::Point), "A point"),
        bind(MEASURE, measure(Key::Num2), begin(MeasurementKind::Distance), "A distance"),
        bind(MEASURE, measure(Key::Num3), begin(MeasurementKind::Polyline), "The length of a polyline"),
        bind(MEASURE, measure(Key::Num4), begin(MeasurementKind::Height), "A height"),
        bind(MEASURE, measure(Key::Num5), begin(MeasurementKind::Angle), "An angle"),
        bind(MEASURE, measure(Key::Num6), begin(MeasurementKind::Area), "An area"),
        bind(MEASURE, measure(Key::Num7), begin(MeasurementKind::Plane), "A plane through points"),
        bind(MEASURE, measure(Key::Num8), begin(MeasurementKind::Circle), "A circle"),
        bind(MEASURE, measure(Key::Num9), begin(MeasurementKind::Cylinder), "A cylinder through points"),
        bind(MEASURE, measure(Key::Num0), begin(MeasurementKind::Volume), "A volume"),
        bind(MEASURE, key(Key::Enter), A::Measuring(Measuring::End), "End the measurement (or double-click)"),
        bind(MEASURE, key(Key::Backspace), A::Measuring(Measuring::RemoveCorner), "Take its last point back"),
        bind(MEASURE, Trigger::Key(SHIFT, Key::N), A::Measuring(Measuring::BeginNote), "Add a note at the next click"),
        bind(
            MEASURE,
            Trigger::Key(SHIFT, Key::I),
            A::Measuring(Measuring::BeginProfile),
            "Draw the line of a profile; again: give it up",
        ),
        bind(MEASURE, key(Key::Period), A::Measuring(Measuring::StepNote(1)), "Next note, previous note"),
        bind(MEASURE, key(Key::Comma), A::Measuring(Measuring::StepNote(-1)), "Next note, previous note"),
        bind(TOOLS, Hold(Key::X), A::ShowTruth, "The ray-traced truth while held"),
        bind(TOOLS, Trigger::Key(SHIFT, Key::X), A::PinTruth, "Pin the truth; again: let go"),
        bind(TOOLS, Hold(Key::F3), A::ShowKept, "The kept state of the picture while held"),
        bind(TOOLS, Trigger::Key(SHIFT, Key::F3), A::Kept(KeptStep::Keep), "Keep this state of the picture"),
        bind(
            TOOLS,
            Trigger::Key(CTRL, Key::F3),
            A::Kept(KeptStep::ToggleSplit),
            "The kept state in a part of the picture; again: one",
        ),
        bind(
            TOOLS,
            Trigger::Key(ALT, Key::F3),
            A::Kept(KeptStep::ToggleBeside),
            "The kept state and this one side by side; again: one",
        ),
        bind(TOOLS, key(Key::C), A::ToggleChart, "Tuning chart: time against error"),
        bind(TOOLS, Trigger::Key(CTRL, Key::T), A::Film(Film::Toggle), "Timeline of camera paths; again: close it"),
        bind(TOOLS, key(Key::Space), A::Film(Film::Play), "Play the path of the timeline; again: pause"),
        bind(TOOLS, key(Key::Escape), A::EndTool, "End the tool, clear the pick"),
        bind(TOOLS, Trigger::Key(CTRL, Key::Z), A::Undo, "Undo"),
        bind(TOOLS, Trigger::Key(CTRL_SHIFT, Key::Z), A::Redo, "Redo"),
        bind(TOOLS, Trigger::Key(CTRL, Key::Y), A::Redo, "Redo"),
        bind(TOOLS, Trigger::Key(CTRL, Key::P), A::TogglePalette, "Command palette: all actions and parameters"),
        bind(TOOLS, Trigger::Key(CTRL, Key::K), A::TogglePalette, "Command palette: all actions and parameters"),
        bind(TOOLS, key(Key::F2), A::ToggleInterface, "Hide or show the panels"),
        bind(TOOLS, key(Key::F11), A::ToggleFullScreen, "Full screen"),
        bind(TOOLS, key(Key::Questionmark), A::ToggleShortcuts, "This sheet"),
        bind(TOOLS, key(Key::F1), A::ToggleShortcuts, "This sheet"),
    ]
};

/// Directions of a drag.
const LEFT: DVec2 = DVec2::NEG_X;
const RIGHT: DVec2 = DVec2::X;
const UP: DVec2 = DVec2::NEG_Y;
const DOWN: DVec2 = DVec2::Y;

const fn key(key: Key) -> Trigger {
    Trigger::Key(NONE, key)
}

const fn measure(key: Key) -> Trigger {
    Trigger::Key(ALT, key)
}

const fn begin(kind: MeasurementKind) -> Action {
    Action::Measuring(Measuring::Begin(kind))
}

/// The action of a gesture in a way of navigating.
pub fn action(trigger: Trigger, mode: Mode) -> Option<Action> {
    // Some keyboards need Shift for these characters and others do not, so Shift is ignored.
    let trigger = match trigger {
        Trigger::Key(modifiers, key @ (Key::Questionmark | Key::Plus)) => {
            Trigger::Key(Modifiers { shift: false, ..modifiers }, key)
        }
        other => other,
    };
    let fits = |binding: &&Binding| binding.trigger == trigger && binding.mode.is_none_or(|wanted| wanted == mode);
    BINDINGS.iter().find(fits).map(|binding| binding.action.clone())
}

/// The actions whose keys or modifiers are held down now. Keys that are down as part of a shortcut do not count.
pub fn held(input: &egui::InputState, shortcuts: &HashSet<Key>, mode: Mode) -> impl Iterator<Item = Action> {
    let modifiers = Modifiers::from(input.modifiers);
    let is_of_mode = move |binding: &&Binding| binding.mode.is_none_or(|wanted| wanted == mode);
    BINDINGS.iter().filter(is_of_mode).filter_map(move |binding| {
        let down = match binding.trigger {
            Trigger::Hold(key) => input.key_down(key) && !shortcuts.contains(&key),
            Trigger::Modifier(wanted) => wanted == modifiers,
            _ => false,
        };
        down.then(|| binding.action.clone())
    })
}

/// What the key is called that shortcuts are pressed with.
pub const COMMAND: &str = if cfg!(target_os = "macos") { "Cmd" } else { "Ctrl" };

/// The first gesture of an action, for tool tips. Empty if the action has none.
pub fn shortcut(action: &Action) -> String {
    let binding = BINDINGS.iter().find(|binding| binding.action == *action);
    binding.map_or(String::new(), |binding| binding.trigger.to_string())
}

impl std::fmt::Display for Modifiers {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (on, name) in [(self.ctrl, COMMAND), (self.shift, "Shift"), (self.alt, "Alt")] {
            if on {
                write!(f, "{name}+")?;
            }
        }
        Ok(())
    }
}

impl std::fmt::Display for Trigger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Key(modifiers, key) => write!(f, "{modifiers}{}", name_of(*key)),
            Self::Hold(key) => write!(f, "{}", name_of(*key)),
            Self::Modifier(modifiers) => f.write_str(modifiers.to_string().trim_end_matches('+')),
            Self::Digit(modifiers) => write!(f, "{modifiers}{}", text!("Digit")),
            Self::Numpad(modifiers, digit) => write!(f, "{modifiers}{} {digit}", text!("Numpad")),
            Self::Wheel(modifiers) => write!(f, "{modifiers}{}", text!("Wheel")),
            Self::Drag(PointerButton::Primary) => f.write_str(text!("Left drag")),
            Self::Drag(PointerButton::Secondary) => f.write_str(text!("Right drag")),
            Self::Drag(_) => f.write_str(text!("Middle drag")),
            Self::Click => f.write_str(text!("Click")),
            Self::DoubleClick => f.write_str(text!("Double-click")),
        }
    }
}

/// The name of a key. The fonts lack the symbols of the arrows.
fn name_of(key: Key) -> &'static str {
    match key {
        Key::ArrowLeft | Key::ArrowRight | Key::ArrowUp | Key::ArrowDown => key.name(),
        _ => key.symbol_or_name(),
    }
}

/// The rows of the shortcut sheet: section, gestures, text.
pub fn sheet() -> Vec<(&'static str, String, &'static str)> {
    let mut rows: Vec<(&'static str, String, &'static str)> = Vec::new();
    for binding in BINDINGS {
        match rows.iter_mut().find(|(section, _, text)| *section == binding.section && *text == binding.text) {
            Some((_, gestures, _)) => *gestures = format!("{gestures}  {}  {}", text!("or"), binding.trigger),
            None => rows.push((binding.section, binding.trigger.to_string(), binding.text)),
        }
    }
    rows
}

/// The least width of the window for a sheet in two columns, in points.
const TWO_COLUMNS: f32 = 1170.0;

/// The least width of the window for rows that are not wrapped.
const WHOLE_ROWS: f32 = 800.0;

/// Draws the shortcut sheet, in two columns where the window is wide enough, which scroll where it is low. Its button
/// sets `open` to false.
pub fn sheet_window(context: &egui::Context, open: &mut bool) {
    let rows = sheet();
    let sections = [MOVE, VIEWS, OBJECTS, MEASURE, COLORS, FILES, TOOLS];
    let whole = context.content_rect().size();
    let most_high = whole.y - 60.0;
    let count = if whole.x >= TWO_COLUMNS { 2 } else { 1 };
    // Where a row is wider than the window, its gestures and its text are wrapped.
    let is_narrow = whole.x < WHOLE_ROWS;
    let widest = if is_narrow { 0.5 * whole.x - 40.0 } else { f32::INFINITY };
    let window = egui::Window::new(text!("Shortcuts"));
    let window = if is_narrow { window.default_width(whole.x - 40.0) } else { window };
    window
        .id(egui::Id::unique("shortcuts"))
        .open(open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .show(context, |ui| {
            let area = egui::ScrollArea::vertical().max_height(most_high).min_scrolled_height(most_high);
            area.show(ui, |ui| {
                ui.columns(count, |columns| {
                    for (index, section) in sections.into_iter().enumerate() {
                        // Each column gets about the same number of lines.
                        let ui = &mut columns[usize::from(index >= 3 && count == 2)];
                        ui.add_space(4.0);
                        ui.label(
                            egui::RichText::new(translated(section)).strong().color(crate::viewer::look::theme::ACCENT),
                        );
                        let grid = egui::Grid::new(section).num_columns(2).spacing([16.0, 3.0]).max_col_width(widest);
                        grid.show(ui, |ui| {
                            for (_, gestures, text) in rows.iter().filter(|row| row.0 == section) {
                                ui.label(egui::RichText::new(gestures).monospace().size(11.0));
                                ui.label(translated(text));
                                ui.end_row();
                            }
                        });
                    }
                })
            });
        });
}

#[cfg(test)]
mod tests {
    use scene::Language;

    use super::*;

    #[test]
    fn no_gesture_means_two_things() {
        for (index, a) in BINDINGS.iter().enumerate() {
            for b in &BINDINGS[index + 1..] {
                let same_mode = a.mode.is_none() || b.mode.is_none() || a.mode == b.mode;
                assert!(!(a.trigger == b.trigger && same_mode), "{} and {} are both {}", a.text, b.text, a.trigger);
            }
        }
    }

    #[test]
    fn the_sheet_lists_every_binding() {
        let rows = sheet();
        for binding in BINDINGS {
            let gesture = binding.trigger.to_string();
            let listed = rows.iter().any(|(section, gestures, text)| {
                *section == binding.section
                    && *text == binding.text
                    && gestures.split("  or  ").any(|listed| listed == gesture)
            });
            assert!(listed, "{gesture}: {} is not on the sheet", binding.text);
        }
    }

    #[test]
    fn the_sheet_shows_every_row_on_the_screen() {
        use egui_kittest::kittest::Queryable as _;
        let mut harness = egui_kittest::Harness::builder().with_size([1280.0, 800.0]).build_ui(|ui| {
            sheet_window(ui.ctx(), &mut true);
        });
        harness.run();
        for (_, _, text) in sheet() {
            assert!(harness.query_all_by_label(text).next().is_some(), "{text}");
        }
        // The list is longer than the window is high, and takes the height that there is.
        let area = harness.ctx.memory(|memory| memory.area_rect(egui::Id::unique("shortcuts"))).unwrap();
        assert!(area.height() > 700.0 && area.height() <= 800.0, "{area}");
    }

    #[test]
    fn the_sheet_fits_into_small_windows() {
        use crate::shared::language::speak;
        use egui_kittest::kittest::Queryable as _;
        // These are screens of 1280 x 720 pixels at 150 % and of 1366 x 768 at 200 %, among others.
        let sizes = [[1024.0, 768.0], [853.0, 453.0], [683.0, 384.0], [480.0, 320.0]];
        for (size, language) in
            sizes.into_iter().flat_map(|size| [Language::English, Language::German].map(|l| (size, l)))
        {
            speak(language);
            let mut harness = egui_kittest::Harness::builder().with_size(size).build_ui(|ui| {
                crate::viewer::look::theme::apply(ui.ctx());
                sheet_window(ui.ctx(), &mut true);
            });
            harness.run();
            let area = harness.ctx.memory(|memory| memory.area_rect(egui::Id::unique("shortcuts"))).unwrap();
            assert!(
                area.left().min(area.top()) >= 0.0 && area.right() <= size[0] && area.bottom() <= size[1],
                "{area}"
            );
            for (_, gestures, text) in sheet() {
                let text = translated(text);
                let texts = harness.query_all_by_label(text).map(|node| node.rect());
                let keys: Vec<_> = harness.query_all_by_label(&gestures).map(|node| node.rect()).collect();
                for place in texts {
                    assert!(place.left() >= area.left() && place.right() <= area.right(), "{text}: {place} {area}");
                    let beside = keys.iter().find(|keys| (keys.center().y - place.center().y).abs() < 8.0);
                    assert!(beside.is_none_or(|keys| keys.right() <= place.left()), "{text} lies on its keys");
                    let lines = (place.height() / 14.0).round();
                    assert!(lines * 16.0 <= text.chars().count() as f32 + 16.0, "{text} has {lines} lines: {size:?}");
                }
            }
        }
        speak(Language::English);
    }

    #[test]
    fn modifiers_must_match_exactly_but_a_question_mark_may_need_shift() {
        assert_eq!(action(Trigger::Key(CTRL, Key::Z), Mode::Orbit), Some(Action::Undo));
        assert_eq!(action(Trigger::Key(CTRL_SHIFT, Key::Z), Mode::Orbit), Some(Action::Redo));
        assert_eq!(action(Trigger::Key(CTRL, Key::Y), Mode::Orbit), Some(Action::Redo));
        assert_eq!(action(Trigger::Key(CTRL, Key::L), Mode::Orbit), None);
        assert_eq!(action(Trigger::Key(SHIFT, Key::Questionmark), Mode::Orbit), Some(Action::ToggleShortcuts));
    }

    #[test]
    fn the_wheel_zooms_in_orbit_and_sets_the_speed_in_flight() {
        assert_eq!(action(Trigger::Wheel(NONE), Mode::Orbit), Some(Action::Zoom(1.0)));
        assert_eq!(action(Trigger::Wheel(NONE), Mode::Fly).map(|a| a.scaled(-2.0)), Some(Action::FlySpeed(-2.0)));
    }
}
