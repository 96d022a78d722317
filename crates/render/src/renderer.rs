//! Renders a frame: runs the passes in their order on its images, and measures their time.

mod around;
mod chapters;
mod failure;
mod plan;
mod request;
mod stats;

use std::sync::Arc;

use cloud::Progress;
use scene::{Quality, Settings, Tone};

use crate::caustics::Caustics;
use crate::exposure::{Exposure, ExposureMeter};
use crate::frame::FrameCamera;
use crate::gi::GlobalIllumination;
use crate::gpu::{Error, Gpu, Result};
use crate::handed::Handed;
use crate::identities::Identities;
use crate::inputs::Inputs;
use crate::layout::{CARRY_BYTES, COLOR_SUM_BYTES, SPECULAR_WORDS, SURFACE_SUM_BYTES};
use crate::light_rays::LightRays;
use crate::lighting::{DrawnMap, Lights};
use crate::pass_times::Times;
use crate::recorder::{IsGivenUp, Pipelines, Recorder, Rehearsal};
use crate::reflection::kept_hits::GlossCache;
use crate::reflection::{self, Reflections};
use crate::rehearsal::Cast;
use crate::store::PointStore;
use crate::store::draw_list::DrawList;
use crate::targets::{Image, Targets, storage};
use chapters::Samples;
use plan::{Before, Plan, PointInputs, SurfaceInputs};

pub(crate) use plan::{Lit, Summed, SummedLight};
pub use request::{Effort, Frame};
pub use stats::FrameStats;

/// Renders frames, one at a time, on any thread.
pub struct Renderer {
    pub(crate) gpu: Arc<Gpu>,
    pub(crate) pipelines: Pipelines,
    pub(crate) handed: Handed,
    pub(crate) targets: Option<Targets>,
    pub(crate) reflections: Option<Reflections>,
    pub(crate) lights: Lights,
    /// The inputs from which the current surfaces and reflections were made.
    made_from: Option<SurfaceInputs>,
    /// Whether the last frame ended before it was drawn.
    is_unfinished: bool,
    /// The inputs from which the surfaces of the points were made. They stay when a frame is given up after them.
    splatted_from: Option<PointInputs>,
    kept_shadows: Vec<DrawnMap>,
    /// What the last frame has summed of its samples of mirrors.
    pub(crate) summed: Option<Summed>,
    pub(crate) gi: GlobalIllumination,
    pub(crate) caustics: Caustics,
    /// The rays of light of the last frame, and how many of each pixel they sum; `None` if there were none.
    light_rays: Option<LightRays>,
    summed_rays: Option<Summed>,
    /// What the indirect light of the last frame came from; `None` if it had none.
    pub(crate) lit: Option<Lit>,
    /// Many virtual lights, against which the light of a few is judged.
    pub(crate) many_lights: GlobalIllumination,
    /// The camera of the last frame.
    pub(crate) camera: Option<FrameCamera>,
    /// How the last frame's picture was mapped.
    tone: Tone,
    pub(crate) is_filmic: bool,
    pub(crate) exposure: ExposureMeter,
    /// The identities that points had when the last frame was drawn.
    pub(crate) drawn: Arc<Identities>,
    pub(crate) given_up: Option<Arc<IsGivenUp>>,
    /// See `cut_passes`.
    pub(crate) longest_piece: f64,
    /// What `prepare` has compiled for.
    pub(crate) prepared: Vec<Cast>,
}

/// The outcome of a frame whose passes have run.
struct Record {
    times: Times,
    shadows: Vec<DrawnMap>,
    samples: Samples,
    rays: Option<Summed>,
}

impl Renderer {
    /// Compiles the passes that every picture needs on a GPU. Others, and all where the adapter is a processor, are
    /// compiled by `prepare`, or when they are first needed.
    ///
    /// # Errors
    /// A shader is refused, or the device is lost.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self> {
        // A single picture has one of two qualities, and compiling the other's passes takes a processor 0.2 s.
        if gpu.is_processor() { Ok(Self::bare(gpu)) } else { Self::with_progress(gpu, &Arc::default()) }
    }

    /// Compiles the passes that every picture needs, for seconds on software Vulkan, so call this off the window's
    /// thread; `progress` is that which `prepare` counts.
    ///
    /// # Errors
    /// Those of `new`.
    pub fn with_progress(gpu: Arc<Gpu>, progress: &Arc<Progress>) -> Result<Self> {
        let mut renderer = Self::bare(gpu);
        renderer.warm_up(progress)?;
        Ok(renderer)
    }

    /// A renderer that has compiled nothing.
    pub(crate) fn bare(gpu: Arc<Gpu>) -> Self {
        let lights = Lights::new(&gpu);
        let handed = Handed::new(&gpu);
        let exposure = ExposureMeter::new(&gpu);
        Self {
            gpu,
            pipelines: Pipelines::new(),
            handed,
            targets: None,
            reflections: None,
            lights,
            made_from: None,
            is_unfinished: false,
            splatted_from: None,
            kept_shadows: Vec::new(),
            summed: None,
            gi: GlobalIllumination::default(),
            caustics: Caustics::default(),
            light_rays: None,
            summed_rays: None,
            lit: None,
            many_lights: GlobalIllumination::default(),
            camera: None,
            tone: Tone::default(),
            is_filmic: false,
            exposure,
            drawn: Arc::default(),
            given_up: None,
            longest_piece: 25.0,
            prepared: Vec::new(),
        }
    }

    /// Forgets everything that is kept between frames, so that the next frame is made from scratch. For measurements.
    pub fn forget(&mut self) {
        self.forget_all_but_shadow_maps();
        self.kept_shadows.clear();
        self.gi.forget();
    }

    /// Forgets what is kept between frames as `forget` does, but for the shadow maps of lamps and virtual lights, which
    /// stay for a frame that needs the same ones. For measurements of what needs no other shadow maps.
    pub fn forget_all_but_shadow_maps(&mut self) {
        (self.made_from, self.splatted_from) = (None, None);
        if let Some(reflections) = &mut self.reflections {
            reflections.forget();
            reflections.forget_hits();
        }
        self.gi.keeper.forget();
        if let Some(rays) = &mut self.light_rays {
            rays.forget();
        }
        self.caustics.forget();
        self.exposure.is_used = false;
    }

    /// Lets frames and probes end with `Error::GivenUp` before their next pass once `is_given_up` says so, because
    /// another picture is wanted; it is asked before each pass. The frame after it is made as if that one had not been
    /// begun. Where the GPU times the passes, what is recorded is not waited for, so that a frame is given up only
    /// while it is recorded. Elsewhere long passes are cut into several (`cut_passes`), which changes no picture.
    pub fn give_up_when(&mut self, is_given_up: Option<Arc<IsGivenUp>>) {
        self.given_up = is_given_up;
    }

    /// Sets how many milliseconds a pass over points, of indirect light or of rays is meant to take at most where a
    /// frame can be given up; 25 unless set.
    pub fn cut_passes(&mut self, longest_piece: f64) {
        self.longest_piece = longest_piece;
    }

    /// Renders a frame and waits for it.
    ///
    /// # Errors
    /// A picture too large for the adapter, no more memory, or the device was lost.
    pub fn render(&mut self, store: &PointStore, frame: &Frame<'_>) -> Result<FrameStats> {
        let outcome = self.draw(store, frame, None, None);
        self.checked(outcome)
    }

    /// Renders a frame as `render` does, but asks `is_given_up` in place of what `give_up_when` was given. It may draw
    /// other pictures meanwhile, by other means.
    ///
    /// # Errors
    /// Those of `render`, and `Error::GivenUp`.
    pub fn render_asking(
        &mut self,
        store: &PointStore,
        frame: &Frame<'_>,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<FrameStats> {
        let outcome = self.draw(store, frame, None, Some(is_given_up));
        self.checked(outcome)
    }

    /// Draws a frame, or rehearses it.
    pub(crate) fn draw(
        &mut self,
        store: &PointStore,
        frame: &Frame<'_>,
        rehearsal: Option<&mut Rehearsal>,
        is_given_up: Option<&dyn Fn() -> bool>,
    ) -> Result<FrameStats> {
        let compiled = self.pipelines.len();
        self.resize(frame.size, frame.settings.splat.quality)?;
        let settings = plan::settings_of(store, frame);
        let before = Before {
            made_from: self.made_from.as_ref(),
            splatted_from: self.splatted_from.as_ref(),
            lacks_points: self.reflections.as_ref().is_some_and(|kept| kept.lacks_points(&settings)),
        };
        let plan = Plan::new(store, frame, &settings, &before)?;
        self.begin(&plan);
        let record = self.record(&plan, rehearsal, is_given_up)?;
        let has_compiled = self.pipelines.len() > compiled;
        self.finish(plan, record, has_compiled)
    }

    /// Gives up what a frame replaces. After an error neither half a frame nor the methods' work on it may be kept.
    fn begin(&mut self, plan: &Plan<'_>) {
        let was_unfinished = std::mem::replace(&mut self.is_unfinished, true);
        let Effort { light_may_lag, light_reuse, .. } = plan.effort;
        (self.gi.may_lag, self.gi.keeper.reuse) = (light_may_lag, light_reuse);
        self.caustics.may_lag = light_may_lag;
        if let Some(reflections) = &mut self.reflections {
            reflections.begin(was_unfinished, plan.lacks_points, light_may_lag);
        }
        self.made_from = None;
        if !plan.points_are_kept {
            self.splatted_from = None;
        }
        self.drawn = plan.store.identities().clone();
    }

    /// Records the chapters of a frame, and waits for the GPU.
    fn record(
        &mut self,
        plan: &Plan<'_>,
        rehearsal: Option<&mut Rehearsal>,
        is_given_up: Option<&dyn Fn() -> bool>,
    ) -> Result<Record> {
        let Self { gpu, pipelines, targets: Some(targets), reflections: Some(reflections), .. } = self else {
            return Err(nothing_rendered());
        };
        let (lights, gi, exposure, before) = (&mut self.lights, &mut self.gi, &mut self.exposure, self.summed.take());
        let caustics = &mut self.caustics;
        let mut recorder = Recorder::new(gpu, pipelines, plan.settings);
        recorder.time_into(&self.handed);
        if !plan.effort.times_passes && rehearsal.is_none() {
            recorder.time_together();
        }
        recorder.rehearse(rehearsal);
        let is_given_up = is_given_up.or_else(|| self.given_up.as_deref().map(|asked| asked as _));
        recorder.give_up_when(is_given_up, self.longest_piece);
        let nothing = DrawList::default();
        let points = if plan.points_are_kept { &nothing } else { &plan.points };
        let mut inputs = Inputs::new(gpu, plan.camera, &plan.seen, points);
        let formulas = reflection::upload(gpu, plan.settings, plan.objects.mirrors, plan.camera.eye);
        if !plan.is_kept || plan.shades_last() {
            gi.surfaces_changed(usize::from(plan.surface_is_kept && !plan.fades));
        }

        chapters::surface(&mut recorder, plan, &inputs, targets, formulas.as_ref())?;
        let targets = &*targets;
        let search = || chapters::search(gpu, plan, formulas.clone(), targets);
        let mut search = plan.searches().then(search);
        chapters::mirrors(&mut recorder, plan, search.as_mut(), targets, reflections)?;
        let at_hand = std::mem::take(&mut self.kept_shadows);
        let shadows = chapters::light(&mut recorder, plan, lights, (gi, caustics), reflections, at_hand)?;
        let thrown = caustics.thrown();
        let (kept, rays_before) = (&mut self.light_rays, self.summed_rays.take());
        let rays = chapters::light_rays(
            &mut recorder,
            plan,
            formulas.clone(),
            targets,
            reflections,
            (lights, thrown, gi),
            kept,
            rays_before,
        )?;
        let brought = kept.as_ref().map(|rays| rays.brought(&plan.settings.gi));
        let samples = chapters::shade(
            &mut recorder,
            plan,
            &mut inputs,
            search.as_mut(),
            targets,
            reflections,
            (&*lights, thrown),
            (&mut *gi, brought),
            before,
        )?;
        chapters::show(&mut recorder, plan, &inputs, targets, reflections, (lights, gi), exposure)?;

        let times =
            recorder.finish_frame(&mut self.handed, &reflections.counters, &exposure.fitted, &targets.picture)?;
        gi.keeper.finish();
        if let Some(rays) = kept {
            rays.finish();
        }
        Ok(Record { times, shadows, samples, rays })
    }

    /// Keeps what the next frame may take over, and says what the frame took.
    fn finish(&mut self, plan: Plan<'_>, record: Record, has_compiled: bool) -> Result<FrameStats> {
        let Record { times, shadows, samples: Samples { summed, hits }, rays } = record;
        let gpu_bytes = plan.store.gpu_bytes() + self.bytes();
        let counters = self.handed.counters()?.filter(|_| Reflections::asked(plan.settings) > 0);
        let known_rays = counters.as_ref().filter(|_| hits == GlossCache::Kept);
        let reflections = self.reflections.as_mut().ok_or_else(nothing_rendered)?;
        reflections.end_gloss();
        let reflection = counters.as_ref().map(|counters| reflections.stats(plan.settings, counters));
        let share = |method: &_| reflections.methods.reflected_share(plan.settings, *method, plan.asked.reflected_step);
        let reflected = plan.methods.iter().find_map(share).filter(|_| plan.has_mirrors);
        let virtual_lights = self.gi.lights().filter(|_| plan.has_indirect).map_or(0, |lights| lights.count);
        let stats = FrameStats {
            passes: times.passes,
            frame_milliseconds: times.total,
            splatting_milliseconds: times.splatting,
            points_drawn: plan.points.points,
            points_resident: plan.store.points(),
            gpu_bytes,
            clock: self.gpu.clock,
            has_compiled,
            dispatches: times.dispatches,
            waits: times.waits,
            virtual_lights,
            glossy_samples: [summed.as_ref().map_or(0, |summed| summed.samples), plan.samples],
            light_rays: [rays.as_ref().map_or(0, |summed| summed.samples), plan.rays],
            exposure: None,
            glossy_hits: hits,
            glossy_rays: known_rays.map_or([0; 2], |counters| Reflections::glossy_rays(counters)),
            methods: plan.methods.clone(),
            reflection,
            reflected,
            is_quick: false,
            flip: None,
        };
        (self.tone, self.is_filmic) = (plan.settings.tone.clone(), chapters::is_filmic(&plan));
        (self.lit, self.summed, self.summed_rays, self.kept_shadows) = (plan.lit(), summed, rays, shadows);
        (self.camera, self.splatted_from) = (Some(plan.camera), Some(plan.asked.points.clone()));
        self.made_from = Some(plan.asked);
        self.is_unfinished = false;
        let exposure = self.handed.exposure()?.filter(|_| self.exposure.is_used).map(Exposure::from);
        Ok(FrameStats { exposure, ..stats })
    }

    /// The bytes that frames take on the GPU, without the points.
    fn bytes(&self) -> u64 {
        self.targets.as_ref().map_or(0, Targets::bytes)
            + self.reflections.as_ref().map_or(0, Reflections::bytes)
            + self.lights.shadows.size()
            + self.gi.bytes()
            + self.caustics.bytes()
            + self.light_rays.as_ref().map_or(0, LightRays::bytes)
            + self.many_lights.bytes()
            + self.handed.bytes()
    }

    /// The last frame's picture: Rgba8Unorm holding sRGB values. Another texture after a change of size.
    pub fn picture(&self) -> Option<&wgpu::Texture> {
        self.targets.as_ref().map(|targets| &targets.picture.texture)
    }

    /// Makes the last frame's picture anew from other colours: linear red, green and blue of each pixel, rows top to
    /// bottom. `settings` are those of the frame. If its exposure was fitted, the picture has that one, or with
    /// `fits_exposure` the one that fits these colours, which is returned.
    ///
    /// # Errors
    /// Nothing was rendered yet, not a colour for each pixel, or the device was lost.
    pub fn present(
        &mut self,
        settings: &Settings,
        color: &[[f32; 3]],
        fits_exposure: bool,
    ) -> Result<Option<Exposure>> {
        let camera = self.camera.ok_or_else(nothing_rendered)?;
        let Self { gpu, targets: Some(targets), reflections: Some(reflections), .. } = self else {
            return Err(nothing_rendered());
        };
        let [width, height] = targets.size;
        if color.len() != width as usize * height as usize {
            return Err(Error::NotRendered(format!("{} colours for a picture of {width} x {height}", color.len())));
        }
        let image = Image::new(&gpu.device, targets.size, "color", wgpu::TextureFormat::Rgba32Float);
        let texels: Vec<[f32; 4]> = color.iter().map(|[red, green, blue]| [*red, *green, *blue, 1.0]).collect();
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width * 16), rows_per_image: Some(height) };
        let texture = &image.texture;
        gpu.queue.write_texture(texture.as_image_copy(), bytemuck::cast_slice(&texels), layout, texture.size());
        let settings = Settings { tone: self.tone.clone(), ..settings.clone() };
        let inputs = Inputs::new(gpu, camera, &settings, &DrawList::default());
        let mut recorder = Recorder::new(gpu, &mut self.pipelines, &settings);
        let switches = [("is_filmic", u32::from(self.is_filmic))];
        // The next frame goes on from the exposure of the last one.
        let mut anew = ExposureMeter::new(gpu);
        let exposure = if fits_exposure && self.exposure.is_used {
            anew.fit(&mut recorder, &inputs, (&image, targets), None)?;
            &anew
        } else {
            self.exposure.give(&mut recorder, &inputs);
            &self.exposure
        };
        recorder.over_pixels(&switches, &inputs, targets.presented(&image))?;
        recorder.finish_frame(&mut self.handed, &reflections.counters, &exposure.fitted, &targets.picture)?;
        Ok(self.handed.exposure()?.filter(|_| exposure.is_used).map(Exposure::from))
    }

    fn resize(&mut self, size: [u32; 2], quality: Quality) -> Result<()> {
        let size = size.map(|edge| edge.max(1));
        let limits = self.gpu.device.limits();
        let too_large = |what, bytes: u64, limit: u64| Error::TooLarge {
            what,
            bytes,
            limit,
            adapter: self.gpu.info.name.clone(),
            advice: "; ask for a smaller picture",
        };
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let edge = size[0].max(size[1]);
        if edge > limits.max_texture_dimension_2d {
            return Err(too_large("an edge of the picture", edge.into(), limits.max_texture_dimension_2d.into()));
        }
        if pixels * 16 > limits.max_storage_buffer_binding_size {
            return Err(too_large("the picture", pixels * 16, limits.max_storage_buffer_binding_size));
        }
        if self.targets.as_ref().is_none_or(|targets| targets.size != size) {
            self.targets = Some(Targets::new(&self.gpu.device, size));
            let device = &self.gpu.device;
            self.reflections = Some(match self.reflections.take() {
                Some(reflections) => reflections.resized(device, size),
                None => Reflections::new(device, size),
            });
            (self.made_from, self.splatted_from) = (None, None);
        }
        if let Some(targets) =
            self.targets.as_mut().filter(|targets| quality == Quality::High && targets.sums.is_none())
        {
            targets.sums = Some(
                [COLOR_SUM_BYTES, SURFACE_SUM_BYTES, SPECULAR_WORDS * 4, CARRY_BYTES]
                    .map(|bytes| storage(&self.gpu.device, "sums", pixels * bytes)),
            );
        }
        let sums = self.targets.as_ref().and_then(|targets| targets.sums.clone());
        if let (Some(reflections), Some([color, surface, specular, _])) = (&mut self.reflections, sums) {
            // The camera's surface is made before reflections are searched.
            reflections.methods.lent = Some([color, surface, specular]);
        }
        Ok(())
    }
}

pub(crate) fn nothing_rendered() -> Error {
    Error::NotRendered("nothing has been rendered yet".into())
}
