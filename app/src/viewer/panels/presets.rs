//! Buttons for settings of screen-space curved reflections that belong together. Each is one step of undo, as any
//! parameter is.

use egui::Ui;
use scene::{Method, Settings, Sscr};

use crate::viewer::action::Action;
use crate::viewer::theme;

struct Preset {
    name: &'static str,
    help: &'static str,
    /// Keys and values. Parameters that are not named get their defaults.
    values: &'static [(&'static str, &'static str)],
}

const PRESETS: [Preset; 3] = [
    Preset { name: "Published", help: "As in the paper (Preiner 2010)", values: &[] },
    Preset {
        name: "Fast",
        help: "Solves each point once, leaves out blocks that are reflected nowhere, and closes more instead",
        values: &[
            ("sscr.solve_once", "true"),
            ("sscr.cull_points", "true"),
            ("sscr.seed_attempts", "2"),
            ("sscr.step_attempts", "2"),
            ("sscr.pull_levels", "4"),
        ],
    },
    Preset {
        name: "Accurate",
        help: "Newton's method from a grid of starts, in several regions a point",
        values: &[
            ("sscr.solve_once", "true"),
            ("sscr.cull_points", "true"),
            ("sscr.solver", "newton"),
            ("sscr.seeds", "grid"),
            ("sscr.seed_attempts", "8"),
            ("sscr.regions_per_point", "4"),
            ("sscr.pull_levels", "1"),
        ],
    },
];

impl Preset {
    /// Returns `settings` with this preset.
    fn applied(&self, settings: &Settings) -> Settings {
        let mut settings = Settings { sscr: Sscr::default(), ..settings.clone() };
        settings.reflection.method = Method::Sscr;
        for (key, value) in self.values {
            // This cannot fail: a test checks the table against the parameters.
            let _ = settings.set_text(key, value);
        }
        settings
    }
}

pub fn show(ui: &mut Ui, settings: &Settings, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.label(egui::RichText::new("SSCR").small().color(theme::WEAK));
        for preset in &PRESETS {
            let applied = preset.applied(settings);
            if ui.selectable_label(applied == *settings, preset.name).on_hover_text(preset.help).clicked() {
                actions.push(Action::ChangeSettings(Box::new(applied)));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use egui_kittest::kittest::Queryable as _;

    use super::*;

    #[test]
    fn every_value_of_a_preset_is_one_of_its_parameter() {
        for preset in &PRESETS {
            for (key, value) in preset.values {
                assert!(key.starts_with("sscr."), "{key}");
                Settings::default().set_text(key, value).unwrap();
            }
        }
    }

    #[test]
    fn a_preset_sets_its_method_and_leaves_everything_else() {
        let mut settings = Settings::default();
        settings.splat.size = 2.0;
        settings.sscr.max_steps = 7;
        let mut harness = egui_kittest::Harness::builder().with_size([360.0, 60.0]).build_ui_state(
            |ui, settings: &mut Settings| {
                let mut actions = Vec::new();
                show(ui, settings, &mut actions);
                for action in actions {
                    let Action::ChangeSettings(changed) = action else { panic!("{action:?}") };
                    *settings = *changed;
                }
            },
            settings,
        );
        harness.run();
        harness.get_by_label("Accurate").click();
        harness.run();
        let settings = harness.state();
        assert_eq!((settings.reflection.method, settings.splat.size), (Method::Sscr, 2.0));
        assert_eq!((settings.sscr.solver, settings.sscr.max_steps), (scene::Solver::Newton, Sscr::default().max_steps));
        harness.get_by_label("Published").click();
        harness.run();
        assert_eq!(harness.state().sscr, Sscr::default());
    }
}
