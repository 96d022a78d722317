// The colour of a point, according to the source of the cloud's colours. The values of COLOR_* are those of
// crates/render/src/coloring.rs.
#import finite
#import packing
#import page_group

const COLOR_PLAIN: u32 = 0u;
const COLOR_RGB: u32 = 1u;
const COLOR_NORMAL: u32 = 2u;
const COLOR_CLASS: u32 = 3u;
const COLOR_HEIGHT: u32 = 4u;
const COLOR_SCALAR: u32 = 5u;
const COLOR_STRAY: u32 = 6u;
const COLOR_RGB_OR_PLAIN: u32 = 7u;
const COLOR_RGB_OR_GREY: u32 = 8u;

// The entry of the palette (256 colours of each ramp, then 256 of the classes and those of strays), or PALETTE_NONE for a colour of its
// own. A point without a value (NaN) has no entry: it is plain.
const PALETTE_NONE: u32 = 0xffffffffu;

fn palette_index(item: Item, point: vec4u, scalar: f32) -> u32 {
    if item.color_source == COLOR_CLASS {
        return item.palette + ((point.w >> 16u) & 0xffu);
    }
    if item.color_source == COLOR_STRAY {
        return item.palette + stray_kind(point.w & 0xffffu);
    }
    var value = scalar;
    if item.color_source == COLOR_HEIGHT {
        value = item.height + dot(item.height_axis.xyz, bitcast<vec3f>(point.xyz));
    } else if item.color_source != COLOR_SCALAR || is_nan(scalar) {
        return PALETTE_NONE;
    }
    return item.palette + u32(clamp((value - item.low) * item.inverse_range, 0.0, 1.0) * 255.0 + 0.5);
}

// The linear albedo of the point `index` of the page; the pass has already read its words `point` and `attributes`.
fn albedo_of_point(item: Item, index: u32, point: vec4u, attributes: vec2u) -> vec3f {
    var scalar = 0.0;
    if item.color_source == COLOR_SCALAR || item.color_source == COLOR_RGB_OR_GREY {
        scalar = scalar_of_point(index);
    }
    let entry = palette_index(item, point, scalar);
    var from_palette = 0u;
    if entry != PALETTE_NONE {
        from_palette = palette_color(entry);
    }
    let is_blank = item.color_source >= COLOR_RGB_OR_PLAIN && (attributes.x & 0xffffffu) == 0u;
    let has_rgb = item.color_source == COLOR_RGB || item.color_source >= COLOR_RGB_OR_PLAIN;
    let own = select(item.plain, attributes.x, has_rgb && !is_blank);
    var srgb = unpack4x8unorm(select(from_palette, own, entry == PALETTE_NONE)).rgb;
    if is_blank && item.color_source == COLOR_RGB_OR_GREY && !is_nan(scalar) {
        let grey = clamp((scalar - item.low) * item.inverse_range, 0.0, 1.0);
        srgb = vec3f(floor(grey * 255.0 + 0.5) / 255.0);
    }
    if item.color_source == COLOR_NORMAL {
        // Normals are shown in the common way: components -1 to 1 as sRGB 0 to 1.
        srgb = unpack_normal(attributes.y) * 0.5 + 0.5;
    }
    // Once, for all sources: its powers are most of the cost of a point's colour.
    return linear_from_srgb(srgb);
}
