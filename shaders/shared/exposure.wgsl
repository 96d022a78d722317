// The histogram of a picture's brightness, and the exposure that is fitted to it. Filled and read by
// crates/render/src/exposure.rs.

// Bins of equal width in stops (doublings of the luminance).
const EXPOSURE_BINS: u32 = 256u;
const EXPOSURE_STOPS: f32 = 24.0;
// The lower end of the first bin: what is darker counts as unlit.
const EXPOSURE_LOWEST: f32 = -16.0;

// The brightness that half of the lit pixels get at most: a quarter of white, the middle grey of the filmic curve.
const EXPOSURE_MIDDLE: f32 = -2.0;
// The brightness that 49 of 50 lit pixels get at most: the filmic curve then still tells them from white.
const EXPOSURE_BRIGHT: f32 = 0.25;
// The most stops of a fit, either way.
const EXPOSURE_MOST: f32 = 8.0;
// A difference in stops that nobody sees.
const EXPOSURE_CLOSE: f32 = 0.03;

struct Adaptation {
    // The stops of the picture before, without those of the parameter.
    before: f32,
    // The share of the way from there to the exposure that fits.
    share: f32,
    unused_0: u32,
    unused_1: u32,
}

struct FittedExposure {
    // Stops by which the picture is brightened: those shown and those of the parameter.
    stops: f32,
    // 1 if the exposure is on its way to the one that fits.
    adapts: u32,
    unused_0: u32,
    unused_1: u32,
}
