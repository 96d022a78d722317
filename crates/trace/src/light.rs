//! Direct light: spot lights with shadows, or a sun and a sky, or a lamp at the eye, straight and over mirrors; blended
//! with reflections in mirrors.
//!
//! The definition is the renderer's; reflectance.rs has that of surfaces. Light that was reflected before it reaches a
//! surface, and that of the sky, comes from [`mod@crate::indirect`]. A mirror whose ray hits nothing shows the background.

use std::f64::consts::FRAC_1_PI;

use cloud::{Bounds, Progress};
use glam::DVec3;
use scene::{MirrorSettings, SpotLight, Sun};

use crate::caustics::Caustics;
use crate::half_lobe::Lobe;
use crate::indirect::{Indirect, Random, glossy_direction, indirect_beside, spread};
use crate::reflectance::{Gloss, Reflectance};
use crate::reflection::in_parallel;
use crate::refraction::{met, stronger, through};
use crate::{Geometry, Hit, MirrorPoint, PixelRays, Ray};

/// The source of the light.
#[derive(Clone, Copy, Debug)]
pub enum Illuminant<'a> {
    Lights(&'a [SpotLight]),
    Sun(Sunlight),
    /// A lamp at the eye, or at the mirror point that sees a surface. The share (0 to 1) is the part of the light that
    /// falls off with the angle between surface and view; at 0 surfaces show their own colours.
    Headlight(f64),
}

/// A sun without size, and a sky that is evenly bright in the upper half of the directions and dark below.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sunlight {
    /// The unit vector toward the sun.
    pub direction: DVec3,
    /// The up direction, a unit vector.
    pub up: DVec3,
    /// The irradiance of a surface that faces the sun.
    pub irradiance: f64,
    /// The irradiance by the whole sky of a surface that faces up.
    pub sky: f64,
}

impl Sunlight {
    /// `up` is the world's up axis, of any length.
    pub fn new(sun: &Sun, up: DVec3) -> Self {
        let (irradiance, sky) = (f64::from(sun.irradiance), f64::from(sun.sky));
        Self { direction: sun.direction(up), up: up.normalize_or(DVec3::Z), irradiance, sky }
    }

    /// The radiance of the sky in `direction`.
    pub(crate) fn sky_radiance(&self, direction: DVec3) -> f64 {
        if direction.dot(self.up) > 0.0 { self.sky * FRAC_1_PI } else { 0.0 }
    }
}

/// A lamp at the eye, or at the mirror point that sees a surface, beside other lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// The radiance of white that faces it; 0 without it.
    pub radiance: f64,
    /// The share that falls off with the angle between surface and view.
    pub share: f64,
}

impl Fill {
    pub const NONE: Self = Self { radiance: 0.0, share: 0.0 };
}

/// The light of a scene, and how far it is followed.
#[derive(Clone, Copy, Debug)]
pub struct Illumination<'a> {
    pub source: Illuminant<'a>,
    pub gloss: Gloss,
    /// The factor of the diffuse light that surfaces send back; a lamp at the eye shows the data's own colours.
    pub diffuse: f64,
    /// What a lamp at the eye adds to lights or sun.
    pub fill: Fill,
    /// The number of mirrors over which a ray is followed, whether of the eye or of a path of light.
    pub bounces: u32,
    /// The number of mirrors over which the eye's ray has been followed already; light takes its own way to the
    /// surfaces that they show.
    pub passed: u32,
    pub mirror: &'a MirrorSettings,
    /// The boxes about the points of the mirrors, whose radii reflections fade by.
    pub mirror_boxes: &'a [Bounds],
    /// The lobe of the light that mirrors with a specular power reflect; `None` if all mirrors are perfect.
    pub lobe: Option<Lobe>,
    /// The linear colour that mirrors show where their ray hits nothing.
    pub background: DVec3,
    pub indirect: Indirect,
    /// What mirrors throw from lamps or sun, if that was traced; it shines where reflections are followed.
    pub caustics: Option<&'a Caustics>,
}

impl<'a> Illumination<'a> {
    /// Direct light on diffuse surfaces, mirrors included, in front of black.
    pub fn new(source: Illuminant<'a>, mirror: &'a MirrorSettings) -> Self {
        let indirect = Indirect { bounces: 0, samples: 0, seed: 0 };
        let (lobe, background) = (None, DVec3::ZERO);
        Self {
            source,
            gloss: Gloss::NONE,
            diffuse: 1.0,
            fill: Fill::NONE,
            bounces: 0,
            passed: 0,
            mirror,
            mirror_boxes: &[],
            lobe,
            background,
            indirect,
            caustics: None,
        }
    }

    /// The number of mirrors over which the eye's ray may still be followed.
    pub fn left(&self) -> u32 {
        self.bounces.saturating_sub(self.passed)
    }

    /// The sky, if it shines.
    pub(crate) fn sky(&self) -> Option<&Sunlight> {
        match &self.source {
            Illuminant::Sun(sun) if sun.sky > 0.0 => Some(sun),
            _ => None,
        }
    }
}

/// The linear red, green and blue of each pixel, row by row; none where nothing is seen. `progress` counts pixels.
/// `None` when cancelled.
pub fn picture(
    geometry: &impl Geometry,
    rays: &PixelRays,
    illumination: &Illumination,
    progress: &Progress,
) -> Option<Vec<Option<DVec3>>> {
    in_parallel(rays.pixel_count(), illumination.indirect.batch(), progress, |pixel| {
        let ray = rays.ray(pixel);
        geometry.nearest(&ray).map(|hit| radiance(geometry, &hit, ray.direction, pixel, illumination))
    })
}

/// The light that a hit sends back along the ray that arrives in `direction`. `pixel` chooses the paths of its indirect
/// light.
pub fn radiance(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    pixel: usize,
    illumination: &Illumination,
) -> DVec3 {
    let own = |share_left: f64| {
        direct(geometry, hit, direction, share_left, illumination)
            + indirect_beside(geometry, hit, direction, pixel, share_left, illumination)
    };
    let surface = Reflectance::new(hit, direction, illumination.left(), 1.0, illumination);
    if !surface.is_followed {
        return own(1.0);
    }
    let beyond = Illumination { passed: illumination.passed + 1, ..*illumination };
    let arriving_by = |ray: Option<Ray>, beyond: &Illumination| {
        let seen = ray.and_then(|ray| Some((met(geometry, hit, &ray)?, ray.direction)));
        let left = illumination.share_left(hit, seen.map(|(hit, _)| hit.distance));
        let light =
            seen.map_or(illumination.background, |(hit, direction)| radiance(geometry, &hit, direction, pixel, beyond));
        Arriving { light: light * left, left }
    };
    let mut sum = Arriving { light: DVec3::ZERO, left: 0.0 };
    let rays = mirror_rays(geometry, hit, direction, pixel, illumination);
    let count = rays.len() as f64;
    for MirrorRay { ray, seed, weight } in rays {
        if weight == 0.0 {
            // Below the surface there is nothing to see.
            sum.left += 1.0;
            continue;
        }
        // One path of indirect light, and one direction of each further glossy mirror, for each direction of a lobe.
        let of_lobe = |seed| Indirect { samples: illumination.indirect.samples.min(1), seed, ..illumination.indirect };
        let indirect = seed.map_or(illumination.indirect, of_lobe);
        let Arriving { light, left } = arriving_by(ray, &Illumination { indirect, ..beyond });
        (sum.light, sum.left) = (sum.light + light * weight, sum.left + left);
    }
    let mut arriving = sum.light / count;
    if illumination.passed == 0
        && let Some(ray) = through(geometry, hit, direction)
    {
        let reflected = hit.reflected_part(direction);
        arriving = arriving * reflected + arriving_by(Some(ray), &beyond).light * (1.0 - reflected);
    }
    own(sum.left / count) + surface.mirror * arriving
}

/// The light that arrives along a mirror's ray, as far as it has not faded, and the share that is left.
struct Arriving {
    light: DVec3,
    left: f64,
}

/// The name of the random numbers of glossy mirrors, which are not those of paths.
const GLOSSY: u64 = 1 << 40;

/// A ray of a mirror.
struct MirrorRay {
    /// `None` if the surface has no normal.
    ray: Option<Ray>,
    /// A seed of its own, if it is drawn by a lobe.
    seed: Option<u32>,
    /// How much of its light is reflected.
    weight: f64,
}

/// The rays over which what a mirror shows is the mean: of the first glossy mirror on the way as many directions as there
/// are paths of indirect light.
fn mirror_rays(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    pixel: usize,
    illumination: &Illumination,
) -> Vec<MirrorRay> {
    let is_first = illumination.passed == 0;
    let is_glossy = hit.specular_power > 0.0 && (is_first || hit.reflected_part(direction) >= 0.5);
    let Some(lobe) = illumination.lobe.filter(|_| is_glossy) else {
        let point = MirrorPoint { position: hit.position, normal: hit.normal, incoming: direction };
        let ray = if is_first { point.reflected() } else { stronger(geometry, hit, direction) };
        return vec![MirrorRay { ray, seed: None, weight: 1.0 }];
    };
    let Indirect { samples, seed, .. } = illumination.indirect;
    let mut numbers = Random::new([u64::from(seed), pixel as u64, GLOSSY]);
    let shift = [numbers.next(), numbers.next()];
    let ray = |sample: u32| {
        let mut numbers = Random::new([u64::from(seed), pixel as u64, GLOSSY + 1 + u64::from(sample)]);
        let first = spread(shift, sample);
        let (drawn, weight) = glossy_direction(lobe, hit, direction, illumination.mirror, first, &mut numbers);
        let seed = (numbers.next() * f64::from(u32::MAX)) as u32;
        MirrorRay { ray: Some(Ray::from_surface(hit.position, drawn)), seed: Some(seed), weight }
    };
    (0..samples.max(1)).map(ray).collect()
}

/// The mean share of what a mirror at `hit` reflects that is left, as [`radiance`] takes it.
pub(crate) fn mean_share_left(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    pixel: usize,
    illumination: &Illumination,
) -> f64 {
    if !illumination.fades(hit) || hit.specular_intensity <= 0.0 || illumination.left() == 0 {
        return 1.0;
    }
    let rays = mirror_rays(geometry, hit, direction, pixel, illumination);
    let count = rays.len() as f64;
    let left = |MirrorRay { ray, weight, .. }: MirrorRay| {
        let met = ray.filter(|_| weight > 0.0).and_then(|ray| met(geometry, hit, &ray));
        if weight > 0.0 { illumination.share_left(hit, met.map(|hit| hit.distance)) } else { 1.0 }
    };
    rays.into_iter().map(left).sum::<f64>() / count
}

/// The light that reaches a mirror point along the reflected ray.
fn reflected_light(geometry: &impl Geometry, point: &MirrorPoint, pixel: usize, illumination: &Illumination) -> DVec3 {
    let seen = point.reflected().and_then(|ray| Some((geometry.nearest(&ray)?, ray.direction)));
    let beyond = Illumination { passed: illumination.passed + 1, ..*illumination };
    seen.map_or(illumination.background, |(hit, direction)| radiance(geometry, &hit, direction, pixel, &beyond))
}

/// What mirrors of specular intensity 1 show at these points; the first reflection counts as one of
/// `illumination.bounces`. `progress` counts points. `None` when cancelled.
pub fn reflected_picture(
    geometry: &impl Geometry,
    points: &[MirrorPoint],
    illumination: &Illumination,
    progress: &Progress,
) -> Option<Vec<DVec3>> {
    in_parallel(points.len(), illumination.indirect.batch(), progress, |index| {
        reflected_light(geometry, &points[index], index, illumination)
    })
}

/// The light of the lights, the sun or the lamp that a hit sends back along the ray that arrives in `direction`: by its
/// diffuse part, by the remainder of it for a mirror whose reflection is followed, and by its highlight. `share_left` of
/// the reflection is left, which is 1 if reflections do not fade.
pub fn direct(
    geometry: &impl Geometry,
    hit: &Hit,
    direction: DVec3,
    share_left: f64,
    illumination: &Illumination,
) -> DVec3 {
    let surface = Reflectance::new(hit, direction, illumination.left(), share_left, illumination);
    let facing = |share: f64| 1.0 - share + share * direction.dot(hit.normal).abs().min(1.0);
    match illumination.source {
        Illuminant::Headlight(share) => surface.diffuse * facing(share),
        Illuminant::Lights(_) | Illuminant::Sun(_) => {
            let Fill { radiance, share } = illumination.fill;
            scattered(geometry, hit, &surface, illumination) + surface.diffuse * (radiance * facing(share))
        }
    }
}

/// The light of the lights or the sun that a surface at `hit` sends to the eye of `surface`, straight and over mirrors.
pub(crate) fn scattered(
    geometry: &impl Geometry,
    hit: &Hit,
    surface: &Reflectance,
    illumination: &Illumination,
) -> DVec3 {
    if !surface.scatters() {
        return DVec3::ZERO;
    }
    let shine = |to_light: DVec3, distance: f64, normal_irradiance: DVec3| {
        let cosine = to_light.dot(hit.normal);
        // The comparison is false for a light right on the surface (NaN).
        let is_lit = cosine > 0.0 && normal_irradiance != DVec3::ZERO;
        if is_lit && !geometry.is_blocked(&Ray::from_surface(hit.position, to_light), distance) {
            normal_irradiance * cosine * surface.scattering(to_light)
        } else {
            DVec3::ZERO
        }
    };
    let straight = match illumination.source {
        Illuminant::Lights(lights) => {
            let each = lights.iter().map(|light| {
                let to_light = light.position - hit.position;
                let distance = to_light.length();
                let direction = to_light / distance;
                shine(direction, distance, intensity(light, -direction) / (distance * distance))
            });
            each.sum()
        }
        Illuminant::Sun(sun) => shine(sun.direction, f64::INFINITY, DVec3::splat(sun.irradiance)),
        Illuminant::Headlight(_) => DVec3::ZERO,
    };
    let Some(caustics) = illumination.caustics.filter(|_| illumination.bounces > 0) else { return straight };
    // A mirror that is followed shows what shines on it over other mirrors as its reflection.
    let surface = surface.beside_reflection();
    straight + caustics.sum(hit, |to_light| surface.scattering(to_light))
}

/// The radiant intensity of a spot light in a direction.
pub(crate) fn intensity(light: &SpotLight, direction: DVec3) -> DVec3 {
    let axis = (light.target - light.position).normalize_or_zero();
    let angle = axis.cross(direction).length().atan2(axis.dot(direction)).to_degrees();
    let [inner, outer] = [light.inner_degrees, light.outer_degrees].map(f64::from);
    let share = if angle <= inner {
        1.0
    } else if angle < outer {
        (outer - angle) / (outer - inner)
    } else {
        0.0
    };
    DVec3::from(light.intensity.map(f64::from)) * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::{Albedo, Object};
    use crate::{Exact, mirrored, primary};
    use cloud::sampling::{Placement, Surface};
    use scene::five_mirrors::{self, Variant};
    use scene::{Highlight, ViewSettings};

    const ALBEDO: [f64; 3] = [0.8, 0.4, 0.2];

    /// A wall in z = `z`, from `x` on.
    fn wall(x: f64, z: f64, albedo: [f64; 3], specular_intensity: f64) -> Object {
        let surface = Surface::Rectangle { corner: DVec3::new(x, -5.0, z), edges: [DVec3::X * 10.0, DVec3::Y * 10.0] };
        Object::new(surface, Placement::ORIGIN, Albedo::Even(albedo), specular_intensity)
    }

    /// A light two above the middle of the wall in z = 0, straight down.
    fn light() -> SpotLight {
        SpotLight {
            position: DVec3::Z * 2.0,
            target: DVec3::ZERO,
            intensity: [10.0, 20.0, 30.0],
            inner_degrees: 20.0,
            outer_degrees: 40.0,
        }
    }

    fn seen_at(geometry: &Exact, x: f64) -> (Hit, DVec3) {
        let direction = (DVec3::X * x - DVec3::new(0.5, 0.0, 1.0)).normalize();
        (geometry.nearest(&Ray::from_eye(DVec3::new(0.5, 0.0, 1.0), direction)).unwrap(), direction)
    }

    /// The direct light of the diffuse part.
    fn direct_of(geometry: &Exact, hit: &Hit, lights: &[SpotLight]) -> DVec3 {
        let settings = MirrorSettings::default();
        direct(geometry, hit, -hit.normal, 1.0, &Illumination::new(Illuminant::Lights(lights), &settings))
    }

    #[test]
    fn direct_light_on_a_wall_is_that_of_the_closed_form() {
        let geometry = Exact::new(vec![wall(-5.0, 0.0, ALBEDO, 0.0)]);
        for degrees in [0.0_f64, 10.0, 19.9, 25.0, 30.0, 39.0, 41.0, 60.0] {
            let angle = degrees.to_radians();
            let (hit, _) = seen_at(&geometry, 2.0 * angle.tan());
            let falloff = ((40.0 - degrees) / 20.0).clamp(0.0, 1.0);
            // E = I cos / (h / cos)^2.
            let irradiance = DVec3::new(10.0, 20.0, 30.0) * falloff * angle.cos().powi(3) / 4.0;
            let expected = DVec3::from(ALBEDO) * irradiance / std::f64::consts::PI;
            let found = direct_of(&geometry, &hit, &[light()]);
            assert!(found.distance(expected) < 1e-12, "{degrees} degrees: {found} instead of {expected}");
        }
    }

    #[test]
    fn light_is_stopped_by_what_stands_in_between_and_shines_on_one_side() {
        // Shades x > 0.2 of the plane z = 1, so x > 0.4 of the wall.
        let geometry = Exact::new(vec![wall(-5.0, 0.0, ALBEDO, 0.0), wall(0.2, 1.5, ALBEDO, 0.0)]);
        let at = |x: f64| {
            let (hit, _) = seen_at(&geometry, x);
            direct_of(&geometry, &hit, &[light()])
        };
        assert!(at(0.39).x > 0.0 && at(0.81).x == 0.0);
        let (hit, _) = seen_at(&geometry, 0.1);
        assert_eq!(direct_of(&geometry, &Hit { normal: -hit.normal, ..hit }, &[light()]), DVec3::ZERO);
    }

    #[test]
    fn a_mirror_shows_its_share_of_the_reflected_light() {
        // The mirror at z = 0 reflects the wall at z = 3; one light shines on each.
        let geometry = Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], 0.6), wall(-5.0, 3.0, ALBEDO, 0.0)]);
        let lights = [SpotLight { target: DVec3::Z * 3.0, ..light() }, light()];
        let (hit, direction) = seen_at(&geometry, 0.3);
        let own = direct_of(&geometry, &hit, &lights);
        let wall = geometry.nearest(&Ray::from_surface(hit.position, mirrored(direction, DVec3::Z))).unwrap();
        assert!((wall.position.z - 3.0).abs() < 1e-12);
        let reflected = direct_of(&geometry, &wall, &lights);
        assert!(own.x > 0.0 && reflected.x > 0.0);
        let seen = |bounces, tint, fresnel| {
            let mirror = &MirrorSettings { tint, fresnel, ..MirrorSettings::default() };
            let illumination = Illumination { bounces, ..Illumination::new(Illuminant::Lights(&lights), mirror) };
            radiance(&geometry, &hit, direction, 0, &illumination)
        };
        let grazing = (1.0 + direction.z).powi(5);
        let share = 0.6 + 0.4 * grazing;
        for (found, expected, what) in [
            (seen(0, 0.0, 0.0), own, "after the last bounce"),
            (seen(1, 0.0, 0.0), 0.4 * own + 0.6 * reflected, "plain"),
            (seen(1, 1.0, 0.0), 0.4 * own + 0.6 * 0.5 * reflected, "tinted by its albedo of a half"),
            (seen(1, 0.0, 1.0), (1.0 - share) * own + share * reflected, "by Schlick's law"),
            (
                seen(1, 1.0, 1.0),
                (1.0 - share) * own + share * (1.0 - 0.5 * (1.0 - grazing)) * reflected,
                "tinted and by Schlick's law",
            ),
        ] {
            assert!(found.distance(expected) < 1e-12, "{what}: {found} instead of {expected}");
        }
    }

    #[test]
    fn a_lamp_at_the_eye_dims_what_is_seen_at_an_angle() {
        let geometry = Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], 1.0), wall(-5.0, 3.0, ALBEDO, 0.0)]);
        let (hit, direction) = seen_at(&geometry, 0.3);
        let seen = |lamp, bounces| {
            let mirror = &MirrorSettings::default();
            let illumination = Illumination { bounces, ..Illumination::new(Illuminant::Headlight(lamp), mirror) };
            radiance(&geometry, &hit, direction, 0, &illumination)
        };
        let cosine = -direction.z;
        for (share, lit) in [(0.0, 1.0), (0.5, 0.5 + 0.5 * cosine), (1.0, cosine)] {
            assert!(seen(share, 0).distance(DVec3::splat(0.5 * lit)) < 1e-12, "share {share}");
            // The ceiling is parallel to the mirror, so that the reflected ray meets it at the same angle.
            assert!(seen(share, 1).distance(DVec3::from(ALBEDO) * lit) < 1e-12, "reflected, share {share}");
        }
    }

    #[test]
    fn a_sun_lights_what_faces_it_and_is_not_in_the_shade() {
        // Shades x > 0.2 - 1.5 from straight above, shifted by the slope of the light.
        let geometry = Exact::new(vec![wall(-5.0, 0.0, ALBEDO, 0.0), wall(0.2, 1.5, ALBEDO, 0.0)]);
        let settings = MirrorSettings::default();
        let sun = Sun { azimuth: 90.0, elevation: 60.0, irradiance: 3.0, sky: 5.0 };
        let illumination = Illumination::new(Illuminant::Sun(Sunlight::new(&sun, DVec3::Z)), &settings);
        let at = |x: f64| {
            let (hit, direction) = seen_at(&geometry, x);
            direct(&geometry, &hit, direction, 1.0, &illumination)
        };
        let expected = DVec3::from(ALBEDO) * 3.0 * 60.0_f64.to_radians().sin() / std::f64::consts::PI;
        // The shadow's edge is 1.5 / tan 60 degrees west of the edge that casts it.
        let edge = 0.2 - 1.5 / 60.0_f64.to_radians().tan();
        assert!(at(edge - 1e-6).distance(expected) < 1e-7, "{} {expected}", at(edge - 1e-6));
        assert_eq!(at(edge + 1e-6), DVec3::ZERO);
        let low = Sunlight::new(&Sun { elevation: 0.0, ..sun }, DVec3::Y);
        assert!(low.direction.distance(DVec3::X) < 1e-7 && low.up == DVec3::Y);
    }

    #[test]
    fn highlights_are_added_to_diffuse_light_and_to_reflections() {
        let light = SpotLight { position: DVec3::new(-0.3, 0.0, 1.0), ..light() };
        let wall_of = |specular_intensity| {
            Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], specular_intensity).with_specular_power(40.0)])
        };
        let seen_by = |factor, specular_intensity, tint, gloss, bounces| {
            let geometry = wall_of(specular_intensity);
            let (hit, direction) = seen_at(&geometry, 0.1);
            let mirror = &MirrorSettings { tint, ..MirrorSettings::default() };
            let gloss = Gloss { share: gloss, power: 40.0, shape: Highlight::Phong };
            let lights = [light];
            let illumination = Illumination {
                gloss,
                diffuse: factor,
                bounces,
                ..Illumination::new(Illuminant::Lights(&lights), mirror)
            };
            radiance(&geometry, &hit, direction, 0, &illumination)
        };
        let seen = |specular_intensity, tint, gloss, bounces| seen_by(1.0, specular_intensity, tint, gloss, bounces);
        let (at, to_light) = (DVec3::X * 0.1, light.position - DVec3::X * 0.1);
        let to_eye = (DVec3::new(0.5, 0.0, 1.0) - at).normalize();
        let irradiance = DVec3::new(10.0, 20.0, 30.0) * to_light.normalize().z / to_light.length_squared();
        let cosine = (-mirrored(to_light.normalize(), DVec3::Z)).dot(to_eye);
        let lobe = irradiance * 42.0 / std::f64::consts::TAU * cosine.powi(40);
        let diffuse = irradiance * 0.5 / std::f64::consts::PI;
        assert!(lobe.x > 0.5 * diffuse.x);
        for (found, expected, what) in [
            (seen(0.0, 0.0, 0.0, 1), diffuse, "no gloss"),
            (seen(0.0, 0.0, 0.3, 1), 0.7 * diffuse + 0.3 * lobe, "gloss"),
            (seen(0.0, 1.0, 0.3, 1), 0.7 * diffuse + 0.15 * lobe, "tinted gloss"),
            (seen_by(2.0, 0.0, 0.0, 0.3, 1), 1.4 * diffuse + 0.3 * lobe, "gloss and a factor of diffuse light"),
            (seen_by(2.0, 0.6, 0.0, 0.3, 1), 0.8 * diffuse + 0.6 * lobe, "a mirror with a factor of diffuse light"),
            (seen(-0.2, 0.0, 0.3, 1), 0.8 * diffuse + 0.2 * lobe, "a gloss of its own"),
            (seen(0.6, 0.0, 0.3, 1), 0.4 * diffuse + 0.6 * lobe, "a mirror of nothing"),
            (seen(0.6, 1.0, 0.3, 0), diffuse + 0.3 * lobe, "a mirror that is not followed, tinted"),
        ] {
            assert!(found.distance(expected) < 1e-12, "{what}: {found} instead of {expected}");
        }
    }

    #[test]
    fn a_glossy_mirror_shows_the_mean_over_its_lobe() {
        // A floor that mirrors, below a far ceiling that is bright on one side of x = 0 and dark on the other.
        let ceiling = |x: f64, albedo: f64| {
            let corner = DVec3::new(x, -1e5, 1.0);
            let surface = Surface::Rectangle { corner, edges: [DVec3::X * 1e5, DVec3::Y * 2e5] };
            Object::new(surface, Placement::ORIGIN, Albedo::Even([albedo; 3]), 0.0)
        };
        let mirror = |power| wall(-5.0, 0.0, [0.5; 3], 1.0).with_specular_power(power);
        let settings = MirrorSettings::default();
        let seen = |power: f64, x: f64, lobe, samples, left: f64| {
            let geometry = Exact::new(vec![mirror(power), ceiling(-1e5, left), ceiling(0.0, 1.0)]);
            let (eye, at) = (DVec3::new(x, -0.5, 0.7), DVec3::new(x, 0.0, 0.0));
            let direction = (at - eye).normalize();
            let hit = geometry.nearest(&Ray::from_eye(eye, direction)).unwrap();
            let indirect = Indirect { bounces: 0, samples, seed: 3 };
            let illumination =
                Illumination { bounces: 1, lobe, indirect, ..Illumination::new(Illuminant::Headlight(0.0), &settings) };
            radiance(&geometry, &hit, direction, 5, &illumination).x
        };
        for shape in [Highlight::Phong, Highlight::Blinn] {
            let lobe = Some(Lobe::Even(shape));
            for power in [5.0, 50.0, 1000.0] {
                // An even surrounding is reflected evenly; half of the rays see the bright half.
                assert!((seen(power, 0.3, lobe, 9, 1.0) - 1.0).abs() < 1e-12);
                let half = seen(power, 0.0, lobe, 4096, 0.0);
                assert!((half - 0.5).abs() < 0.01, "{shape:?} {power}: {half}");
            }
            // A perfect mirror sees one of them, and so does one of a very high power, or one without a lobe.
            for (power, lobe) in [(0.0, lobe), (1e9, lobe), (50.0, None)] {
                assert_eq!([-0.3, 0.3].map(|x| seen(power, x, lobe, 64, 0.0)), [0.0, 1.0]);
            }
        }
        // Phong's lobe of a power of 1 has a density of cos / pi about the reflected ray: of a bright ceiling from `edge`
        // on, which a ray straight up sees, the share (1 + sin) / 2 of the angle to the edge.
        let geometry = Exact::new(vec![mirror(1.0), ceiling(0.0, 1.0)]);
        let at = DVec3::new(-0.8, 0.0, 0.0);
        let hit = geometry.nearest(&Ray::from_eye(at + DVec3::Z * 0.5, -DVec3::Z)).unwrap();
        let indirect = Indirect { bounces: 0, samples: 1 << 14, seed: 3 };
        let illumination = Illumination {
            bounces: 1,
            lobe: Some(Lobe::Even(Highlight::Phong)),
            indirect,
            ..Illumination::new(Illuminant::Headlight(0.0), &settings)
        };
        let found = radiance(&geometry, &hit, -DVec3::Z, 5, &illumination).x;
        let expected = 0.5 * (1.0 - 0.8 / 0.8_f64.hypot(1.0));
        assert!((found - expected).abs() < 3e-3, "{found} instead of {expected}");
    }

    #[test]
    fn mirrors_show_the_background_where_nothing_is() {
        let geometry = Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], 1.0)]);
        let (hit, direction) = seen_at(&geometry, 0.3);
        let background = DVec3::new(0.1, 0.2, 0.3);
        let settings = MirrorSettings::default();
        let illumination =
            Illumination { bounces: 2, background, ..Illumination::new(Illuminant::Lights(&[]), &settings) };
        assert_eq!(radiance(&geometry, &hit, direction, 0, &illumination), background);
    }

    #[test]
    fn mirror_points_show_what_the_picture_shows() {
        let rays = PixelRays::new(&five_mirrors::camera(), &ViewSettings::default(), [64, 48], 0.0);
        let geometry = Exact::five_mirrors(Variant::Torus);
        let settings = MirrorSettings::default();
        let lights = [five_mirrors::light()];
        let illumination = Illumination { bounces: 3, ..Illumination::new(Illuminant::Lights(&lights), &settings) };
        let none = Progress::default();
        let (colors, seen) = (picture(&geometry, &rays, &illumination, &none), primary(&geometry, &rays, &none));
        let (mut points, mut expected) = (Vec::new(), Vec::new());
        for (pixel, (color, hit)) in colors.unwrap().into_iter().zip(seen.unwrap()).enumerate() {
            if let Some(hit) = hit.filter(|hit| hit.specular_intensity > 0.0) {
                let incoming = rays.ray(pixel).direction;
                points.push(MirrorPoint { position: hit.position, normal: hit.normal, incoming });
                // The lamp's highlight is added.
                expected.push(color.unwrap() - direct(&geometry, &hit, incoming, 1.0, &illumination));
            }
        }
        let found = reflected_picture(&geometry, &points, &illumination, &none).unwrap();
        assert!(found.iter().filter(|color| color.x > 0.0).count() > 10);
        assert!(found.iter().zip(&expected).all(|(a, b)| a.distance(*b) < 1e-12));
    }
}
