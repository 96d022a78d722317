// The normals of a glossy sample: reflect(P - E, H) is the direction drawn by the lobe of the surface's specular power.
// A direction below the surface is drawn again, but for Ashikhmin and Shirley's lobe, whose weight there is 0. Perfect
// mirrors keep their normal. Also marks which rays are to be traced. One thread a pixel.
#import frame_group
#import lobe
#import gloss_pixel

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: origin of the ray.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// See gloss_pixel.wgsl.
@group(1) @binding(3) var<storage, read> kept: array<u32>;
@group(1) @binding(4) var<storage, read_write> pixels: array<GlossPixel>;
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
// As point_in, with mirrors only where the ray is to be traced.
@group(1) @binding(6) var rays_out: texture_storage_2d<rgba32float, write>;

override bounce: u32 = 0u;
// Set if all pixels draw the same numbers.
override is_shared: bool = true;
// Set if what rays meet is kept.
override is_kept: bool = false;
// Set if pixels may draw from another lobe than their mirror's.
override is_weighed: bool = false;
// Set for Ashikhmin and Shirley's lobe.
override has_half_lobe: bool = false;

// Directions that are drawn before the perfect reflection stands in: half of them lead below the surface at worst.
const TRIES: u32 = 16u;

// The keys of rays of the first reflection: none, or drawn from the lobe of gloss.cache_power; else that of the
// mirror's power, which is never 0 and has no top bit.
const NO_RAY: u32 = 0x7fa00000u;
const WEIGHED: u32 = 0x7fb00000u;

@compute @workgroup_size(8, 8)
fn gloss_normals(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let place = place_of_thread(thread, groups);
    let point = textureLoad(point_in, id, 0);
    let surface = textureLoad(normal_in, id, 0);
    var drawn = surface.xyz;
    var weight = 1.0;
    let is_mirror = point.w > 0.0;
    let weighs = is_weighed && surface.w > 0.0 && pixels[place].draws_own == 0u;
    if is_mirror && surface.w > 0.0 {
        let normal = normalize(surface.xyz);
        let incoming = normalize(point.xyz - textureLoad(eye_in, id, 0).xyz);
        let is_blinn = settings.gloss.lobe == GLOSS_LOBE_BLINN;
        // Rays leave the camera forwards, and mostly come back after a mirror. Normals face them.
        let reference = frame.forward.xyz * select(1.0, -1.0, (bounce % 2u == 1u) != is_blinn);
        let across = axes_across(select(incoming, normal, is_blinn), reference, frame.right.xyz, frame.up.xyz);
        let of_pixel = select(hash(id.x + hash(id.y)), 0u, is_shared);
        if weighs {
            let weighed = weighed_normal(
                is_blinn, incoming, normal, across, frame.sample, frame.samples,
                hash(settings.gloss.seed + hash(of_pixel)), settings.gloss.cache_power,
                settings.gloss.cache_spread, surface.w,
            );
            drawn = weighed.normal;
            weight = weighed.weight;
        }
        if has_half_lobe {
            let seed = hash(settings.gloss.seed + hash(of_pixel + hash(bounce * TRIES)));
            let powers = surface.w * vec2f(1.0, settings.gloss.across);
            let axes = surface_axes(normal, frame.world_up.xyz);
            drawn = anisotropic_normal(normal, axes, lobe_numbers(frame.sample, seed), powers);
        }
        var is_found = weighs || has_half_lobe;
        for (var tried = 0u; tried < TRIES && !is_found; tried++) {
            let seed = hash(settings.gloss.seed + hash(of_pixel + hash(bounce * TRIES + tried)));
            let candidate =
                lobe_normal(is_blinn, incoming, normal, across, lobe_numbers(frame.sample, seed), surface.w);
            is_found = dot(reflect(incoming, candidate), normal) > 0.0;
            if is_found {
                drawn = candidate;
            }
        }
    }
    textureStore(normal_out, id, vec4f(drawn, surface.w));
    if is_kept {
        var key = select(bitcast<u32>(max(surface.w, 0.0)) + 1u, WEIGHED, weighs);
        if bounce > 0u {
            // What the reflection before shows may have changed with its neighbours.
            let place_and_side = hash(of_bits(point.xyz) + hash(of_bits(surface.xyz) + hash(key)));
            key = (place_and_side & ~TOP_BIT) | 1u;
        }
        key = select(NO_RAY, key, is_mirror);
        let is_known = (kept[KEPT_WORDS * place + 2u] & ~TOP_BIT) == key && (bounce == 0u || pixels[place].is_anew == 0u);
        pixels[place].key = key;
        pixels[place].is_anew = select(1u, 0u, is_known);
        textureStore(rays_out, id, vec4f(point.xyz, select(point.w, 0.0, is_known)));
    }
    if bounce == 0u {
        pixels[place].weight = weight;
    }
}

fn of_bits(vector: vec3f) -> u32 {
    let bits = bitcast<vec3u>(vector);
    return hash(bits.x + hash(bits.y + hash(bits.z)));
}
