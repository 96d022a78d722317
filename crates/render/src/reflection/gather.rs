//! Shared parts of the methods that take each mirror pixel to a point: the nearest hit of its reflected ray, for
//! methods that trace it, and the Mirror G-Buffer made of the points found.

use super::task::{MirrorGBuffer, Task};
use crate::gpu::Result;
use crate::layout::{HIT_BYTES, REST_WORD_BYTES};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, storage};

/// The nearest hit of each mirror pixel.
pub(crate) struct Gather {
    /// Four words a pixel; see shaders/shared/hit.wgsl.
    pub hits: wgpu::Buffer,
    /// z: the number of nodes and discs against which each ray was tested, while that is shown.
    pub views: Image,
    /// What is found, between the steps that complete it.
    pub found: MirrorGBuffer,
}

/// An empty list of rays that a method leaves to another one, for the pixels of `size`: their number; then two words
/// each: pixel, and f32 bits of the distance up to which it is free. `kept` keeps its room.
pub(super) fn rest_list<'a>(
    recorder: &mut Recorder<'_>,
    kept: &'a mut Option<wgpu::Buffer>,
    size: [u32; 2],
) -> &'a wgpu::Buffer {
    let bytes = REST_WORD_BYTES * (1 + 2 * u64::from(size[0]) * u64::from(size[1]));
    let list = kept.take().filter(|list| list.size() == bytes);
    let list = &*kept.insert(list.unwrap_or_else(|| storage(&recorder.gpu.device, "rays that are left", bytes)));
    recorder.clear_part(list, 0..REST_WORD_BYTES);
    list
}

impl Gather {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let hits = storage(device, "hits", u64::from(size[0]) * u64::from(size[1]) * HIT_BYTES);
        let views = Image::new(device, size, "views", wgpu::TextureFormat::Rgba32Float);
        Self { hits, views, found: MirrorGBuffer::new(device, size) }
    }

    pub fn bytes(&self) -> u64 {
        self.hits.size() + self.views.bytes() + self.found.bytes()
    }

    /// Fills the Mirror G-Buffer from the hits, and closes pixels whose ray slipped between discs.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn resolve(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        self.complete(recorder, task, |recorder, found| self.resolve_points(recorder, task, found.bind()))
    }

    /// Writes the points that rays meet, and the pixels whose ray meets nothing. Rays that end in the camera's picture
    /// keep what is there.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn resolve_points(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        [albedo_out, normal_out, position_out]: [wgpu::BindingResource<'_>; 3],
    ) -> Result<()> {
        let bindings = passes::gather_resolve {
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            hits: self.hits.as_entire_binding(),
            albedo_out,
            normal_out,
            position_out,
        };
        recorder.over_page_pixels(task.supply, bindings, task.supply.mirror_groups())
    }

    /// Takes what `fill` writes for the points found, closes pixels beside them, and puts mirrors with a formula in
    /// front.
    ///
    /// # Errors
    /// A shader is refused, or the error of `fill`.
    pub fn complete(
        &self,
        recorder: &mut Recorder<'_>,
        task: &Task<'_>,
        fill: impl FnOnce(&mut Recorder<'_>, &MirrorGBuffer) -> Result<()>,
    ) -> Result<()> {
        // Each step reads what the one before wrote; the last writes the Mirror G-Buffer, and so does every other one.
        let closings = if task.settings.splat.close_gaps { 2 } else { 0 };
        let steps = closings + usize::from(task.formulas.is_some());
        let images = |step: usize| if (steps - step).is_multiple_of(2) { task.seen } else { &self.found };
        fill(recorder, images(0))?;
        for step in 0..closings {
            let [albedo_in, normal_in, position_in] = images(step).bind();
            let [albedo_out, normal_out, position_out] = images(step + 1).bind();
            let bindings = passes::gather_close {
                point_in: task.mirror.point.bind(),
                albedo_in,
                normal_in,
                position_in,
                albedo_out,
                normal_out,
                position_out,
            };
            recorder.over_mirrors(&[], task.supply, bindings)?;
        }
        match task.formulas {
            Some(formulas) => images(closings).show_formulas(recorder, task, formulas),
            None => Ok(()),
        }
    }
}
