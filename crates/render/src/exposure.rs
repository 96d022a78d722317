//! The exposure of a picture, fitted to how bright its lit surfaces are.
//!
//! A histogram counts the pixels by the logarithm of their luminance. The fit brings the median to a middle grey, unless
//! the brightest surfaces would then be burnt out: a sunlit wall beside a dark wood decides for both. The histogram counts
//! with whole numbers, so the same picture has the same exposure every time. The shaders are `exposure_histogram` and
//! `exposure_fit`; the exposure goes from there to the parameters that the last pass reads, without a wait for the CPU.

use scene::{ExposureFit, Lighting, ResolvedLight, Settings};

use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{self, EXPOSURE_BINS, EXPOSURE_COUNT_BYTES, FittedExposure};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, Targets, storage, uniform_buffer};

/// The exposure of a picture, which was fitted to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// The stops that the picture is brightened by, with those of `tone.exposure`.
    pub stops: f32,
    /// Whether the exposure is on its way to the one that fits (`Effort::adaptation`).
    pub adapts: bool,
}

/// How the exposure of a picture follows that of the picture before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptation {
    /// The stops that the picture before was brightened by, without those of `tone.exposure`.
    pub before: f32,
    /// The share of the way from there to the exposure that fits.
    pub share: f32,
}

impl Adaptation {
    /// Where the exposure gets to on its way to the stops that fit a picture: the twin of `exposure_fit`.
    pub(crate) fn go_to(self, fitting: f32, parameter: f32) -> Exposure {
        let shown = self.before + (fitting - self.before) * self.share;
        let adapts = (shown - fitting).abs() >= CLOSE;
        Exposure { stops: parameter + if adapts { shown } else { fitting }, adapts }
    }
}

impl From<FittedExposure> for Exposure {
    fn from(fitted: FittedExposure) -> Self {
        Self { stops: fitted.stops, adapts: fitted.adapts != 0 }
    }
}

/// The buffers that a fit works on.
pub(crate) struct ExposureMeter {
    histogram: wgpu::Buffer,
    pub fitted: wgpu::Buffer,
    /// Whether the last frame was fitted.
    pub is_used: bool,
}

/// Whether the settings ask for a fit under this light. The colours of the data are never changed.
pub(crate) fn is_fitted(settings: &Settings, light: ResolvedLight) -> bool {
    match settings.tone.fit {
        ExposureFit::Auto => light.is_guess,
        ExposureFit::Always => light.by != Lighting::Colors,
        ExposureFit::Locked => false,
    }
}

impl ExposureMeter {
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            histogram: storage(&gpu.device, "histogram", u64::from(EXPOSURE_BINS) * EXPOSURE_COUNT_BYTES),
            fitted: storage(&gpu.device, "exposure", size_of::<FittedExposure>() as u64),
            is_used: false,
        }
    }

    /// Fits the exposure to colours of the frame, and gives it to the passes that follow. It goes a share of the way, or
    /// for `None` all of it.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn fit(
        &mut self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        (color, targets): (&Image, &Targets),
        adaptation: Option<Adaptation>,
    ) -> Result<()> {
        recorder.clear(&self.histogram);
        let bindings = passes::exposure_histogram {
            color_in: color.bind(),
            depth_in: targets.surface().depth.bind(),
            histogram: self.histogram.as_entire_binding(),
        };
        let [width, height] = inputs.size;
        recorder.over(&[], inputs, bindings, [width.div_ceil(16), height.div_ceil(16), 1])?;
        let Adaptation { before, share } = adaptation.unwrap_or(Adaptation { before: 0.0, share: 1.0 });
        let adaptation = layout::Adaptation { before, share, unused_0: 0, unused_1: 0 };
        let adaptation = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&adaptation));
        let bindings = passes::exposure_fit {
            adaptation: adaptation.as_entire_binding(),
            histogram: self.histogram.as_entire_binding(),
            fitted: self.fitted.as_entire_binding(),
        };
        recorder.over(&[], inputs, bindings, [1, 1, 1])?;
        self.is_used = true;
        self.give(recorder, inputs);
        Ok(())
    }

    /// Gives the exposure of the last frame to the passes that follow, if it was fitted.
    pub fn give(&self, recorder: &mut Recorder<'_>, inputs: &Inputs) {
        if self.is_used {
            recorder.copy_word(&self.fitted, inputs.exposure());
        }
    }
}

/// The lower end of the first bin of histograms, in stops, and the width of all.
const LOWEST: f64 = -16.0;
const STOPS: f64 = 24.0;

/// A difference in stops that nobody sees.
const CLOSE: f32 = 0.03;

/// The bin of a histogram that counts pixels of a luminance; `None` for pixels without light. The twin of
/// `exposure_histogram`.
pub(crate) fn bin_of(luminance: f32) -> Option<usize> {
    let stops = f64::from(luminance).log2();
    let bin = (stops - LOWEST) * f64::from(EXPOSURE_BINS) / STOPS;
    (stops >= LOWEST).then_some((bin as usize).min(EXPOSURE_BINS as usize - 1))
}

/// The exposure that fits a histogram, in stops: the twin of `exposure_fit`.
pub(crate) fn stops_of(histogram: &[u32]) -> f64 {
    let total: u32 = histogram.iter().sum();
    if total == 0 {
        return 0.0;
    }
    let below = |share: f64| {
        let wanted = share * f64::from(total);
        let mut passed = 0.0;
        for (bin, count) in histogram.iter().enumerate() {
            let count = f64::from(*count);
            if count > 0.0 && passed + count >= wanted {
                let place = bin as f64 + (wanted - passed) / count;
                return LOWEST + place * STOPS / f64::from(EXPOSURE_BINS);
            }
            passed += count;
        }
        LOWEST + STOPS
    };
    (-2.0 - below(0.5)).min(0.25 - below(0.98)).clamp(-8.0, 8.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;

    const BIN: f64 = 24.0 / 256.0;

    fn histogram(parts: &[(f64, u32)]) -> Vec<u32> {
        let mut histogram = vec![0; 256];
        for (stops, count) in parts {
            histogram[bin_of(stops.exp2() as f32).unwrap()] += count;
        }
        histogram
    }

    #[test]
    fn luminances_are_counted_by_their_stops_and_darkness_is_not() {
        let first = (-16.0_f32).exp2();
        for (luminance, bin) in [
            (f32::NAN, None),
            (-1.0, None),
            (0.0, None),
            (first * 0.99, None),
            (first, Some(0)),
            (1.001, Some(170)),
            (1e9, Some(255)),
            (f32::INFINITY, Some(255)),
        ] {
            assert_eq!(bin_of(luminance), bin, "{luminance}");
        }
    }

    #[test]
    fn the_median_becomes_middle_grey_unless_the_brightest_would_burn() {
        // All of one brightness.
        for stops in [-6.0, -2.0, 0.5] {
            let found = stops_of(&histogram(&[(stops, 1000)]));
            assert!((found - (-2.0 - stops)).abs() <= BIN, "{stops}: {found}");
        }
        // Nothing is lit, or too dark for any exposure.
        assert_eq!(stops_of(&histogram(&[])), 0.0);
        assert_eq!(stops_of(&histogram(&[(-15.9, 9)])), 8.0);
        // A tenth is 6 stops brighter than the rest, and decides; a hundredth does not.
        let bright = stops_of(&histogram(&[(-4.0, 900), (2.0, 100)]));
        assert!((bright - (0.25 - 2.0)).abs() <= BIN, "{bright}");
        let few = stops_of(&histogram(&[(-4.0, 990), (2.0, 10)]));
        assert!((few - 2.0).abs() <= BIN, "{few}");
    }
}
