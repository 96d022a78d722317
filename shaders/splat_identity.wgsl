// Second of two passes that do with 32-bit atomics what splat_nearest does with 64: finds the point to which the
// nearest fragment of each pixel belongs.
#import nearest_point

// Two words a pixel: identity of the point, nearness. 0: empty. The layout is that of the 64-bit pass.
@group(2) @binding(0) var<storage, read_write> nearest: array<atomic<u32>>;

@compute @workgroup_size(128)
fn splat_identity(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

// Two compilations of the same arithmetic may differ in the last bits; without slack such a pixel would stay empty.
const SLACK: u32 = 4u;

fn put(pixel: u32, depth: f32, identity: u32) {
    if nearness(depth) + SLACK >= atomicLoad(&nearest[pixel * 2u + 1u]) {
        atomicMax(&nearest[pixel * 2u], identity);
    }
}
