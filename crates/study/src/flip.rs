//! FLIP: the difference that a person sees who flips between two pictures (Andersson et al. 2020, "FLIP: A Difference
//! Evaluator for Alternating Images"), for pictures of limited range.
//!
//! FLIP combines two differences: that of colours, after details that the eye cannot resolve have been blurred (sections
//! 4.1 and 4.2), and that of edges and points, which sharpens it (4.3, 4.4). All filters are sums of Gaussians or their
//! derivatives, which separate into one filter along the rows and one along the columns.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use rayon::prelude::*;

/// The pixels per degree of the field of view: the authors' default, a 4K screen 0.7 m wide at 0.7 m distance.
const PIXELS_PER_DEGREE: f64 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

type Color = [f64; 3];

/// The difference of each pixel, 0 to 1, of two pictures of linear red, green and blue (sRGB primaries), clamped to 0
/// ..= 1. Rows are `width` long; the picture is continued by its border.
pub fn flip(width: usize, picture: &[Color], reference: &[Color]) -> Vec<f64> {
    let [picture, reference] = [picture, reference].map(|colors| Perceived::new(width, colors));
    // Blue and green are the farthest apart (4.1).
    let farthest = color_distance(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0]));
    (0..picture.colors.len())
        .into_par_iter()
        .map(|index| {
            let distance = color_distance(picture.colors[index], reference.colors[index]);
            let [edge, point] =
                [picture.edges[index] - reference.edges[index], picture.points[index] - reference.points[index]];
            // Equation 6, w = 1/sqrt(2) and exponent 1/2.
            let feature = (FRAC_1_SQRT_2 * edge.abs().max(point.abs())).sqrt();
            color_error(distance, farthest).powf(1.0 - feature)
        })
        .collect()
}

/// A picture as the eye perceives it.
struct Perceived {
    /// The colours in CIELAB after the blur, Hunt-adjusted.
    colors: Vec<Color>,
    /// The strength of edges and of points, 0 to 1.
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Perceived {
    fn new(width: usize, colors: &[Color]) -> Self {
        let opponent: Vec<Color> = colors.par_iter().map(|color| opponent_from_linear(*color)).collect();
        let channel = |index: usize| -> Vec<f64> { opponent.par_iter().map(|color| color[index]).collect() };
        let [lightness, red_green, blue_yellow] = [0, 1, 2].map(channel);
        let filtered = [
            blur(width, &lightness, &[(1.0, 0.0047)]),
            blur(width, &red_green, &[(1.0, 0.0053)]),
            blur(width, &blue_yellow, &[(34.1, 0.04), (13.5, 0.025)]),
        ];
        let colors = (0..colors.len())
            .into_par_iter()
            .map(|index| {
                let linear = linear_from_opponent([0, 1, 2].map(|channel| filtered[channel][index]));
                hunt_lab(linear.map(|value| value.clamp(0.0, 1.0)))
            })
            .collect();
        let luminance: Vec<f64> = lightness.iter().map(|value| (value + 16.0) / 116.0).collect();
        let [edges, points] = [1, 2].map(|derivative| feature(width, &luminance, derivative));
        Self { colors, edges, points }
    }
}

/// The contrast sensitivity of a channel as a blur: the sum of a sqrt(pi / b) exp(-pi^2 x^2 / b) over the given (a, b),
/// x in degrees (equation 2). All channels use as many pixels as the widest one needs.
fn blur(width: usize, values: &[f64], gaussians: &[(f64, f64)]) -> Vec<f64> {
    let reach = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as isize;
    let kernel = |b: f64| -> Vec<f64> {
        (-reach..=reach).map(|x| (-(PI * x as f64 / PIXELS_PER_DEGREE).powi(2) / b).exp()).collect()
    };
    let (mut sum, mut weight) = (vec![0.0; values.len()], 0.0);
    for &(a, b) in gaussians {
        let (kernel, height) = (kernel(b), a * (PI / b).sqrt());
        weight += height * kernel.iter().sum::<f64>().powi(2);
        let filtered = filter(width, values, &kernel, &kernel);
        sum.iter_mut().zip(filtered).for_each(|(sum, value)| *sum += height * value);
    }
    sum.iter_mut().for_each(|value| *value /= weight);
    sum
}

/// The strength of edges (first derivative of a Gaussian) or points (second), over both directions.
fn feature(width: usize, values: &[f64], derivative: u8) -> Vec<f64> {
    // The Gaussian's deviation is half the width of the features searched for, 0.082 degrees.
    let deviation = 0.5 * 0.082 * PIXELS_PER_DEGREE;
    let reach = (3.0 * deviation).ceil() as isize;
    let gaussian = |x: isize| (-(x as f64 / deviation).powi(2) / 2.0).exp();
    let even: Vec<f64> = (-reach..=reach).map(gaussian).collect();
    let total: f64 = even.iter().sum();
    let even: Vec<f64> = even.iter().map(|weight| weight / total).collect();
    let across = |x: isize| match derivative {
        1 => -(x as f64) * gaussian(x),
        _ => ((x as f64 / deviation).powi(2) - 1.0) * gaussian(x),
    };
    let across: Vec<f64> = (-reach..=reach).map(across).collect();
    // Positive weights add up to 1, negative ones to -1.
    let sum = |sign: f64| across.iter().map(|weight| (sign * weight).max(0.0)).sum::<f64>();
    let (positive, negative) = (sum(1.0), sum(-1.0));
    let across: Vec<f64> =
        across.iter().map(|&weight| weight / if weight > 0.0 { positive } else { negative }).collect();
    let sideways = filter(width, values, &across, &even);
    let upright = filter(width, values, &even, &across);
    sideways.into_iter().zip(upright).map(|(x, y)| x.hypot(y)).collect()
}

/// Filters along the rows, then along the columns. Kernels have an odd number of weights.
pub(crate) fn filter(width: usize, values: &[f64], along_rows: &[f64], along_columns: &[f64]) -> Vec<f64> {
    let height = values.len() / width.max(1);
    let reach = (along_rows.len() / 2) as isize;
    // The index moved by one weight's offset, clamped to the picture.
    let held = |index: usize, weight: usize, length: usize| {
        (index as isize + weight as isize - reach).clamp(0, length as isize - 1) as usize
    };
    let rows: Vec<f64> = (0..values.len())
        .into_par_iter()
        .map(|index| {
            let (row, column) = (index / width, index % width);
            let weighted = along_rows.iter().enumerate();
            weighted.map(|(at, weight)| weight * values[row * width + held(column, at, width)]).sum()
        })
        .collect();
    (0..values.len())
        .into_par_iter()
        .map(|index| {
            let (row, column) = (index / width, index % width);
            let weighted = along_columns.iter().enumerate();
            weighted.map(|(at, weight)| weight * rows[held(row, at, height) * width + column]).sum()
        })
        .collect()
}

/// Equation 4: differences up to 0.4 of the largest take 0.95 of the range.
fn color_error(distance: f64, farthest: f64) -> f64 {
    let bend = 0.4 * farthest;
    if distance < bend { 0.95 / bend * distance } else { 0.95 + (distance - bend) / (farthest - bend) * 0.05 }
}

/// The HyAB distance to the power of 0.7 (4.1).
fn color_distance(a: Color, b: Color) -> f64 {
    ((a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])).powf(0.7)
}

/// CIELAB with the Hunt effect: chroma counts less where it is dark (4.1).
fn hunt_lab(linear: Color) -> Color {
    let curve = |value: f64| {
        if value > (6.0_f64 / 29.0).powi(3) {
            value.cbrt()
        } else {
            value * (29.0_f64 / 6.0).powi(2) / 3.0 + 4.0 / 29.0
        }
    };
    let [x, y, z] = relative_xyz(linear).map(curve);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// YCxCz: a linear form of CIELAB (4.1).
fn opponent_from_linear(linear: Color) -> Color {
    let [x, y, z] = relative_xyz(linear.map(|value| value.clamp(0.0, 1.0)));
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn linear_from_opponent([lightness, red_green, blue_yellow]: Color) -> Color {
    let y = (lightness + 16.0) / 116.0;
    let relative = [y + red_green / 500.0, y, y - blue_yellow / 200.0];
    let white = multiply(&XYZ_FROM_LINEAR, [1.0; 3]);
    multiply(&LINEAR_FROM_XYZ, [0, 1, 2].map(|axis| relative[axis] * white[axis]))
}

/// CIE XYZ relative to white.
fn relative_xyz(linear: Color) -> Color {
    let (xyz, white) = (multiply(&XYZ_FROM_LINEAR, linear), multiply(&XYZ_FROM_LINEAR, [1.0; 3]));
    [0, 1, 2].map(|axis| xyz[axis] / white[axis])
}

fn multiply(rows: &[Color; 3], color: Color) -> Color {
    rows.map(|row| row[0] * color[0] + row[1] * color[1] + row[2] * color[2])
}

/// sRGB primaries and D65 (IEC 61966-2-1), in the fractions that the primaries' coordinates give.
const XYZ_FROM_LINEAR: [Color; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];

/// The inverse of `XYZ_FROM_LINEAR`.
const LINEAR_FROM_XYZ: [Color; 3] = [
    [3.241_003_232_976_358_7, -1.537_398_969_488_785_5, -0.498_615_881_996_362_9],
    [-0.969_224_252_202_516_6, 1.875_929_983_695_176, 0.041_554_226_340_084_724],
    [0.055_639_419_851_975_444, -0.204_011_206_123_909_97, 1.057_148_977_187_533_5],
];

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 48;
    const HEIGHT: usize = 40;

    fn picture(color: impl Fn(f64, f64) -> Color) -> Vec<Color> {
        (0..WIDTH * HEIGHT).map(|index| color((index % WIDTH) as f64, (index / WIDTH) as f64)).collect()
    }

    fn waves(x: f64, y: f64) -> Color {
        [0.5 + 0.5 * (0.3 * x).sin(), 0.5 + 0.5 * (0.2 * y).cos(), 0.5 + 0.5 * (0.1 * (x + y)).sin()]
    }

    fn mean(values: &[f64]) -> f64 {
        values.iter().sum::<f64>() / values.len() as f64
    }

    /// The values come from the authors' own program, flip-evaluator 1.7.
    #[test]
    fn differences_are_those_of_the_authors_program() {
        let shifted = picture(|x, y| {
            let [red, green, blue] = waves(x + 1.0, y);
            [0.9 * red, green, blue]
        });
        let found = flip(WIDTH, &shifted, &picture(waves));
        for (index, expected) in [(20 * WIDTH + 24, 0.124_072_49), (0, 0.237_017_1), (39 * WIDTH + 47, 0.204_475_7)] {
            assert!((found[index] - expected).abs() < 1e-4, "{} instead of {expected}", found[index]);
        }
        assert!((mean(&found) - 0.242_752_34).abs() < 1e-4, "{}", mean(&found));

        let step = picture(|x, _| [if x < 24.0 { 0.0 } else { 1.0 }; 3]);
        let found = flip(WIDTH, &picture(|_, _| [0.5; 3]), &step);
        for (index, expected) in [(20 * WIDTH + 24, 0.825_644_08), (20 * WIDTH + 5, 0.958_550_5)] {
            assert!((found[index] - expected).abs() < 1e-4, "{} instead of {expected}", found[index]);
        }
        assert!((mean(&found) - 0.780_207_1).abs() < 1e-4, "{}", mean(&found));

        let found = flip(WIDTH, &picture(|_, _| [1.0; 3]), &picture(|_, _| [0.0; 3]));
        assert!((mean(&found) - 0.967_400_73).abs() < 1e-4, "{}", mean(&found));
    }

    #[test]
    fn equal_pictures_do_not_differ_and_blue_differs_most_from_green() {
        assert_eq!(flip(WIDTH, &picture(waves), &picture(waves)), vec![0.0; WIDTH * HEIGHT]);
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|color| picture(|_, _| color));
        assert!(flip(WIDTH, &blue, &green).iter().all(|difference| (difference - 1.0).abs() < 1e-9));
        assert!(flip(WIDTH, &[], &[]).is_empty());
    }

    #[test]
    fn colours_come_back_from_the_opponent_space() {
        for color in [[0.0; 3], [1.0; 3], [0.2, 0.7, 0.4]] {
            let back = linear_from_opponent(opponent_from_linear(color));
            assert!((0..3).all(|channel| (back[channel] - color[channel]).abs() < 1e-12), "{color:?} became {back:?}");
        }
    }
}
