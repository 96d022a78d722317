// Pictures of depths, their texels and the records of those.

// A surface seen at a smaller angle than this sine has no slope that its depth would show.
const LEAST_COSINE: f32 = 0.16;

// A texel: the disc that it shows.
struct DepthTexel {
    identity: u32,
    // The linear depth of the disc's plane at the texel's middle; 0: nothing is there.
    depth: f32,
    // Toward the view's centre, or along the line of sight where the disc has none or is seen edge-on.
    normal: vec3f,
    // The disc's radius over the width of a texel at this depth.
    radius: f32,
    // The disc's middle from the texel's middle, in texels.
    middle: vec2f,
}

// A record of a texel: identity; depth; normal in 11 + 11 bits and the logarithm of the radius in 10; middle in 16 + 16.
fn pack_texel(texel: DepthTexel) -> vec4u {
    let folded = texel.normal / (abs(texel.normal.x) + abs(texel.normal.y) + abs(texel.normal.z));
    let side = select(vec2f(-1.0), vec2f(1.0), folded.xy >= vec2f(0.0));
    let flat = select((1.0 - abs(folded.yx)) * side, folded.xy, folded.z >= 0.0);
    let steps = vec2u(round((flat * 0.5 + 0.5) * 2047.0));
    let radius = u32(clamp(round((log2(max(texel.radius, 1e-6)) + 8.0) * 64.0), 0.0, 1023.0));
    let middle = vec2u(vec2i(clamp(round(texel.middle * 32.0), vec2f(-32767.0), vec2f(32767.0)))) & vec2u(0xffffu);
    let normal_radius = steps.x | (steps.y << 11u) | (radius << 22u);
    return vec4u(texel.identity, bitcast<u32>(texel.depth), normal_radius, middle.x | (middle.y << 16u));
}

fn unpack_texel(record: vec4u) -> DepthTexel {
    let steps = vec2f(vec2u(record.z, record.z >> 11u) & vec2u(2047u));
    let folded = steps / 2047.0 * 2.0 - 1.0;
    let z = 1.0 - abs(folded.x) - abs(folded.y);
    let side = select(vec2f(-1.0), vec2f(1.0), folded >= vec2f(0.0));
    let flat = select((1.0 - abs(folded.yx)) * side, folded, z >= 0.0);
    let radius = exp2(f32(record.z >> 22u) / 64.0 - 8.0);
    let middle = vec2f(vec2i(vec2u(record.w << 16u, record.w & 0xffff0000u)) >> vec2u(16u)) / 32.0;
    return DepthTexel(record.x, bitcast<f32>(record.y), normalize(vec3f(flat, z)), radius, middle);
}

// From where, and how, a picture shows the scene.
struct DepthView {
    center: vec3f,
    right: vec3f,
    up: vec3f,
    forward: vec3f,
    // In texels.
    size: vec2i,
    // Texels per unit of tangent; of a parallel picture, per world unit.
    focal: f32,
    is_parallel: bool,
    // The number by which the importing pass knows the picture.
    picture: u32,
    // The number of levels of bounds.
    levels: i32,
}

// A line of sight: its place at a linear depth of 0, relative to the centre, and its way to a depth of 1 more.
struct Sight {
    origin: vec3f,
    direction: vec3f,
}

// The line of sight at a place of the picture, in texels.
fn sight_of(view: DepthView, place: vec2f) -> Sight {
    let slope = (place - 0.5 * vec2f(view.size)) / view.focal;
    let beside = view.right * slope.x - view.up * slope.y;
    let turned = view.forward + view.right * slope.x - view.up * slope.y;
    return Sight(select(vec3f(0.0), beside, view.is_parallel), select(turned, view.forward, view.is_parallel));
}

// The product of a plane's normal with its places less the centre.
fn plane_of(sight: Sight, normal: vec3f, depth: f32) -> f32 {
    return dot(normal, sight.origin) + dot(normal, sight.direction) * depth;
}

// The width of a texel at a depth.
fn width_at(view: DepthView, depth: f32) -> f32 {
    return select(depth, 1.0, view.is_parallel) / view.focal;
}
