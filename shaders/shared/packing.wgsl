// Compact normals, and sizes and shapes of splats (crates/cloud/src/packing.rs is the CPU side), and sRGB.

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

// The radius in world units from the upper 11 of 16 bits, or the long half axis of an ellipse; zero if it is not known.
// Below 2^-19, steps are coarse.
fn unpack_radius(packed: u32) -> f32 {
    let octave = f32(packed & 0xffe0u) / 2048.0;
    return select(exp2(select(octave - 20.0, octave * 16.0 - 35.0, octave < 1.0)), 0.0, packed == 0u);
}

// What keeps a point with this packed radius from being on a surface: 1 of a lone stray, 2 of a mixed pixel, or 0.
fn stray_kind(packed: u32) -> u32 {
    return select(0u, packed, packed <= 2u);
}

// How much longer an ellipse is than wide, and in which direction of its plane. A disc has the ratio 1.
struct Stretch {
    axis: vec3f,
    ratio: f32,
}

// The lower bits of a radius below which a splat is an ellipse of 3 to 1, in so many directions, and of 7 to 1 from there.
const SHAPE_BITS: u32 = 31u;
const DIRECTIONS_OF_3: u32 = 10u;
const DIRECTIONS_OF_7: u32 = 21u;

// The shape of a splat with a unit normal from its packed radius. Strays are discs.
fn unpack_stretch(packed: u32, normal: vec3f) -> Stretch {
    let shape = packed & SHAPE_BITS;
    if shape == 0u || packed <= SHAPE_BITS || all(normal == vec3f(0.0)) {
        return Stretch(vec3f(0.0), 1.0);
    }
    let first = select(select(normal.x, normal.y, normal.y != 0.0), normal.z, normal.z != 0.0);
    let up = select(normal, -normal, first < 0.0);
    let a = -1.0 / (1.0 + up.z);
    let is_long = shape > DIRECTIONS_OF_3;
    let turn = select(f32(shape - 1u) / f32(DIRECTIONS_OF_3), f32(shape - 1u - DIRECTIONS_OF_3) / f32(DIRECTIONS_OF_7), is_long);
    let angle = 3.14159274 * turn;
    let across = vec3f(1.0 + up.x * up.x * a, up.x * up.y * a, -up.x);
    let along = vec3f(up.x * up.y * a, 1.0 + up.y * up.y * a, -up.y);
    return Stretch(cos(angle) * across + sin(angle) * along, select(3.0, 7.0, is_long));
}

// The squared distance of a place in the plane of a splat from its middle in units of the squared half axis there, times
// the squared long half axis.
fn stretched_square(stretch: Stretch, offset: vec3f) -> f32 {
    let square = dot(offset, offset);
    let along = dot(offset, stretch.axis);
    return square + (stretch.ratio * stretch.ratio - 1.0) * (square - along * along);
}

fn linear_from_srgb(srgb: vec3f) -> vec3f {
    return select(pow((srgb + 0.055) / 1.055, vec3f(2.4)), srgb / 12.92, srgb <= vec3f(0.04045));
}

fn srgb_from_linear(linear: vec3f) -> vec3f {
    let clamped = clamp(linear, vec3f(0.0), vec3f(1.0));
    return select(1.055 * pow(clamped, vec3f(1.0 / 2.4)) - 0.055, clamped * 12.92, clamped <= vec3f(0.0031308));
}
