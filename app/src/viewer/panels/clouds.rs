//! The panel that lists the clouds. Each can be shown or hidden, framed and removed.

use egui::{RichText, Ui};

use crate::viewer::action::Action;
use crate::viewer::loaded::figures::Figures;
use crate::viewer::session::Session;
use crate::viewer::theme;
use crate::viewer::theme::grouped;
use crate::viewer::widgets::eye;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    for entry in &session.loaded.clouds {
        ui.push_id(entry.key.0, |ui| {
            ui.horizontal(|ui| {
                if eye(ui, entry.is_visible, &entry.cloud.name).clicked() {
                    actions.push(Action::ShowCloud(entry.key, !entry.is_visible));
                }
                ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                    let remove = ui.small_button("×").on_hover_text("Remove");
                    if remove.accessible_name(format!("Remove {}", entry.cloud.name)).clicked() {
                        actions.push(Action::RemoveCloud(entry.key));
                    }
                    if ui.small_button("Frame").on_hover_text("Show all of this cloud").clicked() {
                        actions.push(Action::FrameCloud(entry.key));
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
            let known = |figures: &Figures| (figures.strays.unwrap_or(0), figures.noise.flatten());
            let (strays, noise) = entry.figures.as_ref().map_or((0, None), known);
            let strays = (strays > 0).then(|| format!("{} stray", grouped(strays)));
            let noise = noise.map(|noise| format!("noise {}", crate::info::two_digits(noise)));
            let line: Vec<String> = strays.into_iter().chain(noise).collect();
            if !line.is_empty() {
                let quality = ui.label(RichText::new(line.join(" · ")).small().color(theme::WEAK));
                quality.on_hover_text(
                    "Stray points are far from all surfaces (splat.strays). Noise is how far points are from the \
                     planes through their neighbours, in the file's unit: the standard deviation.",
                );
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::Camera;

    use super::*;
    use crate::viewer::loaded::Loaded;
    use crate::viewer::outside::Effect;
    use crate::viewer::work::{Found, Work};

    /// The panel with a cloud of two points.
    fn harness() -> Harness<'static, Session> {
        let session = Session::with_two_points();
        let mut harness = Harness::builder().with_size([320.0, 200.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        harness
    }

    #[test]
    fn a_cloud_is_hidden_and_shown_by_its_eye_and_removed_by_its_button() {
        let mut harness = harness();
        assert!(harness.query_by_label("2 points").is_some());
        for visible in [false, true] {
            harness.get_by_label("Show cloud.ply").click();
            harness.run_ok();
            assert_eq!(harness.state().loaded.clouds[0].is_visible, visible);
        }
        harness.get_by_label("Remove cloud.ply").click();
        harness.run_ok();
        assert!(harness.state().loaded.clouds.is_empty() && harness.query_by_label("2 points").is_none());
    }

    #[test]
    fn strays_and_noise_are_told_once_they_are_known() {
        let mut harness = harness();
        let session = harness.state_mut();
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, .. }) = effect {
                let figures = Figures::of(&cloud, &basis.color, &basis.test, up);
                let figures = Box::new(Figures { strays: Some(1234), noise: Some(Some(0.001_63)), ..figures });
                session.on_found(Found::Figures { key, basis, figures });
            }
        }
        harness.run_ok();
        assert!(harness.query_by_label("1,234 stray · noise 0.0016").is_some());
    }

    #[test]
    fn frame_looks_at_the_whole_cloud_from_where_one_looks_now_and_is_undone() {
        let mut harness = harness();
        let session = harness.state_mut();
        session.with_loaded(Loaded::renew_figures);
        for effect in std::mem::take(&mut session.outside.effects) {
            if let Effect::Work(Work::FindFigures { key, cloud, basis, up, .. }) = effect {
                let figures = Box::new(Figures::of(&cloud, &basis.color, &basis.test, up));
                session.on_found(Found::Figures { key, basis, figures });
            }
        }
        session.scene.camera = Camera::looking(DVec3::splat(900.0), DVec3::new(1.0, 2.0, -0.5), 3.0, DVec3::Z);
        let before = session.scene.camera;
        harness.get_by_label("Frame").click();
        harness.run_ok();
        let camera = harness.state().scene.camera;
        assert!(camera.forward().distance(before.forward()) < 1e-6, "{}", camera.forward());
        let lens = harness.state().scene.lens();
        let size = glam::DVec2::from(harness.state().scene.view_size.map(f64::from));
        for corner in [DVec3::ZERO, DVec3::new(10.0, 10.0, 0.0)] {
            let pixel = lens.project(corner).expect("a corner before the eye");
            assert!(pixel.cmpge(glam::DVec2::ZERO).all() && pixel.cmple(size).all(), "{corner} is at {pixel}");
        }
        harness.state_mut().act(Action::Undo);
        assert_eq!(harness.state().scene.camera, before);
    }
}
