//! The window that asks for the range of a sweep, and the progress of a sweep.

use egui::{Response, RichText, Ui};
use param::Kind;

use crate::shared::language::text;
use crate::viewer::jobs::sweep_range::{MOST_VALUES, SweepRange};
use crate::viewer::look::theme;
use crate::viewer::look::widgets::number_field;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;

/// Draws the window that asks for the range.
pub fn show(context: &egui::Context, session: &Session, actions: &mut Vec<Action>) {
    let Some(asked) = &session.sweeps.asked else { return };
    let (mut range, mut is_open, mut start) = (asked.clone(), true, None);
    egui::Window::new(text!("Sweep {key}", key = range.key))
        .open(&mut is_open)
        .collapsible(false)
        .resizable(false)
        .anchor(egui::Align2::CENTER_TOP, [0.0, 80.0])
        .show(context, |ui| start = contents(ui, &mut range));
    if range != *asked {
        actions.push(Action::ChangeSweep(Some(Box::new(range.clone()))));
    }
    if let Some(values) = start {
        actions.push(Action::StartSweep { key: range.key, values });
    } else if !is_open {
        actions.push(Action::ChangeSweep(None));
    }
}

/// Draws the content of the window. Returns the values to sweep when the user starts the sweep.
fn contents(ui: &mut Ui, range: &mut SweepRange) -> Option<Vec<String>> {
    ui.set_width(340.0);
    ui.label(RichText::new(range.field.help).color(theme::WEAK));
    if range.is_number() {
        egui::Grid::new("range").num_columns(2).show(ui, |ui| {
            let speed = (range.to - range.from).abs().max(1e-3) * 0.01;
            for (name, value) in [(text!("From"), &mut range.from), (text!("To"), &mut range.to)] {
                let label = ui.label(name);
                end(ui, &range.field.kind, value, speed).labelled_by(label.id);
                ui.end_row();
            }
            let label = ui.label(text!("Values"));
            ui.add(number_field(&mut range.count).range(2..=MOST_VALUES)).labelled_by(label.id);
            ui.end_row();
        });
        let help = text!("Even ratios in place of even steps");
        ui.checkbox(&mut range.is_logarithmic, text!("Logarithmic")).on_hover_text(help);
    }
    let values = range.values();
    let text = match &values {
        Ok(values) => values.join(", "),
        Err(problem) => problem.clone(),
    };
    ui.label(RichText::new(text).small().color(if values.is_ok() { theme::WEAK } else { theme::ERROR }));
    ui.label(RichText::new(text!("Each is drawn, timed and judged in this view; the setting stays as it is.")).small());
    let button = ui.add_enabled(values.is_ok(), egui::Button::new(text!("Start")));
    values.ok().filter(|_| button.clicked())
}

/// Draws the field of an end of the range, which is a whole number where the parameter is.
fn end(ui: &mut Ui, kind: &Kind, value: &mut f64, speed: f64) -> Response {
    if !matches!(kind, Kind::U32 { .. }) {
        return ui.add(number_field(value).speed(speed).max_decimals(4));
    }
    let mut whole = *value as u32;
    let response = ui.add(number_field(&mut whole).speed(speed));
    *value = f64::from(whole);
    response
}

/// Shows the progress of the sweep in the status bar, with a button to end it.
pub fn progress(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(sweep) = &session.sweeps.under_way else { return };
    ui.spinner();
    ui.label(RichText::new(sweep.text()).small().color(theme::WEAK));
    if ui.small_button(text!("End sweep")).on_hover_text(text!("The values that are judged so far are saved")).clicked()
    {
        actions.push(Action::EndSweep);
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn the_ends_of_a_sweep_are_typed_as_the_parameter_is() {
        for (key, text, number) in [("light.photons", "500.000", 500_000.0), ("splat.size", "1.250", 1.25)] {
            let range = SweepRange::of(&scene::Settings::default(), key).unwrap();
            let mut harness = Harness::new_ui_state(|ui, range| drop(contents(ui, range)), range);
            harness.get_by_role_and_label(egui::accesskit::Role::SpinButton, "To").focus();
            harness.run();
            harness.key_press_modifiers(egui::Modifiers::COMMAND, egui::Key::A);
            harness.event(egui::Event::Text(text.into()));
            harness.run();
            harness.key_press(egui::Key::Enter);
            harness.run();
            assert_eq!(harness.state().to, number, "{key}");
        }
    }
}
