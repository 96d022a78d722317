// How a splatting pass walks the points of a page, block by block, one workgroup each. The one shared file with bindings: they
// are the same groups 0 and 1 for all of these passes. The importing pass defines `splat_point(item, index)`.
#import splat

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
@group(1) @binding(0) var<uniform> page: Page;
@group(1) @binding(1) var<storage, read> points: array<vec4u>;
@group(1) @binding(2) var<storage, read> attributes: array<vec2u>;
@group(1) @binding(3) var<storage, read> scalars: array<f32>;
@group(1) @binding(4) var<storage, read> items: array<Item>;
@group(1) @binding(5) var<storage, read> blocks: array<Block>;
@group(1) @binding(6) var<storage, read> class_masks: array<u32>;
@group(1) @binding(7) var<storage, read> palette: array<u32>;

// Set for blocks whose points all cover one pixel: then neither radius nor normal matters.
override pixels_only: bool = false;
// Set while a class is hidden.
override filter_classes: bool = false;

// The share of invocation `lane` of a workgroup of 128.
fn splat_block(group: vec3u, groups: vec3u, lane: u32) {
    let block_index = group.x + group.y * groups.x;
    if block_index >= page.block_count {
        return;
    }
    let block = blocks[block_index];
    let item = items[block.item];
    for (var i = lane; i < block.count; i += 128u) {
        splat_point(item, block.first + i);
    }
}

fn is_hidden(item: Item, point: vec4u) -> bool {
    if !filter_classes {
        return false;
    }
    let class_code = (point.w >> 16u) & 0xffu;
    return (class_masks[item.class_mask + (class_code >> 5u)] & (1u << (class_code & 31u))) == 0u;
}
