//! Camera paths through a scene: keyframes at given times, and the smooth motion between them.
//!
//! Eye, pivot and the direction up each follow a cubic Hermite spline in time. At an inner keyframe the velocity is
//! that of the parabola through it and its two neighbours, as in the splines of Catmull and Rom ("A class of local
//! interpolating splines", 1974) for unequal intervals of time (Barry and Goldman, "A recursive evaluation algorithm
//! for a class of Catmull-Rom splines", 1988). At the first and the last keyframe it is that of the straight line to
//! the neighbour. Two changes keep the camera from passing a keyframe and coming back to it:
//!
//! - Where the path turns by more than a right angle the velocity decreases with the angle, down to zero where it
//!   turns back.
//! - It is at most three times the speed of the slower of the two straight lines that meet there. Under this bound a
//!   cubic between values that rise only rises (Fritsch and Carlson, "Monotone piecewise cubic interpolation", 1980).
//!
//! So a camera on a straight line never turns between keyframes that all go forward, and one with two keyframes at one
//! place stands still between them.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::Camera;

/// A camera path, as `[[paths]]` of a scene file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    pub name: String,
    /// The keyframes: at least one, at times that rise.
    #[serde(default)]
    pub keyframes: Vec<Keyframe>,
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
    /// The number of the keyframe, from 0; `None` for the path as a whole.
    pub(crate) keyframe: Option<usize>,
    /// The key with the wrong value.
    pub(crate) key: &'static str,
    pub(crate) problem: String,
}

impl CameraPath {
    /// The time of the last keyframe in seconds.
    pub fn duration(&self) -> f64 {
        self.keyframes.last().map_or(0.0, |keyframe| keyframe.time)
    }

    /// The camera at a time in seconds; the first keyframe's before it, the last one's after it. `None` for a path
    /// without keyframes, which no scene file has.
    pub fn camera(&self, time: f64) -> Option<Camera> {
        let next = self.keyframes.partition_point(|keyframe| keyframe.time <= time);
        let Some(last) = next.checked_sub(1) else { return self.keyframes.first().map(Keyframe::camera) };
        let (from, to) = (&self.keyframes[last], self.keyframes.get(next));
        let Some(to) = to.filter(|_| from.time < time) else { return Some(from.camera()) };
        let up = self.value(last, time, |keyframe| keyframe.up.normalize_or_zero());
        // There is no direction halfway between opposite ones.
        let up = up.try_normalize().unwrap_or(if time - from.time < to.time - time { from.up } else { to.up });
        let (eye, pivot) = (self.value(last, time, |keyframe| keyframe.eye), self.value(last, time, |k| k.pivot));
        Some(Camera::from_eye(eye, pivot, up))
    }

    /// One of the values of the keyframes at a time between keyframe `from` and the next one.
    fn value(&self, from: usize, time: f64, of: impl Fn(&Keyframe) -> DVec3) -> DVec3 {
        let [start, end] = [&self.keyframes[from], &self.keyframes[from + 1]];
        let span = end.time - start.time;
        let share = (time - start.time) / span;
        let (squared, cubed) = (share * share, share * share * share);
        let leaving = self.velocity(from, &of) * (span * (cubed - 2.0 * squared + share));
        let arriving = self.velocity(from + 1, &of) * (span * (cubed - squared));
        of(start) + (of(end) - of(start)) * (3.0 * squared - 2.0 * cubed) + leaving + arriving
    }

    /// The velocity of a value at a keyframe, in its units a second.
    fn velocity(&self, at: usize, of: impl Fn(&Keyframe) -> DVec3) -> DVec3 {
        let span = |from: usize| self.keyframes[from + 1].time - self.keyframes[from].time;
        let slope = |from: usize| (of(&self.keyframes[from + 1]) - of(&self.keyframes[from])) / span(from);
        let (before, after) = (at.checked_sub(1), Some(at).filter(|at| at + 1 < self.keyframes.len()));
        let (Some(before), Some(after)) = (before, after) else {
            return before.or(after).map_or(DVec3::ZERO, slope);
        };
        let (arriving, leaving) = (slope(before), slope(after));
        let parabola = (arriving * span(after) + leaving * span(before)) / (span(before) + span(after));
        let cosine = arriving.normalize_or_zero().dot(leaving.normalize_or_zero());
        let slower = arriving.length().min(leaving.length());
        (parabola * (1.0 + cosine).clamp(0.0, 1.0)).clamp_length_max(3.0 * slower)
    }

    /// Why the path is not valid, if it is not.
    pub(crate) fn problem(&self) -> Option<PathProblem> {
        let whole = |key, problem: &str| Some(PathProblem { keyframe: None, key, problem: problem.into() });
        if self.name.trim().is_empty() {
            return whole("name", "a path needs a name");
        }
        if self.keyframes.is_empty() {
            return whole("keyframes", "a path needs at least one keyframe");
        }
        let mut before = None;
        for (index, keyframe) in self.keyframes.iter().enumerate() {
            if let Some((key, problem)) = keyframe.problem(before) {
                return Some(PathProblem { keyframe: Some(index), key, problem });
            }
            before = Some(keyframe.time);
        }
        None
    }
}

impl Keyframe {
    fn camera(&self) -> Camera {
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
        let far = |place: DVec3| {
            (!Camera::is_near(place)).then(|| format!("not finite, or beyond {:e}", Camera::MOST_COORDINATE))
        };
        let odd = far(self.eye).map(|problem| ("eye", problem)).or(far(self.pivot).map(|problem| ("pivot", problem)));
        let is_direction = self.up.is_finite() && self.up.try_normalize().is_some();
        odd.or((!is_direction).then(|| ("up", "no direction".into())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(places: &[(f64, [f64; 3])]) -> CameraPath {
        let keyframe = |(time, eye): &(f64, [f64; 3])| Keyframe {
            time: *time,
            eye: DVec3::from_array(*eye),
            pivot: DVec3::new(0.0, 100.0, 1.0),
            up: DVec3::Z,
        };
        CameraPath { name: "tour".into(), keyframes: places.iter().map(keyframe).collect() }
    }

    /// Times from before the path to after it.
    fn times(path: &CameraPath) -> impl Iterator<Item = f64> + use<> {
        let duration = path.duration();
        (-10..=1010).map(move |step| duration * f64::from(step) / 1000.0)
    }

    /// Places that differ by a stride of the golden ratio.
    fn winding(count: usize) -> CameraPath {
        let place = |index: usize| {
            let share = |step: f64| (index as f64 * step).fract();
            (index as f64 + share(0.618), [20.0 * share(0.755), 20.0 * share(0.57), 5.0 * share(0.325)])
        };
        let mut path = path(&(0..count).map(place).collect::<Vec<_>>());
        for (index, keyframe) in path.keyframes.iter_mut().enumerate() {
            keyframe.up = DVec3::new((index as f64 * 0.4).sin() * 0.3, 0.1, 1.0) * (1.0 + index as f64);
            keyframe.pivot += DVec3::new(index as f64, 0.0, 0.0);
        }
        path
    }

    #[test]
    fn a_path_passes_through_its_keyframes_to_the_bit() {
        let path = winding(12);
        for keyframe in &path.keyframes {
            let expected = Camera::from_eye(keyframe.eye, keyframe.pivot, keyframe.up);
            assert_eq!(path.camera(keyframe.time), Some(expected));
        }
    }

    #[test]
    fn motion_has_no_jumps_in_place_or_velocity() {
        let path = winding(12);
        let step = 1e-4;
        let eye = |time: f64| path.camera(time).unwrap().eye;
        let velocity = |time: f64| (eye(time + step) - eye(time)) / step;
        for keyframe in &path.keyframes[1..11] {
            let (before, after) = (velocity(keyframe.time - 2.0 * step), velocity(keyframe.time + step));
            assert!(before.distance(after) < 0.1, "{before} {after} at {}", keyframe.time);
            assert!(eye(keyframe.time - 1e-9).distance(eye(keyframe.time + 1e-9)) < 1e-6);
        }
    }

    #[test]
    fn one_keyframe_stands_still() {
        let path = path(&[(2.0, [1.0, 2.0, 3.0])]);
        let still = path.camera(0.0).unwrap();
        assert!(still.eye.abs_diff_eq(DVec3::new(1.0, 2.0, 3.0), 1e-9));
        assert!([-1.0, 1.999, 2.0, 50.0].into_iter().all(|time| path.camera(time) == Some(still)));
    }

    #[test]
    fn times_outside_are_those_of_the_ends() {
        let path = winding(5);
        let end = path.duration();
        assert_eq!(path.camera(-3.0), path.camera(path.keyframes[0].time));
        assert_eq!(path.camera(f64::NEG_INFINITY), path.camera(path.keyframes[0].time));
        assert_eq!(path.camera(end + 3.0), path.camera(end));
        assert_eq!(path.camera(f64::INFINITY), path.camera(end));
    }

    #[test]
    fn nothing_that_goes_forward_on_a_line_turns_back_and_a_pause_is_one() {
        let direction = DVec3::new(0.48, -0.6, 0.64);
        // Slow and fast stretches side by side, a pause, and short intervals beside long ones.
        let stops = [(0.0, 0.0), (1.0, 0.1), (1.2, 9.0), (5.0, 9.2), (6.0, 9.2), (6.1, 30.0), (20.0, 31.0)];
        let path = path(&stops.map(|(time, along)| (time, (direction * along).to_array())));
        let along: Vec<f64> = times(&path).map(|time| path.camera(time).unwrap().eye.dot(direction)).collect();
        assert!(along.is_sorted_by(|a, b| a <= &(b + 1e-9)), "{along:?}");
        assert!((0..=20).all(|step| path.camera(5.0 + f64::from(step) / 20.0) == path.camera(5.0)));
    }

    #[test]
    fn a_camera_that_turns_back_does_so_at_the_keyframe() {
        let path = path(&[(0.0, [0.0; 3]), (1.0, [10.0, 0.0, 0.0]), (2.0, [7.0, 0.0, 0.0])]);
        let most = times(&path).map(|time| path.camera(time).unwrap().eye.x).fold(0.0, f64::max);
        assert!(most <= 10.0 + 1e-9, "{most}");
    }

    #[test]
    fn directions_up_turn_over_the_way_between_and_never_vanish() {
        let mut turned = path(&[(0.0, [0.0; 3]), (1.0, [1.0, 0.0, 0.0])]);
        turned.keyframes[1].up = DVec3::X * 1000.0;
        let half = turned.camera(0.5).unwrap().up;
        assert!(half.abs_diff_eq((DVec3::X + DVec3::Z).normalize(), 1e-9), "{half}");
        turned.keyframes[1].up = -DVec3::Z;
        assert!(times(&turned).all(|time| turned.camera(time).unwrap().up.is_normalized()));
    }

    #[test]
    fn the_camera_is_finite_all_along_even_where_the_eye_meets_the_pivot() {
        let mut path = winding(12);
        path.keyframes[4].pivot = path.keyframes[4].eye;
        for time in times(&path) {
            let camera = path.camera(time).unwrap();
            assert!(camera.view_from_world().is_finite() && camera.eye.is_finite(), "{camera:?}");
        }
        assert_eq!(CameraPath::default().camera(0.0), None);
    }
}
