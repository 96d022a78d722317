// Cubemap tracing: the reflected ray of each mirror pixel walks through the maps of its mirror, the nearest first;
// where one is hidden from a map, another may see on. What no map resolves is listed, with how far the ray is known to
// be free. The published ways are choices: criteria with one depth for a texel, samples by steps or angles, and each map
// from the ray's beginning. One thread a pixel.
#import frame_group
#import mirror_places
#import mirror_ray
#import cubemaps
#import counters
#import hit

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> mirrors: MappedMirrors;
@group(1) @binding(4) var<storage, read> cubes: Cubes;
@group(1) @binding(5) var<storage, read> records: array<vec4u>;
@group(1) @binding(6) var<storage, read> bounds: array<vec2f>;
// See hit.wgsl. Before: what the ray meets on mirrors, if that was traced.
@group(1) @binding(7) var<storage, read_write> hits: array<vec4u>;
// The number of rays that are not resolved; then two words each: pixel, and f32 bits of the distance up to which it is
// free.
@group(1) @binding(8) var<storage, read_write> rest: array<atomic<u32>>;
// z: number of cells that the ray was tested against.
@group(1) @binding(9) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(10) var<storage, read_write> counters: array<atomic<u32>>;
// The rays that another method has left, if only they are walked; as `rest`.
@group(1) @binding(11) var<storage, read> listed: array<u32>;

// Set for the first bounce, whose figures are reported.
override counts: bool = false;
// Whether rays are sampled by steps or angles, and which hit counts.
override sampling: u32 = CUBEMAP_TRACE_SAMPLING_TEXEL;
override hit: u32 = CUBEMAP_TRACE_HIT_RELAY;
override criterion: u32 = CUBEMAP_TRACE_CRITERION_PLANE;
override rest_of_rays: u32 = CUBEMAP_TRACE_REST_SURFEL_TRACE;

// Set if only the listed rays are walked, from where they are known to be free.
override use_listed: bool = false;

// How often a ray may change to another map.
const MOST_ROUNDS: u32 = 8u;
// The faces that a ray crosses are at most four; it may touch others at their corners.
const MOST_FACES: i32 = 6;
// Farther than any scene.
const FARTHEST: f32 = 1e30;

@compute @workgroup_size(8, 8)
fn cubemap_trace(@builtin(global_invocation_id) invocation: vec3u) {
    let thread = whole_thread(frame, invocation);
    var id = mirror_pixel(frame, thread);
    var start = 0.0;
    if use_listed {
        let entry = list_entry(thread, frame.columns);
        if entry >= listed[0] {
            return;
        }
        let pixel = listed[1u + 2u * entry];
        id = vec2u(pixel % frame.width, pixel / frame.width);
        start = bitcast<f32>(listed[2u + 2u * entry]);
    }
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id, 0);
    if point.w == 0.0 {
        return;
    }
    let reflected = mirror_ray(point.xyz, textureLoad(normal_in, id, 0).xyz, textureLoad(eye_in, id, 0).xyz);
    let pixel = id.y * frame.width + id.x;
    let before = hits[pixel];
    let end = select(FARTHEST, bitcast<f32>(before.z), before.y != 0u);
    let mirror = mirror_at(point.xyz);
    let ray = WalkRay(reflected.origin, reflected.direction, start, end);
    var walk = Walk(WALK_HIDDEN, 0.0, 0u, 0u);
    if criterion == CUBEMAP_TRACE_CRITERION_PLANE && hit == CUBEMAP_TRACE_HIT_RELAY {
        walk = relay(ray, mirror);
    } else {
        walk = through_each(ray, mirror);
    }
    let shown = shown_for(walk, ray, mirror);
    let tests = select(0u, before.w, use_listed) + walk.cells;
    if shown.kind == WALK_HIT {
        let is_proven = walk.kind == WALK_HIT && criterion == CUBEMAP_TRACE_CRITERION_PLANE && cubes.lag == 0u;
        let key = bitcast<u32>(shown.t) | select(HIT_UNPROVEN, 0u, is_proven);
        hits[pixel] = vec4u(key, shown.identity + 1u, bitcast<u32>(shown.t), tests);
    } else {
        hits[pixel].w = tests;
        let is_left = walk.kind == WALK_HIDDEN && rest_of_rays != CUBEMAP_TRACE_REST_SURFEL_TRACE;
        if before.y == 0u && (is_left || (walk.kind == WALK_OPEN && cubes.lag != 0u)) {
            hits[pixel].x = HIT_UNKNOWN;
        }
    }
    if walk.kind == WALK_HIDDEN {
        let place = atomicAdd(&rest[0], 1u);
        atomicStore(&rest[1u + 2u * place], pixel);
        // What maps that lag show is not proven.
        atomicStore(&rest[2u + 2u * place], bitcast<u32>(select(walk.t, 0.0, cubes.lag != 0u)));
    }
    if counts {
        textureStore(views_out, id, vec4f(0.0, 0.0, f32(tests), 0.0));
        atomicAdd(&counters[NODES_TESTED], walk.cells);
        atomicAdd(&counters[RAYS_LEFT], select(0u, 1u, walk.kind == WALK_HIDDEN));
    }
}

fn choices_by(criterion: u32) -> WalkChoices {
    let chosen = settings.cubemap_trace;
    let is_threshold = criterion == CUBEMAP_TRACE_CRITERION_THRESHOLD;
    return WalkChoices(
        chosen.skip != 0u, chosen.jump, chosen.disc_slack, MOST_CELLS, criterion,
        select(0.0, chosen.threshold * frame.scene_radius, is_threshold), is_threshold,
    );
}

fn maps_of(mirror: MappedMirror) -> u32 {
    // A mirror without maps.
    return select(0u, u32(mirror.view.x), mirror.low_map.w >= 0.0);
}

// The map of a mirror that is nearest to a place and not among those used.
fn nearest_map(mirror: MappedMirror, place: vec3f, used: u32) -> u32 {
    var next = 0u;
    var nearest = NEVER;
    for (var map = 0u; map < maps_of(mirror); map++) {
        let offset = cubes.places[u32(mirror.low_map.w) + map].xyz - place;
        let is_nearer = (used & (1u << map)) == 0u && dot(offset, offset) < nearest;
        nearest = select(nearest, dot(offset, offset), is_nearer);
        next = select(next, map, is_nearer);
    }
    return next;
}

// What a ray shows that no map resolves, if that comes from the maps.
fn shown_for(walk: Walk, ray: WalkRay, mirror: MappedMirror) -> Walk {
    var shown = walk;
    if walk.kind == WALK_HIDDEN && maps_of(mirror) > 0u {
        let map = u32(mirror.low_map.w) + nearest_map(mirror, ray.origin, 0u);
        if rest_of_rays == CUBEMAP_TRACE_REST_ENVIRONMENT_MAP {
            let seen = sample_at(map, ray.direction);
            shown = Walk(select(WALK_HIT, WALK_OPEN, seen.identity == NOTHING), seen.distance, seen.identity, 0u);
        } else if rest_of_rays == CUBEMAP_TRACE_REST_CANDIDATE && criterion == CUBEMAP_TRACE_CRITERION_PLANE {
            shown.kind = select(WALK_HIT, WALK_HIDDEN, walk.identity == NOTHING);
        } else if rest_of_rays == CUBEMAP_TRACE_REST_CANDIDATE {
            shown = through_map(map, ray, choices_by(CUBEMAP_TRACE_CRITERION_SIGN));
        }
    }
    return shown;
}

// Walks a ray through the maps of a mirror, each from its beginning. The first hit counts, or the nearest.
fn through_each(ray: WalkRay, mirror: MappedMirror) -> Walk {
    var found = Walk(WALK_HIDDEN, 0.0, NOTHING, 0u);
    var used = 0u;
    let tries = min(maps_of(mirror), settings.cubemap_trace.tries);
    var is_over = false;
    for (var i = 0u; i < tries && !is_over; i++) {
        let next = nearest_map(mirror, ray.origin, used);
        used |= 1u << next;
        let map = u32(mirror.low_map.w) + next;
        var walk = Walk(WALK_HIDDEN, 0.0, NOTHING, 0u);
        if criterion == CUBEMAP_TRACE_CRITERION_THRESHOLD_THEN_SIGN {
            walk = through_map(map, ray, choices_by(CUBEMAP_TRACE_CRITERION_THRESHOLD));
            if walk.kind != WALK_HIT {
                let cells = walk.cells;
                walk = through_map(map, ray, choices_by(CUBEMAP_TRACE_CRITERION_SIGN));
                walk.cells += cells;
            }
        } else {
            walk = through_map(map, ray, choices_by(criterion));
        }
        let cells = found.cells + walk.cells;
        // What is open in one map and hit in another is a hit; of two hits the nearer one.
        let is_hit = walk.kind == WALK_HIT;
        let is_nearer = walk.t < found.t || (walk.t == found.t && walk.identity < found.identity);
        let is_first_hit = is_hit && found.kind != WALK_HIT;
        let tells_more = found.kind == WALK_HIDDEN && (walk.kind == WALK_OPEN || (!is_hit && walk.t > found.t));
        if is_first_hit || (is_hit && is_nearer) || tells_more {
            found = walk;
        }
        found.cells = cells;
        is_over = hit != CUBEMAP_TRACE_HIT_NEAREST && walk.kind != WALK_HIDDEN;
    }
    if found.kind == WALK_HIDDEN && criterion != CUBEMAP_TRACE_CRITERION_PLANE {
        // Nothing is proven.
        found.t = ray.start;
    }
    return found;
}

fn through_map(map: u32, ray: WalkRay, choices: WalkChoices) -> Walk {
    var walk = Walk(WALK_HIDDEN, 0.0, 0u, 0u);
    if sampling == CUBEMAP_TRACE_SAMPLING_TEXEL || criterion == CUBEMAP_TRACE_CRITERION_PLANE {
        walk = walk_cube(map, ray, choices);
    } else {
        walk = search_samples(map, ray, choices);
    }
    return walk;
}

// The identity of no point.
const NOTHING: u32 = 0xffffffffu;

struct Sample {
    // By how much a place lies behind its texel's depth; far before it if the texel is empty.
    behind: f32,
    identity: u32,
    // The distance from the map's middle at which the place would be at the texel's depth.
    distance: f32,
    // Up to this distance from its origin a ray does not meet the texel.
    own: f32,
}

// The texel of a map in the direction `offset` from its middle.
fn sample_at(map: u32, offset: vec3f) -> Sample {
    let view = face_of(map, face_toward(offset));
    let depth = dot(view.forward, offset);
    let record = texel_record(view.picture, texel_toward(view, offset));
    let texel = unpack_texel(record);
    let distance = length(offset) / depth * texel.depth;
    var sample = Sample(-NEVER, NOTHING, 0.0, 0.0);
    if record.y != 0u {
        sample = Sample(depth - texel.depth, texel.identity, distance, 4.0 * texel.radius * texel.depth / view.focal);
    }
    return sample;
}

// The samples of a ray: by equal steps, or by equal angles as seen from a map's middle.
struct Samples {
    // The foot of the map's middle on the ray, and its distance from it.
    foot: f32,
    beside: f32,
    // At the ray's origin, as seen from the middle.
    first_angle: f32,
}

// Points of the scene are at most two radii apart.
const SAMPLED_RADII: f32 = 2.01;
const HALF_TURN: f32 = 1.5706;

fn place_of_sample(samples: Samples, i: u32) -> f32 {
    let angle = samples.first_angle + f32(i) * radians(settings.cubemap_trace.angle);
    let by_angle = select(samples.foot + samples.beside * tan(min(angle, HALF_TURN)), NEVER, angle >= HALF_TURN);
    let by_step = f32(i) * settings.cubemap_trace.step * frame.scene_radius;
    return select(by_step, by_angle, sampling == CUBEMAP_TRACE_SAMPLING_ANGLE);
}

// A sample before which there is nothing new up to a place of the ray.
fn sample_before(samples: Samples, t: f32) -> u32 {
    let angle = atan((t - samples.foot) / samples.beside) - samples.first_angle;
    let by_angle = angle / radians(settings.cubemap_trace.angle) - 0.01;
    let by_step = t / (settings.cubemap_trace.step * frame.scene_radius);
    return u32(clamp(select(by_step, by_angle, sampling == CUBEMAP_TRACE_SAMPLING_ANGLE), 0.0, 1e6));
}

// Compares the ray's depth with that of the texel at each sample. CPU twin: reflection/depth_search.rs.
fn search_samples(map: u32, ray: WalkRay, choices: WalkChoices) -> Walk {
    let center = cubes.places[map].xyz;
    let foot = dot(center - ray.origin, ray.direction);
    let beside = max(distance(center, ray.origin + ray.direction * foot), 1e-6 * frame.scene_radius);
    let samples = Samples(foot, beside, atan(-foot / beside));
    let end = min(ray.end, SAMPLED_RADII * frame.scene_radius);
    let is_either = choices.criterion == CUBEMAP_TRACE_CRITERION_SIGN_EITHER;
    let is_sign = is_either || choices.criterion == CUBEMAP_TRACE_CRITERION_SIGN;
    var walk = Walk(WALK_ON, ray.start, NOTHING, 0u);
    var is_behind = false;
    var level = 0;
    var i = 1u;
    while walk.kind == WALK_ON {
        let t = place_of_sample(samples, i);
        let offset = ray.origin + ray.direction * t - center;
        walk.cells += 1u;
        if t > end || walk.cells > 8u * MOST_CELLS {
            walk.kind = select(WALK_OPEN, WALK_HIDDEN, is_behind);
        } else if level > 0 {
            let view = face_of(map, face_toward(offset));
            let cell = texel_toward(view, offset) >> vec2u(u32(level));
            let along = coordinates_of(view, ray);
            let across = axis_of(along.across, along.divisor);
            let down = axis_of(along.down, along.divisor);
            let edge = 1 << u32(level);
            let is_forward = vec2<bool>(across.z > 0.0, down.z > 0.0);
            let border = select(cell * edge, min((cell + 1) * edge, view.size), is_forward);
            let x = crossing_of(across, along.divisor, border.x);
            let out = max(min(min(x, crossing_of(down, along.divisor, border.y)), end), t);
            let depths = vec2f(linear_at(along.depth, t), linear_at(along.depth, out));
            let bounds = cell_bounds(view.picture, level, cell);
            let is_before = max(depths.x, depths.y) < bounds.x - choices.threshold;
            let lies_behind = min(depths.x, depths.y) > bounds.y + choices.threshold;
            let comes_out = is_either && is_behind;
            if (is_before && !comes_out) || (lies_behind && (is_behind || !is_sign)) {
                is_behind = lies_behind;
                i = max(i + 1u, sample_before(samples, out));
                level = level_above(level, view);
            } else {
                level = level_below(level);
            }
        } else {
            let sample = sample_at(map, offset);
            let was_behind = is_behind;
            is_behind = sample.behind > 0.0;
            var found = t;
            var identity = sample.identity;
            var meets = abs(sample.behind) <= choices.threshold;
            if is_sign {
                meets = i > 1u && is_behind != was_behind && (is_behind || is_either);
                if meets {
                    let last = place_of_sample(samples, i - 1u);
                    let refined = refine(map, ray, center, select(t, last, is_behind), select(last, t, is_behind));
                    found = refined.t;
                    identity = refined.identity;
                }
            }
            if meets && found > sample.own {
                walk.kind = WALK_HIT;
                walk.t = found;
                walk.identity = identity;
            }
            i++;
            if choices.skip {
                level = level_above(0, face_of(map, 0u));
            }
        }
    }
    return walk;
}

// A second secant step after a change of sign moves the place by less than the step between two samples errs.
const SECANT_STEPS: u32 = 1u;

// The place between two samples at which a ray goes behind what it passes, by secant steps.
fn refine(map: u32, ray: WalkRay, center: vec3f, first: f32, second: f32) -> Walk {
    var before = first;
    var after = second;
    var height_before = sample_at(map, ray.origin + ray.direction * before - center).behind;
    var last = sample_at(map, ray.origin + ray.direction * after - center);
    var t = second;
    for (var step = 0u; step < SECANT_STEPS; step++) {
        t = before + (after - before) * (height_before / (height_before - last.behind));
        let sample = sample_at(map, ray.origin + ray.direction * t - center);
        if sample.behind > 0.0 {
            after = t;
            last = sample;
        } else {
            before = t;
            height_before = sample.behind;
        }
    }
    return Walk(WALK_HIT, t, last.identity, 0u);
}

// Walks a ray through the maps of a mirror.
fn relay(whole: WalkRay, mirror: MappedMirror) -> Walk {
    let choices = choices_by(CUBEMAP_TRACE_CRITERION_PLANE);
    var ray = whole;
    var walk = Walk(WALK_HIDDEN, 0.0, NOTHING, 0u);
    var cells = 0u;
    var last = 0xffffffffu;
    var candidate = NOTHING;
    let tries = min(maps_of(mirror), settings.cubemap_trace.tries);
    for (var turn = 0u; turn < MOST_ROUNDS; turn++) {
        var used = 0u;
        var has_advanced = false;
        for (var i = 0u; i < tries && !has_advanced && walk.kind == WALK_HIDDEN; i++) {
            let next = nearest_map(mirror, ray.origin, used);
            used |= 1u << next;
            // The map that has just lost the ray does not find it again.
            if next != last {
                walk = walk_cube(u32(mirror.low_map.w) + next, ray, choices);
                cells += walk.cells;
                if walk.kind == WALK_HIDDEN && (walk.t > ray.start || candidate == NOTHING) {
                    candidate = walk.identity;
                }
                if walk.kind == WALK_HIDDEN && walk.t > ray.start {
                    ray.start = walk.t;
                    last = next;
                    has_advanced = true;
                }
            }
        }
        if !has_advanced {
            break;
        }
    }
    let is_hit = walk.kind == WALK_HIT;
    return Walk(walk.kind, select(ray.start, walk.t, is_hit), select(candidate, walk.identity, is_hit), cells);
}

// Walks a ray through the faces of a map, of which it crosses at most four.
fn walk_cube(map: u32, ray: WalkRay, choices: WalkChoices) -> Walk {
    var walk = Walk(WALK_OPEN, 0.0, 0u, 0u);
    var cells = 0u;
    var t = ray.start;
    let offset = ray.origin + ray.direction * t - cubes.places[map].xyz;
    var face = face_toward(select(offset, ray.direction, all(offset == vec3f(0.0))));
    var starts = true;
    var goes_on = true;
    for (var i = 0; i < MOST_FACES && goes_on; i++) {
        let view = face_of(map, face);
        let exit = exit_of_view(view, ray);
        if exit.t > t {
            walk = walk_picture(view, ray, vec2f(t, exit.t), starts, choices);
            cells += walk.cells;
            starts = false;
            t = exit.t;
        }
        goes_on = walk.kind == WALK_OPEN && exit.side != 0u;
        face = face_beside(face, exit.side);
    }
    walk.cells = cells;
    if walk.kind == WALK_OPEN && is_inside {
        walk = Walk(WALK_HIDDEN, ray.start, NOTHING, cells);
    }
    // A ray right through a corner of the cube or its middle.
    if goes_on {
        walk.kind = WALK_HIDDEN;
        walk.t = t;
        walk.identity = NOTHING;
    }
    return walk;
}

// The face into which a ray goes through a side of a face, see `exit_of_view`: those to the left and right look along
// the axis after its own, those above and below along the next one.
fn face_beside(face: u32, side: u32) -> u32 {
    let axis = (face + select(1u, 2u, side >= SIDE_BELOW)) % 3u;
    return axis + select(3u, 0u, side == SIDE_RIGHT || side == SIDE_ABOVE);
}

fn texel_record(picture: u32, texel: vec2i) -> vec4u {
    return records[index_of_texel(picture, texel)];
}

// No cell is passed unseen by a ray that is to come out from behind something.
fn cell_bounds(picture: u32, level: i32, cell: vec2i) -> vec2f {
    return select(bounds[index_of_cell(picture, level, cell)], vec2f(0.0), is_inside);
}
