//! Screen-space curved reflections (Preiner 2010): the mirror's pixels are parted into regions that bend one way, each point
//! is given to one of them, and a search on its pixels finds the one that reflects the point. docs/methods/sscr.md tells which
//! reading of the paper was taken where its text and its listing differ, and what comes of it.
//!
//! The labels that the paper finds on the CPU are made on the GPU; nothing is read back while a frame is made.

#[cfg(test)]
mod exact_mirrors;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use scene::{Distribution, Seeds, Show};

use super::Task;
use super::forward::{Forward, check_size, picture_buffer};
use crate::gpu::{Gpu, Result};
use crate::passes;
use crate::recorder::Recorder;
use crate::targets::{Image, storage};

/// Smallest region, in pixels, and bytes of a `Region`: of shaders/shared/region.wgsl.
const LEAST_REGION: u64 = 4;
const REGION_BYTES: u64 = 80;
/// Bytes of a `MirrorPixel` in shaders/shared/mirror_space.wgsl.
const MIRROR_PIXEL_BYTES: u64 = 32;
/// Pixels that a workgroup numbers the regions of.
const RUN_PIXELS: u32 = 1024;
const RUN_BYTES: u64 = 8;

/// What the method keeps from frame to frame.
pub(crate) struct Sscr {
    size: [u32; 2],
    curvature: wgpu::Buffer,
    /// Labelling: each pixel's parent in its tree; pixels of the roots' trees, then their labels.
    parents: wgpu::Buffer,
    sizes: wgpu::Buffer,
    runs: wgpu::Buffer,
    totals: wgpu::Buffer,
    regions: wgpu::Buffer,
    mirror_pixels: wgpu::Buffer,
    endings: wgpu::Buffer,
    /// Of the first bounce: flags of the curvature map, label, mean steps of the searches that ended in the pixel, share of
    /// them that ran out of steps. Steps are known while they are shown.
    pub views: Image,
    /// Frames made so far: where last frame's pixels are the seeds, points that have none are tried anew in each.
    frames: u32,
}

impl Sscr {
    pub fn bytes(&self) -> u64 {
        let Self { curvature, parents, sizes, runs, totals, regions, mirror_pixels, endings, views, .. } = self;
        let buffers = [curvature, parents, sizes, runs, totals, regions, mirror_pixels, endings];
        buffers.map(wgpu::Buffer::size).iter().sum::<u64>() + views.bytes()
    }

    /// # Errors
    /// A picture too large for the adapter.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Self> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let buffer = |what, bytes| picture_buffer(gpu, what, bytes);
        let runs = pixels.div_ceil(RUN_PIXELS.into()) * RUN_BYTES;
        // A workgroup each, all along one dimension.
        let most_runs = u64::from(gpu.device.limits().max_compute_workgroups_per_dimension);
        check_size(gpu, "runs of pixels", runs, most_runs * RUN_BYTES)?;
        Ok(Self {
            size,
            curvature: buffer("curvature map", pixels * 4)?,
            parents: buffer("parents", pixels * 4)?,
            sizes: buffer("sizes", pixels * 4)?,
            runs: buffer("runs of pixels", runs)?,
            totals: storage(&gpu.device, "totals of regions", 8),
            regions: buffer("regions", pixels.div_ceil(LEAST_REGION) * REGION_BYTES)?,
            mirror_pixels: buffer("mirror pixels", pixels * MIRROR_PIXEL_BYTES)?,
            endings: buffer("ends of searches", pixels * 12)?,
            views: Image::new(&gpu.device, size, "views", wgpu::TextureFormat::Rgba32Float),
            frames: 0,
        })
    }

    /// The next frame is the first, and has no last one to start from.
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
        // Otherwise a buffer serves all bounces in turn.
        let (bounce, bounces) =
            if keeps_solutions { (task.bounce, task.settings.reflection.bounces as usize) } else { (0, 1) };
        // Solutions that are the next seeds must not be searched for twice.
        let solve_once = settings.solve_once || keeps_solutions;
        if keeps_solutions && self.frames == 0 && task.bounce == 0 {
            forward.forget();
        }
        forward.reserve(recorder.gpu, task, rounds, bounce, bounces)?;
        self.label(recorder, task)?;
        forward.clear(recorder);
        recorder.clear(&self.endings);
        for round in 0..rounds {
            self.solve(recorder, forward, task, round, bounce, task.bounce == 0)?;
            forward.depth(recorder, task, round, bounce)?;
        }
        for round in 0..rounds {
            if !solve_once {
                self.solve(recorder, forward, task, round, bounce, false)?;
            }
            forward.visibility(recorder, task, round, bounce)?;
        }
        forward.close(recorder, task)?;
        if task.bounce == 0 {
            let resources = [
                self.curvature.as_entire_binding(),
                self.mirror_pixels.as_entire_binding(),
                self.endings.as_entire_binding(),
                self.views.bind(),
            ];
            recorder.over_pixels(&passes::SSCR_VIEWS, &[], task.supply, &resources)?;
            self.frames = self.frames.wrapping_add(1);
        }
        Ok(())
    }

    /// Curvature map, labels, regions.
    fn label(&self, recorder: &mut Recorder<'_>, task: &Task<'_>) -> Result<()> {
        let inputs = task.supply;
        let [point, normal, eye] = [task.mirror.point.bind(), task.normal.bind(), task.mirror.eye.bind()];
        let [curvature, parents, sizes, runs, totals, regions, mirror_pixels] =
            [&self.curvature, &self.parents, &self.sizes, &self.runs, &self.totals, &self.regions, &self.mirror_pixels]
                .map(wgpu::Buffer::as_entire_binding);
        let surface = [point.clone(), normal.clone(), eye.clone(), curvature.clone()];
        let switches = [("from_camera", u32::from(task.bounce == 0))];
        recorder.over_pixels(&passes::CURVATURE, &switches, inputs, &surface)?;
        for (along_columns, lines) in [(0, self.size[1]), (1, self.size[0])] {
            let switches = [("along_columns", along_columns)];
            let groups = [lines.div_ceil(64), 1, 1];
            recorder.over(&passes::CURVATURE_SMOOTH, &switches, inputs, std::slice::from_ref(&curvature), groups)?;
        }
        recorder.over_pixels(&passes::LABEL_START, &[], inputs, &[curvature, parents.clone(), sizes.clone()])?;
        recorder.over_pixels(&passes::LABEL_JOIN, &[], inputs, std::slice::from_ref(&parents))?;
        recorder.over_pixels(&passes::LABEL_FLATTEN, &[], inputs, &[parents.clone(), sizes.clone()])?;
        let groups = [(self.size[0] * self.size[1]).div_ceil(RUN_PIXELS), 1, 1];
        let resources = [parents.clone(), sizes.clone(), runs.clone()];
        recorder.over(&passes::REGION_COUNT, &[], inputs, &resources, groups)?;
        let switches = [("count_regions", u32::from(task.bounce == 0))];
        let resources = [runs.clone(), totals, task.counters.as_entire_binding()];
        recorder.over(&passes::REGION_SCAN, &switches, inputs, &resources, [1, 1, 1])?;
        let resources = [parents.clone(), sizes.clone(), runs, regions.clone()];
        recorder.over(&passes::REGION_NUMBER, &[], inputs, &resources, groups)?;
        let switches = [("bound_rays", u32::from(task.settings.sscr.cull_points))];
        let resources = [point, normal, eye, parents, sizes, regions, mirror_pixels];
        recorder.over_pixels(&passes::REGION_ASSIGN, &switches, inputs, &resources)
    }

    /// Searches for the pixel of each point, in the region that is drawn for it in this round.
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
            ("weighted", u32::from(settings.distribution == Distribution::Weighted)),
            ("cull", u32::from(settings.cull_points)),
            ("count_points", u32::from(is_counted)),
            ("record_endings", u32::from(is_counted && records)),
        ];
        // Points that were not found are tried elsewhere in the next frame, if it starts from this one's.
        let frame = if settings.seeds == Seeds::LastFrame { self.frames } else { 0 };
        let draw = frame.wrapping_mul(settings.regions_per_point).wrapping_add(round);
        // Any odd number spreads the draws over the seeds.
        let seed = draw.wrapping_mul(0x9e37_79b9) ^ (task.bounce as u32);
        let uniform = recorder.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("round"),
            size: 16,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        recorder.gpu.queue.write_buffer(&uniform, 0, bytemuck::cast_slice(&[draw, seed, 0, 0]));
        recorder.over_points_by_page(&passes::SSCR_SOLVE, &switches, task.supply, |page| {
            Some(vec![
                uniform.as_entire_binding(),
                self.mirror_pixels.as_entire_binding(),
                self.regions.as_entire_binding(),
                self.totals.as_entire_binding(),
                forward.bind_solutions(page, round, bounce)?,
                task.counters.as_entire_binding(),
                self.endings.as_entire_binding(),
            ])
        })
    }
}
