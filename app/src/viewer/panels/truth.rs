//! The ray-traced truth on the screen: the section of the panel that chooses what to show and says how accurate the
//! picture is, the truth over the picture, and the progress in the status bar.

use egui::{Align2, Color32, FontId, Pos2, Rect, RichText, Sense, Stroke, Ui, pos2, vec2};
use study::{Accuracy, Estimate};

use crate::shared::language::{english, text, translated};
use crate::viewer::jobs::tasks::{ASTRAY_COLOR, Measure, RAMP};
use crate::viewer::look::theme;
use crate::viewer::look::theme::{bytes, grouped};
use crate::viewer::panels;
use crate::viewer::panels::parameters::parameters;
use crate::viewer::requests::action::{Action, Look};
use crate::viewer::requests::bindings;
use crate::viewer::session::Session;
use crate::viewer::truth::live::Estimated;
use crate::viewer::truth::traced_points;
use crate::viewer::truth::view::{Activity, BYTES_PER_POINT, PEAK_BYTES_PER_POINT};

const LOOKS: [(Look, &str, &str); 3] = [
    (Look::Truth, english!("Truth"), english!("What the ray tracer sees in place of the picture")),
    (Look::Split, english!("Split"), english!("The picture on the left, the truth on the right: drag the line")),
    (Look::Difference, english!("Difference"), english!("Where the picture is wrong, as a heat map")),
];

const MEASURES: [(Measure, &str, &str); 2] = [
    (
        Measure::Color,
        english!("Colour"),
        english!("Difference of the colours (CIEDE2000): 1 is hardly seen, 10 is another colour"),
    ),
    (
        Measure::Place,
        english!("Place"),
        english!("How many pixels beside its place a mirror shows a point; cyan where it shows none, or one too many"),
    ),
];

/// How far beside the split's line it can be grabbed, in points of the window: as wide as a scroll bar.
const GRIP: f32 = 6.0;
const SHADOW: Color32 = Color32::from_black_alpha(170);

// ---- panel ----

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let help =
            text!("Keeps the truth in the picture ({shortcut})", shortcut = bindings::shortcut(&Action::PinTruth));
        if ui.selectable_label(session.truth.is_pinned, text!("Pin")).on_hover_text(help).clicked() {
            actions.push(Action::PinTruth);
        }
        ui.label(
            RichText::new(text!("hold {shortcut}", shortcut = bindings::shortcut(&Action::ShowTruth)))
                .color(theme::WEAK),
        );
    });
    let truth = &session.truth;
    if truth.is_pinned {
        actions.extend(choices(ui, truth.look, &LOOKS).map(Action::LookAtTruth));
        if truth.look == Look::Difference {
            actions.extend(choices(ui, truth.measure, &MEASURES).map(Action::MeasureTruth));
        }
    }
    let (mut keeps_ready, mut judges) = (truth.keeps_ready, truth.judges);
    let help = text!("Trace every view that stands still, so that the truth is there when its key is pressed");
    if ui.checkbox(&mut keeps_ready, text!("Keep ready")).on_hover_text(help).changed() {
        actions.push(Action::KeepTruthReady(keeps_ready));
    }
    let help =
        text!("Measure how right the mirrors are whenever the view stands still; the tuning chart does so by itself");
    if ui.checkbox(&mut judges, text!("Judge each setting")).on_hover_text(help).changed() {
        actions.push(Action::JudgeSettings(judges));
    }
    figures(ui, session);
    estimate(ui, session, actions);
    let text = match session.truth.bytes() {
        0 => {
            let [kept, peak] = [BYTES_PER_POINT, PEAK_BYTES_PER_POINT]
                .map(|each| bytes(traced_points(&session.loaded.clouds, &session.loaded.samples) * each));
            text!("Tracing takes {kept} more memory, {peak} while it begins", kept, peak)
        }
        kept => text!("{kept} kept for tracing", kept = bytes(kept)),
    };
    ui.label(RichText::new(text).small().color(theme::WEAK));
    parameters(ui, &session.scene.settings.trace, &[], actions);
}

/// Draws choices side by side. Returns the one that was clicked.
fn choices<T: Copy + PartialEq>(ui: &mut Ui, value: T, choices: &[(T, &str, &str)]) -> Option<T> {
    let mut chosen = None;
    ui.horizontal(|ui| {
        for (choice, name, help) in choices {
            if ui.selectable_label(value == *choice, translated(name)).on_hover_text(translated(help)).clicked() {
                chosen = Some(*choice);
            }
        }
    });
    chosen
}

/// Shows how accurate the picture on the screen is, and what it costs.
fn figures(ui: &mut Ui, session: &Session) {
    let Some(request) = session.still_frame() else { return };
    let times = session.tuning.times(request);
    if let Some(figures) = session.truth.figures(request) {
        for (name, text, help) in lines(figures) {
            line(ui, name, &text, help);
        }
    }
    if let Some([frame, method]) = times {
        line(
            ui,
            text!("Whole frame"),
            &text!("{time} ms", time = format_args!("{frame:.1}")),
            text!("Median of frames from scratch with this setting"),
        );
        line(
            ui,
            text!("Method"),
            &text!("{time} ms", time = format_args!("{method:.1}")),
            text!("Of that, what finds the points that mirrors show"),
        );
    }
}

/// Shows how large the error of the picture on the screen is, as far as random pixels show.
fn estimate(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let mut is_on = session.truth.live.is_on;
    let help = text!(
        "Trace some hundred random mirror pixels exactly, and light as many by many lights, again and again while the \
                view stands still; needs no memory for tracing"
    );
    if ui.checkbox(&mut is_on, text!("Estimate errors")).on_hover_text(help).changed() {
        actions.push(Action::EstimateErrors(is_on));
    }
    let estimated = session.still_frame().and_then(|request| session.truth.live.of(request));
    match estimated {
        Some(Estimated::Figures(figures)) => {
            for (name, text, help) in estimate_lines(figures) {
                line(ui, name, &text, help);
            }
        }
        Some(Estimated::Nothing) => {
            let text = text!("Neither a mirror nor indirect light is seen");
            ui.label(RichText::new(text).small().color(theme::WEAK));
        }
        Some(Estimated::Problem(problem)) => {
            ui.label(RichText::new(problem).small().color(theme::WEAK));
        }
        None => {}
    }
}

/// The estimated figures: the name, the value with its interval of 95 %, and the meaning of each.
fn estimate_lines(figures: &Estimate) -> Vec<(&'static str, String, &'static str)> {
    let number = |value: f64| if value.is_nan() { "?".into() } else { format!("{value:.2}") };
    let percent = |value: f64| if value.is_nan() { "?".into() } else { format!("{:.1}", value * 100.0) };
    let mut lines = Vec::new();
    if let Some(error) = &figures.pixel_error {
        let [low, high] = error.median_interval.map(number);
        let help = text!("Half of the filled mirror pixels show a point at most so many pixels beside its place");
        lines.push((
            text!("Pixel error, half"),
            text!("{median} ({low} to {high})", median = number(error.median), low, high),
            help,
        ));
        let [low, high] = error.p95_interval.map(number);
        let help = text!("95 of 100 filled mirror pixels show a point at most so many pixels beside its place");
        lines.push((
            text!("Pixel error, 95 %"),
            text!("{error} ({low} to {high})", error = number(error.p95), low, high),
            help,
        ));
    }
    if let Some([low, high]) = figures.wrong_interval.map(|interval| interval.map(percent)) {
        let help = text!("Share of the filled mirror pixels that are more than a pixel off, or show another surface");
        lines.push((
            text!("Wrong"),
            text!("{wrong} % ({low} to {high})", wrong = percent(figures.wrong), low, high),
            help,
        ));
    }
    if let Some(light) = &figures.indirect {
        let [low, high] = light.relative_rmse_interval.map(percent);
        let help =
            text!("Root mean square difference of the indirect light from that of 1024 lights, relative to its mean");
        lines.push((
            text!("Indirect light"),
            text!("{relative_rmse} % ({low} to {high})", relative_rmse = percent(light.relative_rmse), low, high),
            help,
        ));
    }
    let help =
        text!("Mirror pixels that were traced exactly; brackets hold the figure of all pixels in 95 of 100 cases");
    lines.push((text!("Rays"), grouped(figures.rays as u64), help));
    lines
}

/// The figures of same-input accuracy: the name, the value and the meaning of each.
pub fn lines(figures: &Accuracy) -> Vec<(&'static str, String, &'static str)> {
    let percent = |share: f64| if share.is_nan() { "-".into() } else { format!("{:.2} %", share * 100.0) };
    let number = |value: f64| if value.is_nan() { "-".into() } else { format!("{value:.2}") };
    let pixels = &figures.pixel_error;
    let mut lines = vec![
        (text!("Covered"), percent(figures.coverage), text!("Share of the mirror pixels in which a point was found")),
        (
            text!("Filled"),
            percent(figures.closed_coverage),
            text!("The same with those that were closed from their neighbours"),
        ),
        (
            text!("Pixel error"),
            format!("{} · {}", number(pixels.median), number(pixels.p95)),
            text!(
                "Pixels beside its place that a point is shown: half of the filled mirror pixels, 95 of 100 are within"
            ),
        ),
        (
            text!("Occlusion error"),
            percent(figures.occlusion_error),
            text!("Share of the filled mirror pixels that show something hidden, or miss something in front"),
        ),
    ];
    if let Some(recall) = figures.recall {
        lines.push((
            text!("Recall"),
            percent(recall),
            text!("Share of the points truly seen in the mirrors that were found"),
        ));
    }
    if let Some(image) = figures.image {
        let help =
            text!("Difference of the mirrors' colours (CIEDE2000): the mean, and what 95 of 100 pixels are within");
        lines.push((
            text!("Colour error"),
            format!("{} · {} ΔE", number(image.delta_e), number(image.delta_e_p95)),
            help,
        ));
    }
    lines
}

fn line(ui: &mut Ui, name: &str, text: &str, help: &str) {
    ui.horizontal(|ui| {
        ui.label(RichText::new(name).size(12.0)).on_hover_text(help);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            // Keep clear of the scroll bar.
            ui.add_space(6.0);
            ui.label(RichText::new(text).monospace().size(11.5));
        });
    });
}

// ---- over the picture ----

/// Draws the truth over the picture in `rect`, as far as it is traced, if it belongs to the picture on the screen.
pub fn paint(ui: &Ui, rect: Rect, session: &Session, actions: &mut Vec<Action>) {
    let Some(request) = session.truth.frame(&session.frames, session.scene.camera, session.scene.view_size) else {
        return;
    };
    let look = session.truth.shown_look();
    let painter = ui.painter().with_clip_rect(rect);
    let picture = match look {
        Look::Difference => session.truth.difference(&request),
        Look::Truth | Look::Split => session.truth.picture(&request),
    };
    let Some(picture) = picture.map(|picture| picture.texture(ui.ctx())) else {
        tag(
            &painter,
            rect.left_top() + vec2(10.0, 10.0),
            Align2::LEFT_TOP,
            &session.truth.awaited(session.sweeps.under_way.is_some(), session.outside.now),
        );
        return;
    };
    let part = match look {
        Look::Split => split(ui, rect, session.truth.split, Action::SplitTruth, actions),
        Look::Truth => rect,
        Look::Difference => {
            // Darken the picture, so that what is not measured can still be recognised.
            painter.rect_filled(rect, 0.0, Color32::from_black_alpha(150));
            rect
        }
    };
    let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
    painter.with_clip_rect(part).image(picture, rect, whole, Color32::WHITE);
    match look {
        Look::Split => {
            divide(&painter, part);
        }
        Look::Difference => legend(&painter, rect, session.truth.measure),
        Look::Truth => {}
    }
    let paths = session.truth.samples(&request).map_or(String::new(), |(samples, wanted)| paths(samples, wanted));
    let more = match session.truth.activity(session.outside.now) {
        Some(Activity::Tracing { progress, .. }) => format!(" · {progress}"),
        _ => String::new(),
    };
    let corner = pos2(part.left() + 10.0, part.top() + 10.0);
    tag(&painter, corner, Align2::LEFT_TOP, &text!("ray-traced truth{paths}{more}", paths, more));
}

/// Reports how many paths have been traced: ` · 2 of 16 paths a pixel, mirrors 16`.
fn paths([mirrors, all]: [u32; 2], wanted: u32) -> String {
    match (mirrors, all) {
        _ if wanted <= 1 && all == wanted => String::new(),
        _ if all == wanted => text!(" · {wanted} paths a pixel", wanted),
        (_, 0) => text!(" · coarse").into(),
        _ if mirrors > all => text!(" · {all} of {wanted} paths a pixel, mirrors {mirrors}", all, wanted, mirrors),
        _ => text!(" · {all} of {wanted} paths a pixel", all, wanted),
    }
}

/// Lets the user drag the split's line, which gives the action of its new position. Returns the rectangle to its right.
/// The keyboard never comes to the line, as no key moves it.
pub fn split(ui: &Ui, rect: Rect, mut share: f32, moved: fn(f32) -> Action, actions: &mut Vec<Action>) -> Rect {
    let line = |share: f32| egui::lerp(rect.x_range(), share);
    let x = line(share);
    let grip = Rect::from_x_y_ranges(x - GRIP..=x + GRIP, rect.y_range());
    let id = ui.scope_id().with(("split", moved(0.0) == Action::SplitTruth(0.0)));
    let response = ui.interact(grip, id, Sense::DRAG);
    if let Some(pointer) = response.interact_pointer_pos().filter(|_| response.dragged()) {
        // The line stays where it can be grabbed again.
        share = ((pointer.x - rect.left()) / rect.width().max(1.0)).clamp(0.01, 0.99);
        actions.push(moved(share));
    }
    response.on_hover_and_drag_cursor(egui::CursorIcon::ResizeHorizontal);
    Rect::from_min_max(pos2(line(share), rect.top()), rect.max)
}

/// Draws the line at the left of the part to the right of a split.
pub fn divide(painter: &egui::Painter, part: Rect) {
    let line = [part.left_top(), part.left_bottom()];
    painter.line_segment(line, Stroke::new(3.5, SHADOW));
    painter.line_segment(line, Stroke::new(1.5, theme::ACCENT));
}

pub fn tag(painter: &egui::Painter, at: Pos2, align: Align2, text: &str) {
    let galley = painter.layout_no_wrap(text.into(), FontId::proportional(12.0), Color32::WHITE);
    let place = align.anchor_size(at, galley.size());
    painter.rect_filled(place.expand(4.0), 4.0, SHADOW);
    painter.galley(place.min, galley, Color32::WHITE);
}

fn legend(painter: &egui::Painter, rect: Rect, measure: Measure) {
    let (steps, size) = (64_u8, vec2(192.0, 12.0));
    let corner = rect.left_bottom() + vec2(16.0, -46.0);
    let bar = Rect::from_min_size(corner, size);
    painter.rect_filled(bar.expand2(vec2(10.0, 8.0)).with_max_y(bar.bottom() + 24.0), 4.0, SHADOW);
    let ramp = render::ramp_colors(RAMP);
    for step in 0..steps {
        let [left, right] = [step, step + 1].map(|step| f32::from(step) / f32::from(steps) * size.x + bar.left());
        let [red, green, blue, _] = ramp[usize::from(step) * 255 / usize::from(steps - 1)];
        let part = Rect::from_x_y_ranges(left..=right, bar.y_range());
        painter.rect_filled(part, 0.0, Color32::from_rgb(red, green, blue));
    }
    let font = FontId::proportional(11.0);
    let unit = if measure == Measure::Color { "ΔE" } else { text!("pixels") };
    let most = measure.most();
    let labels =
        [(0.0, "0".to_string()), (0.5, format!("{}", most * 0.5)), (1.0, text!("{most} {unit} or more", most, unit))];
    for (share, text) in labels {
        let at = pos2(egui::lerp(bar.x_range(), share), bar.bottom() + 4.0);
        let align = if share == 1.0 { Align2::RIGHT_TOP } else { Align2::LEFT_TOP };
        painter.text(at, align, text, font.clone(), Color32::WHITE);
    }
    if measure == Measure::Place {
        let [red, green, blue] = ASTRAY_COLOR;
        let (entry, font) = (bar.left_top() - vec2(0.0, 30.0), FontId::proportional(12.0));
        let color = Color32::from_rgb(red, green, blue);
        let galley = painter.layout_no_wrap(text!("nothing found, or nothing to be found").into(), font, color);
        let place = Rect::from_min_size(entry, galley.size());
        painter.rect_filled(place.expand(4.0), 4.0, SHADOW);
        painter.galley(place.min, galley, color);
    }
}

// ---- status bar ----

/// Shows what the ray tracer is doing, with a button to end it.
pub fn progress(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    panels::sweep::progress(ui, session, actions);
    let Some(activity) = session.truth.activity(session.outside.now) else { return };
    let text = match activity {
        Activity::Building => text!("making the points ready for tracing").into(),
        Activity::Tracing { wanted: 0, progress, .. } => text!("tracing the truth: {progress}", progress),
        Activity::Tracing { samples, wanted, progress } => {
            text!("tracing the truth{wanted} · {progress}", wanted = paths(samples, wanted), progress)
        }
    };
    ui.spinner();
    ui.label(RichText::new(text).small().color(theme::WEAK));
    if ui.small_button(text!("Stop")).on_hover_text(text!("End tracing, and let go of the truth")).clicked() {
        actions.push(Action::StopTruth);
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use study::{Percentiles, Truth};

    use super::*;

    fn figures(recall: Option<f64>) -> Accuracy {
        let error = Percentiles { median: 0.125, p95: f64::NAN, p99: 2.0 };
        Accuracy {
            truth: Truth::SameInput,
            mirror_pixels: 8,
            coverage: 0.25,
            closed_coverage: 1.0,
            false_fill: 0.0,
            angle_error: error,
            pixel_error: error,
            occlusion_error: f64::NAN,
            wrong: f64::NAN,
            recall,
            image: None,
            indirect: None,
            surface: None,
        }
    }

    #[test]
    fn figures_that_could_not_be_measured_are_a_dash_or_left_out() {
        let texts = |figures: &Accuracy| -> Vec<(&'static str, String)> {
            lines(figures).into_iter().map(|(name, text, _)| (name, text)).collect()
        };
        let expected = [
            ("Covered", "25.00 %"),
            ("Filled", "100.00 %"),
            ("Pixel error", "0.12 · -"),
            ("Occlusion error", "-"),
            ("Recall", "50.00 %"),
        ];
        let expected = expected.map(|(name, text)| (name, text.to_string()));
        assert_eq!(texts(&figures(Some(0.5))), expected);
        assert_eq!(texts(&figures(None)), expected[..4]);
    }

    #[test]
    fn estimates_are_shown_with_their_intervals() {
        let error = study::estimate::EstimatedPercentiles {
            median: 0.5,
            p95: 2.0,
            median_interval: [0.25, 0.75],
            p95_interval: [1.5, f64::NAN],
        };
        let figures = Estimate {
            rays: 10_000,
            filled: 1.0,
            pixel_error: Some(error),
            wrong: 0.125,
            wrong_interval: Some([0.1, 0.15]),
            indirect: None,
        };
        let texts: Vec<String> = estimate_lines(&figures).into_iter().map(|(_, text, _)| text).collect();
        assert_eq!(texts, ["0.50 (0.25 to 0.75)", "2.00 (1.50 to ?)", "12.5 % (10.0 to 15.0)", "10,000"]);
    }

    #[test]
    fn a_picture_says_how_many_of_its_paths_are_traced() {
        assert_eq!(paths([1, 1], 1), "");
        assert_eq!(paths([0, 0], 16), " · coarse");
        assert_eq!(paths([2, 2], 16), " · 2 of 16 paths a pixel");
        assert_eq!(paths([16, 2], 16), " · 2 of 16 paths a pixel, mirrors 16");
        assert_eq!(paths([16, 16], 16), " · 16 paths a pixel");
    }

    #[test]
    fn what_is_shown_is_chosen_once_the_truth_is_pinned() {
        let session = Session::with_two_points();
        let mut harness = Harness::builder().with_size([340.0, 600.0]).with_max_steps(16).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        assert!(harness.query_by_label("Difference").is_none());
        harness.get_by_label("Pin").click();
        harness.run_ok();
        assert!(harness.state().truth.is_pinned && harness.query_by_label("Place").is_none());
        harness.get_by_label("Difference").click();
        harness.run_ok();
        harness.get_by_label("Place").click();
        harness.run_ok();
        let truth = &harness.state().truth;
        assert!(truth.look == Look::Difference && truth.measure == Measure::Place);
    }

    #[test]
    fn the_line_between_picture_and_truth_is_dragged_and_stays_where_it_can_be_grabbed() {
        let rect = Rect::from_min_size(pos2(0.0, 0.0), vec2(400.0, 100.0));
        let mut session = Session::with_two_points();
        session.truth.split = 0.5;
        let mut harness = Harness::builder().with_size(rect.size()).build_ui_state(
            |ui, session: &mut Session| {
                session.show_and_act(|session, actions| {
                    let _ = split(ui, rect, session.truth.split, Action::SplitTruth, actions);
                });
            },
            session,
        );
        harness.run();
        let (button, modifiers) = (egui::PointerButton::Primary, egui::Modifiers::NONE);
        let press = |pos, pressed| egui::Event::PointerButton { pos, button, pressed, modifiers };
        // The first press is beside the line and grabs nothing.
        for (from, to, expected) in
            [(100.0, 300.0, 0.5), (200.0, 100.0, 0.25), (100.0, 900.0, 0.99), (396.0, -50.0, 0.01)]
        {
            let [from, to] = [from, to].map(|x| pos2(x, 50.0));
            for event in
                [egui::Event::PointerMoved(from), press(from, true), egui::Event::PointerMoved(to), press(to, false)]
            {
                harness.event(event);
                harness.step();
            }
            harness.run();
            assert_eq!(harness.state().truth.split, expected, "from {from} to {to}");
        }
    }

    #[test]
    fn the_keyboard_never_comes_to_the_line_of_a_split() {
        let mut harness = Harness::new_ui(|ui| {
            let rect = ui.available_rect_before_wrap();
            split(ui, rect, 0.5, Action::SplitTruth, &mut Vec::new());
        });
        harness.key_press(egui::Key::Tab);
        harness.run_ok();
        assert_eq!(harness.ctx.memory(|memory| memory.focused()), None);
    }
}
