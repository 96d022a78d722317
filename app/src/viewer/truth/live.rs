//! The error of the picture on the screen, estimated while it stands still. The render thread answers exactly at random
//! pixels, some hundred at a time; the estimate becomes finer with each answer.

use std::time::{Duration, Instant};

use serde_json::json;
use study::{Estimate, Judged};

use crate::viewer::picture::frame_request::FrameRequest;
use crate::viewer::picture::messages::Command;
use crate::viewer::requests::outside::Outside;

/// A frame that has stood still for this long is worth the work: a slider that is dragged passes many frames that
/// nobody wants judged.
pub const REST: Duration = Duration::from_millis(200);

/// The number of answers after which an estimate is as fine as it gets: its intervals are then a share of one in a
/// hundred wide.
const MOST_ANSWERS: u64 = 20;

#[derive(Default)]
pub struct LiveEstimate {
    pub is_on: bool,
    /// The frame that stands still, and since when.
    still: Option<(FrameRequest, Instant)>,
    /// The frame whose answer is awaited.
    asked: Option<FrameRequest>,
    known: Option<Known>,
}

/// What is known of a frame.
struct Known {
    request: FrameRequest,
    judged: Judged,
    answers: u64,
    /// The figures of all pixels so far; none if there is nothing to estimate.
    estimate: Option<Estimate>,
    problem: Option<String>,
}

/// The state of the estimate of a frame.
pub enum Estimated<'a> {
    Figures(&'a Estimate),
    /// No mirror is seen, and there is no indirect light.
    Nothing,
    Problem(&'a str),
}

impl LiveEstimate {
    /// Asks for the next answer for `still`, the frame that stands still, if one is wanted. Returns the time after
    /// which to call again.
    pub fn sync(&mut self, still: Option<&FrameRequest>, outside: &mut Outside) -> Option<Duration> {
        let still = still.filter(|_| self.is_on);
        if self.still.as_ref().map(|(request, _)| request) != still {
            self.still = still.map(|request| (request.clone(), outside.now));
        }
        let (request, since) = self.still.as_ref()?;
        let left = REST.saturating_sub(outside.now.saturating_duration_since(*since));
        if !left.is_zero() {
            return Some(left);
        }
        let known = self.known.as_ref().filter(|known| known.request == *request);
        let answers = known.map_or(0, |known| known.answers);
        if self.asked.is_none() && answers < MOST_ANSWERS {
            self.asked = Some(request.clone());
            outside.render(Command::Estimate { request: Box::new(request.clone()), seed: answers });
        }
        None
    }

    /// Takes in an answer of the render thread; `None` if it has turned to another frame.
    pub fn on_answer(&mut self, request: FrameRequest, answer: Result<Option<Judged>, String>, outside: &mut Outside) {
        self.asked = None;
        if let Ok(None) = answer {
            return;
        }
        let known = self.known.take().filter(|known| known.request == request);
        let new = || Known { request, judged: Judged::default(), answers: 0, estimate: None, problem: None };
        let known = self.known.insert(known.unwrap_or_else(new));
        match answer {
            Ok(judged) => known.judged.add(judged.unwrap_or_default()),
            Err(problem) => known.problem = Some(problem),
        }
        known.answers += 1;
        known.estimate = known.judged.estimate();
        if known.estimate.is_none() {
            // Asking again would change nothing.
            known.answers = MOST_ANSWERS;
        }
        outside.log(json!({ "event": "estimate", "answers": known.answers, "estimate": known.estimate }));
    }

    /// What is known of a frame; `None` if nothing is known yet, or nobody asks.
    pub fn of(&self, request: &FrameRequest) -> Option<Estimated<'_>> {
        let known = self.known.as_ref().filter(|known| self.is_on && known.request == *request)?;
        Some(match (&known.estimate, &known.problem) {
            (_, Some(problem)) => Estimated::Problem(problem),
            (Some(estimate), None) => Estimated::Figures(estimate),
            (None, None) => Estimated::Nothing,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::requests::action::Action;

    #[test]
    fn a_view_at_rest_is_estimated_ever_finer_until_it_changes() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        assert!(bench.session.truth.live.of(&bench.session.still_frame().cloned().unwrap()).is_none(), "nobody asks");
        bench.session.act(Action::EstimateErrors(true));
        bench.settle();
        let session = &bench.session;
        let request = session.still_frame().cloned().unwrap();
        let Some(Estimated::Figures(figures)) = session.truth.live.of(&request) else { panic!("no estimate") };
        // The small picture has fewer mirror pixels than are asked for at a time.
        let shown = session.frames.shown.as_ref().and_then(|shown| shown.stats.reflection).unwrap();
        assert_eq!(figures.rays as u64, MOST_ANSWERS * u64::from(shown.mirror_pixels));
        assert!(figures.wrong < 0.1 && figures.indirect.is_some(), "{figures:?}");
        // Another view has an estimate of its own; an answer for the view before is none for it.
        let old = Judged::default();
        bench.session.act(Action::Orbit(glam::DVec2::new(40.0, 0.0)));
        bench.settle();
        let turned = bench.session.still_frame().cloned().unwrap();
        assert!(turned != request && bench.session.truth.live.of(&turned).is_some());
        assert!(bench.session.truth.live.of(&request).is_none());
        let session = &mut bench.session;
        session.truth.live.on_answer(request, Ok(Some(old)), &mut session.outside);
        assert!(session.truth.live.of(&turned).is_none());
        // A view with neither mirrors nor indirect light.
        session.scene.settings.reflection.method = scene::Method::None;
        session.scene.settings.gi.bounces = 0;
        bench.settle();
        let plain = bench.session.still_frame().cloned().unwrap();
        assert!(matches!(bench.session.truth.live.of(&plain), Some(Estimated::Nothing)));
        bench.session.act(Action::EstimateErrors(false));
        assert!(bench.session.truth.live.of(&plain).is_none());
    }
}
