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
        let passes = |wall: &[DVec3; 3]| Wall::new(wall, from).crossing(way, 0.0, 1.0).is_some();
        self.ground.is_none_or(is_above)
            && !self.walls.iter().any(passes)
            && self.rooms().is_none_or(|rooms| !rooms.contains(from) || rooms.contains(to))
    }

    /// How far an eye that orbits `center` may be from it: `most`, or less near what would come between. `None` if the
    /// centre is not in free space and none is near.
    pub fn arm(&self, center: DVec3, eye: DVec3, up: DVec3) -> Option<f64> {
        let most = center.distance(eye);
        let back = (eye - center).try_normalize().filter(|_| !self.walls.is_empty() || self.rooms().is_some())?;
        let side = back.cross(up).try_normalize()?;
        // The least angle to a wall decides how near it must be.
        let matters = |wall: &Wall| {
            let angle = wall.middle.angle_between(back) - (wall.radius / wall.middle.length()).min(1.0).asin();
            wall.distance < most * (1.0 + MARGIN - angle.max(0.0) * SLOPE).min(1.0)
        };
        let walls = self.walls.iter().map(|wall| Wall::new(wall, center));
        let mut walls: Vec<Wall> = walls.filter(matters).collect();
        walls.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance));
        // A centre is on a surface: what is closer than this is that surface.
        let least = most * 1e-3;
        let turns: Vec<(i32, DQuat)> =
            (-STEPS[0]..=STEPS[0]).map(|turn| (turn, DQuat::from_axis_angle(up, f64::from(turn) * STEP))).collect();
        let mut arm = most;
        for rise in -STEPS[1]..=STEPS[1] {
            let risen = DQuat::from_axis_angle(side, f64::from(rise) * STEP) * back;
            for (turn, turned) in &turns {
                let slack = f64::from(turn * turn + rise * rise).sqrt() * STEP * SLOPE * most - most * MARGIN;
                // Farther obstacles than this shorten nothing.
                let limit = (arm - slack).min(most);
                let direction = *turned * risen;
                let free = match self.rooms() {
                    Some(rooms) => free_way(rooms, center, direction, most)?,
                    None => {
                        let near = walls.iter().take_while(|wall| wall.distance < limit);
                        near.fold(limit, |free, wall| wall.crossing(direction, least, free).unwrap_or(free))
                    }
                };
                if free < limit {
                    arm = free + slack;
                }
            }
        }
        (arm > 0.0).then_some(arm)
    }
}

/// How far one can go from `center` in a direction, a unit vector, at most `most`. `None` if the centre is not in free
/// space and none is near.
fn free_way(rooms: &Interior, center: DVec3, direction: DVec3, most: f64) -> Option<f64> {
    let mut places = (1..=PLACES).map(|place| most * f64::from(place) / f64::from(PLACES));
    let is_free = |distance: &f64| rooms.contains(center + direction * *distance);
    let first = places.by_ref().find(is_free)?;
    Some(places.take_while(is_free).last().unwrap_or(first))
}

/// A wall as seen from a place.
struct Wall {
    normal: DVec3,
    /// The product of the normal with the way from the place to the wall's plane.
    offset: f64,
    /// The corner, relative to the place.
    corner: DVec3,
    /// The two edges over the squares of their lengths.
    edges: [DVec3; 2],
    /// The middle, relative to the place, and how far the corners are from it.
    middle: DVec3,
    radius: f64,
    /// The wall is at least so far from the place.
    distance: f64,
}

impl Wall {
    fn new([corner, u, v]: &[DVec3; 3], from: DVec3) -> Self {
        let (normal, corner) = (u.cross(*v), *corner - from);
        let (offset, edges) = (normal.dot(corner), [u, v].map(|edge| *edge / edge.length_squared()));
        let (middle, radius) = (corner + (*u + *v) * 0.5, u.distance(*v).max((*u + *v).length()) * 0.5);
        let distance = (offset.abs() / normal.length()).max(middle.length() - radius);
        Self { normal, offset, corner, edges, middle, radius, distance }
    }

    /// Where a line from the place meets the wall: at `way * share`, if the share is between two others.
    #[inline]
    fn crossing(&self, way: DVec3, low: f64, high: f64) -> Option<f64> {
        let share = self.offset / self.normal.dot(way);
        if !(share > low && share < high) {
            return None;
        }
        let at = way * share - self.corner;
        let is_within = |edge: DVec3| (0.0..=1.0).contains(&at.dot(edge));
        (is_within(self.edges[0]) && is_within(self.edges[1])).then_some(share)
    }
}
