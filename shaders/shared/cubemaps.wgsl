// Maps of six faces around mirrors, in which rays are walked. Filled by crates/render/src/reflection/cubemap_trace.rs.
// The importing pass binds them as `cubes`, `records` and `bounds`.
#import cube_faces
#import depth_walk
#import params

// The maps. xyz of `places`: the middle of each, relative to the eye.
struct Cubes {
    // Texels along the edge of a face.
    size: u32,
    // `size`, rounded up to a power of two.
    padded_size: u32,
    // The room of a face in `records`.
    texels_of_face: u32,
    // The number of levels of bounds.
    levels: u32,
    // The number of maps.
    maps: u32,
    // 1 if some faces lack the newest points.
    lag: u32,
    unused_1: u32,
    unused_2: u32,
    places: array<vec4f>,
}

fn face_of(map: u32, face: u32) -> DepthView {
    return cube_face(cubes.places[map].xyz, cubes.size, face, map * 6u + face, i32(cubes.levels));
}

// Set where no other criterion than that of planes is asked for.
override only_planes: bool = true;

fn said_at(view: DepthView, ray: WalkRay, at: vec2i, part: vec2f, starts: bool, choices: WalkChoices) -> Walk {
    var said = Walk(WALK_ON, 0.0, 0u, 0u);
    if only_planes || choices.criterion == CUBEMAP_TRACE_CRITERION_PLANE {
        said = said_by_texel(view, ray, at, part, starts, choices);
    } else {
        said = said_by_flat_texel(view, ray, at, part, starts, choices);
    }
    return said;
}

// Whether a ray is still behind what hid its beginning, and the point that does, by the criterion of either sign.
var<private> is_inside: bool = false;
var<private> inside_of: u32 = 0u;

// The criteria with one depth for a whole texel. Behind it, nothing is known to end: by the change from before to
// behind, whatever is behind a texel has met it. By the published change of either sign, a ray whose beginning is hidden
// meets what it comes out of.
fn said_by_flat_texel(
    view: DepthView,
    ray: WalkRay,
    at: vec2i,
    part: vec2f,
    starts: bool,
    choices: WalkChoices,
) -> Walk {
    let record = texel_record(view.picture, at);
    let texel = unpack_texel(record);
    let width = texel.depth / view.focal;
    let behind = vec2f(dot(view.forward, ray.origin - view.center) - texel.depth, dot(view.forward, ray.direction));
    let enters = linear_at(behind, part.x);
    let leaves = linear_at(behind, part.y);
    // The depth, relative to the texel's, at which the ray meets it, and whether it does so.
    var depth = 0.0;
    var meets = leaves > 0.0;
    var is_within = enters > 0.0;
    var is_hidden = starts && enters > 0.5 * choices.jump * width;
    if choices.criterion == CUBEMAP_TRACE_CRITERION_THRESHOLD {
        depth = select(choices.threshold, -choices.threshold, enters < 0.0);
        is_within = abs(enters) <= choices.threshold;
        meets = is_within || (enters < depth && leaves >= depth) || (enters > depth && leaves <= depth);
        // The ray ends behind the texel.
        is_hidden = !meets && leaves > choices.threshold && part.y >= ray.end;
    }
    let share = (depth - enters) / select(leaves - enters, 1.0, leaves == enters);
    let t = select(part.x + (part.y - part.x) * share, part.x, is_within);
    var said = Walk(WALK_ON, 0.0, texel.identity, 0u);
    if starts {
        let is_either = choices.criterion == CUBEMAP_TRACE_CRITERION_SIGN_EITHER;
        is_inside = is_either && record.y != 0u && is_hidden;
    }
    if is_inside {
        let is_behind = record.y != 0u && enters > 0.0;
        inside_of = select(inside_of, texel.identity, is_behind);
        if record.y == 0u || leaves <= 0.0 {
            is_inside = false;
            said = Walk(WALK_HIT, select(part.x, t_of_change(enters, leaves, part), is_behind), inside_of, 0u);
        }
    } else if record.y != 0u && is_hidden {
        said.kind = WALK_HIDDEN;
        said.t = part.x;
    } else if record.y != 0u && meets && t > 4.0 * texel.radius * width {
        // The surface on which the ray begins does not stop it.
        said.kind = WALK_HIT;
        said.t = t;
    }
    return said;
}

// Where a ray changes sides between the ends of a part.
fn t_of_change(enters: f32, leaves: f32, part: vec2f) -> f32 {
    return part.x - (part.y - part.x) * enters / select(leaves - enters, 1.0, leaves == enters);
}

fn index_of_texel(picture: u32, texel: vec2i) -> u32 {
    return picture * cubes.texels_of_face + u32(texel.y) * cubes.size + u32(texel.x);
}

// Levels have their room one after the other, in rows of a power of two.
fn index_of_cell(picture: u32, level: i32, cell: vec2i) -> u32 {
    let whole = cubes.padded_size * cubes.padded_size;
    let finer = cubes.padded_size >> u32(level - 1);
    let row = cubes.padded_size >> u32(level);
    return (picture * (whole - 1u) + whole - finer * finer) / 3u + u32(cell.y) * row + u32(cell.x);
}
