//! The timeline below the picture: a lane for the keyframes of the camera, one for captions, and one for each track.
//! Keys are dragged along their lanes; a click selects one, and shows its time.

use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{
    Align2, Color32, FontId, Frame, Panel, PopupCloseBehavior, Rect, Response, RichText, Sense, Stroke, Ui, pos2, vec2,
};
use scene::{CameraPath, Caption, Ease, Motion, WIPE};

use crate::shared::language::{english, text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{name_label, number_field_in};
use crate::viewer::panels::{captions, wipe};
use crate::viewer::requests::action::{Action, Film, PathPreset};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::tools::measurements::units;

/// The height of a lane, and the width of what stands before it, in points of the window.
const LANE: f32 = 20.0;
const NAMES: f32 = 210.0;
/// The latest time that is set by hand, in seconds: a day.
const LATEST: f64 = 86_400.0;
/// How long a new caption is shown, in seconds.
const CAPTION_SECONDS: f64 = 3.0;
/// Half of the width of a key's mark.
const MARK: f32 = 5.5;

pub const PRESETS: [(PathPreset, &str, &str); 9] = [
    (PathPreset::View, english!("From this view"), english!("One keyframe; move on and add others")),
    (PathPreset::Bookmarks, english!("Through the bookmarks"), english!("All kept views, two seconds apart")),
    (PathPreset::Turntable, english!("Turntable"), english!("Once around what the camera looks at, in ten seconds")),
    (
        PathPreset::Orbit,
        english!("Orbit of the selection"),
        english!("Around the selected mirror, light or clip, rising and sinking"),
    ),
    (
        PathPreset::Polyline,
        english!("Along the measurement"),
        english!("Above the points of the selected measurement, in ten seconds"),
    ),
    (
        PathPreset::MirrorSweep,
        english!("Mirror sweep"),
        english!("The selected mirror crosses the view and comes back"),
    ),
    (
        PathPreset::MethodTour,
        english!("Method tour"),
        english!(
            "Every reflection method for two seconds, with its name, and with its time and error where the tuning chart has them"
        ),
    ),
    (
        PathPreset::WipeToTruth,
        english!("Wipe: method | truth"),
        english!("A line crosses the picture: the present method on its left, what the ray tracer finds on its right"),
    ),
    (
        PathPreset::WipeFromKept,
        english!("Wipe: kept | now"),
        english!(
            "A line crosses the picture: the kept state (Measure, Compare) on its left, the present one on its right"
        ),
    ),
];
const EASES: [(Ease, &str, &str); 4] = [
    (Ease::Smooth, english!("smooth"), english!("Without a jump in speed")),
    (Ease::Linear, english!("linear"), english!("Evenly from one to the next")),
    (Ease::InOut, english!("in, out"), english!("From a stop to a stop")),
    (Ease::Hold, english!("hold"), english!("Each lasts until the next")),
];

/// The key that is selected.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Selected {
    Keyframe(usize),
    /// The number of a track, and that of its key.
    Key(usize, usize),
    Caption(usize),
}

/// Draws the timeline at the lower edge.
pub fn dock(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    Panel::bottom("timeline")
        .default_size(174.0)
        .size_range(134.0..=420.0)
        .resizable(true)
        .frame(Frame::new().fill(theme::PANEL).inner_margin(egui::Margin::symmetric(10, 6)))
        .show(ui, |ui| show(ui, session, actions));
}

fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut push = |film: Film| actions.push(Action::Film(film));
    let path = session.filming.timeline.path(&session.scene);
    ui.horizontal(|ui| head(ui, session, path, &mut push));
    let Some(path) = path else {
        ui.label(RichText::new(text!("There is no path yet: `New` begins one.")).color(theme::WEAK));
        return;
    };
    let known = egui::Id::unique("selected key of the timeline");
    let selected: Option<(Selected, Option<String>)> = ui.data(|data| data.get_temp(known)).flatten();
    // The track of a key may have gone since, and another one have its place.
    let selected = selected.filter(|(selected, track)| track_of(path, *selected) == track.as_deref());
    let mut selected = selected.map(|(selected, _)| selected).filter(|selected| time_of(path, *selected).is_some());
    let mut changed = path.clone();
    ui.horizontal_wrapped(|ui| options(ui, session, &mut changed, &mut selected, &mut push));
    // The row is always there, so that nothing moves when a caption is selected.
    let end = changed.duration();
    match selected {
        Some(Selected::Caption(index)) if index < changed.captions.len() => {
            captions::row(ui, &mut changed.captions[index], end);
        }
        _ => {
            let text = text!("A click selects a mark or a caption below; a drag moves it.");
            ui.horizontal(|ui| ui.label(RichText::new(text).small().color(theme::WEAK)));
        }
    }
    wipe::row(ui, session, &mut changed);
    lanes(ui, session, &mut changed, &mut selected, &mut push);
    let with_track = selected.map(|selected| (selected, track_of(&changed, selected).map(str::to_owned)));
    ui.data_mut(|data| data.insert_temp(known, with_track));
    if changed != *path {
        push(Film::Change(Box::new(changed)));
    }
}

/// What the track of a selected key changes.
fn track_of(path: &CameraPath, selected: Selected) -> Option<&str> {
    let Selected::Key(track, _) = selected else { return None };
    path.tracks.get(track).map(|track| track.key.as_str())
}

/// The time of a key, if it is there.
fn time_of(path: &CameraPath, selected: Selected) -> Option<f64> {
    match selected {
        Selected::Keyframe(index) => path.keyframes.get(index).map(|keyframe| keyframe.time),
        Selected::Key(track, index) => path.tracks.get(track)?.times.get(index).copied(),
        Selected::Caption(index) => path.captions.get(index).map(|caption| caption.start),
    }
}

/// The first line: the path, what plays it, and its time.
fn head(ui: &mut Ui, session: &Session, path: Option<&CameraPath>, push: &mut impl FnMut(Film)) {
    let timeline = &session.filming.timeline;
    if let Some(path) = path {
        let combo = egui::ComboBox::from_id_salt("path").width(130.0).truncate().selected_text(&path.name);
        let list = combo.show_ui(ui, |ui| {
            for other in &session.scene.objects.paths {
                if ui.selectable_label(other.name == path.name, &other.name).clicked() {
                    push(Film::Choose(other.name.clone()));
                }
            }
        });
        list.response.accessible_name(text!("Path"));
    }
    // A click on the number within it leaves the menu open.
    let menu = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    MenuButton::new(text!("New")).config(menu).ui(ui, |ui| {
        for (preset, name, help) in PRESETS {
            if ui.button(translated(name)).on_hover_text(translated(help)).clicked() {
                push(Film::Add(preset));
                ui.close();
            }
        }
        ui.separator();
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("Height above"));
            let label = label.on_hover_text(text!("How high a path along a measurement leads above its points"));
            let units = units(&session.loaded);
            let unit = units.rise().map_or(String::new(), |unit| format!(" {unit}"));
            let before = session.filming.height(&units);
            let mut height = before;
            let drag = number_field_in(&mut height, &unit).range(-1e6..=1e6).speed(before.abs().max(0.1) * 0.01);
            ui.add(drag).labelled_by(label.id);
            if height != before {
                push(Film::FlyAt(height));
            }
        });
    });
    if let Some(path) = path {
        let shortcut = bindings::shortcut(&Action::Film(Film::Play));
        let text = if timeline.is_playing() { text!("Pause") } else { text!("Play") };
        if ui.button(text).on_hover_text(shortcut).clicked() {
            push(Film::Play);
        }
        let mut repeats = timeline.repeats;
        if ui.checkbox(&mut repeats, text!("Repeat")).changed() {
            push(Film::Repeat(repeats));
        }
        let mut time = timeline.time;
        let drag = number_field_in(&mut time, " s").speed(0.02).range(0.0..=LATEST);
        if ui.add(drag.fixed_decimals(2)).accessible_name(text!("Time")).changed() {
            push(Film::Scrub(time));
        }
        ui.label(
            RichText::new(text!("of {duration} s", duration = format_args!("{:.2}", path.duration())))
                .color(theme::WEAK),
        );
        if timeline.is_playing() {
            ui.ctx().request_repaint();
        }
    }
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
        if ui
            .small_button("×")
            .on_hover_text(text!("Close the timeline"))
            .accessible_name(text!("Close the timeline"))
            .clicked()
        {
            push(Film::Toggle);
        }
        if path.is_some() {
            // The button keeps its place meanwhile, so that nothing else comes under the mouse.
            let is_free = session.filming.recording.under_way.is_none();
            let record = ui.add_enabled(is_free, egui::Button::new(text!("Record…")));
            let record = record.on_hover_text(text!("A film or pictures of this path, as `glint record` makes them"));
            if record.on_disabled_hover_text(text!("A recording is under way")).clicked() {
                push(Film::AskRecording);
            }
        }
        if path.is_some() && ui.small_button(text!("Delete path")).clicked() {
            push(Film::Remove);
        }
    });
}

/// The second line: what the path and the selected key are like, and what is added.
fn options(
    ui: &mut Ui,
    session: &Session,
    path: &mut CameraPath,
    selected: &mut Option<Selected>,
    push: &mut impl FnMut(Film),
) {
    let time = session.filming.timeline.time;
    let name = egui::TextEdit::singleline(&mut path.name).desired_width(110.0);
    ui.add(name).accessible_name(text!("Name of the path"));
    if ui.button(text!("+ Keyframe")).on_hover_text(text!("The camera's view, at the time of the mark")).clicked() {
        *selected = Some(Selected::Keyframe(path.set_keyframe(time, session.scene.camera)));
    }
    ui.menu_button(text!("+ Bookmark"), |ui| {
        if session.scene.objects.bookmarks.is_empty() {
            ui.label(text!("No view is kept."));
        }
        for bookmark in &session.scene.objects.bookmarks {
            if ui.button(&bookmark.name).clicked() {
                *selected = Some(Selected::Keyframe(path.set_keyframe(time, bookmark.camera())));
            }
        }
    })
    .response
    .on_hover_text(text!("A kept view as a keyframe, at the time of the mark"));
    ui.menu_button(text!("+ Key"), |ui| keys_menu(ui, session, push))
        .response
        .on_hover_text(text!("What a parameter, or a value of the selected object, is now, at the time of the mark"));
    let help = text!("A text over the pictures, from the time of the mark on");
    if ui.button(text!("+ Caption")).on_hover_text(help).clicked() {
        *selected = Some(Selected::Caption(path.captions.len()));
        path.captions.push(Caption::new(text!("Caption").into(), time, Some(time + CAPTION_SECONDS)));
    }
    wipe::add(ui, session, path, push);
    let mut ease = path.ease;
    ease_menu(ui, text!("Camera"), &mut ease);
    if ease != path.ease {
        path.set_ease(ease);
    }
    let mut is_even = path.speed.is_some();
    let has_way = path.keyframes.windows(2).any(|ends| ends[0].eye != ends[1].eye);
    let even = ui.add_enabled(has_way, egui::Checkbox::new(&mut is_even, text!("Constant speed")));
    if even.on_disabled_hover_text(text!("The camera stays in one place: add a keyframe from another place")).changed()
    {
        let duration = path.duration();
        let length = Motion::new(path).map_or(0.0, |motion| length(&motion));
        path.set_speed(is_even.then_some(length / duration));
    }
    if let Some(speed) = &mut path.speed {
        let step = *speed * 0.01;
        let drag = number_field_in(speed, text!(" units/s")).speed(step).range(1e-6..=1e9);
        ui.add(drag).accessible_name(text!("Speed"));
    }
    let mut is_loop = path.is_loop;
    if ui.checkbox(&mut is_loop, text!("Loop")).on_hover_text(text!("The path ends where it begins")).changed() {
        path.set_loop(is_loop);
    }
    let Some(key) = *selected else { return };
    ui.separator();
    let mut at = time_of(path, key).unwrap_or_default();
    let drag = number_field_in(&mut at, " s").speed(0.02).range(0.0..=LATEST).fixed_decimals(2);
    if ui
        .add(drag)
        .on_hover_text(text!("The time of the selected key"))
        .accessible_name(text!("Time of the key"))
        .changed()
    {
        move_key(path, key, at);
    }
    if let Selected::Keyframe(index) = key {
        if ui.small_button(text!("Stay")).on_hover_text(text!("The camera stands here for a second more")).clicked() {
            path.hold_keyframe(index, 1.0);
        }
        if ui.small_button(text!("Replace")).on_hover_text(text!("The camera's view takes its place")).clicked() {
            path.set_keyframe(at, session.scene.camera);
        }
    }
    if ui.small_button(text!("Delete key")).clicked() {
        match key {
            Selected::Keyframe(index) => path.remove_keyframe(index),
            Selected::Key(track, index) => path.remove_key(track, index),
            Selected::Caption(index) if index < path.captions.len() => drop(path.captions.remove(index)),
            Selected::Caption(_) => {}
        }
        *selected = None;
    }
}

/// How long the way of the camera is, in world units: that of a line through many of its places.
fn length(motion: &Motion) -> f64 {
    const PLACES: u32 = 1000;
    let [start, end] = [motion.times().first().copied().unwrap_or_default(), motion.duration()];
    let place = |step: u32| motion.camera(start + (end - start) * f64::from(step) / f64::from(PLACES)).eye;
    (0..PLACES).map(|step| place(step).distance(place(step + 1))).sum()
}

fn move_key(path: &mut CameraPath, key: Selected, time: f64) {
    // A hundredth of a second is as fine as anybody sets it.
    let time = (time * 100.0).round() / 100.0;
    match key {
        Selected::Keyframe(index) => path.move_keyframe(index, time),
        Selected::Key(track, index) => path.move_key(track, index, time),
        Selected::Caption(index) => path.captions.get_mut(index).into_iter().for_each(|caption| {
            let time = time.max(0.0);
            caption.end = caption.end.map(|end| end + time - caption.start);
            caption.start = time;
        }),
    }
}

/// What can become a track: values of the selected object, and all parameters by their sections.
fn keys_menu(ui: &mut Ui, session: &Session, push: &mut impl FnMut(Film)) {
    let of_object = session.scene.selected.map(|id| session.scene.objects.keys_of(id)).unwrap_or_default();
    for key in &of_object {
        if ui.button(key).clicked() {
            push(Film::Key(key.clone()));
        }
    }
    let path = session.filming.timeline.path(&session.scene);
    if path.is_some_and(|path| !path.states.is_empty())
        && ui.button(WIPE).on_hover_text(text!("The line between the states, where it is now")).clicked()
    {
        push(Film::Key(WIPE.into()));
    }
    if of_object.is_empty() {
        ui.label(
            RichText::new(text!("Select a mirror, a light, a clip or a profile for its values.")).color(theme::WEAK),
        );
    }
    ui.separator();
    for params in session.scene.settings.groups() {
        let group = params.group();
        let fields: Vec<_> = group.fields.iter().filter(|field| !field.affects.points).collect();
        if fields.is_empty() {
            continue;
        }
        ui.menu_button(group.name, |ui| {
            egui::ScrollArea::vertical().max_height(360.0).show(ui, |ui| {
                for field in fields {
                    if ui.button(field.name).on_hover_text(field.help).clicked() {
                        push(Film::Key(format!("{}.{}", group.name, field.name)));
                        ui.close();
                    }
                }
            });
        });
    }
}

fn ease_menu(ui: &mut Ui, of: &str, ease: &mut Ease) {
    let shown = EASES.iter().find(|(known, ..)| known == ease).map_or("", |(_, name, _)| translated(name));
    let combo = egui::ComboBox::from_id_salt(("ease", of)).width(70.0).selected_text(shown);
    let list = combo.show_ui(ui, |ui| {
        for (known, name, help) in EASES {
            ui.selectable_value(ease, known, translated(name)).on_hover_text(translated(help));
        }
    });
    list.response
        .on_hover_text(text!("How it goes from one key to the next"))
        .accessible_name(text!("Ease of {of}", of));
}

/// Where times stand on the lanes.
#[derive(Clone, Copy)]
struct Scale {
    left: f32,
    width: f32,
    /// The time at the right end, in seconds.
    span: f64,
}

impl Scale {
    fn x(&self, time: f64) -> f32 {
        self.left + (time / self.span) as f32 * self.width
    }

    fn time(&self, x: f32) -> f64 {
        f64::from((x - self.left) / self.width).clamp(0.0, 1.0) * self.span
    }
}

fn lanes(
    ui: &mut Ui,
    session: &Session,
    path: &mut CameraPath,
    selected: &mut Option<Selected>,
    push: &mut impl FnMut(Film),
) {
    let (timeline, duration) = (&session.filming.timeline, path.duration());
    let area = ui.available_rect_before_wrap();
    let left = area.left() + NAMES;
    let width = (area.right() - left - 2.0 * MARK).max(50.0);
    let scale = Scale { left, width, span: rounded_up((duration * 1.1).max(5.0)) };
    let (ruler, _) = ui.allocate_exact_size(vec2(area.width(), LANE), Sense::hover());
    let ruler = ui.interact(ruler.with_min_x(left - MARK), ui.scope_id().with("ruler"), Sense::click_and_drag());
    ruler.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, true, text!("Time of the path")));
    paint_ruler(ui, ruler.rect, scale);
    if let Some(place) = ruler.interact_pointer_pos() {
        push(Film::Scrub(scale.time(place.x)));
    }
    let mut removed = None;
    let top = ruler.rect.top();
    let scrolled = egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 2.0;
        let motion = Motion::new(path);
        let times: Vec<f64> = motion.map(|motion| motion.times().to_vec()).unwrap_or_default();
        lane(
            ui,
            |ui| drop(ui.label(text!("Camera"))),
            |ui, row| {
                for (index, time) in times.iter().enumerate() {
                    let key = Selected::Keyframe(index);
                    let name =
                        text!("Keyframe {index} at {time} s", index = index + 1, time = format_args!("{time:.2}"));
                    let response = mark(ui, row, scale.x(*time), ("keyframe", 0, index), &name, *selected == Some(key));
                    // With a constant speed, the way decides about the time.
                    let moves = path.speed.is_none();
                    follow(&response, (key, *time), moves, scale, path, selected, push);
                }
            },
        );
        if !path.captions.is_empty() {
            let texts = path.captions.clone();
            lane(
                ui,
                |ui| drop(ui.label(text!("Captions"))),
                |ui, row| {
                    for (index, caption) in texts.iter().enumerate() {
                        let key = Selected::Caption(index);
                        let (from, to) = (scale.x(caption.start), scale.x(caption.end.unwrap_or(scale.span)));
                        let bar =
                            Rect::from_x_y_ranges(from..=to.min(row.right()), row.y_range()).shrink2(vec2(0.0, 5.0));
                        ui.painter().rect_filled(bar, 2.0, theme::WEAK.gamma_multiply(0.35));
                        let start = format!("{:.2}", caption.start);
                        let name = text!("Caption {index} at {start} s", index = index + 1, start);
                        let place = ("caption", 0, index);
                        let response = mark(ui, row, from, place, &name, *selected == Some(key));
                        let response = response.on_hover_text(&caption.text);
                        follow(&response, (key, caption.start), true, scale, path, selected, push);
                    }
                },
            );
        }
        for track in 0..path.tracks.len() {
            let (key, before) = (path.tracks[track].key.clone(), path.tracks[track].ease);
            let mut ease = before;
            let names = |ui: &mut Ui| {
                if ui.small_button("×").accessible_name(text!("Delete track {key}", key)).clicked() {
                    removed = Some(track);
                }
                ease_menu(ui, &key, &mut ease);
                ui.add(egui::Label::new(RichText::new(&key).small()).truncate()).on_hover_text(&key);
            };
            let times = path.tracks[track].times.clone();
            lane(ui, names, |ui, row| {
                for (index, time) in times.iter().enumerate() {
                    let seconds = format!("{time:.2}");
                    let name = text!("Key {index} of {key} at {time} s", index = index + 1, key, time = seconds);
                    let place = ("key", track, index);
                    let at = Selected::Key(track, index);
                    let response = mark(ui, row, scale.x(*time), place, &name, *selected == Some(at));
                    let value = path.tracks[track].values.get(index).map(ToString::to_string).unwrap_or_default();
                    let response = response.on_hover_text(format!("{time:.2} s: {}", param::shortened(&value, 60)));
                    follow(&response, (at, *time), true, scale, path, selected, push);
                }
            });
            path.tracks[track].ease = ease;
        }
    });
    if let Some(track) = removed {
        path.tracks.remove(track);
        *selected = None;
    }
    let x = scale.x(timeline.time);
    let color = if timeline.is_followed() { theme::ACCENT } else { theme::WEAK };
    ui.painter().vline(x, top..=scrolled.inner_rect.bottom(), Stroke::new(1.5, color));
}

/// Draws a lane: what stands before it, and its marks.
fn lane(ui: &mut Ui, names: impl FnOnce(&mut Ui), marks: impl FnOnce(&mut Ui, Rect)) {
    ui.horizontal(|ui| {
        let start = ui.cursor().left();
        let layout = egui::Layout::left_to_right(egui::Align::Center);
        ui.allocate_ui_with_layout(vec2(NAMES - 12.0, LANE), layout, |ui| {
            ui.set_min_width(NAMES - 12.0);
            names(ui);
        });
        let (row, _) = ui.allocate_exact_size(vec2(ui.available_width(), LANE), Sense::hover());
        let row = row.with_min_x(start + NAMES - MARK);
        ui.painter().rect_filled(row.shrink2(vec2(0.0, 2.0)), 2.0, ui.visuals().faint_bg_color);
        marks(ui, row);
    });
}

/// Draws the mark of a key.
fn mark(ui: &mut Ui, row: Rect, x: f32, place: (&str, usize, usize), name: &str, is_selected: bool) -> Response {
    let rect = Rect::from_center_size(pos2(x, row.center().y), vec2(2.0 * MARK + 2.0, LANE));
    let response = ui.interact(rect, ui.scope_id().with(place), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::CheckBox, true, is_selected, name));
    let color = match () {
        () if is_selected => theme::ACCENT,
        () if response.hovered() => Color32::WHITE,
        () => theme::WEAK,
    };
    let (middle, reach) = (rect.center(), MARK);
    let corners = [vec2(0.0, -reach), vec2(reach, 0.0), vec2(0.0, reach), vec2(-reach, 0.0)];
    let corners = corners.map(|corner| middle + corner).to_vec();
    ui.painter().add(egui::Shape::convex_polygon(corners, color, Stroke::NONE));
    response
}

/// Selects a key that is clicked and shows its time, and moves one that is dragged.
fn follow(
    mark: &Response,
    (key, time): (Selected, f64),
    moves: bool,
    scale: Scale,
    path: &mut CameraPath,
    selected: &mut Option<Selected>,
    push: &mut impl FnMut(Film),
) {
    if mark.clicked() || mark.drag_started() {
        *selected = Some(key);
    }
    if mark.clicked() {
        push(Film::Scrub(time));
    }
    if let Some(place) = mark.interact_pointer_pos().filter(|_| mark.dragged() && moves) {
        move_key(path, key, scale.time(place.x));
    }
}

fn paint_ruler(ui: &Ui, rect: Rect, scale: Scale) {
    let painter = ui.painter();
    // A label has room in 60 points.
    let step = rounded_up(scale.span * 60.0 / f64::from(scale.width.max(60.0)));
    let count = (scale.span / step).floor() as u32;
    for index in 0..=count {
        let time = f64::from(index) * step;
        let x = scale.x(time);
        painter.vline(x, rect.bottom() - 6.0..=rect.bottom(), Stroke::new(1.0, theme::WEAK));
        let text = format!("{} s", (time * 100.0).round() / 100.0);
        painter.text(pos2(x, rect.top() + 1.0), Align2::CENTER_TOP, text, FontId::proportional(10.5), theme::WEAK);
    }
}

/// The next of 1, 2, 5, 10, 20 and so on, or of their tenths, that is not smaller.
fn rounded_up(value: f64) -> f64 {
    let power = 10.0_f64.powf(value.max(1e-6).log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|step| step * power)
        .find(|step| *step >= value * (1.0 - 1e-9))
        .unwrap_or(value)
}
