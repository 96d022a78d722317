// Tests for numbers by their bits. Metal and some compilers of DirectX take it that no number is NaN, so a comparison
// with one may have either result there.

// Whether a number is neither NaN nor infinite.
fn is_finite(number: f32) -> bool {
    return (bitcast<u32>(number) & 0x7f800000u) != 0x7f800000u;
}

fn is_nan(number: f32) -> bool {
    return (bitcast<u32>(number) & 0x7fffffffu) > 0x7f800000u;
}

// Whether the position of a point, as it is stored, is one: a point without a place is not drawn.
fn is_place(bits: vec3u) -> bool {
    return all((bits & vec3u(0x7f800000u)) != vec3u(0x7f800000u));
}
