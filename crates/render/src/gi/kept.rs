//! Indirect light that is kept from frame to frame: the light that falls on a surface is the same from every eye, so a
//! frame while something moves computes it only where the frame before had none.

use glam::Vec4;
use scene::Gi;

use crate::frame::FrameCamera;
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{Frame, KEPT_LIGHT_BYTES};
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::SurfaceImages;
use crate::targets::{storage, uniform_buffer};

/// What frames do with the indirect light that other frames have computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightReuse {
    /// Frames compute their light, and keep none.
    #[default]
    Never,
    /// Frames compute their light, and keep it for the frames that follow.
    Keep,
    /// Frames take the light of the frame before where it is of the same place, compute the rest, and keep both. The
    /// light is then that of a place within a few pixels. Surfaces with highlights are computed. What is computed is
    /// lit by one virtual light in `HURRIED_PARTS`, and so is what mirrors show, because its places in the frame before
    /// are not known. Light by rays is taken over with its number of rays, and goes on from there.
    Reuse,
}

/// The first one in so many of the virtual lights lights what is computed while light is taken over.
pub(super) const HURRIED_PARTS: u32 = 4;

/// The light of a frame.
struct Kept {
    camera: FrameCamera,
    /// The generation of the virtual lights and the settings that gave the light.
    source: (u64, Gi),
    /// An element of shaders/shared/kept_light.wgsl for each pixel.
    light: wgpu::Buffer,
}

#[derive(Default)]
pub(crate) struct Keeper {
    pub reuse: LightReuse,
    /// The light of the last frame that was finished.
    last: Option<Kept>,
    /// The light of the frame being drawn.
    next: Option<Kept>,
    spare: Option<wgpu::Buffer>,
}

/// The light that a frame takes over and keeps.
pub(crate) struct Taken {
    /// An element of shaders/shared/kept_light.wgsl for each pixel, to be filled.
    pub light: wgpu::Buffer,
    /// For each tile of 8 x 8 pixels whether its light must be computed; `None` if all light must be.
    pub tiles: Option<wgpu::Buffer>,
}

/// The camera of the frame before on the GPU, as shaders/shared/kept_place.wgsl has it, with the most rays that are taken
/// over from each of its pixels.
pub(crate) fn camera_before(gpu: &Gpu, before: &FrameCamera, now: &FrameCamera, most_rays: f32) -> wgpu::Buffer {
    let moved = (now.eye - before.eye).as_vec3();
    uniform_buffer(gpu, bytemuck::bytes_of(&Frame { clip: Vec4::from((moved, most_rays)), ..before.to_gpu() }))
}

impl Keeper {
    /// Prepares a frame that keeps its light, and takes over light for it if it may. `window` is the edge of the window
    /// in pixels over which light is averaged. Returns `None` if the frame keeps no light.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn take(
        &mut self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        surface: SurfaceImages<'_>,
        source: (u64, Gi),
        window: u32,
    ) -> Result<Option<Taken>> {
        self.next = None;
        let gpu: &Gpu = recorder.gpu;
        let bytes = inputs.size.iter().map(|edge| u64::from(*edge)).product::<u64>() * KEPT_LIGHT_BYTES;
        if self.reuse == LightReuse::Never || bytes > gpu.device.limits().max_storage_buffer_binding_size {
            return Ok(None);
        }
        let spare = self.spare.take().filter(|buffer| buffer.size() == bytes);
        let light = spare.unwrap_or_else(|| storage(&gpu.device, "kept light", bytes));
        self.next = Some(Kept { camera: inputs.camera, source: source.clone(), light: light.clone() });
        let before = self.last.as_ref().filter(|last| self.reuse == LightReuse::Reuse && last.source == source);
        let Some(before) = before else { return Ok(Some(Taken { light, tiles: None })) };
        let groups = inputs.pixel_groups();
        let tiles = storage(&gpu.device, "tiles to light", u64::from(groups[0]) * u64::from(groups[1]) * 4);
        recorder.clear(&tiles);
        let camera = camera_before(gpu, &before.camera, &inputs.camera, 0.0);
        let bindings = passes::indirect_reuse {
            albedo_in: surface.albedo.bind(),
            normal_in: surface.normal.bind(),
            position_in: surface.position.bind(),
            before: camera.as_entire_binding(),
            kept: before.light.as_entire_binding(),
            light_out: light.as_entire_binding(),
            tiles: tiles.as_entire_binding(),
        };
        recorder.over(&[("window", window)], inputs, bindings, groups)?;
        Ok(Some(Taken { light, tiles: Some(tiles) }))
    }

    /// Records that the frame is finished, so that the next one may take its light.
    pub fn finish(&mut self) {
        if let Some(next) = self.next.take() {
            self.spare = self.last.replace(next).map(|last| last.light);
        }
    }

    /// Forgets the light of earlier frames.
    pub fn forget(&mut self) {
        (self.last, self.next) = (None, None);
    }

    pub fn bytes(&self) -> u64 {
        let kept = self.last.iter().chain(&self.next).map(|kept| &kept.light);
        kept.chain(&self.spare).map(wgpu::Buffer::size).sum()
    }
}
