//! The common part of this crate's trees. They are eight-wide, with boxes in 8 bits (Ylitie et al. 2017), from `obvhs`,
//! and only propose in f32 what a ray may hit; whether and where it hits is decided in f64.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::Ray;

/// Boxes grow by this share of the radius of the whole geometry, so that rounding in f32 (2^-24, a dozen operations)
/// never hides anything.
pub const BOX_MARGIN: f32 = 4e-6;

/// In the tree's boxes, a ray along an axis may deviate from it by this: far less than their margin.
const LEAST_SLOPE: f32 = 1e-12;

pub fn build(boxes: &[Aabb]) -> CwBvh {
    if boxes.is_empty() {
        return CwBvh::default();
    }
    build_cwbvh(boxes, BvhBuildParams::medium_build(), &mut std::time::Duration::default())
}

/// The displacement of a box, -1 to 1 along each axis, in units of its margin. Without it, things in the same place
/// would make a tree as deep as their number.
pub fn apart(number: u32) -> Vec3A {
    let bits = number.wrapping_mul(0x9e37_79b1);
    let shift = Vec3::new((bits >> 22) as f32, (bits >> 12 & 0x3ff) as f32, (bits >> 2 & 0x3ff) as f32);
    Vec3A::from(shift) / 511.5 - 1.0
}

/// A ray in the tree's form, up to a distance; none if it cannot be traced. `origin` is near the middle of all boxes.
pub fn ray(origin: DVec3, direction: DVec3, most: f64) -> Option<Ray> {
    let direction = direction.as_vec3a();
    if !(origin.is_finite() && direction.is_finite()) {
        return None;
    }
    // The tree needs finite slopes whose sign is the one by which the direction compares, unlike that of -0.
    let direction = direction.map(|along| if along.abs() < LEAST_SLOPE { LEAST_SLOPE } else { along });
    Some(Ray {
        origin: Vec3A::from(origin.as_vec3()),
        direction,
        inv_direction: direction.recip(),
        tmin: 0.0,
        tmax: round_up(most),
    })
}

/// The next f32 that is not below, with room for the direction's rounding in the tree's boxes.
pub fn round_up(distance: f64) -> f32 {
    distance as f32 * (1.0 + 4.0 * f32::EPSILON)
}
