//! Measures flicker: follows places of the scene through frames of a camera that stands still or moves by parts of a
//! pixel.

use glam::{DVec2, DVec3, UVec2};
use scene::{Camera, Projection, ViewSettings};
use serde::{Deserialize, Serialize};

use crate::light::luminance;

/// The standard deviation of a pixel's brightness from frame to frame, in grey levels of 8 bits. NaN where nothing
/// could be measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flicker {
    /// The mean over the pixels.
    pub mean: f64,
    pub max: f64,
}

/// Compares frames of linear red, green and blue over the pixels marked in `mask`. Brightness is the luminance as a
/// screen shows it: clamped to 0 ..= 1, encoded as sRGB, times 255, not rounded. Values that are not finite (a point
/// that a frame does not see) do not count; a pixel needs two frames.
pub fn flicker(mask: &[bool], frames: &[Vec<[f32; 3]>]) -> Flicker {
    let (mut pixels, mut sum, mut max) = (0.0, 0.0, f64::NAN);
    for pixel in (0..mask.len()).filter(|&pixel| mask[pixel]) {
        let colors =
            frames.iter().map(|frame| frame[pixel]).filter(|color| color.iter().all(|value| value.is_finite()));
        let levels: Vec<f64> = colors.map(|color| grey_level(color.map(f64::from))).collect();
        if levels.len() < 2 {
            continue;
        }
        let count = levels.len() as f64;
        let mean = levels.iter().sum::<f64>() / count;
        let deviation = (levels.iter().map(|level| (level - mean).powi(2)).sum::<f64>() / count).sqrt();
        pixels += 1.0;
        sum += deviation;
        // The maximum of NaN and a number is the number.
        max = deviation.max(max);
    }
    Flicker { mean: sum / pixels, max }
}

/// The grey level of linear light, 0 to 255 (IEC 61966-2-1).
pub(crate) fn grey_level(color: [f64; 3]) -> f64 {
    let value = luminance(color).clamp(0.0, 1.0);
    255.0 * if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// How a camera moves while places are followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps {
    pub frames: u32,
    /// The sideways step from frame to frame, in pixels at the distance of the pivot.
    pub pixels: f64,
}

/// The images of one frame.
pub struct FrameImages {
    /// The world positions of its pixels, NaN where a pixel is empty.
    pub positions: Vec<[f32; 3]>,
    /// The linear red, green and blue.
    pub colors: Vec<[f32; 3]>,
}

/// The places that the first frame's pixels see (NaN for empty ones), and the colours of these places in each frame:
/// that of the nearest pixel, NaN if that is outside of the picture or the place is hidden.
pub struct Followed {
    pub places: Vec<DVec3>,
    pub frames: Vec<Vec<[f32; 3]>>,
}

/// A place is hidden if its pixel shows one that differs in distance by more than this many pixels' width; a surface
/// seen flatter than 3 degrees counts as hidden, too.
const SAME_SURFACE: f64 = 20.0;

/// Follows places while the camera moves; `draw` renders a frame.
///
/// # Errors
/// Those of `draw`.
pub fn follow<E>(
    camera: &Camera,
    view: &ViewSettings,
    size: [u32; 2],
    steps: Steps,
    mut draw: impl FnMut(&Camera) -> Result<FrameImages, E>,
) -> Result<Followed, E> {
    // The pixels of a unit of length at the distance 1; in parallel projection that of the pivot everywhere.
    let focal = f64::from(size[1]) / 2.0 / (f64::from(view.field_of_view).to_radians() / 2.0).tan();
    let step = camera.right() * (steps.pixels * camera.distance() / focal);
    let mut places: Vec<DVec3> = Vec::new();
    let mut frames = Vec::new();
    for frame in 0..steps.frames {
        let shift = step * f64::from(frame);
        let camera = Camera { eye: camera.eye + shift, pivot: camera.pivot + shift, ..*camera };
        let shown = draw(&camera)?;
        if frame == 0 {
            places = shown.positions.iter().map(|at| DVec3::from(at.map(f64::from))).collect();
        }
        let turn = camera.view_from_world();
        let at_place = |place: &DVec3| {
            let seen = turn * (*place - camera.eye);
            let depth = match view.projection {
                Projection::Perspective => seen.z,
                Projection::Orthographic => camera.distance(),
            };
            let pixel = DVec2::new(seen.x, -seen.y) / depth * focal + UVec2::from(size).as_dvec2() / 2.0;
            let [x, y] = pixel.to_array().map(|value| value.floor() as i64);
            let is_inside =
                place.is_finite() && (0..i64::from(size[0])).contains(&x) && (0..i64::from(size[1])).contains(&y);
            if !is_inside {
                return [f32::NAN; 3];
            }
            let pixel = y as usize * size[0] as usize + x as usize;
            let is_same =
                DVec3::from(shown.positions[pixel].map(f64::from)).distance(*place) <= SAME_SURFACE * depth / focal;
            if is_same { shown.colors[pixel] } else { [f32::NAN; 3] }
        };
        frames.push(places.iter().map(at_place).collect());
    }
    Ok(Followed { places, frames })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flicker_is_the_deviation_in_grey_levels() {
        // Deviations of 1, from sRGB 8-bit levels 100 and 102, and of 0.
        let linear = |level: f64| (((level / 255.0 + 0.055) / 1.055).powf(2.4)) as f32;
        let frame = |level: f64| vec![[linear(level); 3], [0.5, 0.2, 0.1], [9.0 * level as f32; 3], [f32::NAN; 3]];
        let frames = [frame(100.0), frame(102.0), frame(100.0), frame(102.0)];
        let found = flicker(&[true, true, false, true], &frames);
        assert!((found.mean - 0.5).abs() < 1e-3 && (found.max - 1.0).abs() < 1e-3, "{found:?}");
        let clamped = flicker(&[false, false, true, false], &frames);
        assert_eq!((clamped.mean, clamped.max), (0.0, 0.0));
        let nothing = flicker(&[true; 4], &frames[..1]);
        assert!(nothing.mean.is_nan() && nothing.max.is_nan());
    }
}
