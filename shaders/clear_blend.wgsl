// What arrives at each mirror pixel of the camera: what it reflects, and at clear surfaces what is seen through them, by
// Fresnel's shares. Where nothing was found it is the background. One thread a pixel.
#import frame_group
#import packing
#import brdf

// w: coverage of the reflected surface.
@group(1) @binding(0) var seen_in: texture_2d<f32>;
@group(1) @binding(1) var reflected_in: texture_2d<f32>;
// w: 0 where no light goes through.
@group(1) @binding(2) var point_in: texture_2d<f32>;
// w: the share that is reflected.
@group(1) @binding(3) var direction_in: texture_2d<f32>;
// w: coverage of what is seen through the surface.
@group(1) @binding(4) var beyond_in: texture_2d<f32>;
@group(1) @binding(5) var transmitted_in: texture_2d<f32>;
@group(1) @binding(6) var received_out: texture_storage_2d<rgba16float, write>;
// x: how far the mirror's ray goes, in mirror radii.
@group(1) @binding(7) var left_in: texture_2d<f32>;

// Set if `reflected_in` has what arrives at each mirror pixel, the background included (gloss_sum.wgsl).
override is_received: bool = false;
// Set if reflections fade by distance and have not yet.
override fades: bool = false;

@compute @workgroup_size(8, 8)
fn clear_blend(@builtin(global_invocation_id) thread: vec3u) {
    let id = mirror_pixel(frame, thread);
    if id.x >= frame.width || id.y >= frame.height {
        return;
    }
    let background = linear_from_srgb(unpack4x8unorm(settings.view.background).wzy);
    let found = is_received || textureLoad(seen_in, id, 0).w > 0.0;
    var received = select(background, textureLoad(reflected_in, id, 0).rgb, found);
    if fades {
        let reach = textureLoad(left_in, id, 0).x;
        received *= share_left(settings.mirror.fade_distance, settings.mirror.fade_least, reach);
    }
    if textureLoad(point_in, id, 0).w > 0.0 {
        let is_beyond = textureLoad(beyond_in, id, 0).w > 0.0;
        let transmitted = select(background, textureLoad(transmitted_in, id, 0).rgb, is_beyond);
        received = mix(transmitted, received, textureLoad(direction_in, id, 0).w);
    }
    textureStore(received_out, id, vec4f(received, 1.0));
}
