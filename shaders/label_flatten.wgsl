// Labelling, third of three passes: every pixel's parent is its root, and the roots know their pixels. One thread a pixel.
// A workgroup adds up those of its first root: most are within one tree, whose count all workgroups else add to by pixels.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read_write> parents: array<atomic<u32>>;
@group(1) @binding(1) var<storage, read_write> sizes: array<atomic<u32>>;

// OUTSIDE minus the workgroup's first root; workgroup memory begins at zero, which is none.
var<workgroup> last_root: atomic<u32>;
var<workgroup> first_pixels: atomic<u32>;

@compute @workgroup_size(8, 8)
fn label_flatten(@builtin(global_invocation_id) id: vec3u, @builtin(local_invocation_index) lane: u32) {
    let index = id.y * frame.width + id.x;
    let is_in_picture = id.x < frame.width && id.y < frame.height;
    var at = OUTSIDE;
    if is_in_picture && atomicLoad(&parents[index]) != OUTSIDE {
        at = index;
        var parent = atomicLoad(&parents[at]);
        while parent != at {
            at = parent;
            parent = atomicLoad(&parents[at]);
        }
        // Other threads that still walk up only find a shorter way.
        atomicStore(&parents[index], at);
        atomicMax(&last_root, OUTSIDE - at);
    }
    workgroupBarrier();
    let root = OUTSIDE - atomicLoad(&last_root);
    if at != OUTSIDE {
        if at == root {
            atomicAdd(&first_pixels, 1u);
        } else {
            atomicAdd(&sizes[at], 1u);
        }
    }
    workgroupBarrier();
    if lane == 0u && root != OUTSIDE {
        atomicAdd(&sizes[root], atomicLoad(&first_pixels));
    }
}
