// The records of a face of a cubemap, or of a layer of the picture: the disc of the nearest point of each texel, so
// that rays need no page of the store. Runs once for each page and takes the texels whose point lies in it; the first
// page also writes the empty ones. The frame is that of the face or the picture. One thread a texel.
#import texel_of_point

// x: identity of the texel's nearest point. y: nearness, 0: empty.
@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
@group(2) @binding(1) var<storage, read_write> records: array<vec4u>;

@compute @workgroup_size(8, 8)
fn cube_planes(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let pixel = id.y * frame.width + id.x;
    let key = nearest[pixel];
    if key.y == 0u {
        if page.is_first == 1u {
            records[pixel] = vec4u(0u);
        }
        return;
    }
    let index = index_of_identity(key.x);
    if index >= page.point_count {
        return;
    }
    let texel = texel_of_point(frame, item_of_point(index), index, key.x, depth_from_nearness(key.y), vec2f(id.xy) + 0.5);
    records[pixel] = pack_texel(texel);
}
