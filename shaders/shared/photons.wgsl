// Photons: light of lamps and the sun that mirrors throw onto surfaces. Made by crates/render/src/caustics.rs. Positions are
// relative to the photons' origin, which is the eye of the passes that trace them.
#import frame_group

// A photon where it has landed. Declared in crates/render/src/layout.rs.
struct Landed {
    // w: 0 if there is none.
    position: vec4f,
    // xyz: unit normal of the surface, on the side where the photon arrived.
    normal: vec4f,
    // Of the surface. a: specular intensity.
    albedo: vec4f,
    // rgb: power.
    power: vec4f,
    // xyz: the direction in which it arrived.
    incoming: vec4f,
}

// A place on a ray's line before its origin, so far away that rounding does not turn the ray.
fn place_before(origin: vec3f, direction: vec3f) -> vec3f {
    return origin - direction * max(length(origin), frame.scene_radius);
}
