//! The objects that a frame shows, and the camera as the shaders get it.

use cloud::Bounds;
use glam::{DMat3, DVec3, Vec4};
use scene::{Camera, LightClues, Mirror, Projection, SpotLight, ViewSettings};

use crate::layout::Frame;

/// The objects of the scene besides points.
#[derive(Clone, Copy, Debug, Default)]
pub struct Objects<'a> {
    /// Mirrors with a formula. The points that represent them are clouds of the store, whose material says so.
    pub mirrors: &'a [Mirror],
    /// Spot lights. Only the first four shine.
    pub lights: &'a [SpotLight],
    /// What decides about automatic light, besides the lights.
    pub clues: LightClues,
}

/// The camera of one frame, in full precision on the CPU side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameCamera {
    pub eye: DVec3,
    pub view_from_world: DMat3,
    /// The unit vector that points up in the world.
    pub world_up: DVec3,
    pub focal_pixels: f64,
    pub orthographic: bool,
    pub size: [u32; 2],
    /// Nothing nearer than this is drawn. Negative where that counts as lying as far as this is below 0: in the maps of
    /// suns.
    pub near: f64,
    /// The distance of the pivot, for a parallel projection.
    pub reference_depth: f64,
    /// The distance by which the eye was moved back from the camera's own.
    pub moved_back: f64,
    /// The radius of what is drawn in world units.
    pub scene_radius: f64,
    /// The tiles of the picture in which mirrors may be.
    pub mirror_tiles: Tiles,
    /// Only points in front of this plane are visible. Splatting passes test it if `clips` is set.
    pub clip: Option<Plane>,
}

/// A plane: the places whose product with the unit normal is the offset. Places with a larger product are in front of
/// it. World units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    pub normal: DVec3,
    pub offset: f64,
}

/// A rectangle of tiles of 8 x 8 pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tiles {
    pub first: [u32; 2],
    pub count: [u32; 2],
}

impl Tiles {
    pub fn is_empty(self) -> bool {
        self.count.contains(&0)
    }

    /// All tiles of a picture.
    pub fn of(size: [u32; 2]) -> Self {
        Self { first: [0; 2], count: size.map(|edge| edge.div_ceil(8)) }
    }
}

impl FrameCamera {
    /// `scene_radius` is the radius of what is drawn, in world units. The eye of a parallel projection is moved back
    /// until the whole scene is in front of it.
    pub fn new(camera: &Camera, view: &ViewSettings, size: [u32; 2], scene_center: DVec3, scene_radius: f64) -> Self {
        let orthographic = view.projection == Projection::Orthographic;
        let tangent = (f64::from(view.field_of_view).to_radians() * 0.5).tan();
        let half_height = f64::from(size[1]) * 0.5;
        let distance = camera.distance().max(1e-12);
        let mut eye = camera.eye;
        let focal_pixels = if orthographic { half_height / (tangent * distance) } else { half_height / tangent };
        let mut moved_back = 0.0;
        let near = if orthographic {
            let forward = camera.forward();
            let front = (scene_center - eye).dot(forward) - scene_radius * 1.01;
            moved_back = -front.min(0.0);
            eye -= forward * moved_back;
            0.0
        } else {
            // A ten-thousandth of the camera's distance: close enough for flying through walls, and the relative
            // precision of f32 depth does not depend on it.
            distance * 1e-4
        };
        let reference_depth = if orthographic { distance } else { 0.0 };
        let view_from_world = camera.view_from_world();
        Self {
            eye,
            view_from_world,
            world_up: camera.up.normalize_or(DVec3::Z),
            focal_pixels,
            orthographic,
            size,
            near,
            reference_depth,
            moved_back,
            scene_radius,
            mirror_tiles: Tiles::of(size),
            clip: None,
        }
    }

    /// A perspective view without a picture's camera, for lights. `focal_pixels` is the number of pixels per unit of
    /// tangent.
    pub fn along(eye: DVec3, direction: DVec3, focal_pixels: f64, size: [u32; 2]) -> Self {
        let forward = direction.normalize_or(-DVec3::Z);
        let right = forward.any_orthonormal_vector();
        Self {
            eye,
            view_from_world: DMat3::from_cols(right, right.cross(forward), forward).transpose(),
            world_up: DVec3::Z,
            focal_pixels,
            orthographic: false,
            size,
            near: direction.length() * 1e-4,
            reference_depth: 0.0,
            moved_back: 0.0,
            scene_radius: 0.0,
            mirror_tiles: Tiles::of(size),
            clip: None,
        }
    }

    /// A parallel view without a picture's camera, for suns; nothing behind `eye` is visible.
    pub fn parallel_along(eye: DVec3, direction: DVec3, pixels_per_unit: f64, size: [u32; 2]) -> Self {
        let reference_depth = direction.length();
        Self { orthographic: true, near: 0.0, reference_depth, ..Self::along(eye, direction, pixels_per_unit, size) }
    }

    /// The camera mirrored at a plane, which sees what is in front of the plane. Its right is the mirrored right: a
    /// pixel shows what the mirror shows at the same pixel of this camera's picture.
    pub fn mirrored(self, plane: Plane) -> Self {
        let Plane { normal, offset } = plane;
        let [x, y, z] = normal.to_array().map(|part| normal * part);
        let reflection = DMat3::IDENTITY - DMat3::from_cols(x, y, z) * 2.0;
        Self {
            eye: self.eye - normal * (2.0 * (normal.dot(self.eye) - offset)),
            view_from_world: self.view_from_world * reflection,
            clip: Some(plane),
            ..self
        }
    }

    pub fn to_gpu(self) -> Frame {
        let row = |index: usize| self.view_from_world.row(index).as_vec3().extend(0.0);
        Frame {
            right: row(0),
            up: row(1),
            forward: row(2),
            clip: self.clip.map_or(Vec4::ZERO, |plane| {
                plane.normal.as_vec3().extend((plane.offset - plane.normal.dot(self.eye)) as f32)
            }),
            world_up: self.world_up.as_vec3().extend(0.0),
            focal_pixels: self.focal_pixels as f32,
            orthographic: u32::from(self.orthographic),
            width: self.size[0],
            height: self.size[1],
            near: self.near as f32,
            reference_depth: self.reference_depth as f32,
            scene_radius: self.scene_radius as f32,
            mirror_tile: self.mirror_tiles.first[0] | self.mirror_tiles.first[1] << 16,
            ..Frame::default()
        }
    }

    /// The world position at a pixel coordinate (centres at halves) and a linear depth.
    pub fn world_from_pixel(&self, x: f64, y: f64, depth: f64) -> DVec3 {
        let scale = if self.orthographic { 1.0 } else { depth } / self.focal_pixels;
        let view =
            DVec3::new((x - f64::from(self.size[0]) * 0.5) * scale, (f64::from(self.size[1]) * 0.5 - y) * scale, depth);
        self.eye + self.view_from_world.transpose() * view
    }

    /// The pixels per world unit at the nearest point of a sphere; infinite if that is not in front of the eye.
    pub fn most_pixels_per_unit(&self, center: DVec3, radius: f64) -> f64 {
        let nearest = (self.view_from_world.row(2).dot(center - self.eye) - radius).max(0.0);
        if self.orthographic { self.focal_pixels } else { self.focal_pixels / nearest }
    }

    /// The tiles in which spheres may be seen, widened by `margin` pixels; empty if there are none.
    pub fn tiles_of(&self, spheres: impl Iterator<Item = (DVec3, f64)>, margin: f64) -> Tiles {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (center, radius) in spheres.filter(|(center, radius)| self.sees(*center, *radius, margin)) {
            let view = self.view_from_world * (center - self.eye);
            for (axis, offset) in [view.x, -view.y].into_iter().enumerate() {
                let middle = f64::from(self.size[axis]) * 0.5;
                // The slopes of the two lines through the eye that touch the sphere, seen along the other axis.
                let [from, to] = if self.orthographic {
                    [offset - radius, offset + radius]
                } else if view.z > radius {
                    let squared = view.z * view.z - radius * radius;
                    let half = radius * (offset * offset + squared).max(0.0).sqrt();
                    [(offset * view.z - half) / squared, (offset * view.z + half) / squared]
                } else {
                    [f64::NEG_INFINITY, f64::INFINITY]
                };
                low[axis] = low[axis].min(middle + from * self.focal_pixels - margin);
                high[axis] = high[axis].max(middle + to * self.focal_pixels + margin);
            }
        }
        // An empty range (infinite the wrong way round) gives no tiles.
        let tile = |pixel: f64, edge: u32| (pixel / 8.0).floor().clamp(0.0, f64::from(edge.div_ceil(8))) as u32;
        let first = [0, 1].map(|axis| tile(low[axis], self.size[axis]));
        let end = [0, 1].map(|axis| tile(high[axis] + 8.0, self.size[axis]));
        Tiles { first, count: [0, 1].map(|axis| end[axis].saturating_sub(first[axis])) }
    }

    /// Whether a sphere, widened by `margin` pixels, may be in the picture.
    pub fn sees(&self, center: DVec3, radius: f64, margin: f64) -> bool {
        self.sees_box(Bounds { min: center, max: center }, radius, margin)
    }

    /// Whether a box may be in the picture that is widened by `reach` world units to all sides, and by `margin` pixels.
    pub fn sees_box(&self, bounds: Bounds, reach: f64, margin: f64) -> bool {
        let (center, half_size) = (bounds.center(), bounds.size() * 0.5);
        let view = self.view_from_world * (center - self.eye);
        let [right, up, forward] = [0, 1, 2].map(|row| self.view_from_world.row(row));
        // How far it reaches from its middle along a normal.
        let reaches = |normal: DVec3| half_size.dot(normal.abs()) + reach * normal.length();
        let is_behind = |plane: Plane| plane.normal.dot(center) < plane.offset - reaches(plane.normal);
        let is_too_near = self.near >= 0.0 && view.z < self.near - reaches(forward);
        if is_too_near || self.clip.is_some_and(is_behind) {
            return false;
        }
        let half = [f64::from(self.size[0]) * 0.5, f64::from(self.size[1]) * 0.5]
            .map(|half| (half + margin) / self.focal_pixels);
        [(view.x, right, half[0]), (view.y, up, half[1])].into_iter().all(|(offset, axis, half)| {
            if self.orthographic {
                offset.abs() <= half + reaches(axis)
            } else {
                // The side plane through the eye on whose side the middle lies.
                offset.abs() - half * view.z <= reaches(axis * offset.signum() - forward * half)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(projection: Projection) -> FrameCamera {
        let camera = Camera::looking(DVec3::new(10.0, 0.0, 0.0), -DVec3::X, 10.0, DVec3::Z);
        let view = ViewSettings { projection, ..ViewSettings::default() };
        FrameCamera::new(&camera, &view, [400, 300], DVec3::new(10.0, 0.0, 0.0), 5.0)
    }

    #[test]
    fn pixels_unproject_onto_points_that_project_onto_them() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            let world = camera.world_from_pixel(123.5, 45.5, 7.0);
            let view = camera.view_from_world * (world - camera.eye);
            let scale = if camera.orthographic { camera.focal_pixels } else { camera.focal_pixels / view.z };
            assert!((view.z - 7.0).abs() < 1e-9);
            assert!((200.0 + view.x * scale - 123.5).abs() < 1e-9 && (150.0 - view.y * scale - 45.5).abs() < 1e-9);
        }
    }

    #[test]
    fn a_pixel_of_the_mirrored_camera_shows_what_the_mirror_shows_there() {
        let normal = DVec3::new(-0.3, -0.2, 0.7).normalize();
        let plane = Plane { normal, offset: -2.0 };
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            let mirrored = camera.mirrored(plane);
            for (x, y, depth) in [(10.5, 290.0, 3.0), (200.0, 150.0, 9.0), (399.0, 1.0, 40.0)] {
                let behind = camera.world_from_pixel(x, y, depth);
                let before = behind - normal * (2.0 * (normal.dot(behind) - plane.offset));
                assert!(mirrored.world_from_pixel(x, y, depth).distance(before) < 1e-9);
            }
            // Along one line of sight nothing behind the plane is visible.
            assert!(mirrored.sees(mirrored.world_from_pixel(200.0, 150.0, 9.0), 0.0, 0.0));
            assert!(!mirrored.sees(mirrored.world_from_pixel(200.0, 150.0, 3.0), 0.0, 0.0));
        }
    }

    #[test]
    fn culling_never_drops_a_sphere_that_touches_the_picture() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            for i in 0..4000 {
                let spread = |k: u32| f64::from((i * 7919 + k * 104_729) % 1000) / 500.0 - 1.0;
                let center = DVec3::new(10.0 + spread(1) * 5.0, spread(2) * 9.0, spread(3) * 9.0);
                let view = camera.view_from_world * (center - camera.eye);
                let scale = if camera.orthographic { camera.focal_pixels } else { camera.focal_pixels / view.z };
                let inside = view.z > camera.near && (view.x * scale).abs() < 200.0 && (view.y * scale).abs() < 150.0;
                assert!(!inside || camera.sees(center, 0.0, 0.0), "{center}");
            }
            assert!(!camera.sees(DVec3::new(10.0, 500.0, 0.0), 1.0, 0.0));
            assert!(camera.sees(DVec3::new(10.0, 500.0, 0.0), 499.0, 0.0));
        }
    }

    #[test]
    fn culling_drops_no_box_with_a_place_in_the_picture_and_drops_a_wall_beside_it() {
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let camera = camera(projection);
            let mut dropped = 0;
            for i in 0..4000 {
                let spread = |k: u32| f64::from((i * 7919 + k * 104_729) % 1000) / 500.0 - 1.0;
                let center = DVec3::new(spread(1) * 12.0, spread(2) * 12.0, spread(3) * 12.0);
                let half = DVec3::new(spread(4), spread(5), spread(6)).abs() * 3.0;
                let bounds = Bounds { min: center - half, max: center + half };
                let places = (0..27)
                    .map(|n| center + half * (DVec3::new((n % 3).into(), (n / 3 % 3).into(), (n / 9).into()) - 1.0));
                let is_inside = places.into_iter().any(|place| camera.sees(place, 0.0, 0.0));
                assert!(!is_inside || camera.sees_box(bounds, 0.0, 0.0), "{center} {half}");
                dropped += u32::from(!camera.sees_box(bounds, 0.0, 0.0));
            }
            assert!(dropped > 400, "{dropped}");
            let wall = Bounds { min: DVec3::new(-9.0, 9.0, -9.0), max: DVec3::new(9.0, 9.1, 9.0) };
            assert!(camera.sees(wall.center(), wall.radius(), 0.0) && !camera.sees_box(wall, 0.0, 0.0));
        }
    }

    #[test]
    fn a_parallel_projection_has_all_of_the_scene_before_its_eye() {
        let camera = Camera::looking(DVec3::ZERO, DVec3::X, 0.1, DVec3::Z);
        let view = ViewSettings { projection: Projection::Orthographic, ..ViewSettings::default() };
        let frame = FrameCamera::new(&camera, &view, [100, 100], DVec3::ZERO, 50.0);
        let nearest = (frame.view_from_world * (DVec3::X * 50.0 - frame.eye)).z;
        assert!(nearest > 0.0, "{nearest}");
    }
}
