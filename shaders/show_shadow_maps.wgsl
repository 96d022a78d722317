// The shadow maps of the virtual lights, a cell each: first those of the sky, then bounce by bounce. Bright is near;
// pixels outside a map's disc are outside the half space in front of its light. One thread a pixel.
#import frame_group
#import light_view
#import vpl

@group(1) @binding(0) var<uniform> views: LightViews;
@group(1) @binding(1) var<uniform> virtual_lights: Virtual;
@group(1) @binding(2) var<storage, read> vpls: array<Vpl>;
@group(1) @binding(3) var<storage, read> shadow_maps: array<u32>;
@group(1) @binding(4) var picture_out: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn show_shadow_maps(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let cell = cell_of_pixel(views, vec2u(frame.width, frame.height), id.xy);
    let map = cell.at * 2.0 - 1.0;
    var color = OUTSIDE;
    if cell.index < views.count && dot(map, map) < 1.0 {
        let kind = vpls[cell.index].normal.w;
        let texel = vec2u(cell.at * f32(virtual_lights.map_size));
        let code = shadow_maps[cell.index * virtual_lights.map_stride + texel.y * virtual_lights.map_size + texel.x];
        // Begins at a 64th of the scene's diameter.
        let farthest = 2.0 * virtual_lights.eye_radius.w;
        let distance = distance_of_code(virtual_lights, kind, code >> 16u);
        let share = closeness(distance, farthest / 64.0, farthest, kind == VPL_SKY);
        color = select(EMPTY, vec3f(0.15 + 0.85 * share), code != 0u);
        color = select(color, OUTSIDE, kind == VPL_NONE);
    }
    textureStore(picture_out, id.xy, vec4f(color, 1.0));
}
