//! How the points of a cloud reflect.

use scene::{Method, Mirror};

/// How a cloud reflects: a specular intensity above 0 makes it a mirror, one below 0 makes it glossy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Material {
    /// The share of the light that a mirror reflects, 0 to 1; or, with a minus, that a highlight of lights takes from
    /// the diffuse light.
    pub specular_intensity: f32,
    pub specular_power: f32,
    /// The index of refraction of a mirror through which light goes; 0 for an opaque one.
    pub refraction: f32,
    /// Whether the points are samples of a mirror that the renderer may also draw by its formula.
    pub has_formula: bool,
    /// Whether the mirror is drawn as these samples unless `mirror.surface` asks for the formula.
    pub as_points: bool,
    /// The method that finds what the mirror shows to the camera; `None` for that of the frame.
    pub method: Option<Method>,
}

impl Material {
    /// The material of the points that represent a mirror with a formula or a mesh.
    pub fn of_mirror(mirror: &Mirror) -> Self {
        Self {
            specular_intensity: mirror.specular_intensity,
            specular_power: mirror.specular_power,
            refraction: mirror.refraction.unwrap_or(0.0),
            has_formula: mirror.shape.has_formula(),
            as_points: mirror.as_points,
            method: mirror.method,
        }
    }

    /// Whether light goes through.
    pub fn is_clear(&self) -> bool {
        self.specular_intensity > 0.0 && self.refraction > 0.0
    }

    /// Whether it reflects as another one does, apart from how much and how sharply.
    pub(super) fn is_alike(&self, other: &Self) -> bool {
        let kind = |material: &Self| {
            let Self { specular_intensity, refraction, has_formula, as_points, .. } = *material;
            (specular_intensity > 0.0, specular_intensity < 0.0, refraction, has_formula, as_points)
        };
        kind(self) == kind(other)
    }
}
