// Shading: the albedo, lit in part by a lamp at the eye. Linear radiance. One thread a pixel.
#import frame
#import params

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var depth_in: texture_2d<f32>;
@group(1) @binding(3) var color_out: texture_storage_2d<rgba16float, write>;

@compute @workgroup_size(8, 8)
fn shade(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let depth = textureLoad(depth_in, id.xy, 0).x;
    if depth == 0.0 {
        textureStore(color_out, id.xy, vec4f(0.0));
        return;
    }
    let ray = view_from_pixel(frame, vec2f(id.xy) + 0.5, depth);
    let toward_eye = -world_direction(frame, select(normalize(ray), vec3f(0.0, 0.0, 1.0), frame.orthographic != 0u));
    let cosine = clamp(dot(textureLoad(normal_in, id.xy, 0).xyz, toward_eye), 0.0, 1.0);
    let lit = mix(1.0, cosine, settings.light.headlight);
    textureStore(color_out, id.xy, vec4f(textureLoad(albedo_in, id.xy, 0).rgb * lit, 1.0));
}
