//! Drags that move the camera. Inside of a scanned room a drag turns the head. Elsewhere it orbits what was under the
//! cursor when it began, if that is within reach, and neither an orbit nor a pan takes the eye through the ground or a wall.

use std::time::Instant;

use glam::{DVec2, DVec3};
use scene::Projection;

use crate::shared::language::english;
use crate::viewer::requests::action::Action;
use crate::viewer::requests::outside::Outside;
use crate::viewer::scene::Scene;
use crate::viewer::scene::orbit::{Orbit, Turn};

/// The turn of the camera in radians per pixel of mouse movement. A half turn takes 630 pixels, about half a window.
const RADIANS_PER_PIXEL: f64 = 0.005;
/// A point that is farther away than so many times the pivot is out of reach: to orbit it would sweep the eye away.
const REACH: f64 = 3.0;
impl Scene {
    /// Whether a drag turns the head here.
    pub fn is_in_room(&self) -> bool {
        self.settings.view.projection == Projection::Perspective && self.confines.is_room(self.camera.eye)
    }

    /// What a drag with the left button does here, in a word and in full.
    pub fn turning(&self) -> [&'static str; 2] {
        match self.navigation.turn {
            _ if self.is_flying() => {
                [english!("fly"), english!("A drag turns the head, and W A S D Q E fly; V: orbit")]
            }
            Some(Turn::About(_)) => [english!("orbit"), english!("The drag orbits the marked point")],
            None if !self.is_in_room() => {
                [english!("orbit"), english!("A drag orbits what is under the cursor; V: fly")]
            }
            _ => [
                english!("look around"),
                english!("Inside of a room a drag turns the head. On a mirror it orbits the mirror; V: fly"),
            ],
        }
    }

    /// Begins a drag. `mirror` is the place of the mirror under the cursor.
    pub fn begin_drag(&mut self, mirror: Option<DVec3>, outside: &mut Outside) {
        let known = mirror.or(self.navigation.anchor().flatten());
        if mirror.is_none() && self.is_in_room() {
            self.navigation.turn = Some(Turn::Head);
        } else {
            let awaits = known.is_none() && self.navigation.anchor().is_none() && self.cursor().is_some();
            if awaits && self.navigation.asked.is_none() {
                self.ask_hover(outside);
            }
            let mut orbit = self.orbit(known);
            orbit.awaits = awaits;
            self.navigation.turn = Some(Turn::About(orbit));
        }
        self.bring_pivot(known);
    }

    pub fn end_drag(&mut self) {
        if let Some(Turn::About(orbit)) = self.navigation.turn.take() {
            self.navigation.last_orbit = Some(orbit);
        }
    }

    /// Takes in the point under the cursor, which a drag that has begun may wait for.
    pub fn on_drag_point(&mut self, world: Option<DVec3>) {
        if let Some(Turn::About(Orbit { awaits: true, .. })) = self.navigation.turn {
            self.navigation.turn = Some(Turn::About(self.orbit(world)));
            self.bring_pivot(world);
        }
    }

    /// An orbit about a point if it is within reach, or else about the pivot.
    fn orbit(&self, point: Option<DVec3>) -> Orbit {
        let reach = self.camera.distance() * REACH;
        let center = point.filter(|point| point.distance(self.camera.eye) <= reach).unwrap_or(self.camera.pivot);
        Orbit::new(center, self.camera, self.navigation.last_orbit.as_ref(), &self.confines)
    }

    /// Brings the pivot to the depth of a point, so that it is not behind what is seen. The picture stays as it is.
    fn bring_pivot(&mut self, point: Option<DVec3>) {
        let camera = &mut self.camera;
        let depth = point.map_or(0.0, |point| camera.forward().dot(point - camera.eye));
        let is_behind = depth > camera.distance() * 1e-3 && depth < camera.distance();
        if is_behind && self.settings.view.projection == Projection::Perspective {
            camera.pivot = camera.eye + camera.forward() * depth;
            if let Some(Turn::About(orbit)) = &mut self.navigation.turn {
                orbit.on_pivot(*camera);
            }
        }
    }

    /// Moves the camera by a drag. `Orbit` and `Look` are in points of the window, `Pan` in pixels of the picture.
    pub fn drag_camera(&mut self, drag: &Action, now: Instant) {
        let (Action::Orbit(delta) | Action::Look(delta) | Action::Pan(delta)) = drag else { return };
        let angles = *delta * -RADIANS_PER_PIXEL;
        let turn = match drag {
            Action::Orbit(_) => self.navigation.turn,
            _ => None,
        };
        // A key turns as a drag does that begins with it.
        let of_key = || if self.is_in_room() { Turn::Head } else { Turn::About(self.orbit(None)) };
        let turn = turn.unwrap_or_else(of_key);
        match (drag, turn) {
            (Action::Pan(_), _) => self.pan(*delta),
            (Action::Look(_), _) | (_, Turn::Head) => self.camera.look(angles.x, angles.y),
            (_, Turn::About(mut orbit)) => {
                self.camera = orbit.turn(angles.x, angles.y, self.camera, &self.confines);
                match &mut self.navigation.turn {
                    Some(turn) => *turn = Turn::About(orbit),
                    None => self.navigation.last_orbit = Some(orbit),
                }
                self.navigation.show_pivot(orbit.center, now);
            }
        }
        if *delta != DVec2::ZERO {
            self.camera_moved_by_hand(now);
        }
    }

    /// Moves the camera along the picture, as far as nothing stops the eye.
    fn pan(&mut self, delta: DVec2) {
        let height = f64::from(self.view_size[1].max(1));
        for part in [delta, delta.with_y(0.0), delta.with_x(0.0)] {
            let mut camera = self.camera;
            camera.pan(part, self.settings.view.field_of_view, height);
            if self.confines.lets(self.camera.eye, camera.eye, camera.up) {
                self.camera = camera;
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use scene::{Camera, Interior, Surroundings};

    use super::*;
    use crate::viewer::requests::preferences::Preferences;
    use crate::viewer::scene::confines::Confines;
    use crate::viewer::session::Session;

    /// The free space of a room of 8 by 6 by 3 metres, whose floor begins at the origin.
    fn room() -> Interior {
        let across = |count: u32, width: f64| (0..count).map(move |at| f64::from(at) * width / f64::from(count));
        let plane = |z: f64| across(80, 8.0).flat_map(move |x| across(60, 6.0).map(move |y| DVec3::new(x, y, z)));
        let walls = across(80, 8.0)
            .flat_map(|x| across(30, 3.0).flat_map(move |z| [0.0, 6.0].map(move |y| DVec3::new(x, y, z))));
        let ends = across(60, 6.0)
            .flat_map(|y| across(30, 3.0).flat_map(move |z| [0.0, 8.0].map(move |x| DVec3::new(x, y, z))));
        let points = plane(0.0).chain(plane(3.0)).chain(walls).chain(ends);
        let (surroundings, interior) = Surroundings::with_interior(points, DVec3::Z);
        assert!(matches!(surroundings, Surroundings::Room(_)));
        interior.unwrap()
    }

    fn session_in_room() -> Session {
        let mut session = Session::new(Preferences::default());
        session.set_view_size([800, 600]);
        session.scene.confines.interior = Some(std::sync::Arc::new(room()));
        session.scene.camera = Camera::from_eye(DVec3::new(2.0, 3.0, 1.6), DVec3::new(7.0, 3.0, 1.2), DVec3::Z);
        session
    }

    #[test]
    fn a_drag_in_a_room_turns_the_head_and_leaves_the_eye_where_it_is() {
        let mut session = session_in_room();
        let before = session.scene.camera;
        assert_eq!(session.scene.turning()[0], "look around");
        session.act(Action::BeginDrag);
        session.act(Action::Orbit(DVec2::new(200.0, 20.0)));
        session.act(Action::EndDrag);
        let after = session.scene.camera;
        assert!(after.eye.distance(before.eye) < 1e-9 && after.forward().dot(before.forward()) < 0.6);
        // From outside, it orbits.
        session.scene.camera = Camera::from_eye(DVec3::new(-20.0, 3.0, 9.0), DVec3::new(4.0, 3.0, 1.2), DVec3::Z);
        let before = session.scene.camera;
        session.act(Action::Orbit(DVec2::new(200.0, 20.0)));
        assert!(session.scene.camera.eye.distance(before.eye) > 5.0 && session.scene.turning()[0] == "orbit");
    }

    #[test]
    fn no_drag_takes_the_eye_through_the_wall_of_a_room() {
        let mut session = session_in_room();
        let is_inside = |session: &Session| {
            let eye = session.scene.camera.eye;
            eye.cmpgt(DVec3::ZERO).all() && eye.cmplt(DVec3::new(8.0, 6.0, 3.0)).all()
        };
        for way in [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y] {
            for _ in 0..40 {
                session.act(Action::Pan(way * 25.0));
                assert!(is_inside(&session), "{}", session.scene.camera.eye);
            }
        }
        // A mirror stands in the room: its reflections are seen from all around.
        session.scene.camera = Camera::from_eye(DVec3::new(2.0, 3.0, 1.6), DVec3::new(5.0, 3.0, 1.2), DVec3::Z);
        let center = DVec3::new(5.0, 3.0, 1.0);
        session.scene.begin_drag(Some(center), &mut session.outside);
        let (mut nearest, mut last) = (f64::INFINITY, session.scene.camera);
        for _ in 0..130 {
            session.act(Action::Orbit(DVec2::new(10.0, 0.0)));
            let camera = session.scene.camera;
            assert!(is_inside(&session), "{}", camera.eye);
            assert!(camera.eye.distance(last.eye) < 0.5, "no leap: {} {}", last.eye, camera.eye);
            nearest = nearest.min(camera.eye.distance(center));
            last = camera;
        }
        assert!(nearest < 2.8, "the walls at the sides are nearer: {nearest}");
    }

    #[test]
    fn a_drag_orbits_what_is_under_the_cursor_where_it_is_within_reach() {
        let mut session = Session::with_two_points();
        session.set_view_size([800, 600]);
        let start = Camera::from_eye(DVec3::new(0.0, -10.0, 2.0), DVec3::ZERO, DVec3::Z);
        let orbited = |session: &mut Session, point: Option<DVec3>| {
            session.scene.camera = start;
            session.act(Action::PointAt(Some([200, 200])));
            session.scene.navigation.on_hover([200, 200], point);
            session.act(Action::BeginDrag);
            session.act(Action::Orbit(DVec2::new(100.0, 0.0)));
            session.act(Action::EndDrag);
            session.scene.camera
        };
        for (point, center) in [
            (Some(DVec3::new(-3.0, -4.0, 1.0)), DVec3::new(-3.0, -4.0, 1.0)),
            (Some(DVec3::new(-3.0, 400.0, 1.0)), DVec3::ZERO),
            (None, DVec3::ZERO),
        ] {
            let camera = orbited(&mut session, point);
            let distances = [start.eye, camera.eye].map(|eye| eye.distance(center));
            assert!((distances[0] - distances[1]).abs() < 1e-9, "{point:?}: {distances:?}");
            assert!(camera.eye.distance(start.eye) > 1.0);
        }
        // The pivot is not behind what was seen.
        orbited(&mut session, Some(DVec3::new(-3.0, -4.0, 1.0)));
        assert!(session.scene.camera.distance() < 7.0, "{}", session.scene.camera.distance());
    }

    #[test]
    fn a_drag_in_the_first_scene_leaves_the_eye_before_its_walls() {
        let mut session = Session::new(Preferences::default());
        session.open_request(world::resolve(&[world::first_scene()]));
        session.set_view_size([1090, 870]);
        let start = session.scene.camera;
        let walls = session.scene.confines.walls.clone();
        assert!(walls.len() > 50);
        for way in [6.0, -6.0] {
            session.scene.camera = start;
            session.act(Action::BeginDrag);
            let center = session.scene.camera.pivot;
            for _ in 0..220 {
                let before = session.scene.camera.eye;
                session.act(Action::Orbit(DVec2::new(way, 0.0)));
                let eye = session.scene.camera.eye;
                assert!(eye.distance(before) < 0.8, "no leap: {before} {eye}");
                let free = session.scene.confines.arm(center, eye, DVec3::Y).unwrap();
                assert!(free > 0.7 * eye.distance(center), "{eye}: {free}");
                let seen = Confines { interior: None, ..session.scene.confines.clone() };
                assert!(seen.lets(eye, center + (eye - center) * 1e-3, DVec3::Y), "a wall hides {center} from {eye}");
            }
            session.act(Action::EndDrag);
        }
    }
}
