// Adds indirect light to direct light, and a mirror's reflection to its own radiance, which the shading passes have
// already reduced. A mirror that sees no point shows the background. One thread a pixel.
#import frame_group
#import packing
#import brdf

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var radiance_in: texture_2d<f32>;
// w: coverage of the reflected surface.
@group(1) @binding(5) var seen_in: texture_2d<f32>;
@group(1) @binding(6) var reflected_in: texture_2d<f32>;
// The indirect light of the surface itself.
@group(1) @binding(7) var indirect_in: texture_2d<f32>;
@group(1) @binding(8) var color_out: texture_storage_2d<rgba16float, write>;
// x: how far the mirror's ray goes, in mirror radii.
@group(1) @binding(9) var left_in: texture_2d<f32>;
@group(1) @binding(10) var reflectance_in: texture_2d<f32>;
// w: 0 where no ray is followed from a mirror.
@group(1) @binding(11) var rays_in: texture_2d<f32>;

override from_camera: bool = true;
override has_reflection: bool = false;
// Set if only some rays are followed.
override stops: bool = false;
override has_indirect: bool = false;
// Set if `reflected_in` has what arrives at each mirror pixel, the background included (gloss_sum.wgsl).
override is_received: bool = false;
// Set if the share that mirrors reflect is the published one of the angle.
override is_published: bool = false;
// Set if reflections fade by distance and have not yet.
override fades: bool = false;
// Set if not all that rays receive is reflected, see gloss_reflectance.wgsl.
override has_reflectance: bool = false;

@compute @workgroup_size(8, 8)
fn blend(@builtin(global_invocation_id) thread: vec3u) {
    var id = thread.xy;
    if !from_camera {
        id = mirror_pixel(frame, thread);
    }
    if id.x >= frame.width || id.y >= frame.height || (!from_camera && textureLoad(from_in, id, 0).w == 0.0) {
        return;
    }
    var color = textureLoad(radiance_in, id, 0).rgb;
    if has_indirect {
        color += textureLoad(indirect_in, id, 0).rgb;
    }
    let albedo = textureLoad(albedo_in, id, 0);
    if has_reflection && albedo.a > 0.0 && (!stops || textureLoad(rays_in, id, 0).w > 0.0) {
        var mirror_point = vec3f(0.0);
        if !from_camera {
            mirror_point = textureLoad(from_in, id, 0).xyz;
        }
        let to_eye = toward_viewer(frame, textureLoad(position_in, id, 0).xyz, from_camera, mirror_point);
        let grazing = grazing_share(settings, dot(textureLoad(normal_in, id, 0).xyz, to_eye), is_published);
        let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
        let found = is_received || textureLoad(seen_in, id, 0).w > 0.0;
        let reflected = select(background, textureLoad(reflected_in, id, 0).rgb, found);
        var share = mirror_share(albedo.a, grazing, is_published);
        if fades {
            let reach = textureLoad(left_in, id, 0).x;
            share *= share_left(settings.mirror.fade_distance, settings.mirror.fade_least, reach);
        }
        if has_reflectance {
            share *= textureLoad(reflectance_in, id, 0).x;
        }
        // The published law knows no tint.
        color += share * mirror_tint(settings, albedo.rgb, select(grazing, 0.0, is_published)) * reflected;
    }
    textureStore(color_out, id, vec4f(color, 1.0));
}
