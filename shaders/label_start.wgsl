// Labelling, first of three passes: the pixels within the mirror are joined to trees in each tile of 8 x 8; pixels at a border
// between regions are left out (Preiner 2010, section 3.5.2, step 2). The paper traces contours on the CPU; here trees of pixels are joined
// (Playne, Hawick 2018), whose roots are the first pixels of their parts in scan order whatever the threads' order.
#import frame_group
#import region
#import tile_labels

@group(1) @binding(0) var<storage, read> curvature_map: array<u32>;
// A pixel's parent in its tree; OUTSIDE if it is in none.
@group(1) @binding(1) var<storage, read_write> parents: array<u32>;
// The number of pixels of the tree whose root this is.
@group(1) @binding(2) var<storage, read_write> sizes: array<u32>;

@compute @workgroup_size(8, 8)
fn label_start(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = id.y * frame.width + id.x;
    let is_in_picture = id.x < frame.width && id.y < frame.height;
    var is_inside = false;
    if is_in_picture {
        let flags = curvature_map[index];
        is_inside = (flags & MIRROR) != 0u && (flags & (DEPTH_STEP | (DEPTH_STEP << 1u))) == 0u;
        if id.x > 0u {
            is_inside = is_inside && !is_border_to(flags, curvature_map[index - 1u]);
        }
        if id.y > 0u {
            is_inside = is_inside && !is_border_to(flags, curvature_map[index - frame.width]);
        }
    }
    let root = label_in_tile(lane, is_inside);
    if is_in_picture {
        let first = vec2u(id.x - lane % 8u + root % 8u, id.y - lane / 8u + root / 8u);
        parents[index] = select(OUTSIDE, first.y * frame.width + first.x, is_inside);
        sizes[index] = 0u;
    }
}

fn is_border_to(flags: u32, before: u32) -> bool {
    return (before & MIRROR) != 0u && is_border(flags, before);
}
