// Push (Preiner 2010, sections 3.6, 3 and 4.6.2): mirror pixels in which nothing was found take what the lowest level of the
// pyramid above them holds. One thread a pixel.
#import frame_group

// w: specular intensity, 0 where there is no mirror.
@group(1) @binding(0) var point_in: texture_2d<f32>;
// The pyramids of the Mirror G-Buffer; level 0 holds what was found.
@group(1) @binding(1) var albedo_in: texture_2d<f32>;
@group(1) @binding(2) var normal_in: texture_2d<f32>;
@group(1) @binding(3) var position_in: texture_2d<f32>;
@group(1) @binding(4) var albedo_out: texture_storage_2d<rgba16float, write>;
@group(1) @binding(5) var normal_out: texture_storage_2d<rgba32float, write>;
// w: coverage: 1 found, 1 / (1 + level) where the pixel was closed, 0 nothing.
@group(1) @binding(6) var position_out: texture_storage_2d<rgba32float, write>;

@compute @workgroup_size(8, 8)
fn push(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    // Nothing reads the Mirror G-Buffer where there is no mirror; another method may fill it there.
    if textureLoad(point_in, id.xy, 0).w == 0.0 {
        return;
    }
    var level = 0u;
    var at = id.xy;
    var position = textureLoad(position_in, at, 0);
    let levels = min(settings.sscr.pull_levels, textureNumLevels(position_in) - 1u);
    while position.w == 0.0 && level < levels {
        level++;
        // Levels of odd size round down.
        at = min(id.xy >> vec2u(level), textureDimensions(position_in, level) - 1u);
        position = textureLoad(position_in, at, level);
    }
    position.w /= f32(1u + level);
    let is_filled = position.w > 0.0;
    textureStore(albedo_out, id.xy, select(vec4f(0.0), textureLoad(albedo_in, at, level), is_filled));
    textureStore(normal_out, id.xy, select(vec4f(0.0), textureLoad(normal_in, at, level), is_filled));
    textureStore(position_out, id.xy, select(vec4f(0.0), position, is_filled));
}
