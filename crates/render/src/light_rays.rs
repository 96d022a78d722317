//! Indirect light by rays (docs/methods/gi.md): each pixel of the camera's surface sends rays by the cosine through the
//! tree of discs, as `surfel_trace` does for mirrors. What a ray meets is lit by the scene's lights; where the path
//! ends, the virtual lights add all further reflections. Mirrors reflect the rays that meet them. Rays that leave the
//! scene find the sky. The sums grow from frame to frame while camera, points and light stand still, and are the same
//! however many rays a frame adds. While something moves, each frame takes over the sums of the frame before, place by
//! place, and goes on with them.

use std::ops::Range;

use scene::{Gi, Settings};

use crate::frame::FrameCamera;
use crate::gi::{Brought, LightReuse, camera_before, tile_of};
use crate::gpu::{Error, Gpu, Result};
use crate::layout::{KEPT_MEAN_BYTES, KEPT_PLACE_BYTES, LIGHT_PATH_BYTES};
use crate::loads::ray_tiles;
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::fading::is_published;
use crate::reflection::gather::Gather;
use crate::reflection::surfel_index::SurfelIndex;
use crate::reflection::surfel_trace;
use crate::reflection::{Bounce, Search, Task};
use crate::renderer::SummedLight;
use crate::shading::{FrameLight, LIGHT_RAYS};
use crate::targets::{Image, storage};

/// The rays of the camera's pixels, and the light that they bring.
pub(crate) struct LightRays {
    gather: Gather,
    /// The last two rays of a path and what they meet, which each further ray of the path takes in turn.
    bounces: [Bounce; 2],
    /// Never written, so all zeros: rays that no normal reflects go straight on from their eyes.
    straight: Image,
    paths: wgpu::Buffer,
    diffuse: Image,
    /// Of one pixel until a surface has highlights.
    glossy: Image,
    /// The number of rays of most pixels in the sums.
    summed: u32,
    /// Whether the sums are those of the frame before and what was added to them.
    has_taken: bool,
    state: u64,
    /// The sums of the last frame that was finished, and of the frame being drawn.
    kept: Option<KeptRays>,
    next: Option<KeptRays>,
    spare: Option<[wgpu::Buffer; 2]>,
}

/// The sums of a frame, for the next one while something moves.
struct KeptRays {
    /// The places where the rays began and their numbers, and their light: see shaders/light_ray_keep.wgsl.
    buffers: [wgpu::Buffer; 2],
    camera: FrameCamera,
    /// What the light depends on, and the revision of the points.
    source: SummedLight,
    revision: u64,
    /// The number of rays of most pixels.
    summed: u32,
}

/// Where points have changed, so many rays of the frame before count at most: those that are added replace them soon.
const OF_OTHER_POINTS: u32 = 4;

/// The rays that a frame adds to the sums.
pub(crate) struct RayShare<'a> {
    /// The numbers of the rays of each pixel that the frame adds.
    pub numbers: Range<u32>,
    /// The number of rays of each pixel when none is left to add.
    pub total: u32,
    pub has_sky: bool,
    /// For each ray that is drawn by the cosine, the most reflections in mirrors that follow one another.
    pub mirrors: usize,
    /// The counters of reflections, which rays of light leave alone.
    pub counters: &'a wgpu::Buffer,
    /// What the frame does with the sums of the frame before, and what its light depends on.
    pub reuse: LightReuse,
    pub source: SummedLight,
    /// The revision of the points.
    pub revision: u64,
}

impl LightRays {
    /// # Errors
    /// The picture is too large for the adapter.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self> {
        let bytes = size.iter().map(|edge| u64::from(*edge)).product::<u64>() * LIGHT_PATH_BYTES;
        let limit = gpu.device.limits().max_storage_buffer_binding_size;
        if bytes > limit {
            return Err(Error::TooLarge {
                what: "the paths of rays of light",
                bytes,
                limit,
                adapter: gpu.info.name.clone(),
                advice: "; ask for a smaller picture, or for gi.by = lights",
            });
        }
        let image = |label, size, format| Image::new(&gpu.device, size, label, format);
        Ok(Self {
            gather: Gather::new(&gpu.device, size),
            bounces: std::array::from_fn(|_| Bounce::new(&gpu.device, size)),
            straight: image("no normals", size, wgpu::TextureFormat::Rgba32Float),
            paths: storage(&gpu.device, "paths of light", bytes),
            diffuse: image("irradiance by rays", size, wgpu::TextureFormat::Rgba16Float),
            glossy: image("highlights by rays", [1, 1], wgpu::TextureFormat::Rgba16Float),
            summed: 0,
            has_taken: false,
            state: 0,
            kept: None,
            next: None,
            spare: None,
        })
    }

    pub fn size(&self) -> [u32; 2] {
        self.diffuse.size()
    }

    /// The number of rays that paths have by these settings, without those that mirrors reflect.
    pub fn bounces_of(gi: &Gi) -> u32 {
        gi.ray_bounces.min(gi.bounces).max(1)
    }

    /// The edge in pixels of the window that is averaged at least with so many rays a pixel, and whose pixels share a
    /// sequence of rays: whole tiles of the virtual lights where paths end.
    fn window(gi: &Gi, rays: u32) -> u32 {
        if tile_of(gi) > 1 { ray_tiles(rays) * gi.interleave } else { 1 }
    }

    /// Adds rays of each pixel of `light.camera` to the sums; those with the number 0 start them anew.
    ///
    /// # Errors
    /// A shader is refused, the frame is given up, or there is no memory.
    pub fn add(
        &mut self,
        recorder: &mut Recorder<'_>,
        search: &mut Search<'_>,
        light: &mut FrameLight<'_>,
        index: &mut SurfelIndex,
        share: &RayShare<'_>,
    ) -> Result<()> {
        let gpu = recorder.gpu;
        let size = self.size();
        let is_glossy = light.shading.has_highlights && light.shading.has_gloss;
        if is_glossy && self.glossy.size() != size {
            self.glossy = Image::new(&gpu.device, size, "highlights by rays", wgpu::TextureFormat::Rgba16Float);
        }
        let count = Self::bounces_of(&search.settings.gi) as usize * (1 + share.mirrors);
        let is_first = share.numbers.start == 0;
        if is_first {
            self.has_taken = self.take(recorder, search, share)?;
        }
        let mut reuses = is_first && self.has_taken;
        for number in share.numbers.clone() {
            recorder.go_on()?;
            search.supply.set_sample(gpu, Some([number, share.total, 0]));
            for bounce in 0..count {
                let place = (bounce, bounce + 1 == count);
                self.follow(recorder, search, light, index, (share, is_glossy, reuses), place)?;
            }
            reuses = false;
            self.state += 1;
        }
        let added = share.numbers.len() as u32;
        self.summed = match self.has_taken && !is_glossy {
            true => share.total.min(self.summed + added),
            // Highlights are not taken over.
            false => share.numbers.end,
        };
        self.keep(recorder, search, share)?;
        recorder.time_as(None);
        Ok(())
    }

    /// Takes over the sums of the frame before if its light is the same. Returns whether it is.
    fn take(&mut self, recorder: &mut Recorder<'_>, search: &Search<'_>, share: &RayShare<'_>) -> Result<bool> {
        let Search { supply, camera, .. } = search;
        let is_same = |kept: &&KeptRays| share.reuse == LightReuse::Reuse && kept.source == share.source;
        let Some(kept) = self.kept.as_ref().filter(is_same) else { return Ok(false) };
        let most = if kept.revision == share.revision { share.total } else { OF_OTHER_POINTS };
        recorder.time_as(Some(LIGHT_RAYS));
        let before = camera_before(recorder.gpu, &kept.camera, &supply.camera, most as f32);
        let [places, light] = &kept.buffers;
        let bindings = passes::light_ray_reuse {
            albedo_in: camera.albedo.bind(),
            normal_in: camera.normal.bind(),
            position_in: camera.position.bind(),
            before: before.as_entire_binding(),
            kept: places.as_entire_binding(),
            kept_light: light.as_entire_binding(),
            paths: self.paths.as_entire_binding(),
        };
        recorder.over_pixels(&[], supply, bindings)?;
        self.summed = kept.summed.min(most);
        Ok(true)
    }

    /// Keeps the sums for the frames that follow, unless these are the first rays of a picture at rest, and more are kept.
    fn keep(&mut self, recorder: &mut Recorder<'_>, search: &Search<'_>, share: &RayShare<'_>) -> Result<()> {
        self.next = None;
        if share.reuse == LightReuse::Never {
            (self.kept, self.spare) = (None, None);
            return Ok(());
        }
        let has_more = self.kept.as_ref().is_some_and(|kept| kept.source == share.source && kept.summed > self.summed);
        if share.reuse == LightReuse::Keep && has_more {
            return Ok(());
        }
        let pixels = self.size().iter().map(|edge| u64::from(*edge)).product::<u64>();
        let buffer = |label, bytes| storage(&recorder.gpu.device, label, bytes);
        let spare = self.spare.take().filter(|[places, _]| places.size() == pixels * KEPT_PLACE_BYTES);
        let buffers = spare.unwrap_or_else(|| {
            [buffer("places of rays", pixels * KEPT_PLACE_BYTES), buffer("light of rays", pixels * KEPT_MEAN_BYTES)]
        });
        let [places, light] = &buffers;
        let bindings = passes::light_ray_keep {
            position_in: search.camera.position.bind(),
            paths: self.paths.as_entire_binding(),
            kept: places.as_entire_binding(),
            kept_light: light.as_entire_binding(),
        };
        recorder.over_pixels(&[], &search.supply, bindings)?;
        let (camera, source, revision) = (search.supply.camera, share.source.clone(), share.revision);
        self.next = Some(KeptRays { buffers, camera, source, revision, summed: self.summed });
        Ok(())
    }

    /// Records that the frame is finished, so that the next one may take its sums.
    pub fn finish(&mut self) {
        if let Some(next) = self.next.take() {
            self.spare = self.kept.replace(next).map(|kept| kept.buffers);
        }
    }

    /// Forgets the sums of earlier frames.
    pub fn forget(&mut self) {
        (self.kept, self.next) = (None, None);
    }

    /// Rays for a picture of another size, which may take over the sums of the frame before.
    ///
    /// # Errors
    /// See `new`.
    pub fn resized(self, gpu: &Gpu, size: [u32; 2]) -> Result<Self> {
        let kept = self.kept;
        Ok(Self { kept, ..Self::new(gpu, size)? })
    }

    /// Follows one ray of each path, and adds the light that it finds.
    fn follow(
        &self,
        recorder: &mut Recorder<'_>,
        search: &Search<'_>,
        light: &mut FrameLight<'_>,
        index: &mut SurfelIndex,
        (share, is_glossy, reuses): (&RayShare<'_>, bool, bool),
        (bounce, is_last): (usize, bool),
    ) -> Result<()> {
        let Search { supply, settings, store, mirrors, formulas, camera, .. } = search;
        let [this, before] = [bounce, bounce + 1].map(|number| &self.bounces[number % 2]);
        let (surface, from) = match bounce {
            0 => (*camera, camera.position),
            _ => (before.surface(), &before.mirror.point),
        };
        recorder.time_as(Some(LIGHT_RAYS));
        let bindings = passes::light_ray_draw {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            from_in: from.bind(),
            paths: self.paths.as_entire_binding(),
            point_out: this.mirror.point.bind(),
            eye_out: this.mirror.eye.bind(),
        };
        let tile = Self::window(&settings.gi, share.total);
        let switches = [
            ("bounce", bounce as u32),
            ("tile", tile),
            ("is_glossy", u32::from(is_glossy)),
            ("reuses", u32::from(reuses)),
        ];
        recorder.over_pixels(&switches, supply, bindings)?;

        let task = Task {
            supply,
            settings,
            store,
            mirrors,
            // Not the first reflection, whose tests are counted where they are shown.
            bounce: 1,
            camera: *camera,
            mirror: &this.mirror,
            normal: surface.normal,
            seen: &this.seen,
            formulas: formulas.as_ref(),
            counters: share.counters,
        };
        surfel_trace::meet(recorder, index, &self.gather, task, &supply.chunks, &self.straight)?;

        let is_lit = settings.gi.bounces > 0;
        let ray_bounces = Self::bounces_of(&settings.gi);
        // Some paths have no further ray but those that mirrors reflect.
        let may_end = bounce + 1 >= ray_bounces as usize;
        if is_lit {
            let gi = if may_end { None } else { light.gi.take() };
            let shaded = light.shade(recorder, supply, std::slice::from_ref(this), 1);
            light.gi = gi.or(light.gi.take());
            shaded?;
        }
        recorder.time_as(Some(LIGHT_RAYS));
        let indirect = light.gi.as_ref().and_then(|gi| gi.met()).filter(|_| is_lit && may_end);
        let bindings = passes::light_ray_sum {
            albedo_in: this.seen.albedo.bind(),
            normal_in: this.seen.normal.bind(),
            position_in: this.seen.position.bind(),
            point_in: this.mirror.point.bind(),
            eye_in: this.mirror.eye.bind(),
            direct_in: this.radiance.bind(),
            indirect_in: indirect.unwrap_or(&this.radiance).bind(),
            paths: self.paths.as_entire_binding(),
            diffuse_out: self.diffuse.bind(),
            glossy_out: self.glossy.bind(),
        };
        let switches = [
            ("is_lit", u32::from(is_lit)),
            ("has_indirect", u32::from(indirect.is_some())),
            ("is_last", u32::from(is_last)),
            ("bounce", bounce as u32),
            ("ray_bounces", ray_bounces),
            ("tile", tile),
            ("has_sky", u32::from(share.has_sky)),
            ("is_glossy", u32::from(is_glossy)),
            ("is_mixed", u32::from(light.is_mixed(1))),
            ("is_published", u32::from(is_published(settings))),
        ];
        recorder.over_pixels(&switches, supply, bindings)
    }

    /// The light of the rays so far.
    pub fn brought(&self, gi: &Gi) -> Brought<'_> {
        Brought {
            diffuse: &self.diffuse,
            glossy: &self.glossy,
            window: Self::window(gi, 1),
            narrow: Self::window(gi, self.summed),
            state: self.state,
        }
    }

    pub fn bytes(&self) -> u64 {
        let images = [&self.straight, &self.diffuse, &self.glossy].map(Image::bytes).iter().sum::<u64>();
        let kept = self.kept.iter().chain(&self.next).map(|kept| &kept.buffers).chain(&self.spare);
        let kept: u64 = kept.flatten().map(wgpu::Buffer::size).sum();
        self.gather.bytes() + self.bounces.iter().map(Bounce::bytes).sum::<u64>() + self.paths.size() + images + kept
    }
}

/// The settings by which what rays meet is lit: neighbours among pixels meet places that have nothing to do with one
/// another. So each is lit by its own part of the virtual lights only if the light of a tile's pixels is averaged where
/// the rays begin.
pub(crate) fn settings_where_met(settings: &Settings) -> Settings {
    let mut settings = settings.clone();
    settings.gi.interleave = tile_of(&settings.gi);
    settings.gi.filtered = false;
    settings
}
