// One level of the pyramid of each virtual light's shadow map: the farthest of four texels, where at least three of them hold
// something. One thread a texel of the coarser level and light.
#import frame_group
#import vpl

@group(1) @binding(0) var<uniform> lights: Virtual;
@group(1) @binding(1) var<storage, read_write> shadow_maps: array<u32>;
@group(1) @binding(2) var<uniform> work: Step;

@compute @workgroup_size(64)
fn vpl_shadow_pull(@builtin(global_invocation_id) id: vec3u) {
    let size = (work.fine_size + 1u) / 2u;
    if id.x >= size * size {
        return;
    }
    let map = (work.first_light + id.y) * lights.map_stride;
    let texel = vec2u(id.x % size, id.x / size);
    var farthest = 0xffffffffu;
    var count = 0u;
    for (var i = 0u; i < 4u; i++) {
        let fine = texel * 2u + vec2u(i & 1u, i >> 1u);
        if all(fine < vec2u(work.fine_size)) {
            let code = shadow_maps[map + work.fine_first + fine.y * work.fine_size + fine.x];
            // A smaller code is farther.
            farthest = select(farthest, min(farthest, code), code != 0u);
            count += select(0u, 1u, code != 0u);
        }
    }
    shadow_maps[map + work.coarse_first + id.x] = select(0u, farthest, count >= 3u);
}
