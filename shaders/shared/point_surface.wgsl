// Colour, normal and material of a point that a pass looks up in a page.
#import page_group
#import color

struct SurfaceOfPoint {
    // a: specular intensity.
    albedo: vec4f,
    // The world normal towards the eye; w: specular power.
    normal: vec4f,
}

// A word of the page's runs: for each run of BLOCK_POINTS points, the item; then, for each run of identities, the
// run of the page that contains it.
fn run_word(at: u32) -> u32 {
    return tables[page.runs_at + at / 4u][at & 3u];
}

// The index in the page of the point with an identity, or a number beyond all pages if it is not in this one.
fn index_of_identity(identity: u32) -> u32 {
    // Pages have whole runs. The sum of points and identity may have more than 32 bits.
    let at = page.point_count / BLOCK_POINTS + identity / BLOCK_POINTS;
    if at >= page.run_count {
        return 0xffffffffu;
    }
    let run = run_word(at);
    return select(run * BLOCK_POINTS + identity % BLOCK_POINTS, 0xffffffffu, run == 0xffffffffu);
}

// The item of a point of the page. A point of an earlier frame may have none any more; it then gets another, not what
// lies beyond the list.
fn item_of_point(index: u32) -> Item {
    return item_at(min(run_word(index / BLOCK_POINTS), page.item_count - 1u));
}

fn surface_of_point(index: u32, toward_eye: vec3f) -> SurfaceOfPoint {
    let item = item_of_point(index);
    // Points are scattered over memory: only what is needed is fetched.
    var point = vec4u(0u);
    let source = item.color_source;
    if source == COLOR_HEIGHT || source == COLOR_CLASS || source == COLOR_STRAY {
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
// not show how distant surfaces slant.
fn distance_to_point(index: u32, origin: vec3f, direction: vec3f, depth: f32, width: f32) -> f32 {
    let item = item_of_point(index);
    let offset = bitcast<vec3f>(points[index].xyz) + item.origin_radius.xyz - origin;
    let normal = unpack_normal(attributes[index].y);
    return depth_beside(depth, dot(normal, offset) / dot(normal, direction), width);
}
