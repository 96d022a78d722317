// The indirect light of a frame, kept for the frames after it: an element for each pixel. xyz: f32 bits of the position
// at which the light was computed, relative to the frame's eye. w: the light by `pack_light`, or 0 if there is none.

// Packs irradiance over pi: 9 bits for each component, and the exponent of 2 that they share. The result is never 0.
fn pack_light(light: vec3f) -> u32 {
    let bounded = clamp(light, vec3f(0.0), vec3f(65000.0));
    let most = max(bounded.r, max(bounded.g, bounded.b));
    let exponent = clamp(i32(bitcast<u32>(most) >> 23u) - 126, -14, 16);
    let steps = min(vec3u(bounded * exp2(f32(9 - exponent)) + 0.5), vec3u(511u));
    return steps.r | (steps.g << 9u) | (steps.b << 18u) | (u32(exponent + 15) << 27u);
}

fn unpack_light(packed: u32) -> vec3f {
    let steps = vec3u(packed, packed >> 9u, packed >> 18u) & vec3u(511u);
    return vec3f(steps) * exp2(f32(i32(packed >> 27u) - 24));
}
