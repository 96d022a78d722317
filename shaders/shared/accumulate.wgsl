// What a pass needs that sums the fragments near the front of each pixel by their weights, in integers. The importing pass
// defines `add_sums(pixel, color, shape)`, which adds four values of each kind to the pixel's sums and notes what they
// carry, and has the bindings `nearest` and `specular_sums`.
#import large_discs
#import color

// Set where some clouds are mirrors or glossy.
override has_materials: bool = false;

fn splat_point(item: Item, index: u32) {
    let point = points[index];
    if !is_shown(index) {
        return;
    }
    if hides_backs && is_turned_away(item, point, index) {
        return;
    }
    if pixels_only {
        let single = single_of_point(frame, item, point);
        if !single.is_drawn {
            return;
        }
        let front = front_depth(single.pixel);
        let half_pixel = half_pixel_at(single.center);
        // Most points of a dense scan are hidden: they are rejected before anything else of them is read.
        if single.center.z <= front + half_pixel * settings.splat.depth_offset {
            let surface = surface_of_point(item, point, index, single.center);
            let at = floor(pixel_from_view(frame, single.center)) + 0.5;
            let fragment = fragment_of_single(single.center, surface.normal_in_view, at, half_pixel);
            add(single.pixel, item, surface, fragment, front);
        }
        return;
    }
    var disc = disc_of_point(frame, settings.splat, item, point);
    if disc.radius_pixels == 0.0 {
        return;
    }
    if is_shared(disc) {
        put_off(index);
        return;
    }
    if disc.is_single {
        let front = front_depth(u32(disc.first.y) * frame.width + u32(disc.first.x));
        if disc.center.z > front + half_pixel_at(disc.center) * settings.splat.depth_offset {
            return;
        }
    }
    let surface = surface_of_point(item, point, index, disc.center);
    disc = oriented_disc(frame, disc, point.w, attributes[index].y);
    if covers_nothing(disc) {
        return;
    }
    var at = disc.first;
    loop {
        add_fragment(disc, at, item, surface);
        at = next_pixel(disc, at);
        if at.y > disc.last.y {
            break;
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

// A single pixel counts as half a pixel in radius, however small the disc is.
fn half_pixel_at(center: vec3f) -> f32 {
    return 0.5 / pixels_per_unit(frame, center.z);
}

fn fragment_of_single(center: vec3f, normal: vec3f, at: vec2f, half_pixel: f32) -> Fragment {
    let plane = hit_of_plane(frame, center, normal, at);
    return Fragment(depth_beside(center.z, plane.z, half_pixel), 1.0);
}

fn add_fragment(disc: Disc, at: vec2i, item: Item, surface: PointSurface) {
    var fragment = fragment_of_disc(frame, disc, at);
    var seen = fragment.depth;
    var radius = disc.radius;
    if disc.is_single {
        radius = half_pixel_at(disc.center);
        fragment = fragment_of_single(disc.center, surface.normal_in_view, vec2f(at) + 0.5, radius);
        seen = disc.center.z;
    }
    if seen > 0.0 {
        let pixel = u32(at.y) * frame.width + u32(at.x);
        let front = front_depth(pixel);
        if seen <= front + radius * settings.splat.depth_offset {
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

// Each atomic operation is named once, and hardly any is in a branch: software Vulkan runs both sides of every branch, and
// looks at each invocation for an operation that none of them does.
fn add(pixel: u32, item: Item, surface: PointSurface, fragment: Fragment, front: f32) {
    let weight = 1u + u32(fragment.weight * 63.0);
    let color = vec4u(1u, surface.albedo) * weight;
    let behind = u32(clamp(((fragment.depth - front) / front - LEAST_BEHIND) / BEHIND_RANGE, 0.0, 1.0) * 65535.0 + 0.5);
    let shape = vec4u(vec3u(surface.normal + NORMAL_BIAS), behind) * weight;
    add_sums(pixel, color, shape);
    // Most points are no mirrors and skip this.
    if has_materials && item.specular_intensity != 0.0 {
        let is_mirror = item.specular_intensity > 0.0;
        // The sum of gloss is too small to wrap: that takes a quarter of a million points in a pixel.
        let steps = abs(item.specular_intensity) * select(255.0, 1023.0, is_mirror);
        let specular = vec2u(u32(steps + 0.5), u32(item.specular_power + 0.5)) * weight;
        let first = pixel * SPECULAR_WORDS;
        let before = vec2u(
            atomicAdd(&specular_sums[first + select(3u, 0u, is_mirror)], specular.x),
            atomicAdd(&specular_sums[first + 1u], specular.y),
        );
        atomicAdd(&specular_sums[first + 2u], carry_of(before.xyxy, specular.xyxy).x);
    }
}

// Of four sums, before a value was added to each: a sum that wraps adds one to its half of a word of carries.
fn carry_of(before: vec4u, value: vec4u) -> vec2u {
    let wraps = select(vec4u(0u), vec4u(1u), before > vec4u(0xffffffffu) - value);
    return wraps.xz | (wraps.yw << vec2u(16u));
}
