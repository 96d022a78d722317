// The path of light that each pixel of the camera follows backwards, ray by ray. Made by light_ray_draw.wgsl, summed by
// light_ray_sum.wgsl.
#import frame_group
#import lobe

struct LightPath {
    // rgb: the share of the light at the end of the path that comes back along its first ray. w: the factor by which that
    // light is reflected as a highlight of the visible surface.
    throughput: vec4f,
    // rgb: the sum of the light that arrives along the first rays, drawn by the cosine: a mean of it is the irradiance
    // over pi. w: the number of rays of the path so far that were drawn by the cosine.
    diffuse: vec4f,
    // rgb: the sum of the radiance of the highlights, before the tint. w: 1 if the next ray is the last one as a mirror
    // reflects it.
    glossy: vec4f,
    // The sum of one over the lengths of the first rays, in radii of the scene.
    nearness: f32,
    // The number of paths that the sums hold, with the one that is followed.
    count: f32,
    // The place where the paths that were taken over from the frame before began, relative to where those of this frame do:
    // in distances of neighbouring pixels, three halves and an unused one. See light_ray_reuse.wgsl.
    offset: vec2u,
}

// The edge in pixels of a tile, whose pixels take consecutive parts of one sequence, so that their rays together are as
// even as those of each.
override tile: u32 = 1u;

// Two numbers of the unit square for the path of a pixel that is the `count`-th one, of one dimension of the sequence.
fn path_numbers(pixel: vec2u, count: f32, dimension: u32) -> vec2f {
    let of_tile = hash(pixel.x / tile + hash(pixel.y / tile));
    let number = (pixel.y % tile * tile + pixel.x % tile) * frame.samples + u32(count) - 1u;
    return lobe_numbers(number, hash(settings.gi.ray_seed + hash(of_tile + hash(dimension))));
}

// How far apart neighbouring pixels of this frame lie on a surface that faces the eye, at a place relative to this eye.
fn own_spacing(position: vec3f) -> f32 {
    return 1.0 / pixels_per_unit(frame, view_from_relative(frame, position).z);
}
