// Follows a ray through the trees of a page to the nearest disc. The importing pass binds `tops`, `nodes`, `surfels`,
// `order` and `shown`, as surfel_trace.wgsl does.
#import splat
#import surfel_tree
#import mirror_ray
#import visibility

// Set while the tests are shown.
override count_tests: bool = false;

fn shown_word(word: u32) -> u32 {
    return shown[word];
}

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

// The nearest disc that a ray meets from the top of the trees.
fn through_trees(ray: MirrorRay, start: f32, so_far: Nearest) -> Nearest {
    var nearest = so_far;
    let top_count = tops[0].low_skip.w;
    var i = 0u;
    while i < top_count {
        let top = tops[i];
        let low = bitcast<vec3f>(top.low_skip.xyz);
        let high = bitcast<vec3f>(top.high_leaf.xyz);
        let entry = box_entry(low, high, 0.0, ray.origin, ray.inverse, start, nearest.key);
        i = select(top.low_skip.w, i + 1u, entry < nearest.key);
        if entry < nearest.key && top.high_leaf.w != INNER {
            let place = place_of(tops[top_count + top.high_leaf.w]);
            nearest = through_tree(ray, start, place, 0u, place.end_node, nearest);
        }
    }
    return nearest;
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
