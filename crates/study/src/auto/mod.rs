//! `auto`: chooses the method, its parameters, the virtual lights and their interleaving, the points and the resolution
//! for a time or for an error.
//!
//! 1. It draws the picture with the settings as they are, and the still picture, against which errors count.
//! 2. It changes one setting at a time and draws a small picture. The error of each change is known then, and the cost
//!    model learns its time. Methods whose passes are known to take 1.5 times those of the exact one are left out, and
//!    so are changes that may not be part of the choice by the errors of views before and the times of the cost model.
//! 3. Of all combinations it predicts time and error: the time by the cost model, the error by the changes' squares,
//!    which add up where errors are independent, those of mirrors' colours and of the rest's apart: the worse of the two
//!    counts. It draws the most promising combination, learns from it, and goes on until the most promising one is
//!    already drawn.
//! 4. If changes that were left out may be better than the best of what was drawn in full, they are tried, and it goes
//!    on with step 3.
//! 5. It takes the best of those that were drawn in full, so that nothing is chosen on a prediction alone. No single
//!    frame decides: other work of the machine may have disturbed it.
//!
//! A person who waits gets a choice by times and errors of views before, [`Explored::first`], before the still picture.
//!
//! No rule names a scene. A method that another one beats in time and error is left out of step 3.

mod changes;
mod open;
mod search;
mod stills;

use std::collections::BTreeMap;
use std::time::Instant;

use rayon::prelude::*;
use render::{FrameStats, PassTime, Renderer};
use scene::{Camera, Method, Settings};

use self::changes::{
    Change, Combination, Kind, METHOD, Squares, base_of, changes_of, combinations, correct, differing, predicted_error,
    squares_of, without_dominated,
};
pub use self::changes::{KnownErrors, may_change};
use self::search::{Drawn, Search, Unchanged, is_no_choice, slow};
use self::stills::{Stills, small_size};
use crate::cost::{CostModel, Costs, Workload};
use crate::still::{Shown, Still, StillError, Target, drawn_size};

/// The most combinations that are drawn in full.
const MOST_DRAWN: usize = 8;

/// The most that are drawn before the still picture.
const MOST_FIRST: usize = 3;

/// After each combination that did not keep to the target, predictions must keep to this share of what they had to
/// before, until one keeps to it.
const MARGIN: f64 = 0.87;

/// A frame that takes so many times another one of equal work was disturbed.
const DISTURBED: f64 = 1.25;

/// So many times better a combination must promise to be than what was drawn.
const WORTHWHILE: f64 = 1.02;

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

/// Draws a frame with these settings in this size, and with what the renderer kept of those before.
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

    /// What is sought to be small, as it counts: what is only predicted must be better by [`WORTHWHILE`] to be drawn.
    fn counted(&self, value: f64) -> f64 {
        if self.is_drawn { value } else { value * WORTHWHILE }
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
    /// Those in which single parameters are changed ([`base_of`]).
    base: Settings,
    camera: Camera,
    size: [u32; 2],
    /// The milliseconds of a frame with the base's settings, and what it did.
    milliseconds: f64,
    work: Workload,
    /// That frame, and its passes.
    shown: Shown,
    passes: Vec<PassTime>,
    kind: Kind,
    stills: Stills,
    /// The still picture's settings as they may be chosen: they leave alone the methods that mirrors have of their own.
    /// `None` where they may not be: where a resolution below 1 or another method is fixed, or mirrors that are seen have
    /// other methods, so that it would not be the still picture.
    still_choice: Option<Settings>,
    /// The changes that may be made, those of a parameter together.
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

/// The still picture, what was drawn besides, and the changes with their errors.
struct Judged {
    still: Still,
    /// The picture with the base's settings, and the still picture if its time is known.
    drawn: Vec<Drawn>,
    /// The view in the size in which changes are tried.
    unchanged: Unchanged,
    /// Its still picture, unless that is `still`.
    small_still: Option<Still>,
    /// The changes that were tried.
    changes: Vec<Change>,
    /// Those that were not, with what they added to the squares of the errors of views before.
    open: Vec<(Change, Option<Squares>)>,
}

impl Judged {
    /// The still picture in the size in which changes are tried.
    fn small_still(&self) -> &Still {
        self.small_still.as_ref().unwrap_or(&self.still)
    }
}

/// A combination that was drawn in full.
#[derive(Clone, Debug)]
struct Tried {
    settings: Settings,
    /// What was measured, or is expected after other work was found to have disturbed that.
    milliseconds: f64,
    measured: f64,
    /// The error that counts: what is expected, or what `errors` say.
    error: f64,
    /// The errors against the still picture; `None` before that is drawn.
    errors: Option<StillError>,
    /// Whether its time was measured twice.
    is_sure: bool,
}

/// What was drawn in full for a target, and what that took.
#[derive(Default)]
struct Full {
    tried: Vec<Tried>,
    seconds: f64,
    frames: usize,
}

impl Tried {
    fn new(settings: &Settings, milliseconds: f64, error: f64, errors: Option<StillError>) -> Self {
        Self { settings: settings.clone(), milliseconds, measured: milliseconds, error, errors, is_sure: false }
    }

    fn of(target: Target, drawn: &Drawn) -> Self {
        Self::new(&drawn.settings, drawn.milliseconds, target.error(&drawn.error), Some(drawn.error))
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
        let base = base_of(settings, fixed, light_counts);
        // What was learned of other scenes counts until more is known of this one.
        let mut local = hands.model.clone();
        local.fade(OTHER_SCENES);
        let mut search = Search { camera, hands, local, frames: 0 };
        let stats = search.timed(&base, size, f64::INFINITY)?;
        let of_base = drawn_size(size, &base);
        let work = Workload::of(&stats, &base, of_base);
        let shown = Shown::read(search.hands.renderer, camera, &base, of_base)?;
        let changes = changes_of(settings, &base, fixed, work.mirrors > 0.0, light_counts && work.lights > 0.0);
        let stills = Stills::new(settings, fixed, size);
        let kind = Kind::new(settings, &base, work.mirrors > 0.0, fixed);
        let is_fixed = fixed.iter().any(|key| key == METHOD);
        let mut choice = stills.whole.clone();
        choice.reflection.own_methods = base.reflection.own_methods;
        let has_method = |method| stats.methods.iter().all(|own| *own == method);
        let exact = stills.whole.reflection.method;
        let expected = expected(&search, (&base, &work, &kind), &changes, (exact, small_size(size)));
        let Search { local, frames, .. } = search;
        Ok(Self {
            settings: settings.clone(),
            still_choice: Some(choice).filter(|_| {
                let has_methods = has_method(base.reflection.method) && (!is_fixed || has_method(exact));
                // A large still picture shares its lights among pixels, and is no choice.
                let is_whole = stills.whole.gi.interleave == stills.small.gi.interleave;
                drawn_size(size, &stills.whole) == size && has_methods && is_whole
            }),
            stills,
            base,
            camera: *camera,
            size,
            milliseconds: stats.frame_milliseconds,
            work,
            shown,
            passes: stats.passes,
            kind,
            changes,
            expected,
            judged: None,
            local,
            seconds: start.elapsed().as_secs_f64(),
            frames,
        })
    }

    /// The milliseconds of a frame with the settings as they were, or with virtual lights in the place of rays of light.
    pub fn milliseconds(&self) -> f64 {
        self.milliseconds
    }

    /// Chooses settings by the errors of views before, before the still picture of this one is drawn: their time is
    /// measured, and their error is only expected. `None` where there are no such errors.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn first(&mut self, target: Target, hands: &mut Hands<'_, '_>) -> anyhow::Result<Option<Choice>> {
        let Some(expected) = self.expected.clone() else { return Ok(None) };
        let error = predicted_error(target, expected.0, Squares::default());
        let tried = vec![Tried::new(&self.base, self.milliseconds, error, None)];
        self.search(target, None, &expected, &mut Full { tried, ..Full::default() }, hands).map(Some)
    }

    /// Chooses settings for a target. Changes are tried only if they may be part of the choice by the times and errors of
    /// views before. Where the best that was found shows that others may be, too, these are tried, and it goes on.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn choose(&mut self, target: Target, hands: &mut Hands<'_, '_>) -> anyhow::Result<Choice> {
        let mut judged = match self.judged.take() {
            Some(judged) => judged,
            None => self.judge(hands)?,
        };
        let choice = self.choose_by(target, &mut judged, hands);
        self.judged = Some(judged);
        choice
    }

    fn choose_by(&mut self, target: Target, judged: &mut Judged, hands: &mut Hands<'_, '_>) -> anyhow::Result<Choice> {
        let tried = judged.drawn.iter().map(|drawn| Tried::of(target, drawn)).collect();
        let mut full = Full { tried, ..Full::default() };
        let mut wanted = self.open(target, judged, None);
        loop {
            self.try_open(judged, &wanted, hands)?;
            let known = (squares_of(&judged.drawn[0].error), judged.changes.clone());
            let mut choice = self.search(target, Some(judged), &known, &mut full, hands)?;
            wanted = self.open(target, judged, Some(best(target, &full.tried).0));
            if wanted.is_empty() {
                let left_out: Vec<_> = judged.open.iter().filter(|(_, known)| known.is_some()).collect();
                for (change, _) in &left_out {
                    hands.model.errors.doubt(&self.kind, &self.base, change);
                }
                if !left_out.is_empty() {
                    choice.why += &format!("; changes left out by what views before had: {}", left_out.len());
                }
                return Ok(choice);
            }
        }
    }

    /// Draws the still picture, and what changes are compared with.
    fn judge(&mut self, hands: &mut Hands<'_, '_>) -> anyhow::Result<Judged> {
        let start = Instant::now();
        let open = |change: &Change| (change.clone(), hands.model.errors.of(&self.kind, &self.base, Some(change)));
        let open = self.changes.iter().map(open).collect();
        let mut search = Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames };
        let (size, small) = (self.size, small_size(self.size));
        let (of_small, milliseconds, maps) = search.still(&self.stills.small, small, None)?;
        let (still, small_still, milliseconds) = match size == small {
            true => (of_small, None, milliseconds),
            false => {
                let (still, milliseconds, _) = search.still(&self.stills.whole, size, Some(&maps))?;
                (still, Some(of_small), milliseconds)
            }
        };
        let error = still.error_of(&self.shown);
        let mut drawn = vec![Drawn { settings: self.base.clone(), milliseconds: self.milliseconds, error }];
        if let (Some(milliseconds), Some(settings)) = (milliseconds, self.still_choice.clone()) {
            drawn.push(Drawn { settings, milliseconds, error: still.none() });
        }
        let (error, passes) = match &small_still {
            None => (error, self.passes.clone()),
            Some(still) => search.base_of_small(&self.base, still, small)?,
        };
        search.hands.model.errors.learn(&self.kind, &self.base, squares_of(&drawn[0].error), &[]);
        let (settings, squares) = (self.base.clone(), squares_of(&error));
        let unchanged = Unchanged { settings, work: self.work, size: small, squares, passes };
        (self.local, self.frames) = (search.local, search.frames);
        self.seconds += start.elapsed().as_secs_f64();
        Ok(Judged { still, drawn, unchanged, small_still, changes: Vec::new(), open })
    }

    /// Draws a small picture of each of the changes that are `wanted`.
    fn try_open(&mut self, judged: &mut Judged, wanted: &[Change], hands: &mut Hands<'_, '_>) -> anyhow::Result<()> {
        let start = Instant::now();
        let mut search = Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames };
        let exact = self.stills.whole.reflection.method;
        let found = search.measured(&judged.unchanged, judged.small_still(), wanted, exact)?;
        search.hands.model.errors.learn_changes(&self.kind, &self.base, &found);
        (self.local, self.frames) = (search.local, search.frames);
        judged.open.retain(|(open, _)| wanted.iter().all(|wanted| wanted.set != open.set));
        judged.changes.extend(found);
        // Combinations take the changes of a parameter together.
        let place = |change: &Change| self.changes.iter().position(|own| own.set == change.set);
        judged.changes.sort_by_key(place);
        let costs = self.local.costs();
        for change in &mut judged.changes {
            change.milliseconds = self.expected_time(&costs, &change.of(&self.base)).unwrap_or(f64::INFINITY);
        }
        self.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// The milliseconds that a frame with other settings is expected to take.
    fn expected_time(&self, costs: &Costs, settings: &Settings) -> Option<f64> {
        costs.predict(&self.work.with(&self.base, settings), settings)
    }

    /// Draws the combinations that promise most until the most promising one is already drawn. `known` are the squares
    /// of the errors of the base, and what the changes add to them.
    fn search(
        &mut self,
        target: Target,
        judged: Option<&Judged>,
        (squares, changes): &(Squares, Vec<Change>),
        Full { tried, seconds, frames }: &mut Full,
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
        // What was drawn in full before further changes were tried.
        let drawn_before = &tried[judged.map_or(tried.len(), |judged| judged.drawn.len())..];
        correct_by(drawn_before, &combinations, (squares, &mut changes));
        let matters = if let Target::Milliseconds(most) = target { most } else { f64::INFINITY };
        let mut search =
            Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames + *frames };
        if let Some(judged) = judged {
            self.try_still(target, judged, tried, &mut search)?;
        }
        let (before, most) = (tried.len(), if judged.is_some() { MOST_DRAWN } else { MOST_FIRST });
        loop {
            let in_a_row = tried[before..].iter().rev().take_while(|tried| !tried.keeps(target)).count();
            let margin = MARGIN.powi(in_a_row as i32);
            let predicted = |combination: &Combination| predicted_error(target, squares, combination.squares(&changes));
            let costs = search.local.costs();
            let candidates = self.candidates(&costs, &combinations, tried, predicted);
            let next = promising(target, margin, &candidates).filter(|next| !next.is_drawn);
            let Some(next) = next.filter(|_| tried.len() < before + most) else {
                let expected = |settings: &Settings| self.expected_time(&costs, settings);
                let Some(index) = doubtful(target, tried, expected) else { break };
                let again = search.again(&tried[index].settings, self.size)?;
                look_again(tried, index, again, &mut search.local);
                continue;
            };
            let (index, error) = (next.index, next.error);
            let combination = combinations[index].clone();
            let settings = &combination.settings;
            let drawn = match judged {
                Some(Judged { still, .. }) => {
                    search.drawn(settings, still, self.size, matters).map(|drawn| Tried::of(target, &drawn))
                }
                None => search
                    .timed(settings, self.size, matters)
                    .map(|stats| Tried::new(settings, stats.frame_milliseconds, error, None)),
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
        let (best, reached) = best(target, tried);
        let Tried { settings: chosen, milliseconds, error, errors, .. } = best.clone();
        *frames = search.frames - self.frames;
        *seconds += start.elapsed().as_secs_f64();
        self.local = search.local;
        let (frames, seconds) = (self.frames + *frames, self.seconds + *seconds);
        let found = format!("{milliseconds:.1} ms, {error:.3} {}", target.error_unit());
        let reason = match (target, reached) {
            (Target::Milliseconds(_), true) => format!("the smallest error of what keeps to {target}: {found}"),
            (Target::Milliseconds(_), false) => {
                format!("nothing keeps to {target}, this is about the fastest: {found}")
            }
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

    /// Adds the still picture to what was tried, unless it is known to take too long.
    fn try_still(
        &self,
        target: Target,
        judged: &Judged,
        tried: &mut Vec<Tried>,
        search: &mut Search<'_, '_, '_>,
    ) -> anyhow::Result<()> {
        let Some(settings) = &self.still_choice else { return Ok(()) };
        let milliseconds = search.local.costs().predict(&self.work.with(&self.base, settings), settings);
        let is_slow = matches!((target, milliseconds), (Target::Milliseconds(most), Some(own)) if own > most);
        if !is_slow && tried.iter().all(|tried| tried.settings != *settings) {
            let drawn = search.drawn(settings, &judged.still, self.size, f64::INFINITY)?;
            tried.push(Tried::of(target, &drawn));
        }
        Ok(())
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

/// Corrects the changes by the combinations that were drawn in full before.
fn correct_by(drawn: &[Tried], combinations: &[Combination], (squares, changes): (Squares, &mut [Change])) {
    if drawn.is_empty() {
        return;
    }
    for combination in combinations {
        let known = drawn.iter().find(|tried| tried.settings == combination.settings);
        if let Some(errors) = known.and_then(|tried| tried.errors) {
            let measured = squares_of(&errors);
            correct(changes, combination, std::array::from_fn(|part| measured[part] - squares[part]));
        }
    }
}

/// The candidate that is expected to meet the target best. What is only predicted must keep to a share of it, `margin`.
fn promising(target: Target, margin: f64, candidates: &[Candidate]) -> Option<&Candidate> {
    let error = |candidate: &Candidate| candidate.counted(candidate.error);
    let time = |candidate: &Candidate| candidate.counted(candidate.milliseconds);
    let by_error = |a: &&Candidate, b: &&Candidate| error(a).total_cmp(&error(b)).then(time(a).total_cmp(&time(b)));
    let by_time = |a: &&Candidate, b: &&Candidate| time(a).total_cmp(&time(b)).then(error(a).total_cmp(&error(b)));
    match target {
        Target::Milliseconds(most) => {
            let keeps = |candidate: &&Candidate| candidate.milliseconds <= most * candidate.share(margin);
            let keeping = candidates.iter().filter(keeps).min_by(by_error);
            keeping.or_else(|| {
                let fastest = candidates.iter().min_by(by_time)?;
                if !fastest.is_drawn && fastest.milliseconds * MARGIN <= most {
                    // It may keep to the time after all.
                    return Some(fastest);
                }
                let is_as_fast = |candidate: &&Candidate| time(candidate) <= time(fastest) * DISTURBED;
                candidates.iter().filter(is_as_fast).min_by(by_error)
            })
        }
        Target::Pixels(most) | Target::DeltaE(most) => {
            let keeps = |candidate: &&Candidate| candidate.error <= most * candidate.share(margin);
            let keeping = candidates.iter().filter(keeps).min_by(by_time);
            keeping.or_else(|| candidates.iter().min_by(by_error))
        }
    }
}

/// The combination that is to be timed once more: the best one for a time, or else that of the smallest error of those
/// that missed it though they are expected to keep to it. Other work of the machine may have disturbed it.
fn doubtful(target: Target, tried: &[Tried], expected: impl Fn(&Settings) -> Option<f64>) -> Option<usize> {
    let Target::Milliseconds(most) = target else { return None };
    let (best, reached) = best(target, tried);
    let is_doubtful = |(_, tried): &(usize, &Tried)| {
        let missed = !tried.keeps(target) && expected(&tried.settings).is_some_and(|own| own <= most);
        let is_better = !reached || tried.error < best.error;
        !tried.is_sure && (std::ptr::eq(*tried, best) || missed && is_better)
    };
    let doubtful = tried.iter().enumerate().filter(is_doubtful);
    doubtful.min_by(|(_, a), (_, b)| a.error.total_cmp(&b.error)).map(|(index, _)| index)
}

/// Takes in the milliseconds of another frame of a combination. If that is much quicker, other work took its share of the
/// machine before: all times that were measured once are expected to be shorter by the same factor.
fn look_again(tried: &mut [Tried], index: usize, milliseconds: f64, local: &mut CostModel) {
    let share = milliseconds / tried[index].milliseconds;
    if share * DISTURBED < 1.0 {
        local.scale(share);
        tried.iter_mut().filter(|tried| !tried.is_sure).for_each(|tried| tried.milliseconds *= share);
    }
    let again = &mut tried[index];
    (again.milliseconds, again.is_sure) = (again.measured.min(milliseconds), true);
}

/// The best of what was drawn, which is never nothing, and whether it keeps to the target. Where nothing keeps to a time, it
/// is the most accurate one of those about as fast as the fastest: whoever asks for too little time gains nothing by an empty
/// picture that saves a few milliseconds.
fn best(target: Target, tried: &[Tried]) -> (&Tried, bool) {
    let by_error = |a: &&Tried, b: &&Tried| a.error.total_cmp(&b.error);
    let by_time = |a: &&Tried, b: &&Tried| a.milliseconds.total_cmp(&b.milliseconds);
    let keeping = tried.iter().filter(|tried| tried.keeps(target));
    let (kept, nearest) = match target {
        Target::Milliseconds(_) => {
            let fastest = tried.iter().map(|tried| tried.milliseconds).fold(f64::INFINITY, f64::min);
            let as_fast = tried.iter().filter(|tried| tried.milliseconds <= fastest * DISTURBED);
            (keeping.min_by(by_error), as_fast.min_by(by_error))
        }
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
            let some: Vec<Tried> = some.iter().map(|drawn| Tried::of(target, drawn)).collect();
            let (best, reached) = best(target, &some);
            (best.milliseconds, reached)
        };
        let chosen = |target| of_some(target, &all);
        assert_eq!(chosen(Target::Milliseconds(60.0)), (50.0, true));
        let alike = [tried(12.0, 5.0, 9.0), tried(11.0, 50.0, 9.0), tried(15.0, 1.0, 1.0)];
        assert_eq!(of_some(Target::Milliseconds(10.0), &alike), (12.0, false));
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
        let near = [candidate(42.0, 4.0), candidate(50.0, 2.9)];
        assert_eq!(promising(Target::Milliseconds(40.0), 1.0, &near).unwrap().milliseconds, 42.0, "it may keep to it");
        let missed = [Candidate { is_drawn: true, ..candidate(42.0, 4.0) }, candidate(50.0, 2.9)];
        assert_eq!(promising(Target::Milliseconds(40.0), 1.0, &missed).unwrap().milliseconds, 50.0);
        assert_eq!((promised(Target::DeltaE(6.0)), promised(Target::DeltaE(0.1))), (10.0, 20.0));
        let careful = promising(Target::DeltaE(6.0), 0.8, &candidates).unwrap();
        assert_eq!(careful.milliseconds, 20.0, "after misses a prediction needs a margin");
    }

    #[test]
    fn a_time_that_was_missed_is_measured_again_and_all_others_are_expected_to_be_shorter_if_it_was_disturbed() {
        let target = Target::Milliseconds(60.0);
        let all = [tried(150.0, 0.0, 0.0), tried(120.0, 1.0, 3.0), tried(58.0, 8.0, 0.5)];
        let mut tried = all.map(|drawn| Tried::of(target, &drawn)).to_vec();
        assert_eq!(doubtful(Target::DeltaE(1.0), &tried, |_| None), None);
        assert_eq!(doubtful(target, &tried, |_| Some(59.0)), Some(0), "expected to keep to it");
        assert_eq!(doubtful(target, &tried, |_| Some(61.0)), Some(2), "the best");
        look_again(&mut tried, 2, 29.0, &mut CostModel::default());
        let times: Vec<f64> = tried.iter().map(|tried| tried.milliseconds).collect();
        assert_eq!((times, doubtful(target, &tried, |_| None)), (vec![75.0, 60.0, 29.0], Some(1)));
        look_again(&mut tried, 1, 61.0, &mut CostModel::default());
        assert_eq!((tried[1].milliseconds, doubtful(target, &tried, |_| None)), (61.0, None));
    }
}
