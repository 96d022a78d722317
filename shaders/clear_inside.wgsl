// What a ray meets on a way inside a solid hides what it meets later. One thread a pixel.
#import frame_group

// xyz: where the way begins, w: 0 where there is none.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: the length of the way.
@group(1) @binding(1) var eye_in: texture_2d<f32>;
@group(1) @binding(2) var albedo_in: texture_2d<f32>;
@group(1) @binding(3) var normal_in: texture_2d<f32>;
@group(1) @binding(4) var position_in: texture_2d<f32>;
// What is met later, and from where it is seen: see clear_depth.wgsl.
@group(1) @binding(5) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(6) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(7) var position_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(8) var from_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn clear_inside(@builtin(global_invocation_id) thread: vec3u) {
    let id = thread.xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    let position = textureLoad(position_in, id, 0);
    // A mirror with a formula may be met beyond the end.
    let is_inside = distance(position.xyz, point.xyz) < textureLoad(eye_in, id, 0).w;
    if point.w > 0.0 && position.w > 0.0 && is_inside {
        textureStore(albedo_out, id, textureLoad(albedo_in, id, 0));
        textureStore(normal_out, id, textureLoad(normal_in, id, 0));
        textureStore(position_out, id, position);
        textureStore(from_out, id, point);
    }
}
