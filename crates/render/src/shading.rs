//! Shades a frame: direct and indirect light on each surface, and the reflections in mirrors, blended in.

use scene::{Lighting, Mirror, Settings};

use crate::frame::Objects;
use crate::gi::{GlobalIllumination, Receiver};
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::lighting::Lights;
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::reflection::{Reflections, SurfaceImages};
use crate::store::PointStore;
use crate::targets::{Image, Targets};

/// The name under which the shading of what mirrors show is timed, apart from that of what the camera sees.
const MIRROR_LIGHT: (&str, PassStage) = ("mirror_light", PassStage::Light);

/// The choices that determine how surfaces are shaded, besides the parameters.
#[derive(Clone, Copy)]
pub(crate) struct Shading {
    /// The lighting, with `auto` resolved.
    pub(crate) lighting: Lighting,
    /// The number of lights with shadow maps; for a sun, the number of its maps.
    light_count: u32,
    pub(crate) has_highlights: bool,
    /// Whether surfaces that are no mirrors show highlights, too.
    pub(crate) has_gloss: bool,
}

impl Shading {
    pub(crate) fn new(settings: &Settings, store: &PointStore, objects: Objects<'_>, light_count: usize) -> Self {
        let lighting = Lights::chosen(settings, objects);
        let is_lit = matches!(lighting, Lighting::Lights | Lighting::Sun);
        let shows_highlights = |mirror: &Mirror| mirror.specular_intensity > 0.0 && mirror.specular_power > 0.0;
        let is_glossy =
            settings.light.gloss > 0.0 || store.has_highlights() || objects.mirrors.iter().any(shows_highlights);
        let has_gloss = settings.light.gloss > 0.0 || store.has_gloss();
        Self { lighting, light_count: light_count as u32, has_highlights: is_lit && is_glossy, has_gloss }
    }
}

/// Shades the surfaces that the camera and each bounce see, and blends them from the last bounce to the camera.
pub(crate) fn shade(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    settings: &Settings,
    targets: &Targets,
    reflections: &Reflections,
    lights: &Lights,
    mut gi: Option<&mut GlobalIllumination>,
    shading: Shading,
) -> Result<()> {
    let camera = SurfaceImages {
        albedo: &targets.surface().albedo,
        normal: &targets.surface().normal,
        position: &targets.position,
    };
    let bounces = &reflections.bounces[..reflections.count];
    let surfaces: Vec<SurfaceImages<'_>> =
        std::iter::once(camera).chain(bounces.iter().map(|bounce| bounce.surface())).collect();
    let radiance: Vec<&Image> =
        std::iter::once(&targets.direct).chain(bounces.iter().map(|bounce| &bounce.radiance)).collect();
    for (index, (surface, radiance)) in surfaces.iter().zip(&radiance).enumerate() {
        recorder.time_as((index > 0).then_some(MIRROR_LIGHT));
        // Seen from the camera, or from the mirror point before.
        let from = if index == 0 { &targets.position } else { &bounces[index - 1].mirror.point };
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("lighting", shading.lighting as u32),
            ("light_count", shading.light_count),
            ("is_mixed", u32::from(index < bounces.len())),
            ("has_highlights", u32::from(shading.has_highlights)),
        ];
        let bindings = passes::shade {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            lights: lights.lights.as_entire_binding(),
            shadows: lights.shadows.as_entire_binding(),
            radiance_out: radiance.bind(),
        };
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        recorder.over(&switches, inputs, bindings, groups)?;
        if let Some(gi) = &mut gi {
            let receiver = Receiver {
                index,
                surface: *surface,
                from,
                is_mixed: index < bounces.len(),
                is_glossy: shading.has_highlights,
                has_gloss: shading.has_gloss,
            };
            gi.shade(recorder, inputs, settings, &receiver)?;
        }
    }
    // From the last bounce on, each reflection is added to the surface that reflects it.
    let mut reflected: Option<&Image> = None;
    for index in (0..surfaces.len()).rev() {
        let surface = surfaces[index];
        let from = if index == 0 { &targets.position } else { &bounces[index - 1].mirror.point };
        let target = match index {
            0 => &targets.color,
            _ => &bounces[index - 1].blended,
        };
        let indirect = gi.as_ref().and_then(|gi| gi.radiance(index));
        let seen = bounces.get(index).map_or(surface.position, |bounce| &bounce.seen.position);
        let bindings = passes::blend {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            radiance_in: radiance[index].bind(),
            seen_in: seen.bind(),
            reflected_in: reflected.unwrap_or(radiance[index]).bind(),
            indirect_in: indirect.unwrap_or(radiance[index]).bind(),
            color_out: target.bind(),
        };
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("has_reflection", u32::from(reflected.is_some())),
            ("has_indirect", u32::from(indirect.is_some())),
        ];
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        recorder.time_as((index > 0).then_some(MIRROR_LIGHT));
        recorder.over(&switches, inputs, bindings, groups)?;
        reflected = Some(target);
    }
    recorder.time_as(None);
    Ok(())
}
