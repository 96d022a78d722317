// The bounds of a level of the faces of cubemaps: the linear depths between which the planes of a cell's texels lie.
// Empty texels are infinitely far. One thread a cell; x and y in the face, z the face.
#import frame_group
#import cubemaps

@group(1) @binding(0) var<storage, read> cubes: Cubes;
@group(1) @binding(1) var<storage, read> records: array<vec4u>;
@group(1) @binding(2) var<storage, read_write> bounds: array<vec2f>;
@group(1) @binding(3) var<storage, read> work: CubeLevel;

struct CubeLevel {
    level: u32,
    unused_1: u32,
    unused_2: u32,
    unused_3: u32,
}

// Set for level 1, whose cells hold texels.
override from_texels: bool = false;

@compute @workgroup_size(8, 8)
fn cube_bounds(@builtin(global_invocation_id) id: vec3u) {
    let level = i32(work.level);
    let cells = cells_of(vec2i(i32(cubes.size)), level);
    if any(vec2i(id.xy) >= cells) || id.z >= 6u * cubes.maps {
        return;
    }
    let both = bounds_of_cell(face_of(id.z / 6u, id.z % 6u), level, vec2i(id.xy), from_texels);
    bounds[index_of_cell(id.z, level, vec2i(id.xy))] = both;
}

fn texel_record(picture: u32, texel: vec2i) -> vec4u {
    return records[index_of_texel(picture, texel)];
}

fn cell_bounds(picture: u32, level: i32, cell: vec2i) -> vec2f {
    return bounds[index_of_cell(picture, level, cell)];
}
