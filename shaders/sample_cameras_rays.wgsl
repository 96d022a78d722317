// Sample-based cameras, cells of space: takes a reflected ray from every few pixels. One thread a ray.
#import frame_group
#import mirror_ray
#import camera_tree

@group(1) @binding(0) var<uniform> trees: CameraTrees;
// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(1) var point_in: texture_2d<f32>;
@group(1) @binding(2) var normal_in: texture_2d<f32>;
@group(1) @binding(3) var eye_in: texture_2d<f32>;
// Without a direction where there is no mirror.
@group(1) @binding(4) var<storage, read_write> rays: array<CameraRay>;

@compute @workgroup_size(8, 8)
fn sample_cameras_rays(@builtin(global_invocation_id) thread: vec3u) {
    if thread.x >= trees.columns || thread.y >= trees.rows {
        return;
    }
    let pixel = vec2u(trees.first_x, trees.first_y) + thread.xy * trees.stride;
    var ray = CameraRay(vec4f(0.0), vec4f(0.0));
    if pixel.x < frame.width && pixel.y < frame.height {
        let point = textureLoad(point_in, pixel, 0);
        if point.w > 0.0 {
            let eye = textureLoad(eye_in, pixel, 0).xyz;
            let direction = reflected_direction(point.xyz, textureLoad(normal_in, pixel, 0).xyz, eye);
            let at = vec2f(pixel) + 0.5;
            ray = CameraRay(vec4f(point.xyz, at.x), vec4f(direction, at.y));
        }
    }
    rays[thread.y * trees.columns + thread.x] = ray;
}
