// Sample-based cameras, cells of space: says of each mirror pixel whether the trees' leaves stand for the rays about
// it, or nothing yet; those are counted, and listed if they are to be traced. One thread a pixel.
#import frame_group
#import camera_tree
#import counters
#import hit

@group(1) @binding(0) var<uniform> trees: CameraTrees;
// A bit for each ray: whether leaves stand for the cell between it and those to the right and below.
@group(1) @binding(1) var<storage, read> standing: array<u32>;
// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(2) var point_in: texture_2d<f32>;
// See hit.wgsl. Pixels that leaves stand for are marked as those whose surface is already there.
@group(1) @binding(3) var<storage, read_write> hits: array<vec4u>;
// See bundle_fit.wgsl.
@group(1) @binding(4) var<storage, read_write> rest: array<atomic<u32>>;
@group(1) @binding(5) var<storage, read_write> counters: array<atomic<u32>>;

override count_rays: bool = true;
// Whether the rays that are left are traced.
override traces_rest: bool = false;

@compute @workgroup_size(8, 8)
fn sample_cameras_mark(@builtin(global_invocation_id) thread: vec3u) {
    let pixel = mirror_pixel(frame, thread);
    if pixel.x >= frame.width || pixel.y >= frame.height || textureLoad(point_in, pixel, 0).w == 0.0 {
        return;
    }
    let beyond = vec2i(pixel) - vec2i(i32(trees.first_x), i32(trees.first_y));
    // A pixel with a ray of its own lies in several cells: all of them must stand, or a part of it is missing.
    let stride = i32(trees.stride);
    var is_standing = all(beyond >= vec2i(0));
    if is_standing {
        let last = beyond / stride;
        let first = last - select(vec2i(0), vec2i(1), beyond % stride == vec2i(0));
        for (var y = first.y; y <= last.y; y++) {
            for (var x = first.x; x <= last.x; x++) {
                let is_cell = x >= 0 && y >= 0 && x < i32(trees.columns) && y < i32(trees.rows);
                let cell = select(0u, u32(y) * trees.columns + u32(x), is_cell);
                is_standing = is_standing && is_cell && ((standing[cell / 32u] >> (cell % 32u)) & 1u) != 0u;
            }
        }
    }
    let index = pixel.y * frame.width + pixel.x;
    hits[index] = select(vec4u(0u), vec4u(HIT_IN_PICTURE, 1u, 0u, 0u), is_standing);
    if !is_standing {
        if count_rays {
            atomicAdd(&counters[RAYS_LEFT], 1u);
        }
        if traces_rest {
            let entry = atomicAdd(&rest[0], 1u);
            atomicStore(&rest[1u + 2u * entry], index);
            atomicStore(&rest[2u + 2u * entry], 0u);
        }
    }
}
