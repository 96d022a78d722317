// The counters of a frame's reflections; crates/render/src/reflection/mod.rs reads them when the frame is done.
const MIRROR_PIXELS: u32 = 0u;
const FOUND_PIXELS: u32 = 1u;
const CLOSED_PIXELS: u32 = 2u;
const POINTS_TRIED: u32 = 3u;
const POINTS_FOUND: u32 = 4u;
const REGIONS: u32 = 5u;
// The points tried whose search ran out of steps.
const POINTS_UNCONVERGED: u32 = 6u;
// The nodes and discs against which rays were tested, while steps are shown.
const NODES_TESTED: u32 = 7u;
const DISCS_TESTED: u32 = 8u;
// The doubtful mirror pixels.
const DOUBTED_PIXELS: u32 = 9u;
// The rays that no picture of depths resolves.
const RAYS_LEFT: u32 = 10u;
// The rays of glossy mirrors that were traced, and those of which it was known what they meet; 64 bits each, low word
// first.
const RAYS_TRACED: u32 = 11u;
const RAYS_KEPT: u32 = 13u;
// The points that a list of rays projects (sample_cameras with cells of space).
const POINTS_LISTED: u32 = 15u;
// The texels of maps that were traced because a ray looks at them (light_field with fill on_demand).
const TEXELS_TRACED: u32 = 16u;
