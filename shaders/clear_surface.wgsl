// Where rays go on behind clear surfaces: the point at which a ray leaves, beneath a surface of points, a plane or a
// paraboloid, or behind a solid, to its second interface and through total reflections; and an origin and a normal from
// which the methods get its direction as that of a reflected ray. Also the ways of such rays inside a solid, one by
// one. One thread a pixel.
#import frame_group
#import mirror_formula
#import refraction

// w: specular intensity; 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
// The index of refraction of the points, see clear_points.wgsl.
@group(1) @binding(3) var points_in: texture_2d<f32>;
@group(1) @binding(4) var<storage, read> mirrors: array<FormulaMirror>;
// xyz: where the ray leaves, w: as in `point_in`, 0 where no light goes through.
@group(1) @binding(5) var point_out: texture_storage_2d<rgba32float, write>;
// w: the distance of the origin; of a way inside a solid, its length.
@group(1) @binding(6) var eye_out: texture_storage_2d<rgba32float, write>;
// w: the share that is reflected of what is not diffuse; if `is_only`, the specular power of what reflects.
@group(1) @binding(7) var normal_out: texture_storage_2d<rgba32float, write>;
// The index of refraction of the surface: below 0 if it bounds no solid, 0 if it is opaque; REFLECTS where `is_only`
// reflects.
@group(1) @binding(8) var index_out: texture_storage_2d<r32float, write>;

// Set if light goes through points of the scene.
override has_points: bool = false;
// Set if the rays that are reflected have none of their own: then the stronger of both parts is followed.
override is_only: bool = false;
// The number of the way inside the solid that is asked for, from one interface to the next; 0: the ray behind the
// solid.
override inner_way: u32 = 0u;

// The most total reflections inside a solid.
const INNER_REFLECTIONS: i32 = 8;
// Stands for the index of refraction of a clear surface that reflects.
const REFLECTS: f32 = 1.0;
// How far a mirror's splats may lie beside its formula, in mirror sizes.
const SPLAT_OFF: f32 = 0.05;

struct ClearSurface {
    // 0 for an opaque surface.
    index: f32,
    // The number of the mirror with a formula; NONE for points that are no such mirror.
    mirror: u32,
}
const NONE: u32 = 0xffffffffu;

@compute @workgroup_size(8, 8)
fn clear_surface(@builtin(global_invocation_id) thread: vec3u) {
    let id = whole_thread(frame, thread).xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    let facing = textureLoad(normal_in, id, 0);
    let eye = textureLoad(eye_in, id, 0);
    let incoming = normalize(point.xyz - eye.xyz);
    var surface = ClearSurface(0.0, NONE);
    if point.w > 0.0 {
        surface = surface_at(id, point.xyz);
    }
    // Splats may turn a little away from the eye.
    let normal = select(facing.xyz, -facing.xyz, dot(facing.xyz, incoming) > 0.0);
    var ratio = surface.index;
    var is_solid = false;
    var is_inside = false;
    if surface.mirror != NONE {
        let mirror = mirrors[surface.mirror];
        is_solid = mirror.x_kind.w == SPHERE || mirror.x_kind.w >= TORUS;
        // An eye inside a solid sees its surface from behind.
        is_inside = is_solid && value_at(mirror, point.xyz - incoming * (4.0 * LEAVE * mirror.z_size.w)) < 0.0;
        ratio = select(ratio, 1.0 / ratio, is_inside);
    }
    var direction = vec3f(0.0);
    var share = 1.0;
    if surface.index > 0.0 {
        direction = refracted(incoming, normal, ratio);
        share = reflected_share(-dot(incoming, normal), ratio);
    }
    let goes_on = dot(direction, direction) > 0.0 && !(is_only && share >= 0.5);
    var leaves = point.xyz;
    // The way inside, if there is one of that number.
    var inner_start = vec3f(0.0);
    var inner_direction = vec3f(0.0, 0.0, 1.0);
    var inner_length = 0.0;
    if goes_on && is_solid && !is_inside {
        let mirror = mirrors[surface.mirror];
        var is_in = true;
        for (var i = 0; i <= INNER_REFLECTIONS && is_in; i++) {
            let hit = formula_hit(mirror, leaves, direction, 2.0 * LEAVE * mirror.z_size.w);
            is_in = hit.distance > 0.0;
            if is_in {
                if u32(i) + 1u == inner_way {
                    inner_start = leaves;
                    inner_direction = direction;
                    // Without its end, which lies on the solid itself.
                    inner_length = hit.distance - 2.0 * LEAVE * mirror.z_size.w;
                }
                leaves += direction * hit.distance;
                let inner = select(hit.normal, -hit.normal, dot(hit.normal, direction) > 0.0);
                let outside = refracted(direction, inner, 1.0 / surface.index);
                let is_out = dot(outside, outside) > 0.0;
                let turned = select(reflect(direction, inner), direction, i == INNER_REFLECTIONS);
                direction = normalize(select(turned, outside, is_out));
                is_in = !is_out;
            }
        }
    }
    if inner_way > 0u {
        let is_way = inner_length > 0.0;
        let seen_from = inner_start + inner_direction * max(length(inner_start), 1e-6);
        textureStore(point_out, id, vec4f(inner_start, select(0.0, point.w, is_way)));
        textureStore(eye_out, id, vec4f(seen_from, inner_length));
        textureStore(normal_out, id, vec4f(inner_direction, 0.0));
        textureStore(index_out, id, vec4f(surface.index));
        return;
    }
    // The origin from which `direction` is the reflection at a normal of the same direction; as far from the point as
    // the eye, so that the difference keeps its digits.
    let origin = leaves + direction * max(length(leaves), 1e-6);
    let is_reflected = is_only && !goes_on;
    textureStore(point_out, id, vec4f(leaves, select(0.0, point.w, goes_on || is_reflected)));
    textureStore(eye_out, id, select(vec4f(origin, length(leaves)), eye, is_reflected));
    let turned = vec4f(direction, select(share, 0.0, is_only));
    textureStore(normal_out, id, select(turned, facing, is_reflected));
    let index = select(-surface.index, surface.index, is_solid);
    textureStore(index_out, id, vec4f(select(index, REFLECTS, is_reflected && surface.index > 0.0)));
}

fn surface_at(id: vec2u, point: vec3f) -> ClearSurface {
    var index = 0.0;
    if has_points {
        // The nearest point of a pixel may be no mirror's, and pixels that are closed have none.
        for (var i = 0; i < 25 && index == 0.0; i++) {
            let step = nth_step(i);
            let at = clamp(vec2i(id) + step, vec2i(0), vec2i(i32(frame.width), i32(frame.height)) - 1);
            index = textureLoad(points_in, at, 0).x;
        }
    }
    var found = ClearSurface(max(index, 0.0), NONE);
    var nearest = 3e38;
    for (var i = 0u; i < arrayLength(&mirrors); i++) {
        let mirror = mirrors[i];
        let off = abs(value_at(mirror, point));
        let is_near = distance(point, mirror.position_reach.xyz) <= mirror.position_reach.w;
        // What is drawn by a formula lies in front of the points.
        let is_drawn_so = mirror.as_points == 0u || index > 0.0;
        let tolerance = select(LEAVE, SPLAT_OFF, mirror.as_points == 1u);
        if is_near && is_drawn_so && off < tolerance && off * mirror.z_size.w < nearest {
            nearest = off * mirror.z_size.w;
            found = ClearSurface(mirror.refraction, select(i, NONE, mirror.refraction == 0.0));
        }
    }
    return found;
}
