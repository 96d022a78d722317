//! Traces the reflected rays through the points as oriented discs, exact up to the splats. Two methods: `surfel_trace`
//! starts each ray at the top of the trees (gather); `sscr_hierarchical` first lets whole nodes descend into the beams
//! that bound the rays of a tile, and starts each ray at the nodes that its tile lists
//! (docs/methods/sscr_hierarchical.md).

use scene::Show;

use super::gather::Gather;
use super::surfel_index::SurfelIndex;
use super::task::Task;
use crate::gpu::Result;
use crate::identities::ChunkId;
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::Image;

/// The rays that are traced, and where they start in the trees.
#[derive(Clone, Copy)]
pub(crate) enum Rays<'a> {
    /// The rays of all mirror pixels begin at the top of the trees.
    All,
    /// The rays of all mirror pixels begin at the nodes that lie in the beam of their tile.
    InBeams,
    /// Only rays are followed that another method has left; see `rest_list`.
    Listed(&'a wgpu::Buffer),
    /// The rays of all mirror pixels are followed up to the distance in w of their eyes.
    WithEnds,
    /// All rays go straight on from their eyes; the normals are those of the surfaces that they leave, whose own discs
    /// they do not meet. Those that meet nothing end in the gaps between discs through which they slip.
    FromSurfaces,
}

/// Finds the nearest hits of a bounce's rays on the discs of `chunks`.
///
/// # Errors
/// A shader is refused, or there is no memory for the index.
pub(crate) fn search(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    gather: &Gather,
    task: &Task<'_>,
    chunks: &[ChunkId],
    rays: Rays<'_>,
) -> Result<()> {
    recorder.clear(&gather.hits);
    trace(recorder, index, gather, task, chunks, rays)
}

/// Finds what rays that leave surfaces meet, discs of `chunks` and mirrors with a formula, and fills the Mirror G-Buffer with
/// it. `straight` is an image of zeros.
///
/// # Errors
/// A shader is refused, or there is no memory for the index.
pub(crate) fn meet(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    gather: &Gather,
    task: Task<'_>,
    chunks: &[ChunkId],
    straight: &Image,
) -> Result<()> {
    search(recorder, index, gather, &task, chunks, Rays::FromSurfaces)?;
    // No normal reflects these rays: they go straight on from their eyes.
    let task = Task { normal: straight, ..task };
    match task.formulas {
        None => gather.resolve_points(recorder, &task, task.seen.bind()),
        Some(formulas) => {
            gather.resolve_points(recorder, &task, gather.found.bind())?;
            gather.found.show_formulas(recorder, &task, formulas)
        }
    }
}

/// Finds the nearest hits on the discs of `chunks`, nearer than those in `gather.hits`.
///
/// # Errors
/// A shader is refused, or there is no memory for the index.
pub(super) fn trace(
    recorder: &mut Recorder<'_>,
    index: &mut SurfelIndex,
    gather: &Gather,
    task: &Task<'_>,
    chunks: &[ChunkId],
    rays: Rays<'_>,
) -> Result<()> {
    let use_beams = matches!(rays, Rays::InBeams);
    let leaves_surface = matches!(rays, Rays::FromSurfaces);
    let rest = if let Rays::Listed(rest) = rays { Some(rest) } else { None };
    let trees = index.update(recorder, task.store, task.supply, chunks, task.settings.splat.size)?;
    let [width, height] = task.supply.size.map(|edge| edge.div_ceil(8));
    let tiles = width * height;
    let lists = index.lists(recorder.gpu, if use_beams { tiles } else { 0 });
    for tree in &trees {
        let Some(page) = index.page(tree.page) else { continue };
        let Some(inputs) = task.supply.pages.iter().find(|inputs| inputs.number == tree.page) else { continue };
        if use_beams {
            let bindings = passes::beam_lists {
                point_in: task.mirror.point.bind(),
                normal_in: task.normal.bind(),
                eye_in: task.mirror.eye.bind(),
                tops: tree.tops.as_entire_binding(),
                nodes: page.nodes.as_entire_binding(),
                lists: lists.as_entire_binding(),
            };
            recorder.by_rows(&[], task.supply, bindings, [width.div_ceil(8), height.div_ceil(8), 1])?;
        }
        let bindings = passes::surfel_trace {
            point_in: task.mirror.point.bind(),
            normal_in: task.normal.bind(),
            eye_in: task.mirror.eye.bind(),
            tops: tree.tops.as_entire_binding(),
            nodes: page.nodes.as_entire_binding(),
            surfels: page.surfels.as_entire_binding(),
            order: page.order.as_entire_binding(),
            lists: rest.unwrap_or(&lists).as_entire_binding(),
            hits: gather.hits.as_entire_binding(),
            shown: inputs.bind_shown(),
            views_out: gather.views.bind(),
            counters: task.counters.as_entire_binding(),
        };
        let switches = [
            ("use_lists", u32::from(use_beams)),
            ("use_rest", u32::from(rest.is_some())),
            ("has_ends", u32::from(matches!(rays, Rays::WithEnds))),
            ("leaves_surface", u32::from(leaves_surface)),
            ("closes_gaps", u32::from(leaves_surface && task.settings.splat.close_gaps)),
            ("hides_points", u32::from(task.supply.hides_points)),
            ("count_tests", u32::from(task.bounce == 0 && task.settings.reflection.show == Show::Steps)),
        ];
        recorder.by_rows(&switches, task.supply, bindings, task.supply.mirror_groups())?;
    }
    Ok(())
}
