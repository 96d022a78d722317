// The mirror points of the pixels whose reflections one of several methods finds. One thread a pixel.
#import frame_group

// w: specular intensity; 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// The number of the method of each mirror pixel, see mirror_methods.wgsl.
@group(1) @binding(1) var method_in: texture_2d<f32>;
// w: 0 also where another method finds them.
@group(1) @binding(2) var point_out: texture_storage_2d<rgba32float, write>;

override part: u32 = 0u;

@compute @workgroup_size(8, 8)
fn mirror_share(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id.xy, 0);
    let is_own = point.w != 0.0 && u32(textureLoad(method_in, id.xy, 0).x) == part;
    textureStore(point_out, id.xy, vec4f(point.xyz, select(0.0, point.w, is_own)));
}
