//! Compiles passes when they are first needed, records them, and times them: each by GPU timestamps in few submits, each by
//! the host's clock around a submit of its own, or together by the host's clock.

use std::collections::{HashMap, VecDeque};
use std::sync::Arc;
use std::time::Instant;

use cloud::Progress;
use scene::Settings;

use crate::gpu::{Clock, Error, Gpu, PipelineKey, Result};
use crate::handed::{Handed, MOST_PASSES};
use crate::inputs::{Inputs, PageInputs};
use crate::layout::{Page, Run};
use crate::pass_times::{PassTime, Times, summed};
use crate::passes::{self, Bindings, Blocks, Compiled, Pages, Pass, PassStage, Pixels};
use crate::pieces::{LONGEST_ON_GPU, MOST_AHEAD, TOO_LONG, UNKNOWN_TOGETHER, piece_of, pieces_of};
use crate::store::draw_list::Cover;
use crate::targets::{GBuffer, Image, uniform_buffer};
use crate::together::Together;

/// The values of a shader's `override` constants.
pub(crate) type Switches<'a> = &'a [(&'static str, u32)];

/// The passes compiled so far, by name and switches.
pub(crate) type Pipelines = HashMap<PipelineKey, Compiled>;

/// A pass and the values of its switches.
pub(crate) type Variant = (&'static Pass, Vec<(&'static str, u32)>);

/// What a rehearsal does with the passes of a frame.
pub(crate) enum Rehearsal {
    /// Collects the passes that are not compiled, and runs none.
    Collect(Vec<Variant>),
    /// Runs them, and counts those that have run.
    Count(Arc<Progress>),
}

pub(crate) struct Recorder<'a> {
    pub gpu: &'a Gpu,
    pipelines: &'a mut Pipelines,
    /// The settings decide how much passes do.
    settings: &'a Settings,
    began: Instant,
    encoder: wgpu::CommandEncoder,
    /// The timestamps of the passes, if the GPU times them.
    queries: Option<wgpu::QuerySet>,
    /// Whether each pass is submitted and waited for, because the host's clock times it.
    submits_each: bool,
    /// The passes that the GPU times.
    timed: Vec<Timed>,
    /// The passes that the host's clock times together, if it does.
    together: Option<Together>,
    /// The time of all passes that the host's clock has timed together.
    together_milliseconds: f64,
    /// How often the frame has waited for the GPU.
    waits: u32,
    /// The milliseconds that what is recorded and not submitted is estimated to take.
    recorded: f64,
    /// What was submitted and may still run, and the milliseconds that it is estimated to take.
    ahead: VecDeque<(wgpu::SubmissionIndex, f64)>,
    /// The time of splatting what the camera sees, as far as the host's clock times it.
    splatting: f64,
    host_times: Vec<PassTime>,
    failure: Option<Error>,
    /// Once set, the frame is given up before its next pass.
    given_up: Option<&'a dyn Fn() -> bool>,
    /// The most milliseconds that a dispatch is meant to take where a frame may be given up.
    longest_piece: f64,
    /// The number of dispatches so far.
    dispatches: u32,
    rehearsal: Option<&'a mut Rehearsal>,
    /// The name and stage under which passes are timed; `None` for their own.
    timed_as: Option<Name>,
}

/// Says whether a frame is given up, because another one is wanted.
pub type IsGivenUp = dyn Fn() -> bool + Send + Sync;

/// The name and stage under which a pass is timed.
type Name = (&'static str, PassStage);

/// A pass that the GPU times.
struct Timed {
    name: Name,
    /// Whether it splats what the camera sees.
    splats: bool,
    /// The pass and its switches.
    variant: PipelineKey,
    /// The number of its workgroups.
    groups: f64,
}

/// The name and stage for clearing buffers, where the host's clock times it.
const CLEAR: Name = ("clear", PassStage::Surface);

/// One dispatch: the switches of the pass, its bind groups in order, and the workgroups.
type Dispatch<'r> = (Vec<(&'static str, u32)>, Vec<Vec<wgpu::BindingResource<'r>>>, [u32; 3]);

impl<'a> Recorder<'a> {
    pub fn new(gpu: &'a Gpu, pipelines: &'a mut Pipelines, settings: &'a Settings) -> Self {
        let encoder = gpu.device.create_command_encoder(&Default::default());
        Self {
            gpu,
            pipelines,
            settings,
            began: Instant::now(),
            encoder,
            queries: None,
            submits_each: gpu.clock == Clock::Host,
            timed: Vec::new(),
            together: None,
            together_milliseconds: 0.0,
            waits: 0,
            recorded: 0.0,
            ahead: VecDeque::new(),
            splatting: 0.0,
            host_times: Vec::new(),
            failure: None,
            given_up: None,
            longest_piece: f64::INFINITY,
            dispatches: 0,
            rehearsal: None,
            timed_as: None,
        }
    }

    /// Times the passes, where the GPU does, into what `finish_frame` gets.
    pub fn time_into(&mut self, handed: &Handed) {
        self.queries = handed.queries().cloned();
    }

    /// Where the host's clock times the passes of a GPU: lets it time the ones that splat what the camera sees, and all
    /// others, instead of each. A GPU that is waited for after each pass stands idle meanwhile.
    pub fn time_together(&mut self) {
        if self.submits_each && self.gpu.is_watched {
            self.submits_each = false;
            self.together = Some(Together::default());
        }
    }

    /// Ends the frame with `Error::GivenUp` before the next pass once `is_given_up` says so. Passes that took longer than
    /// `longest_piece` milliseconds are cut into several.
    pub fn give_up_when(&mut self, is_given_up: Option<&'a dyn Fn() -> bool>, longest_piece: f64) {
        self.given_up = is_given_up;
        self.longest_piece = longest_piece;
    }

    /// Makes the frame a rehearsal.
    pub fn rehearse(&mut self, rehearsal: Option<&'a mut Rehearsal>) {
        // What only collects passes submits nothing.
        self.submits_each &= !matches!(rehearsal, Some(Rehearsal::Collect(_)));
        self.rehearsal = rehearsal;
    }

    /// Times the following passes together under this name and stage, or each under its own for `None`. So the camera's
    /// view and other uses of the same splatting passes are told apart.
    pub fn time_as(&mut self, name: Option<Name>) {
        self.timed_as = name;
    }

    /// Between parts of long work on the CPU.
    ///
    /// # Errors
    /// The frame is given up.
    pub fn go_on(&self) -> Result<()> {
        if self.given_up.is_some_and(|is_given_up| is_given_up()) { Err(Error::GivenUp) } else { Ok(()) }
    }

    pub fn clear(&mut self, buffer: &wgpu::Buffer) {
        self.clear_part(buffer, 0..buffer.size());
    }

    /// Clears a range of bytes.
    pub fn clear_part(&mut self, buffer: &wgpu::Buffer, bytes: std::ops::Range<u64>) {
        self.encoder.clear_buffer(buffer, bytes.start, Some(bytes.end - bytes.start));
        if self.submits_each {
            self.submit(CLEAR);
        }
    }

    /// Runs a pass over the pixels of the picture.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_pixels<'r, B: Bindings<'r, Over = Pixels>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
    ) -> Result<()> {
        self.over(switches, inputs, bindings, inputs.pixel_groups())
    }

    /// Runs a pass over the pixels where mirrors may be seen.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_mirrors<'r, B: Bindings<'r, Over = Pixels>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
    ) -> Result<()> {
        self.over(switches, inputs, bindings, inputs.mirror_groups())
    }

    /// Copies the first word of a buffer to a place in another. With the host's clock its time counts towards the
    /// following pass.
    pub fn copy_word(&mut self, from: &wgpu::Buffer, (to, byte): (&wgpu::Buffer, u64)) {
        self.encoder.copy_buffer_to_buffer(from, 0, to, byte, 4);
    }

    /// Copies an image. With the host's clock its time counts towards the following pass.
    pub fn copy(&mut self, from: &Image, to: &Image) {
        self.encoder.copy_texture_to_texture(
            from.texture.as_image_copy(),
            to.texture.as_image_copy(),
            from.texture.size(),
        );
    }

    /// Copies the images of the surface that the camera sees.
    pub fn copy_surface(&mut self, from: &GBuffer, to: &GBuffer) {
        for (from, to) in [(&from.albedo, &to.albedo), (&from.normal, &to.normal), (&from.depth, &to.depth)] {
            self.copy(from, to);
        }
    }

    /// Copies the same range of bytes of two buffers.
    pub fn copy_part(&mut self, from: &wgpu::Buffer, to: &wgpu::Buffer, bytes: std::ops::Range<u64>) {
        self.encoder.copy_buffer_to_buffer(from, bytes.start, to, bytes.start, bytes.end - bytes.start);
    }

    /// Runs a pass with the given number of workgroups.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over<'r, B: Bindings<'r, Over = Pixels>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
        groups: [u32; 3],
    ) -> Result<()> {
        let bound = vec![inputs.frame_resources().to_vec(), bindings.resources()];
        self.dispatch(B::PASS, vec![(switches.to_vec(), bound, groups)])
    }

    /// Runs a pass by rows of workgroups, or by parts of rows, so that a frame can be given up between them. Its shader takes
    /// its thread from `whole_thread` (shaders/shared/frame.wgsl), or adds `first_column` and `first_row` to its workgroup's.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn by_rows<'r, B: Bindings<'r, Over = Pixels>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
        [x, y, z]: [u32; 3],
    ) -> Result<()> {
        let [columns, rows] = piece_of([x, y], self.pieces(B::PASS, switches, [x, y, z]));
        let row = |first_row: u32| (0..x.max(1)).step_by(columns as usize).map(move |first| [first, first_row]);
        let firsts: Vec<[u32; 2]> = (0..y.max(1)).step_by(rows as usize).flat_map(row).collect();
        let frames: Vec<wgpu::Buffer> = firsts.iter().map(|first| inputs.frame_from(self.gpu, *first, x)).collect();
        let [_, settings] = inputs.frame_resources();
        let resources: Vec<wgpu::BindingResource<'_>> = bindings.resources();
        let mut dispatches: Vec<Dispatch<'_>> = Vec::new();
        for ([first_column, first_row], frame) in firsts.iter().zip(&frames) {
            let bound = vec![vec![frame.as_entire_binding(), settings.clone()], resources.clone()];
            dispatches.push((switches.to_vec(), bound, [columns.min(x - first_column), rows.min(y - first_row), z]));
        }
        self.dispatch(B::PASS, dispatches)
    }

    /// Returns into how many pieces to cut a pass, so that none takes long and the frame can be given up between them.
    /// What a pass does must not depend on it.
    fn pieces(&self, pass: &Pass, switches: Switches<'_>, groups: [u32; 3]) -> u32 {
        if !self.is_cut() {
            return 1;
        }
        let load = (pass.load)(self.settings);
        let each = self.estimate(&(pass.name, switches.to_vec()));
        let longest = if self.submits_each && self.given_up.is_some() { self.longest_piece } else { LONGEST_ON_GPU };
        pieces_of(each, load, groups.map(f64::from).iter().product(), longest, self.gpu.is_watched)
    }

    /// The most milliseconds that a workgroup of a pass is known to take; `None` if nobody has timed it.
    fn estimate(&self, pass: &PipelineKey) -> Option<f64> {
        self.pipelines.get(pass).and_then(|compiled| compiled.estimate(self.settings))
    }

    /// Whether long passes are cut into pieces: where a frame may be given up between them, and on a GPU.
    fn is_cut(&self) -> bool {
        self.rehearsal.is_none() && (self.submits_each && self.given_up.is_some() || self.gpu.is_watched)
    }

    /// Submits what is recorded if it is estimated to take long, without waiting for it.
    fn submit_long(&mut self, each: Option<f64>, groups: f64) {
        self.recorded += each.map_or(LONGEST_ON_GPU / UNKNOWN_TOGETHER, |each| each * groups);
        if self.recorded >= LONGEST_ON_GPU {
            self.submit_recorded();
        }
    }

    /// Submits what is recorded, without waiting for it.
    fn submit_recorded(&mut self) {
        if let Some(together) = &mut self.together {
            together.since.get_or_insert_with(Instant::now);
        }
        let next = self.gpu.device.create_command_encoder(&Default::default());
        let submitted = self.gpu.queue.submit([std::mem::replace(&mut self.encoder, next).finish()]);
        self.ahead.push_back((submitted, std::mem::take(&mut self.recorded)));
        self.wait_for_oldest();
    }

    /// Where the frame may be given up: waits for what was submitted first until no more than `MOST_AHEAD` is left for the
    /// GPU to do, because what is submitted cannot be taken back.
    fn wait_for_oldest(&mut self) {
        while self.given_up.is_some() && self.ahead.iter().map(|(_, estimated)| estimated).sum::<f64>() > MOST_AHEAD {
            let Some((submitted, _)) = self.ahead.pop_front() else { return };
            if let Err(error) = self.gpu.wait_for(submitted) {
                self.failure.get_or_insert(error);
            }
            self.waits += 1;
        }
    }

    /// Ends the passes that are timed together where the following pass is to be timed apart from them: the other ones
    /// splat what the camera sees, or nobody knows how long it takes.
    fn begin_together(&mut self, splats: bool, is_known: bool) {
        let Some(together) = &self.together else { return };
        if !together.passes.is_empty() && (together.splats != splats || !is_known) {
            self.end_together();
        }
        if let Some(together) = &mut self.together {
            together.splats = splats;
        }
    }

    /// Submits the passes that are timed together, and waits for them. Returns their milliseconds.
    fn end_together(&mut self) -> f64 {
        self.submit_recorded();
        if let Err(error) = self.gpu.wait() {
            self.failure.get_or_insert(error);
        }
        self.waits += 1;
        self.ahead.clear();
        let Some(together) = self.together.replace(Together::default()) else { return 0.0 };
        let milliseconds = together.learn(self.pipelines, self.settings);
        self.together_milliseconds += milliseconds;
        self.splatting += if together.splats { milliseconds } else { 0.0 };
        milliseconds
    }

    /// Finds the nearest point of each pixel, with atomics of the adapter's width.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn nearest_points(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        nearest: wgpu::BindingResource<'_>,
        atomics64: bool,
    ) -> Result<()> {
        if !atomics64 {
            for run in two_runs(self.gpu) {
                let (nearest, run) = (nearest.clone(), run.as_entire_binding());
                self.over_points(switches, inputs, passes::splat_narrow { nearest, run })?;
            }
            return Ok(());
        }
        if self.gpu.reads_atomics64 {
            self.over_points(switches, inputs, passes::splat_nearest { nearest })
        } else {
            self.over_points(switches, inputs, passes::splat_nearest_blind { nearest })
        }
    }

    /// Runs a pass over the blocks of each page of points.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_points<'r, B: Bindings<'r, Over = Blocks>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
    ) -> Result<()> {
        self.over_points_by_page(switches, inputs, |_| Some(bindings.clone()))
    }

    /// Runs a pass over the blocks of each page of points; `bindings` returns the bindings for a page, or `None` to
    /// skip it.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_points_by_page<'r, B: Bindings<'r, Over = Blocks>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: impl Fn(&PageInputs) -> Option<B>,
    ) -> Result<()> {
        let mut parts = Vec::new();
        for (page, list) in inputs.pages.iter().flat_map(|page| page.lists.iter().map(move |list| (page, list))) {
            let Some(bindings) = bindings(page) else { continue };
            let mut switches = switches.to_vec();
            switches.push(("pixels_only", u32::from(list.cover == Cover::Pixels)));
            if list.shares && B::PASS.has_large_discs() && !switches.contains(&("shares", 1)) {
                switches.push(("shares", 1));
            }
            switches.push(("hides_points", u32::from(inputs.hides_points)));
            let together = list.blocks_per_workgroup;
            let pieces = self.pieces(B::PASS, &switches, [list.workgroups, 1, 1]);
            let blocks = list.workgroups.div_ceil(pieces) * together;
            let Page { runs_at, run_count, .. } = list.values;
            for first in (0..run_count).step_by(blocks as usize) {
                let count = blocks.min(run_count - first);
                let part = Page { runs_at: runs_at + first, run_count: count, ..list.values };
                let part = (count < run_count).then(|| uniform_buffer(self.gpu, bytemuck::bytes_of(&part)));
                let workgroups = count.div_ceil(together);
                // The limit is 65,535 workgroups per dimension.
                let x = workgroups.clamp(1, 32_768);
                let groups = [x, workgroups.div_ceil(x), 1];
                parts.push((page, part, &list.page, switches.clone(), bindings.clone(), groups));
            }
        }
        let dispatches = parts.iter().map(|(page, part, whole, switches, bindings, groups)| {
            let page = inputs.page_resources(page, part.as_ref().unwrap_or(whole)).to_vec();
            (switches.clone(), vec![inputs.frame_resources().to_vec(), page, bindings.clone().resources()], *groups)
        });
        let dispatches = dispatches.collect();
        self.dispatch(B::PASS, dispatches)
    }

    /// Runs a pass once for each page of points, with the given number of workgroups.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_page_pixels<'r, B: Bindings<'r, Over = Pages>>(
        &mut self,
        inputs: &Inputs,
        bindings: B,
        groups: [u32; 3],
    ) -> Result<()> {
        self.over_pages(&[], inputs, bindings, groups)
    }

    /// Runs a pass over pages, with switches.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn over_pages<'r, B: Bindings<'r, Over = Pages>>(
        &mut self,
        switches: Switches<'_>,
        inputs: &Inputs,
        bindings: B,
        groups: [u32; 3],
    ) -> Result<()> {
        let resources = bindings.resources();
        let dispatches = inputs.pages.iter().map(|page| {
            let page = inputs.page_resources(page, &page.page).to_vec();
            (switches.to_vec(), vec![inputs.frame_resources().to_vec(), page, resources.clone()], groups)
        });
        let dispatches = dispatches.collect();
        self.dispatch(B::PASS, dispatches)
    }

    /// Runs the dispatches of a pass, or one after the other if long passes are cut.
    fn dispatch(&mut self, pass: &'static Pass, dispatches: Vec<Dispatch<'_>>) -> Result<()> {
        if self.is_cut() && dispatches.len() > 1 {
            return dispatches.into_iter().try_for_each(|dispatch| self.dispatch(pass, vec![dispatch]));
        }
        self.go_on()?;
        // Metal has no times for a pass without work.
        if dispatches.is_empty() {
            return Ok(());
        }
        if let Some(Rehearsal::Collect(missing)) = self.rehearsal.as_deref_mut() {
            for (switches, ..) in dispatches {
                let is_known = missing.iter().any(|(known, values)| known.name == pass.name && *values == switches);
                if !is_known && !self.pipelines.contains_key(&(pass.name, switches.clone())) {
                    missing.push((pass, switches));
                }
            }
            return Ok(());
        }
        for (switches, ..) in &dispatches {
            let key = (pass.name, switches.clone());
            if !self.pipelines.contains_key(&key) {
                let compiled = Compiled::new(self.gpu, pass, switches).map_err(Error::Shader)?;
                self.pipelines.insert(key, compiled);
            }
        }
        self.refuse_long(pass, &dispatches)?;
        let variant = dispatches.first().map(|(switches, ..)| (pass.name, switches.clone()));
        let pipelines = &*self.pipelines;
        let bind = |(switches, bound, groups): Dispatch<'_>| {
            let compiled = &pipelines[&(pass.name, switches)];
            let bind = |(group, resources): (usize, &Vec<_>)| compiled.bind(&self.gpu.device, group, resources);
            (compiled.pipeline().clone(), bound.iter().enumerate().map(bind).collect::<Vec<_>>(), groups)
        };
        let bound: Vec<_> = dispatches.into_iter().map(bind).collect();
        let splats = self.timed_as.is_none() && pass.stage == PassStage::Surface && pass.is_over_points;
        let groups: f64 = bound.iter().map(|(.., groups)| groups.map(f64::from).iter().product::<f64>()).sum();
        let Some(variant) = variant else { return Ok(()) };
        let each = self.estimate(&variant);
        self.begin_together(splats, each.is_some());
        let first = self.timed.len() as u32 * 2;
        let queries = self.queries.as_ref().filter(|_| first < MOST_PASSES * 2);
        let timestamp_writes = queries.map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        });
        let mut compute =
            self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(pass.name), timestamp_writes });
        for (pipeline, groups, [x, y, z]) in &bound {
            compute.set_pipeline(pipeline);
            for (index, group) in groups.iter().enumerate() {
                compute.set_bind_group(index as u32, group, &[]);
            }
            compute.dispatch_workgroups(*x, *y, *z);
        }
        self.dispatches += bound.len() as u32;
        drop(compute);
        if first < MOST_PASSES * 2 {
            let name = self.timed_as.unwrap_or((pass.name, pass.stage));
            self.timed.push(Timed { name, splats, variant: variant.clone(), groups });
        }
        if let (Some(together), Some(each)) = (&mut self.together, each) {
            together.passes.insert(variant.clone());
            together.estimated += each * groups;
        }
        let is_timed_apart = self.submits_each || self.together.is_some() && each.is_none();
        if !is_timed_apart && self.is_cut() {
            self.submit_long(each, groups);
        }
        if is_timed_apart {
            let milliseconds = if self.submits_each {
                let milliseconds = self.submit((pass.name, pass.stage));
                self.splatting += if splats { milliseconds } else { 0.0 };
                milliseconds
            } else {
                self.end_together()
            };
            if let Some(compiled) = self.pipelines.get_mut(&variant) {
                compiled.learn(milliseconds, groups, self.settings, self.rehearsal.is_none());
            }
        }
        if let Some(Rehearsal::Count(progress)) = self.rehearsal.as_deref() {
            progress.add(1);
        }
        Ok(())
    }

    /// Refuses dispatches after which the system would reset the GPU, as far as their pass has been timed.
    fn refuse_long(&mut self, pass: &Pass, dispatches: &[Dispatch<'_>]) -> Result<()> {
        if !self.gpu.refuses_long || self.rehearsal.is_some() {
            return Ok(());
        }
        for (switches, _, groups) in dispatches {
            let Some(compiled) = self.pipelines.get_mut(&(pass.name, switches.clone())) else { continue };
            let Some(each) = compiled.estimate(self.settings) else { continue };
            let milliseconds = each * groups.map(f64::from).iter().product::<f64>();
            if milliseconds > TOO_LONG {
                // Other programs may have slowed down the frame that taught it: half is believed, and the next frame tries.
                compiled.doubt();
                let adapter = self.gpu.info.name.clone();
                return Err(Error::TooLong { pass: pass.name, seconds: milliseconds / 1000.0, adapter });
            }
        }
        Ok(())
    }

    /// Returns the time in milliseconds.
    fn submit(&mut self, name: Name) -> f64 {
        let encoder = std::mem::replace(&mut self.encoder, self.gpu.device.create_command_encoder(&Default::default()));
        let commands = encoder.finish();
        let (name, stage) = self.timed_as.unwrap_or(name);
        self.waits += 1;
        let start = Instant::now();
        self.gpu.queue.submit([commands]);
        if let Err(error) = self.gpu.wait() {
            self.failure.get_or_insert(error);
        }
        let milliseconds = start.elapsed().as_secs_f64() * 1000.0;
        self.host_times.push(PassTime { name, stage, milliseconds });
        milliseconds
    }

    /// Waits for what is recorded so far, and reads a buffer; `None` in a rehearsal that runs nothing.
    ///
    /// # Errors
    /// The device was lost.
    pub fn read(&mut self, buffer: &wgpu::Buffer) -> Result<Option<Vec<u8>>> {
        if matches!(self.rehearsal, Some(Rehearsal::Collect(_))) {
            return Ok(None);
        }
        // What the CPU does with it is no time of the passes.
        if self.together.is_some() {
            self.end_together();
        }
        self.submit_recorded();
        self.waits += 1;
        self.gpu.read_buffer(buffer, 0, buffer.size()).map(Some)
    }

    /// Waits for what is recorded.
    ///
    /// # Errors
    /// The device was lost.
    pub fn finish(self) -> Result<()> {
        if let Some(error) = self.failure {
            return Err(error);
        }
        self.gpu.queue.submit([self.encoder.finish()]);
        self.gpu.wait()
    }

    /// Waits for the frame, and leaves its picture, its counters and its exposure in `handed`. Returns the times of the passes;
    /// where these are timed together, that of the copies is among them.
    ///
    /// # Errors
    /// The device was lost.
    pub fn finish_frame(
        self,
        handed: &mut Handed,
        counters: &wgpu::Buffer,
        exposure: &wgpu::Buffer,
        picture: &Image,
    ) -> Result<Times> {
        if let Some(error) = self.failure {
            return Err(error);
        }
        if matches!(self.rehearsal, Some(Rehearsal::Collect(_))) {
            return Err(Error::GivenUp);
        }
        let timed = self.queries.as_ref().map_or(0, |_| self.timed.len() as u32);
        let (waits, dispatches) = (self.waits + 1, self.dispatches);
        if let Some(mut together) = self.together {
            together.since.get_or_insert_with(Instant::now);
            handed.take(self.gpu, self.encoder, 0, [counters, exposure], picture)?;
            let milliseconds = together.learn(self.pipelines, self.settings);
            let splatting = self.splatting + if together.splats { milliseconds } else { 0.0 };
            let total = self.together_milliseconds + milliseconds;
            return Ok(Times { passes: Vec::new(), total, splatting, dispatches, waits });
        }
        let ticks = handed.take(self.gpu, self.encoder, timed, [counters, exposure], picture)?;
        if self.submits_each {
            let total = self.host_times.iter().map(|time| time.milliseconds).sum();
            return Ok(Times { passes: summed(self.host_times), total, splatting: self.splatting, dispatches, waits });
        }
        let to_milliseconds = f64::from(self.gpu.queue.get_timestamp_period()) * 1e-6;
        let span = |from: u64, to: u64| to.saturating_sub(from) as f64 * to_milliseconds;
        let pairs = self.timed.iter().zip(ticks.chunks_exact(2));
        let mut splatting = 0.0;
        let pipelines = self.pipelines;
        let counts = self.rehearsal.is_none();
        let time = |(timed, pair): (&Timed, &[u64])| {
            let milliseconds = span(pair[0], pair[1]);
            splatting += if timed.splats { milliseconds } else { 0.0 };
            if let Some(compiled) = pipelines.get_mut(&timed.variant) {
                compiled.learn(milliseconds, timed.groups, self.settings, counts);
            }
            let (name, stage) = timed.name;
            PassTime { name, stage, milliseconds }
        };
        let passes = summed(pairs.map(time).collect());
        // The GPU does not time the last passes of a long frame.
        let is_whole = timed < MOST_PASSES;
        let by_gpu = ticks.first().zip(ticks.last()).filter(|_| is_whole).map(|(first, last)| span(*first, *last));
        let by_host = || if is_whole { 0.0 } else { self.began.elapsed().as_secs_f64() * 1e3 };
        let total = by_gpu.unwrap_or_else(by_host);
        Ok(Times { passes, total, splatting, dispatches, waits })
    }
}

/// What makes a pass run for depths, and then for identities.
pub(crate) fn two_runs(gpu: &Gpu) -> [wgpu::Buffer; 2] {
    [0, 1].map(|finds_identity| uniform_buffer(gpu, bytemuck::bytes_of(&Run { finds_identity, ..Run::default() })))
}
