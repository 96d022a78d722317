// Rays through a picture of depths. A ray crosses the texels of a picture in order. Each texel is the plane of the disc
// that it shows, and the ray either stays in front of it, meets it, or is hidden behind it, which the picture cannot
// show more of. Bounds of cells of 2 x 2, 4 x 4, ... texels let a ray pass all of them at once. CPU twin:
// crates/render/src/reflection/depth_walk.rs.
//
// The importing pass defines `texel_record(picture, texel)`, `cell_bounds(picture, level, cell)`, and `said_at`, which is
// `said_by_texel` where nothing else decides what a ray meets.
#import depth_texel

struct WalkRay {
    origin: vec3f,
    // Unit length.
    direction: vec3f,
    // Up to here it is known to be free.
    start: f32,
    // Beyond it nothing is asked for.
    end: f32,
}

struct WalkChoices {
    skip: bool,
    // Depth steps up to this many texels are within one surface.
    jump: f32,
    // How far beside its disc a plane counts, in texels.
    disc_slack: f32,
    // After so many the ray is given up.
    most_cells: u32,
    // Which rule decides, for importing passes that have several; and its threshold.
    criterion: u32,
    threshold: f32,
    // Whether cells all of whose texels lie before the ray are passed, too.
    passes_behind: bool,
}

// The ray is free as far as it was asked for.
const WALK_OPEN: u32 = 0u;
const WALK_HIT: u32 = 1u;
// The ray is free up to `t`, and what comes after is not known.
const WALK_HIDDEN: u32 = 2u;
// What a texel says when the ray goes on.
const WALK_ON: u32 = 3u;

struct Walk {
    kind: u32,
    t: f32,
    // Of the point that it meets, or behind which it is hidden.
    identity: u32,
    // The cells that were looked at.
    cells: u32,
}

// By how much bounds are widened, so that rounding never skips what a texel would have decided.
const BOUNDS_MARGIN: f32 = 1e-5;
// More cells than a ray can cross in the largest picture.
const MOST_CELLS: u32 = 8192u;
const NEVER: f32 = 3.4028235e38;

// The linear depth at which a line of sight meets a plane.
fn depth_of_plane(sight: Sight, normal: vec3f, plane: f32) -> f32 {
    return (plane - dot(normal, sight.origin)) / dot(normal, sight.direction);
}

// The linear depths between which the plane of a texel lies.
fn bounds_of_texel(view: DepthView, texel: vec2i, record: vec4u) -> vec2f {
    let disc = unpack_texel(record);
    if disc.depth == 0.0 {
        return vec2f(NEVER);
    }
    let plane = plane_of(sight_of(view, vec2f(texel) + 0.5), disc.normal, disc.depth);
    var bounds = vec2f(NEVER, 0.0);
    for (var i = 0; i < 4; i++) {
        let sight = sight_of(view, vec2f(texel + vec2i(i & 1, i >> 1u)));
        // Beyond the plane's horizon it has no depth.
        let depth = select(NEVER, depth_of_plane(sight, disc.normal, plane), dot(disc.normal, sight.direction) < 0.0);
        bounds = vec2f(min(bounds.x, depth), max(bounds.y, depth));
    }
    return vec2f(bounds.x * (1.0 - BOUNDS_MARGIN), select(bounds.y, bounds.y * (1.0 + BOUNDS_MARGIN), bounds.y < 3e38));
}

// The number of cells of a level across and down.
fn cells_of(size: vec2i, level: i32) -> vec2i {
    return (size + (1 << u32(level)) - 1) >> vec2u(u32(level));
}

// The bounds of a cell: those of its parts in the level before, or of its texels.
fn bounds_of_cell(view: DepthView, level: i32, cell: vec2i, from_texels: bool) -> vec2f {
    var both = vec2f(NEVER, 0.0);
    for (var i = 0; i < 4; i++) {
        let at = cell * 2 + vec2i(i & 1, i >> 1u);
        if all(at < cells_of(view.size, level - 1)) {
            var part = vec2f(0.0);
            if from_texels {
                part = bounds_of_texel(view, at, texel_record(view.picture, at));
            } else {
                part = cell_bounds(view.picture, level - 1, at);
            }
            both = vec2f(min(both.x, part.x), max(both.y, part.y));
        }
    }
    return both;
}

// The ray's coordinates along it: the place in texels across and down, each times the divisor, which is the linear depth
// or, in a parallel picture, 1; the depth. x: at zero, y: slope.
struct WalkCoordinates {
    across: vec2f,
    down: vec2f,
    divisor: vec2f,
    depth: vec2f,
}

fn coordinates_of(view: DepthView, ray: WalkRay) -> WalkCoordinates {
    let offset = ray.origin - view.center;
    let p = vec2f(dot(view.right, offset), dot(view.right, ray.direction));
    let q = vec2f(dot(view.up, offset), dot(view.up, ray.direction));
    let w = vec2f(dot(view.forward, offset), dot(view.forward, ray.direction));
    let half_size = 0.5 * vec2f(view.size);
    let divisor = select(w, vec2f(1.0, 0.0), view.is_parallel);
    return WalkCoordinates(half_size.x * divisor + view.focal * p, half_size.y * divisor - view.focal * q, divisor, w);
}

fn linear_at(value: vec2f, t: f32) -> f32 {
    return value.x + value.y * t;
}

const SIDE_LEFT: u32 = 1u;
const SIDE_RIGHT: u32 = 2u;
const SIDE_BELOW: u32 = 3u;
const SIDE_ABOVE: u32 = 4u;

// Where a ray leaves what a picture shows, and through which side; 0 if it ends within.
struct WalkExit {
    t: f32,
    side: u32,
}

// The earlier of an exit and the one through a side: where a linear function that is not negative within becomes so.
fn earlier_exit(exit: WalkExit, within: vec2f, side: u32) -> WalkExit {
    let root = -within.x / within.y;
    let is_earlier = within.y < 0.0 && root < exit.t;
    return WalkExit(select(exit.t, root, is_earlier), select(exit.side, side, is_earlier));
}

fn exit_of_view(view: DepthView, ray: WalkRay) -> WalkExit {
    let along = coordinates_of(view, ray);
    let size = vec2f(view.size);
    var exit = earlier_exit(WalkExit(ray.end, 0u), along.across, SIDE_LEFT);
    exit = earlier_exit(exit, size.x * along.divisor - along.across, SIDE_RIGHT);
    exit = earlier_exit(exit, along.down, SIDE_ABOVE);
    return earlier_exit(exit, size.y * along.divisor - along.down, SIDE_BELOW);
}

// One axis of a picture. x: the coordinate. y: its slope. z: the step at borders: 1, -1, or 0 for a ray that stays.
fn axis_of(value: vec2f, divisor: vec2f) -> vec3f {
    return vec3f(value, sign(value.y * divisor.x - value.x * divisor.y));
}

// When the ray crosses an integer border.
fn crossing_of(axis: vec3f, divisor: vec2f, border: i32) -> f32 {
    let slope = axis.y - f32(border) * divisor.y;
    // A ray may come ever nearer to a border without reaching it.
    return select(NEVER, (f32(border) * divisor.x - axis.x) / slope, slope * axis.z > 0.0);
}

fn is_past(axis: vec3f, divisor: vec2f, border: i32, t: f32, is_first: bool) -> bool {
    let crossing = crossing_of(axis, divisor, border);
    return crossing < t || (is_first && crossing == t);
}

// The texel that contains the ray at `t`, from `low` to `high`: the same that stepping texel by texel finds. `is_first`
// says that this axis steps first where both borders are crossed at once.
fn texel_at(axis: vec3f, divisor: vec2f, t: f32, low: i32, high: i32, is_first: bool) -> i32 {
    var texel = clamp(i32(floor(linear_at(axis.xy, t) / linear_at(divisor, t))), low, high);
    if axis.z > 0.0 {
        if texel > low && !is_past(axis, divisor, texel, t, is_first) {
            texel -= 1;
        }
        if texel < high && is_past(axis, divisor, texel + 1, t, is_first) {
            texel += 1;
        }
    } else if axis.z < 0.0 {
        if texel < high && !is_past(axis, divisor, texel + 1, t, is_first) {
            texel += 1;
        }
        if texel > low && is_past(axis, divisor, texel, t, is_first) {
            texel -= 1;
        }
    }
    return texel;
}

// Walks the part `part` of a ray through a picture. `starts` says that the ray begins there, so that the picture may
// say nothing about it.
fn walk_picture(view: DepthView, ray: WalkRay, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    let along = coordinates_of(view, ray);
    let divisor = along.divisor;
    let across = axis_of(along.across, divisor);
    let down = axis_of(along.down, divisor);
    var t = part.x;
    var is_start = starts;
    // A ray that begins at the centre is in one texel, which its direction decides.
    let has_depth = linear_at(divisor, t) != 0.0;
    let place = select(vec2f(across.y, down.y), vec2f(linear_at(across.xy, t), linear_at(down.xy, t)), has_depth);
    let first_place = place / select(divisor.y, linear_at(divisor, t), has_depth);
    var at = clamp(vec2i(floor(first_place)), vec2i(0), view.size - 1);
    var level = 0;
    var walk = Walk(WALK_ON, 0.0, 0u, 0u);
    while walk.kind == WALK_ON {
        walk.cells += 1u;
        let edge = 1 << u32(level);
        let cell = at >> vec2u(u32(level));
        let border = select(cell * edge, min((cell + 1) * edge, view.size), vec2<bool>(across.z > 0.0, down.z > 0.0));
        let exits = vec2f(crossing_of(across, divisor, border.x), crossing_of(down, divisor, border.y));
        let out = max(min(min(exits.x, exits.y), part.y), t);
        var is_passed = true;
        if level > 0 {
            let depths = vec2f(linear_at(along.depth, t), linear_at(along.depth, out));
            is_passed = passes_cell(cell_bounds(view.picture, level, cell), depths, out < ray.end, choices);
        } else {
            let said = said_at(view, ray, at, vec2f(t, out), is_start, choices);
            walk = Walk(said.kind, said.t, said.identity, walk.cells);
        }
        if !is_passed {
            level = level_below(level);
        } else if walk.kind == WALK_ON {
            is_start = false;
            if out >= part.y {
                walk.kind = WALK_OPEN;
            } else if walk.cells > choices.most_cells {
                walk.kind = WALK_HIDDEN;
                walk.t = t;
            }
            let low = cell * edge;
            let high = min(low + edge, view.size) - 1;
            if exits.y < exits.x {
                at = vec2i(texel_at(across, divisor, out, low.x, high.x, true), select(border.y - 1, border.y, down.z > 0.0));
            } else {
                at = vec2i(select(border.x - 1, border.x, across.z > 0.0), texel_at(down, divisor, out, low.y, high.y, false));
            }
            t = out;
            if choices.skip {
                level = level_above(level, view);
            }
        }
    }
    return walk;
}

// Whether a part of a ray with these depths at its ends meets nothing in a cell with these bounds.
fn passes_cell(bounds: vec2f, depths: vec2f, goes_on: bool, choices: WalkChoices) -> bool {
    let is_before = max(depths.x, depths.y) < bounds.x - choices.threshold;
    let is_behind = min(depths.x, depths.y) > bounds.y + choices.threshold;
    return is_before || (choices.passes_behind && goes_on && is_behind);
}

fn level_below(level: i32) -> i32 {
    return max(level - 1, 0);
}

fn level_above(level: i32, view: DepthView) -> i32 {
    return min(level + 1, view.levels);
}

// The height of a ray over the plane of a texel, along the ray: positive before it.
fn height_over(view: DepthView, ray: WalkRay, at: vec2i, texel: DepthTexel) -> vec2f {
    let plane = plane_of(sight_of(view, vec2f(at) + 0.5), texel.normal, texel.depth);
    return vec2f(dot(texel.normal, ray.origin - view.center) - plane, dot(texel.normal, ray.direction));
}

// What a texel says about the part `part` of the ray, which crosses it.
fn said_by_texel(
    view: DepthView,
    ray: WalkRay,
    at: vec2i,
    part: vec2f,
    starts: bool,
    choices: WalkChoices,
) -> Walk {
    let record = texel_record(view.picture, at);
    if record.y == 0u {
        return Walk(WALK_ON, 0.0, 0u, 0u);
    }
    let texel = unpack_texel(record);
    let height = height_over(view, ray, at, texel);
    let width = width_at(view, texel.depth);
    let radius = texel.radius * width;
    let before = linear_at(height, part.x);
    let after = linear_at(height, part.y);
    let is_before = before >= 0.0;
    // Behind a plane, but not far: a step within one surface.
    let is_crack = !is_before && -before <= choices.jump * width + 0.02 * radius;
    if (starts && before <= -0.5 * choices.jump * width) || !(is_before || is_crack) {
        return Walk(WALK_HIDDEN, part.x, texel.identity, 0u);
    }
    if after > 0.0 {
        return Walk(WALK_ON, 0.0, 0u, 0u);
    }
    let t = select(part.x, part.x + (part.y - part.x) * before / max(before - after, 1e-30), is_before);
    let sight = sight_of(view, vec2f(at) + 0.5 + texel.middle);
    let plane = plane_of(sight_of(view, vec2f(at) + 0.5), texel.normal, texel.depth);
    let middle = view.center + sight.origin + sight.direction * depth_of_plane(sight, texel.normal, plane);
    let beside = distance(ray.origin + ray.direction * t, middle);
    // The surface on which the ray begins does not stop it.
    if t > 4.0 * radius && beside <= radius + choices.disc_slack * width {
        return Walk(WALK_HIT, t, texel.identity, 0u);
    }
    return Walk(WALK_HIDDEN, part.x, texel.identity, 0u);
}
