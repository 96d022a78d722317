//! The cost model: how many milliseconds a pass takes for each point, pixel, mirror pixel and virtual light. It learns
//! from the pass times of the running machine, predicts the time of frames that were not drawn, and says what makes a
//! frame slow.
//!
//! The time of a pass is a sum of drivers, each with a coefficient that is not negative. The stage of the pass decides
//! which drivers there are. The coefficients are those of the weighted least squares over all frames so far; a frame
//! weighs by the inverse square of its time, so that the relative error counts, and old frames fade. A model is kept as
//! these sums.

use std::collections::BTreeMap;

use param::Choice as _;
use render::{FrameStats, PassStage};
use scene::{IndirectBy, Settings};
use serde::{Deserialize, Serialize};

use crate::auto::KnownErrors;

/// What the time of a pass grows with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Driver {
    /// Nothing: it is the same in every frame.
    Frame,
    /// The points that the camera sees.
    PointsDrawn,
    /// The points on the GPU.
    Points,
    Pixels,
    /// The pixels that show a mirror, counted for each bounce.
    MirrorPixels,
    /// The virtual lights.
    Lights,
    /// The points that are splatted into the shadow maps of virtual lights.
    ShadowPoints,
    /// The texels of these shadow maps.
    ShadowTexels,
    /// The pixels, times the virtual lights that light each, or the places where its rays of light end.
    LitPixels,
    /// The pixels, times the rays of light of each, those of further bounces among them.
    LightRays,
}

use Driver::{
    Frame, LightRays, Lights, LitPixels, MirrorPixels, Pixels, Points, PointsDrawn, ShadowPoints, ShadowTexels,
};

impl Driver {
    /// The name for people.
    pub fn name(self) -> &'static str {
        match self {
            Frame => "frame",
            PointsDrawn => "point drawn",
            Points => "point on the GPU",
            Pixels => "pixel",
            MirrorPixels => "mirror pixel",
            Lights => "virtual light",
            ShadowPoints => "point in shadow maps",
            ShadowTexels => "texel of shadow maps",
            LitPixels => "pixel and virtual light",
            LightRays => "ray of light",
        }
    }

    /// The parameter that lowers it, as far as it can be lowered from the given settings.
    pub fn lever(self, settings: &Settings) -> Option<&'static str> {
        match self {
            Frame | Points => None,
            PointsDrawn => Some("splat.step"),
            Pixels => Some("view.resolution"),
            MirrorPixels => Some("reflection.method"),
            Lights | ShadowPoints if settings.gi.shadows => Some("gi.shadow_points"),
            ShadowTexels => Some("gi.shadow_size"),
            LightRays => Some("gi.rays_per_pixel"),
            LitPixels if settings.gi.interleave < 8 => Some("gi.interleave"),
            Lights | ShadowPoints | LitPixels => Some("gi.vpls"),
        }
    }
}

/// The drivers of the passes of a stage.
fn drivers(stage: PassStage) -> &'static [Driver] {
    match stage {
        PassStage::Surface => &[Frame, PointsDrawn, Pixels],
        PassStage::Method => &[Frame, Points, Pixels, MirrorPixels],
        PassStage::Light => {
            &[Frame, Points, Pixels, MirrorPixels, Lights, ShadowPoints, ShadowTexels, LitPixels, LightRays]
        }
        PassStage::View => &[Frame, Pixels],
    }
}

/// How much there is of each driver in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Workload {
    pub points_drawn: f64,
    pub points: f64,
    pub pixels: f64,
    pub mirror_pixels: f64,
    /// The pixels that show a mirror, whatever the bounces.
    pub mirrors: f64,
    pub lights: f64,
    pub shadow_points: f64,
    pub shadow_texels: f64,
    pub lit_pixels: f64,
    pub light_rays: f64,
}

impl Workload {
    /// What a frame of `size` pixels did.
    pub fn of(stats: &FrameStats, settings: &Settings, size: [u32; 2]) -> Self {
        let mirrors = stats.reflection.map_or(0.0, |reflection| f64::from(reflection.mirror_pixels));
        let measured = Self {
            points_drawn: stats.points_drawn as f64,
            points: stats.points_resident as f64,
            pixels: size.map(f64::from).iter().product(),
            mirrors,
            lights: f64::from(stats.virtual_lights),
            ..Self::default()
        };
        measured.lit(settings)
    }

    /// The frame with other settings; `from` are those that it had. The points that are drawn, the pixels and the
    /// number of virtual lights follow from the settings.
    pub fn with(&self, from: &Settings, to: &Settings) -> Self {
        let side = f64::from(to.view.resolution) / f64::from(from.view.resolution);
        let lights = |settings: &Settings| f64::from(settings.gi.vpls) * f64::from(settings.gi.bounces);
        // Lights of the sky stay.
        let sky = (self.lights - lights(from)).max(0.0);
        let changed = Self {
            points_drawn: self.points_drawn * f64::from(from.splat.step) / f64::from(to.splat.step),
            pixels: self.pixels * side * side,
            mirrors: self.mirrors * side * side,
            lights: if self.lights > 0.0 { sky + lights(to) } else { 0.0 },
            ..*self
        };
        changed.lit(to)
    }

    /// The same view with another number of pixels; `settings` are those that it has.
    pub fn of_pixels(&self, pixels: f64, settings: &Settings) -> Self {
        let mirrors = self.mirrors * pixels / self.pixels.max(1.0);
        Self { pixels, mirrors, ..*self }.lit(settings)
    }

    /// Adds what follows from the settings.
    fn lit(self, settings: &Settings) -> Self {
        let Settings { gi, reflection, .. } = settings;
        let is_reflected = reflection.method != scene::Method::None;
        let mirror_pixels = if is_reflected { self.mirrors * f64::from(reflection.bounces) } else { 0.0 };
        let shadowed = if gi.shadows { self.lights } else { 0.0 };
        let each = self.lights / f64::from(gi.interleave * gi.interleave).max(1.0);
        let has_rays = self.lights > 0.0 && gi.by == IndirectBy::Rays;
        let paths = if has_rays { self.pixels * f64::from(gi.rays_per_pixel) } else { 0.0 };
        let lit = if has_rays { paths } else { self.pixels };
        Self {
            mirror_pixels,
            shadow_points: shadowed * f64::from(gi.shadow_points).min(self.points),
            shadow_texels: shadowed * f64::from(gi.shadow_size * gi.shadow_size),
            lit_pixels: (lit + mirror_pixels) * each,
            light_rays: paths * f64::from(gi.ray_bounces),
            ..self
        }
    }

    /// How much there is of a driver, in an amount that is near 1 in common frames, so that coefficients compare.
    fn amount(&self, driver: Driver) -> f64 {
        let millions = |count: f64| count * 1e-6;
        match driver {
            Frame => 1.0,
            PointsDrawn => millions(self.points_drawn),
            Points => millions(self.points),
            Pixels => millions(self.pixels),
            MirrorPixels => millions(self.mirror_pixels),
            Lights => self.lights * 0.01,
            ShadowPoints => millions(self.shadow_points),
            ShadowTexels => millions(self.shadow_texels),
            LitPixels => millions(self.lit_pixels) * 0.01,
            LightRays => millions(self.light_rays),
        }
    }
}

/// What of the settings decides which passes a stage has and how they do their work. Passes of another variant are
/// other passes.
fn variant(stage: PassStage, settings: &Settings, work: &Workload) -> String {
    match stage {
        PassStage::Surface => settings.splat.quality.name().to_owned(),
        PassStage::Method if work.mirror_pixels > 0.0 => {
            let row = settings.reflection.method.chosen().row();
            let group = settings.groups().into_iter().find(|params| Some(params.group().name) == row.group);
            let differing = group.map(param::differing).unwrap_or_default();
            let differing = differing.into_iter().map(|(key, value)| format!(" {key}={value:?}"));
            std::iter::once(row.name.to_owned()).chain(differing).collect()
        }
        PassStage::Method => "none".to_owned(),
        PassStage::Light if work.light_rays > 0.0 => "indirect by rays".to_owned(),
        PassStage::Light if work.lights > 0.0 => "indirect".to_owned(),
        PassStage::Light => "direct".to_owned(),
        PassStage::View => String::new(),
    }
}

/// The sums from which the coefficients of a pass follow.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sums {
    /// For each pair of drivers the weighted sum of the products of their amounts.
    products: Vec<f64>,
    /// For each driver the weighted sum of the products of its amount and the milliseconds.
    times: Vec<f64>,
}

impl Sums {
    fn fade(&mut self, share: f64) {
        self.products.iter_mut().chain(&mut self.times).for_each(|sum| *sum *= share);
    }

    fn add(&mut self, amounts: &[f64], milliseconds: f64, weight: f64) {
        let count = amounts.len();
        self.products.resize(count * count, 0.0);
        self.times.resize(count, 0.0);
        for (row, amount) in amounts.iter().enumerate() {
            for (column, other) in amounts.iter().enumerate() {
                self.products[row * count + column] += weight * amount * other;
            }
            self.times[row] += weight * amount * milliseconds;
        }
    }

    /// The least squares with no negative coefficient (Lawson, Hanson 1974, chapter 23), on the normal equations.
    fn coefficients(&self) -> Vec<f64> {
        /// A driver comes in if it lowers the squares by more than this share of them.
        const WORTHWHILE: f64 = 1e-9;
        let count = self.times.len();
        // Relative to the size of each driver, so that all count alike.
        let sizes: Vec<f64> = (0..count).map(|index| self.products[index * count + index].sqrt()).collect();
        let product = |row: usize, column: usize| self.products[row * count + column] / (sizes[row] * sizes[column]);
        let times: Vec<f64> = self.times.iter().zip(&sizes).map(|(time, size)| time / size).collect();
        let most = times.iter().filter(|time| time.is_finite()).fold(0.0_f64, |most, time| most.max(time.abs()));
        let mut solved = vec![0.0; count];
        let mut used: Vec<usize> = Vec::new();
        // Each round lets a driver in; those that it makes negative go out. Rounding errors could make that endless.
        for _ in 0..3 * count {
            let slope = |row: usize| {
                times[row] - (0..count).map(|other| gain(&solved, other, product(row, other))).sum::<f64>()
            };
            let unused = (0..count).filter(|index| !used.contains(index) && sizes[*index] > 0.0);
            let slopes = unused.map(|index| (index, slope(index)));
            let best = slopes.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, slope)| *slope > WORTHWHILE * most);
            let Some((index, _)) = best else { break };
            used.push(index);
            loop {
                let wanted = solution(&used, &product, &times);
                // How far towards the solution no driver becomes negative.
                let reach = used.iter().zip(&wanted).filter(|(_, wanted)| **wanted <= 0.0);
                let reach =
                    reach.map(|(index, wanted)| solved[*index] / (solved[*index] - wanted).max(f64::MIN_POSITIVE));
                let reach = reach.fold(1.0_f64, f64::min);
                for (index, wanted) in used.iter().zip(&wanted) {
                    solved[*index] += reach * (wanted - solved[*index]);
                }
                if reach >= 1.0 {
                    break;
                }
                used.retain(|index| solved[*index] > 1e-12 * most);
                (0..count).filter(|index| !used.contains(index)).for_each(|index| solved[index] = 0.0);
            }
        }
        solved.iter().zip(&sizes).map(|(value, size)| if *size > 0.0 { value / size } else { 0.0 }).collect()
    }
}

/// What a driver contributes; nothing if it is not used, whatever its products are.
fn gain(solved: &[f64], index: usize, product: f64) -> f64 {
    if solved[index] > 0.0 { solved[index] * product } else { 0.0 }
}

/// Solves the equations of the rows and columns that are used, by elimination with pivots from the diagonal.
fn solution(used: &[usize], product: &impl Fn(usize, usize) -> f64, times: &[f64]) -> Vec<f64> {
    /// Keeps drivers apart that always grew together.
    const RIDGE: f64 = 1e-10;
    let count = used.len();
    let mut rows: Vec<Vec<f64>> = used
        .iter()
        .map(|row| {
            let products = used.iter().map(|column| product(*row, *column) + if row == column { RIDGE } else { 0.0 });
            products.chain([times[*row]]).collect()
        })
        .collect();
    for pivot in 0..count {
        for row in (0..count).filter(|row| *row != pivot) {
            let factor = rows[row][pivot] / rows[pivot][pivot];
            let (from, to) = match row < pivot {
                true => {
                    let (before, after) = rows.split_at_mut(pivot);
                    (&after[0], &mut before[row])
                }
                false => {
                    let (before, after) = rows.split_at_mut(row);
                    (&before[pivot], &mut after[0])
                }
            };
            to.iter_mut().zip(from).for_each(|(to, from)| *to -= factor * from);
        }
    }
    (0..count).map(|row| rows[row][count] / rows[row][row]).collect()
}

/// The cost model of one adapter.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CostModel {
    /// By stage, variant and pass.
    stages: BTreeMap<String, BTreeMap<String, BTreeMap<String, Sums>>>,
    /// The errors that changes of settings had in views before.
    #[serde(default)]
    pub(crate) errors: KnownErrors,
}

/// The part of the sums that a further frame leaves of those before it: of a hundred frames ago an eighth is left.
const FADING: f64 = 0.98;

const STAGES: [PassStage; 4] = [PassStage::Surface, PassStage::Method, PassStage::Light, PassStage::View];

impl CostModel {
    /// Reads a model. Passes whose sums are those of other drivers come from another version, and are learned anew.
    ///
    /// # Errors
    /// The text is no model, with what is wrong.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut model: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        for stage in STAGES {
            let count = drivers(stage).len();
            let Some(variants) = model.stages.get_mut(stage.name()) else { continue };
            let is_own = |sums: &Sums| sums.products.len() == count * count && sums.times.len() == count;
            variants.retain(|_, passes| passes.values().all(is_own));
            for (name, Sums { products, times }) in variants.values().flatten() {
                if products.iter().chain(times).any(|sum| !sum.is_finite()) {
                    return Err(format!("a time of the pass {name} is no number"));
                }
            }
        }
        if !model.errors.are_sound() {
            return Err("an error is no number".to_owned());
        }
        Ok(model)
    }

    /// The text that [`CostModel::parse`] reads.
    pub fn to_text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    pub fn is_empty(&self) -> bool {
        self.stages.is_empty()
    }

    /// Lets what was learned so far weigh less.
    pub fn fade(&mut self, share: f64) {
        let passes = self.stages.values_mut().flat_map(BTreeMap::values_mut).flat_map(BTreeMap::values_mut);
        passes.for_each(|sums| sums.fade(share));
    }

    /// Lets all passes take so many times what they took.
    pub fn scale(&mut self, factor: f64) {
        let passes = self.stages.values_mut().flat_map(BTreeMap::values_mut).flat_map(BTreeMap::values_mut);
        passes.flat_map(|sums| &mut sums.times).for_each(|time| *time *= factor);
    }

    /// Learns from a frame that was drawn from scratch, of `size` pixels. A frame for which passes were compiled says
    /// nothing: do not hand it over.
    pub fn learn(&mut self, stats: &FrameStats, settings: &Settings, size: [u32; 2]) {
        self.learn_frame(stats, settings, size, true);
    }

    /// Learns from the passes of a frame that may have kept work of the one before.
    pub fn learn_parts(&mut self, stats: &FrameStats, settings: &Settings, size: [u32; 2]) {
        self.learn_frame(stats, settings, size, false);
    }

    fn learn_frame(&mut self, stats: &FrameStats, settings: &Settings, size: [u32; 2], is_whole: bool) {
        let work = Workload::of(stats, settings, size);
        let total: f64 = stats.passes.iter().map(|pass| pass.milliseconds).sum();
        if !(total.is_finite() && total > 0.0) {
            return;
        }
        for stage in STAGES {
            let mut times: BTreeMap<&str, f64> = BTreeMap::new();
            for pass in stats.passes.iter().filter(|pass| pass.stage == stage) {
                *times.entry(pass.name).or_default() += pass.milliseconds;
            }
            // Rays of light are summed over several frames, and the frame does not say how many of them it added.
            let is_sum = stage == PassStage::Light && work.light_rays > 0.0;
            if (times.is_empty() || is_sum) && !is_whole {
                continue;
            }
            let variants = self.stages.entry(stage.name().to_owned()).or_default();
            let passes = variants.entry(variant(stage, settings, &work)).or_default();
            let amounts: Vec<f64> = drivers(stage).iter().map(|driver| work.amount(*driver)).collect();
            for (name, milliseconds) in &times {
                let sums = passes.entry((*name).to_owned()).or_default();
                sums.fade(FADING);
                sums.add(&amounts, *milliseconds, total.powi(-2));
            }
            if !is_whole {
                continue;
            }
            // A pass that other frames of the variant had, and this one had not, took no time.
            for (_, sums) in passes.iter_mut().filter(|(name, _)| !times.contains_key(name.as_str())) {
                sums.fade(FADING);
                sums.add(&amounts, 0.0, total.powi(-2));
            }
        }
    }

    /// The coefficients, for predictions.
    pub fn costs(&self) -> Costs {
        let mut costs = Costs::default();
        for stage in STAGES {
            for (variant, passes) in self.stages.get(stage.name()).into_iter().flatten() {
                let of_pass = |(name, sums): (&String, &Sums)| (name.clone(), sums.coefficients());
                costs.passes.insert((stage.name(), variant.clone()), passes.iter().map(of_pass).collect());
            }
        }
        costs
    }
}

/// A pass and its milliseconds for each driver of its stage.
type PassCosts = (String, Vec<f64>);

/// The milliseconds of each pass for each driver.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    /// By stage and variant: the passes with their coefficients.
    passes: BTreeMap<(&'static str, String), Vec<PassCosts>>,
}

/// What makes a frame slow.
#[derive(Clone, Debug, PartialEq)]
pub struct Slowest {
    /// The most expensive pass, its stage and its share of the frame's time.
    pub pass: &'static str,
    pub stage: PassStage,
    pub share: f64,
    /// What most of its time grows with, as far as that is known, and the parameter that lowers it.
    pub driver: Option<Driver>,
    pub lever: Option<&'static str>,
}

impl Costs {
    /// The milliseconds that a frame is expected to take; `None` if no frame of the kind was measured yet.
    pub fn predict(&self, work: &Workload, settings: &Settings) -> Option<f64> {
        STAGES.into_iter().map(|stage| self.predict_stage(stage, work, settings)).sum()
    }

    /// The milliseconds that the passes of a stage are expected to take in a frame; `None` as for `predict`.
    pub fn predict_stage(&self, stage: PassStage, work: &Workload, settings: &Settings) -> Option<f64> {
        let passes = self.passes.get(&(stage.name(), variant(stage, settings, work)));
        let amounts = drivers(stage).iter().map(|driver| work.amount(*driver));
        let of_driver = |(index, amount): (usize, f64)| -> f64 {
            passes.into_iter().flatten().map(|(_, costs)| costs[index] * amount).sum()
        };
        // Without mirrors in the view no pass of the method is run.
        let is_known = passes.is_some() || stage == PassStage::Method && work.mirror_pixels == 0.0;
        is_known.then(|| amounts.enumerate().map(of_driver).sum())
    }

    /// The most expensive pass of a frame, with what lowers its time. `None` if the frame had no passes.
    pub fn slowest(&self, stats: &FrameStats, settings: &Settings, size: [u32; 2]) -> Option<Slowest> {
        let most = stats.passes.iter().max_by(|a, b| a.milliseconds.total_cmp(&b.milliseconds))?;
        let total: f64 = stats.passes.iter().map(|pass| pass.milliseconds).sum();
        let work = Workload::of(stats, settings, size);
        let known = self.passes.get(&(most.stage.name(), variant(most.stage, settings, &work)));
        let costs = known.into_iter().flatten().find(|(name, _)| name == most.name);
        let parts = costs.into_iter().flat_map(|(_, costs)| drivers(most.stage).iter().zip(costs));
        let parts = parts.map(|(driver, cost)| (*driver, cost * work.amount(*driver)));
        let driver = parts.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, part)| *part > 0.0).map(|(driver, _)| driver);
        Some(Slowest {
            pass: most.name,
            stage: most.stage,
            share: if total > 0.0 { most.milliseconds / total } else { 0.0 },
            driver,
            lever: driver.and_then(|driver| driver.lever(settings)),
        })
    }
}

#[cfg(test)]
mod tests {
    use render::{Clock, PassTime, ReflectionStats};
    use scene::{Method, Quality};

    use super::*;

    /// A machine with known costs: a pass each for points, pixels, mirrors and virtual lights.
    fn frame(settings: &Settings, size: [u32; 2], points: u64) -> FrameStats {
        let pixels = f64::from(size[0] * size[1]);
        let mirrors = (pixels * 0.1).round();
        let drawn = points / u64::from(settings.splat.step);
        let is_reflected = settings.reflection.method != Method::None;
        let lights = settings.gi.vpls * settings.gi.bounces;
        let lit = (pixels + if is_reflected { mirrors } else { 0.0 }) * f64::from(lights)
            / f64::from(settings.gi.interleave.pow(2));
        let shadowed = f64::from(lights) * f64::from(settings.gi.shadow_points);
        let method = if settings.reflection.method == Method::SurfelTrace { 40.0 } else { 10.0 };
        let mut passes = vec![
            ("splat_nearest", PassStage::Surface, 0.2 + 9.0e-6 * drawn as f64 + 3.0e-6 * pixels),
            ("shade", PassStage::Light, 7.0e-6 * pixels),
            ("present", PassStage::View, 0.1 + 2.0e-6 * pixels),
        ];
        if is_reflected {
            passes.push(("surfel_trace", PassStage::Method, method * 1e-5 * mirrors));
        }
        if lights > 0 {
            passes.push(("vpl_shadow_splat", PassStage::Light, 4.0e-5 * shadowed));
            passes.push(("indirect", PassStage::Light, 1.5e-7 * lit));
        }
        let passes = passes.into_iter().map(|(name, stage, milliseconds)| PassTime { name, stage, milliseconds });
        let passes: Vec<PassTime> = passes.collect();
        FrameStats {
            frame_milliseconds: passes.iter().map(|pass| pass.milliseconds).sum(),
            passes,
            splatting_milliseconds: 0.0,
            points_drawn: drawn,
            points_resident: points,
            gpu_bytes: 0,
            clock: Clock::Gpu,
            virtual_lights: lights,
            glossy_samples: [0; 2],
            light_rays: [0; 2],
            exposure: None,
            glossy_hits: render::GlossCache::NoGloss,
            glossy_rays: [0; 2],
            methods: Vec::new(),
            reflected: None,
            is_quick: false,
            flip: None,
            has_compiled: false,
            dispatches: 0,
            waits: 0,
            reflection: Some(ReflectionStats { mirror_pixels: mirrors as u32, ..ReflectionStats::default() }),
        }
    }

    fn settings(set: &[(&str, &str)]) -> Settings {
        let mut settings = Settings::default();
        set.iter().for_each(|(key, value)| settings.set_text(key, value).unwrap());
        settings
    }

    /// A model that saw a few settings at two sizes and two numbers of points.
    fn learned() -> CostModel {
        let mut model = CostModel::default();
        for method in ["surfel_trace", "environment_map"] {
            for (size, points) in [([320, 240], 200_000), ([640, 480], 200_000), ([320, 240], 1_000_000)] {
                for set in [[("gi.vpls", "256"), ("gi.interleave", "4")], [("gi.vpls", "64"), ("gi.interleave", "8")]] {
                    for shadow_points in ["8192", "1024"] {
                        let set = [set[0], set[1], ("gi.shadow_points", shadow_points), ("reflection.method", method)];
                        let settings = settings(&set);
                        model.learn(&frame(&settings, size, points), &settings, size);
                    }
                }
            }
        }
        model
    }

    #[test]
    fn known_costs_are_learned_and_frames_that_were_never_drawn_predicted() {
        let costs = learned().costs();
        let base = settings(&[("reflection.method", "surfel_trace")]);
        let size = [640, 480];
        let work = Workload::of(&frame(&base, size, 600_000), &base, size);
        for set in [
            vec![("reflection.method", "surfel_trace")],
            vec![("reflection.method", "environment_map"), ("gi.vpls", "16")],
            vec![("reflection.method", "environment_map"), ("gi.interleave", "8"), ("splat.step", "4")],
            vec![("reflection.method", "surfel_trace"), ("gi.vpls", "1024"), ("gi.interleave", "1")],
        ] {
            let settings = settings(&set);
            let expected = frame(&settings, size, 600_000).frame_milliseconds;
            let predicted = costs.predict(&work.with(&base, &settings), &settings).unwrap();
            assert!((predicted / expected - 1.0).abs() < 0.02, "{set:?}: {predicted} ms, in truth {expected} ms");
        }
        let half = settings(&[("reflection.method", "surfel_trace"), ("view.resolution", "0.5")]);
        let expected = frame(&half, [320, 240], 600_000).frame_milliseconds;
        let predicted = costs.predict(&work.with(&base, &half), &half).unwrap();
        assert!((predicted / expected - 1.0).abs() < 0.02, "{predicted} ms, in truth {expected} ms");
    }

    #[test]
    fn light_by_rays_costs_by_its_rays_and_is_learned_from_whole_sums_alone() {
        let by_rays =
            |rays: &str| settings(&[("reflection.method", "none"), ("gi.by", "rays"), ("gi.rays_per_pixel", rays)]);
        // Two microseconds a ray, and a picture of virtual lights' maps.
        let frame = |settings: &Settings, size: [u32; 2]| {
            let mut stats = frame(settings, size, 200_000);
            let pass = stats.passes.iter_mut().find(|pass| pass.name == "indirect").unwrap();
            let paths = f64::from(size[0] * size[1]) * f64::from(settings.gi.rays_per_pixel);
            (pass.name, pass.milliseconds) = ("light_rays", 2e-3 * paths * f64::from(settings.gi.ray_bounces));
            stats
        };
        let mut model = CostModel::default();
        for (rays, size) in [("1", [320, 240]), ("4", [320, 240]), ("4", [160, 120]), ("16", [160, 120])] {
            let settings = by_rays(rays);
            model.learn(&frame(&settings, size), &settings, size);
        }
        let base = by_rays("64");
        let work = Workload::of(&frame(&base, [320, 240]), &base, [320, 240]);
        let close = |model: &CostModel, rays: &str| {
            let settings = by_rays(rays);
            let predicted = model.costs().predict(&work.with(&base, &settings), &settings).unwrap();
            (predicted / frame(&settings, [320, 240]).passes.iter().map(|pass| pass.milliseconds).sum::<f64>() - 1.0)
                .abs()
                < 0.02
        };
        assert!(["1", "8", "64"].iter().all(|rays| close(&model, rays)));
        // A frame of the window adds some of 64 rays.
        let mut some = frame(&by_rays("4"), [320, 240]);
        some.light_rays = [4, 64];
        model.learn_parts(&some, &base, [320, 240]);
        assert!(close(&model, "64"));
        let lights = settings(&[("reflection.method", "none")]);
        assert_eq!(model.costs().predict(&work.with(&base, &lights), &lights), None, "lights were never drawn");
    }

    #[test]
    fn each_cost_goes_to_its_driver() {
        let costs = learned().costs();
        let method = |name: &str, method: &str| {
            let passes = &costs.passes[&("method", method.to_owned())];
            passes.iter().find(|(pass, _)| pass == name).unwrap().1.clone()
        };
        // In milliseconds for a million mirror pixels.
        let [traced, mapped] = ["surfel_trace", "environment_map"].map(|name| method("surfel_trace", name));
        let sums = |costs: &[f64]| costs.iter().enumerate().map(|(index, cost)| (index, *cost)).collect::<Vec<_>>();
        // Mirror pixels were always a tenth of the pixels: the two share the cost, which is the same in sum.
        let of_pixels = |costs: &[f64]| costs[2] * 10.0 + costs[3];
        assert!((of_pixels(&traced) / 400.0 - 1.0).abs() < 0.02, "{:?}", sums(&traced));
        assert!((of_pixels(&mapped) / 100.0 - 1.0).abs() < 0.02, "{:?}", sums(&mapped));
        let splat = &costs.passes[&("surface", "high".to_owned())][0].1;
        assert!((splat[1] / 9.0 - 1.0).abs() < 0.02 && (splat[2] / 3.0 - 1.0).abs() < 0.02, "{splat:?}");
    }

    #[test]
    fn kinds_of_frames_that_were_never_drawn_are_not_guessed() {
        let costs = learned().costs();
        let base = settings(&[("reflection.method", "surfel_trace")]);
        let work = Workload::of(&frame(&base, [320, 240], 200_000), &base, [320, 240]);
        for unknown in [("reflection.method", "sscr"), ("splat.quality", "nearest")] {
            let settings = settings(&[("reflection.method", "surfel_trace"), unknown]);
            assert_eq!(costs.predict(&work.with(&base, &settings), &settings), None, "{unknown:?}");
        }
        assert_eq!(settings(&[("splat.quality", "nearest")]).splat.quality, Quality::Nearest);
        assert_eq!(CostModel::default().costs().predict(&work, &base), None);
    }

    #[test]
    fn the_slowest_pass_is_told_with_its_share_and_lever() {
        let model = learned();
        let slow = |set: &[(&str, &str)]| {
            let settings = settings(&[&[("reflection.method", "surfel_trace")], set].concat());
            let stats = frame(&settings, [640, 480], 200_000);
            model.costs().slowest(&stats, &settings, [640, 480]).unwrap()
        };
        let shadows = slow(&[]);
        assert_eq!((shadows.pass, shadows.lever), ("vpl_shadow_splat", Some("gi.shadow_points")), "{shadows:?}");
        assert!(shadows.share > 0.5 && shadows.share < 1.0);
        let lit = slow(&[("gi.interleave", "1"), ("gi.shadow_points", "256"), ("gi.vpls", "1024")]);
        assert_eq!((lit.pass, lit.lever), ("indirect", Some("gi.interleave")), "{lit:?}");
        let unknown = CostModel::default().costs();
        let base = settings(&[]);
        let told = unknown.slowest(&frame(&base, [64, 48], 10), &base, [64, 48]).unwrap();
        assert_eq!((told.driver, told.lever), (None, None));
    }

    #[test]
    fn a_model_comes_back_from_its_text_and_damage_is_told() {
        let model = learned();
        let text = model.to_text();
        // Numbers come back to the last digit but one.
        let back = CostModel::parse(&text).unwrap();
        let base = settings(&[("reflection.method", "surfel_trace")]);
        let work = Workload::of(&frame(&base, [320, 240], 200_000), &base, [320, 240]);
        let [before, after] = [&model, &back].map(|model| model.costs().predict(&work, &base).unwrap());
        assert!((before / after - 1.0).abs() < 1e-6, "{before} {after}");
        assert!(CostModel::parse(&text[..text.len() / 2]).is_err());
        // Sums of another version are left out, and the others stay.
        let other = text.replacen("\"products\":[", "\"products\":[1.0,", 1);
        let kept = CostModel::parse(&other).unwrap();
        assert!(kept != back && !kept.is_empty());
        let sums = |stages: &CostModel| stages.stages.values().map(BTreeMap::len).sum::<usize>();
        assert_eq!(sums(&kept) + 1, sums(&back));
        assert!(CostModel::parse("[]").is_err());
    }
}
