// Closes holes of a surface that are narrower than its points can say: a pixel counts as one if at least seven of the eight
// pixels around it, at the same number of pixels from it, show one plane nearer than its own surface, by discs that reach
// two thirds of the way to it at least. It takes their mean, with the depth of their planes at its place. Beside a straight
// outline three of the eight are nearer, and in an inner corner five, so both stay; a window or a slit stays where the
// points around it are closer together than it is wide. The other pixels are copies of what is read. One thread a pixel.
#import frame_group
#import splat

@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var depth_in: texture_2d<f32>;
@group(1) @binding(3) var radius_in: texture_2d<f32>;
@group(1) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(6) var depth_out: texture_storage_2d<r32float, write>;

// The ways to the pixels around one, in pixels.
const WAYS: vec3i = vec3i(3, 8, 20);
const ENOUGH: u32 = 7u;
// Planes up to this far behind the nearest of them are one; a pixel further behind is behind it. Relative to the depth.
const SAME_PLANE: f32 = 0.02;
// The longest way in radii of the discs at its end.
const REACH: f32 = 1.5;

@compute @workgroup_size(8, 8)
fn close_holes(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let center = vec2i(id.xy);
    let own_depth = textureLoad(depth_in, center, 0).x;
    // Holes are rare: conditions are in the loops because software rasterisers run both sides of a branch. Seven of eight are
    // at least three of the four beside, above and below; most pixels look to both sides only.
    let across = vec3i(nearer_ones(center, vec2i(WAYS.x, 0), own_depth), nearer_ones(center, vec2i(WAYS.y, 0), own_depth),
        nearer_ones(center, vec2i(WAYS.z, 0), own_depth));
    var way = 0;
    for (var i = 0; any(across > vec3i(0)) && way == 0 && i < 3; i++) {
        let nearer = across[i] + nearer_ones(center, vec2i(0, WAYS[i]), own_depth);
        way = select(0, WAYS[i], nearer >= 3);
    }
    var planes: array<f32, 8>;
    var front = 3e38;
    for (var i = 0; way > 0 && i < 8; i++) {
        let at = center + neighbor(i) * way;
        let beside = depth_at(at);
        planes[i] = 0.0;
        let radius = textureLoad(radius_in, at, 0).x * pixels_per_unit(frame, beside);
        if beside > 0.0 && radius * REACH >= f32(way) {
            let point = view_from_pixel(frame, vec2f(at) + 0.5, beside);
            let facing = view_from_relative(frame, textureLoad(normal_in, at, 0).xyz);
            let plane = hit_of_plane(frame, point, facing, vec2f(center) + 0.5);
            planes[i] = select(0.0, plane.z, is_finite(plane.z) && plane.z > 0.0);
        }
        front = min(front, select(3e38, planes[i], planes[i] > 0.0));
    }
    let limit = behind(front);
    var count = 0u;
    for (var i = 0; way > 0 && i < 8; i++) {
        count += select(0u, 1u, planes[i] > 0.0 && planes[i] <= limit);
    }
    let closes = count >= ENOUGH && (own_depth == 0.0 || own_depth > limit);
    var albedo_sum = vec4f(0.0);
    var normal_sum = vec4f(0.0);
    var depth_sum = 0.0;
    for (var i = 0; closes && i < 8; i++) {
        if planes[i] > 0.0 && planes[i] <= limit {
            let at = center + neighbor(i) * way;
            albedo_sum += textureLoad(albedo_in, at, 0);
            normal_sum += textureLoad(normal_in, at, 0);
            depth_sum += planes[i];
        }
    }
    for (var i = 0; closes && i < 1; i++) {
        let direction = normal_sum.xyz;
        let own = textureLoad(normal_in, center, 0).xyz;
        let mean = select(own, normalize(direction), dot(direction, direction) > 0.0);
        textureStore(albedo_out, center, albedo_sum / f32(count));
        textureStore(normal_out, center, vec4f(mean, normal_sum.w / f32(count)));
        textureStore(depth_out, center, vec4f(depth_sum / f32(count)));
    }
}

// The depth of a pixel; 0 if nothing is seen there, or beyond the edge of the picture.
fn depth_at(pixel: vec2i) -> f32 {
    let is_in = all(pixel >= vec2i(0)) && all(pixel < vec2i(i32(frame.width), i32(frame.height)));
    return select(0.0, textureLoad(depth_in, pixel, 0).x, is_in);
}

// What is farther away than this lies behind a surface of this depth.
fn behind(depth: f32) -> f32 {
    return depth + SAME_PLANE * select(depth, frame.reference_depth, frame.orthographic != 0u);
}

// How many of the two pixels at this way and its opposite show something before a depth, which is 0 for nothing.
fn nearer_ones(center: vec2i, way: vec2i, own: f32) -> i32 {
    let depths = vec2f(depth_at(center - way), depth_at(center + way));
    let is_nearer = depths > vec2f(0.0) & (vec2<bool>(own == 0.0) | vec2f(own) > vec2f(behind(depths.x), behind(depths.y)));
    return select(0, 1, is_nearer.x) + select(0, 1, is_nearer.y);
}
