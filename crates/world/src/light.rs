//! The automatic light: one rule for the window, headless pictures and studies.
//!
//! It depends on the surroundings of the shown points. Under an open sky the sun shines, unless there are lights. A
//! room gets a lamp if there is no light, and that lamp shines only while the eye is in the room, or when lights are
//! asked for: from outside it would light nothing visible.

use cloud::Chunk;
use glam::DVec3;
use scene::{Lighting, SpotLight, Surroundings};

/// The surroundings of the points, if they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutoLight {
    pub surroundings: Option<Surroundings>,
}

impl AutoLight {
    /// Finds the surroundings of all points that are shown; `up` is a unit vector.
    pub fn around(chunks: &[Chunk], up: DVec3) -> Self {
        Self { surroundings: Some(Surroundings::of(cloud::spread_sample(chunks), up)) }
    }

    pub fn sky_is_open(&self) -> bool {
        self.surroundings == Some(Surroundings::OpenSky)
    }

    /// The lamp of a room that has no other light.
    pub fn lamp(&self) -> Option<SpotLight> {
        match self.surroundings {
            Some(Surroundings::Room(room)) => Some(room.lamp),
            _ => None,
        }
    }

    /// Whether that lamp shines for this eye.
    pub fn lamp_shines(&self, by: Lighting, eye: DVec3) -> bool {
        match self.surroundings {
            Some(Surroundings::Room(room)) => room.lamp_shines(by, eye),
            // The lamp's room is no room any more, or nobody has looked again yet.
            _ => true,
        }
    }
}
