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
