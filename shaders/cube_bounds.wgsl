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
    let cells = cells_along(level);
    let finer = cells_along(level - 1);
    if i32(id.x) >= cells || i32(id.y) >= cells || id.z >= 6u * cubes.maps {
        return;
    }
    let view = face_of(id.z / 6u, id.z % 6u);
    var both = vec2f(NEVER, 0.0);
    for (var i = 0; i < 4; i++) {
        let at = vec2i(id.xy) * 2 + vec2i(i & 1, i >> 1u);
        if all(at < vec2i(finer)) {
            var part = vec2f(0.0);
            if from_texels {
                part = bounds_of_texel(view, at, texel_record(id.z, at));
            } else {
                part = cell_bounds(id.z, level - 1, at);
            }
            both = vec2f(min(both.x, part.x), max(both.y, part.y));
        }
    }
    bounds[index_of_cell(id.z, level, vec2i(id.xy))] = both;
}

fn cells_along(level: i32) -> i32 {
    return (i32(cubes.size) + (1 << u32(level)) - 1) >> u32(level);
}

fn texel_record(picture: u32, texel: vec2i) -> vec4u {
    return records[index_of_texel(picture, texel)];
}

fn cell_bounds(picture: u32, level: i32, cell: vec2i) -> vec2f {
    return bounds[index_of_cell(picture, level, cell)];
}
