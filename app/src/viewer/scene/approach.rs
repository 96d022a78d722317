//! Moves of the camera to another view that take a while.

use std::time::Instant;

use glam::DVec3;
use scene::{Camera, Projection};

use crate::viewer::scene::Scene;
use crate::viewer::scene::flight::Flight;

/// How long the way to a point takes that was double-clicked, in seconds: long enough to see where it leads.
const APPROACH_SECONDS: f64 = 0.35;
/// The share of the distance to the point that is left then.
const APPROACH: f64 = 0.5;

impl Scene {
    /// Begins to move the camera to another view, in one step of undo.
    pub fn fly_to(&mut self, camera: Camera, seconds: f64, bookmark: Option<usize>, now: Instant) {
        let from = self.camera;
        self.jump(now, self.settings.clone(), from);
        self.flight = Flight::new(from, camera, seconds, bookmark, now);
    }

    /// Goes half of the way to a point, turns to it and takes it as the pivot.
    pub fn approach(&mut self, point: DVec3, now: Instant) {
        let mut camera = self.camera;
        if self.settings.view.projection == Projection::Perspective {
            camera = Camera::from_eye(camera.eye, point, camera.up);
        } else {
            camera.recenter(point);
        }
        camera.zoom_toward(point, APPROACH);
        self.fly_to(camera, APPROACH_SECONDS, None, now);
        self.navigation.show_pivot(point, now);
    }

    /// Moves the camera along its flight. Returns whether there is one.
    pub fn step_flight(&mut self, now: Instant) -> bool {
        let Some(flight) = self.flight.take() else { return false };
        let is_over;
        (self.camera, is_over) = flight.camera(now);
        self.camera_moved_by_hand(now);
        self.flight = Some(flight).filter(|_| !is_over);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::viewer::session::Session;

    #[test]
    fn an_approach_goes_nearer_by_time_and_never_back() {
        let point = DVec3::new(3.0, 1.0, 0.5);
        let start = Camera::from_eye(DVec3::new(0.0, -8.0, 2.0), DVec3::new(0.0, 60.0, 0.0), DVec3::Z);
        let approached = |pictures: u32, projection: Projection| {
            let mut session = Session::with_two_points();
            (session.scene.camera, session.scene.settings.view.projection) = (start, projection);
            let begun = Instant::now();
            session.scene.approach(point, begun);
            let mut last = start.eye.distance(point);
            for picture in 1..=pictures {
                session.step(begun + Duration::from_secs_f64(0.4 * f64::from(picture) / f64::from(pictures)), false);
                let distance = session.scene.camera.eye.distance(point);
                assert!(projection == Projection::Orthographic || distance <= last + 1e-9, "{distance} after {last}");
                last = distance;
            }
            assert!(session.scene.flight.is_none());
            session.scene.camera
        };
        let many = approached(40, Projection::Perspective);
        assert_eq!(many, approached(2, Projection::Perspective), "as far with few pictures");
        assert_eq!(many.pivot, point);
        assert!((many.eye.distance(point) - 0.5 * start.eye.distance(point)).abs() < 1e-9);
        // What is seen of a parallel picture grows.
        let parallel = approached(3, Projection::Orthographic);
        assert!((parallel.distance() - 0.5 * start.distance()).abs() < 1e-9 && parallel.pivot == point);
    }
}
