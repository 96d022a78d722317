//! Reflections that fade by distance (`mirror.fade_distance`): how far each mirror pixel's ray goes, in radii of its
//! mirror. shaders/shared/brdf.wgsl has the law. The truth finds mirrors and their radii by the same rule.

use glam::Vec4;
use scene::{FresnelLaw, Settings};

use super::bounce::{Bounce, Search};
use super::mirror_places::{MirrorMap, MirrorPlace, mirror_boxes, upload};
use super::task::MirrorSurface;
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::Image;

/// Whether reflections fade.
pub(crate) fn fades(settings: &Settings) -> bool {
    settings.mirror.fade_distance > 0.0
}

/// Whether the share that mirrors reflect follows the published law of the angle.
pub(crate) fn is_published(settings: &Settings) -> bool {
    settings.mirror.fresnel_law == FresnelLaw::Published
}

/// How the share of the reflections that is left is stored for the mirrors of a surface.
#[derive(Clone, Copy)]
pub(crate) enum ShareLeft<'a> {
    /// Reflections do not fade.
    All,
    /// By how far the ray of each pixel goes, in radii of its mirror.
    ByReach(&'a Image),
    /// As the mean of several rays, in the alpha of the image.
    Mean(&'a Image),
}

impl<'a> ShareLeft<'a> {
    /// Takes the share from the mean of several rays if there is one, else from how far the rays of a bounce go. Without
    /// the latter reflections do not fade.
    pub fn new(mean: Option<&'a Image>, reach: Option<&'a Image>) -> Self {
        match (mean, reach) {
            (_, None) => Self::All,
            (Some(mean), _) => Self::Mean(mean),
            (None, Some(reach)) => Self::ByReach(reach),
        }
    }

    /// The share that another image holds.
    pub fn in_image(self, image: &Image) -> ShareLeft<'_> {
        match self {
            Self::All => ShareLeft::All,
            Self::ByReach(_) => ShareLeft::ByReach(image),
            Self::Mean(_) => ShareLeft::Mean(image),
        }
    }

    pub fn image(self) -> Option<&'a Image> {
        match self {
            Self::All => None,
            Self::ByReach(image) | Self::Mean(image) => Some(image),
        }
    }

    pub fn is_mean(self) -> bool {
        matches!(self, Self::Mean(_))
    }
}

/// The mirrors of a scene with their radii.
pub(crate) struct Fading {
    mirrors: wgpu::Buffer,
}

impl Fading {
    /// `None` if reflections do not fade.
    pub fn new(gpu: &Gpu, search: &Search<'_>) -> Option<Self> {
        let Search { supply, settings, store, mirrors, .. } = search;
        let boxes = fades(settings).then(|| mirror_boxes(store, settings, mirrors))?;
        let place = |bounds| MirrorPlace { cloud: None, own: None, bounds, samples: Vec::new() };
        let places: Vec<MirrorPlace> = boxes.into_iter().map(place).collect();
        let of_mirror =
            |index: usize| Some(MirrorMap { map: 0, view: Vec4::splat(places[index].bounds.radius() as f32) });
        Some(Self { mirrors: upload(gpu, &places, store.bounds(), supply.camera.eye, of_mirror) })
    }

    /// Reports how far the rays of a bounce's mirror pixels go, which it has found. `index` has the index of refraction
    /// of the mirrors' surfaces, if some are clear.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn measure(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        mirror: &MirrorSurface,
        index: Option<&Image>,
        bounce: &Bounce,
    ) -> Result<()> {
        let Some(reach) = &bounce.reach else { return Ok(()) };
        let bindings = passes::mirror_reach {
            point_in: mirror.point.bind(),
            seen_in: bounce.seen.position.bind(),
            index_in: index.unwrap_or(&mirror.point).bind(),
            mirrors: self.mirrors.as_entire_binding(),
            reach_out: reach.bind(),
        };
        recorder.over_mirrors(&[("has_clear", u32::from(index.is_some()))], inputs, bindings)
    }
}
