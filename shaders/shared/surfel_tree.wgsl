// A chunk's points as a tree of oriented discs. Filled by crates/render/src/reflection/surfel_tree.rs.
#import finite
#import packing

struct Node {
    // xyz: f32 bits of the box's lower corner. w: the node that follows when a ray misses this one.
    low_skip: vec4u,
    // xyz: f32 bits of the upper corner. w: first disc << 8 | count of a leaf; INNER else.
    high_leaf: vec4u,
}
const INNER: u32 = 0xffffffffu;

// A chunk's tree among those of its page.
struct TreePlace {
    // xyz: origin of its positions relative to the eye. w: the width by which boxes grow because splats are drawn
    // larger.
    origin_margin: vec4f,
    first_node: u32,
    end_node: u32,
    // The index of its first disc in the page, which is that of its first point.
    first_surfel: u32,
    // The identity of its first point: the others follow.
    first_identity: u32,
}

// The place that is stored as an element of `tops`: places follow the nodes over the page's chunks, whose number the
// first node shows.
fn place_of(words: Node) -> TreePlace {
    let last = words.high_leaf;
    return TreePlace(bitcast<vec4f>(words.low_skip), last.x, last.y, last.z, last.w);
}

// A tile's list of runs of nodes: their number, then a place and a node for each. Longer lists cost more than the upper
// levels of the trees that they replace.
const LIST_RUNS: u32 = 48u;
const LIST_WORDS: u32 = 97u;
const LIST_IS_FULL: u32 = 0xffffffffu;

// A disc is not seen from closer than this many of its radii, nor an ellipse from closer than of its short half axes: the mirror's own splats lie beside the mirror point.
const SELF_DISTANCE: f32 = 4.0;

// Set if rays leave a surface whose own discs they must not meet, while they may meet those of other surfaces however
// close they are.
override leaves_surface: bool = false;
// Then a close disc is another surface's if its centre lies more than so many of its radii, or of its short half axes, above
// the plane that the ray leaves: the first one across the plane, the second one along it, as noise would have it.
const ACROSS_HEIGHT: f32 = 0.1;
const ALONG_HEIGHT: f32 = 1.0;
// The unit normal of that plane.
var<private> left_normal: vec3f;

// Set if a ray that meets nothing ends on the surface between whose discs it slips; see surfel_rays.wgsl.
override closes_gaps: bool = false;
// The farthest centre of a disc beside such a ray, in the disc's radii.
const GAP_REACH: f32 = 2.5;

struct DiscHit {
    // The distance along the ray, in units of its direction; 0 for a miss.
    distance: f32,
    // The squared distance from the disc's centre over the squared half axis there.
    outside: f32,
    radius: f32,
    // The disc's centre, relative to the place where the ray meets its plane.
    aside: vec3f,
    // The distance of that place if it lies beside the disc, within reach, and gaps are closed; else 0.
    beside: f32,
}

// `origin` and the box are relative to the same point; `direction` has unit length. `scale` is the factor of the radii.
fn disc_hit(packed: vec2u, low: vec3f, high: vec3f, scale: f32, origin: vec3f, direction: vec3f) -> DiscHit {
    let extent = high - low;
    let place = vec3f(f32(packed.x & 1023u), f32((packed.x >> 10u) & 1023u), f32((packed.x >> 20u) & 1023u));
    let offset = low + place * (extent / 1023.0) - origin;
    let radius = scale * length(extent) * exp2(f32(packed.y & 255u) / -32.0);
    // Ellipses have fewer bits of the normal, and their shape.
    let is_stretched = (packed.y & 0x80000000u) != 0u;
    let fine = vec2f(f32((packed.y >> 8u) & 2047u), f32((packed.y >> 19u) & 2047u)) * (2.0 / 2047.0) - 1.0;
    let coarse = vec2f(f32((packed.y >> 8u) & 1023u), f32((packed.y >> 18u) & 1023u)) * (2.0 / 1023.0) - 1.0;
    let folded = select(fine, coarse, is_stretched);
    let z = 1.0 - abs(folded.x) - abs(folded.y);
    let side = select(vec2f(-1.0), vec2f(1.0), folded >= vec2f(0.0));
    // Not of unit length: only its direction matters.
    let octahedral = vec3f(select((1.0 - abs(folded.yx)) * side, folded, z >= 0.0), z);
    let normal = select(direction, octahedral, is_stretched || (packed.y & 0x40000000u) != 0u);
    let distance = dot(normal, offset) / dot(normal, direction);
    let across = direction * distance - offset;
    var outside = dot(across, across) / (radius * radius);
    var narrow = radius;
    let reach = select(1.0, GAP_REACH * GAP_REACH, closes_gaps);
    if is_stretched && outside <= reach {
        let shape = SHAPE_BITS + 1u + ((packed.x >> 30u) | (((packed.y >> 28u) & 7u) << 2u));
        let stretch = unpack_stretch(shape, normalize(normal));
        outside = stretched_square(stretch, across) / (radius * radius);
        narrow = radius / stretch.ratio;
    }
    var is_apart = distance > SELF_DISTANCE * narrow;
    if leaves_surface {
        let facing = dot(left_normal, normal);
        let height = mix(ACROSS_HEIGHT, ALONG_HEIGHT, facing * facing / dot(normal, normal));
        is_apart = is_apart || distance > 0.0 && dot(left_normal, offset) > height * narrow;
    }
    // A disc seen edge-on is missed.
    let is_near = is_finite(outside) && outside <= reach && is_apart;
    let is_hit = is_near && outside <= 1.0;
    return DiscHit(select(0.0, distance, is_hit), outside, radius, -across, select(0.0, distance, is_near && !is_hit));
}

// The distance at which a ray that begins at `start` enters a box widened by `margin`; at or beyond `limit` for a miss.
fn box_entry(low: vec3f, high: vec3f, margin: f32, origin: vec3f, inverse: vec3f, start: f32, limit: f32) -> f32 {
    let a = (low - margin - origin) * inverse;
    let b = (high + margin - origin) * inverse;
    let near = min(a, b);
    let far = max(a, b);
    let entry = max(max(near.x, near.y), max(near.z, start));
    let exit = min(min(far.x, far.y), far.z);
    return select(limit, entry, entry <= exit && entry < limit);
}
