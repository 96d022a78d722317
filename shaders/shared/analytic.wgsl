// Planes and spheres reflect each point in one place, which a formula gives: a plane where the line from the mirrored
// eye meets it, a sphere where the angles of eye and point to the normal are equal (Alhazen's problem). For rays that
// come from the camera. The importing pass binds the mirrors as `analytic`; a size of 0 stands for none.
#import frame_group
#import mirror_formula
#import mirror_ray

// No mirror of those.
const NOT_ANALYTIC: u32 = 0xffffffffu;
// How far a mirror's points may lie beside its formula, in its sizes.
const BESIDE_FORMULA: f32 = 0.02;
// Newton's method doubles the digits of an angle that is off by a tenth at first.
const ALHAZEN_STEPS: u32 = 5u;

// The mirror on whose formula a mirror point lies.
fn analytic_at(point: vec3f) -> u32 {
    for (var number = 0u; number < arrayLength(&analytic); number++) {
        let size = analytic[number].z_size.w;
        let offset = (point - analytic[number].position_reach.xyz) / max(size, 1e-30);
        let p = vec3f(
            dot(offset, analytic[number].x_kind.xyz),
            dot(offset, analytic[number].y_parameter.xyz),
            dot(offset, analytic[number].z_size.xyz),
        );
        let beyond = abs(p) - vec3f(1.0, analytic[number].y_parameter.w, 0.0);
        let is_on_plane = all(beyond < vec3f(BESIDE_FORMULA));
        let is_on_sphere = abs(length(p) - 1.0) < BESIDE_FORMULA;
        if size > 0.0 && select(is_on_plane, is_on_sphere, analytic[number].x_kind.w == SPHERE) {
            return number;
        }
    }
    return NOT_ANALYTIC;
}

// A place of a mirror, relative to the eye.
struct AnalyticPlace {
    is_found: bool,
    point: vec3f,
    // Towards the eye, of unit length.
    normal: vec3f,
    // One over the radius; 0 for a plane.
    bend: f32,
}

// The direction in which the camera sees a place.
fn sight_to(place: vec3f) -> vec3f {
    return select(normalize(place), frame.forward.xyz, frame.orthographic != 0u);
}

// Where a mirror reflects a point.
fn analytic_place(mirror: FormulaMirror, q: vec3f) -> AnalyticPlace {
    let middle = mirror.position_reach.xyz;
    if mirror.x_kind.w == SPHERE {
        return place_on_sphere(middle, mirror.z_size.w, q);
    }
    let toward_eye = select(-middle, -frame.forward.xyz, frame.orthographic != 0u);
    let normal = mirror.z_size.xyz * select(-1.0, 1.0, dot(mirror.z_size.xyz, toward_eye) > 0.0);
    let eye_height = dot(normal, -middle);
    let height = dot(normal, q - middle);
    // On the line from the mirrored eye; or along the mirrored line of sight.
    let mirrored = -2.0 * eye_height * normal;
    let on_line = mirrored + (q - mirrored) * (eye_height / max(eye_height + height, 1e-30));
    let direction = reflect(frame.forward.xyz, normal);
    let on_sight = q - direction * (height / max(dot(normal, direction), 1e-30));
    let point = select(on_line, on_sight, frame.orthographic != 0u);
    return AnalyticPlace(height > 0.0 && dot(normal, toward_eye) > 0.0, point, normal, 0.0);
}

// In the plane of the middle, the eye and the point, the place is at the angle t from the eye and at a - t from the
// point, and the angles to the normal are equal where q sin(2 t - a) - sin t + e sin(a - t) = 0; q is the distance of
// the point from the middle, e one over that of the eye, both in radii.
fn place_on_sphere(middle: vec3f, radius: f32, q: vec3f) -> AnalyticPlace {
    let none = AnalyticPlace(false, vec3f(0.0), vec3f(0.0), 0.0);
    let is_parallel = frame.orthographic != 0u;
    let e = select(radius * inverseSqrt(dot(middle, middle)), 0.0, is_parallel);
    let to_eye = select(-normalize(middle), -frame.forward.xyz, is_parallel);
    let offset = (q - middle) / radius;
    let away = length(offset);
    let beside = offset - to_eye * dot(offset, to_eye);
    let side = length(beside);
    if e >= 1.0 || away <= 1.0 {
        return none;
    }
    let angle = atan2(side, dot(offset, to_eye));
    var t = 0.5 * (angle + asin(clamp(sin(0.5 * angle) * (1.0 / away - e), -1.0, 1.0)));
    for (var step = 0u; step < ALHAZEN_STEPS; step++) {
        let value = away * sin(2.0 * t - angle) - sin(t) + e * away * sin(angle - t);
        let slope = 2.0 * away * cos(2.0 * t - angle) - cos(t) - e * away * cos(angle - t);
        t = clamp(t - value / select(slope, 1e-30, slope == 0.0), 0.0, angle);
    }
    // Neither eye nor point sees what lies beyond its own horizon.
    if cos(t) <= e || away * cos(angle - t) <= 1.0 {
        return none;
    }
    let normal = to_eye * cos(t) + beside * (sin(t) / max(side, 1e-30));
    return AnalyticPlace(true, middle + radius * normal, normal, 1.0 / radius);
}

// How the place that a pixel's reflected ray has after a distance z moves with the pixel to the right and down.
struct AnalyticSlopes {
    right: vec3f,
    down: vec3f,
}

fn analytic_slopes(at: AnalyticPlace, z: f32) -> AnalyticSlopes {
    return AnalyticSlopes(slope_along(at, frame.right.xyz, z), slope_along(at, -frame.up.xyz, z));
}

fn slope_along(at: AnalyticPlace, axis: vec3f, z: f32) -> vec3f {
    let sight = sight_to(at.point);
    // At the depth of the place, across the camera's axis; then along the line of sight onto the mirror.
    let moved = axis / pixels_per_unit(frame, dot(frame.forward.xyz, at.point));
    let slant = dot(at.normal, sight);
    let point = moved - sight * (dot(at.normal, moved) / select(slant, -1e-6, slant > -1e-6));
    let turned = (moved - sight * dot(sight, moved)) * inverseSqrt(dot(at.point, at.point));
    let sight_turns = select(turned, vec3f(0.0), frame.orthographic != 0u);
    let normal = at.bend * point;
    let along = dot(normal, sight) + dot(at.normal, sight_turns);
    return point + z * (sight_turns - 2.0 * (at.normal * along + normal * slant));
}

// The least area that a pixel sees of a surface at a place after a reflection, whichever way the surface turns: rays
// that part by 2 / (r cos i) and 2 cos i / r part by no less than 2 / r on the mean, and nearer mirrors are finer.
fn least_area(mirror: FormulaMirror, q: vec3f) -> f32 {
    let middle = mirror.position_reach.xyz;
    let radius = mirror.z_size.w;
    let gap = max(distance(q, middle) - radius, 0.0);
    if mirror.x_kind.w != SPHERE {
        return 0.0;
    }
    if frame.orthographic != 0u {
        let edge = (1.0 + 2.0 * gap / radius) / frame.focal_pixels;
        return edge * edge;
    }
    let eye = length(middle);
    let nearest = max(eye - radius, 0.0);
    let cosine = max(dot(frame.forward.xyz, middle) - radius, 0.0) / (eye + radius);
    let edge = (nearest + gap + 2.0 * gap * nearest / radius) / frame.focal_pixels;
    return cosine * cosine * cosine * edge * edge;
}
