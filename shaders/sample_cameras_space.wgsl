// Sample-based cameras, cells of space: takes each point to its leaf of each mirror's tree, and finds the places of the
// mirror in which the pinhole or the rays of the leaf see it. One workgroup a block of points.
#import blocks
#import camera_root
#import camera_tree
#import finite

@group(2) @binding(0) var<uniform> trees: CameraTrees;
// The nodes, two elements each. Then the cells of lists: each the numbers of four rays, by row.
@group(2) @binding(1) var<storage, read> nodes: array<vec4u>;
@group(2) @binding(2) var<storage, read> leaves: array<CameraLeaf>;
@group(2) @binding(3) var<storage, read> rays: array<CameraRay>;
// w: specular intensity, 0 where there is no mirror.
@group(2) @binding(4) var point_in: texture_2d<f32>;
@group(2) @binding(5) var normal_in: texture_2d<f32>;
@group(2) @binding(6) var eye_in: texture_2d<f32>;
// Indexed by point of the page; the roots of a point are a page apart.
@group(2) @binding(7) var<storage, read_write> solutions: array<Solution>;
@group(2) @binding(8) var<storage, read_write> counters: array<atomic<u32>>;

// Trees are no deeper than this (`DEEPEST` in tree.rs, and the nodes over them).
const DEEPEST: u32 = 48u;
// The most parts of a list (`MOST_PARTS` in tree.rs).
const MOST_PARTS: u32 = 8u;
// How far a place may be outside of a pinhole's rays or of a cell, in halves and wholes of them: rounding must not part
// neighbours.
const PINHOLE_SLACK: f32 = 1e-3;
const CELL_SLACK: f32 = 1e-4;
// The most steps of Newton's method in a cell.
const STEPS: u32 = 6u;

var<workgroup> listed: atomic<u32>;

@compute @workgroup_size(128)
fn sample_cameras_space(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_block(group, groups, lane);
    count_roots(lane);
    if count_points && lane == 0u {
        atomicAdd(&counters[POINTS_LISTED], atomicLoad(&listed));
    }
}

fn splat_point(item: Item, index: u32) {
    let point = tried_point(item, index);
    let given = point.reflected;
    var found = 0u;
    var is_listed = false;
    if point.is_point {
        let place = given.place + trees.shift.xyz;
        for (var tree = 0u; tree < trees.trees; tree++) {
            var at = tree;
            for (var depth = 0u; depth < DEEPEST && (at & CAMERA_LEAF) == 0u; depth++) {
                let node = node_at(at);
                at = select(node.below, node.above, dot(node.plane.xyz, place) > node.plane.w);
            }
            let leaf = at & ~CAMERA_LEAF;
            let kind = leaves[leaf].kind;
            if kind == CAMERA_PINHOLE {
                found = with_root(given, index, found, root_of_pinhole(given, place, leaf));
            } else if kind == CAMERA_LIST {
                let before = found;
                var part = leaf;
                for (var number = 0u; number < MOST_PARTS && (number == 0u || part != 0u); number++) {
                    let end = leaves[part].first + leaves[part].count;
                    for (var cell = leaves[part].first; cell < end; cell++) {
                        let root = root_of_cell(given, place, part, nodes[2u * trees.nodes + cell]);
                        found = with_root(given, index, found, root);
                    }
                    part = leaves[part].next;
                }
                is_listed = is_listed || found > before;
            }
        }
    }
    if is_listed && count_points {
        atomicAdd(&listed, 1u);
    }
    end_roots(index, found, point.is_point);
}

fn node_at(index: u32) -> CameraNode {
    let last = nodes[2u * index + 1u];
    return CameraNode(bitcast<vec4f>(nodes[2u * index]), last.x, last.y, last.z, last.w);
}

// The frame of a leaf, relative to the eye of now.
fn frame_of(leaf: u32) -> CameraFrame {
    let axis = leaves[leaf].axis.xyz;
    return CameraFrame(leaves[leaf].middle.xyz - trees.shift.xyz, axis, across_axis(axis), 1.0, false);
}

fn root_of_pinhole(given: Reflected, place: vec3f, leaf: u32) -> Solution {
    let camera = leaves[leaf];
    let offset = place - camera.middle.xyz;
    let q = vec4f(offset, 1.0);
    let depth = dot(camera.depth, q);
    let uv = vec2f(dot(camera.by_u, q), dot(camera.by_v, q)) / depth;
    if depth <= 0.0 || any(abs(uv) > vec2f(1.0 + PINHOLE_SLACK)) {
        return Solution(0u, 0.0);
    }
    let one = camera.factors_0.xy;
    let u = camera.factors_0.zw;
    let v = camera.factors_1.xy;
    let uu = camera.factors_1.zw;
    let both = camera.factors_2.xy;
    let vv = camera.factors_2.zw;
    let at = one + uv.x * u + uv.y * v + uv.x * uv.x * uu + uv.x * uv.y * both + uv.y * uv.y * vv;
    // How the pixel changes with the place across the axis, and, the other way round, the place with the pixel.
    let leaf_frame = frame_of(leaf);
    let along_u = (u + 2.0 * uv.x * uu + uv.y * both) / depth;
    let along_v = (v + uv.x * both + 2.0 * uv.y * vv) / depth;
    let across = leaf_frame.across;
    let of_x = along_u * dot(camera.by_u.xyz, across.x) + along_v * dot(camera.by_v.xyz, across.x);
    let of_y = along_u * dot(camera.by_u.xyz, across.y) + along_v * dot(camera.by_v.xyz, across.y);
    let determinant = of_x.x * of_y.y - of_x.y * of_y.x;
    let safe = select(determinant, 1e-30, determinant == 0.0);
    let by_x = vec2f(of_y.y, -of_x.y) / safe;
    let by_y = vec2f(-of_y.x, of_x.x) / safe;
    let z = dot(offset, camera.axis.xyz);
    return kept_root(given, leaf_frame, z, at, by_x, by_y, drawn_for(given.identity, leaf), 3e38);
}

// Where a ray of a cell meets the plane through a point across the axis, beside the point; not a number if the ray goes
// along the plane.
fn beside_ray(ray: CameraRay, place: vec3f, axis: vec3f, across: Across) -> vec2f {
    let from_point = ray.point.xyz - place;
    let offset = from_point - ray.direction.xyz * (dot(from_point, axis) / dot(ray.direction.xyz, axis));
    return vec2f(dot(offset, across.x), dot(offset, across.y));
}

fn root_of_cell(given: Reflected, place: vec3f, leaf: u32, cell: vec4u) -> Solution {
    let axis = leaves[leaf].axis.xyz;
    let across = across_axis(axis);
    let y00 = beside_ray(rays[cell.x], place, axis, across);
    let y10 = beside_ray(rays[cell.y], place, axis, across);
    let y01 = beside_ray(rays[cell.z], place, axis, across);
    let y11 = beside_ray(rays[cell.w], place, axis, across);
    // A sum with one that is no number is none.
    let sum = abs(y00) + abs(y10) + abs(y01) + abs(y11);
    if !is_finite(sum.x + sum.y) {
        return Solution(0u, 0.0);
    }
    let low = min(min(y00, y10), min(y01, y11));
    let high = max(max(y00, y10), max(y01, y11));
    // The mix of the four lies in their box.
    let margin = CELL_SLACK * (high - low);
    if any(low - margin > vec2f(0.0)) || any(high + margin < vec2f(0.0)) {
        return Solution(0u, 0.0);
    }
    // The mix of the four rays that passes the point.
    let right = y10 - y00;
    let down = y01 - y00;
    let twist = y11 - y01 - right;
    var p = vec2f(0.5);
    var is_found = false;
    for (var step = 0u; step < STEPS && !is_found; step++) {
        let moved = solved(right + p.y * twist, down + p.x * twist, y00 + p.x * right + p.y * (down + p.x * twist));
        p = clamp(p - moved, vec2f(-2.0), vec2f(3.0));
        is_found = abs(moved.x) + abs(moved.y) < 1e-4;
    }
    if !is_found || any(abs(p - 0.5) > vec2f(0.5 + CELL_SLACK)) {
        return Solution(0u, 0.0);
    }
    let first = vec2f(rays[cell.x].point.w, rays[cell.x].direction.w);
    let at = first + p * f32(trees.stride);
    let by_x = (right + p.y * twist) / f32(trees.stride);
    let by_y = (down + p.x * twist) / f32(trees.stride);
    let z = dot(place - leaves[leaf].middle.xyz, axis);
    return kept_root(given, frame_of(leaf), z, at, by_x, by_y, drawn_for(given.identity, cell.x), 3e38);
}
