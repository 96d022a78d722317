// Cubemap tracing: the reflected ray of each mirror pixel walks through the maps of its mirror, the nearest first;
// where one is hidden from a map, another may see on. What no map resolves is listed, with how far the ray is known to
// be free. One thread a pixel.
#import frame_group
#import mirror_places
#import mirror_ray
#import cubemaps
#import counters

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

// Set for the first bounce, whose figures are told.
override counts: bool = false;

// How often a ray may change to another map.
const MOST_ROUNDS: u32 = 8u;
// The faces that a ray crosses are at most four; it may touch others at their corners.
const MOST_FACES: i32 = 6;
// Farther than any scene.
const FARTHEST: f32 = 1e30;

@compute @workgroup_size(8, 8)
fn cubemap_trace(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, whole_thread(frame, thread));
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
    let walk = relay(WalkRay(reflected.origin, reflected.direction, 0.0, end), mirror);
    if walk.kind == WALK_HIT {
        hits[pixel] = vec4u(bitcast<u32>(walk.t), walk.identity + 1u, bitcast<u32>(walk.t), walk.cells);
    } else {
        hits[pixel].w = walk.cells;
    }
    if walk.kind == WALK_HIDDEN {
        let place = atomicAdd(&rest[0], 1u);
        atomicStore(&rest[1u + 2u * place], pixel);
        atomicStore(&rest[2u + 2u * place], bitcast<u32>(walk.t));
    }
    if counts {
        textureStore(views_out, id, vec4f(0.0, 0.0, f32(walk.cells), 0.0));
        atomicAdd(&counters[NODES_TESTED], walk.cells);
        atomicAdd(&counters[RAYS_LEFT], select(0u, 1u, walk.kind == WALK_HIDDEN));
    }
}

// Walks a ray through the maps of a mirror.
fn relay(whole: WalkRay, mirror: MappedMirror) -> Walk {
    let choices = WalkChoices(
        settings.cubemap_trace.skip != 0u, settings.cubemap_trace.jump, settings.cubemap_trace.disc_slack,
        MOST_CELLS,
    );
    var ray = whole;
    var walk = Walk(WALK_HIDDEN, 0.0, 0u, 0u);
    var cells = 0u;
    var last = 0xffffffffu;
    // A mirror without maps.
    let maps = select(0u, u32(mirror.view.x), mirror.low_map.w >= 0.0);
    let tries = min(maps, settings.cubemap_trace.tries);
    for (var turn = 0u; turn < MOST_ROUNDS; turn++) {
        var used = 0u;
        var has_advanced = false;
        for (var i = 0u; i < tries && !has_advanced && walk.kind == WALK_HIDDEN; i++) {
            var next = 0u;
            var nearest = NEVER;
            for (var map = 0u; map < maps; map++) {
                let offset = cubes.places[u32(mirror.low_map.w) + map].xyz - ray.origin;
                let is_nearer = (used & (1u << map)) == 0u && dot(offset, offset) < nearest;
                nearest = select(nearest, dot(offset, offset), is_nearer);
                next = select(next, map, is_nearer);
            }
            used |= 1u << next;
            // The map that has just lost the ray does not find it again.
            if next != last {
                walk = walk_cube(u32(mirror.low_map.w) + next, ray, choices);
                cells += walk.cells;
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
    return Walk(walk.kind, select(ray.start, walk.t, walk.kind == WALK_HIT), walk.identity, cells);
}

// Walks a ray through the faces of a map, of which it crosses at most four.
fn walk_cube(map: u32, ray: WalkRay, choices: WalkChoices) -> Walk {
    var walk = Walk(WALK_OPEN, 0.0, 0u, 0u);
    var cells = 0u;
    var t = ray.start;
    var face = face_toward(ray.origin + ray.direction * t - cubes.places[map].xyz);
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
    // A ray right through a corner of the cube or its middle.
    if goes_on {
        walk.kind = WALK_HIDDEN;
        walk.t = t;
    }
    return walk;
}

// The face that sees a direction: that of its largest part.
fn face_toward(direction: vec3f) -> u32 {
    let parts = abs(direction);
    var axis = 0u;
    if parts.y > parts.x && parts.y >= parts.z {
        axis = 1u;
    } else if parts.z > parts.x {
        axis = 2u;
    }
    return axis + select(0u, 3u, direction[axis] < 0.0);
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

fn cell_bounds(picture: u32, level: i32, cell: vec2i) -> vec2f {
    return bounds[index_of_cell(picture, level, cell)];
}
