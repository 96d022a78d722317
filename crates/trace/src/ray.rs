//! Rays, their hits, and the interface of geometry.

use glam::DVec3;

/// A ray that leaves a disc, or a point of a mirror among discs, sees no disc nearer than this many radii of that disc.
/// Splats overlap their neighbours, so close to its own surface a ray meets discs that represent the point from which
/// it starts. This is part of the definition of a reflection: the renderer leaves the same points out.
pub const SELF_DISTANCE: f64 = 4.0;

/// A half line. Lengths are world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub origin: DVec3,
    /// The direction, a unit vector.
    pub direction: DVec3,
    /// Whether `origin` lies on a surface, which the ray must not hit at once.
    pub leaves_surface: bool,
}

impl Ray {
    pub fn from_eye(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, leaves_surface: false }
    }

    pub fn from_surface(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, leaves_surface: true }
    }

    pub fn at(&self, distance: f64) -> DVec3 {
        self.origin + self.direction * distance
    }
}

/// Where a ray ends. Both sides of surfaces are visible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The distance from the ray's origin in world units.
    pub distance: f64,
    pub position: DVec3,
    /// The unit normal on the side from which the ray comes.
    pub normal: DVec3,
    /// The linear red, green and blue.
    pub albedo: DVec3,
    /// The share of the light that is reflected; above 0 for a mirror. Below 0, the share that a highlight of a surface
    /// that is no mirror takes from its diffuse light.
    pub specular_intensity: f64,
    /// The exponent of these highlights of lights; 0 for none.
    pub specular_power: f64,
    /// The index of the chunk (`Surfels`); or of the object, or after these of the mesh (`Exact`).
    pub surface: u32,
    /// The index of the point in its chunk (`Surfels`), or of the triangle in its mesh (`Exact`, where objects have 0).
    pub point: u32,
}

/// Geometry in which rays are traced.
pub trait Geometry: Sync {
    /// The first hit.
    fn nearest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit before `distance`.
    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool;
}
