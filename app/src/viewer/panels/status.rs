//! The status bar: what is under way and how many points are shown on its left, the state of the picture on its right.

use std::time::Duration;

use egui::{Align, Layout, RichText, Ui, UiBuilder};
use scene::Show;
use world::{CloudTask, IndexState, LEAST_TIME, TaskKind, TaskStatus};

use crate::shared::language::{text, translated};
use crate::shared::measuring::decimals_of_length;
use crate::system::fetching::{self, Fetch};
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{progress_bar, progress_text, time_left};
use crate::viewer::objects::clouds::JobEntry;
use crate::viewer::panels;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::bindings;
use crate::viewer::requests::messages::Level;
use crate::viewer::session::Session;
use crate::viewer::tools::clips::PRISM_HINT;
use crate::viewer::tools::measurements::units;

/// The room between what is under way and the state of the picture, in points of the window.
const GAP: f32 = 10.0;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    // Tab leads from left to right, so the left end is drawn first. In a narrow window the right end stays whole, and what
    // is under way on the left is cut: the left end leaves as much room as the right end has taken before.
    let (area, place) = (ui.available_rect_before_wrap(), ui.scope_id().with("right end"));
    let taken = ui.data(|data| data.get_temp::<f32>(place)).unwrap_or_default();
    let (left, right) = area.split_left_right_at_x((area.right() - taken).max(area.left()));
    let row = Layout::left_to_right(Align::Center);
    let mut ui_left = ui.new_child(UiBuilder::new().max_rect(left).layout(row));
    ui_left.style_mut().wrap_mode = Some(egui::TextWrapMode::Truncate);
    ui_left.set_clip_rect(left.intersect(ui.clip_rect()));
    under_way(&mut ui_left, session, actions);
    ui_left.with_layout(Layout::right_to_left(Align::Center), |ui| place_under_cursor(ui, session));
    let mut ui_right = ui.new_child(UiBuilder::new().max_rect(right).layout(row));
    ui_right.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
    ui_right.add_space(GAP);
    state_of_picture(&mut ui_right, session, actions);
    let needed = ui_right.min_rect().width();
    if needed != taken {
        ui.data_mut(|data| data.insert_temp(place, needed));
        if needed > taken {
            ui.ctx().request_discard("the right end of the status bar is wider than before");
        }
    }
    ui.advance_cursor_after_rect(area);
}

/// What the next picture waits for before it is drawn, and the first one while it is.
pub fn waiting(session: &Session) -> Option<String> {
    if session.fatal.is_some() {
        return None;
    }
    match session.frames.compiled() {
        Some(share) => Some(text!("compiling shaders: {share} %", share = format_args!("{:.0}", share * 100.0))),
        None if session.adapter.is_none() => Some(text!("preparing the renderer").into()),
        None => session.frames.first_is_drawn().then(|| text!("drawing the first picture").into()),
    }
}

/// The switch of the panel, what to click, what waits, the work that is under way, and the number of points.
fn under_way(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let is_open = session.preferences.panel_is_open;
    let text = if is_open { "<" } else { ">" };
    let help = if is_open { text!("Hide the panel") } else { text!("Show the panel") };
    if ui.small_button(text).on_hover_text(help).accessible_name(help).clicked() {
        actions.push(Action::TogglePanel);
    }
    // What to do, and what waits, comes before what the program does.
    if let Some(placing) = &session.tools.measurements.placing {
        ui.label(RichText::new(placing.hint()).color(theme::ACCENT));
    }
    if session.tools.prism.is_some() {
        ui.label(RichText::new(translated(PRISM_HINT)).color(theme::ACCENT));
    }
    let waits = session.loaded.points_come() && !session.tools.measurements.are_known(&session.scene);
    for text in [
        waits.then(|| text!("a measurement waits")),
        session.tools.clicked.is_waited_for().then(|| text!("looking up the point that was clicked")),
    ] {
        text.map(|text| ui.label(RichText::new(text).color(theme::WEAK)));
    }
    if let Some(wait) = waiting(session) {
        ui.label(RichText::new(wait).color(theme::WEAK));
        if let Some(share) = session.frames.compiled() {
            progress_bar(ui, share);
        }
        ui.ctx().request_repaint_after(Duration::from_millis(100));
    } else if let Some([summed, asked]) = session.frames.samples_under_way().filter(|_| session.fatal.is_none()) {
        ui.label(RichText::new(text!("sample {summed} of {asked}", summed, asked)).color(theme::WEAK));
        progress_bar(ui, summed as f32 / asked as f32);
    } else if let Some((so_far, all)) = session.frames.full_quality_under_way(session.outside.now) {
        let left = all.map(|all| all - so_far).filter(|left| *left > 0.0);
        let more = left.map_or_else(|| text!("{so_far} s so far", so_far = format_args!("{so_far:.0}")), time_left);
        ui.label(RichText::new(text!("drawing the full picture: {more}", more)).color(theme::WEAK));
        if let Some(all) = all.filter(|_| left.is_some()) {
            progress_bar(ui, (so_far / all) as f32);
        }
        ui.ctx().request_repaint_after(Duration::from_millis(250));
    }
    if let Some(job) = session.loaded.jobs.iter().find(|job| session.loaded.is_at_work(job)) {
        if job_progress(ui, session, job) {
            actions.push(Action::StopLoading);
        }
        ui.ctx().request_repaint_after(Duration::from_millis(100));
    } else {
        // Of streamed clouds that are switched off no points are loaded: all of them are left out.
        let hidden = session.loaded.clouds.iter().filter(|entry| !entry.is_visible && entry.streamed.is_some());
        let hidden: u64 = hidden.map(|entry| entry.total() - entry.points).sum();
        let cut = session.loaded.clouds.iter().filter(|entry| entry.is_cut && entry.streamed.is_none());
        let cut: u64 = cut.map(|entry| entry.total() - entry.points).sum();
        let (points, all) = (session.loaded.points(), session.loaded.all_points() - hidden + cut);
        let shown = shown_points(session);
        let help = text!("The others are hidden by clips, filters or classes, or with their cloud");
        if let Some(shown) = shown.filter(|_| all == points) {
            let text = text!("{shown} of {points} points shown", shown = grouped(shown), points = grouped(points));
            ui.label(text).on_hover_text(help);
        } else if all > points {
            let loaded = text!("{points} of {total} points loaded", points = grouped(points), total = grouped(all));
            match shown {
                Some(shown) => drop(ui.label(text!("{loaded}, {shown} shown", loaded, shown = grouped(shown)))),
                None => drop(ui.label(loaded)),
            }
        } else if points > 0 {
            ui.label(text!("{points} points", points = grouped(points)));
        }
    }
    for work in session.loaded.running() {
        let help = bindings::shortcut(&Action::StopAll);
        ui.label(RichText::new(work.to_string()).color(theme::WEAK))
            .on_hover_text(text!("{key} stops it, and all that is loaded", key = help));
        progress_bar(ui, work.share());
        ui.ctx().request_repaint_after(Duration::from_millis(100));
    }
    panels::truth::progress(ui, session, actions);
    panels::recording::progress(ui, session, actions);
    panels::picture::progress(ui, session);
}

/// What the picture shows and took.
fn state_of_picture(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    uncertain_reflections(ui, session, actions);
    if session.is_unlit() {
        ui.label(RichText::new(text!("data colours, no light")).color(theme::ACCENT));
    }
    let [turning, help] = session.scene.turning();
    let color = if turning == "orbit" { theme::WEAK } else { theme::ACCENT };
    ui.label(RichText::new(translated(turning)).color(color)).on_hover_text(translated(help));
    if let Some(shown) = &session.frames.shown {
        ui.label(
            RichText::new(text!("{time} ms", time = format_args!("{:.1}", shown.stats.frame_milliseconds)))
                .monospace()
                .size(11.5),
        );
    }
    messages_button(ui, session, actions);
}

/// The place under the cursor, where there is room for it.
fn place_under_cursor(ui: &mut Ui, session: &Session) {
    if let Some((_, Some(world))) = session.scene.navigation.hovered {
        ui.add_space(6.0);
        // A millimetre is enough for the status bar. A pick shows the other decimals.
        let level = decimals_of_length(units(&session.loaded).level) - 1;
        let text = format!("{:.level$}  {:.level$}  {:.3}", world.x, world.y, world.z);
        let font = egui::FontId::monospace(11.5);
        let text = ui.painter().layout_no_wrap(text, font, theme::WEAK);
        // In a narrow window they would lie over the number of points.
        if text.size().x < ui.available_width() {
            ui.label(text);
        }
    }
}

/// How many points are shown, where something hides points and their number is known.
fn shown_points(session: &Session) -> Option<u64> {
    if session.scene.objects.test().shows_all() {
        return None;
    }
    let visible = session.loaded.clouds.iter().filter(|entry| entry.is_visible);
    visible.map(|entry| entry.figures.as_ref().map(|figures| figures.shown)).sum()
}

/// The status bar warns if a larger share of a frame's reflections than this is uncertain.
const MOSTLY_CERTAIN: f64 = 0.1;

/// Draws a warning if many reflections are uncertain. A click on it shows where they are.
fn uncertain_reflections(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let share =
        session.frames.shown.as_ref().and_then(|shown| shown.stats.reflection).map_or(0.0, |stats| stats.uncertain);
    if share <= MOSTLY_CERTAIN {
        return;
    }
    let text = text!("{share} % of reflections uncertain", share = format_args!("{:.0}", share * 100.0));
    let help = text!("Closed from neighbours, more than a pixel off, or alone among neighbours; click to see where");
    if ui.small_button(RichText::new(text).color(theme::ACCENT)).on_hover_text(help).clicked() {
        let is_shown = session.scene.settings.reflection.show == Show::Uncertain;
        let show = if is_shown { Show::Picture } else { Show::Uncertain };
        actions.push(Action::set("reflection", "show", param::Value::Choice(show as u32)));
    }
}

/// Draws the progress of a job. Returns true if Cancel was clicked.
fn job_progress(ui: &mut Ui, session: &Session, job: &JobEntry) -> bool {
    // What follows may be cut.
    let cancel =
        ui.small_button(text!("Cancel")).on_hover_text(text!("Stop all that is loaded and made; what is there stays"));
    let is_cancelled = cancel.clicked();
    if let Some((entry, stage)) = session.loaded.stage_of(job) {
        let is_preview = entry.points > 0 && matches!(entry.pages, Some(IndexState::Indexing));
        stage_progress(ui, stage, &entry.cloud.name, is_preview);
    } else {
        let (done, total) = (job.progress.done(), job.progress.total());
        ui.label(text!("reading {job}", job = job.name));
        if let Some((Fetch { address, done, total, .. }, count)) = fetching::first() {
            let address = codec::last_part(&address);
            // How long such a wait will be nobody knows.
            if total == 1 {
                ui.label(text!("the server of {address} asks to wait", address));
            } else {
                let others = if count > 1 { text!(" and {count} more", count = count - 1) } else { String::new() };
                ui.label(text!("fetching {address}{others}", address, others));
                progress_bar(ui, (done as f32 / total.max(1) as f32).min(1.0));
                let text = text!("{done} of {total}", done = theme::bytes(done), total = theme::bytes(total));
                ui.label(RichText::new(text).small().color(theme::WEAK));
            }
        }
        // For a streamed cloud the number of points that a view needs is not known.
        if total > 0 {
            progress_bar(ui, (done as f32 / total as f32).min(1.0));
            let elapsed = job.started.elapsed();
            let pace = (done > 0 && elapsed > LEAST_TIME).then(|| done as f64 / elapsed.as_secs_f64());
            ui.label(RichText::new(progress_text(done, total, pace)).small().color(theme::WEAK));
        }
    }
    is_cancelled
}

/// Draws the progress of a task of a cloud.
fn stage_progress(ui: &mut Ui, stage: &CloudTask, name: &str, is_preview: bool) {
    let (verb, noun) = match stage.kind {
        TaskKind::Index if is_preview => (text!("a preview is shown, indexing"), text!("index")),
        TaskKind::Index => (text!("indexing"), text!("index")),
        TaskKind::Surfels => (text!("normals of"), text!("normals")),
    };
    match stage.status() {
        TaskStatus::Queued => drop(ui.label(text!("{name}: its {noun} will be made next", name, noun))),
        TaskStatus::Elsewhere => drop(ui.label(text!("{name}: another program is making its {noun}", name, noun))),
        TaskStatus::UnderWay | TaskStatus::Stopped | TaskStatus::Over => {
            let share = stage.share() as f32;
            ui.label(format!("{verb} {name}: {:.0} %", share * 100.0));
            progress_bar(ui, share);
            let text = progress_text(stage.done(), stage.points(), stage.pace());
            ui.label(RichText::new(text).small().color(theme::WEAK));
        }
    }
}

fn messages_button(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    let worst = session.outside.messages.all.iter().map(|message| message.level).max_by_key(|level| *level as u8);
    let color = worst.filter(|level| *level != Level::Note).map(Level::color);
    let count = session.outside.messages.all.iter().filter(|message| message.level != Level::Note).count();
    let text = if count > 0 { text!("Messages ({count})", count) } else { text!("Messages").into() };
    let text = color.map_or(RichText::new(&text), |color| RichText::new(&text).color(color));
    if ui.small_button(text).clicked() {
        actions.push(Action::ListMessages(!session.outside.messages.list_is_open));
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use glam::DVec3;
    use scene::{Measurement, MeasurementKind, Object};

    use super::*;
    use crate::viewer::objects::ObjectId;
    use crate::viewer::requests::action::{Clipping, Measuring};

    #[test]
    fn in_a_narrow_window_the_left_end_is_cut_and_nothing_lies_over_another() {
        for (width, is_whole) in [(700.0, true), (340.0, false)] {
            let mut session = Session::with_two_points();
            session.adapter = Some("any".into());
            session.act(Action::Measuring(Measuring::Begin(MeasurementKind::Distance)));
            let mut harness = Harness::builder().with_size([width, 28.0]).build_ui_state(
                |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
                session,
            );
            harness.run_ok();
            let points = harness.get_by_label("2 points").rect();
            let hint = harness.get_by_label("distance: click point 1 of 2").rect();
            assert!(hint.right() <= points.left(), "{width}: {points:?}, {hint:?}");
            assert!(hint.right() < harness.get_by_label("Messages").rect().left());
            assert_eq!(points.width() > 40.0, is_whole, "{width}: {points:?}");
            // The longest text of what to click is cut, too.
            harness.state_mut().act(Action::Clip(Clipping::DrawPrism));
            harness.run_ok();
            let [toggle, hint, messages] =
                ["Hide the panel", translated(PRISM_HINT), "Messages"].map(|label| harness.get_by_label(label).rect());
            assert!(toggle.left() >= 0.0 && toggle.right() <= hint.left() && hint.right() < messages.left());
            assert!(messages.right() <= width, "{width}: {messages:?}");
        }
    }

    #[test]
    fn a_measurement_that_waits_for_points_is_named_beside_their_progress() {
        let mut session = Session::with_two_points();
        session.adapter = Some("any".into());
        let line = Measurement {
            name: "width".into(),
            kind: MeasurementKind::Distance,
            on: true,
            color: [1.0; 3],
            points: vec![DVec3::ZERO, DVec3::X],
            reach: None,
            level: None,
        };
        session.scene.objects.add(ObjectId(7), Object::Measurement(line));
        session.loaded.add_job(&[], Default::default(), Default::default(), session.outside.now);
        let mut harness = Harness::builder().with_size([700.0, 28.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_steps(2);
        let waits = |harness: &Harness<'_, Session>| harness.query_by_label("a measurement waits").is_some();
        assert!(waits(&harness));
        harness.state_mut().scene.objects.measurements.clear();
        harness.run_steps(2);
        assert!(!waits(&harness));
    }

    #[test]
    fn a_save_and_a_comparison_show_how_far_they_are_until_the_key_that_stops_work() {
        let mut session = Session::with_two_points();
        session.adapter = Some("any".into());
        let progress = std::sync::Arc::new(cloud::Progress::default());
        progress.set_total(5);
        progress.add(2);
        let path = "/scans/big3.csv".into();
        session.loaded.writing =
            Some(crate::viewer::loaded::Writing { path, progress: progress.clone(), added: Vec::new() });
        let comparison = std::sync::Arc::new(cloud::Progress::default());
        session.loaded.comparisons.under_way = Some(("a to b, M3C2".into(), comparison.clone()));
        let mut harness = Harness::builder().with_size([1100.0, 28.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_steps(2);
        for text in ["big3.csv is being saved (40 %)", "a to b, M3C2: being compared (0 %)"] {
            assert!(harness.query_by_label(text).is_some(), "{text}");
        }
        harness.state_mut().act(Action::StopLoading);
        assert!(!progress.is_cancelled() && !comparison.is_cancelled(), "loading alone is stopped");
        harness.state_mut().act(Action::StopAll);
        assert!(progress.is_cancelled() && comparison.is_cancelled());
    }

    #[test]
    fn a_streamed_cloud_that_is_switched_off_counts_among_no_points_that_could_be_loaded() {
        let mut session = Session::with_two_points();
        session.adapter = Some("any".into());
        let entry = &mut session.loaded.clouds[0];
        (entry.streamed, entry.expected_points) = (Some(Default::default()), 1234);
        let mut harness = Harness::builder().with_size([1100.0, 28.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_steps(2);
        assert!(harness.query_by_label("2 of 1,234 points loaded").is_some());
        let entry = &mut harness.state_mut().loaded.clouds[0];
        (entry.is_visible, entry.points) = (false, 0);
        harness.run_steps(2);
        assert!(harness.query_by_label_contains("points loaded").is_none());
    }

    #[test]
    fn tab_leads_through_the_bar_from_left_to_right() {
        let mut session = Session::with_two_points();
        session.adapter = Some("any".into());
        let mut harness = Harness::builder().with_size([700.0, 28.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        );
        harness.run_ok();
        let mut places = Vec::new();
        for _ in 0..2 {
            harness.key_press(egui::Key::Tab);
            harness.run_ok();
            let focused = harness.ctx.memory(egui::Memory::focused).and_then(|id| harness.ctx.read_response(id));
            places.push(focused.unwrap().rect.left());
        }
        assert!(places[0] < 20.0 && places[1] > 600.0, "{places:?}");
    }
}
