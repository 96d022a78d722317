// What is seen behind clear surfaces: what the rays found; where a ray beneath a surface that bounds no solid found
// nothing, as in deep water, that surface's own colour. One thread a pixel.
#import frame_group

// w: 0 where no light goes through.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var direction_in: texture_2d<f32>;
// Below 0 where the surface bounds no solid.
@group(1) @binding(2) var index_in: texture_2d<f32>;
// The clear surface itself.
@group(1) @binding(3) var own_albedo_in: texture_2d<f32>;
@group(1) @binding(4) var own_normal_in: texture_2d<f32>;
@group(1) @binding(5) var albedo_in: texture_2d<f32>;
@group(1) @binding(6) var normal_in: texture_2d<f32>;
@group(1) @binding(7) var position_in: texture_2d<f32>;
@group(1) @binding(8) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(9) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(10) var position_out: texture_storage_2d<rgba32float, write>;
// xyz: from where it is seen, w: as in `point_in`.
@group(1) @binding(11) var from_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn clear_depth(@builtin(global_invocation_id) thread: vec3u) {
    let id = thread.xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    var origin = point;
    if point.w == 0.0 {
        textureStore(from_out, id, origin);
        return;
    }
    var albedo = textureLoad(albedo_in, id, 0);
    var normal = textureLoad(normal_in, id, 0);
    var position = textureLoad(position_in, id, 0);
    if position.w == 0.0 && textureLoad(index_in, id, 0).x < 0.0 {
        albedo = vec4f(textureLoad(own_albedo_in, id, 0).rgb, 0.0);
        normal = vec4f(textureLoad(own_normal_in, id, 0).xyz, 0.0);
        position = vec4f(point.xyz, 1.0);
        // Along the refracted ray, and as far away as the eye.
        origin = vec4f(point.xyz - textureLoad(direction_in, id, 0).xyz * length(point.xyz), point.w);
    }
    textureStore(albedo_out, id, albedo);
    textureStore(normal_out, id, normal);
    textureStore(position_out, id, position);
    textureStore(from_out, id, origin);
}
