// Forward methods, depth pass (Preiner 2010, section 4.5.2): the distance of the nearest point reflected in each mirror
// pixel. One workgroup a block of points.
#import blocks
#import mirror_splat

// Indexed by point of the page, round by round.
@group(2) @binding(0) var<storage, read> solutions: array<Solution>;
// w: specular intensity, 0 where there is no mirror.
@group(2) @binding(1) var point_in: texture_2d<f32>;
// The nearness of the nearest point; 0 if there is none.
@group(2) @binding(2) var<storage, read_write> nearest: array<atomic<u32>>;

@compute @workgroup_size(128)
fn mirror_depth(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_block(group, groups, lane);
}

fn splat_point(item: Item, index: u32) {
    var has_more = true;
    for (var round = 0u; round < rounds && has_more; round++) {
        let solution = solutions[index + round * page.point_count];
        has_more = solution.distance != 0.0;
        if has_more {
            splat_solution(solution);
        }
    }
}

fn splat_solution(solution: Solution) {
    let far = settings.sscr.mirror_z_far * frame.scene_radius;
    let size = vec2u(frame.width, frame.height);
    let splat = splat_of_solution(solution, settings.sscr.max_splat_size, far, size);
    let key = nearness(solution.distance);
    for (var y = splat.first.y; y <= splat.last.y; y++) {
        for (var x = splat.first.x; x <= splat.last.x; x++) {
            let pixel = u32(y) * frame.width + u32(x);
            if atomicLoad(&nearest[pixel]) < key && textureLoad(point_in, vec2i(x, y), 0).w > 0.0 {
                atomicMax(&nearest[pixel], key);
            }
        }
    }
}
