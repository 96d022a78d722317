//! The panel of comparisons: measures the distances of one cloud to another, and keeps a state of the picture to look at
//! beside the present one.

use codec::Units;
use egui::{Align2, Color32, Pos2, Rect, RichText, Sense, Ui, pos2, vec2};
use measure::DistanceFigures;

use crate::shared::comparing::Scales;
use crate::shared::language::{english, text, translated};
use crate::viewer::input;
use crate::viewer::jobs::comparisons::{CompareDraft, Compared, Second};
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{name_label, number_field, progress_bar};
use crate::viewer::panels::overlay;
use crate::viewer::panels::truth::{divide, split, tag};
use crate::viewer::requests::action::{Action, Compare, KeptStep};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::truth::view::Picture;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    distances(ui, session, actions);
    ui.separator();
    kept(ui, session, actions);
}

/// The buttons of the kept state.
fn kept(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut button = |ui: &mut Ui, name: &str, is_on: bool, is_able: bool, step: KeptStep, help: &str| {
        let action = Action::Kept(step);
        let shortcut = match bindings::shortcut(&action) {
            shortcut if shortcut.is_empty() => shortcut,
            shortcut => format!(" ({shortcut})"),
        };
        let button = ui.add_enabled(is_able, egui::Button::selectable(is_on, name));
        actions.extend(button.on_hover_text(format!("{help}{shortcut}")).clicked().then_some(action));
    };
    let (is_there, is_split) = (session.kept.is_there(), session.kept.is_split);
    ui.horizontal(|ui| {
        let help = text!("Keeps parameters, lights, colours and which points are shown, to look at beside later ones");
        button(ui, text!("Keep this state"), false, true, KeptStep::Keep, help);
        let help = text!("The kept state on the left, the present one on the right: drag the line");
        button(ui, text!("Split"), is_split, is_there, KeptStep::ToggleSplit, help);
        let help = text!(
            "The kept state in the left half of the window, the present one in the right: both follow the camera"
        );
        button(ui, text!("Side by side"), session.kept.is_beside(), is_there, KeptStep::ToggleBeside, help);
    });
    ui.horizontal_wrapped(|ui| {
        let help = text!(
            "The kept state becomes the present one, with its parameters, lights, clips and shown points, and \
                that is kept"
        );
        button(ui, text!("Swap"), false, is_there, KeptStep::Swap, help);
        button(
            ui,
            text!("Forget"),
            false,
            is_there,
            KeptStep::LetGo,
            text!("Forgets the kept state, and frees its memory"),
        );
        let hold = bindings::shortcut(&Action::ShowKept);
        ui.label(RichText::new(text!("hold {hold} to see it", hold)).color(theme::WEAK));
    });
}

/// Draws the kept state over the picture in `rect`, where it is asked for.
pub fn paint(ui: &Ui, rect: Rect, session: &Session, actions: &mut Vec<Action>) {
    let kept = &session.kept;
    if !kept.is_asked_for() || kept.is_beside() {
        return;
    }
    let painter = ui.painter().with_clip_rect(rect);
    let right = if kept.is_held {
        Rect::from_min_max(rect.right_top(), rect.max)
    } else {
        let moved = |share| Action::Kept(KeptStep::SplitAt(share));
        split(ui, rect, kept.split, moved, actions)
    };
    let left = rect.with_max_x(right.left());
    let text = match present_picture(session) {
        Some(picture) => {
            painter.with_clip_rect(left).image(picture.texture(ui.ctx()), rect, WHOLE, Color32::WHITE);
            text!("kept state")
        }
        None => translated(LATER),
    };
    if !kept.is_held {
        divide(&painter, right);
    }
    tag(&painter.with_clip_rect(left), rect.left_top() + vec2(10.0, 10.0), Align2::LEFT_TOP, text);
}

const LATER: &str = english!("the kept state is drawn once the picture stands still");
const WHOLE: Rect = Rect { min: Pos2::ZERO, max: pos2(1.0, 1.0) };

/// The picture of the kept state from where the camera is now.
fn present_picture(session: &Session) -> Option<&Picture> {
    // The camera may have moved since the frame on the screen.
    let (camera, size) = (session.scene.camera, session.scene.view_size);
    let shown = &session.frames.shown.as_ref()?.request;
    let is_present = shown.camera == camera && shown.size == size;
    is_present.then(|| session.kept.picture(shown)).flatten()
}

/// Draws the kept state in the left half of `rect` where it shall be beside the present one. The mouse moves the camera
/// there, too. Returns the part of `rect` that is left for the present state.
pub fn beside(ui: &Ui, rect: Rect, session: &Session, actions: &mut Vec<Action>) -> Rect {
    if !session.kept.is_beside() {
        return rect;
    }
    // The halves have whole pixels, and equally many.
    let pixel = 1.0 / ui.ctx().pixels_per_point();
    let width = ((rect.width() * 0.5 - pixel) / pixel).floor() * pixel;
    let (left, right) = (rect.with_max_x(rect.left() + width), rect.with_min_x(rect.right() - width));
    let response = ui.interact(left, ui.scope_id().with("kept state"), Sense::CLICK | Sense::DRAG);
    input::navigate(ui, &response, session, actions);
    let painter = ui.painter().with_clip_rect(left);
    let [red, green, blue, _] = session.scene.settings.view.background.bytes();
    painter.rect_filled(left, 0.0, Color32::from_rgb(red, green, blue));
    let present = present_picture(session);
    if let Some(picture) = present.or(session.kept.last_picture()) {
        let tint = if present.is_some() { Color32::WHITE } else { Color32::GRAY };
        painter.image(picture.texture(ui.ctx()), left, WHOLE, tint);
    }
    if present.is_some() {
        overlay::paint(&painter, left, session);
    }
    let text = if present.is_some() { text!("kept state") } else { translated(LATER) };
    tag(&painter, left.left_top() + vec2(10.0, 10.0), Align2::LEFT_TOP, text);
    ui.painter().rect_filled(rect.with_min_x(left.right()).with_max_x(right.left()), 0.0, theme::PANEL);
    right
}

/// What is compared, and what came out.
fn distances(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let loaded = &session.loaded;
    let before = &loaded.comparisons.draft;
    let mut draft = before.clone();
    let Some(first) = loaded.compared_first() else {
        ui.label(RichText::new(text!("Open two clouds to measure how far they are apart.")).color(theme::WEAK));
        return;
    };
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Points of"));
        let choice =
            egui::ComboBox::from_id_salt("first cloud").width(180.0).truncate().selected_text(&first.cloud.name);
        let shown = choice.show_ui(ui, |ui| {
            for entry in &loaded.clouds {
                ui.selectable_value(&mut draft.first, Some(entry.key), &entry.cloud.name);
            }
        });
        shown.response.labelled_by(label.id);
    });
    second(ui, session, &mut draft);
    ui.horizontal(|ui| {
        name_label(ui, text!("Measure"));
        let help = text!(
            "To the nearest point, without a sign; or M3C2: along the normal of the first cloud, between the mean \
                    places of both in a cylinder, with the least distance that is a change (95 %)"
        );
        for (is_m3c2, name) in [(false, text!("nearest point")), (true, "M3C2")] {
            let choice = ui.selectable_label(draft.is_m3c2 == is_m3c2, name).on_hover_text(help);
            if choice.clicked() {
                draft.is_m3c2 = is_m3c2;
            }
        }
    });
    if draft.is_m3c2 {
        let Scales { normal, cylinder, reach, registration } = &mut draft.scales;
        length(ui, text!("Normal scale"), normal, text!("Diameter of the neighbourhood that gives a normal"));
        length(ui, text!("Cylinder scale"), cylinder, text!("Diameter of the cylinder along the normal"));
        length(ui, text!("Reach"), reach, text!("How far the cylinder reaches to either side"));
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("Registration"));
            let drag = number_field(registration).speed(0.001).range(0.0..=1e9).max_decimals(4);
            let help = text!(
                "Standard deviation of how far the clouds are off as a whole: 1.96 times as much is added to every \
                        level of detection"
            );
            ui.add(drag).labelled_by(label.id).on_hover_text(help);
        });
    }
    let help = text!(
        "Measures one point only in each cube with edges of this length; the others in the cube get its distance"
    );
    length(ui, text!("Core points"), &mut draft.core, help);
    if first.streamed.is_some() {
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("New file"));
            let help = text!(
                "A streamed cloud does not fit into memory: its points with their distances are written to this file \
                        (.copc.laz opens fastest), which is then opened in its place and coloured by them"
            );
            let hint = "glint-…-distances-1.copc.laz";
            let field = egui::TextEdit::singleline(&mut draft.output).hint_text(hint).desired_width(180.0);
            ui.add(field).labelled_by(label.id).on_hover_text(help);
        });
    }
    if draft != *before {
        actions.push(Action::Compare(Compare::Change(Box::new(draft))));
    }
    match &loaded.comparisons.under_way {
        Some((_, progress)) => {
            ui.horizontal(|ui| {
                progress_bar(ui, progress.done() as f32 / progress.total().max(1) as f32);
                if ui.button(text!("Stop")).clicked() {
                    actions.push(Action::Compare(Compare::Stop));
                }
            });
            ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
        }
        None => {
            if ui.button(text!("Compare")).clicked() {
                actions.push(Action::Compare(Compare::Start));
            }
        }
    }
    if let Some(compared) = &loaded.comparisons.last {
        let second = match loaded.compared_second() {
            Second::Cloud(key) => loaded.cloud(key).map(|entry| entry.units),
            Second::Other | Second::File(_) => None,
        };
        let units = Units::in_common([first.units].into_iter().chain(second));
        let unit = units.length().map_or(String::new(), |unit| format!(" {unit}"));
        result(ui, compared, &unit);
    }
}

fn second(ui: &mut Ui, session: &Session, draft: &mut CompareDraft) {
    let clouds = &session.loaded.clouds;
    let own = session.loaded.compared_first().map(|entry| entry.key);
    let chosen = session.loaded.compared_second();
    let other = match &chosen {
        Second::Other => None,
        Second::Cloud(key) => clouds.iter().find(|entry| entry.key == *key).map(|entry| entry.cloud.name.as_str()),
        Second::File(_) => Some(text!("a file")),
    };
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Distances to"));
        let choice = egui::ComboBox::from_id_salt("second cloud")
            .width(180.0)
            .truncate()
            .selected_text(other.unwrap_or(text!("choose")));
        let shown = choice.show_ui(ui, |ui| {
            for entry in clouds.iter().filter(|entry| Some(entry.key) != own) {
                ui.selectable_value(&mut draft.second, Second::Cloud(entry.key), &entry.cloud.name);
            }
            let is_file = matches!(chosen, Second::File(_));
            if ui.selectable_label(is_file, text!("a file")).clicked() && !is_file {
                draft.second = Second::File(String::new());
            }
        });
        shown.response.labelled_by(label.id);
    });
    if let Second::File(mut path) = chosen {
        ui.horizontal(|ui| {
            let label = name_label(ui, text!("File"));
            let field = egui::TextEdit::singleline(&mut path).hint_text(text!("/folder/scan.laz")).desired_width(180.0);
            if ui.add(field).labelled_by(label.id).changed() {
                draft.second = Second::File(path);
            }
        });
    }
}

/// A length that may be left to the program.
fn length(ui: &mut Ui, name: &str, value: &mut Option<f64>, help: &str) {
    ui.horizontal(|ui| {
        let label = name_label(ui, name);
        let mut is_given = value.is_some();
        let is_changed = ui.checkbox(&mut is_given, "").labelled_by(label.id).on_hover_text(help).changed();
        match value {
            Some(length) => {
                let drag = number_field(length).speed(0.01).range(1e-6..=1e9).max_decimals(4);
                ui.add(drag).labelled_by(label.id).on_hover_text(help);
            }
            None if name == text!("Core points") => {
                drop(ui.label(RichText::new(text!("all points")).color(theme::WEAK)))
            }
            None => drop(ui.label(RichText::new(text!("by the spacing")).color(theme::WEAK))),
        }
        if is_changed {
            *value = is_given.then_some(1.0);
        }
    });
}

fn result(ui: &mut Ui, compared: &Compared, unit: &str) {
    ui.label(RichText::new(&compared.what).small().color(theme::WEAK));
    let DistanceFigures { points, mean, median, std, p95, max, .. } = compared.figures;
    // Three digits of the spread count, also where a small thing is compared in metres.
    let decimals = if std > 0.0 { (2.0 - std.log10().floor()).clamp(4.0, 12.0) as usize } else { 4 };
    let number = |value: f64| format!("{value:.decimals$}{unit}");
    let significant = compared.significant.map(|share| format!("{:.1} %", share * 100.0));
    let lines = [
        (text!("Points"), Some(grouped(points)), text!("Those that have a distance")),
        (
            text!("Mean"),
            Some(number(mean)),
            text!("M3C2 distances have a sign: positive along the normal of the first cloud"),
        ),
        (text!("Median"), Some(number(median)), text!("Half of the distances are below")),
        (text!("Std"), Some(number(std)), text!("The standard deviation about the mean")),
        (text!("95 % within"), Some(number(p95)), text!("95 % of the distances are no longer, whatever their sign")),
        (text!("Longest"), Some(number(max)), text!("The longest distance, whatever its sign")),
        (
            text!("Each ±"),
            compared.interval.map(number),
            text!("The level of detection (95 %) of a distance, the median: a shorter distance may be no change"),
        ),
        (
            text!("Beyond level"),
            significant,
            text!("The share of distances beyond the level of detection (95 %): changes"),
        ),
    ];
    egui::Grid::new("distances").num_columns(2).striped(true).spacing([16.0, 2.0]).show(ui, |ui| {
        for (name, value, help) in lines {
            if let Some(value) = value {
                ui.label(RichText::new(name).size(12.0)).on_hover_text(help);
                ui.label(RichText::new(value).monospace().size(11.5));
                ui.end_row();
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::requests::action::SavePicture;

    #[test]
    fn what_is_compared_and_how_is_chosen_and_the_figures_are_shown() {
        let mut session = Session::with_two_points();
        session.loaded.comparisons.last = Some(Compared {
            what: "a to b, M3C2".into(),
            figures: DistanceFigures { points: 1234, mean: -0.25, median: 0.5, std: 1.0, rms: 1.0, p95: 2.0, max: 3.0 },
            significant: Some(0.375),
            interval: Some(0.125),
        });
        let mut harness = Harness::builder().with_size([340.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        for text in ["1,234", "-0.2500", "37.5 %", "0.1250"] {
            assert!(harness.query_by_label(text).is_some(), "{text}");
        }
        assert!(harness.query_by_label("Reach").is_none());
        harness.get_by_label("M3C2").click();
        harness.run_ok();
        assert!(harness.state().loaded.comparisons.draft.is_m3c2 && harness.query_by_label("Reach").is_some());
        harness.get_by_label("Compare").click();
        harness.run_ok();
        let said = harness.state().outside.messages.all.iter().any(|message| message.text.contains("Choose a second"));
        assert!(said && harness.state().loaded.comparisons.under_way.is_none());
    }

    #[test]
    fn a_state_is_kept_split_shown_beside_swapped_and_let_go_by_its_buttons() {
        let mut harness = Harness::builder().with_size([420.0, 700.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            Session::with_two_points(),
        );
        let click = |harness: &mut Harness<'static, Session>, label: &str| {
            harness.run_ok();
            harness.get_by_label(label).click();
            harness.run_ok();
        };
        let size = |harness: &Harness<'static, Session>| harness.state().scene.settings.splat.size;
        click(&mut harness, "Split");
        assert!(!harness.state().kept.is_split, "nothing is kept yet");
        click(&mut harness, "Keep this state");
        assert!(harness.state().kept.is_there());
        harness.state_mut().scene.settings.splat.size = 3.0;
        click(&mut harness, "Split");
        assert!(harness.state().kept.is_split && harness.state().kept.is_asked_for());
        let says_so = |harness: &Harness<'static, Session>| {
            let mut messages = harness.state().outside.messages.all.iter();
            messages.any(|message| message.text.contains("saved alone"))
        };
        harness.state_mut().act(Action::SavePicture(SavePicture::AtOnce));
        assert!(!says_so(&harness), "there is no picture yet");
        click(&mut harness, "Side by side");
        assert!(harness.state().kept.is_beside());
        click(&mut harness, "Swap");
        assert_eq!(size(&harness), 1.0);
        click(&mut harness, "Swap");
        assert_eq!(size(&harness), 3.0);
        click(&mut harness, "Forget");
        assert!(!harness.state().kept.is_there() && !harness.state().kept.is_asked_for());
    }
}
