//! Camera paths through a scene: keyframes at given times, and tracks of what else changes (`track.rs`). `motion.rs`
//! leads the camera from one keyframe to the next.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::caption::MOST_CAPTIONS;
use crate::{Camera, Caption, Ease, Motion, Track, WipeState};

/// The most tracks of a path.
pub(crate) const MOST_TRACKS: usize = 256;

/// A camera path, as `[[paths]]` of a scene file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    pub name: String,
    /// The speed of the eye in world units a second, if it is constant. Then the times of keyframes give their order, and
    /// how long the eye rests between two in one place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Whether the path goes on at its beginning, where its last keyframe is, too.
    #[serde(default, rename = "loop", skip_serializing_if = "std::ops::Not::not")]
    pub is_loop: bool,
    /// How the camera goes from one keyframe to the next.
    #[serde(default, skip_serializing_if = "Ease::is_smooth")]
    pub ease: Ease,
    /// The keyframes: at least one, at times that rise.
    #[serde(default)]
    pub keyframes: Vec<Keyframe>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tracks: Vec<Track>,
    /// The texts over its pictures.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub captions: Vec<Caption>,
    /// The states that its pictures show side by side, from left to right: none, two or three.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub states: Vec<WipeState>,
}

/// The camera at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Keyframe {
    /// The time in seconds from the beginning of the path.
    pub time: f64,
    /// The eye in world units.
    pub eye: DVec3,
    /// The point that the camera looks at, in world units.
    pub pivot: DVec3,
    /// The up direction, of any length but zero.
    pub up: DVec3,
}

/// An error in a path.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PathProblem {
    /// The list of the path and the number in it, from 0; `None` for the path as a whole.
    pub(crate) place: Option<(&'static str, usize)>,
    /// The key with the wrong value.
    pub(crate) key: &'static str,
    pub(crate) problem: String,
}

impl CameraPath {
    /// The most seconds that a path lasts. A recording of one picture a second has a tenth as many at most.
    pub const MOST_SECONDS: f64 = 1e7;

    /// How long the path lasts in seconds: until the last keyframe, and until the last time of a track.
    pub fn duration(&self) -> f64 {
        let camera = Motion::new(self).map_or(0.0, |motion| motion.duration());
        self.tracks.iter().flat_map(|track| track.times.last()).copied().fold(camera, f64::max)
    }

    /// Warnings about its captions, for before pictures of it are made: what stands in braces and is no parameter.
    pub fn warnings(&self) -> Vec<String> {
        let unknown = |(index, caption): (usize, &Caption)| {
            let of = |key: &&str| {
                format!("path `{}`, caption {}: `{{{key}}}` is no parameter, and stays", self.name, index + 1)
            };
            caption.unknown_keys().iter().map(of).collect::<Vec<_>>()
        };
        self.captions.iter().enumerate().flat_map(unknown).collect()
    }

    /// Why the path is not valid, if it is not.
    pub(crate) fn problem(&self) -> Option<PathProblem> {
        let whole = |key, problem: &str| Some(PathProblem { place: None, key, problem: problem.into() });
        if self.name.trim().is_empty() {
            return whole("name", "a path needs a name");
        }
        let (Some(first), Some(last)) = (self.keyframes.first(), self.keyframes.last()) else {
            return whole("keyframes", "a path needs at least one keyframe");
        };
        let mut before = None;
        for (index, keyframe) in self.keyframes.iter().enumerate() {
            if let Some((key, problem)) = keyframe.problem(before) {
                return Some(PathProblem { place: Some(("keyframes", index)), key, problem });
            }
            before = Some(keyframe.time);
        }
        if self.is_loop && (self.keyframes.len() < 2 || (Keyframe { time: last.time, ..*first }) != *last) {
            return whole("loop", "the last keyframe of a loop has the eye, pivot and up of the first one");
        }
        if let Some(speed) = self.speed {
            let moves = self.keyframes.windows(2).any(|ends| ends[0].eye != ends[1].eye);
            if !(speed > 0.0 && speed.is_finite() && moves) {
                return whole("speed", "expected world units a second above 0, and an eye that moves");
            }
            if !self.ease.is_smooth() {
                return whole("ease", "a path with a constant speed has none");
            }
        }
        if self.tracks.len() > MOST_TRACKS {
            return whole("tracks", &format!("{}, expected at most {MOST_TRACKS}", self.tracks.len()));
        }
        let problem = |(index, track): (usize, &Track)| {
            let (key, problem) = track.problem()?;
            Some(PathProblem { place: Some(("tracks", index)), key, problem })
        };
        if let Some(problem) = self.tracks.iter().enumerate().find_map(problem) {
            return Some(problem);
        }
        if let Some((place, key, problem)) = crate::wipe::problem(&self.states, &self.tracks) {
            return Some(PathProblem { place, key, problem });
        }
        if self.captions.len() > MOST_CAPTIONS {
            return whole("captions", &format!("{}, expected at most {MOST_CAPTIONS}", self.captions.len()));
        }
        let problem = |(index, caption): (usize, &Caption)| {
            let (key, problem) = caption.problem()?;
            Some(PathProblem { place: Some(("captions", index)), key, problem })
        };
        if let Some(problem) = self.captions.iter().enumerate().find_map(problem) {
            return Some(problem);
        }
        let duration = self.duration();
        // NaN fails the comparison.
        let is_short = duration <= Self::MOST_SECONDS;
        let key = if self.speed.is_some() { "speed" } else { "keyframes" };
        (!is_short).then(|| PathProblem {
            place: None,
            key,
            problem: format!("the path lasts {duration:e} seconds, expected at most {:e}", Self::MOST_SECONDS),
        })
    }
}

impl Keyframe {
    pub(crate) fn camera(&self) -> Camera {
        Camera::from_eye(self.eye, self.pivot, self.up)
    }

    /// `before` is the time of the keyframe before.
    fn problem(&self, before: Option<f64>) -> Option<(&'static str, String)> {
        let time = self.time;
        // Comparisons that a NaN fails.
        if !(time >= 0.0 && time.is_finite()) {
            return Some(("time", format!("{time}, expected seconds from 0 on")));
        }
        if let Some(before) = before.filter(|before| *before >= time) {
            return Some(("time", format!("{time}, expected more than the {before} of the keyframe before")));
        }
        let Self { eye, pivot, up, .. } = *self;
        Camera { eye, pivot, up }.problem()
    }
}
