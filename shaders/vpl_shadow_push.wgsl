// Fills empty texels of a level of each virtual light's shadow map from the coarser level. One thread a texel and light.
#import frame_group
#import vpl

@group(1) @binding(0) var<uniform> lights: Virtual;
@group(1) @binding(1) var<storage, read_write> shadow_maps: array<u32>;
@group(1) @binding(2) var<uniform> work: Step;

@compute @workgroup_size(64)
fn vpl_shadow_push(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= work.fine_size * work.fine_size {
        return;
    }
    let map = (work.first_light + id.y) * lights.map_stride;
    let coarse = vec2u(id.x % work.fine_size, id.x / work.fine_size) / 2u;
    let fine = map + work.fine_first + id.x;
    if shadow_maps[fine] == 0u {
        shadow_maps[fine] = shadow_maps[map + work.coarse_first + coarse.y * ((work.fine_size + 1u) / 2u) + coarse.x];
    }
}
