//! Camera paths for any subject, which `glint record` makes where a scene file has none.

use cloud::Bounds;
use glam::{DQuat, DVec3};

use crate::{Camera, CameraPath, Keyframe};

/// A camera path that follows from what is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BuiltInPath {
    /// Once around what the first view looks at, on its level.
    Turntable,
    /// Once around what the first view looks at, while the camera rises and sinks.
    Orbit,
    /// Across everything, in the direction of the first view.
    Flight,
}

/// What a built-in path follows from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPlace {
    /// The first view of the scene.
    pub view: Camera,
    /// The bounds of all points, without stray ones.
    pub bounds: Bounds,
    pub up: DVec3,
}

/// The number of stretches of a path: the curve through their ends is a circle to the eye.
const STRETCHES: u32 = 24;
/// How far an orbit rises and sinks, in degrees.
const SWING_DEGREES: f64 = 20.0;
/// The steepest view of an orbit, in degrees from level.
const STEEPEST_DEGREES: f64 = 75.0;
/// A camera that begins within the bounds goes this share of the way from what it looks at to the border.
const WITHIN: f64 = 0.85;

impl BuiltInPath {
    pub const ALL: [Self; 3] = [Self::Turntable, Self::Orbit, Self::Flight];
    /// How long each lasts, in seconds.
    pub const SECONDS: f64 = 10.0;

    pub fn name(self) -> &'static str {
        match self {
            Self::Turntable => "turntable",
            Self::Orbit => "orbit",
            Self::Flight => "flight",
        }
    }

    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|path| path.name() == name)
    }

    /// The path.
    pub fn path(self, place: &PathPlace) -> CameraPath {
        let camera = |share: f64| match self {
            Self::Turntable => place.around(share, 0.0),
            Self::Orbit => {
                place.around(share, SWING_DEGREES.to_radians() * (std::f64::consts::TAU * share.fract()).sin())
            }
            Self::Flight => place.across(share),
        };
        let keyframe = |step: u32| {
            let share = f64::from(step) / f64::from(STRETCHES);
            let Camera { eye, pivot, up } = camera(share);
            Keyframe { time: Self::SECONDS * share, eye, pivot, up }
        };
        let keyframes = (0..=STRETCHES).map(keyframe).collect();
        CameraPath { name: self.name().into(), is_loop: self != Self::Flight, keyframes, ..CameraPath::default() }
    }
}

impl PathPlace {
    /// The camera after a share of a turn around the pivot, raised by an angle.
    fn around(&self, share: f64, raise: f64) -> Camera {
        let Camera { eye, pivot, .. } = self.view;
        let up = self.up.normalize_or(DVec3::Z);
        let (height, level) = ((eye - pivot).dot(up), (eye - pivot).reject_from_normalized(up));
        let steepest = STEEPEST_DEGREES.to_radians();
        let own = height.atan2(level.length());
        // A first view that is steeper stays so.
        let most = steepest.max(own.abs());
        let tilt = (own + raise).clamp(-most, most);
        let ahead = level.try_normalize().unwrap_or_else(|| self.view.up.reject_from(up).normalize_or(DVec3::X));
        // The last keyframe is where the first one is, to the bit.
        let turned = DQuat::from_axis_angle(up, std::f64::consts::TAU * share.fract()) * ahead;
        let back = turned * tilt.cos() + up * tilt.sin();
        let reach = self.view.distance();
        let within = if self.bounds.contains(eye) { WITHIN * self.way_out(pivot, back) } else { f64::INFINITY };
        Camera::from_eye(pivot + back * reach.min(within), pivot, self.view.up)
    }

    /// The camera after a share of the way across the bounds. It goes around the middle.
    fn across(&self, share: f64) -> Camera {
        let up = self.up.normalize_or(DVec3::Z);
        let toward = self.view.forward().reject_from_normalized(up);
        let toward = toward.try_normalize().unwrap_or_else(|| self.view.up.reject_from(up));
        // Along the side of the bounds that is nearest to it.
        let level = DVec3::AXES.into_iter().filter(|axis| axis.dot(up).abs() < 0.9);
        let nearest = level.max_by(|a, b| a.dot(toward).abs().total_cmp(&b.dot(toward).abs())).unwrap_or(DVec3::X);
        let forward = nearest * nearest.dot(toward).signum();
        let side = forward.cross(up);
        let (center, half) = (self.bounds.center(), self.bounds.size() * 0.5);
        let extent = |axis: DVec3| half.dot(axis.abs());
        let is_within = self.bounds.contains(self.view.eye);
        let (way, aside) = if is_within { (WITHIN, 0.6) } else { (1.3, 0.2) };
        let height = if is_within { (self.view.eye - center).dot(up) } else { extent(up) + 0.3 * extent(forward) };
        let place = |share: f64| {
            let beside = (std::f64::consts::PI * share).sin() * aside * extent(side);
            center + forward * (extent(forward) * way * (2.0 * share - 1.0)) + side * beside + up * height
        };
        let eye = place(share);
        let ahead = (place(share + 0.01) - eye).normalize_or(forward);
        let distance = 0.7 * extent(forward).max(extent(up)).max(f64::MIN_POSITIVE);
        let drop = if is_within { 0.0 } else { 0.6 };
        Camera::from_eye(eye, eye + (ahead - up * drop) * distance, up)
    }

    /// How far a ray from within the bounds goes until it leaves them.
    fn way_out(&self, from: DVec3, direction: DVec3) -> f64 {
        let border = |axis: usize| {
            let end = if direction[axis] > 0.0 { self.bounds.max[axis] } else { self.bounds.min[axis] };
            let way = (end - from[axis]) / direction[axis];
            if direction[axis] == 0.0 { f64::INFINITY } else { way.max(0.0) }
        };
        (0..3).map(border).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Motion;

    fn place(eye: DVec3) -> PathPlace {
        let bounds = Bounds { min: DVec3::new(-2.0, -3.0, 0.0), max: DVec3::new(2.0, 3.0, 2.5) };
        PathPlace { view: Camera::from_eye(eye, DVec3::new(0.1, 0.2, 1.0), DVec3::Z), bounds, up: DVec3::Z }
    }

    #[test]
    fn each_begins_with_names_of_its_own_lasts_ten_seconds_and_is_a_path() {
        for kind in BuiltInPath::ALL {
            let path = kind.path(&place(DVec3::new(10.0, 0.0, 8.0)));
            assert_eq!((path.duration(), path.problem()), (10.0, None), "{kind:?}");
            assert_eq!(BuiltInPath::named(&path.name), Some(kind));
        }
        assert_eq!(BuiltInPath::named("tour"), None);
    }

    #[test]
    fn a_turntable_keeps_its_distance_and_level_and_ends_where_it_began() {
        let place = place(DVec3::new(10.0, 0.0, 8.0));
        let path = BuiltInPath::Turntable.path(&place);
        let motion = Motion::new(&path).unwrap();
        for step in 0..=200 {
            let camera = motion.camera(f64::from(step) / 20.0);
            assert!((camera.distance() / place.view.distance() - 1.0).abs() < 1e-3, "{camera:?}");
            assert!((camera.eye.z - 8.0).abs() < 1e-9, "{camera:?}");
        }
        assert_eq!((motion.camera(0.0), path.problem()), (motion.camera(10.0), None));
        assert!(motion.camera(0.0).eye.distance(place.view.eye) < 1e-9);
        let orbit = BuiltInPath::Orbit.path(&place);
        let heights: Vec<f64> = orbit.keyframes.iter().map(|keyframe| keyframe.eye.z).collect();
        assert!(heights.iter().any(|z| *z > 9.0) && heights.iter().any(|z| *z < 6.0), "{heights:?}");
    }

    #[test]
    fn a_camera_that_begins_in_a_room_stays_in_it() {
        let place = place(DVec3::new(1.5, -2.0, 1.6));
        for kind in BuiltInPath::ALL {
            let motion = Motion::new(&kind.path(&place)).unwrap();
            for step in 0..=200 {
                let camera = motion.camera(f64::from(step) / 20.0);
                assert!(place.bounds.contains(camera.eye), "{kind:?}: {camera:?}");
            }
        }
    }

    #[test]
    fn a_flight_crosses_everything_from_above_and_passes_the_middle_on_one_side() {
        let place = place(DVec3::new(0.1, -20.0, 10.0));
        let motion = Motion::new(&BuiltInPath::Flight.path(&place)).unwrap();
        let eye = |time: f64| motion.camera(time).eye;
        assert!(eye(0.0).y < -3.0 && eye(10.0).y > 3.0 && eye(5.0).z > 2.5, "{} {}", eye(0.0), eye(10.0));
        assert!(eye(5.0).x.abs() > 0.1);
    }
}
