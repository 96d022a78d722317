// Takes over indirect light from the frame before, for pictures while something moves: light that falls on a surface is
// the same from every eye. Pixels that find no light of the same place say which tiles of 8 x 8 pixels must be
// computed. One thread a pixel.
#import frame_group
#import gloss
#import kept_place

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// See kept_place.wgsl.
@group(1) @binding(3) var<uniform> before: Frame;
// See kept_light.wgsl.
@group(1) @binding(4) var<storage, read> kept: array<vec4u>;
@group(1) @binding(5) var<storage, read_write> light_out: array<vec4u>;
// 1 for tiles that must be computed.
@group(1) @binding(6) var<storage, read_write> tiles: array<atomic<u32>>;

// The edge of the window that indirect_filter averages, in pixels; at most 8.
override window: u32 = 1u;

@compute @workgroup_size(8, 8)
fn indirect_reuse(@builtin(global_invocation_id) thread: vec3u) {
    let id = thread.xy;
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let position = textureLoad(position_in, id, 0);
    let normal = textureLoad(normal_in, id, 0);
    var found = vec4u(0u);
    // Highlights are not kept, because they depend on the eye.
    if position.w > 0.0 && gloss_of(settings, textureLoad(albedo_in, id, 0).a, normal.w).share == 0.0 {
        let pixel = kept_pixel(position.xyz, normal.xyz);
        if pixel != NOWHERE {
            let light = kept[pixel];
            found = vec4u(bitcast<vec3u>(bitcast<vec3f>(light.xyz) - before.clip.xyz), light.w);
        }
    }
    light_out[id.y * frame.width + id.x] = found;
    if position.w > 0.0 && found.w == 0u {
        // The average of a pixel needs all pixels of the window about it.
        let reach = vec2i(i32(window / 2u));
        let last_tile = (vec2i(i32(frame.width), i32(frame.height)) - 1) / 8;
        let low = max(vec2i(id) - reach, vec2i(0)) / 8;
        let high = min((vec2i(id) + reach) / 8, last_tile);
        for (var y = low.y; y <= high.y; y++) {
            for (var x = low.x; x <= high.x; x++) {
                atomicStore(&tiles[y * (last_tile.x + 1) + x], 1u);
            }
        }
    }
}
