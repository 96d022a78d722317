// High quality: every fragment within the depth offset of the pixel's nearest one adds its colour, normal and depth, by its
// weight (Botsch et al. 2005, visibility splatting; here with integer atomics, so the order of the points cannot matter).
// Sums are fixed-point words with 16 bits of carry each, so that a pixel can take all points there are.
#import accumulate

// Two words a pixel: identity of the point, nearness.
@group(2) @binding(0) var<storage, read> nearest: array<vec2u>;
// Four words a pixel: weight, albedo * weight.
@group(2) @binding(1) var<storage, read_write> color_sums: array<atomic<u32>>;
// Four words a pixel: (normal + NORMAL_BIAS) * weight, depth behind the front as a share of BEHIND_RANGE * weight.
@group(2) @binding(2) var<storage, read_write> surface_sums: array<atomic<u32>>;
// Three words a pixel: specular intensity and power * weight, and their carries.
@group(2) @binding(3) var<storage, read_write> specular_sums: array<atomic<u32>>;
// Four words a pixel: the carries of color_sums and surface_sums, 16 bits each.
@group(2) @binding(4) var<storage, read_write> carries: array<atomic<u32>>;

@compute @workgroup_size(128)
fn splat_accumulate(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) lane: u32,
) {
    splat_discs(group, groups, lane);
}

fn add_sums(pixel: u32, color: vec4u, shape: vec4u) {
    let at = pixel * 4u;
    let color_before = vec4u(
        atomicAdd(&color_sums[at], color.x),
        atomicAdd(&color_sums[at + 1u], color.y),
        atomicAdd(&color_sums[at + 2u], color.z),
        atomicAdd(&color_sums[at + 3u], color.w),
    );
    let shape_before = vec4u(
        atomicAdd(&surface_sums[at], shape.x),
        atomicAdd(&surface_sums[at + 1u], shape.y),
        atomicAdd(&surface_sums[at + 2u], shape.z),
        atomicAdd(&surface_sums[at + 3u], shape.w),
    );
    let carry = vec4u(carry_of(color_before, color), carry_of(shape_before, shape));
    // A loop over these words would count among the 65,535 turns of an invocation on software Vulkan.
    if any(carry != vec4u(0u)) {
        atomicAdd(&carries[at], carry.x);
        atomicAdd(&carries[at + 1u], carry.y);
        atomicAdd(&carries[at + 2u], carry.z);
        atomicAdd(&carries[at + 3u], carry.w);
    }
}
