//! The ray-traced truth of the view in the window: what is asked of it, what is known of it, and what to do next.
//! `tasks` does the work; nothing here takes long.
//!
//! A frame that stands still passes through these steps: its scene is prepared for tracing (once, until points, colours
//! or splat size change), the render thread captures its images, and then workers trace it ever finer and judge it.
//! Each step names its frame, and results for another frame are never shown.

pub mod live;
pub mod sweep;
pub mod tracing;
pub mod tuning;
pub mod view;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use cloud::{PointTest, Progress};
use scene::Settings;
use serde_json::json;

use crate::shared::language::text;
use crate::viewer::frames::Frames;
use crate::viewer::jobs::tasks::{Answer, Judge, Measure, SceneKey, Source, Task, Trace};
use crate::viewer::objects::clouds::{CloudEntry, Samples};
use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::{Captured, Command};
use crate::viewer::requests::action::Look;
use crate::viewer::requests::messages::Level;
use crate::viewer::requests::outside::Outside;
use crate::viewer::requests::work::Work;
use crate::viewer::truth::live::REST;
use crate::viewer::truth::tracing::Tracing;
use crate::viewer::truth::tuning::Tuning;
use crate::viewer::truth::view::{Activity, Label, MOST_POINTS, Picture, Taken, Traced, TruthView, too_many_points};

/// What the truth reads from the session.
pub struct Around<'a> {
    pub clouds: &'a [CloudEntry],
    pub samples: &'a Samples,
    pub settings: &'a Settings,
    pub test: PointTest,
    pub frames: &'a Frames,
    /// The frame on the screen, if it is final.
    pub still: Option<FrameRequest>,
    pub raw_colors: bool,
    /// Whether a sweep or a wipe has the ray tracer.
    pub is_taken: bool,
}

impl Around<'_> {
    pub fn points(&self) -> u64 {
        traced_points(self.clouds, self.samples)
    }

    /// Everything that is visible, as sources of the scene to trace.
    pub fn sources(&self) -> Vec<Source> {
        Source::all(self.clouds, self.samples, self.settings, &self.test)
    }
}

/// The number of points to trace: all visible points, including those of mirrors.
pub fn traced_points(clouds: &[CloudEntry], samples: &Samples) -> u64 {
    let visible = clouds.iter().filter(|entry| entry.is_visible).map(|entry| entry.points);
    visible.sum::<u64>() + samples.points()
}

impl TruthView {
    /// Handles the key that shows the truth: it is pressed or released.
    pub fn hold(&mut self, is_held: bool, outside: &mut Outside) {
        if is_held != self.is_held {
            self.is_held = is_held;
            outside.log(json!({ "event": "truth_key", "down": is_held }));
        }
    }

    /// The reason why nothing is shown yet.
    pub fn awaited(&self, is_swept: bool, now: Instant) -> String {
        match self.activity(now) {
            _ if self.is_too_large => text!("too many points to trace the truth").into(),
            _ if is_swept => text!("the truth waits for the sweep").into(),
            _ if self.still.is_none() => text!("the truth waits for the picture to stand still").into(),
            Some(Activity::Building) => text!("the points are made ready for tracing the truth").into(),
            Some(Activity::Tracing { progress, .. }) => text!("the truth is being traced: {progress}", progress),
            None => text!("the truth is being traced").into(),
        }
    }

    /// Whether more points are visible than can be traced. A message is shown when this becomes true.
    fn has_too_many_points(&mut self, points: u64, outside: &mut Outside) -> bool {
        let is_too_large = points > MOST_POINTS;
        if is_too_large && !self.is_too_large {
            outside.say(Level::Warning, too_many_points());
        }
        self.is_too_large = is_too_large;
        is_too_large
    }

    /// Advances what is wanted of the truth by one step. Called every frame of the window. Returns the time after which
    /// to call again.
    pub fn sync(&mut self, around: &Around<'_>, tuning: &mut Tuning, outside: &mut Outside) -> Option<Duration> {
        let wanted = around.frames.requested.as_ref();
        let basis = wanted.map(FrameRequest::truth_basis);
        self.cancel_others(wanted, basis.as_ref());
        if self.asked_for.is_some() && self.asked_for != basis {
            self.asked_for = None;
        }
        if self.is_held {
            self.asked_for.clone_from(&basis);
        }
        let outdated = |key: &SceneKey| key.revision != around.frames.revision;
        self.building.iter().filter(|(key, _)| outdated(key)).for_each(|(_, progress)| progress.cancel());
        if self.scene.as_ref().is_some_and(|(key, _)| outdated(key)) {
            self.free();
        }
        if self.still.as_ref().map(|(known, _)| known) != around.still.as_ref() {
            self.still = around.still.clone().map(|request| (request, outside.now));
        }
        let is_judged = self.judges || tuning.is_open;
        if around.is_taken {
            return None;
        }
        if !(self.is_wanted() || is_judged) || self.has_too_many_points(around.points(), outside) {
            self.cancel();
            return None;
        }
        let (Some((request, since)), Some(basis)) = (self.still.clone(), basis) else { return None };
        let waited = outside.now.saturating_duration_since(since);
        if let Some(left) = REST.checked_sub(waited).filter(|left| !left.is_zero()) {
            return Some(left);
        }
        let tuning = Some(tuning).filter(|_| is_judged && !around.raw_colors);
        self.work_on(request, basis, around, tuning, outside);
        None
    }

    /// Starts the next step for a frame that stands still and that `tuning` wants judged.
    fn work_on(
        &mut self,
        request: FrameRequest,
        basis: FrameRequest,
        around: &Around<'_>,
        tuning: Option<&mut Tuning>,
        outside: &mut Outside,
    ) {
        let key = SceneKey::of(&request);
        let Some(scene) = self.scene(key) else { return self.build(key, || around.sources(), outside) };
        let drawn = self.captured.as_ref().filter(|(known, _)| *known == request);
        let Some(drawn) = drawn.map(|(_, drawn)| drawn.clone()) else {
            if self.capturing.as_ref() != Some(&request) {
                self.capturing = Some(request.clone());
                outside.render(Command::Capture { request: Box::new(request), origin: scene.origin });
            }
            return;
        };
        let mut tuning = tuning;
        if let Some(tuning) = &mut tuning
            && tuning.measure(&request, around.settings, || self.is_quiet(), outside)
        {
            return;
        }
        let judge = Judge { request: request.clone(), scene, drawn, progress: Arc::default() };
        // Judging takes less time than a step of tracing, and would otherwise wait behind it.
        self.judge(&judge, outside);
        self.trace(basis, &judge, outside);
        self.present(&judge, outside);
        if let (Some(figures), Some(tuning)) = (self.figures(&request), tuning) {
            tuning.note(&request, around.settings, figures);
        }
    }

    /// Prepares the points for tracing.
    pub fn build(&mut self, key: SceneKey, sources: impl FnOnce() -> Vec<Source>, outside: &mut Outside) {
        if let Some((building, progress)) = &self.building {
            // The task answers when it has ended.
            if *building != key {
                progress.cancel();
            }
            return;
        }
        let progress = Arc::<Progress>::default();
        self.building = Some((key, progress.clone()));
        outside.work(Work::Truth(Box::new(Task::Build { key, sources: sources(), progress })));
    }

    fn trace(&mut self, basis: FrameRequest, judge: &Judge, outside: &mut Outside) {
        let alone = !self.wants_picture(&basis);
        if let Some(tracing) = &self.tracing {
            // Either this frame is being traced already, or the task answers when it has ended.
            tracing.mirrors_alone.store(alone, Ordering::Relaxed);
            return;
        }
        let traced = self.traced.as_mut().filter(|traced| traced.pass.basis == basis);
        if traced.as_ref().is_some_and(|traced| traced.is_done[usize::from(!alone)]) {
            return;
        }
        let work = traced.as_ref().map(|traced| traced.pass.work);
        let refinement = traced.and_then(|traced| traced.refinement.take());
        let mirrors_alone = Arc::new(AtomicBool::new(alone));
        let tracing = Tracing::new(basis.clone(), mirrors_alone.clone(), work, outside.now);
        let progress = tracing.progress.clone();
        self.tracing = Some(tracing);
        let (scene, drawn) = (judge.scene.clone(), judge.drawn.clone());
        let trace = Trace { basis, scene, drawn, refinement, mirrors_alone, progress };
        outside.work(Work::Truth(Box::new(Task::Trace(Box::new(trace)))));
    }

    fn judge(&mut self, judge: &Judge, outside: &mut Outside) {
        let request = &judge.request;
        let Some(verdict) = self.verdict.as_ref().filter(|verdict| verdict.request == *request) else {
            if self.judging.is_none() {
                let judge = judge.anew();
                self.judging = Some((request.clone(), judge.progress.clone()));
                outside.work(Work::Truth(Box::new(Task::Judge(judge))));
            }
            return;
        };
        // Colours are compared only once the mirrors' truth is fully traced: earlier, its noise would count as an
        // error.
        let pass = self.traced.as_ref().map(|traced| &traced.pass);
        let pass = pass.filter(|pass| pass.samples[0] == pass.wanted_samples && pass.basis == request.truth_basis());
        if let (None, None, Some(pass)) = (verdict.figures.image, &self.comparing, pass) {
            let (judge, colors) = (judge.anew(), pass.colors.clone());
            self.comparing = Some((request.clone(), judge.progress.clone()));
            outside.work(Work::Truth(Box::new(Task::Compare { judge, colors })));
        }
    }

    /// Makes pictures for the screen from what was traced.
    fn present(&mut self, judge: &Judge, outside: &mut Outside) {
        let Judge { request, .. } = judge;
        let basis = request.truth_basis();
        if !self.wants_picture(&basis) {
            return;
        }
        let is_shown = |traced: &&Traced| traced.pass.basis == basis && traced.pass.is_whole;
        let Some(traced) = self.traced.as_ref().filter(is_shown) else { return };
        let (colors, pass) = (traced.pass.colors.clone(), traced.number);
        let label = Label { request: request.clone(), pass, measure: None };
        if self.presenting.is_none() && self.presented.as_ref().is_none_or(|(known, _)| *known != label) {
            self.presenting = Some(label);
            let (request, colors) = (Box::new(request.clone()), colors.clone());
            // The truth is as bright as the frame beside it.
            outside.render(Command::Present { request, colors, pass, fits_exposure: false });
        }
        let measure = self.measure;
        // Positions stay the same while colours become finer.
        let pass = if measure == Measure::Place { 0 } else { pass };
        let label = Label { request: request.clone(), pass, measure: Some(measure) };
        let is_asked_for = self.is_pinned && self.look == Look::Difference;
        let is_new = self.difference.as_ref().is_none_or(|(known, _)| *known != label);
        if is_asked_for && is_new && self.drawing.is_none() {
            let judge = judge.anew();
            self.drawing = Some((label, judge.progress.clone()));
            outside.work(Work::Truth(Box::new(Task::Difference { judge, measure, colors, pass })));
        }
    }

    /// Takes in the images of a frame that the render thread has captured.
    pub fn on_captured(&mut self, captured: Captured, revision: u64) {
        let is_current = self.is_of_scene(&captured.request, revision);
        if self.capturing.as_ref() == Some(&captured.request) {
            self.capturing = None;
            self.captured = Some((captured.request, Arc::new(captured.drawn))).filter(|_| is_current);
        }
    }

    /// Whether results for a frame are still useful: changed points, or Stop, have freed its scene.
    fn is_of_scene(&self, request: &FrameRequest, revision: u64) -> bool {
        let scene = self.scene.as_ref();
        request.revision == revision && scene.is_some_and(|(key, _)| key.revision == revision)
    }

    /// Takes in a picture of the truth that the render thread has made.
    pub fn on_presented(
        &mut self,
        request: FrameRequest,
        pass: u32,
        rgba: Vec<u8>,
        revision: u64,
        outside: &mut Outside,
    ) {
        self.presenting = None;
        if !self.is_of_scene(&request, revision) {
            return;
        }
        let (size, label) = (request.size, Label { request, pass, measure: None });
        outside.log(json!({ "event": "truth", "pass": pass }));
        self.presented = Some((label, Picture::new(size, rgba)));
    }

    /// Notes that a request to the render thread has failed.
    pub fn on_not_judged(&mut self) {
        (self.capturing, self.presenting) = (None, None);
    }

    /// Takes in a worker's answer; returns what it means outside of the truth.
    pub fn on_answer(&mut self, answer: Answer, revision: u64) -> Taken {
        let is_current = match answer.request() {
            Some(request) => self.is_of_scene(request, revision),
            None => answer.revision().is_none_or(|known| known == revision),
        };
        self.take(answer, is_current)
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT as _, Queryable as _};
    use param::Choice as _;

    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::jobs::tasks::Kind;
    use crate::viewer::look::tab::Tab;
    use crate::viewer::picture::messages::Report;
    use crate::viewer::requests::action::Action;
    use crate::viewer::session::Session;

    fn harness(mut bench: Bench) -> Harness<'static, Bench> {
        bench.session.act(Action::OpenTab(Tab::Tuning));
        let mut harness = Harness::builder()
            .with_size([420.0, 5000.0])
            .with_max_steps(16)
            .build_ui_state(|ui, bench: &mut Bench| bench.show(ui), bench);
        harness.run_ok();
        harness
    }

    /// Whether the picture shows the truth of the frame on the screen.
    fn is_shown(session: &Session) -> bool {
        let frame = session.truth.frame(&session.frames, session.scene.camera, session.scene.view_size);
        frame.is_some_and(|request| session.truth.picture(&request).is_some())
    }

    #[test]
    fn the_key_shows_the_truth_of_this_view_alone_and_judges_it() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        assert!(!is_shown(&bench.session) && bench.session.truth.scene.is_none(), "nobody has asked for it");
        let mut harness = harness(bench);
        harness.key_down(egui::Key::X);
        harness.run_ok();
        assert!(harness.state().session.truth.is_held);
        harness.state_mut().settle();
        let Bench { session, .. } = harness.state_mut();
        assert!(is_shown(session));
        let request = session.still_frame().cloned().unwrap();
        let (samples, wanted) = session.truth.samples(&request).unwrap();
        assert_eq!((samples, wanted), ([4, 4], 4), "as many paths as trace.samples says");
        let figures = session.truth.figures(&request).unwrap();
        assert!(figures.mirror_pixels > 100 && figures.pixel_error.p95 < 3.0, "{figures:?}");
        assert!(figures.image.is_some_and(|image| image.delta_e < 10.0), "{figures:?}");

        // Another method has the same truth, which is not traced again, and different figures.
        let number = session.truth.traced.as_ref().map(|traced| traced.number);
        session.scene.settings.reflection.method = scene::Method::None;
        harness.state_mut().settle();
        let Bench { session, .. } = harness.state_mut();
        let other = session.still_frame().cloned().unwrap();
        assert_eq!(session.truth.traced.as_ref().map(|traced| traced.number), number);
        assert!(is_shown(session) && session.truth.figures(&request).is_none());
        assert_eq!(session.truth.figures(&other).unwrap().coverage, 0.0);

        // A turning view has no truth until it stands still again.
        session.scene.camera.orbit(0.3, 0.1);
        assert!(!is_shown(session));
        harness.state_mut().settle();
        assert!(is_shown(&harness.state().session));
        harness.key_up(egui::Key::X);
        harness.run_ok();
        assert!(!is_shown(&harness.state().session));
    }

    #[test]
    fn a_pinned_truth_stays_splits_and_tells_where_the_picture_is_wrong() {
        let Some(bench) = Bench::with_sphere() else { return };
        let mut harness = harness(bench);
        harness.get_by_label("Pin").click();
        harness.run_ok();
        harness.state_mut().settle();
        harness.run_ok();
        assert!(is_shown(&harness.state().session));
        harness.get_by_label("Difference").click();
        harness.run_ok();
        harness.get_by_label("Place").click();
        harness.run_ok();
        harness.state_mut().settle();
        let Bench { session, .. } = harness.state_mut();
        let request = session.still_frame().cloned().unwrap();
        let clear = |picture: &Picture| picture.rgba.as_chunks::<4>().0.iter().filter(|rgba| rgba[3] == 0).count();
        let of_mirrors = clear(session.truth.difference(&request).unwrap());
        session.truth.measure = Measure::Color;
        assert!(session.truth.difference(&request).is_none(), "a heat map of places is none of colours");
        harness.state_mut().settle();
        let Bench { session, .. } = harness.state_mut();
        let of_all = clear(session.truth.difference(&request).unwrap());
        assert!(of_mirrors > of_all, "{of_mirrors} {of_all}");

        // When points are removed, everything made from them is removed.
        let keys: Vec<_> = session.loaded.clouds.iter().map(|entry| entry.key).collect();
        keys.into_iter().for_each(|key| session.with_loaded(|loaded, beside| loaded.remove_cloud(key, beside)));
        harness.state_mut().settle();
        let Bench { session, .. } = harness.state_mut();
        assert!(
            !is_shown(session) && session.truth.scene.is_none() && session.truth.activity(Instant::now()).is_none()
        );
    }

    #[test]
    fn settings_that_were_tried_are_dots_and_a_click_goes_back_to_one() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.session.act(Action::ToggleChart);
        bench.settle();
        bench.session.scene.settings.reflection.method = scene::Method::Sscr;
        bench.settle();
        bench.session.scene.history.watch(
            &bench.session.scene.settings,
            &bench.session.scene.objects,
            false,
            bench.session.outside.now,
        );
        let request = bench.session.still_frame().cloned().unwrap();
        let [frame, method] = bench.session.tuning.times(&request).unwrap();
        assert!(frame > method && method > 0.0, "{frame} {method}");
        let mut harness = harness(bench);
        // Finds the row of the setting before this one.
        let is_row = |text: &str| text.contains(" ms of ") && !text.contains("= sscr");
        let row = harness.get_all_by_label_contains("pixels");
        let row = row.into_iter().find(|row| row.accesskit_node().label().is_some_and(|text| is_row(&text)));
        row.unwrap().click();
        harness.run_ok();
        let Bench { session, .. } = harness.state_mut();
        assert_eq!(session.scene.settings.reflection.method.name(), scene::Method::Auto.name());
        session.act(Action::Undo);
        assert_eq!(session.scene.settings.reflection.method, scene::Method::Sscr);
    }

    #[test]
    fn more_points_than_are_traced_are_a_message_and_not_a_wait() {
        let mut session = Session::with_two_points();
        let has_too_many = |session: &mut Session| {
            let points = traced_points(&session.loaded.clouds, &session.loaded.samples);
            session.truth.has_too_many_points(points, &mut session.outside)
        };
        session.loaded.clouds[0].points = MOST_POINTS + 1;
        assert!(has_too_many(&mut session));
        // Points are added, as while a file is read.
        session.loaded.clouds[0].points += 1000;
        assert!(has_too_many(&mut session));
        let told = session.outside.messages.all.iter().filter(|message| message.text.contains("30,000,000")).count();
        assert_eq!(told, 1);
        session.loaded.clouds[0].is_visible = false;
        assert!(!has_too_many(&mut session), "points that are hidden are not traced");
        session.loaded.clouds[0].is_visible = true;
        session.loaded.clouds[0].points = MOST_POINTS;
        assert!(!has_too_many(&mut session));
    }

    #[test]
    fn unpinning_ends_tracing() {
        let mut session = Session::with_two_points();
        let basis = FrameRequest::any().truth_basis();
        session.frames.requested = Some(basis.clone());
        let tracing = Tracing::new(basis, Arc::default(), None, Instant::now());
        let progress = tracing.progress.clone();
        (session.truth.is_pinned, session.truth.tracing) = (true, Some(tracing));
        session.sync_truth();
        assert!(!progress.is_cancelled());
        session.act(Action::PinTruth);
        session.sync_truth();
        assert!(progress.is_cancelled());
    }

    /// Reports a picture of the truth, as the render thread does.
    fn present(session: &mut Session, request: FrameRequest) {
        let rgba = vec![255; 64 * 48 * 4];
        session.on_report(Report::Presented { request: Box::new(request), pass: 99, rgba });
    }

    #[test]
    fn an_answer_that_comes_too_late_is_not_shown() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.session.act(Action::PinTruth);
        bench.settle();
        let session = &mut bench.session;
        let old = session.still_frame().cloned().unwrap();
        let figures = session.truth.figures(&old).cloned().unwrap();
        assert!(is_shown(session) && session.truth.bytes() > 64 * 48 * 200);
        session.scene.camera.orbit(0.3, 0.1);
        present(session, old.clone());
        assert!(!is_shown(session), "of a view that was left");
        bench.settle();
        assert!(is_shown(&bench.session));

        // The points are gone, so nothing is kept.
        let session = &mut bench.session;
        session.with_loaded(|loaded, beside| loaded.set_visible(loaded.clouds[0].key, false, beside));
        let progress = Arc::<Progress>::default();
        session.truth.judging = Some((old.clone(), progress.clone()));
        session.sync_truth();
        assert!(progress.is_cancelled());
        session.truth.verdict = None;
        session.on_truth(Answer::Judged { request: old.clone(), result: Ok(Box::new(figures)) });
        assert!(session.truth.verdict.is_none() && session.truth.judging.is_none());
        present(session, old);
        assert!(session.truth.presented.is_none());
    }

    #[test]
    fn a_worker_that_fails_is_told_and_leaves_nothing_waiting() {
        let mut session = Session::with_two_points();
        let key = SceneKey { revision: session.frames.revision, splat_size: 0 };
        (session.truth.is_pinned, session.truth.building) = (true, Some((key, Arc::default())));
        session.on_truth(Answer::Failed(Kind::Build));
        assert!(session.truth.building.is_none() && !session.truth.is_pinned);
        assert!(session.outside.messages.all.iter().any(|message| message.text.contains("stopped unexpectedly")));
    }
}
