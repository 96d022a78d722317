// Spot lights, the sun, and their shadow maps. Filled by crates/render/src/lighting.rs. The importing pass has the
// bindings `lights` and `shadows`: SHADOW_SIZE squared texels a light, one light after the other, row by row; x:
// identity of the nearest point, y: its nearness, 0 if there is none.
#import frame_group
#import splat

struct LightSource {
    // xyz: relative to the eye. w: inner angle, radians.
    position_inner: vec4f,
    // xyz: unit axis. w: outer angle in radians; 0 for a sun, whose light is parallel.
    axis_outer: vec4f,
    // rgb: radiant intensity within the inner cone; for a sun, irradiance across its light. a: shadow map texels per
    // unit of tangent; for a sun, per world unit.
    intensity_focal: vec4f,
    right: vec4f,
    up: vec4f,
}

// The number of texels along an edge of a shadow map.
const SHADOW_SIZE: i32 = 1024;

struct Arriving {
    // The unit vector to the light.
    direction: vec3f,
    // The share that is not in shadow.
    irradiance: vec3f,
}

// The finest map of the sun that contains a point: the first is that of the whole scene; if `count` is 2, the second is
// fitted to the view.
fn sun_map(count: u32, position: vec3f) -> u32 {
    let texel = shadow_texel(lights[1], position - lights[1].position_inner.xyz).xy;
    // The filter needs a texel on each side.
    let is_inside = all(texel >= vec2f(1.0)) && all(texel < vec2f(f32(SHADOW_SIZE - 1)));
    return select(0u, 1u, count > 1u && is_inside);
}

// The light that reaches a surface from light `index`; `position` is relative to the eye. Normals may point either way:
// they were turned to the eye, so what matters is whether eye and light are on the same side.
fn light_arriving(index: u32, position: vec3f, normal: vec3f) -> Arriving {
    let light = lights[index];
    let offset = position - light.position_inner.xyz;
    let squared = max(dot(offset, offset), 1e-20);
    let is_sun = light.axis_outer.w == 0.0;
    let direction = select(-offset * inverseSqrt(squared), -light.axis_outer.xyz, is_sun);
    let cosine = dot(normal, direction);
    let across = select(intensity_toward(light, offset) / squared, light.intensity_focal.rgb, is_sun);
    return Arriving(direction, across * (max(cosine, 0.0) * share_lit(index, light, offset, cosine)));
}

// The radiant intensity towards a point at `offset` from a spot light; it falls linearly in angle from the inner to the
// outer cone.
fn intensity_toward(light: LightSource, offset: vec3f) -> vec3f {
    let along = dot(offset, light.axis_outer.xyz);
    let across = length(offset - light.axis_outer.xyz * along);
    let angle = atan2(across, along);
    let edge = max(light.axis_outer.w - light.position_inner.w, 1e-6);
    return light.intensity_focal.rgb * clamp((light.axis_outer.w - angle) / edge, 0.0, 1.0);
}

// The texel coordinates of a point at `offset` from the light; z: linear depth.
fn shadow_texel(light: LightSource, offset: vec3f) -> vec3f {
    let view = vec3f(dot(offset, light.right.xyz), dot(offset, light.up.xyz), dot(offset, light.axis_outer.xyz));
    let scale = light.intensity_focal.a / select(max(view.z, 1e-6), 1.0, light.axis_outer.w == 0.0);
    let middle = f32(SHADOW_SIZE / 2);
    return vec3f(middle + view.x * scale, middle - view.y * scale, view.z);
}

// The share of the 3 x 3 texels about a point that are not in shadow.
fn share_lit(index: u32, light: LightSource, offset: vec3f, cosine: f32) -> f32 {
    let texel = shadow_texel(light, offset);
    let tangent = sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 0.05);
    // Over the filter's two texels to the side a surface rises by its slope; splats rise as much above it again.
    let width = select(texel.z, 1.0, light.axis_outer.w == 0.0) / light.intensity_focal.a;
    let bias = settings.light.shadow_bias * width * (1.0 + tangent);
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
