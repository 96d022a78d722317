// Regions of the mirror that bend one way, and the bits of the curvature map from which they are made (Preiner 2010,
// sections 3.5 and 4.4). CPU twin: crates/render/src/reflection/sscr/twin.rs.
#import ordered

// How the surface bends from the previous pixel to this one: two bits for x, then two for y. If none is set, it is
// planar.
const CONVEX: u32 = 1u;
const HOLLOW: u32 = 2u;
const BENT: u32 = 3u;
const DIRECTION_BITS: u32 = 2u;
// Depth step from the left pixel; from the upper one a bit further left.
const DEPTH_STEP: u32 = 16u;
// At a border between regions; only in the views.
const SUPPRESSED: u32 = 64u;
const MIRROR: u32 = 128u;
// How the surface bends before planar pixels take over the bend of their predecessors, by how many bits further left.
const OPEN_BITS: u32 = 8u;

// The label of a pixel that belongs to no region: outside the mirror, or on a border.
const OUTSIDE: u32 = 0xffffffffu;
// The smallest region that a bracket fits in: two by two pixels.
const LEAST_REGION: u32 = 4u;
// The number of pixels in which a workgroup numbers the regions.
const RUN_PIXELS: u32 = 1024u;

// The regions are indexed by label. The one of label 0, which no pixel has, stands for all of them.
struct Region {
    // The first and last pixel.
    first_x: u32,
    first_y: u32,
    last_x: u32,
    last_y: u32,
    pixels: u32,
    // The number of pixels of this region and all before it.
    accumulated: u32,
    // The number of regions, for all of them.
    regions: u32,
    // The pixels of all regions of the first bounce, for all of them.
    first_pixels: u32,
    // The bounds of its mirror points and of the directions reflected there, as ordered integers.
    point_low: array<u32, 3>,
    point_high: array<u32, 3>,
    direction_low: array<u32, 3>,
    direction_high: array<u32, 3>,
}

// The number of words of a Region, and the indices of its words, for passes that write them as atomics.
const REGION_WORDS: u32 = 20u;
const REGION_FIRST: u32 = 0u;
const REGION_LAST: u32 = 2u;
const REGION_PIXELS: u32 = 4u;
const REGION_ACCUMULATED: u32 = 5u;
const REGION_POINT_LOW: u32 = 8u;
const REGION_POINT_HIGH: u32 = 11u;
const REGION_DIRECTION_LOW: u32 = 14u;
const REGION_DIRECTION_HIGH: u32 = 17u;

fn from_ordered3(bits: array<u32, 3>) -> vec3f {
    return vec3f(from_ordered(bits[0]), from_ordered(bits[1]), from_ordered(bits[2]));
}

// Whether any ray reflected in the region may meet a sphere (or a point, with a radius of 0): its mirror points lie in a
// sphere, its reflected rays in a cone.
fn may_reflect(region: Region, middle: vec3f, radius: f32) -> bool {
    let point_low = from_ordered3(region.point_low);
    let point_high = from_ordered3(region.point_high);
    let direction_low = from_ordered3(region.direction_low);
    let direction_high = from_ordered3(region.direction_high);
    let both_radii = length(point_high - point_low) * 0.5 + radius;
    let axis = (direction_low + direction_high) * 0.5;
    // Unit directions within this distance of the axis' tip; half a sphere of them or more excludes nothing.
    let spread = length(direction_high - direction_low) * 0.5;
    let offset = middle - (point_low + point_high) * 0.5;
    let reach = length(offset);
    let sine = spread / max(length(axis), 1e-6);
    if sine >= 1.0 || reach <= both_radii {
        return true;
    }
    // The angle to the axis, less the angle that the spheres may add.
    let angle = acos(clamp(dot(offset, axis) / (reach * length(axis)), -1.0, 1.0));
    return angle <= asin(sine) + asin(min(both_radii / reach, 1.0)) + CULL_SLACK;
}

// In radians: a search ends within a few pixels of the root, and the ray of a pixel is not the last of its region.
const CULL_SLACK: f32 = 0.05;

// Whether two neighbours bend opposite ways along x or along y.
fn is_border(flags: u32, before: u32) -> bool {
    return ((flags | before) & BENT) == BENT || (((flags | before) >> DIRECTION_BITS) & BENT) == BENT;
}
