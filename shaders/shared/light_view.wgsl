// Views of where light comes from. Filled by crates/render/src/light_views.rs.

struct LightViews {
    // The layout of maps in square cells, row by row: cells of a row, edge of a cell in pixels, number of cells.
    columns: u32,
    edge: u32,
    count: u32,
    unused: u32,
    // The range of depths of the scene as seen by its viewer: one lamp's map a cell, or x of the camera.
    nearest: vec4f,
    farthest: vec4f,
}

// The background: beside the cells of the maps, and where a map has no surface.
const OUTSIDE: vec3f = vec3f(0.0);
const EMPTY: vec3f = vec3f(0.0, 0.02, 0.2);

// The brightness of the picture under the marks drawn over it.
const DIMMED: f32 = 0.4;

// The pixel at the upper left corner of a cell.
fn cell_corner(views: LightViews, size: vec2u, cell: u32) -> vec2u {
    let rows = (views.count + views.columns - 1u) / views.columns;
    let margin = (size - min(vec2u(views.columns, rows) * views.edge, size)) / 2u;
    return margin + vec2u(cell % views.columns, cell / views.columns) * views.edge;
}

struct Cell {
    // `count` or more if there is no cell.
    index: u32,
    // 0 to 1 from the cell's upper left corner.
    at: vec2f,
}

fn cell_of_pixel(views: LightViews, size: vec2u, pixel: vec2u) -> Cell {
    let first = cell_corner(views, size, 0u);
    let place = (pixel - min(first, pixel)) / views.edge;
    if any(pixel < first) || place.x >= views.columns {
        return Cell(views.count, vec2f(0.0));
    }
    let within = pixel - first - place * views.edge;
    return Cell(place.y * views.columns + place.x, (vec2f(within) + 0.5) / f32(views.edge));
}

// 1 at the nearest distance of a range, 0 at the farthest: linear in doublings of the distance, in parallel views in
// the distance.
fn closeness(distance: f32, nearest: f32, farthest: f32, is_parallel: bool) -> f32 {
    let by_doublings = log2(farthest / distance) / log2(farthest / nearest);
    return clamp(select(by_doublings, (farthest - distance) / (farthest - nearest), is_parallel), 0.0, 1.0);
}
