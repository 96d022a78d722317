//! Makes pictures that show the drawn picture beside the truth.

use anyhow::Context as _;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use palette::color_difference::Ciede2000 as _;
use rayon::prelude::*;

use crate::metrics::lab;

/// The colour difference (CIEDE2000) at the bright end of the heat map: a quarter of that between black and white, an
/// unmistakable one.
const MOST_DIFFERENCE: f64 = 25.0;
/// The least width of one of the three pictures: smaller ones are enlarged by whole pixels.
const LEAST_WIDTH: usize = 256;
/// The pixels around the mirrors that are shown with them.
const MARGIN: usize = 8;
/// The gap between the pictures.
const GAP: usize = 8;

/// Encodes rows of 8-bit red, green and blue from the top as a PNG file.
///
/// # Errors
/// The number of pixels is wrong.
pub fn png([width, height]: [u32; 2], rgb: &[u8]) -> anyhow::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new(&mut bytes);
    encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8).context("PNG")?;
    Ok(bytes)
}

/// The drawn picture, the truth and a heat map of their difference side by side, as a PNG file of the rectangle around
/// the mirrors. Colours are linear red, green and blue. `None` if there is no mirror.
///
/// # Errors
/// None that a picture of this size could cause.
pub fn beside(
    size: [u32; 2],
    mirror: &[f32],
    drawn: &[[f32; 3]],
    truth: &[[f32; 3]],
) -> anyhow::Result<Option<Vec<u8>>> {
    let row_length = size[0] as usize;
    let Some([[left, top], [right, bottom]]) = around_mirrors(row_length, mirror) else { return Ok(None) };
    let (width, height) = (right - left, bottom - top);
    let scale = LEAST_WIDTH.div_ceil(width);
    let ramp = render::ramp_colors(scene::Ramp::Magma);
    let finite = |color: [f32; 3]| color.map(|value| if value.is_finite() { f64::from(value) } else { 0.0 });
    let shown = |color: [f32; 3]| finite(color).map(|value| (encoded(value) * 255.0).round() as u8);
    let color = |panel: usize, pixel: usize| match panel {
        _ if mirror[pixel] <= 0.0 => [u8::MAX; 3],
        0 => shown(drawn[pixel]),
        1 => shown(truth[pixel]),
        _ => {
            let difference = lab(finite(drawn[pixel])).difference(lab(finite(truth[pixel])));
            let share = (difference / MOST_DIFFERENCE).clamp(0.0, 1.0);
            let [red, green, blue, _] = ramp[(share * 255.0).round() as usize];
            [red, green, blue]
        }
    };
    let (all_width, all_height) = (3 * width * scale + 2 * GAP, height * scale);
    let mut rgb = vec![u8::MAX; all_width * all_height * 3];
    for panel in 0..3 {
        for y in 0..all_height {
            for x in 0..width * scale {
                let pixel = (top + y / scale) * row_length + left + x / scale;
                let place = (y * all_width + panel * (width * scale + GAP) + x) * 3;
                rgb[place..place + 3].copy_from_slice(&color(panel, pixel));
            }
        }
    }
    png([all_width as u32, all_height as u32], &rgb).map(Some)
}

/// The least and the largest column and row of the mirrors' pixels, the latter exclusive.
fn around_mirrors(row_length: usize, mirror: &[f32]) -> Option<[[usize; 2]; 2]> {
    let pixels = || (0..mirror.len()).filter(|pixel| mirror[*pixel] > 0.0);
    let columns = || pixels().map(|pixel| pixel % row_length);
    let (left, right) = (columns().min()?, columns().max()?);
    let (first, last) = (pixels().next()?, pixels().next_back()?);
    Some([[left, first / row_length], [right + 1, last / row_length + 1]])
}

/// A picture of four bytes a pixel, cut to the mirrors and a margin around them, as a PNG file. `None` if there is no
/// mirror.
///
/// # Errors
/// None that a picture of this size could cause.
pub fn cut(size: [u32; 2], mirror: &[f32], picture: &[u8]) -> anyhow::Result<Option<Vec<u8>>> {
    let [row_length, rows] = size.map(|side| side as usize);
    let Some([[left, top], [right, bottom]]) = around_mirrors(row_length, mirror) else { return Ok(None) };
    let (left, top) = (left.saturating_sub(MARGIN), top.saturating_sub(MARGIN));
    let (right, bottom) = ((right + MARGIN).min(row_length), (bottom + MARGIN).min(rows));
    let row = |row: usize| &picture[(row * row_length + left) * 4..(row * row_length + right) * 4];
    let rgb = (top..bottom).flat_map(|at| row(at).chunks_exact(4)).flat_map(|pixel| &pixel[..3]).copied();
    let rgb: Vec<u8> = rgb.collect();
    png([(right - left) as u32, (bottom - top) as u32], &rgb).map(Some)
}

/// The linear colours, 0 to 1, of a picture of four bytes a pixel in sRGB.
pub fn linear(picture: &[u8]) -> Vec<[f64; 3]> {
    let part = |part: u8| {
        let value = f64::from(part) / 255.0;
        if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
    };
    picture.chunks_exact(4).map(|pixel| [part(pixel[0]), part(pixel[1]), part(pixel[2])]).collect()
}

/// Enlarges a picture of four bytes a pixel from one size to another, between pixel centres. A pixel takes nothing from
/// drawn pixels at another depth than the nearest one, so that edges stay sharp; `depth` is NaN where nothing is seen.
pub fn enlarged(picture: &[u8], depth: &[f32], from: [u32; 2], to: [u32; 2]) -> Vec<u8> {
    /// Depths within this share of each other are taken for one surface, as in the filter of indirect light.
    const SAME_DEPTH: f32 = 0.02;
    if from == to {
        return picture.to_vec();
    }
    let [width, height] = from.map(|side| side as usize);
    // For each place along a side: the two drawn pixels beside it, and the weight of the second.
    let beside = |axis: usize, at: usize| {
        let place = (at as f64 + 0.5) / f64::from(to[axis]) * f64::from(from[axis]) - 0.5;
        let place = place.clamp(0.0, f64::from(from[axis] - 1));
        let first = place.floor() as usize;
        (first, (first + 1).min(from[axis] as usize - 1), place.fract() as f32)
    };
    let columns: Vec<_> = (0..to[0] as usize).map(|column| beside(0, column)).collect();
    let row = |row: usize| {
        let (above, below, down) = beside(1, row);
        columns.iter().flat_map(move |&(left, right, along)| {
            let corners = [(above, left), (above, right), (below, left), (below, right)];
            let corners = corners.map(|(row, column)| row.min(height - 1) * width + column.min(width - 1));
            let weights = [(1.0 - down) * (1.0 - along), (1.0 - down) * along, down * (1.0 - along), down * along];
            let nearest = corners[usize::from(down >= 0.5) * 2 + usize::from(along >= 0.5)];
            let is_same = |pixel: usize| match (depth[pixel].is_nan(), depth[nearest].is_nan()) {
                (false, false) => (depth[pixel] - depth[nearest]).abs() <= SAME_DEPTH * depth[nearest].abs(),
                (one, other) => one == other,
            };
            let weights: [f32; 4] =
                std::array::from_fn(|corner| if is_same(corners[corner]) { weights[corner] } else { 0.0 });
            let sum: f32 = weights.iter().sum();
            [0, 1, 2, 3].map(|channel| {
                let value = |corner: usize| weights[corner] * f32::from(picture[corners[corner] * 4 + channel]);
                ((0..4).map(value).sum::<f32>() / sum).round() as u8
            })
        })
    };
    (0..to[1] as usize).into_par_iter().flat_map_iter(row).collect()
}

/// The sRGB encoding of IEC 61966-2-1, clamped.
fn encoded(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enlarged_picture_is_smooth_on_a_surface_and_sharp_at_its_edge() {
        // Two pixels on one surface, and two far behind it.
        let gray = |level: u8| [level, level, level, 255];
        let picture = [gray(0), gray(100), gray(200), gray(200)].concat();
        let depth = [1.0, 1.01, 5.0, 5.0];
        let levels =
            |to: [u32; 2]| -> Vec<u8> { enlarged(&picture, &depth, [4, 1], to).into_iter().step_by(4).collect() };
        assert_eq!(levels([4, 1]), [0, 100, 200, 200]);
        assert_eq!(levels([8, 1]), [0, 25, 75, 100, 200, 200, 200, 200]);
        assert_eq!(levels([4, 3]), [0, 100, 200, 200].repeat(3));
        let open = [1.0, f32::NAN, f32::NAN, 1.0];
        let levels: Vec<u8> = enlarged(&picture, &open, [4, 1], [8, 1]).into_iter().step_by(4).collect();
        assert_eq!(levels, [0, 0, 100, 125, 175, 200, 200, 200]);
    }

    #[test]
    fn a_picture_is_cut_to_its_mirrors_and_a_margin() {
        let size = [40, 30];
        let mut mirror = [0.0_f32; 40 * 30];
        (mirror[12 * 40 + 20], mirror[13 * 40 + 38]) = (1.0, 1.0);
        let picture: Vec<u8> =
            (0..40 * 30).flat_map(|pixel| [(pixel % 40) as u8, (pixel / 40) as u8, 7, 255]).collect();
        let bytes = cut(size, &mirror, &picture).unwrap().unwrap();
        let image = image::load_from_memory(&bytes).unwrap().to_rgb8();
        // From the mirror less the margin to the picture's right side.
        assert_eq!(image.dimensions(), (40 - 12, 14 + 8 - 4));
        assert_eq!([image.get_pixel(0, 0).0, image.get_pixel(27, 17).0], [[12, 4, 7], [39, 21, 7]]);
        assert!(cut(size, &[0.0; 40 * 30], &picture).unwrap().is_none());
    }

    #[test]
    fn the_mirrors_are_cut_out_and_shown_three_times() {
        // A mirror of 2 x 1 pixels in the middle of a row of three of 4.
        let mut mirror = [0.0_f32; 12];
        (mirror[5], mirror[6]) = (1.0, 1.0);
        let mut drawn = [[0.0_f32; 3]; 12];
        drawn[5] = [1.0, 0.0, 0.0];
        let mut truth = drawn;
        truth[6] = [1.0; 3];
        let bytes = beside([4, 3], &mirror, &drawn, &truth).unwrap().unwrap();
        let image = image::load_from_memory(&bytes).unwrap().to_rgb8();
        // Enlarged to 128 a pixel.
        assert_eq!(image.dimensions(), (3 * 256 + 16, 128));
        let at = |x, y| image.get_pixel(x, y).0;
        assert_eq!([at(0, 0), at(255, 127)], [[255, 0, 0], [0; 3]]);
        assert_eq!([at(264, 0), at(264 + 255, 127)], [[255, 0, 0], [255; 3]]);
        let ramp = render::ramp_colors(scene::Ramp::Magma);
        assert_eq!(
            [at(528, 0), at(528 + 255, 127)],
            [[0, 255]]
                .concat()
                .into_iter()
                .map(|level: usize| { [ramp[level][0], ramp[level][1], ramp[level][2]] })
                .collect::<Vec<_>>()[..]
        );
        assert!(beside([4, 3], &[0.0; 12], &drawn, &truth).unwrap().is_none());
    }
}
