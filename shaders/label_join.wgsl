// Labelling, second of three passes: the trees of a pixel and of its left and upper neighbours in other tiles become one.
// A root only ever gets a smaller parent, so the order of the threads cannot matter. One thread a pixel.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read_write> parents: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn label_join(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let index = id.y * frame.width + id.x;
    if atomicLoad(&parents[index]) == OUTSIDE {
        return;
    }
    if id.x > 0u && id.x % 8u == 0u {
        join(index, index - 1u);
    }
    if id.y > 0u && id.y % 8u == 0u {
        join(index, index - frame.width);
    }
}

fn join(pixel: u32, neighbor: u32) {
    if atomicLoad(&parents[neighbor]) == OUTSIDE {
        return;
    }
    var a = root_of(pixel);
    var b = root_of(neighbor);
    while a != b {
        let larger = max(a, b);
        let smaller = min(a, b);
        let before = atomicMin(&parents[larger], smaller);
        if before == larger {
            return;
        }
        // Another thread gave it a parent first: that one's tree is joined as well.
        a = root_of(before);
        b = root_of(smaller);
    }
}

fn root_of(pixel: u32) -> u32 {
    var at = pixel;
    var parent = atomicLoad(&parents[at]);
    while parent != at {
        at = parent;
        parent = atomicLoad(&parents[at]);
    }
    return at;
}
