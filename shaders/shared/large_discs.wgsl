// Walks the points of a page in a pass that splats discs. Each invocation covers the pixels of its own discs. Where
// large discs are shared, all of a workgroup cover the pixels of each: near the eye a single disc has more pixels than
// all others of its block. The importing pass defines `splat_point(item, index)`, which hands a disc that `is_shared`
// to `put_off`, and `splat_large(item, index, lane)`, which splats one of them from pixel `lane` on, each LANES-th.
#import blocks

// Set where large discs are shared.
override shares: bool = false;

// Discs above this radius in pixels are large.
const LARGE: f32 = 8.0;
const LANES: u32 = 128u;

// The large discs of the workgroup: the index of the point in the page, and the block. A workgroup draws no more points
// than a block has, see splat_block.
var<workgroup> large_discs: array<vec2u, BLOCK_POINTS>;
var<workgroup> large_count: atomic<u32>;

fn splat_discs(group: vec3u, groups: vec3u, lane: u32) {
    splat_block(group, groups, lane);
    if pixels_only || !shares {
        return;
    }
    workgroupBarrier();
    let count = atomicLoad(&large_count);
    for (var i = 0u; i < count; i++) {
        let large = large_discs[i];
        let block = enter_block(large.y);
        splat_large(item_at(block.item), large.x, lane);
    }
}

fn is_shared(disc: Disc) -> bool {
    return shares && disc.radius_pixels > LARGE;
}

fn put_off(index: u32) {
    large_discs[atomicAdd(&large_count, 1u)] = vec2u(index, block_at_hand);
}

fn covers_nothing(disc: Disc) -> bool {
    return any(disc.first > disc.last);
}

// The pixel after `at` of those that a disc may cover, row by row. A loop over them tests at its end whether it is done:
// software Vulkan runs loops that do so at their beginning once more, and loops in loops for each of these turns.
fn next_pixel(disc: Disc, at: vec2i) -> vec2i {
    return select(at + vec2i(1, 0), vec2i(disc.first.x, at.y + 1), at.x >= disc.last.x);
}

// The number of pixels that a disc may cover.
fn pixels_of_disc(disc: Disc) -> u32 {
    // The box about an ellipse may be off the screen.
    let size = vec2u(max(disc.last - disc.first + 1, vec2i(0)));
    return size.x * size.y;
}

fn pixel_of_disc(disc: Disc, index: u32) -> vec2i {
    let width = u32(disc.last.x - disc.first.x) + 1u;
    return disc.first + vec2i(vec2u(index % width, index / width));
}
