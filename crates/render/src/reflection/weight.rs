//! Reflections that count too little to be followed (Johnsson 2012, 7.4): the weight of a ray is the product of what
//! the mirrors on its way reflect, and a ray that would weigh less than `reflection.least_weight` is not followed. The
//! mirror that it would leave shows what mirrors show that the last reflection meets.

use scene::{MirrorSettings, Settings};

use super::bounce::Bounce;
use super::fading::is_published;
use super::task::SurfaceImages;
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::Image;

/// The settings of mirrors by which rays are weighed; `None` if all are followed.
pub(crate) fn weighing(settings: &Settings) -> Option<&MirrorSettings> {
    let stops = settings.reflection.bounces > 1 && settings.reflection.least_weight > 0.0;
    stops.then_some(&settings.mirror)
}

/// Weighs the rays of `bounce`, which leave `surface`, if some are not to be followed. What the bounce `before` has found
/// is seen from the points `from`; without one the surface is the camera's.
///
/// # Errors
/// The shader is refused.
pub(super) fn weigh(
    recorder: &mut Recorder<'_>,
    supply: &Inputs,
    settings: &Settings,
    (surface, from): (SurfaceImages<'_>, &Image),
    before: Option<&Bounce>,
    bounce: &Bounce,
) -> Result<()> {
    let Some(weight) = &bounce.weight else { return Ok(()) };
    let of_before = |image: fn(&Bounce) -> &Option<Image>| before.and_then(|before| image(before).as_ref());
    let [arriving, reach, reflectance] = [
        of_before(|before| &before.weight),
        of_before(|before| &before.reach),
        of_before(|before| &before.reflectance),
    ];
    let bindings = passes::mirror_weight {
        albedo_in: surface.albedo.bind(),
        normal_in: surface.normal.bind(),
        position_in: surface.position.bind(),
        from_in: from.bind(),
        weight_in: arriving.unwrap_or(surface.normal).bind(),
        left_in: reach.unwrap_or(surface.normal).bind(),
        reflectance_in: reflectance.unwrap_or(surface.normal).bind(),
        weight_out: weight.bind(),
    };
    let switches = [
        ("from_camera", u32::from(before.is_none())),
        ("is_published", u32::from(is_published(settings))),
        ("fades", u32::from(reach.is_some())),
        ("has_reflectance", u32::from(reflectance.is_some())),
    ];
    recorder.over_mirrors(&switches, supply, bindings)
}
