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

// Set if solutions keep the side of their splat, in the last bits of the distance.
override own_sides: bool = false;
// The number of solutions of each point, of which the first ones are used; they are a page apart.
override rounds: u32 = 1u;

const SIDE_BITS: u32 = 63u;
const SIDES_PER_DOUBLING: f32 = 16.0;

// The distance with the side of a splat, from 1 to 15 pixels; the distance changes by up to 8 millionths.
fn pack_side(distance: f32, side: f32) -> f32 {
    let word = u32(clamp(floor(log2(side) * SIDES_PER_DOUBLING + 0.5), 0.0, f32(SIDE_BITS)));
    return bitcast<f32>((bitcast<u32>(distance) & ~SIDE_BITS) | word);
}

fn unpack_side(distance: f32) -> f32 {
    return exp2(f32(bitcast<u32>(distance) & SIDE_BITS) / SIDES_PER_DOUBLING);
}

struct MirrorSplat {
    // The first and last pixels, inclusive; on the screen.
    first: vec2i,
    last: vec2i,
}

// The square of pixels whose centres a splat covers; at least the one it is in. Its side is the solution's own, or falls
// linearly with the distance to one pixel (Preiner 2010, section 3.6, 2).
fn splat_of_solution(solution: Solution, largest: f32, far: f32, size: vec2u) -> MirrorSplat {
    let at = unpack_place(solution.place);
    let by_distance = max(mix(largest, 1.0, min(solution.distance / far, 1.0)), 1.0);
    let side = select(by_distance, unpack_side(solution.distance), own_sides);
    let holds = vec2i(at);
    let first = min(vec2i(ceil(at - side * 0.5 - 0.5)), holds);
    let last = max(vec2i(ceil(at + side * 0.5 - 0.5)) - 1, holds);
    return MirrorSplat(max(first, vec2i(0)), min(last, vec2i(size) - 1));
}
