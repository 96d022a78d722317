//! Sweeps: the truth judges the current view over a range of one parameter. The frames of a sweep are drawn between
//! those of the window, whose parameters stay unchanged. The result is a contact sheet and a table in a new folder.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use cloud::Progress;
use render::FrameStats;
use scene::Settings;
use serde_json::json;

use crate::shared::language::text;
use crate::viewer::jobs::sweep_files::{Outcome, Row, SweepResult, make_folder};
use crate::viewer::jobs::sweep_range::SweepRange;
use crate::viewer::jobs::tasks::{Judge, SceneKey, Task};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Captured, Command};
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::work::Work;
use crate::viewer::scene::idle;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::{MOST_POINTS, Swept, TruthView, too_many_points};
use crate::viewer::truth::{Around, tuning};

/// A sweep under way.
pub struct Sweep {
    /// The frame on the screen when the sweep began.
    view: FrameRequest,
    /// The values as text, each with its settings.
    values: Vec<(String, Settings)>,
    /// The results of the values before the current one.
    result: SweepResult,
    /// Frame times of the current value; a first frame only compiles what the value needs and does not count.
    times: Vec<[f64; 2]>,
    is_warm: bool,
    /// True while a request waits for its answer.
    is_waiting: bool,
    progress: Arc<Progress>,
}

/// The folders in which sweeps may be saved, the best first.
pub fn places() -> Vec<PathBuf> {
    let current = std::path::absolute(".").unwrap_or_default();
    [Some(current), std::env::home_dir(), Some(std::env::temp_dir())].into_iter().flatten().collect()
}

impl Sweep {
    /// The progress as text.
    pub fn text(&self) -> String {
        let (number, count) = (self.result.rows.len() + 1, self.values.len());
        text!("sweep of {key}: {number} of {count}", key = self.result.key, number, count)
    }

    /// The frame for the current value.
    fn request(&self) -> Option<FrameRequest> {
        let (_, settings) = self.values.get(self.result.rows.len())?;
        Some(FrameRequest { settings: idle::drawn(settings), ..self.view.clone() })
    }
}

/// The sweep that is being set up, and the sweep under way.
#[derive(Default)]
pub struct Sweeps {
    pub asked: Option<SweepRange>,
    pub under_way: Option<Sweep>,
}

impl Sweeps {
    /// Asks the user for the range in which to sweep a parameter.
    pub fn ask(&mut self, key: &str, settings: &Settings, outside: &mut Outside) {
        self.asked = SweepRange::of(settings, key);
        if self.asked.is_none() {
            outside.note(text!("{key} changes nothing in the view at hand: there is nothing to sweep", key));
        }
    }

    /// Begins a sweep of the current view, which is saved in the first of `places` that can be written.
    pub fn start(
        &mut self,
        key: &str,
        values: Vec<String>,
        places: &[PathBuf],
        around: &Around<'_>,
        outside: &mut Outside,
    ) {
        if self.under_way.is_some() {
            outside.note(text!("A sweep is under way: end it before another begins"));
            return;
        }
        if around.points() > MOST_POINTS {
            outside.say(Level::Warning, too_many_points());
            return;
        }
        let Some(view) = around.still.clone() else {
            outside.note(text!("A sweep begins when the view stands still"));
            return;
        };
        let with = |text: String| {
            let mut settings = around.settings.clone();
            settings.set_text(key, &text).map(|()| (text, settings)).map_err(|error| error.to_string())
        };
        let values = values.into_iter().map(with).collect::<Result<Vec<_>, _>>();
        let folder =
            || make_folder(places, key).map_err(|error| format!("no folder can be made for the sweep: {error}"));
        match values.and_then(|values| Ok((values, folder()?))) {
            Ok((values, folder)) => {
                outside.log(json!({ "event": "sweep", "key": key, "values": values.len() }));
                let result = SweepResult { key: key.into(), size: view.size, rows: Vec::new(), folder };
                let (times, progress) = (Vec::new(), Arc::default());
                let sweep = Sweep { view, values, result, times, is_warm: false, is_waiting: false, progress };
                (self.under_way, self.asked) = (Some(sweep), None);
            }
            Err(error) => outside.say(Level::Error, error),
        }
    }

    /// Ends a sweep, complete or not, and has its results saved.
    pub fn stop(&mut self, outside: &mut Outside) {
        let Some(sweep) = self.under_way.take() else { return };
        sweep.progress.cancel();
        if sweep.result.rows.is_empty() {
            // The folder is empty.
            let _ = std::fs::remove_dir(&sweep.result.folder);
        } else {
            outside.work(Work::SaveSweep(Box::new(sweep.result)));
        }
    }

    /// Advances the sweep by one step. Called every frame of the window.
    pub fn sync(&mut self, around: &Around<'_>, truth: &mut TruthView, outside: &mut Outside) {
        let Some(sweep) = &mut self.under_way else { return };
        if around.points() > MOST_POINTS {
            self.stop(outside);
            outside.say(Level::Warning, too_many_points());
            return;
        }
        if sweep.view.revision != around.frames.revision || around.clouds.is_empty() {
            self.stop(outside);
            outside.say(Level::Warning, text!("The sweep was ended: the points are others now"));
            return;
        }
        if sweep.is_waiting {
            return;
        }
        let Some(request) = sweep.request() else { return self.stop(outside) };
        let (key, is_timed) = (SceneKey::of(&request), tuning::are_enough(&sweep.times));
        let Some(scene) = truth.scene(key) else { return truth.build(key, || around.sources(), outside) };
        if truth.is_quiet() {
            let (request, origin) = (Box::new(request), scene.origin);
            outside.render(if is_timed { Command::Capture { request, origin } } else { Command::Measure(request) });
            sweep.is_waiting = true;
        }
    }

    /// Takes the times of a frame that the sweep asked for; returns false if the sweep did not ask for it.
    pub fn on_frame(&mut self, request: &FrameRequest, stats: &FrameStats) -> bool {
        let Some(sweep) = self.under_way.as_mut().filter(|sweep| sweep.is_waiting) else { return false };
        if sweep.request().as_ref() != Some(request) {
            return false;
        }
        sweep.is_waiting = false;
        // The first frame compiles what the value needs.
        if std::mem::replace(&mut sweep.is_warm, true) {
            sweep.times.push(tuning::times(stats));
        }
        true
    }

    /// Has a frame of the sweep judged; returns a frame that does not belong to a sweep.
    pub fn on_images(&mut self, captured: Captured, truth: &TruthView, outside: &mut Outside) -> Option<Captured> {
        let sweep = self.under_way.as_ref().filter(|sweep| sweep.is_waiting);
        let request = sweep.and_then(Sweep::request).filter(|request| *request == captured.request);
        let (Some(sweep), Some(request)) = (sweep, request) else { return Some(captured) };
        match truth.scene(SceneKey::of(&request)) {
            Some(scene) => {
                let (drawn, progress) = (Arc::new(captured.drawn), sweep.progress.clone());
                let judge = Judge { request, scene, drawn, progress };
                outside.work(Work::Truth(Box::new(Task::JudgeAlone { judge, picture: captured.picture })));
            }
            // The points have changed, which ends the sweep.
            None => self.stop(outside),
        }
        None
    }

    /// Takes in the figures and the picture of a value, which is a setting that was tried.
    pub fn on_judged(&mut self, swept: Swept, tuning: &mut Tuning) {
        let Swept { request, figures, picture } = swept;
        let of_request = |sweep: &&mut Sweep| sweep.request().as_ref() == Some(&*request);
        let Some(sweep) = self.under_way.as_mut().filter(of_request) else { return };
        let (Some(times), Some((value, settings))) =
            (tuning::medians(&sweep.times), sweep.values.get(sweep.result.rows.len()))
        else {
            return;
        };
        let figures = *figures;
        tuning.add(&request, settings, sweep.times.clone(), figures.clone());
        let outcome = Some(Outcome { times, figures, picture });
        sweep.result.rows.push(Row { value: value.clone(), outcome });
        sweep.times.clear();
        (sweep.is_warm, sweep.is_waiting) = (false, false);
    }

    /// Handles a failure of the current value: its row stays empty, and the next value follows. Returns false if the
    /// sweep waits for no value.
    pub fn on_failed(&mut self, problem: &str, outside: &mut Outside) -> bool {
        let Some(sweep) = self.under_way.as_mut().filter(|sweep| sweep.is_waiting) else { return false };
        let Some((value, _)) = sweep.values.get(sweep.result.rows.len()) else { return false };
        let text = format!("{} = {value} failed: {problem}", sweep.result.key);
        // The other values mostly fail in the same way.
        let is_first = sweep.result.rows.iter().all(|row| row.outcome.is_some());
        sweep.result.rows.push(Row { value: value.clone(), outcome: None });
        sweep.times.clear();
        (sweep.is_warm, sweep.is_waiting) = (false, false);
        if is_first {
            outside.say(Level::Error, text);
        }
        true
    }
}

/// Reports that a sweep was written, or why it was not.
pub fn on_saved(folder: &Path, result: Result<(), String>, outside: &mut Outside) {
    match result {
        Ok(()) => {
            outside.log(json!({ "event": "swept", "folder": folder }));
            outside.note(text!("Sweep saved: {folder}", folder = folder.join("sheet.png").display()));
        }
        Err(error) => outside.say(Level::Error, error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::picture::messages::Report;
    use crate::viewer::requests::action::Action;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::session::Session;

    #[test]
    fn what_changes_nothing_in_the_view_is_not_swept() {
        let mut session = Session::with_two_points();
        let mut swept = 0;
        for group in Settings::default().groups() {
            for field in &group.group().fields[..] {
                let key = format!("{}.{}", group.group().name, field.name);
                session.act(Action::AskSweep(key.clone()));
                let ask = session.sweeps.asked.take();
                assert_eq!(ask.is_some(), field.can_be_swept(), "{key}");
                assert!(ask.iter().all(|ask| ask.values().is_ok()), "{key}");
                swept += usize::from(ask.is_some());
            }
        }
        assert!(swept > 40, "{swept}");
        for key in ["surface.neighbours", "scene.points", "color.ramp", "view.up", "view.background"] {
            session.act(Action::AskSweep(key.to_owned()));
            assert!(session.sweeps.asked.is_none(), "{key}");
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
        bench.session.scene.settings.reflection.method = scene::Method::Sscr;
        bench.settle();
        let before = bench.session.scene.settings.clone();
        let values = ["0", "2"].map(String::from).to_vec();
        let folder = tempfile::tempdir().unwrap();
        let places = [folder.path().to_path_buf()];
        bench.session.start_sweep("sscr.pull_levels", values.clone(), &places);
        bench.session.start_sweep("sscr.pull_levels", values, &places);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a second one waits for the end of the first");
        bench.settle();
        let Bench { session, swept, .. } = bench;
        assert_eq!(session.scene.settings, before);
        let (path, result) = swept.expect("the sweep came to its end").save();
        result.unwrap();
        assert!(path.ends_with("sweep-sscr-pull_levels-1"), "{}", path.display());
        let table = std::fs::read_to_string(path.join("sweep.csv")).unwrap();
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(rows.iter().map(Vec::len).collect::<Vec<_>>(), [25; 3], "{table}");
        let column = |name: &str| rows[0].iter().position(|known| *known == name).unwrap();
        let number = |row: usize, name: &str| rows[row][column(name)].parse::<f64>().unwrap();
        assert_eq!([rows[1][1], rows[2][1]], ["0", "2"]);
        assert!(number(2, "closed_coverage") > number(1, "closed_coverage"), "{table}");
        assert!(number(1, "frame_ms") > number(1, "method_ms") && number(1, "same_input_delta_e") > 0.0, "{table}");
        let sheet = image::open(path.join("sheet.png")).unwrap().to_rgb8();
        assert!(sheet.width() > 2 * session.scene.view_size[0] && sheet.height() > session.scene.view_size[1]);
    }

    #[test]
    fn a_value_that_fails_is_an_empty_row_and_points_that_go_end_a_sweep_with_what_there_is() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let folder = tempfile::tempdir().unwrap();
        let values = ["1", "2"].map(String::from).to_vec();
        bench.session.start_sweep("splat.size", values.clone(), &[folder.path().to_path_buf()]);
        let Session { sweeps, outside, .. } = &mut bench.session;
        assert!(!sweeps.on_failed("nothing is waited for yet", outside));
        if let Some(sweep) = &mut bench.session.sweeps.under_way {
            sweep.is_waiting = true;
        }
        bench.session.on_report(Report::NotJudged("out of memory".into()));
        let key = bench.session.loaded.clouds[0].key;
        bench.session.with_loaded(|loaded, beside| loaded.set_visible(key, false, beside));
        bench.settle();
        assert!(bench.session.sweeps.under_way.is_none());
        let told = |text: &str| bench.session.outside.messages.all.iter().any(|message| message.text.contains(text));
        assert!(told("sweep was ended") && told("splat.size = 1 failed: out of memory"));
        let swept = bench.swept.take().expect("what there is is saved");
        // The sweep's folder is gone, so another is used.
        std::fs::remove_dir(&swept.folder).unwrap();
        let (path, result) = swept.save();
        result.unwrap();
        let table = std::fs::read_to_string(path.join("sweep.csv")).unwrap();
        let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!((rows.len(), rows[1].len(), &rows[1][..3]), (2, 25, &["splat.size", "1", ""][..]), "{table}");
        assert!(image::open(path.join("sheet.png")).is_ok());
        std::fs::remove_dir_all(path).unwrap();
    }

    #[test]
    fn stop_ends_a_sweep_whose_scene_is_being_made_and_nothing_begins_anew() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let folder = tempfile::tempdir().unwrap();
        bench.session.start_sweep("splat.size", vec!["1".into(), "2".into()], &[folder.path().to_path_buf()]);
        bench.session.sync_truth();
        let is_build = |effect: &Effect| matches!(effect, Effect::Work(Work::Truth(_)));
        assert!(bench.session.outside.effects.iter().any(is_build), "its scene is being made");
        bench.session.stop_truth();
        bench.settle();
        assert!(bench.session.sweeps.under_way.is_none() && bench.swept.is_none());
        assert_eq!(bench.session.truth.bytes(), 0, "a scene that comes after Stop is not kept");
        assert!(bench.session.sync_truth().is_none() && !bench.session.outside.effects.iter().any(is_build));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no empty folder is left");
    }

    #[test]
    fn a_sweep_of_too_many_points_is_refused() {
        let mut session = Session::with_two_points();
        session.loaded.clouds[0].points = MOST_POINTS + 1;
        let folder = tempfile::tempdir().unwrap();
        session.start_sweep("splat.size", vec!["1".into()], &[folder.path().to_path_buf()]);
        assert!(session.sweeps.under_way.is_none());
        assert!(session.outside.messages.all.iter().any(|message| message.text.contains("30,000,000")));
    }
}
