// Walks the points of a page in a splatting pass, block by block, one workgroup each, or several blocks a workgroup where
// few points of each are drawn. The importing pass defines `splat_point(item, index)`.
#import page_group
#import visibility

// Set for blocks whose points all cover one pixel: then neither radius nor normal matters.
override pixels_only: bool = false;

// Set if surfaces whose back is turned to the eye are hidden.
override hides_backs: bool = false;

// A point's identity is this plus its index in the page. Identities follow the order of clouds, chunks and files, never that of
// places in the store (crates/render/src/identities.rs).
var<private> identities_from: u32;
// The block at hand, its item, and the number of its points.
var<private> block_at_hand: u32;
var<private> item_of_block: u32;
var<private> points_of_block: u32;

// Points without a normal have no back.
fn is_turned_away(item: Item, point: vec4u, index: u32) -> bool {
    let from_eye = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let sight = select(from_eye, frame.forward.xyz, frame.orthographic != 0u);
    return dot(unpack_normal(attributes[index].y), sight) > 0.0;
}

// The share of invocation `lane` of a workgroup of 128.
fn splat_block(group: vec3u, groups: vec3u, lane: u32) {
    // 1024 / 128 points a block keep one of 128 invocations busy each. Fewer would leave some idle, and a workgroup costs
    // as much as its points. Powers of two divide 128 (blocks_per_workgroup in crates/render/src/inputs.rs).
    let together = 1u << min(firstLeadingBit(max(page.step / 8u, 1u)), 7u);
    let lanes = 128u / together;
    let block_index = (group.x + group.y * groups.x) * together + lane / lanes;
    if block_index >= page.run_count {
        return;
    }
    let block = enter_block(block_index);
    let item = item_at(block.item);
    for (var i = (lane % lanes) * page.step; i < block.count; i += lanes * page.step) {
        splat_point(item, block.first + i);
    }
}

fn enter_block(index: u32) -> Block {
    let words = tables[page.runs_at + index];
    let block = Block(words.x, words.y, words.z, words.w);
    identities_from = block.first_identity - block.first;
    block_at_hand = index;
    item_of_block = block.item;
    points_of_block = block.count;
    return block;
}
