// The reflected eye ray of a mirror pixel.

struct MirrorRay {
    // The origin relative to the eye.
    origin: vec3f,
    // The direction: unit length, no component zero.
    direction: vec3f,
    inverse: vec3f,
}

fn reflected_direction(point: vec3f, normal: vec3f, eye: vec3f) -> vec3f {
    let direction = normalize(reflect(point - eye, normal));
    // Keeps inverses finite; far below the precision of a direction.
    return select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
}

fn mirror_ray(point: vec3f, normal: vec3f, eye: vec3f) -> MirrorRay {
    let direction = reflected_direction(point, normal, eye);
    return MirrorRay(point, direction, 1.0 / direction);
}
