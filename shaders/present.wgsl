// The picture: eye-dome lighting (Boucheny 2009) over the shaded colour, background, tone mapping. One thread a pixel.
#import frame_group
#import packing
#import tone

@group(1) @binding(0) var color_in: texture_2d<f32>;
@group(1) @binding(1) var depth_in: texture_2d<f32>;
// The radius of the splat that the pixel is of, where steps below it are ignored; else not read.
@group(1) @binding(2) var radius_in: texture_2d<f32>;
@group(1) @binding(3) var picture_out: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn present(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let depth = textureLoad(depth_in, id.xy, 0).x;
    if depth == 0.0 {
        // Colours of parameters are 0xrrggbbaa in screen colours: they are not light to be mapped.
        textureStore(picture_out, id.xy, vec4f(unpack4x8unorm(settings.view.background).wzy, 1.0));
        return;
    }
    let color = textureLoad(color_in, id.xy, 0).rgb * eye_dome(vec2i(id.xy), depth);
    textureStore(picture_out, id.xy, vec4f(screen_color(settings, color), 1.0));
}

// Splats up to this radius in pixels cannot be told from one another ...
const FINE_PIXELS: f32 = 4.0;
// ... and from this one on are seen as discs.
const DISC_PIXELS: f32 = 16.0;

// Neighbours in front of the pixel darken it, by the logarithm of the ratio of depths: the same step looks the same
// near and far. Where splats are discs, the part of a step below their radius is that from disc to disc.
fn eye_dome(pixel: vec2i, depth: f32) -> f32 {
    if settings.edl.strength == 0.0 {
        return 1.0;
    }
    let size = vec2i(i32(frame.width), i32(frame.height));
    var ignored = 0.0;
    if settings.edl.ignored > 0.0 {
        let radius = textureLoad(radius_in, pixel, 0).x;
        let is_disc = saturate((radius * pixels_per_unit(frame, depth) - FINE_PIXELS) / (DISC_PIXELS - FINE_PIXELS));
        ignored = settings.edl.ignored * radius * is_disc;
    }
    var sum = 0.0;
    for (var i = 0; i < 8; i++) {
        let angle = f32(i) * 0.78539816;
        let offset = vec2i(round(vec2f(cos(angle), sin(angle)) * settings.edl.radius));
        let neighbor = clamp(pixel + offset, vec2i(0), size - 1);
        let neighbor_depth = textureLoad(depth_in, neighbor, 0).x;
        if neighbor_depth > 0.0 {
            sum += log2(1.0 + max(0.0, depth_step(frame, neighbor_depth, depth - ignored)));
        }
    }
    // 300 is the customary factor: at strength 0.4 a step of one percent of the depth on one side darkens by about a
    // fifth.
    return exp(-300.0 * settings.edl.strength * sum / 8.0);
}
