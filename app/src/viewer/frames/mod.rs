//! The frames of the window: the one that is wanted, the one being drawn, and the one on the screen.

pub mod auto;

use std::cell::Cell;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use cloud::Progress;
use render::FrameStats;
use scene::Method;
use serde_json::{Value, json};

use crate::viewer::picture::frame_request::{FrameRequest, hurried};
use crate::viewer::picture::messages::Command;
use crate::viewer::picture::pace::{Haste, QuickPace, Spared};
use crate::viewer::requests::outside::Outside;

/// The shortest time between two frames while points are loaded. Each frame takes time from reading, so a frame is
/// followed by at least as much time without one.
const LOADING_FRAME_INTERVAL: Duration = Duration::from_millis(100);
/// The longest time in milliseconds of frames that follow a turn of the camera smoothly: 20 frames a second.
const TOO_LONG: f64 = 50.0;
/// How long the first picture after a movement may take in milliseconds, where full quality takes more than twice that.
const FIRST_STILL: f64 = 200.0;
/// How coarse the very first picture is, before any time is known: it comes four times as soon, and a better one
/// follows.
const FIRST: Spared = Spared { divisor: 2, ..Spared::NOTHING };

/// How long a picture may be that of earlier values before the panel says so: shorter waits would make the notice
/// flicker.
const LATE: Duration = Duration::from_millis(300);

/// A picture in full quality that takes more seconds is announced.
const LONG: f64 = 1.5;

/// How fast the time that is expected of a frame falls where frames take less.
const EXPECTED_DECAY: f64 = 0.8;

fn method_of(request: &FrameRequest) -> Method {
    request.settings.reflection.method
}

/// The picture on the screen: its request, its statistics and the time that it took.
pub struct Shown {
    pub request: FrameRequest,
    pub stats: FrameStats,
    pub total_milliseconds: f64,
    input_at: Option<Instant>,
    is_moving: bool,
    /// True once the window has presented the picture.
    is_presented: bool,
}

/// A request that was sent to the render thread, and what it follows.
struct Asked {
    request: FrameRequest,
    /// The time of the newest input that the request takes into account.
    input_at: Option<Instant>,
    /// Whether something moved when the frame was requested.
    is_moving: bool,
    /// The number of the values that the frame shows.
    values: u64,
}

#[derive(Default)]
pub struct Frames {
    /// The shaders that the render thread has compiled.
    pub shaders: Arc<Progress>,
    /// How many there were when none was being compiled, and the largest share that was shown since: more of them come
    /// to light on the way.
    told_shaders: Cell<(u64, f32)>,
    pub shown: Option<Shown>,
    /// Whether that picture shows its background alone.
    pub is_blank: bool,
    /// The last request that was sent to the render thread.
    pub requested: Option<FrameRequest>,
    requested_at: Option<Instant>,
    /// The requests that the render thread may still answer, the oldest first.
    asked: VecDeque<Asked>,
    pub under_way: u32,
    /// The time that the last frame in full quality took.
    careful_milliseconds: f64,
    /// The milliseconds that a frame in full quality is likely to take, with this method and in this size.
    expected: Option<(Method, [u32; 2], f64)>,
    /// The number of shaders that were compiled when the last frame in full quality was shown.
    compiled_before: u64,
    /// The time that the last hurried frame took.
    hurried_milliseconds: f64,
    /// Chooses the quality of frames while something moves.
    haste: Haste,
    /// The pace of quick pictures.
    quick_pace: QuickPace,
    /// Whether the last hurried frame was a quick picture, as the next one will be.
    moves_quickly: bool,
    /// The quality of the first picture since the movement ended; `None` while something moves.
    first_still: Option<Spared>,
    /// The frame of the current values: parameters, mirrors and lights.
    current: Option<FrameRequest>,
    /// The number of the current values; it grows with each change of them.
    values: u64,
    /// The changes of values that the picture on the screen does not show, the oldest first: their numbers and times.
    changes: VecDeque<(u64, Instant)>,
    /// Since when colours are being made that the points do not have yet, and the revision at that time.
    coloring: Option<(Instant, u64)>,
    /// A counter that grows with each change of the points and their colours.
    pub revision: u64,
    /// True once the picture on the screen is final and the event log says so.
    is_at_rest: bool,
}

/// The state of the session, as far as it decides when a frame is drawn and in which quality.
pub struct Situation {
    /// True while points that the picture needs are still being loaded.
    pub points_come: bool,
    /// True while the search for the automatic light is under way.
    pub light_comes: bool,
    /// True while the picture is about to change by itself.
    pub soon_changes: bool,
    /// The time until the camera is at rest; `None` if it is at rest already.
    pub rest: Option<Duration>,
    pub a_mirror_is_dragged: bool,
    /// True in recordings, which draw only final pictures.
    pub is_recorded: bool,
    /// The time that a frame may take while something moves, in milliseconds. 0 means no limit.
    pub milliseconds: f64,
}

/// What `Frames::want` decides about a wanted frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// The frame is already requested or shown.
    Nothing,
    /// Another frame is being drawn, and its report will wake the window.
    Wait,
    WaitFor(Duration),
    Draw,
}

impl Frames {
    /// Must be called after each change of the points or their colours.
    pub fn points_changed(&mut self) {
        self.revision += 1;
    }

    /// Returns how many samples of glossy mirrors, or rays of light of each pixel, the picture shows, and of how many, while more are to come.
    pub fn samples_under_way(&self) -> Option<[u32; 2]> {
        let shown = self.shown.as_ref()?;
        let samples @ [summed, asked] = shown.stats.samples();
        (summed < asked).then_some(samples)
    }

    /// Returns the share of the shaders that are compiled; `None` if none is being compiled.
    pub fn compiled(&self) -> Option<f32> {
        let (done, total) = (self.shaders.done(), self.shaders.total());
        let (before, told) = self.told_shaders.get();
        if done >= total {
            self.told_shaders.set((total, 0.0));
            return None;
        }
        let share = done.saturating_sub(before) as f32 / total.saturating_sub(before).max(1) as f32;
        self.told_shaders.set((before, share.max(told)));
        Some(share.max(told))
    }

    /// Returns true while a picture is drawn and there is none to show meanwhile.
    pub fn first_is_drawn(&self) -> bool {
        self.shown.is_none() && self.under_way > 0
    }

    /// Returns the seconds for which a frame in full quality has been drawn, and those that it is likely to take in all,
    /// if that is known. `None` if none is drawn, or it comes soon.
    pub fn full_quality_under_way(&self, now: Instant) -> Option<(f64, Option<f64>)> {
        let is_drawn = |request: &&FrameRequest| {
            let is_shown = self.shown.as_ref().is_some_and(|shown| shown.request == **request);
            !request.hurried && self.under_way > 0 && !is_shown
        };
        let request = self.requested.as_ref().filter(is_drawn)?;
        let so_far = now.saturating_duration_since(self.requested_at?).as_secs_f64();
        let is_alike =
            |(method, size, _): &(Method, [u32; 2], f64)| *method == method_of(request) && *size == request.size;
        let all = self.expected.filter(is_alike).map(|(.., milliseconds)| milliseconds * 1e-3);
        (so_far.max(all.unwrap_or(0.0)) > LONG).then_some((so_far, all))
    }

    /// Returns true if frames in full quality take too long to steer the camera by. Where there are quick pictures they
    /// do until one is drawn.
    pub fn is_slow(&self) -> bool {
        self.careful_milliseconds > TOO_LONG || self.careful_milliseconds == 0.0 && self.moves_quickly
    }

    /// Returns true if a frame in full quality, which something else is about to replace, would hold that up. Until one
    /// was drawn, the time of a hurried frame decides.
    fn would_delay(&self) -> bool {
        self.is_slow() || self.careful_milliseconds == 0.0 && self.hurried_milliseconds > TOO_LONG
    }

    /// Sends a request for the wanted frame, unless it is already requested or shown. The frame is a hurried one if it
    /// is the first picture, or if full quality is slow and something moves or the picture soon changes by itself.
    /// Returns the time after which to call this again.
    pub fn request(
        &mut self,
        mut wanted: FrameRequest,
        situation: &Situation,
        outside: &mut Outside,
    ) -> Option<Duration> {
        self.note_values(&wanted, outside.now);
        let &Situation { points_come, light_comes, soon_changes, rest, a_mirror_is_dragged, is_recorded, milliseconds } =
            situation;
        if is_recorded && (points_come || light_comes) {
            return None;
        }
        // The first picture is hurried so that it comes soon. A better one follows it. While points are read, frames in
        // full quality would take the processors from the reading, and the next points would replace them.
        let is_moving = !is_recorded && rest.is_some() && self.is_slow();
        let is_passing = soon_changes && self.would_delay();
        let spared = if is_moving && milliseconds > 0.0 {
            self.first_still = None;
            Some(match self.moves_quickly {
                true => self.quick_pace.spare(wanted.size, milliseconds),
                false => self.haste.spare(wanted.size, milliseconds),
            })
        } else if self.shown.is_none() && !is_recorded {
            Some(FIRST)
        } else {
            self.first_still(wanted.size).filter(|_| !is_recorded)
        };
        if !is_recorded && (self.shown.is_none() || is_passing) || is_moving || spared.is_some() {
            let settings = hurried(&wanted.settings, a_mirror_is_dragged);
            wanted.spared = spared.filter(|spared| *spared != Spared::NOTHING);
            // While something moves, light of earlier frames is taken over.
            wanted.hurried = is_moving || settings != wanted.settings || wanted.spared.is_some();
            wanted.light_may_lag |= is_moving;
            wanted.settings = settings;
        }
        match self.want(&wanted, points_come || is_passing && !is_recorded, outside.now) {
            Next::Draw => {
                let is_moving = rest.is_some();
                let (request, input_at) = (wanted.clone(), outside.input_at);
                self.asked.push_back(Asked { request, input_at, is_moving, values: self.values });
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

    /// Returns how coarse the next frame is when nothing moves any more: the picture is refined in two steps if full
    /// quality takes long. `None` if the first step is done, or not needed.
    fn first_still(&mut self, size: [u32; 2]) -> Option<Spared> {
        let shown = self.shown.as_ref().filter(|shown| shown.is_moving && shown.request.hurried)?;
        if self.first_still.is_none() && self.careful_milliseconds > 2.0 * FIRST_STILL {
            let before = shown.request.spared.map_or(1, |spared| spared.divisor);
            let still = match self.moves_quickly {
                true => self.quick_pace.choose(size, FIRST_STILL),
                false => self.haste.choose(size, FIRST_STILL),
            };
            self.first_still = Some(still).filter(|still| still.divisor < before);
        }
        self.first_still
    }

    /// Records when the values change that the panel shows.
    fn note_values(&mut self, wanted: &FrameRequest, now: Instant) {
        let is_same = |known: &FrameRequest| {
            known.settings == wanted.settings && known.mirrors == wanted.mirrors && known.lights == wanted.lights
        };
        if !self.current.as_ref().is_some_and(is_same) {
            self.current = Some(wanted.clone());
            self.values += 1;
            self.changes.push_back((self.values, now));
        }
    }

    /// Must be called before each request. `comes` says that colours are being made: until a picture shows them, the one
    /// on the screen has earlier ones, whatever other values it shows.
    pub fn note_coloring(&mut self, comes: bool, now: Instant) {
        match self.coloring {
            None if comes => self.coloring = Some((now, self.revision)),
            Some((since, revision)) if !comes => {
                self.coloring = None;
                if self.revision != revision {
                    self.values += 1;
                    self.changes.push_back((self.values, since));
                }
            }
            _ => {}
        }
    }

    /// Returns the time until the panel must say that the picture is that of earlier values: zero if it must now,
    /// `None` if the picture is that of the current ones.
    pub fn time_to_late(&self, now: Instant) -> Option<Duration> {
        self.shown.as_ref()?;
        let changes = self.changes.iter().map(|(_, since)| *since);
        let since = changes.chain(self.coloring.map(|(since, _)| since)).min()?;
        Some(LATE.saturating_sub(now.saturating_duration_since(since)))
    }

    /// Decides what to do about the wanted frame, and records it if it is to be drawn. While points are loaded, or what
    /// they need is computed, frames that differ from the last only in their points are drawn no more often than
    /// `LOADING_FRAME_INTERVAL`.
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
            let drawing = self.shown.as_ref().map_or(0.0, |shown| shown.total_milliseconds.max(0.0) / 1e3);
            let interval = LOADING_FRAME_INTERVAL.max(Duration::from_secs_f64(2.0 * drawing));
            let since = self.requested_at.map_or(interval, |at| now.saturating_duration_since(at));
            if since < interval {
                return Next::WaitFor(interval - since);
            }
        }
        self.is_at_rest = false;
        self.requested = Some(wanted.clone());
        self.requested_at = Some(now);
        self.under_way += 1;
        Next::Draw
    }

    /// Returns true the first time that the picture on the screen is final. `may_change` says whether work is under way
    /// that could change the picture.
    fn comes_to_rest(&mut self, may_change: bool) -> bool {
        let is_final = self.requested.as_ref().is_some_and(|requested| !requested.hurried);
        let is_shown = self.under_way == 0 && self.shown.is_some() && is_final;
        let comes = !self.is_at_rest && is_shown && !may_change;
        self.is_at_rest |= comes;
        comes
    }

    /// Returns the request of the frame on the screen if that frame is final.
    pub fn final_one(&self) -> Option<&FrameRequest> {
        let shown = &self.shown.as_ref().filter(|_| self.is_at_rest)?.request;
        (self.requested.as_ref() == Some(shown) && !shown.hurried).then_some(shown)
    }

    /// Records that a frame is on the screen, which took `total_milliseconds` to draw. `milliseconds` has the meaning
    /// of the field of `Situation`.
    pub fn show(&mut self, request: FrameRequest, stats: FrameStats, total_milliseconds: f64, milliseconds: f64) {
        let is_whole = request.is_whole(&stats);
        // The render thread draws only the newest request, so at most that one is still under way.
        self.under_way = u32::from(self.requested.as_ref() != Some(&request) || !is_whole);
        if request.hurried {
            self.moves_quickly = stats.is_quick;
            self.hurried_milliseconds = total_milliseconds;
        } else {
            self.careful_milliseconds = total_milliseconds;
            // A frame that keeps what the one before found takes less than others will, and one during which shaders are
            // compiled says nothing of them.
            let alike =
                self.expected.filter(|(method, size, _)| (*method, *size) == (method_of(&request), request.size));
            let least = alike.map_or(0.0, |(.., known)| known * EXPECTED_DECAY);
            let compiled = self.shaders.done();
            if std::mem::replace(&mut self.compiled_before, compiled) == compiled {
                self.expected = Some((method_of(&request), request.size, total_milliseconds.max(least)));
            }
        }
        match stats.is_quick {
            true => self.quick_pace.learn(&stats, &request, milliseconds),
            false => self.haste.learn(&stats, &request, total_milliseconds, milliseconds),
        }
        // Older requests are never answered. One whose picture is not whole yet is answered again.
        let place = self.asked.iter().position(|asked| asked.request == request);
        self.asked.drain(..place.unwrap_or(0));
        let asked = place.and_then(|_| self.asked.front());
        let (input_at, is_moving, values) =
            asked.map_or((None, false, 0), |asked| (asked.input_at, asked.is_moving, asked.values));
        if place.is_some() && is_whole {
            self.asked.pop_front();
        }
        self.changes.retain(|(number, _)| *number > values);
        let is_presented = false;
        self.shown = Some(Shown { request, stats, total_milliseconds, input_at, is_moving, is_presented });
    }

    /// Records that the window presented the picture at the time `now`. Returns the event for the log if this is the
    /// first time.
    pub fn present(&mut self, now: Instant) -> Option<Value> {
        let shown = self.shown.as_mut().filter(|shown| !shown.is_presented)?;
        shown.is_presented = true;
        let since_input = shown.input_at.map(|at| now.saturating_duration_since(at).as_secs_f64() * 1e3);
        Some(json!({
            "event": "frame", "ms": shown.total_milliseconds, "points": shown.stats.points_drawn,
            "size": shown.request.drawn_size(), "moving": shown.is_moving, "since_input_ms": since_input,
            "flip": shown.stats.flip,
        }))
    }

    /// Records that the requested frame will not come.
    pub fn give_up(&mut self) {
        self.under_way = 0;
        self.asked.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::viewer::bench::Bench;
    use crate::viewer::requests::action::{Action, Film, PathPreset};

    #[test]
    fn full_quality_waits_for_the_points_only_where_it_is_slow() {
        let delays = |careful_milliseconds, hurried_milliseconds| {
            Frames { careful_milliseconds, hurried_milliseconds, ..Frames::default() }.would_delay()
        };
        // Before the first frame, and where hurried or careful frames were fast.
        assert!(!delays(0.0, 0.0) && !delays(0.0, 20.0) && !delays(20.0, 0.0) && !delays(20.0, 80.0));
        assert!(delays(0.0, 80.0) && delays(80.0, 20.0));
    }

    #[test]
    fn frames_are_hurried_while_points_are_read_and_the_last_is_in_full_quality() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let session = &mut bench.session;
        let shown = session.frames.shown.as_ref().unwrap().request.clone();
        assert!(!shown.hurried);
        session.frames.careful_milliseconds = 1000.0;
        let mut situation = Situation {
            points_come: true,
            light_comes: false,
            soon_changes: true,
            rest: None,
            a_mirror_is_dragged: false,
            is_recorded: false,
            milliseconds: 83.0,
        };
        let mut is_hurried = |situation: &Situation| {
            session.frames.requested = None;
            session.frames.request(shown.clone(), situation, &mut session.outside);
            session.frames.requested.as_ref().unwrap().hurried
        };
        assert!(is_hurried(&situation));
        assert!(!is_hurried(&Situation { is_recorded: true, points_come: false, ..situation }));
        situation.soon_changes = false;
        assert!(!is_hurried(&situation), "normals and radii do not hold it up");
    }

    #[test]
    fn what_moves_where_nothing_reflects_is_a_quick_picture_and_leaves_the_picture_at_rest_as_it_was() {
        let Some(mut bench) = Bench::with_scene("five-mirrors/none") else { return };
        bench.settle();
        let (rest, camera) = (bench.read(), bench.session.scene.camera);
        assert!(!bench.session.frames.moves_quickly || bench.is_processor);
        // Lit by lamps, then in the colours of the data.
        for light in ["auto", "colors"] {
            bench.session.scene.settings.set_text("light.by", light).unwrap();
            bench.settle();
            let still = bench.read();
            bench.session.frames.careful_milliseconds = 1000.0;
            bench.session.act(Action::Orbit(glam::DVec2::new(40.0, 0.0)));
            bench.settle();
            assert_eq!(bench.session.frames.moves_quickly, bench.is_processor, "{light}");
            assert!(bench.read() != still, "the camera has turned");
            bench.session.scene.camera = camera;
            bench.settle();
            assert!(bench.read() == still, "{light}");
        }
        bench.session.scene.settings.set_text("light.by", "auto").unwrap();
        bench.settle();
        assert!(bench.read() == rest);
    }

    #[test]
    fn quick_pictures_take_the_time_that_they_may_and_give_up_pixels_before_points() {
        let Some(mut bench) = Bench::with_scene("five-mirrors/none") else { return };
        bench.settle();
        let shown = bench.session.frames.shown.take().unwrap();
        // Milliseconds for a point and for a pixel: many cores, two cores, two slow ones.
        for [per_point, per_pixel] in [[1e-6, 5e-6], [1e-5, 4e-5], [6e-5, 2e-4]] {
            for points in [8_000, 3_000_000, 12_000_000] {
                let mut pace = QuickPace::default();
                let mut last = (Spared::NOTHING, 0.0);
                for _ in 0..5 {
                    let spared = pace.spare([1400, 900], 40.0);
                    let request = FrameRequest { size: [1400, 900], spared: Some(spared), ..shown.request.clone() };
                    let drawn = spared.most_points.map_or(points, |most: u64| most.min(points));
                    let splatting = drawn as f64 * per_point;
                    let pixels = request.drawn_size().map(f64::from).iter().product::<f64>();
                    let milliseconds = splatting + pixels * per_pixel;
                    let stats = FrameStats {
                        splatting_milliseconds: splatting,
                        frame_milliseconds: milliseconds,
                        points_drawn: drawn,
                        is_quick: true,
                        ..shown.stats.clone()
                    };
                    pace.learn(&stats, &request, 40.0);
                    last = (spared, milliseconds);
                }
                let (spared, milliseconds) = last;
                assert!(spared.divisor <= 2, "{spared:?}");
                let is_least = spared.divisor == 2 && spared.most_points.unwrap_or(points).min(points) <= 700 * 450;
                assert!(milliseconds < 50.0 || is_least, "{per_point} {points}: {last:?}");
                assert!(spared.most_points.is_none() || spared.divisor == 2, "{per_point} {points}: {last:?}");
            }
        }
    }

    #[test]
    fn a_path_that_plays_is_drawn_as_what_moves_and_its_end_in_full_quality() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let session = &mut bench.session;
        session.act(Action::Film(Film::Add(PathPreset::Turntable)));
        session.act(Action::Film(Film::Play));
        session.frames.careful_milliseconds = 1000.0;
        let start = session.outside.now;
        for seconds in [0.5, 1.0] {
            session.step(start + Duration::from_secs_f64(seconds), false);
            let asked = session.frames.requested.as_ref().unwrap();
            assert!(asked.hurried, "{seconds} s");
            assert_eq!(asked.camera, session.scene.camera);
            session.frames.under_way = 0;
        }
        bench.skip(Duration::from_secs(60));
        assert!(!bench.session.filming.timeline.is_playing());
        bench.settle();
        let shown = &bench.session.frames.shown.as_ref().unwrap().request;
        assert!(!shown.hurried && shown.spared.is_none());
    }

    #[test]
    fn the_picture_is_refined_in_two_steps_where_full_quality_takes_long() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let shown = bench.session.frames.shown.as_ref().unwrap();
        let (wanted, stats) = (shown.request.clone(), shown.stats.clone());
        let mut situation = Situation {
            points_come: false,
            light_comes: false,
            soon_changes: false,
            rest: Some(Duration::from_millis(100)),
            a_mirror_is_dragged: false,
            is_recorded: false,
            milliseconds: 83.0,
        };
        // The pictures so far were drawn by another machine than that below.
        bench.session.frames.haste = Haste::default();
        let mut drawn = |situation: &Situation, careful: f64| {
            let frames = &mut bench.session.frames;
            frames.careful_milliseconds = careful;
            frames.requested = None;
            frames.request(wanted.clone(), situation, &mut bench.session.outside);
            let request = frames.requested.clone().unwrap();
            // A machine that takes a quarter of a millisecond for each pixel.
            let milliseconds = request.drawn_size().iter().map(|side| f64::from(*side)).product::<f64>() * 0.25;
            let stats = FrameStats { splatting_milliseconds: 1.0, ..stats.clone() };
            frames.show(request.clone(), stats, milliseconds, situation.milliseconds);
            request
        };
        (0..4).for_each(|_| drop(drawn(&situation, 1000.0)));
        let moving = drawn(&situation, 1000.0);
        situation.rest = None;
        let [first, second] = [0, 1].map(|_| drawn(&situation, 1000.0));
        let sizes = [&moving, &first, &second].map(FrameRequest::drawn_size);
        assert!(sizes[0][0] < sizes[1][0] && sizes[1][0] < sizes[2][0], "{sizes:?}");
        assert!(first.hurried && !second.hurried && second.spared.is_none());
        // Where full quality comes soon, it is the first step.
        situation.rest = Some(Duration::from_millis(100));
        assert!(drawn(&situation, 1000.0).hurried);
        situation.rest = None;
        assert!(!drawn(&situation, 300.0).hurried);
    }

    #[test]
    fn a_picture_that_takes_long_is_announced_by_the_time_that_those_before_took() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let frames = &mut bench.session.frames;
        let (wanted, stats) = (frames.requested.clone().unwrap(), frames.shown.as_ref().unwrap().stats.clone());
        frames.expected = None;
        let start = Instant::now();
        let shaders = frames.shaders.clone();
        frames.compiled_before = shaders.done();
        let mut told = |milliseconds: f64, method: Method, seconds: f64| {
            frames.show(wanted.clone(), stats.clone(), milliseconds, 40.0);
            let mut next = wanted.clone();
            (next.settings.reflection.method, next.settings.splat.size) = (method, 1.5);
            (frames.requested, frames.requested_at, frames.under_way) = (Some(next), Some(start), 1);
            frames.full_quality_under_way(start + Duration::from_secs_f64(seconds))
        };
        let method = method_of(&wanted);
        assert_eq!(told(20.0, method, 0.5), None, "it comes soon");
        assert_eq!(told(8000.0, method, 0.5), Some((0.5, Some(8.0))));
        // One that keeps what was found says little about the next.
        assert_eq!(told(20.0, method, 0.5), Some((0.5, Some(6.4))));
        // While shaders are compiled, a frame takes far longer than the next one will.
        shaders.add(1);
        assert_eq!(told(60_000.0, method, 0.5), Some((0.5, Some(6.4))));
        let other = if method == Method::Sscr { Method::None } else { Method::Sscr };
        assert_eq!(told(8000.0, other, 0.5), None);
        assert_eq!(told(8000.0, other, 3.0), Some((3.0, None)), "of another method nothing is known");
        frames.requested.as_mut().unwrap().hurried = true;
        assert_eq!(frames.full_quality_under_way(start + Duration::from_secs(9)), None);
    }

    #[test]
    fn a_picture_counts_once_it_is_presented_and_tells_which_input_it_follows() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let first = bench.session.frames.present(Instant::now()).unwrap();
        assert_eq!((&first["size"], &first["moving"]), (&json!([64, 48]), &json!(false)), "{first}");
        assert!(first["since_input_ms"].is_null() && first["points"].as_u64() > Some(0), "{first}");
        assert_eq!(bench.session.frames.present(Instant::now()), None);
        let input = Instant::now();
        bench.session.outside.input_at = Some(input);
        bench.session.act(Action::Orbit(glam::DVec2::new(40.0, 0.0)));
        bench.settle();
        // What comes after the request is not in the picture.
        bench.session.outside.input_at = Some(input + Duration::from_millis(10));
        let turned = bench.session.frames.present(input + Duration::from_millis(50)).unwrap();
        assert_eq!(turned["since_input_ms"], json!(50.0), "{turned}");
    }

    #[test]
    fn a_picture_is_late_when_it_does_not_show_a_value_after_a_while() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let late = |bench: &Bench, at| bench.session.frames.time_to_late(at);
        let start = Instant::now();
        assert_eq!(late(&bench, start), None);
        bench.session.act(Action::Orbit(glam::DVec2::new(40.0, 0.0)));
        bench.session.step(start, false);
        assert_eq!(late(&bench, start), None, "where the camera stands is no value of the panel");
        bench.session.scene.settings.splat.size = 1.5;
        bench.session.step(start, false);
        assert_eq!(late(&bench, start), Some(LATE));
        bench.session.scene.settings.splat.size = 1.6;
        bench.session.step(start + LATE / 2, false);
        assert_eq!(late(&bench, start + LATE / 2), Some(LATE / 2), "the oldest change that is not shown counts");
        assert_eq!(late(&bench, start + 2 * LATE), Some(Duration::ZERO));
        bench.settle();
        assert_eq!(late(&bench, start + 2 * LATE), None);
    }
    #[test]
    fn a_picture_is_late_until_it_shows_colours_that_were_still_to_be_made() {
        let Some(mut bench) = Bench::with_sphere() else { return };
        bench.settle();
        let start = Instant::now();
        let late = |bench: &Bench| bench.session.frames.time_to_late(start + 2 * LATE);
        let frames = &mut bench.session.frames;
        frames.note_coloring(true, start);
        assert_eq!(frames.time_to_late(start), Some(LATE));
        frames.note_coloring(false, start + LATE);
        assert_eq!(late(&bench), None, "the points have the colours that they had");
        let frames = &mut bench.session.frames;
        frames.note_coloring(true, start);
        frames.points_changed();
        frames.note_coloring(false, start + LATE);
        assert_eq!(late(&bench), Some(Duration::ZERO), "the picture does not show them yet");
        bench.settle();
        assert_eq!(late(&bench), None);
    }
}
