// The index of refraction of the point that each mirror pixel's ray has found. Runs once for each page of the point
// store and takes the pixels whose point lies in it; the first page also writes the empty pixels. One thread a pixel.
#import point_surface

// y: identity + 1, 0: nothing; see surfel_trace.wgsl.
@group(2) @binding(0) var<storage, read> hits: array<vec4u>;
// -1 for an opaque mirror, 0 for no mirror.
@group(2) @binding(1) var index_out: texture_storage_2d<r32float, write>;

@compute @workgroup_size(8, 8)
fn clear_hits(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let hit = hits[id.y * frame.width + id.x];
    var refraction = 0.0;
    var is_ours = page.is_first == 1u;
    if hit.y != 0u {
        let index = index_of_identity(hit.y - 1u);
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
