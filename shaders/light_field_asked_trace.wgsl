// Finds the nearest disc of a page of points on the line of sight through the middle of each listed texel of a mirror's
// maps. Runs once for each page; later pages start from what earlier ones found. One thread a texel.
#import frame_group
#import surfel_rays
#import asked_texels

@group(1) @binding(0) var<storage, read> tops: array<Node>;
@group(1) @binding(1) var<storage, read> nodes: array<Node>;
@group(1) @binding(2) var<storage, read> surfels: array<vec2u>;
@group(1) @binding(3) var<storage, read> order: array<u32>;
@group(1) @binding(4) var<storage, read> shown: array<u32>;
@group(1) @binding(5) var<storage, read> maps: AskedMaps;
// See light_field_ask.wgsl.
@group(1) @binding(6) var<storage, read> asked: array<u32>;
// For each listed texel, x: identity of the nearest point + 1, 0: nothing. y: f32 bits of its linear depth.
@group(1) @binding(7) var<storage, read_write> found: array<vec2u>;

@compute @workgroup_size(8, 8)
fn light_field_asked_trace(@builtin(global_invocation_id) invocation: vec3u) {
    let entry = list_entry(whole_thread(frame, invocation), frame.columns);
    if entry >= min(asked[0], arrayLength(&asked) - 1u) {
        return;
    }
    let texel = asked_texel(vec2u(maps.size, maps.texels_of_face), asked[1u + entry]);
    let middle = maps.middles[texel.slot];
    if u32(middle.w) != maps.mirror {
        return;
    }
    let face = cube_face(middle.xyz, maps.size, texel.face, 0u, 0);
    let sight = sight_of(face, vec2f(texel.at) + 0.5).direction;
    let length_of_depth = length(sight);
    var direction = sight / length_of_depth;
    // Keeps inverses finite.
    direction = select(direction, vec3f(1e-12), abs(direction) < vec3f(1e-12));
    var nearest = Nearest(3e38, 3e38, NONE, 0u, 0u);
    let before = found[entry];
    if before.x != 0u {
        let distance = bitcast<f32>(before.y) * length_of_depth;
        nearest = Nearest(distance, distance, before.x - 1u, 0u, 0u);
    }
    nearest = through_trees(MirrorRay(middle.xyz, direction, 1.0 / direction), 0.0, nearest);
    if nearest.identity != NONE {
        found[entry] = vec2u(nearest.identity + 1u, bitcast<u32>(nearest.distance / length_of_depth));
    }
}
