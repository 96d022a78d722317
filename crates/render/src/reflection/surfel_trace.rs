//! Tracing of the reflected rays through the points as oriented discs, exact up to the splats. Two methods: `surfel_trace`
//! starts each ray at the top of the trees (gather), `sscr_hierarchical` first lets whole nodes descend into the beams that
//! bound the rays of a tile, and starts each ray at what its tile lists (docs/methods/sscr_hierarchical.md).

use scene::Show;

use super::Task;
use super::gather::Gather;
use super::surfel_index::SurfelIndex;
use crate::gpu::Result;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::storage;

/// Bytes of a tile's list, as shaders/shared/surfel_tree.wgsl has it.
const LIST_BYTES: u64 = 97 * 4;

/// # Errors
/// A shader is refused, or no memory for the index.
pub(crate) fn run(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    gather: &Gather,
    task: &Task<'_>,
    use_beams: bool,
) -> Result<()> {
    let trees = index.update(recorder.gpu, task.store, task.supply, task.settings.splat.size)?;
    recorder.clear(&gather.hits);
    let [width, height] = task.supply.size.map(|edge| edge.div_ceil(8));
    let tiles = width * height;
    let list_bytes = if use_beams { u64::from(tiles) * LIST_BYTES } else { 16 };
    let lists = storage(&recorder.gpu.device, "lists of nodes", list_bytes);
    for tree in &trees {
        let Some(page) = index.page(tree.page) else { continue };
        let Some(inputs) = task.supply.pages.iter().find(|inputs| inputs.number == tree.page) else { continue };
        let mirror = [task.mirror.point.bind(), task.normal.bind(), task.mirror.eye.bind()];
        let nodes = [tree.tops.as_entire_binding(), tree.places.as_entire_binding(), page.nodes.as_entire_binding()];
        if use_beams {
            let resources: Vec<_> = mirror.iter().chain(&nodes).cloned().chain([lists.as_entire_binding()]).collect();
            recorder.over(&passes::BEAM_LISTS, &[], task.supply, &resources, [tiles.div_ceil(64), 1, 1])?;
        }
        let rest = [
            page.surfels.as_entire_binding(),
            page.order.as_entire_binding(),
            lists.as_entire_binding(),
            gather.hits.as_entire_binding(),
            inputs.page.as_entire_binding(),
            inputs.points.as_entire_binding(),
            task.supply.class_masks.as_entire_binding(),
            gather.views.bind(),
            task.counters.as_entire_binding(),
        ];
        let resources: Vec<_> = mirror.into_iter().chain(nodes).chain(rest).collect();
        let switches = [
            ("use_lists", u32::from(use_beams)),
            ("filter_classes", u32::from(task.supply.filter_classes)),
            ("count_tests", u32::from(task.bounce == 0 && task.settings.reflection.show == Show::Steps)),
        ];
        recorder.over_mirrors(&passes::SURFEL_TRACE, &switches, task.supply, &resources)?;
    }
    gather.resolve(recorder, task)
}
