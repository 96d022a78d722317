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

// Discs of scattered points leave gaps in a surface. A ray slips through one if the nearest discs that it passes lie
// about it on all four sides; beside a straight outline they lie on three at most.
struct Gap {
    // The axes that part the sides.
    right: vec3f,
    up: vec3f,
    // The distance of the nearest disc beside the ray, and the identity of its point.
    distance: f32,
    identity: u32,
    // A bit for each side on which a disc at about that distance lies.
    sides: u32,
}
const ALL_SIDES: u32 = 15u;
// The key of a ray that ends in a gap: beyond those of all discs that it meets.
const GAP_KEY: f32 = 2e38;
var<private> gap: Gap;
// The share of their extent by which boxes are widened while a ray that met nothing looks for the discs beside it: a leaf
// is some five radii wide.
const GAP_MARGIN: f32 = 0.3;
var<private> widening: f32;
// Discs are taken to be about as far as another one within so many of their radii: those of two walls that meet.
const GAP_DEPTH: f32 = 4.0;

// Forgets the discs beside the ray before, and looks for those of another one.
fn begin_gap(direction: vec3f) {
    let axis = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(direction.x) > 0.7);
    let right = normalize(cross(direction, axis));
    gap = Gap(right, cross(direction, right), 3e38, NONE, 0u);
    widening = GAP_MARGIN;
}

// The margin of a box while such a ray looks for them.
fn widened(margin: f32, extent: vec3f) -> f32 {
    if closes_gaps {
        return margin + widening * max(extent.x, max(extent.y, extent.z));
    }
    return margin;
}

// Takes note of a disc beside the ray.
fn pass_beside(hit: DiscHit, identity: u32) {
    let depth = hit.beside - gap.distance;
    let most = GAP_DEPTH * hit.radius;
    if depth < -most {
        gap.sides = 0u;
    }
    if depth < most {
        let side = select(0u, 1u, dot(hit.aside, gap.right) > 0.0) + select(0u, 2u, dot(hit.aside, gap.up) > 0.0);
        gap.sides |= 1u << side;
    }
    if depth < 0.0 {
        gap.distance = hit.beside;
        gap.identity = identity;
    }
}

// What a ray ends on that met no disc: the surface through whose gap it would slip.
fn through_gap(ray: MirrorRay, start: f32, so_far: Nearest) -> Nearest {
    begin_gap(ray.direction);
    let nearest = through_trees(ray, start, so_far);
    let is_open = nearest.key >= GAP_KEY && (nearest.identity == NONE || gap.distance < nearest.distance);
    if !is_open || gap.sides != ALL_SIDES {
        return nearest;
    }
    return Nearest(GAP_KEY, gap.distance, gap.identity, nearest.nodes_tested, nearest.discs_tested);
}

// The nearest disc that a ray meets from the top of the trees.
fn through_trees(ray: MirrorRay, start: f32, so_far: Nearest) -> Nearest {
    var nearest = so_far;
    let top_count = tops[0].low_skip.w;
    var i = 0u;
    while i < top_count {
        let top = tops[i];
        let low = bitcast<vec3f>(top.low_skip.xyz);
        let high = bitcast<vec3f>(top.high_leaf.xyz);
        let entry = box_entry(low, high, widened(0.0, high - low), ray.origin, ray.inverse, start, nearest.key);
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
        let wide = widened(margin, high - low);
        let is_met = box_entry(low, high, wide, origin, ray.inverse, start, nearest.key) < nearest.key;
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
            if closes_gaps && widening > 0.0 && hit.beside > start && hit.beside < gap.distance + GAP_DEPTH * hit.radius {
                let at = order[first_surfel + k];
                if !hides_points || is_shown(at) {
                    pass_beside(hit, place.first_identity + at - place.first_surfel);
                }
            }
        }
    }
    return nearest;
}
