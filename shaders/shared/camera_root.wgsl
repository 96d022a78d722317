// Where a point is reflected, once a camera of rays has found a place of the mirror for it. The importing pass has the
// images `point_in`, `normal_in` and `eye_in`, `solutions` and `counters`.
#import bundle
#import counters
#import hash
#import mirror_ray
#import mirror_splat

override roots: u32 = 4u;
override count_points: bool = true;

var<workgroup> tried: atomic<u32>;
var<workgroup> reflected: atomic<u32>;
var<workgroup> dropped: atomic<u32>;

// A point, with what its roots need.
struct Reflected {
    // Relative to the eye.
    place: vec3f,
    // Zero if there is none.
    normal: vec3f,
    // Of its disc.
    radius: f32,
    // The area that it stands for: discs overlap.
    area: f32,
    identity: u32,
}

// The discs of a surface together have so many times its area: radii are 1.5 sqrt(area / (pi count)).
const OVERLAP: f32 = 2.25;
// Roots of a point that are no farther apart than this, in pixels, are one.
const SAME_ROOT: f32 = 1.0;
// The squares that are splatted are so many times as large as the discs' reflections: so they overlap also where points
// are left out at random.
const COVER: f32 = 2.0;
// The largest side of a splat that `pack_side` keeps.
const LARGEST_SIDE: f32 = 15.0;
// The longest step of polishing, in pixels.
const LONGEST_POLISH: f32 = 2.0;

// The rays at hand, in a frame across their mean direction (see `Bundle`).
struct CameraFrame {
    middle: vec3f,
    axis: vec3f,
    across: Across,
    // Half the edge of the square in pixels, in which places of the mirror are measured.
    half: f32,
    // Whether a place counts only if the pixel's own ray passes the point within the accuracy.
    is_judged: bool,
}

// A point as it is stored, and whether it is shown and is a place.
struct Tried {
    is_point: bool,
    reflected: Reflected,
}

fn tried_point(item: Item, index: u32) -> Tried {
    let point = points[index];
    let place = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let is_point = is_place(point.xyz) && dot(place, place) < 3e38 && is_shown(index);
    let own_radius = unpack_radius(point.w & 0xffffu);
    let radius = select(own_radius, item.origin_radius.w, own_radius == 0.0);
    // The area also covers the points that a thinned frame skips.
    let area = 3.14159274 * radius * radius / OVERLAP * f32(page.step);
    let normal = unpack_normal(attributes[index].y);
    return Tried(is_point, Reflected(place, normal, radius * settings.splat.size, area, identities_from + index));
}

// A number from 0 to 1 for a point and a leaf.
fn drawn_for(identity: u32, leaf: u32) -> f32 {
    return f32(hash(identity ^ (leaf * 2654435769u)) >> 8u) / 16777216.0;
}

// Keeps a root, if it is one and not that of a neighbouring leaf. Returns the number of roots so far; those beyond
// `roots` are dropped.
fn with_root(given: Reflected, index: u32, found: u32, root: Solution) -> u32 {
    var is_new = root.distance > 0.0;
    let at = unpack_place(root.place);
    for (var other = 0u; other < min(found, roots) && is_new; other++) {
        let before = unpack_place(solutions[index + other * page.point_count].place);
        is_new = distance(at, before) > SAME_ROOT;
    }
    if is_new && found < roots {
        solutions[index + found * page.point_count] = root;
    }
    return found + select(0u, 1u, is_new);
}

// Ends the roots of a point that was tried, if it has fewer than there is room for, and counts it.
fn end_roots(index: u32, found: u32, is_counted: bool) {
    if is_counted && count_points {
        atomicAdd(&tried, 1u);
        atomicAdd(&reflected, min(found, 1u));
        atomicAdd(&dropped, select(0u, 1u, found > roots));
    }
    if found < roots {
        solutions[index + found * page.point_count] = Solution(0u, 0.0);
    }
}

// Adds what the workgroup has counted; by all of its threads.
fn count_roots(lane: u32) {
    if count_points {
        workgroupBarrier();
        if lane == 0u {
            atomicAdd(&counters[POINTS_TRIED], atomicLoad(&tried));
            atomicAdd(&counters[POINTS_FOUND], atomicLoad(&reflected));
            atomicAdd(&counters[POINTS_UNCONVERGED], atomicLoad(&dropped));
        }
    }
}

// Which way a point's disc turns: its area across a direction.
fn facing_of(given: Reflected, direction: vec3f) -> f32 {
    return select(abs(dot(given.normal, direction)), 1.0, all(given.normal == vec3f(0.0)));
}

fn area_of(by_x: vec2f, by_y: vec2f) -> f32 {
    return max(abs(by_x.x * by_y.y - by_x.y * by_y.x), 1e-30);
}

// The step (x, y) with x by_x + y by_y = value.
fn solved(by_x: vec2f, by_y: vec2f, value: vec2f) -> vec2f {
    let determinant = by_x.x * by_y.y - by_x.y * by_y.x;
    let safe = select(determinant, 1e-30, determinant == 0.0);
    return vec2f(value.x * by_y.y - value.y * by_y.x, by_x.x * value.y - by_x.y * value.x) / safe;
}

// The root at a place of the picture, by the mirror pixel there: none if there is no mirror, or the point is behind it,
// or belongs to the mirror itself beside it, or if the pixel's own ray passes it by. `by_x` and `by_y` say how the
// rays' places at the point's z change over half a square. A point is kept with a chance, `most_share` at most.
fn kept_root(
    given: Reflected,
    camera: CameraFrame,
    z: f32,
    found_at: vec2f,
    by_x: vec2f,
    by_y: vec2f,
    drawn: f32,
    most_share: f32,
) -> Solution {
    let size = vec2f(f32(frame.width), f32(frame.height));
    let target_offset = given.place - camera.middle;
    let target_place = vec2f(dot(target_offset, camera.across.x), dot(target_offset, camera.across.y));
    var at = found_at;
    var solution = Solution(0u, 0.0);
    var is_kept = true;
    for (var step = 0u; step <= settings.sample_cameras.polish && is_kept; step++) {
        let pixel = floor(at);
        is_kept = all(pixel >= vec2f(0.0)) && all(pixel < size);
        let texel = vec2i(select(vec2f(0.0), pixel, is_kept));
        let point = textureLoad(point_in, texel, 0);
        let normal = textureLoad(normal_in, texel, 0).xyz;
        let offset = given.place - point.xyz;
        let reach = length(offset);
        let is_before = dot(offset, normal) > 0.0 && reach > OWN_SURFACE_RADII * given.radius;
        let direction = reflected_direction(point.xyz, normal, textureLoad(eye_in, texel, 0).xyz);
        let along = dot(direction, camera.axis);
        is_kept = is_kept && point.w > 0.0 && is_before && along > LEAST_ALONG;
        // How far the pixel's own ray is beside the point, less what the place is beside the pixel's middle.
        let ray = ray_in_frame(camera.middle, camera.axis, camera.across, point.xyz, direction);
        let aside = (pixel + 0.5 - at) / camera.half;
        let beside = ray.xy + z * ray.zw - target_place - aside.x * by_x - aside.y * by_y;
        let step_back = solved(by_x, by_y, beside) * camera.half;
        if step < settings.sample_cameras.polish {
            at -= clamp(step_back, vec2f(-LONGEST_POLISH), vec2f(LONGEST_POLISH));
        } else {
            let by_ray = length(beside) / max(max(length(by_x), length(by_y)), 1e-20) * camera.half;
            let is_by_solve = settings.sample_cameras.judged_by == SAMPLE_CAMERAS_JUDGED_BY_SOLVE;
            let error = select(by_ray, length(step_back), is_by_solve);
            // Within the accuracy, all rays of the square are near enough.
            is_kept = is_kept && (!camera.is_judged || error <= settings.sample_cameras.accuracy);
            // The pixels that all points like this one, together without gaps, would cover each.
            let covers = facing_of(given, direction) / along * camera.half * camera.half / area_of(by_x, by_y);
            let per_pixel = settings.sample_cameras.points_per_pixel;
            let share = min(per_pixel * given.area * covers, most_share);
            let chance = select(min(share, 1.0), 1.0, per_pixel == 0.0);
            is_kept = is_kept && drawn < chance;
            if is_kept {
                let disc = OVERLAP * given.area * settings.splat.size * settings.splat.size * covers;
                let side = sqrt(COVER * disc / max(chance, 1e-20));
                solution = Solution(pack_place(at), pack_side(reach, clamp(side, 1.0, LARGEST_SIDE)));
            }
        }
    }
    return solution;
}
