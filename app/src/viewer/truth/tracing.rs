//! Tracing that is under way: how far it is, and how long it still takes.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use cloud::Progress;

use crate::shared::language::text;
use crate::viewer::look::widgets::time_left;
use crate::viewer::picture::frame_request::FrameRequest;

/// From when on the pace of tracing is known.
const LEAST_TIME: Duration = Duration::from_secs(1);

pub struct Tracing {
    pub basis: FrameRequest,
    /// The total grows with each step, by the pixels of the picture, and before the first one by what finds the light.
    pub progress: Arc<Progress>,
    /// The total that was seen last, and by how much it had grown.
    seen: Cell<(u64, u64)>,
    pub mirrors_alone: Arc<AtomicBool>,
    first: Pace,
    all: Pace,
}

impl Tracing {
    /// Tracing that begins now, or goes on from so much work (`Pass::work`).
    pub fn new(basis: FrameRequest, mirrors_alone: Arc<AtomicBool>, work: Option<[u64; 3]>, now: Instant) -> Self {
        let before = work.map_or(0.0, |work| share_of(work, 0.0));
        let (first, all) = (Pace::new(0.0, now), Pace::new(before, now));
        Self { basis, progress: Arc::default(), seen: Cell::default(), mirrors_alone, first, all }
    }

    /// How far it is, from the work after the last step, as text: `34 %, 50 s left`. Before the end of the first step, how
    /// far that is.
    pub fn text(&self, work: Option<[u64; 3]>, now: Instant) -> String {
        let step = self.share_of_step();
        match work {
            None => text!("first picture {progress}", progress = self.first.text(step, now)),
            Some(work) => self.all.text(share_of(work, step), now),
        }
    }

    /// The share of the step under way: each step counts every pixel, also those that it leaves out.
    fn share_of_step(&self) -> f64 {
        let (total, done) = (self.progress.total(), self.progress.done());
        let (before, growth) = self.seen.get();
        let growth = if total == before { growth } else { total - before };
        self.seen.set((total, growth));
        let pixels = self.basis.size.map(u64::from).iter().product::<u64>();
        let left = total.saturating_sub(done);
        // Between two steps nothing is left.
        if growth < pixels || left == 0 { 0.0 } else { 1.0 - left as f64 / pixels.max(1) as f64 }
    }
}

/// The share of all work that is done where this share of the next step is.
fn share_of([taken, next, wanted]: [u64; 3], step: f64) -> f64 {
    (taken as f64 + next as f64 * step) / wanted.max(1) as f64
}

/// The pace of work, which gives the time that is left. Neither the share nor the time runs backwards.
struct Pace {
    began: Instant,
    /// The share that was done when it began.
    before: f64,
    /// The largest share and the fewest seconds that were shown.
    shown: Cell<(f64, f64)>,
}

impl Pace {
    fn new(before: f64, began: Instant) -> Self {
        Self { began, before, shown: Cell::new((before, f64::INFINITY)) }
    }

    fn text(&self, share: f64, now: Instant) -> String {
        let (most, least) = self.shown.get();
        let share = share.max(most).min(1.0);
        let passed = now.saturating_duration_since(self.began);
        let text = format!("{:.0} %", (share * 100.0).floor());
        if passed < LEAST_TIME || share - self.before < 0.01 {
            self.shown.set((share, least));
            return text;
        }
        let left = (1.0 - share) * passed.as_secs_f64() / (share - self.before);
        let shown = left.min(least);
        self.shown.set((share, shown));
        // A time that has turned out to be far too short is shown no more.
        if left > 1.5 * shown + 5.0 { text } else { format!("{text}, {}", time_left(shown)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neither_the_share_nor_the_time_left_runs_backwards() {
        let began = Instant::now();
        let pace = Pace::new(0.2, began);
        let text = |share: f64, seconds: u64| pace.text(share, began + Duration::from_secs(seconds));
        assert_eq!(text(0.2, 0), "20 %");
        assert_eq!(text(0.4, 10), "40 %, 30 s left");
        // A step that takes longer than those before.
        assert_eq!(text(0.4, 12), "40 %, 30 s left");
        assert_eq!(text(0.38, 12), "40 %, 30 s left");
        assert_eq!(text(0.4, 30), "40 %", "the time was too short by far");
        assert_eq!(text(0.9, 35), "90 %, 5 s left");
        assert_eq!(text(1.0, 40), "100 %, 0 s left");
    }

    #[test]
    fn steps_count_by_their_estimates_and_by_the_pixels_that_are_left() {
        assert_eq!(share_of([10, 20, 100], 0.5), 0.2);
        assert_eq!(share_of([0, 0, 0], 1.0), 0.0);
        let basis = FrameRequest { size: [10, 10], ..FrameRequest::any() };
        let tracing = Tracing::new(basis, Arc::default(), None, Instant::now());
        let step = |total: u64, more: u64| {
            tracing.progress.set_total(total);
            tracing.progress.add(more);
            tracing.share_of_step()
        };
        assert_eq!(step(5, 2), 0.0, "what finds the light is no step");
        assert_eq!(step(105, 28), 0.25);
        assert_eq!(step(105, 75), 0.0, "the next step has not begun");
        assert_eq!(step(205, 50), 0.5);
    }
}
