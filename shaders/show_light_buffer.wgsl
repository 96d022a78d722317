// The shadow maps of the lamps or the sun, a cell each, by distance (bright is near) and slope. One thread a pixel.
#import frame_group
#import light
#import light_view

@group(1) @binding(0) var<uniform> views: LightViews;
@group(1) @binding(1) var<storage, read> lights: array<LightSource>;
@group(1) @binding(2) var<storage, read> shadows: array<vec2u>;
@group(1) @binding(3) var picture_out: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn show_light_buffer(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let cell = cell_of_pixel(views, vec2u(frame.width, frame.height), id.xy);
    var color = OUTSIDE;
    if cell.index < views.count {
        let texel = vec2i(cell.at * f32(SHADOW_SIZE));
        let depth = depth_at(cell.index, texel);
        let is_sun = lights[cell.index].axis_outer.w == 0.0;
        let share = closeness(depth, views.nearest[cell.index], views.farthest[cell.index], is_sun);
        let grey = (0.25 + 0.75 * share) * mix(0.3, 1.0, facing(cell.index, texel, depth));
        color = select(EMPTY, vec3f(grey), depth > 0.0);
    }
    textureStore(picture_out, id.xy, vec4f(color, 1.0));
}

// The linear depth; 0 if empty.
fn depth_at(map: u32, texel: vec2i) -> f32 {
    let inside = clamp(texel, vec2i(0), vec2i(SHADOW_SIZE - 1));
    let key = shadows[(i32(map) * SHADOW_SIZE + inside.y) * SHADOW_SIZE + inside.x].y;
    return select(0.0, depth_from_nearness(key), key != 0u);
}

// The cosine between the surface's normal and the line to the light.
fn facing(map: u32, texel: vec2i, depth: f32) -> f32 {
    let light = lights[map];
    let is_sun = light.axis_outer.w == 0.0;
    // The world units of a texel, and of the place of this one, across the axis.
    let width = select(depth, 1.0, is_sun) / light.intensity_focal.a;
    let across = (vec2f(texel) + 0.5 - f32(SHADOW_SIZE / 2)) * width;
    let slope = vec2f(slope_along(map, texel, vec2i(1, 0), depth), slope_along(map, texel, vec2i(0, 1), depth)) / width;
    // Depth over place is a plane's in parallel light. From a lamp, places spread as depth grows.
    let spread = select(1.0 + dot(slope, across) / depth, 1.0, is_sun);
    let normal = normalize(vec3f(slope, -spread));
    let toward = select(normalize(vec3f(-across, -depth)), vec3f(0.0, 0.0, -1.0), is_sun);
    return abs(dot(normal, toward));
}

// The change of depth from texel to texel: the smaller of both sides, so that edges do not count.
fn slope_along(map: u32, texel: vec2i, step: vec2i, depth: f32) -> f32 {
    let before = depth_at(map, texel - step);
    let after = depth_at(map, texel + step);
    let back = select(1e30, depth - before, before > 0.0);
    let ahead = select(1e30, after - depth, after > 0.0);
    let least = select(ahead, back, abs(back) < abs(ahead));
    return select(0.0, least, abs(least) < 1e30);
}
