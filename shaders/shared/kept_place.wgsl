// Finds a place of this frame among those that the frame before has kept. The shader that imports this binds
// `before`, the camera of the frame before, whose clip.xyz is this frame's eye relative to that one's, and `kept`: an element
// for each pixel of that frame. xyz: f32 bits of a place relative to that frame's eye, w: 0 if there is none.
#import frame_group

// Places are taken over from pixels at most so many pixels away.
const REACH: f32 = 8.0;
// No pixel.
const NOWHERE: u32 = 0xffffffffu;

// The element of the nearest kept place of the same side of the same surface; `position` is relative to this frame's eye.
fn kept_pixel(position: vec3f, normal: vec3f) -> u32 {
    let place = position + before.clip.xyz;
    let view = view_from_relative(before, place);
    // The eye was on the same side of the surface: its other side has other light.
    let sight = select(place, before.forward.xyz, before.orthographic != 0u);
    if !(view.z > before.near && dot(normal, sight) < 0.0) {
        return NOWHERE;
    }
    let at = pixel_from_view(before, view);
    let size = vec2f(f32(before.width), f32(before.height));
    if !(all(at >= vec2f(0.0)) && all(at < size)) {
        return NOWHERE;
    }
    // Neighbouring pixels lie this far apart, of the coarser one of the two pictures.
    let own = view_from_relative(frame, position);
    let apart = 1.0 / min(pixels_per_unit(before, view.z), pixels_per_unit(frame, own.z));
    let slant = max(abs(dot(normal, normalize(place))), 0.25);
    var nearest = REACH * apart / slant;
    let near_enough = 3.0 * apart / slant;
    var found = NOWHERE;
    let corner = vec2i(floor(at - 0.5));
    // First the four pixels around the place. Where they show other surfaces, which points of a coarse picture do here
    // and there, those farther away.
    for (var i = 0; i < 4 + 16; i++) {
        if i == 4 && nearest < near_enough {
            break;
        }
        let farther = vec2i((i - 4) & 3, (i - 4) >> 2u) * 3 - 4;
        let pixel = clamp(corner + select(farther, vec2i(i & 1, i >> 1u), i < 4), vec2i(0), vec2i(size) - 1);
        let index = u32(pixel.y) * before.width + u32(pixel.x);
        let element = kept[index];
        let offset = bitcast<vec3f>(element.xyz) - place;
        let distance = length(offset);
        // A place of another surface is not taken.
        let is_same = element.w != 0u && abs(dot(offset, normal)) < 1.0 * apart;
        if is_same && distance < nearest {
            nearest = distance;
            found = index;
        }
    }
    return found;
}
