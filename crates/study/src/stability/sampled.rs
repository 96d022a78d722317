//! A scene of analytic surfaces as points, from which the cases are built.

use std::sync::Arc;

use cloud::hash;
use cloud::sampling::{Placement, Surface};
use glam::DVec3;
use render::Gpu;
use scene::five_mirrors::SampledPart;
use scene::surface_points::{append, splat_radius};
use scene::{Camera, Mirror, Settings, SpotLight};
use trace::Exact;
use trace::exact::{Albedo, Object};

use crate::subject::Subject;

/// Surfaces and their viewer.
pub struct Scene {
    pub pieces: Vec<Piece>,
    pub camera: Camera,
    /// The vertical field of view in degrees.
    pub field_of_view: f32,
}

/// One surface.
pub struct Piece {
    surface: Surface,
    placement: Placement,
    albedo: Albedo,
    /// The mirror, if the surface is one.
    mirror: Option<Mirror>,
    /// Whether its points are those of the mirror before it, which has more than one surface.
    is_joined: bool,
    points: Points,
    /// The standard deviation of the error angle of a point's normal, along each of two axes; degrees.
    noise: f64,
}

/// How many points a surface has.
#[derive(Clone, Copy)]
enum Points {
    /// The piece's share, by area, of `scene.points`.
    Shared,
    /// One for each square of this width in world units, in addition to those.
    Spaced(f64),
}

impl Piece {
    pub fn wall(surface: Surface, albedo: Albedo) -> Self {
        let placement = Placement::ORIGIN;
        Self { surface, placement, albedo, mirror: None, is_joined: false, points: Points::Shared, noise: 0.0 }
    }

    pub fn mirror(mirror: Mirror) -> Self {
        let (surface, placement) = mirror.surface();
        let albedo = Albedo::Even(mirror.color.map(f64::from));
        let mirror = Some(mirror);
        Self { surface, placement, albedo, mirror, is_joined: false, points: Points::Shared, noise: 0.0 }
    }

    /// The mirror, unless it is that of the piece before.
    pub fn into_mirror(self) -> Option<Mirror> {
        self.mirror.filter(|_| !self.is_joined)
    }

    /// With another surface than the mirror's shape has, in the mirror's own coordinates.
    pub fn shaped(self, surface: Surface) -> Self {
        Self { surface, ..self }
    }

    /// As a further surface of the mirror before.
    pub fn joined(self) -> Self {
        Self { is_joined: true, ..self }
    }

    pub fn spaced(self, spacing: f64) -> Self {
        Self { points: Points::Spaced(spacing), ..self }
    }

    pub fn noisy(self, noise: f64) -> Self {
        Self { noise, ..self }
    }

    fn area(&self) -> f64 {
        self.surface.area() * self.placement.scale * self.placement.scale
    }
}

impl Scene {
    /// Samples and uploads the scene; `settings.scene` gives the number of points and their seed.
    ///
    /// # Errors
    /// No memory on the GPU.
    pub fn subject(&self, gpu: &Arc<Gpu>, lights: Vec<SpotLight>, settings: &Settings) -> anyhow::Result<Subject> {
        let seed = u64::from(settings.scene.seed);
        let mut parts = vec![SampledPart { chunks: Vec::new(), mirror: None }];
        for (index, piece) in self.pieces.iter().enumerate() {
            let count = self.count(piece, settings.scene.points.into());
            let mut points = piece.surface.sample(count, seed.wrapping_add(index as u64));
            for (number, point) in points.iter_mut().enumerate() {
                *point = piece.placement.place(*point);
                point.normal = tilted(point.normal, piece.noise, hash(seed ^ hash(index as u64)) ^ number as u64);
            }
            let radius = splat_radius(piece.area(), count as u64);
            let albedo = |position| match piece.albedo {
                Albedo::Even(albedo) => albedo,
                Albedo::At(albedo) => albedo(position),
            };
            let part = match &piece.mirror {
                None => 0,
                Some(_) if piece.is_joined => parts.len() - 1,
                Some(mirror) => {
                    parts.push(SampledPart { chunks: Vec::new(), mirror: Some(mirror.clone()) });
                    parts.len() - 1
                }
            };
            append(&mut parts[part].chunks, points, radius, albedo);
        }
        Subject::sampled(gpu, parts, lights, self.camera, Some(self.exact()), settings)
    }

    #[cfg(test)]
    pub fn mirrors(&self) -> impl Iterator<Item = &Mirror> {
        self.pieces.iter().filter_map(|piece| piece.mirror.as_ref())
    }

    fn count(&self, piece: &Piece, shared: u64) -> usize {
        let sharing = self.pieces.iter().filter(|piece| matches!(piece.points, Points::Shared));
        let count = match piece.points {
            Points::Shared => piece.area() / sharing.map(Piece::area).sum::<f64>() * shared as f64,
            Points::Spaced(spacing) => piece.area() / (spacing * spacing),
        };
        count.round() as usize
    }

    /// The formulas behind the points; their normals have no noise.
    fn exact(&self) -> Exact {
        let object = |piece: &Piece| {
            let intensity = piece.mirror.as_ref().map_or(0.0, |mirror| f64::from(mirror.specular_intensity));
            Object::new(piece.surface.clone(), piece.placement, piece.albedo, intensity)
        };
        Exact::new(self.pieces.iter().map(object).collect())
    }
}

/// A unit vector turned by an angle of two normal deviates of `degrees` along two axes; the same for the same number.
fn tilted(normal: DVec3, degrees: f64, number: u64) -> DVec3 {
    if degrees == 0.0 {
        return normal;
    }
    // Uniform in 0 < u <= 1, then Box and Muller.
    let [one, other] = [0, 1].map(|half| (hash(hash(number).wrapping_add(half)) >> 11) as f64 + 1.0);
    let scale = (1_u64 << 53) as f64;
    let length = (-2.0 * (one / scale).ln()).sqrt() * degrees.to_radians();
    let (sin, cos) = (other / scale * std::f64::consts::TAU).sin_cos();
    let across = normal.any_orthonormal_vector();
    (normal + (across * cos + normal.cross(across) * sin) * length.tan()).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_are_off_by_the_noise_that_is_asked_for() {
        let count = 20_000;
        let squares: f64 =
            (0..count).map(|number| tilted(DVec3::Y, 2.0, number).angle_between(DVec3::Y).to_degrees().powi(2)).sum();
        // Two axes: the mean square is 2 sigma^2.
        let sigma = (squares / count as f64 / 2.0).sqrt();
        assert!((sigma - 2.0).abs() < 0.03, "{sigma}");
        assert_eq!(tilted(DVec3::Y, 0.0, 3), DVec3::Y);
        assert_eq!(tilted(DVec3::Y, 2.0, 3), tilted(DVec3::Y, 2.0, 3));
    }
}
