// The sums that the visibility pass of forward methods accumulates in each mirror pixel. They are fixed-point words
// with 16 bits of carry each, so that the order of the points cannot matter and a pixel can take all points.
#import frame_group

const MIRROR_SUMS: u32 = 12u;
// albedo_sums: count; albedo, linear, 12 bits. normal_sums: normal in world axes, 11 bits and sign; specular intensity.
// position_sums: position; specular power.
// Positions are relative to the mirror point, in 20 bits of this many distances to the farthest point that counts, to
// either side: a splat extends over pixels whose mirror points are elsewhere. The step is 4 millionths of the distance.
const POSITION_REACH: f32 = 2.0;
const POSITION_STEPS: f32 = 524287.0;

// The words of a pixel's carries. Behind those of all pixels, from a multiple of CARRY_ALIGNMENT words on, lies the
// nearness of each pixel's nearest point.
const MIRROR_CARRIES: u32 = 6u;
const CARRY_ALIGNMENT: u32 = 64u;

// The largest distance from the mirror at which points count, if the nearest is at `front`; world units.
fn farthest_counted(front: f32, scene_radius: f32) -> f32 {
    let behind = settings.sscr.mirror_depth_offset * scene_radius;
    return front + select(behind, 0.0, settings.sscr.visibility == SSCR_VISIBILITY_NEAREST);
}
