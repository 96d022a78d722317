// Colour, normal and material of a point that a pass looks up in a page.
#import page_group
#import color

// The item of each run of BLOCK_POINTS points of the page.
@group(1) @binding(5) var<storage, read> items_of_runs: array<u32>;

struct SurfaceOfPoint {
    // a: specular intensity.
    albedo: vec4f,
    // The world normal towards the eye; w: specular power.
    normal: vec4f,
}

// The index in the page of the point with an identity, or a number beyond all pages if it is not in this one. After the
// items of the page's runs of BLOCK_POINTS points, `items_of_runs` has for each run of identities the run of the page
// that contains it.
fn index_of_identity(identity: u32) -> u32 {
    // Pages have whole runs. The sum of points and identity may have more than 32 bits.
    let at = page.point_count / BLOCK_POINTS + identity / BLOCK_POINTS;
    if at >= arrayLength(&items_of_runs) || items_of_runs[at] == 0xffffffffu {
        return 0xffffffffu;
    }
    return items_of_runs[at] * BLOCK_POINTS + identity % BLOCK_POINTS;
}

// The item of a point of the page. A point of an earlier frame may have none any more; it then gets another, not what
// lies beyond the list.
fn item_of_point(index: u32) -> Item {
    return items[min(items_of_runs[index / BLOCK_POINTS], arrayLength(&items) - 1u)];
}

fn surface_of_point(index: u32, toward_eye: vec3f) -> SurfaceOfPoint {
    let item = item_of_point(index);
    // Points are scattered over memory: only what is needed is fetched.
    var point = vec4u(0u);
    if item.color_source == COLOR_HEIGHT || item.color_source == COLOR_CLASS {
        point = points[index];
    }
    let color_normal = attributes[index];
    let own = unpack_normal(color_normal.y);
    let outward = select(own, -own, dot(own, toward_eye) < 0.0);
    let normal = select(outward, toward_eye, all(own == vec3f(0.0)));
    let albedo = albedo_of_point(item, index, point, color_normal);
    return SurfaceOfPoint(vec4f(albedo, item.specular_intensity), vec4f(normal, item.specular_power));
}

// The distance along a line to the plane of a point of the page; or `depth`, which the map has for the texel's middle,
// if the point has no normal or is seen edge-on. A texel is `width` world units wide there. The map's depth alone does
// not tell how distant surfaces slant.
fn distance_to_point(index: u32, origin: vec3f, direction: vec3f, depth: f32, width: f32) -> f32 {
    let item = item_of_point(index);
    let offset = bitcast<vec3f>(points[index].xyz) + item.origin_radius.xyz - origin;
    let normal = unpack_normal(attributes[index].y);
    return depth_beside(depth, dot(normal, offset) / dot(normal, direction), width);
}
