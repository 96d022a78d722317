// Closes mirror pixels whose ray slipped between discs: a pixel takes the mean of its neighbours if at least five of the eight
// found something at about the same distance. A gap of two by two pixels closes in two runs; an open side stays open, since
// beyond a straight outline only three neighbours found anything. One thread a pixel.
#import frame_group

// w: specular intensity; 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var albedo_in: texture_2d<f32>;
@group(1) @binding(2) var normal_in: texture_2d<f32>;
// w: coverage.
@group(1) @binding(3) var position_in: texture_2d<f32>;
@group(1) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(6) var position_out: texture_storage_2d<rgba32float, write>;

// The coverage of a closed pixel: different from that of found ones, and above zero.
const CLOSED: f32 = 0.5;

@compute @workgroup_size(8, 8)
fn gather_close(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    let center = vec2i(id);
    var albedo = textureLoad(albedo_in, center, 0);
    var normal = textureLoad(normal_in, center, 0);
    var position = textureLoad(position_in, center, 0);
    let is_open = position.w == 0.0;
    let mirror_point = textureLoad(point_in, center, 0).xyz;
    // Open pixels are few: conditions stand in the loops because software rasterisers run both sides of a branch.
    var nearest = 3e38;
    for (var i = 0; is_open && i < 8; i++) {
        let seen = seen_at(center + neighbor(i));
        nearest = min(nearest, select(3e38, distance(seen.xyz, mirror_point), seen.w > 0.0));
    }
    var count = 0.0;
    var albedo_sum = vec4f(0.0);
    var normal_sum = vec4f(0.0);
    var position_sum = vec3f(0.0);
    for (var i = 0; is_open && i < 8; i++) {
        let at = center + neighbor(i);
        let seen = seen_at(at);
        // Twice the distance is another surface: the near one closes, the far one is seen beside it.
        if seen.w > 0.0 && distance(seen.xyz, mirror_point) <= 2.0 * nearest {
            count += 1.0;
            albedo_sum += textureLoad(albedo_in, at, 0);
            normal_sum += textureLoad(normal_in, at, 0);
            position_sum += seen.xyz;
        }
    }
    if is_open && count >= 5.0 {
        albedo = albedo_sum / count;
        let squared = dot(normal_sum.xyz, normal_sum.xyz);
        normal = vec4f(normal_sum.xyz * inverseSqrt(max(squared, 1e-20)), normal_sum.w / count);
        position = vec4f(position_sum / count, CLOSED);
    }
    textureStore(albedo_out, center, albedo);
    textureStore(normal_out, center, normal);
    textureStore(position_out, center, position);
}

// What a neighbour found; w: 0 if it found nothing or is no mirror pixel.
fn seen_at(pixel: vec2i) -> vec4f {
    let size = vec2i(i32(frame.width), i32(frame.height));
    if any(pixel < vec2i(0)) || any(pixel >= size) || textureLoad(point_in, pixel, 0).w == 0.0 {
        return vec4f(0.0);
    }
    return textureLoad(position_in, pixel, 0);
}
