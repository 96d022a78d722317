//! The error of a picture, estimated from exact answers at some of its pixels, with intervals that hold the figure of
//! all pixels in 95 of 100 cases. It needs no model of the scene and no ray tracer: the renderer answers.
//!
//! What a picture is judged against is the still picture of [`still_settings`]: the same view at full resolution with
//! all resident points, many virtual lights and `surfel_trace`. [`render::Renderer::probe`] asks it at random pixels
//! once; [`Judged::new`] judges any frame of that view by the answers, so that lower resolution, fewer points, another
//! method and fewer lights all count. [`estimate`] does both for the frame drawn last. The errors of pixels are those
//! of [`metrics`](crate::metrics).

use render::{Effort, Frame, MirrorProbe, PointStore, Probe, Renderer, SeenMirror, Shown};
use serde::Serialize;
use trace::MirrorPoint;

use crate::light::light_error;
use crate::metrics::{MirrorPixel, Percentiles, PixelError, pixel_error};
use crate::still::still_settings;

/// The number of mirror pixels, and of visible pixels, behind an estimate.
pub const RAYS: usize = 500;

/// The error of a picture, estimated. NaN (`null` in JSON) where nothing could be measured. Intervals are of 95 %.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The number of mirror pixels whose reflected rays were traced.
    pub rays: usize,
    /// The share of these pixels in which the picture shows something.
    pub filled: f64,
    /// The angle between what is shown and the reflected direction, over the change of that direction per pixel, of the
    /// filled pixels; none without mirrors or reflections.
    pub pixel_error: Option<EstimatedPercentiles>,
    /// The share of the filled pixels that are more than a pixel off, or show another surface.
    pub wrong: f64,
    pub wrong_interval: Option<[f64; 2]>,
    /// None without indirect light.
    pub indirect: Option<EstimatedLight>,
}

/// Percentiles with their intervals. The upper end is NaN where the samples are too few to have one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimatedPercentiles {
    pub median: f64,
    pub p95: f64,
    pub median_interval: [f64; 2],
    pub p95_interval: [f64; 2],
}

/// The error of indirect light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct EstimatedLight {
    /// As [`LightError::relative_rmse`](crate::LightError::relative_rmse).
    pub relative_rmse: f64,
    pub relative_rmse_interval: [f64; 2],
}

/// Estimates the error of the frame drawn last, from up to `rays` random mirror pixels and as many random visible
/// pixels; `seed` decides which. The frame has the camera, settings and objects of `view`, and is shown in its size.
/// `None` if there is nothing to estimate: no mirror whose reflections were looked for is seen, and there is no indirect
/// light.
///
/// # Errors
/// Nothing was rendered yet, no memory for the index of points or for the many lights, or the device was lost.
pub fn estimate(
    renderer: &mut Renderer,
    store: &PointStore,
    frame: Frame<'_>,
    rays: usize,
    seed: u64,
) -> render::Result<Option<Estimate>> {
    Ok(judge(renderer, store, frame, rays, seed)?.estimate())
}

/// The errors of the single pixels behind [`estimate`]. Where the frame has fewer pixels or points than the still
/// picture, a frame with all of them is drawn first, and then the frame again.
///
/// # Errors
/// Those of `estimate`.
pub fn judge(
    renderer: &mut Renderer,
    store: &PointStore,
    frame: Frame<'_>,
    rays: usize,
    seed: u64,
) -> render::Result<Judged> {
    let Frame { settings, objects, size, .. } = frame;
    let drawn = renderer.picture().map_or(size, |picture| [picture.width(), picture.height()]);
    let is_coarse = drawn != size || settings.splat.step > 1;
    if is_coarse {
        let mut fine = settings.clone();
        fine.splat.step = 1;
        renderer.render(store, &Frame { settings: &fine, effort: Effort::FULL, ..frame })?;
    }
    let probe = renderer.probe(store, &still_settings(settings), objects, rays, seed)?;
    if is_coarse {
        renderer.render(store, &Frame { size: drawn, ..frame })?;
    }
    let shown = renderer.shown_at(settings, &probe)?;
    Ok(Judged::new(&probe, &shown))
}

/// The errors of single pixels of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Judged {
    rays: usize,
    /// The errors of the filled mirror pixels.
    errors: Vec<PixelError>,
    /// The indirect light that is shown, and that of many lights.
    lights: Vec<[[f32; 3]; 2]>,
}

impl Judged {
    /// Judges what a frame shows by the answers of a probe.
    pub fn new(probe: &Probe, shown: &Shown) -> Self {
        let mirrors = probe.mirrors.iter().zip(&shown.mirrors);
        let errors = mirrors.filter_map(|(mirror, (found, coverage))| {
            let found = MirrorPixel { found: *found, coverage: *coverage, truth: mirror.truth, ..pixel(&mirror.place) };
            error_of(mirror, found)
        });
        let lights = probe.lights.iter().zip(&shown.lights).map(|(light, shown)| [*shown, light.truth]);
        Self { rays: probe.mirrors.len(), errors: errors.collect(), lights: lights.collect() }
    }

    /// Adds the errors of other pixels of the same view, or of another frame of it with the same settings.
    pub fn add(&mut self, other: Self) {
        self.rays += other.rays;
        self.errors.extend(other.errors);
        self.lights.extend(other.lights);
    }

    /// The figures; none if there are no pixels.
    pub fn estimate(&self) -> Option<Estimate> {
        let Self { rays, errors, lights } = self;
        if *rays == 0 && lights.is_empty() {
            return None;
        }
        let in_pixels: Vec<f64> = errors.iter().filter_map(|error| error.pixels).collect();
        let wrong = errors.iter().filter(|error| error.is_wrong()).count();
        Some(Estimate {
            rays: *rays,
            filled: errors.len() as f64 / *rays as f64,
            pixel_error: (*rays > 0).then(|| EstimatedPercentiles::of(in_pixels)),
            wrong: wrong as f64 / errors.len() as f64,
            wrong_interval: share_interval(wrong, errors.len()),
            indirect: (!lights.is_empty()).then(|| EstimatedLight::of(lights)),
        })
    }
}

impl EstimatedPercentiles {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let interval = |share: f64| {
            if values.is_empty() {
                return [f64::NAN; 2];
            }
            let [low, high] = quantile_ranks(values.len(), share);
            // Errors are at least 0.
            [low.map_or(0.0, |rank| values[rank - 1]), high.map_or(f64::NAN, |rank| values[rank - 1])]
        };
        let (median_interval, p95_interval) = (interval(0.5), interval(0.95));
        let Percentiles { median, p95, .. } = Percentiles::of(values);
        Self { median, p95, median_interval, p95_interval }
    }
}

impl EstimatedLight {
    fn of(lights: &[[[f32; 3]; 2]]) -> Self {
        let [shown, truth]: [Vec<[f32; 3]>; 2] = [0, 1].map(|side| lights.iter().map(|pair| pair[side]).collect());
        let relative_rmse = light_error(&vec![true; lights.len()], &shown, &truth).relative_rmse;
        // The logarithm of the figure depends almost linearly on the means over the pixels of the squares and of the
        // truth (delta method); its deviation is that of the mean of the pixels' parts in it.
        let count = lights.len() as f64;
        let parts = lights.iter().map(|[shown, truth]| {
            let pairs = shown.iter().zip(truth).map(|(shown, truth)| (f64::from(*shown), f64::from(*truth)));
            pairs.fold([0.0; 2], |[squares, sum], (shown, truth)| [squares + (shown - truth).powi(2), sum + truth])
        });
        let parts: Vec<[f64; 2]> = parts.collect();
        let [squares, sum] = [0, 1].map(|part| parts.iter().map(|parts| parts[part]).sum::<f64>() / count);
        let squared = |[own_squares, own_sum]: &[f64; 2]| (0.5 * own_squares / squares - own_sum / sum + 0.5).powi(2);
        let deviation = (parts.iter().map(squared).sum::<f64>() / (count - 1.0).max(1.0) / count).sqrt();
        let reach = if squares > 0.0 { (TAIL_DEVIATIONS * deviation).exp() } else { 1.0 };
        Self { relative_rmse, relative_rmse_interval: [relative_rmse / reach, relative_rmse * reach] }
    }
}

/// The share of cases that an interval misses at each end.
const TAIL: f64 = 0.025;
/// The number of standard deviations beyond which a normal distribution has this share.
const TAIL_DEVIATIONS: f64 = 1.959_963_984_540_054;

/// A mirror pixel of which only the place is known.
fn pixel(seen: &SeenMirror) -> MirrorPixel {
    let SeenMirror { position, normal, incoming } = *seen;
    let reflected = MirrorPoint { position, normal, incoming }.reflected();
    let reflected = reflected.map_or(glam::DVec3::ZERO, |ray| ray.direction);
    MirrorPixel { position, incoming, reflected, found: glam::DVec3::NAN, coverage: 0.0, truth: None }
}

/// The error of a filled pixel; none for others.
fn error_of(mirror: &MirrorProbe, found: MirrorPixel) -> Option<PixelError> {
    // The pixel with the four beside it, in a picture of three by three.
    let [left, right, upper, lower] = mirror.beside.map(|seen| seen.as_ref().map(pixel));
    pixel_error(3, &[None, upper, None, left, Some(found), right, None, lower, None], 4)
}

/// The interval of a share of which `count` of `all` independent samples are (Wilson 1927); none without samples.
pub fn share_interval(count: usize, all: usize) -> Option<[f64; 2]> {
    if all == 0 {
        return None;
    }
    let (count, all, squared) = (count as f64, all as f64, TAIL_DEVIATIONS.powi(2));
    let middle = (count + squared / 2.0) / (all + squared);
    let reach = TAIL_DEVIATIONS / (all + squared) * (count * (all - count) / all + squared / 4.0).sqrt();
    // Rounding must not move the ends at 0 and 1.
    let low = if count == 0.0 { 0.0 } else { middle - reach };
    Some([low, if count == all { 1.0 } else { middle + reach }])
}

/// The ranks, from 1, of the sorted samples between which the value lies that a `share` of all values does not exceed:
/// the number of samples at or below it has a binomial distribution, whatever that of the values is. None at an end
/// where even the outermost of `count` samples is not far enough out.
pub fn quantile_ranks(count: usize, share: f64) -> [Option<usize>; 2] {
    // Up to the rank `low` - 1 and from the rank `high` on, the distribution has at most a tail.
    let (mut low, mut high) = (None, None);
    let mut below = 0.0;
    let mut logarithm = count as f64 * (1.0 - share).ln();
    for rank in 0..=count {
        // Here `below` is the chance of fewer than `rank` samples.
        if rank > 0 && below <= TAIL {
            low = Some(rank);
        }
        if rank > 0 && high.is_none() && 1.0 - below <= TAIL {
            high = Some(rank);
        }
        below += logarithm.exp();
        logarithm += ((count - rank) as f64 / (rank + 1) as f64 * share / (1.0 - share)).ln();
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use cloud::Random;

    use super::*;

    /// The chance of at most `most` of `count`, by the sum of binomial coefficients.
    fn at_most(most: usize, count: usize, share: f64) -> f64 {
        let coefficient = |k: usize| (0..k).map(|i| (count - i) as f64 / (i + 1) as f64).product::<f64>();
        (0..=most).map(|k| coefficient(k) * share.powi(k as i32) * (1.0 - share).powi((count - k) as i32)).sum()
    }

    #[test]
    fn intervals_of_shares_are_wilsons() {
        // Brown, Cai and DasGupta 2001: the ends solve |p - k/n| = z sqrt(p (1 - p) / n).
        for (count, all) in [(0, 10), (3, 10), (10, 10), (7, 500), (250, 500), (1, 1)] {
            let [low, high] = share_interval(count, all).unwrap();
            let share = count as f64 / all as f64;
            for end in [low, high] {
                let deviation = TAIL_DEVIATIONS * (end * (1.0 - end) / all as f64).sqrt();
                assert!(((end - share).abs() - deviation).abs() < 1e-12, "{count} of {all}: {end}");
            }
            assert!(low <= share && share <= high && (low < high), "{count} of {all}");
        }
        // The rule of three, which Wilson's interval follows with z^2 / n.
        let [low, high] = share_interval(0, 1000).unwrap();
        assert!(low == 0.0 && (high - 3.8415 / 1003.8415).abs() < 1e-6, "{high}");
        assert_eq!(share_interval(0, 0), None);
    }

    #[test]
    fn ranks_about_a_quantile_leave_a_tail_at_each_end() {
        for (count, share) in [(1, 0.5), (5, 0.5), (6, 0.5), (20, 0.5), (100, 0.5), (60, 0.95), (72, 0.95), (100, 0.95)]
        {
            let [low, high] = quantile_ranks(count, share);
            // The value lies below the sample of rank r if fewer than r samples are at or below it.
            if let Some(low) = low {
                assert!(at_most(low - 1, count, share) <= TAIL, "{count}, {share}: {low}");
            }
            assert!(at_most(low.unwrap_or(0), count, share) > TAIL, "{count}, {share}: no tighter {low:?}");
            if let Some(high) = high {
                assert!(1.0 - at_most(high - 1, count, share) <= TAIL, "{count}, {share}: {high}");
            }
            let tighter = high.map_or(count, |high| high - 1);
            assert!(tighter == 0 || 1.0 - at_most(tighter - 1, count, share) > TAIL, "{count}, {share}: {high:?}");
        }
        // Six samples have the median between the least and the greatest in 31 of 32 cases (Conover 1999).
        assert_eq!((quantile_ranks(5, 0.5), quantile_ranks(6, 0.5)), ([None, None], [Some(1), Some(6)]));
        assert_eq!(quantile_ranks(100, 0.5), [Some(40), Some(61)]);
        let [low, high] = quantile_ranks(20_000, 0.95);
        // The normal approximation: 19,000 and 1.96 times the root of 950 about it.
        assert!(low.unwrap().abs_diff(18_939) < 3 && high.unwrap().abs_diff(19_061) < 3, "{low:?} {high:?}");
    }

    fn errors(random: &mut Random, count: usize) -> Judged {
        let unit = |random: &mut Random| (random.draw() >> 11) as f64 / (1_u64 << 53) as f64;
        let mut judged = Judged { rays: count, ..Judged::default() };
        for _ in 0..count {
            // Exponential, with the median ln 2 and a share of e^-1 above 1.
            let pixels = -(1.0 - unit(random)).ln();
            judged.errors.push(PixelError {
                angle: 0.0,
                pixels: Some(pixels),
                is_off: Some(pixels > 1.0),
                is_other_surface: None,
            });
            let noise = (unit(random) - 0.5) as f32;
            judged.lights.push([[2.0 + noise; 3], [2.0; 3]]);
        }
        judged
    }

    #[test]
    fn intervals_hold_the_true_figure_in_95_of_100_cases() {
        let mut random = Random(7);
        let cases = 400;
        let mut held = [0; 4];
        for _ in 0..cases {
            let Estimate { pixel_error, wrong_interval, indirect, .. } = errors(&mut random, 200).estimate().unwrap();
            let (pixel_error, indirect) = (pixel_error.unwrap(), indirect.unwrap());
            let figures = [
                (pixel_error.median_interval, 2.0_f64.ln()),
                (pixel_error.p95_interval, 20.0_f64.ln()),
                (wrong_interval.unwrap(), (-1.0_f64).exp()),
                // The deviation of an even distribution over a range of 1.
                (indirect.relative_rmse_interval, (1.0_f64 / 12.0).sqrt() / 2.0),
            ];
            for (held, ([low, high], truth)) in held.iter_mut().zip(figures) {
                *held += u32::from(low <= truth && truth <= high);
            }
        }
        // Four standard deviations about 95 %; the ranks are discrete, so that these intervals hold a little more.
        assert!(held.iter().all(|held| (362..=398).contains(held)), "{held:?} of {cases}");
    }

    #[test]
    fn samples_add_up_and_nothing_gives_no_estimate() {
        assert_eq!(Judged::default().estimate(), None);
        let mut random = Random(1);
        let (first, second) = (errors(&mut random, 100), errors(&mut random, 300));
        let mut both = first.clone();
        both.add(second);
        let width = |judged: &Judged| {
            let [low, high] = judged.estimate().unwrap().wrong_interval.unwrap();
            high - low
        };
        assert_eq!(both.estimate().unwrap().rays, 400);
        assert!((width(&both) / width(&first) - 0.5).abs() < 0.1, "four times the samples, half the interval");
        let unfilled = Judged { rays: 10, ..Judged::default() }.estimate().unwrap();
        assert!(unfilled.filled == 0.0 && unfilled.wrong.is_nan() && unfilled.wrong_interval.is_none());
        let json = serde_json::to_value(&unfilled).unwrap();
        assert!(json["pixel_error"]["median"].is_null() && json["wrong"].is_null() && json["indirect"].is_null());
        let json = serde_json::to_value(first.estimate()).unwrap();
        assert_eq!(json["rays"], 100);
        assert!(json["pixel_error"]["p95"].is_f64() && json["wrong_interval"][1].is_f64());
        assert!(json["indirect"]["relative_rmse"].is_f64(), "{json}");
    }
}
