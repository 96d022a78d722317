//! A loaded scene of a study, with what was traced in it, its still picture, and what `auto` knows of it.

use std::collections::HashMap;
use std::hash::{Hash as _, Hasher as _};
use std::sync::Arc;

use anyhow::anyhow;
use cloud::Progress;
use render::{Aov, Renderer};
use scene::{IndirectBy, Settings};

use crate::auto::{Choice, Explored, Hands};
use crate::cost::CostModel;
use crate::light::{LightError, is_same_surface, light_error};
use crate::metrics::Truth;
use crate::plan::{Case, Plan, PlannedTarget, RAY_TRACE};
use crate::still::{Still, Target, drawn_size, judging_settings};
use crate::subject::Subject;
use crate::truth::{Drawn, TracedScene, Tracer, View, mirrors_of};

/// The difference between the seed of the truth's paths and that of the method `ray_trace`, so that the truth does not
/// contain the method's own noise.
const SEED_STEP: u32 = 0x5eed;

/// A loaded scene, and what was traced in it.
pub struct Loaded {
    pub subject: Subject,
    pub points: u64,
    /// The scene for the ray tracer, with the `splat.size` that it was made for.
    pub traced: Option<(f32, TracedScene)>,
    /// The traced light of pixels, by a hash of all its inputs.
    pub references: HashMap<u64, Arc<Vec<[f32; 3]>>>,
    /// The still picture of the settings that were judged last.
    pub still: Option<(Settings, [u32; 2], Still)>,
    /// What is known of the view, for targets, with the settings that it is known of.
    pub explored: Option<(Settings, [u32; 2], bool, Explored)>,
}

impl Loaded {
    pub fn traced(&mut self, plan: &Plan, splat_size: f32) -> anyhow::Result<()> {
        if self.traced.as_ref().is_none_or(|(size, _)| *size != splat_size) {
            let exact = plan.truths.contains(&Truth::Exact).then(|| self.subject.exact.clone()).flatten();
            let scene = TracedScene::new(&self.subject.parts, exact, splat_size, &Progress::default())?;
            self.traced = Some((splat_size, scene));
            self.references.clear();
        }
        Ok(())
    }

    /// Whether the still picture of a view with these settings is at hand.
    pub fn has_still(&self, case: &Case, settings: &Settings) -> bool {
        let of = judging_settings(settings);
        self.still.as_ref().is_some_and(|(other, size, _)| *other == of && *size == case.size)
    }

    /// Draws the still picture of a view with these settings, unless it is at hand.
    pub fn still(&mut self, case: &Case, settings: &Settings, renderer: &mut Renderer) -> render::Result<()> {
        if !self.has_still(case, settings) {
            let of = judging_settings(settings);
            self.subject.render(renderer, &of, case.size)?;
            let still = Still::read(renderer, &self.subject.camera, &of, case.size)?;
            self.still = Some((of, case.size, still));
        }
        Ok(())
    }

    /// Lets `auto` choose for a setting whose scene was prepared. What the view shows is examined once for all targets.
    pub fn choose(
        &mut self,
        case: &Case,
        settings: &Settings,
        planned: PlannedTarget,
        renderer: &mut Renderer,
        model: &mut CostModel,
    ) -> anyhow::Result<(Target, Choice)> {
        let Self { subject, explored, .. } = self;
        let mut draw = |renderer: &mut Renderer, settings: &Settings, size: [u32; 2]| {
            Ok(subject.render_next(renderer, settings, size)?)
        };
        let mut hands = Hands { renderer, draw: &mut draw, model };
        // Where lights would stand in for rays, a target in pixels leaves light as it is.
        let light_counts =
            settings.gi.by == IndirectBy::Lights || !matches!(planned, PlannedTarget::Fixed(Target::Pixels(_)));
        let is_of = |(of, size, counts, _): &(Settings, [u32; 2], bool, Explored)| {
            of == settings && *size == case.size && *counts == light_counts
        };
        let (_, _, _, known) = match explored.take().filter(is_of) {
            Some(known) => explored.insert(known),
            None => {
                let view = (&subject.camera, case.size);
                let known = Explored::new(settings, &[], view, light_counts, &mut hands)?;
                explored.insert((settings.clone(), case.size, light_counts, known))
            }
        };
        let target = planned.target(known.milliseconds());
        let choice = known.choose(target, &mut hands)?;
        Ok((target, choice))
    }
}

pub fn view<'a>(subject: &'a Subject, settings: &'a Settings, size: [u32; 2]) -> View<'a> {
    View { camera: &subject.camera, settings, objects: subject.objects(), size }
}

pub fn tracer<'a>(traced: &'a Option<(f32, TracedScene)>, view: View<'a>) -> anyhow::Result<Tracer<'a>> {
    let (_, scene) = traced.as_ref().ok_or_else(|| anyhow!("the scene was not traced"))?;
    Ok(Tracer::new(scene, view))
}

/// The frame that the renderer drew last, with the ray tracer's result in it if that is the method; and the ray
/// tracer's milliseconds.
pub fn drawn(loaded: &Loaded, case: &Case, settings: &Settings, renderer: &Renderer) -> anyhow::Result<(Drawn, f64)> {
    let tracer = tracer(&loaded.traced, view(&loaded.subject, settings, drawn_size(case.size, settings)))?;
    let mut drawn = tracer.drawn(renderer)?;
    let is_traced = case.method == RAY_TRACE;
    let milliseconds = if is_traced { tracer.ray_trace(&mut drawn, &Progress::default())?.milliseconds } else { 0.0 };
    Ok((drawn, milliseconds))
}

/// Which light of the truth is compared with a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// All light that mirrors show.
    Mirrors,
    /// The indirect light that the surfaces themselves send out.
    Indirect,
}

/// What the truth sees at each pixel, and its light there; the light is kept, as several settings share it.
pub fn reference(
    loaded: &mut Loaded,
    plan: &Plan,
    case: &Case,
    settings: &Settings,
    truth: Truth,
    drawn: &Drawn,
    wanted: Wanted,
) -> anyhow::Result<(crate::truth::Seen, Arc<Vec<[f32; 3]>>)> {
    let mut traced = settings.clone();
    traced.trace.samples = plan.truth_samples;
    traced.trace.seed = settings.trace.seed.wrapping_add(SEED_STEP);
    let Loaded { subject, traced: scene, references, .. } = loaded;
    let tracer = tracer(scene, view(subject, &traced, drawn_size(case.size, settings)))?;
    let progress = Progress::default();
    let seen = match truth {
        Truth::SameInput => tracer.seen(&drawn.surface),
        Truth::Exact => tracer.exactly_seen(&progress)?,
    };
    let Settings { view, light, sun, gi, mirror, reflection, .. } = settings;
    let mut hasher = std::hash::DefaultHasher::new();
    let lit = (view, light, sun, gi.bounces, mirror, reflection.bounces, &traced.trace);
    // Where no method finds reflections, mirrors send on the light of a diffuse surface.
    let method = (wanted == Wanted::Indirect).then_some(reflection.method);
    format!("{wanted:?} {method:?} {truth:?} {:?} {lit:?}", drawn_size(case.size, settings)).hash(&mut hasher);
    if truth == Truth::SameInput {
        drawn
            .surface
            .images()
            .iter()
            .for_each(|image| image.iter().for_each(|value| hasher.write_u32(value.to_bits())));
    }
    let key = hasher.finish();
    let reference = match references.get(&key) {
        Some(reference) => reference.clone(),
        None => {
            let reference = Arc::new(match wanted {
                Wanted::Mirrors => tracer.colors(truth, &mirrors_of(&seen), &progress)?,
                Wanted::Indirect => tracer.indirect(truth, &seen, &progress)?,
            });
            references.insert(key, reference.clone());
            reference
        }
    };
    Ok((seen, reference))
}

/// The error of the indirect light of the frame that was rendered last, over the pixels that show the truth's surface.
pub fn error_of_light(
    loaded: &mut Loaded,
    plan: &Plan,
    case: &Case,
    settings: &Settings,
    truth: Truth,
    (drawn, renderer): (&Drawn, &Renderer),
) -> anyhow::Result<LightError> {
    let (seen, light) = reference(loaded, plan, case, settings, truth, drawn, Wanted::Indirect)?;
    let own = tracer(&loaded.traced, view(&loaded.subject, settings, drawn_size(case.size, settings)))?;
    let own = own.seen(&drawn.surface);
    let pairs = own.iter().zip(&seen).map(|(own, seen)| own.zip(*seen));
    let is_same =
        pairs.map(|pair| pair.is_some_and(|((own, _), (hit, _))| is_same_surface(own.normal, own.albedo, &hit)));
    let same: Vec<bool> = is_same.collect();
    Ok(light_error(&same, renderer.read_aov(Aov::Indirect)?.data.as_chunks::<3>().0, &light))
}
