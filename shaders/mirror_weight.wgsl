// How much the rays that leave the mirrors of a surface count in the picture: the product of what the mirrors on their way
// reflect (Johnsson 2012). The many rays of a pixel of a glossy mirror have the weight of one, since what all of them leave
// out adds up. One thread a pixel.
#import frame_group
#import brdf

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
// x: how much the rays that arrive count.
@group(1) @binding(4) var weight_in: texture_2d<f32>;
// x: how far the ray that arrives goes, in mirror radii.
@group(1) @binding(5) var left_in: texture_2d<f32>;
@group(1) @binding(6) var reflectance_in: texture_2d<f32>;
@group(1) @binding(7) var weight_out: texture_storage_2d<r32float, write>;

override from_camera: bool = true;
// Set if the share that mirrors reflect is the published one of the angle.
override is_published: bool = false;
// Set if reflections fade by distance.
override fades: bool = false;
// Set if not all that rays receive is reflected, see gloss_reflectance.wgsl.
override has_reflectance: bool = false;

@compute @workgroup_size(8, 8)
fn mirror_weight(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let from_point = textureLoad(from_in, id, 0);
    let albedo = textureLoad(albedo_in, id, 0);
    var weight = 0.0;
    if albedo.a > 0.0 && (from_camera || from_point.w > 0.0) {
        let to_eye = toward_viewer(frame, textureLoad(position_in, id, 0).xyz, from_camera, from_point.xyz);
        let grazing = grazing_share(settings, dot(textureLoad(normal_in, id, 0).xyz, to_eye), is_published);
        let tint = mirror_tint(settings, albedo.rgb, select(grazing, 0.0, is_published));
        weight = mirror_share(albedo.a, grazing, is_published) * max(tint.r, max(tint.g, tint.b));
        if !from_camera {
            weight *= textureLoad(weight_in, id, 0).x;
        }
        if fades {
            let reach = textureLoad(left_in, id, 0).x;
            weight *= share_left(settings.mirror.fade_distance, settings.mirror.fade_least, reach);
        }
        if has_reflectance {
            weight *= textureLoad(reflectance_in, id, 0).x;
        }
    }
    textureStore(weight_out, id, vec4f(weight));
}
