// The cosines over squared distance of a virtual light that stands for a surface: the CPU twin is
// crates/render/src/gi/twin.rs.
#import vpl

// The mean over the light's surface. `offset` leads from the lit place to the light, and `normal` is that place's; both
// must see each other.
fn transfer_of_light(light: Vpl, offset: vec3f, normal: vec3f) -> f32 {
    let squared = dot(offset, offset);
    let area_over_pi = light.position.w;
    if squared < NEAR * area_over_pi {
        return transfer_of_square(light, offset, normal);
    }
    let toward = offset * inverseSqrt(max(squared, 1e-30));
    let cosine = dot(normal, toward);
    let cosine_there = -dot(light.normal.xyz, toward);
    return cosine * cosine_there / max(squared, 1e-12)
        * mean_over_disc(light, normal, cosine, cosine_there, area_over_pi / squared);
}

// The mean over a light's disc of the cosines over squared distance, as a multiple of those of its middle, to the
// second order in the disc's radius (the Laplacian in its plane): 1 / (1 + r^2 / d^2), which is exact, where disc and
// surface face each other, and more than 1 at a slant. `share` is r^2 / d^2. Over a surface that many lights cover
// evenly, discs send what the surface sends.
fn mean_over_disc(light: Vpl, normal: vec3f, cosine: f32, cosine_there: f32, share: f32) -> f32 {
    let facing = dot(normal, light.normal.xyz) * cosine_there / cosine;
    let bend = share * min(1.0 - 3.0 * cosine_there * cosine_there - facing, 2.0);
    return select(1.0 + bend, 1.0 / (1.0 - bend), bend < 0.0);
}

// A light counts as near within this many squares of its radius.
const NEAR: f32 = 25.0;

// A wall of one layer of points is lit from both sides. A light on its other side may stand a little before it, by a
// texel of a lamp's map or by rounding, but does not shine on it. What is as near to the plane of a light's square as
// this share of half its side, and as level as this cosine, is of the light's own surface.
const OWN_SURFACE: f32 = 0.05;
const LEVEL: f32 = 0.9;

// The cosines over squared distance of a near light, which is treated as the square that it represents: in corners a
// disc's mean direction would darken the surface within its radius. It is the integral over the part of the square
// above the surface's horizon (Lambert 1760), divided by that part's area: where surfaces meet, the light's own surface
// ends there. The square's edge is four fifths longer than that of the light's share of the surface, which compensates
// for the uneven spread of lights.
fn transfer_of_square(light: Vpl, offset: vec3f, normal: vec3f) -> f32 {
    let half = 0.9 * sqrt(3.14159265 * light.position.w);
    if abs(dot(light.normal.xyz, offset)) < OWN_SURFACE * half && abs(dot(light.normal.xyz, normal)) > LEVEL {
        return 0.0;
    }
    let along = light.tangent.xyz * half;
    let across = cross(light.normal.xyz, light.tangent.xyz) * half;
    var sum = vec2f(0.0);
    var before = offset - along + across;
    var height_before = dot(normal, before);
    var left = vec3f(0.0);
    var entered = vec3f(0.0);
    for (var i = 0; i < 4; i++) {
        let corner = offset + along * select(1.0, -1.0, i == 0 || i == 3) + across * select(1.0, -1.0, i < 2);
        let height = dot(normal, corner);
        if height > 0.0 || height_before > 0.0 {
            let crossing = mix(before, corner, height_before / (height_before - height));
            let start = select(crossing, before, height_before > 0.0);
            let end = select(crossing, corner, height > 0.0);
            entered = select(crossing, entered, height_before > 0.0);
            left = select(crossing, left, height > 0.0);
            sum += edge_of_square(light, normal, start, end);
        }
        before = corner;
        height_before = height;
    }
    sum += edge_of_square(light, normal, left, entered);
    return abs(sum.x) / max(abs(sum.y), 1e-20);
}

// The contribution of an edge to twice the integral of the cosines and to twice the area.
fn edge_of_square(light: Vpl, normal: vec3f, start: vec3f, end: vec3f) -> vec2f {
    let turn = cross(start, end);
    let sine = length(turn);
    // No contribution: an edge toward the surface, or of no length.
    let light_of_edge = select(0.0, atan2(sine, dot(start, end)) * dot(normal, turn) / sine, sine > 0.0);
    return vec2f(light_of_edge, dot(light.normal.xyz, turn));
}
