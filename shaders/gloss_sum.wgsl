// Sums what the samples of mirrors receive by their weights, and keeps their mean; a mirror that sees no point
// receives the background. Reflections that fade by distance do so ray by ray. One thread a pixel.
#import frame_group
#import brdf
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
// a: the mean share of the reflections that is left.
@group(1) @binding(6) var received_out: texture_storage_2d<rgba16float, write>;
// x: how much the look counts among those of the ray.
@group(1) @binding(7) var looks_in: texture_2d<f32>;
// x: how far the ray goes, in mirror radii.
@group(1) @binding(8) var left_in: texture_2d<f32>;
// The sum of the shares of the reflections that are left, by their weights.
@group(1) @binding(9) var<storage, read_write> shares_left: array<f32>;
@group(1) @binding(10) var reflectance_in: texture_2d<f32>;

// Set if rays have weights.
override is_weighed: bool = false;
// Set if the distances are asked for.
override is_blurred: bool = false;
// Set if several looks of each ray are blended.
override has_looks: bool = false;
// Set if reflections fade by distance.
override fades: bool = false;
// Set if not all that rays receive is reflected, see gloss_reflectance.wgsl.
override has_reflectance: bool = false;

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
    var left = 0.0;
    if fades && has_begun {
        left = shares_left[index];
    }
    let point = textureLoad(point_in, id, 0);
    if point.w > 0.0 {
        let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
        let seen = textureLoad(seen_in, id, 0);
        let found = seen.w > 0.0;
        let of_ray = select(1.0, pixels[place_of_thread(thread, groups)].weight, is_weighed);
        let weight = of_ray * select(1.0, textureLoad(looks_in, id, 0).x, has_looks);
        var received = select(background, textureLoad(reflected_in, id, 0).rgb, found);
        var reflectance = 1.0;
        if has_reflectance {
            reflectance = textureLoad(reflectance_in, id, 0).x;
            received *= reflectance;
        }
        if fades {
            let reach = textureLoad(left_in, id, 0).x;
            let by_reach = share_left(settings.mirror.fade_distance, settings.mirror.fade_least, reach);
            // Rays below the surface say nothing.
            let share = select(by_reach, 1.0, reflectance == 0.0);
            received *= share;
            left += weight * share;
        }
        sum += weight * vec4f(received, 1.0);
        if is_blurred {
            let met = select(vec2f(0.0), weight * vec2f(distance(seen.xyz, point.xyz), 1.0), found);
            distances[index] = select(vec2f(0.0), distances[index], has_begun) + met;
        }
    }
    sums[index] = sum;
    let weights = select(1.0, sum.a, sum.a > 0.0);
    var mean_left = 1.0;
    if fades {
        shares_left[index] = left;
        mean_left = left / weights;
    }
    textureStore(received_out, id, vec4f(sum.rgb / weights, mean_left));
}
