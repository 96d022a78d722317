// Keeps the sums of rays of light for light_ray_reuse.wgsl in the next frame. One thread a pixel.
#import frame_group
#import light_path

// xyz: relative to the eye, w: coverage.
@group(1) @binding(0) var position_in: texture_2d<f32>;
@group(1) @binding(1) var<storage, read> paths: array<LightPath>;
// xyz: f32 bits of the place where the rays began, relative to the eye, w: their number.
@group(1) @binding(2) var<storage, read_write> kept: array<vec4u>;
// rgb: the mean irradiance over pi, a: the mean nearness, see light_path.wgsl.
@group(1) @binding(3) var<storage, read_write> kept_light: array<vec4f>;

@compute @workgroup_size(8, 8)
fn light_ray_keep(@builtin(global_invocation_id) thread: vec3u) {
    let id = thread.xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    let index = id.y * frame.width + id.x;
    let path = paths[index];
    let offset = vec3f(unpack2x16float(path.offset.x), unpack2x16float(path.offset.y).x);
    let place = position.xyz + offset * own_spacing(position.xyz);
    let count = select(0u, u32(path.count), position.w > 0.0);
    kept[index] = vec4u(bitcast<vec3u>(place), count);
    kept_light[index] = vec4f(path.diffuse.rgb, path.nearness) / max(path.count, 1.0);
}
