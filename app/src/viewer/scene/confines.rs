//! What stops the eye while a person drags: the ground and the walls of a built-in scene, and the walls of rooms that
//! were scanned.

use std::sync::Arc;

use glam::{DQuat, DVec3};
use scene::Interior;

/// How far above the ground of a built-in scene a drag keeps the eye, in its metres.
const ABOVE_GROUND: f64 = 0.3;
/// How far an orbiting eye keeps from a wall, as a share of its distance from the centre.
const MARGIN: f64 = 0.05;
/// By which share of its distance an orbiting eye comes nearer for each radian to an obstacle: gradually, not at once.
const SLOPE: f64 = 0.7;
/// The angle between two directions in which obstacles are looked for, in radians, and their numbers to each side and up.
const STEP: f64 = 0.052;
const STEPS: [i32; 2] = [28, 4];
/// The number of places along a line in which free space is looked up: a wall is wider than one of 64 parts of a room.
const PLACES: u32 = 64;

#[derive(Clone, Debug, Default)]
pub struct Confines {
    /// The height of the ground of a built-in scene along the up axis.
    pub ground: Option<f64>,
    /// A corner and two edges of each wall of built-in scenes, in world units.
    pub walls: Vec<[DVec3; 3]>,
    /// The free space of scanned rooms.
    pub interior: Option<Arc<Interior>>,
}

impl Confines {
    fn rooms(&self) -> Option<&Interior> {
        // The walls of built-in scenes are known exactly.
        self.interior.as_deref().filter(|_| self.walls.is_empty())
    }

    /// Whether an eye there is inside of a scanned room.
    pub fn is_room(&self, eye: DVec3) -> bool {
        self.rooms().is_some_and(|rooms| rooms.surrounds(eye))
    }

    /// Whether the eye may go from one place to another.
    pub fn lets(&self, from: DVec3, to: DVec3, up: DVec3) -> bool {
        let is_above = |ground: f64| to.dot(up) >= (ground + ABOVE_GROUND).min(from.dot(up)) - 1e-9;
        let way = to - from;
        let passes = |wall: &[DVec3; 3]| crossing(wall, from, way).is_some_and(|share| share <= 1.0);
        self.ground.is_none_or(is_above)
            && !self.walls.iter().any(passes)
            && self.rooms().is_none_or(|rooms| !rooms.contains(from) || rooms.contains(to))
    }

    /// How far one can go from `center` in a direction, a unit vector, at most `most`. `None` if the centre is not in
    /// free space and none is near.
    fn free(&self, center: DVec3, direction: DVec3, most: f64) -> Option<f64> {
        // A centre is on a surface: what is closer than this is that surface.
        let hits = self.walls.iter().filter_map(|wall| crossing(wall, center, direction));
        let nearest = hits.filter(|distance| *distance > most * 1e-3).fold(most, f64::min);
        let Some(rooms) = self.rooms() else { return Some(nearest) };
        let mut places = (1..=PLACES).map(|place| most * f64::from(place) / f64::from(PLACES));
        let is_free = |distance: &f64| rooms.contains(center + direction * *distance);
        let first = places.by_ref().find(is_free)?;
        Some(places.take_while(is_free).last().unwrap_or(first))
    }

    /// How far an eye that orbits `center` may be from it: `most`, or less near what would come between.
    pub fn arm(&self, center: DVec3, eye: DVec3, up: DVec3) -> Option<f64> {
        let most = center.distance(eye);
        let back = (eye - center).try_normalize().filter(|_| !self.walls.is_empty() || self.rooms().is_some())?;
        let side = back.cross(up).try_normalize()?;
        let mut arm = most;
        for rise in -STEPS[1]..=STEPS[1] {
            let risen = DQuat::from_axis_angle(side, f64::from(rise) * STEP) * back;
            for turn in -STEPS[0]..=STEPS[0] {
                let angle = f64::from(turn).hypot(f64::from(rise)) * STEP;
                // Farther obstacles than this shorten nothing.
                if angle * SLOPE < 1.0 {
                    let free = self.free(center, DQuat::from_axis_angle(up, f64::from(turn) * STEP) * risen, most)?;
                    let kept = if free < most { free - most * MARGIN } else { most };
                    arm = arm.min(kept + angle * SLOPE * most);
                }
            }
        }
        (arm > 0.0).then_some(arm)
    }
}

/// Where a line meets a wall: at `from + way * share`, with a positive share.
fn crossing([corner, u, v]: &[DVec3; 3], from: DVec3, way: DVec3) -> Option<f64> {
    let normal = u.cross(*v);
    let share = normal.dot(*corner - from) / normal.dot(way);
    let at = from + way * share - *corner;
    let is_within = |edge: &DVec3| (0.0..=1.0).contains(&(at.dot(*edge) / edge.length_squared()));
    (share.is_finite() && share > 0.0 && is_within(u) && is_within(v)).then_some(share)
}
