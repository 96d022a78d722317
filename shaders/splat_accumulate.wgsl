// High quality: every fragment within the depth offset of the pixel's nearest one adds its colour, normal and depth, by its
// weight (Botsch et al. 2005, visibility splatting; here with integer atomics, so the order of the points cannot matter).
// Sums are fixed-point words with 16 bits of carry each, so that a pixel can take all points there are.
#import large_discs
#import color

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

fn splat_point(item: Item, index: u32) {
    let point = points[index];
    if !is_shown(index) {
        return;
    }
    if hides_backs && is_turned_away(item, point, index) {
        return;
    }
    var disc: Disc;
    if !pixels_only {
        disc = disc_of_point(frame, settings.splat, item, point);
        if disc.radius_pixels == 0.0 {
            return;
        }
    }
    if pixels_only || disc.is_single {
        let single = single_of_point(frame, item, point);
        if !single.is_drawn {
            return;
        }
        let front = front_depth(single.pixel);
        // A single pixel counts as half a pixel in radius, however small the disc is.
        let half_pixel = 0.5 / pixels_per_unit(frame, single.center.z);
        let offset = half_pixel * settings.splat.depth_offset;
        // Most points of a dense scan are hidden: they are rejected before anything else of them is read.
        if single.center.z <= front + offset {
            let surface = surface_of_point(item, point, index, single.center);
            let at = floor(pixel_from_view(frame, single.center)) + 0.5;
            let plane = hit_of_plane(frame, single.center, surface.normal_in_view, at);
            let depth = depth_beside(single.center.z, plane.z, half_pixel);
            add(single.pixel, item, surface, Fragment(depth, 1.0), front);
        }
        return;
    }
    if is_shared(disc) {
        put_off(index);
        return;
    }
    let surface = surface_of_point(item, point, index, disc.center);
    disc = oriented_disc(frame, disc, point.w, attributes[index].y);
    for (var y = disc.first.y; y <= disc.last.y; y++) {
        for (var x = disc.first.x; x <= disc.last.x; x++) {
            add_fragment(disc, vec2i(x, y), item, surface);
        }
    }
}

fn splat_large(item: Item, index: u32, lane: u32) {
    let point = points[index];
    var disc = disc_of_point(frame, settings.splat, item, point);
    let surface = surface_of_point(item, point, index, disc.center);
    disc = oriented_disc(frame, disc, point.w, attributes[index].y);
    for (var i = lane; i < pixels_of_disc(disc); i += LANES) {
        add_fragment(disc, pixel_of_disc(disc, i), item, surface);
    }
}

fn add_fragment(disc: Disc, at: vec2i, item: Item, surface: PointSurface) {
    let fragment = fragment_of_disc(frame, disc, at);
    if fragment.depth > 0.0 {
        let pixel = u32(at.y) * frame.width + u32(at.x);
        let front = front_depth(pixel);
        if fragment.depth <= front + disc.radius * settings.splat.depth_offset {
            add(pixel, item, surface, fragment, front);
        }
    }
}

struct PointSurface {
    // Linear, ALBEDO_MOST is 1.
    albedo: vec3u,
    // World axes, 11 bits and sign.
    normal: vec3i,
    normal_in_view: vec3f,
}

fn surface_of_point(item: Item, point: vec4u, index: u32, center: vec3f) -> PointSurface {
    let color_normal = attributes[index];
    let albedo = vec3u(albedo_of_point(item, index, point, color_normal) * ALBEDO_MOST + 0.5);
    let normal = normal_toward_eye(frame, center, color_normal.y);
    return PointSurface(albedo, vec3i(round(world_direction(frame, normal) * 2047.0)), normal);
}

fn front_depth(pixel: u32) -> f32 {
    return depth_from_nearness(nearest[pixel].y);
}

fn add(pixel: u32, item: Item, surface: PointSurface, fragment: Fragment, front: f32) {
    let weight = 1u + u32(fragment.weight * 63.0);
    add_color(pixel, 0u, weight);
    add_color(pixel, 1u, surface.albedo.r * weight);
    add_color(pixel, 2u, surface.albedo.g * weight);
    add_color(pixel, 3u, surface.albedo.b * weight);
    let biased = vec3u(surface.normal + NORMAL_BIAS) * weight;
    add_surface(pixel, 0u, biased.x);
    add_surface(pixel, 1u, biased.y);
    add_surface(pixel, 2u, biased.z);
    let behind = u32(clamp(((fragment.depth - front) / front - LEAST_BEHIND) / BEHIND_RANGE, 0.0, 1.0) * 65535.0 + 0.5);
    add_surface(pixel, 3u, behind * weight);
    // Most points are no mirrors and skip this.
    if item.specular_intensity != 0.0 {
        if item.specular_intensity > 0.0 {
            add_specular(pixel, 0u, u32(item.specular_intensity * 1023.0 + 0.5) * weight);
        } else {
            // Gloss. Its sum is too small to wrap: that takes a quarter of a million points in a pixel.
            atomicAdd(&specular_sums[pixel * SPECULAR_WORDS + 3u], u32(-item.specular_intensity * 255.0 + 0.5) * weight);
        }
        add_specular(pixel, 1u, u32(item.specular_power + 0.5) * weight);
    }
}

// A sum that wraps adds one to its half of a word of carries.
fn add_color(pixel: u32, word: u32, value: u32) {
    if atomicAdd(&color_sums[pixel * 4u + word], value) > 0xffffffffu - value {
        atomicAdd(&carries[pixel * 4u + word / 2u], 1u << (16u * (word & 1u)));
    }
}

fn add_surface(pixel: u32, word: u32, value: u32) {
    if atomicAdd(&surface_sums[pixel * 4u + word], value) > 0xffffffffu - value {
        atomicAdd(&carries[pixel * 4u + 2u + word / 2u], 1u << (16u * (word & 1u)));
    }
}

fn add_specular(pixel: u32, word: u32, value: u32) {
    if atomicAdd(&specular_sums[pixel * SPECULAR_WORDS + word], value) > 0xffffffffu - value {
        atomicAdd(&specular_sums[pixel * SPECULAR_WORDS + 2u], 1u << (16u * word));
    }
}
