// Finds the nearest point of each pixel behind the surface that the camera sees, or the nearest whose stored normal
// points away. Runs twice: first for depths, then for identities.
#import nearest_point
#import hit
#import run

// The camera's picture, see screen_planes.wgsl.
@group(2) @binding(0) var<storage, read> records: array<vec4u>;
// Two words a pixel: identity of the point, nearness. 0: empty.
@group(2) @binding(1) var<storage, read_write> nearest: array<atomic<u32>>;
@group(2) @binding(2) var<uniform> run: Run;

@compute @workgroup_size(128)
fn splat_behind(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn put(pixel: u32, depth: f32, identity: u32) {
    let finds_identity = run.finds_identity != 0u;
    let key = nearness(depth);
    let so_far = atomicLoad(&nearest[pixel * 2u + 1u]);
    if select(key <= so_far, key < so_far, finds_identity) || !is_behind(pixel, depth, identity) {
        return;
    }
    if finds_identity {
        atomicMax(&nearest[pixel * 2u], identity);
    } else {
        atomicMax(&nearest[pixel * 2u + 1u], key);
    }
}

fn is_behind(pixel: u32, depth: f32, identity: u32) -> bool {
    let front = bitcast<f32>(records[pixel].y);
    let index = identity - identities_from;
    if settings.screen_trace.back == SCREEN_TRACE_BACK_CULLED {
        let place = vec2f(vec2u(pixel % frame.width, pixel / frame.width)) + 0.5;
        let sight = world_direction(frame, view_from_pixel(frame, place, select(1.0, 0.0, frame.orthographic != 0u)));
        let toward = select(sight, frame.forward.xyz, frame.orthographic != 0u);
        return dot(unpack_normal(attributes[index].y), toward) > 0.0;
    }
    let width = 1.0 / pixels_per_unit(frame, depth);
    let own = unpack_radius(points[index].w & 0xffffu);
    let radius = select(own, item_at(item_of_block).origin_radius.w, own == 0.0) * settings.splat.size;
    // Empty pixels have nothing behind them but what formulas hide.
    return front > 0.0 && depth > front + 2.0 * max(radius, width);
}
