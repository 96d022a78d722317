//! Tracing of the reflected rays through the points as oriented discs, exact up to the splats (gather).

use super::Task;
use super::gather::Gather;
use super::surfel_index::SurfelIndex;
use crate::gpu::Result;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::storage;

/// # Errors
/// A shader is refused, or no memory for the index.
pub(crate) fn run(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    gather: &Gather,
    task: &Task<'_>,
) -> Result<()> {
    let trees = index.update(recorder.gpu, task.store, task.supply, task.settings.splat.size)?;
    recorder.clear(&gather.hits);
    let lists = storage(&recorder.gpu.device, "no lists", 16);
    for tree in &trees {
        let Some(page) = index.page(tree.page) else { continue };
        let Some(inputs) = task.supply.pages.iter().find(|inputs| inputs.number == tree.page) else { continue };
        let resources = [
            task.mirror.point.bind(),
            task.normal.bind(),
            task.mirror.eye.bind(),
            tree.tops.as_entire_binding(),
            tree.places.as_entire_binding(),
            page.nodes.as_entire_binding(),
            page.surfels.as_entire_binding(),
            page.order.as_entire_binding(),
            lists.as_entire_binding(),
            gather.hits.as_entire_binding(),
            inputs.page.as_entire_binding(),
        ];
        recorder.over_pixels(&passes::SURFEL_TRACE, &[], task.supply, &resources)?;
    }
    gather.resolve(recorder, task)
}
