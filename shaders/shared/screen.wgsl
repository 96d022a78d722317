// The camera's picture as one in which rays are walked. Filled by crates/render/src/reflection/screen_trace.rs. The
// importing pass binds `screen`, `records` and `bounds`.
#import frame_group
#import depth_walk
#import hit

struct Screen {
    // The number of levels of bounds.
    levels: u32,
    // The level that a pass makes.
    level: u32,
    // The largest radius of a mirror's splats, in world units.
    mirror_radius: f32,
    unused: u32,
    // The first cell of each level in `bounds`, from level 1 on.
    first_cells: array<u32>,
}

fn screen_view() -> DepthView {
    return DepthView(
        vec3f(0.0), frame.right.xyz, frame.up.xyz, frame.forward.xyz, vec2i(i32(frame.width), i32(frame.height)),
        frame.focal_pixels, frame.orthographic != 0u, 0u, i32(screen.levels),
    );
}

fn index_of_cell(level: i32, cell: vec2i) -> u32 {
    let columns = cells_of(vec2i(i32(frame.width), i32(frame.height)), level).x;
    return screen.first_cells[level - 1] + u32(cell.y * columns + cell.x);
}

fn texel_record(picture: u32, texel: vec2i) -> vec4u {
    return records[u32(texel.y) * frame.width + u32(texel.x)];
}

fn cell_bounds(picture: u32, level: i32, cell: vec2i) -> vec2f {
    return bounds[index_of_cell(level, cell)];
}

fn said_at(view: DepthView, ray: WalkRay, at: vec2i, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    // A ray may begin on a surface that is seen edge-on.
    if starts && (texel_record(0u, at).x & EDGE_ON) != 0u {
        return Walk(WALK_ON, 0.0, 0u, 0u);
    }
    return said_by_texel(view, ray, at, part, starts, choices);
}
