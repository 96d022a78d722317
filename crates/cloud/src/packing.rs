//! Compact forms of a normal (octahedral, 2 x 16 bits; Cigolle et al. 2014) and of a splat's size and shape (11 bits of
//! the logarithm of its radius, 5 bits of its shape), the same on the CPU and in `shaders/shared/packing.wgsl`.
//!
//! A splat is a disc, or an ellipse in the plane of the disc whose long half axis is the radius. Whatever looks at radii
//! alone sees a disc that contains the ellipse.

use glam::{Vec2, Vec3};

/// The packed normal of a point that has none.
pub const NO_NORMAL: u32 = 0x8000_8000;
/// The packed radius of a point whose spacing is not known yet.
pub const NO_RADIUS: u16 = 0;
/// The packed radius of a stray point, which is on no surface: the smallest one, so that it is a dot in pictures and no
/// ray meets it.
pub const STRAY_RADIUS: u16 = 1;
/// The packed radius of a mixed pixel, between two surfaces: as small as that of a stray point.
pub const MIXED_RADIUS: u16 = 2;

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

/// The number of packed steps per doubling of a radius of 2^-19 and more.
pub const RADIUS_STEPS: u16 = 2048;
/// The lowest bits of a packed radius are the shape, so that radii come in these steps: 1.1 % from one to the next
/// from 2^-19 on.
pub const RADIUS_SHAPES: u16 = 32;
/// The steps per doubling without those of the shape.
const FINE_STEPS: f32 = (RADIUS_STEPS / RADIUS_SHAPES) as f32;
/// The binary logarithm of the radius of step 0, if all steps were fine. The largest radius is 2^12: from the bunny in
/// metres to a survey in feet.
const RADIUS_LOG_MIN: f32 = -20.0;
/// Below this step, whose radius is 2^-19, steps are coarse, so that they reach down to 2^-35: a sample under a microscope
/// in metres has discs, too, up to 9 % larger or smaller than they should be.
const FIRST_FINE: u16 = RADIUS_STEPS / RADIUS_SHAPES;
/// The number of coarse steps per doubling.
const COARSE_STEPS: f32 = 4.0;

/// The step of a radius by its binary logarithm.
fn step_of(log: f32) -> u16 {
    let first = f32::from(FIRST_FINE);
    let step = (log - RADIUS_LOG_MIN) * FINE_STEPS;
    let coarse = || (log - RADIUS_LOG_MIN - 1.0) * COARSE_STEPS + first;
    if step < first { coarse().round().clamp(1.0, first) as u16 } else { step.round().min(2047.0) as u16 }
}

/// The binary logarithm of the radius of a step.
fn log_of(step: u16) -> f32 {
    if step < FIRST_FINE {
        return (f32::from(step) - f32::from(FIRST_FINE)) / COARSE_STEPS + RADIUS_LOG_MIN + 1.0;
    }
    f32::from(step) / FINE_STEPS + RADIUS_LOG_MIN
}

/// Packs the radius of a disc in world units; clamped to 2^-35 ..= 2^12, but never that of a stray, and `NO_RADIUS` if
/// not positive and finite.
pub fn pack_radius(radius: f32) -> u16 {
    if !(radius > 0.0 && radius.is_finite()) {
        return NO_RADIUS;
    }
    step_of(radius.log2()) * RADIUS_SHAPES
}

/// The radius in world units, or the long half axis of an ellipse; `None` for `NO_RADIUS`.
pub fn unpack_radius(packed: u16) -> Option<f32> {
    (packed != NO_RADIUS).then(|| log_of(packed / RADIUS_SHAPES).exp2())
}

/// What keeps a point with this packed radius from being on a surface: 1 of a lone stray, 2 of a mixed pixel, and 0 of all
/// other points.
pub fn stray_kind(packed: u16) -> u8 {
    if packed <= MIXED_RADIUS { packed as u8 } else { 0 }
}

/// A packed radius times `size`, with its shape. Strays stay strays, and unknown radii unknown.
pub fn resized_radius(packed: u16, size: f32) -> u16 {
    if packed < RADIUS_SHAPES {
        return packed;
    }
    grown_radius(packed, (size.log2() * FINE_STEPS).round() as i32)
}

/// A packed radius after so many steps, of which `RADIUS_STEPS / RADIUS_SHAPES` double it, with its shape. It must be one of a
/// disc or an ellipse.
pub fn grown_radius(packed: u16, steps: i32) -> u16 {
    let step = packed / RADIUS_SHAPES;
    let grown = i32::from(step).saturating_add(steps).min(2047);
    let is_fine = step.min(grown.max(0) as u16) >= FIRST_FINE;
    let grown = if is_fine { grown as u16 } else { step_of(log_of(step) + steps as f32 / FINE_STEPS) };
    grown * RADIUS_SHAPES + packed % RADIUS_SHAPES
}

/// How much longer an ellipse is than wide, and in which direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// The unit direction of the long axis, in the plane of the splat; its sign is arbitrary.
    pub axis: Vec3,
    /// The long axis over the short one.
    pub ratio: f32,
}

/// The ratios that are packed, and the number of directions of each, evenly over half a turn: the end of an ellipse is
/// at most 0.55 short half axes beside where it belongs.
const RATIOS: [(f32, u16); 2] = [(3.0, 10), (7.0, 21)];

/// Packs the half axes of an ellipse in the plane of `normal`, the long one in world units; a disc where the ratio is
/// much below the least that is packed (3). The ratio becomes a packed one no larger than a tenth above it, so that
/// ellipses become wider rather than narrower.
pub fn pack_ellipse(long: f32, stretch: Stretch, normal: Vec3) -> u16 {
    let disc = pack_radius(long);
    let packed = RATIOS.iter().rposition(|(ratio, _)| *ratio <= 1.1 * stretch.ratio);
    let Some(row) = packed.filter(|_| disc != NO_RADIUS) else { return disc };
    let first: u16 = 1 + RATIOS[..row].iter().map(|(_, directions)| directions).sum::<u16>();
    let [across, along] = plane_axes(normal);
    let turn = stretch.axis.dot(along).atan2(stretch.axis.dot(across)) / std::f32::consts::PI;
    let directions = RATIOS[row].1;
    disc + first + ((turn.rem_euclid(1.0) * f32::from(directions)).round() as u16) % directions
}

/// The shape of a splat with a unit normal; `None` for a disc.
pub fn unpack_stretch(packed: u16, normal: Vec3) -> Option<Stretch> {
    let (ratio, turn) = ratio_and_turn(packed)?;
    let [across, along] = plane_axes(normal);
    let (sine, cosine) = (std::f32::consts::PI * turn).sin_cos();
    Some(Stretch { axis: cosine * across + sine * along, ratio })
}

/// The long axis of a splat over the short one; 1 for a disc.
pub fn stretch_ratio(packed: u16) -> f32 {
    ratio_and_turn(packed).map_or(1.0, |(ratio, _)| ratio)
}

/// The ratio of an ellipse, and its direction as a share of half a turn.
fn ratio_and_turn(packed: u16) -> Option<(f32, f32)> {
    if packed < RADIUS_SHAPES {
        return None;
    }
    let mut direction = (packed % RADIUS_SHAPES).checked_sub(1)?;
    for (ratio, directions) in RATIOS {
        if direction < directions {
            return Some((ratio, f32::from(direction) / f32::from(directions)));
        }
        direction -= directions;
    }
    None
}

/// Two unit vectors that span the plane of a unit normal with it, for both of its signs the same (after Duff et al.
/// 2017).
fn plane_axes(normal: Vec3) -> [Vec3; 2] {
    let components = [normal.z, normal.y, normal.x];
    let first = components.into_iter().find(|component| *component != 0.0).unwrap_or(1.0);
    let Vec3 { x, y, z } = if first < 0.0 { -normal } else { normal };
    let a = -1.0 / (1.0 + z);
    [Vec3::new(1.0 + x * x * a, x * y * a, -x), Vec3::new(x * y * a, 1.0 + y * y * a, -y)]
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
                assert!((back / wanted - 1.0).abs() < 0.011, "{radius} times {size} is {back}");
                assert!(size != 1.0 || resized_radius(packed, size) == packed);
                assert_eq!(resized_radius(packed + 7, size), resized_radius(packed, size) + 7, "its shape stays");
            }
            let marks = [NO_RADIUS, STRAY_RADIUS, MIXED_RADIUS];
            assert_eq!(marks.map(|packed| resized_radius(packed, size)), marks);
        }
        assert_eq!((resized_radius(70, 0.05), resized_radius(65_001, 20.0)), (32 + 6, 65_504 + 9));
    }

    #[test]
    fn radii_of_microscopy_survive_packing_to_a_tenth_and_grow_as_all_others() {
        for radius in [1e-10_f32, 2.5e-8, 4e-7, 1.8e-6] {
            let packed = pack_radius(radius);
            assert!((unpack_radius(packed).unwrap() / radius - 1.0).abs() < 0.1, "{radius}");
            for size in [1.0, 3.0, 400.0, 1e6] {
                let back = unpack_radius(resized_radius(packed + 5, size)).unwrap();
                assert!((back / (radius * size) - 1.0).abs() < 0.2, "{radius} times {size} is {back}");
                assert_eq!(resized_radius(packed + 5, size) % RADIUS_SHAPES, 5);
            }
        }
        let all: Vec<f32> = (0..=2047).map(log_of).collect();
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]), "steps are in order");
        assert!((1..=2047).all(|step| step_of(log_of(step)) == step), "and each is one of its own");
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
    fn radii_survive_packing_to_six_thousandths() {
        for radius in [1e-5_f32, 0.001, 0.37, 1.0, 25.0, 4000.0] {
            let back = unpack_radius(pack_radius(radius)).unwrap();
            assert!((back / radius - 1.0).abs() < 6e-3, "{radius} became {back}");
            assert_eq!(unpack_stretch(pack_radius(radius), Vec3::X), None);
        }
        let marks = [NO_RADIUS, STRAY_RADIUS, MIXED_RADIUS];
        assert_eq!(marks.map(|packed| unpack_stretch(packed, Vec3::X)), [None; 3]);
        assert_eq!(marks.map(stray_kind), [0, 1, 2]);
        assert_eq!([pack_radius(1e-9), pack_radius(2.0) + 2].map(stray_kind), [0, 0]);
    }

    #[test]
    fn ellipses_survive_packing_for_both_signs_of_their_normal() {
        for i in 0..5000u32 {
            let z = if i % 10 == 0 { 0.0 } else { 1.0 - 2.0 * (i as f32 + 0.5) / 5000.0 };
            let angle = i as f32 * 2.399_963;
            let ring = (1.0 - z * z).sqrt();
            let normal = Vec3::new(ring * angle.cos(), ring * angle.sin(), z);
            let axis = normal.cross(Vec3::new(0.3, -0.8, 0.1 * i as f32)).normalize();
            for (ratio, expected) in
                [(2.5, None), (2.8, Some(3.0)), (6.0, Some(3.0)), (6.4, Some(7.0)), (40.0, Some(7.0))]
            {
                let packed = pack_ellipse(0.3, Stretch { axis, ratio }, normal);
                assert!((unpack_radius(packed).unwrap() / 0.3 - 1.0).abs() < 6e-3);
                let stretch = unpack_stretch(packed, normal);
                assert_eq!(stretch.map(|stretch| stretch.ratio), expected);
                let Some(stretch) = stretch else { continue };
                let beside = stretch.ratio * (axis - axis.dot(stretch.axis) * stretch.axis).length();
                assert!(beside < 0.55, "{normal}: {axis} became {}", stretch.axis);
                assert!(stretch.axis.dot(normal).abs() < 1e-5 && (stretch.axis.length() - 1.0).abs() < 1e-5);
                let flipped = unpack_stretch(packed, -normal).unwrap();
                assert!((flipped.axis - stretch.axis).length() < 1e-6);
            }
        }
        let stretch = Stretch { axis: Vec3::X, ratio: 9.0 };
        assert_eq!(pack_ellipse(f32::NAN, stretch, Vec3::Z), NO_RADIUS);
    }
}
