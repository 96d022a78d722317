//! Reflections. A method answers one question for every mirror pixel: which scene point does the reflected eye ray see?
//! It answers by filling a Mirror G-Buffer. The following steps, which are shading, blending and the next bounce, do
//! not depend on the method.
//!
//! Forward methods take points to pixels and share the splatting of `forward`; gather methods take pixels to points and
//! share `gather`. How to add a method: docs/how/picture.md, "Reflections".

#[cfg(test)]
mod beam;
mod bounce;
pub(crate) mod clear;
pub(crate) mod cubemap_trace;
mod cubemaps;
#[cfg(test)]
mod depth_search;
#[cfg(test)]
mod depth_walk;
pub(crate) mod environment_map;
pub(crate) mod fading;
mod footprint;
mod formula;
pub(crate) mod forward;
pub(crate) mod gather;
pub(crate) mod gloss;
pub(crate) mod kept_hits;
pub(crate) mod light_field;
#[cfg(test)]
mod lobe;
mod mirror_places;
pub(crate) mod mirrored_viewpoint;
pub(crate) mod own_methods;
pub(crate) mod sample_cameras;
mod screen_box;
pub(crate) mod screen_trace;
#[cfg(test)]
mod screen_walk;
pub(crate) mod sscr;
mod step;
pub(crate) mod surfel_index;
pub(crate) mod surfel_trace;
mod surfel_tree;
pub(crate) mod task;
pub(crate) mod weight;

use scene::{MapFill, Method, Settings, Supply};

pub(crate) use bounce::{Bounce, Part, Parts, Search};
use clear::{Clear, ClearSurface};
pub use cubemaps::MapCount;
use fading::Fading;
use footprint::Footprint;
pub(crate) use formula::{exact, is_clear, mirror_spheres, upload};
use gloss::{Gloss, RaySet, has_reflectance, is_weighed};
use kept_hits::{GlossCache, KeptHits, KnownRays, Scenery};
pub use light_field::{MapLimit, MapUse};
use own_methods::OwnMethods;
pub use sample_cameras::CameraCount;
use step::Step;
pub(crate) use task::{SurfaceImages, Task};

use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::{
    CLOSED_PIXELS, COUNTERS, DISCS_TESTED, DOUBTED_PIXELS, FOUND_PIXELS, HIT_BYTES, MIRROR_PIXELS, NODES_TESTED,
    POINTS_FOUND, POINTS_LISTED, POINTS_TRIED, POINTS_UNCONVERGED, RAYS_KEPT, RAYS_LEFT, RAYS_TRACED, REGIONS,
    TEXELS_TRACED,
};
use crate::method::{Methods, Views, behind_clear, has_cells, walks_maps};
use crate::recorder::Recorder;
use crate::targets::{Image, storage};

/// Statistics of the first bounce of a frame's reflections.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReflectionStats {
    pub mirror_pixels: u32,
    /// The share of the mirror pixels in which a point was found.
    pub coverage: f64,
    /// The share of the mirror pixels in which a point was found or that were closed from their neighbours.
    pub closed_coverage: f64,
    /// The share of the points tried that found a pixel (forward methods).
    pub hit_rate: Option<f64>,
    /// The share of the points tried whose search ran out of steps (SSCR), or that more places reflect than are kept
    /// (`sample_cameras`).
    pub unconverged: Option<f64>,
    /// The number of regions of the mirror pixels (SSCR), or of squares or cells of space (`sample_cameras`).
    pub regions: Option<u32>,
    /// The cells of space (`sample_cameras`).
    pub cameras: Option<CameraCount>,
    /// The share of the mirror pixels whose ray no picture of depths resolves (`cubemap_trace`, `screen_trace`,
    /// `light_field`), or no bundle of rays (`sample_cameras`).
    pub unresolved: Option<f64>,
    /// The maps around mirrors through which rays walk (`cubemap_trace`), or in which they are looked up (`light_field`).
    pub maps: Option<MapCount>,
    /// What the maps of `light_field` took.
    pub map_use: Option<MapUse>,
    /// The average numbers of nodes and of discs against which a ray was tested; known while steps are shown.
    pub tests_per_ray: Option<[f64; 2]>,
    /// The share of the mirror pixels whose content is doubtful: closed from neighbours, more than a pixel beside the
    /// reflected ray, or alone among neighbours that show other surfaces.
    pub uncertain: f64,
    /// The method that found what is seen through clear surfaces; `None` if there are none.
    pub seen_through_by: Option<Method>,
    pub bounces: u32,
}

/// The bounces of a frame and the methods that find them.
pub(crate) struct Reflections {
    size: [u32; 2],
    pub bounces: Vec<Bounce>,
    /// The number of bounces of the last frame with reflections.
    pub count: usize,
    pub methods: Methods,
    /// The methods of the last frame; more than one if mirrors have their own.
    in_use: Vec<Method>,
    /// What shares mirror pixels out among methods, from the first frame on that has several.
    own: Option<OwnMethods>,
    pub counters: wgpu::Buffer,
    /// Bound where a method marks none.
    no_hits: wgpu::Buffer,
    /// The doubtful pixels of the first bounce; see shaders/mirror_doubt.wgsl.
    pub doubt: Image,
    /// Glossy mirrors, from the first frame on that has some.
    pub gloss: Option<Gloss>,
    /// Mirror points that are moved within their pixels, from the first frame on that has some.
    footprint: Option<Footprint>,
    /// What the rays of glossy mirrors meet.
    kept: KeptHits,
    /// Glass and water, from the first frame on that has some.
    clear: Option<Clear>,
    /// Whether the last frame has some.
    has_clear: bool,
    /// Those of a frame that follows no reflections.
    clear_alone: Option<ClearSurface>,
    /// Whether the weights of the frame's glossy samples are still to be judged.
    weights_are_new: bool,
}

/// The bytes of the counters that a search for one set of rays counts in.
const OF_SEARCH: std::ops::Range<u64> = 0..RAYS_TRACED as u64 * 4;

/// The number of pixels in the tiles where mirrors may be.
fn places_of(inputs: &Inputs) -> u64 {
    inputs.mirror_groups().iter().map(|groups| u64::from(*groups)).product::<u64>() * 64
}

/// Finds a bounce by several methods, each of which has some of the mirror pixels, and judges which are doubtful, in this
/// image, if that is asked for.
fn find_parts(
    recorder: &mut Recorder<'_>,
    methods: &mut Methods,
    (parts, own): (&Parts<'_>, &OwnMethods),
    task: &Task<'_>,
    judged: Option<(&Step<'_>, &Image, &wgpu::Buffer)>,
) -> Result<()> {
    methods.begin_parts();
    for (number, part) in parts.each.iter().enumerate() {
        let mirror = &own.share(recorder, task.supply, task.mirror, number)?;
        let task = &Task { supply: &part.supply, settings: &part.settings, mirror, ..*task };
        methods.run_part(recorder, task)?;
        if let Some((step, doubt, no_hits)) = judged {
            let hits = (methods.marked_hits(), no_hits);
            step.doubt(recorder, (mirror, task.normal), doubt, task.counters, hits, number > 0)?;
        }
    }
    methods.end_parts();
    Ok(())
}

impl Reflections {
    pub fn new(device: &wgpu::Device, size: [u32; 2]) -> Self {
        let counters = storage(device, "counters", COUNTERS as u64 * 4);
        let no_hits = storage(device, "no hits", HIT_BYTES);
        let doubt = Image::new(device, size, "doubt", wgpu::TextureFormat::R32Float);
        let methods = Methods::new(size);
        Self {
            size,
            bounces: Vec::new(),
            count: 0,
            methods,
            in_use: Vec::new(),
            own: None,
            counters,
            no_hits,
            doubt,
            gloss: None,
            footprint: None,
            kept: KeptHits::default(),
            clear: None,
            has_clear: false,
            clear_alone: None,
            weights_are_new: false,
        }
    }

    /// Empty bounces for pictures of another size, with what methods keep of the points.
    pub fn resized(self, device: &wgpu::Device, size: [u32; 2]) -> Self {
        Self { methods: self.methods.resized(size), ..Self::new(device, size) }
    }

    /// The number of bounces that the settings ask for.
    pub fn asked(settings: &Settings) -> usize {
        if settings.reflection.method.row().supply == Supply::Nothing {
            0
        } else {
            settings.reflection.bounces as usize
        }
    }

    /// Forgets what methods keep from frame to frame.
    pub fn forget(&mut self) {
        self.methods.forget();
    }

    /// Begins a frame, whose maps around mirrors may lag. If the one before was not finished, its work is not kept; nor
    /// are hits in maps that lacked points.
    pub fn begin(&mut self, was_unfinished: bool, lacks_points: bool, may_lag: bool) {
        if was_unfinished {
            self.methods.forget_unfinished();
        }
        if lacks_points {
            self.forget_hits();
        }
        self.methods.environment.begin(was_unfinished);
        self.methods.cubemaps.begin(was_unfinished, may_lag);
        self.methods.light_field.begin(was_unfinished, may_lag);
        self.methods.cameras.begin(may_lag);
    }

    /// Forgets what the rays of glossy mirrors meet.
    pub fn forget_hits(&mut self) {
        self.kept.forget();
    }

    /// Whether what was found last came from maps that lack the newest points, or by cameras of an earlier view.
    pub fn lacks_points(&self, settings: &Settings) -> bool {
        self.in_use.iter().any(|method| {
            walks_maps(settings, *method) && self.methods.cubemaps.lags()
                || *method == Method::LightField && self.methods.light_field.lags()
                || has_cells(settings, *method) && self.methods.cameras.lags()
        })
    }

    /// Records that no mirror can be seen in the frame.
    pub fn none(&mut self) {
        self.count = 0;
    }

    /// Fills the Mirror G-Buffer of each bounce with what a set of rays meets.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn find(&mut self, recorder: &mut Recorder<'_>, search: &mut Search<'_>, rays: RaySet) -> Result<()> {
        let gpu = recorder.gpu;
        search.set_sample(gpu, rays.sample);
        let search = &*search;
        let fading = Fading::new(gpu, search);
        self.provide(gpu, search.settings, rays, fading.is_some());
        recorder.clear_part(&self.counters, OF_SEARCH);
        if let Some(set) = rays.kept_as {
            self.kept.take_up(set);
        }
        // All rays of perfect mirrors are known, or none.
        let may_be_known = rays.kept_as.is_some() && rays.is_perfect();
        let counters = self.kept.known_counters().filter(|_| may_be_known);
        if let Some(counters) = counters {
            recorder.copy_part(counters, &self.counters, OF_SEARCH);
        }
        let all_known = counters.is_some();
        if let Some(parts) = &search.parts {
            self.own.get_or_insert_with(|| OwnMethods::new(gpu, self.size)).find(recorder, search, parts)?;
        }
        for index in 0..self.count {
            self.find_bounce(recorder, search, rays, index, fading.as_ref(), all_known)?;
        }
        Ok(())
    }

    /// Makes the images that a set of rays needs.
    fn provide(&mut self, gpu: &Gpu, settings: &Settings, rays: RaySet, fades: bool) {
        self.count = Self::asked(settings);
        while self.bounces.len() < self.count {
            self.bounces.push(Bounce::new(&gpu.device, self.size));
        }
        self.bounces.truncate(self.count);
        let asked = [fades, has_reflectance(settings), weight::weighing(settings).is_some()];
        self.bounces.iter_mut().for_each(|bounce| bounce.provide(&gpu.device, asked));
        if rays.sample.is_some() {
            self.gloss.get_or_insert_with(|| Gloss::new(gpu, self.size)).provide(gpu, settings);
        }
        if rays.is_moved {
            self.footprint.get_or_insert_with(|| Footprint::new(gpu, self.size));
        }
    }

    /// Finds a bounce, step by step; with `all_known` the method has nothing to search.
    fn find_bounce(
        &mut self,
        recorder: &mut Recorder<'_>,
        search: &Search<'_>,
        rays: RaySet,
        index: usize,
        fading: Option<&Fading>,
        all_known: bool,
    ) -> Result<()> {
        let Search { supply, settings, store, mirrors, formulas, camera, parts } = search;
        let (before, rest) = self.bounces.split_at(index);
        let step = Step::new(search, index, before.last(), &rest[0]);
        let any_clear = self.clear.as_ref().filter(|_| self.has_clear);
        // Of clear surfaces that mirrors show, the stronger ray is followed.
        let clear = any_clear.filter(|_| index > 0);
        let gloss = self.gloss.as_ref().filter(|_| rays.is_glossy || rays.kept_as.is_some());
        let drawn = gloss.filter(|_| rays.is_glossy);

        // The rays: perfect ones, and those that rough mirrors draw about them.
        weight::weigh(recorder, supply, settings, (step.surface, step.from), before.last(), step.bounce)?;
        let (mirror, own_normal) = match clear {
            Some(clear) => {
                let onward = clear.go_on(recorder, supply, search, (step.surface, step.from), step.bounce)?;
                (&onward.rays, &onward.normal)
            }
            None => step.reflect(recorder, self.footprint.as_ref().filter(|_| rays.is_moved && index == 0))?,
        };
        let kept = rays.kept_as.and_then(|set| self.kept.of_bounce(recorder.gpu, set, index, places_of(supply)));
        let mut normal = own_normal;
        if let Some(gloss) = drawn {
            if index == 0 && is_weighed(settings) && self.weights_are_new {
                gloss.judge_weights(recorder, supply, settings, (mirror, normal))?;
                self.weights_are_new = false;
            }
            gloss.draw_normals(recorder, supply, settings, index, (mirror, normal), kept)?;
            normal = &gloss.normal;
        }
        step.weigh(recorder, mirror, [own_normal, normal])?;

        // What they meet.
        let task = Task {
            supply,
            settings,
            store,
            mirrors,
            bounce: index,
            camera: *camera,
            mirror,
            normal,
            seen: clear.map_or(&step.bounce.seen, |clear| &clear.found),
            formulas: formulas.as_ref(),
            counters: &self.counters,
        };
        let unknown = drawn.map(|gloss| gloss.unknown(mirror));
        let known = gloss.zip(kept).map(|(gloss, kept)| KnownRays {
            kept,
            pixels: &gloss.pixels,
            unknown: unknown.as_ref(),
            all: all_known,
        });
        let judges = index == 0 && rays.is_perfect();
        if let (Some(parts), Some(own)) = (parts, &self.own) {
            let (methods, judged) = (&mut self.methods, judges.then_some((&step, &self.doubt, &self.no_hits)));
            find_parts(recorder, methods, (parts, own), &task, judged)?;
        } else {
            self.methods.run(recorder, settings.reflection.method.chosen(), &task, known.as_ref())?;
        }
        if index == 0 && rays.kept_as.is_some() && rays.is_perfect() {
            self.kept.keep_counters(recorder, &self.counters, OF_SEARCH);
        }
        if let Some(clear) = clear {
            clear.take(recorder, &task, step.surface, false, step.bounce)?;
            let (methods, points) = (&mut self.methods, clear.known_points());
            clear.look_inside(recorder, methods, search, &task, step.surface.normal, points, true, step.bounce)?;
        }

        // What the following steps of the frame want to know of them.
        if let Some(fading) = fading {
            let refraction = clear.map_or(any_clear.map(Clear::index), |clear| Some(clear.later_index()));
            fading.measure(recorder, supply, mirror, refraction, step.bounce)?;
        }
        let learnt = match any_clear {
            Some(clear) => clear.learn_points(recorder, &self.methods, &task)?,
            None => false,
        };
        if judges && parts.is_none() {
            let hits = (self.methods.marked_hits(), &self.no_hits);
            step.doubt(recorder, (&step.bounce.mirror, normal), &self.doubt, task.counters, hits, false)?;
        }
        if let Some(clear) = &mut self.clear {
            clear.knows_points = learnt;
        }
        Ok(())
    }

    /// Begins a frame with so many glossy samples, whose rays meet what is in this scenery; `is_first` if it draws the
    /// first of them. Returns whether their hits are kept.
    pub fn begin_gloss(
        &mut self,
        recorder: &mut Recorder<'_>,
        search: &Search<'_>,
        scenery: Scenery,
        samples: u32,
        is_first: bool,
    ) -> GlossCache {
        recorder.clear(&self.counters);
        self.weights_are_new = is_first;
        let places = places_of(&search.supply);
        let kept = match search.parts {
            // The methods have hits of their own.
            Some(_) if samples > 0 => GlossCache::NoHits,
            _ => KeptHits::can(search.settings, samples, places, self.has_clear, recorder.gpu),
        };
        match kept {
            GlossCache::Kept => self.kept.begin(scenery),
            _ => self.kept.forget(),
        }
        kept
    }

    /// Ends a frame whose hits are kept.
    pub fn end_gloss(&mut self) {
        self.kept.end();
    }

    /// The numbers of rays of glossy mirrors that the last frame traced, and of those that it knew.
    pub fn glossy_rays(counters: &[u32]) -> [u64; 2] {
        [RAYS_TRACED, RAYS_KEPT].map(|at| u64::from(counters[at]) | u64::from(counters[at + 1]) << 32)
    }

    /// Finds what is seen through clear surfaces, before a set of rays is reflected; `points` as in `Clear::find`.
    ///
    /// # Errors
    /// A shader is refused, or there is no memory.
    pub fn look_through(
        &mut self,
        recorder: &mut Recorder<'_>,
        search: &Search<'_>,
        points: Option<&Image>,
    ) -> Result<()> {
        let clear = self.clear.get_or_insert_with(|| Clear::new(recorder.gpu, self.size));
        clear.find(recorder, &mut self.methods, search, points)
    }

    /// Looks up the clear surfaces that the camera sees, and follows no rays; `points` as in `Clear::find`.
    ///
    /// # Errors
    /// A shader is refused.
    pub fn look_at_clear(
        &mut self,
        recorder: &mut Recorder<'_>,
        search: &Search<'_>,
        points: Option<&Image>,
    ) -> Result<()> {
        let make = || ClearSurface::new(&recorder.gpu.device, self.size);
        let clear = self.clear_alone.get_or_insert_with(make);
        clear.go_through(recorder, &search.supply, search, points)?;
        Ok(())
    }

    /// Records the methods of the frame, and whether light goes through something in it, with reflections or alone. The
    /// images of methods that it does not use are given up.
    pub fn expect(&mut self, settings: &Settings, methods: &[Method], [has_clear, has_clear_alone]: [bool; 2]) {
        self.has_clear = has_clear;
        self.clear_alone = self.clear_alone.take().filter(|_| has_clear_alone);
        self.in_use = methods.to_vec();
        self.own = self.own.take().filter(|_| methods.len() > 1);
        let behind = if has_clear { behind_clear(settings) } else { Method::None };
        self.bounces.truncate(Self::asked(settings));
        self.count = self.count.min(self.bounces.len());
        self.methods.keep_images_of(&[methods, &[behind]].concat());
    }

    /// What is seen through clear surfaces, if there are any.
    pub fn clear(&self) -> Option<&Clear> {
        self.clear.as_ref().filter(|_| self.has_clear && self.count > 0)
    }

    /// The bounces of what is seen through clear surfaces.
    pub fn beyond(&self) -> &[Bounce] {
        self.clear.as_ref().map_or(&[], |clear| &clear.bounces)
    }

    /// The indices of refraction of the surfaces that the camera sees, if light goes through any.
    pub fn refraction(&self) -> Option<&Image> {
        self.clear().map(Clear::index).or(self.clear_alone.as_ref().map(ClearSurface::index))
    }

    /// Adds what the camera's mirrors show by the sample of `inputs`, whose bounces are shaded; `is_glossy` if its rays are.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn sum(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        is_glossy: bool,
    ) -> Result<()> {
        match (&self.gloss, self.first()) {
            (Some(gloss), Some(first)) => {
                gloss.add(recorder, inputs, settings, first, is_glossy, self.methods.looks(settings))
            }
            _ => Ok(()),
        }
    }

    /// What the camera's mirrors show by the samples summed so far; `glossy` are the normals of mirrors if those are of
    /// glossy ones, which is blurred if the settings ask for it.
    ///
    /// # Errors
    /// The shader is refused.
    pub fn received(
        &self,
        recorder: &mut Recorder<'_>,
        inputs: &Inputs,
        settings: &Settings,
        glossy: Option<&Image>,
    ) -> Result<Option<&Image>> {
        match (&self.gloss, self.first(), glossy) {
            (Some(gloss), Some(first), Some(normal)) => {
                gloss.blurred(recorder, inputs, settings, (&first.mirror, normal)).map(Some)
            }
            _ => Ok(self.mean()),
        }
    }

    /// The mean so far of what the camera's mirrors receive by several rays.
    pub fn mean(&self) -> Option<&Image> {
        self.gloss.as_ref().map(|gloss| &gloss.received)
    }

    /// The bounces of the last set of rays.
    pub fn found(&self) -> &[Bounce] {
        &self.bounces[..self.count]
    }

    /// Whether one of the last frame's methods is such.
    fn uses(&self, is_such: impl Fn(Method) -> bool) -> bool {
        self.in_use.iter().any(|method| is_such(*method))
    }

    /// The statistics of the last frame, whose counters are these.
    pub fn stats(&self, settings: &Settings, counters: &[u32]) -> ReflectionStats {
        let bounces = Self::asked(settings) as u32;
        if self.count == 0 {
            return ReflectionStats { bounces, ..Default::default() };
        }
        let share = |part: u32, whole: u32| if whole == 0 { 0.0 } else { f64::from(part) / f64::from(whole) };
        let pixels = counters[MIRROR_PIXELS];
        let tried = counters[POINTS_TRIED];
        let listed = share(counters[POINTS_LISTED], counters[POINTS_FOUND]) as f32;
        let cameras = self.methods.cameras.count().filter(|_| self.uses(|method| has_cells(settings, method)));
        let cameras = cameras.map(|cameras| CameraCount { listed, ..cameras });
        ReflectionStats {
            mirror_pixels: pixels,
            coverage: share(counters[FOUND_PIXELS], pixels),
            closed_coverage: share(counters[FOUND_PIXELS] + counters[CLOSED_PIXELS], pixels),
            hit_rate: (tried > 0).then(|| share(counters[POINTS_FOUND], tried)),
            unconverged: (tried > 0).then(|| share(counters[POINTS_UNCONVERGED], tried)),
            tests_per_ray: (counters[NODES_TESTED] > 0)
                .then(|| [counters[NODES_TESTED], counters[DISCS_TESTED]].map(|tests| share(tests, pixels))),
            uncertain: share(counters[DOUBTED_PIXELS], pixels),
            seen_through_by: self.clear().map(|_| behind_clear(settings)),
            regions: match &cameras {
                Some(cameras) => Some(cameras.pinholes + cameras.lists),
                None => (counters[REGIONS] > 0).then_some(counters[REGIONS]),
            },
            cameras,
            unresolved: self.methods.leaves_rays().then(|| share(counters[RAYS_LEFT], pixels)),
            maps: match self.uses(|method| method == Method::LightField) {
                true => self.methods.light_field.count(),
                false => self.methods.cubemaps.count().filter(|_| self.uses(|method| walks_maps(settings, method))),
            },
            map_use: match self.uses(|method| method == Method::LightField) {
                true => self.methods.light_field.map_use().map(|map_use| {
                    let is_partial = settings.light_field.fill == MapFill::OnDemand;
                    MapUse { texels: is_partial.then_some(counters[TEXELS_TRACED]), ..map_use }
                }),
                false => None,
            },
            bounces,
        }
    }

    pub fn bytes(&self) -> u64 {
        let gloss = self.gloss.as_ref().map_or(0, Gloss::bytes) + self.clear.as_ref().map_or(0, Clear::bytes);
        let gloss = gloss + self.clear_alone.as_ref().map_or(0, ClearSurface::bytes);
        let gloss = gloss + self.own.as_ref().map_or(0, OwnMethods::bytes);
        let gloss = gloss + self.footprint.as_ref().map_or(0, Footprint::bytes) + self.kept.bytes();
        self.bounces.iter().map(Bounce::bytes).sum::<u64>() + self.methods.bytes() + self.doubt.bytes() + gloss
    }

    /// Images of how the last frame's method came to its result; `None` if no mirror could be seen.
    pub fn views(&self) -> Option<Views<'_>> {
        if self.count == 0 { None } else { self.methods.views() }
    }

    /// The first bounce of the last frame; `None` if no mirror could be seen.
    pub fn first(&self) -> Option<&Bounce> {
        self.found().first()
    }
}
