//! Mirrors, and why they are taken to be mirrors.

use glam::DVec3;
use scene::{Mirror, Shape};

use crate::unfold::Reflector;

/// A mirror, and why it is taken to be one.
#[derive(Clone, Debug)]
pub struct Found {
    pub reflector: Reflector,
    /// In words, for people.
    pub reason: String,
}

impl Found {
    /// A mirror that a person named.
    pub fn given(mirror: Mirror) -> Self {
        let reason = if mirror.refraction.is_some() { "a pane that was given" } else { "a mirror that was given" };
        Self { reflector: Reflector::exact(mirror), reason: reason.to_owned() }
    }

    /// Whether another mirror is this one, as far as follows from the parts of both that a scanner saw.
    pub fn is_at(&self, other: &Self) -> bool {
        let [one, two] = [&self.reflector.mirror, &other.reflector.mirror];
        let (apart, size) = (two.position - one.position, one.size.max(two.size));
        let [axis, other_axis] = [one, two].map(|mirror| mirror.rotation * DVec3::Z);
        let is_aligned = axis.dot(other_axis).abs() > ALIGNED;
        one.shape.name() == two.shape.name()
            && match one.shape {
                Shape::Plane { .. } => apart.length() < size && is_aligned && axis.dot(apart).abs() < NEAR * size,
                // One may be known higher up than the other.
                Shape::Cylinder { .. } => is_aligned && apart.reject_from_normalized(axis).length() < size,
                _ => apart.length() < size,
            }
    }
}

/// The cosine between the normals of two planes that are one, or the axes of two columns, and how far they are apart at most, in their sizes.
const ALIGNED: f64 = 0.999;
const NEAR: f64 = 0.05;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mirror_that_is_known_is_not_another_one() {
        let found = |shape, x: f64, toward| {
            Found::given(Mirror {
                position: DVec3::new(x, 0.0, 0.0),
                ..Mirror::standing(shape, DVec3::ZERO, toward, DVec3::Z, 1.0)
            })
        };
        let plane = |x, toward| found(Shape::Plane { height: 0.5 }, x, toward);
        let one = plane(0.0, DVec3::X);
        assert!(one.is_at(&plane(0.01, DVec3::NEG_X)) && !one.is_at(&plane(0.2, DVec3::X)));
        assert!(!one.is_at(&plane(0.0, DVec3::Y)) && !one.is_at(&found(Shape::Sphere, 0.0, DVec3::X)));
        let ball = |x| found(Shape::Sphere, x, DVec3::Z);
        assert!(ball(0.0).is_at(&ball(0.1)) && !ball(0.0).is_at(&ball(1.5)));
        let column = |place| {
            let shape = Shape::Cylinder { height: 8.0 };
            let column = Mirror::standing(shape, place, DVec3::Z, DVec3::Y, 0.2);
            Found::given(Mirror { position: place, ..column })
        };
        let low = column(DVec3::ZERO);
        assert!(low.is_at(&column(DVec3::new(0.05, 0.0, 1.0))) && !low.is_at(&column(DVec3::new(0.5, 0.0, 0.0))));
    }
}
