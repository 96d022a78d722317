// The directions of a glossy mirror's rays, drawn by its lobe. CPU twin: crates/render/src/reflection/lobe.rs.
#import hash

// Swaps the halves of the unit interval at random, those of each half, and so on (Owen 1995, by Laine and Karras 2011).
fn scrambled(bits: u32, seed: u32) -> u32 {
    var x = reverseBits(bits) + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return reverseBits(x);
}

// Point `index` of Sobol's sequence in two dimensions, shuffled and scrambled (Burley 2020), inside of the unit square.
// Any number of points from the first on, and any power of two of them more so, are spread evenly.
fn lobe_numbers(index: u32, seed: u32) -> vec2f {
    let shuffled = scrambled(index, hash(seed));
    var second = 0u;
    var column = 0x80000000u;
    for (var rest = shuffled; rest != 0u; rest >>= 1u) {
        second ^= select(0u, column, (rest & 1u) == 1u);
        column ^= column >> 1u;
    }
    let bits = vec2u(
        scrambled(reverseBits(shuffled), hash(seed ^ 0x9e3779b9u)),
        scrambled(second, hash(seed ^ 0x3c6ef372u)),
    );
    return (vec2f(bits >> vec2u(8u)) + 0.5) / 16777216.0;
}

// One minus the cosine of the angle from the lobe's middle: the cosine is u^(1 / (power + 1)).
fn lobe_height(u: f32, power: f32) -> f32 {
    let x = -log(u) / (power + 1.0);
    // The series keeps the digits of small angles.
    return select(1.0 - exp(-x), x * (1.0 - x * (0.5 - x / 6.0)), x < 0.01);
}

// The axes across a unit vector: those across `reference`, turned with it by the smallest turn. They change smoothly
// from pixel to pixel, except about the vector opposite to the reference.
fn axes_across(axis: vec3f, reference: vec3f, right: vec3f, up: vec3f) -> mat2x3f {
    let sum = reference + axis;
    let scale = 1.0 / max(1.0 + dot(reference, axis), 1e-6);
    return mat2x3f(right - sum * (dot(axis, right) * scale), up - sum * (dot(axis, up) * scale));
}

// The unit vector at the drawn angle from `axis`.
fn lobe_direction(axis: vec3f, across: mat2x3f, numbers: vec2f, power: f32) -> vec3f {
    let height = lobe_height(numbers.x, power);
    let turn = 6.2831853 * numbers.y;
    let sideways = across * vec2f(cos(turn), sin(turn));
    return normalize(axis * (1.0 - height) + sideways * sqrt(height * (2.0 - height)));
}

// The normal that mirrors `incoming` into a direction drawn by the lobe; `across` has the axes across `incoming`
// (Phong) or across the normal (Blinn). Phong's lobe about the reflected ray is that about the incoming one, mirrored.
fn lobe_normal(is_blinn: bool, incoming: vec3f, normal: vec3f, across: mat2x3f, numbers: vec2f, power: f32) -> vec3f {
    if is_blinn {
        return lobe_direction(normal, across, numbers, power);
    }
    return normalize(reflect(lobe_direction(incoming, across, numbers, power), normal) - incoming);
}

// The level direction along a surface, and that across it. Surfaces that lie level themselves, to three degrees, have the
// world's x axis along them, or y where they face along x.
fn surface_axes(normal: vec3f, world_up: vec3f) -> mat2x3f {
    let level = cross(world_up, normal);
    let axis = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(normal.x) > 0.9);
    let lies_level = dot(level, level) < LEVEL_SINE * LEVEL_SINE;
    let along = normalize(select(level, axis - normal * dot(axis, normal), lies_level));
    return mat2x3f(along, cross(normal, along));
}
const LEVEL_SINE: f32 = 0.05233596;

// The normal halfway between two directions, drawn by the lobe of two exponents, along each of the axes across the
// surface's normal (Ashikhmin and Shirley 2000).
fn anisotropic_normal(normal: vec3f, across: mat2x3f, numbers: vec2f, powers: vec2f) -> vec3f {
    let turn = 6.2831853 * numbers.y;
    let side = normalize(vec2f(cos(turn), sin(turn)) * sqrt(powers.yx + 1.0));
    let height = lobe_height(numbers.x, dot(powers, side * side));
    return normalize(normal * (1.0 - height) + across * side * sqrt(height * (2.0 - height)));
}

// A normal drawn from another lobe than the surface's, and how much the ray counts.
struct WeighedNormal {
    normal: vec3f,
    weight: f32,
}

// Draws ray `index` of `count` half from a lobe of power `drawn_power`, half from one of `spread` times less power. The
// weight is the density of the surface's lobe over that of both together (the balance heuristic); both densities of a
// direction come from those of the normal by the same factor. A direction below the surface counts nothing.
fn weighed_normal(
    is_blinn: bool,
    incoming: vec3f,
    normal: vec3f,
    across: mat2x3f,
    index: u32,
    count: u32,
    seed: u32,
    drawn_power: f32,
    spread: f32,
    power: f32,
) -> WeighedNormal {
    let wide_power = drawn_power / spread;
    let is_wide = index % 2u == 1u;
    let from_power = select(drawn_power, wide_power, is_wide);
    let numbers = lobe_numbers(index / 2u, hash(seed + select(1u, 2u, is_wide)));
    let drawn = lobe_normal(is_blinn, incoming, normal, across, numbers, from_power);
    let log_cosine = log(numbers.x) / (from_power + 1.0);
    let narrow_share = f32((count + 1u) / 2u) / f32(count);
    let narrow = narrow_share * (drawn_power + 1.0) * exp((drawn_power - power) * log_cosine);
    let wide = (1.0 - narrow_share) * (wide_power + 1.0) * exp((wide_power - power) * log_cosine);
    let is_above = dot(reflect(incoming, drawn), normal) > 0.0;
    return WeighedNormal(select(normal, drawn, is_above), select(0.0, (power + 1.0) / (narrow + wide), is_above));
}
