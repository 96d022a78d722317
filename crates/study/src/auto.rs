//! `auto`: chooses the method, its parameters, the virtual lights and their interleaving, the points and the resolution
//! for a time or for an error.
//!
//! 1. It draws the still picture, against which errors count, and the picture with the settings as they are.
//! 2. It changes one setting at a time and draws a small picture. The cost model learns the times. The error of each
//!    change is known then.
//! 3. Of all combinations it predicts time and error: the time by the cost model, the error by the changes' squares,
//!    which add up where errors are independent, those of mirrors' colours and of the rest's apart: the worse of the two
//!    counts. It draws the most promising combination, learns from it, and goes on until the most promising one is
//!    already drawn.
//! 4. It takes the best of those that were drawn in full, so that nothing is chosen on a prediction alone.
//!
//! No rule names a scene. A method that another one beats in time and error is left out of step 3.

use std::collections::BTreeMap;
use std::time::Instant;

use param::Choice as _;
use render::{FrameStats, PassStage, Renderer};
use scene::{Camera, METHODS, Method, Settings};

use crate::cost::{CostModel, Workload};
use crate::results::{Spread, stage_ms};
use crate::still::{Still, StillError, Target, drawn_size, judging_settings};

const METHOD: &str = "reflection.method";

/// The beginning of the keys of indirect light.
const LIGHT: &str = "gi.";

/// The values that are tried of each parameter besides the one that it has.
const LEVERS: [(&str, &[&str]); 8] = [
    ("view.resolution", &["0.75", "0.5", "0.25"]),
    ("splat.step", &["2", "8"]),
    ("splat.quality", &["nearest"]),
    ("mirror.surface", &["exact"]),
    ("reflection.bounces", &["1"]),
    ("gi.bounces", &["0", "1"]),
    ("gi.vpls", &["1024", "128", "64", "32", "16"]),
    ("gi.interleave", &["1", "2", "8"]),
];

/// The most pixels of the small pictures by which single changes are judged.
const SMALL: f64 = 320.0 * 240.0;

/// The most combinations that are drawn in full.
const MOST_DRAWN: usize = 8;

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
    pub predicted_error: StillError,
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

/// A setting that was drawn.
#[derive(Clone, Debug)]
struct Drawn {
    settings: Settings,
    milliseconds: f64,
    /// The part of it that finds reflections.
    method_milliseconds: f64,
    error: StillError,
}

/// The squares of errors, or parts of them: of the colours of mirrors, of those of the rest, and of pixels.
type Squares = [f64; 3];

/// The places of the squares of mirrors' colours and of pixels.
const OF_MIRRORS: usize = 0;
const OF_PIXELS: usize = 2;

fn squares_of(error: &StillError) -> Squares {
    let [mirrors, rest] = error.means();
    [mirrors, rest, error.pixels].map(|error| error.powi(2))
}

/// A change of one parameter, or of the method with its parameters.
#[derive(Clone, Debug, PartialEq)]
struct Change {
    set: Vec<(&'static str, String)>,
    /// The change's part of the squares of the errors.
    squares: Squares,
    /// The time of the passes that find reflections.
    method_milliseconds: f64,
}

impl Change {
    fn is_of_method(&self) -> bool {
        self.set[0].0 == METHOD
    }

    fn is_of_light(&self) -> bool {
        self.set[0].0.starts_with(LIGHT)
    }
}

/// A combination with what is predicted of it, or known.
struct Candidate {
    settings: Settings,
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
    still: Still,
    /// The still picture, and the picture with the base's settings.
    drawn: [Drawn; 2],
    /// What the base's picture took.
    work: Workload,
    changes: Vec<Change>,
    /// The cost model with more weight on this view.
    local: CostModel,
    seconds: f64,
    frames: usize,
}

impl Explored {
    /// Draws the still picture, and small pictures of each change; those of light only if `light_counts`.
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
        let still_settings = still_of(&base, fixed);
        let mut search = Search { camera, hands, local, frames: 0 };
        let (still, milliseconds) = search.still(&still_settings, size)?;
        let best = Drawn {
            settings: still_settings.clone(),
            milliseconds,
            method_milliseconds: milliseconds,
            error: still.none(),
        };
        let (first, work) = search.drawn(&base, &still, size)?;
        let small = small(size);
        let changes = if small == size {
            search.changes(&base, fixed, &still, (light_counts && work.lights > 0.0, small))?
        } else {
            let (still, _) = search.still(&still_settings, small)?;
            search.changes(&base, fixed, &still, (light_counts && work.lights > 0.0, small))?
        };
        let Search { local, frames, .. } = search;
        Ok(Self {
            settings: settings.clone(),
            base,
            camera: *camera,
            size,
            still,
            drawn: [best, first],
            work,
            changes,
            local,
            seconds: start.elapsed().as_secs_f64(),
            frames,
        })
    }

    /// The milliseconds of a frame with the settings as they were.
    pub fn milliseconds(&self) -> f64 {
        self.drawn[1].milliseconds
    }

    /// Chooses settings for a target.
    ///
    /// # Errors
    /// Those of [`choose`].
    pub fn choose(&self, target: Target, hands: &mut Hands<'_, '_>) -> anyhow::Result<Choice> {
        let start = Instant::now();
        // Light changes no pixel error: it stays as it is.
        let is_of_target = |change: &&Change| !matches!(target, Target::Pixels(_)) || !change.is_of_light();
        let changes: Vec<Change> = self.changes.iter().filter(is_of_target).cloned().collect();
        let (dominated, changes) = without_dominated(changes, target);
        let combinations = combinations(&self.base, &changes);
        let mut drawn = self.drawn.to_vec();
        let mut search = Search { camera: &self.camera, hands, local: self.local.clone(), frames: self.frames };
        let mut scale = 1.0_f64;
        while drawn.len() < MOST_DRAWN + self.drawn.len() {
            let costs = search.local.costs();
            let candidate = |(settings, squares): &(Settings, Squares)| {
                let known = drawn.iter().find(|drawn| drawn.settings == *settings);
                let milliseconds = match known {
                    Some(drawn) => drawn.milliseconds,
                    None => costs.predict(&self.work.with(&self.base, settings), settings)?,
                };
                let predicted = || predicted_error(target, &self.drawn[1].error, *squares) * scale;
                let error = known.map_or_else(predicted, |drawn| target.error(&drawn.error));
                Some(Candidate { settings: settings.clone(), milliseconds, error, is_drawn: known.is_some() })
            };
            let candidates: Vec<Candidate> = combinations.iter().filter_map(candidate).collect();
            let misses = |drawn: &&Drawn| !target.is_kept(drawn.milliseconds, &drawn.error);
            let in_a_row = drawn[self.drawn.len()..].iter().rev().take_while(misses).count();
            let margin = MARGIN.powi(in_a_row as i32);
            let Some(next) = promising(target, margin, &candidates).filter(|next| !next.is_drawn) else { break };
            let (found, _) = search.drawn(&next.settings, &self.still, self.size)?;
            let measured = target.error(&found.error);
            // Where errors turn out larger than their squares said, the other predictions are too small as well.
            if next.error > 0.0 && measured > 0.0 {
                scale = (scale * measured / next.error).clamp(0.25, 4.0);
            }
            drawn.push(found);
        }
        let (best, reached) = best(target, &drawn);
        let Drawn { settings: chosen, milliseconds, error, .. } = best.clone();
        let (frames, seconds) = (search.frames, self.seconds + start.elapsed().as_secs_f64());
        let found = format!("{milliseconds:.1} ms, {:.3} {}", target.error(&error), target.error_unit());
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
        let count = combinations.len();
        let why =
            format!("{reason} ({error}); chosen from {count} settings by {frames} frames in {seconds:.1} s{left_out}");
        let set = differing(&self.settings, &chosen);
        Ok(Choice { set, predicted_ms: milliseconds, predicted_error: error, why, seconds, frames })
    }
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

struct Search<'a, 'b, 'c> {
    camera: &'a Camera,
    hands: &'a mut Hands<'b, 'c>,
    /// The cost model with more weight on this view.
    local: CostModel,
    frames: usize,
}

impl Search<'_, '_, '_> {
    /// Draws the still picture. Returns the milliseconds, too.
    fn still(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(Still, f64)> {
        let milliseconds = self.timed(settings, size)?.1;
        Ok((Still::read(self.hands.renderer, self.camera, settings, size)?, milliseconds))
    }

    /// Draws a frame of a picture of `size`, and again if shaders were compiled for it. Returns the milliseconds.
    fn timed(&mut self, settings: &Settings, size: [u32; 2]) -> anyhow::Result<(FrameStats, f64)> {
        /// Frames are drawn until they took so many milliseconds, at least one and at most so many.
        const ENOUGH: f64 = 400.0;
        const MOST: usize = 5;
        let size = drawn_size(size, settings);
        let Hands { renderer, draw, model } = &mut *self.hands;
        let mut times: Vec<f64> = Vec::new();
        loop {
            let stats = draw(renderer, settings, size)?;
            self.frames += 1;
            if stats.has_compiled {
                continue;
            }
            model.learn(&stats, settings, size);
            self.local.learn(&stats, settings, size);
            times.push(stats.frame_milliseconds);
            if times.len() >= MOST || times.iter().sum::<f64>() > ENOUGH {
                let median = Spread::of(times).map_or(0.0, |spread| spread.median);
                return Ok((stats, median));
            }
        }
    }

    /// Draws a setting in full, with its error.
    fn drawn(&mut self, settings: &Settings, still: &Still, size: [u32; 2]) -> anyhow::Result<(Drawn, Workload)> {
        let (stats, milliseconds) = self.timed(settings, size)?;
        let drawn = drawn_size(size, settings);
        let error = still.error(self.hands.renderer, self.camera, settings, drawn)?;
        let work = Workload::of(&stats, settings, drawn);
        let method_milliseconds = stage_ms(&stats.passes, PassStage::Method);
        Ok((Drawn { settings: settings.clone(), milliseconds, method_milliseconds, error }, work))
    }

    /// Draws a small picture for each change of the settings.
    fn changes(
        &mut self,
        base_settings: &Settings,
        fixed: &[String],
        still: &Still,
        (is_lit, size): (bool, [u32; 2]),
    ) -> anyhow::Result<Vec<Change>> {
        let is_free = |key: &str| !fixed.iter().any(|fixed| fixed == key);
        let mut sets: Vec<Vec<(&'static str, String)>> = Vec::new();
        if still.has_mirrors() && is_free(METHOD) {
            for row in METHODS.iter().filter(|row| row.method != Method::Auto) {
                let alone = vec![(METHOD, row.name.to_owned())];
                let own = row.variants.iter().filter(|(key, _)| is_free(key));
                let with = own.map(|(key, value)| [alone.clone(), vec![(*key, (*value).to_owned())]].concat());
                sets.extend(std::iter::once(alone.clone()).chain(with));
            }
        }
        for (key, values) in LEVERS.iter().filter(|(key, _)| is_free(key) && (is_lit || !key.starts_with(LIGHT))) {
            sets.extend(values.iter().map(|value| vec![(*key, (*value).to_owned())]));
        }
        let (base, _) = self.drawn(base_settings, still, size)?;
        let mut changes = Vec::new();
        for set in sets {
            let mut settings = base_settings.clone();
            set.iter().try_for_each(|(key, value)| settings.set_text(key, value))?;
            let is_more = settings.reflection.bounces > base_settings.reflection.bounces
                || settings.gi.bounces > base_settings.gi.bounces;
            let is_change = settings != *base_settings && !is_more;
            let is_method = set[0].0 == METHOD;
            if !is_change && !is_method {
                continue;
            }
            let drawn = match is_change.then(|| self.drawn(&settings, still, size)) {
                Some(Ok((drawn, _))) => drawn,
                // A method that cannot show the scene's glossy mirrors, or not beside the own methods of mirrors, is no
                // choice.
                Some(Err(error)) if is_no_choice(&error) => continue,
                Some(Err(error)) => return Err(error),
                None => base.clone(),
            };
            let (own, of_base) = (squares_of(&drawn.error), squares_of(&base.error));
            let squares = std::array::from_fn(|part| own[part] - of_base[part]);
            changes.push(Change { set, squares, method_milliseconds: drawn.method_milliseconds });
        }
        Ok(changes)
    }
}

/// Whether a picture was refused because of its method.
fn is_no_choice(error: &anyhow::Error) -> bool {
    use render::Error::{OneMethodOnly, PerfectMirrorsOnly};
    matches!(error.downcast_ref(), Some(PerfectMirrorsOnly { .. } | OneMethodOnly { .. }))
}

/// The parameters of `to` that differ from `from`, and its method.
fn differing(from: &Settings, to: &Settings) -> BTreeMap<String, String> {
    let mut set = BTreeMap::from([(METHOD.to_owned(), to.reflection.method.name().to_owned())]);
    for (before, after) in from.groups().into_iter().zip(to.groups()) {
        let group = after.group();
        let values = group.fields.iter().zip(before.values()).zip(after.values());
        for ((field, _), after) in values.filter(|((_, before), after)| before != after) {
            set.insert(format!("{}.{}", group.name, field.name), field.format(&after));
        }
    }
    set
}

/// Takes the methods out that another one beats in time and error. Returns their names and the other changes.
fn without_dominated(changes: Vec<Change>, target: Target) -> (Vec<String>, Vec<Change>) {
    // A method changes nothing but mirrors.
    let part = if matches!(target, Target::Pixels(_)) { OF_PIXELS } else { OF_MIRRORS };
    let square = |change: &Change| change.squares[part];
    let methods: Vec<Change> = changes.iter().filter(|change| change.is_of_method()).cloned().collect();
    let is_dominated = |change: &Change| {
        let beats = |other: &&Change| {
            let (own, others) = (change.method_milliseconds, other.method_milliseconds);
            let better = square(change) - square(other);
            // Times of equal work differ by some hundredths.
            own > 1.05 * others && better >= 0.0 || own >= others && better > 0.0
        };
        change.is_of_method() && methods.iter().find(beats).is_some()
    };
    let (dominated, kept): (Vec<Change>, Vec<Change>) = changes.into_iter().partition(is_dominated);
    let of_kept = |name: &str| kept.iter().any(|change| change.set[0].1 == name);
    let mut names: Vec<String> = dominated.iter().map(|change| change.set[0].1.clone()).collect();
    names.dedup();
    names.retain(|name| !of_kept(name));
    (names, kept)
}

/// All combinations of changes with the sums of their squares, that without any change first. Of each parameter a
/// combination has at most one change.
fn combinations(base: &Settings, changes: &[Change]) -> Vec<(Settings, Squares)> {
    let mut keys: Vec<&str> = changes.iter().map(|change| change.set[0].0).collect();
    keys.dedup();
    let mut all = vec![(base.clone(), Squares::default())];
    for key in keys {
        let of_key: Vec<&Change> = changes.iter().filter(|change| change.set[0].0 == key).collect();
        let is_method = key == METHOD;
        let mut next = Vec::new();
        for (settings, squares) in all {
            // The own method is among the changes, unless another one beats it.
            if !is_method {
                next.push((settings.clone(), squares));
            }
            for change in &of_key {
                let mut changed = settings.clone();
                // The same values were set before the change was drawn.
                if change.set.iter().try_for_each(|(key, value)| changed.set_text(key, value)).is_ok() {
                    // Without light between surfaces the number of its lights changes nothing.
                    if changed.gi.bounces == 0 && changed.gi.vpls != base.gi.vpls {
                        continue;
                    }
                    let sum = std::array::from_fn(|part| squares[part] + change.squares[part]);
                    next.push((changed, sum));
                }
            }
        }
        all = next;
    }
    all
}

/// The error of a combination, from that without any change: of colours the worse of mirrors and of the rest.
fn predicted_error(target: Target, base: &StillError, squares: Squares) -> f64 {
    let base = squares_of(base);
    let [mirrors, rest, pixels] = std::array::from_fn(|part| (base[part] + squares[part]).max(0.0).sqrt());
    match target {
        Target::Pixels(_) => pixels,
        Target::Milliseconds(_) | Target::DeltaE(_) => f64::max(mirrors, rest),
    }
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

/// The best of what was drawn, and whether it keeps to the target.
fn best(target: Target, drawn: &[Drawn]) -> (&Drawn, bool) {
    let error = |drawn: &Drawn| target.error(&drawn.error);
    let by_error = |a: &&Drawn, b: &&Drawn| error(a).total_cmp(&error(b));
    let by_time = |a: &&Drawn, b: &&Drawn| a.milliseconds.total_cmp(&b.milliseconds);
    let mut keeping = drawn.iter().filter(|drawn| target.is_kept(drawn.milliseconds, &drawn.error)).collect::<Vec<_>>();
    let mut all: Vec<&Drawn> = drawn.iter().collect();
    match target {
        Target::Milliseconds(_) => {
            keeping.sort_by(by_error);
            all.sort_by(by_time);
        }
        Target::Pixels(_) | Target::DeltaE(_) => {
            keeping.sort_by(by_time);
            all.sort_by(by_error);
        }
    }
    // There is always one: the still picture is drawn first.
    keeping.first().map_or((all[0], false), |drawn| (drawn, true))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::still::ColorError;

    const MAP: &str = METHODS[2].name;
    const SSCR: &str = METHODS[4].name;
    const BEAMS: &str = METHODS[5].name;
    const TRACE: &str = METHODS[6].name;

    fn change(set: &[(&'static str, &str)], squares: Squares, method_milliseconds: f64) -> Change {
        let set = set.iter().map(|(key, value)| (*key, (*value).to_owned())).collect();
        Change { set, squares, method_milliseconds }
    }

    /// An error of mirrors and of the rest.
    fn error(mirrors: f64, rest: f64, pixels: f64) -> StillError {
        let [mirrors, rest] = [mirrors, rest].map(|mean| Some(ColorError { mean, p95: mean }));
        StillError { delta_e: 0.0, mirrors, rest, pixels }
    }

    fn drawn(milliseconds: f64, delta_e: f64, pixels: f64) -> Drawn {
        let error = error(delta_e, 0.0, pixels);
        Drawn { settings: Settings::default(), milliseconds, method_milliseconds: 0.0, error }
    }

    #[test]
    fn a_method_that_another_beats_in_time_and_error_is_left_out() {
        let method = |name: &str, delta_e: f64, pixels: f64, time: f64| {
            change(&[(METHOD, name)], [delta_e * delta_e, 0.0, pixels * pixels], time)
        };
        let all = vec![
            method("none", 9.0, 1e4, 0.0),
            method(MAP, 3.0, 9.0, 20.0),
            change(&[(METHOD, MAP), ("environment_map.size", "64")], [10.0, 0.0, 81.0], 5.0),
            method(SSCR, 4.0, 1.0, 90.0),
            method(BEAMS, 0.0, 0.0, 30.0),
            method(TRACE, 0.0, 0.0, 40.0),
            change(&[("gi.vpls", "64")], [0.0, 1.0, 0.0], 30.0),
        ];
        let (names, kept) = without_dominated(all, Target::DeltaE(1.0));
        assert_eq!(names, [SSCR, TRACE]);
        let kept: Vec<&str> = kept.iter().map(|change| change.set.last().unwrap().1.as_str()).collect();
        assert_eq!(kept, ["none", MAP, "64", BEAMS, "64"]);
        // Equal in all that counts: both stay, whatever the clock says.
        let equal = vec![method(BEAMS, 0.0, 0.0, 30.0), method(TRACE, 0.0, 0.0, 30.5)];
        assert_eq!(without_dominated(equal, Target::Pixels(1.0)).0, [""; 0]);
    }

    #[test]
    fn combinations_have_at_most_one_change_of_each_parameter_and_the_sum_of_their_squares() {
        let mut base = Settings::default();
        base.reflection.method = Method::SscrHierarchical;
        let changes = [
            change(&[(METHOD, BEAMS)], [0.0; 3], 0.0),
            change(&[(METHOD, MAP), ("environment_map.size", "64")], [1.0, 0.0, 4.0], 0.0),
            change(&[("gi.bounces", "0")], [9.0, 9.0, 0.0], 0.0),
            change(&[("gi.vpls", "64")], [0.5, 0.5, 0.0], 0.0),
            change(&[("gi.vpls", "16")], [2.0, 7.0, 0.0], 0.0),
        ];
        let all = combinations(&base, &changes);
        // Two methods, three numbers of lights, and no light.
        assert_eq!(all.len(), 2 * (3 + 1));
        assert_eq!(all[0], (base.clone(), [0.0; 3]));
        let mut mapped = base.clone();
        for (key, value) in [(METHOD, MAP), ("environment_map.size", "64"), ("gi.vpls", "16")] {
            mapped.set_text(key, value).unwrap();
        }
        let found = all.iter().find(|(settings, _)| *settings == mapped).unwrap();
        assert_eq!(found.1, [3.0, 7.0, 4.0]);
        let of_base = error(1.0, 3.0, 0.0);
        assert_eq!(predicted_error(Target::Milliseconds(9.0), &of_base, found.1), 4.0, "the rest is worse");
        assert_eq!(predicted_error(Target::DeltaE(9.0), &of_base, [24.0, 7.0, 4.0]), 5.0, "the mirrors are worse");
        assert_eq!(predicted_error(Target::Pixels(9.0), &of_base, found.1), 2.0);
        // A change that makes it better than perfect is not trusted.
        assert_eq!(predicted_error(Target::DeltaE(9.0), &of_base, [-4.0, -10.0, 0.0]), 0.0);
        assert_eq!(
            differing(&Settings::default(), &mapped).into_iter().collect::<Vec<_>>(),
            [
                ("environment_map.size".to_owned(), "64".to_owned()),
                ("gi.vpls".to_owned(), "16".to_owned()),
                (METHOD.to_owned(), MAP.to_owned()),
            ]
        );
    }

    #[test]
    fn the_best_keeps_to_the_target_or_comes_nearest() {
        let all = [drawn(100.0, 0.0, 0.0), drawn(50.0, 1.0, 3.0), drawn(20.0, 2.0, 0.5), drawn(10.0, 8.0, 9.0)];
        let chosen = |target| {
            let (best, reached) = best(target, &all);
            (best.milliseconds, reached)
        };
        assert_eq!(chosen(Target::Milliseconds(60.0)), (50.0, true));
        assert_eq!(chosen(Target::Milliseconds(200.0)), (100.0, true));
        assert_eq!(chosen(Target::Milliseconds(5.0)), (10.0, false));
        assert_eq!(chosen(Target::DeltaE(2.5)), (20.0, true));
        assert_eq!(chosen(Target::Pixels(1.0)), (20.0, true));
        assert!(!best(Target::DeltaE(0.5), &all[1..]).1);
        assert_eq!(best(Target::DeltaE(0.5), &all[1..]).0.milliseconds, 50.0);
        let candidate =
            |milliseconds, error| Candidate { settings: Settings::default(), milliseconds, error, is_drawn: false };
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
        let fixed = ["gi.vpls".to_owned(), METHOD.to_owned()];
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
