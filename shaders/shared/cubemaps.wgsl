// Maps of six faces around mirrors, in which rays are walked. Filled by crates/render/src/reflection/cubemap_trace.rs.
// The importing pass binds them as `cubes`, `records` and `bounds`.
#import depth_walk

// The maps. xyz of `places`: the middle of each, relative to the eye.
struct Cubes {
    // Texels along the edge of a face.
    size: u32,
    // The same, rounded up to a power of two.
    padded_size: u32,
    // The room of a face in `records`.
    texels_of_face: u32,
    // The number of levels of bounds.
    levels: u32,
    // The number of maps.
    maps: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
    places: array<vec4f>,
}

// A face of a map as a picture: faces 0 to 2 look along an axis, 3 to 5 against it; the two axes after it point right
// and up, see face_camera of crates/render/src/reflection/environment_map.rs.
fn face_of(map: u32, face: u32) -> DepthView {
    var axes = array<vec3f, 3>(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
    let forward = select(-1.0, 1.0, face < 3u) * axes[face % 3u];
    let size = i32(cubes.size);
    return DepthView(
        cubes.places[map].xyz, axes[(face + 1u) % 3u], axes[(face + 2u) % 3u], forward, vec2i(size), 0.5 * f32(size),
        false, map * 6u + face, i32(cubes.levels),
    );
}

fn said_at(view: DepthView, ray: WalkRay, at: vec2i, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    return said_by_texel(view, ray, at, part, starts, choices);
}

fn index_of_texel(picture: u32, texel: vec2i) -> u32 {
    return picture * cubes.texels_of_face + u32(texel.y) * cubes.size + u32(texel.x);
}

// Levels have their room one after the other, in rows of a power of two.
fn index_of_cell(picture: u32, level: i32, cell: vec2i) -> u32 {
    let whole = cubes.padded_size * cubes.padded_size;
    let finer = cubes.padded_size >> u32(level - 1);
    let row = cubes.padded_size >> u32(level);
    return (picture * (whole - 1u) + whole - finer * finer) / 3u + u32(cell.y) * row + u32(cell.x);
}
