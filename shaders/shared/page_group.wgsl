// Group 1 of the passes that read points: a page of the point store. Filled by crates/render/src/inputs.rs. It has few
// buffers, because WebGPU promises only eight in a shader.
#import frame_group
#import splat

@group(1) @binding(0) var<uniform> page: Page;
@group(1) @binding(1) var<storage, read> points: array<vec4u>;
// Colour and normal of each point. Behind those of all points lie a bit for each that says whether it is shown, then
// the scalars, two an element; they are read only where some points are hidden, or an attribute is shown.
@group(1) @binding(2) var<storage, read> attributes: array<vec2u>;
// The palette, four colours an element; where the page's values say, the items, four elements each, and the blocks or
// the runs (blocks.wgsl, point_surface.wgsl).
@group(1) @binding(3) var<storage, read> tables: array<vec4u>;

fn shown_word(word: u32) -> u32 {
    return attributes[page.point_count + word / 2u][word & 1u];
}

fn scalar_of_point(index: u32) -> f32 {
    let first = page.point_count + page.point_count / 64u;
    return bitcast<f32>(attributes[first + index / 2u][index & 1u]);
}

fn palette_color(entry: u32) -> u32 {
    return tables[entry / 4u][entry & 3u];
}

fn item_at(index: u32) -> Item {
    let at = page.items_at + index * 4u;
    let ramp = tables[at + 1u];
    let gloss = tables[at + 2u];
    return Item(
        bitcast<vec4f>(tables[at]),
        bitcast<f32>(ramp.x),
        bitcast<f32>(ramp.y),
        ramp.z,
        ramp.w,
        bitcast<f32>(gloss.x),
        bitcast<f32>(gloss.y),
        gloss.z,
        bitcast<f32>(gloss.w),
        bitcast<vec4f>(tables[at + 3u]),
    );
}
