//! The plan of a frame: what its request asks for, and what is kept of the frames before. A plan needs no GPU.

use std::borrow::Cow;

use cloud::Bounds;
use glam::DVec3;
use scene::{IndirectBy, Lighting, Method, Mirror, MirrorSettings, Reflection, Settings, Show, Tone};

use super::request::{Effort, Frame};
use crate::frame::{FrameCamera, Objects};
use crate::gi::{GlobalIllumination, LightReuse, Region, Sky};
use crate::gpu::Result;
use crate::layout::BLOCK_POINTS;
use crate::lighting::{Lights, MappedLight};
use crate::method::check;
use crate::reflection::fading::fades;
use crate::reflection::gloss::RaySets;
use crate::reflection::own_methods::methods_of;
use crate::reflection::weight::weighing;
use crate::reflection::{self, Reflections};
use crate::shading::Shading;
use crate::store::PointStore;
use crate::store::draw_list::{DrawList, Selection};

/// A thinned picture draws at least one point in so many: fewer would be specks.
const MOST_STEP: u64 = 64;
/// Reflections are made of at least one point in so many: one of each block.
const MOST_REFLECTED_STEP: u64 = BLOCK_POINTS as u64;

/// All inputs of the surfaces that points make, as the camera sees them.
#[derive(Clone, PartialEq)]
pub(super) struct PointInputs {
    /// The camera without the tiles of mirrors, which points do not depend on.
    camera: FrameCamera,
    /// The settings that affect the surfaces; the others are at their defaults.
    settings: Settings,
    /// One point in so many is drawn.
    pub step: u32,
    revision: u64,
    /// Whether eye-dome lighting asks for the radii of splats.
    pub with_radii: bool,
}

/// All inputs of the surfaces and the reflected points of a frame.
#[derive(Clone, PartialEq)]
pub(super) struct SurfaceInputs {
    pub points: PointInputs,
    /// The mirrors that are drawn by their formula.
    formulas: Vec<Mirror>,
    mirrors: Vec<Mirror>,
    /// One point in so many is searched for, or drawn into maps.
    pub reflected_step: u32,
    /// The settings that affect what is found; the others are at their defaults.
    pub settings: Settings,
    /// Whether steps are counted because they are shown.
    counts_steps: bool,
    /// Whether points are placed where their search stands.
    shows_search: bool,
    /// The sets of rays of mirrors.
    pub rays: RaySets,
    /// Whether it is measured how far the rays of mirrors go.
    fades: bool,
    /// The settings by which rays are weighed; `None` if all are followed.
    pub weighing: Option<MirrorSettings>,
}

impl SurfaceInputs {
    /// # Errors
    /// The method does not know glossy mirrors.
    fn new(
        camera: FrameCamera,
        (settings, methods): (&Settings, &[Method]),
        seen: &Settings,
        [step, reflected_step]: [u32; 2],
        store: &PointStore,
        objects: Objects<'_>,
    ) -> Result<Self> {
        let seen = seen.only(|field| field.affects.surface);
        let with_radii = settings.edl.strength > 0.0 && settings.edl.ignored > 0.0;
        Ok(Self {
            points: PointInputs { camera, settings: seen, step, revision: store.revision(), with_radii },
            formulas: reflection::exact(settings, objects.mirrors).cloned().collect(),
            mirrors: objects.mirrors.to_vec(),
            reflected_step,
            settings: settings.only(|field| field.affects.found),
            counts_steps: matches!(settings.reflection.show, Show::Steps | Show::Unconverged),
            shows_search: settings.reflection.show == Show::Search,
            rays: RaySets::new(settings, methods, store, objects.mirrors)?,
            fades: fades(settings),
            weighing: weighing(settings).cloned(),
        })
    }

    fn has_surface_of(&self, other: &Self) -> bool {
        self.points == other.points && self.formulas == other.formulas
    }
}

/// The light of the samples that are summed so far.
#[derive(Clone, PartialEq)]
pub(crate) struct SummedLight {
    /// The settings that affect shading; the others are at their defaults.
    settings: Settings,
    lights: Vec<MappedLight>,
    sky: Option<Sky>,
    /// Rays of light meet them.
    mirrors: Vec<Mirror>,
    /// The generations of the virtual lights and of the photons, if there are any.
    generations: [Option<u64>; 2],
    reuse: LightReuse,
}

/// The samples of mirrors, or the rays of light, that are summed so far for the surfaces of the last frame.
pub(crate) struct Summed {
    light: SummedLight,
    pub samples: u32,
}

/// What indirect light comes from.
pub(crate) struct Lit {
    pub lights: Vec<MappedLight>,
    pub sky: Option<Sky>,
    pub has_highlights: bool,
    pub has_gloss: bool,
}

/// What the renderer holds of the frames before.
pub(super) struct Before<'a> {
    /// The inputs of the surfaces and the reflected points.
    pub made_from: Option<&'a SurfaceInputs>,
    /// The inputs of the surfaces of the points alone.
    pub splatted_from: Option<&'a PointInputs>,
    /// Whether maps or cameras of reflections lack the newest points.
    pub lacks_points: bool,
}

/// The plan of a frame.
pub(super) struct Plan<'a> {
    pub store: &'a PointStore,
    pub settings: &'a Settings,
    /// The methods of its mirrors; more than one if mirrors have their own.
    pub methods: Vec<Method>,
    pub objects: Objects<'a>,
    pub effort: Effort,
    /// The bounds of all points that are shown.
    pub bounds: Bounds,
    /// The point that the camera turns around.
    pub pivot: DVec3,
    pub camera: FrameCamera,
    /// The settings by which the camera sees points.
    pub seen: Settings,
    /// The points that the camera sees.
    pub points: DrawList,
    pub asked: SurfaceInputs,
    /// Whether all surfaces and reflected points are kept.
    pub is_kept: bool,
    /// Whether the camera's surface is kept, with its mirrors.
    pub surface_is_kept: bool,
    /// Whether the surface of the points is kept.
    pub points_are_kept: bool,
    /// Whether kept maps or cameras of reflections lack the newest points.
    pub lacks_points: bool,
    /// Whether mirrors are followed and may be in the picture. Data that no mirror on the screen needs is not prepared.
    pub has_mirrors: bool,
    /// Whether light goes through something in the picture.
    pub has_clear: bool,
    /// Whether something is clear in a picture whose mirrors are not followed.
    pub has_clear_alone: bool,
    /// The number of samples of mirrors that are summed; 0 if each mirror pixel has one ray.
    pub samples: u32,
    /// Whether a mirror's own light depends on what its rays meet.
    pub fades: bool,
    /// The lights with shadow maps.
    pub lights: Vec<MappedLight>,
    pub shading: Shading,
    pub sky: Option<Sky>,
    pub has_indirect: bool,
    /// The number of rays of light of each pixel; 0 where no rays bring indirect light.
    pub rays: u32,
}

/// The settings of a frame. Colours of the data are shown as they are, whatever exposure and curve are for light. If all
/// mirrors that may be seen have a method of their own, and the same one, it is the frame's.
pub(super) fn settings_of<'a>(store: &PointStore, frame: &Frame<'a>) -> Cow<'a, Settings> {
    let Frame { settings, objects, .. } = *frame;
    let mut chosen = Cow::Borrowed(settings);
    if Lights::chosen(settings, objects).by == Lighting::Colors && settings.tone != Tone::default() {
        chosen.to_mut().tone = Tone::default();
    }
    if settings.reflection.own_methods && store.has_own_methods(objects.mirrors) {
        let [_, camera] = cameras(store, frame, settings);
        if let [only] = methods_of(store, settings, objects.mirrors, &camera)[..] {
            chosen.to_mut().reflection.method = only;
        }
    }
    chosen
}

impl<'a> Plan<'a> {
    /// Plans a frame; `settings` are those of `settings_of`.
    ///
    /// # Errors
    /// The method does not know glossy mirrors.
    pub fn new(store: &'a PointStore, frame: &Frame<'a>, settings: &'a Settings, before: &Before<'_>) -> Result<Self> {
        let Frame { camera, objects, effort, .. } = *frame;
        let bounds = store.bounds();
        let [without_mirrors, camera_with_mirrors] = cameras(store, frame, settings);
        let (seen, points, step) = seen_points(store, &camera_with_mirrors, settings, effort);
        let most_reflected = effort.most_reflected.unwrap_or(u64::MAX).max(1);
        let reflected_step = store.points().div_ceil(most_reflected).clamp(1, MOST_REFLECTED_STEP) as u32;
        let methods = methods_of(store, settings, objects.mirrors, &camera_with_mirrors);
        let steps = [step, reflected_step];
        let asked = SurfaceInputs::new(without_mirrors, (settings, &methods), &seen, steps, store, objects)?;

        let made_from = before.made_from.filter(|_| settings.reflection.keep);
        let is_kept = made_from == Some(&asked) && !before.lacks_points;
        let surface_is_kept = made_from.is_some_and(|made| made.has_surface_of(&asked));
        let points_are_kept = settings.reflection.keep && before.splatted_from == Some(&asked.points);

        let may_show_mirrors = !camera_with_mirrors.mirror_tiles.is_empty();
        let has_mirrors = Reflections::asked(settings) > 0 && may_show_mirrors;
        let mut lights = Lights::mapped(settings, objects, camera, frame.size, bounds);
        if effort.is_moving() && lights.first().is_some_and(|light| light.camera.orthographic) {
            lights.truncate(1);
        }
        let shading = Shading::new(settings, store, objects, lights.len());
        let sky = (shading.light.by == Lighting::Sun).then(|| Sky {
            up: camera.up,
            irradiance: settings.sun.sky,
            near: Region::seen(camera, settings, frame.size, bounds),
        });
        let has_indirect = GlobalIllumination::is_asked(settings, &lights, sky);
        let is_clear_there = may_show_mirrors && reflection::clear::is_there(settings, store, objects.mirrors);
        let (has_clear, has_clear_alone) = (has_mirrors && is_clear_there, !has_mirrors && is_clear_there);
        if has_mirrors {
            check(settings, &methods, has_clear, asked.rays.glossy > 0)?;
        }
        Ok(Self {
            store,
            settings,
            methods,
            objects,
            effort,
            bounds,
            pivot: camera.pivot,
            camera: camera_with_mirrors,
            seen,
            points,
            is_kept,
            surface_is_kept,
            points_are_kept,
            lacks_points: before.lacks_points,
            has_mirrors,
            has_clear,
            has_clear_alone,
            samples: if has_mirrors { asked.rays.summed() } else { 0 },
            fades: asked.fades && has_mirrors,
            has_indirect,
            rays: if has_indirect && settings.gi.by == IndirectBy::Rays { settings.gi.rays_per_pixel } else { 0 },
            asked,
            lights,
            shading,
            sky,
        })
    }

    /// Whether several rays of each mirror pixel are summed.
    pub fn is_sampled(&self) -> bool {
        self.samples > 0
    }

    /// Whether summed rays leave rough mirrors.
    pub fn has_gloss(&self) -> bool {
        self.is_sampled() && self.asked.rays.glossy > 0
    }

    /// Whether rays of mirrors are searched for the frame, or clear surfaces looked up.
    pub fn searches(&self) -> bool {
        self.is_sampled() || (self.has_mirrors || self.has_clear_alone) && !self.is_kept
    }

    /// Whether the camera's surface can be shaded only after all rays of its mirrors, because their share of light
    /// fades with what the rays meet.
    pub fn shades_last(&self) -> bool {
        self.is_sampled() && self.fades
    }

    /// The light of the frame's samples, lit by virtual lights and photons of these generations.
    fn light(&self, generations: [Option<u64>; 2]) -> SummedLight {
        SummedLight {
            settings: self.settings.only(|field| field.affects.shading),
            lights: self.lights.clone(),
            sky: self.sky,
            mirrors: self.objects.mirrors.to_vec(),
            generations,
            reuse: self.effort.light_reuse,
        }
    }

    /// What light by rays that may be taken over depends on. What pictures in motion spare for reflections hardly changes it,
    /// and the finer maps of sun and sky go with the view.
    pub fn reusable(&self, generations: [Option<u64>; 2]) -> SummedLight {
        let mut light = self.light(generations);
        let Reflection { bounces, samples, .. } = Reflection::default();
        (light.settings.reflection.bounces, light.settings.reflection.samples) = (bounces, samples);
        if light.lights.first().is_some_and(|light| light.camera.orthographic) {
            light.lights.truncate(1);
        }
        light.sky = light.sky.map(|sky| Sky { near: None, ..sky });
        light.reuse = LightReuse::Reuse;
        light
    }

    /// What the samples of the frame add to, where `before` is what the frame before has summed, with the generations of the
    /// virtual lights and of the photons. A change of the light needs all samples anew, by their hits.
    pub fn sums(&self, before: Option<Summed>, generations: [Option<u64>; 2]) -> Summed {
        let light = self.light(generations);
        let known = before.filter(|summed| self.is_kept && summed.light == light);
        Summed { samples: known.map_or(0, |summed| summed.samples), light }
    }

    /// The number of samples that are summed when the frame ends, of `all`; it adds those from `first` on.
    pub fn end_of_samples(&self, first: u32, all: u32) -> u32 {
        let at_once = self.effort.most_samples.filter(|_| self.settings.reflection.keep);
        let at_once = at_once.map_or(all, |samples| samples.max(1));
        all.min(first.saturating_add(at_once))
    }

    /// What the frame's indirect light comes from; `None` if it has none.
    pub fn lit(&self) -> Option<Lit> {
        let Shading { has_highlights, has_gloss, .. } = self.shading;
        self.has_indirect.then(|| Lit { lights: self.lights.clone(), sky: self.sky, has_highlights, has_gloss })
    }
}

/// The camera of the frame without the tiles of its mirrors, and with them.
fn cameras(store: &PointStore, frame: &Frame<'_>, settings: &Settings) -> [FrameCamera; 2] {
    let sphere = |bounds: Bounds| {
        if bounds.is_empty() { (frame.camera.pivot, 1.0) } else { (bounds.center(), bounds.radius()) }
    };
    let (center, radius) = sphere(store.reach());
    let mut bare = FrameCamera::new(frame.camera, &settings.view, frame.size, center, radius);
    bare.scene_radius = sphere(store.bounds()).1;
    let spheres = store.mirror_spheres(settings).chain(reflection::mirror_spheres(settings, frame.objects.mirrors));
    // Splats reach at least as far as their smallest size, and closing a gap reaches two pixels further.
    let mirror_tiles = bare.tiles_of(spheres, f64::from(settings.splat.min_pixels) * 0.5 + 2.0);
    [bare, FrameCamera { mirror_tiles, ..bare }]
}

/// The points that the camera sees, with the settings by which they are splatted; one in so many of them is drawn.
fn seen_points(
    store: &PointStore,
    camera: &FrameCamera,
    settings: &Settings,
    effort: Effort,
) -> (Settings, DrawList, u32) {
    let mut seen = settings.clone();
    if !effort.is_moving() {
        seen.splat.max_pixels = seen.splat.max_pixels.max(seen.splat.rest_pixels);
    }
    let mut points = store.draw_list(camera, &seen, Selection::Seen);
    let most_points = effort.most_points.unwrap_or(u64::MAX).max(1);
    let step = (points.points.div_ceil(most_points).clamp(1, MOST_STEP) as u32).max(settings.splat.step);
    if step > 1 {
        // The larger splats cover as much of the picture as all would.
        seen.splat.size *= (step as f32).sqrt();
        points = store.draw_list(camera, &seen, Selection::Seen);
        points.thin(step);
    }
    (seen, points, step)
}
