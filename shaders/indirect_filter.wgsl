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
// a: of light by rays, see light_ray_sum.wgsl.
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
// The edge of the part of the window whose pixels count however near other surfaces are. Pixels beyond it count if they
// are within reach.
override narrow: u32 = 1u;
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

// The most that two places are apart whose light is averaged, in harmonic mean distances of what is about them.
const REACH: f32 = 0.1;
// Farther apart than any two places.
const FAR: f32 = 1e30;

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
        // Highlights change with the direction to the eye, too, so what is beyond the nearest pixels says nothing of them.
        var glossy_weight = 0.0;
        // Any window of the tile's size has one pixel of each run.
        let first = vec2i(id) - i32(window / 2u);
        let nearest = vec2i(id) - i32(narrow / 2u);
        var most_apart = FAR;
        if narrow < window {
            most_apart = reach(nearest, surface.xyz, position.xyz, range);
        }
        for (var i = 0u; i < taps; i++) {
            let at = first + vec2i(i32(i % window), i32(i / window));
            let is_nearest = all(at >= nearest) && all(at < nearest + i32(narrow));
            if is_one_surface(at, surface.xyz, position.xyz, range, select(most_apart, FAR, is_nearest)) {
                weight += 1.0;
                diffuse += textureLoad(diffuse_in, at, 0).rgb;
                if is_glossy && is_nearest {
                    glossy_weight += 1.0;
                    glossy += textureLoad(glossy_in, at, 0).rgb;
                }
            }
        }
        // The pixel itself always counts.
        diffuse /= max(weight, 1.0);
        glossy /= max(glossy_weight, 1.0);
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

// Whether another pixel shows the surface of a place with a normal that is `range` from its eye, and is that near to it.
fn is_one_surface(at: vec2i, normal: vec3f, place: vec3f, range: f32, most_apart: f32) -> bool {
    if any(at < vec2i(0)) || at.x >= i32(frame.width) || at.y >= i32(frame.height) {
        return false;
    }
    let other = textureLoad(position_in, at, 0);
    let facing = dot(textureLoad(normal_in, at, 0).xyz, normal);
    let beside = abs(dot(other.xyz - place, normal));
    var is_one = other.w > 0.0 && facing >= cos(radians(settings.gi.filter_angle));
    is_one = is_one && beside <= settings.gi.filter_depth * range && distance(other.xyz, place) <= most_apart;
    if !from_camera {
        is_one = is_one && textureLoad(from_in, at, 0).w > 0.0;
    }
    return is_one;
}

// How far apart two places of a surface may be whose light is averaged: light varies the more quickly the nearer other
// surfaces are (Ward, Rubinstein and Clear 1988). Their harmonic mean distance follows from the rays of the nearest pixels.
fn reach(first: vec2i, normal: vec3f, place: vec3f, range: f32) -> f32 {
    var nearness = 0.0;
    var weight = 0.0;
    for (var i = 0u; i < narrow * narrow; i++) {
        let at = first + vec2i(i32(i % narrow), i32(i / narrow));
        if is_one_surface(at, normal, place, range, FAR) {
            nearness += textureLoad(diffuse_in, at, 0).a;
            weight += 1.0;
        }
    }
    return REACH * frame.scene_radius * weight / max(nearness, 1e-30);
}
