// Direct light on a surface, seen by the camera or in a mirror. Lambertian (radiance = albedo / pi x irradiance) with
// highlights; for a mirror whose reflection blend.wgsl adds, the diffuse light that remains beside it. Linear radiance.
// One thread a pixel.
#import frame_group
#import splat
#import light
#import brdf
#import gloss

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var<storage, read> lights: array<LightSource>;
@group(1) @binding(5) var<storage, read> shadows: array<vec2u>;
@group(1) @binding(6) var radiance_out: texture_storage_2d<rgba16float, write>;
// x: how far the mirror's ray goes, in mirror radii; or a: the mean share of its reflections that is left.
@group(1) @binding(7) var left_in: texture_2d<f32>;
// w: 0 where no ray is followed from a mirror.
@group(1) @binding(8) var rays_in: texture_2d<f32>;
// rgb: the irradiance of light that mirrors throw.
@group(1) @binding(9) var thrown_in: texture_2d<f32>;

override from_camera: bool = true;
// LIGHT_BY_*, never auto.
override lighting: u32 = LIGHT_BY_HEADLIGHT;
// For a sun, the number of its maps.
override light_count: u32 = 0u;
// Set if the reflections of this surface's mirrors are followed.
override is_mixed: bool = false;
// Set if only some of them are.
override stops: bool = false;
// Set if a lamp at the eye adds to lights or sun.
override has_fill: bool = false;
// Set if some surface shows highlights of lights.
override has_highlights: bool = false;
// Set if mirrors throw light onto surfaces.
override has_photons: bool = false;
// Set if the share that mirrors reflect is the published one of the angle.
override is_published: bool = false;
// Set if reflections fade by distance, and if `left_in` has the mean of several rays.
override fades: bool = false;
override is_mean_left: bool = false;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) invocation: vec3u) {
    let thread = whole_thread(frame, invocation);
    var id = thread.xy;
    if !from_camera {
        id = mirror_pixel(frame, thread);
    }
    if id.x >= frame.width || id.y >= frame.height || (!from_camera && textureLoad(from_in, id, 0).w == 0.0) {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    if position.w == 0.0 {
        textureStore(radiance_out, id, vec4f(0.0));
        return;
    }
    let albedo = textureLoad(albedo_in, id, 0);
    let normal = textureLoad(normal_in, id, 0);
    var mirror_point = vec3f(0.0);
    if !from_camera {
        mirror_point = textureLoad(from_in, id, 0).xyz;
    }
    let to_eye = toward_viewer(frame, position.xyz, from_camera, mirror_point);
    let cosine = clamp(dot(normal.xyz, to_eye), 0.0, 1.0);
    let is_mirror = albedo.a > 0.0;
    // The diffuse share of the albedo.
    var share = 1.0;
    if is_mixed && is_mirror && (!stops || textureLoad(rays_in, id, 0).w > 0.0) {
        var reflected = mirror_share(albedo.a, grazing_share(settings, cosine, is_published), is_published);
        if fades {
            let left = textureLoad(left_in, id, 0);
            let by_reach = share_left(settings.mirror.fade_distance, settings.mirror.fade_least, left.x);
            reflected *= select(by_reach, left.a, is_mean_left);
        }
        share -= reflected;
    }
    var radiance = vec3f(0.0);
    if lighting == LIGHT_BY_COLORS {
        radiance = albedo.rgb * share;
    } else if lighting == LIGHT_BY_HEADLIGHT {
        // A lamp at the eye, or at the origin of the reflected ray: every visible surface is turned to it.
        radiance = albedo.rgb * (share * mix(1.0, cosine, settings.light.headlight));
    } else {
        let gloss = gloss_of(settings, albedo.a, normal.w);
        if has_highlights && !is_mirror {
            share -= gloss.share;
        }
        share *= settings.light.diffuse;
        var diffuse = vec3f(0.0);
        var specular = vec3f(0.0);
        let is_sun = lighting == LIGHT_BY_SUN;
        for (var i = 0u; i < select(light_count, 1u, is_sun); i++) {
            var index = i;
            if is_sun {
                index = sun_map(light_count, position.xyz);
            }
            let arriving = light_arriving(index, position.xyz, normal.xyz);
            diffuse += arriving.irradiance;
            if has_highlights && gloss.share > 0.0 {
                let shape = highlight(settings.light.highlight, normal.xyz, arriving.direction, to_eye, gloss.power);
                specular += arriving.irradiance * (gloss.share * shape);
            }
        }
        if has_photons {
            diffuse += textureLoad(thrown_in, id, 0).rgb;
        }
        let tint = mirror_tint(settings, albedo.rgb, 0.0);
        radiance = albedo.rgb * diffuse * (share * 0.31830989) + tint * specular;
        if has_fill {
            radiance += albedo.rgb * (share * settings.light.fill * mix(1.0, cosine, settings.light.headlight));
        }
    }
    textureStore(radiance_out, id, vec4f(radiance, 1.0));
}
