//! What surfaces do with light that arrives: Lambert's law, highlights, and a mirror's share.
//!
//! The definition, which is the renderer's. Radiance that is sent out over irradiance is albedo / pi of the diffuse part. Of the
//! highlight it is a lobe of power p: (p + 2) / (2 pi) cos^p of the angle to the mirrored direction (Phong 1975, scaled as by
//! Lafortune and Willems 1994), or (p + 2)(p + 4) / (8 pi (2^(-p/2) + p)) cos^p of the angle between the normal and the
//! direction halfway (Blinn 1977, scaled by its integral for light along the normal). Neither sends out more than arrives.
//!
//! Surfaces that are no mirrors split their light between the two by [`Gloss`], or by a share and a power of their own. A mirror shows its share (the specular
//! intensity, and more or less by a law of the angle as far as `scene::MirrorSettings` asks for it, and less by the distance of
//! what is reflected, see fading.rs) of what arrives along the reflected ray, tinted by its albedo as far as asked for, for the
//! rest its diffuse part, and a highlight of lights on top. After the last
//! reflection that is followed a mirror is a diffuse surface with a highlight. A factor of all diffuse light is 1 unless asked for.

use std::f64::consts::{FRAC_1_PI, PI, TAU};

use glam::DVec3;
use scene::{Highlight, LastMirror};

use crate::light::{Illuminant, Illumination};
use crate::share::mirror_share;
use crate::{Hit, mirrored};

/// The highlights of surfaces that are no mirrors, and the shape of all highlights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gloss {
    /// The share of the light that the highlight takes from the diffuse part, 0 to 1.
    pub share: f64,
    pub power: f64,
    pub shape: Highlight,
}

impl Gloss {
    pub const NONE: Self = Self { share: 0.0, power: 1.0, shape: Highlight::Phong };
}

/// A surface point as one viewer sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reflectance {
    normal: DVec3,
    to_eye: DVec3,
    /// The share of light that is sent out diffusely.
    pub diffuse: DVec3,
    /// The largest share that the highlight sends out; 0 without one.
    gloss: DVec3,
    power: f64,
    shape: Highlight,
    /// The share of the light that arrives along the reflected ray; 0 where no reflection is followed.
    pub mirror: DVec3,
    /// Whether a reflection is followed.
    pub is_followed: bool,
}

/// A direction from which light may come.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Incoming {
    /// The unit vector away from the surface.
    pub direction: DVec3,
    /// The weight of the radiance from there in the mean over all samples.
    pub weight: DVec3,
}

impl Reflectance {
    /// The reflectance at a hit of a ray that arrives in `direction`, and may continue over `reflections` mirrors. If
    /// reflections fade, `share_left` of this one is left.
    pub fn new(hit: &Hit, direction: DVec3, reflections: u32, share_left: f64, illumination: &Illumination) -> Self {
        let settings = illumination.mirror;
        let Gloss { share: gloss, power, shape } = illumination.gloss;
        let tint = |grazing: f64| DVec3::ONE.lerp(hit.albedo, f64::from(settings.tint) * (1.0 - grazing));
        let is_followed = hit.specular_intensity > 0.0 && reflections > 0;
        // The eye's own surface is no mirror's picture.
        let is_dark = !is_followed && illumination.bounces > 0 && settings.last == LastMirror::Dark;
        let (mut diffuse, mut gloss, mut power, mut mirror) = (1.0 - gloss, gloss, power, DVec3::ZERO);
        if hit.specular_intensity > 0.0 {
            (diffuse, gloss, power) = (1.0, hit.specular_intensity, hit.specular_power);
            if is_followed || is_dark {
                let (share, grazing) = mirror_share(hit.specular_intensity, direction.dot(hit.normal).abs(), settings);
                let share = share * share_left;
                diffuse = 1.0 - share;
                mirror = if is_dark { DVec3::ZERO } else { share * tint(grazing) };
            }
        } else if hit.specular_intensity < 0.0 && hit.specular_power > 0.0 {
            (diffuse, gloss, power) = (1.0 + hit.specular_intensity, -hit.specular_intensity, hit.specular_power);
        }
        if !matches!(illumination.source, Illuminant::Headlight(_)) {
            diffuse *= illumination.diffuse;
        } else if hit.specular_intensity <= 0.0 {
            // A lamp at the eye shows the data's own colours.
            (diffuse, gloss) = (1.0, 0.0);
        }
        // A perfect mirror shows no lamp without size.
        let gloss = if power > 0.0 { gloss * tint(0.0) } else { DVec3::ZERO };
        let diffuse = diffuse * hit.albedo;
        Self { normal: hit.normal, to_eye: -direction, diffuse, gloss, power, shape, mirror, is_followed }
    }

    /// The reflectance without the highlight if the reflected ray replaces it.
    pub fn beside_reflection(self) -> Self {
        if self.is_followed { self.without_highlight() } else { self }
    }

    pub fn without_highlight(self) -> Self {
        Self { gloss: DVec3::ZERO, ..self }
    }

    /// Whether light is sent out that did not arrive along the reflected ray.
    pub fn scatters(&self) -> bool {
        self.scattered() > 0.0
    }

    /// The largest share of light, over the colours, that the diffuse part and the highlight send out.
    pub fn scattered(&self) -> f64 {
        self.diffuse.max_element() + self.gloss.max_element()
    }

    /// The radiance toward the eye per irradiance by light from `to_light`, a unit vector.
    pub fn scattering(&self, to_light: DVec3) -> DVec3 {
        let lobe = if self.gloss == DVec3::ZERO { 0.0 } else { self.lobe(to_light) };
        self.diffuse * FRAC_1_PI + self.gloss * lobe
    }

    /// The highlight's radiance per irradiance if it sends out all light.
    fn lobe(&self, to_light: DVec3) -> f64 {
        let p = self.power;
        match self.shape {
            Highlight::Phong => {
                let cosine = mirrored(-to_light, self.normal).dot(self.to_eye).max(0.0);
                (p + 2.0) / TAU * cosine.powf(p)
            }
            Highlight::Blinn => {
                let cosine = (to_light + self.to_eye).normalize_or_zero().dot(self.normal).max(0.0);
                (p + 2.0) * (p + 4.0) / (8.0 * PI * ((-p / 2.0).exp2() + p)) * cosine.powf(p)
            }
        }
    }

    /// Draws a direction from which light may come, by two numbers in [0, 1): by the cosine for the diffuse part, by
    /// the lobe for the highlight. `None` if it leads into the surface: then the sample has no light.
    pub fn sample(&self, [mut u, v]: [f64; 2]) -> Option<Incoming> {
        let scattered = self.scattered();
        let diffuse_chance = self.diffuse.max_element() / scattered;
        let is_diffuse = u < diffuse_chance;
        u = if is_diffuse { u / diffuse_chance } else { (u - diffuse_chance) / (1.0 - diffuse_chance) };
        let direction = if is_diffuse { around(self.normal, (1.0 - u).sqrt(), v) } else { self.sample_lobe(u, v)? };
        let cosine = direction.dot(self.normal);
        // The comparison is false without a normal (NaN).
        let is_above = cosine > 0.0;
        if !is_above {
            return None;
        }
        let mut density = diffuse_chance * cosine * FRAC_1_PI;
        if diffuse_chance < 1.0 {
            density += (1.0 - diffuse_chance) * self.lobe_density(direction);
        }
        Some(Incoming { direction, weight: self.scattering(direction) * (cosine / density) })
    }

    fn sample_lobe(&self, u: f64, v: f64) -> Option<DVec3> {
        lobe_direction(self.shape, self.power, self.normal, self.to_eye, [u, v])
    }

    /// The density of directions drawn for the highlight, per steradian.
    fn lobe_density(&self, direction: DVec3) -> f64 {
        let density = |cosine: f64| (self.power + 1.0) / TAU * cosine.max(0.0).powf(self.power);
        match self.shape {
            Highlight::Phong => density(direction.dot(mirrored(-self.to_eye, self.normal))),
            Highlight::Blinn => {
                let middle = (direction + self.to_eye).normalize_or_zero();
                // Mirrored directions are four times as sparse as the halfway directions, over the cosine.
                density(middle.dot(self.normal)) / (4.0 * middle.dot(self.to_eye))
            }
        }
    }
}

/// The direction of a lobe by two numbers in [0, 1): the density is (p + 1) / (2 pi) cos^p about the reflected direction
/// (Phong) or, for the normal halfway, about the normal (Blinn). `None` if that normal turns away from the eye.
pub(crate) fn lobe_direction(
    shape: Highlight,
    power: f64,
    normal: DVec3,
    to_eye: DVec3,
    [u, v]: [f64; 2],
) -> Option<DVec3> {
    let cosine = (1.0 - u).powf(1.0 / (power + 1.0));
    match shape {
        Highlight::Phong => Some(around(mirrored(-to_eye, normal), cosine, v)),
        Highlight::Blinn => {
            let middle = around(normal, cosine, v);
            (middle.dot(to_eye) > 0.0).then(|| mirrored(-to_eye, middle))
        }
    }
}

/// The unit vector at an angle of this cosine to the unit vector `axis`, `turn` (0 to 1) around it.
pub(crate) fn around(axis: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let (side, other) = axis.any_orthonormal_pair();
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin, cos) = (turn * TAU).sin_cos();
    (axis * cosine + (side * cos + other * sin) * sine).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use scene::MirrorSettings;

    const POWERS: [f64; 6] = [1.0, 5.0, 50.0, 300.0, 1000.0, 10_000.0];

    /// A hit on a white surface with normal z.
    const HIT: Hit = Hit {
        distance: 1.0,
        position: DVec3::ZERO,
        normal: DVec3::Z,
        albedo: DVec3::ONE,
        specular_intensity: 0.0,
        specular_power: 0.0,
        medium: None,
        surface: 0,
        point: 0,
    };

    /// A surface with normal z, seen at `degrees` from it.
    fn surface(shape: Highlight, power: f64, share: f64, degrees: f64) -> Reflectance {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let settings = MirrorSettings::default();
        let illumination = Illumination {
            gloss: Gloss { share, power, shape },
            ..Illumination::new(Illuminant::Lights(&[]), &settings)
        };
        Reflectance::new(&HIT, -DVec3::new(sin, 0.0, cos), 0, 1.0, &illumination)
    }

    #[test]
    fn a_mirror_that_is_not_followed_shows_its_own_colour_or_only_the_share_that_it_does_not_reflect() {
        let mirror = Hit { specular_intensity: 0.75, ..HIT };
        for (last, bounces, share) in
            [(LastMirror::Matt, 1, 1.0), (LastMirror::Dark, 1, 0.25), (LastMirror::Dark, 0, 1.0)]
        {
            let settings = MirrorSettings { last, ..MirrorSettings::default() };
            let illumination = Illumination { bounces, ..Illumination::new(Illuminant::Lights(&[]), &settings) };
            let found = Reflectance::new(&mirror, -DVec3::Z, 0, 1.0, &illumination);
            assert_eq!((found.diffuse, found.mirror), (DVec3::splat(share), DVec3::ZERO), "{last:?}");
        }
    }

    /// The share of evenly arriving light that is sent to the eye: by reciprocity, the share of the light from the
    /// eye's side that is sent anywhere. Computed at midpoints of a grid that is fine about the lobe's middle.
    fn albedo(surface: &Reflectance) -> f64 {
        let axis = match surface.shape {
            Highlight::Phong => mirrored(-surface.to_eye, DVec3::Z),
            Highlight::Blinn => DVec3::Z,
        };
        let (rings, turns) = (400, 400);
        let mut sum = 0.0;
        for ring in 0..rings {
            // Angles grow with the cube, starting where the lobe is high.
            let angle = |step: f64| PI * (step / f64::from(rings)).powi(3);
            let (low, high) = (angle(f64::from(ring)), angle(f64::from(ring + 1)));
            let solid_angle = (low.cos() - high.cos()) * TAU / f64::from(turns);
            for turn in 0..turns {
                let middle = around(axis, ((low + high) / 2.0).cos(), (f64::from(turn) + 0.5) / f64::from(turns));
                let (to_light, stretch) = match surface.shape {
                    Highlight::Phong => (middle, 1.0),
                    Highlight::Blinn => (mirrored(-surface.to_eye, middle), 4.0 * middle.dot(surface.to_eye).max(0.0)),
                };
                sum += surface.scattering(to_light).x * to_light.z.max(0.0) * stretch * solid_angle;
            }
        }
        sum
    }

    #[test]
    fn highlights_send_out_no_more_than_arrives_and_all_of_it_along_the_normal() {
        for shape in [Highlight::Phong, Highlight::Blinn] {
            for power in POWERS {
                for degrees in [0.0, 20.0, 45.0, 70.0, 85.0] {
                    let share = albedo(&surface(shape, power, 1.0, degrees));
                    assert!(share < 1.001, "{shape:?} {power} at {degrees} degrees: {share}");
                    assert!(degrees > 0.0 || share > 0.999, "{shape:?} {power} along the normal: {share}");
                }
            }
        }
        // The share is split, not added.
        let split = albedo(&surface(Highlight::Phong, 20.0, 0.3, 0.0));
        assert!((split - 1.0).abs() < 1e-3, "{split}");
    }

    #[test]
    fn samples_add_up_to_what_is_sent_out() {
        for shape in [Highlight::Phong, Highlight::Blinn] {
            for (power, share) in [(1.0, 1.0), (50.0, 1.0), (1000.0, 1.0), (50.0, 0.3), (1000.0, 0.95)] {
                for degrees in [0.0, 45.0, 80.0] {
                    let surface = surface(shape, power, share, degrees);
                    let count = 256;
                    let numbers = (0..count * count)
                        .map(|index| [index / count, index % count].map(|n| (f64::from(n) + 0.5) / f64::from(count)));
                    let sum: f64 = numbers.filter_map(|pair| surface.sample(pair)).map(|light| light.weight.x).sum();
                    let (found, expected) = (sum / f64::from(count * count), albedo(&surface));
                    let what = format!("{shape:?} {power} x {share} at {degrees} degrees");
                    assert!((found - expected).abs() < 3e-3, "{what}: {found} instead of {expected}");
                }
            }
        }
    }

    #[test]
    fn weights_of_samples_are_bounded() {
        // A sample with a large weight makes a picture sparkle.
        for shape in [Highlight::Phong, Highlight::Blinn] {
            for power in POWERS {
                let surface = surface(shape, power, 0.95, 60.0);
                let worst = (0..4096)
                    .filter_map(|i| {
                        surface.sample([(f64::from(i % 64) + 0.5) / 64.0, (f64::from(i / 64) + 0.5) / 64.0])
                    })
                    .fold(0.0_f64, |worst, light| worst.max(light.weight.x));
                assert!(worst < 4.1, "{shape:?} {power}: {worst}");
            }
        }
    }
}
