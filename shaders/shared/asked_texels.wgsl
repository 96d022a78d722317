// The texels of a page of maps that are traced because a mirror pixel looks at them. Filled by
// crates/render/src/reflection/light_field/asked.rs.
#import cube_faces

struct AskedMaps {
    // Texels along the edge of a face.
    size: u32,
    // The room of a face in the page.
    texels_of_face: u32,
    // The number of the mirror whose maps are traced, which leave its points out.
    mirror: u32,
    unused: u32,
    // For each slot of the page, xyz: the middle of its map, relative to that of the mirror. w: the number of its own mirror.
    middles: array<vec4f>,
}

struct AskedTexel {
    slot: u32,
    face: u32,
    at: vec2u,
}

fn asked_texel(maps: vec2u, number: u32) -> AskedTexel {
    let face = number / maps.y;
    let within = number % maps.y;
    return AskedTexel(face / 6u, face % 6u, vec2u(within % maps.x, within / maps.x));
}
