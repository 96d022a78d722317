//! `auto`: chooses the method, its parameters, the virtual lights and their interleaving, the points and the resolution
//! for a time or for an error.
//!
//! 1. It draws the picture with the settings as they are, and the still picture, against which errors count.
//! 2. It changes one setting at a time and draws a small picture. The error of each change is known then, and the cost
//!    model learns its time. What it knows from views before is drawn once, and methods that are known to take three
//!    times as long as the exact one are left out.
//! 3. Of all combinations it predicts time and error: the time by the cost model, the error by the changes' squares,
//!    which add up where errors are independent, those of mirrors' colours and of the rest's apart: the worse of the two
//!    counts. It draws the most promising combination, learns from it, and goes on until the most promising one is
//!    already drawn.
//! 4. It takes the best of those that were drawn in full, so that nothing is chosen on a prediction alone.
//!
//! A person who waits gets a choice by times and errors of views before, [`Explored::first`], before the still picture.
//!
//! No rule names a scene. A method that another one beats in time and error is left out of step 3.

mod changes;
mod search;

use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;
use render::{FrameStats, Renderer};
use scene::{Camera, Method, Settings};

pub use self::changes::KnownErrors;
use self::changes::{
    Change, Combination, Kind, Squares, changes_of, combinations, correct, differing, predicted_error, squares_of,
    without_dominated,
};
use self::search::{Drawn, Search, is_no_choice, slow};
use crate::cost::{CostModel, Costs, Workload};
use crate::still::{Still, StillError, Target, drawn_size, judging_settings};

/// The most pixels of the small pictures by which single changes are judged.
const SMALL: f64 = 320.0 * 240.0;

/// The most combinations that are drawn in full.
const MOST_DRAWN: usize = 8;

/// The most that are drawn before the still picture.
const MOST_FIRST: usize = 3;

/// After each combination that did not keep to the target, predictions must keep to this share of what they had to
/// before, until one keeps to it.
const MARGIN: f64 = 0.87;

/// The weight of what was learned of other scenes beside one frame of this one.
const OTHER_SCENES: f64 = 0.02;

/// What `auto` chose.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// The parameters that differ from those of before, with their values; `reflection.method` is always among them.
    pub set: BTreeMap<String, String>,
    pub predicted_ms: f64,
    /// The error that counts for the target.
    pub predicted_error: f64,
    /// All errors against the still picture; `None` if that was not drawn.
    pub errors: Option<StillError>,
    pub why: String,
    /// The seconds that choosing took, and the frames that were drawn for it.
    pub seconds: f64,
    pub frames: usize,
}

impl Choice {
    /// Sets the chosen values.
    ///
    /// # Errors
    /// A parameter that does not exist, or a value out of range: the choice was kept by another version.
    pub fn apply(&self, settings: &mut Settings) -> Result<(), param::Error> {
        self.set.iter().try_for_each(|(key, value)| settings.set_text(key, value))
    }
}

/// Draws a frame from scratch with these settings in this size.
pub type Draw<'a> = dyn FnMut(&mut Renderer, &Settings, [u32; 2]) -> anyhow::Result<FrameStats> + 'a;

/// What draws a view and learns from its times.
pub struct Hands<'a, 'b> {
    pub renderer: &'a mut Renderer,
    pub draw: &'a mut Draw<'b>,
    /// The cost model of the adapter.
    pub model: &'a mut CostModel,
}

/// A combination with what is predicted of it, or known.
struct Candidate {
    /// The index of the combination.
    index: usize,
    milliseconds: f64,
    error: f64,
    is_drawn: bool,
}

impl Candidate {
    /// The share of the target to which it must keep.
    fn share(&self, margin: f64) -> f64 {
        if self.is_drawn { 1.0 } else { margin }
    }
}

/// Chooses settings for a view of `size` pixels. Parameters of `fixed` stay as they are. The cost model learns from all
/// frames that are drawn.
///
/// # Errors
/// The device was lost, or a frame needs more memory than there is; what `draw` returns.
pub fn choose(
    target: Target,
    settings: &Settings,
    fixed: &[String],
    view: (&Camera, [u32; 2]),
    hands: &mut Hands<'_, '_>,
) -> anyhow::Result<Choice> {
    Explored::new(settings, fixed, view, !matches!(target, Target::Pixels(_)), hands)?.choose(target, hands)
}

/// What is known of a view before a target is.
pub struct Explored {
    settings: Settings,
    /// The settings with the method that `auto` stands for.
    base: Settings,
    camera: Camera,
    size: [u32; 2],
    /// The milliseconds of a frame with the base's settings, and what it did.
    milliseconds: f64,
    work: Workload,
    kind: Kind,
    still_settings: Settings,
    /// The changes that may be made.
    changes: Vec<Change>,
    /// The squares of the errors of the base, and the changes with their errors and times, as views before had them;
    /// `None` where any is missing.
    expected: Option<(Squares, Vec<Change>)>,
    judged: Option<Judged>,
    /// The cost model with more weight on this view.
    local: CostModel,
    seconds: f64,
    frames: usize,
}

/// The still picture, it and the picture with the base's settings with their errors, and the changes with theirs.
struct Judged {
    still: Still,
    drawn: [Drawn; 2],
    changes: Vec<Change>,
}

/// A combination that was drawn in full.
#[derive(Clone, Debug)]
struct Tried {
    settings: Settings,
    milliseconds: f64,
    /// The error that counts: what is expected, or what `errors` say.
    error: f64,
    /// The errors against the still picture; `None` before that is drawn.
    errors: Option<StillError>,
}

impl Tried {
    fn of(target: Target, drawn: Drawn) -> Self {
        let Drawn { settings, milliseconds, error, .. } = drawn;
        Self { settings, milliseconds, error: target.error(&error), errors: Some(error) }
    }

    fn keeps(&self, target: Target) -> bool {
        target.is_kept(self.milliseconds, self.error)
    }
}

impl Explored {
    /// Draws a picture with the settings as they are. Changes of light are left alone unless `light_counts`.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn new(
        settings: &Settings,
        fixed: &[String],
        (camera, size): (&Camera, [u32; 2]),
        light_counts: bool,
        hands: &mut Hands<'_, '_>,
    ) -> anyhow::Result<Self> {
        let start = Instant::now();
        let mut base = settings.clone();
        base.reflection.method = base.reflection.method.chosen();
        // What was learned of other scenes counts until more is known of this one.
        let mut local = hands.model.clone();
        local.fade(OTHER_SCENES);
        let mut search = Search { camera, hands, local, frames: 0 };
        let (stats, milliseconds) = search.timed(&base, size)?;
        let work = Workload::of(&stats, &base, drawn_size(size, &base));
        let changes = changes_of(&base, fixed, work.mirrors > 0.0, light_counts && work.lights > 0.0);
        let still_settings = still_of(&base, fixed);
        let kind = Kind::new(work.mirrors > 0.0, fixed);
        let exact = still_settings.reflection.method;
        let expected = expected(&search, (&base, &work, &kind), &changes, (exact, small(size)));
        let Search { local, frames, .. } = search;
        Ok(Self {
            settings: settings.clone(),
            still_settings,
            base,
            camera: *camera,
            size,
            milliseconds,
            work,
            kind,
            changes,
            expected,
            judged: None,
            local,
            seconds: start.elapsed().as_secs_f64(),
            frames,
        })
    }

    /// The milliseconds of a frame with the settings as they were.
    pub fn milliseconds(&self) -> f64 {
        self.milliseconds
    }

    /// Chooses settings by the errors of views before, before the still picture of this one is drawn: their time is
    /// measured, and their error is only expected. `None` where there are no such errors.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn first(&self, target: Target, hands: &mut Hands<'_, '_>) -> anyhow::Result<Option<Choice>> {
        self.expected.as_ref().map(|expected| self.search(target, None, expected, hands)).transpose()
    }

    /// Chooses settings for a target.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn choose(&mut self, target: Target, hands: &mut Hands<'_, '_>) -> anyhow::Result<Choice> {
        let judged = match self.judged.take() {
            Some(judged) => judged,
            None => self.judge(hands)?,
        };
        let known = (squares_of(&judged.drawn[1].error), judged.changes.clone());
        let choice = self.search(target, Some(&judged), &known, hands);
        self.judged = Some(judged);
        choice
    }

    /// Draws the still picture, the picture with the settings as they are, and a small picture of each change.
    fn judge(&mut self, hands: &mut Hands<'_, '_>) -> anyhow::Result<Judged> {
        let start = Instant::now();
        let mut search = Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames };
        let small = small(self.size);
        // Shaders are compiled for the small one, so that one frame of the large one tells its time.
        let of_small = match small == self.size {
            true => None,
            false => Some(search.still(&self.still_settings, small)?.0),
        };
        let (still, milliseconds) = search.timed_still(&self.still_settings, self.size)?;
        // A resolution that is fixed makes the still picture of full resolution none that may be chosen.
        let best = match drawn_size(self.size, &self.still_settings) == self.size {
            true => Drawn { settings: self.still_settings.clone(), milliseconds, error: still.none() },
            false => search.drawn(&self.still_settings, &still, self.size)?,
        };
        let first = search.drawn(&self.base, &still, self.size)?;
        let (base, still_of_small) = ((&self.base, &self.work), of_small.as_ref().unwrap_or(&still));
        let exact = self.still_settings.reflection.method;
        let changes = search.measured(base, &self.changes, exact, still_of_small, small)?;
        search.hands.model.errors.learn(&self.kind, &self.base, squares_of(&first.error), &changes);
        (self.local, self.frames) = (search.local, search.frames);
        self.seconds += start.elapsed().as_secs_f64();
        Ok(Judged { still, drawn: [best, first], changes })
    }

    /// Draws the combinations that promise most until the most promising one is already drawn. `known` are the squares
    /// of the errors of the base, and what the changes add to them.
    fn search(
        &self,
        target: Target,
        judged: Option<&Judged>,
        (squares, changes): &(Squares, Vec<Change>),
        hands: &mut Hands<'_, '_>,
    ) -> anyhow::Result<Choice> {
        let start = Instant::now();
        // Light changes no pixel error: it stays as it is.
        let is_of_target = |change: &&Change| !matches!(target, Target::Pixels(_)) || !change.is_of_light();
        let changes: Vec<Change> = changes.iter().filter(is_of_target).cloned().collect();
        let (dominated, mut changes) = without_dominated(changes, target);
        let mut combinations = combinations(&self.base, &changes);
        let count = combinations.len();
        let squares = *squares;
        let mut tried = match judged {
            Some(judged) => judged.drawn.clone().map(|drawn| Tried::of(target, drawn)).to_vec(),
            None => {
                let (settings, milliseconds) = (self.base.clone(), self.milliseconds);
                let error = predicted_error(target, squares, Squares::default());
                vec![Tried { settings, milliseconds, error, errors: None }]
            }
        };
        let (before, most) = (tried.len(), if judged.is_some() { MOST_DRAWN } else { MOST_FIRST });
        let mut search = Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames };
        while tried.len() < before + most {
            let in_a_row = tried[before..].iter().rev().take_while(|tried| !tried.keeps(target)).count();
            let margin = MARGIN.powi(in_a_row as i32);
            let predicted = |combination: &Combination| predicted_error(target, squares, combination.squares(&changes));
            let candidates = self.candidates(&search.local.costs(), &combinations, &tried, predicted);
            let Some(next) = promising(target, margin, &candidates).filter(|next| !next.is_drawn) else { break };
            let (index, error) = (next.index, next.error);
            let combination = combinations[index].clone();
            let settings = &combination.settings;
            let drawn = match judged {
                Some(judged) => search.drawn(settings, &judged.still, self.size).map(|drawn| Tried::of(target, drawn)),
                None => search.timed(settings, self.size).map(|(_, milliseconds)| Tried {
                    settings: settings.clone(),
                    milliseconds,
                    error,
                    errors: None,
                }),
            };
            match drawn {
                Ok(found) => {
                    if let Some(errors) = &found.errors {
                        let measured = squares_of(errors);
                        correct(&mut changes, &combination, std::array::from_fn(|part| measured[part] - squares[part]));
                    }
                    tried.push(found);
                }
                Err(error) if is_no_choice(&error) => {
                    let refused = settings.reflection.method;
                    combinations.retain(|combination| combination.settings.reflection.method != refused);
                }
                Err(error) => return Err(error),
            }
        }
        let (best, reached) = best(target, &tried);
        let Tried { settings: chosen, milliseconds, error, errors } = best.clone();
        let (frames, seconds) = (search.frames, self.seconds + start.elapsed().as_secs_f64());
        let found = format!("{milliseconds:.1} ms, {error:.3} {}", target.error_unit());
        let reason = match (target, reached) {
            (Target::Milliseconds(_), true) => format!("the smallest error of what keeps to {target}: {found}"),
            (Target::Milliseconds(_), false) => format!("nothing keeps to {target}, this is the fastest: {found}"),
            (_, true) => format!("the fastest of what keeps to {target}: {found}"),
            (_, false) => format!("nothing keeps to {target}, this has the smallest error: {found}"),
        };
        let left_out = match dominated.as_slice() {
            [] => String::new(),
            names => format!("; never better than another method: {}", names.join(", ")),
        };
        let by = match &errors {
            Some(errors) => errors.to_string(),
            None => "the error is what views before had".to_owned(),
        };
        let why =
            format!("{reason} ({by}); chosen from {count} settings by {frames} frames in {seconds:.1} s{left_out}");
        let set = differing(&self.settings, &chosen);
        Ok(Choice { set, predicted_ms: milliseconds, predicted_error: error, errors, why, seconds, frames })
    }

    /// What is predicted of all combinations whose passes were ever measured, or known of those that were drawn.
    fn candidates(
        &self,
        costs: &Costs,
        combinations: &[Combination],
        tried: &[Tried],
        predicted: impl Fn(&Combination) -> f64 + Sync,
    ) -> Vec<Candidate> {
        let candidate = |(index, combination): (usize, &Combination)| {
            let settings = &combination.settings;
            let known = tried.iter().find(|tried| tried.settings == *settings);
            let milliseconds = match known {
                Some(tried) => tried.milliseconds,
                None => costs.predict(&self.work.with(&self.base, settings), settings)?,
            };
            let error = known.map_or_else(|| predicted(combination), |tried| tried.error);
            Some(Candidate { index, milliseconds, error, is_drawn: known.is_some() })
        };
        combinations.par_iter().enumerate().filter_map(candidate).collect()
    }
}

/// What the changes of `base` add to the squares of its errors, which come first, by the views before, with the times
/// of the changes by the cost model; `None` if any is missing. Methods that would not be tried are left out.
fn expected(
    search: &Search,
    (base, work, kind): (&Settings, &Workload, &Kind),
    changes: &[Change],
    (exact, small): (Method, [u32; 2]),
) -> Option<(Squares, Vec<Change>)> {
    let (errors, costs) = (&search.hands.model.errors, search.local.costs());
    let is_slow = slow(&costs, (base, work), exact, small);
    let mut known = Vec::new();
    for change in changes.iter().filter(|change| !is_slow(change)) {
        let settings = change.of(base);
        let milliseconds = costs.predict(&work.with(base, &settings), &settings)?;
        match errors.of(kind, base, Some(change)) {
            Some(squares) => known.push(Change { squares, milliseconds, ..change.clone() }),
            // Views before may have refused a method.
            None if change.is_of_method() => {}
            None => return None,
        }
    }
    Some((errors.of(kind, base, None)?, known))
}

/// The size of small pictures of a view.
fn small(size: [u32; 2]) -> [u32; 2] {
    let share = (SMALL / size.map(f64::from).iter().product::<f64>()).sqrt().min(1.0);
    size.map(|side| ((f64::from(side) * share).round() as u32).max(1))
}

/// The settings of the still picture. What is fixed stays, but for the method: the error is that of the fixed one.
fn still_of(base: &Settings, fixed: &[String]) -> Settings {
    let mut still = judging_settings(base);
    let is_kept = |key: &String| fixed.contains(key) && key != "reflection.method";
    for (before, after) in base.groups().into_iter().zip(still.groups_mut()) {
        let group = before.group();
        let keys = group.fields.iter().map(|field| format!("{}.{}", group.name, field.name));
        let values = keys.zip(before.values()).zip(after.values());
        let values = values.map(|((key, before), after)| if is_kept(&key) { before } else { after });
        let values: Vec<param::Value> = values.collect();
        after.set_values(&values);
    }
    still
}

/// The candidate that is expected to meet the target best. What is only predicted must keep to a share of it, `margin`.
fn promising(target: Target, margin: f64, candidates: &[Candidate]) -> Option<&Candidate> {
    let by_error =
        |a: &&Candidate, b: &&Candidate| a.error.total_cmp(&b.error).then(a.milliseconds.total_cmp(&b.milliseconds));
    let by_time =
        |a: &&Candidate, b: &&Candidate| a.milliseconds.total_cmp(&b.milliseconds).then(a.error.total_cmp(&b.error));
    match target {
        Target::Milliseconds(most) => {
            let keeps = |candidate: &&Candidate| candidate.milliseconds <= most * candidate.share(margin);
            let keeping = candidates.iter().filter(keeps).min_by(by_error);
            keeping.or_else(|| candidates.iter().min_by(by_time))
        }
        Target::Pixels(most) | Target::DeltaE(most) => {
            let keeps = |candidate: &&Candidate| candidate.error <= most * candidate.share(margin);
            let keeping = candidates.iter().filter(keeps).min_by(by_time);
            keeping.or_else(|| candidates.iter().min_by(by_error))
        }
    }
}

/// The best of what was drawn, which is never nothing, and whether it keeps to the target.
fn best(target: Target, tried: &[Tried]) -> (&Tried, bool) {
    let by_error = |a: &&Tried, b: &&Tried| a.error.total_cmp(&b.error);
    let by_time = |a: &&Tried, b: &&Tried| a.milliseconds.total_cmp(&b.milliseconds);
    let keeping = tried.iter().filter(|tried| tried.keeps(target));
    let (kept, nearest) = match target {
        Target::Milliseconds(_) => (keeping.min_by(by_error), tried.iter().min_by(by_time)),
        Target::Pixels(_) | Target::DeltaE(_) => (keeping.min_by(by_time), tried.iter().min_by(by_error)),
    };
    kept.map_or_else(|| (nearest.unwrap_or(&tried[0]), false), |kept| (kept, true))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::still::ColorError;

    fn tried(milliseconds: f64, delta_e: f64, pixels: f64) -> Drawn {
        let [mirrors, rest] = [delta_e, 0.0].map(|mean| Some(ColorError { mean, p95: mean }));
        let error = StillError { delta_e: 0.0, mirrors, rest, pixels };
        Drawn { settings: Settings::default(), milliseconds, error }
    }

    #[test]
    fn the_best_keeps_to_the_target_or_comes_nearest() {
        let all = [tried(100.0, 0.0, 0.0), tried(50.0, 1.0, 3.0), tried(20.0, 2.0, 0.5), tried(10.0, 8.0, 9.0)];
        let of_some = |target, some: &[Drawn]| {
            let some: Vec<Tried> = some.iter().map(|drawn| Tried::of(target, drawn.clone())).collect();
            let (best, reached) = best(target, &some);
            (best.milliseconds, reached)
        };
        let chosen = |target| of_some(target, &all);
        assert_eq!(chosen(Target::Milliseconds(60.0)), (50.0, true));
        assert_eq!(chosen(Target::Milliseconds(200.0)), (100.0, true));
        assert_eq!(chosen(Target::Milliseconds(5.0)), (10.0, false));
        assert_eq!(chosen(Target::DeltaE(2.5)), (20.0, true));
        assert_eq!(chosen(Target::Pixels(1.0)), (20.0, true));
        assert_eq!(of_some(Target::DeltaE(0.5), &all[1..]), (50.0, false));
        let candidate = |milliseconds, error| Candidate { index: 0, milliseconds, error, is_drawn: false };
        let candidates = [candidate(30.0, 1.0), candidate(20.0, 1.0), candidate(10.0, 5.0)];
        let promised = |target| promising(target, 1.0, &candidates).unwrap().milliseconds;
        assert_eq!(promised(Target::Milliseconds(40.0)), 20.0, "of equal errors the faster");
        assert_eq!(promised(Target::Milliseconds(1.0)), 10.0);
        assert_eq!((promised(Target::DeltaE(6.0)), promised(Target::DeltaE(0.1))), (10.0, 20.0));
        let careful = promising(Target::DeltaE(6.0), 0.8, &candidates).unwrap();
        assert_eq!(careful.milliseconds, 20.0, "after misses a prediction needs a margin");
    }

    #[test]
    fn the_still_picture_keeps_what_is_fixed_but_not_the_method() {
        let mut base = Settings::default();
        (base.reflection.method, base.gi.vpls, base.view.resolution) = (Method::None, 64, 0.5);
        let fixed = ["gi.vpls".to_owned(), "reflection.method".to_owned()];
        let still = still_of(&base, &fixed);
        assert_eq!((still.reflection.method, still.gi.vpls), (Method::SurfelTrace, 64));
        assert_eq!(still.mirror.surface, scene::MirrorSurface::Exact);
        base.mirror.surface = scene::MirrorSurface::Points;
        assert_eq!(still_of(&base, &fixed).mirror.surface, scene::MirrorSurface::Points);
        assert_eq!((still.view.resolution, still.gi.interleave), (1.0, 1));
        assert_eq!(small([800, 600]), [320, 240]);
        assert_eq!(small([64, 48]), [64, 48]);
    }
}
