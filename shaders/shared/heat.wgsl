// Black, blue, red, yellow, white over 0 to 1.
fn heat(value: f32) -> vec3f {
    let v = clamp(value, 0.0, 1.0) * 4.0;
    return clamp(vec3f(v - 1.0, v - 2.0, select(v, max(2.0 - v, v - 3.0), v > 1.0)), vec3f(0.0), vec3f(1.0));
}
