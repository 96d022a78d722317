// Adds what a surface reflects to its own radiance: by its specular intensity and, where asked for, more of it the flatter the
// line of sight (Schlick 1994). Where a mirror sees no point it shows the background. One thread a pixel.
#import frame
#import packing
#import params

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> settings: Settings;
// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var position_in: texture_2d<f32>;
// xyz: the mirror point that sees the surface, w: its specular intensity, 0 where there is no mirror.
@group(1) @binding(3) var from_in: texture_2d<f32>;
@group(1) @binding(4) var radiance_in: texture_2d<f32>;
// w: coverage of what is reflected.
@group(1) @binding(5) var seen_in: texture_2d<f32>;
@group(1) @binding(6) var reflected_in: texture_2d<f32>;
@group(1) @binding(7) var color_out: texture_storage_2d<rgba16float, write>;

override from_camera: bool = true;
override has_reflection: bool = false;

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
    let albedo = textureLoad(albedo_in, id, 0);
    if has_reflection && albedo.a > 0.0 {
        let normal = textureLoad(normal_in, id, 0).xyz;
        let position = textureLoad(position_in, id, 0).xyz;
        var toward_eye = -position;
        if !from_camera {
            toward_eye = textureLoad(from_in, id, 0).xyz - position;
        } else if frame.orthographic != 0u {
            toward_eye = -frame.forward.xyz;
        }
        let cosine = clamp(dot(normal, toward_eye) * inverseSqrt(max(dot(toward_eye, toward_eye), 1e-30)), 0.0, 1.0);
        let grazing = settings.mirror.fresnel * pow(1.0 - cosine, 5.0);
        let share = albedo.a + (1.0 - albedo.a) * grazing;
        let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
        let found = textureLoad(seen_in, id, 0).w > 0.0;
        let reflected = select(background, textureLoad(reflected_in, id, 0).rgb, found);
        let tint = mix(vec3f(1.0), albedo.rgb, settings.mirror.tint * (1.0 - grazing));
        color = mix(color, reflected * tint, share);
    }
    textureStore(color_out, id, vec4f(color, 1.0));
}
