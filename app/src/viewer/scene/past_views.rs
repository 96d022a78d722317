//! Where the camera rested before, so that a key goes back there. Flying is no step of undo.

use std::time::{Duration, Instant};

use scene::Camera;

use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;

/// A view counts once the camera has rested there for this long: longer than a pause of the hand between two notches of
/// the wheel.
const REST: Duration = Duration::from_millis(600);
/// The largest number of views kept.
const MOST: usize = 100;

#[derive(Default)]
pub struct PastViews {
    past: Vec<Camera>,
    next: Vec<Camera>,
    /// The view in which the camera rested last.
    resting: Option<Camera>,
    moving: Option<(Camera, Instant)>,
}

impl PastViews {
    /// Notes where the camera is. `is_placed` says that a person or a file has put it there, and `is_held` that a mouse
    /// button is down. Returns the time after which to call this again.
    pub fn watch(&mut self, camera: Camera, is_placed: bool, is_held: bool, now: Instant) -> Option<Duration> {
        if !is_placed || self.resting.is_none() {
            (self.resting, self.moving) = (Some(camera), None);
            return None;
        }
        if self.resting == Some(camera) {
            self.moving = None;
            return None;
        }
        match self.moving {
            Some((before, since)) if before == camera && !is_held => {
                let left = REST.saturating_sub(now.saturating_duration_since(since));
                if left.is_zero() {
                    self.rest(camera);
                    return None;
                }
                Some(left)
            }
            _ => {
                self.moving = Some((camera, now));
                Some(REST)
            }
        }
    }

    /// Ends a move at `camera`.
    fn rest(&mut self, camera: Camera) {
        self.moving = None;
        if let Some(before) = self.resting.replace(camera).filter(|before| *before != camera) {
            self.past.push(before);
            self.next.clear();
            if self.past.len() > MOST {
                self.past.remove(0);
            }
        }
    }

    /// The view before this one, or the one after it that was gone back from.
    fn step(&mut self, camera: Camera, is_back: bool) -> Option<Camera> {
        self.rest(camera);
        let (from, to) = if is_back { (&mut self.past, &mut self.next) } else { (&mut self.next, &mut self.past) };
        let target = from.pop()?;
        to.push(camera);
        self.resting = Some(target);
        Some(target)
    }
}

impl Scene {
    /// Goes to where the camera rested before, or takes that back.
    pub fn step_view(&mut self, is_back: bool, outside: &mut Outside) {
        match self.past_views.step(self.camera, is_back) {
            Some(camera) => {
                self.camera = camera;
                self.camera_is_placed = true;
                self.navigation.camera_moved(outside.now);
            }
            None => outside.note(if is_back { "There is no view before this one" } else { "There is no later view" }),
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn view(distance: f64) -> Camera {
        Camera::looking(DVec3::ZERO, DVec3::X, distance, DVec3::Z)
    }

    #[test]
    fn a_key_goes_back_to_where_the_camera_rested_and_forth_again() {
        let (mut views, start) = (PastViews::default(), Instant::now());
        // Each view is held for a second, in which the camera passes through others.
        for (number, distance) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            let at = start + Duration::from_secs(number as u64 * 2);
            views.watch(view(distance - 0.5), true, true, at);
            views.watch(view(distance), true, false, at + Duration::from_millis(100));
            views.watch(view(distance), true, false, at + Duration::from_secs(1));
        }
        // The camera has been moved on since, and has hardly stopped.
        assert_eq!(views.step(view(3.5), true), Some(view(3.0)));
        assert_eq!(views.step(view(3.0), true), Some(view(2.0)));
        assert_eq!(views.step(view(2.0), false), Some(view(3.0)));
        assert_eq!(views.step(view(3.0), false), Some(view(3.5)));
        assert_eq!(views.step(view(3.5), false), None);
    }

    #[test]
    fn views_that_nobody_chose_are_none_to_go_back_to() {
        let (mut views, start) = (PastViews::default(), Instant::now());
        for distance in [1.0, 2.0] {
            views.watch(view(distance), false, false, start);
        }
        views.watch(view(2.0), true, false, start + Duration::from_secs(2));
        assert_eq!(views.step(view(2.0), true), None);
    }
}
