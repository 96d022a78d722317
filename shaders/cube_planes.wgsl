// The records of a face of a cubemap, or of a layer of the picture: the disc of the nearest point of each texel, so
// that rays need no page of the store. Runs once for each page and takes the texels whose point lies in it; the first
// page also writes the empty ones. The frame is that of the face or the picture. One thread a texel.
#import point_surface
#import depth_texel

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
    let item = item_of_point(index);
    let point = points[index];
    let place = vec2f(id.xy) + 0.5;
    let eye = view_from_pixel(frame, place, 0.0);
    let origin = world_direction(frame, eye);
    let sight = world_direction(frame, view_from_pixel(frame, place, 1.0) - eye);
    let center = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let own = unpack_normal(attributes[index].y);
    let cosine = dot(own, normalize(sight));
    let has_slope = abs(cosine) >= LEAST_COSINE;
    let normal = select(-normalize(sight), select(own, -own, cosine > 0.0), has_slope);
    let depth = depth_from_nearness(key.y);
    let is_parallel = frame.orthographic != 0u;
    let width = select(depth, 1.0, is_parallel) / frame.focal_pixels;
    // The nearest point of a texel may lie beside its middle.
    let plane = select(depth, dot(own, center - origin) / dot(own, sight), has_slope);
    let in_view = view_from_relative(frame, center);
    // A disc is drawn with at least a texel.
    let disc = disc_of_point(frame, settings.splat, item, point);
    let radius = select(disc.radius, 0.5 * select(in_view.z, 1.0, is_parallel) / frame.focal_pixels, disc.radius_pixels == 0.0);
    let middle = pixel_from_view(frame, in_view) - place;
    let texel = DepthTexel(key.x, depth_beside(depth, plane, width), normal, radius / width, middle);
    records[pixel] = pack_texel(texel);
}
