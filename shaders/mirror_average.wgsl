// Forward methods, averaging pass (Preiner 2010, section 4.5.4): the sums of mirror_visibility over their counts, into the
// Mirror G-Buffer before it is closed. One thread a pixel.
#import frame_group
#import mirror_sums
#import splat

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> nearest: array<u32>;
// See mirror_sums.wgsl.
@group(1) @binding(2) var<storage, read> albedo_sums: array<vec4u>;
@group(1) @binding(3) var<storage, read> normal_sums: array<vec4u>;
@group(1) @binding(4) var<storage, read> position_sums: array<vec4u>;
@group(1) @binding(5) var<storage, read> carries: array<u32>;
// rgb: linear albedo of Q, a: its specular intensity.
@group(1) @binding(6) var albedo_out: texture_storage_2d<rgba16float, write>;
// xyz: world normal of Q towards P, w: specular power.
@group(1) @binding(7) var normal_out: texture_storage_2d<rgba32float, write>;
// xyz: Q relative to the camera's eye, w: coverage.
@group(1) @binding(8) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn mirror_average(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let is_empty = nearest[pixel] == 0u;
    let point = textureLoad(point_in, id.xy, 0).xyz;
    let albedo_sum = total(albedo_sums[pixel], pixel, 0u);
    let normal_sum = total(normal_sums[pixel], pixel, 4u);
    let position_sum = total(position_sums[pixel], pixel, 8u);
    let count = max(albedo_sum.x, 1.0);
    let farthest = farthest_counted(depth_from_nearness(nearest[pixel]), frame.scene_radius);
    let relative = position_sum.xyz / (count * POSITION_STEPS) - 1.0;
    let offset = relative * POSITION_REACH * farthest;
    let normal_mean = normal_sum.xyz / count - f32(NORMAL_BIAS);
    // If no point had a normal, or they cancelled, the surface is assumed to face the mirror.
    let normal = select(-offset, normal_mean, dot(normal_mean, normal_mean) > 1.0);
    let unit = normal * inverseSqrt(max(dot(normal, normal), 1e-30));
    let albedo = vec4f(albedo_sum.yzw / (count * 4095.0), normal_sum.w / (count * 1023.0));
    let power = position_sum.w / count;
    textureStore(albedo_out, id.xy, select(albedo, vec4f(0.0), is_empty));
    textureStore(normal_out, id.xy, select(vec4f(unit, power), vec4f(0.0), is_empty));
    textureStore(position_out, id.xy, select(vec4f(point + offset, 1.0), vec4f(0.0), is_empty));
}

// Four sums with their carries, of which the first is this word of the pixel's.
fn total(sums: vec4u, pixel: u32, word: u32) -> vec4f {
    let first = (pixel * MIRROR_SUMS + word) / 2u;
    let carry = vec2u(carries[first], carries[first + 1u]);
    let high = vec4u(carry.x & 0xffffu, carry.x >> 16u, carry.y & 0xffffu, carry.y >> 16u);
    return vec4f(sums) + vec4f(high) * 4294967296.0;
}
