// The path of light that each pixel of the camera follows backwards, ray by ray. Made by light_ray_draw.wgsl, summed by
// light_ray_sum.wgsl.

struct LightPath {
    // rgb: the share of the light at the end of the path that comes back along its first ray. w: the factor by which that
    // light is reflected as a highlight of the visible surface.
    throughput: vec4f,
    // rgb: the sum of the light that arrives along the first rays, drawn by the cosine: a mean of it is the irradiance
    // over pi.
    diffuse: vec4f,
    // rgb: the sum of the radiance of the highlights, before the tint.
    glossy: vec4f,
}
