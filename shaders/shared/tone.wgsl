// Tone mapping: from linear light to the colours of the screen.
#import packing
#import params

// The filmic curve, or none, which clips values brighter than the screen.
override is_filmic: bool = false;

// sRGB of linear light. The curve is the fit of Narkowicz 2015 to the ACES reference tone curve.
fn screen_color(settings: Settings, linear: vec3f) -> vec3f {
    var shown = max(linear, vec3f(0.0)) * exp2(settings.tone.exposure);
    if is_filmic {
        // Beyond this it is white, and its square would overflow.
        let x = min(shown, vec3f(1e4));
        shown = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14);
    }
    return srgb_from_linear(shown);
}
