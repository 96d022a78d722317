// First of two passes that do with 32-bit atomics what splat_nearest does with 64: the nearness of each pixel's nearest
// fragment.
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
// Two words a pixel: identity of the point, nearness. 0: empty. The layout is that of the 64-bit pass.
@group(2) @binding(0) var<storage, read_write> nearest: array<atomic<u32>>;

// Set for blocks whose points all cover one pixel: then neither radius nor normal matters.
override pixels_only: bool = false;
// Set while a class is hidden.
override filter_classes: bool = false;

@compute @workgroup_size(128)
fn splat_depth(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
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

fn splat_point(item: Item, index: u32) {
    let point = points[index];
    if filter_classes {
        let class_code = (point.w >> 16u) & 0xffu;
        if (class_masks[item.class_mask + (class_code >> 5u)] & (1u << (class_code & 31u))) == 0u {
            return;
        }
    }
    let identity = page.first_identity + index;
    if pixels_only {
        let single = single_of_point(frame, item, point);
        if single.is_drawn {
            put(single.pixel, single.center.z, identity);
        }
        return;
    }
    var disc = disc_of_point(frame, settings.splat, item, point);
    if disc.is_single {
        put(u32(disc.first.y) * frame.width + u32(disc.first.x), disc.center.z, identity);
        return;
    }
    if disc.radius_pixels == 0.0 {
        return;
    }
    disc.normal = normal_toward_eye(frame, disc.center, attributes[index].y);
    for (var y = disc.first.y; y <= disc.last.y; y++) {
        for (var x = disc.first.x; x <= disc.last.x; x++) {
            let fragment = fragment_of_disc(frame, disc, vec2i(x, y));
            if fragment.depth > 0.0 {
                put(u32(y) * frame.width + u32(x), fragment.depth, identity);
            }
        }
    }
}

fn put(pixel: u32, depth: f32, identity: u32) {
    let key = nearness(depth);
    if atomicLoad(&nearest[pixel * 2u + 1u]) < key {
        atomicMax(&nearest[pixel * 2u + 1u], key);
    }
}
