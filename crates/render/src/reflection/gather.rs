//! What methods share that follow the reflected ray of each mirror pixel: the nearest hit of each pixel, and the Mirror G-Buffer
//! made of it.

use super::Task;
use crate::gpu::Result;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::storage;

/// The nearest hit of each mirror pixel.
pub(crate) struct Gather {
    /// Four words a pixel; see shaders/surfel_trace.wgsl.
    pub hits: wgpu::Buffer,
}

impl Gather {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self { hits: storage(device, "hits", u64::from(size[0]) * u64::from(size[1]) * 16) }
    }

    /// Fills the Mirror G-Buffer from the hits.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn resolve(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        let [albedo, normal, position] = task.seen.bind();
        let outputs = [
            task.mirror.point.bind(),
            task.normal.bind(),
            task.mirror.eye.bind(),
            self.hits.as_entire_binding(),
            albedo,
            normal,
            position,
        ];
        recorder.over_page_pixels(&passes::GATHER_RESOLVE, task.supply, &outputs)
    }
}
