// The box of six walls about all points, each with a picture of its own. Wall k < 3 is where axis k is largest, wall k + 3
// where it is smallest; the two axes after k point right and up. The importing pass binds `screen`.
#import screen_layout

// Texels along an edge of a wall's picture.
fn box_edge() -> i32 {
    return i32(settings.screen_trace.box_size);
}

// The texels of a wall in a buffer of them all: bindings must start at a multiple of 256 bytes.
fn texels_of_wall() -> u32 {
    return (settings.screen_trace.box_size * settings.screen_trace.box_size + 31u) / 32u * 32u;
}

fn index_in_box(wall: u32, texel: vec2i) -> u32 {
    return wall * texels_of_wall() + u32(texel.y * box_edge() + texel.x);
}

// The texel of a place on a wall.
fn texel_in_box(wall: u32, place: vec3f) -> vec2i {
    let axes = vec2u((wall + 1u) % 3u, (wall + 2u) % 3u);
    let extent = screen.box_high.xyz - screen.box_low.xyz;
    let offset = place - 0.5 * (screen.box_low.xyz + screen.box_high.xyz);
    let scale = f32(box_edge()) / max(max(extent[axes.x], extent[axes.y]), 1e-20);
    let at = 0.5 * f32(box_edge()) + scale * vec2f(offset[axes.x], -offset[axes.y]);
    return clamp(vec2i(floor(at)), vec2i(0), vec2i(box_edge() - 1));
}

// A texel has two words: a point's identity or a pixel, and 0 if it has none, 1 if it was filled from other texels.
const BOX_FILLED: u32 = 1u;
