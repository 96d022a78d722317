//! The ray-traced truth of the view in the window: what is asked of it, what there is of it, and what is to be done next. The work
//! itself is `truth_tasks`; here nothing takes time.
//!
//! A frame that stands still goes these ways: its scene is made ready for tracing (once, until points, colours or splat size
//! change), the render thread hands over its images, and then it is traced ever finer and judged. All of it names the frame that it
//! is about, and nothing that is about another frame is shown.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use cloud::Progress;
use render::ColorPlan;
use serde_json::json;

use super::messages::Level;
use super::render_thread::{Captured, Command, FrameRequest};
use super::state::{Effect, State};
use super::truth_tasks::{Answer, Judge, Measure, SceneKey, Source, Task, Trace};
use super::truth_view::{Label, Look, MOST_POINTS, Picture, Taken, Traced, Tracing, too_many_points};
use super::work::Work;

/// A frame that has stood still for so long is worth work: on the way of a slider there are many that nobody means.
const REST: Duration = Duration::from_millis(200);

impl State {
    /// Holds or releases the truth's key.
    pub fn hold_truth(&mut self, is_held: bool) {
        if is_held && !self.truth.is_held && self.clouds.is_empty() {
            return;
        }
        if is_held != self.truth.is_held {
            self.truth.is_held = is_held;
            self.log(json!({ "event": "truth_key", "down": is_held }));
        }
    }

    pub fn toggle_truth(&mut self) {
        self.truth.is_pinned = !self.truth.is_pinned;
    }

    /// Why nothing is shown yet.
    pub fn truth_is_awaited(&self) -> &'static str {
        match () {
            () if self.truth.is_too_large => "too many points to trace the truth",
            () if self.sweep.is_some() => "the truth waits for the sweep",
            () if self.truth.still.is_none() => "the truth waits for the picture to stand still",
            () => "the truth is being traced",
        }
    }

    /// The frame whose truth belongs in the picture now. None where the view has moved on and its picture is still to come: what was
    /// traced is of another.
    pub fn truth_frame(&self) -> Option<FrameRequest> {
        let request = &self.frames.shown.as_ref().filter(|_| self.truth.is_asked_for())?.request;
        let is_current = request.camera == self.camera && request.size == self.view_size && !request.hurried;
        is_current.then(|| request.clone())
    }

    /// Points that are shown, those of mirrors included: as many are traced.
    pub fn traced_points(&self) -> u64 {
        let of_mirrors =
            self.samples.of.values().flat_map(|sample| &sample.chunks).map(|(chunk, _)| chunk.len() as u64);
        let visible = self.clouds.iter().filter(|entry| entry.is_visible).map(|entry| entry.points);
        visible.chain(of_mirrors).sum()
    }

    /// Whether more points are shown than are traced, which is said when it begins to be so.
    fn has_too_many_points(&mut self) -> bool {
        let is_too_large = self.traced_points() > MOST_POINTS;
        if is_too_large && !self.truth.is_too_large {
            self.say(Level::Warning, too_many_points());
        }
        self.truth.is_too_large = is_too_large;
        is_too_large
    }

    /// Ends all that is under way for the truth, the chart and a sweep.
    pub fn stop_truth(&mut self) {
        self.truth.stop();
        self.tuning.is_open = false;
        self.stop_sweep();
    }

    /// Takes what is wanted of the truth one step on; called every frame of the window. Returns when to look again.
    pub fn sync_truth(&mut self) -> Option<Duration> {
        let basis = self.wanted_frame().map(FrameRequest::truth_basis);
        let wanted = self.frames.requested.as_ref();
        let truth = &mut self.truth;
        truth.cancel_others(wanted, basis.as_ref());
        if truth.asked_for.is_some() && truth.asked_for != basis {
            truth.asked_for = None;
        }
        if truth.is_held {
            truth.asked_for.clone_from(&basis);
        }
        let revision = self.frames.revision;
        let outdated = |key: &SceneKey| key.revision != revision;
        truth.building.iter().filter(|(key, _)| outdated(key)).for_each(|(_, progress)| progress.cancel());
        if truth.scene.as_ref().is_some_and(|(key, _)| outdated(key)) {
            truth.free();
        }
        let still = self.still_frame().cloned();
        if self.truth.still.as_ref().map(|(known, _)| known) != still.as_ref() {
            self.truth.still = still.map(|request| (request, self.now));
        }
        let is_judged = self.truth.judges || self.tuning.is_open;
        if self.sweep.is_some() {
            return None;
        }
        if !(self.truth.is_wanted() || is_judged) || self.has_too_many_points() {
            self.truth.cancel();
            return None;
        }
        let (Some((request, since)), Some(basis)) = (self.truth.still.clone(), basis) else { return None };
        if let Some(left) = REST.checked_sub(self.now.saturating_duration_since(since)).filter(|left| !left.is_zero()) {
            return Some(left);
        }
        self.work_on_truth(request, basis, is_judged);
        None
    }

    /// The next step for a frame that stands still.
    fn work_on_truth(&mut self, request: FrameRequest, basis: FrameRequest, is_judged: bool) {
        let key = SceneKey::of(&request);
        let Some(scene) = self.truth.scene(key) else { return self.build_truth(key) };
        let truth = &mut self.truth;
        let Some(drawn) =
            truth.captured.as_ref().filter(|(known, _)| *known == request).map(|(_, drawn)| drawn.clone())
        else {
            if truth.capturing.as_ref() != Some(&request) {
                truth.capturing = Some(request.clone());
                let (request, origin) = (Box::new(request), scene.origin);
                self.render(Command::Capture { request, origin });
            }
            return;
        };
        if is_judged && !self.raw_colors && self.measure(&request) {
            return;
        }
        let judge = Judge { request: request.clone(), scene, drawn, progress: Arc::default() };
        // It takes less time than a step of tracing, which it would wait behind.
        self.judge(&judge);
        self.trace(basis, &judge);
        self.present(&judge);
        if let Some(figures) = self.truth.figures(&request).filter(|_| is_judged && !self.raw_colors) {
            self.tuning.note(&request, &self.settings, figures);
        }
    }

    /// Makes the points ready to be traced.
    pub fn build_truth(&mut self, key: SceneKey) {
        if let Some((building, progress)) = &self.truth.building {
            // It answers when it has ended.
            if *building != key {
                progress.cancel();
            }
            return;
        }
        let test = self.objects.visibility.test();
        let clouds = self.clouds.iter().filter(|entry| entry.is_visible).map(|entry| {
            let (cloud, up) = (entry.cloud.clone(), entry.up);
            let plan = entry.figures.as_ref().map(|figures| figures.plan.clone());
            let plan = plan.unwrap_or_else(|| ColorPlan::new(&cloud.shown(&test), &self.settings.color, up).0);
            Source::Cloud { cloud, plan, up, marked: entry.marks.clone(), test }
        });
        let mirrors = self.samples.of.values().map(|sample| {
            let chunks = sample.chunks.iter().map(|(chunk, _)| chunk.clone()).collect();
            Source::Mirror { mirror: sample.mirror.clone(), chunks }
        });
        let sources = clouds.chain(mirrors).collect();
        let progress = Arc::<Progress>::default();
        self.truth.building = Some((key, progress.clone()));
        self.effects.push(Effect::Work(Work::Truth(Box::new(Task::Build { key, sources, progress }))));
    }

    fn trace(&mut self, basis: FrameRequest, judge: &Judge) {
        let truth = &mut self.truth;
        let alone = !truth.wants_picture(&basis);
        if let Some(tracing) = &truth.tracing {
            // Either this very frame's, or it answers when it has ended.
            tracing.mirrors_alone.store(alone, Ordering::Relaxed);
            return;
        }
        let traced = truth.traced.as_mut().filter(|traced| traced.pass.basis == basis);
        if traced.as_ref().is_some_and(|traced| traced.is_done[usize::from(!alone)]) {
            return;
        }
        let refinement = traced.and_then(|traced| traced.refinement.take());
        let (progress, mirrors_alone) = (Arc::<Progress>::default(), Arc::new(AtomicBool::new(alone)));
        let tracing =
            Tracing { basis: basis.clone(), progress: progress.clone(), mirrors_alone: mirrors_alone.clone() };
        truth.tracing = Some(tracing);
        let (scene, drawn) = (judge.scene.clone(), judge.drawn.clone());
        let trace = Trace { basis, scene, drawn, refinement, mirrors_alone, progress };
        self.effects.push(Effect::Work(Work::Truth(Box::new(Task::Trace(Box::new(trace))))));
    }

    fn judge(&mut self, judge: &Judge) {
        let truth = &mut self.truth;
        let request = &judge.request;
        let Some(verdict) = truth.verdict.as_ref().filter(|verdict| verdict.request == *request) else {
            if truth.judging.is_none() {
                let judge = judge.anew();
                truth.judging = Some((request.clone(), judge.progress.clone()));
                self.effects.push(Effect::Work(Work::Truth(Box::new(Task::Judge(judge)))));
            }
            return;
        };
        // Colours are compared when the mirrors' truth is as fine as it gets: noise would count as an error.
        let pass = truth.traced.as_ref().map(|traced| &traced.pass);
        let pass = pass.filter(|pass| pass.samples[0] == pass.wanted_samples && pass.basis == request.truth_basis());
        if let (None, None, Some(pass)) = (verdict.figures.image, &truth.comparing, pass) {
            let (judge, colors) = (judge.anew(), pass.colors.clone());
            truth.comparing = Some((request.clone(), judge.progress.clone()));
            self.effects.push(Effect::Work(Work::Truth(Box::new(Task::Compare { judge, colors }))));
        }
    }

    /// Makes pictures of what was traced for the screen.
    fn present(&mut self, judge: &Judge) {
        let truth = &mut self.truth;
        let Judge { request, .. } = judge;
        let basis = request.truth_basis();
        if !truth.wants_picture(&basis) {
            return;
        }
        let is_shown = |traced: &&Traced| traced.pass.basis == basis && traced.pass.is_whole;
        let Some(traced) = truth.traced.as_ref().filter(is_shown) else { return };
        let (colors, pass) = (traced.pass.colors.clone(), traced.number);
        let label = Label { request: request.clone(), pass, measure: None };
        if truth.presenting.is_none() && truth.presented.as_ref().is_none_or(|(known, _)| *known != label) {
            truth.presenting = Some(label);
            let (request, colors) = (Box::new(request.clone()), colors.clone());
            self.effects.push(Effect::Render(Command::Present { request, colors, pass }));
        }
        let measure = truth.measure;
        // Places stay as they are while colours become finer.
        let pass = if measure == Measure::Place { 0 } else { pass };
        let label = Label { request: request.clone(), pass, measure: Some(measure) };
        let is_asked_for = truth.is_pinned && truth.look == Look::Difference;
        let is_new = truth.difference.as_ref().is_none_or(|(known, _)| *known != label);
        if is_asked_for && is_new && truth.drawing.is_none() {
            let judge = judge.anew();
            truth.drawing = Some((label, judge.progress.clone()));
            self.effects.push(Effect::Work(Work::Truth(Box::new(Task::Difference { judge, measure, colors, pass }))));
        }
    }

    /// The images of a frame that the render thread was asked for.
    pub fn on_captured(&mut self, captured: Captured) {
        let Some(captured) = self.on_swept_images(captured) else { return };
        let is_current = self.is_of_scene(&captured.request);
        let truth = &mut self.truth;
        if truth.capturing.as_ref() == Some(&captured.request) {
            truth.capturing = None;
            truth.captured = Some((captured.request, Arc::new(captured.drawn))).filter(|_| is_current);
        }
    }

    /// Whether what was found out about a frame is still of use: points that have changed, or Stop, have freed its scene.
    fn is_of_scene(&self, request: &FrameRequest) -> bool {
        let scene = self.truth.scene.as_ref();
        request.revision == self.frames.revision && scene.is_some_and(|(key, _)| key.revision == self.frames.revision)
    }

    /// A picture of the truth, as the render thread shows it.
    pub fn on_presented(&mut self, request: FrameRequest, pass: u32, rgba: Vec<u8>) {
        self.truth.presenting = None;
        if !self.is_of_scene(&request) {
            return;
        }
        let (size, label) = (request.size, Label { request, pass, measure: None });
        self.log(json!({ "event": "truth", "pass": pass }));
        self.truth.presented = Some((label, Picture::new(size, rgba)));
    }

    /// The truth cannot be had: nothing more is asked for it. In a sweep it is the value at hand that failed.
    pub fn on_not_judged(&mut self, problem: &str) {
        (self.truth.capturing, self.truth.presenting) = (None, None);
        self.tuning.forget_measuring();
        if self.on_value_failed(problem) {
            return;
        }
        self.stop_truth();
        self.say(Level::Error, format!("The truth cannot be shown: {problem}"));
    }

    pub fn on_truth(&mut self, answer: Answer) {
        let is_current = match answer.request() {
            Some(request) => self.is_of_scene(request),
            None => answer.revision().is_none_or(|revision| revision == self.frames.revision),
        };
        match self.truth.take(answer, is_current) {
            Taken::Nothing => {}
            Taken::Log(event) => self.log(event),
            Taken::Swept { request, figures, picture } => self.on_swept(&request, *figures, picture),
            Taken::Failed(problem) => self.on_not_judged(&problem),
        }
    }
}

#[cfg(test)]
mod tests {
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT as _, Queryable as _};
    use param::Choice as _;

    use super::super::action::Action;
    use super::super::bench::Bench;
    use super::super::truth_tasks::Kind;
    use super::*;

    fn harness(bench: Bench) -> Harness<'static, Bench> {
        let mut harness = Harness::builder()
            .with_size([420.0, 5000.0])
            .with_max_steps(16)
            .build_ui_state(|ui, bench: &mut Bench| bench.show(ui), bench);
        harness.run_ok();
        harness
    }

    /// Whether the truth of the frame on the screen is in the picture.
    fn is_shown(state: &State) -> bool {
        state.truth_frame().is_some_and(|request| state.truth.picture(&request).is_some())
    }

    #[test]
    fn the_key_shows_the_truth_of_this_view_alone_and_judges_it() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        assert!(!is_shown(&bench.state) && bench.state.truth.scene.is_none(), "nobody has asked for it");
        let mut harness = harness(bench);
        harness.key_down(egui::Key::X);
        harness.run_ok();
        assert!(harness.state().state.truth.is_held);
        harness.state_mut().settle();
        let Bench { state, .. } = harness.state_mut();
        assert!(is_shown(state));
        let request = state.still_frame().cloned().unwrap();
        let (samples, wanted) = state.truth.samples(&request).unwrap();
        assert_eq!((samples, wanted), ([4, 4], 4), "as many paths as trace.samples says");
        let figures = state.truth.figures(&request).unwrap();
        assert!(figures.mirror_pixels > 100 && figures.pixel_error.p95 < 3.0, "{figures:?}");
        assert!(figures.image.is_some_and(|image| image.delta_e < 10.0), "{figures:?}");

        // Another method has the same truth, which is not traced anew, and other figures.
        let number = state.truth.traced.as_ref().map(|traced| traced.number);
        state.settings.reflection.method = scene::Method::None;
        harness.state_mut().settle();
        let Bench { state, .. } = harness.state_mut();
        let other = state.still_frame().cloned().unwrap();
        assert_eq!(state.truth.traced.as_ref().map(|traced| traced.number), number);
        assert!(is_shown(state) && state.truth.figures(&request).is_none());
        assert_eq!(state.truth.figures(&other).unwrap().coverage, 0.0);

        // A view that turns has none until it stands still again.
        state.camera.orbit(0.3, 0.1);
        assert!(!is_shown(state));
        harness.state_mut().settle();
        assert!(is_shown(&harness.state().state));
        harness.key_up(egui::Key::X);
        harness.run_ok();
        assert!(!is_shown(&harness.state().state));
    }

    #[test]
    fn a_pinned_truth_stays_splits_and_tells_where_the_picture_is_wrong() {
        let Some(bench) = Bench::with_sphere() else { return };
        let mut harness = harness(bench);
        harness.get_by_label("Pin").click();
        harness.run_ok();
        harness.state_mut().settle();
        harness.run_ok();
        assert!(is_shown(&harness.state().state));
        harness.get_by_label("Difference").click();
        harness.run_ok();
        harness.get_by_label("Place").click();
        harness.run_ok();
        harness.state_mut().settle();
        let Bench { state, .. } = harness.state_mut();
        let request = state.still_frame().cloned().unwrap();
        let clear = |picture: &Picture| picture.rgba.as_chunks::<4>().0.iter().filter(|rgba| rgba[3] == 0).count();
        let of_mirrors = clear(state.truth.difference(&request).unwrap());
        state.truth.measure = Measure::Color;
        assert!(state.truth.difference(&request).is_none(), "a heat map of places is none of colours");
        harness.state_mut().settle();
        let Bench { state, .. } = harness.state_mut();
        let of_all = clear(state.truth.difference(&request).unwrap());
        assert!(of_mirrors > of_all, "{of_mirrors} {of_all}");

        // Points that go take with them what was made of them.
        let keys: Vec<_> = state.clouds.iter().map(|entry| entry.key).collect();
        keys.into_iter().for_each(|key| state.remove_cloud(key));
        harness.state_mut().settle();
        let Bench { state, .. } = harness.state_mut();
        assert!(!is_shown(state) && state.truth.scene.is_none() && state.truth.activity().is_none());
    }

    #[test]
    fn settings_that_were_tried_are_dots_and_a_click_goes_back_to_one() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.state.act(Action::ToggleChart);
        bench.settle();
        bench.state.settings.reflection.method = scene::Method::Sscr;
        bench.settle();
        bench.state.history.watch(&bench.state.settings, &bench.state.objects, false, bench.state.now);
        let request = bench.state.still_frame().cloned().unwrap();
        let [frame, method] = bench.state.tuning.times(&request).unwrap();
        assert!(frame > method && method > 0.0, "{frame} {method}");
        let mut harness = harness(bench);
        // The row of the setting before this one.
        let is_row = |text: &str| text.contains(" ms of ") && !text.contains("= sscr");
        let row = harness.get_all_by_label_contains("pixels");
        let row = row.into_iter().find(|row| row.accesskit_node().label().is_some_and(|text| is_row(&text)));
        row.unwrap().click();
        harness.run_ok();
        let Bench { state, .. } = harness.state_mut();
        assert_eq!(state.settings.reflection.method.name(), scene::Method::Auto.name());
        state.act(Action::Undo);
        assert_eq!(state.settings.reflection.method, scene::Method::Sscr);
    }

    #[test]
    fn more_points_than_are_traced_are_a_message_and_not_a_wait() {
        let mut state = State::with_two_points();
        state.clouds[0].points = MOST_POINTS + 1;
        assert!(state.has_too_many_points());
        // As while a file is read.
        state.clouds[0].points += 1000;
        assert!(state.has_too_many_points());
        let told = state.messages.all.iter().filter(|message| message.text.contains("30,000,000")).count();
        assert_eq!(told, 1);
        state.clouds[0].is_visible = false;
        assert!(!state.has_too_many_points(), "points that are hidden are not traced");
        state.clouds[0].is_visible = true;
        state.clouds[0].points = MOST_POINTS;
        assert!(!state.has_too_many_points());
    }

    #[test]
    fn unpinning_ends_tracing() {
        let mut state = State::with_two_points();
        let basis = FrameRequest::any().truth_basis();
        state.frames.requested = Some(basis.clone());
        let progress = Arc::<Progress>::default();
        let tracing = Tracing { basis, progress: progress.clone(), mirrors_alone: Arc::default() };
        (state.truth.is_pinned, state.truth.tracing) = (true, Some(tracing));
        state.sync_truth();
        assert!(!progress.is_cancelled());
        state.toggle_truth();
        state.sync_truth();
        assert!(progress.is_cancelled());
    }

    #[test]
    fn an_answer_that_comes_too_late_is_not_shown() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.state.act(Action::PinTruth);
        bench.settle();
        let state = &mut bench.state;
        let old = state.still_frame().cloned().unwrap();
        let figures = state.truth.figures(&old).cloned().unwrap();
        assert!(is_shown(state) && state.truth.bytes() > 64 * 48 * 200);
        state.camera.orbit(0.3, 0.1);
        state.on_presented(old.clone(), 99, vec![255; 64 * 48 * 4]);
        assert!(!is_shown(state), "of a view that was left");
        bench.settle();
        assert!(is_shown(&bench.state));

        // Of points that are gone: nothing is kept of it.
        let state = &mut bench.state;
        state.set_visible(state.clouds[0].key, false);
        let progress = Arc::<Progress>::default();
        state.truth.judging = Some((old.clone(), progress.clone()));
        state.sync_truth();
        assert!(progress.is_cancelled());
        state.truth.verdict = None;
        state.on_truth(Answer::Judged { request: old.clone(), result: Ok(Box::new(figures)) });
        assert!(state.truth.verdict.is_none() && state.truth.judging.is_none());
        state.on_presented(old, 99, vec![255; 64 * 48 * 4]);
        assert!(state.truth.presented.is_none());
    }

    #[test]
    fn a_worker_that_fails_is_told_and_leaves_nothing_waiting() {
        let mut state = State::with_two_points();
        let key = SceneKey { revision: state.frames.revision, splat_size: 0 };
        (state.truth.is_pinned, state.truth.building) = (true, Some((key, Arc::default())));
        state.on_truth(Answer::Failed(Kind::Build));
        assert!(state.truth.building.is_none() && !state.truth.is_pinned);
        assert!(state.messages.all.iter().any(|message| message.text.contains("stopped unexpectedly")));
    }
}
