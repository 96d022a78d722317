// Cells of space: the reflected rays of each mirror in a tree of planes, at whose leaves pinholes or lists of rays
// project the points (Popescu, Sacks and Mei 2006). crates/render/src/reflection/sample_cameras/tree.rs makes them.

struct CameraTrees {
    // The pixel of the first ray, and the number of rays.
    first_x: u32,
    first_y: u32,
    columns: u32,
    rows: u32,
    // The distance of rays in pixels, and the number of trees: one a mirror.
    stride: u32,
    trees: u32,
    // The number of nodes, which the cells follow.
    nodes: u32,
    unused: u32,
    // The eye less the one to which the trees are relative.
    shift: vec4f,
}

struct CameraNode {
    // xyz: the unit normal of a plane. w: its distance from the eye.
    plane: vec4f,
    // What lies before and behind it: nodes, or leaves with CAMERA_LEAF. The first nodes are those over the trees.
    above: u32,
    below: u32,
    unused_1: u32,
    unused_2: u32,
}

const CAMERA_LEAF: u32 = 0x80000000u;

// Leaves by what projects: nothing, a pinhole, or a list of rays.
const CAMERA_OPEN: u32 = 0u;
const CAMERA_PINHOLE: u32 = 1u;
const CAMERA_LIST: u32 = 2u;

struct CameraLeaf {
    kind: u32,
    // Of a list: its cells, and the leaf with those of its rays that go elsewhere; 0 if there are none.
    first: u32,
    count: u32,
    next: u32,
    // xyz: the middle of the rays' tails, relative to the eye.
    middle: vec4f,
    // xyz: their mean direction.
    axis: vec4f,
    // A pinhole takes the place (u, v), from -1 to 1 over its rays, for a point p beside the middle: with q = (p, 1),
    // u = dot(by_u, q) / dot(depth, q), and v alike.
    by_u: vec4f,
    by_v: vec4f,
    depth: vec4f,
    // Pixels as factors of (1, u), (v, u u), (u v, v v).
    factors_0: vec4f,
    factors_1: vec4f,
    factors_2: vec4f,
}

struct CameraRay {
    // xyz: the mirror point relative to the eye. w: column of the pixel's middle.
    point: vec4f,
    // xyz: the direction. w: row.
    direction: vec4f,
}
