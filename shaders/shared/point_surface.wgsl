// Colour, normal and material of a point that a pass looks up in a page.
#import page_group
#import color

// Item of each run of BLOCK_POINTS points of the page.
@group(1) @binding(5) var<storage, read> items_of_runs: array<u32>;

struct SurfaceOfPoint {
    // a: specular intensity.
    albedo: vec4f,
    // World, towards the eye; w: specular power.
    normal: vec4f,
}

// Where the point with an identity lies in the page, or a number that no page has room for. Behind the items of the page's runs
// of BLOCK_POINTS points, `items_of_runs` tells for each run of identities which run of the page it is.
fn index_of_identity(identity: u32) -> u32 {
    let at = (page.point_count + identity) / BLOCK_POINTS;
    if at >= arrayLength(&items_of_runs) || items_of_runs[at] == 0xffffffffu {
        return 0xffffffffu;
    }
    return items_of_runs[at] * BLOCK_POINTS + identity % BLOCK_POINTS;
}

fn surface_of_point(index: u32, toward_eye: vec3f) -> SurfaceOfPoint {
    let item = items[items_of_runs[index / BLOCK_POINTS]];
    // Points lie all over memory: what is not asked for is not fetched.
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
