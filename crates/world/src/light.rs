//! The automatic light: one rule for the window, headless pictures and studies.
//!
//! The light depends on all points of the clouds that are shown, also on those that are clipped or hidden, so that the light
//! stays when somebody hides points. Most clouds that bring RGB were lit when they were scanned: their own colours are
//! shown. For others the surroundings decide: under an open sky the sun shines, unless there are lights. A room gets a
//! lamp if there is no light, and that lamp shines only while the eye is in the room, or when lights are asked for:
//! from outside it would light nothing visible.

use std::sync::Arc;

use cloud::Chunk;
use glam::DVec3;
use scene::{Camera, ColorBy, Interior, LightClues, Lighting, SpotLight, Surroundings};

/// The surroundings of the points, if they are known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AutoLight {
    pub surroundings: Option<Surroundings>,
    /// The free space of the rooms, if the points are some.
    pub interior: Option<Arc<Interior>>,
    /// Where the camera of a depth image was, if the points are one.
    pub sensor: Option<Camera>,
}

/// Where the camera of a depth image was: in the origin, and turned to the middle of its points. Where it looks along
/// z, y points upwards or downwards, by convention of the program that wrote the file. What is low in a picture, as the
/// floor, is mostly nearer than what is high, so that decides which. Else `up` is upwards.
fn sensor(chunks: &[Chunk], up: DVec3) -> Option<Camera> {
    if !cloud::is_depth_image(chunks) {
        return None;
    }
    let bounds = cloud::robust_bounds(chunks);
    let sample: Vec<DVec3> = cloud::spread_sample(chunks).filter(|place| bounds.contains(*place)).collect();
    // In steps, so that a point more or less does not move the view.
    let mean = sample.iter().sum::<DVec3>() / sample.len() as f64;
    let step = (mean.length().log2().floor() - 8.0).exp2();
    let pivot = (mean / step).round() * step;
    let forward = pivot.try_normalize()?;
    let looks_along_z = forward.z.abs() > forward.x.abs().max(forward.y.abs());
    let up = if looks_along_z { DVec3::Y * farther_side(&sample) } else { up };
    (forward.dot(up).abs() < MOST_UPRIGHT).then(|| Camera::from_eye(DVec3::ZERO, pivot, up))
}

/// 1 if the distances from the origin grow along y, as seen from there, else -1.
fn farther_side(points: &[DVec3]) -> f64 {
    let seen: Vec<[f64; 2]> = points.iter().map(|point| [point.y / point.z.abs(), point.length()]).collect();
    let seen = || seen.iter().filter(|pair| pair.iter().all(|value| value.is_finite()));
    let count = seen().count().max(1) as f64;
    let [height, distance] = [0, 1].map(|index| seen().map(|pair| pair[index]).sum::<f64>() / count);
    let covariance: f64 = seen().map(|pair| (pair[0] - height) * (pair[1] - distance)).sum();
    if covariance > 0.0 { 1.0 } else { -1.0 }
}

/// A camera that looks more along the up direction than this, as a cosine, has no upright picture.
const MOST_UPRIGHT: f64 = 0.98;

impl AutoLight {
    /// Finds the surroundings of the points; `up` is a unit vector.
    pub fn around(chunks: &[Chunk], up: DVec3) -> Self {
        let (surroundings, interior) = Surroundings::with_interior(cloud::spread_sample(chunks), up);
        Self { surroundings: Some(surroundings), interior: interior.map(Arc::new), sensor: sensor(chunks, up) }
    }

    /// What decides about automatic light. `chunks` are those of the clouds, each with what its cloud is coloured by if
    /// it has that of its own, and `has_lamp` says whether the lights that shine are this one's lamp.
    pub fn clues<'a>(
        &self,
        chunks: impl Iterator<Item = (&'a Chunk, Option<ColorBy>)> + Clone,
        has_lamp: bool,
    ) -> LightClues {
        let show_colors = |view_does: bool| {
            let shows = move |by: Option<ColorBy>| by.map_or(view_does, ColorBy::shows_rgb);
            has_colors(chunks.clone().map(move |(chunk, by)| (chunk, shows(by))))
        };
        LightClues {
            has_colors: show_colors(true),
            keeps_colors: show_colors(false),
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

    /// A camera that stands in the room, if the surroundings are one, or where the camera of a depth image was.
    pub fn camera_inside(&self, up: DVec3) -> Option<Camera> {
        match self.surroundings {
            Some(Surroundings::Room(room)) if self.sensor.is_none() => Some(room.camera(up)),
            _ => self.sensor,
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

/// Says why a scene is dark, if its lights are asked for and it has none.
pub fn dark_warning(by: Lighting, lights: &[SpotLight]) -> Option<String> {
    let warning = "light.by = lights: the scene has no light, so nothing is lit; add a light, or set light.by = auto";
    (by == Lighting::Lights && lights.is_empty()).then(|| warning.into())
}

/// The number of points of a chunk whose colours are compared.
const COMPARED: usize = 16;

/// Whether at least half of the points bring RGB colours and are to show them, and these are not one colour everywhere,
/// which says nothing about the points.
fn has_colors<'a>(chunks: impl Iterator<Item = (&'a Chunk, bool)>) -> bool {
    let (mut colored, mut all) = (0, 0);
    let (mut first, mut varies) = (None, false);
    for (chunk, shows_colors) in chunks {
        all += chunk.len();
        let Some(colors) = chunk.colors.as_ref().filter(|_| shows_colors) else { continue };
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
            AutoLight::default().clues(chunks.iter().map(|chunk| (chunk, None)), false).has_colors
        };
        assert!(found(&[(3, true)]) && found(&[(3, true), (3, false)]));
        assert!(!found(&[(3, true), (4, false)]) && !found(&[(2, false)]) && !found(&[]));
    }

    #[test]
    fn the_colours_of_a_cloud_count_as_the_cloud_shows_them() {
        let colors = Some(Arc::new((0..3).map(|point| [point; 4]).collect()));
        let chunk = Chunk { colors, ..Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 3]) };
        let found = |own: Option<ColorBy>| {
            let clues = AutoLight::default().clues([(&chunk, own)].into_iter(), false);
            (clues.has_colors, clues.keeps_colors)
        };
        assert_eq!(found(None), (true, false), "as the view has it");
        assert_eq!(found(Some(ColorBy::Rgb)), (true, true));
        assert_eq!(found(Some(ColorBy::Height)), (false, false));
    }

    /// A depth image of 200 x 150 pixels of a wall with a box before it, whose camera looks along an axis.
    fn depth_image(look: impl Fn(f32, f32, f32) -> [f32; 3]) -> Vec<Chunk> {
        let pixel = |at: i32| {
            let (x, y) = ((at % 200 - 100) as f32 * 0.004, (at / 200 - 75) as f32 * 0.004);
            let depth = if x.abs() < 0.1 && y > 0.0 { 2.0 } else { 3.0 };
            look(x * depth, y * depth, depth)
        };
        vec![Chunk::new(0, DVec3::ZERO, (0..200 * 150).map(pixel).collect())]
    }

    #[test]
    fn a_depth_image_is_first_seen_from_where_it_was_taken_and_upright() {
        // Right, down, ahead; right, up, back; left, up, ahead; and ahead, left, up.
        let optical = depth_image(|x, y, depth| [x, y, depth]);
        let graphics = depth_image(|x, y, depth| [x, -y, -depth]);
        let turned = depth_image(|x, y, depth| [-x, -y, depth]);
        let vehicle = depth_image(|x, y, depth| [depth, -x, -y]);
        for (chunks, ahead, up) in [
            (optical, DVec3::Z, -DVec3::Y),
            (graphics, -DVec3::Z, DVec3::Y),
            (turned, DVec3::Z, DVec3::Y),
            (vehicle, DVec3::X, DVec3::Z),
        ] {
            let camera = AutoLight::around(&chunks, DVec3::Z).camera_inside(DVec3::Z).unwrap();
            assert!(camera.eye.length() < 1e-9 && camera.forward().dot(ahead) > 0.99 && camera.up.dot(up) > 0.99);
            assert!((2.0..3.2).contains(&camera.distance()), "{}", camera.distance());
        }
        let level: Vec<[f32; 3]> = (0..10_000).map(|at| [(at % 100) as f32, (at / 100) as f32, 0.0]).collect();
        let level = AutoLight::around(&[Chunk::new(0, DVec3::ZERO, level)], DVec3::Z);
        assert_eq!(level.camera_inside(DVec3::Z), None);
    }

    #[test]
    fn one_colour_everywhere_is_none() {
        let chunk = |color: [u8; 4]| Chunk {
            colors: Some(Arc::new(vec![color; 100])),
            ..Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 100])
        };
        assert!(!has_colors([chunk([9; 4]), chunk([9; 4])].iter().map(|chunk| (chunk, true))));
        assert!(has_colors([chunk([9; 4]), chunk([8; 4])].iter().map(|chunk| (chunk, true))));
        let mut half = chunk([9; 4]);
        half.colors = Some(Arc::new((0..100).map(|point| [u8::from(point > 49); 4]).collect()));
        assert!(has_colors([half].iter().map(|chunk| (chunk, true))));
    }
}
