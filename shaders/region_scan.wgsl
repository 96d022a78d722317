// Numbering the regions, second of three passes: the sums before each run of pixels, and the totals. One workgroup.
#import frame_group
#import region
#import scan
#import counters

@group(1) @binding(0) var<storage, read_write> runs: array<vec2u>;
@group(1) @binding(1) var<storage, read_write> regions: array<Region>;
@group(1) @binding(2) var<storage, read_write> counters: array<u32>;

// Set for the first bounce, whose regions the statistics report.
override count_regions: bool = true;

@compute @workgroup_size(256)
fn region_scan(@builtin(local_invocation_index) lane: u32) {
    let count = (frame.width * frame.height + RUN_PIXELS - 1u) / RUN_PIXELS;
    var before = vec2u(0u);
    for (var first = 0u; first < count; first += 256u) {
        let run = first + lane;
        var sum = vec2u(0u);
        if run < count {
            sum = runs[run];
        }
        let found = scan(lane, sum);
        if run < count {
            runs[run] = before + found.before;
        }
        before += found.total;
    }
    if lane == 0u {
        regions[0].regions = before.x;
        regions[0].pixels = before.y;
        if count_regions {
            regions[0].first_pixels = before.y;
            counters[REGIONS] = before.x;
        }
    }
}
