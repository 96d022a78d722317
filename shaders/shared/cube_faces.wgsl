// The six faces of a map as pictures of depths.
#import depth_texel

// A face: 0 to 2 look along an axis, 3 to 5 against it; the two axes after it point right and up, see face_camera of
// crates/render/src/reflection/environment_map.rs.
fn cube_face(center: vec3f, size: u32, face: u32, picture: u32, levels: i32) -> DepthView {
    var axes = array<vec3f, 3>(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
    let forward = select(-1.0, 1.0, face < 3u) * axes[face % 3u];
    return DepthView(
        center, axes[(face + 1u) % 3u], axes[(face + 2u) % 3u], forward, vec2i(i32(size)), 0.5 * f32(size), false,
        picture, levels,
    );
}

// The face that sees a direction: that of its largest part.
fn face_toward(direction: vec3f) -> u32 {
    let parts = abs(direction);
    var axis = 0u;
    if parts.y > parts.x && parts.y >= parts.z {
        axis = 1u;
    } else if parts.z > parts.x {
        axis = 2u;
    }
    return axis + select(0u, 3u, direction[axis] < 0.0);
}

// The texel of a face in the direction `offset` from its centre.
fn texel_toward(view: DepthView, offset: vec3f) -> vec2i {
    let slope = vec2f(dot(view.right, offset), -dot(view.up, offset)) / dot(view.forward, offset);
    return clamp(vec2i(floor(0.5 * vec2f(view.size) + view.focal * slope)), vec2i(0), view.size - 1);
}
