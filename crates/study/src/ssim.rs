//! Structural similarity (Wang et al. 2004, "Image Quality Assessment: From Error Visibility to Structural
//! Similarity"): whether two pictures have the same structure around a pixel, whatever their brightness and contrast.
//! It is 1 for equal structures.
//!
//! SSIM is computed from the luminance as a screen shows it, with the authors' Gaussian window (deviation 1.5 pixels, 11
//! wide) and constants.

use crate::flicker::grey_level;
use crate::flip::filter;

/// The similarity around each pixel, -1 to 1, of two pictures of linear red, green and blue (sRGB primaries), clamped
/// to 0 ..= 1. Rows are `width` long; the picture is continued by its border.
pub fn ssim(width: usize, picture: &[[f64; 3]], reference: &[[f64; 3]]) -> Vec<f64> {
    let [x, y] =
        [picture, reference].map(|colors| -> Vec<f64> { colors.iter().map(|color| grey_level(*color)).collect() });
    let weights: Vec<f64> = (-5..=5).map(|offset| (-(f64::from(offset) / 1.5).powi(2) / 2.0).exp()).collect();
    let total: f64 = weights.iter().sum();
    let window: Vec<f64> = weights.into_iter().map(|weight| weight / total).collect();
    let mean = |values: &[f64]| filter(width, values, &window, &window);
    let mean_of_products = |a: &[f64], b: &[f64]| {
        let products: Vec<f64> = a.iter().zip(b).map(|(a, b)| a * b).collect();
        mean(&products)
    };
    let (mean_x, mean_y) = (mean(&x), mean(&y));
    let (xx, yy, xy) = (mean_of_products(&x, &x), mean_of_products(&y, &y), mean_of_products(&x, &y));
    // (0.01 L)^2 and (0.03 L)^2 for the range L of 255 grey levels.
    let (c1, c2) = (2.55_f64.powi(2), 7.65_f64.powi(2));
    (0..x.len())
        .map(|pixel| {
            let (mx, my) = (mean_x[pixel], mean_y[pixel]);
            let (vx, vy, covariance) = (xx[pixel] - mx * mx, yy[pixel] - my * my, xy[pixel] - mx * my);
            (2.0 * mx * my + c1) * (2.0 * covariance + c2) / ((mx * mx + my * my + c1) * (vx + vy + c2))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 32;

    /// The linear grey of a pattern of grey levels.
    fn picture(level: impl Fn(usize, usize) -> f64) -> Vec<[f64; 3]> {
        let linear = |level: f64| {
            let value = level / 255.0;
            if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
        };
        (0..SIZE * SIZE).map(|pixel| [linear(level(pixel % SIZE, pixel / SIZE)); 3]).collect()
    }

    /// The mean over the pixels whose windows lie in the picture.
    fn mean_inside(values: &[f64]) -> f64 {
        let inside: Vec<f64> = (0..values.len())
            .filter(|pixel| (5..SIZE - 5).contains(&(pixel % SIZE)) && (5..SIZE - 5).contains(&(pixel / SIZE)))
            .map(|pixel| values[pixel])
            .collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    }

    fn wave(x: usize, y: usize) -> f64 {
        120.0 + 60.0 * (x as f64 * 0.7).sin() + 40.0 * (y as f64 * 0.4).cos()
    }

    /// The means of three pairs by scikit-image 0.26: structural_similarity(gaussian_weights=True, sigma=1.5,
    /// use_sample_covariance=False, data_range=255).
    const SHIFTED: f64 = 0.780_147_106_691;
    const DARKER: f64 = 0.952_434_225_043;
    const NOISY: f64 = 0.968_669_682_700;

    #[test]
    fn the_same_picture_has_the_same_structure() {
        let waves = picture(wave);
        assert!(ssim(SIZE, &waves, &waves).iter().all(|value| (value - 1.0).abs() < 1e-9));
    }

    #[test]
    fn values_are_those_of_the_published_implementation() {
        let reference = picture(wave);
        let shifted = picture(|x, y| wave(x + 1, y));
        let darker = picture(|x, y| wave(x, y) * 0.8);
        let noisy = picture(|x, y| wave(x, y) + ((x * 7 + y * 13) % 11) as f64 * 3.0 - 15.0);
        for (name, picture, expected) in
            [("shifted", shifted, SHIFTED), ("darker", darker, DARKER), ("noisy", noisy, NOISY)]
        {
            let found = mean_inside(&ssim(SIZE, &picture, &reference));
            assert!((found - expected).abs() < 1e-6, "{name}: {found} instead of {expected}");
        }
    }
}
