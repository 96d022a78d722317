// Compact normals and radii (crates/cloud/src/packing.rs is the CPU side) and sRGB.

const NO_NORMAL: u32 = 0x80008000u;

// The unit normal from two snorm16 octahedral coordinates; zero for NO_NORMAL.
fn unpack_normal(packed: u32) -> vec3f {
    if packed == NO_NORMAL {
        return vec3f(0.0);
    }
    let folded = unpack2x16snorm(packed);
    let z = 1.0 - abs(folded.x) - abs(folded.y);
    let side = select(vec2f(-1.0), vec2f(1.0), folded >= vec2f(0.0));
    let flat = select((1.0 - abs(folded.yx)) * side, folded, z >= 0.0);
    return normalize(vec3f(flat, z));
}

// The radius in world units from a 16-bit logarithm; zero if it is not known.
fn unpack_radius(packed: u32) -> f32 {
    return select(exp2(f32(packed) / 2048.0 - 20.0), 0.0, packed == 0u);
}

fn linear_from_srgb(srgb: vec3f) -> vec3f {
    return select(pow((srgb + 0.055) / 1.055, vec3f(2.4)), srgb / 12.92, srgb <= vec3f(0.04045));
}

fn srgb_from_linear(linear: vec3f) -> vec3f {
    let clamped = clamp(linear, vec3f(0.0), vec3f(1.0));
    return select(1.055 * pow(clamped, vec3f(1.0 / 2.4)) - 0.055, clamped * 12.92, clamped <= vec3f(0.0031308));
}
