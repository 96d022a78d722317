//! The automatic light: one rule for the window, headless pictures and studies.
//!
//! It depends on all points of the clouds that are shown, also on those that are clipped or hidden, so that the light
//! stays when somebody hides points. Most clouds that bring RGB were lit when they were scanned: their own colours are
//! shown. For others the surroundings decide: under an open sky the sun shines, unless there are lights. A room gets a
//! lamp if there is no light, and that lamp shines only while the eye is in the room, or when lights are asked for:
//! from outside it would light nothing visible.

use cloud::Chunk;
use glam::DVec3;
use scene::{Camera, LightClues, Lighting, SpotLight, Surroundings};

/// The surroundings of the points, if they are known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutoLight {
    pub surroundings: Option<Surroundings>,
}

impl AutoLight {
    /// Finds the surroundings of the points; `up` is a unit vector.
    pub fn around(chunks: &[Chunk], up: DVec3) -> Self {
        Self { surroundings: Some(Surroundings::of(cloud::spread_sample(chunks), up)) }
    }

    /// What decides about automatic light. `chunks` are those of the clouds, and `has_lamp` says whether the lights that
    /// shine are this one's lamp.
    pub fn clues<'a>(&self, chunks: impl Iterator<Item = &'a Chunk>, has_lamp: bool) -> LightClues {
        LightClues {
            has_colors: has_colors(chunks),
            sky_is_open: self.surroundings == Some(Surroundings::OpenSky),
            is_guessed: has_lamp,
        }
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

    /// A camera that stands in the room, if the surroundings are one.
    pub fn camera_inside(&self, up: DVec3) -> Option<Camera> {
        match self.surroundings {
            Some(Surroundings::Room(room)) => Some(room.camera(up)),
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

/// The number of points of a chunk whose colours are compared.
const COMPARED: usize = 16;

/// Whether at least half of the points bring RGB colours, and these are not one colour everywhere, which says nothing
/// about the points.
pub fn has_colors<'a>(chunks: impl Iterator<Item = &'a Chunk>) -> bool {
    let (mut colored, mut all) = (0, 0);
    let (mut first, mut varies) = (None, false);
    for chunk in chunks {
        all += chunk.len();
        let Some(colors) = &chunk.colors else { continue };
        colored += chunk.len();
        let mut compared = colors.iter().step_by(colors.len().div_ceil(COMPARED).max(1));
        varies = varies || compared.any(|color| *first.get_or_insert(*color) != *color);
    }
    varies && 2 * colored >= all
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_scene_has_colours_if_half_of_its_points_bring_them() {
        let chunk = |points: usize, is_colored: bool| Chunk {
            colors: is_colored.then(|| Arc::new((0..points).map(|point| [point as u8; 4]).collect())),
            ..Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; points])
        };
        let found = |parts: &[(usize, bool)]| {
            let chunks: Vec<Chunk> = parts.iter().map(|(points, is_colored)| chunk(*points, *is_colored)).collect();
            AutoLight::default().clues(chunks.iter(), false).has_colors
        };
        assert!(found(&[(3, true)]) && found(&[(3, true), (3, false)]));
        assert!(!found(&[(3, true), (4, false)]) && !found(&[(2, false)]) && !found(&[]));
    }

    #[test]
    fn one_colour_everywhere_is_none() {
        let chunk = |color: [u8; 4]| Chunk {
            colors: Some(Arc::new(vec![color; 100])),
            ..Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 100])
        };
        assert!(!has_colors([chunk([9; 4]), chunk([9; 4])].iter()));
        assert!(has_colors([chunk([9; 4]), chunk([8; 4])].iter()));
        let mut half = chunk([9; 4]);
        half.colors = Some(Arc::new((0..100).map(|point| [u8::from(point > 49); 4]).collect()));
        assert!(has_colors([half].iter()));
    }
}
