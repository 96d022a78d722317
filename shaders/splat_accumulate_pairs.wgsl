// The same as splat_accumulate with two sums an atomic operation: on processors, half of the time of that pass is atomic
// operations. Both sums of a pair lie in one word of 64 bits. What the lower one carries is added to the upper one, too, and
// splat_average takes it from there.
#import accumulate

// Two words a pixel: identity of the point, nearness.
@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
// Two pairs a pixel: weight, albedo * weight.
@group(2) @binding(1) var<storage, read_write> color_sums: array<atomic<u64>>;
// Two pairs a pixel: (normal + NORMAL_BIAS) * weight, depth behind the front as a share of BEHIND_RANGE * weight.
@group(2) @binding(2) var<storage, read_write> surface_sums: array<atomic<u64>>;
// Three words a pixel: specular intensity and power * weight, and their carries.
@group(2) @binding(3) var<storage, read_write> specular_sums: array<atomic<u32>>;
// Two pairs of words a pixel: the carries of color_sums and surface_sums, 16 bits each.
@group(2) @binding(4) var<storage, read_write> carries: array<atomic<u64>>;

@compute @workgroup_size(128)
fn splat_accumulate_pairs(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn add_sums(pixel: u32, color: vec4u, shape: vec4u) {
    let at = pixel * 2u;
    let color_first = pair(color.x, color.y);
    let color_second = pair(color.z, color.w);
    let shape_first = pair(shape.x, shape.y);
    let shape_second = pair(shape.z, shape.w);
    let color_carry = pair(
        carry_of_pair(atomicAdd(&color_sums[at], color_first), color_first),
        carry_of_pair(atomicAdd(&color_sums[at + 1u], color_second), color_second),
    );
    let shape_carry = pair(
        carry_of_pair(atomicAdd(&surface_sums[at], shape_first), shape_first),
        carry_of_pair(atomicAdd(&surface_sums[at + 1u], shape_second), shape_second),
    );
    if (color_carry | shape_carry) != 0lu {
        atomicAdd(&carries[at], color_carry);
        atomicAdd(&carries[at + 1u], shape_carry);
    }
}

fn pair(low: u32, high: u32) -> u64 {
    return (u64(high) << 32u) | u64(low);
}

// Of a pair of sums, before a pair of values was added: each sum that wraps adds one to its half of a word of carries.
fn carry_of_pair(before: u64, value: u64) -> u32 {
    let sum = before + value;
    return select(0u, 1u, u32(sum) < u32(value)) | select(0u, 1u << 16u, sum < value);
}
