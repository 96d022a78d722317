// The mirror pixels of a surface, and the origins of the rays to them. One thread a pixel.
#import frame_group

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: mirror points of the bounce before, w: 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(4) var point_out: texture_storage_2d<rgba32float, write>;
// xyz: origin of the ray, w: linear depth of the mirror point seen from there.
@group(1) @binding(5) var eye_out: texture_storage_2d<rgba32float, write>;

// x: how much the rays count.
@group(1) @binding(6) var weight_in: texture_2d<f32>;

// Whether the surface is the camera's, not one seen in a mirror.
override from_camera: bool = true;
// Set if rays that count too little are not followed, except those of the first bounce.
override stops: bool = false;

@compute @workgroup_size(8, 8)
fn mirror_surface(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id.xy, 0);
    // Beyond the first bounce there is a surface only where the mirror before it saw something.
    let is_seen = position.w > 0.0 && (from_camera || textureLoad(from_in, id.xy, 0).w > 0.0);
    var intensity = select(0.0, max(textureLoad(albedo_in, id.xy, 0).a, 0.0), is_seen);
    // Further samples of a perfect mirror are the same as those before, unless it shows a glossy one.
    if from_camera && frame.sample >= settings.reflection.samples && settings.reflection.bounces == 1u && textureLoad(normal_in, id.xy, 0).w <= 0.0 {
        intensity = 0.0;
    }
    if stops && !from_camera && textureLoad(weight_in, id.xy, 0).x < settings.reflection.least_weight {
        intensity = 0.0;
    }
    var eye = vec4f(0.0);
    if from_camera {
        eye.w = dot(position.xyz, frame.forward.xyz);
        eye = vec4f(select(vec3f(0.0), position.xyz - frame.forward.xyz * eye.w, frame.orthographic != 0u), eye.w);
    } else {
        let origin = textureLoad(from_in, id.xy, 0).xyz;
        eye = vec4f(origin, distance(origin, position.xyz));
    }
    textureStore(point_out, id.xy, vec4f(position.xyz, intensity));
    textureStore(eye_out, id.xy, eye);
}
