//! Figures of light: how far an image of it differs from the truth.

use glam::DVec3;
use serde::{Deserialize, Serialize};
use trace::Hit;

/// The largest relative difference of an albedo from the truth's, and the least cosine between normals, at which a
/// pixel counts as showing one surface and the right one: 8-bit colours and the normals of splats differ less.
const SAME_ALBEDO: f64 = 0.03;
const SAME_NORMAL: f64 = 0.999;

/// The error of an image of light. NaN (`null` in JSON) where nothing could be measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightError {
    /// The root of the mean square difference of linear red, green and blue, relative to the mean of the truth.
    pub relative_rmse: f64,
    /// The mean of the image relative to that of the truth.
    pub mean_ratio: f64,
    /// The largest luminance of the image relative to that of the truth: far above 1 if the image sparkles.
    pub brightest_ratio: f64,
}

/// Whether a pixel of this normal and albedo shows the surface of the truth, and no mean of two.
pub(crate) fn is_same_surface(normal: DVec3, albedo: DVec3, truth: &Hit) -> bool {
    let albedo_is_off = (albedo / truth.albedo - 1.0).abs().max_element() > SAME_ALBEDO;
    normal.dot(truth.normal) > SAME_NORMAL && !albedo_is_off
}

/// Compares images of linear red, green and blue over the pixels that are marked in `mask` and finite in the truth.
/// Values of `image` that are not finite count as black.
pub fn light_error(mask: &[bool], image: &[[f32; 3]], truth: &[[f32; 3]]) -> LightError {
    let (mut values, mut squares, mut sums, mut brightest) = (0.0, 0.0, [0.0; 2], [0.0_f64; 2]);
    let marked = image.iter().zip(truth).zip(mask).filter(|(_, is_marked)| **is_marked).map(|(pair, _)| pair);
    for (color, truth) in marked.filter(|(_, truth)| truth.iter().all(|value| value.is_finite())) {
        let color = color.map(|value| if value.is_finite() { f64::from(value) } else { 0.0 });
        let truth = truth.map(f64::from);
        for (value, true_value) in color.iter().zip(truth) {
            values += 1.0;
            squares += (value - true_value).powi(2);
            sums[0] += value;
            sums[1] += true_value;
        }
        brightest[0] = brightest[0].max(luminance(color));
        brightest[1] = brightest[1].max(luminance(truth));
    }
    LightError {
        relative_rmse: (squares / values).sqrt() / (sums[1] / values),
        mean_ratio: sums[0] / sums[1],
        brightest_ratio: brightest[0] / brightest[1],
    }
}

/// The difference in luminance that 95 of 100 pixels of `light_error` do not exceed, relative to the mean of the truth.
/// NaN where nothing could be measured.
pub(crate) fn p95_error(mask: &[bool], image: &[[f32; 3]], truth: &[[f32; 3]]) -> f64 {
    let marked = image.iter().zip(truth).zip(mask).filter(|(_, is_marked)| **is_marked).map(|(pair, _)| pair);
    let finite = marked.filter(|(_, truth)| truth.iter().all(|value| value.is_finite()));
    let light = |color: &[f32; 3]| luminance(color.map(|value| if value.is_finite() { f64::from(value) } else { 0.0 }));
    let (mut differences, lights): (Vec<f64>, Vec<f64>) =
        finite.map(|(color, truth)| ((light(color) - light(truth)).abs(), light(truth))).unzip();
    differences.sort_by(f64::total_cmp);
    let mean = lights.iter().sum::<f64>() / lights.len() as f64;
    differences.get((differences.len() * 19).div_ceil(20).saturating_sub(1)).map_or(f64::NAN, |error| error / mean)
}

/// The luminance of linear red, green and blue with the primaries of sRGB (ITU-R BT.709).
pub(crate) fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_that_shows_a_mean_of_two_surfaces_is_not_of_one() {
        let truth = Hit {
            distance: 1.0,
            position: DVec3::ZERO,
            normal: DVec3::Z,
            albedo: DVec3::splat(0.5),
            specular_intensity: 0.0,
            specular_power: 0.0,
            medium: None,
            surface: 0,
            point: 0,
        };
        let tilted = |degrees: f64| DVec3::new(degrees.to_radians().sin(), 0.0, degrees.to_radians().cos());
        assert!(is_same_surface(tilted(2.0), DVec3::new(0.5, 0.51, 0.49), &truth));
        assert!(!is_same_surface(tilted(3.0), truth.albedo, &truth));
        assert!(!is_same_surface(DVec3::Z, DVec3::new(0.5, 0.5, 0.48), &truth));
    }

    #[test]
    fn ninety_five_of_a_hundred_pixels_are_no_farther_off_than_the_p95_says() {
        let truth = [[2.0; 3]; 100];
        let image: Vec<[f32; 3]> = (0..100).map(|index| [2.0 + index as f32; 3]).collect();
        assert!((p95_error(&[true; 100], &image, &truth) - 47.0).abs() < 1e-6);
        assert!(p95_error(&[false; 100], &image, &truth).is_nan());
    }

    #[test]
    fn errors_of_light_are_relative_to_the_truth() {
        let truth = [[1.0; 3], [2.0; 3], [3.0; 3], [f32::NAN; 3], [100.0; 3]];
        let image = [[1.1; 3], [1.9; 3], [6.0, 3.0, 3.0], [7.0; 3], [0.0; 3]];
        let mask = [true, true, true, true, false];
        let found = light_error(&mask, &image, &truth);
        // Squares 3 x 0.01, 3 x 0.01 and 9 over nine values with the mean 2; sums 21 and 18.
        assert!((found.relative_rmse - (9.06_f64 / 9.0).sqrt() / 2.0).abs() < 1e-6, "{found:?}");
        assert!((found.mean_ratio - 21.0 / 18.0).abs() < 1e-6, "{found:?}");
        let brightest = (0.2126 * 6.0 + (1.0 - 0.2126) * 3.0) / 3.0;
        assert!((found.brightest_ratio - brightest).abs() < 1e-6, "{found:?}");
        let same = light_error(&mask, &truth, &truth);
        assert_eq!((same.relative_rmse, same.mean_ratio, same.brightest_ratio), (0.0, 1.0, 1.0));
        let dark = light_error(&mask, &[[f32::NAN; 3]; 5], &truth);
        assert_eq!((dark.mean_ratio, dark.brightest_ratio), (0.0, 0.0));
        assert!(light_error(&[false; 5], &image, &truth).relative_rmse.is_nan());
    }
}
