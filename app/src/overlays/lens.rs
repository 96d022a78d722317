//! Projects world positions to pixels, and finds the sight line of a pixel.

use glam::{DMat3, DVec2, DVec3};
use scene::{Camera, Projection, ViewSettings};

/// The centre of a pixel.
pub fn to_vector(pixel: [u32; 2]) -> DVec2 {
    DVec2::from(pixel.map(f64::from)) + 0.5
}

/// Maps between world and picture for one camera and one picture size. Everything that is drawn over the picture uses
/// it.
pub struct Lens {
    eye: DVec3,
    view_from_world: DMat3,
    /// The tangents of half the field of view, along x and y.
    tangents: DVec2,
    distance: f64,
    is_parallel: bool,
    size: DVec2,
}

impl Lens {
    pub fn new(camera: &Camera, view: &ViewSettings, size: [u32; 2]) -> Self {
        let size = DVec2::from(size.map(|side| f64::from(side.max(1))));
        let tangent = (f64::from(view.field_of_view).to_radians() * 0.5).tan();
        Self {
            eye: camera.eye,
            view_from_world: camera.view_from_world(),
            tangents: DVec2::new(tangent * size.x / size.y, tangent),
            distance: camera.distance(),
            is_parallel: view.projection == Projection::Orthographic,
            size,
        }
    }

    /// Pixel coordinates of a world position; `None` behind the eye.
    pub fn project(&self, world: DVec3) -> Option<DVec2> {
        let view = self.view_from_world * (world - self.eye);
        let depth = if self.is_parallel { self.distance } else { view.z };
        if depth <= 0.0 {
            return None;
        }
        let device = view.truncate() / (self.tangents * depth);
        Some((DVec2::new(device.x, -device.y) + 1.0) * 0.5 * self.size)
    }

    /// The origin and the unit direction of a pixel's sight line.
    pub fn ray(&self, pixel: DVec2) -> (DVec3, DVec3) {
        let at = self.on_pivot_plane(pixel);
        let forward = self.view_from_world.row(2);
        if self.is_parallel {
            (at - forward * self.distance, forward)
        } else {
            (self.eye, (at - self.eye).normalize_or(forward))
        }
    }

    /// World units per pixel at the depth of a world position; `None` behind the eye.
    pub fn units_per_pixel(&self, world: DVec3) -> Option<f64> {
        let depth = if self.is_parallel { self.distance } else { self.view_from_world.row(2).dot(world - self.eye) };
        (depth > 0.0).then(|| 2.0 * self.tangents.y * depth / self.size.y)
    }

    /// The viewing direction, a unit vector.
    pub fn forward(&self) -> DVec3 {
        self.view_from_world.row(2)
    }

    /// The world position of a pixel on the plane through the pivot that faces the eye.
    pub fn on_pivot_plane(&self, pixel: DVec2) -> DVec3 {
        let device = pixel / self.size * 2.0 - 1.0;
        let view = (DVec2::new(device.x, -device.y) * self.tangents * self.distance).extend(self.distance);
        self.eye + self.view_from_world.transpose() * view
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_on_the_pivot_plane_projects_back_to_itself() {
        let camera = Camera::looking(DVec3::new(5e5, 4e6, 10.0), DVec3::new(1.0, -2.0, 0.7), 40.0, DVec3::Z);
        for projection in [Projection::Perspective, Projection::Orthographic] {
            let view = ViewSettings { projection, ..ViewSettings::default() };
            let lens = Lens::new(&camera, &view, [800, 600]);
            for pixel in [DVec2::new(0.0, 0.0), DVec2::new(400.0, 300.0), DVec2::new(123.0, 456.0)] {
                let back = lens.project(lens.on_pivot_plane(pixel)).unwrap();
                assert!(back.distance(pixel) < 1e-4, "{pixel} became {back}");
            }
            assert!(lens.project(camera.pivot).unwrap().distance(DVec2::new(400.0, 300.0)) < 1e-4);
            let (from, direction) = lens.ray(DVec2::new(123.0, 456.0));
            let seen = lens.project(from + direction * 57.0).unwrap();
            assert!(seen.distance(DVec2::new(123.0, 456.0)) < 1e-4, "{seen}");
        }
        let lens = Lens::new(&camera, &ViewSettings::default(), [800, 600]);
        assert_eq!(lens.project(camera.eye - camera.forward()), None);
    }
}
