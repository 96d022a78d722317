// What the mirror pixels' rays meet, four words each. x: f32 bits of the key by which the nearest is chosen. y: identity
// of the point + 1, 0: nothing yet. z: f32 bits of the distance. w: tests so far, while they are counted.

// x of a ray that ends on a pixel of the camera's picture; y is the pixel + 1 (screen_resolve.wgsl).
const HIT_IN_PICTURE: u32 = 0x7fffffffu;
// Added to x where nothing proves that the ray is free up to the hit.
const HIT_UNPROVEN: u32 = 0x80000000u;

fn is_in_picture(hit: vec4u) -> bool {
    return (hit.x & HIT_IN_PICTURE) == HIT_IN_PICTURE;
}

// The coverage of what was found.
fn coverage_of(hit: vec4u) -> f32 {
    return select(1.0, 0.75, (hit.x & HIT_UNPROVEN) != 0u);
}

// Marks the pixels of the picture whose surface is seen edge-on: where a ray meets it there is not known.
const EDGE_ON: u32 = 0x80000000u;
