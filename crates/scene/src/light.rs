//! Lights in the scene, and the direction of the sun.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::{Light, Lighting, Sun};

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

impl Light {
    /// The lighting of the points, with `auto` resolved for a scene that has lights, or a sky above it.
    pub fn lighting(&self, has_lights: bool, sky_is_open: bool) -> Lighting {
        match self.by {
            Lighting::Auto if has_lights => Lighting::Lights,
            Lighting::Auto if sky_is_open => Lighting::Sun,
            Lighting::Auto => Lighting::Headlight,
            chosen => chosen,
        }
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
