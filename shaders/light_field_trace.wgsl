// The face of a map by rays: finds the nearest disc of a page on the line of sight through the middle of each texel. Runs
// once for each page; later pages start from what earlier ones found. The frame is that of the face. One thread a texel.
#import frame_group
#import surfel_rays

@group(1) @binding(0) var<storage, read> tops: array<Node>;
@group(1) @binding(1) var<storage, read> nodes: array<Node>;
@group(1) @binding(2) var<storage, read> surfels: array<vec2u>;
@group(1) @binding(3) var<storage, read> order: array<u32>;
@group(1) @binding(4) var<storage, read> shown: array<u32>;
// x: identity of the texel's nearest point. y: nearness, 0: empty.
@group(1) @binding(5) var<storage, read_write> nearest_points: array<vec2u>;

@compute @workgroup_size(8, 8)
fn light_field_trace(@builtin(global_invocation_id) invocation: vec3u) {
    let id = whole_thread(frame, invocation).xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let texel = id.y * frame.width + id.x;
    let sight = world_direction(frame, view_from_pixel(frame, vec2f(id) + 0.5, 1.0));
    let length_of_depth = length(sight);
    var direction = sight / length_of_depth;
    // Keeps inverses finite.
    direction = select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
    let before = nearest_points[texel];
    var nearest = Nearest(3e38, 3e38, NONE, 0u, 0u);
    if before.y != 0u {
        let distance = depth_from_nearness(before.y) * length_of_depth;
        nearest = Nearest(distance, distance, before.x, 0u, 0u);
    }
    nearest = through_trees(MirrorRay(vec3f(0.0), direction, 1.0 / direction), 0.0, nearest);
    if nearest.identity != NONE {
        nearest_points[texel] = vec2u(nearest.identity, nearness(nearest.distance / length_of_depth));
    }
}
