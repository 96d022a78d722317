//! Rays, what they hit, and what they can be traced in.

use glam::DVec3;

/// A ray that leaves a disc, or a point of a mirror among discs, sees no disc nearer than this many radii of that disc. Splats
/// overlap their neighbours, so that close to its own surface a ray meets discs that stand for the point it starts from.
/// Part of the definition of a reflection: the renderer leaves the same points out.
pub const SELF_DISTANCE: f64 = 4.0;

/// A half line. Lengths are world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit vector.
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

/// Where a ray ends. Surfaces have two sides, both alike.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// From the ray's origin, world units.
    pub distance: f64,
    pub position: DVec3,
    /// Unit vector on the side that the ray comes from.
    pub normal: DVec3,
    /// Linear red, green and blue.
    pub albedo: DVec3,
    /// Share of the light that is reflected; a mirror where it is above 0.
    pub specular_intensity: f64,
    /// Exponent of the highlight that a mirror shows of lights; 0 for none, and where there is no mirror.
    pub specular_power: f64,
    /// Running number of the chunk (`Surfels`), or of the object or after these the mesh (`Exact`).
    pub surface: u32,
    /// Index of the point in its chunk (`Surfels`), or of the triangle in its mesh (`Exact`, where objects have 0).
    pub point: u32,
}

/// What rays are traced in.
pub trait Geometry: Sync {
    /// The first hit.
    fn nearest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit before `distance`.
    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool;
}
