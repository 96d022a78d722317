// Forward methods, visibility pass (Preiner 2010, sections 3.7 and 4.5.3): all points within the depth offset of the
// nearest add their values to the mirror pixels that they cover. One workgroup a block of points.
#import blocks
#import color
#import mirror_ray
#import mirror_splat
#import mirror_sums

// Indexed by point of the page, round by round.
@group(2) @binding(0) var<storage, read> solutions: array<Solution>;
// xyz: mirror point. w: specular intensity, 0 where there is no mirror.
@group(2) @binding(1) var point_in: texture_2d<f32>;
// Four words a pixel each, see mirror_sums.wgsl.
@group(2) @binding(2) var<storage, read_write> albedo_sums: array<atomic<u32>>;
@group(2) @binding(3) var<storage, read_write> normal_sums: array<atomic<u32>>;
@group(2) @binding(4) var<storage, read_write> position_sums: array<atomic<u32>>;
// Half as many words of carries, then the nearest points (see MIRROR_CARRIES).
@group(2) @binding(5) var<storage, read_write> carries: array<atomic<u32>>;
@group(2) @binding(6) var normal_in: texture_2d<f32>;
@group(2) @binding(7) var eye_in: texture_2d<f32>;

@compute @workgroup_size(128)
fn mirror_visibility(
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
            splat_solution(item, index, solution);
        }
    }
}

fn splat_solution(item: Item, index: u32, solution: Solution) {
    let far = settings.sscr.mirror_z_far * frame.scene_radius;
    let size = vec2u(frame.width, frame.height);
    let splat = splat_of_solution(solution, settings.sscr.max_splat_size, far, size);
    let point = points[index];
    let color_normal = attributes[index];
    let albedo = vec3u(albedo_of_point(item, index, point, color_normal) * 4095.0 + 0.5);
    let q = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let own = unpack_normal(color_normal.y);
    let carry_words = size.x * size.y * MIRROR_CARRIES;
    let first_nearest = (carry_words + CARRY_ALIGNMENT - 1u) / CARRY_ALIGNMENT * CARRY_ALIGNMENT;
    for (var y = splat.first.y; y <= splat.last.y; y++) {
        for (var x = splat.first.x; x <= splat.last.x; x++) {
            let pixel = u32(y) * frame.width + u32(x);
            // Without a mirror there is no nearest point, and `farthest` is not a number.
            let front = depth_from_nearness(atomicLoad(&carries[first_nearest + pixel]));
            let farthest = farthest_counted(front, frame.scene_radius);
            if solution.distance <= farthest {
                let mirror_point = textureLoad(point_in, vec2i(x, y), 0).xyz;
                var toward = q - mirror_point;
                if own_sides {
                    let normal = textureLoad(normal_in, vec2i(x, y), 0).xyz;
                    let eye = textureLoad(eye_in, vec2i(x, y), 0).xyz;
                    toward = on_plane(toward, own, reflected_direction(mirror_point, normal, eye));
                }
                let facing = select(own, -own, dot(own, toward) > 0.0);
                let normal = vec3u(vec3i(round(facing * 2047.0)) + NORMAL_BIAS);
                let relative = clamp(toward / (POSITION_REACH * farthest), vec3f(-1.0), vec3f(1.0));
                let position = vec3u((relative + 1.0) * POSITION_STEPS + 0.5);
                add_to_albedo(pixel, 0u, 1u);
                for (var axis = 0u; axis < 3u; axis++) {
                    add_to_albedo(pixel, 1u + axis, albedo[axis]);
                    add_to_normal(pixel, axis, normal[axis]);
                    add_to_position(pixel, axis, position[axis]);
                }
                if item.specular_intensity > 0.0 {
                    add_to_normal(pixel, 3u, u32(item.specular_intensity * 1023.0 + 0.5));
                    add_to_position(pixel, 3u, u32(item.specular_power + 0.5));
                }
            }
        }
    }
}

// Where a reflected ray meets a point's plane, from the mirror point; the point itself if the plane is seen edge-on, or
// if it has none. With the points themselves, slanted surfaces would be seen in steps as wide as the splats.
fn on_plane(toward: vec3f, normal: vec3f, direction: vec3f) -> vec3f {
    let along = dot(toward, direction);
    let beside = length(toward - along * direction);
    let plane = dot(normal, toward) / dot(normal, direction);
    return select(toward, plane * direction, is_finite(plane) && plane > 0.0 && abs(plane - along) <= STEEPEST * beside);
}

fn add_to_albedo(pixel: u32, word: u32, value: u32) {
    carry(pixel, word, atomicAdd(&albedo_sums[pixel * 4u + word], value), value);
}

fn add_to_normal(pixel: u32, word: u32, value: u32) {
    carry(pixel, 4u + word, atomicAdd(&normal_sums[pixel * 4u + word], value), value);
}

fn add_to_position(pixel: u32, word: u32, value: u32) {
    carry(pixel, 8u + word, atomicAdd(&position_sums[pixel * 4u + word], value), value);
}

// A sum that wraps adds one to its half of a word of carries.
fn carry(pixel: u32, word: u32, before: u32, value: u32) {
    if before > 0xffffffffu - value {
        atomicAdd(&carries[(pixel * MIRROR_SUMS + word) / 2u], 1u << (16u * (word & 1u)));
    }
}
