// The virtual lights of the first bounce of lamps and sun: each is placed on the point that its light meets and
// reflects an equal part of the flux. Runs once for each page of the point store and takes the lights whose point lies
// in it. One thread a virtual light.
#import point_surface
#import vpl_of_surface

@group(2) @binding(0) var<uniform> lights: Virtual;
@group(2) @binding(1) var<storage, read> hits: array<u32>;
@group(2) @binding(2) var<storage, read> counts: array<u32>;
@group(2) @binding(3) var<storage, read> shadows: array<vec2u>;
// For each layer, how its light shines.
@group(2) @binding(4) var<storage, read> emitters: array<Emitter>;
@group(2) @binding(5) var<storage, read_write> vpls: array<Vpl>;

// Declared in crates/render/src/layout.rs. Positions are relative to the virtual lights' origin.
struct Emitter {
    // xyz: position; w: 1 if the light's rays are parallel.
    position: vec4f,
    // w: texels per unit of tangent, or per world unit if the rays are parallel.
    axis_focal: vec4f,
    right: vec4f,
    up: vec4f,
    // rgb: flux of each virtual light if all directions met something.
    flux: vec4f,
    // rgb: radiant intensity in the middle, or irradiance.
    strength: vec4f,
    // Angles of the cone, radians: inner, outer.
    angles: vec4f,
}

@compute @workgroup_size(64)
fn vpl_place(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= lights.lights_per_bounce || hits[id.x] == 0xffffffffu {
        return;
    }
    let layer = hits[id.x] >> 24u;
    let texel = hits[id.x] & 0xffffffu;
    let key = shadows[layer * LAMP_MAP_SIZE * LAMP_MAP_SIZE + texel];
    let index = index_of_identity(key.x);
    if index >= page.point_count {
        return;
    }
    let emitter = emitters[layer];
    let is_parallel = emitter.position.w != 0.0;
    let pixel = vec2f(vec2u(texel % LAMP_MAP_SIZE, texel / LAMP_MAP_SIZE)) + 0.5;
    let centered = vec2f(pixel.x - f32(LAMP_MAP_SIZE / 2u), f32(LAMP_MAP_SIZE / 2u) - pixel.y) / emitter.axis_focal.w;
    let depth = depth_from_nearness(key.y);
    let across = emitter.right.xyz * centered.x + emitter.up.xyz * centered.y;
    let offset = select(across, across * depth, !is_parallel) + emitter.axis_focal.xyz * depth;
    let toward = select(-normalize(offset), -emitter.axis_focal.xyz, is_parallel);
    let surface = surface_of_point(index, toward);
    let cosine = max(dot(surface.normal.xyz, toward), 0.0);
    // First tries show what part of the flux meets anything; all lights that do share it.
    let flux = emitter.flux.rgb * f32(counts[layer * AIM_COUNTS]) / f32(max(counts[layer * AIM_COUNTS + 1u], 1u));
    // The surface that receives this flux.
    var irradiance = dot(emitter.strength.rgb, vec3f(1.0)) * cosine;
    if !is_parallel {
        let angle = acos(clamp(-dot(toward, emitter.axis_focal.xyz), -1.0, 1.0));
        let edge = max(emitter.angles.y - emitter.angles.x, 1e-6);
        irradiance *= clamp((emitter.angles.y - angle) / edge, 0.0, 1.0) / dot(offset, offset);
    }
    let area = dot(flux, vec3f(1.0)) / max(irradiance, 1e-20);
    // A light that only grazes a surface, or the cone's edge, would represent a larger surface than exists.
    let most = 0.01 * lights.eye_radius.w * lights.eye_radius.w;
    let squared = min(area / 3.14159265, most);
    let position = emitter.position.xyz + offset;
    vpls[lights.sky_lights + id.x] =
        vpl_of_surface(lights, position, surface.normal.xyz, toward, surface.albedo, flux, squared);
}
