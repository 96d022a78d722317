// Virtual lights (Keller 1997) and their shadow maps (Ritschel et al. 2008). Filled by crates/render/src/gi; the CPU twin is
// crates/render/src/gi/twin.rs.
// All positions are relative to one origin that stands still while the camera moves.

struct Virtual {
    // xyz: the camera's eye. w: radius of the scene, world units.
    eye_radius: vec4f,
    // The radius of the discs from which shadow maps are splatted, in world units.
    disc_radius: f32,
    // The nearest distance that a shadow map distinguishes.
    nearest: f32,
    // The steps of a shadow map's distances for each doubling.
    steps: f32,
    // The number of texels along an edge of a shadow map.
    map_size: u32,
    // The number of texels of a shadow map with the levels of its pyramid.
    map_stride: u32,
    // The number of points from which shadow maps are splatted.
    point_count: u32,
    // Virtual light v is splatted from the points p for which p % subsets == v % subsets.
    subsets: u32,
    sky_lights: u32,
    // The number of lights of each bounce; they follow those of the sky.
    lights_per_bounce: u32,
    bounces: u32,
    // The squared radius of the surface that a light of the second and later bounces represents.
    area_over_pi: f32,
    // 1 if the reflections of mirrors are followed; else a mirror is a diffuse surface.
    follows_mirrors: u32,
}

struct Vpl {
    // xyz: position; w: squared radius of the surface that it represents.
    position: vec4f,
    // xyz: unit normal of the surface, or toward a light of the sky; w: VPL_*.
    normal: vec4f,
    // rgb: radiant intensity straight ahead, by diffuse reflection, or a sky light's irradiance. w: power of the highlight.
    intensity: vec4f,
    // rgb: flux that is reflected as a highlight.
    glossy: vec4f,
    // The unit vector to the origin of its light.
    incoming: vec4f,
    // xyz: the first axis of its shadow map; w: the factor of its light, see vpl_balance.wgsl.
    tangent: vec4f,
}

// The lights and maps that a pass works on.
struct Step {
    first_light: u32,
    // The number of the bounce, from 1.
    bounce: u32,
    // The finer level of the maps: edge in texels, and its first texel in a map.
    fine_size: u32,
    fine_first: u32,
    coarse_first: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
}

// The number of texels along an edge of a lamp's or the sun's shadow map, equal to light.wgsl.
const LAMP_MAP_SIZE: u32 = 1024u;

// The number of vectors kept of a point that casts shadows, see vpl_points.wgsl.
const OCCLUDER_VECTORS: u32 = 2u;
// The counters of a layer of the lamps' shadow maps, see vpl_aim.wgsl.
const AIM_COUNTS: u32 = 2u;

const VPL_NONE: f32 = 0.0;
const VPL_LOCAL: f32 = 1.0;
const VPL_SKY: f32 = 2.0;

// A unit vector across `normal` (Duff et al. 2017).
fn tangent_of(normal: vec3f) -> vec3f {
    let side = select(-1.0, 1.0, normal.z >= 0.0);
    let a = -1.0 / (side + normal.z);
    return vec3f(1.0 + side * normal.x * normal.x * a, side * normal.x * normal.y * a, -side * normal.x);
}

// Paraboloid maps (Brabec et al. 2002) of the half space before a light: the unit disc, in which z, the normal, is the middle.
fn map_from_direction(direction: vec3f) -> vec2f {
    return direction.xy / (1.0 + direction.z);
}

fn direction_from_map(map: vec2f) -> vec3f {
    let squared = dot(map, map);
    return vec3f(2.0 * map, 1.0 - squared) / (1.0 + squared);
}

// A texel of a shadow map keeps the nearest disc: in its upper half a code that is larger for nearer discs, in its
// lower half the point's number among the light's. 0: nothing.
fn code_of_distance(lights: Virtual, kind: f32, distance: f32) -> u32 {
    let steps = select(
        log2(distance / lights.nearest) * lights.steps,
        distance / (2.0 * lights.eye_radius.w) * 65534.0,
        kind == VPL_SKY,
    );
    return 65535u - u32(clamp(steps, 0.0, 65534.0));
}

// The far end of the code's step.
fn distance_of_code(lights: Virtual, kind: f32, code: u32) -> f32 {
    let steps = f32(65536u - code);
    if kind == VPL_SKY {
        return steps / 65534.0 * 2.0 * lights.eye_radius.w;
    }
    return lights.nearest * exp2(steps / lights.steps);
}

// The ray of a texel of a light's map into the scene.
struct MapRay {
    origin: vec3f,
    direction: vec3f,
}

// `map`: -1 to 1.
fn ray_of_map(lights: Virtual, light: Vpl, map: vec2f) -> MapRay {
    let tangent = light.tangent.xyz;
    let bitangent = cross(light.normal.xyz, tangent);
    if light.normal.w == VPL_SKY {
        let across = tangent * map.x + bitangent * map.y + light.normal.xyz;
        return MapRay(across * lights.eye_radius.w, -light.normal.xyz);
    }
    let direction = direction_from_map(map);
    let world = tangent * direction.x + bitangent * direction.y + light.normal.xyz * direction.z;
    return MapRay(light.position.xyz, world);
}

// The place of a point in a light's map.
struct MapPoint {
    map: vec2f,
    // The distance from the light; for the sky, from the plane that touches the scene's sphere.
    distance: f32,
    // The map units per world unit across the line of sight.
    scale: f32,
    // The unit vector from the light to the point.
    direction: vec3f,
}

fn point_in_map(lights: Virtual, light: Vpl, point: vec3f) -> MapPoint {
    let tangent = light.tangent.xyz;
    let normal = light.normal.xyz;
    let bitangent = cross(normal, tangent);
    if light.normal.w == VPL_SKY {
        let radius = lights.eye_radius.w;
        let map = vec2f(dot(tangent, point), dot(bitangent, point)) / radius;
        return MapPoint(map, radius - dot(normal, point), 1.0 / radius, -normal);
    }
    let offset = point - light.position.xyz;
    let distance = length(offset);
    let direction = offset / max(distance, 1e-20);
    let local = vec3f(dot(tangent, direction), dot(bitangent, direction), dot(normal, direction));
    let map = map_from_direction(vec3f(local.xy, max(local.z, -0.5)));
    return MapPoint(map, distance, 0.5 * (1.0 + dot(map, map)) / max(distance, 1e-20), direction);
}
