//! The motion of a camera along a path.
//!
//! The eye follows a smooth curve through the keyframes (`curve.rs`), and comes to each at its time; with `speed` it
//! goes on evenly. The length of the way that it has gone rises with time as a cubic that never falls (Fritsch and
//! Carlson), and slows down where the curve turns back.
//!
//! The direction of view turns by quaternions: between two keyframes along the cumulative curve of Kim, Kim and Shin ("A
//! general construction scheme for unit quaternion curves with simple high order derivatives", 1995), whose angular
//! velocities at keyframes are bounded so that no turn goes beyond its end. Between keyframes with one pivot the camera
//! looks at it. The direction up turns from that of one keyframe to that of the next, so a level horizon stays level.

use glam::{DMat3, DQuat, DVec3};

use crate::curve::{Curve, derivative, derivatives, hermite};
use crate::{Camera, CameraPath, Ease, Keyframe};

/// The cosines of the angles between the view and the direction up at which the turn itself begins to decide what is
/// up, and at which it alone does: there the horizon is out of sight, and says nothing.
const STEEP: [f64; 2] = [0.94, 0.99];

/// A path with all that its motion needs.
pub struct Motion {
    keyframes: Vec<Keyframe>,
    is_loop: bool,
    ease: Ease,
    /// When the camera is at each keyframe.
    times: Vec<f64>,
    way: Curve,
    /// The speeds of the eye at keyframes, for each stretch at its ends, in world units a second.
    speeds: Vec<[f64; 2]>,
    /// The camera's axes at keyframes.
    turns: Vec<DQuat>,
    /// The angular velocities at keyframes, in the camera's axes, radians a second.
    spins: Vec<DVec3>,
    /// The distances to the pivots, and how they change a second.
    distances: Vec<f64>,
    approaches: Vec<f64>,
}

impl Motion {
    /// `None` for a path without keyframes, which no scene file has.
    pub fn new(path: &CameraPath) -> Option<Self> {
        let CameraPath { keyframes, ease, speed, .. } = path;
        let first = keyframes.first()?;
        let stretches = keyframes.len() - 1;
        let is_loop = path.is_loop && stretches > 0;
        let way = Curve::new(keyframes.iter().map(|keyframe| keyframe.eye).collect(), is_loop);
        let lengths: Vec<f64> = (0..stretches).map(|stretch| way.length(stretch)).collect();
        let mut times = vec![first.time];
        for (index, length) in lengths.iter().enumerate() {
            let pause = keyframes[index + 1].time - keyframes[index].time;
            let span = speed.filter(|_| *length > 0.0).map_or(pause, |speed| length / speed);
            times.push(times[index] + span);
        }
        let spans: Vec<f64> = times.windows(2).map(|ends| ends[1] - ends[0]).collect();
        let rates: Vec<f64> = lengths.iter().zip(&spans).map(|(length, span)| length / span).collect();
        let before = |point: usize| if point > 0 { Some(point - 1) } else { is_loop.then(|| stretches - 1) };
        let after = |point: usize| if point < stretches { Some(point) } else { is_loop.then_some(0) };
        let smooth = derivatives(&rates, &spans, is_loop);
        let slowed = |point: usize| match (before(point), after(point)) {
            // The curve is the sharper there, so it is followed by the square of what its derivative decreases by.
            (Some(before), Some(after)) => smooth[point] * (1.0 + way.cosine(before, after)).clamp(0.0, 1.0).powi(2),
            _ => smooth[point],
        };
        let speeds = (0..stretches).map(|stretch| match ease {
            _ if speed.is_some() => [rates[stretch]; 2],
            Ease::Smooth => [slowed(stretch), slowed(stretch + 1)],
            Ease::Linear => [rates[stretch]; 2],
            Ease::InOut | Ease::Hold => [0.0; 2],
        });
        let speeds = speeds.collect();
        let turns: Vec<DQuat> = keyframes.iter().map(|keyframe| axes(&keyframe.camera())).collect();
        let arcs: Vec<DVec3> = turns.windows(2).map(|ends| arc(ends[0], ends[1])).collect();
        let slopes: Vec<DVec3> = arcs.iter().zip(&spans).map(|(arc, span)| *arc / *span).collect();
        let spin = |point: usize| {
            let (before, after) = (before(point), after(point));
            let spin = match (before, after) {
                (Some(before), Some(after)) => {
                    derivative([slopes[before], slopes[after]], [spans[before], spans[after]])
                }
                (Some(only), None) | (None, Some(only)) => slopes[only],
                (None, None) => DVec3::ZERO,
            };
            // A third of it, for as long as the stretch lasts, leads half of the way to the other end at most.
            let most = |stretch: usize| 1.5 * slopes[stretch].dot(spin.normalize_or_zero()).max(0.0);
            spin.clamp_length_max(before.into_iter().chain(after).map(most).fold(f64::INFINITY, f64::min).min(1e30))
        };
        let spins = (0..=stretches).map(|point| match ease {
            Ease::Smooth => spin(point),
            Ease::Linear | Ease::InOut | Ease::Hold => DVec3::ZERO,
        });
        let spins = spins.collect();
        let distances: Vec<f64> = keyframes.iter().map(|keyframe| keyframe.camera().distance()).collect();
        let changes = distances.windows(2).zip(&spans).map(|(ends, span)| (ends[1] - ends[0]) / span);
        let approaches = derivatives(&changes.collect::<Vec<_>>(), &spans, is_loop);
        let (keyframes, ease) = (keyframes.clone(), *ease);
        Some(Self { keyframes, is_loop, ease, times, way, speeds, turns, spins, distances, approaches })
    }

    /// When the camera is at each keyframe, in seconds.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The time of the last keyframe in seconds.
    pub fn duration(&self) -> f64 {
        self.times.last().copied().unwrap_or_default()
    }

    /// The camera at a time in seconds: before the first keyframe that of the first one; after the last keyframe that of
    /// the last one, or again from the first one on in a loop.
    pub fn camera(&self, time: f64) -> Camera {
        let (first, end) = (self.times[0], self.duration());
        let time =
            if self.is_loop && time > end && time.is_finite() { first + (time - first) % (end - first) } else { time };
        let next = self.times.partition_point(|keyframe| *keyframe <= time);
        let Some(last) = next.checked_sub(1) else { return self.keyframes[0].camera() };
        let (from, to) = (&self.keyframes[last], self.keyframes.get(next));
        let Some(to) = to.filter(|_| self.times[last] < time && self.ease != Ease::Hold) else { return from.camera() };
        let span = self.times[next] - self.times[last];
        let share = (time - self.times[last]) / span;
        let [_, _, leaving, arriving] = hermite(share);
        let rise = hermite(share)[1];
        let [start, stop] = self.speeds[last];
        let eye = self.way.place(last, self.way.length(last) * rise + (start * leaving + stop * arriving) * span);
        let turned = match self.ease {
            Ease::Linear => self.turns[last].slerp(self.turns[next], share),
            _ => self.turned(last, share, span),
        };
        // A turn as wide as the axes may go, which the share of the cubic follows without its ends' velocities.
        let even = if self.ease == Ease::Linear { share } else { rise };
        let level = level(from.up, to.up, even);
        if from.pivot == to.pivot {
            let forward = (to.pivot - eye).try_normalize().unwrap_or(turned * DVec3::NEG_Z);
            return Camera::from_eye(eye, to.pivot, upright(forward, level, turned));
        }
        let distance = self.distances[last] + (self.distances[next] - self.distances[last]) * even;
        let distance = match self.ease {
            Ease::Smooth => distance + (self.approaches[last] * leaving + self.approaches[next] * arriving) * span,
            _ => distance,
        };
        let forward = turned * DVec3::NEG_Z;
        Camera::from_eye(eye, eye + forward * distance, upright(forward, level, turned))
    }

    /// The camera's axes after a share of the turn from keyframe `last` to the next one.
    fn turned(&self, last: usize, share: f64, span: f64) -> DQuat {
        let [from, to] = [self.turns[last], self.turns[last + 1]];
        let [leaving, arriving] = [self.spins[last], self.spins[last + 1]].map(|spin| spin * (span / 3.0));
        let between = arc(from * rotation(leaving), to * rotation(-arriving));
        let (rest, squared, cubed) = (1.0 - share, share * share, share * share * share);
        let shares = [1.0 - rest * rest * rest, 3.0 * squared - 2.0 * cubed, cubed];
        let parts = [leaving * shares[0], between * shares[1], arriving * shares[2]];
        parts.into_iter().fold(from, |turn, part| turn * rotation(part)).normalize()
    }
}

/// The axes of a camera: right, up, backwards.
fn axes(camera: &Camera) -> DQuat {
    let (right, forward) = (camera.right(), camera.forward());
    DQuat::from_mat3(&DMat3::from_cols(right, right.cross(forward), -forward)).normalize()
}

/// The shortest turn from one to the other, as an axis times an angle, in the axes of either.
fn arc(from: DQuat, to: DQuat) -> DVec3 {
    let turn = from.conjugate() * to;
    (if turn.w < 0.0 { -turn } else { turn }).to_scaled_axis()
}

fn rotation(arc: DVec3) -> DQuat {
    DQuat::from_scaled_axis(arc)
}

/// The direction up on the way from one to another.
fn level(from: DVec3, to: DVec3, share: f64) -> DVec3 {
    let [from, to] = [from, to].map(|up| up.normalize_or(DVec3::Z));
    if from == to { from } else { DQuat::IDENTITY.slerp(DQuat::from_rotation_arc(from, to), share) * from }
}

/// The direction up of a camera that looks along `forward`: `level`, or that of its axes where it looks along that.
fn upright(forward: DVec3, level: DVec3, axes: DQuat) -> DVec3 {
    let steep = ((forward.dot(level).abs() - STEEP[0]) / (STEEP[1] - STEEP[0])).clamp(0.0, 1.0);
    if steep == 0.0 {
        return level;
    }
    let own = DMat3::from_quat(axes).y_axis;
    // The part of the direction up that shows.
    let across = level.reject_from_normalized(forward).normalize_or(own);
    across.lerp(own, steep * steep * (3.0 - 2.0 * steep)).normalize_or(own)
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
        let keyframes = places.iter().map(keyframe).collect();
        CameraPath { name: "tour".into(), keyframes, ..CameraPath::default() }
    }

    fn camera(path: &CameraPath, time: f64) -> Camera {
        Motion::new(path).unwrap().camera(time)
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
            assert_eq!(camera(&path, keyframe.time), expected);
        }
    }

    #[test]
    fn motion_has_no_jumps_in_place_or_velocity() {
        let path = winding(12);
        let step = 1e-4;
        let eye = |time: f64| camera(&path, time).eye;
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
        let still = camera(&path, 0.0);
        assert!(still.eye.abs_diff_eq(DVec3::new(1.0, 2.0, 3.0), 1e-9));
        assert!([-1.0, 1.999, 2.0, 50.0].into_iter().all(|time| camera(&path, time) == still));
    }

    #[test]
    fn times_outside_are_those_of_the_ends() {
        let path = winding(5);
        let end = path.duration();
        assert_eq!(camera(&path, -3.0), camera(&path, path.keyframes[0].time));
        assert_eq!(camera(&path, f64::NEG_INFINITY), camera(&path, path.keyframes[0].time));
        assert_eq!(camera(&path, end + 3.0), camera(&path, end));
        assert_eq!(camera(&path, f64::INFINITY), camera(&path, end));
    }

    #[test]
    fn nothing_that_goes_forward_on_a_line_turns_back_and_a_pause_is_one() {
        let direction = DVec3::new(0.48, -0.6, 0.64);
        // Slow and fast stretches side by side, a pause, and short intervals beside long ones.
        let stops = [(0.0, 0.0), (1.0, 0.1), (1.2, 9.0), (5.0, 9.2), (6.0, 9.2), (6.1, 30.0), (20.0, 31.0)];
        let path = path(&stops.map(|(time, along)| (time, (direction * along).to_array())));
        let along: Vec<f64> = times(&path).map(|time| camera(&path, time).eye.dot(direction)).collect();
        assert!(along.is_sorted_by(|a, b| a <= &(b + 1e-9)), "{along:?}");
        assert!((0..=20).all(|step| camera(&path, 5.0 + f64::from(step) / 20.0) == camera(&path, 5.0)));
    }

    #[test]
    fn a_camera_that_turns_back_does_so_at_the_keyframe() {
        let path = path(&[(0.0, [0.0; 3]), (1.0, [10.0, 0.0, 0.0]), (2.0, [7.0, 0.0, 0.0])]);
        let most = times(&path).map(|time| camera(&path, time).eye.x).fold(0.0, f64::max);
        assert!(most <= 10.0 + 1e-9, "{most}");
    }

    #[test]
    fn directions_up_turn_over_the_way_between_and_never_vanish() {
        let mut turned = path(&[(0.0, [0.0; 3]), (1.0, [1.0, 0.0, 0.0])]);
        turned.keyframes[1].up = DVec3::X * 1000.0;
        let half = camera(&turned, 0.5).up;
        assert!(half.abs_diff_eq((DVec3::X + DVec3::Z).normalize(), 1e-9), "{half}");
        turned.keyframes[1].up = -DVec3::Z;
        assert!(times(&turned).all(|time| camera(&turned, time).up.is_normalized()));
    }

    #[test]
    fn the_camera_is_finite_all_along_even_where_the_eye_meets_the_pivot() {
        let mut path = winding(12);
        path.keyframes[4].pivot = path.keyframes[4].eye;
        for time in times(&path) {
            let camera = camera(&path, time);
            assert!(camera.view_from_world().is_finite() && camera.eye.is_finite(), "{camera:?}");
        }
        assert!(Motion::new(&CameraPath::default()).is_none());
    }

    /// The angle between the views of two cameras, in radians.
    fn angle(a: &Camera, b: &Camera) -> f64 {
        a.forward().angle_between(b.forward())
    }

    #[test]
    fn a_constant_speed_is_constant_within_two_percent_and_pauses_stay() {
        let mut path = winding(12);
        // A pause: the eye rests while the view turns.
        path.keyframes[6].eye = path.keyframes[5].eye;
        path.speed = Some(2.5);
        let motion = Motion::new(&path).unwrap();
        let pause = motion.times()[5]..motion.times()[6];
        assert!((pause.end - pause.start - (path.keyframes[6].time - path.keyframes[5].time)).abs() < 1e-9);
        let step = 1.0 / 240.0;
        let mut time = 0.0;
        let mut count = 0;
        while time + step < motion.duration() {
            let speed = motion.camera(time).eye.distance(motion.camera(time + step).eye) / step;
            let is_within = |range: &std::ops::Range<f64>| range.contains(&time) && range.contains(&(time + step));
            let is_beside = time + step < pause.start || time > pause.end;
            if is_beside && !motion.times().iter().any(|at| (time..time + step).contains(at)) {
                assert!((speed / 2.5 - 1.0).abs() < 0.02, "{speed} at {time}");
                count += 1;
            }
            assert!(!is_within(&pause) || speed < 1e-9, "{speed} at {time}");
            time += step;
        }
        assert!(count > 1000, "{count}");
    }

    #[test]
    fn no_turn_of_the_view_goes_beyond_its_end() {
        // Turns of the view in one plane, fast and slow ones side by side, forth and back.
        let headings = [0.0, 10.0, 100.0, 100.0, 95.0, -60.0, -61.0, 170.0_f64];
        let times = [0.0, 1.0, 1.3, 2.0, 6.0, 6.5, 9.0, 10.0];
        let mut turning = path(&times.map(|time| (time, [0.0; 3])));
        for (keyframe, heading) in turning.keyframes.iter_mut().zip(headings) {
            let (sine, cosine) = heading.to_radians().sin_cos();
            keyframe.pivot = DVec3::new(cosine, sine, 0.3);
        }
        let motion = Motion::new(&turning).unwrap();
        let heading = |time: f64| {
            let forward = motion.camera(time).forward();
            forward.y.atan2(forward.x).to_degrees()
        };
        for (ends, between) in headings.windows(2).zip(times.windows(2)) {
            // Of a half turn and more the shorter way counts; none of these is one.
            let mut before = ends[0];
            for step in 0..=100 {
                let now = heading(between[0] + (between[1] - between[0]) * f64::from(step) / 100.0);
                let way = (now - before + 540.0).rem_euclid(360.0) - 180.0;
                let whole = (ends[1] - ends[0] + 540.0).rem_euclid(360.0) - 180.0;
                assert!(way * whole.signum() > -0.5, "{ends:?}: from {before} to {now}");
                before = now;
            }
        }
        // Any turns: the view stays as near to both ends as they are to one another.
        let path = winding(30);
        let motion = Motion::new(&path).unwrap();
        let still = |keyframe: &Keyframe| Keyframe { eye: DVec3::ZERO, pivot: keyframe.eye - 10.0, ..*keyframe };
        let still = CameraPath { keyframes: path.keyframes.iter().map(still).collect(), ..path.clone() };
        let turns = Motion::new(&still).unwrap();
        for (last, ends) in motion.times().windows(2).enumerate() {
            let [from, to] = [turns.turns[last], turns.turns[last + 1]];
            let whole = arc(from, to).length();
            for step in 0..=100 {
                let now = turns.turned(last, f64::from(step) / 100.0, ends[1] - ends[0]);
                let farthest = arc(from, now).length().max(arc(now, to).length());
                assert!(farthest < whole * 1.02 + 1e-6, "{ends:?}: {farthest} of {whole}");
            }
        }
    }

    #[test]
    fn a_loop_goes_on_without_a_jump_in_place_speed_or_view() {
        let mut path = winding(9);
        let first = path.keyframes[0];
        path.keyframes.push(Keyframe { time: 10.0, ..first });
        path.is_loop = true;
        assert_eq!(path.problem(), None);
        for speed in [None, Some(3.0)] {
            path.speed = speed;
            let motion = Motion::new(&path).unwrap();
            let end = motion.duration();
            let step = 1e-4;
            let velocity = |time: f64| (motion.camera(time + step).eye - motion.camera(time).eye) / step;
            let spin = |time: f64| (motion.camera(time + step).forward() - motion.camera(time).forward()) / step;
            assert_eq!(motion.camera(end), motion.camera(motion.times()[0]));
            let (before, after) = (end - 2.0 * step, end + step);
            assert!(velocity(before).distance(velocity(after)) < 0.1, "{} {}", velocity(before), velocity(after));
            assert!(spin(before).distance(spin(after)) < 0.05, "{} {}", spin(before), spin(after));
            let again = end - motion.times()[0];
            assert!(motion.camera(3.3 + again).eye.distance(motion.camera(3.3).eye) < 1e-6);
        }
        path.keyframes[9].eye.x += 1e-3;
        assert!(path.problem().is_some_and(|problem| problem.key == "loop"), "{:?}", path.problem());
    }

    #[test]
    fn each_ease_leaves_and_arrives_as_it_says() {
        let mut path = path(&[(0.0, [0.0; 3]), (1.0, [2.0, 0.0, 0.0]), (3.0, [10.0, 0.0, 0.0])]);
        let speed = |path: &CameraPath, time: f64| {
            let motion = Motion::new(path).unwrap();
            (motion.camera(time + 1e-5).eye.x - motion.camera(time).eye.x) * 1e5
        };
        path.ease = Ease::Linear;
        assert!([0.1, 0.5, 0.9].iter().all(|time| (speed(&path, *time) - 2.0).abs() < 1e-3));
        assert!([1.1, 2.0, 2.9].iter().all(|time| (speed(&path, *time) - 4.0).abs() < 1e-3));
        path.ease = Ease::InOut;
        assert!([0.0, 0.99999, 1.0, 2.99998].iter().all(|time| speed(&path, *time).abs() < 1e-2));
        assert!(speed(&path, 2.0) > 5.9);
        path.ease = Ease::Hold;
        for (time, expected) in [(0.5, 0.0), (0.999, 0.0), (1.0, 2.0), (2.9, 2.0), (3.0, 10.0)] {
            assert!((camera(&path, time).eye.x - expected).abs() < 1e-9, "{time}");
        }
    }

    #[test]
    fn a_horizon_that_is_level_at_keyframes_is_level_between_them() {
        let mut path = winding(12);
        for (index, keyframe) in path.keyframes.iter_mut().enumerate() {
            keyframe.up = DVec3::Z;
            keyframe.pivot = keyframe.eye + DVec3::new((index as f64).sin(), (index as f64).cos(), -0.5);
        }
        for time in times(&path) {
            assert!(camera(&path, time).right().z.abs() < 1e-9, "{time}");
        }
    }

    #[test]
    fn the_view_turns_round_where_the_pivots_lie_on_both_sides_of_the_eye() {
        let mut path = path(&[(0.0, [0.0; 3]), (1.0, [0.0, 0.1, 0.0])]);
        path.keyframes[0].pivot = DVec3::new(5.0, 0.0, 0.0);
        path.keyframes[1].pivot = DVec3::new(-5.0, 0.5, 0.0);
        let motion = Motion::new(&path).unwrap();
        let turns: Vec<f64> = (0..60)
            .map(|step| {
                let [a, b] = [step, step + 1].map(|step| motion.camera(f64::from(step) / 60.0));
                angle(&a, &b).to_degrees()
            })
            .collect();
        assert!(turns.iter().all(|turn| *turn < 6.0), "{turns:?}");
    }
}
