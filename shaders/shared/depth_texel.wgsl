// The texels of pictures of depths that rays are walked through (depth_walk.wgsl), and their records.

// A surface seen at a smaller angle than this sine has no slope that its depth would tell.
const LEAST_COSINE: f32 = 0.16;

// A texel: the disc that it shows.
struct DepthTexel {
    identity: u32,
    // The linear depth of the disc's plane at the texel's middle; 0: nothing is there.
    depth: f32,
    // Toward the view's centre, or along the line of sight where the disc has none or is seen edge-on.
    normal: vec3f,
    // The disc's radius over the width of a texel at this depth.
    radius: f32,
    // The disc's middle from the texel's middle, in texels.
    middle: vec2f,
}

// A record of a texel: identity; depth; normal in 11 + 11 bits and the logarithm of the radius in 10; middle in 16 + 16.
fn pack_texel(texel: DepthTexel) -> vec4u {
    let folded = texel.normal / (abs(texel.normal.x) + abs(texel.normal.y) + abs(texel.normal.z));
    let side = select(vec2f(-1.0), vec2f(1.0), folded.xy >= vec2f(0.0));
    let flat = select((1.0 - abs(folded.yx)) * side, folded.xy, folded.z >= 0.0);
    let steps = vec2u(round((flat * 0.5 + 0.5) * 2047.0));
    let radius = u32(clamp(round((log2(max(texel.radius, 1e-6)) + 8.0) * 64.0), 0.0, 1023.0));
    let middle = vec2u(vec2i(clamp(round(texel.middle * 32.0), vec2f(-32767.0), vec2f(32767.0)))) & vec2u(0xffffu);
    let normal_radius = steps.x | (steps.y << 11u) | (radius << 22u);
    return vec4u(texel.identity, bitcast<u32>(texel.depth), normal_radius, middle.x | (middle.y << 16u));
}

fn unpack_texel(record: vec4u) -> DepthTexel {
    let steps = vec2f(vec2u(record.z, record.z >> 11u) & vec2u(2047u));
    let folded = steps / 2047.0 * 2.0 - 1.0;
    let z = 1.0 - abs(folded.x) - abs(folded.y);
    let side = select(vec2f(-1.0), vec2f(1.0), folded >= vec2f(0.0));
    let flat = select((1.0 - abs(folded.yx)) * side, folded, z >= 0.0);
    let radius = exp2(f32(record.z >> 22u) / 64.0 - 8.0);
    let middle = vec2f(vec2i(vec2u(record.w << 16u, record.w & 0xffff0000u)) >> vec2u(16u)) / 32.0;
    return DepthTexel(record.x, bitcast<f32>(record.y), normalize(vec3f(flat, z)), radius, middle);
}
