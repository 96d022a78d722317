//! The list of clouds: show or hide, frame, remove.

use egui::{RichText, Ui};
use scene::StandardView;

use super::state::State;
use super::theme::{self, grouped};
use super::widgets::eye;

pub fn show(ui: &mut Ui, state: &mut State) {
    enum Wish {
        Show(bool),
        Frame,
        Remove,
    }
    let mut wish = None;
    for entry in &state.clouds {
        ui.push_id(entry.key.0, |ui| {
            ui.horizontal(|ui| {
                if eye(ui, entry.is_visible, &entry.cloud.name).clicked() {
                    wish = Some((entry.key, Wish::Show(!entry.is_visible)));
                }
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let remove = ui.small_button("×").on_hover_text("Remove");
                    if remove.accessible_name(format!("Remove {}", entry.cloud.name)).clicked() {
                        wish = Some((entry.key, Wish::Remove));
                    }
                    if ui.small_button("Frame").on_hover_text("Show all of this cloud").clicked() {
                        wish = Some((entry.key, Wish::Frame));
                    }
                    ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                        let name = ui.add(egui::Label::new(&entry.cloud.name).truncate());
                        name.on_hover_text(&entry.input);
                    });
                });
            });
            let points = if entry.streamed.is_some() {
                let what = if entry.is_visible { "shown" } else { "kept" };
                format!("{} of {} points {what}", grouped(entry.points), grouped(entry.total()))
            } else if entry.is_read || entry.points >= entry.expected_points {
                format!("{} points", grouped(entry.points))
            } else {
                format!("{} of {} points", grouped(entry.points), grouped(entry.expected_points))
            };
            let format = entry.source.as_ref().map(|source| {
                let info = source.info();
                let format = match info.format {
                    codec::Format::Las => "LAS",
                    codec::Format::Laz => "LAZ",
                    codec::Format::Ply => "PLY",
                };
                let point_format = info.point_format.map_or(String::new(), |number| format!(", format {number}"));
                format!(" · {format} {}{point_format}", info.version)
            });
            let streamed = if entry.streamed.is_some() { " · streamed" } else { "" };
            let line = points + &format.unwrap_or_default() + streamed;
            ui.label(RichText::new(line).small().color(theme::WEAK));
        });
    }
    let Some((key, wish)) = wish else { return };
    match wish {
        Wish::Show(visible) => state.set_visible(key, visible),
        Wish::Remove => state.remove_cloud(key),
        Wish::Frame => {
            let outline =
                state.cloud(key).and_then(|entry| entry.figures.as_ref()).map(|figures| figures.outline.clone());
            if let Some(outline) = outline.filter(|outline| !outline.is_empty()) {
                let mut camera = state.framed(&outline, StandardView::Isometric);
                // As it is looked at now, but at this cloud.
                camera.eye = camera.pivot - state.camera.forward() * camera.distance();
                camera.frame(&outline, state.settings.view.field_of_view, state.aspect());
                state.jump(state.settings.clone(), camera);
            }
        }
    }
}
