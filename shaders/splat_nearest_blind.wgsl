// Does what splat_nearest does without looking first. A 64-bit value cannot be read in Metal's language, and naga 30
// writes a read of 32 bits for DirectX.
#import nearest_point

// Low word: identity of the point. High word: nearness. 0: empty.
@group(2) @binding(0) var<storage, read_write> nearest: array<atomic<u64>>;

@compute @workgroup_size(128)
fn splat_nearest_blind(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn put(pixel: u32, depth: f32, identity: u32) {
    atomicMax(&nearest[pixel], (u64(nearness(depth)) << 32u) | u64(identity));
}
