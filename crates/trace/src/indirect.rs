//! Indirect light by path tracing: the light that the sky and other surfaces send to a surface, and that the surface
//! sends on to the eye.
//!
//! Each sample follows one path from the surface, in directions drawn according to the surface's reflectance, and adds
//! at each surface on the path the direct light of the lights or the sun there (next-event estimation; Kajiya 1986).
//! Paths that escape find the sky's light. The estimate is unbiased. The first directions of a surface's samples are
//! spread by the R2 sequence (Roberts 2018), shifted at random from pixel to pixel (Cranley and Patterson 1976).
//!
//! Mirrors on the way are followed, with their share, as far as reflections are followed at all, and do not count as a
//! reflection between surfaces. Their highlights are left out: light that a mirror throws from a lamp onto a surface is
//! that surface's direct light, if photons have found it ([`crate::Caustics`]).
//!
//! Random numbers are hashes of seed, pixel, sample and dimension: they do not depend on the number of threads.

use cloud::Progress;
use glam::DVec3;
use scene::MirrorSettings;

use crate::half_lobe::Lobe;
use crate::light::{Illuminant, Illumination, mean_share_left, scattered};
use crate::reflectance::{Reflectance, lobe_direction};
use crate::reflection::{BATCH, in_parallel};
use crate::refraction::stronger;
use crate::{Geometry, Hit, Ray, mirrored};

/// How indirect light is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indirect {
    /// The most reflections between surfaces before light reaches the visible one; with 0 there is only light of the
    /// sky.
    pub bounces: u32,
    /// The number of paths that are averaged for a surface; 0 for no indirect light.
    pub samples: u32,
    pub seed: u32,
}

impl Indirect {
    /// The number of surfaces whose paths are as much work as `BATCH` rays.
    pub(crate) fn batch(&self) -> usize {
        (BATCH / self.samples.max(1) as usize).max(1)
    }
}

/// The indirect light of each pixel's surface, given as its hit and the direction of the ray that sees it; none where
/// nothing is seen. `progress` counts pixels. `None` when cancelled.
pub fn indirect_picture(
    geometry: &impl Geometry,
    seen: &[Option<(Hit, DVec3)>],
    illumination: &Illumination,
    progress: &Progress,
) -> Option<Vec<Option<DVec3>>> {
    in_parallel(seen.len(), illumination.indirect.batch(), progress, |pixel| {
        seen[pixel].map(|(hit, direction)| indirect(geometry, &hit, direction, pixel, illumination))
    })
}

/// The indirect light that a hit sends back along the ray that arrives in `direction`, by its diffuse part and its
/// highlight; for a mirror whose reflection is followed, only by the remaining diffuse part. `pixel` chooses the paths.
pub fn indirect(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    pixel: usize,
    illumination: &Illumination,
) -> DVec3 {
    let share_left = mean_share_left(geometry, hit, direction, pixel, illumination);
    indirect_beside(geometry, hit, direction, pixel, share_left, illumination)
}

/// The indirect light of `indirect`, where it is known which share of the mirror's reflection is left.
pub(crate) fn indirect_beside(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    pixel: usize,
    share_left: f64,
    illumination: &Illumination,
) -> DVec3 {
    let Indirect { bounces, samples, seed } = illumination.indirect;
    let surface = Reflectance::new(hit, direction, illumination.left(), share_left, illumination).beside_reflection();
    let tracer = PathTracer { geometry, illumination };
    if samples == 0 || !surface.scatters() || !tracer.finds_light(bounces) {
        return DVec3::ZERO;
    }
    let mut numbers = Random::new([u64::from(seed), pixel as u64, 0]);
    let shift = [numbers.next(), numbers.next()];
    let path = |sample: u32| {
        let mut numbers = Random::new([u64::from(seed), pixel as u64, u64::from(sample) + 1]);
        tracer.path(hit.position, &surface, spread(shift, sample), &mut numbers)
    };
    (0..samples).map(path).sum::<DVec3>() / f64::from(samples)
}

struct PathTracer<'a, G> {
    geometry: &'a G,
    illumination: &'a Illumination<'a>,
}

impl<G: Geometry> PathTracer<'_, G> {
    /// Whether a ray can find light that at most `bounces` surfaces are to reflect.
    fn finds_light(&self, bounces: u32) -> bool {
        self.illumination.sky().is_some()
            || bounces > 0 && !matches!(self.illumination.source, Illuminant::Headlight(_))
    }

    /// The light of one path from a surface.
    fn path(&self, position: DVec3, surface: &Reflectance, first: [f64; 2], numbers: &mut Random) -> DVec3 {
        let mut light = DVec3::ZERO;
        let Some(next) = surface.sample(first) else {
            return light;
        };
        let (mut bounces, mut reflections) = (self.illumination.indirect.bounces, self.illumination.bounces);
        let mut throughput = next.weight;
        let mut ray = Ray::from_surface(position, next.direction);
        loop {
            let Some(hit) = self.geometry.nearest(&ray) else {
                let radiance = self.illumination.sky().map_or(0.0, |sky| sky.sky_radiance(ray.direction));
                return light + throughput * radiance;
            };
            let is_mirror = hit.specular_intensity > 0.0;
            let go_on = |ray: &Ray, numbers: &mut Random| {
                onward(self.geometry, &hit, ray.direction, self.illumination, numbers)
            };
            // What is left of a reflection that fades depends on what its ray meets.
            let knows_ray = is_mirror && reflections > 0 && self.illumination.fades(&hit);
            let known = if knows_ray { go_on(&ray, numbers) } else { None };
            let share_left = match known {
                _ if !knows_ray => 1.0,
                // Below the surface there is nothing to see.
                Some((_, 0.0)) => 1.0,
                known => {
                    let met = known.and_then(|(ray, _)| self.geometry.nearest(&ray));
                    self.illumination.share_left(&hit, met.map(|hit| hit.distance))
                }
            };
            let mut surface = Reflectance::new(&hit, ray.direction, reflections, share_left, self.illumination);
            if is_mirror {
                surface = surface.without_highlight();
            }
            if bounces > 0 {
                light += throughput * scattered(self.geometry, &hit, &surface, self.illumination);
            }
            // The path continues over a mirror or from the surface, in proportion to their shares.
            let mirror = if self.finds_light(bounces) { surface.mirror.max_element() } else { 0.0 };
            let scatter = if bounces > 0 && self.finds_light(bounces - 1) { surface.scattered() } else { 0.0 };
            let either = mirror + scatter;
            if either <= 0.0 {
                return light;
            }
            if numbers.next() * either < mirror {
                throughput *= surface.mirror * (either / mirror);
                reflections -= 1;
                let next = if knows_ray { known } else { go_on(&ray, numbers) };
                let Some((next, weight)) = next.filter(|(_, weight)| *weight > 0.0) else { return light };
                throughput *= weight;
                ray = next;
            } else {
                let Some(sample) = surface.sample([numbers.next(), numbers.next()]) else {
                    return light;
                };
                throughput *= sample.weight * (either / scatter);
                bounces -= 1;
                ray = Ray::from_surface(hit.position, sample.direction);
            }
        }
    }
}

/// The ray that goes on after one that arrives in `direction` at a mirror or a clear surface which is not the first, and
/// how much of its light is reflected; a glossy mirror draws it. `None` if the surface has no normal.
pub(crate) fn onward(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    illumination: &Illumination,
    numbers: &mut Random,
) -> Option<(Ray, f64)> {
    let is_glossy = hit.specular_power > 0.0 && hit.reflected_part(direction) >= 0.5;
    let Some(lobe) = illumination.lobe.filter(|_| is_glossy) else {
        return Some((stronger(geometry, hit, direction)?, 1.0));
    };
    let pair = [numbers.next(), numbers.next()];
    let (drawn, weight) = glossy_direction(lobe, hit, direction, illumination.mirror, pair, numbers);
    Some((Ray::from_surface(hit.position, drawn), weight))
}

/// A direction that the lobe of a glossy mirror sends to the eye's ray, which arrives in `incoming`, and how much of the
/// light from there is reflected. Of even lobes it is drawn until it leads out of the surface; the perfect reflection
/// stands in after many tries, which only a ray along the surface needs.
pub(crate) fn glossy_direction(
    lobe: Lobe,
    hit: &Hit,
    incoming: DVec3,
    settings: &MirrorSettings,
    first: [f64; 2],
    numbers: &mut Random,
) -> (DVec3, f64) {
    let shape = match lobe {
        Lobe::Even(shape) => shape,
        Lobe::Half(lobe) => return lobe.drawn(hit, incoming, settings, first),
    };
    let mut pair = first;
    for _ in 0..64 {
        let drawn = lobe_direction(shape, hit.specular_power, hit.normal, -incoming, pair);
        if let Some(direction) = drawn.filter(|direction| direction.dot(hit.normal) > 0.0) {
            return (direction, 1.0);
        }
        pair = [numbers.next(), numbers.next()];
    }
    (mirrored(incoming, hit.normal).normalize_or_zero(), 1.0)
}

/// Point `index` of the R2 sequence in [0, 1) in both dimensions, shifted.
pub(crate) fn spread(shift: [f64; 2], index: u32) -> [f64; 2] {
    // Powers of 1 over the root of x^3 = x + 1.
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    [0, 1].map(|axis| (shift[axis] + f64::from(index) * STEPS[axis]).fract())
}

/// A stream of random numbers, different for each name (SplitMix64; Steele et al. 2014).
pub(crate) struct Random {
    state: u64,
}

impl Random {
    const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

    pub fn new(name: [u64; 3]) -> Self {
        Self { state: name.into_iter().fold(0, |state, part| Self::mixed((state ^ part).wrapping_add(Self::STEP))) }
    }

    /// A number in [0, 1).
    pub fn next(&mut self) -> f64 {
        self.state = self.state.wrapping_add(Self::STEP);
        (Self::mixed(self.state) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn mixed(mut bits: u64) -> u64 {
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_1_PI, PI, TAU};

    use super::*;
    use crate::exact::{Albedo, Object};
    use crate::{Exact, Gloss, MaterialPoints, PixelRays, Sunlight, Surfels, picture, primary, radiance};
    use cloud::Bounds;
    use cloud::sampling::{Placement, Surface};
    use scene::five_mirrors::{Variant, camera, light, sample, walls};
    use scene::{Highlight, MirrorSettings, SpotLight, ViewSettings};

    fn rectangle(corner: DVec3, edges: [DVec3; 2], albedo: f64, specular_intensity: f64) -> Object {
        let surface = Surface::Rectangle { corner, edges };
        Object::new(surface, Placement::ORIGIN, Albedo::Even([albedo; 3]), specular_intensity)
    }

    /// A floor in z = `z`, 2000 wide.
    fn floor(z: f64, albedo: f64, specular_intensity: f64) -> Object {
        let corner = DVec3::new(-1000.0, -1000.0, z);
        rectangle(corner, [DVec3::X * 2000.0, DVec3::Y * 2000.0], albedo, specular_intensity)
    }

    fn sky(sky: f64) -> Illuminant<'static> {
        Illuminant::Sun(Sunlight { direction: DVec3::Z, up: DVec3::Z, irradiance: 0.0, sky })
    }

    fn lamp(position: DVec3, target: DVec3, degrees: f32) -> SpotLight {
        SpotLight { position, target, intensity: [10.0; 3], inner_degrees: degrees, outer_degrees: degrees }
    }

    fn indirect_at(geometry: &Exact, origin: DVec3, direction: DVec3, illumination: &Illumination) -> f64 {
        let direction = direction.normalize();
        let hit = geometry.nearest(&Ray::from_eye(origin, direction)).unwrap();
        indirect(geometry, &hit, direction, 7, illumination).x
    }

    fn assert_near(found: f64, expected: f64, share: f64, what: &str) {
        assert!((found / expected - 1.0).abs() < share, "{what}: {found} instead of {expected}");
    }

    #[test]
    fn an_integrating_sphere_is_evenly_bright_as_the_geometric_series_says() {
        let (radius, settings) = (2.0, MirrorSettings::default());
        let lights = [lamp(DVec3::new(0.3, -0.2, 0.1), DVec3::new(1.0, 0.5, -0.4), 40.0)];
        let flux = 10.0 * TAU * (1.0 - 40.0_f64.to_radians().cos());
        for albedo in [0.5, 0.9] {
            let surface = Surface::Sphere { radius };
            let object = Object::new(surface, Placement::ORIGIN, Albedo::Even([albedo; 3]), 0.0);
            let sphere = Exact::new(vec![object]);
            for bounces in [1, 2, 3, 30] {
                let indirect = Indirect { bounces, samples: 1 << 14, seed: 1 };
                let illumination =
                    Illumination { indirect, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
                // Each bit of a sphere lights all others equally.
                let arriving: f64 =
                    (1..=bounces).map(|k| albedo.powi(k as i32) * flux / (4.0 * PI * radius * radius)).sum();
                for direction in [DVec3::X, DVec3::new(-1.0, 2.0, 0.5)] {
                    let found = indirect_at(&sphere, DVec3::ZERO, direction, &illumination);
                    let what = format!("albedo {albedo}, {bounces} bounces, toward {direction}");
                    assert_near(found, albedo * FRAC_1_PI * arriving, 0.01, &what);
                }
            }
        }
    }

    #[test]
    fn a_closed_white_box_keeps_the_light_of_its_lamp() {
        let (walls, albedo) = (walls(), 0.8);
        let objects =
            walls.clone().map(|(surface, _)| Object::new(surface, Placement::ORIGIN, Albedo::Even([albedo; 3]), 0.0));
        let (geometry, settings) = (Exact::new(objects.into()), MirrorSettings::default());
        let lights = [lamp(DVec3::new(0.2, 0.1, -0.3), DVec3::new(0.5, -1.0, 2.0), 60.0)];
        let flux = 10.0 * TAU * (1.0 - 60.0_f64.to_radians().cos());
        let area: f64 = walls.iter().map(|(surface, _)| surface.area()).sum();
        for bounces in [1, 3, 12] {
            let indirect = Indirect { bounces, samples: 16, seed: 2 };
            let illumination = Illumination { indirect, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
            let mut sum = 0.0;
            let places = 20_000;
            for (index, (surface, _)) in walls.iter().enumerate() {
                let share = surface.area() / area;
                let on_wall = surface.sample((share * f64::from(places)) as usize, index as u64);
                let count = on_wall.len() as f64;
                for (at, point) in on_wall.into_iter().enumerate() {
                    let eye = point.position + point.normal * 0.1;
                    let hit = geometry.nearest(&Ray::from_eye(eye, -point.normal)).unwrap();
                    let pixel = index * 100_000 + at;
                    sum += radiance(&geometry, &hit, -point.normal, pixel, &illumination).x * share / count;
                }
            }
            // Nothing leaves a closed box: each reflection sends out its albedo's share of the light of the one before.
            let expected: f64 = (0..=bounces).map(|k| albedo.powi(k as i32 + 1) * flux / area).sum();
            assert_near(sum * PI, expected, 0.01, &format!("{bounces} bounces"));
        }
    }

    #[test]
    fn an_open_plane_shows_the_sky_whatever_the_bounces() {
        let plane = Exact::new(vec![floor(0.0, 0.6, 0.0)]);
        let settings = MirrorSettings::default();
        for bounces in [0, 1, 3] {
            let indirect = Indirect { bounces, samples: 64, seed: 3 };
            let illumination = Illumination { indirect, ..Illumination::new(sky(2.0), &settings) };
            let found = indirect_at(&plane, DVec3::Z, DVec3::new(0.3, 0.1, -1.0), &illumination);
            assert_near(found, 0.6 * 2.0 * FRAC_1_PI, 1e-9, "the sky");
            // No light comes from below.
            assert_eq!(indirect_at(&plane, -DVec3::Z, DVec3::Z, &illumination), 0.0);
        }
    }

    #[test]
    fn a_tall_wall_takes_half_of_the_sky() {
        let tall = rectangle(DVec3::new(0.0, -1e6, 0.0), [DVec3::Y * 2e6, DVec3::Z * 1e6], 0.8, 0.0);
        let geometry = Exact::new(vec![floor(0.0, 0.6, 0.0), tall]);
        let settings = MirrorSettings::default();
        let at_foot = |bounces| {
            let indirect = Indirect { bounces, samples: 1 << 16, seed: 3 };
            let illumination = Illumination { indirect, ..Illumination::new(sky(1.0), &settings) };
            indirect_at(&geometry, DVec3::new(1e-3, 0.0, 1.0), -DVec3::Z, &illumination)
        };
        assert_near(at_foot(0), 0.5 * 0.6 * FRAC_1_PI, 2e-3, "the sky alone");
        // The wall sees half of the sky, too, and fills the other half of the floor's view.
        assert_near(at_foot(1), (0.5 + 0.5 * 0.8 * 0.5) * 0.6 * FRAC_1_PI, 8e-3, "with the wall's light");
    }

    #[test]
    fn each_reflection_between_surfaces_is_a_bounce() {
        let geometry = Exact::new(vec![floor(0.0, 0.5, 0.0), floor(1.0, 0.5, 0.0)]);
        let settings = MirrorSettings::default();
        let lights = [lamp(DVec3::Z * 0.9, DVec3::ZERO, 60.0)];
        let with = |bounces| {
            let indirect = Indirect { bounces, samples: 1 << 14, seed: 5 };
            let illumination = Illumination { indirect, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
            indirect_at(&geometry, DVec3::new(0.0, 0.0, 0.5), DVec3::new(0.5, 0.0, -1.0), &illumination)
        };
        // Floor and ceiling: the floor's light comes back to it only after an even number of reflections.
        assert!(with(0) == 0.0 && with(1) == 0.0, "{} {}", with(0), with(1));
        assert!(with(2) > 0.0);
        assert_near(with(3), with(2), 1e-9, "the third bounce ends on the ceiling");
        assert!(with(4) > with(2) * 1.05);
    }

    #[test]
    fn mirrors_pass_light_on_without_counting_as_a_bounce() {
        // A lamp lights a wall at z = 3; the floor sees it in the ceiling's mirror, half of the way.
        let settings = MirrorSettings::default();
        let lights = [lamp(DVec3::Z * 0.5, DVec3::Z, 80.0)];
        let scene = |specular_intensity| {
            let ceiling = floor(1.0, 0.5, specular_intensity);
            let ground = rectangle(DVec3::new(-1.0, -1.0, 0.0), [DVec3::X * 2.0, DVec3::Y * 2.0], 0.5, 0.0);
            Exact::new(vec![ground, floor(-4.0, 0.5, 0.0), ceiling])
        };
        let with = |specular_intensity, reflections, bounces| {
            let indirect = Indirect { bounces, samples: 1 << 15, seed: 5 };
            let illumination = Illumination {
                indirect,
                bounces: reflections,
                ..Illumination::new(Illuminant::Lights(&lights), &settings)
            };
            indirect_at(&scene(specular_intensity), DVec3::Z * 0.5, -DVec3::Z, &illumination)
        };
        // A path takes a mirror whose reflections have faded for a diffuse surface.
        let faded = {
            let settings = MirrorSettings { fade_distance: 0.1, ..MirrorSettings::default() };
            let illumination = Illumination {
                indirect: Indirect { bounces: 1, samples: 1 << 15, seed: 5 },
                bounces: 1,
                mirror_boxes: &[Bounds { min: DVec3::ZERO, max: DVec3::ONE }],
                ..Illumination::new(Illuminant::Lights(&lights), &settings)
            };
            indirect_at(&scene(1.0), DVec3::Z * 0.5, -DVec3::Z, &illumination)
        };
        let diffuse = with(0.0, 1, 1);
        assert_near(faded, diffuse, 0.02, "faded");
        assert!(diffuse > 0.0);
        // A perfect mirror passes on none of the lamp's light, which photons would follow. A half one sends half of it out
        // diffusely.
        assert_eq!(with(1.0, 1, 1), 0.0);
        assert_near(with(0.5, 1, 1), 0.5 * diffuse, 0.02, "half a mirror");
        // A mirror that is not followed is diffuse.
        assert_near(with(1.0, 0, 1), diffuse, 1e-9, "not followed");
        // The mirror shows the ground beyond after two reflections between surfaces: ceiling, ground, and over the mirror.
        assert!(with(0.5, 1, 2) > with(0.5, 1, 1) * 1.01);
    }

    #[test]
    fn what_a_mirror_shows_is_lit_as_it_is_where_it_stands() {
        let (geometry, settings, lights) = (Exact::five_mirrors(Variant::Sphere), MirrorSettings::default(), [light()]);
        let indirect = Indirect { bounces: 1, samples: 64, seed: 4 };
        let illumination =
            Illumination { bounces: 1, indirect, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
        let rays = PixelRays::new(&camera(), &ViewSettings::default(), [40, 30], 0.0);
        let mut mirrors = 0;
        for (pixel, hit) in primary(&geometry, &rays, &Progress::default()).unwrap().into_iter().enumerate() {
            let Some(mirror) = hit.filter(|hit| hit.specular_intensity > 0.0) else { continue };
            let direction = rays.ray(pixel).direction;
            let onward = mirrored(direction, mirror.normal);
            let wall = geometry.nearest(&Ray::from_surface(mirror.position, onward)).unwrap();
            // Walls are diffuse: they look the same from everywhere, and with the same paths to the bit.
            let there = radiance(&geometry, &wall, onward, pixel, &illumination);
            let shown = radiance(&geometry, &mirror, direction, pixel, &illumination);
            assert!(shown.distance(there) <= 1e-12 * there.length(), "pixel {pixel}: {shown} instead of {there}");
            mirrors += 1;
        }
        assert!(mirrors > 50);
    }

    #[test]
    fn glossy_paths_are_those_of_a_brute_force_sum() {
        // A glossy floor under a strip of even light: a sky seen through a slit between two black screens.
        let screen = |x: f64| rectangle(DVec3::new(x, -1000.0, 1.0), [DVec3::X * 1000.0, DVec3::Y * 2000.0], 0.0, 0.0);
        let geometry = Exact::new(vec![floor(0.0, 0.5, 0.0), screen(0.2), screen(-1000.3)]);
        let settings = MirrorSettings::default();
        for shape in [Highlight::Phong, Highlight::Blinn] {
            for power in [3.0, 60.0] {
                let gloss = Gloss { share: 0.7, power, shape };
                let indirect = Indirect { bounces: 0, samples: 1 << 14, seed: 9 };
                let illumination = Illumination { gloss, indirect, ..Illumination::new(sky(PI), &settings) };
                let eye = DVec3::new(-0.4, 0.3, 0.9);
                let found = indirect_at(&geometry, eye, -eye, &illumination);
                let to_eye = eye.normalize();
                let steps = 1000;
                let mut expected = 0.0;
                for (i, j) in (0..steps).flat_map(|i| (0..steps).map(move |j| (i, j))) {
                    let [cosine, turn] = [i, j].map(|n| (f64::from(n) + 0.5) / f64::from(steps));
                    let sine = (1.0 - cosine * cosine).sqrt();
                    let to_light = DVec3::new(sine * (TAU * turn).cos(), sine * (TAU * turn).sin(), cosine);
                    let x = to_light.x / to_light.z;
                    if !(-0.3..0.2).contains(&x) {
                        continue;
                    }
                    let lobe = match shape {
                        Highlight::Phong => {
                            let along = (2.0 * to_light.z * DVec3::Z - to_light).dot(to_eye).max(0.0);
                            (power + 2.0) / TAU * along.powf(power)
                        }
                        Highlight::Blinn => {
                            let along = (to_light + to_eye).normalize().z;
                            let scale =
                                (power + 2.0) * (power + 4.0) / (8.0 * PI * (2.0_f64.powf(-power / 2.0) + power));
                            scale * along.powf(power)
                        }
                    };
                    expected += (0.3 * 0.5 * FRAC_1_PI + 0.7 * lobe) * cosine * TAU / f64::from(steps * steps);
                }
                assert_near(found, expected, 0.01, &format!("{shape:?} {power}"));
            }
        }
    }

    #[test]
    fn a_mirror_keeps_its_highlight_of_indirect_light_until_its_reflection_is_followed() {
        let mirror = floor(0.0, 0.4, 0.9).with_specular_power(100.0);
        let geometry = Exact::new(vec![mirror]);
        let with = |bounces, fade_distance, fade_least| {
            let settings = MirrorSettings { fade_distance, fade_least, ..MirrorSettings::default() };
            let indirect = Indirect { bounces: 0, samples: 256, seed: 3 };
            let illumination = Illumination { bounces, indirect, ..Illumination::new(sky(PI), &settings) };
            indirect_at(&geometry, DVec3::Z, -DVec3::Z, &illumination)
        };
        // Along the normal a highlight sends out all the light that it receives.
        assert_near(with(0, 0.0, 0.0), 0.4 + 0.9, 5e-3, "not followed");
        assert_near(with(1, 0.0, 0.0), 0.1 * 0.4, 1e-9, "followed");
        // The mirror's ray meets nothing, so that the least is left of its reflection.
        assert_near(with(1, 1.0, 0.5), 0.55 * 0.4, 1e-7, "half is left");
        assert_near(with(1, 1.0, 0.0), 0.4, 1e-9, "nothing is left, and no highlight");
    }

    #[test]
    fn pictures_with_indirect_light_are_its_sum_and_do_not_depend_on_the_number_of_threads() {
        let (settings, lights) = (MirrorSettings::default(), [light()]);
        let rays = PixelRays::new(&camera(), &ViewSettings::default(), [48, 36], 0.0);
        let parts = sample(Variant::Torus, 30_000, 1);
        let parts: Vec<MaterialPoints> = parts
            .iter()
            .map(|part| {
                let specular_intensity = part.mirror.as_ref().map_or(0.0, |_| 0.8);
                MaterialPoints {
                    chunks: &part.chunks,
                    specular_intensity,
                    specular_power: 0.0,
                    clear: None,
                    plain: [0.5; 3],
                }
            })
            .collect();
        let surfels = Surfels::new(&parts, 1.0, &Progress::default()).unwrap();
        let gloss = Gloss { share: 0.2, power: 30.0, shape: Highlight::Blinn };
        let illumination = Illumination {
            gloss,
            bounces: 1,
            indirect: Indirect { bounces: 2, samples: 3, seed: 11 },
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let draw = |threads: usize, illumination: &Illumination| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| picture(&surfels, &rays, illumination, &Progress::default()).unwrap())
        };
        let full = draw(1, &illumination);
        assert_eq!(full, draw(3, &illumination));
        assert!(full.iter().flatten().all(|color| color.is_finite() && color.min_element() >= 0.0));
        let reseeded = Illumination { indirect: Indirect { seed: 12, ..illumination.indirect }, ..illumination };
        assert_ne!(full, draw(3, &reseeded));

        let seen = primary(&surfels, &rays, &Progress::default()).unwrap();
        let seen: Vec<Option<(Hit, DVec3)>> =
            seen.into_iter().enumerate().map(|(pixel, hit)| Some((hit?, rays.ray(pixel).direction))).collect();
        let own = indirect_picture(&surfels, &seen, &illumination, &Progress::default()).unwrap();
        let without = Illumination { indirect: Indirect { samples: 0, ..illumination.indirect }, ..illumination };
        let (mut lit, mut walls) = (0, 0);
        for (pixel, seen) in seen.iter().enumerate() {
            let Some((hit, direction)) = seen else { continue };
            let (full, own) = (full[pixel].unwrap(), own[pixel].unwrap());
            lit += usize::from(own.x > 0.0);
            if hit.specular_intensity == 0.0 {
                walls += 1;
                let direct = radiance(&surfels, hit, *direction, pixel, &without);
                assert!(full.distance(direct + own) < 1e-12);
            }
        }
        assert!(walls > 1000 && lit > 1000, "{walls} {lit}");
        let cancelled = Progress::default();
        cancelled.cancel();
        assert_eq!(indirect_picture(&surfels, &seen, &illumination, &cancelled), None);
    }

    #[test]
    fn discs_send_the_indirect_light_of_the_surfaces_they_stand_for() {
        let (settings, lights) = (MirrorSettings::default(), [light()]);
        let rays = PixelRays::new(&camera(), &ViewSettings::default(), [48, 36], 0.0);
        let exact = Exact::five_mirrors(Variant::None);
        let parts = sample(Variant::None, 200_000, 1);
        let parts: Vec<MaterialPoints> = parts
            .iter()
            .map(|part| MaterialPoints {
                chunks: &part.chunks,
                specular_intensity: 0.0,
                specular_power: 0.0,
                clear: None,
                plain: [0.5; 3],
            })
            .collect();
        let surfels = Surfels::new(&parts, 1.0, &Progress::default()).unwrap();
        let illumination = Illumination {
            indirect: Indirect { bounces: 1, samples: 256, seed: 1 },
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let seen = |hits: Vec<Option<Hit>>| -> Vec<Option<(Hit, DVec3)>> {
            hits.into_iter().enumerate().map(|(pixel, hit)| Some((hit?, rays.ray(pixel).direction))).collect()
        };
        let none = Progress::default();
        let [a, b] = [
            indirect_picture(&exact, &seen(primary(&exact, &rays, &none).unwrap()), &illumination, &none).unwrap(),
            indirect_picture(&surfels, &seen(primary(&surfels, &rays, &none).unwrap()), &illumination, &none).unwrap(),
        ];
        let mean = |light: &[Option<DVec3>]| light.iter().flatten().sum::<DVec3>() / light.len() as f64;
        let squares = a.iter().zip(&b).map(|(a, b)| (a.unwrap() - b.unwrap()).length_squared()).sum::<f64>();
        let rmse = (squares / a.len() as f64 / 3.0).sqrt() / (mean(&a).element_sum() / 3.0);
        let ratio = mean(&b) / mean(&a);
        assert!((ratio - DVec3::ONE).abs().max_element() < 0.02, "{ratio}");
        // 0.08 of it is noise.
        assert!(rmse < 0.15, "{rmse}");
    }

    #[test]
    fn what_has_no_normal_or_stands_on_a_lamp_gets_no_light_and_no_nan() {
        let (geometry, settings) = (Exact::five_mirrors(Variant::None), MirrorSettings::default());
        let lights = [lamp(DVec3::new(0.0, -1.0, 0.0), DVec3::ZERO, 80.0)];
        let gloss = Gloss { share: 0.5, power: 1000.0, shape: Highlight::Blinn };
        let indirect_settings = Indirect { bounces: 3, samples: 64, seed: 1 };
        let illumination = Illumination {
            gloss,
            indirect: indirect_settings,
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let ray = Ray::from_eye(DVec3::ZERO, -DVec3::Y);
        let hit = geometry.nearest(&ray).unwrap();
        for normal in [hit.normal, DVec3::ZERO, DVec3::NAN, -hit.normal] {
            for direction in [ray.direction, DVec3::X, -ray.direction] {
                let light = indirect(&geometry, &Hit { normal, ..hit }, direction, 0, &illumination);
                assert!(light.is_finite() && light.min_element() >= 0.0, "{normal} {direction}: {light}");
            }
        }
    }
}
