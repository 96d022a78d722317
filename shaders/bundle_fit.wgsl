// Sample-based cameras: fits bundles to the reflected rays of the squares of one level, and divides squares in which a
// ray is farther from its bundle than the accuracy. One workgroup a square.
#import frame_group
#import mirror_ray
#import bundle
#import counters
#import hit
#import analytic
#import finite

@group(1) @binding(0) var<uniform> grid: BundleGrid;
// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(1) var point_in: texture_2d<f32>;
@group(1) @binding(2) var normal_in: texture_2d<f32>;
@group(1) @binding(3) var eye_in: texture_2d<f32>;
@group(1) @binding(4) var<storage, read_write> nodes: array<BundleNode>;
@group(1) @binding(5) var<storage, read_write> bundles: array<Bundle>;
@group(1) @binding(6) var<storage, read_write> counters: array<atomic<u32>>;
// See hit.wgsl. Pixels that bundles stand for are marked as those whose surface is already there.
@group(1) @binding(7) var<storage, read_write> hits: array<vec4u>;
// The number of rays that are left to surfel_trace; then two words each: pixel, and f32 bits of the distance up to
// which it is free.
@group(1) @binding(8) var<storage, read_write> rest: array<atomic<u32>>;
// See analytic.wgsl: their rays are no rays of squares.
@group(1) @binding(9) var<storage, read> analytic: array<FormulaMirror>;

override count_squares: bool = true;
// Whether the rays of squares that are still off are traced.
override traces_rest: bool = false;

const THREADS: u32 = 64u;
// The largest number of terms of a polynomial.
const TERMS: u32 = 10u;

var<workgroup> is_wanted: u32;
// Partial results of the threads: the sum of mirror points and the rays in the square; the sum of directions and all
// rays; bounds of both.
var<workgroup> parts: array<array<vec4f, 64>, 6>;
var<workgroup> totals: array<vec4f, 6>;
// The terms of a batch of rays, and where these meet the plane z = 0, and their slopes.
var<workgroup> batch_terms: array<array<f32, 10>, 64>;
var<workgroup> batch_rays: array<vec4f, 64>;
// The lower triangle of the normal equations, row by row, and their right sides.
var<workgroup> matrix: array<f32, 55>;
var<workgroup> right: array<vec4f, 10>;
var<workgroup> is_solved: u32;
// f32 bits of the largest error, which is not negative.
var<workgroup> error_bits: atomic<u32>;

struct Sampled {
    // Whether there is a mirror.
    is_ray: bool,
    // Whether the pixel is in the square, not beside it.
    is_inside: bool,
    // The place in the square, from -1 to 1.
    place: vec2f,
    point: vec3f,
    direction: vec3f,
}

// The rays of a square and of a border of one ray about it, which lets neighbouring bundles agree.
fn sampled(corner: vec2u, edge: u32, count: u32, index: u32) -> Sampled {
    let step = vec2i(vec2u(index % count, index / count)) - 1;
    let pixel = vec2i(corner) + step * i32(grid.stride) + i32(grid.stride / 2u);
    let inside = all(step >= vec2i(0)) && all(step < vec2i(i32(count) - 2));
    var result = Sampled(false, inside, vec2f(0.0), vec3f(0.0), vec3f(0.0, 0.0, 1.0));
    if index < count * count && all(pixel >= vec2i(0)) && all(pixel < vec2i(vec2u(frame.width, frame.height))) {
        let point = textureLoad(point_in, pixel, 0);
        let half = 0.5 * f32(edge);
        result.is_ray = point.w > 0.0 && analytic_at(point.xyz) == NOT_ANALYTIC;
        result.place = (vec2f(pixel) + 0.5 - vec2f(corner) - half) / half;
        result.point = point.xyz;
        let eye = textureLoad(eye_in, pixel, 0).xyz;
        result.direction = reflected_direction(point.xyz, textureLoad(normal_in, pixel, 0).xyz, eye);
    }
    return result;
}

// Legendre polynomials, whose normal equations are well conditioned on a full square.
fn terms_at(p: vec2f) -> array<f32, 10> {
    let second = 1.5 * p * p - 0.5;
    let third = (2.5 * p * p - 1.5) * p;
    return array<f32, 10>(
        1.0, p.x, p.y, second.x, p.x * p.y, second.y, third.x, second.x * p.y, p.x * second.y, third.y
    );
}

// How far a coefficient is pulled to zero, as a share of the rays: rays that do not determine it leave it there.
fn pull_of(term: u32) -> f32 {
    return select(select(select(1e-4, 1e-5, term < 6u), 1e-6, term < 3u), 0.0, term == 0u);
}

// The distance at which a ray leaves the box about all points.
fn leaves_scene(point: vec3f, direction: vec3f) -> f32 {
    let side = select(grid.scene_low.xyz, grid.scene_high.xyz, direction > vec3f(0.0));
    let distances = (side - point) / direction;
    return max(min(distances.x, min(distances.y, distances.z)), 0.0);
}

fn term_count() -> u32 {
    return (settings.sample_cameras.degree + 1u) * (settings.sample_cameras.degree + 2u) / 2u;
}

@compute @workgroup_size(64)
fn bundle_fit(
    @builtin(workgroup_id) group: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    // The workgroups before those of this dispatch count.
    let index = group.x + frame.first_column + (group.y + frame.first_row) * frame.columns;
    if index >= (grid.columns * grid.rows) << (2u * grid.level) {
        return;
    }
    let node = first_of_level(grid, grid.level) + index;
    if grid.level == 0u {
        mark(corner_of(grid, 0u, index), grid.largest, lane, false);
    }
    if lane == 0u {
        is_wanted = 1u;
        if grid.level > 0u {
            let parent = first_of_level(grid, grid.level - 1u) + index / 4u;
            is_wanted = select(0u, 1u, nodes[parent].origin_low.w == NODE_DIVIDED);
        }
        atomicStore(&error_bits, 0u);
    }
    if workgroupUniformLoad(&is_wanted) == 0u {
        if lane == 0u {
            nodes[node].origin_low.w = NODE_EMPTY;
        }
        return;
    }
    let edge = grid.largest >> grid.level;
    let corner = corner_of(grid, grid.level, index);
    let count = edge / grid.stride + 2u;
    let rounds = (count * count + THREADS - 1u) / THREADS;
    // The rays of small squares are fetched once.
    let only = sampled(corner, edge, count, lane);

    // The mean ray, and the bounds of all.
    var own = array<vec4f, 6>(
        vec4f(0.0), vec4f(0.0), vec4f(3e38), vec4f(-3e38), vec4f(3e38), vec4f(-3e38)
    );
    for (var round = 0u; round < rounds; round++) {
        var ray = only;
        if round > 0u {
            ray = sampled(corner, edge, count, round * THREADS + lane);
        }
        if ray.is_ray {
            own[0] += vec4f(ray.point, select(0.0, 1.0, ray.is_inside));
            own[1] += vec4f(ray.direction, 1.0);
            own[2] = min(own[2], vec4f(ray.point, 0.0));
            own[3] = max(own[3], vec4f(ray.point, 0.0));
            own[4] = min(own[4], vec4f(ray.direction, 0.0));
            own[5] = max(own[5], vec4f(ray.direction, 0.0));
        }
    }
    for (var part = 0u; part < 6u; part++) {
        parts[part][lane] = own[part];
    }
    workgroupBarrier();
    if lane < 6u {
        var total = parts[lane][0];
        for (var thread = 1u; thread < THREADS; thread++) {
            let other = parts[lane][thread];
            total = select(
                select(max(total, other), min(total, other), lane % 2u == 0u),
                total + other,
                lane < 2u
            );
        }
        totals[lane] = total;
    }
    workgroupBarrier();
    let rays = totals[1].w;
    if lane == 0u {
        is_wanted = select(0u, 1u, totals[0].w > 0.0);
    }
    if workgroupUniformLoad(&is_wanted) == 0u {
        if lane == 0u {
            nodes[node].origin_low.w = NODE_EMPTY;
        }
        return;
    }
    let middle = totals[0].xyz / max(rays, 1.0);
    let mean = totals[1].xyz / max(rays, 1.0);
    let axis = mean * inverseSqrt(max(dot(mean, mean), 1e-20));
    let across = across_axis(axis);
    // The rays of a square beyond this go apart too far for one frame.
    var is_narrow = length(mean) >= LEAST_MEAN;

    // The normal equations.
    let terms = term_count();
    let entries = terms * (terms + 1u) / 2u;
    for (var entry = lane; entry < 55u; entry += THREADS) {
        matrix[entry] = 0.0;
    }
    if lane < TERMS {
        right[lane] = vec4f(0.0);
    }
    var least_z = 3e38;
    var largest_z = 0.0;
    for (var round = 0u; round < rounds; round++) {
        var ray = only;
        if round > 0u {
            ray = sampled(corner, edge, count, round * THREADS + lane);
        }
        let along = dot(ray.direction, axis);
        var here = vec4f(0.0);
        var terms_here = array<f32, 10>();
        if ray.is_ray {
            is_narrow = is_narrow && along >= LEAST_ALONG;
            if along >= LEAST_ALONG {
                here = ray_in_frame(middle, axis, across, ray.point, ray.direction);
                terms_here = terms_at(ray.place);
                let z = dot(ray.point - middle, axis);
                let near = settings.sample_cameras.near * frame.scene_radius;
                least_z = min(least_z, z + min(near, leaves_scene(ray.point, ray.direction)) * along);
                largest_z = max(largest_z, z + leaves_scene(ray.point, ray.direction) * along);
            }
        }
        batch_rays[lane] = here;
        batch_terms[lane] = terms_here;
        workgroupBarrier();
        for (var entry = lane; entry < entries + terms; entry += THREADS) {
            if entry < entries {
                // The row and the column of the lower triangle.
                var row = 0u;
                while (row + 1u) * (row + 2u) / 2u <= entry {
                    row++;
                }
                let column = entry - row * (row + 1u) / 2u;
                var sum = matrix[entry];
                for (var ray_index = 0u; ray_index < THREADS; ray_index++) {
                    sum += batch_terms[ray_index][row] * batch_terms[ray_index][column];
                }
                matrix[entry] = sum;
            } else {
                let row = entry - entries;
                var sum = right[row];
                for (var ray_index = 0u; ray_index < THREADS; ray_index++) {
                    sum += batch_terms[ray_index][row] * batch_rays[ray_index];
                }
                right[row] = sum;
            }
        }
        workgroupBarrier();
    }
    // Partial results like those above, of what the bundle's z is bounded by.
    parts[0][lane] = vec4f(least_z, -largest_z, select(0.0, 1.0, is_narrow), 0.0);
    if lane == 0u {
        is_solved = select(0u, 1u, cholesky(terms, rays));
    }
    workgroupBarrier();
    if lane == 1u {
        var total = parts[0][0];
        for (var thread = 1u; thread < THREADS; thread++) {
            total = min(total, parts[0][thread]);
        }
        totals[2].w = total.x;
        totals[3].w = -total.y;
        totals[4].w = total.z;
    }
    workgroupBarrier();
    let bound = vec2f(totals[2].w, totals[3].w);

    // The error of the rays, in pixels.
    let half = 0.5 * f32(edge);
    var error = 0.0;
    for (var round = 0u; round < rounds; round++) {
        var ray = only;
        if round > 0u {
            ray = sampled(corner, edge, count, round * THREADS + lane);
        }
        let along = dot(ray.direction, axis);
        if ray.is_ray && along >= LEAST_ALONG {
            let truth = ray_in_frame(middle, axis, across, ray.point, ray.direction);
            let z = dot(ray.point - middle, axis);
            let leaves = leaves_scene(ray.point, ray.direction);
            let first = z + min(settings.sample_cameras.near * frame.scene_radius, leaves) * along;
            let last = z + leaves * along;
            error = max(error, error_of(truth, ray.place, first, last) * half);
        }
    }
    // Not a number counts as an infinite error.
    atomicMax(&error_bits, bitcast<u32>(select(3e38, error, error <= 3e38)));
    workgroupBarrier();
    let is_fitted = is_solved == 1u && totals[4].w > 0.0;
    let is_exact = is_fitted && bitcast<f32>(atomicLoad(&error_bits)) <= settings.sample_cameras.accuracy;
    var state = NODE_EMPTY;
    if !is_exact && grid.level < grid.last_level {
        state = NODE_DIVIDED;
    } else if is_fitted && !(traces_rest && !is_exact) {
        state = NODE_LEAF;
    }
    if !is_exact && grid.level == grid.last_level {
        mark(corner, edge, lane, true);
    }
    if lane != 0u {
        return;
    }
    // Pixels reach half a pixel beyond the rays of their middles. Bounds of divided squares hold those of their parts.
    let beyond = select(0.25, min(f32(grid.stride) / f32(edge), 0.25), state == NODE_LEAF);
    let origin_extent = vec4f(totals[3].xyz - totals[2].xyz, 0.0) * beyond;
    let direction_extent = vec4f(totals[5].xyz - totals[4].xyz, 0.0) * beyond;
    nodes[node] = BundleNode(
        vec4f(totals[2].xyz, state) - origin_extent,
        vec4f(totals[3].xyz, 0.0) + origin_extent,
        vec4f(totals[4].xyz, 0.0) - direction_extent,
        vec4f(totals[5].xyz, 0.0) + direction_extent,
    );
    if state == NODE_LEAF {
        // In powers of the place.
        bundles[node] = Bundle(
            vec4f(middle, bound.x),
            vec4f(axis, bound.y),
            vec4f(vec2f(corner) + half, half, select(1.0, 0.0, is_exact)),
            in_powers(),
        );
        if count_squares {
            atomicAdd(&counters[REGIONS], 1u);
        }
    }
}

// Says of the mirror pixels of a square whether bundles stand for them, or nothing yet; those are counted, and listed
// if they are to be traced. At the roots of squares, `is_left` being false, those are left whose mirror has a formula
// that their own ray does not follow.
fn mark(corner: vec2u, edge: u32, lane: u32, is_left: bool) {
    for (var i = lane; i < edge * edge; i += THREADS) {
        let pixel = corner + vec2u(i % edge, i / edge);
        let is_in = pixel.x < frame.width && pixel.y < frame.height;
        let point = textureLoad(point_in, select(vec2u(0u), pixel, is_in), 0);
        let mirror = select(NOT_ANALYTIC, analytic_at(point.xyz), is_in && point.w > 0.0);
        if is_in && point.w > 0.0 && !(is_left && mirror != NOT_ANALYTIC) {
            let is_rest = is_left || (mirror != NOT_ANALYTIC && is_off_formula(mirror, pixel, point.xyz));
            let index = pixel.y * frame.width + pixel.x;
            if traces_rest {
                hits[index] = select(vec4u(HIT_IN_PICTURE, 1u, 0u, 0u), vec4u(0u), is_rest);
            }
            if is_rest && count_squares {
                atomicAdd(&counters[RAYS_LEFT], 1u);
            }
            if is_rest && traces_rest {
                let entry = atomicAdd(&rest[0], 1u);
                atomicStore(&rest[1u + 2u * entry], index);
                atomicStore(&rest[2u + 2u * entry], 0u);
            }
        }
    }
}

// Whether a pixel of a mirror that is drawn as points has a ray that is farther than the accuracy from that of the
// mirror's formula, at the mirror or where it leaves the box about all points.
fn is_off_formula(number: u32, pixel: vec2u, point: vec3f) -> bool {
    let mirror = analytic[number];
    if mirror.as_points == 0u {
        return false;
    }
    let normal = textureLoad(normal_in, pixel, 0).xyz;
    let eye = textureLoad(eye_in, pixel, 0).xyz;
    let sight = normalize(point - eye);
    let offset = (eye - mirror.position_reach.xyz) / mirror.z_size.w;
    var at = AnalyticPlace(true, vec3f(0.0), mirror.z_size.xyz, 0.0);
    if mirror.x_kind.w == SPHERE {
        let t = quadratic(1.0, dot(offset, sight), dot(offset, offset) - 1.0).x;
        if t > 1e30 {
            return true;
        }
        at.normal = offset + sight * t;
        at.bend = 1.0 / mirror.z_size.w;
        at.point = eye + sight * (t * mirror.z_size.w);
    } else {
        at.normal *= select(1.0, -1.0, dot(at.normal, sight) > 0.0);
        at.point = eye - sight * (dot(offset, at.normal) * mirror.z_size.w / dot(sight, at.normal));
    }
    let axis = reflected_direction(at.point, at.normal, at.point - sight);
    let across = across_axis(axis);
    let ray = ray_in_frame(at.point, axis, across, point, reflected_direction(point, normal, eye));
    for (var end = 0u; end < 2u; end++) {
        let z = select(0.0, leaves_scene(at.point, axis), end == 1u);
        let slopes = analytic_slopes(at, z);
        let by_x = vec2f(dot(slopes.right, across.x), dot(slopes.right, across.y));
        let by_y = vec2f(dot(slopes.down, across.x), dot(slopes.down, across.y));
        let error = error_at(ray.xy + z * ray.zw, by_x, by_y);
        // What is no number is off, too.
        if !is_finite(error) || error > settings.sample_cameras.accuracy {
            return true;
        }
    }
    return false;
}

// A mean direction shorter than this is that of rays that go anywhere.
const LEAST_MEAN: f32 = 0.3;

// Solves the normal equations in place: `right` becomes the factors. False if they have no solution.
fn cholesky(terms: u32, rays: f32) -> bool {
    var is_regular = true;
    for (var column = 0u; column < terms; column++) {
        let first = column * (column + 1u) / 2u;
        var diagonal = matrix[first + column] + pull_of(column) * rays;
        for (var k = 0u; k < column; k++) {
            diagonal -= matrix[first + k] * matrix[first + k];
        }
        is_regular = is_regular && diagonal > 1e-7 * rays;
        let root = sqrt(max(diagonal, 1e-12));
        matrix[first + column] = root;
        for (var row = column + 1u; row < terms; row++) {
            let other = row * (row + 1u) / 2u;
            var value = matrix[other + column];
            for (var k = 0u; k < column; k++) {
                value -= matrix[other + k] * matrix[first + k];
            }
            matrix[other + column] = value / root;
        }
    }
    for (var row = 0u; row < terms; row++) {
        let first = row * (row + 1u) / 2u;
        var value = right[row];
        for (var k = 0u; k < row; k++) {
            value -= matrix[first + k] * right[k];
        }
        right[row] = value / matrix[first + row];
    }
    for (var back = 0u; back < terms; back++) {
        let row = terms - 1u - back;
        var value = right[row];
        for (var k = row + 1u; k < terms; k++) {
            value -= matrix[k * (k + 1u) / 2u + row] * right[k];
        }
        right[row] = value / matrix[row * (row + 1u) / 2u + row];
    }
    return is_regular;
}

// The largest error of a ray at four places from `first` to `last` along it, in halves of the square's edge. By
// `solve`: how far the place is off that the bundle has for a point of the ray. By `ray`: how far the bundle's ray
// is beside the point, over the distance of rays a pixel apart; that stays finite where rays meet.
fn error_of(truth: vec4f, place: vec2f, first: f32, last: f32) -> f32 {
    let terms = terms_at(place);
    var value = vec4f(0.0);
    for (var term = 0u; term < term_count(); term++) {
        value += terms[term] * right[term];
    }
    let x = place.x;
    let y = place.y;
    let slope_x = 3.0 * vec2f(x, y);
    let second = 1.5 * place * place - 0.5;
    let third = 7.5 * place * place - 1.5;
    var along_x = right[1] + slope_x.x * right[3] + y * right[4];
    var along_y = right[2] + x * right[4] + slope_x.y * right[5];
    along_x += third.x * right[6] + 3.0 * x * y * right[7] + second.y * right[8];
    along_y += second.x * right[7] + 3.0 * x * y * right[8] + third.y * right[9];
    let off = value - truth;
    var error = 0.0;
    for (var step = 0u; step < 4u; step++) {
        let share = f32(step * step) / 9.0;
        let z = mix(first, last, share);
        let beside = off.xy + z * off.zw;
        let by_x = along_x.xy + z * along_x.zw;
        let by_y = along_y.xy + z * along_y.zw;
        error = max(error, error_at(beside, by_x, by_y));
    }
    return error;
}

// The error of a place that lies beside its ray, where rays move so far with a step in the picture.
fn error_at(beside: vec2f, by_x: vec2f, by_y: vec2f) -> f32 {
    let width = max(length(by_x), length(by_y));
    let determinant = by_x.x * by_y.y - by_x.y * by_y.x;
    let solved = vec2f(
        beside.x * by_y.y - beside.y * by_y.x,
        by_x.x * beside.y - by_x.y * beside.x
    ) / select(determinant, 1e-30, determinant == 0.0);
    let by_ray = length(beside) / max(width, 1e-20);
    let is_solved_for = settings.sample_cameras.judged_by == SAMPLE_CAMERAS_JUDGED_BY_SOLVE;
    return select(by_ray, length(solved), is_solved_for);
}

// The factors of the Legendre polynomials as factors of powers.
fn in_powers() -> array<vec4f, 10> {
    return array<vec4f, 10>(
        right[0] - 0.5 * (right[3] + right[5]),
        right[1] - 1.5 * right[6] - 0.5 * right[8],
        right[2] - 0.5 * right[7] - 1.5 * right[9],
        1.5 * right[3],
        right[4],
        1.5 * right[5],
        2.5 * right[6],
        1.5 * right[7],
        1.5 * right[8],
        2.5 * right[9],
    );
}
