// Shows how a method came to its result, or what it found, instead of the picture: mirror pixels in false colours,
// other pixels darkened. One thread a pixel.
#import frame_group
#import packing
#import tone
#import heat
#import region

@group(1) @binding(0) var color_in: texture_2d<f32>;
// xyz: mirror point, w: specular intensity.
@group(1) @binding(1) var point_in: texture_2d<f32>;
@group(1) @binding(2) var albedo_in: texture_2d<f32>;
@group(1) @binding(3) var normal_in: texture_2d<f32>;
// w: coverage.
@group(1) @binding(4) var position_in: texture_2d<f32>;
// x: flags of the curvature map (shaders/shared/region.wgsl), y: label, z: steps, w: share of searches out of steps.
@group(1) @binding(5) var views_in: texture_2d<f32>;
// Why the result is doubtful, as in mirror_doubt.wgsl; 0 where it is trusted.
@group(1) @binding(6) var doubt_in: texture_2d<f32>;
@group(1) @binding(7) var picture_out: texture_storage_2d<rgba8unorm, write>;

@compute @workgroup_size(8, 8)
fn show(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let point = textureLoad(point_in, id.xy, 0);
    let position = textureLoad(position_in, id.xy, 0);
    let views = textureLoad(views_in, id.xy, 0);
    let picture = screen_color(settings, textureLoad(color_in, id.xy, 0).rgb);
    var color = picture * 0.25;
    if point.w > 0.0 {
        color = vec3f(0.0);
        let is_found = position.w > 0.0;
        switch settings.reflection.show {
            // Red: along x, green: along y; dark: planar, half: convex, bright: hollow. Blue: a step of depth.
            case REFLECTION_SHOW_CURVATURE: {
                let flags = u32(views.x);
                color = vec3f(f32(flags & 3u), f32((flags >> 2u) & 3u), f32(min((flags >> 4u) & 3u, 1u)) * 2.0) * 0.5;
            }
            // The same before planar pixels take over the bend beside them; white: between two regions.
            case REFLECTION_SHOW_BORDERS: {
                let flags = u32(views.x);
                let open = flags >> OPEN_BITS;
                color = vec3f(f32(open & BENT), f32((open >> DIRECTION_BITS) & BENT), 0.0) * 0.5;
                color = select(color, vec3f(1.0), (flags & SUPPRESSED) != 0u);
            }
            case REFLECTION_SHOW_REGIONS: { color = color_of_number(u32(views.y)); }
            case REFLECTION_SHOW_STEPS: { color = heat(views.z / f32(most_steps)); }
            case REFLECTION_SHOW_UNCONVERGED: { color = heat(views.w); }
            // Black: nothing, orange: closed, by how much; white: found.
            case REFLECTION_SHOW_COVERAGE: {
                color = select(vec3f(1.0, 0.6, 0.1) * (0.4 + 0.6 * position.w), vec3f(1.0), position.w >= 0.75);
                color = select(vec3f(0.0), color, is_found);
            }
            // Grey: trusted; orange: closed, red: off its ray, violet: alone among its neighbours, yellow: unproven; dark blue: nothing found.
            case REFLECTION_SHOW_UNCERTAIN: {
                let reasons = array(vec3f(0.0), vec3f(1.0, 0.6, 0.1), vec3f(0.95, 0.15, 0.1), vec3f(0.65, 0.3, 0.95), vec3f(0.9, 0.85, 0.2));
                let doubt = u32(textureLoad(doubt_in, id.xy, 0).x);
                color = select(reasons[min(doubt, 4u)], vec3f(dot(picture, vec3f(0.2126, 0.7152, 0.0722))) * 0.8, doubt == 0u);
                color = select(vec3f(0.05, 0.05, 0.3), color, is_found);
            }
            case REFLECTION_SHOW_DISTANCE: {
                color = select(vec3f(0.0), heat(distance(position.xyz, point.xyz) / (2.0 * frame.scene_radius)), is_found);
            }
            case REFLECTION_SHOW_ALBEDO: {
                color = select(vec3f(0.0), srgb_from_linear(textureLoad(albedo_in, id.xy, 0).rgb), is_found);
            }
            case REFLECTION_SHOW_NORMAL: {
                color = select(vec3f(0.0), textureLoad(normal_in, id.xy, 0).xyz * 0.5 + 0.5, is_found);
            }
            // Repeats every quarter of the scene's radius.
            default: { color = select(vec3f(0.0), fract(position.xyz / (0.25 * frame.scene_radius)), is_found); }
        }
    }
    textureStore(picture_out, id.xy, vec4f(color, 1.0));
}

// The value that is white in the heat map.
override most_steps: u32 = 64u;

// Distant hues for consecutive numbers: the hue turns by the golden angle.
fn color_of_number(number: u32) -> vec3f {
    if number == 0u {
        return vec3f(0.15);
    }
    let hue = fract(f32(number) * 0.61803399) * 6.0;
    return clamp(vec3f(abs(hue - 3.0) - 1.0, 2.0 - abs(hue - 2.0), 2.0 - abs(hue - 4.0)), vec3f(0.0), vec3f(1.0)) * 0.8 + 0.1;
}
