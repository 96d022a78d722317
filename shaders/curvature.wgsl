// Curvature map (Preiner 2010, sections 3.5.1 and 4.3): whether the mirror bends outwards, inwards or not from the left and
// from the upper pixel to each pixel, and whether its depth steps there. One thread a pixel.
#import frame_group
#import depth_step
#import region

// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// w: linear depth.
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read_write> curvature_map: array<u32>;

@compute @workgroup_size(8, 8)
fn curvature(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    var flags = 0u;
    if textureLoad(point_in, id.xy, 0).w > 0.0 {
        // Rows run downwards, so along a column the normal of a convex surface turns against the view's up.
        flags = MIRROR
            | change_from(id.xy, vec2u(1u, 0u), frame.right.xyz)
            | change_from(id.xy, vec2u(0u, 1u), -frame.up.xyz);
        flags |= (flags & (BENT | (BENT << DIRECTION_BITS))) << OPEN_BITS;
    }
    curvature_map[id.y * frame.width + id.x] = flags;
}

// The flags of the change from the previous pixel along one direction.
fn change_from(pixel: vec2u, direction: vec2u, axis: vec3f) -> u32 {
    if any(pixel < direction) || textureLoad(point_in, pixel - direction, 0).w == 0.0 {
        return 0u;
    }
    let depth = textureLoad(eye_in, pixel, 0).w;
    if is_depth_step(textureLoad(eye_in, pixel - direction, 0).w, depth) {
        // A change of the normal from one surface to another is no curvature.
        return DEPTH_STEP << direction.y;
    }
    let turn = dot(textureLoad(normal_in, pixel, 0).xyz - textureLoad(normal_in, pixel - direction, 0).xyz, axis);
    if abs(turn) > settings.sscr.planar_normal_threshold {
        return select(HOLLOW, CONVEX, turn > 0.0) << (DIRECTION_BITS * direction.y);
    }
    return 0u;
}
