//! Runs a plan: each setting is drawn and judged once, untimed, then timed in rounds. In each round every setting is
//! drawn once, in a new random order, so that anything that speeds up or slows down the machine for a while affects all
//! alike.

use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use anyhow::anyhow;
use cloud::Progress;
use render::{Aov, Effort, Frame, FrameStats, Gpu, PassStage, Renderer};
use scene::{Camera, ColorBy, Preset, Settings};

use crate::chart;
use crate::cost::CostModel;
use crate::estimate::{RAYS, estimate};
use crate::file_name::file_name;
use crate::flicker::{Followed, FrameImages, Steps, flicker, follow};
use crate::journal::{Folder, FolderError};
use crate::loaded::{Loaded, Wanted, drawn, error_of_light, reference, tracer, view};
use crate::metrics::Truth;
use crate::picture;
use crate::plan::{Case, Group, Pictures, Plan, PlanError, RAY_TRACE};
use crate::report;
use crate::results::{self, Figure, Machine, MapFigures, Measured, Row, Run, TimedPass};
use crate::sightlines::Ruler;
use crate::still::{Shown, Target, drawn_size};
use crate::subject::Subject;
use crate::truth::{Drawn, Tracer, View};

/// The source of a plan's scenes.
pub trait Scenes {
    /// The parameters of a scene, with a preset for its mirrors if one is given.
    ///
    /// # Errors
    /// There is no such scene.
    fn settings(&self, scene: &str, preset: Option<&Preset>) -> anyhow::Result<Settings>;

    /// Reads a scene and puts it on the GPU.
    ///
    /// # Errors
    /// It cannot be read, or there is no memory for it.
    fn load(&self, gpu: &Arc<Gpu>, scene: &str, settings: &Settings) -> anyhow::Result<Subject>;

    /// The ruler for the surface of a scene's points.
    ///
    /// # Errors
    /// It cannot be read, or has not one cloud.
    fn ruler(&self, gpu: &Arc<Gpu>, scene: &str, settings: &Settings) -> anyhow::Result<Ruler>;
}

/// Every N-th setting, from the K-th.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// The number of the shard, from 1.
    pub number: usize,
    pub count: usize,
}

impl Shard {
    pub const WHOLE: Self = Self { number: 1, count: 1 };

    /// Whether a setting or a frame belongs to the shard.
    pub fn has(self, case: usize) -> bool {
        case % self.count == self.number - 1
    }
}

impl std::str::FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(number, count)| Some([number.parse().ok()?, count.parse().ok()?]));
        match numbers {
            Some([number, count]) if (1..=count).contains(&number) => Ok(Self { number, count }),
            _ => Err("expected K/N with K from 1 to N, as in 2/8".into()),
        }
    }
}

/// The progress of a study.
#[derive(Clone, Copy, Debug)]
pub struct State<'a> {
    /// The number of drawings done, of `total` that this call makes.
    pub done: usize,
    pub total: usize,
    /// The next setting; none at the end.
    pub next: Option<&'a Case>,
}

/// The result of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// The number of drawings that this call made.
    pub runs: usize,
    pub settings: usize,
    /// The number of settings that failed; the table says why.
    pub failed: usize,
    /// The number of settings that another version or clock had begun, and that were measured anew as a whole.
    pub redone: usize,
}

/// The number of points kept on the GPU and in memory at a time: with the tree of the ray tracer some 100 bytes each.
const MOST_POINTS: u64 = 24_000_000;

/// The bytes of traced colours that are kept: those of some forty pictures of 800x600.
const MOST_REFERENCE_BYTES: usize = 256 << 20;

/// The number of frames of a still camera, and of steps of a moving one, over which flicker is measured.
const STILL: Steps = Steps { frames: 16, pixels: 0.0 };
const MOVING: Steps = Steps { frames: 9, pixels: 0.25 };

/// Checks that all scenes of a plan exist, before anything is opened.
///
/// # Errors
/// A scene that does not exist, with the plan's group.
pub fn check_scenes(plan: &Plan, scenes: &dyn Scenes) -> Result<(), PlanError> {
    let mut known = HashSet::new();
    for case in plan.cases() {
        if !known.insert(case.scene.clone()) {
            continue;
        }
        let place = format!("group `{}`", plan.groups[case.group].name);
        let problem = |error: String| PlanError { place: place.clone(), problem: error };
        let settings = scenes.settings(&case.scene, case.preset).map_err(|error| problem(format!("{error:#}")))?;
        case.settings(&settings).map_err(|error| problem(error.to_string()))?;
    }
    Ok(())
}

/// Makes the missing runs of a shard and writes the results after every round. `commit` is the program's version.
/// `progress` may stop it: finished runs are in the journal.
///
/// # Errors
/// A folder that cannot be written, runs of another adapter in it, or no renderer. Settings that fail become rows of
/// the table instead.
pub fn run(
    folder: &mut Folder,
    shard: Shard,
    gpu: &Arc<Gpu>,
    scenes: &dyn Scenes,
    commit: &str,
    progress: &mut dyn FnMut(State<'_>) -> ControlFlow<()>,
) -> anyhow::Result<Outcome> {
    let machine = Machine {
        adapter: gpu.info.name.clone(),
        adapter_kind: render::kind_name(gpu.info.device_type).to_owned(),
        clock: gpu.clock.name().to_owned(),
        commit: commit.to_owned(),
    };
    let cases: Vec<Case> = folder.cases.iter().filter(|case| shard.has(case.index)).cloned().collect();
    let done = folder.done(&machine);
    let rounds: Vec<Vec<&Case>> = (0..=folder.plan.repeats)
        .map(|round| in_order(&cases, round).into_iter().filter(|case| !done.contains(&(case.index, round))).collect())
        .collect();
    let total: usize = rounds.iter().map(Vec::len).sum();
    let pending: HashSet<usize> = rounds.iter().flatten().map(|case| case.index).collect();
    let is_foreign = |run: &&Run| run.machine.adapter != machine.adapter && pending.contains(&run.case);
    if let Some(other) = folder.runs.iter().find(is_foreign) {
        return Err(anyhow!(
            "{}: begun on {}, this is {}: times of two machines would mix; name it with --gpu, or another folder",
            folder.path.display(),
            other.machine.adapter,
            machine.adapter
        ));
    }
    let is_other = |run: &&Run| run.machine != machine && run.error.is_none() && pending.contains(&run.case);
    let redone: HashSet<usize> = folder.runs.iter().filter(is_other).map(|run| run.case).collect();
    let mut outcome = Outcome { runs: 0, settings: cases.len(), failed: 0, redone: redone.len() };
    let mut runner: Option<Runner<'_>> = None;
    let mut failed = Vec::new();
    for (round, cases) in (0..).zip(&rounds) {
        for case in cases {
            let state = State { done: outcome.runs, total, next: Some(case) };
            if progress(state).is_break() {
                return Ok(outcome);
            }
            outcome.runs += 1;
            // A setting that could not be judged is not timed either.
            if failed.contains(&case.index) {
                continue;
            }
            let runner = running(&mut runner, gpu, scenes, &folder.plan)?;
            let made = if round == 0 { runner.judged(case) } else { runner.timed(case, &chosen(&folder.runs, case)) };
            // A drawing that was stopped is no failure of the setting.
            if made.is_err() && progress(state).is_break() {
                return Ok(outcome);
            }
            let run = made.unwrap_or_else(|error| {
                failed.push(case.index);
                Run { error: Some(format!("{error:#}").replace('\n', "; ")), ..Run::default() }
            });
            folder.add(Run { case: case.index, round, machine: machine.clone(), ..run })?;
        }
        if round == 0 {
            if !missing_pictures(folder).is_empty() {
                running(&mut runner, gpu, scenes, &folder.plan)?.pictures(folder)?;
            }
            // The rounds that follow are timed alone.
            if let Some(runner) = &mut runner {
                runner.forget_references();
            }
        }
        if !cases.is_empty() {
            write(folder)?;
        }
    }
    if total == 0 {
        write(folder)?;
    }
    let _ = progress(State { done: total, total, next: None });
    let rows = results::rows(&folder.plan, &folder.cases, &folder.runs);
    outcome.failed = rows.iter().filter(|row| row.error.is_some()).count();
    Ok(outcome)
}

/// The parameters that were chosen for a setting with a target when it was judged; none for others.
fn chosen(runs: &[Run], case: &Case) -> Vec<(String, String)> {
    let judged = runs.iter().rfind(|run| run.case == case.index && run.round == 0 && run.error.is_none());
    let pairs = judged.filter(|_| case.target.is_some()).into_iter().flat_map(|run| run.set.split(' '));
    pairs.filter_map(|pair| pair.split_once('=')).map(|(key, value)| (key.to_owned(), value.to_owned())).collect()
}

/// The runner, made when it is first needed: it compiles shaders.
fn running<'a, 'b>(
    runner: &'b mut Option<Runner<'a>>,
    gpu: &'a Arc<Gpu>,
    scenes: &'a dyn Scenes,
    plan: &Plan,
) -> anyhow::Result<&'b mut Runner<'a>> {
    match runner {
        Some(runner) => Ok(runner),
        none => Ok(none.insert(Runner::new(gpu, scenes, plan.clone())?)),
    }
}

/// The file names and settings of missing pictures that groups ask for. A setting without a visible mirror has none.
fn missing_pictures(folder: &Folder) -> Vec<(String, Case)> {
    let rows = results::rows(&folder.plan, &folder.cases, &folder.runs);
    let shows_mirrors = |row: &Row| row.value("mirror_pixels").is_some_and(|pixels| pixels > 0.0);
    let missing = shown(&folder.plan, &rows).into_iter();
    let missing = missing.filter(|(name, row)| shows_mirrors(row) && !folder.path.join(name).exists());
    missing.map(|(name, row)| (name, row.case.clone())).collect()
}

/// Writes tables, charts and the report of the runs so far.
///
/// # Errors
/// A folder that cannot be written.
pub fn write(folder: &Folder) -> anyhow::Result<()> {
    let Folder { plan, cases, runs, path, .. } = folder;
    let rows = results::rows(plan, cases, runs);
    folder.write("results.csv", &results::csv(plan, &rows)?)?;
    folder.write("results.json", results::json(plan, &rows)?.as_bytes())?;
    let charts = chart::charts(plan, &rows);
    for chart in &charts {
        folder.write(&format!("{}.svg", chart.name), chart.svg()?.as_bytes())?;
        folder.write(&format!("{}.png", chart.name), &chart.png()?)?;
    }
    let pictures: Vec<(String, &Row)> =
        shown(plan, &rows).into_iter().filter(|(name, _)| path.join(name).exists()).collect();
    folder.write("index.html", report::html(plan, &rows, &charts, &pictures).as_bytes())?;
    Ok(())
}

/// Copies the pictures of the settings that are shown from folders that were joined.
///
/// # Errors
/// A picture that cannot be read or written.
pub fn copy_pictures(folders: &[impl AsRef<Path>], into: &Folder) -> Result<(), FolderError> {
    let rows = results::rows(&into.plan, &into.cases, &into.runs);
    for (name, _) in shown(&into.plan, &rows) {
        let found = folders.iter().map(|folder| folder.as_ref().join(&name)).find(|path| path.exists());
        if let Some(path) = found.filter(|path| *path != into.path.join(&name)) {
            let bytes = std::fs::read(&path).map_err(|reason| FolderError::Unread { path, reason })?;
            into.write(&name, &bytes)?;
        }
    }
    Ok(())
}

/// The file name of the picture and the row of each setting that is shown: in groups that ask for pictures each one, or
/// for each scene and method the one whose figure is worst.
fn shown<'a>(plan: &Plan, rows: &'a [Row]) -> Vec<(String, &'a Row)> {
    let mut shown: Vec<(String, &Row)> = Vec::new();
    for (index, group) in plan.groups.iter().enumerate().filter(|(_, group)| group.pictures != Pictures::None) {
        let figure = group.bound.as_ref().map(|bound| &bound.figure).or(plan.errors.first());
        let more_is_better = || figure.and_then(|name| plan.figure(name)).is_some_and(|of| Figure::more_is_better(&of));
        let least_is_worst = group.bound.as_ref().map_or_else(more_is_better, |bound| bound.at_least.is_some());
        let badness = |row: &Row| {
            let value = figure.and_then(|figure| row.value(figure));
            value.map_or(f64::NEG_INFINITY, |value| if least_is_worst { -value } else { value })
        };
        let of_group: Vec<&Row> = rows.iter().filter(|row| row.case.group == index && row.error.is_none()).collect();
        let named = |row: &'a Row| (format!("pictures/{}-{}.png", file_name(&group.name), row.case.index), row);
        if group.pictures == Pictures::Each {
            shown.extend(of_group.into_iter().map(named));
            continue;
        }
        for scene in &group.scenes {
            for method in &group.methods {
                let is_of = |row: &&&Row| row.case.scene_pattern == *scene && row.case.method == *method;
                let rows = of_group.iter().filter(is_of);
                let worst = rows.max_by(|a, b| badness(a).total_cmp(&badness(b)));
                shown.extend(worst.map(|row| named(row)));
            }
        }
    }
    shown
}

/// The first round keeps the settings of a scene together, which is loaded for them; the others are shuffled.
fn in_order(cases: &[Case], round: u32) -> Vec<&Case> {
    let mut order: Vec<&Case> = cases.iter().collect();
    if round == 0 {
        order.sort_by(|a, b| a.scene.cmp(&b.scene));
        return order;
    }
    // The shuffle of Fisher and Yates.
    let mut random = cloud::Random(u64::from(round));
    for last in (1..order.len()).rev() {
        order.swap(last, random.below(last as u64 + 1) as usize);
    }
    order
}

/// The run of a setting that was judged.
fn judged_run(case: &Case, settings: &Settings, points: u64, frames: &[FrameStats], measured: Measured) -> Run {
    let found = frames.last().and_then(|stats| stats.reflection);
    let cameras = found.and_then(|found| found.cameras);
    // Of no points there is no share.
    let listed = cameras.filter(|_| found.is_some_and(|found| found.coverage > 0.0));
    let measured = Measured {
        coverage: found.map(|found| found.coverage).or(measured.coverage),
        closed_coverage: found.map(|found| found.closed_coverage).or(measured.closed_coverage),
        hit_rate: found.and_then(|found| found.hit_rate),
        unconverged: found.and_then(|found| found.unconverged),
        regions: found.and_then(|found| found.regions).map(f64::from),
        unresolved: found.and_then(|found| found.unresolved),
        tests_per_ray: found.and_then(|found| found.tests_per_ray).map(|[cells, _]| cells),
        maps: MapFigures::of(frames),
        listed: listed.map(|cameras| cameras.listed.into()),
        ray_copies: cameras.map(|cameras| cameras.copies.into()),
        cameras_bytes: cameras.map(|cameras| cameras.bytes as f64),
        cameras_ms: cameras.map(|cameras| cameras.milliseconds.into()),
        uncertain: found.map(|found| found.uncertain),
        ..measured
    };
    // What was chosen for a target is written down, the method included.
    let is_told = |key: &str| key != "reflection.method" || case.target.is_some();
    let swept = |key: &str| case.swept_value(key).is_some() || !is_told(key);
    let set = settings.differing().into_iter().filter(|(key, _)| !swept(key));
    let set: Vec<String> = set.map(|(key, value)| format!("{key}={value}")).collect();
    Run { set: set.join(" "), points: Some(points), figures: measured.figures(), ..Run::default() }
}

struct Runner<'a> {
    gpu: &'a Arc<Gpu>,
    scenes: &'a dyn Scenes,
    plan: Plan,
    renderer: Renderer,
    /// What targets learned of the times of this adapter.
    model: CostModel,
    /// The loaded scenes; the last used one comes last.
    loaded: Vec<(String, Loaded)>,
}

impl<'a> Runner<'a> {
    fn new(gpu: &'a Arc<Gpu>, scenes: &'a dyn Scenes, plan: Plan) -> anyhow::Result<Self> {
        Ok(Self {
            gpu,
            scenes,
            plan,
            renderer: Renderer::new(gpu.clone())?,
            model: CostModel::default(),
            loaded: Vec::new(),
        })
    }

    /// Returns the case's parameters; its scene is then the last of `loaded`.
    fn prepare(&mut self, case: &Case) -> anyhow::Result<Settings> {
        let settings = case.settings(&self.scenes.settings(&case.scene, case.preset)?)?;
        let key = loading_key(case, &settings);
        if let Some(index) = self.loaded.iter().position(|(other, _)| *other == key) {
            let found = self.loaded.remove(index);
            self.loaded.push(found);
            return Ok(settings);
        }
        // The least recently used scenes make room; how much the new one needs is known only when it is loaded. If
        // loading fails, all of them make room: a lack of memory cannot be distinguished from other failures, which
        // then occur again.
        let mut subject = match self.scenes.load(self.gpu, &case.scene, &settings) {
            Err(_) if !self.loaded.is_empty() => {
                self.loaded.clear();
                // Memory is returned when the GPU has finished all work.
                self.gpu.wait()?;
                self.scenes.load(self.gpu, &case.scene, &settings)
            }
            loaded => loaded,
        }?;
        let Camera { eye, pivot, .. } = subject.camera;
        subject.camera.eye = pivot + (eye - pivot) * case.distance;
        let points = subject.parts.iter().map(|part| part.cloud.len()).sum();
        let kept = |loaded: &[(String, Loaded)]| loaded.iter().map(|(_, loaded)| loaded.points).sum::<u64>();
        while !self.loaded.is_empty() && kept(&self.loaded) + points > MOST_POINTS {
            self.loaded.remove(0);
        }
        let loaded = Loaded { subject, points, traced: None, references: HashMap::new(), still: None, explored: None };
        self.loaded.push((key, loaded));
        Ok(settings)
    }

    fn forget_references(&mut self) {
        self.loaded.iter_mut().for_each(|(_, loaded)| loaded.references.clear());
    }

    /// Draws a setting without timing it, and judges the frame.
    fn judged(&mut self, case: &Case) -> anyhow::Result<Run> {
        let references = self.loaded.iter().flat_map(|(_, loaded)| loaded.references.values());
        if references.map(|colors| size_of_val(&colors[..])).sum::<usize>() > MOST_REFERENCE_BYTES {
            self.forget_references();
        }
        let mut settings = self.prepare(case)?;
        let mut measured = Measured::default();
        if let Some(planned) = case.target {
            let Self { renderer, loaded, model, .. } = self;
            let (_, loaded) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
            let (target, choice) = loaded.choose(case, &settings, planned, renderer, model)?;
            choice.apply(&mut settings)?;
            measured.predicted_ms = Some(choice.predicted_ms);
            measured.target_ms = if let Target::Milliseconds(time) = target { Some(time) } else { None };
        }
        if self.plan.still {
            self.still(case)?;
        }
        if self.plan.sightlines {
            let mut ruler = self.scenes.ruler(self.gpu, &case.scene, &settings)?;
            measured.drawn_sightlines = ruler.drawn(&mut self.renderer, &settings)?;
            measured.traced_sightlines = Some(ruler.traced()?);
        }
        let Self { plan, renderer, loaded, .. } = self;
        let (_, loaded) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
        let size = drawn_size(case.size, &settings);
        let frames = draw(loaded, renderer, case, &settings, &plan.groups[case.group])?;
        let traced = traced(loaded, plan, case, &settings, renderer)?;
        if let Some((_, _, still)) = loaded.still.as_ref().filter(|_| plan.still) {
            let mut shown = Shown::read(renderer, &loaded.subject.camera, &settings, size)?;
            if let (Some(drawn), Some((_, scene))) = (&traced, &loaded.traced) {
                shown = shown.finding(&drawn.found, scene.origin - loaded.subject.camera.eye);
            }
            measured.still = Some(still.error_of(&shown));
        }
        let flickers_count = plan.flicker || plan.groups[case.group].flicker;
        let is_drawn_alone = plan.truths.is_empty() && case.method != RAY_TRACE && !flickers_count;
        // Where the still picture or sightlines judge alone, estimates would take long for nothing.
        if (plan.still || plan.sightlines) && is_drawn_alone {
            measured.mirror_pixels = mirror_pixels(&renderer.read_aov(Aov::Mirror)?.data);
            return Ok(judged_run(case, &settings, loaded.points, &frames, measured));
        }
        // The ray tracer's reflections are not the renderer's.
        measured.estimate = match case.method == RAY_TRACE {
            true => None,
            false => {
                let view = view(&loaded.subject, &settings, case.size);
                estimate(renderer, &loaded.subject.store, view.frame(), RAYS, settings.scene.seed.into())?
            }
        };
        // So would the ray tracer's own scene where no truth judges.
        if is_drawn_alone {
            measured.mirror_pixels = mirror_pixels(&renderer.read_aov(Aov::Mirror)?.data);
            return Ok(judged_run(case, &settings, loaded.points, &frames, measured));
        }
        loaded.traced(plan, settings.splat.size)?;
        let drawn = match traced {
            Some(traced) => traced,
            None => drawn(loaded, case, &settings, renderer)?.0,
        };
        let mut judged = Vec::new();
        for &truth in &plan.truths {
            if truth == Truth::Exact && loaded.subject.exact.is_none() {
                continue;
            }
            let view = view(&loaded.subject, &settings, size);
            let mut accuracy = tracer(&loaded.traced, view)?.judge(truth, &drawn, &Progress::default())?;
            if truth == Truth::SameInput || matches!(settings.color.by, ColorBy::Auto | ColorBy::Rgb) {
                let (seen, reference) = reference(loaded, plan, case, &settings, truth, &drawn, Wanted::Mirrors)?;
                let view = self::view(&loaded.subject, &settings, size);
                accuracy.image = Some(tracer(&loaded.traced, view)?.image_error(&drawn, &seen, &reference));
                if plan.light {
                    let light = error_of_light(loaded, plan, case, &settings, truth, (&drawn, renderer))?;
                    accuracy.indirect = Some(light);
                }
            }
            judged.push(accuracy);
        }
        let traced = (case.method == RAY_TRACE).then(|| judged.first()).flatten();
        measured.mirror_pixels = mirror_pixels(&drawn.surface.mirror);
        measured.coverage = traced.map(|judged| judged.coverage);
        measured.closed_coverage = traced.map(|judged| judged.closed_coverage);
        measured.judged = judged;
        if flickers_count {
            [measured.flicker_still, measured.flicker_moving] = flickers(loaded, case, &settings, renderer, &drawn)?;
        }
        Ok(judged_run(case, &settings, loaded.points, &frames, measured))
    }

    /// Draws the still picture of a setting, unless it is at hand. The setting's own scene is the last of `loaded`
    /// afterwards, as before.
    fn still(&mut self, case: &Case) -> anyhow::Result<()> {
        let base = self.plan.base(&self.scenes.settings(&case.scene, None)?)?;
        let Self { plan, renderer, loaded, .. } = self;
        let (_, own) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
        if plan.still_set.is_empty() {
            return Ok(own.still(case, &base, renderer)?);
        }
        let of_still = plan.of_still(case);
        let settings = of_still.settings(&self.scenes.settings(&of_still.scene, of_still.preset)?)?;
        if own.has_still(&of_still, &settings) {
            return Ok(());
        }
        self.prepare(&of_still)?;
        let Self { renderer, loaded, .. } = self;
        let (_, other) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
        other.still(&of_still, &settings, renderer)?;
        let still = other.still.take();
        self.prepare(case)?;
        let (_, own) = self.loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
        own.still = still;
        Ok(())
    }

    /// Draws a setting once, from scratch.
    fn timed(&mut self, case: &Case, chosen: &[(String, String)]) -> anyhow::Result<Run> {
        let mut settings = self.prepare(case)?;
        for (key, value) in chosen {
            settings.set_text(key, value)?;
        }
        let Self { plan, renderer, loaded, .. } = self;
        let (_, loaded) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
        let frames = draw(loaded, renderer, case, &settings, &plan.groups[case.group])?;
        let timed = |name: &str, stage, ms| TimedPass { name: name.to_owned(), stage, ms };
        let share = 1.0 / frames.len() as f64;
        let mut passes: Vec<TimedPass> = Vec::new();
        for pass in frames.iter().flat_map(|frame| &frame.passes) {
            let ms = share * pass.milliseconds;
            match passes.iter_mut().find(|known| known.name == pass.name && known.stage == pass.stage) {
                Some(known) if case.orbit != 0.0 => known.ms += ms,
                _ => passes.push(timed(pass.name, pass.stage, ms)),
            }
        }
        let mut frame_ms = share * frames.iter().map(|frame| frame.frame_milliseconds).sum::<f64>();
        if case.method == RAY_TRACE {
            loaded.traced(plan, settings.splat.size)?;
            let milliseconds = drawn(loaded, case, &settings, renderer)?.1;
            passes.push(timed(RAY_TRACE, PassStage::Method, milliseconds));
            frame_ms += milliseconds;
        }
        Ok(Run { frame_ms: Some(frame_ms), passes, ..Run::default() })
    }

    /// Draws the settings that groups show, beside the truth.
    fn pictures(&mut self, folder: &Folder) -> anyhow::Result<()> {
        for (name, case) in missing_pictures(folder) {
            let case = &case;
            let mut settings = self.prepare(case)?;
            chosen(&folder.runs, case).iter().try_for_each(|(key, value)| settings.set_text(key, value))?;
            let Self { plan, renderer, loaded, .. } = self;
            let (_, loaded) = loaded.last_mut().ok_or_else(|| anyhow!("no scene is loaded"))?;
            let (group, size) = (&plan.groups[case.group], drawn_size(case.size, &settings));
            draw(loaded, renderer, case, &settings, group)?;
            let png = match group.pictures {
                Pictures::Each => {
                    traced(loaded, plan, case, &settings, renderer)?;
                    let mirror = renderer.read_aov(Aov::Mirror)?.data;
                    picture::cut(size, &mirror, &renderer.read_picture()?)?
                }
                _ => {
                    loaded.traced(plan, settings.splat.size)?;
                    let drawn = drawn(loaded, case, &settings, renderer)?.0;
                    let (_, reference) =
                        reference(loaded, plan, case, &settings, Truth::SameInput, &drawn, Wanted::Mirrors)?;
                    picture::beside(size, &drawn.surface.mirror, &drawn.color, &reference)?
                }
            };
            if let Some(png) = png {
                folder.write(&name, &png)?;
            }
        }
        Ok(())
    }
}

/// Draws a frame that keeps nothing of other settings', after others of the same setting if the group wants them, for
/// methods that learn from frame to frame. Returns the frames that count: the last one; where the camera turns, all but
/// the first, which has nothing to begin with.
fn draw(
    loaded: &Loaded,
    renderer: &mut Renderer,
    case: &Case,
    settings: &Settings,
    group: &Group,
) -> render::Result<Vec<FrameStats>> {
    let Subject { store, camera, .. } = &loaded.subject;
    let before = group.frames_before;
    let mut anew = settings.clone();
    // Each of the frames is drawn, even though nothing moves.
    anew.reflection.keep &= before == 0;
    renderer.forget();
    let mut frames = Vec::new();
    for left in (0..=before).rev() {
        let mut camera = *camera;
        if left > 0 && case.orbit != 0.0 {
            camera.orbit(-case.orbit.to_radians() * f64::from(left), 0.0);
        }
        let size = drawn_size(case.size, settings);
        let effort = Effort { light_may_lag: group.lags && left < before, ..Effort::FULL };
        let frame = Frame::new(&camera, &anew, loaded.subject.objects(), size);
        frames.push(renderer.render(store, &Frame { effort, ..frame })?);
    }
    let skipped = if case.orbit == 0.0 { before as usize } else { 1 };
    Ok(frames.split_off(skipped))
}

/// The frame that was drawn last with what the ray tracer sees in its mirrors, if that is the method. It is then in the
/// renderer's picture, too.
fn traced(
    loaded: &mut Loaded,
    plan: &Plan,
    case: &Case,
    settings: &Settings,
    renderer: &mut Renderer,
) -> anyhow::Result<Option<Drawn>> {
    if case.method != RAY_TRACE {
        return Ok(None);
    }
    loaded.traced(plan, settings.splat.size)?;
    let (drawn, _) = drawn(loaded, case, settings, renderer)?;
    renderer.present(settings, &drawn.color, true)?;
    Ok(Some(drawn))
}

fn mirror_pixels(mirror: &[f32]) -> f64 {
    mirror.iter().filter(|mirror| **mirror > 0.0).count() as f64
}

/// A hash of all that a scene's loading depends on: how it is read, coloured and, without a camera or light of its own,
/// seen and lit, and from how far.
fn loading_key(case: &Case, settings: &Settings) -> String {
    let Settings { scene, surface, color, view, light, .. } = settings;
    let differing =
        [param::differing(scene), param::differing(surface), param::differing(color), param::differing(view)];
    format!("{} {} {differing:?} {:?}", case.scene, case.distance, light.by)
}

/// How much the mirrors' pixels flicker, in grey levels: while the camera stands still, and while it moves sideways by
/// quarters of a pixel. Then a place on the mirror is followed from frame to frame; the motion of its content is part
/// of the figure, and the same for all methods.
fn flickers(
    loaded: &Loaded,
    case: &Case,
    settings: &Settings,
    renderer: &mut Renderer,
    first: &Drawn,
) -> anyhow::Result<[Option<f64>; 2]> {
    let (_, scene) = loaded.traced.as_ref().ok_or_else(|| anyhow!("the scene was not traced"))?;
    let (subject, origin, size) = (&loaded.subject, scene.origin, drawn_size(case.size, settings));
    let mask: Vec<bool> = first.surface.mirror.iter().map(|mirror| *mirror > 0.0).collect();
    let mut measure = |steps| -> anyhow::Result<Option<f64>> {
        let (view, mut settings) = (&settings.view, settings.clone());
        // Each frame is drawn anew, and methods may use what they remember of the frames before.
        settings.reflection.keep = false;
        renderer.forget();
        let draw = |camera: &Camera| -> anyhow::Result<FrameImages> {
            // Between the world's coordinates and those near the scene.
            let camera = Camera { eye: camera.eye + origin, pivot: camera.pivot + origin, ..*camera };
            // The ray tracer's random numbers continue as they would from frame to frame.
            settings.trace.seed = settings.trace.seed.wrapping_add(1);
            renderer.render(&subject.store, &Frame::new(&camera, &settings, subject.objects(), size))?;
            let view = View { camera: &camera, settings: &settings, objects: subject.objects(), size };
            let tracer = Tracer::new(scene, view);
            let mut drawn = tracer.drawn(renderer)?;
            if case.method == RAY_TRACE {
                tracer.ray_trace(&mut drawn, &Progress::default())?;
            }
            Ok(FrameImages { positions: drawn.surface.position.as_chunks::<3>().0.to_vec(), colors: drawn.color })
        };
        let camera = subject.camera;
        let near = Camera { eye: camera.eye - origin, pivot: camera.pivot - origin, ..camera };
        let Followed { frames, .. } = follow(&near, view, size, steps, draw)?;
        let mean = flicker(&mask, &frames).mean;
        Ok(mean.is_finite().then_some(mean))
    };
    Ok([measure(STILL)?, measure(MOVING)?])
}

#[cfg(test)]
mod tests;
