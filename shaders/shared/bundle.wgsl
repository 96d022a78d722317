// Bundles of reflected rays: the mirror pixels of a square of the picture, as polynomials (after Popescu, Sacks and Mei
// 2006, whose sample-based cameras part space instead). Squares form a complete quadtree for each root of a grid: the
// four parts of square i of a level are the squares 4 i to 4 i + 3 of the next. CPU twin:
// crates/render/src/reflection/sample_cameras/twin.rs.

struct BundleGrid {
    // The pixel at the corner of the first root.
    first_x: u32,
    first_y: u32,
    // The number of roots.
    columns: u32,
    rows: u32,
    // The number of the finest level, and that of the level that a pass makes; roots are level 0.
    last_level: u32,
    level: u32,
    // The edge of a root, and the distance of rays, in pixels: powers of two.
    largest: u32,
    stride: u32,
    // The box about all points, relative to the eye; rays end there.
    scene_low: vec4f,
    scene_high: vec4f,
}

// What the descent reads of a square: bounds of its rays, of the form of `Beam`.
struct BundleNode {
    // w: NODE_*.
    origin_low: vec4f,
    origin_high: vec4f,
    direction_low: vec4f,
    direction_high: vec4f,
}

// No mirror in the square, or its parent is not divided.
const NODE_EMPTY: f32 = 0.0;
// The four parts of the square stand for it.
const NODE_DIVIDED: f32 = 1.0;
// The bundle of the square stands for its pixels.
const NODE_LEAF: f32 = 2.0;

// The rays of a square, in a frame across their mean direction: the ray of a place p of the square, from -1 to 1, meets
// the plane z = 0 of the frame at t(p) and goes along (k(p), 1).
struct Bundle {
    // xyz: the origin of the frame, relative to the eye. w: the least z of a point that is reflected.
    middle: vec4f,
    // xyz: the mean direction. w: the largest z.
    axis: vec4f,
    // xy: the middle of the square in pixels. z: half its edge. w: 1 if rays are farther off than the accuracy.
    square: vec4f,
    // xy: t, zw: k. The factors of 1, x, y, xx, xy, yy, xxx, xxy, xyy, yyy.
    coefficients: array<vec4f, 10>,
}

// Rays that go along the mean direction by less than this have no place in its frame.
const LEAST_ALONG: f32 = 0.15;

// The vectors across a direction that span the frame.
struct Across {
    x: vec3f,
    y: vec3f,
}

fn across_axis(axis: vec3f) -> Across {
    let size = abs(axis);
    var side = vec3f(0.0, 0.0, 1.0);
    if size.x <= size.y && size.x <= size.z {
        side = vec3f(1.0, 0.0, 0.0);
    } else if size.y <= size.z {
        side = vec3f(0.0, 1.0, 0.0);
    }
    let x = normalize(cross(axis, side));
    return Across(x, cross(axis, x));
}

// The index of a level's first square.
fn first_of_level(grid: BundleGrid, level: u32) -> u32 {
    return grid.columns * grid.rows * (((1u << (2u * level)) - 1u) / 3u);
}

// The corner of a square in pixels.
fn corner_of(grid: BundleGrid, level: u32, index: u32) -> vec2u {
    let root = index >> (2u * level);
    var place = vec2u(root % grid.columns, root / grid.columns);
    for (var down = level; down > 0u; down--) {
        let part = index >> (2u * (down - 1u));
        place = 2u * place + vec2u(part & 1u, (part >> 1u) & 1u);
    }
    return vec2u(grid.first_x, grid.first_y) + place * (grid.largest >> level);
}

// A ray in the frame of a bundle: where it meets the plane z = 0, and its slope.
fn ray_in_frame(middle: vec3f, axis: vec3f, across: Across, point: vec3f, direction: vec3f) -> vec4f {
    let offset = point - middle;
    let along = dot(direction, axis);
    let slope = vec2f(dot(direction, across.x), dot(direction, across.y)) / along;
    return vec4f(vec2f(dot(offset, across.x), dot(offset, across.y)) - dot(offset, axis) * slope, slope);
}
