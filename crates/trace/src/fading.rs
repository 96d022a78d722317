//! Reflections that fade by distance (`mirror.fade_distance`; Popescu, Sacks and Mei 2006).
//!
//! The definition, which is the renderer's. What a mirror's ray meets at the distance r keeps the share
//! m + (1 - m) (1 - min(r / d, 1))^2 of its reflection, where m is `mirror.fade_least` and d is `mirror.fade_distance`
//! times the mirror's radius: half the diagonal of the box about its points. Where nothing is met, m is left. A place
//! belongs to the mirror whose box is nearest to it, and among boxes that hold it to the smallest. Clear surfaces do not
//! fade. What is taken from the reflection is the mirror's own diffuse light; of several rays it is their mean.

use cloud::Bounds;
use glam::DVec3;

use crate::Hit;
use crate::light::Illumination;

impl Illumination<'_> {
    /// Whether the reflections of the mirror at `hit` fade.
    pub(crate) fn fades(&self, hit: &Hit) -> bool {
        self.mirror.fade_distance > 0.0 && hit.medium.is_none()
    }

    /// The share of a reflection that is left whose ray leaves the mirror at `hit` and meets something at `distance`.
    pub(crate) fn share_left(&self, hit: &Hit, distance: Option<f64>) -> f64 {
        if !self.fades(hit) {
            return 1.0;
        }
        let least = f64::from(self.mirror.fade_least);
        let reach = f64::from(self.mirror.fade_distance) * radius_at(self.mirror_boxes, hit.position);
        let rest = distance.map_or(0.0, |distance| (1.0 - distance / reach).max(0.0));
        least + (1.0 - least) * rest * rest
    }
}

/// The radius of the mirror to which a place belongs; 0 without mirrors.
fn radius_at(boxes: &[Bounds], place: DVec3) -> f64 {
    let key = |bounds: &Bounds| {
        let outside = (bounds.min - place).max(place - bounds.max).max(DVec3::ZERO);
        [outside.length_squared(), bounds.radius()]
    };
    let nearer = |[a, b]: &[f64; 2], [c, d]: &[f64; 2]| a.total_cmp(c).then(b.total_cmp(d));
    boxes.iter().map(key).min_by(nearer).map_or(0.0, |[_, radius]| radius)
}

#[cfg(test)]
mod tests {
    use cloud::sampling::{Placement, Surface};
    use scene::{FresnelLaw, Highlight, MirrorSettings};

    use super::*;
    use crate::exact::{Albedo, Object};
    use crate::{Exact, Geometry as _, Illuminant, Indirect, Lobe, Ray, mirrored, radiance};

    const ALBEDO: [f64; 3] = [0.8, 0.4, 0.2];

    /// The box of a mirror that is a wall.
    const BOXES: [Bounds; 1] = [Bounds { min: DVec3::new(-5.0, -5.0, 0.0), max: DVec3::new(5.0, 5.0, 0.0) }];

    /// A wall in z = `z`, 10 wide.
    fn wall(z: f64, albedo: [f64; 3], specular_intensity: f64) -> Object {
        let surface =
            Surface::Rectangle { corner: DVec3::new(-5.0, -5.0, z), edges: [DVec3::X * 10.0, DVec3::Y * 10.0] };
        Object::new(surface, Placement::ORIGIN, Albedo::Even(albedo), specular_intensity)
    }

    fn seen_at(geometry: &Exact, x: f64) -> (Hit, DVec3) {
        let eye = DVec3::new(0.5, 0.0, 0.5);
        let direction = (DVec3::X * x - eye).normalize();
        (geometry.nearest(&Ray::from_eye(eye, direction)).unwrap(), direction)
    }

    /// The surfaces' own colours.
    fn illumination(settings: &MirrorSettings) -> Illumination<'_> {
        Illumination { bounces: 1, mirror_boxes: &BOXES, ..Illumination::new(Illuminant::Headlight(0.0), settings) }
    }

    #[test]
    fn a_place_belongs_to_the_nearest_box_and_to_the_smallest_that_holds_it() {
        let cube =
            |middle: f64, half: f64| Bounds { min: DVec3::splat(middle - half), max: DVec3::splat(middle + half) };
        let boxes = [cube(0.0, 2.0), cube(1.0, 0.5), cube(9.0, 1.0)];
        for (place, half) in [(0.0, 2.0), (1.2, 0.5), (4.5, 2.0), (6.5, 1.0), (100.0, 1.0)] {
            let found = radius_at(&boxes, DVec3::splat(place));
            assert!((found - half * 3.0_f64.sqrt()).abs() < 1e-12, "{place}: {found}");
        }
        assert_eq!(radius_at(&[], DVec3::ZERO), 0.0);
    }

    #[test]
    fn reflections_fade_by_the_square_of_what_is_left_of_the_way() {
        // The mirror at z = 0 is 10 wide and shows the wall at z = 3, or the background.
        let mirror = wall(0.0, [0.5; 3], 0.6);
        let [below, open] = [vec![mirror.clone(), wall(3.0, ALBEDO, 0.0)], vec![mirror]].map(Exact::new);
        let (hit, direction) = seen_at(&below, 0.3);
        let met = below.nearest(&Ray::from_surface(hit.position, mirrored(direction, DVec3::Z))).unwrap();
        let (own, reflected) = (DVec3::splat(0.5), DVec3::from(ALBEDO));
        let background = DVec3::new(0.1, 0.2, 0.3);
        let seen = |geometry: &Exact, fade_distance, fade_least| {
            let settings = &MirrorSettings { fade_distance, fade_least, ..MirrorSettings::default() };
            let illumination = Illumination { background, ..illumination(settings) };
            radiance(geometry, &hit, direction, 0, &illumination)
        };
        assert!(met.distance > 3.0 && met.distance < 5.0 * 2.0_f64.sqrt());
        for fade_distance in [0.1_f32, 0.4, 0.5, 1.0, 10.0] {
            for least in [0.0_f32, 0.25, 1.0] {
                let reach = f64::from(fade_distance) * 5.0 * 2.0_f64.sqrt();
                let rest = (1.0 - met.distance / reach).max(0.0).powi(2);
                assert_eq!(rest == 0.0, fade_distance < 0.45);
                let share = 0.6 * (f64::from(least) + (1.0 - f64::from(least)) * rest);
                let expected = (1.0 - share) * own + share * reflected;
                let found = seen(&below, fade_distance, least);
                assert!(found.distance(expected) < 1e-12, "{fade_distance} {least}: {found} instead of {expected}");
                // Where nothing is met, the least is left.
                let share = 0.6 * f64::from(least);
                let expected = (1.0 - share) * own + share * background;
                let found = seen(&open, fade_distance, least);
                assert!(found.distance(expected) < 1e-12, "{fade_distance} {least}: {found} instead of {expected}");
            }
        }
        assert_eq!(seen(&below, 0.0, 0.7), seen(&below, 0.0, 0.0), "0 fades nothing");
    }

    #[test]
    fn a_glossy_mirror_fades_ray_by_ray_and_clear_ones_never() {
        // All that the mirror shows is as bright as itself, whatever is left of it.
        let mirror = || wall(0.0, [0.5; 3], 0.8).with_specular_power(5.0);
        let even = Exact::new(vec![mirror(), wall(3.0, [0.5; 3], 0.0)]);
        let (hit, direction) = seen_at(&even, 0.3);
        let seen = |geometry: &Exact, hit: &Hit, fade_distance, fade_least, background: f64| {
            let settings = &MirrorSettings { fade_distance, fade_least, ..MirrorSettings::default() };
            let illumination = Illumination {
                background: DVec3::splat(background),
                lobe: Some(Lobe::Even(Highlight::Phong)),
                indirect: Indirect { bounces: 0, samples: 1024, seed: 3 },
                ..illumination(settings)
            };
            radiance(geometry, hit, direction, 0, &illumination).x
        };
        for fade_distance in [0.0, 0.6, 2.0] {
            assert!((seen(&even, &hit, fade_distance, 0.1, 0.5) - 0.5).abs() < 1e-9);
        }
        // Of what is brighter less is left the shorter the reach is, and the least where nothing is met.
        let bright = Exact::new(vec![mirror(), wall(3.0, [1.0; 3], 0.0)]);
        let [full, faded, least] =
            [(0.0, 0.25), (1.0, 0.25), (0.01, 0.25)].map(|(d, m)| seen(&bright, &hit, d, m, 1.0));
        assert!((full - 0.9).abs() < 1e-9 && (least - 0.6).abs() < 1e-7, "{full} {least}");
        assert!(0.62 < faded && faded < 0.85, "{faded}");
        let alone = Exact::new(vec![mirror()]);
        assert!((seen(&alone, &hit, 1.0, 0.25, 3.0) - (0.8 * 0.5 + 0.2 * 3.0)).abs() < 1e-7);
        let glass = Exact::new(vec![wall(0.0, [0.5; 3], 0.8).with_refraction(1.5), wall(3.0, ALBEDO, 0.0)]);
        let (hit, _) = seen_at(&glass, 0.3);
        assert_eq!(seen(&glass, &hit, 0.1, 0.0, 0.2), seen(&glass, &hit, 0.0, 0.0, 0.2));
    }

    #[test]
    fn the_published_law_reflects_less_the_flatter_a_mirror_is_seen() {
        let geometry = Exact::new(vec![wall(0.0, [0.5; 3], 0.8), wall(3.0, [1.0; 3], 0.0)]);
        for x in [0.5, 0.3, 0.0, -0.2] {
            let (hit, direction) = seen_at(&geometry, x);
            let seen = |fresnel, tint, fade_distance| {
                let fresnel_law = FresnelLaw::Published;
                let settings =
                    &MirrorSettings { fresnel, tint, fresnel_law, fade_distance, ..MirrorSettings::default() };
                radiance(&geometry, &hit, direction, 0, &illumination(settings)).x
            };
            let squared = direction.z * direction.z;
            for (fresnel, share) in [(0.0, 0.8), (0.5, 0.4 + 0.4 * squared), (1.0, 0.8 * squared)] {
                let expected = (1.0 - share) * 0.5 + share;
                assert!((seen(fresnel, 0.0, 0.0) - expected).abs() < 1e-12, "{x} {fresnel}");
                // The tint does not depend on the angle.
                assert!((seen(fresnel, 1.0, 0.0) - 0.5).abs() < 1e-12, "{x} {fresnel}");
                // The two effects together: the one fades what the other leaves.
                let share = share * (1.0 - -3.0 / direction.z / (10.0 * 2.0_f64.sqrt())).powi(2);
                let expected = (1.0 - share) * 0.5 + share;
                assert!((seen(fresnel, 0.0, 2.0) - expected).abs() < 1e-7, "{x} {fresnel}");
            }
        }
    }
}
