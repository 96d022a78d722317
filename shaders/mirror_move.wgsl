// Moves the mirror point of each pixel that the camera sees, and its normal, to a place within the pixel: by the
// mirror's formula if it is drawn by that, else as they change evenly from pixel to pixel. All pixels take the same
// place. One thread a pixel.
#import frame_group
#import mirror_formula

// xyz: mirror point, w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// xyz: unit normal towards the eye, w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read> mirrors: array<FormulaMirror>;
@group(1) @binding(3) var point_out: texture_storage_2d<rgba32float, write>;
// xyz: origin of the ray, w: linear depth of the mirror point seen from there.
@group(1) @binding(4) var eye_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;

// Whether any mirror is drawn by its formula.
override has_formulas: bool = false;

// A point and its normal, or how they change.
struct Moved {
    point: vec3f,
    normal: vec3f,
}

@compute @workgroup_size(8, 8)
fn mirror_move(@builtin(global_invocation_id) thread: vec3u) {
    let id = whole_thread(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    var point = textureLoad(point_in, id.xy, 0);
    var normal = textureLoad(normal_in, id.xy, 0);
    if point.w > 0.0 {
        // Of a perfect mirror that shows no glossy one fewer rays may be followed.
        let has_fewer = normal.w <= 0.0 && settings.reflection.bounces == 1u;
        let place = place_in_pixel(frame.sample, select(frame.samples, settings.reflection.samples, has_fewer));
        var moved = Moved(point.xyz, normal.xyz);
        let number = formula_of(point.xyz);
        if number < arrayLength(&mirrors) {
            moved = by_formula(mirrors[number], vec2f(id.xy) + 0.5 + place, moved);
        } else {
            moved = by_neighbors(vec2i(id.xy), place, moved);
        }
        point = vec4f(moved.point, point.w);
        normal = vec4f(moved.normal, normal.w);
    }
    let depth = dot(point.xyz, frame.forward.xyz);
    let eye = select(vec3f(0.0), point.xyz - frame.forward.xyz * depth, frame.orthographic != 0u);
    textureStore(point_out, id.xy, point);
    textureStore(eye_out, id.xy, vec4f(eye, depth));
    textureStore(normal_out, id.xy, normal);
}

// Place `index` of `count` from the pixel's centre: one in each of as many columns, at heights that the golden ratio
// spreads. They come in pairs opposite to one another, from the outermost columns to the middle.
fn place_in_pixel(index: u32, count: u32) -> vec2f {
    let outward = f32(count - 1u) * 0.5 - f32(index / 2u);
    let column = select(outward, -outward, index % 2u == 1u);
    let height = column * 0.6180339887;
    return vec2f(column / f32(count), height - round(height));
}

// The number of the mirror that is drawn by its formula and has this point; more than any if none has.
fn formula_of(point: vec3f) -> u32 {
    var number = 0xffffffffu;
    for (var i = 0u; has_formulas && i < arrayLength(&mirrors); i++) {
        if number == 0xffffffffu && mirrors[i].as_points == 0u && leave(mirrors[i], point) > 0.0 {
            number = i;
        }
    }
    return number;
}

// Where the ray through a place of the picture meets the mirror. One that passes beside it leaves the point where it
// is.
fn by_formula(mirror: FormulaMirror, pixel: vec2f, center: Moved) -> Moved {
    let is_parallel = frame.orthographic != 0u;
    let through = view_from_pixel(frame, pixel, select(1.0, 0.0, is_parallel));
    let origin = select(vec3f(0.0), world_direction(frame, through), is_parallel);
    let direction = select(normalize(world_direction(frame, through)), frame.forward.xyz, is_parallel);
    let hit = formula_hit(mirror, origin, direction, frame.near);
    let normal = select(hit.normal, -hit.normal, dot(hit.normal, direction) > 0.0);
    let is_hit = hit.distance > 0.0;
    return Moved(select(center.point, origin + direction * hit.distance, is_hit), select(center.normal, normal, is_hit));
}

fn by_neighbors(pixel: vec2i, place: vec2f, center: Moved) -> Moved {
    let sideways = change(pixel, vec2i(1, 0), place.x, center);
    let upright = change(pixel, vec2i(0, 1), place.y, center);
    let point = center.point + sideways.point + upright.point;
    let normal = normalize(center.normal + sideways.normal + upright.normal);
    let sight = select(point, frame.forward.xyz, frame.orthographic != 0u);
    return Moved(point, select(center.normal, normal, dot(normal, sight) < 0.0));
}

// The change of point and normal from the pixel's centre to `along` pixels beside it on one axis: towards the neighbour
// there, else away from the other one, else none.
fn change(pixel: vec2i, axis: vec2i, along: f32, center: Moved) -> Moved {
    let side = axis * select(-1, 1, along > 0.0);
    var share = abs(along);
    var other = pixel + side;
    if !is_same_mirror(other, center) {
        other = pixel - side;
        share = select(0.0, -share, is_same_mirror(other, center));
    }
    let at = clamp(other, vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1);
    let offset = textureLoad(point_in, at, 0).xyz - center.point;
    let turn = textureLoad(normal_in, at, 0).xyz - center.normal;
    return Moved(select(vec3f(0.0), offset * share, share != 0.0), select(vec3f(0.0), turn * share, share != 0.0));
}

// Normals of one mirror turn by less than this from pixel to pixel.
const LEAST_COSINE: f32 = 0.4;
// A neighbour's point is at most as many pixels away as a plane seen this flatly has them.
const MOST_PIXELS: f32 = 16.0;
// How far from the chord's level it may be: a curved surface leaves its mean tangent by the square of the chord.
const MOST_SLOPE: f32 = 0.25;

fn is_same_mirror(pixel: vec2i, center: Moved) -> bool {
    if any(pixel < vec2i(0)) || any(pixel >= vec2i(i32(frame.width), i32(frame.height))) {
        return false;
    }
    let other = textureLoad(point_in, pixel, 0);
    let other_normal = textureLoad(normal_in, pixel, 0).xyz;
    let offset = other.xyz - center.point;
    let wide = pixels_per_unit(frame, dot(center.point, frame.forward.xyz)) * length(offset);
    let off_level = abs(dot(offset, center.normal + other_normal)) * 0.5;
    return other.w > 0.0 && dot(center.normal, other_normal) > LEAST_COSINE && wide < MOST_PIXELS
        && off_level <= MOST_SLOPE * length(offset);
}
