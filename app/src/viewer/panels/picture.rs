//! The window that saves the picture at any size, under a name and in a place that a person chooses.

use std::path::Path;

use egui::{Key, RichText};

use crate::shared::command_line::LARGEST_SIDE;
use crate::shared::language::{english, text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::{name_label, number_field};
use crate::viewer::requests::action::{Action, PictureDraft, SavePicture};
use crate::viewer::session::Session;

/// Sizes that people ask for: name, width, height.
const SIZES: [(&str, [u32; 2]); 3] =
    [("Full HD", [1920, 1080]), ("4K", [3840, 2160]), (english!("A4 at 300 dpi"), [3508, 2480])];

/// Draws the window if it is open.
pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(before) = &session.tools.picture_draft else { return };
    let mut draft = before.clone();
    let mut is_open = true;
    let window = egui::Window::new(text!("Save the picture")).open(&mut is_open).collapsible(false).resizable(false);
    window.anchor(egui::Align2::CENTER_TOP, [0.0, 80.0]).show(context, |ui| {
        ui.set_width(440.0);
        size_line(ui, session.scene.view_size, &mut draft);
        let entered = path_line(ui, &mut draft, actions);
        let place = draft.place();
        let is_there = Path::new(&place).exists();
        if is_there {
            let text = text!("{place} is there, and is replaced.", place);
            ui.label(RichText::new(text).color(theme::WARNING));
        }
        ui.horizontal(|ui| {
            let is_named = !draft.path.trim().is_empty();
            let save =
                ui.add_enabled(is_named, egui::Button::new(if is_there { text!("Replace") } else { text!("Save") }));
            if save.clicked() || entered && is_named && !is_there {
                actions.push(Action::SavePicture(SavePicture::To(Box::new(draft.clone()))));
            }
            if ui.button(text!("Cancel")).clicked() || ui.input(|input| input.key_pressed(Key::Escape)) {
                actions.push(Action::SavePicture(SavePicture::Change(None)));
            }
        });
    });
    if !is_open {
        actions.push(Action::SavePicture(SavePicture::Change(None)));
    } else if draft != *before {
        // An answer to the buttons above comes later, and counts.
        actions.insert(0, Action::SavePicture(SavePicture::Change(Some(Box::new(draft)))));
    }
}

fn size_line(ui: &mut egui::Ui, shown: [u32; 2], draft: &mut PictureDraft) {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Pixels"));
        for (axis, side) in draft.size.iter_mut().enumerate() {
            if axis == 1 {
                ui.label("×");
            }
            ui.add(number_field(side).range(1..=LARGEST_SIDE).speed(4.0)).labelled_by(label.id);
        }
    });
    ui.horizontal_wrapped(|ui| {
        let times = |factor: u32| shown.map(|side| (side * factor).clamp(1, LARGEST_SIDE));
        let own = [(text!("As shown"), times(1)), (text!("2 times"), times(2)), (text!("4 times"), times(4))];
        for (name, size) in own.into_iter().chain(SIZES) {
            let help = format!("{} × {}", size[0], size[1]);
            if ui.selectable_label(draft.size == size, translated(name)).on_hover_text(help).clicked() {
                draft.size = size;
            }
        }
    });
}

/// Says which picture is being saved: a large one takes a while, and the window shows another.
pub fn progress(ui: &mut egui::Ui, session: &Session) {
    let Some(path) = session.outside.saving().next() else { return };
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    ui.spinner();
    ui.label(RichText::new(text!("saving {name}", name)).color(theme::WEAK)).on_hover_text(path.display().to_string());
}

/// Draws the field of the path. Returns whether Enter was pressed in it.
fn path_line(ui: &mut egui::Ui, draft: &mut PictureDraft, actions: &mut Vec<Action>) -> bool {
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("File"));
        let field = egui::TextEdit::singleline(&mut draft.path).desired_width(240.0);
        let response = ui.add(field).labelled_by(label.id);
        if !draft.is_shown {
            draft.is_shown = true;
            response.request_focus();
        }
        if ui.button(text!("Browse…")).on_hover_text(text!("Choose the place in the system's dialog")).clicked() {
            actions.push(Action::SavePicture(SavePicture::Browse(draft.place().into())));
        }
        response.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter))
    })
    .inner
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::requests::preferences::Preferences;

    #[test]
    fn a_size_and_a_name_are_chosen_and_a_file_that_is_there_is_replaced_by_its_button_only() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall").display().to_string();
        std::fs::write(format!("{path}.png"), "").unwrap();
        let mut session = Session::new(Preferences::default());
        session.set_view_size([640, 480]);
        let draft = PictureDraft { path: path.clone(), size: [640, 480], is_shown: false };
        session.tools.picture_draft = Some(draft);
        let mut harness = Harness::builder().with_size([800.0, 500.0]).with_max_steps(16).build_ui_state(
            |ui, (session, asked): &mut (Session, Vec<Action>)| {
                let mut actions = Vec::new();
                show(ui.ctx(), session, &mut actions);
                for action in actions {
                    match action {
                        Action::SavePicture(SavePicture::Change(_)) => session.act(action),
                        other => asked.push(other),
                    }
                }
            },
            (session, Vec::new()),
        );
        harness.run_ok();
        harness.key_press(Key::Enter);
        harness.run_ok();
        assert_eq!(harness.state().1, []);
        harness.get_by_label("2 times").click();
        harness.run_ok();
        harness.get_by_label("Replace").click();
        harness.run_ok();
        let [Action::SavePicture(SavePicture::To(draft))] = harness.state().1.as_slice() else {
            panic!("{:?}", harness.state().1)
        };
        assert_eq!((draft.size, draft.place()), ([1280, 960], format!("{path}.png")));
        harness.key_press(Key::Escape);
        harness.run_ok();
        assert!(harness.state().0.tools.picture_draft.is_none());
    }
}
