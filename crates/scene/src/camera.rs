//! The camera: an eye, the pivot that it looks at, and the axis that stays up. World coordinates are f64 throughout, so
//! that a scene at seven-digit coordinates looks and turns as it would at the origin.

use cloud::Bounds;
use glam::{DMat3, DQuat, DVec2, DVec3};
use param::choices;
use serde::{Deserialize, Serialize};

choices! {
    /// How depth shrinks things.
    pub enum Projection { Perspective = "perspective", Orthographic = "orthographic" }
}

choices! {
    /// Directions to look from.
    pub enum StandardView { Front = "front", Back = "back", Left = "left", Right = "right", Top = "top", Bottom = "bottom", Isometric = "iso" }
}

/// The place of the eye and the point that it looks at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// The position in world units.
    pub eye: DVec3,
    /// The point about which the camera orbits; it is in the middle of the picture.
    pub pivot: DVec3,
    /// The unit vector that points up in the world; never parallel to the line of sight.
    pub up: DVec3,
}

/// The least angle between the line of sight and the up axis in radians: the turntable stops half a degree before the
/// pole, where "right" would be undefined.
const POLE_MARGIN: f64 = 0.0087;

/// Framing keeps the eye at least this many radii away from the middle.
const CLOSEST_RADII: f64 = 1.2;

impl Camera {
    /// The largest believable coordinate: no measurement is so large, and the square of its distance would overflow.
    pub(crate) const MOST_COORDINATE: f64 = 1e30;

    /// Whether a camera may be at this place. A NaN is not.
    pub(crate) fn is_near(place: DVec3) -> bool {
        place.abs().cmple(DVec3::splat(Self::MOST_COORDINATE)).all()
    }

    /// The first value that no camera has, and what it is instead.
    pub(crate) fn problem(&self) -> Option<(&'static str, String)> {
        let is_direction = self.up.is_finite() && self.up.try_normalize().is_some();
        let odd = [("eye", self.eye), ("pivot", self.pivot)].into_iter().find(|(_, place)| !Self::is_near(*place));
        odd.map(|(key, _)| (key, format!("not finite, or beyond {:e}", Self::MOST_COORDINATE)))
            .or_else(|| (!is_direction).then(|| ("up", "no direction".into())))
    }

    /// A camera with the values of a scene file: `up` may have any usable length, and the eye may be at the pivot
    /// or straight above it.
    pub fn from_eye(eye: DVec3, pivot: DVec3, up: DVec3) -> Self {
        Self::looking(pivot, eye - pivot, eye.distance(pivot), up)
    }

    /// A camera at `pivot + back * distance`; `back` points from the pivot to the eye.
    pub fn looking(pivot: DVec3, back: DVec3, distance: f64, up: DVec3) -> Self {
        let back = if back.normalize_or_zero() == DVec3::ZERO { DVec3::X } else { back.normalize() };
        let mut camera =
            Self { eye: pivot + back * distance.max(f64::MIN_POSITIVE), pivot, up: up.normalize_or(DVec3::Z) };
        camera.leave_pole();
        camera
    }

    pub fn forward(&self) -> DVec3 {
        (self.pivot - self.eye).normalize_or(DVec3::X)
    }

    pub fn right(&self) -> DVec3 {
        self.forward().cross(self.up).normalize_or(self.up.any_orthonormal_vector())
    }

    /// The distance from the eye to the pivot in world units.
    pub fn distance(&self) -> f64 {
        self.eye.distance(self.pivot)
    }

    /// Rows: right, up of the picture, forward. `view = rows * (world - eye)`, z is the linear depth.
    pub fn view_from_world(&self) -> DMat3 {
        let (right, forward) = (self.right(), self.forward());
        DMat3::from_cols(right, right.cross(forward), forward).transpose()
    }

    /// A camera that looks at `points` (an outline, or the corners of a box) from a standard direction, with all of
    /// them in the picture.
    pub fn framing(points: &[DVec3], view: StandardView, up: DVec3, field_of_view_degrees: f32, aspect: f64) -> Self {
        let (side, front) = horizontal_axes(up);
        // A little off the pole for top and bottom: see POLE_MARGIN.
        let back = match view {
            StandardView::Front => front,
            StandardView::Back => -front,
            StandardView::Left => -side,
            StandardView::Right => side,
            StandardView::Top => up + front * POLE_MARGIN,
            StandardView::Bottom => -up + front * POLE_MARGIN,
            StandardView::Isometric => side * 0.45 + front * 0.8 + up * 0.55,
        };
        let mut camera = Self::looking(DVec3::ZERO, back, 1.0, up);
        camera.frame(points, field_of_view_degrees, aspect);
        camera
    }

    /// Keeps the direction of sight and moves the eye so that `points` fill the picture as well as possible, in its
    /// middle. The pivot gets the depth of their middle. Without points nothing moves.
    pub fn frame(&mut self, points: &[DVec3], field_of_view_degrees: f32, aspect: f64) {
        let mut bounds = Bounds::EMPTY;
        points.iter().for_each(|point| bounds.include(*point));
        if bounds.is_empty() {
            return;
        }
        let rows = self.view_from_world();
        let center = bounds.center();
        let seen: Vec<DVec3> =
            points.iter().filter(|point| point.is_finite()).map(|point| rows * (*point - center)).collect();
        // A margin of 4 % keeps the points off the edge.
        let tangent = (f64::from(field_of_view_degrees).to_radians() * 0.5).tan() / 1.04;
        // Per axis, each point must lie between two planes through the eye: p - e <= t (z - ez) and e - p <= t (z - ez).
        let mut depth = f64::INFINITY;
        let mut most = [[0.0; 2]; 2];
        for (axis, tangent) in [(0, tangent * aspect), (1, tangent)] {
            let bound =
                |sign: f64| seen.iter().map(|p| sign * p[axis] - tangent * p.z).fold(f64::NEG_INFINITY, f64::max);
            most[axis] = [bound(1.0), bound(-1.0)];
            depth = depth.min(-(most[axis][0] + most[axis][1]) / (2.0 * tangent));
        }
        let mut eye = DVec3::ZERO;
        let far = center.abs().max_element();
        let nearest = if bounds.radius() > 0.0 {
            // Closer than this, near parts would tower over far ones. Far from the origin, the precision of doubles limits
            // the distance.
            (bounds.radius() * CLOSEST_RADII).max(far * 1e-9).max(1e-9)
        } else {
            // One place has no size to fill the picture with. From here, offsets in single precision are exact enough to
            // keep it in the middle.
            (far * 1e-3).max(1.0)
        };
        eye.z = depth.min(-nearest);
        // The room that is left along the other axis is shared evenly on the screen: by bisection, since the slope of
        // the uppermost point falls and that of the lowest grows with the eye's height.
        for (axis, tangent) in [(0, tangent * aspect), (1, tangent)] {
            let (mut low, mut high) = (most[axis][0] + tangent * eye.z, -most[axis][1] - tangent * eye.z);
            for _ in 0..40 {
                eye[axis] = (low + high) * 0.5;
                let slopes = seen.iter().map(|p| (p[axis] - eye[axis]) / (p.z - eye.z));
                let (least, largest) = slopes.fold((f64::INFINITY, f64::NEG_INFINITY), |(least, largest), slope| {
                    (slope.min(least), slope.max(largest))
                });
                if largest > -least { low = eye[axis] } else { high = eye[axis] }
            }
        }
        self.eye = center + rows.transpose() * eye;
        self.pivot = self.eye + rows.row(2) * -eye.z;
    }

    /// Orbits like a turntable: `turn` about the up axis, `tilt` about the right axis, in radians.
    pub fn orbit(&mut self, turn: f64, tilt: f64) {
        self.rotate_about(self.pivot, turn, tilt);
    }

    /// Orbits likewise about another point, which keeps its place in the picture.
    pub fn orbit_about(&mut self, center: DVec3, turn: f64, tilt: f64) {
        self.rotate_about(center, turn, tilt);
    }

    /// Turns the line of sight about the eye, in radians; the pivot moves along.
    pub fn look(&mut self, turn: f64, tilt: f64) {
        self.rotate_about(self.eye, turn, tilt);
    }

    fn rotate_about(&mut self, center: DVec3, turn: f64, tilt: f64) {
        let angle = self.forward().angle_between(self.up);
        // Tilting by t reduces the angle to the up axis by t.
        let tilt = angle - (angle - tilt).clamp(POLE_MARGIN, std::f64::consts::PI - POLE_MARGIN);
        let rotation = DQuat::from_axis_angle(self.up, turn) * DQuat::from_axis_angle(self.right(), tilt);
        self.eye = center + rotation * (self.eye - center);
        self.pivot = center + rotation * (self.pivot - center);
    }

    fn leave_pole(&mut self) {
        let angle = self.forward().angle_between(self.up);
        if !(POLE_MARGIN..=std::f64::consts::PI - POLE_MARGIN).contains(&angle) {
            let (_, front) = horizontal_axes(self.up);
            let distance = self.distance();
            let back = -self.forward() + front * POLE_MARGIN * 2.0;
            self.eye = self.pivot + back.normalize() * distance;
        }
    }

    /// Moves eye and pivot by `pixels` of the picture plane at the pivot's depth (x right, y down).
    pub fn pan(&mut self, pixels: DVec2, field_of_view_degrees: f32, height_pixels: f64) {
        let per_pixel =
            2.0 * self.distance() * (f64::from(field_of_view_degrees).to_radians() * 0.5).tan() / height_pixels;
        let rows = self.view_from_world().transpose();
        let shift = rows.x_axis * (-pixels.x * per_pixel) + rows.y_axis * (pixels.y * per_pixel);
        self.eye += shift;
        self.pivot += shift;
    }

    /// Scales the distances of eye and pivot to `anchor` by `factor`, so that `anchor` keeps its place in the picture.
    pub fn zoom_toward(&mut self, anchor: DVec3, factor: f64) {
        // Beyond these, doubles could no longer distinguish the eye from the pivot, or a coordinate from infinity.
        let reach = self.eye.abs().max_element().max(self.pivot.abs().max_element()).max(1.0);
        let distance = self.distance().max(f64::MIN_POSITIVE);
        let factor = factor.clamp((reach * 1e-12 / distance).min(1.0), (1e15 / distance).max(1.0));
        self.eye = anchor + (self.eye - anchor) * factor;
        self.pivot = anchor + (self.pivot - anchor) * factor;
    }

    /// Moves by `step` = (right, up, forward) in world units.
    pub fn fly(&mut self, step: DVec3) {
        let shift = self.right() * step.x + self.up * step.y + self.forward() * step.z;
        self.eye += shift;
        self.pivot += shift;
    }

    /// Makes `pivot` the centre of the picture and keeps eye and direction of sight as near to the old ones as
    /// possible: the eye moves sideways so that the direction stays.
    pub fn recenter(&mut self, pivot: DVec3) {
        let shift = pivot - self.pivot;
        self.eye += shift;
        self.pivot = pivot;
    }
}

/// Two horizontal directions for an up axis: to the right, and towards a viewer in front. For z up the front is -y
/// (looking north), for y up it is +z.
fn horizontal_axes(up: DVec3) -> (DVec3, DVec3) {
    let front = if up.z.abs() > 0.7 { -DVec3::Y } else { DVec3::Z };
    let side = up.cross(front).normalize_or(DVec3::X);
    (side, side.cross(up))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit_box() -> Bounds {
        Bounds { min: DVec3::splat(-1.0), max: DVec3::ONE }
    }

    fn pixel(camera: &Camera, world: DVec3) -> DVec2 {
        let view = camera.view_from_world() * (world - camera.eye);
        DVec2::new(view.x / view.z, view.y / view.z)
    }

    #[test]
    fn framing_fills_the_picture_with_the_points_and_keeps_them_off_its_edge() {
        let limit = 30_f64.to_radians().tan();
        for up in [DVec3::Y, DVec3::Z] {
            for view in [
                StandardView::Front,
                StandardView::Top,
                StandardView::Isometric,
                StandardView::Left,
                StandardView::Bottom,
            ] {
                let points = Bounds { min: DVec3::new(-5.0, 2.0, 7.0), max: DVec3::new(9.0, 4.0, 8.0) }.corners();
                // All points of the box, and a corner of it.
                for points in [&points[..], &points[..3]] {
                    let camera = Camera::framing(points, view, up, 60.0, 1.5);
                    let seen: Vec<DVec2> =
                        points.iter().map(|point| pixel(&camera, *point) / DVec2::new(limit * 1.5, limit)).collect();
                    let worst = seen.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
                    let mut bounds = Bounds::EMPTY;
                    points.iter().for_each(|point| bounds.include(*point));
                    let is_closest = camera.distance() < bounds.radius() * CLOSEST_RADII * 1.001;
                    assert!(worst <= 0.97 && (worst > 0.95 || is_closest), "{up} {view:?}: {worst}");
                    let sum = |axis: usize| {
                        let along = seen.iter().map(|p| p[axis]);
                        along.clone().fold(f64::NEG_INFINITY, f64::max) + along.fold(f64::INFINITY, f64::min)
                    };
                    assert!(sum(0).abs() < 1e-6 && sum(1).abs() < 1e-6, "centred both ways");
                }
            }
        }
    }

    #[test]
    fn a_single_point_is_framed_wherever_it_is() {
        for point in [DVec3::ZERO, DVec3::new(1.2, 12_345.7, 1_234_568_000.0)] {
            let camera = Camera::framing(&[point], StandardView::Isometric, DVec3::Z, 60.0, 1.0);
            let view = camera.view_from_world() * (point - camera.eye);
            assert!(view.z > 0.0 && (view.x / view.z).abs() < 0.1 && (view.y / view.z).abs() < 0.1, "{view}");
        }
    }

    #[test]
    fn front_looks_north_in_a_survey_and_top_has_north_up() {
        let front = Camera::framing(&unit_box().corners(), StandardView::Front, DVec3::Z, 60.0, 1.0);
        assert!(front.forward().abs_diff_eq(DVec3::Y, 1e-9));
        assert!(front.right().abs_diff_eq(DVec3::X, 1e-9));
        let top = Camera::framing(&unit_box().corners(), StandardView::Top, DVec3::Z, 60.0, 1.0);
        assert!(top.view_from_world().row(1).dot(DVec3::Y) > 0.99);
        assert!(top.right().abs_diff_eq(DVec3::X, 1e-6));
    }

    #[test]
    fn orbiting_keeps_the_distance_and_stops_before_the_pole() {
        let mut camera = Camera::framing(&unit_box().corners(), StandardView::Isometric, DVec3::Z, 60.0, 1.0);
        let distance = camera.distance();
        for _ in 0..100 {
            camera.orbit(0.1, 0.3);
            assert!((camera.distance() - distance).abs() < 1e-9);
            assert!(camera.right().is_normalized());
        }
        assert!(camera.forward().angle_between(camera.up) >= POLE_MARGIN * 0.99);
        for _ in 0..100 {
            camera.orbit(0.0, -0.3);
        }
        assert!(camera.forward().angle_between(camera.up) <= std::f64::consts::PI - POLE_MARGIN * 0.99);
    }

    #[test]
    fn a_point_that_is_orbited_keeps_its_place_in_the_picture() {
        let mut camera = Camera::from_eye(DVec3::new(3.0, -9.0, 2.5), DVec3::new(0.0, 0.8, 0.0), DVec3::Z);
        let center = DVec3::new(-1.0, -2.0, 1.0);
        let (before, distance) = (pixel(&camera, center), camera.eye.distance(center));
        for _ in 0..20 {
            camera.orbit_about(center, 0.3, 0.02);
        }
        assert!(pixel(&camera, center).distance(before) < 1e-9);
        assert!((camera.eye.distance(center) - distance).abs() < 1e-9 && camera.right().z.abs() < 1e-9);
    }

    #[test]
    fn zooming_keeps_the_point_under_the_cursor() {
        let mut camera = Camera::framing(&unit_box().corners(), StandardView::Isometric, DVec3::Z, 60.0, 1.0);
        let anchor = DVec3::new(0.3, -0.4, 0.9);
        let before = pixel(&camera, anchor);
        camera.zoom_toward(anchor, 0.7);
        assert!(pixel(&camera, anchor).abs_diff_eq(before, 1e-12));
    }

    #[test]
    fn zooming_without_end_keeps_a_camera_that_can_zoom_back() {
        for factor in [0.8, 1.25] {
            let mut camera = Camera::looking(DVec3::new(6e6, 5e6, 100.0), DVec3::new(0.3, -1.0, 0.4), 500.0, DVec3::Z);
            let forward = camera.forward();
            for _ in 0..2000 {
                camera.zoom_toward(camera.pivot, factor);
            }
            assert!(
                camera.eye.is_finite() && camera.distance() > 0.0 && camera.forward().dot(forward) > 0.9,
                "{camera:?}"
            );
            for _ in 0..20 {
                camera.zoom_toward(camera.pivot, 1.0 / factor);
            }
            assert!(camera.forward().dot(forward) > 0.9);
        }
    }

    #[test]
    fn panning_moves_the_pivot_plane_with_the_cursor() {
        let mut camera = Camera::framing(&unit_box().corners(), StandardView::Front, DVec3::Z, 60.0, 1.0);
        let point = camera.pivot;
        camera.pan(DVec2::new(100.0, 50.0), 60.0, 600.0);
        let moved = pixel(&camera, point) * 300.0 / 30_f64.to_radians().tan();
        assert!(moved.abs_diff_eq(DVec2::new(100.0, -50.0), 1e-6), "{moved}");
    }

    #[test]
    fn degenerate_cameras_still_have_an_orthonormal_frame() {
        let same = Camera { eye: DVec3::ONE, pivot: DVec3::ONE, up: DVec3::Z };
        let along_up = Camera::looking(DVec3::ZERO, DVec3::Z, 3.0, DVec3::Z);
        for camera in [same, along_up, Camera::looking(DVec3::ZERO, DVec3::ZERO, 0.0, DVec3::ZERO)] {
            let rows = camera.view_from_world();
            assert!((rows.determinant().abs() - 1.0).abs() < 1e-6, "{rows}");
        }
    }
}
