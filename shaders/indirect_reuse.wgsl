// Takes over indirect light from the frame before, for pictures while something moves: light that falls on a surface is
// the same from every eye. Pixels that find no light of the same place say which tiles of 8 x 8 pixels must be
// computed. One thread a pixel.
#import frame_group
#import gloss
#import kept_light

// a: specular intensity.
@group(1) @binding(0) var albedo_in: texture_2d<f32>;
// w: specular power.
@group(1) @binding(1) var normal_in: texture_2d<f32>;
// xyz: relative to the eye, w: coverage.
@group(1) @binding(2) var position_in: texture_2d<f32>;
// The camera of the frame before. Its clip: this frame's eye relative to that one's.
@group(1) @binding(3) var<uniform> before: Frame;
@group(1) @binding(4) var<storage, read> kept: array<vec4u>;
@group(1) @binding(5) var<storage, read_write> light_out: array<vec4u>;
// 1 for tiles that must be computed.
@group(1) @binding(6) var<storage, read_write> tiles: array<atomic<u32>>;

// The edge of the window that indirect_filter averages, in pixels; at most 8.
override window: u32 = 1u;

// Light is taken over from places at most so many pixels away.
const REACH: f32 = 8.0;

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
        found = light_of(position.xyz, normal.xyz);
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

// The kept light of a place, with its position relative to this frame's eye; w is 0 if there is none.
fn light_of(position: vec3f, normal: vec3f) -> vec4u {
    let place = position + before.clip.xyz;
    let view = view_from_relative(before, place);
    // The eye was on the same side of the surface: its other side has other light.
    let sight = select(place, before.forward.xyz, before.orthographic != 0u);
    if !(view.z > before.near && dot(normal, sight) < 0.0) {
        return vec4u(0u);
    }
    let at = pixel_from_view(before, view);
    let size = vec2f(f32(before.width), f32(before.height));
    if !(all(at >= vec2f(0.0)) && all(at < size)) {
        return vec4u(0u);
    }
    // Neighbouring pixels lie this far apart, of the coarser one of the two pictures.
    let own = view_from_relative(frame, position);
    let apart = 1.0 / min(pixels_per_unit(before, view.z), pixels_per_unit(frame, own.z));
    let slant = max(abs(dot(normal, normalize(place))), 0.25);
    var nearest = REACH * apart / slant;
    let near_enough = 3.0 * apart / slant;
    var found = vec4u(0u);
    let corner = vec2i(floor(at - 0.5));
    // First the four pixels around the place. Where they show other surfaces, which points of a coarse picture do here
    // and there, those farther away.
    for (var i = 0; i < 4 + 16; i++) {
        if i == 4 && nearest < near_enough {
            break;
        }
        let farther = vec2i((i - 4) & 3, (i - 4) >> 2u) * 3 - 4;
        let pixel = clamp(corner + select(farther, vec2i(i & 1, i >> 1u), i < 4), vec2i(0), vec2i(size) - 1);
        let light = kept[u32(pixel.y) * before.width + u32(pixel.x)];
        let offset = bitcast<vec3f>(light.xyz) - place;
        let distance = length(offset);
        // Light of another surface is not taken.
        let is_same = light.w != 0u && abs(dot(offset, normal)) < 1.0 * apart;
        if is_same && distance < nearest {
            nearest = distance;
            found = vec4u(bitcast<vec3u>(bitcast<vec3f>(light.xyz) - before.clip.xyz), light.w);
        }
    }
    return found;
}
