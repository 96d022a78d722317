// Where the light of lamps and sun first meets a surface: for each virtual light the first of its directions in which
// the shadow map holds a point. One thread a virtual light.
#import frame_group
#import vpl

@group(1) @binding(0) var<uniform> lights: Virtual;
// VPL_TRIES a virtual light: layer << 24 | texel of that shadow map; AIM_NONE if there is none.
@group(1) @binding(1) var<storage, read> aims: array<u32>;
@group(1) @binding(2) var<storage, read> shadows: array<vec2u>;
// The texel of each virtual light, as above.
@group(1) @binding(3) var<storage, read_write> hits: array<u32>;
// Two a layer: the number of lights whose first direction meets something, and of lights of which any direction does.
@group(1) @binding(4) var<storage, read_write> counts: array<atomic<u32>>;

const VPL_TRIES: u32 = 8u;
const AIM_NONE: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn vpl_aim(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= lights.lights_per_bounce {
        return;
    }
    var hit = AIM_NONE;
    for (var attempt = 0u; attempt < VPL_TRIES && hit == AIM_NONE; attempt++) {
        let aim = aims[id.x * VPL_TRIES + attempt];
        if aim == AIM_NONE {
            break;
        }
        let layer = aim >> 24u;
        let texel = vec2i(vec2u((aim & 0xffffffu) % LAMP_MAP_SIZE, (aim & 0xffffffu) / LAMP_MAP_SIZE));
        // A gap between splats is no hole in a surface: the texels around are tried as well, starting from the middle
        // one.
        for (var i = 0; i < 9 && hit == AIM_NONE; i++) {
            let place = (i + 4) % 9;
            let near = texel + vec2i(place % 3 - 1, place / 3 - 1);
            let is_inside = all(near >= vec2i(0)) && all(near < vec2i(i32(LAMP_MAP_SIZE)));
            let index = u32(near.y) * LAMP_MAP_SIZE + u32(near.x);
            if is_inside && shadows[layer * LAMP_MAP_SIZE * LAMP_MAP_SIZE + index].y != 0u {
                hit = layer << 24u | index;
            }
        }
        if hit != AIM_NONE {
            atomicAdd(&counts[layer * AIM_COUNTS], select(0u, 1u, attempt == 0u));
            atomicAdd(&counts[layer * AIM_COUNTS + 1u], 1u);
        }
    }
    hits[id.x] = hit;
}
