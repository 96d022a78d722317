// Numbering the regions, third of three passes: roots get their region's label, in scan order, and the regions what is known
// of them. The running sum of their pixels is what points are drawn by. One workgroup a run of 1024 pixels.
#import frame_group
#import region
#import scan

@group(1) @binding(0) var<storage, read> parents: array<u32>;
// In: pixels of each root. Out: its label, 0 if it is too small.
@group(1) @binding(1) var<storage, read_write> sizes: array<u32>;
@group(1) @binding(2) var<storage, read> runs: array<vec2u>;
@group(1) @binding(3) var<storage, read_write> regions: array<Region>;

@compute @workgroup_size(256)
fn region_number(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    var own: array<u32, 4>;
    var sum = vec2u(0u);
    for (var i = 0u; i < 4u; i++) {
        let index = group.x * RUN_PIXELS + lane * 4u + i;
        own[i] = 0u;
        if index < frame.width * frame.height && parents[index] == index {
            own[i] = sizes[index];
        }
        if own[i] >= LEAST_REGION {
            sum += vec2u(1u, own[i]);
        }
    }
    let found = scan(lane, sum);
    var before = runs[group.x] + found.before;
    for (var i = 0u; i < 4u; i++) {
        if own[i] > 0u {
            let index = group.x * RUN_PIXELS + lane * 4u + i;
            if own[i] >= LEAST_REGION {
                let most = array<u32, 3>(0xffffffffu, 0xffffffffu, 0xffffffffu);
                let none = array<u32, 3>(0u, 0u, 0u);
                before += vec2u(1u, own[i]);
                regions[before.x] =
                    Region(frame.width, frame.height, 0u, 0u, own[i], before.y, 0u, 0u, most, none, most, none);
                sizes[index] = before.x;
            } else {
                sizes[index] = 0u;
            }
        }
    }
}
