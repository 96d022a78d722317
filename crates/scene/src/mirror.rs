//! Mirrors with a formula: what they look like and where they stand.

use cloud::sampling::{Placement, StarShape, Surface};
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// The form of a mirror whose size is 1, in its own coordinates. Lengths are relative to the mirror's size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// In z = 0, x from -1 to 1 and y from -height to height.
    Plane { height: f64 },
    /// Of radius 1.
    Sphere,
    /// z = (x^2 + y^2) / (4 focal_length) up to the rim of radius 1; hollow towards +z.
    Paraboloid { focal_length: f64 },
    /// A tube of this radius about the circle of radius 1 in z = 0.
    Torus { tube: f64 },
    /// Star-shaped, with convex and hollow patches; its mean radius is 1.
    Blob,
    /// Star-shaped, with hundreds of small bumps.
    Coral,
}

/// A mirror in the scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    pub name: String,
    pub shape: Shape,
    /// World units.
    pub position: DVec3,
    /// Turns the shape's own axes into the world's.
    pub rotation: DQuat,
    /// World units.
    pub size: f64,
    /// Linear albedo of its diffuse part, and the tint of its reflections.
    pub color: [f32; 3],
    /// Share of the light that is reflected, 0 to 1; the rest is diffuse.
    pub specular_intensity: f32,
    pub specular_power: f32,
    /// Drawn as sampled points unless `mirror.surface` says otherwise: the published condition of the built-in scenes.
    #[serde(default)]
    pub as_points: bool,
}

impl Mirror {
    /// The surface and where it stands.
    pub fn surface(&self) -> (Surface, Placement) {
        let surface = match self.shape {
            Shape::Plane { height } => Surface::Rectangle {
                corner: DVec3::new(-1.0, -height, 0.0),
                edges: [DVec3::X * 2.0, DVec3::Y * (2.0 * height)],
            },
            Shape::Sphere => Surface::Sphere { radius: 1.0 },
            Shape::Paraboloid { focal_length } => Surface::Paraboloid { focal_length, rim_radius: 1.0 },
            Shape::Torus { tube } => Surface::Torus { ring: 1.0, tube },
            Shape::Blob => Surface::Star(StarShape { radius: blob_radius, gradient: blob_gradient }),
            Shape::Coral => Surface::Star(StarShape { radius: coral_radius, gradient: coral_gradient }),
        };
        let rotation = DMat3::from_quat(self.rotation.normalize());
        (surface, Placement { rotation, scale: self.size, translation: self.position })
    }
}

fn blob_radius(d: DVec3) -> f64 {
    1.0 + 0.10 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.06 * (7.0 * d.z).sin()
}

fn blob_gradient(d: DVec3) -> DVec3 {
    let ((sin_x, cos_x), (sin_y, cos_y)) = ((6.0 * d.x + 1.0).sin_cos(), (5.0 * d.y).sin_cos());
    DVec3::new(0.10 * 6.0 * cos_x * sin_y, 0.10 * 5.0 * sin_x * cos_y, 0.06 * 7.0 * (7.0 * d.z).cos())
}

fn coral_radius(d: DVec3) -> f64 {
    let bumps = (19.0 * d.x).sin() * (17.0 * d.y).sin() * (23.0 * d.z).sin();
    1.0 + 0.08 * bumps + 0.03 * (41.0 * d.x + 3.0 * d.y).sin()
}

fn coral_gradient(d: DVec3) -> DVec3 {
    let [(sin_x, cos_x), (sin_y, cos_y), (sin_z, cos_z)] = [19.0 * d.x, 17.0 * d.y, 23.0 * d.z].map(f64::sin_cos);
    let ripple = 0.03 * (41.0 * d.x + 3.0 * d.y).cos();
    let bumps = DVec3::new(19.0 * cos_x * sin_y * sin_z, 17.0 * sin_x * cos_y * sin_z, 23.0 * sin_x * sin_y * cos_z);
    0.08 * bumps + ripple * DVec3::new(41.0, 3.0, 0.0)
}
