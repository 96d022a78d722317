// Sample-based cameras: finds all places of the mirror in which each point is reflected, by the bundles of its squares.
// One workgroup a block of points: the squares whose rays may meet the block's box are listed first.
#import blocks
#import beam
#import camera_root
#import ordered
#import analytic

@group(2) @binding(0) var<uniform> grid: BundleGrid;
@group(2) @binding(1) var<storage, read> nodes: array<BundleNode>;
@group(2) @binding(2) var<storage, read> bundles: array<Bundle>;
// w: specular intensity, 0 where there is no mirror.
@group(2) @binding(3) var point_in: texture_2d<f32>;
@group(2) @binding(4) var normal_in: texture_2d<f32>;
@group(2) @binding(5) var eye_in: texture_2d<f32>;
// Indexed by point of the page; the roots of a point are a page apart.
@group(2) @binding(6) var<storage, read_write> solutions: array<Solution>;
@group(2) @binding(7) var<storage, read_write> counters: array<atomic<u32>>;
// See analytic.wgsl: squares hold none of their rays.
@group(2) @binding(8) var<storage, read> analytic: array<FormulaMirror>;

override degree: u32 = 2u;
// Whether whole blocks descend before their points.
override by_blocks: bool = true;

// What the walk over the points is for.
const BOUND: u32 = 0u;
const SOLVE: u32 = 1u;
var<private> walk: u32;

// Room for the squares of a block. Where it is not enough, each point descends alone.
const QUEUE: u32 = 256u;
var<workgroup> low: array<atomic<u32>, 3>;
var<workgroup> high: array<atomic<u32>, 3>;
var<workgroup> queue: array<array<u32, 256>, 2>;
var<workgroup> queued: array<atomic<u32>, 2>;
// The leaves: level << 28 | index in the level; as found, and in the order of the picture's squares.
var<workgroup> found_leaves: array<u32, 256>;
var<workgroup> leaves: array<u32, 256>;
// For each leaf, the chance that no point of the block is kept with a larger one.
var<workgroup> chances: array<f32, 256>;
// f32 bits of the largest area that a point of the block stands for.
var<workgroup> largest_area: atomic<u32>;
var<workgroup> leaf_count: atomic<u32>;
var<workgroup> is_full: atomic<u32>;
var<workgroup> meets_square: atomic<u32>;
var<workgroup> has_squares: u32;

@compute @workgroup_size(128)
fn sample_cameras_project(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    if lane < 3u {
        atomicStore(&low[lane], 0xffffffffu);
    }
    let roots = grid.columns * grid.rows;
    for (var root = lane; root < roots && atomicLoad(&meets_square) == 0u; root += 128u) {
        if nodes[root].origin_low.w != NODE_EMPTY {
            atomicStore(&meets_square, 1u);
        }
    }
    workgroupBarrier();
    if lane == 0u {
        has_squares = atomicLoad(&meets_square);
    }
    // Where formulas stand for all rays, there is no square to look for.
    if workgroupUniformLoad(&has_squares) != 0u && by_blocks {
        walk = BOUND;
        splat_block(group, groups, lane);
        workgroupBarrier();
        list_leaves(lane);
    }
    walk = SOLVE;
    splat_block(group, groups, lane);
    count_roots(lane);
}

// Lists the leaves that may reflect a point of the block, level by level.
fn list_leaves(lane: u32) {
    let box_low = vec3f(
        from_ordered(atomicLoad(&low[0])), from_ordered(atomicLoad(&low[1])), from_ordered(atomicLoad(&low[2]))
    );
    let box_high = vec3f(
        from_ordered(atomicLoad(&high[0])), from_ordered(atomicLoad(&high[1])), from_ordered(atomicLoad(&high[2]))
    );
    // A block without points has no box.
    let is_empty = atomicLoad(&high[0]) == 0u;
    for (var level = 0u; level <= grid.last_level; level++) {
        let this_level = level & 1u;
        let parents = min(atomicLoad(&queued[this_level]), QUEUE);
        let count = select(select(4u * parents, grid.columns * grid.rows, level == 0u), 0u, is_empty);
        for (var i = lane; i < count; i += 128u) {
            var index = i;
            if level > 0u {
                index = 4u * queue[this_level][i / 4u] + i % 4u;
            }
            let node = nodes[first_of_level(grid, level) + index];
            if node.origin_low.w != NODE_EMPTY && beam_entry(beam_of(node), box_low, box_high) >= 0.0 {
                if node.origin_low.w == NODE_LEAF {
                    let slot = atomicAdd(&leaf_count, 1u);
                    if slot < QUEUE {
                        found_leaves[slot] = level << 28u | index;
                    }
                } else {
                    let slot = atomicAdd(&queued[1u - this_level], 1u);
                    if slot < QUEUE {
                        queue[1u - this_level][slot] = index;
                    }
                }
            }
        }
        workgroupBarrier();
        if lane == 0u {
            atomicStore(&queued[this_level], 0u);
            if atomicLoad(&queued[1u - this_level]) > QUEUE || atomicLoad(&leaf_count) > QUEUE {
                atomicStore(&is_full, 1u);
            }
        }
        workgroupBarrier();
    }
    // The threads find leaves in any order: the roots of a point must not depend on it.
    let count = min(atomicLoad(&leaf_count), QUEUE);
    for (var i = lane; i < count; i += 128u) {
        let key = order_of(found_leaves[i]);
        var rank = 0u;
        for (var other = 0u; other < count; other++) {
            rank += select(0u, 1u, order_of(found_leaves[other]) < key);
        }
        leaves[rank] = found_leaves[i];
        chances[rank] = most_chance(found_leaves[i], box_low, box_high);
    }
    workgroupBarrier();
}

// The largest chance with which a leaf keeps a point of a box: by the least area of rays where they may meet the box.
fn most_chance(leaf: u32, box_low: vec3f, box_high: vec3f) -> f32 {
    let per_pixel = settings.sample_cameras.points_per_pixel;
    let node = first_of_level(grid, leaf >> 28u) + (leaf & 0xfffffffu);
    let axis = bundles[node].axis;
    let b = bundles[node].coefficients[1];
    let c = bundles[node].coefficients[2];
    let z = dot((box_low + box_high) * 0.5 - bundles[node].middle.xyz, axis.xyz);
    let reach = dot((box_high - box_low) * 0.5, abs(axis.xyz));
    let first = z - reach;
    let last = z + reach;
    // The area is that of a quadratic in z.
    let constant = b.x * c.y - b.y * c.x;
    let linear = b.x * c.w + b.z * c.y - b.y * c.z - b.w * c.x;
    let square = b.z * c.w - b.w * c.z;
    let at_first = constant + first * (linear + first * square);
    let at_last = constant + last * (linear + last * square);
    var least = min(abs(at_first), abs(at_last));
    if at_first * at_last <= 0.0 {
        least = 0.0;
    }
    let turn = -0.5 * linear / square;
    if turn > first && turn < last {
        let at_turn = constant + turn * (linear + turn * square);
        least = select(min(least, abs(at_turn)), 0.0, at_turn * at_first <= 0.0);
    }
    let margin = 1e-4 * (abs(z) + reach);
    if last + margin < bundles[node].middle.w || first - margin > farthest_z(axis.w) {
        return 0.0;
    }
    let half = bundles[node].square.z;
    let area = bitcast<f32>(atomicLoad(&largest_area));
    // Rounding must not leave out a point.
    let most = 1.01 * PEAK * per_pixel * area * half * half / max(least, 1e-30);
    return select(most, 3e38, per_pixel == 0.0);
}

// The place of a leaf among all, as a descent meets them: the first of the finest squares in it.
fn order_of(leaf: u32) -> u32 {
    return (leaf & 0xfffffffu) << (2u * (grid.last_level - (leaf >> 28u)));
}

fn beam_of(node: BundleNode) -> Beam {
    return Beam(node.origin_low.xyz, node.origin_high.xyz, node.direction_low.xyz, node.direction_high.xyz);
}

fn splat_point(item: Item, index: u32) {
    let point = tried_point(item, index);
    let given = point.reflected;
    if walk == BOUND {
        if point.is_point {
            if atomicLoad(&largest_area) < bitcast<u32>(given.area) {
                atomicMax(&largest_area, bitcast<u32>(given.area));
            }
            for (var axis = 0u; axis < 3u; axis++) {
                lower(axis, ordered(given.place[axis]));
                raise(axis, ordered(given.place[axis]));
            }
        }
        return;
    }
    var found = 0u;
    if point.is_point {
        for (var number = 0u; number < arrayLength(&analytic); number++) {
            found = with_root(given, index, found, root_by_formula(given, number));
        }
        if by_blocks && atomicLoad(&is_full) == 0u {
            let count = min(atomicLoad(&leaf_count), QUEUE);
            var i = next_leaf(given.identity, 0u, count);
            while i < count {
                let level = leaves[i] >> 28u;
                let node = first_of_level(grid, level) + (leaves[i] & 0xfffffffu);
                if beam_entry(beam_of(nodes[node]), given.place, given.place) >= 0.0 {
                    found = with_root(given, index, found, root_in(given, node, leaves[i]));
                }
                i = next_leaf(given.identity, i + 1u, count);
            }
        } else if has_squares != 0u {
            found = descend(given, index, found);
        }
    }
    end_roots(index, found, point.is_point);
}

// The next leaf of the list that may keep the point. Most keep few: threads that run in step then wait for each other
// by leaves that do, not by all.
fn next_leaf(identity: u32, first: u32, count: u32) -> u32 {
    var i = first;
    while i < count && drawn_for(identity, leaves[i]) >= chances[i] {
        i++;
    }
    return i;
}

// Reading first saves nearly all atomics: bounds settle after a few points.
fn lower(axis: u32, value: u32) {
    if atomicLoad(&low[axis]) > value {
        atomicMin(&low[axis], value);
    }
}

fn raise(axis: u32, value: u32) {
    if atomicLoad(&high[axis]) < value {
        atomicMax(&high[axis], value);
    }
}

// Tries a point in all leaves, from the roots on.
fn descend(given: Reflected, index: u32, found_before: u32) -> u32 {
    var found = found_before;
    var level = 0u;
    var square = 0u;
    while level > 0u || square < grid.columns * grid.rows {
        let node = first_of_level(grid, level) + square;
        let bounds = nodes[node];
        let is_met =
            bounds.origin_low.w != NODE_EMPTY && beam_entry(beam_of(bounds), given.place, given.place) >= 0.0;
        if is_met && bounds.origin_low.w == NODE_DIVIDED {
            level++;
            square *= 4u;
        } else {
            if is_met {
                found = with_root(given, index, found, root_in(given, node, level << 28u | square));
            }
            square++;
            while level > 0u && square % 4u == 0u {
                square /= 4u;
                level--;
            }
        }
    }
    return found;
}

// Squares reach this much over their border, in pixels: neighbouring bundles differ by up to the accuracy, and a root
// must not fall between them.
const BORDER: f32 = 0.25;
// The most steps of Newton's method; two are usual.
const STEPS: u32 = 6u;
// In halves of the square's edge: a step that leaves the square by more starts from there.
const FARTHEST: f32 = 2.5;
// The chance of a point is at most this many times that in the middle of the square, where it costs little to know.
const PEAK: f32 = 1.25;
// Discs that are nearly edge-on in the middle of the square may turn elsewhere.
const LEAST_FACING: f32 = 0.1;

// The largest z at which points are searched for: discs reach beyond the box about their middles.
fn farthest_z(largest: f32) -> f32 {
    return largest * 1.02 + 1e-3 * frame.scene_radius;
}

// The place in the square of a leaf in which the point is reflected; a solution with no distance if there is none.
fn root_in(given: Reflected, node: u32, leaf: u32) -> Solution {
    let middle = bundles[node].middle;
    let axis = bundles[node].axis;
    let offset = given.place - middle.xyz;
    let z = dot(offset, axis.xyz);
    if z < middle.w || z > farthest_z(axis.w) {
        return Solution(0u, 0.0);
    }
    let across = across_axis(axis.xyz);
    let target_place = vec2f(dot(offset, across.x), dot(offset, across.y));
    let square = bundles[node].square;
    let facing = max(facing_of(given, axis.xyz), LEAST_FACING);
    // Fewer points than fall on a pixel do: each is kept with a chance, drawn by its identity and the square.
    let drawn = drawn_for(given.identity, leaf);
    let a = bundles[node].coefficients[0];
    let b = bundles[node].coefficients[1];
    let c = bundles[node].coefficients[2];
    let per_pixel = settings.sample_cameras.points_per_pixel;
    let scale = given.area * square.z * square.z * per_pixel;
    let middle_share = PEAK * scale * facing / area_of(b.xy + z * b.zw, c.xy + z * c.zw);
    if per_pixel > 0.0 && drawn >= middle_share {
        return Solution(0u, 0.0);
    }
    let c0 = a.xy + z * a.zw - target_place;
    let c1 = b.xy + z * b.zw;
    let c2 = c.xy + z * c.zw;
    var c3 = vec2f(0.0);
    var c4 = vec2f(0.0);
    var c5 = vec2f(0.0);
    var c6 = vec2f(0.0);
    var c7 = vec2f(0.0);
    var c8 = vec2f(0.0);
    var c9 = vec2f(0.0);
    if degree > 1u {
        c3 = bundles[node].coefficients[3].xy + z * bundles[node].coefficients[3].zw;
        c4 = bundles[node].coefficients[4].xy + z * bundles[node].coefficients[4].zw;
        c5 = bundles[node].coefficients[5].xy + z * bundles[node].coefficients[5].zw;
    }
    if degree > 2u {
        c6 = bundles[node].coefficients[6].xy + z * bundles[node].coefficients[6].zw;
        c7 = bundles[node].coefficients[7].xy + z * bundles[node].coefficients[7].zw;
        c8 = bundles[node].coefficients[8].xy + z * bundles[node].coefficients[8].zw;
        c9 = bundles[node].coefficients[9].xy + z * bundles[node].coefficients[9].zw;
    }
    var p = vec2f(0.0);
    var by_x = vec2f(0.0);
    var by_y = vec2f(0.0);
    let limit = 1.0 + BORDER / square.z;
    var is_going = true;
    var is_found = false;
    for (var step = 0u; step < STEPS && is_going; step++) {
        var value = c0 + p.x * c1 + p.y * c2;
        by_x = c1;
        by_y = c2;
        if degree > 1u {
            value += p.x * p.x * c3 + p.x * p.y * c4 + p.y * p.y * c5;
            by_x += 2.0 * p.x * c3 + p.y * c4;
            by_y += p.x * c4 + 2.0 * p.y * c5;
        }
        if degree > 2u {
            let xx = p.x * p.x;
            let xy = p.x * p.y;
            let yy = p.y * p.y;
            value += xx * p.x * c6 + xx * p.y * c7 + p.x * yy * c8 + yy * p.y * c9;
            by_x += 3.0 * xx * c6 + 2.0 * xy * c7 + yy * c8;
            by_y += xx * c7 + 2.0 * xy * c8 + 3.0 * yy * c9;
        }
        let moved = solved(by_x, by_y, value);
        p -= moved;
        let is_outside = any(abs(p) > vec2f(limit));
        // Newton's method converges by squares: this is a hundredth of a pixel in the largest square.
        is_found = abs(moved.x) + abs(moved.y) < 0.01 && !is_outside;
        is_going = !is_found && !(is_outside && step > 0u);
        p = clamp(p, vec2f(-FARTHEST), vec2f(FARTHEST));
    }
    if !is_found {
        return Solution(0u, 0.0);
    }
    let camera = CameraFrame(middle.xyz, axis.xyz, across, square.z, square.w != 0.0);
    return kept_root(given, camera, z, square.xy + p * square.z, by_x, by_y, drawn, middle_share);
}

// Rounding must not leave out a point, nor the angle between its pixel's ray and that of the formula.
const FORMULA_MARGIN: f32 = 1.1;

// The place in which a mirror with a closed formula reflects the point; a solution with no distance if there is none.
fn root_by_formula(given: Reflected, number: u32) -> Solution {
    let mirror = analytic[number];
    if mirror.z_size.w <= 0.0 {
        return Solution(0u, 0.0);
    }
    let per_pixel = settings.sample_cameras.points_per_pixel;
    let drawn = drawn_for(given.identity, BY_FORMULA | number);
    let least = least_area(mirror, given.place);
    let most_share = select(FORMULA_MARGIN * per_pixel * given.area / max(least, 1e-30), 3e38, least <= 0.0);
    if per_pixel > 0.0 && drawn >= most_share {
        return Solution(0u, 0.0);
    }
    let place = analytic_place(mirror, given.place);
    let view = view_from_relative(frame, place.point);
    if !place.is_found || view.z <= frame.near {
        return Solution(0u, 0.0);
    }
    let at = pixel_from_view(frame, view);
    let is_in = all(at >= vec2f(0.0)) && all(at < vec2f(f32(frame.width), f32(frame.height)));
    let texel = vec2i(select(vec2f(0.0), floor(at), is_in));
    // Another mirror may stand before this one.
    if !is_in || analytic_at(textureLoad(point_in, texel, 0).xyz) != number {
        return Solution(0u, 0.0);
    }
    let axis = reflected_direction(place.point, place.normal, place.point - sight_to(place.point));
    let across = across_axis(axis);
    let z = dot(given.place - place.point, axis);
    let slopes = analytic_slopes(place, z);
    let by_x = vec2f(dot(slopes.right, across.x), dot(slopes.right, across.y));
    let by_y = vec2f(dot(slopes.down, across.x), dot(slopes.down, across.y));
    // Of a mirror that is drawn as points, each pixel has a place and a normal of its own.
    let camera = CameraFrame(place.point, axis, across, 1.0, mirror.as_points != 0u);
    return kept_root(given, camera, z, at, by_x, by_y, drawn, most_share);
}

// Parts mirrors from the leaves for which points are drawn.
const BY_FORMULA: u32 = 0xf0000000u;
