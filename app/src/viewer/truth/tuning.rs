//! The settings that were tried in this session and stood still, each with its times and its accuracy.

use std::path::Path;

use render::{FrameStats, PassStage, PassTime};
use scene::Settings;
use serde_json::json;
use study::Accuracy;
use study::results::Spread;

use crate::shared::language::text;
use crate::viewer::look::tab::Tab;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::Command;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::preferences::Preferences;

/// A time is the median of this many frames that are drawn from scratch.
const FRAMES: usize = 3;
/// After this many milliseconds of frames, the measurements so far are enough: the times of longer frames vary less.
const ENOUGH: f64 = 3000.0;
/// The most settings that are kept: more dots in the chart cannot be told apart.
const MOST_TRIALS: usize = 400;
/// The least share of the mirror pixels that a setting must fill. A setting that leaves more pixels empty is judged
/// only by the easy ones.
const LEAST_FILLED: f64 = 0.9;
/// A setting that was tried.
pub struct Trial {
    pub request: FrameRequest,
    /// Equal for all trials that can be compared with each other.
    pub series: FrameRequest,
    /// The settings in the panel: a click restores them.
    pub settings: Settings,
    /// For each measurement, the milliseconds of the whole frame and of the method.
    pub times: Vec<[f64; 2]>,
    pub figures: Option<Accuracy>,
}

#[derive(Default)]
pub struct Tuning {
    pub is_open: bool,
    pub trials: Vec<Trial>,
    measuring: Option<FrameRequest>,
}

impl Tuning {
    /// Shows the chart in its tab, or closes it where it is in view. `search` hides the tab while it has words.
    pub fn toggle(&mut self, preferences: &mut Preferences, interface_is_hidden: &mut bool, search: &mut String) {
        let has_tab = preferences.panel_is_open && Tab::named(&preferences.tab) == Tab::Tuning;
        let is_in_view = has_tab && !*interface_is_hidden && search.trim().is_empty();
        self.is_open = !(self.is_open && is_in_view);
        if self.is_open {
            (preferences.panel_is_open, *interface_is_hidden) = (true, false);
            preferences.tab = Tab::Tuning.name().to_owned();
            search.clear();
        }
    }
}

/// The milliseconds of a frame and of the passes that find the points that mirrors show.
pub fn times(stats: &FrameStats) -> [f64; 2] {
    [stats.frame_milliseconds, PassTime::of_stage(&stats.passes, PassStage::Method)]
}

/// The median of the frame times and of the method times.
pub fn medians(times: &[[f64; 2]]) -> Option<[f64; 2]> {
    let median = |which: usize| Some(Spread::of(times.iter().map(|times| times[which]).collect())?.median);
    Some([median(0)?, median(1)?])
}

/// Whether these measurements of frames are enough.
pub fn are_enough(times: &[[f64; 2]]) -> bool {
    times.len() >= FRAMES || times.iter().map(|[frame, _]| frame).sum::<f64>() > ENOUGH
}

/// The request reduced to what is equal for all trials that compare with one truth. The parameters of splats and of
/// shadow map lookups are left out: users choose them for their speed, as they choose methods, although the truth is
/// traced from the surface that depends on them.
pub fn series(request: &FrameRequest) -> FrameRequest {
    let mut basis = request.truth_basis();
    let (splat, light) = (scene::Splat::default(), scene::Light::default());
    (basis.settings.splat, basis.settings.light.shadow_bias) = (splat, light.shadow_bias);
    basis
}

impl Trial {
    pub fn time(&self, by_frame: bool) -> Option<f64> {
        medians(&self.times).map(|[frame, method]| if by_frame { frame } else { method })
    }

    /// Whether the setting fills too little to compare its errors with those of others.
    pub fn is_sparse(&self) -> bool {
        self.figures.as_ref().is_some_and(|figures| figures.closed_coverage < LEAST_FILLED)
    }

    /// The setting as text: the parameters that differ from their defaults, those of reflections first.
    pub fn text(&self) -> String {
        let mut differing = self.settings.differing();
        let section = scene::Reflection::table().section;
        let groups = self.settings.groups().into_iter().map(|params| params.group());
        let tuned: Vec<&str> = groups.filter(|group| group.section == section).map(|group| group.name).collect();
        differing.sort_by_key(|(key, _)| !tuned.iter().any(|name| key.split('.').next() == Some(name)));
        let lines: Vec<String> = differing.into_iter().map(|(key, text)| format!("{key} = {text}")).collect();
        if lines.is_empty() { "all parameters as by default".into() } else { lines.join("\n") }
    }
}

impl Tuning {
    /// The median milliseconds of a frame and of its method.
    pub fn times(&self, request: &FrameRequest) -> Option<[f64; 2]> {
        medians(&self.trials.iter().find(|trial| trial.request == *request)?.times)
    }

    fn trial(&mut self, request: &FrameRequest, settings: &Settings) -> &mut Trial {
        let known = self.trials.iter().position(|trial| trial.request == *request);
        let index = known.unwrap_or_else(|| {
            let series = series(request);
            if self.trials.len() >= MOST_TRIALS {
                // Removes the oldest trial, preferably one of another view.
                let other = self.trials.iter().position(|trial| trial.series != series);
                self.trials.remove(other.unwrap_or(0));
            }
            let (request, settings) = (request.clone(), settings.clone());
            self.trials.push(Trial { request, series, settings, times: Vec::new(), figures: None });
            self.trials.len() - 1
        });
        &mut self.trials[index]
    }

    /// Adds a setting that was measured elsewhere.
    pub fn add(&mut self, request: &FrameRequest, settings: &Settings, times: Vec<[f64; 2]>, figures: Accuracy) {
        let trial = self.trial(request, settings);
        (trial.times, trial.figures) = (times, Some(figures));
    }

    /// The timed settings of a view, the newest first; pictures of another size are of the same view.
    pub fn of_view(&self, request: &FrameRequest) -> impl Iterator<Item = &Trial> {
        let view = series(request);
        let is_of_view = move |trial: &&Trial| FrameRequest { size: trial.series.size, ..view.clone() } == trial.series;
        self.trials.iter().rev().filter(|trial| !trial.times.is_empty()).filter(is_of_view)
    }

    /// Notes the accuracy of a frame.
    pub fn note(&mut self, request: &FrameRequest, settings: &Settings, figures: &Accuracy) {
        self.trial(request, settings).figures = Some(figures.clone());
    }

    /// Has the times of a still frame measured. `is_quiet` says that no other work would disturb the measurement.
    /// Returns whether measurements are still missing.
    pub fn measure(
        &mut self,
        request: &FrameRequest,
        settings: &Settings,
        is_quiet: impl FnOnce() -> bool,
        outside: &mut Outside,
    ) -> bool {
        if are_enough(&self.trial(request, settings).times) {
            return false;
        }
        if is_quiet() && self.measuring.is_none() {
            self.measuring = Some(request.clone());
            outside.render(Command::Measure(Box::new(request.clone())));
        }
        true
    }

    /// Takes in the times of a frame that was drawn for them.
    pub fn on_measured(&mut self, request: &FrameRequest, stats: &FrameStats) {
        self.measuring = None;
        if let Some(trial) = self.trials.iter_mut().find(|trial| trial.request == *request) {
            trial.times.push(times(stats));
        }
    }

    /// Removes all trials.
    pub fn forget_trials(&mut self) {
        self.trials.clear();
    }

    /// Stops waiting for a measurement that failed, or that was requested by something else.
    pub fn forget_measuring(&mut self) {
        self.measuring = None;
    }
}

/// Reports that a setting was added to a plan, or why it was not.
pub fn on_added_to_study(path: &Path, result: Result<(), String>, outside: &mut Outside) {
    match result {
        Ok(()) => {
            outside.log(json!({ "event": "added_to_study", "path": path }));
            outside.note(text!("Added to the study: {path}", path = path.display()));
        }
        Err(error) => outside.say(Level::Error, error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::jobs::study_file::{STUDY, add_to_study, group_of};
    use crate::viewer::session::Session;

    #[test]
    fn settings_are_held_against_each_other_where_the_truth_is_the_same() {
        let request = FrameRequest::any();
        let with = |change: fn(&mut Settings)| {
            let mut request = request.clone();
            change(&mut request.settings);
            series(&request)
        };
        let same: [fn(&mut Settings); 3] = [
            |settings| settings.reflection.method = scene::Method::Sscr,
            |settings| settings.splat.size = 2.0,
            |settings| settings.light.shadow_bias = 1.0,
        ];
        let others: [fn(&mut Settings); 5] = [
            |settings| settings.view.field_of_view = 20.0,
            |settings| settings.light.by = scene::Lighting::Sun,
            |settings| settings.gi.bounces = 0,
            |settings| settings.reflection.bounces = 2,
            |settings| settings.trace.samples = 1,
        ];
        assert!(same.into_iter().all(|change| with(change) == series(&request)));
        assert!(others.into_iter().all(|change| with(change) != series(&request)));
    }

    #[test]
    fn the_text_of_a_setting_begins_with_what_is_tuned() {
        let mut settings = Settings::default();
        (settings.view.field_of_view, settings.splat.size) = (20.0, 2.0);
        (settings.reflection.bounces, settings.sscr.seed_attempts) = (2, 8);
        let request = FrameRequest::any();
        let trial = Trial { series: series(&request), request, settings, times: Vec::new(), figures: None };
        let text = trial.text();
        let keys: Vec<&str> = text.lines().filter_map(|line| line.split(" = ").next()).collect();
        assert_eq!(keys, ["reflection.bounces", "sscr.seed_attempts", "view.field_of_view", "splat.size"]);
    }

    #[test]
    fn the_oldest_of_other_views_goes_first() {
        let (mut tuning, settings) = (Tuning::default(), Settings::default());
        let request = FrameRequest::any();
        let other = FrameRequest { size: [1, 1], ..request.clone() };
        let mut tried = |index: usize| {
            let mut request = if index == 1 { other.clone() } else { request.clone() };
            request.settings.tone.exposure = index as f32 * 0.01;
            tuning.trial(&request, &settings);
            let is_kept = |trial: &&Trial| trial.series == series(&other);
            (tuning.trials.len(), tuning.trials.iter().filter(is_kept).count())
        };
        assert_eq!((0..MOST_TRIALS).map(&mut tried).last(), Some((MOST_TRIALS, 1)));
        assert_eq!(tried(MOST_TRIALS), (MOST_TRIALS, 0));
        tried(MOST_TRIALS + 1);
        assert_eq!(tuning.trials[0].request.settings.tone.exposure, 0.02, "then the oldest of its own");
    }

    #[test]
    fn times_are_medians_and_long_frames_need_no_third() {
        assert_eq!(medians(&[[9.0, 1.0], [5.0, 3.0], [7.0, 2.0]]), Some([7.0, 2.0]));
        assert_eq!(medians(&[]), None);
        assert!(!are_enough(&[[5.0, 1.0]; 2]) && are_enough(&[[5.0, 1.0]; 3]) && are_enough(&[[4000.0, 1.0]]));
    }

    #[test]
    fn settings_added_to_a_plan_stand_behind_those_that_are_there() {
        let folder = tempfile::tempdir().unwrap();
        let plan = folder.path().join(STUDY);
        // A file that lies below the plan is named from there.
        let beside = folder.path().join("scans/a.ply");
        std::fs::create_dir(folder.path().join("scans")).unwrap();
        std::fs::write(&beside, "ply").unwrap();
        let mut session = Session::with_two_points();
        session.loaded.clouds[0].input = beside.display().to_string();
        session.scene.view_size = [64, 48];
        for bounces in [1, 2] {
            session.scene.settings.reflection.bounces = bounces;
            add_to_study(
                &plan,
                &session.scene.view_as_scene(&session.loaded, folder.path()),
                group_of(&session.scene.written_settings(&session.loaded), session.scene.view_size),
            )
            .unwrap();
        }
        let text = std::fs::read_to_string(&plan).unwrap();
        let table: toml::Table = toml::from_str(&text).unwrap();
        let cases = study::Plan::parse("study.toml", &text).unwrap_or_else(|error| panic!("{error}\n{text}")).cases();
        assert_eq!(cases.len(), 2);
        let groups = table["group"].as_array().unwrap();
        let names: Vec<&str> = groups.iter().filter_map(|group| group["name"].as_str()).collect();
        assert_eq!(names, ["tried-1", "tried-2"]);
        // Equal views share one file.
        let scene = groups[0]["scenes"][0].as_str().unwrap();
        assert_eq!((scene, &groups[0]["scenes"]), ("study-view-1.toml", &groups[1]["scenes"]));
        let view = std::fs::read_to_string(folder.path().join(scene)).unwrap();
        let clouds = scene::SceneFile::parse(&view).unwrap().clouds;
        assert_eq!(clouds.iter().map(Path::new).collect::<Vec<_>>(), [Path::new("scans/a.ply")]);
        assert_eq!(groups[1]["set"]["reflection.bounces"].as_integer(), Some(2));
        assert_eq!(groups[1]["sweep"]["size"][0].as_str(), Some("64x48"));
        // A file that is not text belongs to someone else, and stays.
        let foreign = folder.path().join("study-view-2.toml");
        std::fs::write(&foreign, [0xff, 0xfe]).unwrap();
        let other_view = session.scene.view_as_scene(&session.loaded, folder.path()) + "# another\n";
        add_to_study(
            &plan,
            &other_view,
            group_of(&session.scene.written_settings(&session.loaded), session.scene.view_size),
        )
        .unwrap();
        assert_eq!(std::fs::read(&foreign).unwrap(), [0xff, 0xfe]);
        assert_eq!(std::fs::read_to_string(folder.path().join("study-view-3.toml")).unwrap(), other_view);
        // A group that is not valid in a plan is not written.
        let before = std::fs::read_to_string(&plan).unwrap();
        let wrong = toml::Table::from_iter([("methods".to_string(), toml::Value::Integer(1))]);
        assert!(add_to_study(&plan, "never written", wrong).unwrap_err().to_string().contains("nothing was added"));
        assert_eq!(std::fs::read_to_string(&plan).unwrap(), before);
        assert!(!folder.path().join("study-view-4.toml").exists());
        std::fs::write(&plan, "no plan [").unwrap();
        let error = add_to_study(&plan, "", toml::Table::new()).unwrap_err().to_string();
        assert!(error.contains("study.toml") && error.contains("no plan"), "{error}");
        assert_eq!(std::fs::read_to_string(&plan).unwrap(), "no plan [");
    }
}
