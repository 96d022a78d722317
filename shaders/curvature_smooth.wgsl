// Gives a planar pixel of the curvature map the bend of its predecessor, up to the next depth step or gap (Preiner
// 2010, section 3.5.2, step 1). Runs along the rows, then along the columns: each run only changes its own direction's
// bits. One thread a line.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read_write> curvature_map: array<u32>;

override along_columns: bool = false;

@compute @workgroup_size(64)
fn curvature_smooth(@builtin(global_invocation_id) id: vec3u) {
    let lines = select(frame.height, frame.width, along_columns);
    if id.x >= lines {
        return;
    }
    let length = select(frame.width, frame.height, along_columns);
    let stride = select(1u, frame.width, along_columns);
    let shift = select(0u, DIRECTION_BITS, along_columns);
    let step = DEPTH_STEP << select(0u, 1u, along_columns);
    var index = select(id.x * frame.width, id.x, along_columns);
    var bend = 0u;
    for (var place = 0u; place < length; place++) {
        let flags = curvature_map[index];
        let own = (flags >> shift) & BENT;
        bend = select(own, select(bend, 0u, (flags & step) != 0u), own == 0u);
        bend = select(0u, bend, (flags & MIRROR) != 0u);
        if bend != own {
            curvature_map[index] = flags | (bend << shift);
        }
        index += stride;
    }
}
