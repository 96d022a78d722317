// Numbering the regions, first of three passes: regions and their pixels in each run of 1024 pixels. One workgroup a run.
#import frame_group
#import region
#import scan

@group(1) @binding(0) var<storage, read> parents: array<u32>;
@group(1) @binding(1) var<storage, read> sizes: array<u32>;
// The numbers of regions and pixels of each run.
@group(1) @binding(2) var<storage, read_write> runs: array<vec2u>;

@compute @workgroup_size(256)
fn region_count(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    var sum = vec2u(0u);
    for (var i = 0u; i < 4u; i++) {
        let index = group.x * RUN_PIXELS + lane * 4u + i;
        if index < frame.width * frame.height && parents[index] == index && sizes[index] >= LEAST_REGION {
            sum += vec2u(1u, sizes[index]);
        }
    }
    let found = scan(lane, sum);
    if lane == 0u {
        runs[group.x] = found.total;
    }
}
