// Screen-space tracing: the reflected ray of each mirror pixel walks through the camera's picture. Rays that leave it, or
// that pass behind something, are listed with how far they are known to be free. One thread a pixel.
#import screen
#import hit
#import mirror_ray
#import counters

@group(1) @binding(0) var point_in: texture_2d<f32>;
@group(1) @binding(1) var normal_in: texture_2d<f32>;
@group(1) @binding(2) var eye_in: texture_2d<f32>;
@group(1) @binding(3) var<storage, read> screen: Screen;
@group(1) @binding(4) var<storage, read> records: array<vec4u>;
@group(1) @binding(5) var<storage, read> bounds: array<vec2f>;
// See hit.wgsl.
@group(1) @binding(6) var<storage, read_write> hits: array<vec4u>;
// The rays that are not resolved, see cubemap_trace.wgsl.
@group(1) @binding(7) var<storage, read_write> rest: array<atomic<u32>>;
// z: number of cells that the ray was tested against.
@group(1) @binding(8) var views_out: texture_storage_2d<rgba32float, write>;
@group(1) @binding(9) var<storage, read_write> counters: array<atomic<u32>>;
// See screen_box.wgsl.
@group(1) @binding(10) var<storage, read> walls: array<vec2u>;

// Set for the first bounce, whose figures are reported.
override counts: bool = false;

// Farther than any scene.
const FARTHEST: f32 = 1e30;
// The mirror's own surface does not stop a ray within so many radii of its largest splat, and so many pixels.
const OWN_RADII: f32 = 4.0;
const OWN_PIXELS: f32 = 2.0;
// Depth steps of one pixel are within one surface: more closes cracks, and invents walls.
const SURFACE_JUMP: f32 = 1.0;
// No ray through a picture of 3840 x 2160 takes more steps: it crosses at most so many rows and columns.
const MOST_STEPS: u32 = 8192u;
// Discs are not known: planes count all over their pixels.
const ANY_SLACK: f32 = 1e9;

@compute @workgroup_size(8, 8)
fn screen_trace(@builtin(global_invocation_id) thread: vec3u) {
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
    let by_depth = settings.screen_trace.criterion != SCREEN_TRACE_CRITERION_PLANE;
    let ray = WalkRay(reflected.origin, reflected.direction, 0.0, FARTHEST);
    var walk = through_screen(ray);
    let is_on_wall = walk.kind == WALK_HIDDEN && leaves_picture && meets_wall(ray);
    if is_on_wall {
        walk = Walk(WALK_HIT, wall_distance, wall_content, walk.cells);
    }
    if walk.kind == WALK_HIT {
        // A disc of the layer behind is a point, whose key is the distance, as is what a wall of points shows.
        let of_points = is_on_wall && settings.screen_trace.box_from == SCREEN_TRACE_BOX_FROM_POINTS;
        let is_point = of_points || (is_in_back && !is_on_wall);
        var key = select(HIT_IN_PICTURE, bitcast<u32>(walk.t), is_point);
        let is_unsure = passed_behind < NEVER || by_depth || (meets_unsure && !is_in_back);
        key |= select(0u, HIT_UNPROVEN, is_unsure || is_on_wall);
        let identity = select(walk.identity & PIXEL_NUMBER, walk.identity, is_point);
        hits[pixel] = vec4u(key, identity + 1u, bitcast<u32>(walk.t), walk.cells);
    } else {
        let is_left = walk.kind == WALK_HIDDEN;
        hits[pixel] = vec4u(select(0u, HIT_UNKNOWN, is_left && !is_continued()), 0u, 0u, walk.cells);
    }
    if walk.kind == WALK_HIDDEN {
        let place = atomicAdd(&rest[0], 1u);
        atomicStore(&rest[1u + 2u * place], pixel);
        atomicStore(&rest[2u + 2u * place], bitcast<u32>(walk.t));
    }
    if counts {
        // The maps count what they leave.
        let is_left_here = walk.kind == WALK_HIDDEN && settings.screen_trace.rest != SCREEN_TRACE_REST_CUBEMAP_TRACE;
        textureStore(views_out, id, vec4f(0.0, 0.0, f32(walk.cells), 0.0));
        atomicAdd(&counters[NODES_TESTED], walk.cells);
        atomicAdd(&counters[RAYS_LEFT], select(0u, 1u, is_left_here));
    }
}

// Whether the ray goes on outside of the picture.
var<private> leaves_picture: bool = false;
// Where it ends on the box about all points, and the point or pixel that is there.
var<private> wall_distance: f32 = 0.0;
var<private> wall_content: u32 = 0u;

// Whether something is on the wall at which a ray leaves the box.
fn meets_wall(ray: WalkRay) -> bool {
    var is_met = false;
    if settings.screen_trace.box_from != SCREEN_TRACE_BOX_FROM_NONE {
        let is_rising = ray.direction > vec3f(0.0);
        let entries = (select(screen.box_high.xyz, screen.box_low.xyz, is_rising) - ray.origin) / ray.direction;
        let exits = (select(screen.box_low.xyz, screen.box_high.xyz, is_rising) - ray.origin) / ray.direction;
        let nearest = min(exits.x, min(exits.y, exits.z));
        // A ray that begins outside of the box may pass it.
        let is_through = nearest > max(0.0, max(entries.x, max(entries.y, entries.z)));
        let axis = select(select(2u, 1u, exits.y == nearest), 0u, exits.x == nearest);
        let wall = axis + select(3u, 0u, is_rising[axis]);
        let texel = walls[index_in_box(wall, texel_in_box(wall, ray.origin + ray.direction * nearest))];
        is_met = is_through && texel.y != 0u;
        wall_distance = nearest;
        wall_content = texel.x;
    }
    return is_met;
}

fn through_screen(ray: WalkRay) -> Walk {
    let choices = WalkChoices(
        settings.screen_trace.skip != 0u, SURFACE_JUMP, ANY_SLACK, MOST_STEPS, 0u, 0.0, false,
    );
    let view = screen_view();
    let along = coordinates_of(view, ray);
    // By the width of a pixel at the mirror, which may be behind the eye.
    let own = max(OWN_RADII * screen.mirror_radius, OWN_PIXELS * width_at(view, abs(along.depth.x)));
    let size = vec2f(view.size);
    let depth = linear_at(along.depth, own) - frame.near;
    let place = vec2f(linear_at(along.across, own), linear_at(along.down, own));
    let is_within = all(place >= vec2f(0.0)) && all(place <= size * linear_at(along.divisor, own)) && depth > 0.0;
    var exit = exit_of_view(view, ray);
    // Nothing nearer is in the picture.
    exit = earlier_exit(exit, vec2f(along.depth.x - frame.near, along.depth.y), SIDE_NEAR);
    var walk = Walk(WALK_HIDDEN, 0.0, 0u, 0u);
    leaves_picture = !is_within;
    if is_within && exit.t > own {
        if settings.screen_trace.sampling == SCREEN_TRACE_SAMPLING_STEP {
            walk = walk_by_steps(view, ray, vec2f(own, exit.t), choices);
        } else if settings.screen_trace.sampling == SCREEN_TRACE_SAMPLING_EVEN {
            walk = walk_by_points(view, ray, vec2f(own, exit.t), choices);
        } else {
            walk = walk_picture(view, ray, vec2f(own, exit.t), true, choices);
        }
        let is_free = walk.kind == WALK_OPEN;
        if is_free && (exit.side != 0u || passed_behind < NEVER) {
            walk.kind = WALK_HIDDEN;
            leaves_picture = exit.side != 0u && passed_behind == NEVER;
        }
        if walk.kind == WALK_HIDDEN {
            walk.t = min(select(walk.t, exit.t, is_free), passed_behind);
            // The picture says nothing about the ray's beginning.
            walk.t = select(0.0, walk.t, walk.t > own);
        }
    }
    return walk;
}

const SIDE_NEAR: u32 = 5u;

// Walks the part `part` of a ray by points at even steps along it, as published: each is compared with the pixel that
// shows it, and of what lies between two points nothing is known.
fn walk_by_points(view: DepthView, ray: WalkRay, part: vec2f, choices: WalkChoices) -> Walk {
    let along = coordinates_of(view, ray);
    let stride = settings.screen_trace.stride * frame.scene_radius;
    var walk = Walk(WALK_ON, 0.0, 0u, 0u);
    while walk.kind == WALK_ON {
        let t = part.x + f32(walk.cells + 1u) * stride;
        if t >= part.y {
            walk.kind = WALK_OPEN;
        } else if walk.cells >= choices.most_cells {
            walk.kind = WALK_HIDDEN;
            walk.t = t;
        } else {
            let at = clamp(vec2i(floor(place_at(along, t))), vec2i(0), view.size - 1);
            let said = said_at(view, ray, at, vec2f(t), walk.cells == 0u, choices);
            walk = Walk(said.kind, said.t, said.identity, walk.cells + 1u);
        }
    }
    return walk;
}

// Walks the part `part` of a ray by steps of even length in the picture, each of which is an interval of depths. Of what
// lies between the pixels that it steps on, nothing is known.
fn walk_by_steps(view: DepthView, ray: WalkRay, part: vec2f, choices: WalkChoices) -> Walk {
    let along = coordinates_of(view, ray);
    let first = place_at(along, part.x);
    let way = place_at(along, part.y) - first;
    let length = max(distance(way, vec2f(0.0)), 1e-6);
    let step = settings.screen_trace.step / length;
    let is_down = abs(way.y) > abs(way.x);
    let axis = select(along.across, along.down, is_down);
    var walk = Walk(WALK_ON, 0.0, 0u, 0u);
    var t = part.x;
    while walk.kind == WALK_ON {
        let share = f32(walk.cells + 1u) * step;
        let place = first + way * share;
        let border = select(place.x, place.y, is_down);
        let crossing = (border * along.divisor.x - axis.x) / (axis.y - border * along.divisor.y);
        let out = select(part.y, clamp(crossing, t, part.y), share < 1.0);
        let at = clamp(vec2i(floor(first + way * min(share - 0.5 * step, 1.0))), vec2i(0), view.size - 1);
        let said = said_at(view, ray, at, vec2f(t, out), walk.cells == 0u, choices);
        walk = Walk(said.kind, said.t, said.identity, walk.cells + 1u);
        if walk.kind == WALK_ON && out >= part.y {
            walk.kind = WALK_OPEN;
        } else if walk.kind == WALK_ON && walk.cells >= choices.most_cells {
            walk.kind = WALK_HIDDEN;
            walk.t = out;
        }
        t = out;
    }
    return walk;
}

fn place_at(along: WalkCoordinates, t: f32) -> vec2f {
    return vec2f(linear_at(along.across, t), linear_at(along.down, t)) / linear_at(along.divisor, t);
}
