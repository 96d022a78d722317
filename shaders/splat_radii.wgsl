// The radius of the splat of each pixel's nearest point, for eye-dome lighting. Runs once for each page of the point
// store and takes the pixels whose point lies in it; the first page also writes the empty pixels. One thread a pixel.
#import point_surface

@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
// In world units, after the limits in pixels; 0 if empty.
@group(2) @binding(1) var radius_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn splat_radii(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let key = nearest[id.y * frame.width + id.x];
    var radius = 0.0;
    var is_ours = page.is_first == 1u;
    if key.y != 0u {
        let index = index_of_identity(key.x);
        is_ours = index < page.point_count;
        if is_ours {
            let item = item_of_point(index);
            radius = disc_of_point(frame, settings.splat, item, points[index]).radius;
        }
    }
    if is_ours {
        textureStore(radius_out, id.xy, vec4f(radius));
    }
}
