//! Screen-space curved reflections (Preiner 2010): the mirror's pixels are divided into regions that bend one way, each
//! point is assigned to one of them, and a search on its pixels finds the one that reflects the point.
//! docs/methods/sscr.md says which reading of the paper was taken where its text and its algorithm 3.1 differ, and what
//! follows from it.
//!
//! The labels that the paper finds on the CPU are made on the GPU; nothing is read back while a frame is made.

#[cfg(test)]
pub(super) mod exact_mirrors;
#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) mod threads;
#[cfg(test)]
pub(super) mod twin;

use std::num::NonZeroU64;

use cloud::Bounds;
use glam::Vec4;
use scene::{KeptPoints, Seeds, Show};

use super::forward::{Forward, Splats, check_size, picture_buffer};
use super::task::Task;
use crate::gpu::{Gpu, Result};
use crate::identities::ChunkId;
use crate::layout::{
    CURVATURE_BYTES, ENDING_ALIGNMENT, ENDING_WORDS, LABEL_BYTES, LEAST_REGION, MIRROR_PIXEL_BYTES, PARENT_BYTES,
    REGION_BYTES, RUN_BYTES, RUN_PIXELS, Round,
};
use crate::passes::{self, PassStage};
use crate::recorder::Recorder;
use crate::targets::{Image, storage, uniform_buffer};

/// The name under which the second search of a frame is timed.
const SOLVE_AGAIN: (&str, PassStage) = ("sscr_solve_again", PassStage::Method);

/// The state of the method that is kept from frame to frame.
pub(crate) struct Sscr {
    size: [u32; 2],
    /// The averaged normals, along rows and then along columns, if the curvature map is made from them.
    filtered: Option<[Image; 2]>,
    curvature: wgpu::Buffer,
    /// Labelling: each pixel's parent in its tree; the number of pixels of the roots' trees, then their labels.
    parents: wgpu::Buffer,
    sizes: wgpu::Buffer,
    runs: wgpu::Buffer,
    /// By label; the first stands for all of them.
    regions: wgpu::Buffer,
    mirror_pixels: wgpu::Buffer,
    /// Where searches ended; then, for each chunk of the frame, whether its points are searched for.
    endings: wgpu::Buffer,
    /// For the first bounce: the flags of the curvature map, the label, the mean number of steps of the searches that
    /// ended in the pixel, the share of them that ran out of steps. Steps are known while they are shown.
    pub views: Image,
    /// The number of frames made so far: if last frame's pixels are the seeds, points without one are tried anew in
    /// each frame.
    frames: u32,
}

/// The bytes of the words for where searches ended, in pictures of `size`.
fn ending_bytes(size: [u32; 2]) -> u64 {
    u64::from(size[0]) * u64::from(size[1]) * ENDING_WORDS * 4
}

impl Sscr {
    pub fn bytes(&self) -> u64 {
        let Self { curvature, parents, sizes, runs, regions, mirror_pixels, endings, views, .. } = self;
        let buffers = [curvature, parents, sizes, runs, regions, mirror_pixels, endings];
        let images = self.filtered.iter().flatten().chain([views]);
        buffers.map(wgpu::Buffer::size).iter().sum::<u64>() + images.map(Image::bytes).sum::<u64>()
    }

    /// Makes the buffers for pictures of `size`.
    ///
    /// # Errors
    /// A picture too large for the adapter.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let buffer = |what, bytes| picture_buffer(gpu, what, bytes);
        let runs = pixels.div_ceil(RUN_PIXELS.into()) * RUN_BYTES;
        // Each run has a workgroup, all along one dimension.
        let most_runs = u64::from(gpu.device.limits().max_compute_workgroups_per_dimension);
        check_size(gpu, "runs of pixels", runs, most_runs * RUN_BYTES)?;
        Ok(Self {
            size,
            filtered: None,
            curvature: buffer("curvature map", pixels * CURVATURE_BYTES)?,
            parents: buffer("parents", pixels * PARENT_BYTES)?,
            sizes: buffer("sizes", pixels * LABEL_BYTES)?,
            runs: buffer("runs of pixels", runs)?,
            regions: buffer("regions", (pixels.div_ceil(LEAST_REGION) + 1) * REGION_BYTES)?,
            mirror_pixels: buffer("mirror pixels", pixels * MIRROR_PIXEL_BYTES)?,
            endings: buffer("ends of searches", ending_bytes(size).next_multiple_of(ENDING_ALIGNMENT * 4))?,
            views: Image::new(&gpu.device, size, "views", wgpu::TextureFormat::Rgba32Float),
            frames: 0,
        })
    }

    /// Makes the next frame the first, without a last frame to start from.
    pub fn forget(&mut self) {
        self.frames = 0;
    }

    /// Fills the Mirror G-Buffer of one bounce.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn run(&mut self, recorder: &mut Recorder<'_>, forward: &mut Forward, task: &Task<'_>) -> Result<()> {
        let settings = &task.settings.sscr;
        let rounds = settings.regions_per_point;
        let keeps_solutions = settings.seeds == Seeds::LastFrame;
        // If they are not kept, one buffer serves all bounces in turn.
        let (bounce, bounces) =
            if keeps_solutions { (task.bounce, task.settings.reflection.bounces as usize) } else { (0, 1) };
        // Solutions that are the next seeds must not be searched twice, and the nearest point needs no second search: in
        // the thesis it is what its depth buffer keeps.
        let solve_once = settings.solve_once || keeps_solutions || settings.visibility == KeptPoints::Nearest;
        if keeps_solutions && self.frames == 0 && task.bounce == 0 {
            forward.forget();
        }
        forward.reserve(recorder.gpu, task, rounds, 1, [bounce, bounces])?;
        self.filter(recorder, task)?;
        self.label(recorder, task)?;
        self.cull(recorder, task)?;
        forward.clear(recorder);
        recorder.clear_part(&self.endings, 0..ending_bytes(self.size));
        for round in 0..rounds {
            self.solve(recorder, forward, task, round, bounce, task.bounce == 0)?;
            forward.depth(recorder, task, Splats::PUBLISHED, [round as usize, bounce])?;
        }
        for round in 0..rounds {
            if !solve_once {
                // As published, points are searched for twice, and the thesis gives the times of both searches.
                recorder.time_as(Some(SOLVE_AGAIN));
                self.solve(recorder, forward, task, round, bounce, false)?;
                recorder.time_as(None);
            }
            forward.visibility(recorder, task, Splats::PUBLISHED, [round as usize, bounce])?;
        }
        forward.close(recorder, task, |_, _| Ok(()))?;
        if task.bounce == 0 {
            let bindings = passes::sscr_views {
                curvature_map: self.curvature.as_entire_binding(),
                mirror_pixels: self.mirror_pixels.as_entire_binding(),
                endings: self.endings.as_entire_binding(),
                parents: self.parents.as_entire_binding(),
                views_out: self.views.bind(),
            };
            recorder.over_pixels(&[], task.supply, bindings)?;
            self.frames = self.frames.wrapping_add(1);
        }
        Ok(())
    }

    /// Averages the mirror's normals, if the curvature map is to be made from them.
    fn filter(&mut self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        if task.settings.sscr.normal_filter == 0 {
            self.filtered = None;
            return Ok(());
        }
        let (device, size) = (&recorder.gpu.device, self.size);
        let image = |label| Image::new(device, size, label, wgpu::TextureFormat::Rgba32Float);
        let [rows, columns] = self.filtered.get_or_insert_with(|| ["filtered rows", "filtered normal"].map(image));
        for (along_columns, from, to) in [(0, task.normal, &*rows), (1, &*rows, &*columns)] {
            let bindings = passes::normal_filter {
                point_in: task.mirror.point.bind(),
                normal_in: from.bind(),
                eye_in: task.mirror.eye.bind(),
                normal_out: to.bind(),
            };
            let switches = [("along_columns", along_columns), ("from_camera", u32::from(task.bounce == 0))];
            recorder.over_pixels(&switches, task.supply, bindings)?;
        }
        Ok(())
    }

    /// Makes the curvature map, the labels and the regions.
    fn label(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        let inputs = task.supply;
        let [point_in, normal_in, eye_in] = [task.mirror.point.bind(), task.normal.bind(), task.mirror.eye.bind()];
        let [curvature_map, parents, sizes, runs, regions, mirror_pixels] =
            [&self.curvature, &self.parents, &self.sizes, &self.runs, &self.regions, &self.mirror_pixels]
                .map(wgpu::Buffer::as_entire_binding);
        let bindings = passes::curvature {
            point_in: point_in.clone(),
            normal_in: self.filtered.as_ref().map_or_else(|| normal_in.clone(), |[_, columns]| columns.bind()),
            eye_in: eye_in.clone(),
            curvature_map: curvature_map.clone(),
        };
        recorder.over_pixels(&[("from_camera", u32::from(task.bounce == 0))], inputs, bindings)?;
        for (along_columns, lines) in [(0, self.size[1]), (1, self.size[0])] {
            let switches = [("along_columns", along_columns)];
            let groups = [lines.div_ceil(64), 1, 1];
            let bindings = passes::curvature_smooth { curvature_map: curvature_map.clone() };
            recorder.over(&switches, inputs, bindings, groups)?;
        }
        let bindings = passes::label_start { curvature_map, parents: parents.clone(), sizes: sizes.clone() };
        recorder.over_pixels(&[], inputs, bindings)?;
        recorder.over_pixels(&[], inputs, passes::label_join { parents: parents.clone() })?;
        let bindings = passes::label_flatten { parents: parents.clone(), sizes: sizes.clone() };
        recorder.over_pixels(&[], inputs, bindings)?;
        let groups = [(self.size[0] * self.size[1]).div_ceil(RUN_PIXELS), 1, 1];
        let bindings = passes::region_count { parents: parents.clone(), sizes: sizes.clone(), runs: runs.clone() };
        recorder.over(&[], inputs, bindings, groups)?;
        let switches = [("count_regions", u32::from(task.bounce == 0))];
        let counters = task.counters.as_entire_binding();
        let bindings = passes::region_scan { runs: runs.clone(), regions: regions.clone(), counters };
        recorder.over(&switches, inputs, bindings, [1, 1, 1])?;
        let bindings =
            passes::region_number { parents: parents.clone(), sizes: sizes.clone(), runs, regions: regions.clone() };
        recorder.over(&[], inputs, bindings, groups)?;
        let switches = [("bound_rays", u32::from(task.settings.sscr.cull_points || task.settings.sscr.cull_chunks))];
        let bindings = passes::region_assign { point_in, normal_in, eye_in, parents, sizes, regions, mirror_pixels };
        recorder.over_pixels(&switches, inputs, bindings)
    }

    /// Finds the chunks that some region may reflect, if only their points are to be searched for.
    fn cull(&mut self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        if !task.settings.sscr.cull_chunks {
            return Ok(());
        }
        let eye = task.supply.camera.eye;
        let sphere = |chunk: &ChunkId| {
            let bounds = task.store.placed(*chunk).map_or(Bounds::EMPTY, |placed| placed.bounds);
            // Rounding must not leave a point outside.
            let radius = bounds.radius() * 1.0001 + bounds.center().distance(eye) * 1e-6;
            (bounds.center() - eye).as_vec3().extend(radius as f32)
        };
        let mut spheres: Vec<Vec4> = task.supply.chunks.iter().map(sphere).collect();
        // The buffer must not be empty.
        spheres.resize(spheres.len().max(1), Vec4::ZERO);
        let device = &recorder.gpu.device;
        let uploaded = storage(device, "spheres about chunks", size_of_val(&spheres[..]) as u64);
        recorder.gpu.queue.write_buffer(&uploaded, 0, bytemuck::cast_slice(&spheres));
        let chunks = ending_bytes(self.size).next_multiple_of(ENDING_ALIGNMENT * 4);
        let bytes = 4 * spheres.len() as u64;
        if self.endings.size() < chunks + bytes {
            self.endings = picture_buffer(recorder.gpu, "ends of searches", chunks + bytes.next_power_of_two())?;
        }
        let bindings = passes::sscr_cull {
            regions: self.regions.as_entire_binding(),
            spheres: uploaded.as_entire_binding(),
            chunks_reached: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &self.endings,
                offset: chunks,
                size: NonZeroU64::new(bytes),
            }),
        };
        recorder.over(&[], task.supply, bindings, [(spheres.len() as u32).div_ceil(64), 1, 1])
    }

    /// Searches the pixel of each point, in the region that is drawn for it in this round.
    fn solve(
        &self,
        recorder: &mut Recorder<'_>,
        forward: &Forward,
        task: &Task<'_>,
        round: u32,
        bounce: usize,
        is_counted: bool,
    ) -> Result<()> {
        let settings = &task.settings.sscr;
        let records = matches!(task.settings.reflection.show, Show::Steps | Show::Unconverged);
        let switches = [
            ("solver", settings.solver as u32),
            ("seeds", settings.seeds as u32),
            ("per_region", u32::from(settings.per_region)),
            ("cull", u32::from(settings.cull_points)),
            ("cull_chunks", u32::from(settings.cull_chunks)),
            ("count_points", u32::from(is_counted)),
            ("is_later", u32::from(task.bounce > 0)),
            ("record_endings", u32::from(is_counted && records)),
            ("shows_search", u32::from(task.settings.reflection.show == Show::Search)),
        ];
        // Points that were not found are tried elsewhere in the next frame, if it starts from this one's pixels.
        let frame = if settings.seeds == Seeds::LastFrame { self.frames } else { 0 };
        let draw = frame.wrapping_mul(settings.regions_per_point).wrapping_add(round);
        // Any odd number spreads the draws over the seeds.
        let seed = draw.wrapping_mul(0x9e37_79b9) ^ (task.bounce as u32);
        let uniform = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&Round { draw, seed }));
        recorder.over_points_by_page(&switches, task.supply, |page| {
            Some(passes::sscr_solve {
                round: uniform.as_entire_binding(),
                mirror_pixels: self.mirror_pixels.as_entire_binding(),
                regions: self.regions.as_entire_binding(),
                solutions: forward.bind_solutions(page, round, bounce)?,
                counters: task.counters.as_entire_binding(),
                endings: self.endings.as_entire_binding(),
            })
        })
    }
}
