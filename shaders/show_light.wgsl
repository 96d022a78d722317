// Shows a part of the light, or a property of the lit surfaces, instead of the picture. One thread a pixel.
#import frame_group
#import tone
#import heat
#import light_view

@group(1) @binding(0) var<uniform> views: LightViews;
// Light, albedo or normal, according to the view.
@group(1) @binding(1) var image_in: texture_2d<f32>;
@group(1) @binding(2) var depth_in: texture_2d<f32>;
@group(1) @binding(3) var picture_out: texture_storage_2d<rgba8unorm, write>;

// Set if there is such light.
override has_light: bool = true;

@compute @workgroup_size(8, 8)
fn show_light(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let depth = textureLoad(depth_in, id.xy, 0).x;
    let image = textureLoad(image_in, id.xy, 0).rgb;
    var color = unpack4x8unorm(settings.view.background).wzy;
    if depth > 0.0 {
        switch settings.light.show {
            case LIGHT_SHOW_DIRECT, LIGHT_SHOW_INDIRECT: {
                color = select(vec3f(0.0), screen_color(settings, image), has_light);
            }
            case LIGHT_SHOW_ALBEDO: { color = srgb_from_linear(image); }
            case LIGHT_SHOW_NORMAL: { color = image * 0.5 + 0.5; }
            // White is near, black is far.
            case LIGHT_SHOW_DEPTH: {
                color = heat(closeness(depth, views.nearest.x, views.farthest.x, frame.orthographic != 0u));
            }
            // The background on which virtual lights are drawn.
            default: { color = screen_color(settings, image) * DIMMED; }
        }
    }
    textureStore(picture_out, id.xy, vec4f(color, 1.0));
}
