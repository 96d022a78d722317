//! What methods share that take each mirror pixel to a point: the nearest hit of its reflected ray, if they look for that, and
//! the Mirror G-Buffer made of what was found.

use super::{MirrorGBuffer, Task};
use crate::gpu::Result;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, storage};

/// The nearest hit of each mirror pixel.
pub(crate) struct Gather {
    /// Four words a pixel; see shaders/surfel_trace.wgsl.
    pub hits: wgpu::Buffer,
    /// z: nodes and discs that each ray was tested against, while that is shown.
    pub views: Image,
    /// As found, and half closed.
    found: [MirrorGBuffer; 2],
}

impl Gather {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let hits = storage(device, "hits", u64::from(size[0]) * u64::from(size[1]) * 16);
        let views = Image::new(device, size, "views", wgpu::TextureFormat::Rgba32Float);
        Self { hits, views, found: [MirrorGBuffer::new(device, size), MirrorGBuffer::new(device, size)] }
    }

    pub fn bytes(&self) -> u64 {
        self.hits.size() + self.views.bytes() + self.found.iter().map(MirrorGBuffer::bytes).sum::<u64>()
    }

    /// Fills the Mirror G-Buffer from the hits, and closes pixels whose ray slipped between discs.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn resolve(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        self.complete(recorder, task, |recorder, found| {
            let [albedo, normal, position] = found.bind();
            let outputs = [
                task.mirror.point.bind(),
                task.normal.bind(),
                task.mirror.eye.bind(),
                self.hits.as_entire_binding(),
                albedo,
                normal,
                position,
            ];
            recorder.over_page_pixels(&passes::GATHER_RESOLVE, task.supply, &outputs, task.supply.mirror_groups())
        })
    }

    /// Takes what `fill` writes for the points that were found, closes pixels beside them, and puts mirrors with a formula before
    /// it.
    ///
    /// # Errors
    /// A shader is refused, or what `fill` says.
    pub fn complete(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        fill: impl FnOnce(&mut Recorder<'_>, &MirrorGBuffer) -> Result<()>,
    ) -> Result<()> {
        // Each step reads what the one before wrote; the last writes the Mirror G-Buffer itself.
        let closings = if task.settings.splat.close_gaps { 2 } else { 0 };
        let steps = closings + usize::from(task.formulas.is_some());
        let images = |step: usize| if step == steps { task.seen } else { &self.found[step % 2] };
        fill(recorder, images(0))?;
        for step in 0..closings {
            let mut resources = vec![task.mirror.point.bind()];
            resources.extend(images(step).bind().into_iter().chain(images(step + 1).bind()));
            recorder.over_mirrors(&passes::GATHER_CLOSE, &[], task.supply, &resources)?;
        }
        if let Some(formulas) = task.formulas {
            let mut resources = vec![
                task.mirror.point.bind(),
                task.normal.bind(),
                task.mirror.eye.bind(),
                formulas.as_entire_binding(),
            ];
            resources.extend(images(closings).bind().into_iter().chain(task.seen.bind()));
            recorder.over_mirrors(&passes::MIRROR_EXACT_SEEN, &[], task.supply, &resources)?;
        }
        Ok(())
    }
}
