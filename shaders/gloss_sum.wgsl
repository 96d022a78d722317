// Sums what the samples of mirrors receive by their weights, and keeps their mean; a mirror that sees no point
// receives the background. One thread a pixel.
#import frame_group
#import gloss_pixel
#import packing

// xyz: mirror point, w: 0 where the sample has no ray.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// xyz: the reflected surface, w: its coverage.
@group(1) @binding(1) var seen_in: texture_2d<f32>;
@group(1) @binding(2) var reflected_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> pixels: array<GlossPixel>;
// rgb: the sum of what the rays receive, a: that of their weights.
@group(1) @binding(4) var<storage, read_write> sums: array<vec4f>;
// x: the sum of the distances at which the rays met something, y: that of their weights.
@group(1) @binding(5) var<storage, read_write> distances: array<vec2f>;
@group(1) @binding(6) var received_out: texture_storage_2d<rgba16float, write>;
// x: how much the look counts among those of the ray.
@group(1) @binding(7) var looks_in: texture_2d<f32>;

// Set if rays have weights.
override is_weighed: bool = false;
// Set if the distances are asked for.
override is_blurred: bool = false;
// Set if several looks of each ray are blended.
override has_looks: bool = false;

@compute @workgroup_size(8, 8)
fn gloss_sum(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    var sum = vec4f(0.0);
    let has_begun = frame.sample > 0u || frame.look > 0u;
    if has_begun {
        sum = sums[index];
    }
    let point = textureLoad(point_in, id, 0);
    if point.w > 0.0 {
        let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
        let seen = textureLoad(seen_in, id, 0);
        let found = seen.w > 0.0;
        let of_ray = select(1.0, pixels[place_of_thread(thread, groups)].weight, is_weighed);
        let weight = of_ray * select(1.0, textureLoad(looks_in, id, 0).x, has_looks);
        sum += weight * vec4f(select(background, textureLoad(reflected_in, id, 0).rgb, found), 1.0);
        if is_blurred {
            let met = select(vec2f(0.0), weight * vec2f(distance(seen.xyz, point.xyz), 1.0), found);
            distances[index] = select(vec2f(0.0), distances[index], has_begun) + met;
        }
    }
    sums[index] = sum;
    textureStore(received_out, id, vec4f(sum.rgb / select(1.0, sum.a, sum.a > 0.0), 1.0));
}
