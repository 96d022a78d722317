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
    /// Whether the ray is beneath a clear surface that bounds no solid, as in water: it meets no such surface.
    pub is_beneath: bool,
}

impl Ray {
    pub fn from_eye(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, leaves_surface: false, is_beneath: false }
    }

    pub fn from_surface(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, leaves_surface: true, is_beneath: false }
    }

    /// Whether the ray does not meet a surface with this behind it.
    pub(crate) fn passes(&self, medium: Option<Medium>) -> bool {
        self.is_beneath && medium.is_some_and(|medium| medium.side == Side::Beneath)
    }

    pub fn at(&self, distance: f64) -> DVec3 {
        self.origin + self.direction * distance
    }
}

/// The way of light through a clear surface, as a ray meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// The index of refraction behind the surface over that before it.
    pub ratio: f64,
    pub side: Side,
}

/// The material of a clear surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clear {
    /// The index of refraction of what is behind it, relative to the air.
    pub index: f64,
    /// Whether it bounds a solid, out of which its normals point.
    pub is_solid: bool,
}

impl Clear {
    /// What lies behind the surface for a ray in this direction, where the surface has this normal.
    pub(crate) fn medium(self, direction: DVec3, normal: DVec3) -> Medium {
        match (self.is_solid, direction.dot(normal) > 0.0) {
            (false, _) => Medium { ratio: self.index, side: Side::Beneath },
            (true, false) => Medium { ratio: self.index, side: Side::IntoSolid },
            (true, true) => Medium { ratio: 1.0 / self.index, side: Side::OutOfSolid },
        }
    }
}

/// Where a ray through a clear surface gets to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    IntoSolid,
    OutOfSolid,
    /// Beneath a surface that bounds no solid, such as that of water.
    Beneath,
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
    /// What lies behind it, if light goes through the surface.
    pub medium: Option<Medium>,
    /// The index of the chunk (`Surfels`); or of the object, or after these of the mesh (`Exact`).
    pub surface: u32,
    /// The index of the point in its chunk (`Surfels`), or of the triangle in its mesh (`Exact`, where objects have 0).
    pub point: u32,
}

/// Geometry in which rays are traced.
pub trait Geometry: Sync {
    /// The first hit.
    fn nearest(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything that casts a shadow is hit before `distance`: clear surfaces cast none.
    fn is_blocked(&self, ray: &Ray, distance: f64) -> bool;
}
