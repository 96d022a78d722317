// Where a mirror's surface ends and another begins (Preiner 2010, section 4.3).
#import frame_group

// Whether the surface is the camera's, not one seen in a mirror.
override from_camera: bool = true;

// Whether the depth steps between two neighbouring pixels, of which `before` is the left or the upper one.
fn is_depth_step(before: f32, depth: f32) -> bool {
    // In parallel views the eye's distance is meaningless; rays from a mirror start on it in every view.
    let compared = select(before, frame.reference_depth, from_camera && frame.orthographic != 0u);
    return abs(depth - before) > settings.sscr.depth_step_threshold * compared;
}
