// The Mirror G-Buffer from mirrored viewpoints: each mirror pixel takes what the mirrored eye of its mirror sees at the
// same pixel. Runs once for each page of the point store and takes the pixels whose point lies in it; the first page
// also writes the pixels that see nothing. One thread a pixel.
#import mirror_places
#import point_surface

@group(2) @binding(0) var point_in: texture_2d<f32>;
// x: identity of the pixel's nearest point. y: nearness, 0: empty.
@group(2) @binding(1) var<storage, read> maps: array<vec2u>;
@group(2) @binding(2) var<storage, read> mirrors: MappedMirrors;
@group(2) @binding(3) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(2) @binding(4) var normal_out: texture_storage_2d<rgba32float, write>;
// xyz: position relative to the eye, w: 1, or 0 where nothing was found.
@group(2) @binding(5) var position_out: texture_storage_2d<rgba32float, write>;
// A look-up takes no steps.
@group(2) @binding(6) var views_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn mirrored_look_up(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height || textureLoad(point_in, id, 0).w == 0.0 {
        return;
    }
    let mirror = mirror_at(textureLoad(point_in, id, 0).xyz);
    var key = vec2u(0u);
    if mirror.low_map.w >= 0.0 {
        // Pictures start at multiples of 32 texels.
        let stride = (frame.width * frame.height + 31u) / 32u * 32u;
        key = maps[u32(mirror.low_map.w) * stride + id.y * frame.width + id.x];
    }
    var albedo = vec4f(0.0);
    var normal = vec4f(0.0);
    var position = vec4f(0.0);
    var is_ours = page.is_first == 1u;
    if key.y != 0u {
        let index = index_of_identity(key.x);
        is_ours = index < page.point_count;
        if is_ours {
            // The mirrored eye's line through the pixel, of linear depth 1.
            let at = vec2f(id) + 0.5;
            let start = view_from_pixel(frame, at, 0.0);
            let plane = mirror.view;
            let eye_side = world_direction(frame, start);
            let origin = eye_side - 2.0 * plane.xyz * (dot(plane.xyz, eye_side) - plane.w);
            let direction = reflect(world_direction(frame, view_from_pixel(frame, at, 1.0) - start), plane.xyz);
            let depth = depth_from_nearness(key.y);
            let width = 1.0 / pixels_per_unit(frame, depth);
            position = vec4f(origin + direction * distance_to_point(index, origin, direction, depth, width), 1.0);
            let surface = surface_of_point(index, -normalize(direction));
            albedo = surface.albedo;
            normal = surface.normal;
        }
    }
    if is_ours {
        textureStore(albedo_out, id, albedo);
        textureStore(normal_out, id, normal);
        textureStore(position_out, id, position);
        textureStore(views_out, id, vec4f(0.0));
    }
}
