//! The figures of accuracy of one picture, over its mirror pixels.
//!
//! A mirror pixel shows the point P of a mirror; the eye's ray is reflected there into a direction R. A method claims
//! to see the point Q; in truth the ray along R ends in H.

use glam::DVec3;
use palette::color_difference::Ciede2000;
use palette::white_point::D65;
use palette::{FromColor, Lab, LinSrgb};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::flip::flip;
use crate::light::LightError;
use crate::ssim::ssim;

/// The reference of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Truth {
    /// Rays from the picture's own mirror points into the points from which it was drawn, as discs: gives the method's
    /// error alone.
    SameInput,
    /// Rays from exact mirrors into exact surfaces: gives the errors of method and sampling.
    Exact,
}

/// How accurate the places of reflections are. NaN (`null` in JSON) where nothing could be measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    pub truth: Truth,
    /// The number of pixels behind the figures.
    pub mirror_pixels: usize,
    /// The share of the mirror pixels for which a point was found.
    pub coverage: f64,
    /// The share of the mirror pixels that are filled, by a point found or from neighbours.
    pub closed_coverage: f64,
    /// The share of the mirror pixels that are filled although the truth sees nothing there.
    pub false_fill: f64,
    /// The angle between Q - P and R over the filled pixels, in degrees.
    pub angle_error: Percentiles,
    /// The error in pixels: relative to the angle by which R changes from this pixel to the next.
    pub pixel_error: Percentiles,
    /// The share of the pixels that are filled and see something whose |Q - P| differs from |H - P| by more than 5 %.
    pub occlusion_error: f64,
    /// The share of the filled pixels that are wrong: more than a pixel off, or of another surface.
    #[serde(default = "unknown")]
    pub wrong: f64,
    /// The share of the points truly visible by reflection that were found; only with the same input.
    pub recall: Option<f64>,
    pub image: Option<ImageError>,
    /// The error of the indirect light of all pixels, not of mirrors alone.
    pub indirect: Option<LightError>,
    /// The error of all visible surfaces; only with exact surfaces.
    #[serde(default)]
    pub surface: Option<SurfaceError>,
}

/// The value of a figure that was not measured.
fn unknown() -> f64 {
    f64::NAN
}

/// The values that half, 95 and 99 of a hundred do not exceed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    pub median: f64,
    pub p95: f64,
    pub p99: f64,
}

impl Percentiles {
    /// Percentiles by nearest rank. NaN if there are no values.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let rank = (share * values.len() as f64).ceil() as usize;
            values.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
        };
        Self { median: rank(0.5), p95: rank(0.95), p99: rank(0.99) }
    }
}

/// One mirror pixel. Positions are world coordinates, directions unit vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirrorPixel {
    /// P.
    pub position: DVec3,
    /// The direction of the eye's ray.
    pub incoming: DVec3,
    /// R; zero if the mirror point has no normal, so that only its coverage can be judged.
    pub reflected: DVec3,
    /// Q.
    pub found: DVec3,
    /// 0: nothing found, and Q is meaningless; 1: found; 0.75: found, but not proven; below: closed from neighbours.
    pub coverage: f64,
    /// H, if the ray ends anywhere.
    pub truth: Option<DVec3>,
}

/// Distances that differ by more than this share belong to different surfaces.
const OCCLUSION_TOLERANCE: f64 = 0.05;

/// Judges a picture of rows of `width` pixels, `None` where there is no mirror.
pub fn accuracy(truth: Truth, width: usize, pixels: &[Option<MirrorPixel>]) -> Accuracy {
    let mirrors = || pixels.iter().flatten();
    let mirror_pixels = mirrors().count();
    let share = |is_counted: fn(&MirrorPixel) -> bool| {
        mirrors().filter(|pixel| is_counted(pixel)).count() as f64 / mirror_pixels as f64
    };
    let errors: Vec<PixelError> = (0..pixels.len()).filter_map(|index| pixel_error(width, pixels, index)).collect();
    let compared = errors.iter().filter_map(|error| error.is_other_surface);
    let (compared, occluded) =
        compared.fold((0_u32, 0), |(all, wrong), is_wrong| (all + 1, wrong + u32::from(is_wrong)));
    Accuracy {
        truth,
        mirror_pixels,
        coverage: share(|pixel| pixel.coverage >= 0.75),
        closed_coverage: share(MirrorPixel::is_filled),
        false_fill: share(|pixel| pixel.is_filled() && pixel.truth.is_none()),
        angle_error: Percentiles::of(errors.iter().map(|error| error.angle).collect()),
        pixel_error: Percentiles::of(errors.iter().filter_map(|error| error.pixels).collect()),
        occlusion_error: f64::from(occluded) / f64::from(compared),
        wrong: errors.iter().filter(|error| error.is_wrong()).count() as f64 / errors.len() as f64,
        recall: None,
        image: None,
        indirect: None,
        surface: None,
    }
}

/// How far visible surfaces are from their true places, mirrors included. NaN (`null` in JSON) where nothing could be
/// measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceError {
    /// The share of the pixels in which the truth sees something and the picture nothing.
    pub missing: f64,
    /// The share of the pixels in which the picture shows something and the truth nothing.
    pub false_fill: f64,
    /// The distance between the shown position and the hit of the ray through the pixel's centre, in world units, where
    /// both exist.
    pub position_error: Percentiles,
}

/// Compares the shown positions of pixels with the true ones; NaN where nothing is seen.
pub fn surface_error(drawn: &[DVec3], truth: &[DVec3]) -> SurfaceError {
    let is_something = |position: &&DVec3| position.is_finite();
    let pairs = || drawn.iter().zip(truth);
    let lacking = |of: &[DVec3], in_other: &[DVec3]| {
        let alone = of.iter().zip(in_other).filter(|(one, other)| one.is_finite() && !other.is_finite());
        alone.count() as f64 / of.iter().filter(is_something).count() as f64
    };
    let both = pairs().filter(|(drawn, truth)| drawn.is_finite() && truth.is_finite());
    SurfaceError {
        missing: lacking(truth, drawn),
        false_fill: lacking(drawn, truth),
        position_error: Percentiles::of(both.map(|(drawn, truth)| drawn.distance(*truth)).collect()),
    }
}

/// The error of one pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelError {
    /// The angle between Q - P and R in degrees.
    pub angle: f64,
    /// The error relative to the angle by which R changes from this pixel to the next; none if R does not change by more
    /// than rounding does (a thousandth of a degree), as in a plane mirror in parallel projection.
    pub pixels: Option<f64>,
    /// Whether the error is more than a pixel, or more than rounding where R does not change; none without a neighbour.
    pub is_off: Option<bool>,
    /// Whether |Q - P| differs from |H - P| by more than 5 %; none if the truth sees nothing.
    pub is_other_surface: Option<bool>,
}

impl PixelError {
    /// Whether the pixel is more than a pixel off, or shows another surface.
    pub fn is_wrong(&self) -> bool {
        self.is_off == Some(true) || self.is_other_surface == Some(true)
    }
}

/// The angle in degrees up to which reflected directions count as the same. Rounding of positions turns them by less,
/// unless what is seen is a thousand times nearer to the mirror than the eye is. From pixel to pixel a plane mirror in a
/// picture of 1000 pixels turns them by more, unless the field of view is a degree.
const STEADY: f64 = 1e-3;

/// The error of a filled pixel; none for others. Arguments as in [`accuracy`] and [`direction_step`].
pub fn pixel_error(width: usize, pixels: &[Option<MirrorPixel>], index: usize) -> Option<PixelError> {
    let pixel = pixels[index].filter(|pixel| pixel.is_filled() && pixel.reflected != DVec3::ZERO)?;
    let angle = pixel.angle_error();
    let is_other_surface = pixel.truth.map(|truth| {
        let [found, true_distance] = [pixel.found, truth].map(|end| end.distance(pixel.position));
        // The comparison counts a distance that is no number as wrong.
        let is_same = (found - true_distance).abs() <= OCCLUSION_TOLERANCE * true_distance;
        !is_same
    });
    let step = direction_step(width, pixels, index);
    let in_pixels = step.filter(|step| *step > STEADY).map(|step| angle / step);
    let is_off = step.map(|step| angle > step.max(STEADY));
    Some(PixelError { angle, pixels: in_pixels, is_off, is_other_surface })
}

impl MirrorPixel {
    fn is_filled(&self) -> bool {
        self.coverage > 0.0
    }

    /// The error in degrees. A point that is not finite, or on the mirror point itself, has the largest error.
    fn angle_error(&self) -> f64 {
        match (self.found - self.position).try_normalize() {
            Some(direction) => angle(direction, self.reflected),
            None => 180.0,
        }
    }
}

/// The angle between two unit vectors in degrees; exact for small ones, where the cosine is not.
fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Neighbours whose points are this much farther apart along the ray than across it are on different surfaces, or on
/// one seen flatter than 3 degrees. At the built-in scenes' size it is a twentieth of the distance.
const DEPTH_STEP: f64 = 20.0;

/// The change of the reflected direction from a mirror pixel to the next in degrees: the larger of the mean changes to
/// the left and right and to the upper and lower neighbour, without neighbours that show no mirror or lie beyond a
/// depth step; 0 if nothing changes. `None` if no neighbour is left.
pub fn direction_step(width: usize, pixels: &[Option<MirrorPixel>], index: usize) -> Option<f64> {
    let pixel = pixels.get(index).copied().flatten()?;
    let column = index % width;
    let change = |neighbour: Option<usize>| {
        let other = pixels.get(neighbour?).copied().flatten()?;
        let offset = other.position - pixel.position;
        let along = offset.dot(pixel.incoming).abs();
        let across = offset.reject_from_normalized(pixel.incoming).length();
        let is_same_surface = along <= DEPTH_STEP * across && other.reflected != DVec3::ZERO;
        is_same_surface.then(|| angle(pixel.reflected, other.reflected))
    };
    let mean = |neighbours: [Option<usize>; 2]| match neighbours.map(change) {
        [Some(a), Some(b)] => Some((a + b) / 2.0),
        [one, other] => one.or(other),
    };
    let sideways = mean([(column > 0).then(|| index - 1), (column + 1 < width).then_some(index + 1)]);
    let upright = mean([index.checked_sub(width), Some(index + width)]);
    sideways.into_iter().chain(upright).reduce(f64::max)
}

/// How different a picture looks, over its mirror pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageError {
    /// The root of the mean square difference of linear red, green and blue, not clamped.
    pub rmse: f64,
    /// The mean CIEDE2000 difference in CIELAB (D65, 2 degrees).
    pub delta_e: f64,
    /// The CIEDE2000 difference that 95 of 100 of the pixels do not exceed.
    #[serde(default = "unknown")]
    pub delta_e_p95: f64,
    /// The mean of the FLIP differences, 0 to 1; see [`flip`](crate::flip).
    pub flip: f64,
    /// The mean structural similarity, -1 to 1, 1 for equal pictures; see [`ssim`](crate::ssim).
    pub ssim: f64,
    /// The roots of the mean square differences of L*, a* and b* in CIELAB.
    #[serde(default = "unknown_lab")]
    pub rmse_lab: [f64; 3],
}

/// The values of three figures that were not measured.
fn unknown_lab() -> [f64; 3] {
    [f64::NAN; 3]
}

/// Compares two pictures, linear red, green and blue, over the pixels marked in `mirror`; other pixels do not matter.
/// Colours that are not finite (empty pixels) count as black. Delta E, FLIP and SSIM see colours as a screen shows
/// them, clamped to 0 ..= 1. `width` is that of a row. NaN if no pixel is marked.
pub fn image_error(width: usize, mirror: &[bool], picture: &[[f32; 3]], reference: &[[f32; 3]]) -> ImageError {
    // Outside the mirrors both are black, so that nothing affects the mirrors through the filters of FLIP and SSIM.
    let of_mirrors = |colors: &[[f32; 3]]| -> Vec<[f64; 3]> {
        let marked = colors.iter().zip(mirror);
        marked.map(|(color, is_mirror)| if *is_mirror { finite(color) } else { [0.0; 3] }).collect()
    };
    let (picture, reference) = (of_mirrors(picture), of_mirrors(reference));
    let flip = flip(width, &picture, &reference);
    let ssim = ssim(width, &picture, &reference);
    let (mut count, mut squares, mut flip_sum, mut ssim_sum) = (0.0, 0.0, 0.0, 0.0);
    let mut delta_e = Vec::new();
    let mut lab_squares = [0.0; 3];
    for index in (0..mirror.len()).filter(|&index| mirror[index]) {
        let (color, true_color) = (picture[index], reference[index]);
        count += 1.0;
        squares += (0..3).map(|channel| (color[channel] - true_color[channel]).powi(2)).sum::<f64>() / 3.0;
        let (shown, truth) = (lab(color), lab(true_color));
        delta_e.push(shown.difference(truth));
        for (sum, difference) in lab_squares.iter_mut().zip([shown.l - truth.l, shown.a - truth.a, shown.b - truth.b]) {
            *sum += difference * difference;
        }
        flip_sum += flip[index];
        ssim_sum += ssim[index];
    }
    ImageError {
        rmse: (squares / count).sqrt(),
        delta_e: delta_e.iter().sum::<f64>() / count,
        delta_e_p95: Percentiles::of(delta_e).p95,
        flip: flip_sum / count,
        ssim: ssim_sum / count,
        rmse_lab: lab_squares.map(|sum| (sum / count).sqrt()),
    }
}

/// The CIEDE2000 difference of each pixel of two pictures, linear red, green and blue, as in [`image_error`].
pub fn delta_e(picture: &[[f32; 3]], reference: &[[f32; 3]]) -> Vec<f32> {
    let difference = |(color, truth): (&[f32; 3], &[f32; 3])| lab(finite(color)).difference(lab(finite(truth))) as f32;
    picture.par_iter().zip(reference).map(difference).collect()
}

/// Replaces missing colours by black.
fn finite(color: &[f32; 3]) -> [f64; 3] {
    color.map(|value| if value.is_finite() { f64::from(value) } else { 0.0 })
}

pub(crate) fn lab(color: [f64; 3]) -> Lab<D65, f64> {
    let [red, green, blue] = color.map(|value| value.clamp(0.0, 1.0));
    Lab::from_color(LinSrgb::new(red, green, blue))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(axis: DVec3, degrees: f64, direction: DVec3) -> DVec3 {
        glam::DQuat::from_axis_angle(axis, degrees.to_radians()) * direction
    }

    /// A pixel at (x, 0, 0), seen from above, that reflects along z turned by `degrees` about y, into a ceiling at
    /// distance 2.
    fn pixel(x: f64, degrees: f64) -> MirrorPixel {
        let (position, reflected) = (DVec3::X * x, turned(DVec3::Y, degrees, DVec3::Z));
        let end = position + reflected * 2.0;
        MirrorPixel { position, incoming: -DVec3::Z, reflected, found: end, coverage: 1.0, truth: Some(end) }
    }

    #[test]
    fn percentiles_are_the_values_that_so_many_do_not_exceed() {
        let values = (1..=200).rev().map(f64::from).collect();
        assert_eq!(Percentiles::of(values), Percentiles { median: 100.0, p95: 190.0, p99: 198.0 });
        assert_eq!(Percentiles::of(vec![3.0]), Percentiles { median: 3.0, p95: 3.0, p99: 3.0 });
        assert!(Percentiles::of(Vec::new()).median.is_nan());
    }

    #[test]
    fn each_figure_counts_what_it_says() {
        // Directions two degrees apart.
        let [right, missing, mut closed, mut open, mut far, mut lost] = [0, 1, 2, 3, 4, 5].map(|column| {
            let column = f64::from(column);
            pixel(column, 2.0 * column)
        });
        let missing = MirrorPixel { coverage: 0.0, found: DVec3::NAN, ..missing };
        closed.coverage = 0.4;
        closed.found = closed.position + turned(DVec3::X, 3.0, closed.reflected) * 2.0;
        open.truth = None;
        far.found = far.position + far.reflected * 2.2;
        lost.found = lost.position;
        let row = [Some(right), Some(missing), Some(closed), Some(open), Some(far), Some(lost), None];
        let figures = accuracy(Truth::SameInput, row.len(), &row);
        assert_eq!(figures.mirror_pixels, 6);
        let shares = [figures.coverage, figures.closed_coverage, figures.false_fill, figures.occlusion_error];
        assert_eq!(shares, [4.0 / 6.0, 5.0 / 6.0, 1.0 / 6.0, 2.0 / 4.0]);
        // The angles are 0, 3, 0, 0 and 180 degrees: a point on the mirror point itself has no direction.
        let turn = angle(turned(DVec3::X, 3.0, closed.reflected), closed.reflected);
        assert!(figures.angle_error.median < 1e-9 && figures.angle_error.p99 == 180.0, "{figures:?}");
        assert!((angle_of(&row[..3]) - turn).abs() < 1e-12 && turn > 2.9);
        // Wrong are the closed one, 3 degrees or 1.5 pixels off, the far one and the lost one.
        assert_eq!(figures.wrong, 3.0 / 5.0);
        let in_pixels = accuracy(Truth::SameInput, 7, &row[..3]).pixel_error;
        assert!((in_pixels.p99 - turn / 2.0).abs() < 1e-9, "{in_pixels:?}");
    }

    fn angle_of(pixels: &[Option<MirrorPixel>]) -> f64 {
        accuracy(Truth::Exact, pixels.len(), pixels).angle_error.p99
    }

    #[test]
    fn angles_far_below_a_pixel_are_measured() {
        for degrees in [1e-9, 1e-4, 0.5, 90.0, 179.0] {
            let right = pixel(0.0, 0.0);
            let off = MirrorPixel { found: right.position + turned(DVec3::Y, degrees, right.reflected) * 7.0, ..right };
            assert!((angle_of(&[Some(off)]) / degrees - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn where_directions_do_not_change_an_error_is_wrong_but_has_no_size_in_pixels() {
        // A plane mirror in parallel projection, with the rounding of f32.
        let flat = |x: f64, degrees: f64| {
            let pixel = pixel(x, 2e-5 * x);
            MirrorPixel { found: pixel.position + turned(DVec3::Y, degrees, DVec3::Z) * 2.0, ..pixel }
        };
        let row = [0.0, 1e-4, 15.0].map(|degrees| Some(flat(degrees / 15.0, degrees)));
        let errors = [0, 1, 2].map(|index| pixel_error(3, &row, index).unwrap());
        assert_eq!(errors.map(|error| error.pixels), [None; 3]);
        assert_eq!(errors.map(|error| error.is_wrong()), [false, false, true]);
        assert_eq!(pixel_error(1, &row[2..], 0).unwrap().is_off, None, "without a neighbour nothing is known");
    }

    #[test]
    fn direction_step_is_the_larger_of_both_ways_within_one_surface() {
        // Two degrees a column, three a row; a third column of 5 more degrees, and one far behind the others.
        let at = |column: f64, row: f64, degrees: f64| {
            let mut pixel = pixel(column, degrees);
            pixel.position.y = row;
            pixel.reflected = turned(DVec3::X, 3.0 * row, DVec3::Z);
            pixel.reflected = turned(DVec3::Y, degrees, pixel.reflected);
            Some(pixel)
        };
        let behind =
            at(3.0, 0.0, 60.0).map(|pixel| MirrorPixel { position: pixel.position - DVec3::Z * 30.0, ..pixel });
        let rows = [
            at(0.0, 0.0, 0.0),
            at(1.0, 0.0, 2.0),
            at(2.0, 0.0, 9.0),
            behind,
            at(0.0, 1.0, 0.0),
            None,
            at(2.0, 1.0, 9.0),
            None,
        ];
        let step = |index: usize| direction_step(4, &rows, index);
        assert!((step(0).unwrap() - 3.0).abs() < 1e-9, "the row below");
        assert!((step(1).unwrap() - (2.0 + 7.0) / 2.0).abs() < 1e-9, "the mean of left and right");
        assert!((step(2).unwrap() - 7.0).abs() < 1e-9, "what is behind is no neighbour");
        assert_eq!((step(3), step(5)), (None, None));
        assert_eq!(direction_step(1, &[at(0.0, 0.0, 0.0)], 0), None);
    }

    #[test]
    fn figures_have_the_names_that_charts_rely_on() {
        let mut figures = accuracy(Truth::SameInput, 1, &[Some(pixel(0.0, 0.0))]);
        let image = ImageError { rmse: 0.5, delta_e: 2.0, delta_e_p95: 4.0, flip: 0.25, ssim: 0.9, rmse_lab: [1.0; 3] };
        figures.image = Some(image);
        figures.indirect = Some(LightError { relative_rmse: 0.1, mean_ratio: 0.9, brightest_ratio: 2.0 });
        let json = serde_json::to_value(&figures).unwrap();
        assert_eq!(json["truth"], "same_input");
        assert_eq!(json["angle_error"]["p95"], 0.0);
        assert!(json["pixel_error"]["median"].is_null(), "no neighbour, no pixel error");
        assert_eq!(json["image"]["flip"], 0.25);
        assert_eq!(json["image"]["ssim"], 0.9);
        assert_eq!(json["indirect"]["relative_rmse"], 0.1);
        assert_eq!(json["indirect"]["mean_ratio"], 0.9);
        for name in ["coverage", "closed_coverage", "false_fill", "occlusion_error", "wrong", "recall"] {
            assert!(json.get(name).is_some(), "{name}");
        }
    }

    #[test]
    fn image_errors_are_those_of_the_mirror_pixels() {
        let reference = vec![[0.5, 0.2, 0.1]; 64];
        let mut picture = vec![[0.45, 0.25, 0.12]; 64];
        let mirror: Vec<bool> = (0..64).map(|index| index % 8 > 2).collect();
        let found = image_error(8, &mirror, &picture, &reference);
        // The CIEDE2000 difference of the pair according to colour-science 0.4.
        assert!((found.delta_e - 7.34935).abs() < 1e-3, "{}", found.delta_e);
        assert!((found.delta_e_p95 - found.delta_e).abs() < 1e-9, "{found:?}");
        // Four of forty mirror pixels are off: more than the one in twenty that the percentile leaves out.
        let mut few = reference.clone();
        (3..7).for_each(|index| few[index] = [0.45, 0.25, 0.12]);
        let of_few = image_error(8, &mirror, &few, &reference);
        assert!((of_few.delta_e * 10.0 - found.delta_e).abs() < 1e-9 && of_few.delta_e_p95 == found.delta_e_p95);
        few[4..7].fill(reference[0]);
        assert_eq!(image_error(8, &mirror, &few, &reference).delta_e_p95, 0.0, "one of forty");
        let mean_square = (0.05_f64.powi(2) + 0.05_f64.powi(2) + 0.02_f64.powi(2)) / 3.0;
        assert!((found.rmse - mean_square.sqrt()).abs() < 1e-6 && found.flip > 0.05, "{found:?}");
        // Every pixel is off by the same.
        let (one, other) = (lab([0.45, 0.25, 0.12]), lab([0.5, 0.2, 0.1]));
        for (error, expected) in found.rmse_lab.iter().zip([one.l - other.l, one.a - other.a, one.b - other.b]) {
            assert!((error - expected.abs()).abs() < 1e-4 && *error > 0.1, "{error}, {expected}");
        }
        // Pixels without a mirror do not matter, not even through the filters.
        picture.iter_mut().zip(&mirror).filter(|(_, is_mirror)| !**is_mirror).for_each(|(color, _)| *color = [9.0; 3]);
        assert_eq!(image_error(8, &mirror, &picture, &reference), found);
        let mut other = reference.clone();
        other.iter_mut().zip(&mirror).filter(|(_, is_mirror)| !**is_mirror).for_each(|(color, _)| *color = [0.9; 3]);
        assert_eq!(image_error(8, &mirror, &picture, &other), found);
        let same = image_error(8, &mirror, &reference, &reference);
        assert_eq!((same.rmse, same.delta_e, same.flip), (0.0, 0.0, 0.0));
        assert!((same.ssim - 1.0).abs() < 1e-9 && found.ssim < 1.0, "{found:?}");
        let empty = image_error(8, &mirror, &[[f32::NAN; 3]; 64], &[[0.0; 3]; 64]);
        assert_eq!(empty, same, "empty pixels are black");
    }
}
