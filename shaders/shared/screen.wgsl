// The camera's picture as one in which rays are walked. The importing pass binds `screen`, `records` and `bounds`.
#import screen_box
#import depth_walk
#import hit

fn screen_view() -> DepthView {
    return DepthView(
        vec3f(0.0), frame.right.xyz, frame.up.xyz, frame.forward.xyz, vec2i(i32(frame.width), i32(frame.height)),
        frame.focal_pixels, frame.orthographic != 0u, 0u, i32(screen.levels),
    );
}

fn index_of_cell(level: i32, cell: vec2i) -> u32 {
    let columns = cells_of(vec2i(i32(frame.width), i32(frame.height)), level).x;
    return screen.first_cells[level - 1] + u32(cell.y * columns + cell.x);
}

// Layer 0 is the nearest surface, layer 1 the one behind it, if it is asked for.
fn texel_record(layer: u32, texel: vec2i) -> vec4u {
    return records[layer * screen.texels_of_layer + u32(texel.y) * frame.width + u32(texel.x)];
}

// Between the layers no pixel is passed unseen.
fn cell_bounds(layer: u32, level: i32, cell: vec2i) -> vec2f {
    return select(bounds[index_of_cell(level, cell)], vec2f(0.0), is_between);
}

// Whether the ray is behind the nearest surface, where the layer behind it shows what comes.
var<private> is_between: bool = false;
// Whether what the ray meets is in the layer behind.
var<private> is_in_back: bool = false;
// Whether the ray meets a pixel where another surface may be met.
var<private> meets_unsure: bool = false;
// Where the ray first passed behind something that may hide more; NEVER: nowhere.
var<private> passed_behind: f32 = NEVER;

// Discs of the layer behind are known: how far beside one its plane counts, in pixels.
const BACK_SLACK: f32 = 0.5;

// Whether another method traces the rays that the picture does not resolve.
fn is_continued() -> bool {
    let rest = settings.screen_trace.rest;
    return rest == SCREEN_TRACE_REST_SURFEL_TRACE || rest == SCREEN_TRACE_REST_CUBEMAP_TRACE;
}

fn said_at(view: DepthView, ray: WalkRay, at: vec2i, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    var said = Walk(WALK_ON, 0.0, 0u, 0u);
    if settings.screen_trace.criterion != SCREEN_TRACE_CRITERION_PLANE {
        said = said_by_depth(ray, at, part);
    } else {
        let is_edge_on = (texel_record(0u, at).x & EDGE_ON) != 0u;
        let is_blind = starts && (texel_record(0u, at).x & BLIND) != 0u;
        // A ray may begin on a surface that is seen edge-on.
        if is_blind {
            said = Walk(WALK_HIDDEN, part.x, 0u, 0u);
        } else if !is_between && !(starts && is_edge_on) {
            said = said_by_texel(view, ray, at, part, starts, choices);
            // Where such a surface is met is not known, nor where one that hides the ray's beginning is.
            let is_met = said.kind == WALK_HIT;
            let is_vague = is_edge_on || (starts && said.t <= part.x);
            // What may not be met there is left to the next method; without one it is shown, and not proven.
            let is_unsure = is_met && (texel_record(0u, at).x & UNSURE) != 0u;
            said.t = select(said.t, part.x, is_unsure && is_continued());
            said.kind = select(said.kind, WALK_HIDDEN, is_met && (is_vague || (is_unsure && is_continued())));
            meets_unsure = is_unsure;
        }
        if said.kind == WALK_HIDDEN && !is_blind && settings.screen_trace.back != SCREEN_TRACE_BACK_NONE {
            is_between = true;
            // The nearest back side of a disc may stand behind a front side.
            let hides_more = settings.screen_trace.back == SCREEN_TRACE_BACK_CULLED;
            passed_behind = select(passed_behind, min(passed_behind, said.t), hides_more);
        }
        if is_between {
            said = said_between(view, ray, at, part, starts, choices);
        }
    }
    return said;
}

// What the two layers say about a ray between them.
fn said_between(view: DepthView, ray: WalkRay, at: vec2i, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    let front = texel_record(0u, at);
    let texel = unpack_texel(front);
    let height = height_over(view, ray, at, texel);
    let before = linear_at(height, part.x);
    let after = linear_at(height, part.y);
    var said = Walk(WALK_ON, 0.0, 0u, 0u);
    if front.y == 0u || before >= 0.0 {
        // The ray comes out beside an outline.
        is_between = false;
        if front.y != 0u {
            said = said_by_texel(view, ray, at, part, false, choices);
        }
    } else if after > 0.0 {
        // The ray meets the nearest surface from behind.
        let t = part.x + (part.y - part.x) * before / (before - after);
        said = Walk(WALK_HIT, t, front.x, 0u);
    } else {
        var behind = view;
        behind.picture = 1u;
        var by_disc = choices;
        by_disc.disc_slack = BACK_SLACK;
        said = said_by_texel(behind, ray, at, part, starts, by_disc);
        is_in_back = said.kind == WALK_HIT;
    }
    // Where a surface is met that is seen edge-on is not known.
    let is_edge_on = !is_in_back && (front.x & EDGE_ON) != 0u;
    said.t = select(said.t, part.x, said.kind == WALK_HIT && is_edge_on);
    said.kind = select(said.kind, WALK_HIDDEN, said.kind == WALK_HIT && is_edge_on);
    return said;
}

// What a pixel says by its depth alone, as published: the ray meets it where it is behind it, by no more than a
// thickness, or before the layer behind.
fn said_by_depth(ray: WalkRay, at: vec2i, part: vec2f) -> Walk {
    let record = texel_record(0u, at);
    let depth = bitcast<f32>(record.y);
    let along = vec2f(dot(frame.forward.xyz, ray.origin), dot(frame.forward.xyz, ray.direction));
    let enters = linear_at(along, part.x);
    let leaves = linear_at(along, part.y);
    var end = NEVER;
    var back = vec4u(0u);
    if settings.screen_trace.criterion == SCREEN_TRACE_CRITERION_THICKNESS {
        end = depth + settings.screen_trace.thickness * frame.scene_radius;
    } else if settings.screen_trace.criterion == SCREEN_TRACE_CRITERION_LAYERS {
        if settings.screen_trace.back != SCREEN_TRACE_BACK_NONE {
            back = texel_record(1u, at);
        }
        end = select(NEVER, bitcast<f32>(back.y), back.y != 0u);
    }
    let is_behind = record.y != 0u && max(enters, leaves) > depth;
    let is_met = is_behind && min(enters, leaves) < end;
    // Where it gets behind the pixel, or before the end of what it shows.
    let border = select(select(enters, end, enters > end), depth, enters < depth);
    let t = clamp(part.x + select((border - enters) / along.y, 0.0, border == enters), part.x, part.y);
    passed_behind = select(passed_behind, min(passed_behind, part.x), is_behind && !is_met);
    var said = Walk(WALK_ON, 0.0, 0u, 0u);
    if is_met {
        // The back side is shown where it is nearer to the ray, and faces it.
        let met = linear_at(along, t);
        let is_nearer = back.y != 0u && abs(met - depth) > abs(met - end);
        is_in_back = is_nearer && dot(ray.direction, unpack_texel(back).normal) > 0.0;
        said = Walk(WALK_HIT, t, select(record.x, back.x, is_in_back), 0u);
    }
    return said;
}
