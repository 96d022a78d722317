// The texel of a picture of depths whose nearest point is known.
#import point_surface
#import depth_texel

// `view` is the picture, and the places of `item` are relative to its eye; `index` is that of the point in the page,
// `place` the middle of the texel.
fn texel_of_point(view: Frame, item: Item, index: u32, identity: u32, depth: f32, place: vec2f) -> DepthTexel {
    let point = points[index];
    let eye = view_from_pixel(view, place, 0.0);
    let origin = world_direction(view, eye);
    let sight = world_direction(view, view_from_pixel(view, place, 1.0) - eye);
    let center = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let own = unpack_normal(attributes[index].y);
    let cosine = dot(own, normalize(sight));
    let has_slope = abs(cosine) >= LEAST_COSINE;
    let normal = select(-normalize(sight), select(own, -own, cosine > 0.0), has_slope);
    let is_parallel = view.orthographic != 0u;
    let width = select(depth, 1.0, is_parallel) / view.focal_pixels;
    // The nearest point of a texel may lie beside its middle.
    let plane = select(depth, dot(own, center - origin) / dot(own, sight), has_slope);
    let in_view = view_from_relative(view, center);
    // A disc is drawn with at least a texel.
    let disc = disc_of_point(view, settings.splat, item, point);
    let radius = select(disc.radius, 0.5 * select(in_view.z, 1.0, is_parallel) / view.focal_pixels, disc.radius_pixels == 0.0);
    let middle = pixel_from_view(view, in_view) - place;
    return DepthTexel(identity, depth_beside(depth, plane, width), normal, radius / width, middle);
}
