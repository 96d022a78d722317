//! The rays through a picture's pixels.

use glam::{DMat3, DVec3};
use scene::{Camera, Projection, ViewSettings};

use crate::Ray;

/// The viewpoint of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// All rays start here, in world units.
    Eye(DVec3),
    /// All rays run along this unit vector.
    Parallel(DVec3),
}

impl Viewpoint {
    /// The unit vector of the ray that sees `position`.
    pub fn toward(&self, position: DVec3) -> DVec3 {
        match *self {
            Self::Eye(eye) => (position - eye).normalize_or_zero(),
            Self::Parallel(direction) => direction,
        }
    }

    /// The distance along that ray, from the eye or from any plane across the rays.
    pub fn distance(&self, position: DVec3) -> f64 {
        match *self {
            Self::Eye(eye) => position.distance(eye),
            Self::Parallel(direction) => position.dot(direction),
        }
    }
}

/// A camera's rays. Row 0 is at the top.
#[derive(Clone, Copy, Debug)]
pub struct PixelRays {
    eye: DVec3,
    world_from_view: DMat3,
    projection: Projection,
    /// The pixels per unit of the picture plane: at distance 1, or in parallel projection anywhere.
    pixels_per_unit: f64,
    pub size: [u32; 2],
}

impl PixelRays {
    /// In parallel projection, rays start `reach` before the plane through the eye, so that the whole scene is in front
    /// of them: twice its radius and the eye's distance to its middle is enough.
    pub fn new(camera: &Camera, view: &ViewSettings, size: [u32; 2], reach: f64) -> Self {
        let tangent = (f64::from(view.field_of_view).to_radians() / 2.0).tan();
        let half_height = f64::from(size[1]) / 2.0;
        let (eye, plane_distance) = match view.projection {
            Projection::Perspective => (camera.eye, 1.0),
            Projection::Orthographic => (camera.eye - camera.forward() * reach, camera.distance()),
        };
        Self {
            eye,
            world_from_view: camera.view_from_world().transpose(),
            projection: view.projection,
            pixels_per_unit: half_height / (tangent * plane_distance),
            size,
        }
    }

    pub fn viewpoint(&self) -> Viewpoint {
        match self.projection {
            Projection::Perspective => Viewpoint::Eye(self.eye),
            Projection::Orthographic => Viewpoint::Parallel(self.world_from_view.z_axis),
        }
    }

    pub fn pixel_count(&self) -> usize {
        self.size[0] as usize * self.size[1] as usize
    }

    /// The ray through the centre of a pixel, counted row by row.
    pub fn ray(&self, pixel: usize) -> Ray {
        self.ray_through(pixel, [0.5; 2])
    }

    /// Ray `index` of `count` that are spread evenly over a pixel, by the points of Hammersley (1960).
    pub fn ray_of(&self, pixel: usize, index: u32, count: u32) -> Ray {
        let across = f64::from(index.reverse_bits()) / 2.0_f64.powi(32);
        // The middle of the places is that of the pixel.
        let most = 1.0 - 1.0 / f64::from(count.next_power_of_two());
        self.ray_through(pixel, [(f64::from(index) + 0.5) / f64::from(count), across + (1.0 - most) / 2.0])
    }

    /// The ray through a place of a pixel, from its left and upper edge in pixels.
    fn ray_through(&self, pixel: usize, place: [f64; 2]) -> Ray {
        let width = self.size[0] as usize;
        let [x, y] = [(pixel % width, place[0]), (pixel / width, place[1])].map(|(index, at)| index as f64 + at);
        let right = (x - f64::from(self.size[0]) / 2.0) / self.pixels_per_unit;
        let up = (f64::from(self.size[1]) / 2.0 - y) / self.pixels_per_unit;
        match self.projection {
            Projection::Perspective => {
                Ray::from_eye(self.eye, (self.world_from_view * DVec3::new(right, up, 1.0)).normalize())
            }
            Projection::Orthographic => {
                let offset = self.world_from_view * DVec3::new(right, up, 0.0);
                Ray::from_eye(self.eye + offset, self.world_from_view.z_axis)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corner_pixels_see_the_corners_of_the_field_of_view() {
        let camera = Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y);
        let rays = PixelRays::new(&camera, &ViewSettings::default(), [800, 600], 0.0);
        let tangent = 30.0_f64.to_radians().tan();
        let first = rays.ray(0);
        assert_eq!(first.origin, DVec3::Z * 2.0);
        let expected = DVec3::new(-tangent * 799.0 / 600.0, tangent * 599.0 / 600.0, -1.0).normalize();
        assert!(first.direction.distance(expected) < 1e-14, "{}", first.direction);
        let last = rays.ray(rays.pixel_count() - 1).direction;
        assert!(last.distance(DVec3::new(-expected.x, -expected.y, expected.z)) < 1e-14);
    }

    #[test]
    fn rays_of_a_pixel_lie_one_in_each_row_and_column_of_it_about_its_middle() {
        let camera = Camera::looking(DVec3::ZERO, DVec3::Z, 2.0, DVec3::Y);
        let rays = PixelRays::new(&camera, &ViewSettings::default(), [8, 6], 0.0);
        let place = |ray: Ray| {
            let at = rays.world_from_view.transpose() * ray.direction;
            [4.0 + at.x / at.z * rays.pixels_per_unit, 3.0 - at.y / at.z * rays.pixels_per_unit]
        };
        for count in [1, 2, 16, 64] {
            let places: Vec<[f64; 2]> = (0..count).map(|index| place(rays.ray_of(11, index, count))).collect();
            for axis in 0..2 {
                let first = [3.0, 1.0][axis];
                let mut at: Vec<f64> = places.iter().map(|place| (place[axis] - first) * f64::from(count)).collect();
                at.sort_by(f64::total_cmp);
                let even = at.iter().enumerate().all(|(index, at)| (at - index as f64 - 0.5).abs() < 1e-9);
                assert!(even, "{count} rays on axis {axis}: {at:?}");
            }
        }
        assert!(rays.ray_of(5, 0, 1).direction.distance(rays.ray(5).direction) < 1e-15);
    }

    #[test]
    fn parallel_rays_meet_the_perspective_ones_in_the_plane_of_the_pivot() {
        let camera = Camera::looking(DVec3::new(3.0, -1.0, 2.0), DVec3::new(1.0, 2.0, 0.5), 7.0, DVec3::Z);
        let perspective = PixelRays::new(&camera, &ViewSettings::default(), [64, 48], 0.0);
        let view = ViewSettings { projection: Projection::Orthographic, ..ViewSettings::default() };
        let parallel = PixelRays::new(&camera, &view, [64, 48], 100.0);
        for pixel in [0, 63, 1000, 64 * 48 - 1] {
            let [a, b] = [perspective, parallel].map(|rays| rays.ray(pixel));
            let on_plane = |ray: Ray| {
                ray.at((camera.pivot - ray.origin).dot(camera.forward()) / ray.direction.dot(camera.forward()))
            };
            assert!(on_plane(a).distance(on_plane(b)) < 1e-12);
            assert_eq!(b.direction, camera.forward());
            assert!((b.origin - camera.eye).dot(camera.forward()) < -99.0);
        }
    }
}
