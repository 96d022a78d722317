// The light of the virtual lights on a surface, seen by the camera or in a mirror (Keller 1997; SSCR, 4.7). Each pixel
// of a tile is lit by its own run of the lights (interleaved sampling, Keller and Heidrich 2001); pixels at the same
// place in their tiles are processed together, so that a workgroup walks one run. One thread a pixel.
#import frame_group
#import brdf
#import gloss
#import finite
#import vpl

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
            if squared < NEAR * area_over_pi {
                transfer = transfer_of_square(light, offset, normal);
            } else {
                transfer *= mean_over_disc(light, normal, cosine, cosine_there, area_over_pi / squared);
            }
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

// The mean over a light's disc of the cosines over squared distance, as a multiple of those of its middle, to the second
// order in the disc's radius (the Laplacian in its plane): 1 / (1 + r^2 / d^2), which is exact, where disc and surface
// face each other, and more than 1 at a slant. `share` is r^2 / d^2. Over a surface that many lights cover evenly, discs send
// what the surface sends.
fn mean_over_disc(light: Vpl, normal: vec3f, cosine: f32, cosine_there: f32, share: f32) -> f32 {
    let facing = dot(normal, light.normal.xyz) * cosine_there / cosine;
    let bend = share * min(1.0 - 3.0 * cosine_there * cosine_there - facing, 2.0);
    return select(1.0 + bend, 1.0 / (1.0 - bend), bend < 0.0);
}

// A light counts as near within this many squares of its radius.
const NEAR: f32 = 25.0;

// The cosines over squared distance of a near light, which is treated as the square that it represents: in corners a
// disc's mean direction would darken the surface within its radius. It is the integral over the part of the square
// above the surface's horizon (Lambert 1760), divided by that part's area: where surfaces meet, the light's own surface
// ends there. The square is four fifths wider than the light's share of the surface, which compensates for the uneven
// spread of lights.
fn transfer_of_square(light: Vpl, offset: vec3f, normal: vec3f) -> f32 {
    let half = 0.9 * sqrt(3.14159265 * light.position.w);
    let along = light.tangent.xyz * half;
    let across = cross(light.normal.xyz, light.tangent.xyz) * half;
    var sum = vec2f(0.0);
    var before = offset - along + across;
    var height_before = dot(normal, before);
    var left = vec3f(0.0);
    var entered = vec3f(0.0);
    for (var i = 0; i < 4; i++) {
        let corner = offset + along * select(1.0, -1.0, i == 0 || i == 3) + across * select(1.0, -1.0, i < 2);
        let height = dot(normal, corner);
        if height > 0.0 || height_before > 0.0 {
            let crossing = mix(before, corner, height_before / (height_before - height));
            let start = select(crossing, before, height_before > 0.0);
            let end = select(crossing, corner, height > 0.0);
            entered = select(crossing, entered, height_before > 0.0);
            left = select(crossing, left, height > 0.0);
            sum += edge_of_square(light, normal, start, end);
        }
        before = corner;
        height_before = height;
    }
    sum += edge_of_square(light, normal, left, entered);
    return abs(sum.x) / max(abs(sum.y), 1e-20);
}

// The contribution of an edge to twice the integral of the cosines and to twice the area.
fn edge_of_square(light: Vpl, normal: vec3f, start: vec3f, end: vec3f) -> vec2f {
    let turn = cross(start, end);
    let sine = length(turn);
    // No contribution: an edge toward the surface, or of no length.
    let light_of_edge = select(0.0, atan2(sine, dot(start, end)) * dot(normal, turn) / sine, sine > 0.0);
    return vec2f(light_of_edge, dot(light.normal.xyz, turn));
}

// 1 if the light sees the surface at `at`, 0 if its shadow map has something nearer.
fn share_seen(v: u32, light: Vpl, at: vec3f, normal: vec3f) -> f32 {
    let point = point_in_map(lights, light, at);
    let size = f32(lights.map_size);
    let texel = clamp(floor((point.map * 0.5 + 0.5) * size), vec2f(0.0), vec2f(size - 1.0));
    let code = shadow_maps[v * lights.map_stride + u32(texel.y) * lights.map_size + u32(texel.x)];
    // The surface itself, as the texel's middle sees its plane.
    let ray = ray_of_map(lights, light, (texel + 0.5) / size * 2.0 - 1.0);
    let plane = dot(normal, at - ray.origin) / dot(normal, ray.direction);
    // A plane along the ray keeps the distance.
    let expected = select(point.distance, plane, is_finite(plane) && plane > 0.5 * point.distance && plane < point.distance);
    let stored = distance_of_code(lights, light.normal.w, code >> 16u);
    let bias = settings.gi.shadow_bias * lights.disc_radius;
    return select(1.0, 0.0, code != 0u && stored < expected - bias);
}
