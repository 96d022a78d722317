// Blurs what glossy mirrors receive along one axis of the picture: each pixel takes the mean of a stretch as long as its
// lobe is wide where its rays end, so that few rays show less noise, and what is near to its mirror stays sharp. A perfect
// mirror keeps what it has. One thread a pixel.
#import frame_group
#import lobe

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// x: the sum of the distances at which the rays met something, y: that of their weights.
@group(1) @binding(3) var<storage, read> distances: array<vec2f>;
// a: the mean share of the reflections that is left.
@group(1) @binding(4) var received_in: texture_2d<f32>;
@group(1) @binding(5) var received_out: texture_storage_2d<rgba16float, write>;

// Set if the axis is the picture's columns.
override is_upright: bool = false;

// Neighbours are of one mirror if their intensities, powers and depths differ by at most this share, and their normals by
// at most 20 degrees.
const SAME_MIRROR: f32 = 0.05;
const SAME_SIDE: f32 = 0.9397;
// The widest lobe that is blurred for: 80 degrees to either side.
const WIDEST: f32 = 1.3963;

struct GlossyPoint {
    point: vec3f,
    normal: vec3f,
    intensity: f32,
    power: f32,
    direction: vec3f,
}

@compute @workgroup_size(8, 8)
fn gloss_blur(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let center = vec2i(id);
    let axis = select(vec2i(1, 0), vec2i(0, 1), is_upright);
    let mirror = mirror_at(center);
    let met = distances[id.y * frame.width + id.x];
    let received = textureLoad(received_in, id, 0);
    var half_length = 0.5;
    if mirror.intensity > 0.0 && mirror.power > 0.0 && met.y > 0.0 {
        half_length = 0.5 * length_of(center, axis, mirror, met.x / met.y);
    }
    let reach = i32(ceil(half_length - 0.5));
    var sum = received;
    var weights = 1.0;
    for (var step = 1; step <= 2 * reach; step++) {
        let offset = select(-((step + 1) / 2), (step + 1) / 2, step % 2 == 1);
        let at = center + offset * axis;
        let inside = clamp(at, vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1);
        let is_same = all(inside == at) && is_same_mirror(mirror, mirror_at(inside));
        let weight = select(0.0, clamp(half_length + 0.5 - f32(abs(offset)), 0.0, 1.0), is_same);
        sum += weight * textureLoad(received_in, inside, 0);
        weights += weight;
    }
    textureStore(received_out, id, sum / weights);
}

fn mirror_at(pixel: vec2i) -> GlossyPoint {
    let point = textureLoad(point_in, pixel, 0);
    let surface = textureLoad(normal_in, pixel, 0);
    let normal = normalize(select(vec3f(0.0, 0.0, 1.0), surface.xyz, point.w > 0.0));
    let direction = reflect(normalize(point.xyz - textureLoad(eye_in, pixel, 0).xyz), normal);
    return GlossyPoint(point.xyz, normal, point.w, surface.w, direction);
}

fn is_same_mirror(mirror: GlossyPoint, other: GlossyPoint) -> bool {
    let depths = vec2f(dot(frame.forward.xyz, mirror.point), dot(frame.forward.xyz, other.point));
    return other.intensity > 0.0
        && abs(other.intensity - mirror.intensity) <= SAME_MIRROR * mirror.intensity
        && abs(other.power - mirror.power) <= SAME_MIRROR * mirror.power
        && dot(other.normal, mirror.normal) >= SAME_SIDE
        && depth_step(frame, min(depths.x, depths.y), max(depths.x, depths.y)) <= SAME_MIRROR;
}

// The length in pixels of the stretch that a pixel takes the mean of: the width of its lobe at the distance that its rays
// go, over what the perfect reflection moves from pixel to pixel there.
fn length_of(center: vec2i, axis: vec2i, mirror: GlossyPoint, far: f32) -> f32 {
    // The median angle of the lobe: half of the rays leave at less. A normal that turns, turns directions twice as far.
    var power = mirror.power;
    if settings.gloss.lobe == GLOSS_LOBE_ASHIKHMIN_SHIRLEY {
        // The narrower of both directions.
        power *= max(settings.gloss.across, 1.0);
    }
    let height = lobe_height(0.5, power);
    let angle = atan2(sqrt(height * (2.0 - height)), 1.0 - height);
    let widest = min(select(2.0 * angle, angle, settings.gloss.lobe == GLOSS_LOBE_PHONG), WIDEST);
    var moved = vec3f(0.0);
    var steps = 0.0;
    for (var side = -1; side <= 1; side += 2) {
        let at = center + side * axis;
        let inside = clamp(at, vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1);
        let other = mirror_at(inside);
        if all(inside == at) && is_same_mirror(mirror, other) {
            moved += f32(side) * (other.point - mirror.point + far * (other.direction - mirror.direction));
            steps += 1.0;
        }
    }
    // Along the ray nothing moves on the picture.
    moved -= mirror.direction * dot(mirror.direction, moved);
    let pixel = length(moved) / max(steps, 1.0);
    let asked = settings.gloss.blur * 2.0 * far * tan(widest) / max(pixel, 1e-20);
    return select(1.0, clamp(asked, 1.0, settings.gloss.blur_most), steps > 0.0);
}
