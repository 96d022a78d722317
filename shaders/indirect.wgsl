// The light of the virtual lights on a surface, seen by the camera or in a mirror (Keller 1997; SSCR, 4.7). Each pixel
// of a tile is lit by its own run of the lights (interleaved sampling, Keller and Heidrich 2001); pixels at the same
// place in their tiles are processed together, so that a workgroup walks one run. One thread a pixel.
#import frame_group
#import brdf
#import gloss
#import finite
#import vpl
#import vpl_transfer

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var<uniform> lights: Virtual;
@group(1) @binding(5) var<storage, read> vpls: array<Vpl>;
@group(1) @binding(6) var<storage, read> shadow_maps: array<u32>;
// Irradiance over pi.
@group(1) @binding(7) var diffuse_out: texture_storage_2d<rgba16float, write>;
// Radiance of highlights, before the tint.
@group(1) @binding(8) var glossy_out: texture_storage_2d<rgba16float, write>;
// 1 for tiles of 8 x 8 pixels that need the light of this frame.
@group(1) @binding(9) var<storage, read> tiles: array<u32>;
// The levels of finer maps of the sky's lights, finest first, and as many parts of `near_maps`: positions are relative to the
// middle of the ball that a level shows, whose radius is the scene's, see gi/near.rs.
@group(1) @binding(10) var<storage, read> near_lights: array<Virtual>;
@group(1) @binding(11) var<storage, read> near_maps: array<u32>;

override from_camera: bool = true;
override interleave: u32 = 1u;
override has_shadows: bool = true;
override is_glossy: bool = false;
// Lights are spheres.
override is_spherical: bool = true;
// Set if only some tiles are computed, see indirect_reuse.wgsl.
override by_tiles: bool = false;
// The first one in so many of a run's lights are taken, for all of them: neighbours in the sequence lie far apart.
override parts: u32 = 1u;
// The runs that glossy samples share: each is lit by its part of a pixel's run.
override sample_runs: u32 = 1u;
// The most reflections whose lights are taken.
override most_bounces: u32 = 0xffffffffu;
// Whether the sky's lights have finer maps.
override has_near: bool = false;

// The share of the radius of a ball from which its finer maps fade into those of the next level, or of the scene.
const WHOLE_SHARE: f32 = 0.75;

@compute @workgroup_size(8, 8)
fn indirect(@builtin(global_invocation_id) invocation: vec3u) {
    let thread = whole_thread(frame, invocation);
    let place = vec2u(thread.z % interleave, thread.z / interleave);
    var id = thread.xy * interleave + place;
    if !from_camera {
        id = mirror_pixel(frame, vec3u(id, 0u));
    }
    if id.x >= frame.width || id.y >= frame.height || (!from_camera && textureLoad(from_in, id, 0).w == 0.0) {
        return;
    }
    if by_tiles && tiles[id.y / 8u * ((frame.width + 7u) / 8u) + id.x / 8u] == 0u {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    if position.w == 0.0 {
        return;
    }
    let surface = textureLoad(normal_in, id, 0);
    let normal = surface.xyz;
    var mirror_point = vec3f(0.0);
    if !from_camera {
        mirror_point = textureLoad(from_in, id, 0).xyz;
    }
    let toward_eye = toward_viewer(frame, position.xyz, from_camera, mirror_point);
    var gloss = SurfaceGloss(0.0, 0.0);
    if is_glossy {
        gloss = gloss_of(settings, textureLoad(albedo_in, id, 0).a, surface.w);
    }
    let at = position.xyz + lights.eye_radius.xyz;
    var diffuse = vec3f(0.0);
    var glossy = vec3f(0.0);
    // The lights of the sky first, then each bounce. Compilers copy the function to each call, so one call serves them all.
    var first = 0u;
    var count = lights.sky_lights;
    // Mesa's software Vulkan compiles a pass anew at each dispatch if a loop ends by a uniform alone, which took five
    // times as long as the pass itself. The length of the buffer, which is never less, makes it no uniform.
    let bounces = min(min(lights.bounces, most_bounces), arrayLength(&vpls));
    for (var bounce = 0u; bounce <= bounces; bounce++) {
        let sum = light_of_run(first, count, thread.z * sample_runs + frame.sample % sample_runs, at, normal, toward_eye, gloss);
        diffuse += sum.diffuse;
        glossy += sum.glossy;
        first += count;
        count = lights.lights_per_bounce;
    }
    // A run represents all lights.
    let runs = f32(interleave * interleave * sample_runs);
    textureStore(diffuse_out, id, vec4f(diffuse * runs / 3.14159265, 1.0));
    if is_glossy {
        textureStore(glossy_out, id, vec4f(glossy * runs * gloss.share, 1.0));
    }
}

struct Arriving {
    // Irradiance.
    diffuse: vec3f,
    // Multiplied by the highlight's shape.
    glossy: vec3f,
}

// The light of run `run` of `count` lights.
fn light_of_run(first: u32, count: u32, run: u32, at: vec3f, normal: vec3f, toward_eye: vec3f, gloss: SurfaceGloss) -> Arriving {
    let runs = interleave * interleave * sample_runs;
    let begin = first + count * run / runs;
    let whole = first + count * (run + 1u) / runs - begin;
    let taken = (whole + parts - 1u) / parts;
    var sum = Arriving(vec3f(0.0), vec3f(0.0));
    for (var v = begin; v < begin + taken; v++) {
        let light = vpls[v];
        let is_sky = light.normal.w == VPL_SKY;
        var offset = light.position.xyz - at;
        if is_sky {
            offset = light.normal.xyz;
        }
        let squared = dot(offset, offset);
        let toward = offset * inverseSqrt(max(squared, 1e-30));
        let cosine = dot(normal, toward);
        let cosine_there = select(-dot(light.normal.xyz, toward), 1.0, is_sky);
        let is_dark = all(light.intensity.rgb + light.glossy.rgb == vec3f(0.0));
        if light.normal.w == VPL_NONE || is_dark || cosine <= 0.0 || cosine_there <= 0.0 {
            continue;
        }
        let area_over_pi = light.position.w;
        var transfer = cosine * cosine_there / max(squared, 1e-12);
        if is_spherical && !is_sky {
            transfer = transfer_of_light(light, offset, normal) * light.tangent.w;
        }
        if settings.gi.clamp > 0.0 {
            // The form factor is transfer times area over pi.
            transfer = min(transfer, settings.gi.clamp / max(area_over_pi, 1e-30));
        }
        if is_sky {
            transfer = cosine;
        }
        // The radius under which a sphere is seen spreads highlights (after Hasan et al. 2009, whose mean over the cone
        // is approximated here by the variances of cone and lobe).
        var spread = 0.0;
        if is_spherical {
            // A light of the sky represents a cap of 2 pi over their number.
            let squared_sine = select(area_over_pi / (squared + area_over_pi), 2.0 / f32(lights.sky_lights), is_sky);
            spread = 0.25 * squared_sine;
        }
        var intensity = light.intensity.rgb;
        if is_glossy && !is_sky && any(light.glossy.rgb > vec3f(0.0)) {
            let power = 1.0 / (1.0 / light.intensity.w + spread);
            intensity += light.glossy.rgb
                * highlight(settings.light.highlight, light.normal.xyz, light.incoming.xyz, -toward, power);
        }
        if has_shadows && transfer > 0.0 {
            transfer *= share_seen(v, light, at, normal);
        }
        let arriving = intensity * transfer;
        sum.diffuse += arriving;
        if is_glossy && gloss.share > 0.0 {
            let power = 1.0 / (1.0 / gloss.power + spread);
            sum.glossy += arriving * highlight(settings.light.highlight, normal, toward, toward_eye, power);
        }
    }
    if taken < whole {
        let share = f32(whole) / f32(taken);
        sum.diffuse *= share;
        sum.glossy *= share;
    }
    return sum;
}

// 1 if the light sees the surface at `at`, 0 if its shadow map has something nearer; between both where finer maps end.
fn share_seen(v: u32, light: Vpl, at: vec3f, normal: vec3f) -> f32 {
    // What finer levels leave to coarser ones.
    var outside = 1.0;
    var seen = 0.0;
    if has_near && light.normal.w == VPL_SKY {
        let levels = arrayLength(&near_lights);
        let texels = arrayLength(&near_maps) / levels;
        for (var level = 0u; level < levels && outside > 0.0; level++) {
            let near = near_lights[level];
            let place = at - lights.eye_radius.xyz + near.eye_radius.xyz;
            let fade = clamp((length(place) / near.eye_radius.w - WHOLE_SHARE) / (1.0 - WHOLE_SHARE), 0.0, 1.0);
            if fade < 1.0 {
                let map = place_in_map(near, v, light, place);
                let code = near_maps[level * texels + map.index];
                seen += outside * (1.0 - fade) * share_before(near, light, place, normal, map, code);
            }
            outside *= fade;
        }
    }
    if outside > 0.0 {
        let map = place_in_map(lights, v, light, at);
        seen += outside * share_before(lights, light, at, normal, map, shadow_maps[map.index]);
    }
    return seen;
}

struct MapPlace {
    // The texel, and its index in all maps.
    texel: vec2f,
    index: u32,
    // The distance from the light.
    distance: f32,
}

fn place_in_map(map_lights: Virtual, v: u32, light: Vpl, at: vec3f) -> MapPlace {
    let point = point_in_map(map_lights, light, at);
    let size = f32(map_lights.map_size);
    let texel = clamp(floor((point.map * 0.5 + 0.5) * size), vec2f(0.0), vec2f(size - 1.0));
    let index = v * map_lights.map_stride + u32(texel.y) * map_lights.map_size + u32(texel.x);
    return MapPlace(texel, index, point.distance);
}

// 1 if the surface at `at` is not behind what the texel at `place` holds, else 0.
fn share_before(map_lights: Virtual, light: Vpl, at: vec3f, normal: vec3f, place: MapPlace, code: u32) -> f32 {
    // The surface itself, as the texel's middle sees its plane.
    let ray = ray_of_map(map_lights, light, (place.texel + 0.5) / f32(map_lights.map_size) * 2.0 - 1.0);
    let plane = dot(normal, at - ray.origin) / dot(normal, ray.direction);
    // A plane along the ray keeps the distance.
    let is_hit = is_finite(plane) && plane > 0.5 * place.distance && plane < place.distance;
    let expected = select(place.distance, plane, is_hit);
    let stored = distance_of_code(map_lights, light.normal.w, code >> 16u);
    let bias = settings.gi.shadow_bias * map_lights.disc_radius;
    return select(1.0, 0.0, code != 0u && stored < expected - bias);
}
