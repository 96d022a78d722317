// The results that forward methods pass to the passes that splat points onto the mirror.

struct Solution {
    // The place on the screen where the point is reflected, see pack_place. 0: none yet.
    place: u32,
    // The distance from the mirror in world units. 0: not reflected.
    distance: f32,
}

// The mirror does not reflect its own surface around the mirror point: points nearer than this many splat radii are
// left out.
const OWN_SURFACE_RADII: f32 = 4.0;

// A quarter of a pixel is finer than any splat shows, and lets 16 bits reach over 16,000 pixels.
const PLACES_PER_PIXEL: f32 = 4.0;

// Pixel coordinates, centres at halves, as two halves of a word; never 0.
fn pack_place(at: vec2f) -> u32 {
    let steps = vec2u(clamp(at * PLACES_PER_PIXEL, vec2f(1.0), vec2f(65535.0)));
    return steps.x | steps.y << 16u;
}

fn unpack_place(place: u32) -> vec2f {
    return (vec2f(vec2u(place & 0xffffu, place >> 16u)) + 0.5) / PLACES_PER_PIXEL;
}

struct MirrorSplat {
    // The first and last pixels, inclusive; on the screen.
    first: vec2i,
    last: vec2i,
}

// The square of pixels whose centres a splat covers; at least the one it is in. Its side falls linearly with the
// distance to one pixel (Preiner 2010, section 3.6, 2).
fn splat_of_solution(solution: Solution, largest: f32, far: f32, size: vec2u) -> MirrorSplat {
    let at = unpack_place(solution.place);
    let side = max(mix(largest, 1.0, min(solution.distance / far, 1.0)), 1.0);
    let holds = vec2i(at);
    let first = min(vec2i(ceil(at - side * 0.5 - 0.5)), holds);
    let last = max(vec2i(ceil(at + side * 0.5 - 0.5)) - 1, holds);
    return MirrorSplat(max(first, vec2i(0)), min(last, vec2i(size) - 1));
}
