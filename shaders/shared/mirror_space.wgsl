// The mirror's pixels as the search reads them, and the mirror-space error function (Preiner 2010, sections 3.2 and 3.3).
// CPU twin: crates/render/src/reflection/sscr/twin.rs.
#import packing

// 32 consecutive bytes, so that a step of the search costs one fetch from memory.
struct MirrorPixel {
    // xyz: f32 bits of P relative to the camera's eye, world axes. w: label of its region, 0: none.
    point_label: vec4u,
    // xyz: f32 bits of the unit normal towards the eye. w: octahedral direction from P to where the ray came from.
    normal_eye: vec4u,
}

// The words per pixel for where searches ended: their number, their steps, and the number of those that ran out of
// steps.
const ENDING_WORDS: u32 = 3u;
// What follows these words in their buffer begins at a multiple of so many: where a binding may.
const ENDING_ALIGNMENT: u32 = 64u;

// Octahedral unit vector in two snorm16 halves: the inverse of unpack_normal.
fn pack_direction(direction: vec3f) -> u32 {
    let flat = direction.xy / (abs(direction.x) + abs(direction.y) + abs(direction.z));
    let side = select(vec2f(-1.0), vec2f(1.0), flat >= vec2f(0.0));
    return pack2x16snorm(select((1.0 - abs(flat.yx)) * side, flat, direction.z >= 0.0));
}

// The direction in which light from Q leaves P, in mirror space: z to the eye, x in the plane of z and the view's x axis.
fn reflected_in_mirror_space(pixel: MirrorPixel, right: vec3f, q: vec3f) -> vec3f {
    let normal = bitcast<vec3f>(pixel.normal_eye.xyz);
    let z = unpack_normal(pixel.normal_eye.w);
    let across = right - z * dot(right, z);
    // Zero where the ray runs along the view's x axis, which happens only in further bounces.
    let x = across * inverseSqrt(max(dot(across, across), 1e-30));
    let y = cross(z, x);
    let offset = bitcast<vec3f>(pixel.point_label.xyz) - q;
    let incoming = offset * inverseSqrt(max(dot(offset, offset), 1e-30));
    let rho = incoming - 2.0 * normal * dot(normal, incoming);
    return vec3f(dot(rho, x), dot(rho, y), dot(rho, z));
}

// The signed error angles along x and y. The printed formula takes the angles of rho - e, both of whose components
// vanish at the root; here they are those of the reflected direction rho itself, which is e at the root and only there.
fn mirror_space_error(reflected: vec3f) -> vec2f {
    return vec2f(atan2(reflected.x, reflected.z), atan2(reflected.y, reflected.z));
}

// The same error as a place on Lambert's azimuthal map, for searches that follow its slope: it tears only where light leaves
// away from the eye, and over a distant sphere it is linear in the pixels.
fn mapped_error(reflected: vec3f) -> vec2f {
    return reflected.xy * sqrt(2.0 / max(1.0 + reflected.z, 1e-6));
}
