//! Figures of light: how far an image of it is off the truth, and how much a picture flickers.

use serde::{Deserialize, Serialize};

/// How far an image of light is off the truth. NaN (`null` in JSON) where nothing could be measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightError {
    /// Root of the mean square difference of linear red, green and blue, over the mean of the truth.
    pub relative_rmse: f64,
    /// Mean of the image over that of the truth.
    pub mean_ratio: f64,
    /// Largest luminance of the image over that of the truth: what sparkles is far above 1.
    pub brightest_ratio: f64,
}

/// Compares images of linear red, green and blue over the pixels that are marked in `mask` and that the truth has a finite value
/// for. What is not finite in `image` counts as black.
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

/// Of linear red, green and blue with the primaries of sRGB (ITU-R BT.709).
fn luminance([red, green, blue]: [f64; 3]) -> f64 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// Standard deviation of a pixel's brightness from frame to frame, in grey levels of 8 bits. NaN where nothing could be measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Flicker {
    /// Over the pixels.
    pub mean: f64,
    pub max: f64,
}

/// Compares frames of linear red, green and blue over the pixels marked in `mask`. Brightness is the luminance as a screen shows
/// it: clamped to 0 ..= 1, encoded as sRGB, times 255, not rounded. What is not finite (a point that a frame does not see) does
/// not count; a pixel needs two frames.
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

/// IEC 61966-2-1.
fn grey_level(color: [f64; 3]) -> f64 {
    let value = luminance(color).clamp(0.0, 1.0);
    255.0 * if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn flicker_is_the_deviation_in_grey_levels() {
        // Of sRGB 8-bit levels 100 and 102, so a deviation of 1, and of one that stands still.
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
