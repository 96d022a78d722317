// Closes pixels that see through a gap between splats: points are samples, and however large the discs, some pixels
// between them stay open. A pixel counts as a gap if at least five of its eight neighbours form one surface nearer than
// its own; it takes their mean, with the depths that their planes have at its place. Gaps of two by two pixels close.
// Beside a straight outline three neighbours are nearer, so it stays; only an inner corner loses its pixel. The other
// pixels are copies of what is read. One thread a pixel.
#import frame_group
#import splat

@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var depth_in: texture_2d<f32>;
@group(1) @binding(3) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(4) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(5) var depth_out: texture_storage_2d<r32float, write>;

// Neighbours up to this far behind the nearest of them form one surface with it; a pixel further behind is behind it.
// Relative to the depth: a surface seen at 80 degrees changes by this much over two pixels of a 60-degree picture.
const SAME_SURFACE: f32 = 0.02;
const ENOUGH: u32 = 5u;

@compute @workgroup_size(8, 8)
fn close_gaps(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let center = vec2i(id.xy);
    let own_depth = textureLoad(depth_in, center, 0).x;
    let last = vec2i(i32(frame.width), i32(frame.height)) - 1;
    var depths: array<f32, 8>;
    var front = 3e38;
    for (var i = 0; i < 8; i++) {
        let at = center + neighbor(i);
        // Nothing is known beyond the picture's edge.
        depths[i] = 0.0;
        if all(at >= vec2i(0)) && all(at <= last) {
            depths[i] = textureLoad(depth_in, at, 0).x;
        }
        if depths[i] > 0.0 {
            front = min(front, depths[i]);
        }
    }
    let limit = front + SAME_SURFACE * select(front, frame.reference_depth, frame.orthographic != 0u);
    var count = 0u;
    for (var i = 0; i < 8; i++) {
        count += select(0u, 1u, depths[i] > 0.0 && depths[i] <= limit);
    }
    let is_gap = count >= ENOUGH && (own_depth == 0.0 || own_depth > limit);
    var albedo_sum = vec4f(0.0);
    var normal_sum = vec4f(0.0);
    var depth_sum = 0.0;
    // Gaps are rare: the condition is in the loop because software rasterisers run both sides of a branch.
    for (var i = 0; is_gap && i < 8; i++) {
        if depths[i] > 0.0 && depths[i] <= limit {
            let at = center + neighbor(i);
            let beside = textureLoad(normal_in, at, 0);
            let point = view_from_pixel(frame, vec2f(at) + 0.5, depths[i]);
            let plane = hit_of_plane(frame, point, view_from_relative(frame, beside.xyz), vec2f(center) + 0.5);
            albedo_sum += textureLoad(albedo_in, at, 0);
            normal_sum += beside;
            depth_sum += depth_beside(depths[i], plane.z, 1.0 / pixels_per_unit(frame, depths[i]));
        }
    }
    for (var i = 0; is_gap && i < 1; i++) {
        let direction = normal_sum.xyz;
        let own = textureLoad(normal_in, center, 0).xyz;
        let mean = select(own, normalize(direction), dot(direction, direction) > 0.0);
        textureStore(albedo_out, center, albedo_sum / f32(count));
        textureStore(normal_out, center, vec4f(mean, normal_sum.w / f32(count)));
        textureStore(depth_out, center, vec4f(depth_sum / f32(count)));
    }
}
