// Screen-space curved reflections: which chunks of points any region's reflected rays may meet. The others are not
// searched for. One thread a chunk.
#import frame_group
#import region

@group(1) @binding(0) var<storage, read> regions: array<Region>;
// For each item. xyz: the middle of its chunk's points, relative to the eye. w: the radius of a sphere that holds them.
@group(1) @binding(1) var<storage, read> spheres: array<vec4f>;
// 1 for chunks that a region may reflect.
@group(1) @binding(2) var<storage, read_write> chunks_reached: array<u32>;

@compute @workgroup_size(64)
fn sscr_cull(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= arrayLength(&chunks_reached) {
        return;
    }
    let sphere = spheres[id.x];
    var is_reached = false;
    for (var label = 1u; label <= regions[0].regions && !is_reached; label++) {
        is_reached = may_reflect(regions[label], sphere.xyz, sphere.w);
    }
    chunks_reached[id.x] = select(0u, 1u, is_reached);
}
