//! When what could not be read is asked for again: a server that is down, or a disk of the network, may be back in a moment.

use std::time::{Duration, Instant};

/// The waits before what has failed is asked for again, in seconds.
const WAITS: [u64; 5] = [1, 2, 4, 8, 16];
/// The seconds after which another view may ask for it again, once all of these tries have failed.
const REST: u64 = 60;

/// A read that has failed, and when it is tried again: five times, each after a longer wait; then no more, until a view that
/// needs it comes after a minute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Again {
    tries: usize,
    next: Instant,
    is_asked: bool,
}

impl Again {
    /// `before` is what was known of a read that has now failed once more. `may_pass` says that waiting may help; if not, only
    /// another view asks again.
    #[must_use]
    pub fn after(before: Option<Self>, may_pass: bool, now: Instant) -> Self {
        let next = before.map_or(0, |before| (before.tries + 1) % (WAITS.len() + 1));
        let tries = if may_pass { next } else { WAITS.len() };
        let wait = WAITS.get(tries).copied().unwrap_or(REST);
        Self { tries, next: now + Duration::from_secs(wait), is_asked: false }
    }

    /// Whether it is to be tried now; the read is under way from then on. `is_other_view` says that the view has changed.
    pub fn ask(&mut self, now: Instant, is_other_view: bool) -> bool {
        let is_due = !self.is_asked && now >= self.next && (self.tries < WAITS.len() || is_other_view);
        self.is_asked |= is_due;
        is_due
    }

    /// Whether it is not being tried.
    pub fn waits(&self) -> bool {
        !self.is_asked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_tried_five_times_and_after_a_minute_where_another_view_needs_it() {
        let start = Instant::now();
        let mut now = start;
        let mut again = Again::after(None, true, now);
        for seconds in [1, 2, 4, 8, 16] {
            now += Duration::from_millis(1000 * seconds - 1);
            assert!(!again.ask(now, true), "after {seconds} s");
            now += Duration::from_millis(1);
            assert!(again.ask(now, false) && !again.ask(now, true) && !again.waits());
            again = Again::after(Some(again), true, now);
        }
        assert!(!again.ask(now + Duration::from_secs(3600), false) && !again.ask(now + Duration::from_secs(59), true));
        now += Duration::from_secs(60);
        assert!(again.ask(now, true));
        again = Again::after(Some(again), true, now);
        assert_eq!(again, Again::after(None, true, now));
        // What does not pass is left to another view from the first time on.
        let mut again = Again::after(None, false, now);
        now += Duration::from_secs(60);
        assert!(!again.ask(now, false) && again.ask(now, true));
    }
}
