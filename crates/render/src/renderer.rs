//! Renders a frame: runs the passes in their order on its images, and measures their time.

mod failure;
mod requests;

use std::sync::Arc;

use cloud::{Bounds, Progress};
use scene::{Camera, Curve, LightView, Lighting, Mirror, Quality, Settings, Show, Tone};

use crate::exposure::{self, Exposure, ExposureMeter};
use crate::frame::{FrameCamera, Objects};
use crate::gi::{GlobalIllumination, LightReuse, Sky};
use crate::gpu::{Clock, Error, Gpu, Result};
use crate::handed::Handed;
use crate::identities::Identities;
use crate::inputs::Inputs;
use crate::layout::{CARRY_BYTES, COLOR_SUM_BYTES, SPECULAR_WORDS, SURFACE_SUM_BYTES, ShownPoint};
use crate::light_views;
use crate::lighting::{DrawnMap, Lights, MappedLight};
use crate::method;
use crate::pass_times::PassTime;
use crate::passes;
use crate::recorder::{IsGivenUp, Pipelines, Recorder, Rehearsal};
use crate::reflection::fading::fades;
use crate::reflection::gloss::{RaySet, RaySets};
use crate::reflection::kept_hits::{GlossCache, Scenery};
use crate::reflection::{self, ReflectionStats, Reflections, Search, SurfaceImages};
use crate::rehearsal::Cast;
use crate::shading::{FrameLight, Reflected, Shading};
use crate::store::PointStore;
use crate::store::draw_list::{DrawList, Selection};
use crate::surface::{lay_mirrors, see_clear_points, see_radii, splat_surface};
use crate::targets::{Image, Targets, storage, uniform_buffer};

/// The cost and the content of a frame.
#[derive(Clone, Debug)]
pub struct FrameStats {
    /// The passes in order; a pass that runs once a page is summed. None if they were timed together
    /// (`Renderer::time_passes`).
    pub passes: Vec<PassTime>,
    /// The time from the first pass to the last; where passes are timed together, with the copy of the picture.
    pub frame_milliseconds: f64,
    /// The part of it that splats the points that the camera sees; it grows with their number.
    pub splatting_milliseconds: f64,
    pub points_drawn: u64,
    pub points_resident: u64,
    pub gpu_bytes: u64,
    pub clock: Clock,
    /// Whether passes were compiled for the frame: drivers then compile at their first dispatch, which counts in the
    /// times.
    pub has_compiled: bool,
    /// The number of dispatches: more than passes where long ones were cut (`Renderer::give_up_when`).
    pub dispatches: u32,
    /// The number of times that the CPU waited for the GPU.
    pub waits: u32,
    /// The number of virtual lights that lit the frame; 0 without indirect light.
    pub virtual_lights: u32,
    /// The number of samples of mirrors that the picture shows, and the number asked for; 0 of 0 if mirrors are perfect
    /// and one ray a pixel is followed.
    pub glossy_samples: [u32; 2],
    /// The exposure of the picture, if it was fitted.
    pub exposure: Option<Exposure>,
    /// Whether what the rays of glossy mirrors meet is kept for the next frame.
    pub glossy_hits: GlossCache,
    /// If it is: the number of rays of glossy mirrors that the frame traced, and of those whose hits it knew from frames
    /// before.
    pub glossy_rays: [u64; 2],
    /// The statistics of the reflections, if they were asked for.
    pub reflection: Option<ReflectionStats>,
    /// Whether the processor has drawn the frame (`QuickPicture`).
    pub is_quick: bool,
    /// The mean FLIP to the picture at rest of the same view, where somebody has judged it.
    pub flip: Option<f64>,
}

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
    /// How many samples of mirrors a frame may add.
    samples_at_once: Option<u32>,
    pub(crate) gi: GlobalIllumination,
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
    /// How many points that the camera sees a frame may draw.
    most_points: Option<u64>,
    pub(crate) given_up: Option<Arc<IsGivenUp>>,
    /// See `cut_passes`.
    pub(crate) longest_piece: f64,
    /// See `time_passes`.
    times_passes: bool,
    /// What the last `prepare` compiled for.
    pub(crate) prepared: Option<Cast>,
}

/// What indirect light comes from.
pub(crate) struct Lit {
    pub lights: Vec<MappedLight>,
    pub sky: Option<Sky>,
    pub has_highlights: bool,
    pub has_gloss: bool,
}

/// A thinned picture draws at least one point in so many: fewer would be specks.
const MOST_STEP: u64 = 64;

/// All inputs of the surfaces that points make, as the camera sees them.
#[derive(Clone, PartialEq)]
struct PointInputs {
    /// The camera without the tiles of mirrors, which points do not depend on.
    camera: FrameCamera,
    /// The settings that affect the surfaces; the others are at their defaults.
    settings: Settings,
    /// One point in so many is drawn.
    step: u32,
    revision: u64,
    /// Whether eye-dome lighting asks for the radii of splats.
    with_radii: bool,
}

/// All inputs of the surfaces and the reflected points of a frame.
#[derive(Clone, PartialEq)]
struct SurfaceInputs {
    points: PointInputs,
    /// The mirrors that are drawn by their formula.
    formulas: Vec<Mirror>,
    mirrors: Vec<Mirror>,
    /// The settings that affect what is found; the others are at their defaults.
    settings: Settings,
    /// Whether steps are counted because they are shown.
    counts_steps: bool,
    /// Whether points are placed where their search stands.
    shows_search: bool,
    /// The sets of rays of mirrors.
    rays: RaySets,
    /// Whether it is measured how far the rays of mirrors go.
    fades: bool,
}

/// The light of the samples that are summed so far.
#[derive(Clone, PartialEq)]
struct SummedLight {
    /// The settings that affect shading; the others are at their defaults.
    settings: Settings,
    lights: Vec<MappedLight>,
    sky: Option<Sky>,
    /// The generation of the virtual lights, if there are any.
    virtual_lights: Option<u64>,
    reuse: LightReuse,
}

/// The samples of mirrors that are summed so far for the surfaces of the last frame.
pub(crate) struct Summed {
    light: SummedLight,
    samples: u32,
}

impl SurfaceInputs {
    /// # Errors
    /// The method does not know glossy mirrors.
    fn new(
        camera: FrameCamera,
        settings: &Settings,
        seen: &Settings,
        step: u32,
        store: &PointStore,
        objects: Objects<'_>,
    ) -> Result<Self> {
        let seen = seen.only(|field| field.affects.surface);
        let with_radii = settings.edl.strength > 0.0 && settings.edl.ignored > 0.0;
        Ok(Self {
            points: PointInputs { camera, settings: seen, step, revision: store.revision(), with_radii },
            formulas: reflection::exact(settings, objects.mirrors).cloned().collect(),
            mirrors: objects.mirrors.to_vec(),
            settings: settings.only(|field| field.affects.found),
            counts_steps: matches!(settings.reflection.show, Show::Steps | Show::Unconverged),
            shows_search: settings.reflection.show == Show::Search,
            rays: RaySets::new(settings, store, objects.mirrors)?,
            fades: fades(settings),
        })
    }
}

impl Renderer {
    /// Compiles the passes that every picture needs: for seconds on software Vulkan, so call this off the window's
    /// thread. Others are compiled by `prepare`, or when they are first needed.
    ///
    /// # Errors
    /// A shader is refused, or the device is lost.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self> {
        Self::with_progress(gpu, &Arc::default())
    }

    /// The same, with the progress that `prepare` tells.
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
            samples_at_once: None,
            gi: GlobalIllumination::default(),
            lit: None,
            many_lights: GlobalIllumination::default(),
            camera: None,
            tone: Tone::default(),
            is_filmic: false,
            exposure,
            drawn: Arc::default(),
            most_points: None,
            given_up: None,
            longest_piece: 25.0,
            times_passes: true,
            prepared: None,
        }
    }

    /// Forgets everything that is kept between frames, so that the next frame is made from scratch. For measurements.
    pub fn forget(&mut self) {
        (self.made_from, self.splatted_from, self.kept_shadows) = (None, None, Vec::new());
        if let Some(reflections) = &mut self.reflections {
            reflections.forget();
            reflections.forget_hits();
        }
        self.gi.forget();
        self.exposure.is_used = false;
    }

    /// Renders a frame and waits for it.
    ///
    /// # Errors
    /// A picture too large for the adapter, no more memory, or the device was lost.
    pub fn render(
        &mut self,
        store: &PointStore,
        camera: &Camera,
        settings: &Settings,
        objects: Objects<'_>,
        size: [u32; 2],
    ) -> Result<FrameStats> {
        let outcome = self.draw(store, camera, settings, objects, size, None);
        self.checked(outcome)
    }

    /// Draws a frame, or rehearses it.
    pub(crate) fn draw(
        &mut self,
        store: &PointStore,
        camera: &Camera,
        settings: &Settings,
        objects: Objects<'_>,
        size: [u32; 2],
        rehearsal: Option<&mut Rehearsal>,
    ) -> Result<FrameStats> {
        let compiled = self.pipelines.len();
        // The data's own colours are shown as they are, whatever exposure and curve are for light.
        let as_they_are;
        let settings = if Lights::chosen(settings, objects).by == Lighting::Colors && settings.tone != Tone::default() {
            as_they_are = Settings { tone: Tone::default(), ..settings.clone() };
            &as_they_are
        } else {
            settings
        };
        self.resize(size, settings.splat.quality)?;
        let atomics64 = self.gpu.has_wide_atomics(&settings.splat);
        let (bounds, reach) = (store.bounds(), store.reach());
        let sphere = |bounds: Bounds| {
            if bounds.is_empty() { (camera.pivot, 1.0) } else { (bounds.center(), bounds.radius()) }
        };
        let (center, radius) = sphere(reach);
        let mut frame_camera = FrameCamera::new(camera, &settings.view, size, center, radius);
        frame_camera.scene_radius = sphere(bounds).1;
        let without_mirrors = frame_camera;
        let spheres = store.mirror_spheres(settings).chain(reflection::mirror_spheres(settings, objects.mirrors));
        // Splats reach at least as far as their smallest size, and closing a gap reaches two pixels further.
        frame_camera.mirror_tiles = frame_camera.tiles_of(spheres, f64::from(settings.splat.min_pixels) * 0.5 + 2.0);
        let mut lights = Lights::mapped(settings, objects, camera, size, bounds);
        if self.most_points.is_some() && lights.first().is_some_and(|light| light.camera.orthographic) {
            lights.truncate(1);
        }
        let mut seen = settings.clone();
        if self.most_points.is_none() {
            seen.splat.max_pixels = seen.splat.max_pixels.max(seen.splat.rest_pixels);
        }
        let mut points_drawn = store.draw_list(&frame_camera, &seen, Selection::Seen);
        let most_points = self.most_points.unwrap_or(u64::MAX).max(1);
        let step = (points_drawn.points.div_ceil(most_points).clamp(1, MOST_STEP) as u32).max(settings.splat.step);
        if step > 1 {
            // The larger splats cover as much of the picture as all would.
            seen.splat.size *= (step as f32).sqrt();
            points_drawn = store.draw_list(&frame_camera, &seen, Selection::Seen);
            points_drawn.thin(step);
        }
        let asks = SurfaceInputs::new(without_mirrors, settings, &seen, step, store, objects)?;
        let made_from = self.made_from.as_ref().filter(|_| settings.reflection.keep);
        let lacks_points = self.reflections.as_ref().is_some_and(|reflections| reflections.lacks_points(settings));
        let is_kept = made_from == Some(&asks) && !lacks_points;
        let is_surface = |made: &SurfaceInputs| made.points == asks.points && made.formulas == asks.formulas;
        let surface_is_kept = made_from.is_some_and(is_surface);
        let points_are_kept = settings.reflection.keep && self.splatted_from.as_ref() == Some(&asks.points);
        // After an error neither half a frame nor the methods' work on it may be kept.
        let was_unfinished = std::mem::replace(&mut self.is_unfinished, true);
        self.reflections.iter_mut().for_each(|kept| kept.begin(was_unfinished, lacks_points, self.gi.may_lag));
        self.made_from = None;
        let summed_before = self.summed.take();
        if !points_are_kept {
            self.splatted_from = None;
        }
        self.drawn = store.identities().clone();

        let Self { gpu, targets, reflections, .. } = self;
        let (Some(targets), Some(reflections)) = (targets, reflections) else { return Err(nothing_rendered()) };
        let mut recorder = Recorder::new(gpu, &mut self.pipelines, settings);
        recorder.time_into(&self.handed);
        if !self.times_passes && rehearsal.is_none() {
            recorder.time_together();
        }
        recorder.rehearse(rehearsal);
        recorder.give_up_when(self.given_up.as_deref(), self.longest_piece);
        let nothing = DrawList::default();
        let list = if points_are_kept { &nothing } else { &points_drawn };
        let mut inputs = Inputs::new(gpu, frame_camera, &seen, list);
        // Data that no mirror on the screen needs is not prepared.
        let has_mirrors = Reflections::asked(settings) > 0 && !frame_camera.mirror_tiles.is_empty();
        let all_samples = if has_mirrors { asks.rays.summed() } else { 0 };
        let is_sampled = all_samples > 0;
        let formulas = reflection::upload(gpu, settings, objects.mirrors, frame_camera.eye);
        // Where reflections fade, a mirror's own light depends on what its rays meet.
        let fades = asks.fades && has_mirrors;
        if !is_kept || is_sampled && fades {
            self.gi.surfaces_changed(usize::from(surface_is_kept && !fades));
        }
        if !is_kept {
            if !points_are_kept {
                splat_surface(&mut recorder, &inputs, settings, targets, atomics64)?;
                if asks.points.with_radii {
                    see_radii(&mut recorder, &inputs, targets)?;
                }
                if store.has_clear_points(settings) {
                    see_clear_points(&mut recorder, &inputs, targets)?;
                }
            }
            if !surface_is_kept {
                lay_mirrors(&mut recorder, &inputs, targets, formulas.as_ref())?;
            }
        }
        let camera_surface = SurfaceImages {
            albedo: &targets.surface().albedo,
            normal: &targets.surface().normal,
            position: &targets.position,
        };
        let search = || {
            let everywhere = store.draw_list(&frame_camera, settings, method::supply(settings));
            let supply = Inputs::new(gpu, frame_camera, settings, &everywhere);
            Search { supply, settings, store, mirrors: objects.mirrors, formulas, camera: camera_surface }
        };
        let mut search = (is_sampled || has_mirrors && !is_kept).then(search);
        let has_clear = has_mirrors && reflection::clear::is_there(settings, store, objects.mirrors);
        reflections.expect(settings, has_clear);
        if let Some(search) = search.as_ref().filter(|_| has_clear && !is_kept) {
            let points = targets.clear_points.as_ref().filter(|_| store.has_clear_points(settings));
            reflections.look_through(&mut recorder, search, points)?;
        }
        if !has_mirrors {
            reflections.none();
        } else if let Some(search) = search.as_mut().filter(|_| !is_sampled) {
            reflections.find(&mut recorder, search, RaySet::PERFECT)?;
        }
        self.lights.upload(gpu, &lights, frame_camera.eye);
        let at_hand = std::mem::take(&mut self.kept_shadows);
        let may_lag = self.gi.may_lag;
        let kept_shadows =
            self.lights.draw_shadows(&mut recorder, store, settings, &lights, at_hand, may_lag, atomics64)?;
        let shading = Shading::new(settings, store, objects, lights.len());
        let sky = (shading.light.by == Lighting::Sun).then_some(Sky { up: camera.up, irradiance: settings.sun.sky });
        let has_indirect = GlobalIllumination::is_asked(settings, &lights, sky);
        if has_indirect {
            let shadows = &self.lights.shadows;
            self.gi.place(&mut recorder, frame_camera, store, settings, &lights, sky, shadows)?;
        }
        let lit_by = SummedLight {
            settings: settings.only(|field| field.affects.shading),
            lights: lights.clone(),
            sky,
            virtual_lights: self.gi.generation().filter(|_| has_indirect),
            reuse: self.gi.keeper.reuse,
        };
        let mut light = FrameLight {
            settings,
            lights: &self.lights,
            gi: has_indirect.then_some(&mut self.gi),
            shading,
            camera: camera_surface,
            bounces: if has_mirrors { Reflections::asked(settings) } else { 0 },
            received: None,
            direct: &targets.direct,
            color: &targets.color,
            first_receiver: 0,
        };
        let knows_rays = !(is_sampled && fades);
        if knows_rays {
            light.shade(&mut recorder, &inputs, reflections.found(), 0)?;
        }
        if has_clear {
            // Receivers of their own, after those of the reflections.
            light.first_receiver = Reflections::asked(settings);
            light.shade_bounces(&mut recorder, &inputs, reflections.beyond())?;
            light.first_receiver = 0;
        }
        let mut summed = None;
        let mut glossy_hits = GlossCache::NoGloss;
        if !is_sampled || asks.rays.glossy == 0 {
            reflections.forget_hits();
        }
        let mut reflected = if let Some(search) = search.as_mut().filter(|_| is_sampled) {
            // A change of the light needs all samples anew, by their hits.
            let known = summed_before.filter(|summed| is_kept && summed.light == lit_by);
            let first = known.map_or(0, |summed| summed.samples);
            if asks.rays.glossy > 0 {
                let scenery = Scenery::new(frame_camera, &asks.settings, step, store, objects.mirrors);
                glossy_hits = reflections.begin_gloss(&mut recorder, search, scenery, all_samples, first == 0);
            }
            let kept_as = |set: u32| (glossy_hits == GlossCache::Kept).then_some(set);
            let at_once = self.samples_at_once.filter(|_| settings.reflection.keep).unwrap_or(all_samples);
            let end = all_samples.min(first.saturating_add(at_once));
            for sample in first..end {
                let rays = RaySet { kept_as: kept_as(sample), ..asks.rays.rays(sample) };
                reflections.find(&mut recorder, search, rays)?;
                inputs.set_sample(gpu, rays.sample);
                light.surfaces_changed();
                light.shade_bounces(&mut recorder, &inputs, reflections.found())?;
                reflections.sum(&mut recorder, &inputs, settings, asks.rays.glossy > 0)?;
            }
            if first < end && end == all_samples && !asks.rays.rays(end - 1).is_perfect() {
                // Statistics, images of what mirrors see, and probes are those of perfect mirrors.
                let rays = RaySet { kept_as: kept_as(all_samples), ..RaySet::PERFECT };
                reflections.find(&mut recorder, search, rays)?;
            }
            summed = Some(Summed { light: lit_by, samples: end });
            let glossy = (asks.rays.glossy > 0).then_some(camera_surface.normal);
            let received = reflections.received(&mut recorder, &inputs, settings, glossy)?;
            if !knows_rays {
                light.received = received;
                light.shade(&mut recorder, &inputs, reflections.found(), 0)?;
            }
            received.map_or(Reflected::Nothing, Reflected::Received)
        } else {
            light.shade_bounces(&mut recorder, &inputs, reflections.found())?;
            if has_mirrors { Reflected::Found } else { Reflected::Nothing }
        };
        if let Some(clear) = reflections.clear() {
            let received = if let Reflected::Received(image) = reflected { Some(image) } else { None };
            clear.blend(&mut recorder, &inputs, reflections.found(), received)?;
            reflected = Reflected::Received(&clear.received);
        }
        light.blend(&mut recorder, &inputs, reflections.found(), 0, reflected)?;
        let samples = [summed.as_ref().map_or(0, |summed| summed.samples), all_samples];
        let is_filmic = match settings.tone.curve {
            // The colours of the data are not mapped.
            Curve::Auto => matches!(shading.light.by, Lighting::Lights | Lighting::Sun),
            curve => curve == Curve::Filmic,
        };
        if exposure::is_fitted(settings, shading.light) {
            self.exposure.fit(&mut recorder, &inputs, targets)?;
        } else {
            self.exposure.is_used = false;
        }
        match (reflections.views(), reflections.first()) {
            _ if settings.light.show != LightView::Picture => {
                let shown = light_views::FrameInputs {
                    targets,
                    lights: &self.lights,
                    mapped: &lights,
                    virtual_lights: self.gi.lights().filter(|_| has_indirect),
                    indirect: self.gi.radiance(0).filter(|_| has_indirect),
                    bounds,
                    is_filmic,
                };
                light_views::show(&mut recorder, &inputs, settings, &shown)?;
            }
            (_, Some(bounce)) if settings.reflection.show == Show::Error => {
                let point = settings.reflection.shown_point().unwrap_or(camera.pivot);
                let shown = ShownPoint { position: (point - frame_camera.eye).as_vec3().extend(0.0) };
                let shown = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&shown));
                let bindings = passes::show_error {
                    shown: shown.as_entire_binding(),
                    color_in: targets.color.bind(),
                    point_in: bounce.mirror.point.bind(),
                    normal_in: targets.surface().normal.bind(),
                    eye_in: bounce.mirror.eye.bind(),
                    picture_out: targets.picture.bind(),
                };
                recorder.over_pixels(&[("is_filmic", u32::from(is_filmic))], &inputs, bindings)?;
            }
            (views, Some(bounce)) if method::shows_more(settings, views.as_ref()) => {
                let [albedo_in, normal_in, position_in] = bounce.seen.bind();
                let bindings = passes::show {
                    color_in: targets.color.bind(),
                    point_in: bounce.mirror.point.bind(),
                    albedo_in,
                    normal_in,
                    position_in,
                    // A view that the method does not have is not shown.
                    views_in: views.as_ref().map_or(&reflections.doubt, |views| views.image).bind(),
                    doubt_in: reflections.doubt.bind(),
                    picture_out: targets.picture.bind(),
                };
                let most_steps = views.as_ref().map_or(1, |views| views.most_steps);
                let switches = [("most_steps", most_steps), ("is_filmic", u32::from(is_filmic))];
                recorder.over_pixels(&switches, &inputs, bindings)?;
            }
            _ => {
                let bindings = targets.presented(&targets.color);
                recorder.over_pixels(&[("is_filmic", u32::from(is_filmic))], &inputs, bindings)?;
            }
        }

        let virtual_lights = self.gi.lights().filter(|_| has_indirect).map_or(0, |lights| lights.count);
        let times =
            recorder.finish_frame(&mut self.handed, &reflections.counters, &self.exposure.fitted, &targets.picture)?;
        self.gi.keeper.finish();
        let gpu_bytes = store.gpu_bytes()
            + targets.bytes()
            + reflections.bytes()
            + self.lights.shadows.size()
            + self.gi.bytes()
            + self.many_lights.bytes()
            + self.handed.bytes();
        let counters = self.handed.counters()?.filter(|_| Reflections::asked(settings) > 0);
        let glossy_rays = counters.as_ref().filter(|_| glossy_hits == GlossCache::Kept);
        let glossy_rays = glossy_rays.map_or([0; 2], |counters| Reflections::glossy_rays(counters));
        reflections.end_gloss();
        let reflection = counters.map(|counters| reflections.stats(settings, &counters));
        let Shading { has_highlights, has_gloss, .. } = shading;
        self.lit = has_indirect.then_some(Lit { lights, sky, has_highlights, has_gloss });
        self.splatted_from = Some(asks.points.clone());
        (self.camera, self.made_from, self.kept_shadows) = (Some(frame_camera), Some(asks), kept_shadows);
        self.is_unfinished = false;
        self.summed = summed;
        (self.tone, self.is_filmic) = (settings.tone.clone(), is_filmic);
        let exposure = self.handed.exposure()?.filter(|_| self.exposure.is_used);
        Ok(FrameStats {
            passes: times.passes,
            frame_milliseconds: times.total,
            splatting_milliseconds: times.splatting,
            points_drawn: points_drawn.points,
            points_resident: store.points(),
            gpu_bytes,
            clock: self.gpu.clock,
            has_compiled: self.pipelines.len() > compiled,
            dispatches: times.dispatches,
            waits: times.waits,
            virtual_lights,
            glossy_samples: samples,
            exposure: exposure.map(|fitted| Exposure { stops: fitted.stops, adapts: fitted.adapts != 0 }),
            glossy_hits,
            glossy_rays,
            reflection,
            is_quick: false,
            flip: None,
        })
    }

    /// The last frame's picture: Rgba8Unorm holding sRGB values. Another texture after a change of size.
    pub fn picture(&self) -> Option<&wgpu::Texture> {
        self.targets.as_ref().map(|targets| &targets.picture.texture)
    }

    /// Makes the last frame's picture anew from other colours: linear red, green and blue of each pixel, rows top to
    /// bottom. `settings` are those of the frame.
    ///
    /// # Errors
    /// Nothing was rendered yet, not a colour for each pixel, or the device was lost.
    pub fn present(&mut self, settings: &Settings, color: &[[f32; 3]]) -> Result<()> {
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
        self.exposure.give(&mut recorder, &inputs);
        recorder.over_pixels(&switches, &inputs, targets.presented(&image))?;
        recorder.finish_frame(&mut self.handed, &reflections.counters, &self.exposure.fitted, &targets.picture)?;
        Ok(())
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
