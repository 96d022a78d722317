//! The panel of kept views: keeps the view, shows each with its picture, name, note and key, and flies there.

use egui::{RichText, Ui};
use scene::{Bookmark, CaptureFormat};

use crate::shared::language::{english, text, translated};
use crate::viewer::look::theme;
use crate::viewer::requests::action::{Action, Film};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;

/// The size of a picture, in points of the window.
const PICTURE: egui::Vec2 = egui::vec2(80.0, 50.0);

const CAPTURES: [(CaptureFormat, &str, &str); 5] = [
    (CaptureFormat::Mp4, "MP4", english!("A film by H.264 where ffmpeg is there, else by AV1")),
    (CaptureFormat::Av1, "MP4, AV1", english!("A film that browsers and recent phones play; making it takes long")),
    (CaptureFormat::H264, "MP4, H.264", english!("A film for slides and old phones; needs ffmpeg")),
    (CaptureFormat::Gif, "GIF", english!("A film of 256 colours a picture, for pages that show no others")),
    (CaptureFormat::Pictures, english!("Pictures"), english!("A folder with a PNG file for each frame")),
];

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut push = |film: Film| actions.push(Action::Film(film));
    let shortcut = |film: Film| bindings::shortcut(&Action::Film(film));
    ui.horizontal(|ui| {
        let help = text!("{shortcut} keeps it for a key", shortcut = shortcut(Film::Keep(None)));
        if ui.button(text!("Keep the view")).on_hover_text(help).clicked() {
            push(Film::Keep(None));
        }
        let is_open = session.filming.timeline.is_open;
        let timeline = ui.selectable_label(is_open, text!("Timeline"));
        if timeline
            .on_hover_text(text!("Paths of the camera ({shortcut})", shortcut = shortcut(Film::Toggle)))
            .clicked()
        {
            push(Film::Toggle);
        }
    });
    ui.horizontal(|ui| capture(ui, session, &mut push));
    let bookmarks = &session.scene.objects.bookmarks;
    if bookmarks.is_empty() {
        ui.label(RichText::new(text!("No view is kept.")).color(theme::WEAK));
    }
    for (index, bookmark) in bookmarks.iter().enumerate() {
        ui.push_id(index, |ui| ui.horizontal(|ui| row(ui, session, index, bookmark, &mut push)));
    }
}

/// The button that records the window, and what it is recorded into.
fn capture(ui: &mut Ui, session: &Session, push: &mut impl FnMut(Film)) {
    ui.add_enabled_ui(session.filming.live.is_none(), |ui| {
        let shortcut = bindings::shortcut(&Action::Film(Film::Capture));
        let help = text!("All that the window shows, until {shortcut} is pressed again", shortcut);
        if ui.button(text!("Record the window")).on_hover_text(help).clicked() {
            push(Film::Capture);
        }
        let mut format = session.preferences.capture;
        let name = CAPTURES.iter().find(|(known, ..)| *known == format).map_or("", |(_, name, _)| translated(name));
        let combo = egui::ComboBox::from_id_salt("capture").width(90.0).selected_text(name);
        let list = combo.show_ui(ui, |ui| {
            for (known, name, help) in CAPTURES {
                ui.selectable_value(&mut format, known, translated(name)).on_hover_text(translated(help));
            }
        });
        list.response.accessible_name(text!("Record the window as"));
        if format != session.preferences.capture {
            push(Film::CaptureAs(format));
        }
    });
}

fn row(ui: &mut Ui, session: &Session, index: usize, bookmark: &Bookmark, push: &mut impl FnMut(Film)) {
    let name = text!("Fly to {bookmark}", bookmark = bookmark.name);
    let flies = match session.filming.thumbnails.of(bookmark) {
        Some(picture) => {
            let texture = egui::load::SizedTexture::new(picture.texture(ui.ctx()), PICTURE);
            ui.add(egui::Button::image(texture).frame(false))
        }
        None => ui.add_sized(PICTURE, egui::Button::new(text!("Go"))),
    };
    if flies.on_hover_text(&name).accessible_name(name).clicked() {
        push(Film::FlyTo(index));
    }
    let mut changed = bookmark.clone();
    ui.vertical(|ui| {
        ui.horizontal(|ui| {
            if let Some(digit) = bookmark.digit {
                ui.label(RichText::new(text!("Shift+{digit}", digit)).small().color(theme::WEAK));
            }
            let delete = text!("Delete {bookmark}", bookmark = bookmark.name);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui.small_button("×").on_hover_text(&delete).accessible_name(delete).clicked() {
                    push(Film::RemoveBookmark(index));
                }
                let width = ui.available_width();
                let edit = egui::TextEdit::singleline(&mut changed.name).desired_width(width);
                ui.add(edit).accessible_name(text!("Name of bookmark {index}", index = index + 1));
            });
        });
        let width = ui.available_width();
        let edit = egui::TextEdit::singleline(&mut changed.note).hint_text(text!("note")).desired_width(width);
        ui.add(edit).accessible_name(text!("Note of bookmark {index}", index = index + 1));
    });
    if changed != *bookmark {
        push(Film::ChangeBookmark(index, Box::new(changed)));
    }
}
