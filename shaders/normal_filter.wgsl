// Averages the mirror's normals over their neighbours, from which the curvature map is then made: splats make normals
// noisy, and noise makes false inflections. Along the rows, then along the columns, with weights that fall linearly to
// both sides, up to the mirror's rim and to depth steps. The rows leave sums, so that each pixel counts by its weight.
// One thread a pixel.
#import frame_group
#import depth_step

// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: linear depth.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var normal_out: texture_storage_2d<rgba32float, write>;

override along_columns: bool = false;

@compute @workgroup_size(8, 8)
fn normal_filter(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let here = vec2i(id.xy);
    let size = vec2i(i32(frame.width), i32(frame.height));
    var sum = vec3f(0.0);
    if textureLoad(point_in, here, 0).w > 0.0 {
        let radius = i32(settings.sscr.normal_filter);
        sum = textureLoad(normal_in, here, 0).xyz * f32(radius + 1);
        for (var side = -1; side <= 1; side += 2) {
            let direction = select(vec2i(side, 0), vec2i(0, side), along_columns);
            var depth = textureLoad(eye_in, here, 0).w;
            for (var distance = 1; distance <= radius; distance++) {
                let at = here + direction * distance;
                if any(at < vec2i(0)) || any(at >= size) || textureLoad(point_in, at, 0).w == 0.0 {
                    break;
                }
                let next = textureLoad(eye_in, at, 0).w;
                if is_depth_step(select(next, depth, side > 0), select(depth, next, side > 0)) {
                    break;
                }
                sum += textureLoad(normal_in, at, 0).xyz * f32(radius + 1 - distance);
                depth = next;
            }
        }
        if along_columns {
            sum *= inverseSqrt(max(dot(sum, sum), 1e-30));
        }
    }
    textureStore(normal_out, here, vec4f(sum, 0.0));
}
