// The normals of a glossy sample: reflect(P - E, H) is the direction drawn by the lobe of the surface's specular power. A
// direction below the surface is drawn again. Perfect mirrors keep their normal. One thread a pixel.
#import frame_group
#import lobe

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: origin of the ray.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var normal_out: texture_storage_2d<rgba32float, write>;

override bounce: u32 = 0u;
// Set if all pixels draw the same numbers.
override is_shared: bool = true;

// Directions that are drawn before the perfect reflection stands in: half of them lead below the surface at worst.
const TRIES: u32 = 16u;

@compute @workgroup_size(8, 8)
fn gloss_normals(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    let surface = textureLoad(normal_in, id, 0);
    var drawn = surface.xyz;
    if surface.w > 0.0 {
        let normal = normalize(surface.xyz);
        let incoming = normalize(textureLoad(point_in, id, 0).xyz - textureLoad(eye_in, id, 0).xyz);
        let is_blinn = settings.gloss.lobe == GLOSS_LOBE_BLINN;
        // Rays leave the camera forwards, and mostly come back after a mirror. Normals face them.
        let reference = frame.forward.xyz * select(1.0, -1.0, (bounce % 2u == 1u) != is_blinn);
        let across = axes_across(select(incoming, normal, is_blinn), reference, frame.right.xyz, frame.up.xyz);
        let of_pixel = select(lobe_hash(id.x + lobe_hash(id.y)), 0u, is_shared);
        var is_found = false;
        for (var tried = 0u; tried < TRIES && !is_found; tried++) {
            let seed = lobe_hash(settings.gloss.seed + lobe_hash(of_pixel + lobe_hash(bounce * TRIES + tried)));
            let candidate =
                lobe_normal(is_blinn, incoming, normal, across, lobe_numbers(frame.sample, seed), surface.w);
            is_found = dot(reflect(incoming, candidate), normal) > 0.0;
            if is_found {
                drawn = candidate;
            }
        }
    }
    textureStore(normal_out, id, vec4f(drawn, surface.w));
}
