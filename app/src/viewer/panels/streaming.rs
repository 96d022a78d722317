//! The panel of streamed clouds: the state of their indexes, how much of them is loaded, what is being loaded, and the
//! budgets.

use std::time::Duration;

use egui::{Color32, RichText, Ui};
use world::{CloudKey, CloudTask, IndexEntry, IndexState, StreamStats, TaskKind, TaskStatus, half_of, most_points};

use crate::shared::language::text;
use crate::viewer::look::theme;
use crate::viewer::look::theme::grouped;
use crate::viewer::look::widgets::{progress_bar, progress_text};
use crate::viewer::objects::clouds::{CloudEntry, Streamed};
use crate::viewer::panels;
use crate::viewer::requests::action::Action;
use crate::viewer::session::Session;

pub fn show(ui: &mut Ui, session: &Session, actions: &mut Vec<Action>) {
    for entry in &session.loaded.clouds {
        if let Some(streamed) = &entry.streamed {
            ui.push_id(entry.key.0, |ui| cloud(ui, session, entry, streamed, actions));
        }
    }
    // Only jobs that have something to report.
    let jobs = || session.loaded.jobs.iter().filter(|job| job.has_streamed && job.stream.points_total > 0);
    for job in jobs() {
        if jobs().count() > 1 {
            weak(ui, text!("what is there of {job}", job = job.name));
        }
        let points =
            (most_points(&session.scene.settings.view, &session.scene.settings.stream) as f64 * job.share) as u64;
        let bytes = (half_of(session.scene.settings.stream.host_bytes) as f64 * job.share) as u64;
        ui.push_id(job.id, |ui| figures(ui, &job.stream, points, bytes));
        ui.add_space(4.0);
    }
    panels::parameters::parameter(ui, &session.scene.settings.view, "point_budget", actions);
    panels::parameters::parameters(ui, &session.scene.settings.stream, &[], actions);
    if let Some(size) = session.loaded.cache_size {
        let most = session.scene.settings.stream.cache_bytes;
        weak(ui, text!("All indexes take {size} of {most}", size = theme::bytes(size), most));
    }
}

fn weak(ui: &mut Ui, text: impl Into<String>) {
    ui.label(RichText::new(text).small().color(theme::WEAK));
}

/// Shows the state of a cloud's index.
fn cloud(ui: &mut Ui, session: &Session, entry: &CloudEntry, streamed: &Streamed, actions: &mut Vec<Action>) {
    ui.add(egui::Label::new(RichText::new(&entry.cloud.name).strong()).truncate());
    let stage = entry.task.as_deref();
    let made = |making: TaskKind| stage.filter(|stage| stage.kind == making);
    match &entry.pages {
        None | Some(IndexState::Indexing) => match made(TaskKind::Index).map(|stage| (stage, stage.status())) {
            Some((_, TaskStatus::Stopped)) => {
                let help = text!("Make the index after all, from its beginning");
                resume(ui, session, entry.key, text!("no index: what is shown is a preview"), help, actions);
            }
            Some((stage, _)) if stage.is_pending() => {
                let help = text!("Stop; nothing is kept of the index, and the preview stays");
                pending(ui, entry.key, stage, help, actions);
            }
            Some(_) => weak(ui, text!("no index")),
            None => weak(ui, text!("its index will be made next")),
        },
        Some(IndexState::Indexed { has_surfels, was_built, entry: kept, .. }) => {
            let origin = match kept {
                Some(_) if *was_built => text!("indexed now"),
                Some(_) => text!("the index was there"),
                None => text!("brings its own index"),
            };
            weak(
                ui,
                text!(
                    "{points} of {total} points · {origin}",
                    points = grouped(entry.points),
                    total = grouped(entry.total()),
                    origin
                ),
            );
            let ready = match kept {
                Some(_) => text!("ready, without normals and radii"),
                None => text!("ready; normals and radii are those of what is there"),
            };
            match made(TaskKind::Surfels).map(|stage| (stage, stage.status())) {
                _ if *has_surfels => weak(ui, text!("ready, with normals and radii of all points")),
                Some((stage, _)) if stage.is_pending() => {
                    let help = text!("Stop; what is done is kept for the next time");
                    pending(ui, entry.key, stage, help, actions);
                }
                Some((_, TaskStatus::Stopped)) => {
                    resume(
                        ui,
                        session,
                        entry.key,
                        ready,
                        text!("Go on with normals and radii where they were stopped"),
                        actions,
                    );
                }
                _ => weak(ui, ready),
            }
            if let Some(kept) = kept {
                index(ui, entry.key, kept, actions);
            }
            if session.scene.settings.stream.overlay {
                legend(ui, streamed);
            }
        }
    }
    ui.add_space(4.0);
}

/// Shows a task that is queued or under way, with a button to stop it.
fn pending(ui: &mut Ui, key: CloudKey, stage: &CloudTask, help: &str, actions: &mut Vec<Action>) {
    ui.ctx().request_repaint_after(Duration::from_millis(250));
    let (verb, noun) = match stage.kind {
        TaskKind::Index => (text!("indexing"), text!("index")),
        TaskKind::Surfels => (text!("normals"), text!("normals")),
    };
    let standing = stage.status();
    ui.horizontal(|ui| {
        match standing {
            TaskStatus::Queued => drop(ui.label(text!("its {noun} will be made next", noun))),
            TaskStatus::Elsewhere => drop(ui.label(text!("another program is making its {noun}", noun))),
            _ => {
                ui.label(format!("{verb} {:.0} %", stage.share() * 100.0));
                progress_bar(ui, stage.share() as f32);
            }
        }
        if ui.small_button(text!("Stop")).on_hover_text(help).clicked() {
            actions.push(Action::StopMaking(key));
        }
    });
    if standing == TaskStatus::UnderWay {
        weak(ui, progress_text(stage.done(), stage.points(), stage.pace()));
    }
}

/// Shows what a stopped task left, with a button to resume it.
fn resume(ui: &mut Ui, session: &Session, key: CloudKey, text: &str, help: &str, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        weak(ui, text);
        if session.loaded.job_of(key).is_some() && ui.small_button(text!("Resume")).on_hover_text(help).clicked() {
            actions.push(Action::ResumeMaking(key));
        }
    });
}

/// Shows the size of a cloud's index in the cache, with buttons to copy its path and to delete it.
fn index(ui: &mut Ui, key: CloudKey, kept: &IndexEntry, actions: &mut Vec<Action>) {
    let folder = kept.folder.display().to_string();
    ui.horizontal(|ui| {
        ui.label(RichText::new(text!("index: {kept}", kept = theme::bytes(kept.bytes))).small()).on_hover_text(&folder);
        if ui.small_button(text!("Copy path")).on_hover_text(&folder).clicked() {
            actions.push(Action::Copy(folder.clone()));
        }
        ui.menu_button(RichText::new(text!("Delete…")).small(), |ui| {
            ui.set_max_width(260.0);
            ui.label(text!(
                "The cloud is closed and {kept} are free. Its files stay as they are; when they are \
                opened again, the index is made anew.",
                kept = theme::bytes(kept.bytes)
            ));
            if ui.button(text!("Close cloud and delete index")).clicked() {
                actions.push(Action::DeleteIndex(key));
                ui.close();
            }
        });
    });
}

/// Shows the colours of the levels.
fn legend(ui: &mut Ui, streamed: &Streamed) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        weak(ui, text!("level, coarse to fine "));
        for (level, [red, green, blue, _]) in streamed.levels() {
            let luminance = 0.3 * f32::from(red) + 0.6 * f32::from(green) + 0.1 * f32::from(blue);
            let ink = if luminance > 110.0 { Color32::BLACK } else { Color32::WHITE };
            let text = RichText::new(format!(" {level} ")).small().color(ink);
            ui.label(text.background_color(Color32::from_rgb(red, green, blue)));
        }
    });
}

/// Shows what is loaded of the clouds of a job, and what is being loaded.
fn figures(ui: &mut Ui, stats: &StreamStats, points: u64, bytes: u64) {
    let lines = [
        (text!("Points"), text!("{done} of {total}", done = grouped(stats.points_resident), total = grouped(points))),
        (text!("Nodes"), grouped(stats.nodes as u64)),
        (
            text!("Memory"),
            text!("{done} of {total}", done = theme::bytes(stats.host_bytes), total = theme::bytes(bytes)),
        ),
        (text!("Waiting"), text!("{nodes_waiting} nodes", nodes_waiting = grouped(stats.nodes_waiting as u64))),
        (text!("Disk"), format!("{}/s", theme::bytes(stats.disk_bytes_per_second as u64))),
        (text!("Decoded"), text!("{speed} M points/s", speed = format_args!("{:.2}", stats.points_per_second / 1e6))),
    ];
    let [open, needed, all] = stats.tiles;
    let tiles = (all > 0).then(|| {
        (
            text!("Tiles"),
            text!("{open} of {needed} in view", open = grouped(open as u64), needed = grouped(needed as u64)),
        )
    });
    let help = text!(
        "What this may have of the budgets; decoded points take half of stream.host_bytes, making indexes the other half"
    );
    let grid = egui::Grid::new("streaming").num_columns(2).spacing([16.0, 2.0]).show(ui, |ui| {
        for (name, text) in lines.into_iter().chain(tiles) {
            ui.label(RichText::new(name).small());
            ui.label(RichText::new(text).small().monospace());
            ui.end_row();
        }
    });
    grid.response.on_hover_text(help);
}

#[cfg(test)]
pub mod tests {
    use std::sync::Arc;

    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;
    use world::{Event, IndexRequest, Mailbox, Opened, Part};

    use super::*;
    use crate::viewer::loaded::Loaded;
    use crate::viewer::requests::outside::Effect;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::requests::work::{Found, Work};

    /// Two clouds of job 0: the index of the first is being made, that of the second is next.
    pub fn indexing() -> (Session, [Arc<CloudTask>; 2]) {
        let mut session = Session::new(Preferences::default());
        let mailbox = Arc::<Mailbox>::default();
        session.loaded.add_job(&[], Arc::default(), mailbox.clone(), session.outside.now);
        let stages = ["survey.laz", "town.laz"].map(|name| {
            let cloud = session.loaded.clouds.len();
            let (name, input, up) = (name.into(), name.into(), glam::DVec3::Z);
            let opened = Opened { name, input, expected_points: 200, up, ..Opened::default() };
            session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Opened { cloud, opened }, beside));
            session.with_loaded(|loaded, beside| {
                loaded.on_loading(0, Event::Pages { cloud, pages: IndexState::Indexing }, beside)
            });
            let stage = mailbox.plan(cloud, CloudTask::new(TaskKind::Index, 200));
            session
                .with_loaded(|loaded, beside| loaded.on_loading(0, Event::Task { cloud, task: stage.clone() }, beside));
            stage
        });
        stages[0].begin();
        stages[0].progress.set_total(400);
        stages[0].progress.add(172);
        (session, stages)
    }

    /// The index of a cloud of 12,345 points in two levels.
    fn indexed(has_surfels: bool) -> IndexState {
        let node = |level, parent: Option<u32>| stream::Node {
            level,
            bounds: cloud::Bounds::EMPTY,
            points: 200,
            is_exact: false,
            total: 12_345,
            first_point: 200 * u64::from(level),
            parent: parent.map(stream::NodeId),
            children: [None; 8],
        };
        let nodes = vec![node(0, None), node(1, Some(0))];
        let octree = stream::Octree::new(glam::DVec3::ZERO, 1.0, 1.0, nodes);
        let kept = Some(IndexEntry { folder: "/cache/0123".into(), bytes: 1_700_000 });
        let attributes = Vec::new();
        IndexState::Indexed {
            octree: Arc::new(octree),
            attributes,
            grid: None,
            was_built: true,
            has_surfels,
            entry: kept,
        }
    }

    fn harness(session: Session) -> Harness<'static, Session> {
        Harness::builder().with_size([360.0, 700.0]).build_ui_state(
            |ui, session: &mut Session| session.show_and_act(|session, actions| show(ui, session, actions)),
            session,
        )
    }

    #[test]
    fn each_index_tells_how_far_it_is_and_is_stopped_and_resumed_by_itself() {
        let (session, stages) = indexing();
        let mut harness = harness(session);
        harness.run_ok();
        assert!(harness.query_by_label("indexing 43 %").is_some());
        assert!(harness.query_by_label("its index will be made next").is_some());
        let stop = harness.query_all_by_label("Stop").next().unwrap();
        stop.click();
        harness.run_ok();
        assert_eq!(stages.each_ref().map(|stage| stage.status()), [TaskStatus::Stopped, TaskStatus::Queued]);
        stages[1].begin();
        stages[1].progress.set_waiting(true);
        harness.run_ok();
        assert!(harness.query_by_label("another program is making its index").is_some());
        // What a stopped task left is also shown when no work is under way.
        let chunk = cloud::Chunk::new(0, glam::DVec3::ZERO, vec![[0.0; 3]]);
        let (mut session, _) = indexing();
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Chunk { cloud: 0, part: Part::Preview(0), chunk }, beside)
        });
        session.with_loaded(Loaded::stop_loading);
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Finished, beside));
        let mut harness = self::harness(session);
        harness.run_ok();
        assert!(harness.query_by_label("no index: what is shown is a preview").is_some());
    }

    #[test]
    fn the_status_says_that_what_is_shown_is_a_preview() {
        let text = |has_preview: bool| {
            let (mut session, _) = indexing();
            if has_preview {
                let chunk = cloud::Chunk::new(0, glam::DVec3::ZERO, vec![[0.0; 3]]);
                let event = Event::Chunk { cloud: 0, part: Part::Preview(0), chunk };
                session.with_loaded(|loaded, beside| loaded.on_loading(0, event, beside));
            }
            let mut harness = Harness::builder().with_size([1100.0, 800.0]).build_ui_state(
                |ui, session: &mut Session| drop(crate::viewer::interface::show(ui, session, None)),
                session,
            );
            harness.run_ok();
            ["indexing survey.laz: 43 %", "a preview is shown, indexing survey.laz: 43 %"]
                .map(|text| harness.query_by_label(text).is_some())
        };
        assert_eq!([text(false), text(true)], [[true, false], [false, true]]);
    }

    #[test]
    fn what_was_stopped_is_resumed() {
        let (mut session, _) = indexing();
        session.with_loaded(Loaded::stop_loading);
        let mailbox = session.loaded.jobs[0].mailbox.clone();
        let mut harness = harness(session);
        harness.run_ok();
        harness.query_all_by_label("Resume").nth(1).unwrap().click();
        harness.run_ok();
        assert_eq!(mailbox.wait_for_requests(), Some(vec![IndexRequest::Resume(1)]));
        assert!(harness.query_by_label("its index will be made next").is_some());
        assert!(mailbox.plan(1, CloudTask::new(TaskKind::Index, 200)).is_pending(), "the stop is over");
    }

    #[test]
    fn what_is_there_of_a_streamed_cloud_is_told_beside_its_budgets() {
        let (mut session, _) = indexing();
        session.scene.settings.stream.overlay = true;
        session.scene.settings.stream.host_bytes = param::Bytes(500_000_000);
        session.scene.settings.view.point_budget = 1_000_000;
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Pages { cloud: 0, pages: indexed(true) }, beside)
        });
        let stats = StreamStats {
            nodes: 3,
            points_total: 12_345,
            points_resident: 2_000,
            nodes_waiting: 7,
            ..StreamStats::default()
        };
        session.with_loaded(|loaded, beside| loaded.on_loading(0, Event::Stream(stats), beside));
        session.on_found(Found::CacheSize(3_000_000_000));
        let mut harness = harness(session);
        harness.run_ok();
        let lines = ["2,000 of 1,000,000", "7 nodes", "0 kB of 250 MB", "index: 1 MB", "Host bytes"];
        for text in lines.into_iter().chain(["Point budget", "All indexes take 3.00 GB of 50GiB", " 0 ", " 1 "]) {
            assert!(harness.query_all_by_label(text).next().is_some(), "{text}");
        }
        assert!(harness.query_by_label_contains("0 of 12,345 points").is_some());
    }

    #[test]
    fn an_index_is_deleted_with_its_cloud() {
        let (mut session, _) = indexing();
        session.with_loaded(|loaded, beside| {
            loaded.on_loading(0, Event::Pages { cloud: 0, pages: indexed(true) }, beside)
        });
        let key = session.loaded.clouds[0].key;
        let mut harness = harness(session);
        harness.run_ok();
        harness.get_by_label("Delete…").click();
        harness.run_ok();
        harness.get_by_label("Close cloud and delete index").click();
        harness.run_ok();
        let session = harness.state();
        assert!(session.loaded.cloud(key).is_none() && session.loaded.clouds.len() == 1);
        let is_deletion = |effect: &Effect| matches!(effect, Effect::Work(Work::DeleteIndex(kept)) if kept.folder.as_path() == std::path::Path::new("/cache/0123"));
        assert!(session.outside.effects.iter().any(is_deletion));
        assert!(session.loaded.jobs[0].mailbox.is_closed(0));
    }
}
