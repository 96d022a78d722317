//! The CPU twin of shaders/shared/lobe.wgsl and of the drawing in shaders/gloss_normals.wgsl.

use glam::{Vec2, Vec3};
use scene::Highlight;

pub fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

fn scrambled(bits: u32, seed: u32) -> u32 {
    let mut x = bits.reverse_bits().wrapping_add(seed);
    for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6_u32] {
        x ^= x.wrapping_mul(factor);
    }
    x.reverse_bits()
}

/// Point `index` of the scrambled sequence, inside of the unit square.
pub fn numbers(index: u32, seed: u32) -> Vec2 {
    let shuffled = scrambled(index, hash(seed));
    let (mut second, mut column, mut rest) = (0, 0x8000_0000_u32, shuffled);
    while rest != 0 {
        if rest & 1 == 1 {
            second ^= column;
        }
        column ^= column >> 1;
        rest >>= 1;
    }
    let bits =
        [scrambled(shuffled.reverse_bits(), hash(seed ^ 0x9e37_79b9)), scrambled(second, hash(seed ^ 0x3c6e_f372))];
    Vec2::from(bits.map(|bits| ((bits >> 8) as f32 + 0.5) / 16_777_216.0))
}

/// One minus the cosine of the angle from the lobe's middle.
fn height(u: f32, power: f32) -> f32 {
    let x = -u.ln() / (power + 1.0);
    if x < 0.01 { x * (1.0 - x * (0.5 - x / 6.0)) } else { 1.0 - (-x).exp() }
}

/// The axes across `axis`: those across `reference`, turned with it.
fn axes_across(axis: Vec3, [right, up, reference]: [Vec3; 3]) -> [Vec3; 2] {
    let sum = reference + axis;
    let scale = 1.0 / (1.0 + reference.dot(axis)).max(1e-6);
    [right, up].map(|side| side - sum * (axis.dot(side) * scale))
}

fn direction(axis: Vec3, across: [Vec3; 2], numbers: Vec2, power: f32) -> Vec3 {
    let height = height(numbers.x, power);
    let (sin, cos) = (std::f32::consts::TAU * numbers.y).sin_cos();
    let sideways = across[0] * cos + across[1] * sin;
    (axis * (1.0 - height) + sideways * (height * (2.0 - height)).sqrt()).normalize()
}

fn reflect(incoming: Vec3, normal: Vec3) -> Vec3 {
    incoming - 2.0 * normal.dot(incoming) * normal
}

/// The normal that mirrors `incoming` into a direction of the lobe about the mirror of this normal.
pub fn lobe_normal(lobe: Highlight, incoming: Vec3, normal: Vec3, view: [Vec3; 3], numbers: Vec2, power: f32) -> Vec3 {
    match lobe {
        Highlight::Blinn => direction(normal, axes_across(normal, view), numbers, power),
        Highlight::Phong => {
            let drawn = direction(incoming, axes_across(incoming, view), numbers, power);
            (reflect(drawn, normal) - incoming).normalize()
        }
    }
}

/// The normal of a sample, as `gloss_normals` draws it for the first bounce; the axes are the camera's.
pub fn sampled_normal(
    lobe: Highlight,
    incoming: Vec3,
    normal: Vec3,
    [right, up, forward]: [Vec3; 3],
    power: f32,
    [sample, seed]: [u32; 2],
) -> Vec3 {
    let reference = if lobe == Highlight::Blinn { -forward } else { forward };
    let tries = (0..16).map(|tried| {
        let seed = hash(seed.wrapping_add(hash(hash(tried))));
        lobe_normal(lobe, incoming, normal, [right, up, reference], numbers(sample, seed), power)
    });
    tries.into_iter().find(|drawn| reflect(incoming, *drawn).dot(normal) > 0.0).unwrap_or(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIEW: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];
    const COUNT: u32 = 1 << 16;

    /// Incoming and normal: 0 to 85 degrees between the ray and the normal.
    fn incidences() -> impl Iterator<Item = (f32, Vec3, Vec3)> {
        [0.0_f32, 20.0, 45.0, 70.0, 85.0].into_iter().map(|degrees| {
            let incoming = Vec3::new(0.2, -0.1, 1.0).normalize();
            let across = incoming.any_orthonormal_vector();
            let (sin, cos) = degrees.to_radians().sin_cos();
            (degrees, incoming, across * sin - incoming * cos)
        })
    }

    /// The mean of `value` over many directions of a lobe without a horizon.
    fn mean(lobe: Highlight, incoming: Vec3, normal: Vec3, power: f32, value: impl Fn(Vec3) -> f64) -> f64 {
        let view = [Vec3::X, Vec3::Y, if lobe == Highlight::Blinn { -Vec3::Z } else { Vec3::Z }];
        let each = (0..COUNT).map(|index| {
            let drawn = lobe_normal(lobe, incoming, normal, view, numbers(index, 7), power);
            value(reflect(incoming, drawn))
        });
        each.sum::<f64>() / f64::from(COUNT)
    }

    #[test]
    fn points_of_the_sequence_are_spread_evenly() {
        // Each of the boxes of equal area that are 2^-a wide and 2^(a-8) high has one of the first 256 points.
        for seed in [1, 2, 0xdead_beef] {
            let points: Vec<Vec2> = (0..256).map(|index| numbers(index, seed)).collect();
            for columns in (0..=8).map(|power| 1_u32 << power) {
                let mut taken = [false; 256];
                for point in &points {
                    let rows = 256 / columns;
                    let place = (point.x * columns as f32) as u32 + columns * (point.y * rows as f32) as u32;
                    assert!(!std::mem::replace(&mut taken[place as usize], true), "seed {seed}, {columns} columns");
                }
            }
        }
    }

    #[test]
    fn moments_of_the_lobes_are_those_of_their_closed_forms() {
        for power in [1.0_f32, 10.0, 50.0, 300.0, 3000.0] {
            let n = f64::from(power);
            for (degrees, incoming, normal) in incidences() {
                let what = format!("power {power} at {degrees} degrees");
                let perfect = reflect(incoming, normal);
                let cosine = |direction: Vec3| f64::from(direction.dot(perfect));
                let first = mean(Highlight::Phong, incoming, normal, power, cosine);
                assert!((first - (n + 1.0) / (n + 2.0)).abs() < 2e-4, "{what}: {first}");
                let second = mean(Highlight::Phong, incoming, normal, power, |drawn| cosine(drawn).powi(2));
                assert!((second - (n + 1.0) / (n + 3.0)).abs() < 2e-4, "{what}: {second}");
                // A surrounding that brightens evenly along a direction, and one that is bright on one side.
                let along = Vec3::new(0.3, -0.5, 0.7);
                let light = mean(Highlight::Phong, incoming, normal, power, |drawn| f64::from(along.dot(drawn)) + 2.0);
                let expected = 2.0 + (n + 1.0) / (n + 2.0) * f64::from(along.dot(perfect));
                assert!((light - expected).abs() < 2e-4, "{what}: {light} instead of {expected}");
                let side = perfect.any_orthonormal_vector();
                let half = mean(Highlight::Phong, incoming, normal, power, |drawn| f64::from(drawn.dot(side) > 0.0));
                assert!((half - 0.5).abs() < 2e-3, "{what}: {half}");
            }
            // Blinn along the normal: d.N = 2 (h.N)^2 - 1.
            let (_, incoming, normal) = incidences().next().unwrap();
            let found = mean(Highlight::Blinn, incoming, normal, power, |drawn| f64::from(drawn.dot(normal)));
            let expected = (n - 1.0) / (n + 3.0);
            assert!((found - expected).abs() < 2e-4, "power {power}: {found} instead of {expected}");
        }
    }

    #[test]
    fn at_a_grazing_view_directions_follow_the_lobe_above_the_surface() {
        let (degrees, incoming, normal) = incidences().last().unwrap();
        assert!(degrees > 80.0);
        let perfect = reflect(incoming, normal);
        for power in [5.0_f32, 50.0] {
            // The mean height of directions over the part of the lobe that is above the surface, by a fine grid.
            let across = perfect.any_orthonormal_pair();
            let (mut sum, mut weights) = (0.0, 0.0);
            for ring in 0..2000 {
                let u = (f64::from(ring) + 0.5) / 2000.0;
                for turn in 0..500 {
                    let at = Vec2::new(u as f32, (turn as f32 + 0.5) / 500.0);
                    let drawn = direction(perfect, [across.0, across.1], at, power);
                    let above = f64::from(drawn.dot(normal));
                    if above > 0.0 {
                        (sum, weights) = (sum + above, weights + 1.0);
                    }
                }
            }
            let expected = sum / weights;
            let drawn = |index| {
                let drawn = sampled_normal(Highlight::Phong, incoming, normal, VIEW, power, [index, 3]);
                f64::from(reflect(incoming, drawn).dot(normal))
            };
            let found = (0..COUNT).map(drawn).sum::<f64>() / f64::from(COUNT);
            assert!((found / expected - 1.0).abs() < 5e-3, "power {power}: {found} instead of {expected}");
        }
    }

    #[test]
    fn every_sample_leaves_the_surface_and_mirrors_the_ray_into_its_direction() {
        for lobe in [Highlight::Phong, Highlight::Blinn] {
            for power in [1.0_f32, 30.0, 1000.0, 1e6] {
                for (degrees, incoming, normal) in incidences() {
                    for sample in 0..500 {
                        let drawn = sampled_normal(lobe, incoming, normal, VIEW, power, [sample, 1]);
                        let direction = reflect(incoming, drawn);
                        let what = format!("{lobe:?}, power {power} at {degrees} degrees: {drawn}");
                        assert!((drawn.length() - 1.0).abs() < 1e-5 && direction.dot(normal) > 0.0, "{what}");
                        // With a very high power the mirror is perfect: a thousandth of a turn.
                        let off = direction.distance(reflect(incoming, normal));
                        assert!(power < 1e6 || off < 2.0 * 0.006, "{what}: {off}");
                    }
                }
            }
        }
    }
}
