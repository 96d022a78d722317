// Labelling, first of three passes: every pixel within the mirror is a tree of its own; pixels at a border between regions
// are left out (Preiner 2010, section 3.5.2, step 2). The paper traces contours on the CPU; here trees of pixels are joined
// (Playne, Hawick 2018), whose roots are the first pixels of their parts in scan order whatever the threads' order.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read> curvature_map: array<u32>;
// A pixel's parent in its tree; OUTSIDE if it is in none.
@group(1) @binding(1) var<storage, read_write> parents: array<u32>;
// The number of pixels of the tree whose root this is.
@group(1) @binding(2) var<storage, read_write> sizes: array<u32>;

@compute @workgroup_size(8, 8)
fn label_start(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    let flags = curvature_map[index];
    var is_inside = (flags & MIRROR) != 0u && (flags & (DEPTH_STEP | (DEPTH_STEP << 1u))) == 0u;
    if id.x > 0u {
        is_inside = is_inside && !is_border_to(flags, curvature_map[index - 1u]);
    }
    if id.y > 0u {
        is_inside = is_inside && !is_border_to(flags, curvature_map[index - frame.width]);
    }
    parents[index] = select(OUTSIDE, index, is_inside);
    sizes[index] = 0u;
}

fn is_border_to(flags: u32, before: u32) -> bool {
    return (before & MIRROR) != 0u && is_border(flags, before);
}
