// Labelling, third of three passes: every pixel's parent is its root, and the roots know their pixels. One thread a pixel.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read_write> parents: array<atomic<u32>>;
@group(1) @binding(1) var<storage, read_write> sizes: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn label_flatten(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    var at = index;
    var parent = atomicLoad(&parents[at]);
    if parent == OUTSIDE {
        return;
    }
    while parent != at {
        at = parent;
        parent = atomicLoad(&parents[at]);
    }
    // Other threads that still walk up only find a shorter way.
    atomicStore(&parents[index], at);
    atomicAdd(&sizes[at], 1u);
}
