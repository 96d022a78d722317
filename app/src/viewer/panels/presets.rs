//! Buttons for the presets of screen-space curved reflections. Each is one step of undo, as any parameter is.

use egui::Ui;
use scene::{Mirror, PRESETS, Settings};

use crate::shared::language::{text, translated};
use crate::viewer::look::theme;
use crate::viewer::requests::action::Action;

pub fn show<'a>(
    ui: &mut Ui,
    settings: &Settings,
    mirrors: impl Iterator<Item = &'a Mirror> + Clone,
    actions: &mut Vec<Action>,
) {
    ui.horizontal(|ui| {
        ui.label(egui::RichText::new(text!("Presets of sscr")).small().color(theme::WEAK));
        for preset in &PRESETS {
            let applied = preset.applied(settings, mirrors.clone());
            if ui
                .selectable_label(applied == *settings, translated(preset.name))
                .on_hover_text(translated(preset.help))
                .clicked()
            {
                actions.push(Action::ChangeSettings(Box::new(applied)));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::kittest::Queryable as _;
    use scene::Method;
    use scene::five_mirrors::Variant;

    use super::*;

    #[test]
    fn a_click_takes_the_presets_values_for_the_mirrors_that_are_there() {
        let mirrors = Variant::Torus.mirrors();
        let mut harness = egui_kittest::Harness::builder().with_size([360.0, 60.0]).build_ui_state(
            |ui, settings: &mut Settings| {
                let mut actions = Vec::new();
                show(ui, settings, mirrors.iter(), &mut actions);
                for action in actions {
                    let Action::ChangeSettings(changed) = action else { panic!("{action:?}") };
                    *settings = *changed;
                }
            },
            Settings::default(),
        );
        harness.run();
        harness.get_by_label("Accurate").click();
        harness.run();
        assert_eq!(
            (harness.state().reflection.method, harness.state().sscr.solver),
            (Method::Sscr, scene::Solver::Newton)
        );
        harness.get_by_label("Published").click();
        harness.run();
        let sscr = &harness.state().sscr;
        assert_eq!((sscr.solver, sscr.threshold, sscr.pull_levels), (scene::Solver::Interleaved, 3.0, 3));
    }
}
