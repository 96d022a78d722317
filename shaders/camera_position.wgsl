// Computes the position of each pixel of the camera's G-buffer in world axes, relative to the eye. One thread a pixel.
#import frame_group

@group(1) @binding(0) var depth_in: texture_2d<f32>;
// w: 1, or 0 where the pixel is empty.
@group(1) @binding(1) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn camera_position(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let depth = textureLoad(depth_in, id.xy, 0).x;
    let position = world_direction(frame, view_from_pixel(frame, vec2f(id.xy) + 0.5, depth));
    textureStore(position_out, id.xy, select(vec4f(0.0), vec4f(position, 1.0), depth > 0.0));
}
