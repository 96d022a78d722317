//! Follows light from lamps and the sun over mirrors, to where it ends ([`Caustics`]).
//!
//! A path from a surface meets no lamp without size, so photons go the other way. They are aimed at balls about the boxes
//! of the mirrors, spread by the R2 sequence; those whose first hit is no mirror are dropped, since that light comes
//! straight. Mirrors reflect a photon with their share, tint and lobe, as they reflect the eye's rays, and photons land
//! on everything they meet after the first mirror: on further mirrors for the part that these scatter. Light of lamps goes straight
//! through clear surfaces, which cast no shadow either, and is not reflected by them.

use std::f64::consts::{PI, TAU};

use cloud::{Bounds, Progress};
use glam::DVec3;
use scene::SpotLight;

use crate::caustics::{Caustics, Photon};
use crate::indirect::{Random, onward, spread};
use crate::light::{Illuminant, Illumination, Sunlight, intensity};
use crate::reflectance::{Reflectance, around};
use crate::reflection::{BATCH, in_parallel};
use crate::{Geometry, Hit, Ray};

/// How caustics are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Photons {
    /// The number that starts from all lamps together.
    pub count: u32,
    /// The radius of the disc over which those that have landed are averaged.
    pub radius: f64,
    pub seed: u32,
}

/// The name of the random numbers of photons, which are those of no path and no glossy mirror.
const PHOTONS: u64 = 1 << 41;

/// By so much the ball about a mirror is larger than that of its box, since points do not reach a surface's edge.
const AROUND_MIRROR: f64 = 1.02;

/// The number of photons that are traced one after the other.
const RUN: usize = 256;

/// The most clear surfaces that a photon passes one after the other.
const MOST_CLEAR: usize = 64;

impl Caustics {
    /// Traces the light that the mirrors in `illumination.mirror_boxes` throw. `progress` counts runs of photons. `None`
    /// when cancelled.
    pub fn traced(
        geometry: &impl Geometry,
        illumination: &Illumination,
        photons: Photons,
        progress: &Progress,
    ) -> Option<Self> {
        let emitters = Emitter::all(illumination);
        if emitters.iter().all(|emitter| emitter.beams.is_empty()) || photons.count == 0 || illumination.bounces == 0 {
            return Some(Self::new(Vec::new(), photons.radius));
        }
        let beams: Vec<(&Emitter, usize)> =
            emitters.iter().flat_map(|emitter| (0..emitter.beams.len()).map(move |beam| (emitter, beam))).collect();
        let each = (photons.count as usize / beams.len()).max(1);
        let total = beams.len() * each;
        let of_run = |run: usize| {
            let mut landed = Vec::new();
            for photon in run * RUN..((run + 1) * RUN).min(total) {
                let (number, index) = (photon / each, photon % each);
                let (emitter, beam) = beams[number];
                let random = |index| Random::new([u64::from(photons.seed), PHOTONS + number as u64, index as u64]);
                let mut shift = random(0);
                let shift = [shift.next(), shift.next()];
                if let Some((ray, density)) = emitter.start(geometry, beam, spread(shift, index as u32)) {
                    let power = emitter.light(ray.direction) / (density * each as f64);
                    follow(geometry, illumination, (ray, power), &mut random(index + 1), &mut landed);
                }
            }
            landed
        };
        let landed = in_parallel(total.div_ceil(RUN), BATCH / RUN, progress, of_run)?;
        Some(Self::new(landed.into_iter().flatten().collect(), photons.radius))
    }
}

/// Follows a photon over mirrors, and adds it to `landed` wherever it is scattered after the first one.
fn follow(
    geometry: &impl Geometry,
    illumination: &Illumination,
    (mut ray, mut power): (Ray, DVec3),
    numbers: &mut Random,
    landed: &mut Vec<Photon>,
) {
    if power == DVec3::ZERO {
        return;
    }
    let Some(mut hit) = met(geometry, ray) else { return };
    for left in (1..=illumination.bounces).rev() {
        if hit.specular_intensity <= 0.0 {
            return;
        }
        let Some((next, weight)) = onward(geometry, &hit, ray.direction, illumination, numbers) else { return };
        let beyond = met(geometry, next);
        let share_left = illumination.share_left(&hit, beyond.map(|beyond| beyond.position.distance(hit.position)));
        power *= Reflectance::new(&hit, ray.direction, left, share_left, illumination).mirror * weight;
        let Some(beyond) = beyond else { return };
        landed.push(Photon {
            position: beyond.position,
            direction: next.direction.as_vec3(),
            normal: beyond.normal.as_vec3(),
            power: power.as_vec3(),
        });
        (ray, hit) = (next, beyond);
    }
}

/// The first hit that is not clear.
fn met(geometry: &impl Geometry, mut ray: Ray) -> Option<Hit> {
    for _ in 0..MOST_CLEAR {
        let hit = geometry.nearest(&ray)?;
        if hit.medium.is_none() {
            return Some(hit);
        }
        ray = Ray::from_surface(hit.position, ray.direction);
    }
    None
}

/// A source of light, and the beams of it that may meet mirrors.
struct Emitter {
    source: Source,
    beams: Vec<Beam>,
}

enum Source {
    Lamp(SpotLight),
    Sun(Sunlight),
}

/// The light of a source that may meet one mirror: of a lamp, the directions about `axis` at angles up to one of the
/// cosine `extent`; of the sun, the parallel rays that start within the radius `extent` about the point `axis`.
#[derive(Clone, Copy)]
struct Beam {
    axis: DVec3,
    extent: f64,
}

impl Emitter {
    /// The sources that shine on mirrors.
    fn all(illumination: &Illumination) -> Vec<Self> {
        let is_there = |bounds: &&Bounds| bounds.min.is_finite() && bounds.max.is_finite() && !bounds.is_empty();
        let balls = illumination.mirror_boxes.iter().filter(is_there);
        let balls: Vec<(DVec3, f64)> = balls.map(|bounds| (bounds.center(), AROUND_MIRROR * bounds.radius())).collect();
        match illumination.source {
            Illuminant::Lights(lights) => {
                let shine = lights.iter().filter(|lamp| lamp.intensity.iter().any(|value| *value > 0.0));
                let of_lamp = |lamp: &SpotLight| {
                    let beams = balls.iter().map(|ball| cone_toward(lamp, *ball)).collect();
                    Self { source: Source::Lamp(*lamp), beams }
                };
                shine.map(of_lamp).collect()
            }
            Illuminant::Sun(sun) if sun.irradiance > 0.0 => {
                // All rays start in the plane before all mirrors, since one may stand before another.
                let height = |(center, radius): &(DVec3, f64)| center.dot(sun.direction) + radius;
                let start = balls.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
                let beam = |(center, radius): &(DVec3, f64)| Beam {
                    axis: center + sun.direction * (start - center.dot(sun.direction)),
                    extent: *radius,
                };
                vec![Self { source: Source::Sun(sun), beams: balls.iter().map(beam).collect() }]
            }
            Illuminant::Sun(_) | Illuminant::Headlight(_) => Vec::new(),
        }
    }

    /// The ray of a beam that two numbers in [0, 1) choose, and how many rays of all beams there are per steradian or per
    /// area if each has one. `None` for a ray of the sun that something stops before all mirrors.
    fn start(&self, geometry: &impl Geometry, beam: usize, [u, v]: [f64; 2]) -> Option<(Ray, f64)> {
        let Beam { axis, extent } = self.beams[beam];
        match &self.source {
            Source::Lamp(lamp) => {
                let direction = around(axis, 1.0 - u * (1.0 - extent), v);
                let holds = |beam: &&Beam| beam.axis.dot(direction) >= beam.extent;
                let density = |beam: &Beam| 1.0 / (TAU * (1.0 - beam.extent));
                // The beam that the ray is of counts, whatever rounding says.
                let density = self.beams.iter().filter(holds).map(density).sum::<f64>();
                Some((Ray::from_eye(lamp.position, direction), density.max(1.0 / (TAU * (1.0 - extent)))))
            }
            Source::Sun(sun) => {
                let (side, other) = sun.direction.any_orthonormal_pair();
                let (sin, cos) = (TAU * v).sin_cos();
                let origin = axis + (side * cos + other * sin) * (extent * u.sqrt());
                if geometry.is_blocked(&Ray::from_eye(origin, sun.direction), f64::INFINITY) {
                    return None;
                }
                // All starts lie in one plane.
                let holds = |beam: &&Beam| beam.axis.distance(origin) <= beam.extent;
                let density = |beam: &Beam| 1.0 / (PI * beam.extent * beam.extent);
                let density = self.beams.iter().filter(holds).map(density).sum::<f64>();
                Some((Ray::from_eye(origin, -sun.direction), density.max(1.0 / (PI * extent * extent))))
            }
        }
    }

    /// The light along a ray: power per steradian of a lamp, and per area of the sun.
    fn light(&self, direction: DVec3) -> DVec3 {
        match &self.source {
            Source::Lamp(lamp) => intensity(lamp, direction),
            Source::Sun(sun) => DVec3::splat(sun.irradiance),
        }
    }
}

/// The narrower one of the cone in which a lamp sees a ball, and of the lamp's own cone.
fn cone_toward(lamp: &SpotLight, (center, radius): (DVec3, f64)) -> Beam {
    let toward = center - lamp.position;
    let sine = radius / toward.length();
    // The lamp may stand in the ball.
    let extent = if sine < 1.0 { (1.0 - sine * sine).sqrt() } else { -1.0 };
    let to_ball = Beam { axis: toward.normalize_or(DVec3::Z), extent };
    let widest = f64::from(lamp.inner_degrees.max(lamp.outer_degrees)).min(180.0);
    let own = (lamp.target - lamp.position).try_normalize();
    let own = own.map(|axis| Beam { axis, extent: widest.to_radians().cos() });
    own.filter(|own| own.extent > to_ball.extent).unwrap_or(to_ball)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::{Albedo, Object};
    use crate::{Exact, Indirect, direct, radiance};
    use cloud::sampling::{Placement, Surface};
    use glam::DMat3;
    use scene::MirrorSettings;
    use scene::five_mirrors::walls;

    const REFLECTED: f64 = 0.8;
    const COUNT: u32 = 400_000;

    fn rectangle(corner: DVec3, edges: [DVec3; 2], specular_intensity: f64) -> Object {
        Object::new(Surface::Rectangle { corner, edges }, Placement::ORIGIN, Albedo::Even([1.0; 3]), specular_intensity)
    }

    /// A floor in z = 0.
    fn floor() -> Object {
        rectangle(DVec3::new(-4.0, -4.0, 0.0), [DVec3::X * 8.0, DVec3::Y * 8.0], 0.0)
    }

    /// A part of a mirror in the plane x = 2, from `y` on for `width`, half of one to one and a half high, and its box.
    fn pane(y: f64, width: f64) -> (Object, Bounds) {
        let corner = DVec3::new(2.0, y, 0.5);
        let bounds = Bounds { min: corner, max: corner + DVec3::new(0.0, width, 1.0) };
        (rectangle(corner, [DVec3::Y * width, DVec3::Z], REFLECTED), bounds)
    }

    fn lamp() -> SpotLight {
        SpotLight {
            position: DVec3::new(0.5, 0.2, 2.0),
            target: DVec3::new(2.0, 0.0, 1.0),
            intensity: [10.0, 5.0, 1.0],
            inner_degrees: 20.0,
            outer_degrees: 50.0,
        }
    }

    fn traced(geometry: &Exact, illumination: &Illumination, radius: f64) -> Caustics {
        Caustics::traced(geometry, illumination, Photons { count: COUNT, radius, seed: 1 }, &Progress::default())
            .unwrap()
    }

    /// What the floor gets at a place over mirrors.
    fn on_floor(geometry: &Exact, caustics: &Caustics, x: f64, y: f64) -> DVec3 {
        let hit = geometry.nearest(&Ray::from_eye(DVec3::new(x, y, 0.01), -DVec3::Z)).unwrap();
        caustics.sum(&hit, |_| DVec3::ONE)
    }

    /// Compares with the light of the source behind the mirror, which the pane's edges bound; `image` gives the
    /// irradiance at a place of the floor without the pane, and the direction to the image.
    fn assert_window(geometry: &Exact, illumination: &Illumination, image: impl Fn(DVec3) -> (DVec3, DVec3)) {
        const RADIUS: f64 = 0.06;
        let caustics = traced(geometry, illumination, RADIUS);
        let (mut inside, mut outside, mut squares) = (0, 0, 0.0);
        let (mut sum, mut expected_sum) = (DVec3::ZERO, DVec3::ZERO);
        for (i, j) in (0..40).flat_map(|i| (0..40).map(move |j| (i, j))) {
            let place = DVec3::new(-3.9 + 0.145 * f64::from(i), -3.9 + 0.195 * f64::from(j), 0.0);
            let (expected, toward) = image(place);
            // How far within the pane the line to the image passes, as the floor sees it.
            let share = (2.0 - place.x) / toward.x;
            let at = place + toward * share;
            let within = (at.z - 0.5).min(1.5 - at.z).min(1.0 - at.y.abs());
            let found = on_floor(geometry, &caustics, place.x, place.y);
            if within > 0.1 {
                squares += (found / expected - 1.0).length_squared() / 3.0;
                (sum, expected_sum, inside) = (sum + found, expected_sum + expected, inside + 1);
            } else if within < -0.1 {
                assert_eq!(found, DVec3::ZERO, "{place}");
                outside += 1;
            }
        }
        assert!(inside > 50 && outside > 300, "{inside} {outside}");
        let (rmse, mean) = ((squares / f64::from(inside)).sqrt(), sum / expected_sum);
        println!("{inside} places: relative RMSE {rmse}, mean {mean}");
        assert!(rmse < 0.05 && (mean - 1.0).abs().max_element() < 0.01, "{rmse} {mean}");
    }

    #[test]
    fn a_plane_mirror_throws_the_light_of_the_lamp_behind_it() {
        let settings = MirrorSettings::default();
        let (whole, bounds) = pane(-1.0, 2.0);
        let parts = [pane(-1.0, 0.7), pane(-0.3, 1.3)];
        let lights = [lamp()];
        for (mirrors, boxes) in [(vec![whole], vec![bounds]), parts.into_iter().unzip()] {
            let geometry = Exact::new(mirrors.into_iter().chain([floor()]).collect());
            let illumination = Illumination {
                bounces: 1,
                mirror_boxes: &boxes,
                ..Illumination::new(Illuminant::Lights(&lights), &settings)
            };
            assert_window(&geometry, &illumination, |place| {
                let across = DVec3::new(-1.0, 1.0, 1.0);
                let behind = DVec3::new(3.5, 0.2, 2.0) - place;
                let direction = behind.normalize();
                let expected = intensity(&lamp(), -direction * across) * direction.z / behind.length_squared();
                (expected * REFLECTED, direction)
            });
        }
    }

    #[test]
    fn a_plane_mirror_throws_the_light_of_the_sun() {
        let settings = MirrorSettings::default();
        let (mirror, bounds) = pane(-1.0, 2.0);
        let direction = DVec3::new(-0.6, 0.1, 0.5).normalize();
        let geometry = Exact::new(vec![mirror, floor()]);
        let sun = Sunlight { direction, up: DVec3::Z, irradiance: 3.0, sky: 0.0 };
        let boxes = [bounds];
        let illumination =
            Illumination { bounces: 1, mirror_boxes: &boxes, ..Illumination::new(Illuminant::Sun(sun), &settings) };
        let image = direction * DVec3::new(-1.0, 1.0, 1.0);
        assert_window(&geometry, &illumination, |_| (DVec3::splat(3.0 * REFLECTED * direction.z), image));
        // What stands beyond the plane where rays start stops them, too.
        let roof = rectangle(DVec3::new(-40.0, -40.0, 9.0), [DVec3::X * 80.0, DVec3::Y * 80.0], 0.0);
        let (mirror, _) = pane(-1.0, 2.0);
        let dark = traced(&Exact::new(vec![mirror, floor(), roof]), &illumination, 0.1);
        let at = DVec3::new(2.0, 0.0, 1.0) - image / image.z;
        assert_eq!(on_floor(&geometry, &dark, at.x, at.y), DVec3::ZERO);
    }

    #[test]
    fn a_hollow_mirror_throws_all_the_light_that_it_gets() {
        // A lamp in the focus of a paraboloid that hangs above the floor: a ray that leaves it at the distance r from the
        // mirror goes straight down, with the irradiance I / r^2.
        let (focal_length, rim_radius, height) = (0.5, 0.8, 3.0);
        let turned = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let placement = Placement { rotation: turned, scale: 1.0, translation: DVec3::Z * height };
        let dish =
            Object::new(Surface::Paraboloid { focal_length, rim_radius }, placement, Albedo::Even([1.0; 3]), REFLECTED);
        let geometry = Exact::new(vec![dish, floor()]);
        let depth = rim_radius * rim_radius / (4.0 * focal_length);
        let boxes = [Bounds {
            min: DVec3::new(-rim_radius, -rim_radius, height - depth),
            max: DVec3::new(rim_radius, rim_radius, height),
        }];
        let lights = [SpotLight {
            position: DVec3::Z * (height - focal_length),
            target: DVec3::Z * height,
            intensity: [10.0; 3],
            inner_degrees: 180.0,
            outer_degrees: 180.0,
        }];
        let settings = MirrorSettings::default();
        let illumination = Illumination {
            bounces: 1,
            mirror_boxes: &boxes,
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let caustics = traced(&geometry, &illumination, 0.04);
        for radius in [0.0, 0.2, 0.4, 0.6, 0.75] {
            let squared: f64 = radius * radius;
            let distance = focal_length + squared / (4.0 * focal_length);
            let expected = REFLECTED * 10.0 / (distance * distance);
            for direction in [DVec3::X, DVec3::new(-0.6, 0.8, 0.0)] {
                let found = on_floor(&geometry, &caustics, radius * direction.x, radius * direction.y).x;
                assert!((found / expected - 1.0).abs() < 0.05, "{radius}: {found} instead of {expected}");
            }
        }
        let steps = 100;
        let step = 2.0 / f64::from(steps);
        let places =
            (0..steps).flat_map(|i| (0..steps).map(move |j| [i, j].map(|n| (f64::from(n) + 0.5) * step - 1.0)));
        let power = places.map(|[x, y]| on_floor(&geometry, &caustics, x, y).x).sum::<f64>() * step * step;
        // The cosine of the rim's angle from the axis, seen from the lamp.
        let rim = focal_length - depth;
        let cosine = rim / (rim * rim + rim_radius * rim_radius).sqrt();
        let expected = REFLECTED * 10.0 * TAU * (1.0 - cosine);
        assert!((power / expected - 1.0).abs() < 0.01, "{power} instead of {expected}");
    }

    #[test]
    fn a_closed_white_box_with_a_mirror_ball_keeps_the_light_of_its_lamp() {
        let (walls, albedo, radius) = (walls(), 0.7, 0.6);
        let ball = Object::new(Surface::Sphere { radius }, Placement::ORIGIN, Albedo::Even([albedo; 3]), 1.0);
        let objects =
            walls.clone().map(|(surface, _)| Object::new(surface, Placement::ORIGIN, Albedo::Even([albedo; 3]), 0.0));
        let geometry = Exact::new(objects.into_iter().chain([ball]).collect());
        let degrees = 25.0;
        let lights = [SpotLight {
            position: DVec3::new(-0.6, 0.8, 1.5),
            target: DVec3::new(0.3, 0.0, 0.0),
            intensity: [10.0; 3],
            inner_degrees: degrees,
            outer_degrees: degrees,
        }];
        let boxes = [Bounds { min: DVec3::splat(-radius), max: DVec3::splat(radius) }];
        let settings = MirrorSettings::default();
        let flux = 10.0 * TAU * (1.0 - f64::from(degrees).to_radians().cos());
        let area: f64 = walls.iter().map(|(surface, _)| surface.area()).sum();
        // A path takes a mirror that it meets after its last reflection for matt, so it must have enough of them.
        let without = Illumination {
            bounces: 8,
            mirror_boxes: &boxes,
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let caustics = traced(&geometry, &without, 0.03);
        let over_walls = |illumination: &Illumination| {
            let places = 20_000.0;
            let mut sum = 0.0;
            for (index, (surface, _)) in walls.iter().enumerate() {
                let on_wall = surface.sample((surface.area() / area * places) as usize, index as u64);
                for (at, point) in on_wall.into_iter().enumerate() {
                    let eye = point.position + point.normal * 0.1;
                    let hit = geometry.nearest(&Ray::from_eye(eye, -point.normal)).unwrap();
                    sum += radiance(&geometry, &hit, -point.normal, index * 100_000 + at, illumination).x;
                }
            }
            sum / places * area * PI / albedo
        };
        for bounces in [0, 1, 3] {
            let indirect = Indirect { bounces, samples: 16, seed: 2 };
            let expected: f64 = (0..=bounces).map(|k| albedo.powi(k as i32) * flux).sum();
            let lit = over_walls(&Illumination { indirect, caustics: Some(&caustics), ..without });
            println!("{bounces} bounces: {lit} of {expected}");
            assert!((lit / expected - 1.0).abs() < 0.01, "{bounces} bounces: {lit} instead of {expected}");
            let dark = over_walls(&Illumination { indirect, ..without });
            assert!(dark < 0.8 * expected, "the ball throws nothing: {dark} of {expected}");
        }
    }

    #[test]
    fn photons_do_not_depend_on_the_number_of_threads_and_shine_where_mirrors_are_followed() {
        let settings = MirrorSettings::default();
        let ((mirror, bounds), lights) = (pane(-1.0, 2.0), [lamp()]);
        let geometry = Exact::new(vec![mirror, floor()]);
        let boxes = [bounds];
        let illumination = Illumination {
            bounces: 1,
            mirror_boxes: &boxes,
            ..Illumination::new(Illuminant::Lights(&lights), &settings)
        };
        let photons = Photons { count: 5000, radius: 0.3, seed: 3 };
        let on_threads = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| Caustics::traced(&geometry, &illumination, photons, &Progress::default()).unwrap())
        };
        let at = DVec3::new(1.0, 0.1, 0.0);
        let [one, three] = [1, 3].map(|threads| on_floor(&geometry, &on_threads(threads), at.x, at.y));
        assert!(one == three && one.x > 0.0, "{one} {three}");
        let caustics = on_threads(2);
        let hit = geometry.nearest(&Ray::from_eye(at + DVec3::Z, -DVec3::Z)).unwrap();
        let lit = |caustics, bounces| {
            direct(&geometry, &hit, -DVec3::Z, 1.0, &Illumination { caustics, bounces, ..illumination })
        };
        let straight = lit(None, 1);
        assert!((lit(Some(&caustics), 1) - straight - one / PI).abs().max_element() < 1e-12);
        assert_eq!(lit(Some(&caustics), 0), straight, "mirrors are diffuse surfaces");
        // Without mirrors, without their pictures, or without lamps there is nothing to trace.
        for without in [
            Illumination { mirror_boxes: &[], ..illumination },
            Illumination { bounces: 0, ..illumination },
            Illumination { source: Illuminant::Headlight(1.0), ..illumination },
        ] {
            let none = Caustics::traced(&geometry, &without, photons, &Progress::default()).unwrap();
            assert_eq!(on_floor(&geometry, &none, at.x, at.y), DVec3::ZERO);
        }
        let cancelled = Progress::default();
        cancelled.cancel();
        assert!(Caustics::traced(&geometry, &illumination, photons, &cancelled).is_none());
    }
}
