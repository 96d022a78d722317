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

/// The level direction along a surface, and that across it.
fn surface_axes(normal: Vec3, world_up: Vec3) -> [Vec3; 2] {
    let level = world_up.cross(normal);
    let axis = if normal.x.abs() > 0.9 { Vec3::Y } else { Vec3::X };
    let lies_level = level.length() < 3.0_f32.to_radians().sin();
    let along = if lies_level { axis - normal * axis.dot(normal) } else { level }.normalize();
    [along, normal.cross(along)]
}

/// The normal that Ashikhmin and Shirley's lobe draws, by its exponents along and across the surface's axes.
pub fn anisotropic_normal(normal: Vec3, axes: [Vec3; 2], numbers: Vec2, powers: Vec2) -> Vec3 {
    let (sin, cos) = (std::f32::consts::TAU * numbers.y).sin_cos();
    let side = (Vec2::new(cos, sin) * Vec2::new(powers.y + 1.0, powers.x + 1.0).powf(0.5)).normalize();
    let height = height(numbers.x, powers.dot(side * side));
    let sideways = axes[0] * side.x + axes[1] * side.y;
    (normal * (1.0 - height) + sideways * (height * (2.0 - height)).sqrt()).normalize()
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

/// A ray of another lobe: its normal and its weight, as `gloss_normals` draws it with `gloss.cache_power`.
#[derive(Clone, Copy)]
pub struct Other {
    pub power: f32,
    pub spread: f32,
    pub count: u32,
    pub seed: u32,
}

impl Other {
    pub fn drawn(
        self,
        lobe: Highlight,
        incoming: Vec3,
        normal: Vec3,
        [right, up, forward]: [Vec3; 3],
        index: u32,
        power: f32,
    ) -> (Vec3, f32) {
        let Self { power: narrow_power, spread, count, seed } = self;
        let reference = if lobe == Highlight::Blinn { -forward } else { forward };
        let wide_power = narrow_power / spread;
        let (from, side) = if index % 2 == 1 { (wide_power, 2) } else { (narrow_power, 1) };
        let numbers = numbers(index / 2, hash(seed.wrapping_add(side)));
        let drawn = lobe_normal(lobe, incoming, normal, [right, up, reference], numbers, from);
        let log_cosine = numbers.x.ln() / (from + 1.0);
        let share = count.div_ceil(2) as f32 / count as f32;
        let density = |other: f32| (other + 1.0) * ((other - power) * log_cosine).exp();
        let weight = (power + 1.0) / (share * density(narrow_power) + (1.0 - share) * density(wide_power));
        if reflect(incoming, drawn).dot(normal) > 0.0 { (drawn, weight) } else { (normal, 0.0) }
    }
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
    fn ashikhmin_and_shirleys_lobe_of_one_exponent_is_blinns_times_a_weight() {
        // The paper's specular term (2000, equation 4) with n_u = n_v = n and R_s = 1, whose Fresnel factor is 1:
        // (n + 1) / (8 pi) (n.h)^n / ((h.v) max(n.v, n.l)). The integral by a fine grid of directions, even by area.
        const RINGS: u32 = 400;
        const TURNS: u32 = 800;
        let light = |direction: Vec3| 2.0 + f64::from(direction.dot(Vec3::new(0.3, -0.5, 0.7)));
        for power in [10.0_f32, 100.0] {
            for (degrees, incoming, normal) in incidences() {
                let (view, (side, other)) = (-incoming, normal.any_orthonormal_pair());
                let from_view = f64::from(view.dot(normal));
                let (mut sum, mut reflected) = (0.0, 0.0);
                for ring in 0..RINGS {
                    let along = (ring as f32 + 0.5) / RINGS as f32;
                    let across = (1.0 - along * along).sqrt();
                    for turn in 0..TURNS {
                        let (sin, cos) = (std::f32::consts::TAU * (turn as f32 + 0.5) / TURNS as f32).sin_cos();
                        let toward = normal * along + (side * cos + other * sin) * across;
                        let half = (view + toward).normalize();
                        let n = f64::from(power);
                        let term = (n + 1.0) / (8.0 * std::f64::consts::PI) * f64::from(normal.dot(half)).powf(n)
                            / (f64::from(half.dot(view)) * from_view.max(f64::from(along)));
                        let share = term * f64::from(along) * std::f64::consts::TAU / f64::from(RINGS * TURNS);
                        (sum, reflected) = (sum + share * light(toward), reflected + share);
                    }
                }
                let weight = |drawn: Vec3| (f64::from(drawn.dot(normal)) / from_view).clamp(0.0, 1.0);
                let found = mean(Highlight::Blinn, incoming, normal, power, |drawn| weight(drawn) * light(drawn));
                let what = format!("power {power} at {degrees} degrees");
                assert!((found / sum - 1.0).abs() < 5e-3, "{what}: {found} instead of {sum}");
                // What the weight takes away is light that the lobe does not reflect at all.
                assert!(reflected < 1.0, "{what}: {reflected}");
                println!("{what}: {reflected:.3} is reflected");
            }
        }
    }

    #[test]
    fn normals_of_two_exponents_spread_as_their_density_says() {
        let normal = Vec3::new(0.5, -0.3, 0.4).normalize();
        let axes = surface_axes(normal, Vec3::Z);
        assert!(axes[0].z.abs() < 1e-6 && axes[0].dot(normal).abs() < 1e-6 && axes[1].z > 0.0, "{axes:?}");
        assert_eq!(surface_axes(Vec3::Z, Vec3::Z), [Vec3::X, Vec3::Y]);
        for powers in [[10.0_f32, 10.0], [10.0, 1000.0], [1000.0, 10.0], [100.0, 1.0]] {
            let (mut sums, mut expected) = ([0.0; 2], [0.0; 2]);
            for index in 0..COUNT {
                let half = anisotropic_normal(normal, axes, numbers(index, 5), Vec2::from(powers));
                sums = [0, 1].map(|axis| sums[axis] + f64::from(half.dot(axes[axis])).powi(2) / f64::from(COUNT));
            }
            // The density is sqrt((n_u + 1)(n_v + 1)) / (2 pi) (n.h)^e, e = n_u cos^2 + n_v sin^2; the mean of the squared
            // sine over the cosine is 2 / ((e + 1)(e + 3)).
            let [n_u, n_v] = powers.map(f64::from);
            let steps = 10_000;
            for step in 0..steps {
                let (sin, cos) = (std::f64::consts::TAU * (f64::from(step) + 0.5) / f64::from(steps)).sin_cos();
                let e = n_u * cos * cos + n_v * sin * sin;
                let part = ((n_u + 1.0) * (n_v + 1.0)).sqrt() * 2.0 / ((e + 1.0) * (e + 3.0)) / f64::from(steps);
                expected = [expected[0] + part * cos * cos, expected[1] + part * sin * sin];
            }
            for (sum, expected) in sums.into_iter().zip(expected) {
                assert!((sum / expected - 1.0).abs() < 0.01, "{powers:?}: {sum} of {expected}");
            }
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

    /// The mean of `value` over rays of another lobe, by their weights.
    fn weighed(
        other: Other,
        lobe: Highlight,
        [incoming, normal]: [Vec3; 2],
        power: f32,
        value: impl Fn(Vec3) -> f64,
    ) -> f64 {
        let (mut sum, mut weights) = (0.0, 0.0);
        for index in 0..other.count {
            let (drawn, weight) = other.drawn(lobe, incoming, normal, VIEW, index, power);
            sum += f64::from(weight) * value(reflect(incoming, drawn));
            weights += f64::from(weight);
        }
        sum / weights
    }

    #[test]
    fn rays_of_the_same_lobe_weigh_one_to_the_bit() {
        for lobe in [Highlight::Phong, Highlight::Blinn] {
            for power in [1.0, 30.0, 1000.0, 1e6] {
                for (degrees, incoming, normal) in incidences() {
                    for index in 0..63 {
                        let other = Other { power, spread: 1.0, count: 63, seed: 5 };
                        let (_, weight) = other.drawn(lobe, incoming, normal, VIEW, index, power);
                        // Only rays that lead below the surface count nothing.
                        let may_lead_below = power < 50.0 || degrees > 60.0;
                        assert!(weight == 1.0 || weight == 0.0 && may_lead_below, "{lobe:?} {power}: {weight}");
                    }
                }
            }
        }
    }

    #[test]
    fn means_by_weights_are_those_of_the_own_lobe() {
        // The mean of many caches of 64 rays each, against the same lobe's own rays; grazing views lose some below the
        // surface.
        const CACHES: u32 = 10_000;
        for lobe in [Highlight::Phong, Highlight::Blinn] {
            for (degrees, incoming, normal) in incidences().step_by(2) {
                let side = reflect(incoming, normal).any_orthonormal_vector();
                // A surrounding with an edge, and a bright middle.
                let light = |direction: Vec3| {
                    let middle = direction.dot(reflect(incoming, normal)).max(0.0).powi(800);
                    f64::from(middle) + if direction.dot(side) > 0.02 { 1.0 } else { 0.0 }
                };
                for power in [100.0, 300.0, 3000.0] {
                    let own = |index| {
                        let drawn = sampled_normal(lobe, incoming, normal, VIEW, power, [index, 3]);
                        light(reflect(incoming, drawn))
                    };
                    let expected = (0..COUNT).map(own).sum::<f64>() / f64::from(COUNT);
                    let (mut sum, mut squares) = (0.0, 0.0);
                    for cache in 0..CACHES {
                        let other = Other { power: 1000.0, spread: 10.0, count: 64, seed: hash(cache) };
                        let found = weighed(other, lobe, [incoming, normal], power, light);
                        (sum, squares) = (sum + found, squares + found * found);
                    }
                    let count = f64::from(CACHES);
                    let mean = sum / count;
                    let deviation = ((squares / count - mean * mean) / count).sqrt();
                    // Dividing by the sum of weights leaves a bias that falls as one over the rays.
                    let bound = 3.0 * deviation + 2e-3;
                    let what = format!("{lobe:?} at {degrees} degrees, power {power}");
                    assert!((mean - expected).abs() < bound, "{what}: {mean} instead of {expected}, {deviation}");
                }
            }
        }
    }

    #[test]
    fn the_share_of_rays_that_count_is_that_of_its_closed_form() {
        // One lobe without a horizon: E[w^2] = (n2+1)^2 / ((n1+1) (2 n2 - n1 + 1)).
        let (incoming, normal) = (Vec3::Z, -Vec3::Z);
        for (drawn, power) in [(1000.0_f32, 800.0_f32), (1000.0, 1000.0), (1000.0, 3000.0), (300.0, 500.0)] {
            let other = Other { power: drawn, spread: 1.0, count: 4096, seed: 9 };
            let weight = |index| f64::from(other.drawn(Highlight::Phong, incoming, normal, VIEW, index, power).1);
            let sum: f64 = (0..4096).map(weight).sum();
            let squares: f64 = (0..4096).map(|index| weight(index).powi(2)).sum();
            let (n1, n2) = (f64::from(drawn), f64::from(power));
            let expected = (n1 + 1.0) * (2.0 * n2 - n1 + 1.0) / (n2 + 1.0).powi(2);
            let found = sum * sum / (4096.0 * squares);
            assert!((found / expected - 1.0).abs() < 0.05, "{drawn} shown at {power}: {found} instead of {expected}");
        }
    }

    #[test]
    fn every_other_ray_from_a_wide_lobe_lets_a_cache_of_1000_show_powers_about_it() {
        // The power that is shown, by the mean height of directions, and the share of rays that count in effect.
        let (incoming, normal) = (Vec3::Z, -Vec3::Z);
        for (power, least_share) in [(30.0, 0.0), (100.0, 0.5), (300.0, 0.5), (1000.0, 0.5), (3000.0, 0.2)] {
            let shown = |spread: f32| {
                let (mut heights, mut share) = (0.0, 0.0);
                for seed in 0..400 {
                    let other = Other { power: 1000.0, spread, count: 8, seed: hash(seed) };
                    let height = |direction: Vec3| 1.0 - f64::from(direction.dot(Vec3::NEG_Z));
                    heights += weighed(other, Highlight::Phong, [incoming, normal], power, height) / 400.0;
                    let weight =
                        |index| f64::from(other.drawn(Highlight::Phong, incoming, normal, VIEW, index, power).1);
                    let sum: f64 = (0..8).map(weight).sum();
                    share += sum * sum / (8.0 * (0..8).map(|index| weight(index).powi(2)).sum::<f64>()) / 400.0;
                }
                // The mean height is 1 / (n + 2).
                (1.0 / heights - 2.0, share)
            };
            let ((one, _), (two, share)) = (shown(1.0), shown(10.0));
            println!("asked {power}, shown {one:.0} by one lobe, {two:.0} by two, share {share:.2}");
            let off = |shown: f64| (shown / f64::from(power)).ln().abs();
            assert!(share > least_share && off(two) < off(one).max(0.3), "{power}: {one} {two} {share}");
        }
    }
}
