//! The panel for the points' colours: the mode, the ramp, the histogram with its two handles, and the list of classes.

use std::collections::BTreeMap;

use egui::{Color32, Rect, RichText, Sense, Ui, pos2, vec2};
use param::Value;
use render::{class_color, class_name, ramp_colors};
use scene::{ColorBy, Ramp};

use crate::overlays::legend;
use crate::shared::language::{text, translated};
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{eye, name_label};
use crate::viewer::objects::clouds::CloudEntry;
use crate::viewer::objects::figures::{Figures, share_below};
use crate::viewer::panels::clips::range_button;
use crate::viewer::panels::parameters::parameter;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let color = &session.scene.settings.color;
    parameter(ui, color, "by", actions);
    if color.by == ColorBy::Attribute {
        attribute_choice(ui, session, actions);
    }
    for (name, progress) in session.loaded.columns_under_way() {
        let share = progress.done() as f32 / progress.total().max(1) as f32;
        ui.add(egui::ProgressBar::new(share).text(text!("reading {name}", name)).desired_height(14.0));
        ui.ctx().request_repaint_after(std::time::Duration::from_millis(100));
    }
    // The histogram is of a cloud that has these colours.
    let objects = &session.scene.objects;
    let has_no_own_color = |entry: &CloudEntry| objects.settings_of(entry.key).is_none_or(|own| own.color.is_empty());
    let with_ramp = session
        .loaded
        .clouds
        .iter()
        .filter(|entry| entry.is_visible && has_no_own_color(entry))
        .find_map(|entry| Some((entry, entry.figures.as_ref().filter(|figures| !figures.histogram.is_empty())?)));
    if let Some((entry, figures)) = with_ramp {
        let title = legend::title(&figures.plan, &entry.units);
        let dragged = histogram(ui, figures, &title, color.ramp, color.low, color.high);
        if entry.is_partly_loaded() {
            ui.label(RichText::new(text!("of the loaded points")).small().color(theme::WEAK));
        }
        let [low, high] = range_button(ui, session, entry, actions).unwrap_or(dragged.into());
        for (name, before, share) in [("low", color.low, low), ("high", color.high, high)] {
            actions.extend((share != before).then(|| Action::set("color", name, Value::F32(share))));
        }
        parameter(ui, color, "ramp", actions);
    } else if let Some(figures) = session.loaded.clouds.iter().find_map(|entry| entry.figures.as_ref()) {
        ui.label(RichText::new(text!("shown: {label}", label = figures.plan.label)).small().color(theme::WEAK));
    }
    parameter(ui, color, "plain", actions);
    let mut classes: BTreeMap<u8, u64> = BTreeMap::new();
    for (class, count) in
        session.loaded.clouds.iter().filter_map(|entry| entry.figures.as_ref()).flat_map(|f| &f.classes)
    {
        *classes.entry(*class).or_default() += count;
    }
    // If all points of the files have the same class, the list would say nothing.
    if classes.len() > 1 || !session.scene.objects.visibility.shows_all() {
        ui.separator();
        class_list(ui, session, &classes, actions);
    }
}

fn attribute_choice(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut names: Vec<&str> = Vec::new();
    for attribute in session.loaded.clouds.iter().flat_map(|entry| entry.offered()) {
        if !names.contains(&attribute.name.as_str()) {
            names.push(&attribute.name);
        }
    }
    let mut chosen = session.scene.settings.color.attribute.clone();
    ui.horizontal(|ui| {
        let label = name_label(ui, text!("Attribute"));
        egui::ComboBox::from_id_salt("attribute")
            .width(130.0)
            .selected_text(&chosen)
            .show_ui(ui, |ui| {
                for name in &names {
                    ui.selectable_value(&mut chosen, (*name).to_string(), *name);
                }
                if names.is_empty() {
                    ui.label(text!("no attributes"));
                }
            })
            .response
            .labelled_by(label.id);
    });
    if chosen != session.scene.settings.color.attribute {
        actions.push(Action::set("color", "attribute", Value::Text(chosen)));
    }
}

/// Draws the histogram under a title, in the colours of the ramp. Returns the shares of all points below its two handles.
pub fn histogram(ui: &mut Ui, figures: &Figures, title: &str, ramp: Ramp, low: f32, high: f32) -> (f32, f32) {
    let plan = &figures.plan;
    let (start, end) = figures.histogram_range;
    let place_of =
        |value: f64| if end > start { ((value - start) / (end - start)).clamp(0.0, 1.0) as f32 } else { 0.5 };
    let log = ui.scope_id().with("logarithmic");
    let mut is_logarithmic = ui.data(|data| data.get_temp(log)).unwrap_or(false);
    ui.horizontal(|ui| {
        ui.label(RichText::new(title).small().color(theme::WEAK));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let switch = ui.selectable_label(is_logarithmic, RichText::new(text!("log")).small());
            is_logarithmic ^= switch.on_hover_text(text!("Heights by the logarithm of the counts")).clicked();
        });
    });
    ui.data_mut(|data| data.insert_temp(log, is_logarithmic));
    // Tab leads to the numbers of the range, and the histogram is for the mouse.
    let (outer, response) = ui.allocate_exact_size(vec2(ui.available_width(), 70.0), Sense::CLICK | Sense::DRAG);
    // Leave room for the handles at the ends.
    let rect = outer.shrink2(vec2(6.0, 0.0));
    let (mut low, mut high) = (low, high);
    let (mut low_place, mut high_place) = (place_of(plan.low), place_of(plan.high));
    if response.double_clicked() {
        let default = scene::Color::default();
        return (default.low, default.high);
    }
    // The drag moves the handle that is nearest to where it began.
    let id = response.id.with("handle");
    if let (true, Some(pointer)) = (response.drag_started(), response.interact_pointer_pos()) {
        let at = (pointer.x - rect.left()) / rect.width();
        let is_low = (at - low_place).abs() < (at - high_place).abs() || at <= low_place;
        ui.data_mut(|data| data.insert_temp(id, is_low));
    }
    if let (true, Some(pointer)) = (response.dragged(), response.interact_pointer_pos()) {
        let at = ((pointer.x - rect.left()) / rect.width()).clamp(0.0, 1.0);
        let share = share_at(&figures.histogram, at);
        if ui.data(|data| data.get_temp(id)).unwrap_or(true) {
            (low, low_place) = (share.min(high), at.min(high_place));
        } else {
            (high, high_place) = (share.max(low), at.max(low_place));
        }
    }
    let painter = ui.painter_at(outer);
    painter.rect_filled(outer, 4.0, ui.visuals().extreme_bg_color);
    let colors = ramp_colors(ramp);
    let tallest = figures.histogram.iter().copied().max().unwrap_or(1).max(1) as f32;
    let width = rect.width() / figures.histogram.len() as f32;
    for (index, count) in figures.histogram.iter().enumerate() {
        let place = (index as f32 + 0.5) / figures.histogram.len() as f32;
        let along = ((place - low_place) / (high_place - low_place).max(1e-6)).clamp(0.0, 1.0);
        let [red, green, blue, _] = colors[(along * 255.0) as usize];
        // The height grows with the square root of the count or its logarithm, so that a bin of a hundredth of the
        // tallest can still be seen.
        let share =
            if is_logarithmic { (*count as f32).ln_1p() / tallest.ln_1p() } else { (*count as f32 / tallest).sqrt() };
        let height = share * (rect.height() - 8.0);
        let left = rect.left() + index as f32 * width;
        let bar = Rect::from_min_max(pos2(left, rect.bottom() - height), pos2(left + width, rect.bottom()));
        let is_inside = place >= low_place && place <= high_place;
        let color = Color32::from_rgb(red, green, blue);
        painter.rect_filled(bar, 0.0, if is_inside { color } else { color.gamma_multiply(0.35) });
    }
    for place in [low_place, high_place] {
        let x = rect.left() + place * rect.width();
        painter.vline(x, rect.y_range(), egui::Stroke::new(1.5, Color32::WHITE));
        painter.circle_filled(pos2(x, rect.bottom() - 5.0), 4.5, Color32::WHITE);
    }
    ui.horizontal(|ui| {
        ui.label(RichText::new(figure(plan.low, end - start)).small().monospace());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(RichText::new(figure(plan.high, end - start)).small().monospace());
        });
    });
    response.on_hover_text(text!("Drag the handles to set the ramp's ends; double-click resets them"));
    (low, high)
}

/// The share of all points below a place in the histogram, from 0 to 1. The histogram leaves out the most extreme
/// thousandth of the points at each end; only a handle at the very end includes them.
fn share_at(histogram: &[u32], place: f32) -> f32 {
    match place {
        0.0 => 0.0,
        1.0 => 1.0,
        _ => (0.001 + 0.998 * share_below(histogram, f64::from(place))) as f32,
    }
}

/// Formats a value with as many decimals as its range asks for.
fn figure(value: f64, range: f64) -> String {
    let decimals = if range > 0.0 { (3.0 - range.log10().floor()).clamp(0.0, 6.0) } else { 3.0 };
    format!("{value:.*}", decimals as usize)
}

fn class_list(ui: &mut Ui, session: &Session, classes: &BTreeMap<u8, u64>, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.label(RichText::new(text!("Classes")).strong());
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui.small_button(text!("None")).clicked() {
                actions.push(Action::ShowClasses((0..=255).collect(), false));
            }
            if ui.small_button(text!("All")).clicked() {
                actions.push(Action::ShowClasses((0..=255).collect(), true));
            }
        });
    });
    if session.loaded.clouds.iter().any(CloudEntry::is_partly_loaded) {
        let text = text!("Of the loaded points; classes that only others have are missing.");
        ui.label(RichText::new(text).small().color(theme::WEAK));
    }
    for (class, count) in classes {
        let visible = !session.scene.objects.visibility.hidden_classes.contains(class);
        let name = translated(class_name(*class));
        let name = if name.is_empty() { text!("user-defined or reserved") } else { name };
        ui.horizontal(|ui| {
            if eye(ui, visible, &text!("class {class}", class)).clicked() {
                actions.push(Action::ShowClasses(vec![*class], !visible));
            }
            let [red, green, blue, _] = class_color(*class);
            let (swatch, _) = ui.allocate_exact_size(vec2(10.0, 10.0), Sense::hover());
            ui.painter().rect_filled(swatch, 2.0, Color32::from_rgb(red, green, blue));
            let text = RichText::new(format!("{class} {name}"));
            ui.label(if visible { text } else { text.color(theme::WEAK) });
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                ui.label(RichText::new(grouped(*count)).small().monospace().color(theme::WEAK));
            });
        });
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::kittest::Queryable as _;

    use super::*;
    use crate::viewer::objects::clouds::Streamed;

    #[test]
    fn the_eye_of_a_class_hides_it_and_all_shows_it_again() {
        let classes = BTreeMap::from([(2_u8, 1200_u64), (6, 34)]);
        let mut harness = egui_kittest::Harness::builder().with_size([300.0, 200.0]).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| class_list(ui, session, &classes, actions))
            },
            Session::with_two_points(),
        );
        harness.run();
        assert!(harness.query_by_label("2 ground").is_some());
        let is_told = |harness: &egui_kittest::Harness<'_, Session>| {
            harness.query_by_label_contains("classes that only others have are missing").is_some()
        };
        assert!(!is_told(&harness));
        let entry = &mut harness.state_mut().loaded.clouds[0];
        (entry.streamed, entry.expected_points) = (Some(Streamed::default()), 1234);
        harness.run();
        assert!(is_told(&harness), "1,232 points are not loaded");
        harness.get_by_label("Show class 6").click();
        harness.run();
        let hidden = |harness: &egui_kittest::Harness<'_, Session>| {
            harness.state().scene.objects.visibility.hidden_classes.clone()
        };
        assert_eq!(hidden(&harness), [6].into());
        harness.get_by_label("All").click();
        harness.run();
        assert!(hidden(&harness).is_empty());
    }

    #[test]
    fn the_handles_of_the_histogram_are_dragged_and_reset_and_its_heights_are_by_root_or_logarithm() {
        // Heights from 0 to 999, and many points in the lowest bin.
        let height = |index: usize| index.saturating_sub(1000) as f32;
        let mut session = Session::with_points((0..2000).map(|index| [0.0, 0.0, height(index)]).collect());
        let color = &mut session.scene.settings.color;
        (color.by, color.low, color.high) = (ColorBy::Height, 0.0, 1.0);
        let (color, test, up) = (color.clone(), session.scene.objects.test(), session.up());
        let entry = &mut session.loaded.clouds[0];
        entry.figures = Some(Figures::of(&entry.cloud, &color, &test, up));
        let mut harness = egui_kittest::Harness::builder().with_size([380.0, 300.0]).with_step_dt(0.02).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        let ends = |harness: &egui_kittest::Harness<'_, Session>| {
            let color = &harness.state().scene.settings.color;
            [color.low, color.high]
        };
        // The histogram is as wide as the panel, below the word that switches its heights.
        let below = harness.get_by_label("log").rect().bottom() + 40.0;
        let at = |share: f32| pos2(16.0 + share * (380.0 - 32.0), below);
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        let press = |harness: &mut egui_kittest::Harness<'_, Session>, pos, pressed| {
            harness.event(egui::Event::PointerButton { pos, button, pressed, modifiers });
            harness.run_steps(1);
        };
        for (from, to) in [(0.02, 0.3), (0.98, 0.8)] {
            harness.hover_at(at(from));
            harness.run_steps(1);
            press(&mut harness, at(from), true);
            for step in 1..=4 {
                harness.hover_at(at(from + (to - from) * step as f32 * 0.25));
                harness.run_steps(1);
            }
            press(&mut harness, at(to), false);
        }
        // Half of the points are in the lowest bin.
        let expected = [0.5 + 0.5 * 0.3, 0.5 + 0.5 * 0.8];
        let found = ends(&harness);
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 0.02), "{found:?}");
        let bar_heights = |harness: &egui_kittest::Harness<'_, Session>| -> Vec<f32> {
            let bars = harness.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
                egui::Shape::Rect(bar) if bar.rect.width() < 4.0 && bar.rect.height() > 0.0 => Some(bar.rect.height()),
                _ => None,
            });
            bars.collect()
        };
        let relative = |heights: Vec<f32>| heights[40] / heights.iter().copied().fold(0.0, f32::max);
        let by_root = relative(bar_heights(&harness));
        harness.get_by_label("log").click();
        harness.run_steps(3);
        let by_logarithm = relative(bar_heights(&harness));
        let counts = &harness.state().loaded.clouds[0].figures.as_ref().unwrap().histogram;
        let (count, most) = (counts[40] as f32, counts[0] as f32);
        assert!((by_root - (count / most).sqrt()).abs() < 0.01, "{by_root}");
        assert!((by_logarithm - count.ln_1p() / most.ln_1p()).abs() < 0.01, "{by_logarithm}");
        // Long enough for the clicks from here on to be a double-click, and no longer one.
        harness.run_steps(20);
        harness.hover_at(at(0.5));
        for pressed in [true, false, true, false] {
            press(&mut harness, at(0.5), pressed);
        }
        let usual = scene::Color::default();
        assert_eq!(ends(&harness), [usual.low, usual.high]);
        let says =
            |harness: &egui_kittest::Harness<'_, Session>| harness.query_by_label("of the loaded points").is_some();
        assert!(!says(&harness));
        let entry = &mut harness.state_mut().loaded.clouds[0];
        (entry.streamed, entry.expected_points) = (Some(Streamed::default()), 12_340);
        harness.run_steps(2);
        assert!(says(&harness));
    }

    #[test]
    fn handles_at_the_ends_leave_no_point_out() {
        assert_eq!(share_at(&[1, 2, 3], 0.0), 0.0);
        assert_eq!(share_at(&[1, 2, 3], 1.0), 1.0);
        assert!((share_at(&[1, 1], 0.5) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn values_have_digits_for_their_range() {
        assert_eq!(figure(635_619.123_4, 0.02), "635619.12340");
        assert_eq!(figure(1234.56, 5000.0), "1235");
    }
}
