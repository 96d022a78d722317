// Fills the texels of the walls of the box that the camera does not see: from the nearest one that is a whole number of
// periods away, else from the nearest in the row or column. A wall of which nothing is seen stays empty. One thread a
// texel.
#import screen_box

@group(1) @binding(0) var<storage, read> screen: Screen;
// Texels that were filled are not filled from.
@group(1) @binding(1) var<storage, read_write> texels: array<atomic<u32>>;
// See screen_box_edges.wgsl.
@group(1) @binding(2) var<storage, read> periods: array<u32>;

// The most periods away.
const MOST_PERIODS: i32 = 32;

@compute @workgroup_size(8, 8)
fn screen_box_fill(@builtin(global_invocation_id) thread: vec3u) {
    let id = whole_thread(frame, thread);
    let at = vec2i(id.xy);
    if any(at >= vec2i(box_edge())) || periods[12u + id.z] == 0u || is_known(id.z, at) {
        return;
    }
    let period = vec2i(vec2u(periods[2u * id.z], periods[2u * id.z + 1u]));
    var from_texel = at;
    var is_found = false;
    for (var away = 1; away <= MOST_PERIODS && any(period > vec2i(0)) && !is_found; away++) {
        for (var across = -away; across <= away && !is_found; across++) {
            for (var side = -1; side <= 1 && !is_found; side += 2) {
                let steps = vec2i(across, side * (away - abs(across)));
                let is_periodic = all((steps == vec2i(0)) | (period > vec2i(0)));
                let candidate = at + steps * period;
                is_found = is_periodic && is_known(id.z, candidate);
                from_texel = select(from_texel, candidate, is_found);
            }
        }
    }
    for (var away = 1; away < box_edge() && !is_found; away++) {
        for (var side = 0; side < 4 && !is_found; side++) {
            let along = select(vec2i(away, 0), vec2i(0, away), side >= 2);
            let candidate = select(at - along, at + along, side % 2 == 1);
            is_found = is_known(id.z, candidate);
            from_texel = select(from_texel, candidate, is_found);
        }
    }
    if is_found {
        let place = 2u * index_in_box(id.z, at);
        atomicStore(&texels[place], atomicLoad(&texels[2u * index_in_box(id.z, from_texel)]));
        atomicStore(&texels[place + 1u], BOX_FILLED);
    }
}

fn is_known(wall: u32, texel: vec2i) -> bool {
    let inside = clamp(texel, vec2i(0), vec2i(box_edge() - 1));
    return all(inside == texel) && atomicLoad(&texels[2u * index_in_box(wall, inside) + 1u]) > BOX_FILLED;
}
