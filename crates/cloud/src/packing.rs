//! Compact forms of a normal (octahedral, 2 x 16 bits; Cigolle et al. 2014) and of a splat radius (16-bit logarithm),
//! the same on the CPU and in `shaders/shared/packing.wgsl`.

use glam::{Vec2, Vec3};

/// The packed normal of a point that has none.
pub const NO_NORMAL: u32 = 0x8000_8000;
/// The packed radius of a point whose spacing is not known yet.
pub const NO_RADIUS: u16 = 0;
/// The packed radius of a stray point, which is on no surface: the smallest one, so that it is a dot in pictures and no
/// ray meets it.
pub const STRAY_RADIUS: u16 = 1;

/// Packs a unit normal into two snorm16 octahedral coordinates (x in the low half). A zero vector or one that is not
/// finite gives `NO_NORMAL`. The worst error is about 0.003 degrees.
pub fn pack_normal(normal: Vec3) -> u32 {
    let sum = normal.x.abs() + normal.y.abs() + normal.z.abs();
    if !(sum > 0.0 && sum.is_finite()) {
        return NO_NORMAL;
    }
    let flat = Vec2::new(normal.x, normal.y) / sum;
    let folded = if normal.z >= 0.0 { flat } else { fold(flat) };
    let snorm = |v: f32| ((v.clamp(-1.0, 1.0) * 32767.0).round() as i16) as u16 as u32;
    snorm(folded.x) | (snorm(folded.y) << 16)
}

/// The unit normal, or `None` for `NO_NORMAL`.
pub fn unpack_normal(packed: u32) -> Option<Vec3> {
    if packed == NO_NORMAL {
        return None;
    }
    let snorm = |bits: u32| ((bits as u16 as i16) as f32 / 32767.0).max(-1.0);
    let folded = Vec2::new(snorm(packed & 0xffff), snorm(packed >> 16));
    let z = 1.0 - folded.x.abs() - folded.y.abs();
    let flat = if z >= 0.0 { folded } else { fold(folded) };
    Some(Vec3::new(flat.x, flat.y, z).normalize_or(Vec3::Z))
}

/// Reflects over the diagonals, which unfolds the lower half of the octahedron.
fn fold(p: Vec2) -> Vec2 {
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}

/// The number of steps per doubling of the radius: 0.034 % from one step to the next.
const RADIUS_STEPS: f32 = 2048.0;
/// The binary logarithm of the smallest radius, 2^-20; the largest is 2^12: from the bunny in metres to a survey in
/// feet.
const RADIUS_LOG_MIN: f32 = -20.0;

/// Packs a radius in world units as a 16-bit logarithm; clamped to 2^-20 ..= 2^12, but never `STRAY_RADIUS`, and
/// `NO_RADIUS` if not positive and finite.
pub fn pack_radius(radius: f32) -> u16 {
    if !(radius > 0.0 && radius.is_finite()) {
        return NO_RADIUS;
    }
    ((radius.log2() - RADIUS_LOG_MIN) * RADIUS_STEPS).round().clamp(2.0, 65535.0) as u16
}

/// The radius in world units, or `None` for `NO_RADIUS`.
pub fn unpack_radius(packed: u16) -> Option<f32> {
    (packed != NO_RADIUS).then(|| (f32::from(packed) / RADIUS_STEPS + RADIUS_LOG_MIN).exp2())
}

/// A packed radius times `size`. Strays stay strays, and unknown radii unknown.
pub fn resized_radius(packed: u16, size: f32) -> u16 {
    if packed == NO_RADIUS || packed == STRAY_RADIUS {
        return packed;
    }
    let steps = (size.log2() * RADIUS_STEPS).round() as i32;
    (i32::from(packed).saturating_add(steps)).clamp(2, 65535) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resized_radii_are_within_a_step_of_the_product() {
        for size in [0.05, 0.3, 1.0, 1.7, 20.0] {
            for radius in [1e-4, 0.013, 2.5, 90.0] {
                let packed = pack_radius(radius);
                let (back, wanted) = (unpack_radius(resized_radius(packed, size)).unwrap(), radius * size);
                assert!((back / wanted - 1.0).abs() < 4e-4, "{radius} times {size} is {back}");
                assert!(size != 1.0 || resized_radius(packed, size) == packed);
            }
            assert_eq!([NO_RADIUS, STRAY_RADIUS].map(|packed| resized_radius(packed, size)), [NO_RADIUS, STRAY_RADIUS]);
        }
        assert_eq!((resized_radius(3, 0.05), resized_radius(65_000, 20.0)), (2, 65_535));
    }

    #[test]
    fn normals_survive_packing_to_a_hundredth_of_a_degree() {
        for i in 0..10_000u32 {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / 10_000.0;
            let angle = i as f32 * 2.399_963;
            let ring = (1.0 - z * z).sqrt();
            let normal = Vec3::new(ring * angle.cos(), ring * angle.sin(), z);
            let back = unpack_normal(pack_normal(normal)).unwrap();
            // Computed from the sine: the cosine of so small an angle rounds to one.
            let angle = normal.cross(back).length().asin().to_degrees();
            assert!(angle < 0.01 && normal.dot(back) > 0.0, "{normal} became {back}");
        }
    }

    #[test]
    fn axes_survive_packing_exactly() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
            assert_eq!(unpack_normal(pack_normal(axis)), Some(axis));
        }
    }

    #[test]
    fn missing_normals_and_radii_stay_missing() {
        assert_eq!(unpack_normal(pack_normal(Vec3::ZERO)), None);
        assert_eq!(unpack_normal(pack_normal(Vec3::splat(f32::NAN))), None);
        assert_eq!(unpack_radius(pack_radius(0.0)), None);
        assert_eq!(unpack_radius(pack_radius(f32::NAN)), None);
        assert_eq!(unpack_radius(pack_radius(-1.0)), None);
        assert!(pack_radius(1e-9) > STRAY_RADIUS && unpack_radius(STRAY_RADIUS) < unpack_radius(pack_radius(1e-9)));
    }

    #[test]
    fn radii_survive_packing_to_a_thousandth() {
        for radius in [1e-5_f32, 0.001, 0.37, 1.0, 25.0, 4000.0] {
            let back = unpack_radius(pack_radius(radius)).unwrap();
            assert!((back / radius - 1.0).abs() < 1e-3, "{radius} became {back}");
        }
    }
}
