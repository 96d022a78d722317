// Spot lights and their shadow maps. Filled by crates/render/src/lighting.rs.
#import frame

struct SpotLight {
    // xyz: relative to the eye. w: inner angle, radians.
    position_inner: vec4f,
    // xyz: unit axis. w: outer angle, radians.
    axis_outer: vec4f,
    // rgb: radiant intensity within the inner cone. a: shadow map texels per unit of tangent.
    intensity_focal: vec4f,
    right: vec4f,
    up: vec4f,
}

// Texels along an edge of a shadow map.
const SHADOW_SIZE: i32 = 1024;

// Radiant intensity towards a point at `offset` from the light, falling linearly in angle from the inner to the outer cone.
fn intensity_toward(light: SpotLight, offset: vec3f) -> vec3f {
    let along = dot(offset, light.axis_outer.xyz);
    let across = length(offset - light.axis_outer.xyz * along);
    let angle = atan2(across, along);
    let edge = max(light.axis_outer.w - light.position_inner.w, 1e-6);
    return light.intensity_focal.rgb * clamp((light.axis_outer.w - angle) / edge, 0.0, 1.0);
}

// Texel coordinates of a point at `offset` from the light; z: linear depth.
fn shadow_texel(light: SpotLight, offset: vec3f) -> vec3f {
    let view = vec3f(dot(offset, light.right.xyz), dot(offset, light.up.xyz), dot(offset, light.axis_outer.xyz));
    let scale = light.intensity_focal.a / max(view.z, 1e-6);
    let middle = f32(SHADOW_SIZE / 2);
    return vec3f(middle + view.x * scale, middle - view.y * scale, view.z);
}
