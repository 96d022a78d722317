// The trees of pixels within a workgroup's tile of 8 x 8, joined in workgroup memory. Later passes then follow and change
// trees in the buffer only across the edges of tiles: with thousands of threads at once they else wait for each other.

const TILE_PIXELS: u32 = 64u;
const NO_TREE: u32 = 0xffffffffu;

// The parent of each pixel of the tile in its tree, by place in scan order; NO_TREE if it is in none.
var<workgroup> tile_parents: array<atomic<u32>, TILE_PIXELS>;

fn tile_root(lane: u32) -> u32 {
    var at = lane;
    var parent = atomicLoad(&tile_parents[at]);
    while parent != at {
        at = parent;
        parent = atomicLoad(&tile_parents[at]);
    }
    return at;
}

fn join_in_tile(lane: u32, neighbor: u32) {
    if atomicLoad(&tile_parents[neighbor]) == NO_TREE {
        return;
    }
    var a = tile_root(lane);
    var b = tile_root(neighbor);
    while a != b {
        let larger = max(a, b);
        let smaller = min(a, b);
        let before = atomicMin(&tile_parents[larger], smaller);
        if before == larger {
            return;
        }
        a = tile_root(before);
        b = tile_root(smaller);
    }
}

// The place of the first pixel of the tree of pixel `lane` within the tile; NO_TREE for a pixel in none. All threads of a
// workgroup of 8 x 8 call it.
fn label_in_tile(lane: u32, is_inside: bool) -> u32 {
    atomicStore(&tile_parents[lane], select(NO_TREE, lane, is_inside));
    workgroupBarrier();
    if is_inside {
        if lane % 8u > 0u {
            join_in_tile(lane, lane - 1u);
        }
        if lane >= 8u {
            join_in_tile(lane, lane - 8u);
        }
    }
    workgroupBarrier();
    var root = NO_TREE;
    if is_inside {
        root = tile_root(lane);
    }
    return root;
}
