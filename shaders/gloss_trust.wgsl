// Which pixels of glossy mirrors draw from their mirror's own lobe: those of whose rays too few would count in effect,
// if they were drawn from the lobe of gloss.cache_power. That is told from the weights alone. One thread a pixel.
#import frame_group
#import lobe
#import gloss_pixel

@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read_write> pixels: array<GlossPixel>;

// Set if all pixels draw the same numbers.
override is_shared: bool = true;

@compute @workgroup_size(8, 8)
fn gloss_trust(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    let surface = textureLoad(normal_in, id, 0);
    var sum = 0.0;
    var squares = 0.0;
    let normal = normalize(surface.xyz);
    let incoming = normalize(point.xyz - textureLoad(eye_in, id, 0).xyz);
    let is_blinn = settings.gloss.lobe == GLOSS_LOBE_BLINN;
    let reference = frame.forward.xyz * select(1.0, -1.0, is_blinn);
    let across = axes_across(select(incoming, normal, is_blinn), reference, frame.right.xyz, frame.up.xyz);
    let of_pixel = select(hash(id.x + hash(id.y)), 0u, is_shared);
    let count = select(0u, frame.samples, point.w > 0.0 && surface.w > 0.0);
    for (var index = 0u; index < count; index++) {
        let weight = weighed_normal(
            is_blinn, incoming, normal, across, index, count, hash(settings.gloss.seed + hash(of_pixel)),
            settings.gloss.cache_power, settings.gloss.cache_spread, surface.w,
        ).weight;
        sum += weight;
        squares += weight * weight;
    }
    let share = sum * sum / max(f32(count) * squares, 1e-30);
    pixels[place_of_thread(thread, groups)].draws_own = select(0u, 1u, share < max(settings.gloss.cache_trust, 1e-3));
}
