//! Clouds that are streamed: how far their pages are, what is there of them, what comes, and the budgets.

use std::time::Duration;

use egui::{RichText, Ui};

use super::interface::progress_text;
use super::state::{CloudEntry, JobEntry, State};
use super::theme::{self, grouped};
use super::{panel, streams::Streamed};
use crate::streaming::{Paged, StreamStats};

pub fn show(ui: &mut Ui, state: &mut State) {
    for job in state.jobs.iter().filter(|job| job.has_streamed) {
        let of_job = state.clouds.iter().filter(|entry| job.clouds.values().any(|key| *key == entry.key));
        for (entry, streamed) in of_job.filter_map(|entry| Some((entry, entry.streamed.as_ref()?))) {
            ui.push_id(entry.key.0, |ui| cloud(ui, job, entry, streamed));
        }
        figures(ui, &job.stream, state.settings.stream.host_bytes.0);
        ui.add_space(4.0);
    }
    panel::parameter(ui, &mut state.settings.view, "point_budget");
    panel::parameters(ui, &mut state.settings.stream, &[]);
}

/// How far the pages of a cloud are.
fn cloud(ui: &mut Ui, job: &JobEntry, entry: &CloudEntry, streamed: &Streamed) {
    ui.add(egui::Label::new(RichText::new(&entry.cloud.name).strong()).truncate());
    let weak = |ui: &mut Ui, text: String| ui.label(RichText::new(text).small().color(theme::WEAK));
    match &streamed.pages {
        Paged::Indexing if job.progress.is_cancelled() => {
            weak(ui, "no index: what is shown is a preview".into());
        }
        Paged::Indexing => {
            let (done, total) = (job.progress.done(), job.progress.total());
            let text = progress_text(done, total, true, job.started.elapsed());
            let help = "Stop; nothing is kept of the index, and the preview stays";
            if stage(ui, "indexing", done, total, &text, help) {
                job.progress.cancel();
                job.surfel_progress.cancel();
            }
        }
        Paged::Indexed { has_surfels, was_built, .. } => {
            let origin = if *was_built { "indexed now" } else { "the index was there" };
            weak(ui, format!("{} of {} points · {origin}", grouped(entry.points), grouped(entry.total())));
            let (done, total) = (job.surfel_progress.done(), job.surfel_progress.total());
            if *has_surfels {
                weak(ui, "ready, with normals and radii of all points".into());
            } else if total > 0 && done < total && !job.surfel_progress.is_cancelled() {
                let text = progress_text(done, total, false, job.started.elapsed());
                let help = "Stop; normals and radii stay those of what is there";
                if stage(ui, "normals", done, total, &text, help) {
                    job.surfel_progress.cancel();
                }
            } else {
                weak(ui, "ready; normals and radii are those of what is there".into());
            }
        }
    }
}

/// A stage that takes its time. Returns whether it is to stop.
fn stage(ui: &mut Ui, verb: &str, done: u64, total: u64, text: &str, help: &str) -> bool {
    ui.ctx().request_repaint_after(Duration::from_millis(250));
    let share = if total > 0 { (done as f32 / total as f32).clamp(0.0, 1.0) } else { 0.0 };
    let is_stopped = ui.horizontal(|ui| {
        ui.label(format!("{verb} {:.0} %", share * 100.0));
        let bar = egui::ProgressBar::new(share).desired_width(110.0).desired_height(12.0);
        ui.add(bar.fill(theme::ACCENT.gamma_multiply(0.7)));
        ui.small_button("Stop").on_hover_text(help).clicked()
    });
    ui.label(RichText::new(text).small().color(theme::WEAK));
    is_stopped.inner
}

/// What is there of the clouds of a job, and what comes.
fn figures(ui: &mut Ui, stats: &StreamStats, host_bytes: u64) {
    let lines = [
        ("Resident", format!("{} points in {} nodes", grouped(stats.points_resident), grouped(stats.nodes as u64))),
        ("Memory", format!("{} of {}", theme::bytes(stats.host_bytes), theme::bytes(host_bytes))),
        ("Waiting", format!("{} nodes", grouped(stats.nodes_waiting as u64))),
        ("Disk", format!("{}/s", theme::bytes(stats.disk_bytes_per_second as u64))),
        ("Decoded", format!("{:.2} M points/s", stats.points_per_second / 1e6)),
    ];
    egui::Grid::new("streaming").num_columns(2).spacing([16.0, 2.0]).show(ui, |ui| {
        for (name, text) in lines {
            ui.label(RichText::new(name).small());
            ui.label(RichText::new(text).small().monospace());
            ui.end_row();
        }
    });
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use cloud::Progress;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    use super::super::preferences::Preferences;
    use super::*;
    use crate::loading::Event;

    /// A cloud whose index is being made, by job 0, and how far it is.
    fn indexing() -> (State, Arc<Progress>) {
        let mut state = State::new(Preferences::default());
        let progress = Arc::<Progress>::default();
        progress.set_total(200);
        progress.add(86);
        state.add_job(&[], progress.clone(), Arc::default(), Arc::default());
        let opened = Event::Opened {
            cloud: 0,
            name: "survey.laz".into(),
            input: "survey.laz".into(),
            source: None,
            attributes: Vec::new(),
            grid: None,
            expected_points: 200,
            up: glam::DVec3::Z,
            provisional_radius: 0.0,
            warnings: Vec::new(),
        };
        state.on_loading(0, opened);
        state.on_loading(0, Event::Pages { cloud: 0, pages: Paged::Indexing });
        (state, progress)
    }

    fn harness(state: State) -> Harness<'static, State> {
        Harness::builder().with_size([360.0, 700.0]).build_ui_state(show, state)
    }

    #[test]
    fn an_index_that_is_made_tells_how_far_it_is_and_can_be_stopped() {
        let (state, progress) = indexing();
        let mut harness = harness(state);
        harness.run_ok();
        assert!(harness.query_by_label("indexing 43 %").is_some());
        harness.get_by_label("Stop").click();
        harness.run_ok();
        assert!(progress.is_cancelled());
        assert!(harness.query_by_label_contains("preview").is_some(), "what is left is said");
    }

    #[test]
    fn what_is_there_of_a_streamed_cloud_is_told_beside_its_budgets() {
        let (mut state, _) = indexing();
        let node = stream::Node {
            level: 0,
            bounds: cloud::Bounds::EMPTY,
            points: 200,
            total: 12_345,
            first_point: 0,
            parent: None,
            children: [None; 8],
        };
        let octree = stream::Octree { corner: glam::DVec3::ZERO, width: 1.0, spacing: 1.0, nodes: vec![node] };
        let pages = Paged::Indexed { octree: Arc::new(octree), grid: None, was_built: true, has_surfels: true };
        state.on_loading(0, Event::Pages { cloud: 0, pages });
        let stats = StreamStats { nodes: 3, points_resident: 2_000, nodes_waiting: 7, ..StreamStats::default() };
        state.on_loading(0, Event::Stream(stats));
        let mut harness = harness(state);
        harness.run_ok();
        for text in ["2,000 points in 3 nodes", "7 nodes", "Host bytes", "Point budget"] {
            assert!(harness.query_all_by_label(text).next().is_some(), "{text}");
        }
        assert!(harness.query_by_label_contains("0 of 12,345 points").is_some());
    }
}
