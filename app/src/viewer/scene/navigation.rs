//! The state of navigation from one frame of the window to the next: the cursor, what it points at, and a zoom that
//! waits for the point under the cursor. Zooming goes toward that point, which the render thread looks up. Until it
//! answers, the turns of the wheel add up. If it does not answer soon, the zoom goes toward the plane of the pivot.

use std::time::{Duration, Instant};

use glam::DVec3;

use crate::overlays::lens::to_vector;
use crate::viewer::requests::pick::Pick;
use crate::viewer::scene::orbit::{Orbit, Turn};

/// The camera rests when it has not moved for this long. Then the picture is refined.
const REST: Duration = Duration::from_millis(150);
/// How many pixels the cursor may drift while the point under it still counts as the same.
const SAME_PLACE: f64 = 4.0;
/// How long the pivot stays marked.
const PIVOT_MARK: Duration = Duration::from_millis(700);

/// The state of navigation from one frame of the window to the next.
#[derive(Default)]
pub struct Navigation {
    last_move: Option<Instant>,
    /// The time since which a mouse button is down.
    held_since: Option<Instant>,
    /// The pixel that the cursor is over, and the time since which it is there.
    pub cursor: Option<([u32; 2], Instant)>,
    /// The pixel that was last looked up, and the world position of the point there, if there is one.
    pub hovered: Option<([u32; 2], Option<DVec3>)>,
    pub asked: Option<[u32; 2]>,
    /// Whether the picture that is shown is coarser than the window, or lacks points.
    is_coarse: bool,
    pub pending_zoom: f32,
    pub zoom_since: Option<Instant>,
    /// The point that is marked as the centre of a turn, and since when.
    pivot_shown: Option<(DVec3, Instant)>,
    /// What the drag that is under way turns.
    pub turn: Option<Turn>,
    /// The orbit that ended last.
    pub last_orbit: Option<Orbit>,
    /// How many times the speed of flight is doubled.
    pub speed: f32,
    /// The pick before the click that may become a double-click.
    pub pick_before: Option<Pick>,
}

impl Navigation {
    pub fn camera_moved(&mut self, now: Instant) {
        self.last_move = Some(now);
        self.hovered = None;
    }

    /// Records whether a mouse button is down. What begins to move while it is down counts as moving until it comes up,
    /// and no longer: the hand may pause, and on a busy machine its movements come late.
    pub fn hold(&mut self, is_held: bool, now: Instant) {
        let has_moved = self.held_since.zip(self.last_move).is_some_and(|(since, moved)| moved >= since);
        self.held_since = self.held_since.or(Some(now)).filter(|_| is_held);
        if has_moved {
            self.last_move = Some(now).filter(|_| is_held);
        }
    }

    pub fn is_held(&self) -> bool {
        self.held_since.is_some()
    }

    /// The time until the camera rests; `None` if it does already.
    pub fn time_to_rest(&self, now: Instant) -> Option<Duration> {
        REST.checked_sub(now.saturating_duration_since(self.last_move?)).filter(|left| !left.is_zero())
    }

    /// Marks the point about which the camera turns.
    pub fn show_pivot(&mut self, at: DVec3, now: Instant) {
        self.pivot_shown = Some((at, now));
    }

    /// The point that is marked, and how long it stays so.
    pub fn pivot_mark(&self, now: Instant) -> Option<(DVec3, Duration)> {
        let (at, since) = self.pivot_shown?;
        let left = PIVOT_MARK.checked_sub(now.saturating_duration_since(since)).filter(|left| !left.is_zero())?;
        Some((at, left))
    }

    /// Records that the cursor is over another pixel of the picture now, or over none.
    pub fn point_at(&mut self, pixel: Option<[u32; 2]>, now: Instant) {
        self.cursor = pixel.map(|pixel| (pixel, now));
        if pixel.is_none() {
            self.hovered = None;
        }
    }

    /// Notes that a picture is shown. What was looked up in a coarse one is looked up again in the first fine one, whose
    /// points are others.
    pub fn on_picture(&mut self, is_coarse: bool) {
        if self.is_coarse && !is_coarse {
            self.hovered = None;
        }
        self.is_coarse = is_coarse;
    }

    pub fn on_hover(&mut self, pixel: [u32; 2], world: Option<DVec3>) {
        self.hovered = Some((pixel, world));
        self.asked = None;
    }

    /// The point under the cursor. The outer `None` means that it was not looked up, the inner one that there is no
    /// point.
    pub fn anchor(&self) -> Option<Option<DVec3>> {
        let (cursor, _) = self.cursor?;
        let (pixel, world) = self.hovered?;
        let apart = to_vector(cursor).distance(to_vector(pixel));
        (apart <= SAME_PLACE).then_some(world)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_in_a_coarse_picture_is_looked_up_again_in_the_fine_one() {
        let mut navigation = Navigation::default();
        let found = Some(([40, 40], Some(DVec3::X)));
        for (is_coarse, expected) in [(false, found), (true, found), (true, found), (false, None)] {
            navigation.on_hover([40, 40], Some(DVec3::X));
            navigation.on_picture(is_coarse);
            assert_eq!(navigation.hovered, expected);
        }
        navigation.on_hover([40, 40], None);
        navigation.on_picture(false);
        assert_eq!(navigation.hovered, Some(([40, 40], None)));
    }
}
