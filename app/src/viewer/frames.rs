//! The frames of the window: which one is wanted, which is on its way, and which is on the screen.

use std::time::{Duration, Instant};

use render::FrameStats;
use serde_json::json;

use crate::viewer::outside::Outside;
use crate::viewer::pace::{Haste, Spared};
use crate::viewer::window::render_thread;
use crate::viewer::window::render_thread::{Command, Frame, FrameRequest};

/// While points come in, a frame at most this often: each takes time from reading.
const LOADING_FRAME_INTERVAL: Duration = Duration::from_millis(100);

/// The picture on the screen.
pub struct Shown {
    pub request: FrameRequest,
    pub stats: FrameStats,
    pub total_milliseconds: f64,
}

#[derive(Default)]
pub struct Frames {
    pub shown: Option<Shown>,
    /// The frame that is wanted now, as far as it has been asked for.
    pub requested: Option<FrameRequest>,
    requested_at: Option<Instant>,
    pub under_way: u32,
    /// Time of the last frame in the wanted quality.
    careful_milliseconds: f64,
    /// What frames spare while something moves.
    haste: Haste,
    /// Counts changes of the points and their colours.
    pub revision: u64,
    /// The picture on the screen is the final one, and that was told.
    is_at_rest: bool,
}

/// What decides when a frame is drawn, and how carefully.
pub struct Situation {
    /// Points are on their way that the picture wants.
    pub points_come: bool,
    /// What lights the points is still being found out.
    pub light_comes: bool,
    /// After how long the camera rests; `None` if it does.
    pub rest: Option<Duration>,
    pub a_mirror_is_dragged: bool,
    /// Only final pictures are wanted.
    pub is_recorded: bool,
    /// How long a frame may take while something moves, milliseconds; 0 for as long as it takes.
    pub milliseconds: f64,
}

/// What is to be done about a frame that is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// It is drawn or shown already.
    Nothing,
    /// Another frame is being drawn; its report wakes the window.
    Wait,
    WaitFor(Duration),
    Draw,
}

impl Frames {
    /// The points or their colours have changed.
    pub fn points_changed(&mut self) {
        self.revision += 1;
    }

    /// Whether frames in the wanted quality take too long to move by.
    pub fn is_slow(&self) -> bool {
        // Below 20 frames a second a turn no longer feels like a turn.
        const TOO_LONG: f64 = 50.0;
        self.careful_milliseconds > TOO_LONG
    }

    /// Has a picture drawn, in a hurry where that is called for, unless it is drawn or shown already. Returns when to look again.
    pub fn request(
        &mut self,
        mut wanted: FrameRequest,
        situation: &Situation,
        outside: &mut Outside,
    ) -> Option<Duration> {
        let &Situation { points_come, light_comes, rest, a_mirror_is_dragged, is_recorded, milliseconds } = situation;
        if is_recorded && (points_come || light_comes) {
            return None;
        }
        // The first picture comes soon, and a better one after it.
        let is_moving = !is_recorded && rest.is_some() && self.is_slow();
        if !is_recorded && self.shown.is_none() || is_moving {
            let settings = render_thread::hurried(&wanted.settings, a_mirror_is_dragged);
            let spared = (is_moving && milliseconds > 0.0).then(|| self.haste.spare(wanted.size, milliseconds));
            wanted.spared = spared.filter(|spared| *spared != Spared::NOTHING);
            wanted.hurried = settings != wanted.settings || wanted.spared.is_some();
            wanted.settings = settings;
        }
        match self.want(&wanted, points_come, outside.now) {
            Next::Draw => {
                outside.render(Command::Frame(Box::new(wanted)));
                rest
            }
            Next::Wait => None,
            Next::WaitFor(time) => Some(time),
            Next::Nothing => {
                if self.comes_to_rest(light_comes || points_come) {
                    outside.log(json!({ "event": "settled" }));
                }
                rest
            }
        }
    }

    /// Takes in which frame is wanted now. While points come, frames that differ only by them are not drawn too often.
    fn want(&mut self, wanted: &FrameRequest, points_come: bool, now: Instant) -> Next {
        if self.requested.as_ref() == Some(wanted) {
            return Next::Nothing;
        }
        let only_points_changed = self.requested.as_ref().is_some_and(|requested| {
            points_come && FrameRequest { revision: wanted.revision, ..requested.clone() } == *wanted
        });
        if only_points_changed {
            if self.under_way > 0 {
                return Next::Wait;
            }
            let since = self.requested_at.map_or(LOADING_FRAME_INTERVAL, |at| now.saturating_duration_since(at));
            if since < LOADING_FRAME_INTERVAL {
                return Next::WaitFor(LOADING_FRAME_INTERVAL - since);
            }
        }
        self.is_at_rest = false;
        self.requested = Some(wanted.clone());
        self.requested_at = Some(now);
        self.under_way += 1;
        Next::Draw
    }

    /// Whether the picture on the screen is now, and was not before, the one that is wanted in the end. `may_change`: something is
    /// under way that could make it another.
    fn comes_to_rest(&mut self, may_change: bool) -> bool {
        let is_final = self.requested.as_ref().is_some_and(|requested| !requested.hurried);
        let is_shown = self.under_way == 0 && self.shown.is_some() && is_final;
        let comes = !self.is_at_rest && is_shown && !may_change;
        self.is_at_rest |= comes;
        comes
    }

    /// The frame on the screen, if it is the final one.
    pub fn final_one(&self) -> Option<&FrameRequest> {
        let shown = &self.shown.as_ref().filter(|_| self.is_at_rest)?.request;
        (self.requested.as_ref() == Some(shown) && !shown.hurried).then_some(shown)
    }

    /// A frame is on the screen. `milliseconds` as in `Situation`.
    pub fn show(&mut self, frame: Frame, milliseconds: f64) {
        // Those that were overtaken are never drawn.
        self.under_way = u32::from(self.requested.as_ref() != Some(&frame.request));
        if !frame.request.hurried {
            self.careful_milliseconds = frame.total_milliseconds;
        }
        let Frame { request, stats, total_milliseconds, .. } = frame;
        self.haste.learn(&stats, &request, total_milliseconds, milliseconds);
        self.shown = Some(Shown { request, stats, total_milliseconds });
    }

    /// The frame that was asked for will not come.
    pub fn give_up(&mut self) {
        self.under_way = 0;
    }
}
