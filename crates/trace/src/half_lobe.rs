//! The lobe of Ashikhmin and Shirley (*An Anisotropic Phong BRDF Model*, 2000): normals halfway between two directions
//! spread with two exponents, along and across the level direction of a surface.
//!
//! The definition, which is the renderer's. With the unit normal n, the direction v to the eye, l to the light and h
//! halfway, and e = n_u cos^2 + n_v sin^2 of the angle of h about n from the level direction u, light is reflected by
//! sqrt((n_u + 1)(n_v + 1)) / (8 pi) (n.h)^e F / ((h.v) max(n.v, n.l)). F is the share that a mirror reflects whose normal
//! is h. Directions drawn by the density of h count by F min(1, n.l / n.v), so that no ray counts for more than F; those
//! below the surface count 0. n_u is the mirror's specular power. u is the product of the scene's up axis with n; where
//! that is shorter than the sine of three degrees it is the part of the world's x axis along the surface, or of the y
//! axis where n lies within 26 degrees of the x axis.

use std::f64::consts::TAU;

use glam::DVec3;
use scene::{Highlight, MirrorSettings};

use crate::share::mirror_share;
use crate::{Hit, mirrored};

/// The lobe of the light that glossy mirrors reflect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lobe {
    /// About the reflected ray, or of normals about the mirror's own.
    Even(Highlight),
    /// Of normals, more along a mirror than across it.
    Half(HalfLobe),
}

/// Ashikhmin and Shirley's lobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfLobe {
    /// The exponent n_v over n_u.
    pub across: f64,
    /// The scene's up axis, a unit vector.
    pub up: DVec3,
}

impl HalfLobe {
    /// The level direction along a surface, and that across it.
    fn axes(&self, normal: DVec3) -> [DVec3; 2] {
        let level = self.up.cross(normal);
        let along = if level.length() < 3.0_f64.to_radians().sin() {
            let axis = if normal.x.abs() > 0.9 { DVec3::Y } else { DVec3::X };
            axis - normal * axis.dot(normal)
        } else {
            level
        };
        let along = along.normalize_or_zero();
        [along, normal.cross(along)]
    }

    /// The direction that two numbers in [0, 1) draw for a ray that arrives in `incoming` at a mirror, and how much of the
    /// light from there it reflects, over the share that it reflects by its own normal.
    pub(crate) fn drawn(
        &self,
        hit: &Hit,
        incoming: DVec3,
        settings: &MirrorSettings,
        numbers: [f64; 2],
    ) -> (DVec3, f64) {
        let half = self.half(hit.normal, hit.specular_power, numbers);
        let direction = mirrored(incoming, half).normalize_or_zero();
        let from_view = incoming.dot(hit.normal).abs();
        let share = |normal: DVec3| mirror_share(hit.specular_intensity, incoming.dot(normal).abs(), settings).0;
        let height = (direction.dot(hit.normal) / from_view.max(1e-6)).clamp(0.0, 1.0);
        (direction, share(half) / share(hit.normal).max(1e-6) * height)
    }

    /// The drawn normal.
    fn half(&self, normal: DVec3, power: f64, [u, v]: [f64; 2]) -> DVec3 {
        let ([along, across], [n_u, n_v]) = (self.axes(normal), [power, power * self.across]);
        // The tangent of the angle about the normal is that of an even one times the root of (n_u + 1) / (n_v + 1).
        let (sin, cos) = (v * TAU).sin_cos();
        let (x, y) = (cos * (n_v + 1.0).sqrt(), sin * (n_u + 1.0).sqrt());
        let side = (along * x + across * y) / x.hypot(y);
        let exponent = (n_u * x * x + n_v * y * y) / (x * x + y * y);
        let cosine = (1.0 - u).powf(1.0 / (exponent + 1.0));
        normal * cosine + side * (1.0 - cosine * cosine).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indirect::Random;

    const EXPONENTS: [f64; 4] = [1.0, 10.0, 100.0, 1000.0];
    const UP: DVec3 = DVec3::Z;

    fn lobe([n_u, n_v]: [f64; 2]) -> HalfLobe {
        HalfLobe { across: n_v / n_u, up: UP }
    }

    fn mirror(normal: DVec3, specular_power: f64, specular_intensity: f64) -> Hit {
        Hit {
            distance: 1.0,
            position: DVec3::ZERO,
            normal,
            albedo: DVec3::ONE,
            specular_intensity,
            specular_power,
            medium: None,
            surface: 0,
            point: 0,
        }
    }

    /// All pairs of exponents.
    fn pairs() -> impl Iterator<Item = [f64; 2]> {
        EXPONENTS.into_iter().flat_map(|n_u| EXPONENTS.map(|n_v| [n_u, n_v]))
    }

    /// A normal that is not level, and views at angles to it, from the side that `turn` says.
    fn views(turn: f64) -> impl Iterator<Item = (f64, DVec3, DVec3)> {
        let normal = DVec3::new(0.6, -0.3, 0.5).normalize();
        let (side, other) = normal.any_orthonormal_pair();
        [0.0_f64, 20.0, 45.0, 70.0, 85.0].into_iter().map(move |degrees| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            (degrees, normal, normal * cos + (side * turn.cos() + other * turn.sin()) * sin)
        })
    }

    /// The density of the drawn halfway normals, per steradian, by its closed form.
    fn density_of_half([n_u, n_v]: [f64; 2], normal: DVec3, half: DVec3) -> f64 {
        let along = UP.cross(normal).normalize();
        let across = normal.cross(along);
        let (x, y, cosine) = (half.dot(along), half.dot(across), half.dot(normal));
        let exponent = (n_u * x * x + n_v * y * y) / (x * x + y * y).max(1e-300);
        ((n_u + 1.0) * (n_v + 1.0)).sqrt() / TAU * cosine.max(0.0).powf(exponent)
    }

    /// The published reflectance with the share F.
    fn reflectance(powers: [f64; 2], normal: DVec3, [view, light]: [DVec3; 2], share: impl Fn(f64) -> f64) -> f64 {
        let half = (view + light).normalize();
        let cosine = half.dot(view);
        let least = view.dot(normal).max(light.dot(normal));
        density_of_half(powers, normal, half) / 4.0 * share(cosine) / (cosine * least)
    }

    fn settings(fresnel: f32) -> MirrorSettings {
        MirrorSettings { fresnel, ..MirrorSettings::default() }
    }

    #[test]
    fn draws_count_by_the_published_reflectance_over_their_density() {
        let mut numbers = Random::new([1, 2, 3]);
        let mut below = 0;
        for powers in pairs() {
            for (fresnel, intensity) in [(0.0, 1.0), (1.0, 0.3)] {
                for (degrees, normal, view) in views(1.0) {
                    let hit = mirror(normal, powers[0], intensity);
                    let own = intensity + (1.0 - intensity) * f64::from(fresnel) * (1.0 - view.dot(normal)).powi(5);
                    for _ in 0..500 {
                        let pair = [numbers.next(), numbers.next()];
                        let (light, weight) = lobe(powers).drawn(&hit, -view, &settings(fresnel), pair);
                        let what = format!("{powers:?} at {degrees} degrees: {weight}");
                        assert!((0.0..=1.0 / own + 1e-9).contains(&weight), "{what}");
                        let height = light.dot(normal);
                        below += u32::from(height <= 0.0);
                        if height <= 1e-6 {
                            assert!(weight < 1e-4, "{what}");
                            continue;
                        }
                        let half = (view + light).normalize();
                        let share =
                            |cosine: f64| intensity + (1.0 - intensity) * f64::from(fresnel) * (1.0 - cosine).powi(5);
                        let density = density_of_half(powers, normal, half) / (4.0 * half.dot(view));
                        let value = reflectance(powers, normal, [view, light], share);
                        let expected = value * height / density / own;
                        assert!((weight - expected).abs() < 1e-6 * (1.0 + expected), "{what} instead of {expected}");
                        // Light goes the same way back.
                        let back = reflectance(powers, normal, [light, view], share);
                        assert!((value - back).abs() <= 1e-12 * value.abs(), "{value} {back}");
                    }
                }
            }
        }
        assert!(below > 1000, "{below}");
    }

    #[test]
    fn no_more_light_is_reflected_than_arrives_and_much_of_it_along_the_normal() {
        let count = 128;
        for powers in pairs() {
            for (fresnel, intensity) in [(0.0, 1.0), (0.0, 0.4), (1.0, 0.4)] {
                for (degrees, normal, view) in views(0.3) {
                    let hit = mirror(normal, powers[0], intensity);
                    let cells = (0..count * count)
                        .map(|cell| [cell % count, cell / count].map(|n| (f64::from(n) + 0.5) / f64::from(count)));
                    let drawn = cells.map(|pair| lobe(powers).drawn(&hit, -view, &settings(fresnel), pair).1);
                    let own = mirror_share(intensity, view.dot(normal), &settings(fresnel)).0;
                    let reflected = own * drawn.sum::<f64>() / f64::from(count * count);
                    let what = format!("{powers:?} of {intensity} at {degrees} degrees: {reflected}");
                    assert!(reflected <= 1.0 && reflected > 0.2 * intensity, "{what}");
                    // A very high power along the normal is a perfect mirror.
                    let is_sharp = powers.iter().all(|power| *power >= 1000.0) && degrees == 0.0;
                    assert!(!is_sharp || (reflected / intensity - 1.0).abs() < 0.01, "{what}");
                }
            }
        }
    }

    #[test]
    fn directions_are_as_dense_as_the_closed_form_says() {
        const RINGS: usize = 8;
        const TURNS: usize = 16;
        const COUNT: u32 = 100_000;
        for (index, powers) in pairs().enumerate() {
            let mut numbers = Random::new([7, index as u64, 0]);
            let normal = DVec3::new(0.6, -0.3, 0.5).normalize();
            let along = UP.cross(normal).normalize();
            let across = normal.cross(along);
            // Rings of the lobe's cosine to the power of the mean exponent, turns about the normal.
            let mean = (powers[0] * powers[1]).sqrt();
            let mut counts = [[0_u32; TURNS]; RINGS];
            for _ in 0..COUNT {
                let half = lobe(powers).half(normal, powers[0], [numbers.next(), numbers.next()]);
                assert!((half.length() - 1.0).abs() < 1e-12 && half.dot(normal) >= 0.0);
                let ring = (half.dot(normal).powf(mean + 1.0) * RINGS as f64) as usize;
                let turn = half.dot(across).atan2(half.dot(along)).rem_euclid(TAU) / TAU * TURNS as f64;
                counts[ring.min(RINGS - 1)][(turn as usize).min(TURNS - 1)] += 1;
            }
            // Over a ring the cosine's share is that of exponents (e + 1) / (mean + 1); the turn's is integrated by steps.
            let mut squares = 0.0;
            for (ring, row) in counts.iter().enumerate() {
                for (turn, found) in row.iter().enumerate() {
                    let steps = 200;
                    let part = |step: u32| {
                        let angle = TAU * (turn as f64 + (f64::from(step) + 0.5) / f64::from(steps)) / TURNS as f64;
                        let exponent = powers[0] * angle.cos().powi(2) + powers[1] * angle.sin().powi(2);
                        let share = |edge: usize| (edge as f64 / RINGS as f64).powf((exponent + 1.0) / (mean + 1.0));
                        (share(ring + 1) - share(ring)) / (exponent + 1.0)
                    };
                    let scale = ((powers[0] + 1.0) * (powers[1] + 1.0)).sqrt() / TAU;
                    let width = TAU / (TURNS as f64 * f64::from(steps));
                    let expected = f64::from(COUNT) * scale * width * (0..steps).map(part).sum::<f64>();
                    squares += (f64::from(*found) - expected).powi(2) / expected.max(1.0);
                }
            }
            // 127 degrees of freedom: chi-square lies under 200 but once in 30,000 times.
            assert!(squares < 200.0, "{powers:?}: {squares}");
        }
    }

    #[test]
    fn the_lobe_turns_with_its_axes_and_equal_exponents_have_none() {
        let mut numbers = Random::new([3, 1, 4]);
        for (_, normal, view) in views(2.0) {
            for power in EXPONENTS {
                let (hit, settings) = (mirror(normal, power, 1.0), settings(0.0));
                // Scene, view and up axis turned together: the same directions, turned.
                let turn = glam::DQuat::from_axis_angle(DVec3::new(0.3, 0.8, -0.2).normalize(), 1.1);
                let turned = mirror(turn * normal, power, 1.0);
                let other = HalfLobe { across: 30.0, up: turn * UP };
                // With equal exponents the mean over all turns about the normal is the same from every side.
                let even = |up: DVec3| {
                    let lobe = HalfLobe { across: 1.0, up };
                    let places = (0..64 * 64).map(|cell| [cell % 64, cell / 64].map(|n| (f64::from(n) + 0.5) / 64.0));
                    places
                        .map(|pair| lobe.drawn(&hit, -view, &settings, pair))
                        .fold((DVec3::ZERO, 0.0), |(sum, weights), (direction, weight)| {
                            (sum + direction * weight, weights + weight)
                        })
                };
                let (one, two) = (even(UP), even(DVec3::Y));
                assert!(
                    one.0.distance(two.0) < 0.02 * one.1 && (one.1 - two.1).abs() < 0.01 * one.1,
                    "{one:?} {two:?}"
                );
                for _ in 0..200 {
                    let pair = [numbers.next(), numbers.next()];
                    let (here, weight) = HalfLobe { across: 30.0, up: UP }.drawn(&hit, -view, &settings, pair);
                    let (there, same) = other.drawn(&turned, turn * -view, &settings, pair);
                    assert!(there.distance(turn * here) < 1e-9 && (weight - same).abs() < 1e-9);
                }
            }
        }
    }

    #[test]
    fn equal_exponents_are_blinns_lobe_and_different_ones_are_wide_in_one_direction() {
        let normal = DVec3::new(1.0, 0.2, 0.0).normalize();
        let [along, across] = lobe([10.0, 1000.0]).axes(normal);
        assert!(along.dot(UP).abs() < 1e-12 && across.dot(UP).abs() > 0.99, "{along} {across}");
        let widths = |powers: [f64; 2]| {
            let places = (0..128 * 128).map(|cell| [cell % 128, cell / 128].map(|n| (f64::from(n) + 0.5) / 128.0));
            let halves = places.map(|pair| lobe(powers).half(normal, powers[0], pair));
            halves.fold([0.0; 2], |[x, y], half| [x + half.dot(along).powi(2), y + half.dot(across).powi(2)])
        };
        let [x, y] = widths([1000.0, 10.0]);
        assert!(y > 20.0 * x, "{x} {y}");
        // Of one exponent p the mean of the squared sine is 2 / (p + 3), half of it in each direction.
        for power in EXPONENTS {
            for width in widths([power; 2]) {
                let expected = 128.0 * 128.0 / (power + 3.0);
                assert!((width / expected - 1.0).abs() < 0.01, "{power}: {width} instead of {expected}");
            }
        }
        assert!(widths([1e12; 2])[0] < 1e-6);
        // Level surfaces have the x axis, or y if they face along x.
        assert_eq!(lobe([1.0, 1.0]).axes(DVec3::Z), [DVec3::X, DVec3::Y]);
        assert_eq!(HalfLobe { across: 1.0, up: DVec3::X }.axes(-DVec3::X)[0], DVec3::Y);
    }
}
