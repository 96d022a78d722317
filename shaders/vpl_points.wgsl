// Normal and colour of each point that casts indirect shadows. Runs once for each page of the point store and takes the points
// that lie in it. One thread a point.
#import point_surface
#import vpl

@group(2) @binding(0) var<uniform> lights: Virtual;
// xyz: bits of the position; w: identity.
@group(2) @binding(1) var<storage, read> chosen: array<vec4u>;
// Two a point: normal (zero where there is none), 1; albedo, specular intensity.
@group(2) @binding(2) var<storage, read_write> surfaces: array<vec4f>;

@compute @workgroup_size(64)
fn vpl_points(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= lights.point_count {
        return;
    }
    let index = index_of_identity(chosen[id.x].w);
    if index >= page.point_count {
        return;
    }
    let surface = surface_of_point(index, vec3f(0.0));
    surfaces[id.x * OCCLUDER_VECTORS] = vec4f(surface.normal.xyz, 1.0);
    surfaces[id.x * OCCLUDER_VECTORS + 1u] = surface.albedo;
}
