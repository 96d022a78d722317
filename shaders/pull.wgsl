// Pull (Preiner 2010, sections 3.6, 3 and 4.6.1): one level of the Mirror G-Buffer's pyramid from the level below, the
// mean of those of four pixels that hold something. One thread a pixel of the level made.
#import frame_group

@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: 1 where something was found, else 0.
@group(1) @binding(2) var position_in: texture_2d<f32>;
@group(1) @binding(3) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(4) var normal_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(5) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn pull(@builtin(global_invocation_id) id: vec3u) {
    let size = textureDimensions(position_out);
    if any(id.xy >= size) {
        return;
    }
    let last = textureDimensions(position_in) - 1u;
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var position = vec3f(0.0);
    var count = 0.0;
    for (var i = 0u; i < 4u; i++) {
        let at = min(id.xy * 2u + vec2u(i & 1u, i >> 1u), last);
        let found = textureLoad(position_in, at, 0);
        if found.w > 0.0 {
            albedo += textureLoad(albedo_in, at, 0);
            normal += textureLoad(normal_in, at, 0);
            position += found.xyz;
            count += 1.0;
        }
    }
    let share = 1.0 / max(count, 1.0);
    let unit = normal.xyz * inverseSqrt(max(dot(normal.xyz, normal.xyz), 1e-30));
    textureStore(albedo_out, id.xy, albedo * share);
    textureStore(normal_out, id.xy, vec4f(unit, normal.w * share));
    textureStore(position_out, id.xy, vec4f(position * share, min(count, 1.0)));
}
