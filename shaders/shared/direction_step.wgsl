// How the reflected direction changes from a mirror pixel to the next. The importing pass binds `point_in`, `normal_in` and
// `eye_in`.
#import mirror_ray

// Radians, a thousandth of a degree: from pixel to pixel, reflected directions that change by less count as the same, as
// in a plane mirror in parallel projection, where rounding alone changes them.
const STEADY: f32 = 1.75e-5;

fn reflected(id: vec2u) -> vec3f {
    return reflected_direction(textureLoad(point_in, id, 0).xyz, textureLoad(normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
}

// The angle between unit vectors; exact for small ones, where the cosine is not.
fn angle(a: vec3f, b: vec3f) -> f32 {
    return atan2(length(cross(a, b)), dot(a, b));
}

// The angle by which the reflected direction changes to a neighbour; huge if there is none.
fn change(id: vec2u, step: vec2i, direction: vec3f) -> f32 {
    let other = vec2u(vec2i(id) + step);
    let is_inside = all(vec2i(id) + step >= vec2i(0)) && other.x < frame.width && other.y < frame.height;
    // Clamped: both sides of a branch may run.
    let at = min(other, vec2u(frame.width, frame.height) - 1u);
    if !is_inside || textureLoad(point_in, at, 0).w == 0.0 {
        return 1e9;
    }
    return angle(direction, reflected(at));
}

// The angle by which the reflected direction changes from pixel to pixel; -1 if no neighbour shows it. Along each axis
// the smaller change counts, so that the edge of another mirror does not; the larger of both axes is taken.
fn direction_step(id: vec2u, direction: vec3f) -> f32 {
    let sideways = min(change(id, vec2i(-1, 0), direction), change(id, vec2i(1, 0), direction));
    let upright = min(change(id, vec2i(0, -1), direction), change(id, vec2i(0, 1), direction));
    return max(select(sideways, -1.0, sideways > 1e8), select(upright, -1.0, upright > 1e8));
}
