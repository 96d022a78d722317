//! What a newcomer sees over the picture: the hint of the first scene, and the page that is left when everything is closed.

use egui::{Color32, Rect, RichText, Ui};

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::objects::clouds::short_name;
use crate::viewer::requests::action::{Action, Filing};
use crate::viewer::requests::bindings;
use crate::viewer::requests::bindings::COMMAND;
use crate::viewer::session::Session;

/// Shows a newcomer what to do, until a hand has done something.
pub fn hint(ui: &Ui, rect: Rect, session: &Session) {
    let Some(first) = &session.first_look else { return };
    let is_untouched = session.scene.camera == first.camera && session.scene.history.steps() == 0;
    let is_free =
        !session.interface_is_hidden && !session.filming.timeline.is_open && session.tools.inspection.is_none();
    if is_untouched && is_free && session.frames.shown.is_some() {
        caption(
            ui,
            rect,
            rect.center_bottom() - egui::vec2(0.0, 24.0),
            &text!("Drag the ball by its arrows. Drop a file of points here, or press {COMMAND}+O.", COMMAND),
        );
    }
}

/// Says how to come back where the picture at rest shows none of what is there.
pub fn lost(ui: &Ui, rect: Rect, session: &Session) {
    if let Some(text) = lost_text(session).filter(|_| !session.interface_is_hidden) {
        caption(ui, rect, rect.center(), &text);
    }
}

fn lost_text(session: &Session) -> Option<String> {
    let is_lost = session.frames.final_one().is_some() && session.frames.is_blank && !session.bounds().is_empty();
    let back = bindings::shortcut(&Action::FrameAll);
    let shows_all = session.scene.objects.test().shows_all();
    let more = if shows_all { "" } else { text!(" Clips and filters hide points, too.") };
    is_lost.then(|| text!("Nothing is in view. {back} frames everything.{more}", back, more))
}

/// Says what the inspection mirror waits for until a picture shows it.
pub fn first_reflection(ui: &Ui, rect: Rect, session: &Session) {
    if let Some(text) = first_reflection_text(session).filter(|_| !session.interface_is_hidden) {
        caption(ui, rect, rect.center_bottom() - egui::vec2(0.0, 24.0), &text);
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
    }
}

fn first_reflection_text(session: &Session) -> Option<String> {
    let held = session.tools.inspection.as_ref()?.mirror.as_ref().filter(|_| session.fatal.is_none())?;
    let shown = session.frames.shown.as_ref().map(|shown| &shown.request.mirrors);
    if shown.is_some_and(|mirrors| mirrors.iter().any(|mirror| mirror.name == held.name)) {
        return None;
    }
    let wait = match session.frames.compiled() {
        Some(share) => text!("shaders are compiled, {share} %", share = format_args!("{:.0}", share * 100.0)),
        None => text!("it is being drawn").into(),
    };
    Some(text!("First picture in the mirror: {wait}", wait))
}

/// Writes a text over the picture that can be read whatever is behind it, in lines that fit into the picture. It stands
/// above `foot`, or about it where it has one line.
pub fn caption(ui: &Ui, rect: Rect, foot: egui::Pos2, text: &str) {
    let (font, wrap) = (egui::FontId::proportional(15.0), (rect.width() - 40.0).max(80.0));
    let galley = ui.painter().layout(text.into(), font, Color32::WHITE, wrap);
    let line = galley.size().y / galley.rows.len().max(1) as f32;
    let middle = foot - egui::vec2(0.0, (galley.size().y - line) * 0.5);
    let area = Rect::from_center_size(middle, galley.size());
    ui.painter().rect_filled(area.expand2(egui::vec2(12.0, 6.0)), 6.0, Color32::from_black_alpha(170));
    ui.painter().galley(area.min, galley, Color32::WHITE);
}

/// How many of the last scenes the page lists, and how many of the last files.
const RECENT: [usize; 2] = [3, 4];
/// The built-in scenes in a row of the page.
const SCENES_IN_ROW: usize = 6;

/// Draws the page that is left when everything is closed.
pub fn empty_state(ui: &mut Ui, session: &Session, rect: Rect, actions: &mut Vec<Action>) {
    let size = egui::vec2(520.0, 480.0).min(rect.size());
    let area = Rect::from_center_size(rect.center(), size);
    ui.scope_builder(egui::UiBuilder::new().max_rect(area), |ui| {
        ui.vertical_centered(|ui| {
            ui.label(RichText::new("glint").size(34.0).color(theme::ACCENT));
            ui.add_space(6.0);
            ui.label(RichText::new(text!("Drop a file of points here, or press {COMMAND}+O", COMMAND)).size(16.0));
            ui.add_space(10.0);
            if ui.button(RichText::new(text!("Open files…")).size(15.0)).clicked() {
                actions.push(Action::OpenDialog);
            }
            let [scenes, files] = RECENT;
            for path in session.preferences.sessions.iter().take(scenes) {
                if ui.link(short_name(path)).on_hover_text(path).clicked() {
                    actions.push(Action::File(Filing::Open(path.into())));
                }
            }
            for path in session.preferences.recent.iter().take(files) {
                if ui.link(short_name(path)).on_hover_text(path).clicked() {
                    actions.push(Action::Open(path.into()));
                }
            }
            ui.add_space(14.0);
            ui.label(RichText::new(text!("or look at a built-in scene")).color(theme::WEAK));
        });
        let names = world::built_in_names();
        for family in names.chunk_by(|one, next| family(one) == family(next)) {
            ui.vertical_centered(|ui| {
                ui.add_space(4.0);
                ui.label(RichText::new(self::family(&family[0])).small().color(theme::WEAK));
            });
            family.chunks(SCENES_IN_ROW).for_each(|row| scene_row(ui, row, actions));
        }
    });
}

/// The part of a built-in scene's name that it shares with others like it.
fn family(name: &str) -> &str {
    name.split_once('/').map_or(name, |(family, _)| family)
}

fn scene_row(ui: &mut Ui, names: &[String], actions: &mut Vec<Action>) {
    let own = |name: &str| name.rsplit('/').next().unwrap_or(name).to_owned();
    // The row is centred by hand, because a centred layout puts each button on a line of its own.
    let width: f32 = names.iter().map(|name| 7.2 * own(name).len() as f32 + 24.0).sum();
    ui.horizontal(|ui| {
        ui.add_space(((ui.available_width() - width) * 0.5).max(0.0));
        for name in names {
            if ui.button(own(name)).on_hover_text(name).clicked() {
                actions.push(Action::Open(name.into()));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::Camera;

    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::objects::inspection::Surface;
    use crate::viewer::requests::preferences::Preferences;

    #[test]
    fn the_page_lists_what_was_open_and_each_built_in_scene_below_its_family() {
        let preferences = Preferences {
            sessions: vec!["/scans/hall.toml".into()],
            recent: vec!["/scans/hall.laz".into()],
            ..Preferences::default()
        };
        let show = |ui: &mut Ui, (session, actions): &mut (Session, Vec<Action>)| {
            empty_state(ui, session, ui.max_rect(), actions);
        };
        let state = (Session::new(preferences), Vec::new());
        let mut harness = Harness::builder().with_size([900.0, 700.0]).build_ui_state(show, state);
        for family in ["five-mirrors", "courtyard", "tripod"] {
            assert!(harness.query_by_label(family).is_some(), "{family}");
        }
        for name in ["hall.toml", "hall.laz", "hall-30"] {
            harness.get_by_label(name).click();
            harness.run();
        }
        let [scene, file] = ["/scans/hall.toml", "/scans/hall.laz"].map(std::path::PathBuf::from);
        let wanted = [Action::File(Filing::Open(scene)), Action::Open(file), Action::Open("tripod/hall-30".into())];
        assert_eq!(harness.state().1, wanted);
    }

    #[test]
    fn a_view_of_nothing_says_how_to_come_back_wherever_the_eye_stands() {
        let Some(mut bench) = Bench::with_scene("courtyard/pool") else { return };
        bench.settle();
        assert_eq!(lost_text(&bench.session), None);
        // The eye stands within the box of everything, below the open sky, and looks up.
        let (bounds, up) = (bench.session.bounds(), bench.session.up());
        let height = (bounds.max - bounds.center()).dot(up);
        let eye = bounds.center() + up * (0.99 * height);
        bench.session.scene.camera = Camera::from_eye(eye, eye + up * 10.0 + DVec3::X, up);
        bench.settle();
        let told = "Nothing is in view. Home frames everything.";
        assert_eq!(lost_text(&bench.session).as_deref(), Some(told));
        bench.session.act(Action::FrameAll);
        bench.settle();
        assert_eq!(lost_text(&bench.session), None);
    }

    #[test]
    fn the_inspection_mirror_says_what_it_waits_for_until_a_picture_shows_it() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        bench.session.act(Action::Inspect);
        assert_eq!(first_reflection_text(&bench.session), None, "it is over no surface");
        let held = bench.session.tools.inspection.as_mut().unwrap();
        let eye = bench.session.scene.camera.eye;
        held.update(Some(Surface { position: DVec3::ZERO, normal: DVec3::Z }), |_| eye, DVec3::Z);
        let told = "First picture in the mirror: it is being drawn";
        assert_eq!(first_reflection_text(&bench.session).as_deref(), Some(told));
        let shaders = bench.session.frames.shaders.clone();
        shaders.set_total(shaders.done() + 10);
        shaders.add(5);
        let told = "First picture in the mirror: shaders are compiled, 50 %";
        assert_eq!(first_reflection_text(&bench.session).as_deref(), Some(told));
        shaders.add(5);
        bench.settle();
        assert_eq!(first_reflection_text(&bench.session), None);
    }
}
