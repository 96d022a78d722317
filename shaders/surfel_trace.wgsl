// Follows the reflected eye ray of each mirror pixel through the points of a page, as oriented discs, to the nearest
// hit. Runs once for each page; later pages start from the hits of earlier ones. One thread a pixel.
#import frame_group
#import surfel_rays
#import counters
#import hit

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// A tree over the boxes of the page's chunks, then their places (see `place_of`).
@group(1) @binding(3) var<storage, read> tops: array<Node>;
@group(1) @binding(4) var<storage, read> nodes: array<Node>;
@group(1) @binding(5) var<storage, read> surfels: array<vec2u>;
// The index in the page of each disc's point.
@group(1) @binding(6) var<storage, read> order: array<u32>;
// The runs of the trees that the pixel's tile may see, `LIST_WORDS` words a tile (see beam_lists.wgsl). Or the rays
// that another method has left, if only they are traced; see cubemap_trace.wgsl.
@group(1) @binding(7) var<storage, read> lists: array<u32>;
// See hit.wgsl.
@group(1) @binding(8) var<storage, read_write> hits: array<vec4u>;
@group(1) @binding(9) var<storage, read> shown: array<u32>;
// z: number of nodes and discs against which the ray was tested.
@group(1) @binding(10) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(11) var<storage, read_write> counters: array<atomic<u32>>;

// Set if rays start from the tile's list instead of the top of the tree.
override use_lists: bool = false;
// Set if only the listed rays are traced, from where they are known to be free.
override use_rest: bool = false;
// Set if rays end before the distance in w of `eye_in`.
override has_ends: bool = false;

@compute @workgroup_size(8, 8)
fn surfel_trace(@builtin(global_invocation_id) invocation: vec3u) {
    let thread = whole_thread(frame, invocation);
    var id = mirror_pixel(frame, thread);
    var start = 0.0;
    if use_rest {
        let entry = list_entry(thread, frame.columns);
        if entry >= lists[0] {
            return;
        }
        let pixel = lists[1u + 2u * entry];
        id = vec2u(pixel % frame.width, pixel / frame.width);
        start = bitcast<f32>(lists[2u + 2u * entry]);
    }
    let tile = id / 8u;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    left_normal = textureLoad(normal_in, id, 0).xyz;
    // Rays that leave a surface go straight on from where they come.
    let normal = select(left_normal, vec3f(0.0), leaves_surface);
    let ray = mirror_ray(point.xyz, normal, textureLoad(eye_in, id, 0).xyz);
    let pixel = id.y * frame.width + id.x;
    let before = hits[pixel];
    var nearest = Nearest(3e38, 3e38, NONE, 0u, 0u);
    if has_ends {
        nearest.key = textureLoad(eye_in, id, 0).w;
    }
    if before.y != 0u {
        nearest = Nearest(bitcast<f32>(before.x), bitcast<f32>(before.z), before.y - 1u, 0u, 0u);
    }
    let list = (tile.y * ((frame.width + 7u) / 8u) + tile.x) * LIST_WORDS;
    var count = LIST_IS_FULL;
    if use_lists {
        count = lists[list];
    }
    if count != LIST_IS_FULL {
        for (var i = 0u; i < count; i++) {
            let place = place_of(tops[tops[0].low_skip.w + lists[list + 1u + i * 2u]]);
            let first = lists[list + 2u + i * 2u];
            let end = nodes[place.first_node + first].low_skip.w;
            nearest = through_tree(ray, start, place, first, end, nearest);
        }
    } else {
        nearest = through_trees(ray, start, nearest);
    }
    if closes_gaps && nearest.key >= GAP_KEY {
        nearest = through_gap(ray, start, nearest);
    }
    if count_tests {
        let tests = before.w + nearest.nodes_tested + nearest.discs_tested;
        hits[pixel].w = tests;
        textureStore(views_out, id, vec4f(0.0, 0.0, f32(tests), 0.0));
        atomicAdd(&counters[NODES_TESTED], nearest.nodes_tested);
        atomicAdd(&counters[DISCS_TESTED], nearest.discs_tested);
    }
    if nearest.identity != NONE {
        let words = vec3u(bitcast<u32>(nearest.key), nearest.identity + 1u, bitcast<u32>(nearest.distance));
        hits[pixel] = vec4u(words, hits[pixel].w);
    }
}
