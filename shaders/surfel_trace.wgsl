// Follows the reflected eye ray of each mirror pixel through the points of a page, as oriented discs, to the nearest
// hit. Runs once for each page; later pages start from the hits of earlier ones. One thread a pixel.
#import frame_group
#import splat
#import surfel_tree
#import mirror_ray
#import counters
#import visibility
#import hit

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// A tree over the boxes of the page's chunks.
@group(1) @binding(3) var<storage, read> tops: array<Node>;
@group(1) @binding(4) var<storage, read> places: array<TreePlace>;
@group(1) @binding(5) var<storage, read> nodes: array<Node>;
@group(1) @binding(6) var<storage, read> surfels: array<vec2u>;
// The index in the page of each disc's point.
@group(1) @binding(7) var<storage, read> order: array<u32>;
// The runs of the trees that the pixel's tile may see, `LIST_WORDS` words a tile (see beam_lists.wgsl).
@group(1) @binding(8) var<storage, read> lists: array<u32>;
// See hit.wgsl.
@group(1) @binding(9) var<storage, read_write> hits: array<vec4u>;
@group(1) @binding(10) var<storage, read> shown: array<u32>;
// z: number of nodes and discs against which the ray was tested.
@group(1) @binding(11) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(12) var<storage, read_write> counters: array<atomic<u32>>;
// The rays that another method has left, if only they are traced; see cubemap_trace.wgsl.
@group(1) @binding(13) var<storage, read> rest: array<u32>;

// Set while the tests are shown.
override count_tests: bool = false;
// Set if rays start from the tile's list instead of the top of the tree.
override use_lists: bool = false;
// Set if only the listed rays are traced, from where they are known to be free.
override use_rest: bool = false;
// Set if rays end before the distance in w of `eye_in`.
override has_ends: bool = false;

struct Nearest {
    key: f32,
    distance: f32,
    // The identity of its point; NONE if nothing was found.
    identity: u32,
    // So far.
    nodes_tested: u32,
    discs_tested: u32,
}
const NONE: u32 = 0xffffffffu;

@compute @workgroup_size(8, 8)
fn surfel_trace(@builtin(global_invocation_id) invocation: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let thread = whole_thread(frame, invocation);
    var id = mirror_pixel(frame, thread);
    var start = 0.0;
    if use_rest {
        let entry = list_entry(thread, groups);
        if entry >= rest[0] {
            return;
        }
        let pixel = rest[1u + 2u * entry];
        id = vec2u(pixel % frame.width, pixel / frame.width);
        start = bitcast<f32>(rest[2u + 2u * entry]);
    }
    let tile = id / 8u;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let ray = mirror_ray(point.xyz, textureLoad(normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
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
            let place = places[lists[list + 1u + i * 2u]];
            let first = lists[list + 2u + i * 2u];
            let end = nodes[place.first_node + first].low_skip.w;
            nearest = through_tree(ray, start, place, first, end, nearest);
        }
    } else {
        let top_count = tops[0].low_skip.w;
        var i = 0u;
        while i < top_count {
            let top = tops[i];
            let low = bitcast<vec3f>(top.low_skip.xyz);
            let high = bitcast<vec3f>(top.high_leaf.xyz);
            let entry = box_entry(low, high, 0.0, ray.origin, ray.inverse, start, nearest.key);
            i = select(top.low_skip.w, i + 1u, entry < nearest.key);
            if entry < nearest.key && top.high_leaf.w != INNER {
                let place = places[top.high_leaf.w];
                nearest = through_tree(ray, start, place, 0u, place.end_node, nearest);
            }
        }
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

// Where discs overlap, the one whose centre is nearer to the ray is taken to be a little nearer: else rounding would
// decide.
const CENTER_SHARE: f32 = 0.05;

fn through_tree(
    ray: MirrorRay,
    start: f32,
    place: TreePlace,
    first: u32,
    end: u32,
    so_far: Nearest,
) -> Nearest {
    var nearest = so_far;
    let origin = ray.origin - place.origin_margin.xyz;
    let margin = place.origin_margin.w;
    let scale = settings.splat.size;
    var i = first;
    while i < end {
        let node = nodes[place.first_node + i];
        let low = bitcast<vec3f>(node.low_skip.xyz);
        let high = bitcast<vec3f>(node.high_leaf.xyz);
        let is_met = box_entry(low, high, margin, origin, ray.inverse, start, nearest.key) < nearest.key;
        i = select(node.low_skip.w, i + 1u, is_met);
        let count = select(0u, node.high_leaf.w & 255u, is_met && node.high_leaf.w != INNER);
        let first_surfel = place.first_surfel + (node.high_leaf.w >> 8u);
        if count_tests {
            nearest.nodes_tested += 1u;
            nearest.discs_tested += count;
        }
        for (var k = 0u; k < count; k++) {
            let hit = disc_hit(surfels[first_surfel + k], low, high, scale, origin, ray.direction);
            let key = hit.distance + hit.outside * hit.radius * CENTER_SHARE;
            var is_nearer = hit.distance > start && key <= nearest.key;
            var identity = 0u;
            if is_nearer {
                // Among discs at equal distances the first in order wins, not the first that is met.
                identity = place.first_identity + order[first_surfel + k] - place.first_surfel;
                is_nearer = key < nearest.key || identity < nearest.identity;
            }
            // The bit is fetched only where it matters: points are scattered over memory.
            if hides_points && is_nearer {
                is_nearer = is_shown(order[first_surfel + k]);
            }
            if is_nearer {
                nearest = Nearest(key, hit.distance, identity, nearest.nodes_tested, nearest.discs_tested);
            }
        }
    }
    return nearest;
}
