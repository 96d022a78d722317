//! The chapters of a frame, in their order: surface, mirrors, light, shade, show.

use scene::{Curve, LightView, Lighting, Method, Settings, Show};

use super::plan::{Plan, Summed};
use crate::caustics::{Caustics, PhotonScene, Thrown};
use crate::exposure::{self, ExposureMeter};
use crate::frame::{FrameCamera, Tiles};
use crate::gi::{Brought, GlobalIllumination};
use crate::gpu::{Gpu, Result};
use crate::inputs::Inputs;
use crate::layout::ShownPoint;
use crate::light_rays::{self, LightRays, RayShare};
use crate::light_views;
use crate::lighting::{DrawnMap, Lights};
use crate::method::{self, Views};
use crate::passes;
use crate::recorder::Recorder;
use crate::reflection::gloss::RaySet;
use crate::reflection::kept_hits::{GlossCache, Scenery};
use crate::reflection::{Bounce, Part, Parts, Reflections, Search, SurfaceImages};
use crate::shading::{FrameLight, Reflected};
use crate::store::draw_list::Selection;
use crate::surface::{lay_mirrors, see_clear_points, splat_surface};
use crate::targets::{Image, Targets, uniform_buffer};

/// The samples of mirrors that a frame has summed.
pub(super) struct Samples {
    /// What is summed; `None` if each mirror pixel has one ray.
    pub summed: Option<Summed>,
    /// Whether the hits of the rays of rough mirrors are kept.
    pub hits: GlossCache,
}

/// Makes the surface that the camera sees, as far as it is not kept: points, and mirrors that are drawn by
/// their formula, which are `formulas`.
///
/// # Errors
/// A shader is refused.
pub(super) fn surface(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    inputs: &Inputs,
    targets: &mut Targets,
    formulas: Option<&wgpu::Buffer>,
) -> Result<()> {
    let Plan { store, settings, .. } = plan;
    if plan.is_kept {
        return Ok(());
    }
    if !plan.points_are_kept {
        let atomics64 = recorder.gpu.has_wide_atomics(&settings.splat);
        splat_surface(recorder, inputs, settings, targets, (atomics64, plan.asked.points.with_radii))?;
        if store.has_clear_points(settings) {
            see_clear_points(recorder, inputs, targets)?;
        }
    }
    if !plan.surface_is_kept {
        lay_mirrors(recorder, inputs, targets, formulas)?;
    }
    Ok(())
}

/// What the frame's mirror rays are searched in, with the mirrors that are drawn by their formula.
pub(super) fn search<'a>(
    gpu: &Gpu,
    plan: &'a Plan<'_>,
    formulas: Option<wgpu::Buffer>,
    targets: &'a Targets,
) -> Search<'a> {
    let Plan { store, settings, objects, methods, camera, .. } = plan;
    let step = plan.asked.reflected_step;
    let supply = |settings: &Settings| {
        let mut everywhere = store.draw_list(camera, settings, method::supply(settings));
        everywhere.thin(step);
        Inputs::new(gpu, *camera, settings, &everywhere)
    };
    let part = |method: &Method| {
        let mut settings = (*settings).clone();
        settings.reflection.method = *method;
        Part { supply: supply(&settings), settings }
    };
    let parts = (methods.len() > 1).then(|| methods.iter().map(part).collect());
    let parts = parts.map(|each| Parts { each, nearest: &targets.nearest });
    let supply = supply(settings);
    let camera = SurfaceImages::of_camera(targets);
    Search { supply, settings, store, mirrors: objects.mirrors, formulas, camera, parts }
}

/// Finds what is seen through clear surfaces, and what perfect mirrors show by one ray of each pixel. Several rays of a
/// pixel are found by `shade`, which sums their light.
///
/// # Errors
/// A shader is refused, or there is no memory.
pub(super) fn mirrors(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    search: Option<&mut Search<'_>>,
    targets: &Targets,
    reflections: &mut Reflections,
) -> Result<()> {
    let Plan { store, settings, .. } = plan;
    reflections.expect(settings, &plan.methods, [plan.has_clear, plan.has_clear_alone]);
    if let Some(search) = search.as_deref().filter(|_| !plan.is_kept) {
        let points = targets.clear_points.as_ref().filter(|_| store.has_clear_points(settings));
        if plan.has_clear {
            reflections.look_through(recorder, search, points)?;
        } else if plan.has_clear_alone {
            reflections.look_at_clear(recorder, search, points)?;
        }
    }
    if !plan.has_mirrors {
        reflections.none();
    } else if let Some(search) = search.filter(|_| !plan.is_sampled()) {
        reflections.find(recorder, search, RaySet::PERFECT)?;
    }
    Ok(())
}

/// Draws the shadow maps of lights, except for those in `at_hand`, finds what mirrors throw from them, and places virtual
/// lights. Returns the maps.
///
/// # Errors
/// A shader is refused, or there is no memory.
pub(super) fn light(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    lights: &mut Lights,
    (gi, caustics): (&mut GlobalIllumination, &mut Caustics),
    reflections: &mut Reflections,
    at_hand: Vec<DrawnMap>,
) -> Result<Vec<DrawnMap>> {
    let Plan { store, settings, objects, lights: mapped, camera, sky, .. } = plan;
    lights.upload(recorder.gpu, mapped, camera.eye);
    let (may_lag, atomics64) = (plan.effort.light_may_lag, recorder.gpu.has_wide_atomics(&settings.splat));
    let maps = lights.draw_shadows(recorder, store, settings, mapped, at_hand, may_lag, atomics64)?;
    let scene = PhotonScene { store, settings, mirrors: objects.mirrors, lights: mapped, camera };
    caustics.trace(recorder, &scene, reflections)?;
    if plan.has_indirect {
        gi.place(recorder, *camera, store, settings, (mapped, caustics.thrown(), *sky), &lights.shadows)?;
    }
    Ok(maps)
}

/// Adds rays of light to the sums, which are those of `before` where nothing else has changed; `kept` are their images,
/// which are made if there are rays. Returns the number that is summed.
///
/// # Errors
/// A shader is refused, the picture is too large for the adapter, or there is no memory.
pub(super) fn light_rays(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    formulas: Option<wgpu::Buffer>,
    targets: &Targets,
    reflections: &mut Reflections,
    (lights, thrown, gi): (&Lights, Option<&Thrown>, &mut GlobalIllumination),
    kept: &mut Option<LightRays>,
    before: Option<Summed>,
) -> Result<Option<Summed>> {
    let Plan { store, settings, objects, camera, .. } = plan;
    if plan.rays == 0 {
        *kept = None;
        return Ok(None);
    }
    let gpu = recorder.gpu;
    let (rays, before) = match kept.take() {
        Some(rays) if rays.size() == targets.size => (rays, before),
        Some(rays) => (rays.resized(gpu, targets.size)?, None),
        None => (LightRays::new(gpu, targets.size)?, None),
    };
    let rays = kept.insert(rays);
    let generations = [gi.generation(), thrown.map(|thrown| thrown.generation)];
    let mut sums = plan.sums(before, generations);
    let numbers = sums.samples..plan.end_of_samples(sums.samples, plan.rays);
    if numbers.is_empty() {
        return Ok(Some(sums));
    }
    // Every pixel has rays, and every point that is shown may stop them.
    let camera = FrameCamera { mirror_tiles: Tiles::of(targets.size), ..*camera };
    let with_mirrors = formulas.is_none();
    let selection = if with_mirrors { Selection::EverywhereWithMirrors } else { Selection::Everywhere };
    let supply = Inputs::new(gpu, camera, settings, &store.draw_list(&camera, settings, selection));
    let surface = SurfaceImages::of_camera(targets);
    let mirrors = objects.mirrors;
    let mut search = Search { supply, settings, store, mirrors, formulas, camera: surface, parts: None };
    let shown = light_rays::settings_where_met(settings);
    let mut shading = plan.shading;
    // The lamp at the eye is no light of the scene.
    shading.light.fill = 0.0;
    let mut light = FrameLight {
        settings: &shown,
        lights,
        thrown,
        gi: Some(gi),
        shading,
        camera: surface,
        // A mirror's own light is its diffuse part alone where its reflections are followed.
        bounces: if Reflections::asked(settings) > 0 { usize::MAX } else { 0 },
        received: None,
        direct: &targets.direct,
        color: &targets.color,
        first_receiver: 0,
        brought: None,
        met_bounces: Some(settings.gi.bounces.saturating_sub(LightRays::bounces_of(&settings.gi))),
    };
    let Reflections { methods, counters, .. } = reflections;
    let share = RayShare {
        numbers: numbers.clone(),
        total: plan.rays,
        has_sky: plan.sky.is_some(),
        mirrors: if store.has_mirrors() || !with_mirrors { Reflections::asked(settings) } else { 0 },
        counters,
        reuse: plan.effort.light_reuse,
        source: plan.reusable(generations),
        revision: store.revision(),
    };
    rays.add(recorder, &mut search, &mut light, &mut methods.index, &share)?;
    sums.samples = numbers.end;
    Ok(Some(sums))
}

/// Shades all surfaces, and blends what mirrors show into the camera's; `before` is what the frame before has summed.
///
/// # Errors
/// A shader is refused, or there is no memory.
pub(super) fn shade(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    inputs: &mut Inputs,
    search: Option<&mut Search<'_>>,
    targets: &Targets,
    reflections: &mut Reflections,
    (lights, thrown): (&Lights, Option<&Thrown>),
    (gi, brought): (&mut GlobalIllumination, Option<Brought<'_>>),
    before: Option<Summed>,
) -> Result<Samples> {
    let settings = plan.settings;
    let generation = gi.generation().filter(|_| plan.has_indirect);
    let sums = plan.sums(before, [generation, thrown.map(|thrown| thrown.generation)]);
    let mut light = FrameLight {
        settings,
        lights,
        thrown,
        gi: plan.has_indirect.then_some(gi),
        shading: plan.shading,
        camera: SurfaceImages::of_camera(targets),
        bounces: if plan.has_mirrors { Reflections::asked(settings) } else { 0 },
        received: None,
        direct: &targets.direct,
        color: &targets.color,
        first_receiver: 0,
        brought,
        met_bounces: None,
    };
    if !plan.shades_last() {
        light.shade(recorder, inputs, reflections.found(), 0)?;
    }
    if plan.has_clear {
        // Receivers of their own, after those of the reflections.
        light.first_receiver = Reflections::asked(settings);
        light.shade_bounces(recorder, inputs, reflections.beyond())?;
        light.first_receiver = 0;
    }
    if !plan.has_gloss() {
        reflections.forget_hits();
    }
    let samples = match search.filter(|_| plan.is_sampled()) {
        Some(search) => sum_samples(recorder, plan, inputs, search, reflections, &mut light, sums)?,
        None => {
            light.shade_bounces(recorder, inputs, reflections.found())?;
            Samples { summed: None, hits: GlossCache::NoGloss }
        }
    };
    let mut received = None;
    if plan.is_sampled() {
        let normals = plan.has_gloss().then_some(light.camera.normal);
        received = reflections.received(recorder, inputs, settings, normals)?;
    }
    if plan.shades_last() {
        light.received = received;
        light.shade(recorder, inputs, reflections.found(), 0)?;
    }
    if let Some(clear) = reflections.clear() {
        clear.blend(recorder, inputs, reflections.found(), received)?;
        received = Some(&clear.received);
    }
    let is_found = plan.has_mirrors && !plan.is_sampled();
    let otherwise = if is_found { Reflected::Found } else { Reflected::Nothing };
    light.blend(recorder, inputs, reflections.found(), 0, received.map_or(otherwise, Reflected::Received))?;
    Ok(samples)
}

/// Follows the rays of mirrors that the frame adds to `sums`, sample by sample, and sums their light.
fn sum_samples(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    inputs: &mut Inputs,
    search: &mut Search<'_>,
    reflections: &mut Reflections,
    light: &mut FrameLight<'_>,
    mut sums: Summed,
) -> Result<Samples> {
    let Plan { store, settings, asked, .. } = plan;
    let (first, end) = (sums.samples, plan.end_of_samples(sums.samples, plan.samples));
    let mut hits = GlossCache::NoGloss;
    if plan.has_gloss() {
        let found_by = (&asked.settings, asked.weighing.as_ref());
        let scenery = Scenery::new(plan.camera, found_by, asked.points.step, store, plan.objects.mirrors);
        hits = reflections.begin_gloss(recorder, search, scenery, plan.samples, first == 0);
    }
    let kept_as = |set: u32| (hits == GlossCache::Kept).then_some(set);
    for sample in first..end {
        let rays = RaySet { kept_as: kept_as(sample), ..asked.rays.rays(sample) };
        reflections.find(recorder, search, rays)?;
        inputs.set_sample(recorder.gpu, rays.sample);
        light.surfaces_changed();
        light.shade_bounces(recorder, inputs, reflections.found())?;
        reflections.sum(recorder, inputs, settings, plan.has_gloss())?;
    }
    if first < end && end == plan.samples && !asked.rays.rays(end - 1).is_perfect() {
        // Statistics, images of what mirrors see, and probes are those of perfect mirrors.
        let rays = RaySet { kept_as: kept_as(plan.samples), ..RaySet::PERFECT };
        reflections.find(recorder, search, rays)?;
    }
    sums.samples = end;
    Ok(Samples { summed: Some(sums), hits })
}

/// Whether the frame's tones are mapped by the curve of film.
pub(super) fn is_filmic(plan: &Plan<'_>) -> bool {
    match plan.settings.tone.curve {
        // The colours of the data are not mapped.
        Curve::Auto => matches!(plan.shading.light.by, Lighting::Lights | Lighting::Sun),
        curve => curve == Curve::Filmic,
    }
}

/// Fits the exposure, and writes the picture: the frame, or what the settings show instead of it.
///
/// # Errors
/// A shader is refused.
pub(super) fn show(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    inputs: &Inputs,
    targets: &Targets,
    reflections: &Reflections,
    (lights, gi): (&Lights, &GlobalIllumination),
    exposure: &mut ExposureMeter,
) -> Result<()> {
    let settings = plan.settings;
    if exposure::is_fitted(settings, plan.shading.light) {
        exposure.fit(recorder, inputs, (&targets.color, targets), plan.effort.adaptation)?;
    } else {
        exposure.is_used = false;
    }
    let is_filmic = is_filmic(plan);
    if settings.light.show != LightView::Picture {
        let shown = light_views::FrameInputs {
            targets,
            lights,
            mapped: &plan.lights,
            virtual_lights: gi.lights().filter(|_| plan.has_indirect),
            indirect: gi.radiance(0).filter(|_| plan.has_indirect),
            bounds: plan.bounds,
            is_filmic,
        };
        return light_views::show(recorder, inputs, settings, &shown);
    }
    let views = reflections.views();
    match reflections.first() {
        Some(bounce) if settings.reflection.show == Show::Error => {
            show_error(recorder, plan, inputs, targets, bounce, is_filmic)
        }
        Some(bounce) if method::shows_more(settings, views.as_ref()) => {
            show_work(recorder, inputs, targets, (bounce, &reflections.doubt), views.as_ref(), is_filmic)
        }
        _ => {
            let bindings = targets.presented(&targets.color);
            recorder.over_pixels(&[("is_filmic", u32::from(is_filmic))], inputs, bindings)
        }
    }
}

/// Shows the error function of a point's search in place of mirrors.
fn show_error(
    recorder: &mut Recorder<'_>,
    plan: &Plan<'_>,
    inputs: &Inputs,
    targets: &Targets,
    bounce: &Bounce,
    is_filmic: bool,
) -> Result<()> {
    let point = plan.settings.reflection.shown_point().unwrap_or(plan.pivot);
    let shown = ShownPoint { position: (point - plan.camera.eye).as_vec3().extend(0.0) };
    let shown = uniform_buffer(recorder.gpu, bytemuck::bytes_of(&shown));
    let bindings = passes::show_error {
        shown: shown.as_entire_binding(),
        color_in: targets.color.bind(),
        point_in: bounce.mirror.point.bind(),
        normal_in: targets.surface().normal.bind(),
        eye_in: bounce.mirror.eye.bind(),
        picture_out: targets.picture.bind(),
    };
    recorder.over_pixels(&[("is_filmic", u32::from(is_filmic))], inputs, bindings)
}

/// Shows what the first bounce has found, or how its method came to that, in place of mirrors.
fn show_work(
    recorder: &mut Recorder<'_>,
    inputs: &Inputs,
    targets: &Targets,
    (bounce, doubt): (&Bounce, &Image),
    views: Option<&Views<'_>>,
    is_filmic: bool,
) -> Result<()> {
    let [albedo_in, normal_in, position_in] = bounce.seen.bind();
    let bindings = passes::show {
        color_in: targets.color.bind(),
        point_in: bounce.mirror.point.bind(),
        albedo_in,
        normal_in,
        position_in,
        // A view that the method does not have is not shown.
        views_in: views.map_or(doubt, |views| views.image).bind(),
        doubt_in: doubt.bind(),
        picture_out: targets.picture.bind(),
    };
    let most_steps = views.map_or(1, |views| views.most_steps);
    recorder.over_pixels(&[("most_steps", most_steps), ("is_filmic", u32::from(is_filmic))], inputs, bindings)
}
