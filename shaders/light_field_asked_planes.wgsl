// The records of listed texels of a mirror's maps, whose nearest points are known: the texels whose point lies in the
// page of points. The first page also marks those in which nothing is. One thread a texel.
#import texel_of_point
#import asked_texels

@group(2) @binding(0) var<storage, read> maps: AskedMaps;
@group(2) @binding(1) var<storage, read> asked: array<u32>;
// See light_field_asked_trace.wgsl.
@group(2) @binding(2) var<storage, read> found: array<vec2u>;
@group(2) @binding(3) var<storage, read_write> records: array<vec4u>;

@compute @workgroup_size(8, 8)
fn light_field_asked_planes(@builtin(global_invocation_id) thread: vec3u, @builtin(num_workgroups) groups: vec3u) {
    let entry = list_entry(thread, groups.x);
    if entry >= min(asked[0], arrayLength(&asked) - 1u) {
        return;
    }
    let number = asked[1u + entry];
    let texel = asked_texel(vec2u(maps.size, maps.texels_of_face), number);
    let middle = maps.middles[texel.slot];
    if u32(middle.w) != maps.mirror {
        return;
    }
    let nearest = found[entry];
    if nearest.x == 0u {
        if page.is_first == 1u {
            records[number] = vec4u(0u, 0u, 1u, 0u);
        }
        return;
    }
    let index = index_of_identity(nearest.x - 1u);
    if index >= page.point_count {
        return;
    }
    let face = cube_face(middle.xyz, maps.size, texel.face, 0u, 0);
    var view = frame;
    view.right = vec4f(face.right, 0.0);
    view.up = vec4f(face.up, 0.0);
    view.forward = vec4f(face.forward, 0.0);
    view.focal_pixels = face.focal;
    view.orthographic = 0u;
    view.width = maps.size;
    view.height = maps.size;
    var item = item_of_point(index);
    item.origin_radius -= vec4f(middle.xyz, 0.0);
    let place = vec2f(texel.at) + 0.5;
    records[number] = pack_texel(texel_of_point(view, item, index, nearest.x - 1u, bitcast<f32>(nearest.y), place));
}
