//! Light: spot lights with shadows on Lambertian surfaces, or a lamp at the eye, blended with what mirrors reflect.
//!
//! The definition, which is the renderer's: a diffuse surface sends out albedo / pi times its irradiance. A mirror shows its
//! share (the specular intensity, and more by Fresnel's law as far as `scene::MirrorSettings` asks for it) of what arrives along
//! the reflected ray, tinted by its albedo as far as asked for, and for the rest its diffuse light. After the last bounce a mirror
//! is a diffuse surface. Where a reflected ray sees nothing, it sees the background.

use std::f64::consts::FRAC_1_PI;

use cloud::Progress;
use glam::DVec3;
use scene::{MirrorSettings, SpotLight};

use crate::reflection::in_parallel;
use crate::{Geometry, Hit, MirrorPoint, PixelRays, Ray};

/// What lights a scene, and how far reflections are followed.
#[derive(Clone, Copy, Debug)]
pub struct Illumination<'a> {
    pub lights: &'a [SpotLight],
    /// Instead of the lights: a lamp at the eye, or at the mirror point that sees a surface, whose share (0 to 1) of the picture
    /// falls with the angle that a surface is seen at; at 0 surfaces show their own colours.
    pub lamp: Option<f64>,
    /// Mirrors that a ray is followed over.
    pub bounces: u32,
    pub mirror: &'a MirrorSettings,
    /// What mirrors show where nothing is, linear.
    pub background: DVec3,
}

/// Linear red, green and blue of each pixel, row by row; none where nothing is seen. `progress` counts pixels. `None` when
/// cancelled.
pub fn picture(
    geometry: &impl Geometry,
    rays: &PixelRays,
    illumination: &Illumination,
    progress: &Progress,
) -> Option<Vec<Option<DVec3>>> {
    in_parallel(rays.pixel_count(), progress, |pixel| {
        let ray = rays.ray(pixel);
        geometry.nearest(&ray).map(|hit| radiance(geometry, &hit, ray.direction, illumination))
    })
}

/// Light that a hit sends back along the ray that arrives in `direction`.
pub fn radiance(geometry: &impl Geometry, hit: &Hit, direction: DVec3, illumination: &Illumination) -> DVec3 {
    let Illumination { bounces, mirror, .. } = *illumination;
    if bounces == 0 || hit.specular_intensity <= 0.0 {
        return diffuse(geometry, hit, direction, illumination);
    }
    // Schlick 1994: all of it is reflected, without a tint, the flatter the ray.
    let flatness = (1.0 - direction.dot(hit.normal).abs()).clamp(0.0, 1.0);
    let grazing = f64::from(mirror.fresnel) * flatness.powi(5);
    let share = hit.specular_intensity + (1.0 - hit.specular_intensity) * grazing;
    let tint = DVec3::ONE.lerp(hit.albedo, f64::from(mirror.tint) * (1.0 - grazing));
    let point = MirrorPoint { position: hit.position, normal: hit.normal, incoming: direction };
    let reflected = tint * reflected_light(geometry, &point, illumination);
    let own = if share < 1.0 { diffuse(geometry, hit, direction, illumination) } else { DVec3::ZERO };
    own.lerp(reflected, share)
}

/// Light of a hit's diffuse part, seen along `direction`.
fn diffuse(geometry: &impl Geometry, hit: &Hit, direction: DVec3, illumination: &Illumination) -> DVec3 {
    match illumination.lamp {
        None => direct(geometry, hit, illumination.lights),
        Some(share) => hit.albedo * (1.0 - share + share * direction.dot(hit.normal).abs().min(1.0)),
    }
}

/// Light that reaches a mirror point along the reflected ray.
fn reflected_light(geometry: &impl Geometry, point: &MirrorPoint, illumination: &Illumination) -> DVec3 {
    let seen = point.reflected().and_then(|ray| Some((geometry.nearest(&ray)?, ray.direction)));
    let beyond = Illumination { bounces: illumination.bounces.saturating_sub(1), ..*illumination };
    seen.map_or(illumination.background, |(hit, direction)| radiance(geometry, &hit, direction, &beyond))
}

/// What mirrors of specular intensity 1 show at these points, the first reflection included in `illumination.bounces`. `progress`
/// counts points. `None` when cancelled.
pub fn reflected_picture(
    geometry: &impl Geometry,
    points: &[MirrorPoint],
    illumination: &Illumination,
    progress: &Progress,
) -> Option<Vec<DVec3>> {
    in_parallel(points.len(), progress, |index| reflected_light(geometry, &points[index], illumination))
}

/// Light that the lights reach a hit's diffuse part with and that it sends out, whatever share of it is diffuse.
pub fn direct(geometry: &impl Geometry, hit: &Hit, lights: &[SpotLight]) -> DVec3 {
    let irradiance: DVec3 = lights
        .iter()
        .map(|light| {
            let to_light = light.position - hit.position;
            let distance = to_light.length();
            let direction = to_light / distance;
            let cosine = direction.dot(hit.normal);
            let intensity = intensity(light, -direction);
            // Written so that a light right on the surface (NaN) gives none.
            let is_lit = cosine > 0.0 && intensity != DVec3::ZERO;
            if is_lit && !geometry.is_blocked(&Ray::from_surface(hit.position, direction), distance) {
                intensity * (cosine / (distance * distance))
            } else {
                DVec3::ZERO
            }
        })
        .sum();
    hit.albedo * irradiance * FRAC_1_PI
}

/// Radiant intensity of a spot light in a direction.
fn intensity(light: &SpotLight, direction: DVec3) -> DVec3 {
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
    use scene::ViewSettings;
    use scene::five_mirrors::{self, Variant};

    const ALBEDO: [f64; 3] = [0.8, 0.4, 0.2];

    /// In z = `z`, x from `x` on.
    fn wall(x: f64, z: f64, albedo: [f64; 3], specular_intensity: f64) -> Object {
        let surface = Surface::Rectangle { corner: DVec3::new(x, -5.0, z), edges: [DVec3::X * 10.0, DVec3::Y * 10.0] };
        Object::new(surface, Placement::ORIGIN, Albedo::Even(albedo), specular_intensity)
    }

    /// Two above the middle of the wall in z = 0, straight down.
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
            let found = direct(&geometry, &hit, &[light()]);
            assert!(found.distance(expected) < 1e-12, "{degrees} degrees: {found} instead of {expected}");
        }
    }

    #[test]
    fn light_is_stopped_by_what_stands_in_between_and_shines_on_one_side() {
        // Shades x > 0.2 of the plane z = 1, so x > 0.4 of the wall.
        let geometry = Exact::new(vec![wall(-5.0, 0.0, ALBEDO, 0.0), wall(0.2, 1.5, ALBEDO, 0.0)]);
        let at = |x: f64| {
            let (hit, _) = seen_at(&geometry, x);
            direct(&geometry, &hit, &[light()])
        };
        assert!(at(0.39).x > 0.0 && at(0.81).x == 0.0);
        let (hit, _) = seen_at(&geometry, 0.1);
        assert_eq!(direct(&geometry, &Hit { normal: -hit.normal, ..hit }, &[light()]), DVec3::ZERO);
    }

    #[test]
    fn a_mirror_shows_its_share_of_the_reflected_light() {
        // The mirror at z = 0 reflects the wall at z = 3; one light shines on each.
        let geometry = Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], 0.6), wall(-5.0, 3.0, ALBEDO, 0.0)]);
        let lights = [SpotLight { target: DVec3::Z * 3.0, ..light() }, light()];
        let (hit, direction) = seen_at(&geometry, 0.3);
        let own = direct(&geometry, &hit, &lights);
        let wall = geometry.nearest(&Ray::from_surface(hit.position, mirrored(direction, DVec3::Z))).unwrap();
        assert!((wall.position.z - 3.0).abs() < 1e-12);
        let reflected = direct(&geometry, &wall, &lights);
        assert!(own.x > 0.0 && reflected.x > 0.0);
        let seen = |bounces, tint, fresnel| {
            let mirror = &MirrorSettings { tint, fresnel, ..MirrorSettings::default() };
            let illumination = Illumination { lights: &lights, lamp: None, bounces, mirror, background: DVec3::ONE };
            radiance(&geometry, &hit, direction, &illumination)
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
            let illumination =
                Illumination { lights: &[light()], lamp: Some(lamp), bounces, mirror, background: DVec3::ONE };
            radiance(&geometry, &hit, direction, &illumination)
        };
        let cosine = -direction.z;
        for (share, lit) in [(0.0, 1.0), (0.5, 0.5 + 0.5 * cosine), (1.0, cosine)] {
            assert!(seen(share, 0).distance(DVec3::splat(0.5 * lit)) < 1e-12, "share {share}");
            // The ceiling is parallel to the mirror, so that the reflected ray meets it at the same angle.
            assert!(seen(share, 1).distance(DVec3::from(ALBEDO) * lit) < 1e-12, "reflected, share {share}");
        }
    }

    #[test]
    fn mirrors_show_the_background_where_nothing_is() {
        let geometry = Exact::new(vec![wall(-5.0, 0.0, [0.5; 3], 1.0)]);
        let (hit, direction) = seen_at(&geometry, 0.3);
        let background = DVec3::new(0.1, 0.2, 0.3);
        let illumination =
            Illumination { lights: &[], lamp: None, bounces: 2, mirror: &MirrorSettings::default(), background };
        assert_eq!(radiance(&geometry, &hit, direction, &illumination), background);
    }

    #[test]
    fn mirror_points_show_what_the_picture_shows() {
        let rays = PixelRays::new(&five_mirrors::camera(), &ViewSettings::default(), [64, 48], 0.0);
        let geometry = Exact::five_mirrors(Variant::Torus);
        let settings = MirrorSettings::default();
        let lights = [five_mirrors::light()];
        let illumination =
            Illumination { lights: &lights, lamp: None, bounces: 3, mirror: &settings, background: DVec3::ZERO };
        let none = Progress::default();
        let (colors, seen) = (picture(&geometry, &rays, &illumination, &none), primary(&geometry, &rays, &none));
        let (mut points, mut expected) = (Vec::new(), Vec::new());
        for (pixel, (color, hit)) in colors.unwrap().into_iter().zip(seen.unwrap()).enumerate() {
            if let Some(Hit { position, normal, .. }) = hit.filter(|hit| hit.specular_intensity > 0.0) {
                points.push(MirrorPoint { position, normal, incoming: rays.ray(pixel).direction });
                expected.push(color.unwrap());
            }
        }
        let found = reflected_picture(&geometry, &points, &illumination, &none).unwrap();
        assert!(found.iter().filter(|color| color.x > 0.0).count() > 10);
        assert!(found.iter().zip(&expected).all(|(a, b)| a.distance(*b) < 1e-12));
    }
}
