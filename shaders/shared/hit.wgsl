// What the mirror pixels' rays meet, four words each. x: f32 bits of the key by which the nearest is chosen. y: identity
// of the point + 1, 0: nothing yet. z: f32 bits of the distance; below 0 if the point's disc is not on the ray, which then
// sees the place of it that is nearest. w: tests so far, while they are counted.

// x of a ray that ends on a pixel of the camera's picture; y is the pixel + 1 (screen_resolve.wgsl).
const HIT_IN_PICTURE: u32 = 0x7fffffffu;
// Added to x where nothing proves that the ray is free up to the hit.
const HIT_UNPROVEN: u32 = 0x80000000u;

// x where y is 0 and nothing is known of what the ray meets.
const HIT_UNKNOWN: u32 = 1u;

fn is_unknown(hit: vec4u) -> bool {
    return hit.y == 0u && hit.x == HIT_UNKNOWN;
}

fn is_in_picture(hit: vec4u) -> bool {
    return (hit.x & HIT_IN_PICTURE) == HIT_IN_PICTURE;
}

// The coverage of what was found.
fn coverage_of(hit: vec4u) -> f32 {
    return select(1.0, 0.75, (hit.x & HIT_UNPROVEN) != 0u);
}

// Marks the pixels of the picture whose surface is seen edge-on: where a ray meets it there is not known.
const EDGE_ON: u32 = 0x80000000u;
// Added where that is because slopes change from pixel to pixel: not even a ray's beginning there is known to be free.
const BLIND: u32 = 0x40000000u;
// Marks those where another surface may be met than the pixel shows.
const UNSURE: u32 = 0x20000000u;
// The number of the pixel without marks.
const PIXEL_NUMBER: u32 = 0x1fffffffu;
