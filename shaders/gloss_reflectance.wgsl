// How much a glossy mirror reflects of what its ray receives, by the lobe of Ashikhmin and Shirley (2000), over the share
// that it reflects by its normal. Directions are drawn in proportion to the lobe, so that what is left is the share by the
// drawn normal, times min(1, n.l / n.v): below the surface 0. One thread a pixel.
#import frame_group
#import brdf

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: origin of the ray.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// The normals by which rays are reflected.
@group(1) @binding(3) var drawn_in: texture_2d<f32>;
@group(1) @binding(4) var reflectance_out: texture_storage_2d<r32float, write>;

// Set if the share that mirrors reflect is the published one of the angle.
override is_published: bool = false;

@compute @workgroup_size(8, 8)
fn gloss_reflectance(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    let surface = textureLoad(normal_in, id, 0);
    var reflectance = 1.0;
    if point.w > 0.0 && surface.w > 0.0 {
        let normal = normalize(surface.xyz);
        let drawn = normalize(textureLoad(drawn_in, id, 0).xyz);
        let incoming = normalize(point.xyz - textureLoad(eye_in, id, 0).xyz);
        let from_view = abs(dot(incoming, normal));
        let share = mirror_share(point.w, grazing_share(settings, from_view, is_published), is_published);
        let from_drawn = grazing_share(settings, abs(dot(incoming, drawn)), is_published);
        // A normal on the far side leads below the surface.
        let height = dot(reflect(incoming, drawn), normal) / max(from_view, 1e-6);
        reflectance = mirror_share(point.w, from_drawn, is_published) / max(share, 1e-6) * clamp(height, 0.0, 1.0);
    }
    textureStore(reflectance_out, id, vec4f(reflectance));
}
