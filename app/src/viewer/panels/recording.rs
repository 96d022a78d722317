//! The dialog of `Record…`, and the progress of a recording in the status bar.

use std::sync::atomic::Ordering;

use egui::{Key, RichText, Ui};

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{name_label, number_field, number_field_in, progress_bar};
use crate::viewer::requests::action::{Action, Film};
use crate::viewer::requests::bindings;
use crate::viewer::requests::recording::Wanted;
use crate::viewer::session::Session;

pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = &session.filming.recording.asked else { return };
    let mut wanted = before.clone();
    let (mut is_open, mut film) = (true, None);
    let title = text!("Record `{path}`", path = before.path);
    let window = egui::Window::new(title).id(egui::Id::unique("recording")).open(&mut is_open);
    let window = window.collapsible(false).resizable(false).anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO);
    window.show(context, |ui| {
        let is_entered = fields(ui, session, &mut wanted);
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            let is_named = !wanted.output.trim().is_empty();
            let start = ui.add_enabled(is_named, egui::Button::new(text!("Record")));
            film = (start.clicked() || is_entered && is_named).then_some(Film::StartRecording);
            if ui.button(text!("Cancel")).clicked() {
                film = Some(Film::ChangeRecording(None));
            }
            if ui
                .button(text!("Copy the command"))
                .on_hover_text(text!("For a scene that is saved as scene.toml"))
                .clicked()
            {
                actions.push(Action::Copy(command(&wanted, session.adapter.as_deref())));
            }
        });
    });
    if wanted != *before {
        actions.push(Action::Film(Film::ChangeRecording(Some(Box::new(wanted)))));
    }
    if !is_open || context.input(|input| input.key_pressed(Key::Escape)) {
        film = Some(Film::ChangeRecording(None));
    }
    actions.extend(film.map(Action::Film));
}

fn command(wanted: &Wanted, adapter: Option<&str>) -> String {
    let words = wanted.words(adapter);
    let words = words.iter().map(|word| crate::shared::command_line::quoted(&word.to_string_lossy()));
    format!("glint record scene.toml {}\n", words.collect::<Vec<_>>().join(" "))
}

/// Draws the fields. Returns whether Enter was pressed in that of the output.
fn fields(ui: &mut Ui, session: &Session, wanted: &mut Wanted) -> bool {
    let mut is_entered = false;
    let line = |ui: &mut Ui, name: &str, contents: &mut dyn FnMut(&mut Ui, egui::Id)| {
        ui.horizontal(|ui| {
            let label = name_label(ui, name);
            contents(ui, label.id);
        });
    };
    line(ui, text!("File or folder"), &mut |ui, label| {
        let edit = egui::TextEdit::singleline(&mut wanted.output).desired_width(280.0);
        let help = text!(
            "A film if it ends in .mp4 or .gif, with its pictures in a folder beside it; else a folder of pictures"
        );
        let response = ui.add(edit).labelled_by(label).on_hover_text(help);
        if !std::mem::replace(&mut wanted.is_shown, true) {
            response.request_focus();
        }
        is_entered = response.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
    });
    line(ui, text!("Size"), &mut |ui, label| {
        for side in &mut wanted.size {
            ui.add(number_field(side).range(16..=16384).speed(2.0)).labelled_by(label);
        }
        for size in [[1280, 720], [1920, 1080], [3840, 2160]] {
            if ui.small_button(format!("{} × {}", size[0], size[1])).clicked() {
                wanted.size = size;
            }
        }
    });
    line(ui, text!("Frame rate"), &mut |ui, label| {
        ui.add(number_field_in(&mut wanted.fps, text!(" a second")).range(1..=1000)).labelled_by(label);
    });
    let duration = session.filming.timeline.path(&session.scene).map_or(0.0, |path| path.duration());
    let all = (duration * f64::from(wanted.fps) - 1e-6).ceil().max(1.0) as u32;
    line(ui, text!("Frames"), &mut |ui, label| {
        let mut is_part = wanted.frames[0] < wanted.frames[1];
        if ui.checkbox(&mut is_part, text!("Only")).changed() {
            wanted.frames = if is_part { [0, all] } else { [0, 0] };
        }
        if is_part {
            let [first, end] = wanted.frames;
            ui.add(number_field(&mut wanted.frames[0]).range(0..=end.min(all) - 1)).labelled_by(label);
            ui.label(text!("to before"));
            ui.add(number_field(&mut wanted.frames[1]).range(first + 1..=all)).labelled_by(label);
        }
        ui.label(RichText::new(text!("of {all}", all)).color(theme::WEAK));
    });
    line(ui, text!("Sub-frames"), &mut |ui, label| {
        ui.add(number_field(&mut wanted.subframes).range(1..=256)).labelled_by(label);
        if wanted.subframes > 1 {
            ui.label(text!("shutter"));
            let shutter = number_field(&mut wanted.shutter).range(0.01..=1.0).speed(0.01);
            ui.add(shutter)
                .on_hover_text(text!("The share of a frame's time for which it is open"))
                .accessible_name(text!("Shutter"));
        }
    });
    line(ui, text!("Supersampling"), &mut |ui, label| {
        let drag = number_field_in(&mut wanted.supersample, text!(" × a side")).range(1..=8);
        ui.add(drag).labelled_by(label);
    });
    if wanted.output.ends_with(".mp4") {
        line(ui, text!("Film"), &mut |ui, _| {
            ui.radio_value(&mut wanted.is_h264, false, "AV1");
            ui.radio_value(&mut wanted.is_h264, true, "H.264")
                .on_hover_text(text!("For slides and old phones; needs ffmpeg"));
        });
    }
    is_entered
}

/// Shows how far recordings are, with buttons to end them.
pub fn progress(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    if let Some(live) = &session.filming.live {
        let dropped = live.dropped.load(Ordering::Relaxed);
        let dropped = if dropped > 0 { text!(", {dropped} pictures dropped", dropped) } else { String::new() };
        if live.is_ending {
            ui.spinner();
            ui.label(text!("making {live}{dropped}", live = live.name.display(), dropped));
        } else {
            let seconds = session.outside.now.saturating_duration_since(live.since).as_secs();
            ui.colored_label(theme::ERROR, text!("recording the window, {seconds} s{dropped}", seconds, dropped));
            let stop = Action::Film(Film::Capture);
            let shortcut = bindings::shortcut(&stop);
            actions.extend(ui.small_button(text!("Stop")).on_hover_text(shortcut).clicked().then_some(stop));
            ui.ctx().request_repaint_after(std::time::Duration::from_secs(1));
        }
    }
    let Some(under_way) = &session.filming.recording.under_way else { return };
    let text = match &under_way.stage {
        _ if under_way.is_stopping => text!("recording: stopping").to_owned(),
        None => text!("recording: starting").to_owned(),
        Some(stage) => {
            let rate = under_way.rate(session.outside.now).map_or(String::new(), |rate| match rate {
                _ if rate >= 1e4 => format!(", {:.2} M/s", rate / 1e6),
                _ => format!(", {rate:.2}/s"),
            });
            let left = under_way.seconds_left(session.outside.now).map_or(String::new(), |seconds| match seconds {
                _ if seconds >= 90.0 => {
                    text!(", {minutes} min left", minutes = format_args!("{:.0}", (seconds / 60.0).ceil()))
                }
                _ => text!(", {seconds} s left", seconds = format_args!("{seconds:.0}")),
            });
            text!(
                "{output}: {task}, {done} of {total}{rate}{left}",
                output = under_way.wanted.output,
                task = stage.task,
                done = stage.done,
                total = stage.total,
                rate,
                left
            )
        }
    };
    // The text changes its length: before it, the button keeps its place.
    let stop = ui.add_enabled(!under_way.is_stopping, egui::Button::new(text!("Stop recording")).small());
    if stop.on_hover_text(text!("What is recorded stays; the same recording goes on from there")).clicked() {
        actions.push(Action::Film(Film::StopRecording));
    }
    let total = under_way.stage.as_ref().filter(|stage| stage.total > 0);
    progress_bar(ui, total.map_or(0.0, |stage| (stage.done as f32 / stage.total as f32).min(1.0)));
    ui.label(text);
    ui.ctx().request_repaint_after(std::time::Duration::from_millis(200));
}
