// The virtual lights of the next bounce: each is placed where one of the lights before sends its light, in a direction
// drawn by the cosine from that light's shadow map; it carries all the light that its parent reflects. Lights of the
// sky send theirs to a place drawn evenly over their map. One thread a virtual light.
#import frame_group
#import vpl_of_surface

@group(1) @binding(0) var<uniform> lights: Virtual;
// For each new light: its parent, or PARENT_NONE; bits of two numbers from 0 to 1, or of a place in a sky light's map;
// bits of the share of the parent's light.
@group(1) @binding(1) var<storage, read> births: array<vec4u>;
@group(1) @binding(2) var<storage, read> shadow_maps: array<u32>;
// Two a point, see vpl_points.wgsl.
@group(1) @binding(3) var<storage, read> surfaces: array<vec4f>;
// xyz: bits of the position.
@group(1) @binding(4) var<storage, read> chosen: array<vec4u>;
@group(1) @binding(5) var<storage, read_write> vpls: array<Vpl>;
@group(1) @binding(6) var<uniform> work: Step;

const PARENT_NONE: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn vpl_bounce(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= lights.lights_per_bounce {
        return;
    }
    let birth = births[(work.bounce - 1u) * lights.lights_per_bounce + id.x];
    if birth.x == PARENT_NONE {
        return;
    }
    let target_index = lights.sky_lights + (work.bounce - 1u) * lights.lights_per_bounce + id.x;
    vpls[target_index].normal.w = VPL_NONE;
    let light = vpls[birth.x];
    if light.normal.w == VPL_NONE {
        return;
    }
    let numbers = bitcast<vec2f>(birth.yz);
    let is_sky = light.normal.w == VPL_SKY;
    var map: vec2f;
    if is_sky {
        map = numbers;
    } else {
        // By the cosine: even over the disc below the half sphere (Malley's method).
        let turn = 6.2831853 * numbers.y;
        let across = sqrt(numbers.x);
        map = map_from_direction(vec3f(cos(turn) * across, sin(turn) * across, sqrt(max(1.0 - numbers.x, 0.0))));
    }
    let size = f32(lights.map_size);
    let texel = min(vec2u((map * 0.5 + 0.5) * size), vec2u(lights.map_size - 1u));
    let code = shadow_maps[birth.x * lights.map_stride + texel.y * lights.map_size + texel.x];
    if code == 0u {
        return;
    }
    let point = (code & 0xffffu) * lights.subsets + birth.x % lights.subsets;
    // The middle of the disc is a point of the surface: elsewhere discs reach over the edges of walls, and texels that
    // were filled from others have no distance of their own.
    let position = bitcast<vec3f>(chosen[point].xyz);
    let back = light.position.xyz - position;
    if !is_sky && all(back == vec3f(0.0)) {
        // Two points may be at one place.
        return;
    }
    let toward = select(normalize(back), light.normal.xyz, is_sky);
    let surface = surfaces[point * OCCLUDER_VECTORS];
    var normal = select(surface.xyz, -surface.xyz, dot(surface.xyz, toward) < 0.0);
    // Points without a normal face the light, as in the first bounce.
    normal = select(normal, toward, all(surface.xyz == vec3f(0.0)));
    let albedo = surfaces[point * OCCLUDER_VECTORS + 1u];
    // A light of intensity I cos sends out pi I, and its highlight's flux, which is assumed to leave it as evenly; one
    // of the sky sends its irradiance over an area of its map, which is given by its share.
    var flux = light.intensity.rgb;
    if !is_sky {
        flux = flux * 3.14159265 + light.glossy.rgb;
    }
    flux *= bitcast<f32>(birth.w);
    vpls[target_index] = vpl_of_surface(lights, position, normal, toward, albedo, flux, lights.area_over_pi);
}
