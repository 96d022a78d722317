//! Lights in the scene, and the direction of the sun.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{ColorBy, Lighting, Settings, Sun};

/// A spot light: even within the inner cone, falling linearly in angle to nothing at the outer one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpotLight {
    /// The position in world units.
    pub position: DVec3,
    /// A point on the axis.
    pub target: DVec3,
    /// The radiant intensity within the inner cone, per steradian, linear red, green and blue.
    pub intensity: [f32; 3],
    /// The angles from the axis in degrees.
    pub inner_degrees: f32,
    pub outer_degrees: f32,
}

impl SpotLight {
    /// The half angle of the widest cone in degrees: the shadows of a wider one do not fit in its shadow map.
    pub const WIDEST_DEGREES: f32 = 85.0;

    /// Why it is not a valid spot light, in words.
    pub fn problem(&self) -> Option<String> {
        let Self { position, target, intensity, inner_degrees, outer_degrees } = *self;
        if !(position.is_finite() && target.is_finite() && position != target) {
            return Some(format!("it stands at {position} and aims at {target}, expected two places"));
        }
        if let Some(odd) = intensity.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
            return Some(format!("intensity is {odd}, expected 0 or more"));
        }
        let is_cone = inner_degrees >= 0.0 && inner_degrees <= outer_degrees && outer_degrees > 0.0;
        let is_fine = is_cone && outer_degrees <= Self::WIDEST_DEGREES;
        let expected = format!("expected 0 <= inner_degrees <= outer_degrees <= {}", Self::WIDEST_DEGREES);
        (!is_fine).then(|| format!("it opens from {inner_degrees} to {outer_degrees} degrees, {expected}"))
    }
}

/// What decides about automatic light, besides the lights that shine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LightClues {
    /// Whether most of the points bring RGB colours and show them, if the view's `color.by` asks for these.
    pub has_colors: bool,
    /// Whether most of them show them in any case, because their clouds have a `color.by` of their own.
    pub keeps_colors: bool,
    /// Whether nothing hangs over the points: a sun and a sky may light them.
    pub sky_is_open: bool,
    /// Whether the lights that shine are a guess, and not those of the scene.
    pub is_guessed: bool,
}

/// The light of the points, with everything automatic resolved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResolvedLight {
    /// Neither `Auto` nor `Surroundings`.
    pub by: Lighting,
    /// Whether a sun or a lamp is guessed, because there is no other light.
    pub is_guess: bool,
    /// What a lamp at the eye adds to sun or lamp: the radiance of white.
    pub fill: f32,
}

impl ColorBy {
    /// Whether it shows RGB colours where a cloud brings them.
    pub fn shows_rgb(self) -> bool {
        matches!(self, Self::Auto | Self::Rgb)
    }
}

impl Settings {
    /// The light of the points in a scene with or without lights.
    pub fn resolved_light(&self, has_lights: bool, clues: LightClues) -> ResolvedLight {
        let has_own_lights = has_lights && !clues.is_guessed;
        let shows_colors = if self.color.by.shows_rgb() { clues.has_colors } else { clues.keeps_colors };
        let by = match self.light.by {
            Lighting::Auto if shows_colors && !has_own_lights => Lighting::Colors,
            Lighting::Auto | Lighting::Surroundings if has_lights => Lighting::Lights,
            Lighting::Auto | Lighting::Surroundings if clues.sky_is_open => Lighting::Sun,
            Lighting::Auto | Lighting::Surroundings => Lighting::Headlight,
            chosen => chosen,
        };
        let guesses = matches!(self.light.by, Lighting::Auto | Lighting::Surroundings);
        let is_guess = guesses && !has_own_lights && matches!(by, Lighting::Lights | Lighting::Sun);
        ResolvedLight { by, is_guess, fill: if is_guess { self.light.fill } else { 0.0 } }
    }
}

impl Sun {
    /// The unit vector toward the sun, where `up` is the world's up axis. North is +y, or -z where y points up; east is
    /// +x.
    pub fn direction(&self, up: DVec3) -> DVec3 {
        let up = up.normalize_or(DVec3::Z);
        let north = if up.y.abs() > up.z.abs() { -DVec3::Z } else { DVec3::Y };
        let east = north.cross(up).normalize_or(DVec3::X);
        let north = up.cross(east);
        let (azimuth, elevation) = (f64::from(self.azimuth).to_radians(), f64::from(self.elevation).to_radians());
        (north * azimuth.cos() + east * azimuth.sin()) * elevation.cos() + up * elevation.sin()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_lights_come_first_then_own_colours_then_a_guess_with_fill() {
        let resolved = |by: Lighting, color: ColorBy, has_lights, has_colors, sky_is_open, is_guessed| {
            let mut settings = Settings::default();
            (settings.light.by, settings.color.by, settings.light.fill) = (by, color, 0.25);
            let clues = LightClues { has_colors, sky_is_open, is_guessed, keeps_colors: false };
            let light = settings.resolved_light(has_lights, clues);
            (light.by, light.is_guess, light.fill)
        };
        use Lighting::{Auto, Colors, Headlight, Lights, Sun, Surroundings};
        for (by, color, clues, expected) in [
            // Lights, colours, open sky, guessed lights.
            (Auto, ColorBy::Auto, [true, true, true, false], (Lights, false, 0.0)),
            (Auto, ColorBy::Auto, [false, true, true, false], (Colors, false, 0.0)),
            (Auto, ColorBy::Rgb, [true, true, false, true], (Colors, false, 0.0)),
            (Auto, ColorBy::Height, [true, true, false, true], (Lights, true, 0.25)),
            (Auto, ColorBy::Height, [false, true, true, false], (Sun, true, 0.25)),
            (Auto, ColorBy::Auto, [false, false, true, false], (Sun, true, 0.25)),
            (Auto, ColorBy::Auto, [false, false, false, false], (Headlight, false, 0.0)),
            (Surroundings, ColorBy::Auto, [false, true, true, false], (Sun, true, 0.25)),
            (Surroundings, ColorBy::Auto, [true, true, false, true], (Lights, true, 0.25)),
            (Surroundings, ColorBy::Auto, [true, true, false, false], (Lights, false, 0.0)),
            (Surroundings, ColorBy::Auto, [false, true, false, false], (Headlight, false, 0.0)),
            (Sun, ColorBy::Auto, [true, true, false, false], (Sun, false, 0.0)),
            (Headlight, ColorBy::Auto, [true, true, true, true], (Headlight, false, 0.0)),
        ] {
            let [lights, colors, sky, guessed] = clues;
            assert_eq!(resolved(by, color, lights, colors, sky, guessed), expected, "{by:?} {color:?} {clues:?}");
        }
    }

    #[test]
    fn clouds_that_show_their_own_colours_whatever_the_view_does_need_no_guess() {
        let mut settings = Settings::default();
        settings.color.by = ColorBy::Height;
        let resolved = |keeps_colors| {
            let clues = LightClues { has_colors: true, keeps_colors, sky_is_open: true, is_guessed: false };
            settings.resolved_light(false, clues).by
        };
        assert_eq!([true, false].map(resolved), [Lighting::Colors, Lighting::Sun]);
    }

    #[test]
    fn a_cone_is_no_wider_than_its_shadows_reach() {
        let light = crate::five_mirrors::light();
        let problem = |outer_degrees| SpotLight { outer_degrees, ..light }.problem();
        assert_eq!(problem(85.0), None);
        assert!(problem(85.5).is_some_and(|problem| problem.contains("<= 85")));
    }

    #[test]
    fn the_sun_stands_where_a_compass_says() {
        let at = |azimuth, elevation, up| Sun { azimuth, elevation, ..Sun::default() }.direction(up);
        for (azimuth, elevation, up, expected) in [
            (0.0, 0.0, DVec3::Z, DVec3::Y),
            (90.0, 0.0, DVec3::Z, DVec3::X),
            (180.0, 0.0, DVec3::Z, -DVec3::Y),
            (0.0, 0.0, DVec3::Y, -DVec3::Z),
            (90.0, 0.0, DVec3::Y, DVec3::X),
            (123.0, 90.0, DVec3::Z, DVec3::Z),
            (123.0, 90.0, DVec3::Y, DVec3::Y),
        ] {
            let found = at(azimuth, elevation, up);
            assert!(found.distance(expected) < 1e-6, "{azimuth} {elevation} {up}: {found}");
        }
        assert!((at(225.0, 40.0, DVec3::Z).length() - 1.0).abs() < 1e-12);
    }
}
