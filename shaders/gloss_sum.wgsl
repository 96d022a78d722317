// Sums what the samples of glossy mirrors receive, and keeps their mean; a mirror that sees no point receives the
// background. One thread a pixel.
#import frame_group
#import packing

// w: 0 where the sample has no ray.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: coverage of the reflected surface.
@group(1) @binding(1) var seen_in: texture_2d<f32>;
@group(1) @binding(2) var reflected_in: texture_2d<f32>;
// rgb: the sum of what the rays receive, a: their number.
@group(1) @binding(3) var<storage, read_write> sums: array<vec4f>;
@group(1) @binding(4) var received_out: texture_storage_2d<rgba16float, write>;

@compute @workgroup_size(8, 8)
fn gloss_sum(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    var sum = vec4f(0.0);
    if frame.sample > 0u {
        sum = sums[index];
    }
    if textureLoad(point_in, id, 0).w > 0.0 {
        let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
        let found = textureLoad(seen_in, id, 0).w > 0.0;
        sum += vec4f(select(background, textureLoad(reflected_in, id, 0).rgb, found), 1.0);
    }
    sums[index] = sum;
    textureStore(received_out, id, vec4f(sum.rgb / max(sum.a, 1.0), 1.0));
}
