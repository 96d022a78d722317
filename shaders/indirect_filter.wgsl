// Indirect light as radiance: the mean over the pixels of a tile that lie on one surface, each lit by its own run of
// the virtual lights; times the surface's colour. One thread a pixel.
#import frame_group
#import brdf
#import gloss
#import kept_light

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var diffuse_in: texture_2d<f32>;
@group(1) @binding(5) var glossy_in: texture_2d<f32>;
@group(1) @binding(6) var radiance_out: texture_storage_2d<rgba16float, write>;
// See kept_light.wgsl.
@group(1) @binding(7) var<storage, read_write> kept: array<vec4u>;
// See shade.wgsl.
@group(1) @binding(8) var left_in: texture_2d<f32>;
@group(1) @binding(9) var rays_in: texture_2d<f32>;

override from_camera: bool = true;
// The edge of the window in pixels; 1 for no average.
override window: u32 = 1u;
override is_glossy: bool = false;
// Set if a reflection is followed from here, which replaces the mirror's own light.
override is_mixed: bool = false;
// Set if light is kept for the next frame.
override keeps: bool = false;
// Set if pixels take the light that indirect_reuse has found.
override reuses: bool = false;
// See shade.wgsl.
override stops: bool = false;
override is_published: bool = false;
override fades: bool = false;
override is_mean_left: bool = false;

@compute @workgroup_size(8, 8)
fn indirect_filter(@builtin(global_invocation_id) invocation: vec3u) {
    let thread = whole_thread(frame, invocation);
    var id = thread.xy;
    if !from_camera {
        id = mirror_pixel(frame, thread);
    }
    if id.x >= frame.width || id.y >= frame.height || (!from_camera && textureLoad(from_in, id, 0).w == 0.0) {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    let index = id.y * frame.width + id.x;
    if position.w == 0.0 {
        textureStore(radiance_out, id, vec4f(0.0));
        if keeps {
            kept[index] = vec4u(0u);
        }
        return;
    }
    let surface = textureLoad(normal_in, id, 0);
    var mirror_point = vec3f(0.0);
    if !from_camera {
        mirror_point = textureLoad(from_in, id, 0).xyz;
    }
    let toward_eye = toward_viewer(frame, position.xyz, from_camera, mirror_point);
    let range = select(frame.reference_depth, distance(mirror_point, position.xyz), frame.orthographic == 0u || !from_camera);
    var diffuse = vec3f(0.0);
    var glossy = vec3f(0.0);
    var found = 0u;
    if reuses {
        found = kept[index].w;
    }
    // Software Vulkan runs both sides of a branch, and within one that depends on `found` it would know the length of the
    // loop, and run it that often.
    let taps = select(window * window, 0u, found != 0u);
    if window == 1u {
        diffuse = textureLoad(diffuse_in, id, 0).rgb;
        if is_glossy {
            glossy = textureLoad(glossy_in, id, 0).rgb;
        }
    } else {
        var weight = 0.0;
        let least = cos(radians(settings.gi.filter_angle));
        let most = settings.gi.filter_depth * range;
        // Any window of the tile's size has one pixel of each run.
        let first = vec2i(id) - i32(window / 2u);
        for (var i = 0u; i < taps; i++) {
            let at = first + vec2i(i32(i % window), i32(i / window));
            if any(at < vec2i(0)) || at.x >= i32(frame.width) || at.y >= i32(frame.height) {
                continue;
            }
            let other = textureLoad(position_in, at, 0);
            let facing = dot(textureLoad(normal_in, at, 0).xyz, surface.xyz);
            let beside = abs(dot(other.xyz - position.xyz, surface.xyz));
            var is_one = other.w > 0.0 && facing >= least && beside <= most;
            if !from_camera {
                is_one = is_one && textureLoad(from_in, at, 0).w > 0.0;
            }
            if is_one {
                weight += 1.0;
                diffuse += textureLoad(diffuse_in, at, 0).rgb;
                if is_glossy {
                    glossy += textureLoad(glossy_in, at, 0).rgb;
                }
            }
        }
        // The pixel itself always counts.
        diffuse /= max(weight, 1.0);
        glossy /= max(weight, 1.0);
    }
    if found != 0u {
        diffuse = unpack_light(found);
        glossy = vec3f(0.0);
    }
    if keeps && found == 0u {
        kept[index] = vec4u(bitcast<vec3u>(position.xyz), pack_light(diffuse));
    }
    let albedo = textureLoad(albedo_in, id, 0);
    let gloss = gloss_of(settings, albedo.a, surface.w);
    let grazing = grazing_share(settings, dot(surface.xyz, toward_eye), is_published);
    let highlight = glossy * mirror_tint(settings, albedo.rgb, 0.0);
    var radiance = albedo.rgb * diffuse * settings.light.diffuse;
    if albedo.a <= 0.0 {
        radiance = radiance * (1.0 - gloss.share) + highlight;
    } else if is_mixed && (!stops || textureLoad(rays_in, id, 0).w > 0.0) {
        // A mirror's highlight is already part of its reflection.
        var reflected = mirror_share(albedo.a, grazing, is_published);
        if fades {
            let left = textureLoad(left_in, id, 0);
            let by_reach = share_left(settings.mirror.fade_distance, settings.mirror.fade_least, left.x);
            reflected *= select(by_reach, left.a, is_mean_left);
        }
        radiance *= 1.0 - reflected;
    } else {
        radiance += highlight;
    }
    textureStore(radiance_out, id, vec4f(radiance, 1.0));
}
