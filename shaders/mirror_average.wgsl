// Forward methods, averaging pass (Preiner 2010, section 4.5.4): the sums of mirror_visibility over their counts, into the
// Mirror G-Buffer before it is closed. One thread a pixel.
#import frame_group
#import mirror_sums
#import splat

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> nearest: array<u32>;
@group(1) @binding(2) var<storage, read> sums: array<u32>;
@group(1) @binding(3) var<storage, read> carries: array<u32>;
// rgb: linear albedo of Q, a: its specular intensity.
@group(1) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
// xyz: world normal of Q towards P, w: specular power.
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
// xyz: Q relative to the camera's eye, w: coverage.
@group(1) @binding(6) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn mirror_average(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let is_empty = nearest[pixel] == 0u;
    let point = textureLoad(point_in, id.xy, 0).xyz;
    let count = max(total(pixel, SUM_COUNT), 1.0);
    let farthest = farthest_counted(depth_from_nearness(nearest[pixel]), frame.scene_radius);
    let relative = total3(pixel, SUM_POSITION) / (count * POSITION_STEPS) - 1.0;
    let offset = relative * POSITION_REACH * farthest;
    let normal_sum = total3(pixel, SUM_NORMAL) / count - f32(NORMAL_BIAS);
    // If no point had a normal, or they cancelled, the surface is assumed to face the mirror.
    let normal = select(-offset, normal_sum, dot(normal_sum, normal_sum) > 1.0);
    let unit = normal * inverseSqrt(max(dot(normal, normal), 1e-30));
    let albedo = vec4f(total3(pixel, SUM_ALBEDO) / (count * 4095.0), total(pixel, SUM_INTENSITY) / (count * 1023.0));
    let power = total(pixel, SUM_POWER) / count;
    textureStore(albedo_out, id.xy, select(albedo, vec4f(0.0), is_empty));
    textureStore(normal_out, id.xy, select(vec4f(unit, power), vec4f(0.0), is_empty));
    textureStore(position_out, id.xy, select(vec4f(point + offset, 1.0), vec4f(0.0), is_empty));
}

fn total(pixel: u32, word: u32) -> f32 {
    let index = pixel * MIRROR_SUMS + word;
    let carry = (carries[index / 2u] >> (16u * (word & 1u))) & 0xffffu;
    return f32(sums[index]) + f32(carry) * 4294967296.0;
}

fn total3(pixel: u32, word: u32) -> vec3f {
    return vec3f(total(pixel, word), total(pixel, word + 1u), total(pixel, word + 2u));
}
