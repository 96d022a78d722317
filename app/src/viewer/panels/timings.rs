//! The panel of times: every pass of a frame, the counts and the memory, and the figures of the reflections with their
//! history.

use egui::{Align, Layout, RichText, Ui};
use render::{Clock, FrameStats, GlossCache, ReflectionStats};

use crate::shared::language::{text, translated};
use crate::viewer::frames::auto::slowest_text;
use crate::viewer::look::reflection_figures::{FIGURES, reflected_text};
use crate::viewer::look::theme;
use crate::viewer::look::theme::{bytes, grouped};
use crate::viewer::session::Session;

fn reflections(ui: &mut Ui, session: &Session, stats: &ReflectionStats) {
    for (index, (name, text, figure)) in FIGURES.into_iter().enumerate() {
        let Some(value) = figure(stats) else { continue };
        let rect = row(ui, translated(name), &text(value), None);
        sparkline(ui, rect, session.figure_history.of(index).filter(|value| value.is_finite()).collect());
    }
    if let Some(limit) = stats.map_use.and_then(|map_use| map_use.limit) {
        row(ui, text!("Maps limited by"), limit.name(), None);
    }
    if stats.bounces > 1 {
        row(ui, text!("Bounces"), &stats.bounces.to_string(), None);
    }
    ui.separator();
}

/// How far a picture is whose indirect light comes by rays.
fn light_rays(ui: &mut Ui, stats: &FrameStats) {
    let [summed, asked] = stats.light_rays;
    if asked > 0 {
        row(
            ui,
            text!("Rays of light"),
            &text!("{summed} of {asked}", summed, asked),
            Some(summed as f32 / asked as f32),
        );
    }
}

/// How far a picture with glossy mirrors is, and whether its rays had to be traced.
fn gloss(ui: &mut Ui, stats: &FrameStats) {
    let [summed, asked] = stats.glossy_samples;
    if asked == 0 {
        return;
    }
    row(ui, text!("Glossy samples"), &text!("{summed} of {asked}", summed, asked), Some(summed as f32 / asked as f32));
    let why = match stats.glossy_hits {
        GlossCache::Kept => {
            let [traced, known] = stats.glossy_rays;
            row(ui, text!("Glossy rays traced"), &grouped(traced), None);
            row(ui, text!("Known from before"), &grouped(known), None);
            return;
        }
        GlossCache::NoGloss => return,
        GlossCache::Off => text!("gloss.cache is off").to_owned(),
        GlossCache::NoHits => text!("the method keeps no hits").to_owned(),
        GlossCache::Clear => text!("there is glass or water").to_owned(),
        GlossCache::TooLarge(size) => text!("they would take {size}", size = bytes(size)),
    };
    ui.label(RichText::new(text!("Rays are traced for each change of light: {why}", why)).small().color(theme::WEAK));
}

/// Draws a line of values over the middle of a row, scaled from the least to the largest of them.
fn sparkline(ui: &Ui, row: egui::Rect, values: Vec<f64>) {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if values.len() < 2 {
        return;
    }
    let rect = egui::Rect::from_x_y_ranges(
        egui::lerp(row.x_range(), 0.42)..=egui::lerp(row.x_range(), 0.70),
        row.top() + 3.0..=row.bottom() - 3.0,
    );
    let place = |(index, value): (usize, &f64)| {
        let along = index as f32 / (values.len() - 1) as f32;
        // A value that does not change is drawn as a line in the middle.
        let height = if high > low { ((value - low) / (high - low)) as f32 } else { 0.5 };
        egui::pos2(egui::lerp(rect.x_range(), along), egui::lerp(rect.bottom()..=rect.top(), height))
    };
    let points = values.iter().enumerate().map(place).collect();
    ui.painter().add(egui::Shape::line(points, egui::Stroke::new(1.2, theme::ACCENT.gamma_multiply(0.8))));
}

pub fn show(ui: &mut Ui, session: &Session) {
    let Some(shown) = &session.frames.shown else {
        ui.label(RichText::new(text!("No frame yet.")).color(theme::WEAK));
        return;
    };
    let stats = &shown.stats;
    if let Some(reflection) = &stats.reflection {
        reflections(ui, session, reflection);
    }
    let clock = match stats.clock {
        Clock::Gpu => text!("GPU clock"),
        Clock::Host => text!("host clock (this adapter has none that is to be trusted)"),
    };
    passes(ui, stats);
    ui.separator();
    gloss(ui, stats);
    light_rays(ui, stats);
    row(ui, text!("Whole frame"), &text!("{time} ms", time = format_args!("{:.1}", stats.frame_milliseconds)), None);
    row(ui, text!("With transfer"), &text!("{time} ms", time = format_args!("{:.1}", shown.total_milliseconds)), None);
    let [width, height] = shown.request.drawn_size();
    row(ui, text!("Picture"), &format!("{width} × {height}"), None);
    ui.label(RichText::new(clock).small().color(theme::WEAK));
    let slowest = session.auto.slowest.as_ref().filter(|_| !shown.request.hurried).map(slowest_text);
    for text in [slowest, session.auto.told(&session.picture())].into_iter().flatten() {
        ui.label(RichText::new(text).small());
    }
    if shown.request.hurried {
        let text = match shown.request.spared {
            None => text!("Nearest point while moving, refined at rest"),
            Some(_) => text!("Fewer pixels and points while moving, refined at rest"),
        };
        ui.label(RichText::new(text).small().color(theme::ACCENT));
    }
    if let Some(share) = &stats.reflected {
        let text = text!("Mirrors reflect {share}", share = reflected_text(share));
        ui.label(RichText::new(text).small().color(theme::ACCENT));
    }
    if let Some(text) = stats.reflection.as_ref().and_then(cameras_text) {
        ui.label(RichText::new(text).small().color(theme::ACCENT));
    }
    ui.separator();
    let loaded: u64 = session.loaded.clouds.iter().map(|entry| entry.points).sum();
    let total: u64 = session.loaded.clouds.iter().map(|entry| entry.expected_points.max(entry.points)).sum();
    row(ui, text!("Points drawn"), &grouped(stats.points_drawn), None);
    row(ui, text!("On the GPU"), &grouped(stats.points_resident), None);
    row(ui, text!("Loaded"), &grouped(loaded), None);
    row(ui, text!("In the files"), &grouped(total), None);
    ui.separator();
    let points: usize = session.loaded.clouds.iter().map(|entry| entry.cloud.size_in_bytes()).sum();
    row(ui, text!("GPU memory"), &bytes(stats.gpu_bytes), None);
    row(ui, text!("Points in memory"), &bytes(points as u64), None);
    if let Some(resident) = host_memory() {
        row(ui, text!("Program"), &bytes(resident), None);
    }
    if let Some(adapter) = &session.adapter {
        ui.label(RichText::new(adapter).small().color(theme::WEAK));
    }
}

/// The time of each pass, if each was timed.
fn passes(ui: &mut Ui, stats: &FrameStats) {
    if stats.passes.is_empty() {
        let text = text!("Without timestamps of the adapter, passes are timed only while nothing moves");
        ui.label(RichText::new(text).small().color(theme::WEAK));
    }
    let longest = stats.passes.iter().map(|pass| pass.milliseconds).fold(f64::MIN_POSITIVE, f64::max);
    for pass in &stats.passes {
        row(
            ui,
            pass.name,
            &text!("{time} ms", time = format_args!("{:.2}", pass.milliseconds)),
            Some((pass.milliseconds / longest) as f32),
        );
    }
}

/// What there is to say of the cells of space of `sample_cameras`.
fn cameras_text(reflection: &ReflectionStats) -> Option<String> {
    let cameras = reflection.cameras.as_ref()?;
    Some(if cameras.is_late {
        text!("Cameras of an earlier view, while those of this one are made").to_owned()
    } else {
        let (pinholes, lists) = (grouped(cameras.pinholes.into()), grouped(cameras.lists.into()));
        text!(
            "{pinholes} pinholes, {lists} lists of rays, made in {milliseconds} ms",
            pinholes,
            lists,
            milliseconds = format_args!("{:.0}", cameras.milliseconds)
        )
    })
}

/// Draws a row: the name on the left, the figure on the right, and behind them a bar. `share` is the bar's length over
/// the row's.
fn row(ui: &mut Ui, name: &str, figure: &str, share: Option<f32>) -> egui::Rect {
    let (rect, _) = ui.allocate_exact_size(egui::vec2(ui.available_width(), 17.0), egui::Sense::hover());
    if let Some(share) = share {
        let bar = egui::Rect::from_min_size(rect.min, egui::vec2(rect.width() * share.clamp(0.0, 1.0), rect.height()));
        ui.painter().rect_filled(bar, 2.0, theme::ACCENT.gamma_multiply(0.16));
    }
    let mut child = ui.new_child(egui::UiBuilder::new().max_rect(rect.shrink2(egui::vec2(4.0, 0.0))));
    child.with_layout(Layout::left_to_right(Align::Center), |ui| {
        ui.label(RichText::new(name).size(12.0));
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            ui.label(RichText::new(figure).monospace().size(11.5));
        });
    });
    rect
}

/// The resident memory of this process, in bytes. `None` where the system does not report it as Linux does.
fn host_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kilobytes: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kilobytes * 1024)
}

#[cfg(test)]
mod tests {
    use egui_kittest::kittest::Queryable as _;
    use render::FrameStats;

    use super::*;
    use crate::viewer::look::reflection_figures::REMEMBERED;

    fn stats(coverage: f64) -> FrameStats {
        FrameStats {
            passes: Vec::new(),
            frame_milliseconds: 1.0,
            splatting_milliseconds: 0.0,
            points_drawn: 0,
            points_resident: 0,
            gpu_bytes: 0,
            clock: Clock::Host,
            virtual_lights: 0,
            glossy_samples: [0; 2],
            light_rays: [0; 2],
            exposure: None,
            glossy_hits: render::GlossCache::NoGloss,
            glossy_rays: [0; 2],
            methods: Vec::new(),
            reflected: None,
            is_quick: false,
            flip: None,
            has_compiled: false,
            dispatches: 0,
            waits: 0,
            reflection: Some(ReflectionStats {
                mirror_pixels: 12_345,
                coverage,
                closed_coverage: 1.0,
                regions: Some(2),
                bounces: 1,
                ..ReflectionStats::default()
            }),
        }
    }

    #[test]
    fn the_history_keeps_the_last_frames_and_what_a_method_does_not_tell_is_left_out() {
        let mut session = Session::new(crate::viewer::requests::preferences::Preferences::default());
        for frame in 0..REMEMBERED + 30 {
            session.figure_history.push(&stats(frame as f64));
        }
        let coverage: Vec<f64> = session.figure_history.of(1).collect();
        assert_eq!((coverage.len(), coverage[0]), (REMEMBERED, 30.0));
        let mut harness = egui_kittest::Harness::builder().with_size([300.0, 200.0]).build_ui_state(
            |ui, session: &mut Session| reflections(ui, session, &stats(0.5).reflection.unwrap_or_default()),
            session,
        );
        harness.run();
        for shown in ["Mirror pixels", "12,345", "Coverage", "50.00 %", "Regions"] {
            assert!(harness.query_all_by_label(shown).next().is_some(), "{shown}");
        }
        assert!(harness.query_by_label("Hit rate").is_none());
    }

    #[test]
    fn passes_that_were_not_timed_have_no_times() {
        let shows = |frame: &FrameStats, text: &str| {
            let mut harness =
                egui_kittest::Harness::builder().with_size([300.0, 200.0]).build_ui(|ui| passes(ui, frame));
            harness.run();
            harness.query_all_by_label_contains(text).next().is_some()
        };
        let mut frame = stats(0.5);
        assert!(shows(&frame, "only while nothing moves") && !shows(&frame, "ms"));
        frame.passes.push(render::PassTime { name: "shade", stage: render::PassStage::Light, milliseconds: 1.25 });
        assert!(shows(&frame, "1.25 ms") && !shows(&frame, "only while nothing moves"));
    }

    #[test]
    fn samples_of_glossy_mirrors_are_counted_and_a_cache_that_keeps_nothing_is_told() {
        let mut frame = stats(0.5);
        (frame.glossy_samples, frame.glossy_hits, frame.glossy_rays) = ([5, 16], GlossCache::Kept, [0, 98_765]);
        let shows = |frame: &FrameStats, text: &str| {
            let mut harness =
                egui_kittest::Harness::builder().with_size([300.0, 200.0]).build_ui(|ui| gloss(ui, frame));
            harness.run();
            harness.query_all_by_label_contains(text).next().is_some()
        };
        assert!(shows(&frame, "5 of 16") && shows(&frame, "98,765") && !shows(&frame, "Rays are traced"));
        for (kept, text) in [
            (GlossCache::Off, "gloss.cache is off"),
            (GlossCache::NoHits, "keeps no hits"),
            (GlossCache::Clear, "glass"),
            (GlossCache::TooLarge(600 << 20), "629 MB"),
        ] {
            frame.glossy_hits = kept;
            assert!(shows(&frame, text) && shows(&frame, "5 of 16"), "{kept:?}");
        }
        frame.glossy_samples = [0, 0];
        assert!(!shows(&frame, "Glossy"));
    }
}
