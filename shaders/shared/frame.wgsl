// The camera and the screen, the same for every pass. Filled by crates/render/src/frame.rs.
// View space: x right, y up, z forward, so z is the linear depth. Positions reach the GPU relative to the eye.
struct Frame {
    // Rows of view_from_world; w unused.
    right: vec4f,
    up: vec4f,
    forward: vec4f,
    // A plane; in passes that test it, only points in front of it are visible. xyz: unit normal. w: its product with a
    // place on the plane, relative to the eye.
    clip: vec4f,
    // xyz: the unit vector that points up in the world.
    world_up: vec4f,
    // Perspective: pixels per unit of tangent. Orthographic: pixels per world unit.
    focal_pixels: f32,
    orthographic: u32,
    width: u32,
    height: u32,
    // Nothing nearer than this is drawn, in world units. Negative where that counts as lying as far as this is below 0.
    near: f32,
    // Orthographic: the pivot's distance, to which depth differences are compared, since depths themselves depend on
    // where along the line of sight the eye was put. Perspective: 0.
    reference_depth: f32,
    // The radius of what is drawn in world units.
    scene_radius: f32,
    // The tiles of 8 x 8 pixels: column | row << 16 of the first one in which a mirror may be seen.
    mirror_tile: u32,
    // The first row of workgroups that this dispatch runs, where a pass is cut into several; the first block of the list
    // that is bound, where a pass over points is.
    first_row: u32,
    // The number of the glossy sample that the pass works for, and that of all samples; 0 of 0 for perfect mirrors.
    sample: u32,
    samples: u32,
    // The number of the look that the pass works for, where what several maps show is blended (light_field_look_up.wgsl).
    look: u32,
    // The first column of workgroups that this dispatch runs, and the number of columns of the whole pass, where a pass is
    // cut by rows and columns.
    first_column: u32,
    columns: u32,
    unused_0: u32,
    unused_1: u32,
}

// The thread of the whole pass that a thread of a dispatch is, in passes with workgroups of 8 x 8 that are cut by rows and
// columns.
fn whole_thread(frame: Frame, thread: vec3u) -> vec3u {
    return thread + 8u * vec3u(frame.first_column, frame.first_row, 0u);
}

// The entry of a list of rays that a thread of a pass takes whose `columns` of workgroups of 8 x 8 walk such a list.
fn list_entry(thread: vec3u, columns: u32) -> u32 {
    return (thread.y / 8u * columns + thread.x / 8u) * 64u + thread.y % 8u * 8u + thread.x % 8u;
}

// The pixel of a thread of a pass that runs over the tiles where mirrors may be seen.
fn mirror_pixel(frame: Frame, thread: vec3u) -> vec2u {
    return thread.xy + 8u * vec2u(frame.mirror_tile & 0xffffu, frame.mirror_tile >> 16u);
}

// The distance of `far` behind `near`, as a share of the depth at which it is seen.
fn depth_step(frame: Frame, near: f32, far: f32) -> f32 {
    return (far - near) / select(near, frame.reference_depth, frame.orthographic != 0u);
}

fn view_from_relative(frame: Frame, relative: vec3f) -> vec3f {
    return vec3f(dot(frame.right.xyz, relative), dot(frame.up.xyz, relative), dot(frame.forward.xyz, relative));
}

fn world_direction(frame: Frame, view: vec3f) -> vec3f {
    return frame.right.xyz * view.x + frame.up.xyz * view.y + frame.forward.xyz * view.z;
}

// The unit vector from a surface to its viewer: the eye, or for surfaces seen by reflection the mirror point.
fn toward_viewer(frame: Frame, position: vec3f, from_camera: bool, mirror_point: vec3f) -> vec3f {
    let origin = select(mirror_point, vec3f(0.0), from_camera);
    let offset = select(origin - position, -frame.forward.xyz, from_camera && frame.orthographic != 0u);
    return offset * inverseSqrt(max(dot(offset, offset), 1e-30));
}

fn pixels_per_unit(frame: Frame, depth: f32) -> f32 {
    return select(frame.focal_pixels / depth, frame.focal_pixels, frame.orthographic != 0u);
}

// Pixel coordinates, y down, pixel centres at halves.
fn pixel_from_view(frame: Frame, view: vec3f) -> vec2f {
    let scale = pixels_per_unit(frame, view.z);
    return vec2f(f32(frame.width) * 0.5 + view.x * scale, f32(frame.height) * 0.5 - view.y * scale);
}

// View-space x and y of a pixel coordinate, divided by depth in a perspective projection.
fn slope_from_pixel(frame: Frame, pixel: vec2f) -> vec2f {
    let centered = vec2f(pixel.x - f32(frame.width) * 0.5, f32(frame.height) * 0.5 - pixel.y);
    return centered / frame.focal_pixels;
}

// The view-space point at `depth` seen through a pixel coordinate.
fn view_from_pixel(frame: Frame, pixel: vec2f, depth: f32) -> vec3f {
    let slope = slope_from_pixel(frame, pixel);
    return vec3f(select(slope * depth, slope, frame.orthographic != 0u), depth);
}

// The eight pixels around one, by index 0 to 7.
fn neighbor(index: i32) -> vec2i {
    let i = index + select(0, 1, index >= 4);
    return vec2i(i % 3 - 1, i / 3 - 1);
}

// The pixel itself, the eight around it, and those around these.
fn nth_step(n: i32) -> vec2i {
    var step = vec2i(0);
    if n > 8 {
        let at = n - 9;
        let side = at / 4;
        let along = at % 4 - 2;
        let sides = array<vec2i, 4>(vec2i(along, -2), vec2i(2, along), vec2i(-along, 2), vec2i(-2, -along));
        step = sides[side];
    } else if n > 0 {
        step = neighbor(n - 1);
    }
    return step;
}
