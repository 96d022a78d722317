//! Lights that stand in the scene.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A spot light: even within the inner cone, falling linearly in angle to nothing at the outer one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SpotLight {
    /// World units.
    pub position: DVec3,
    /// A point on the axis.
    pub target: DVec3,
    /// Radiant intensity within the inner cone, per steradian, linear red, green and blue.
    pub intensity: [f32; 3],
    /// Angles from the axis, degrees.
    pub inner_degrees: f32,
    pub outer_degrees: f32,
}

impl SpotLight {
    /// What makes it no spot light, in words, if anything does.
    pub fn problem(&self) -> Option<String> {
        let Self { position, target, intensity, inner_degrees, outer_degrees } = *self;
        if !(position.is_finite() && target.is_finite() && position != target) {
            return Some(format!("it stands at {position} and aims at {target}, expected two places"));
        }
        if let Some(odd) = intensity.iter().find(|value| !(value.is_finite() && **value >= 0.0)) {
            return Some(format!("intensity is {odd}, expected 0 or more"));
        }
        // A cone of a half space is no spot any more.
        let is_cone = inner_degrees >= 0.0 && inner_degrees <= outer_degrees && outer_degrees > 0.0;
        let is_fine = is_cone && outer_degrees < 90.0;
        let expected = "expected 0 <= inner_degrees <= outer_degrees < 90";
        (!is_fine).then(|| format!("it opens from {inner_degrees} to {outer_degrees} degrees, {expected}"))
    }
}
