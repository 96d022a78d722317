// Fits the exposure to the histogram of the picture's brightness. One thread.
#import frame_group
#import exposure

@group(1) @binding(0) var<uniform> adaptation: Adaptation;
@group(1) @binding(1) var<storage, read> histogram: array<u32>;
@group(1) @binding(2) var<storage, read_write> fitted: FittedExposure;

// The brightness in stops that this share of the lit pixels has at most.
fn brightness_below(share: f32, total: f32) -> f32 {
    let wanted = share * total;
    var passed = 0.0;
    var place = f32(EXPOSURE_BINS);
    var is_found = false;
    for (var bin = 0u; bin < EXPOSURE_BINS; bin++) {
        let count = f32(histogram[bin]);
        if !is_found && count > 0.0 && passed + count >= wanted {
            place = f32(bin) + (wanted - passed) / count;
            is_found = true;
        }
        passed += count;
    }
    return EXPOSURE_LOWEST + place * (EXPOSURE_STOPS / f32(EXPOSURE_BINS));
}

@compute @workgroup_size(1)
fn exposure_fit() {
    var total = 0.0;
    for (var bin = 0u; bin < EXPOSURE_BINS; bin++) {
        total += f32(histogram[bin]);
    }
    var stops = 0.0;
    if total > 0.0 {
        let middle = EXPOSURE_MIDDLE - brightness_below(0.5, total);
        stops = clamp(min(middle, EXPOSURE_BRIGHT - brightness_below(0.98, total)), -EXPOSURE_MOST, EXPOSURE_MOST);
    }
    var shown = stops;
    if adaptation.share < 1.0 {
        shown = mix(adaptation.before, stops, adaptation.share);
    }
    let is_close = abs(shown - stops) < EXPOSURE_CLOSE;
    fitted.stops = settings.tone.exposure + select(shown, stops, is_close);
    fitted.adapts = select(1u, 0u, is_close);
}
