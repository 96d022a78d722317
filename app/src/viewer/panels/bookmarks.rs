//! The panel of kept views: keeps the view, shows each with its picture, name, note and key, and flies there.

use egui::{RichText, Ui};
use scene::Bookmark;

use crate::viewer::action::{Action, Film};
use crate::viewer::input::bindings;
use crate::viewer::session::Session;
use crate::viewer::theme;

/// The size of a picture, in points of the window.
const PICTURE: egui::Vec2 = egui::vec2(80.0, 50.0);

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut push = |film: Film| actions.push(Action::Film(film));
    let shortcut = |film: Film| bindings::shortcut(&Action::Film(film));
    ui.horizontal(|ui| {
        let help = format!("{} keeps it for a key", shortcut(Film::Keep(None)));
        if ui.button("Keep the view").on_hover_text(help).clicked() {
            push(Film::Keep(None));
        }
        let is_open = session.filming.timeline.is_open;
        let timeline = ui.selectable_label(is_open, "Timeline");
        if timeline.on_hover_text(format!("Paths of the camera ({})", shortcut(Film::Toggle))).clicked() {
            push(Film::Toggle);
        }
    });
    let record = ui.add_enabled(session.filming.live.is_none(), egui::Button::new("Record the window"));
    let help = format!("A film of all that the window shows, until {} is pressed again", shortcut(Film::Capture));
    if record.on_hover_text(help).clicked() {
        push(Film::Capture);
    }
    let bookmarks = &session.scene.objects.bookmarks;
    if bookmarks.is_empty() {
        ui.label(RichText::new("No view is kept.").color(theme::WEAK));
    }
    for (index, bookmark) in bookmarks.iter().enumerate() {
        ui.push_id(index, |ui| ui.horizontal(|ui| row(ui, session, index, bookmark, &mut push)));
    }
}

fn row(ui: &mut Ui, session: &Session, index: usize, bookmark: &Bookmark, push: &mut impl FnMut(Film)) {
    let name = format!("Fly to {}", bookmark.name);
    let flies = match session.filming.thumbnails.of(bookmark) {
        Some(picture) => {
            let texture = egui::load::SizedTexture::new(picture.texture(ui.ctx()), PICTURE);
            ui.add(egui::Button::image(texture).frame(false))
        }
        None => ui.add_sized(PICTURE, egui::Button::new("Go")),
    };
    if flies.on_hover_text(&name).accessible_name(name).clicked() {
        push(Film::FlyTo(index));
    }
    let mut changed = bookmark.clone();
    ui.vertical(|ui| {
        ui.horizontal(|ui| {
            if let Some(digit) = bookmark.digit {
                ui.label(RichText::new(format!("Shift+{digit}")).small().color(theme::WEAK));
            }
            let delete = format!("Delete {}", bookmark.name);
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if ui.small_button("×").on_hover_text(&delete).accessible_name(delete).clicked() {
                    push(Film::RemoveBookmark(index));
                }
                let width = ui.available_width();
                let edit = egui::TextEdit::singleline(&mut changed.name).desired_width(width);
                ui.add(edit).accessible_name(format!("Name of bookmark {}", index + 1));
            });
        });
        let width = ui.available_width();
        let edit = egui::TextEdit::singleline(&mut changed.note).hint_text("note").desired_width(width);
        ui.add(edit).accessible_name(format!("Note of bookmark {}", index + 1));
    });
    if changed != *bookmark {
        push(Film::ChangeBookmark(index, Box::new(changed)));
    }
}
