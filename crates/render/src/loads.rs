//! The loads of passes: how much more a thread may do by some settings than by those that docs/gpu.md computes times
//! with. Each row of `passes!` names its load, if it has one.

use scene::{IndirectBy, Method, Settings, Splat};

/// How many times as many texels a ray tests where no bounds of depths are asked.
pub(crate) const WITHOUT_SKIPPING: f64 = 8.0;

/// The number of tiles of virtual lights along the edge of the window over which light by rays is averaged however near
/// other surfaces are. Few rays are too noisy for less than the whole window.
pub(crate) fn ray_tiles(rays_per_pixel: u32) -> u32 {
    if rays_per_pixel > 8 { 1 } else { MOST_RAY_TILES }
}

const MOST_RAY_TILES: u32 = 2;

/// The side of most discs in pixels, at least one: streaming and the spacing of points keep them at about three for
/// splats of the usual size.
pub(crate) fn side_of_discs(splat: &Splat) -> f64 {
    let most = splat.max_pixels.max(splat.rest_pixels);
    f64::from((3.0 * splat.size).min(most).max(splat.min_pixels).max(1.0))
}

fn ratio(value: u32, usual: u32) -> f64 {
    (f64::from(value) / f64::from(usual)).max(1.0)
}

/// Bounds of depths let a ray pass many texels at once.
fn by_texels(skip: bool) -> f64 {
    if skip { 1.0 } else { WITHOUT_SKIPPING }
}

fn virtual_lights(settings: &Settings) -> f64 {
    f64::from(settings.gi.sky_lights + settings.gi.bounces * settings.gi.vpls)
}

pub(crate) fn discs(settings: &Settings) -> f64 {
    (side_of_discs(&settings.splat) / 3.0).powi(2)
}

/// The virtual lights of a pixel: neighbours share the lights of a block.
pub(crate) fn lights_of_a_pixel(settings: &Settings) -> f64 {
    virtual_lights(settings) / neighbours_of(settings) / 1024.0
}

pub(crate) fn all_lights(settings: &Settings) -> f64 {
    virtual_lights(settings) / 4096.0
}

/// The neighbours whose light is averaged.
pub(crate) fn neighbours(settings: &Settings) -> f64 {
    neighbours_of(settings) * windows(settings) / 16.0
}

/// How many times as many neighbours the light of rays is averaged over.
pub(crate) fn windows(settings: &Settings) -> f64 {
    if settings.gi.by == IndirectBy::Rays { f64::from(MOST_RAY_TILES * MOST_RAY_TILES) } else { 1.0 }
}

fn neighbours_of(settings: &Settings) -> f64 {
    f64::from(settings.gi.interleave * settings.gi.interleave)
}

/// The pixels of a mirror point's splat.
pub(crate) fn mirror_splats(settings: &Settings) -> f64 {
    let splat = (f64::from(settings.sscr.max_splat_size) / 3.0).powi(2);
    match settings.reflection.method {
        Method::SampleCameras => f64::from(settings.sample_cameras.roots) * splat.max(1.0),
        _ => splat,
    }
}

/// The steps of the searches of a point.
pub(crate) fn searches(settings: &Settings) -> f64 {
    let sscr = &settings.sscr;
    let seeds = if sscr.per_region { 32 } else { sscr.seed_attempts };
    f64::from(sscr.max_steps) / 30.0 * ratio(sscr.step_attempts, 6) * ratio(seeds, 6)
}

/// The points that a square keeps, with their roots.
pub(crate) fn points_of_a_square(settings: &Settings) -> f64 {
    let cameras = &settings.sample_cameras;
    let kept = if cameras.points_per_pixel == 0.0 { 16.0 } else { cameras.points_per_pixel / 2.0 };
    let squares = ratio(4, cameras.least_square).powi(2);
    f64::from(kept).max(1.0) * squares * ratio(cameras.roots, 4) * ratio(cameras.polish + 1, 1)
}

/// The gaps of a cell of space, with their roots.
pub(crate) fn cells(settings: &Settings) -> f64 {
    let cameras = &settings.sample_cameras;
    ratio(cameras.longest_list, 64) * ratio(cameras.roots, 4) * ratio(cameras.polish + 1, 1)
}

/// The texels of maps that a ray passes.
pub(crate) fn maps(settings: &Settings) -> f64 {
    let trace = &settings.cubemap_trace;
    let by_step = (0.001 / f64::from(trace.step)).max(0.25 / f64::from(trace.angle)).max(1.0);
    // Rays pass small maps sooner.
    let texels = (f64::from(trace.size) / 256.0).max(0.5) * by_texels(trace.skip);
    ratio(trace.tries.min(trace.maps), 2) * texels * by_step
}

/// The texels of the picture that a ray passes.
pub(crate) fn layers(settings: &Settings) -> f64 {
    by_texels(settings.screen_trace.skip) * (0.005 / f64::from(settings.screen_trace.stride)).max(1.0)
}

/// The places at which a texel of the walls is tried.
pub(crate) fn walls(settings: &Settings) -> f64 {
    texels_of_walls(settings).powi(2)
}

/// The texels of a row of the walls.
pub(crate) fn texels_of_walls(settings: &Settings) -> f64 {
    f64::from(settings.screen_trace.box_size) / 256.0
}
