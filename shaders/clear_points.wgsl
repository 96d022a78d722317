// The index of refraction of each pixel's nearest point. Runs once for each page of the point store and takes the
// pixels whose point lies in it; the first page also writes the empty pixels. One thread a pixel.
#import point_surface

@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
// -1 for an opaque mirror, 0 for no mirror.
@group(2) @binding(1) var index_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn clear_points(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let key = nearest[id.y * frame.width + id.x];
    var refraction = 0.0;
    var is_ours = page.is_first == 1u;
    if key.y != 0u {
        let index = index_of_identity(key.x);
        is_ours = index < page.point_count;
        if is_ours {
            let item = item_of_point(index);
            let opaque = select(0.0, -1.0, item.specular_intensity > 0.0);
            refraction = select(opaque, item.height_axis.w, item.height_axis.w > 0.0);
        }
    }
    if is_ours {
        textureStore(index_out, id.xy, vec4f(refraction));
    }
}
