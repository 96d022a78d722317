//! Glossy mirrors: a mirror with a specular power shows the mean of what many rays meet, drawn by its lobe. A sample is
//! another mirror normal for each pixel, so that every method that traces a mirror pixel's ray finds it as it finds
//! that of a perfect mirror. Samples are found, shaded and summed one after the other (docs/methods/gloss.md).

use scene::{GlossLobe, GlossPattern, LightView, Method, Mirror, Settings, Show};

use super::bounce::Bounce;
use super::fading::fades;
use super::light_field;
use super::task::MirrorSurface;
use crate::gpu::{Error, Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{GLOSS_DISTANCE_BYTES, GLOSS_PIXEL_BYTES, GLOSS_SHARE_BYTES, GLOSS_SUM_BYTES};
use crate::method;
use crate::passes;
use crate::recorder::Recorder;
use crate::store::PointStore;
use crate::targets::{Image, storage};

/// One set of rays from the mirror pixels that the camera sees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RaySet {
    /// The number of the sample, that of all samples, which count alike, and that of the look, where several looks of a
    /// sample are blended; `None` where one set of rays is all.
    pub sample: Option<[u32; 3]>,
    /// Whether glossy mirrors draw their directions.
    pub is_glossy: bool,
    /// Whether rays leave from another place than the centres of pixels.
    pub is_moved: bool,
    /// The number of the set among those whose hits are kept, if its hits are.
    pub kept_as: Option<u32>,
}

impl RaySet {
    /// The rays from the centres of pixels, of perfect mirrors, that no picture sums.
    pub const PERFECT: Self = Self { sample: None, is_glossy: false, is_moved: false, kept_as: None };

    /// Whether statistics and images describe these rays.
    pub fn is_perfect(&self) -> bool {
        !self.is_glossy && !self.is_moved && self.sample.is_none_or(|[_, _, look]| look == 0)
    }
}

/// The sets of rays whose mean a frame's mirrors show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RaySets {
    /// The number of samples of glossy mirrors; 0 if mirrors are perfect.
    pub glossy: u32,
    /// The number of places within each pixel.
    pub places: u32,
    /// The number of looks of each ray that are blended by their weights (`light_field`); 1 if none are.
    pub looks: u32,
}

impl RaySets {
    /// Returns the sets of a frame: one of perfect rays where something else than the picture is shown, which describes
    /// that.
    ///
    /// # Errors
    /// The method knows only perfect mirrors.
    pub fn new(settings: &Settings, methods: &[Method], store: &PointStore, mirrors: &[Mirror]) -> Result<Self> {
        let is_picture = settings.reflection.show == Show::Picture && settings.light.show == LightView::Picture;
        let is_moved = is_picture && !methods.contains(&Method::MirroredViewpoint);
        let places = if is_moved { settings.reflection.samples.max(1) } else { 1 };
        let looks = if is_picture { light_field::looks(settings) } else { 1 };
        Ok(Self { glossy: samples(settings, methods, store, mirrors, is_picture)?, places, looks })
    }

    /// The number of sets that are summed; 0 where one set of perfect rays is all.
    pub fn summed(self) -> u32 {
        let most = self.glossy.max(self.places) * self.looks;
        if self.glossy == 0 && most == 1 { 0 } else { most }
    }

    /// The rays of a set, whose hits are not kept: all looks of the first sample, then those of the next. The last
    /// sample of an odd number leaves from the centres of pixels.
    pub fn rays(self, set: u32) -> RaySet {
        let (sample, look) = (set / self.looks, set % self.looks);
        let all = self.glossy.max(self.places);
        RaySet {
            sample: Some([sample, all, look]),
            is_glossy: self.glossy > 0,
            is_moved: self.places > 1 && (sample + 1 != all || all.is_multiple_of(2)),
            kept_as: None,
        }
    }
}

/// The images and the sums of glossy mirrors.
pub(crate) struct Gloss {
    /// The drawn normals of the bounce that is being found; w: specular power.
    pub normal: Image,
    /// The mirror pixels of the bounce whose rays are to be traced, if some are known; the origins are the bounce's
    /// own.
    rays: Image,
    /// What the passes note for each pixel of the tiles where mirrors may be.
    pub pixels: wgpu::Buffer,
    /// For each pixel the sum of what its rays receive, and that of their weights.
    sums: wgpu::Buffer,
    /// For each pixel the sum of the distances at which its rays met something, and that of their weights; of one pixel
    /// until a frame is blurred.
    distances: wgpu::Buffer,
    /// For each pixel the sum of the shares of its reflections that are left; of one pixel until a frame's reflections
    /// fade.
    shares_left: wgpu::Buffer,
    /// The mean so far of what each mirror pixel receives; a: the share of its reflections that is left.
    pub received: Image,
    /// The sums blurred along rows, and along rows and columns, from the first frame on that is blurred.
    blurred: Option<[Image; 2]>,
}

/// Returns the number of glossy samples of a frame; 0 if mirrors are perfect.
///
/// # Errors
/// The method knows only perfect mirrors.
fn samples(
    settings: &Settings,
    methods: &[Method],
    store: &PointStore,
    mirrors: &[Mirror],
    is_picture: bool,
) -> Result<u32> {
    let is_glossy = |mirror: &Mirror| mirror.specular_intensity > 0.0 && mirror.specular_power > 0.0;
    let has_gloss = || mirrors.iter().any(is_glossy) || store.has_glossy_mirrors();
    if settings.gloss.samples == 0 || !is_picture || !has_gloss() {
        return Ok(0);
    }
    if let Some(method) = methods.iter().find(|method| is_refused_by(**method)) {
        return Err(Error::PerfectMirrorsOnly { method: method.row().name });
    }
    Ok(settings.gloss.samples)
}

/// Whether a method shows one direction for each mirror point, so that it cannot show glossy mirrors.
pub(crate) fn is_refused_by(method: Method) -> bool {
    method == Method::MirroredViewpoint
}

/// Whether all pixels draw the same directions.
fn is_shared(settings: &Settings) -> bool {
    method::is_forward(settings) || settings.gloss.pattern == GlossPattern::Shared
}

/// Whether glossy mirrors reflect less than what their rays receive.
pub(crate) fn has_reflectance(settings: &Settings) -> bool {
    settings.gloss.samples > 0 && settings.gloss.lobe == GlossLobe::AshikhminShirley
}

/// Whether glossy mirrors may draw from another lobe than their own. That of Ashikhmin and Shirley draws from its own.
pub(crate) fn is_weighed(settings: &Settings) -> bool {
    settings.gloss.cache_power > 0.0 && settings.gloss.lobe != GlossLobe::AshikhminShirley
}

/// Whether what glossy mirrors receive is blurred.
fn is_blurred(settings: &Settings) -> bool {
    settings.gloss.blur > 0.0
}

impl Gloss {
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let [width, height] = size.map(u64::from);
        let tiles = width.div_ceil(8) * height.div_ceil(8);
        Self {
            normal: Image::new(&gpu.device, size, "drawn normals", wgpu::TextureFormat::Rgba32Float),
            rays: Image::new(&gpu.device, size, "unknown rays", wgpu::TextureFormat::Rgba32Float),
            pixels: storage(&gpu.device, "glossy pixels", tiles * 64 * GLOSS_PIXEL_BYTES),
            sums: storage(&gpu.device, "sums of glossy samples", width * height * GLOSS_SUM_BYTES),
            distances: storage(&gpu.device, "distances of glossy samples", GLOSS_DISTANCE_BYTES),
            shares_left: storage(&gpu.device, "shares left of samples", GLOSS_SHARE_BYTES),
            received: Image::new(&gpu.device, size, "received", wgpu::TextureFormat::Rgba16Float),
            blurred: None,
        }
    }

    /// Makes what the blur and the fading of these settings need.
    pub fn provide(&mut self, gpu: &Gpu, settings: &Settings) {
        let [width, height] = self.received.size().map(u64::from);
        let bytes = width * height * GLOSS_SHARE_BYTES;
        if fades(settings) && self.shares_left.size() < bytes {
            self.shares_left = storage(&gpu.device, "shares left of samples", bytes);
        }
        if is_blurred(settings) && self.blurred.is_none() {
            let size = self.received.size();
            let bytes = width * height * GLOSS_DISTANCE_BYTES;
            self.distances = storage(&gpu.device, "distances of glossy samples", bytes);
            let image = || Image::new(&gpu.device, size, "blurred", wgpu::TextureFormat::Rgba16Float);
            self.blurred = Some([image(), image()]);
        }
    }

    pub fn bytes(&self) -> u64 {
        let images = self.normal.bytes() + self.rays.bytes() + self.received.bytes();
        let blurred: u64 = self.blurred.iter().flatten().map(Image::bytes).sum();
        let sums = self.sums.size() + self.distances.size() + self.shares_left.size();
        images + blurred + self.pixels.size() + sums
    }

    /// Finds out which pixels draw from the lobe of `gloss.cache_power`, before the first sample.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn judge_weights(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        (mirror, normal): (&MirrorSurface, &Image),
    ) -> Result<()> {
        let bindings = passes::gloss_trust {
            point_in: mirror.point.bind(),
            normal_in: normal.bind(),
            eye_in: mirror.eye.bind(),
            pixels: self.pixels.as_entire_binding(),
        };
        recorder.over_mirrors(&[("is_shared", u32::from(is_shared(settings)))], inputs, bindings)
    }

    /// Draws the normals of a bounce's mirror pixels for the sample of `inputs`, and finds out which of the rays `kept`
    /// knows.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn draw_normals(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        bounce: usize,
        (mirror, normal): (&MirrorSurface, &Image),
        kept: Option<&wgpu::Buffer>,
    ) -> Result<()> {
        let bindings = passes::gloss_normals {
            point_in: mirror.point.bind(),
            normal_in: normal.bind(),
            eye_in: mirror.eye.bind(),
            kept: kept.unwrap_or(&self.sums).as_entire_binding(),
            pixels: self.pixels.as_entire_binding(),
            normal_out: self.normal.bind(),
            rays_out: self.rays.bind(),
        };
        let switches = [
            ("bounce", bounce as u32),
            ("is_shared", u32::from(is_shared(settings))),
            ("is_kept", u32::from(kept.is_some())),
            ("is_weighed", u32::from(bounce == 0 && is_weighed(settings))),
            ("has_half_lobe", u32::from(settings.gloss.lobe == GlossLobe::AshikhminShirley)),
        ];
        recorder.over_mirrors(&switches, inputs, bindings)
    }

    /// The rays of a bounce that are to be traced, as `draw_normals` found them.
    pub fn unknown(&self, mirror: &MirrorSurface) -> MirrorSurface {
        MirrorSurface { point: self.rays.clone(), eye: mirror.eye.clone() }
    }

    /// Adds what the sample of `inputs` receives, by the weights of its rays if glossy ones have some, and by those of its
    /// look in `looks` if several are blended; the first set starts the sums anew.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn add(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        first: &Bounce,
        is_glossy: bool,
        looks: Option<&Image>,
    ) -> Result<()> {
        let bindings = passes::gloss_sum {
            point_in: first.mirror.point.bind(),
            seen_in: first.seen.position.bind(),
            reflected_in: first.blended.bind(),
            pixels: self.pixels.as_entire_binding(),
            sums: self.sums.as_entire_binding(),
            distances: self.distances.as_entire_binding(),
            received_out: self.received.bind(),
            // Without looks nothing reads them.
            looks_in: looks.unwrap_or(&first.blended).bind(),
            left_in: first.reach.as_ref().unwrap_or(&first.blended).bind(),
            shares_left: self.shares_left.as_entire_binding(),
            reflectance_in: first.reflectance.as_ref().unwrap_or(&first.blended).bind(),
        };
        let is_weighed = is_glossy && is_weighed(settings);
        let switches = [
            ("is_weighed", u32::from(is_weighed)),
            ("is_blurred", u32::from(is_glossy && is_blurred(settings))),
            ("has_looks", u32::from(looks.is_some())),
            ("fades", u32::from(first.reach.is_some())),
            ("has_reflectance", u32::from(first.reflectance.is_some())),
        ];
        recorder.over_mirrors(&switches, inputs, bindings)
    }

    /// What glossy mirrors of these normals show by the samples summed so far, blurred if the settings ask for it.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn blurred(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        (mirror, normal): (&MirrorSurface, &Image),
    ) -> Result<&Image> {
        let Some([by_rows, blurred]) = self.blurred.as_ref().filter(|_| is_blurred(settings)) else {
            return Ok(&self.received);
        };
        for (from, to, is_upright) in [(&self.received, by_rows, 0), (by_rows, blurred, 1)] {
            let bindings = passes::gloss_blur {
                point_in: mirror.point.bind(),
                normal_in: normal.bind(),
                eye_in: mirror.eye.bind(),
                distances: self.distances.as_entire_binding(),
                received_in: from.bind(),
                received_out: to.bind(),
            };
            recorder.over_mirrors(&[("is_upright", is_upright)], inputs, bindings)?;
        }
        Ok(blurred)
    }
}
