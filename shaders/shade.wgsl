// Direct light on a surface, whatever it was seen by: the camera, or a mirror. Lambertian: radiance = albedo / pi x irradiance.
// Linear radiance. One thread a pixel.
#import frame
#import params
#import splat
#import light

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var<storage, read> lights: array<SpotLight>;
// SHADOW_SIZE squared a light; y: nearness of the nearest point, 0 where there is none.
@group(1) @binding(5) var<storage, read> shadows: array<vec2u>;
@group(1) @binding(6) var radiance_out: texture_storage_2d<rgba16float, write>;

override from_camera: bool = true;
override lighting: u32 = LIGHT_BY_HEADLIGHT;
override light_count: u32 = 0u;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) thread: vec3u) {
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
    let albedo = textureLoad(albedo_in, id, 0).rgb;
    let normal = textureLoad(normal_in, id, 0).xyz;
    var lit = vec3f(1.0);
    if lighting == LIGHT_BY_LIGHTS {
        lit = vec3f(0.0);
        for (var i = 0u; i < light_count; i++) {
            lit += irradiance(i, position.xyz, normal) / 3.14159265;
        }
    } else if lighting != LIGHT_BY_COLORS {
        // A lamp at the eye, or where the reflected ray comes from: all that is seen is turned to it.
        var toward_eye = -position.xyz;
        if !from_camera {
            toward_eye = textureLoad(from_in, id, 0).xyz - position.xyz;
        } else if frame.orthographic != 0u {
            toward_eye = -frame.forward.xyz;
        }
        let cosine = clamp(dot(normal, toward_eye) * inverseSqrt(max(dot(toward_eye, toward_eye), 1e-30)), 0.0, 1.0);
        lit = vec3f(mix(1.0, cosine, settings.light.headlight));
    }
    textureStore(radiance_out, id, vec4f(albedo * lit, 1.0));
}

// Normals may point either way (they were turned to the eye): what matters is whether eye and light are on the same side, and
// they are turned to the eye already.
fn irradiance(index: u32, position: vec3f, normal: vec3f) -> vec3f {
    let light = lights[index];
    let offset = position - light.position_inner.xyz;
    let squared = max(dot(offset, offset), 1e-20);
    let cosine = dot(normal, -offset) * inverseSqrt(squared);
    let arriving = intensity_toward(light, offset) * max(cosine, 0.0) / squared;
    return arriving * share_lit(index, light, offset, cosine);
}

// Share of the 3 x 3 texels about a point that are not in shadow.
fn share_lit(index: u32, light: SpotLight, offset: vec3f, cosine: f32) -> f32 {
    let texel = shadow_texel(light, offset);
    let tangent = sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 0.05);
    // Over the filter's two texels to the side a surface rises by its slope; splats stand as much above it again.
    let bias = settings.light.shadow_bias * (texel.z / light.intensity_focal.a) * (1.0 + tangent);
    let center = vec2i(floor(texel.xy));
    var lit = 0.0;
    var inside = 0.0;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let at = center + vec2i(x, y);
            if all(at >= vec2i(0)) && all(at < vec2i(SHADOW_SIZE)) {
                let key = shadows[(i32(index) * SHADOW_SIZE + at.y) * SHADOW_SIZE + at.x].y;
                inside += 1.0;
                lit += select(1.0, 0.0, key != 0u && depth_from_nearness(key) < texel.z - bias);
            }
        }
    }
    return select(1.0, lit / inside, inside > 0.0);
}
