// The picture: eye-dome lighting (Boucheny 2009) over the shaded colour, background, tone mapping. One thread a pixel.
#import frame_group
#import packing
#import tone

@group(1) @binding(0) var color_in: texture_2d<f32>;
@group(1) @binding(1) var depth_in: texture_2d<f32>;
// The radius of the splat that the pixel is of, where steps below it are ignored; else not read.
@group(1) @binding(2) var radius_in: texture_2d<f32>;
// xyz: world normal towards the eye.
@group(1) @binding(3) var normal_in: texture_2d<f32>;
@group(1) @binding(4) var picture_out: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn present(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let depth = textureLoad(depth_in, id.xy, 0).x;
    let dome = eye_dome(vec2i(id.xy), depth);
    if depth == 0.0 {
        // Colours of parameters are 0xrrggbbaa in screen colours: they are not light to be mapped.
        textureStore(picture_out, id.xy, vec4f(unpack4x8unorm(settings.view.background).wzy, 1.0));
        return;
    }
    let color = textureLoad(color_in, id.xy, 0).rgb * dome;
    textureStore(picture_out, id.xy, vec4f(screen_color(settings, color), 1.0));
}

// Splats up to this radius in pixels cannot be told from one another ...
const FINE_PIXELS: f32 = 4.0;
// ... and from this one on are seen as discs.
const DISC_PIXELS: f32 = 16.0;

// Normals that differ by less than this cosine count as those of one plane, but for noise ...
const SAME_PLANE: f32 = 0.8;
// ... that turns the plane by this much at most: radians.
const NORMAL_ERROR: f32 = 0.05;
// The least sine of the angle between a plane and the line of sight that is known despite that.
const LEAST_SINE: f32 = 0.02;

// Neighbours in front of the pixel darken it, by the logarithm of the ratio of depths: the same step looks the same
// near and far. Where splats are discs, the part of a step below their radius is that from disc to disc. Where normals
// show a plane, so is what that plane rises toward the neighbour, and what discs that lie a radius off it, by noise,
// differ in depth along the line of sight. Where nothing is seen, the loops end at once: software rasterisers run both
// sides of a branch.
fn eye_dome(pixel: vec2i, depth: f32) -> f32 {
    let darkens = settings.edl.strength > 0.0 && depth > 0.0;
    let size = vec2i(i32(frame.width), i32(frame.height));
    let is_parallel = frame.orthographic != 0u;
    let normal = plane_about(pixel, size, darkens);
    let sight = sight_of(pixel);
    // 0: not known to be a plane.
    let sine = max(abs(dot(normal, normalize(sight))) - NORMAL_ERROR, LEAST_SINE);
    let is_plane = any(normal != vec3f(0.0));
    var ignored = 0.0;
    if settings.edl.ignored > 0.0 {
        let radius = textureLoad(radius_in, pixel, 0).x;
        let is_disc = saturate((radius * pixels_per_unit(frame, depth) - FINE_PIXELS) / (DISC_PIXELS - FINE_PIXELS));
        ignored = settings.edl.ignored * radius * (is_disc + select(0.0, 1.0 / sine - 1.0, is_plane));
    }
    var sum = 0.0;
    for (var i = 0; darkens && i < 8; i++) {
        let angle = f32(i) * 0.78539816;
        let offset = vec2i(round(vec2f(cos(angle), sin(angle)) * settings.edl.radius));
        let neighbor = clamp(pixel + offset, vec2i(0), size - 1);
        let neighbor_depth = textureLoad(depth_in, neighbor, 0).x;
        if neighbor_depth > 0.0 {
            // What the plane rises from one line of sight to the other, in units of `depth_step`.
            let across = (slope_from_pixel(frame, vec2f(neighbor)) - slope_from_pixel(frame, vec2f(pixel)))
                / select(1.0, frame.reference_depth, is_parallel);
            let rise = (abs(dot(normal.xy, across)) + NORMAL_ERROR * length(across)) / sine;
            let step = depth_step(frame, neighbor_depth, depth - ignored) - select(0.0, rise, is_plane);
            sum += log2(1.0 + max(0.0, step));
        }
    }
    // 300 is the customary factor: at strength 0.4 a step of one percent of the depth on one side darkens by about a
    // fifth.
    return exp(-300.0 * settings.edl.strength * sum / 8.0);
}

// The direction of a pixel's line of sight in view space.
fn sight_of(pixel: vec2i) -> vec3f {
    let slope = slope_from_pixel(frame, vec2f(pixel) + 0.5);
    return vec3f(select(slope, vec2f(0.0), frame.orthographic != 0u), 1.0);
}

// The unit normal, in view space, of the plane that a pixel lies on with its neighbours; 0 where normals show none, as
// in leaves. Normals turn to the eye, so those of a plane that is seen along it point either way by noise, and cancel
// out in the mean of a few pixels: such a pixel takes the plane of those around it, if these agree.
fn plane_about(pixel: vec2i, size: vec2i, darkens: bool) -> vec3f {
    let own = textureLoad(normal_in, pixel, 0).xyz;
    var alike = own;
    var alike_count = 0.0;
    var all = vec3f(0.0);
    var count = 0.0;
    for (var i = 0; darkens && i < 8; i++) {
        let other = textureLoad(normal_in, clamp(pixel + neighbor(i), vec2i(0), size - 1), 0).xyz;
        let cosine = dot(own, other);
        if abs(cosine) > SAME_PLANE {
            alike += sign(cosine) * other;
            alike_count += 1.0;
        }
        all += select(1.0, -1.0, dot(all, other) < 0.0) * other;
        count += length(other);
    }
    var normal = alike;
    if alike_count < 2.0 {
        normal = select(vec3f(0.0), all, count > 4.5 && length(all) > SAME_PLANE * count);
    }
    return view_from_relative(frame, normal / max(length(normal), 1e-20));
}
