// A point as an oriented disc or ellipse on the screen: the pixels that it covers and its depth there. Every splatting pass uses
// it, so that all of them agree on the same fragments.
#import finite
#import frame
#import packing
#import params

// A run of points with one origin and one material (a chunk). Filled by crates/render/src/store.rs.
struct Item {
    // xyz: origin of the positions relative to the eye, world axes. w: radius of points that have none.
    origin_radius: vec4f,
    // Ramp position of a value is (value - low) * inverse_range.
    low: f32,
    inverse_range: f32,
    // COLOR_*, see color.wgsl.
    color_source: u32,
    // sRGB, red in the low byte.
    plain: u32,
    specular_intensity: f32,
    specular_power: f32,
    // Where the colours of its ramp, or those of the classes, begin in the palette.
    palette: u32,
    // Height of the origin above the reference height, along the up axis `height_axis`.
    height: f32,
    // w: index of refraction; 0 where no light goes through.
    height_axis: vec4f,
}

// The value is that of crates/render/src/layout.rs.
const BLOCK_POINTS: u32 = 1024u;

// A run of at most BLOCK_POINTS points of one item: what one workgroup splats.
struct Block {
    item: u32,
    // The index of the first point in the page.
    first: u32,
    count: u32,
    // The identity of its first point: the others follow.
    first_identity: u32,
}

// The values of one page of the point store.
struct Page {
    // The number of blocks, or of words of the runs (point_surface.wgsl).
    run_count: u32,
    // The number of points that it has room for.
    point_count: u32,
    // 1 for the first page of the frame, which writes the empty pixels.
    is_first: u32,
    // One point in so many of a block is splatted.
    step: u32,
    // Where the blocks or the runs begin in the tables, and the items.
    runs_at: u32,
    items_at: u32,
    // At least 1.
    item_count: u32,
    unused: u32,
}

// A point that covers one pixel: the pixel that contains its centre.
struct Single {
    pixel: u32,
    is_drawn: bool,
    // The position in view space.
    center: vec3f,
}

// The position in view space of a point, relative to the eye in the world's axes.
fn center_of_splat(frame: Frame, relative: vec3f) -> vec3f {
    let center = view_from_relative(frame, relative);
    return vec3f(center.xy, select(center.z, max(center.z, -frame.near), frame.near < 0.0));
}

fn single_of_point(frame: Frame, item: Item, point: vec4u) -> Single {
    let center = center_of_splat(frame, bitcast<vec3f>(point.xyz) + item.origin_radius.xyz);
    let pixel = floor(pixel_from_view(frame, center));
    let size = vec2f(f32(frame.width), f32(frame.height));
    let is_drawn = is_place(point.xyz) && center.z > frame.near && center.z < 3e38 && all(pixel >= vec2f(0.0)) && all(pixel < size);
    return Single(u32(pixel.y) * frame.width + u32(pixel.x), is_drawn, center);
}

struct Disc {
    // The position in view space.
    center: vec3f,
    // The radius in world units, after the limits in pixels; the long half axis of an ellipse.
    radius: f32,
    // The normal in view space, towards the eye; zero if the disc faces the eye.
    normal: vec3f,
    // In view space.
    stretch: Stretch,
    pixel: vec2f,
    // 0: not drawn.
    radius_pixels: f32,
    // The pixels that may be covered, inclusive.
    first: vec2i,
    last: vec2i,
    // Covers one pixel's centre or less: needs no orientation, and reading the normal would cost as much as the
    // position.
    is_single: bool,
}

const ROUND: Stretch = Stretch(vec3f(0.0), 1.0);
const NOT_DRAWN: Disc = Disc(vec3f(0.0), 0.0, vec3f(0.0), ROUND, vec2f(0.0), 0.0, vec2i(0), vec2i(-1), false);

// `point`: f32 bits of the position, and radius | class << 16 | flags << 24.
fn disc_of_point(frame: Frame, splat: Splat, item: Item, point: vec4u) -> Disc {
    let relative = bitcast<vec3f>(point.xyz) + item.origin_radius.xyz;
    let center = center_of_splat(frame, relative);
    if !is_place(point.xyz) || !(center.z > frame.near && center.z < 3e38) {
        return NOT_DRAWN;
    }
    let pixel = pixel_from_view(frame, center);
    let scale = pixels_per_unit(frame, center.z);
    let own_radius = unpack_radius(point.w & 0xffffu);
    let radius = select(own_radius, item.origin_radius.w, own_radius == 0.0) * splat.size;
    let radius_pixels = clamp(radius * scale, splat.min_pixels * 0.5, max(splat.max_pixels, splat.min_pixels) * 0.5);
    let size = vec2f(f32(frame.width), f32(frame.height));
    if !(all(pixel + radius_pixels >= vec2f(0.0)) && all(pixel - radius_pixels < size)) {
        return NOT_DRAWN;
    }
    // Pixel centres within the radius, and always the pixel that holds the centre.
    let holds = vec2i(floor(pixel));
    let first = min(vec2i(ceil(pixel - radius_pixels - 0.5)), holds);
    let last = max(vec2i(floor(pixel + radius_pixels - 0.5)), holds);
    let is_single = all(first == last);
    // On the screen, `first` is not beyond `last`; off it, by less than a pixel, it may be.
    let shown_first = max(first, vec2i(0));
    let shown_last = min(last, vec2i(size) - 1);
    if any(shown_first > shown_last) {
        return NOT_DRAWN;
    }
    let shown_radius = max(radius_pixels, 1e-6);
    let shown = radius_pixels / scale;
    return Disc(center, shown, vec3f(0.0), ROUND, pixel, shown_radius, shown_first, shown_last, is_single);
}

// A disc with the normal and the shape of its point; `packed` has its packed radius in the lower 16 bits. An ellipse may
// cover no pixel: then `first` is beyond `last`.
fn oriented_disc(frame: Frame, facing: Disc, packed: u32, packed_normal: u32) -> Disc {
    var disc = facing;
    disc.normal = normal_toward_eye(frame, disc.center, packed_normal);
    let shape = packed & 0xffffu;
    if (shape & SHAPE_BITS) == 0u {
        return narrowed(frame, disc);
    }
    let stretch = unpack_stretch(shape, unpack_normal(packed_normal));
    disc.stretch = Stretch(view_from_relative(frame, stretch.axis), stretch.ratio);
    // The box about an ellipse is far smaller than that about its long axis.
    let long = disc.radius * disc.stretch.axis;
    let short = disc.radius / stretch.ratio * cross(disc.normal, disc.stretch.axis);
    let extent = sqrt(long * long + short * short) * (1.0 + 1e-4);
    let nearest = disc.center.z - extent.z;
    if stretch.ratio == 1.0 || !(nearest > frame.near) {
        return disc;
    }
    let slope = select(abs(disc.center.xy / disc.center.z), vec2f(0.0), frame.orthographic != 0u);
    let reach = pixels_per_unit(frame, nearest) * (extent.xy + slope * extent.z) + 0.01;
    let holds = vec2i(floor(disc.pixel));
    disc.first = max(disc.first, min(vec2i(ceil(disc.pixel - reach - 0.5)), holds));
    disc.last = min(disc.last, max(vec2i(floor(disc.pixel + reach - 0.5)), holds));
    return disc;
}

// A round disc with a box about what it covers as it is turned: half of the pixels about a floor seen at 30 degrees are
// beside it. The margins are wider than what rounding moves its rim.
fn narrowed(frame: Frame, oriented: Disc) -> Disc {
    var disc = oriented;
    let normal = disc.normal;
    let nearest = disc.center.z - 1.01 * disc.radius * sqrt(max(1.0 - normal.z * normal.z, 0.0));
    if all(normal == vec3f(0.0)) || !(nearest > frame.near) {
        return disc;
    }
    // How far the disc reaches at right angles to the planes of sight through its middle that are upright and level.
    let slope = select(disc.center.xy / disc.center.z, vec2f(0.0), frame.orthographic != 0u);
    let across = normal.xy - slope * normal.z;
    let width = sqrt(max(1.0 + slope * slope - across * across, vec2f(0.0)) + 1e-4);
    let reach = 1.01 * pixels_per_unit(frame, nearest) * disc.radius * width + 0.05;
    let holds = vec2i(floor(disc.pixel));
    disc.first = max(disc.first, min(vec2i(ceil(disc.pixel - reach - 0.5)), holds));
    disc.last = min(disc.last, max(vec2i(floor(disc.pixel + reach - 0.5)), holds));
    return disc;
}

// The view-space normal of a point towards the eye; zero if it has none.
fn normal_toward_eye(frame: Frame, center: vec3f, packed_normal: u32) -> vec3f {
    let normal = view_from_relative(frame, unpack_normal(packed_normal));
    let away = select(dot(normal, center), normal.z, frame.orthographic != 0u);
    return select(normal, -normal, away > 0.0);
}

struct Fragment {
    // Linear depth; 0: the pixel is outside the disc.
    depth: f32,
    // 1 in the centre, 0 at the rim.
    weight: f32,
}

// The view-space point at which the ray through a pixel coordinate meets a point's plane.
fn hit_of_plane(frame: Frame, center: vec3f, normal: vec3f, pixel: vec2f) -> vec3f {
    let slope = slope_from_pixel(frame, pixel);
    if frame.orthographic != 0u {
        return vec3f(slope, dot(normal, center - vec3f(slope, 0.0)) / normal.z);
    }
    let direction = vec3f(slope, 1.0);
    return direction * (dot(normal, center) / dot(normal, direction));
}

// The steepest surface whose plane is used beside a point: 80 degrees.
const STEEPEST: f32 = 6.0;

// The depth at a pixel's centre of a surface whose depth is `own` at a point `width` world units beside it; `plane` is
// the depth of the point's plane there. With the point's own depth a slanted surface would shift to the side, and the
// nearer of several points would win. Seen edge-on, or without a normal, `plane` is no number and the result is the point's own depth.
fn depth_beside(own: f32, plane: f32, width: f32) -> f32 {
    return select(own, plane, is_finite(plane) && abs(plane - own) <= STEEPEST * width);
}

// Perspective-correct: the ray through the pixel's centre meets the disc's plane.
fn fragment_of_disc(frame: Frame, disc: Disc, pixel: vec2i) -> Fragment {
    let at = vec2f(pixel) + 0.5;
    let is_center = all(pixel == vec2i(floor(disc.pixel)));
    // The pixel that holds the centre is always covered, so that discs seen edge-on leave no holes.
    if all(disc.normal == vec3f(0.0)) {
        let offset = (at - disc.pixel) / disc.radius_pixels;
        let outside = dot(offset, offset);
        if outside > 1.0 {
            return Fragment(select(0.0, disc.center.z, is_center), 0.0);
        }
        return Fragment(disc.center.z, 1.0 - outside);
    }
    let hit = hit_of_plane(frame, disc.center, disc.normal, at);
    let offset = hit - disc.center;
    let outside = stretched_square(disc.stretch, offset) / (disc.radius * disc.radius);
    // A plane through the eye falls back.
    if !(is_finite(outside) && outside <= 1.0 && hit.z > frame.near) {
        let half_pixel = 0.5 * disc.radius / disc.radius_pixels;
        return Fragment(select(0.0, depth_beside(disc.center.z, hit.z, half_pixel), is_center), 0.0);
    }
    return Fragment(hit.z, 1.0 - outside);
}

// Depths are averaged as shares of the front depth, from this one on: planes of front points may be nearer than those.
const LEAST_BEHIND: f32 = -0.0625;
// To a quarter of the front depth behind it: splats are limited to fewer pixels than that.
const BEHIND_RANGE: f32 = 0.3125;

// Added to the components of normals, 11 bits and sign, to sum them unsigned.
const NORMAL_BIAS: i32 = 2048;

// Albedos are summed in 16 bits: levels of 8-bit sRGB are 20 of these steps apart or more, so that data colours come
// back exactly.
const ALBEDO_MOST: f32 = 65535.0;

// The words per pixel of the sums of the highlights: two sums, and their carries.
const SPECULAR_WORDS: u32 = 4u;

// Depth as an integer that is larger for nearer points: 0 means "empty", and a cleared buffer is all zero.
fn nearness(depth: f32) -> u32 {
    return 0xffffffffu - bitcast<u32>(depth);
}

fn depth_from_nearness(key: u32) -> f32 {
    return bitcast<f32>(0xffffffffu - key);
}
