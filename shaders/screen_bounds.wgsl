// The bounds of a level of the camera's picture: the linear depths between which the planes of a cell's pixels lie.
// Empty pixels are infinitely far. One thread a cell.
#import screen

@group(1) @binding(0) var<storage, read> screen: Screen;
@group(1) @binding(1) var<storage, read> records: array<vec4u>;
@group(1) @binding(2) var<storage, read_write> bounds: array<vec2f>;

// Set for level 1, whose cells hold pixels.
override from_texels: bool = false;

@compute @workgroup_size(8, 8)
fn screen_bounds(@builtin(global_invocation_id) id: vec3u) {
    let view = screen_view();
    let level = i32(screen.level);
    if any(vec2i(id.xy) >= cells_of(view.size, level)) {
        return;
    }
    bounds[index_of_cell(level, vec2i(id.xy))] = bounds_of_cell(view, level, vec2i(id.xy), from_texels);
}
