//! The steps of a bounce that no method, no gloss and no clear surface owns: its perfect rays, how much of their light
//! is reflected, and how doubtful it is what they meet.

use super::bounce::{Bounce, Search};
use super::fading::is_published;
use super::footprint::Footprint;
use super::task::{MirrorSurface, SurfaceImages};
use crate::gpu::Result;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::Image;

/// A bounce that is being found.
pub(super) struct Step<'a> {
    search: &'a Search<'a>,
    index: usize,
    /// The surface that the rays leave.
    pub surface: SurfaceImages<'a>,
    /// The origin of the rays to that surface: the camera, or the mirror points of the bounce before.
    pub from: &'a Image,
    pub bounce: &'a Bounce,
}

impl<'a> Step<'a> {
    /// `before` is the bounce before, if there is one.
    pub fn new(search: &'a Search<'a>, index: usize, before: Option<&'a Bounce>, bounce: &'a Bounce) -> Self {
        let surface = before.map_or(search.camera, Bounce::surface);
        let from = before.map_or(search.camera.position, |before| &before.mirror.point);
        Self { search, index, surface, from, bounce }
    }

    /// Makes the mirror points of the surface, moved within their pixels if there is a footprint. Returns them with
    /// their normals.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn reflect(
        &self,
        recorder: &mut Recorder<'_>,
        footprint: Option<&'a Footprint>,
    ) -> Result<(&'a MirrorSurface, &'a Image)> {
        let Self { search, surface, bounce, .. } = self;
        let bindings = passes::mirror_surface {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: self.from.bind(),
            point_out: footprint.map_or(&bounce.mirror.point, |footprint| &footprint.centers).bind(),
            eye_out: bounce.mirror.eye.bind(),
            weight_in: bounce.weight.as_ref().unwrap_or(surface.normal).bind(),
        };
        let switches = [("from_camera", u32::from(self.index == 0)), ("stops", u32::from(bounce.weight.is_some()))];
        recorder.over_pixels(&switches, &search.supply, bindings)?;
        let Some(footprint) = footprint else { return Ok((&bounce.mirror, surface.normal)) };
        let formulas = search.formulas.as_ref();
        footprint.move_points(recorder, &search.supply, surface.normal, formulas, &bounce.mirror)?;
        Ok((&bounce.mirror, &footprint.normal))
    }

    /// Weighs rays by how much of their light is reflected, where a lobe says so; the normals are those of the surface
    /// and those that are drawn.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn weigh(
        &self,
        recorder: &mut Recorder<'_>,
        mirror: &MirrorSurface,
        [normal, drawn]: [&Image; 2],
    ) -> Result<()> {
        let Some(reflectance) = &self.bounce.reflectance else { return Ok(()) };
        let bindings = passes::gloss_reflectance {
            point_in: mirror.point.bind(),
            normal_in: normal.bind(),
            eye_in: mirror.eye.bind(),
            drawn_in: drawn.bind(),
            reflectance_out: reflectance.bind(),
        };
        let switches = [("is_published", u32::from(is_published(self.search.settings)))];
        recorder.over_mirrors(&switches, &self.search.supply, bindings)
    }

    /// Judges which pixels of these mirrors are doubtful; `hits` are those of rays of which a method leaves some, or a
    /// buffer that stands for them. If `is_further`, the other pixels keep what they have.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn doubt(
        &self,
        recorder: &mut Recorder<'_>,
        (mirror, normal): (&MirrorSurface, &Image),
        doubt: &Image,
        counters: &wgpu::Buffer,
        (hits, no_hits): (Option<&wgpu::Buffer>, &wgpu::Buffer),
        is_further: bool,
    ) -> Result<()> {
        let Bounce { seen, .. } = self.bounce;
        let bindings = passes::mirror_doubt {
            point_in: mirror.point.bind(),
            normal_in: normal.bind(),
            eye_in: mirror.eye.bind(),
            seen_in: seen.position.bind(),
            seen_normal_in: seen.normal.bind(),
            doubt_out: doubt.bind(),
            counters: counters.as_entire_binding(),
            hits: hits.unwrap_or(no_hits).as_entire_binding(),
        };
        let switches = [("knows_rest", u32::from(hits.is_some())), ("is_further", u32::from(is_further))];
        let switches = &switches[..1 + usize::from(is_further)];
        recorder.over_mirrors(switches, &self.search.supply, bindings)
    }
}
