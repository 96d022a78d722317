//! Sweeps: one parameter over a range, in the view at hand, judged by the truth. Frames of a sweep are drawn between those of the
//! window, whose parameters stay as they are; what comes of it is a contact sheet and a table in a folder of its own.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::Progress;
use egui::{RichText, Ui};
use render::FrameStats;
use scene::Settings;
use serde_json::json;
use study::Accuracy;

use super::action::Action;
use super::messages::Level;
use super::render_thread::{Captured, Command, FrameRequest};
use super::state::{Effect, State};
use super::sweep_files::{Outcome, Row, SweepResult, make_folder};
use super::sweep_range::{MOST_VALUES, SweepRange};
use super::truth_tasks::{Judge, SceneKey, Task};
use super::truth_view::{MOST_POINTS, too_many_points};
use super::work::Work;
use super::{theme, tuning};

/// A sweep under way.
pub struct Sweep {
    /// The frame on the screen when it began.
    view: FrameRequest,
    /// As text, with the parameters that they give.
    values: Vec<(String, Settings)>,
    /// Of the values before the one at hand.
    result: SweepResult,
    /// Of the value at hand, after a first frame that only makes things ready.
    times: Vec<[f64; 2]>,
    is_warm: bool,
    /// Asked for and not answered.
    is_waiting: bool,
    progress: Arc<Progress>,
}

/// Where sweeps are saved, the best first.
pub fn places() -> Vec<PathBuf> {
    let current = std::path::absolute(".").unwrap_or_default();
    [Some(current), std::env::home_dir(), Some(std::env::temp_dir())].into_iter().flatten().collect()
}

impl Sweep {
    /// The frame that is at hand.
    fn request(&self) -> Option<FrameRequest> {
        let (_, settings) = self.values.get(self.result.rows.len())?;
        Some(FrameRequest { settings: settings.drawn(), ..self.view.clone() })
    }
}

impl State {
    /// Asks for the range of a parameter that is to be swept.
    pub fn ask_sweep(&mut self, key: &str) {
        let range = SweepRange::of(&self.settings, key);
        if range.is_none() {
            self.messages.note(format!("{key} changes nothing in the view at hand: there is nothing to sweep"));
        }
        self.sweep_asked = range;
    }

    /// Begins a sweep of the view at hand, to be saved in the first of some places that can be written.
    pub fn start_sweep(&mut self, key: &str, values: Vec<String>, places: &[PathBuf]) {
        if self.sweep.is_some() {
            self.messages.note("A sweep is under way: end it before another begins");
            return;
        }
        if self.traced_points() > MOST_POINTS {
            self.say(Level::Warning, too_many_points());
            return;
        }
        let Some(view) = self.still_frame().cloned() else {
            self.messages.note("A sweep begins when the view stands still");
            return;
        };
        let with = |text: String| {
            let mut settings = self.settings.clone();
            settings.set_text(key, &text).map(|()| (text, settings)).map_err(|error| error.to_string())
        };
        let values = values.into_iter().map(with).collect::<Result<Vec<_>, _>>();
        let folder =
            || make_folder(places, key).map_err(|error| format!("no folder can be made for the sweep: {error}"));
        match values.and_then(|values| Ok((values, folder()?))) {
            Ok((values, folder)) => {
                self.log(json!({ "event": "sweep", "key": key, "values": values.len() }));
                let result = SweepResult { key: key.into(), size: view.size, rows: Vec::new(), folder };
                let (times, progress) = (Vec::new(), Arc::default());
                self.sweep = Some(Sweep { view, values, result, times, is_warm: false, is_waiting: false, progress });
                self.sweep_asked = None;
            }
            Err(error) => self.say(Level::Error, error),
        }
    }

    /// Ends a sweep, done or not, and has saved what there is of it.
    pub fn stop_sweep(&mut self) {
        let Some(sweep) = self.sweep.take() else { return };
        sweep.progress.cancel();
        if sweep.result.rows.is_empty() {
            // Nothing is in it.
            let _ = std::fs::remove_dir(&sweep.result.folder);
        } else {
            self.effects.push(Effect::Work(Work::SaveSweep(Box::new(sweep.result))));
        }
    }

    /// Takes the sweep one step on; called every frame of the window.
    pub fn sync_sweep(&mut self) {
        let Some(sweep) = &self.sweep else { return };
        if self.traced_points() > MOST_POINTS {
            self.stop_sweep();
            self.say(Level::Warning, too_many_points());
            return;
        }
        if sweep.view.revision != self.frames.revision || self.clouds.is_empty() {
            self.stop_sweep();
            self.say(Level::Warning, "The sweep was ended: the points are others now");
            return;
        }
        if sweep.is_waiting {
            return;
        }
        let Some(request) = sweep.request() else { return self.stop_sweep() };
        let (key, is_timed) = (SceneKey::of(&request), tuning::are_enough(&sweep.times));
        let Some(scene) = self.truth.scene(key) else { return self.build_truth(key) };
        if !self.truth.is_quiet() {
            return;
        }
        let (request, origin) = (Box::new(request), scene.origin);
        self.render(if is_timed { Command::Capture { request, origin } } else { Command::Measure(request) });
        if let Some(sweep) = &mut self.sweep {
            sweep.is_waiting = true;
        }
    }

    /// Takes the times of a frame that the sweep asked for; false if it did not.
    pub fn on_swept_frame(&mut self, request: &FrameRequest, stats: &FrameStats) -> bool {
        let Some(sweep) = self.sweep.as_mut().filter(|sweep| sweep.is_waiting) else { return false };
        if sweep.request().as_ref() != Some(request) {
            return false;
        }
        sweep.is_waiting = false;
        // The first one compiles what the value needs.
        if std::mem::replace(&mut sweep.is_warm, true) {
            sweep.times.push(tuning::times(stats));
        }
        true
    }

    /// Has a frame of the sweep judged; gives back one that is of no sweep.
    pub fn on_swept_images(&mut self, captured: Captured) -> Option<Captured> {
        let sweep = self.sweep.as_ref().filter(|sweep| sweep.is_waiting);
        let request = sweep.and_then(Sweep::request).filter(|request| *request == captured.request);
        let (Some(sweep), Some(request)) = (sweep, request) else { return Some(captured) };
        match self.truth.scene(SceneKey::of(&request)) {
            Some(scene) => {
                let (drawn, progress) = (Arc::new(captured.drawn), sweep.progress.clone());
                let judge = Judge { request, scene, drawn, progress };
                self.effects
                    .push(Effect::Work(Work::Truth(Box::new(Task::JudgeAlone { judge, picture: captured.picture }))));
            }
            // The points have changed, which ends the sweep.
            None => self.stop_sweep(),
        }
        None
    }

    /// What a value of the sweep came to.
    pub fn on_swept(&mut self, request: &FrameRequest, figures: Accuracy, picture: Vec<u8>) {
        let Some(sweep) = self.sweep.as_mut().filter(|sweep| sweep.request().as_ref() == Some(request)) else { return };
        let (Some(times), Some((value, _))) =
            (tuning::medians(&sweep.times), sweep.values.get(sweep.result.rows.len()))
        else {
            return;
        };
        let outcome = Some(Outcome { times, figures, picture });
        sweep.result.rows.push(Row { value: value.clone(), outcome });
        sweep.times.clear();
        (sweep.is_warm, sweep.is_waiting) = (false, false);
    }

    /// The value at hand failed: its row stays empty, and the next has its turn. False if no value is waited for.
    pub fn on_value_failed(&mut self, problem: &str) -> bool {
        let Some(sweep) = self.sweep.as_mut().filter(|sweep| sweep.is_waiting) else { return false };
        let Some((value, _)) = sweep.values.get(sweep.result.rows.len()) else { return false };
        let text = format!("{} = {value} failed: {problem}", sweep.result.key);
        // The others mostly fail in the same way.
        let is_first = sweep.result.rows.iter().all(|row| row.outcome.is_some());
        sweep.result.rows.push(Row { value: value.clone(), outcome: None });
        sweep.times.clear();
        (sweep.is_warm, sweep.is_waiting) = (false, false);
        if is_first {
            self.say(Level::Error, text);
        }
        true
    }

    pub fn on_sweep_saved(&mut self, folder: &Path, result: Result<(), String>) {
        match result {
            Ok(()) => {
                self.log(json!({ "event": "swept", "folder": folder }));
                self.messages.note(format!("Sweep saved: {}", folder.join("sheet.png").display()));
            }
            Err(error) => self.say(Level::Error, error),
        }
    }
}

/// The window that asks for the range.
pub fn show(context: &egui::Context, state: &State, actions: &mut Vec<Action>) {
    let Some(asked) = &state.sweep_asked else { return };
    let (mut range, mut is_open, mut start) = (asked.clone(), true, None);
    egui::Window::new(format!("Sweep {}", range.key))
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

/// The values, once they are to be swept.
fn contents(ui: &mut Ui, range: &mut SweepRange) -> Option<Vec<String>> {
    ui.set_width(340.0);
    ui.label(RichText::new(range.field.help).color(theme::WEAK));
    if range.is_number() {
        egui::Grid::new("range").num_columns(2).show(ui, |ui| {
            let speed = (range.to - range.from).abs().max(1e-3) * 0.01;
            for (name, value) in [("From", &mut range.from), ("To", &mut range.to)] {
                let label = ui.label(name);
                ui.add(egui::DragValue::new(value).speed(speed).max_decimals(4)).labelled_by(label.id);
                ui.end_row();
            }
            let label = ui.label("Values");
            ui.add(egui::DragValue::new(&mut range.count).range(2..=MOST_VALUES)).labelled_by(label.id);
            ui.end_row();
        });
        let help = "Even ratios in place of even steps";
        ui.checkbox(&mut range.is_logarithmic, "Logarithmic").on_hover_text(help);
    }
    let values = range.values();
    let text = match &values {
        Ok(values) => values.join(", "),
        Err(problem) => problem.clone(),
    };
    ui.label(RichText::new(text).small().color(if values.is_ok() { theme::WEAK } else { theme::ERROR }));
    ui.label(RichText::new("Each is drawn, timed and judged in this view; the setting stays as it is.").small());
    let button = ui.add_enabled(values.is_ok(), egui::Button::new("Start"));
    values.ok().filter(|_| button.clicked())
}

/// How far the sweep is, with a way to end it; for the status bar.
pub fn progress(ui: &mut Ui, state: &State, actions: &mut Vec<Action>) {
    let Some(sweep) = &state.sweep else { return };
    ui.spinner();
    let text = format!("sweep of {}: {} of {}", sweep.result.key, sweep.result.rows.len() + 1, sweep.values.len());
    ui.label(RichText::new(text).small().color(theme::WEAK));
    if ui.small_button("End sweep").on_hover_text("What there is of it is saved").clicked() {
        actions.push(Action::EndSweep);
    }
}

#[cfg(test)]
mod tests {
    use super::super::bench::Bench;
    use super::*;

    #[test]
    fn what_changes_nothing_in_the_view_is_not_swept() {
        let mut state = State::with_two_points();
        let mut swept = 0;
        for group in Settings::default().groups() {
            for field in &group.group().fields[..] {
                let key = format!("{}.{}", group.group().name, field.name);
                state.ask_sweep(&key);
                let ask = state.sweep_asked.take();
                assert_eq!(ask.is_some(), field.can_be_swept(), "{key}");
                assert!(ask.iter().all(|ask| ask.values().is_ok()), "{key}");
                swept += usize::from(ask.is_some());
            }
        }
        assert!(swept > 40, "{swept}");
        for key in ["surface.neighbours", "scene.points", "color.ramp", "view.up", "view.background"] {
            state.ask_sweep(key);
            assert!(state.sweep_asked.is_none(), "{key}");
        }
    }

    #[test]
    fn a_folder_that_is_taken_is_left_alone_and_a_place_that_is_missing_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        let places = [folder.path().join("missing"), folder.path().to_path_buf()];
        let made = [(); 2].map(|()| make_folder(&places, "splat.size").unwrap());
        assert!(made[0].ends_with("sweep-splat-size-1") && made[1].ends_with("sweep-splat-size-2"), "{made:?}");
        assert!(made[0].is_absolute() && made[0].starts_with(folder.path()));
        assert!(make_folder(&places[..1], "splat.size").is_err());
    }

    #[test]
    fn a_sweep_writes_a_row_and_a_picture_for_each_value_and_leaves_the_settings_alone() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.state.settings.reflection.method = scene::Method::Sscr;
        bench.settle();
        let before = bench.state.settings.clone();
        let values = ["0", "2"].map(String::from).to_vec();
        let folder = tempfile::tempdir().unwrap();
        let places = [folder.path().to_path_buf()];
        bench.state.start_sweep("sscr.pull_levels", values.clone(), &places);
        bench.state.start_sweep("sscr.pull_levels", values, &places);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a second one waits for the end of the first");
        bench.settle();
        let Bench { state, swept, .. } = bench;
        assert_eq!(state.settings, before);
        let (path, result) = swept.expect("the sweep came to its end").save();
        result.unwrap();
        assert!(path.ends_with("sweep-sscr-pull_levels-1"), "{}", path.display());
        let table = std::fs::read_to_string(path.join("sweep.csv")).unwrap();
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [20; 3], "{table}");
        let column = |name: &str| rows[0].iter().position(|known| *known == name).unwrap();
        let number = |row: usize, name: &str| rows[row][column(name)].parse::<f64>().unwrap();
        assert_eq!([rows[1][1], rows[2][1]], ["0", "2"]);
        assert!(number(2, "closed_coverage") > number(1, "closed_coverage"), "{table}");
        assert!(number(1, "frame_ms") > number(1, "method_ms") && number(1, "same_input_delta_e") > 0.0, "{table}");
        let sheet = image::open(path.join("sheet.png")).unwrap().to_rgb8();
        assert!(sheet.width() > 2 * state.view_size[0] && sheet.height() > state.view_size[1]);
    }

    #[test]
    fn a_value_that_fails_is_an_empty_row_and_points_that_go_end_a_sweep_with_what_there_is() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let folder = tempfile::tempdir().unwrap();
        let values = ["1", "2"].map(String::from).to_vec();
        bench.state.start_sweep("splat.size", values.clone(), &[folder.path().to_path_buf()]);
        assert!(!bench.state.on_value_failed("nothing is waited for yet"));
        if let Some(sweep) = &mut bench.state.sweep {
            sweep.is_waiting = true;
        }
        bench.state.on_not_judged("out of memory");
        let key = bench.state.clouds[0].key;
        bench.state.set_visible(key, false);
        bench.settle();
        assert!(bench.state.sweep.is_none());
        let told = |text: &str| bench.state.messages.all.iter().any(|message| message.text.contains(text));
        assert!(told("sweep was ended") && told("splat.size = 1 failed: out of memory"));
        let swept = bench.swept.take().expect("what there is is saved");
        // Its folder is gone: another takes its place.
        std::fs::remove_dir(&swept.folder).unwrap();
        let (path, result) = swept.save();
        result.unwrap();
        let table = std::fs::read_to_string(path.join("sweep.csv")).unwrap();
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!((rows.len(), rows[1].len(), &rows[1][..3]), (2, 20, &["splat.size", "1", ""][..]), "{table}");
        assert!(image::open(path.join("sheet.png")).is_ok());
        std::fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn stop_ends_a_sweep_whose_scene_is_being_made_and_nothing_begins_anew() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let folder = tempfile::tempdir().unwrap();
        bench.state.start_sweep("splat.size", vec!["1".into(), "2".into()], &[folder.path().to_path_buf()]);
        bench.state.sync_sweep();
        let is_build = |effect: &Effect| matches!(effect, Effect::Work(Work::Truth(_)));
        assert!(bench.state.effects.iter().any(is_build), "its scene is being made");
        bench.state.stop_truth();
        bench.settle();
        assert!(bench.state.sweep.is_none() && bench.swept.is_none());
        assert_eq!(bench.state.truth.bytes(), 0, "a scene that comes after Stop is not kept");
        bench.state.sync_sweep();
        assert!(bench.state.sync_truth().is_none() && !bench.state.effects.iter().any(is_build));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no empty folder is left");
    }

    #[test]
    fn a_sweep_of_too_many_points_is_refused() {
        let mut state = State::with_two_points();
        state.clouds[0].points = MOST_POINTS + 1;
        let folder = tempfile::tempdir().unwrap();
        state.start_sweep("splat.size", vec!["1".into()], &[folder.path().to_path_buf()]);
        assert!(state.sweep.is_none());
        assert!(state.messages.all.iter().any(|message| message.text.contains("30,000,000")));
    }
}
