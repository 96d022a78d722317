// Finds the nearest point of each pixel by one 64-bit atomic maximum of (nearness, identity) per fragment (Schuetz,
// Kerbl, Wimmer 2021). One workgroup per block of points.
#import nearest_point

// Low word: identity of the point. High word: nearness. 0: empty.
@group(2) @binding(0) var<storage, read_write> nearest: array<atomic<u64>>;

@compute @workgroup_size(128)
fn splat_nearest(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn put(pixel: u32, depth: f32, identity: u32) {
    let key = (u64(nearness(depth)) << 32u) | u64(identity);
    // Reading first saves the atomic if something nearer is already there.
    if atomicLoad(&nearest[pixel]) < key {
        atomicMax(&nearest[pixel], key);
    }
}
