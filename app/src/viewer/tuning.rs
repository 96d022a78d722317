//! The tuning chart: every setting that was tried in this session and stood still is a dot, its time against its error. A click on a
//! dot goes back to its setting.

use std::path::Path;

use egui::{Align2, Color32, Pos2, RichText, Ui};
use egui_plot::{GridMark, Line, MarkerShape, Plot, PlotPoint, PlotPoints, Points};
use render::{FrameStats, PassStage};
use scene::Settings;
use serde_json::json;
use study::Accuracy;
use study::results::Spread;

use super::action::Action;
use super::messages::Level;
use super::render_thread::{Command, FrameRequest};
use super::state::{Effect, State};
use super::study_file::STUDY;
use super::theme;
use super::work::Work;

/// Frames from scratch that a time is the median of.
const FRAMES: usize = 3;
/// Milliseconds after which those that were measured are enough: longer ones vary less.
const ENOUGH: f64 = 3000.0;
/// Least time on the chart, milliseconds: a method that takes none stands there.
const LEAST_TIME: f64 = 0.01;
/// The chart reaches at least so far up: less is no error that anybody sees.
const LEAST_ERROR: f64 = 0.01;
/// Most settings that are kept: more dots are not told apart.
const MOST_TRIALS: usize = 400;
/// Share of the mirror pixels that a setting fills at least: the errors of one that leaves more empty are of the easy ones alone.
const LEAST_FILLED: f64 = 0.9;
/// Pixels around a dot in which the mouse means it.
const REACH: f32 = 10.0;

/// What is charted as the error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum ErrorFigure {
    #[default]
    Place,
    Color,
    Occlusion,
    Empty,
}

const ERRORS: [(ErrorFigure, &str, &str); 4] = [
    (
        ErrorFigure::Place,
        "pixel error, 95 of 100",
        "Pixels beside its place that 95 of 100 filled mirror pixels are within; empty ones do not count",
    ),
    (
        ErrorFigure::Color,
        "colour error, ΔE",
        "Mean difference of the mirrors' colours (CIEDE2000), empty pixels included",
    ),
    (
        ErrorFigure::Occlusion,
        "occlusion error",
        "Share of the filled mirror pixels that show something hidden, or miss something in front",
    ),
    (
        ErrorFigure::Empty,
        "empty",
        "Share of the mirror pixels that show nothing, those included that have nothing to show",
    ),
];

impl ErrorFigure {
    fn of(self, figures: &Accuracy) -> Option<f64> {
        let value = match self {
            Self::Place => figures.pixel_error.p95,
            Self::Color => figures.image?.delta_e,
            Self::Occlusion => figures.occlusion_error,
            Self::Empty => 1.0 - figures.closed_coverage,
        };
        value.is_finite().then_some(value)
    }

    /// Whether pixels that a setting leaves empty are missing from it.
    fn is_of_filled(self) -> bool {
        matches!(self, Self::Place | Self::Occlusion)
    }
}

/// A setting that was tried.
struct Trial {
    request: FrameRequest,
    /// Equal to that of tries it can be held against.
    series: FrameRequest,
    /// Those of the panel: a click brings them back.
    settings: Settings,
    /// Milliseconds of whole frames and of the method, measurement by measurement.
    times: Vec<[f64; 2]>,
    figures: Option<Accuracy>,
}

/// What is charted: the choice of the window alone.
#[derive(Clone, Copy, Default)]
struct Axes {
    by_frame: bool,
    error: ErrorFigure,
}

#[derive(Default)]
pub struct Tuning {
    pub is_open: bool,
    trials: Vec<Trial>,
    measuring: Option<FrameRequest>,
}

/// Times of a frame and of what of it finds the points that mirrors show, milliseconds.
pub fn times(stats: &FrameStats) -> [f64; 2] {
    [stats.frame_milliseconds, study::results::stage_ms(&stats.passes, PassStage::Method)]
}

/// The median of each.
pub fn medians(times: &[[f64; 2]]) -> Option<[f64; 2]> {
    let median = |which: usize| Some(Spread::of(times.iter().map(|times| times[which]).collect())?.median);
    Some([median(0)?, median(1)?])
}

/// Whether so many measurements of frames will do.
pub fn are_enough(times: &[[f64; 2]]) -> bool {
    times.len() >= FRAMES || times.iter().map(|[frame, _]| frame).sum::<f64>() > ENOUGH
}

/// The same for all frames that are tries at one truth. How splats are drawn and how shadow maps are looked up is no part of it: it is
/// chosen for its time as methods are, though the truth is traced from the surface that comes of it.
fn series(request: &FrameRequest) -> FrameRequest {
    let mut basis = request.truth_basis();
    let (splat, light) = (scene::Splat::default(), scene::Light::default());
    (basis.settings.splat, basis.settings.light.shadow_bias) = (splat, light.shadow_bias);
    basis
}

/// Those of some points (time, error) that no other beats in both, by time.
fn pareto(points: &[[f64; 2]]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|a, b| points[*a][0].total_cmp(&points[*b][0]).then(points[*a][1].total_cmp(&points[*b][1])));
    let mut least = f64::INFINITY;
    order.retain(|index| {
        let is_better = points[*index][1] < least;
        least = least.min(points[*index][1]);
        is_better
    });
    order
}

impl Trial {
    fn time(&self, by_frame: bool) -> Option<f64> {
        medians(&self.times).map(|[frame, method]| if by_frame { frame } else { method })
    }

    /// Whether it fills too little for its errors to be held against those of others.
    fn is_sparse(&self) -> bool {
        self.figures.as_ref().is_some_and(|figures| figures.closed_coverage < LEAST_FILLED)
    }

    /// What it is: the parameters that are not the defaults.
    fn text(&self) -> String {
        let differing = self.settings.differing();
        let lines: Vec<String> = differing.into_iter().map(|(key, text)| format!("{key} = {text}")).collect();
        if lines.is_empty() { "all parameters as by default".into() } else { lines.join("\n") }
    }
}

impl Tuning {
    /// Median times of a frame and of its method, milliseconds.
    pub fn times(&self, request: &FrameRequest) -> Option<[f64; 2]> {
        medians(&self.trials.iter().find(|trial| trial.request == *request)?.times)
    }

    fn trial(&mut self, request: &FrameRequest, settings: &Settings) -> &mut Trial {
        let known = self.trials.iter().position(|trial| trial.request == *request);
        let index = known.unwrap_or_else(|| {
            let series = series(request);
            if self.trials.len() >= MOST_TRIALS {
                // The oldest, of another view if there is one.
                let other = self.trials.iter().position(|trial| trial.series != series);
                self.trials.remove(other.unwrap_or(0));
            }
            let (request, settings) = (request.clone(), settings.clone());
            self.trials.push(Trial { request, series, settings, times: Vec::new(), figures: None });
            self.trials.len() - 1
        });
        &mut self.trials[index]
    }

    /// How right a frame is.
    pub fn note(&mut self, request: &FrameRequest, settings: &Settings, figures: &Accuracy) {
        self.trial(request, settings).figures = Some(figures.clone());
    }

    /// Forgets what was tried.
    pub fn forget_trials(&mut self) {
        self.trials.clear();
    }

    /// What was measured failed, or was for something else.
    pub fn forget_measuring(&mut self) {
        self.measuring = None;
    }

    /// Place and error of each trial that has both, with its index; those of one series, or of all others.
    fn dots(&self, axes: Axes, series: &FrameRequest, is_of_series: bool) -> Vec<(usize, [f64; 2])> {
        let dot = |(index, trial): (usize, &Trial)| {
            let time = trial.time(axes.by_frame)?.max(LEAST_TIME);
            Some((index, [time.log10(), axes.error.of(trial.figures.as_ref()?)?]))
        };
        let trials = self.trials.iter().enumerate();
        trials.filter(|(_, trial)| (trial.series == *series) == is_of_series).filter_map(dot).collect()
    }
}

impl State {
    /// Has the times of a still frame measured. Returns whether they are still to come.
    pub fn measure(&mut self, request: &FrameRequest) -> bool {
        if are_enough(&self.tuning.trial(request, &self.settings).times) {
            return false;
        }
        // The ray tracer would take the time that is measured.
        if self.truth.is_quiet() && self.tuning.measuring.is_none() {
            self.tuning.measuring = Some(request.clone());
            self.render(Command::Measure(Box::new(request.clone())));
        }
        true
    }

    /// A frame that was drawn for its times.
    pub fn on_measured(&mut self, request: &FrameRequest, stats: &FrameStats) {
        if self.on_swept_frame(request, stats) {
            return;
        }
        self.tuning.measuring = None;
        if let Some(trial) = self.tuning.trials.iter_mut().find(|trial| trial.request == *request) {
            trial.times.push(times(stats));
        }
    }

    /// Goes back to a setting: one step of undo.
    pub fn return_to(&mut self, settings: Settings) {
        self.history.settle(&self.settings, &self.objects);
        self.settings = settings;
        self.history.settle(&self.settings, &self.objects);
        self.log(json!({ "event": "returned" }));
    }

    /// The setting at hand as a group of a study's plan, whose name and scene are still to come.
    fn study_group(&self) -> toml::Table {
        // What the group names itself.
        let is_set = |key: &String| key != "reflection.method" && !key.starts_with("scene.");
        let written = self.written_settings();
        let differing: Vec<String> = written.differing().into_iter().map(|(key, _)| key).filter(is_set).collect();
        let values = written.all().into_iter().filter(|(key, _)| differing.contains(key));
        let text = |key: &str| {
            let texts = written.differing().into_iter();
            texts.filter(|(known, _)| known == key).map(|(_, text)| text).next().unwrap_or_default()
        };
        let value = |key: &str, value: &param::Value| match value {
            param::Value::Bool(on) => toml::Value::Boolean(*on),
            param::Value::U32(number) => toml::Value::Integer((*number).into()),
            // By its text: the shortest that reads back as the same number.
            param::Value::F32(_) => text(key).parse().map_or(toml::Value::String(text(key)), toml::Value::Float),
            _ => toml::Value::String(text(key)),
        };
        let set: toml::Table = values.map(|(key, known)| (key.clone(), value(&key, &known))).collect();
        let method = param::Choice::name(self.settings.reflection.method);
        let [width, height] = self.view_size;
        let list = |text: String| toml::Value::Array(vec![toml::Value::String(text)]);
        let mut group = toml::Table::new();
        group.insert("methods".into(), list(method.into()));
        let sweep = toml::Table::from_iter([("size".to_string(), list(format!("{width}x{height}")))]);
        group.insert("sweep".into(), toml::Value::Table(sweep));
        if !set.is_empty() {
            group.insert("set".into(), toml::Value::Table(set));
        }
        group
    }

    /// Adds the setting at hand to the plan in the current folder, with the view as a scene beside it.
    pub fn add_to_study(&mut self) {
        if self.clouds.is_empty() {
            self.messages.note("There is no setting to add yet");
            return;
        }
        let scene = self.view_as_scene();
        // Absolute: a plan may be run from anywhere.
        let folder = std::env::current_dir().unwrap_or_default();
        let group = self.study_group();
        self.effects.push(Effect::Work(Work::AddToStudy { plan: folder.join(STUDY), scene, group }));
    }

    pub fn on_added_to_study(&mut self, path: &Path, result: Result<(), String>) {
        match result {
            Ok(()) => {
                self.log(json!({ "event": "added_to_study", "path": path }));
                self.messages.note(format!("Added to the study: {}", path.display()));
            }
            Err(error) => self.say(Level::Error, error),
        }
    }
}

/// The chart's window.
pub fn show(context: &egui::Context, state: &State, actions: &mut Vec<Action>) {
    if !state.tuning.is_open {
        return;
    }
    let mut is_open = true;
    egui::Window::new("Tuning chart")
        .open(&mut is_open)
        .default_size([460.0, 470.0])
        .anchor(Align2::RIGHT_BOTTOM, [-12.0, -40.0])
        .show(context, |ui| contents(ui, state, actions));
    actions.extend((!is_open).then_some(Action::ToggleChart));
}

fn contents(ui: &mut Ui, state: &State, actions: &mut Vec<Action>) {
    let Some(view) = state.wanted_frame().cloned() else {
        ui.label(RichText::new("Open a scene: every setting that stands still becomes a dot.").color(theme::WEAK));
        return;
    };
    let tuning = &state.tuning;
    let id = egui::Id::unique("axes of the tuning chart");
    let mut axes: Axes = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    ui.horizontal(|ui| {
        let times = [
            (false, "method", "Time of what finds the points that mirrors show"),
            (true, "frame", "Time of the whole frame, from scratch"),
        ];
        for (by_frame, name, help) in times {
            if ui.selectable_label(axes.by_frame == by_frame, name).on_hover_text(help).clicked() {
                axes.by_frame = by_frame;
            }
        }
        ui.separator();
        for (error, name, help) in ERRORS {
            if ui.selectable_label(axes.error == error, name).on_hover_text(help).clicked() {
                axes.error = error;
            }
        }
    });
    let series = series(&view);
    ui.data_mut(|data| data.insert_temp(id, axes));
    let chosen = chart(ui, tuning, axes, &view, &series);
    let listed = list(ui, tuning, &view, &series);
    let trial = chosen.or(listed).and_then(|trial| tuning.trials.get(trial));
    actions.extend(trial.map(|trial| Action::ReturnTo(Box::new(trial.settings.clone()))));
    ui.horizontal(|ui| {
        let help = format!("Appends the setting at hand to {STUDY} in the current folder, for `glint study`");
        if ui.button("Add to study").on_hover_text(help).clicked() {
            actions.push(Action::AddToStudy);
        }
        if ui.button("Clear").on_hover_text("Forget what was tried").clicked() {
            actions.push(Action::ForgetTrials);
        }
        let figures = state.truth.figures(&view);
        if figures.is_none_or(|figures| figures.image.is_none()) || state.tuning.times(&view).is_none() {
            ui.spinner();
            ui.label(RichText::new("judging this setting").small().color(theme::WEAK));
        }
    });
}

/// Draws the dots; the one that was clicked.
fn chart(ui: &mut Ui, tuning: &Tuning, axes: Axes, view: &FrameRequest, series: &FrameRequest) -> Option<usize> {
    let (dots, others) = (tuning.dots(axes, series, true), tuning.dots(axes, series, false));
    let places = |is_sparse: bool| -> Vec<[f64; 2]> {
        let is_hollow = |index: usize| axes.error.is_of_filled() && tuning.trials[index].is_sparse();
        dots.iter().filter(|(index, _)| is_hollow(*index) == is_sparse).map(|(_, place)| *place).collect()
    };
    let (places, sparse) = (places(false), places(true));
    let front: Vec<[f64; 2]> = pareto(&places).into_iter().map(|index| places[index]).collect();
    let at_hand: Vec<[f64; 2]> =
        dots.iter().filter(|(index, _)| tuning.trials[*index].request == *view).map(|(_, place)| *place).collect();
    let greyed: Vec<[f64; 2]> = others.iter().map(|(_, place)| *place).collect();
    let error = ERRORS.iter().find(|(error, ..)| *error == axes.error).map_or("", |(_, name, _)| name);
    let time = if axes.by_frame { "frame, ms" } else { "method, ms" };
    let milliseconds = |mark: GridMark, _: &std::ops::RangeInclusive<f64>| {
        let value = 10_f64.powf(mark.value);
        if value < 1.0 { format!("{value:.2}") } else { format!("{value:.0}") }
    };
    let plot = Plot::new("tuning")
        .height(ui.available_height().clamp(160.0, 260.0))
        .allow_scroll(false)
        .x_axis_label(time)
        .y_axis_label(error)
        .x_axis_formatter(milliseconds)
        .label_formatter(|_| None)
        .include_y(0.0)
        .include_y(LEAST_ERROR)
        .set_margin_fraction(egui::vec2(0.12, 0.12));
    // A lone dot has room on either side.
    let sides = dots.iter().chain(&others).flat_map(|(_, [time, _])| [time - 0.2, time + 0.2]);
    let plot = sides.fold(plot, |plot, side| plot.include_x(side));
    let drawn = plot.show(ui, |plot| {
        let points = |name: &str, places: Vec<[f64; 2]>| Points::new(name, PlotPoints::from(places)).allow_hover(false);
        let line = Line::new("front", PlotPoints::from(front)).color(theme::WEAK).allow_hover(false);
        plot.line(line.width(1.0));
        plot.points(points("other views", greyed).color(Color32::from_gray(70)).radius(3.0));
        plot.points(points("tried", places).color(theme::ACCENT).radius(4.5));
        plot.points(points("mostly empty", sparse).color(theme::ACCENT).radius(4.5).filled(false));
        let ring = points("at hand", at_hand).color(Color32::WHITE).shape(MarkerShape::Circle);
        plot.points(ring.filled(false).radius(8.0));
    });
    let all = dots.into_iter().chain(others);
    let place =
        |(index, [x, y]): (usize, [f64; 2])| (index, drawn.transform.position_from_point(&PlotPoint::new(x, y)));
    let on_screen: Vec<(usize, Pos2)> = all.map(place).collect();
    let pointed = nearest(&on_screen, drawn.response.hover_pos()?)?;
    let trial = &tuning.trials[pointed];
    let note = if trial.is_sparse() { SPARSE } else { "" };
    let response = drawn.response.on_hover_text_at_pointer(format!("{}\n{note}{}", summary(trial), trial.text()));
    response.clicked().then_some(pointed)
}

/// The dot that the mouse means.
fn nearest(dots: &[(usize, Pos2)], pointer: Pos2) -> Option<usize> {
    let near = dots.iter().map(|(index, place)| (*index, place.distance(pointer)));
    let near = near.filter(|(_, distance)| *distance <= REACH).min_by(|(_, a), (_, b)| a.total_cmp(b));
    near.map(|(index, _)| index)
}

/// Of a setting that is drawn hollow.
const SPARSE: &str =
    "fills less than 90 % of the mirrors: what is empty does not count as an error of place or occlusion\n";

/// `12.3 ms of 41.0 ms · 99 % filled · 0.91 pixels · 0.32 ΔE`.
fn summary(trial: &Trial) -> String {
    let times =
        medians(&trial.times).map_or("not timed".into(), |[frame, method]| format!("{method:.1} ms of {frame:.1} ms"));
    let figures = trial.figures.as_ref();
    let place = figures.and_then(|figures| ErrorFigure::Place.of(figures));
    let color = figures.and_then(|figures| ErrorFigure::Color.of(figures));
    let filled = figures.map(|figures| figures.closed_coverage).filter(|share| share.is_finite());
    let filled = filled.map_or(String::new(), |share| format!(" · {:.0} % filled", share * 100.0));
    let place = place.map_or(String::new(), |value| format!(" · {value:.2} pixels"));
    let color = color.map_or(String::new(), |value| format!(" · {value:.2} ΔE"));
    format!("{times}{filled}{place}{color}")
}

/// The settings of this view in words; the one that was clicked.
fn list(ui: &mut Ui, tuning: &Tuning, view: &FrameRequest, series: &FrameRequest) -> Option<usize> {
    let mut chosen = None;
    let of_view = || tuning.trials.iter().enumerate().filter(|(_, trial)| trial.series == *series);
    if of_view().next().is_none() {
        ui.label(RichText::new("Nothing was tried in this view yet.").color(theme::WEAK));
    }
    egui::ScrollArea::vertical().max_height(120.0).auto_shrink([false, true]).show(ui, |ui| {
        for (index, trial) in of_view() {
            let differs = trial.text().replace('\n', ", ");
            let text = format!("{} · {differs}", summary(trial));
            let is_at_hand = trial.request == *view;
            let label = egui::Button::selectable(is_at_hand, RichText::new(text).size(11.5)).truncate();
            if ui.add(label).on_hover_text(trial.text()).clicked() {
                chosen = Some(index);
            }
        }
    });
    chosen
}

#[cfg(test)]
mod tests {
    use super::super::study_file::add_to_study;
    use super::*;

    #[test]
    fn the_front_is_what_nothing_else_beats_in_both() {
        let points = [[3.0, 1.0], [1.0, 4.0], [2.0, 4.0], [2.0, 2.0], [4.0, 1.0], [0.5, f64::NAN]];
        let by_force: Vec<usize> = {
            let beats = |a: &[f64; 2], b: &[f64; 2]| a != b && a[0] <= b[0] && a[1] <= b[1];
            let mut front: Vec<usize> = (0..5).filter(|i| !points[..5].iter().any(|a| beats(a, &points[*i]))).collect();
            front.sort_by(|a, b| points[*a][0].total_cmp(&points[*b][0]));
            front
        };
        assert_eq!(pareto(&points), by_force);
    }

    #[test]
    fn the_mouse_means_the_nearest_dot_within_reach() {
        let dots = [(7, egui::pos2(10.0, 10.0)), (9, egui::pos2(16.0, 10.0))];
        assert_eq!(nearest(&dots, egui::pos2(12.0, 10.0)), Some(7));
        assert_eq!(nearest(&dots, egui::pos2(20.0, 12.0)), Some(9));
        assert_eq!(nearest(&dots, egui::pos2(40.0, 10.0)), None);
    }

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
        let mut state = State::with_two_points();
        state.view_size = [64, 48];
        for bounces in [1, 2] {
            state.settings.reflection.bounces = bounces;
            add_to_study(&plan, &state.view_as_scene(), state.study_group()).unwrap();
        }
        let text = std::fs::read_to_string(&plan).unwrap();
        let table: toml::Table = toml::from_str(&text).unwrap();
        let cases = study::Plan::parse("study.toml", &text).unwrap_or_else(|error| panic!("{error}\n{text}")).cases();
        assert_eq!(cases.len(), 2);
        let groups = table["group"].as_array().unwrap();
        let names: Vec<&str> = groups.iter().filter_map(|group| group["name"].as_str()).collect();
        assert_eq!(names, ["tried-1", "tried-2"]);
        // The same view is one file.
        let scene = groups[0]["scenes"][0].as_str().unwrap();
        assert_eq!(groups[0]["scenes"], groups[1]["scenes"]);
        assert!(std::fs::read_to_string(scene).unwrap().contains("cloud.ply"));
        assert_eq!(groups[1]["set"]["reflection.bounces"].as_integer(), Some(2));
        assert_eq!(groups[1]["sweep"]["size"][0].as_str(), Some("64x48"));
        // What cannot be read as text is another's, and stays.
        let foreign = folder.path().join("study-view-2.toml");
        std::fs::write(&foreign, [0xff, 0xfe]).unwrap();
        let other_view = state.view_as_scene() + "# another\n";
        add_to_study(&plan, &other_view, state.study_group()).unwrap();
        assert_eq!(std::fs::read(&foreign).unwrap(), [0xff, 0xfe]);
        assert_eq!(std::fs::read_to_string(folder.path().join("study-view-3.toml")).unwrap(), other_view);
        // A group that no plan can have is not written.
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
