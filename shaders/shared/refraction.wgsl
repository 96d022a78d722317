// One interface between two media: Snell's law and Fresnel's equations.

// The direction behind a surface whose normal faces the ray; `ratio` is the index of refraction behind the surface over
// that before it. Zero for total reflection.
fn refracted(direction: vec3f, normal: vec3f, ratio: f32) -> vec3f {
    let along = -dot(direction, normal);
    let across = (direction + normal * along) / ratio;
    let squared = 1.0 - dot(across, across);
    return select(vec3f(0.0), normalize(across - normal * sqrt(max(squared, 0.0))), squared > 0.0);
}

// The share of unpolarised light that the surface reflects; `cosine` is that of the angle between ray and normal.
fn reflected_share(cosine: f32, ratio: f32) -> f32 {
    let before = clamp(cosine, 0.0, 1.0);
    let squared = 1.0 - (1.0 - before * before) / (ratio * ratio);
    let behind = sqrt(max(squared, 0.0));
    let across = (before - ratio * behind) / (before + ratio * behind);
    let along = (ratio * before - behind) / (ratio * before + behind);
    return select(1.0, 0.5 * (across * across + along * along), squared > 0.0 && before > 0.0);
}
