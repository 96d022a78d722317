// Does with 32-bit atomics in two runs what splat_nearest does with 64 in one: finds the nearness of each pixel's nearest
// fragment, then the point to which that fragment belongs.
#import nearest_point
#import run

// Two words a pixel: identity of the point, nearness. 0: empty. The layout is that of the 64-bit pass.
@group(2) @binding(0) var<storage, read_write> nearest: array<atomic<u32>>;
@group(2) @binding(1) var<uniform> run: Run;

@compute @workgroup_size(128)
fn splat_narrow(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn put(pixel: u32, depth: f32, identity: u32) {
    let key = nearness(depth);
    let so_far = atomicLoad(&nearest[pixel * 2u + 1u]);
    if run.finds_identity != 0u {
        if key >= so_far {
            atomicMax(&nearest[pixel * 2u], identity);
        }
    } else if so_far < key {
        atomicMax(&nearest[pixel * 2u + 1u], key);
    }
}
