// How the camera's picture is laid out where rays are walked in it. Filled by
// crates/render/src/reflection/screen_trace.rs.
#import frame_group

struct Screen {
    // The number of levels of bounds.
    levels: u32,
    // The level that a pass makes.
    level: u32,
    // The largest radius of a mirror's splats, in world units.
    mirror_radius: f32,
    // The room of a layer in `records`.
    texels_of_layer: u32,
    // The corners of the box about all points, relative to the eye.
    box_low: vec4f,
    box_high: vec4f,
    // The first cell of each level in `bounds`, from level 1 on.
    first_cells: array<u32>,
}
