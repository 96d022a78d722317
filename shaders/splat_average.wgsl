// High quality: the sums of splat_accumulate over their weights, into the G-buffer. One thread a pixel.
#import frame_group
#import splat

@group(1) @binding(0) var<storage, read> nearest: array<vec2u>;
@group(1) @binding(1) var<storage, read> color_sums: array<vec4u>;
@group(1) @binding(2) var<storage, read> surface_sums: array<vec4u>;
@group(1) @binding(3) var<storage, read> specular_sums: array<u32>;
@group(1) @binding(4) var<storage, read> carries: array<vec4u>;
// rgb: linear albedo, a: specular intensity; below 0 the share of a highlight of a surface that is no mirror.
@group(1) @binding(5) var albedo_out: texture_storage_2d<rgba16float, write>;
// xyz: world normal towards the eye, w: specular power.
@group(1) @binding(6) var normal_out: texture_storage_2d<rgba32float, write>;
// The linear depth in world units; 0 if empty.
@group(1) @binding(7) var depth_out: texture_storage_2d<r32float, write>;

// Set where splat_accumulate_pairs made the sums.
override pairs: bool = false;
// Set where some clouds are mirrors or glossy; else the sums of highlights hold nothing.
override has_materials: bool = false;

@compute @workgroup_size(8, 8)
fn splat_average(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let color = color_sums[pixel];
    let carry = carries[pixel];
    let color_sum = total(color, carry.xy);
    let surface_sum = total(surface_sums[pixel], carry.zw);
    // At least one point's weight wherever anything was splatted.
    let weight = max(color_sum.x, 1.0);
    let is_empty = nearest[pixel].y == 0u;
    var specular = vec2f(0.0);
    var gloss = 0.0;
    if has_materials {
        let at = pixel * SPECULAR_WORDS;
        let high = vec2u(specular_sums[at + 2u] & 0xffffu, specular_sums[at + 2u] >> 16u);
        specular = (vec2f(vec2u(specular_sums[at], specular_sums[at + 1u])) + vec2f(high) * 4294967296.0) / weight;
        gloss = f32(specular_sums[at + 3u]) / (weight * 255.0);
    }
    let is_glossy = specular.x == 0.0 && gloss > 0.0;
    let front = depth_from_nearness(nearest[pixel].y);
    let depth = front * (1.0 + LEAST_BEHIND + BEHIND_RANGE * (surface_sum.w / weight / 65535.0));
    let sum = surface_sum.xyz - f32(NORMAL_BIAS) * weight;
    let ray = view_from_pixel(frame, vec2f(id.xy) + 0.5, depth);
    // If no point had a normal, or they cancelled, the surface is assumed to face the eye.
    let facing = -world_direction(frame, select(normalize(ray), vec3f(0.0, 0.0, 1.0), frame.orthographic != 0u));
    let normal = select(facing, normalize(sum), dot(sum, sum) > weight * weight);
    let albedo = vec4f(color_sum.yzw / (weight * ALBEDO_MOST), select(specular.x / 1023.0, -gloss, is_glossy));
    textureStore(albedo_out, id.xy, select(albedo, vec4f(0.0), is_empty));
    textureStore(normal_out, id.xy, select(vec4f(normal, specular.y), vec4f(0.0), is_empty));
    textureStore(depth_out, id.xy, vec4f(select(depth, 0.0, is_empty)));
}

// Sums with their carries, 16 bits each, two a word.
fn total(sums: vec4u, carry: vec2u) -> vec4f {
    let high = vec4u(carry.x & 0xffffu, carry.x >> 16u, carry.y & 0xffffu, carry.y >> 16u);
    // The upper sum of a pair has what the lower one carried.
    let carried = select(vec4u(0u), vec4u(0u, high.x, 0u, high.z), pairs);
    let borrowed = select(vec4u(0u), vec4u(1u), sums < carried);
    return vec4f(sums - carried) + vec4f(high - borrowed) * 4294967296.0;
}
