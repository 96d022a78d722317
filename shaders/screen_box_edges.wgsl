// The changes of brightness between neighbouring texels of the walls of the box, along rows and along columns, and the
// number of known texels of each wall. One thread a texel.
#import screen_box

@group(1) @binding(0) var<storage, read> screen: Screen;
@group(1) @binding(1) var picture_albedo_in: texture_2d<f32>;
@group(1) @binding(2) var<storage, read> texels: array<vec2u>;
// The edges along rows of all walls, then those along columns.
@group(1) @binding(3) var<storage, read_write> edges: array<f32>;
// The period of each wall across and down in texels, then the number of known texels of each.
@group(1) @binding(4) var<storage, read_write> periods: array<atomic<u32>>;

// Of pairs that are not both known.
const UNKNOWN: f32 = 1e9;

@compute @workgroup_size(8, 8)
fn screen_box_edges(@builtin(global_invocation_id) id: vec3u) {
    let at = vec2i(id.xy);
    if any(at >= vec2i(box_edge())) {
        return;
    }
    let here = texels[index_in_box(id.z, at)];
    if here.y > BOX_FILLED {
        atomicAdd(&periods[12u + id.z], 1u);
    }
    for (var axis = 0u; axis < 2u; axis++) {
        let beside = at + select(vec2i(1, 0), vec2i(0, 1), axis == 1u);
        let other = texels[index_in_box(id.z, min(beside, vec2i(box_edge() - 1)))];
        let is_known = all(beside < vec2i(box_edge())) && here.y > BOX_FILLED && other.y > BOX_FILLED;
        edges[6u * axis * texels_of_wall() + index_in_box(id.z, at)] =
            select(UNKNOWN, brightness(other.x) - brightness(here.x), is_known);
    }
}

fn brightness(pixel: u32) -> f32 {
    // A texel without a pixel may hold any number.
    let at = min(vec2u(pixel % frame.width, pixel / frame.width), vec2u(frame.width, frame.height) - 1u);
    return dot(textureLoad(picture_albedo_in, at, 0).rgb, vec3f(0.3, 0.6, 0.1));
}
