//! The tuning chart: each setting that was tried is a dot, placed by its time and its error. A click on a dot goes back
//! to its setting. It is docked in the tab of tuning, so that it never lies over the picture that it judges.

use egui::{Color32, Pos2, RichText, Ui};
use egui_plot::{GridMark, Line, MarkerShape, Plot, PlotPoint, PlotPoints, Points};
use study::Accuracy;

use crate::shared::language::{english, text, translated};
use crate::viewer::jobs::study_file::STUDY;
use crate::viewer::look::theme;
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;
use crate::viewer::truth::tuning::{Trial, Tuning, medians, series};

/// The least time on the chart, in milliseconds. A method that takes no time stands there.
const LEAST_TIME: f64 = 0.01;
/// The chart reaches at least up to this error: nobody sees a smaller one.
const LEAST_ERROR: f64 = 0.01;
/// How far from a dot the mouse still means it, in points of the window.
const REACH: f32 = 10.0;

/// The figure that the chart shows as the error.
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
        english!("pixel error, 95 of 100"),
        english!("Pixels beside its place that 95 of 100 filled mirror pixels are within; empty ones do not count"),
    ),
    (
        ErrorFigure::Color,
        english!("colour error, ΔE"),
        english!("Mean difference of the mirrors' colours (CIEDE2000), empty pixels included"),
    ),
    (
        ErrorFigure::Occlusion,
        english!("occlusion error"),
        english!("Share of the filled mirror pixels that show something hidden, or miss something in front"),
    ),
    (
        ErrorFigure::Empty,
        english!("empty"),
        english!("Share of the mirror pixels that show nothing, those included that have nothing to show"),
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

    /// Whether the figure leaves out pixels that a setting leaves empty.
    fn is_of_filled(self) -> bool {
        matches!(self, Self::Place | Self::Occlusion)
    }
}

/// What the axes of the chart show. The window alone keeps this choice.
#[derive(Clone, Copy, Default)]
struct Axes {
    by_frame: bool,
    error: ErrorFigure,
}

/// The points (time, error) that no other point beats in both: their indices, by time.
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

/// The position on the chart and the index of each trial that has both figures. The trials are those of one series, or
/// all others.
fn dots(tuning: &Tuning, axes: Axes, series: &FrameRequest, is_of_series: bool) -> Vec<(usize, [f64; 2])> {
    let dot = |(index, trial): (usize, &Trial)| {
        let time = trial.time(axes.by_frame)?.max(LEAST_TIME);
        Some((index, [time.log10(), axes.error.of(trial.figures.as_ref()?)?]))
    };
    let trials = tuning.trials.iter().enumerate();
    trials.filter(|(_, trial)| (trial.series == *series) == is_of_series).filter_map(dot).collect()
}

/// How much of the panel's height the chart takes.
pub fn height(panel: f32) -> f32 {
    (panel * 0.48).clamp(120.0, 360.0)
}

/// Draws the chart into the panel.
pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.separator();
    ui.horizontal(|ui| {
        ui.label(RichText::new(text!("Tuning chart")).strong().size(13.5));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            if ui
                .small_button("×")
                .on_hover_text(text!("Close the chart"))
                .accessible_name(text!("Close the chart"))
                .clicked()
            {
                actions.push(Action::ToggleChart);
            }
        });
    });
    egui::ScrollArea::vertical().id_salt("tuning chart").show(ui, |ui| contents(ui, session, actions));
}

fn contents(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let Some(view) = session.frames.requested.as_ref().cloned() else {
        ui.label(
            RichText::new(text!("Open a scene: every setting that stands still becomes a dot.")).color(theme::WEAK),
        );
        return;
    };
    let tuning = &session.tuning;
    let id = egui::Id::unique("axes of the tuning chart");
    let mut axes: Axes = ui.data(|data| data.get_temp(id)).unwrap_or_default();
    ui.horizontal_wrapped(|ui| {
        let times = [
            (false, text!("method"), text!("Time of what finds the points that mirrors show")),
            (true, text!("frame"), text!("Time of the whole frame, from scratch")),
        ];
        for (by_frame, name, help) in times {
            if ui.selectable_label(axes.by_frame == by_frame, name).on_hover_text(help).clicked() {
                axes.by_frame = by_frame;
            }
        }
        ui.separator();
        for (error, name, help) in ERRORS {
            if ui.selectable_label(axes.error == error, translated(name)).on_hover_text(translated(help)).clicked() {
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
    ui.horizontal_wrapped(|ui| {
        let help = text!("Appends the setting at hand to {STUDY} in the current folder, for `glint study`", STUDY);
        if ui.button(text!("Add to study")).on_hover_text(help).clicked() {
            actions.push(Action::AddToStudy);
        }
        if ui.button(text!("Forget all")).on_hover_text(text!("Forget what was tried")).clicked() {
            actions.push(Action::ForgetTrials);
        }
    });
    let figures = session.truth.figures(&view);
    if figures.is_none_or(|figures| figures.image.is_none()) || session.tuning.times(&view).is_none() {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label(RichText::new(text!("judging this setting")).small().color(theme::WEAK));
        });
    }
}

/// Draws the dots. Returns the trial that was clicked.
fn chart(ui: &mut Ui, tuning: &Tuning, axes: Axes, view: &FrameRequest, series: &FrameRequest) -> Option<usize> {
    let (dots, others) = (dots(tuning, axes, series, true), dots(tuning, axes, series, false));
    let places = |is_sparse: bool| -> Vec<[f64; 2]> {
        let is_hollow = |index: usize| axes.error.is_of_filled() && tuning.trials[index].is_sparse();
        dots.iter().filter(|(index, _)| is_hollow(*index) == is_sparse).map(|(_, place)| *place).collect()
    };
    let (places, sparse) = (places(false), places(true));
    let front: Vec<[f64; 2]> = pareto(&places).into_iter().map(|index| places[index]).collect();
    let at_hand: Vec<[f64; 2]> =
        dots.iter().filter(|(index, _)| tuning.trials[*index].request == *view).map(|(_, place)| *place).collect();
    let greyed: Vec<[f64; 2]> = others.iter().map(|(_, place)| *place).collect();
    let error = ERRORS.iter().find(|(error, ..)| *error == axes.error).map_or("", |(_, name, _)| translated(name));
    let time = if axes.by_frame { text!("frame, ms") } else { text!("method, ms") };
    let milliseconds = |mark: GridMark, _: &std::ops::RangeInclusive<f64>| time_text(mark.value);
    let plot = Plot::new("tuning")
        .height(150.0)
        .allow_scroll(false)
        .x_axis_label(time)
        .y_axis_label(error)
        .x_axis_formatter(milliseconds)
        .x_grid_spacer(|input| time_marks(input.bounds))
        .label_formatter(|_| None)
        .include_y(0.0)
        .include_y(LEAST_ERROR)
        .set_margin_fraction(egui::vec2(0.12, 0.12));
    // A lone dot needs room on either side.
    let sides = dots.iter().chain(&others).flat_map(|(_, [time, _])| [time - 0.2, time + 0.2]);
    let plot = sides.fold(plot, |plot, side| plot.include_x(side));
    let drawn = plot.show(ui, |plot| {
        let points = |name: &str, places: Vec<[f64; 2]>| Points::new(name, PlotPoints::from(places)).allow_hover(false);
        let line = Line::new(text!("front"), PlotPoints::from(front)).color(theme::WEAK).allow_hover(false);
        plot.line(line.width(1.0));
        plot.points(points(text!("other views"), greyed).color(Color32::from_gray(70)).radius(3.0));
        plot.points(points(text!("tried"), places).color(theme::ACCENT).radius(4.5));
        plot.points(points(text!("mostly empty"), sparse).color(theme::ACCENT).radius(4.5).filled(false));
        let ring = points(text!("at hand"), at_hand).color(Color32::WHITE).shape(MarkerShape::Circle);
        plot.points(ring.filled(false).radius(8.0));
    });
    let all = dots.into_iter().chain(others);
    let place =
        |(index, [x, y]): (usize, [f64; 2])| (index, drawn.transform.position_from_point(&PlotPoint::new(x, y)));
    let on_screen: Vec<(usize, Pos2)> = all.map(place).collect();
    let pointed = nearest(&on_screen, drawn.response.hover_pos()?)?;
    let trial = &tuning.trials[pointed];
    let note = if trial.is_sparse() { translated(SPARSE) } else { "" };
    let response = drawn.response.on_hover_text_at_pointer(format!("{}\n{note}{}", summary(trial), trial.text()));
    response.clicked().then_some(pointed)
}

/// The marks of an axis of times whose values are decimal logarithms: 1, 2 and 5 of each decade.
fn time_marks((low, high): (f64, f64)) -> Vec<GridMark> {
    let decades = (low.floor() as i32)..=(high.ceil() as i32).min(low.floor() as i32 + 12);
    let of = |decade: i32| {
        [1.0_f64, 2.0, 5.0]
            .map(|digit| GridMark { value: f64::from(decade) + digit.log10(), step_size: digit_step(digit) })
    };
    decades.flat_map(of).collect()
}

/// How far apart marks of this kind are at least: those of 1 are drawn strongest.
fn digit_step(digit: f64) -> f64 {
    if digit == 1.0 { 1.0 } else { 0.3 }
}

/// A time in milliseconds from its decimal logarithm.
fn time_text(logarithm: f64) -> String {
    let value = 10_f64.powf(logarithm);
    let rounded = if value < 1.0 { format!("{value:.2}") } else { format!("{value:.0}") };
    if value < 1000.0 { rounded } else { format!("{} s", (value / 1000.0 * 10.0).round() / 10.0) }
}

/// The dot that the mouse means.
fn nearest(dots: &[(usize, Pos2)], pointer: Pos2) -> Option<usize> {
    let near = dots.iter().map(|(index, place)| (*index, place.distance(pointer)));
    let near = near.filter(|(_, distance)| *distance <= REACH).min_by(|(_, a), (_, b)| a.total_cmp(b));
    near.map(|(index, _)| index)
}

/// Explains why a dot is hollow.
const SPARSE: &str =
    english!("fills less than 90 % of the mirrors: what is empty does not count as an error of place or occlusion\n");

/// For example `12.3 ms of 41.0 ms · 99 % filled · 0.91 pixels · 0.32 ΔE`.
fn summary(trial: &Trial) -> String {
    let times = medians(&trial.times).map_or(text!("not timed").into(), |[frame, method]| {
        text!("{method} ms of {frame} ms", method = format_args!("{method:.1}"), frame = format_args!("{frame:.1}"))
    });
    let figures = trial.figures.as_ref();
    let place = figures.and_then(|figures| ErrorFigure::Place.of(figures));
    let color = figures.and_then(|figures| ErrorFigure::Color.of(figures));
    let filled = figures.map(|figures| figures.closed_coverage).filter(|share| share.is_finite());
    let filled = filled
        .map_or(String::new(), |share| text!(" · {share} % filled", share = format_args!("{:.0}", share * 100.0)));
    let place = place.map_or(String::new(), |value| text!(" · {value} pixels", value = format_args!("{value:.2}")));
    let color = color.map_or(String::new(), |value| format!(" · {value:.2} ΔE"));
    format!("{times}{filled}{place}{color}")
}

/// Lists the settings of this view in words. Returns the one that was clicked.
fn list(ui: &mut Ui, tuning: &Tuning, view: &FrameRequest, series: &FrameRequest) -> Option<usize> {
    let mut chosen = None;
    let of_view = || tuning.trials.iter().enumerate().filter(|(_, trial)| trial.series == *series);
    if of_view().next().is_none() {
        ui.label(RichText::new(text!("Nothing was tried in this view yet.")).color(theme::WEAK));
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
    fn the_axis_of_times_has_round_numbers() {
        let texts: Vec<String> = time_marks((0.9, 4.2)).iter().map(|mark| time_text(mark.value)).collect();
        assert_eq!(texts[..6], ["1", "2", "5", "10", "20", "50"]);
        assert!(
            ["1 s", "2 s", "5 s", "10 s", "20 s"].iter().all(|text| texts.iter().any(|known| known == text)),
            "{texts:?}"
        );
    }

    #[test]
    fn the_mouse_means_the_nearest_dot_within_reach() {
        let dots = [(7, egui::pos2(10.0, 10.0)), (9, egui::pos2(16.0, 10.0))];
        assert_eq!(nearest(&dots, egui::pos2(12.0, 10.0)), Some(7));
        assert_eq!(nearest(&dots, egui::pos2(20.0, 12.0)), Some(9));
        assert_eq!(nearest(&dots, egui::pos2(40.0, 10.0)), None);
    }
}
