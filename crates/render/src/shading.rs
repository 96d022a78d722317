//! Shades a frame: direct and indirect light on each surface, and the reflections in mirrors, blended in.

use scene::{LastMirror, Lighting, Mirror, ResolvedLight, Settings};

use crate::caustics::Thrown;
use crate::frame::Objects;
use crate::gi::{Brought, GlobalIllumination, Receiver};
use crate::gpu::Result;
use crate::inputs::Inputs;
use crate::lighting::Lights;
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::reflection::fading::{ShareLeft, is_published};
use crate::reflection::{Bounce, SurfaceImages};
use crate::store::PointStore;
use crate::targets::Image;

/// The name under which the shading of what mirrors show is timed, apart from that of what the camera sees.
const MIRROR_LIGHT: (&str, PassStage) = ("mirror_light", PassStage::Light);
/// The name under which all work of the rays of light is timed.
pub(crate) const LIGHT_RAYS: (&str, PassStage) = ("light_rays", PassStage::Light);

/// The choices that determine how surfaces are shaded, besides the parameters.
#[derive(Clone, Copy)]
pub(crate) struct Shading {
    pub(crate) light: ResolvedLight,
    /// The number of lights with shadow maps; for a sun, the number of its maps.
    light_count: u32,
    pub(crate) has_highlights: bool,
    /// Whether surfaces that are no mirrors show highlights, too.
    pub(crate) has_gloss: bool,
}

impl Shading {
    pub(crate) fn new(settings: &Settings, store: &PointStore, objects: Objects<'_>, light_count: usize) -> Self {
        let light = Lights::chosen(settings, objects);
        let is_lit = matches!(light.by, Lighting::Lights | Lighting::Sun);
        let shows_highlights = |mirror: &Mirror| mirror.specular_intensity > 0.0 && mirror.specular_power > 0.0;
        let is_glossy =
            settings.light.gloss > 0.0 || store.has_highlights() || objects.mirrors.iter().any(shows_highlights);
        let has_gloss = settings.light.gloss > 0.0 || store.has_gloss();
        Self { light, light_count: light_count as u32, has_highlights: is_lit && is_glossy, has_gloss }
    }
}

/// The light of a frame, and the camera's surface that it falls on.
pub(crate) struct FrameLight<'a> {
    pub settings: &'a Settings,
    pub lights: &'a Lights,
    /// The light that mirrors throw from them.
    pub thrown: Option<&'a Thrown>,
    pub gi: Option<&'a mut GlobalIllumination>,
    pub shading: Shading,
    pub camera: SurfaceImages<'a>,
    /// The number of reflections that are followed, whether or not they have been found yet.
    pub bounces: usize,
    /// What each mirror pixel of the camera receives by several rays, with the share that is left of them if
    /// reflections fade; `None` if it has one ray.
    pub received: Option<&'a Image>,
    /// Gets the direct light of the camera's surface.
    pub direct: &'a Image,
    /// Gets the colours with reflections.
    pub color: &'a Image,
    /// Added to the index of a surface beyond the camera's, which names it to the indirect light.
    pub first_receiver: usize,
    /// The indirect light that rays have brought to the camera's surface, if they bring it.
    pub brought: Option<Brought<'a>>,
    /// For the surfaces that rays of light meet: the most reflections whose virtual lights shine there.
    pub met_bounces: Option<u32>,
}

/// What the mirrors show that the camera sees.
#[derive(Clone, Copy)]
pub(crate) enum Reflected<'a> {
    Nothing,
    /// The light of what a ray of each mirror pixel found; one that found nothing shows the background.
    Found,
    /// What arrives at each mirror pixel.
    Received(&'a Image),
}

impl FrameLight<'_> {
    /// Shades a surface: the camera's for index 0, or what the bounce before `index` has found.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn shade(
        &mut self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        bounces: &[Bounce],
        index: usize,
    ) -> Result<()> {
        recorder.time_as(self.timed_as(index));
        // Seen from the camera, or from the mirror point before.
        let (surface, from, radiance) = match index.checked_sub(1).map(|before| &bounces[before]) {
            None => (self.camera, self.camera.position, self.direct),
            Some(before) => (before.surface(), &before.mirror.point, &before.radiance),
        };
        let (shading, receiver, is_mixed) = (self.shading, self.receiver(index), self.is_mixed(index));
        let reach = bounces.get(index).and_then(|bounce| bounce.reach.as_ref());
        let fading = ShareLeft::new(self.received.filter(|_| index == 0), reach);
        // A mirror that is dark where no ray is followed needs no look at its ray.
        let followed = followed(bounces, index).filter(|_| self.settings.mirror.last == LastMirror::Matt);
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("lighting", shading.light.by as u32),
            ("light_count", shading.light_count),
            ("is_mixed", u32::from(is_mixed)),
            ("stops", u32::from(followed.is_some())),
            ("has_highlights", u32::from(shading.has_highlights)),
            ("has_fill", u32::from(shading.light.fill > 0.0)),
            ("has_photons", u32::from(self.thrown.is_some())),
            ("is_published", u32::from(is_published(self.settings))),
            ("fades", u32::from(fading.image().is_some())),
            ("is_mean_left", u32::from(fading.is_mean())),
        ];
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        if let Some(thrown) = self.thrown {
            let bindings = passes::photon_light {
                position_in: surface.position.bind(),
                normal_in: surface.normal.bind(),
                from_in: from.bind(),
                photons: thrown.photons.as_entire_binding(),
                cells: thrown.cells.as_entire_binding(),
                irradiance_out: thrown.irradiance.bind(),
            };
            recorder.by_rows(&[("from_camera", u32::from(index == 0))], inputs, bindings, groups)?;
        }
        let bindings = passes::shade {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            lights: self.lights.lights.as_entire_binding(),
            shadows: self.lights.shadows.as_entire_binding(),
            radiance_out: radiance.bind(),
            left_in: fading.image().unwrap_or(surface.normal).bind(),
            rays_in: followed.unwrap_or(surface.normal).bind(),
            thrown_in: self.thrown.map_or(surface.normal, |thrown| &thrown.irradiance).bind(),
        };
        recorder.by_rows(&switches, inputs, bindings, groups)?;
        if let Some(gi) = &mut self.gi {
            let receiver = Receiver {
                index: receiver,
                surface,
                from,
                is_mixed,
                followed,
                is_glossy: shading.has_highlights,
                has_gloss: shading.has_gloss,
                fading,
                brought: self.brought.filter(|_| index == 0),
                most_bounces: self.met_bounces,
            };
            gi.shade(recorder, inputs, self.settings, &receiver)?;
        }
        recorder.time_as(None);
        Ok(())
    }

    /// The name under which the shading of a surface is timed, if it is not its own.
    fn timed_as(&self, index: usize) -> Option<(&'static str, PassStage)> {
        if self.met_bounces.is_some() { Some(LIGHT_RAYS) } else { (index > 0).then_some(MIRROR_LIGHT) }
    }

    /// Whether mirrors of a surface show their own colour by the share only that they do not reflect.
    pub fn is_mixed(&self, index: usize) -> bool {
        index < self.bounces || (index > 0 && self.settings.mirror.last == LastMirror::Dark)
    }

    fn receiver(&self, index: usize) -> usize {
        if index == 0 { 0 } else { index + self.first_receiver }
    }

    /// Records that the bounces have found other surfaces.
    pub fn surfaces_changed(&mut self) {
        if let Some(gi) = &mut self.gi {
            gi.surfaces_changed(1);
        }
    }

    /// Shades what each bounce has found, and blends it from the last bounce to the first: what the camera's mirrors
    /// show.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn shade_bounces(&mut self, recorder: &mut Recorder<'_>, inputs: &Inputs, bounces: &[Bounce]) -> Result<()> {
        for index in 1..=bounces.len() {
            self.shade(recorder, inputs, bounces, index)?;
        }
        for index in (1..=bounces.len()).rev() {
            let reflected = if index < bounces.len() { Reflected::Found } else { Reflected::Nothing };
            self.blend(recorder, inputs, bounces, index, reflected)?;
        }
        Ok(())
    }

    /// Adds what its mirrors show to a surface, with the index of `shade`.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn blend(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        bounces: &[Bounce],
        index: usize,
        reflected: Reflected<'_>,
    ) -> Result<()> {
        let (surface, from, radiance, target) = match index.checked_sub(1).map(|before| &bounces[before]) {
            None => (self.camera, self.camera.position, self.direct, self.color),
            Some(before) => (before.surface(), &before.mirror.point, &before.radiance, &before.blended),
        };
        let indirect = self.gi.as_ref().and_then(|gi| gi.radiance(self.receiver(index)));
        let seen = bounces.get(index).map_or(surface.position, |bounce| &bounce.seen.position);
        let shown = match reflected {
            Reflected::Nothing => None,
            Reflected::Found => bounces.get(index).map(|bounce| &bounce.blended),
            Reflected::Received(image) => Some(image),
        };
        let is_received = matches!(reflected, Reflected::Received(_));
        let followed = followed(bounces, index);
        // What is received has faded already, and is what is reflected.
        let bounce = bounces.get(index).filter(|_| !is_received && shown.is_some());
        let reach = bounce.and_then(|bounce| bounce.reach.as_ref());
        let reflectance = bounce.and_then(|bounce| bounce.reflectance.as_ref());
        let bindings = passes::blend {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            radiance_in: radiance.bind(),
            seen_in: seen.bind(),
            reflected_in: shown.unwrap_or(radiance).bind(),
            indirect_in: indirect.unwrap_or(radiance).bind(),
            color_out: target.bind(),
            left_in: reach.unwrap_or(radiance).bind(),
            reflectance_in: reflectance.unwrap_or(radiance).bind(),
            rays_in: followed.unwrap_or(radiance).bind(),
        };
        let switches = [
            ("from_camera", u32::from(index == 0)),
            ("has_reflection", u32::from(shown.is_some())),
            ("stops", u32::from(followed.is_some())),
            ("has_indirect", u32::from(indirect.is_some())),
            ("is_received", u32::from(is_received)),
            ("is_published", u32::from(is_published(self.settings))),
            ("fades", u32::from(reach.is_some())),
            ("has_reflectance", u32::from(reflectance.is_some())),
        ];
        let groups = if index == 0 { inputs.pixel_groups() } else { inputs.mirror_groups() };
        recorder.time_as((index > 0).then_some(MIRROR_LIGHT));
        recorder.over(&switches, inputs, bindings, groups)?;
        recorder.time_as(None);
        Ok(())
    }
}

/// The rays of a bounce, whose w is 0 where none is followed from a mirror of the surface with its index; `None` if all
/// are, as those of the camera's mirrors.
fn followed(bounces: &[Bounce], index: usize) -> Option<&Image> {
    let bounce = bounces.get(index).filter(|_| index > 0)?;
    bounce.weight.as_ref().map(|_| &bounce.mirror.point)
}
