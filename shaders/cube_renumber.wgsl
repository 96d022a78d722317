// Follows the points of cubemaps to the identities that they have since other points came or went. A texel whose point
// has gone becomes empty. One thread a texel.
#import frame_group
#import splat

// For each run of BLOCK_POINTS identities that points had, the run that they have now; GONE if they have gone.
@group(1) @binding(0) var<storage, read> runs: array<u32>;
@group(1) @binding(1) var<storage, read_write> records: array<vec4u>;

const GONE: u32 = 0xffffffffu;

@compute @workgroup_size(64)
fn cube_renumber(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let texel = id.y * groups.x * 64u + id.x;
    if texel >= arrayLength(&records) || records[texel].y == 0u {
        return;
    }
    let run = runs[records[texel].x / BLOCK_POINTS];
    if run == GONE {
        records[texel] = vec4u(0u);
    } else {
        records[texel].x = run * BLOCK_POINTS + records[texel].x % BLOCK_POINTS;
    }
}
