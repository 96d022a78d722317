//! Whether `auto` keeps to its targets, and how much better the best of the other settings of a plan is.
//!
//! A share of the time of the settings as they are is that of their median in the same rounds: a machine that other work
//! slows down does so for both. Targets in pixels leave the light alone, so only settings with the same light count.
//! Errors of colours are the worse of mirrors and of the rest. In a table from before these were measured apart they are
//! the means of all pixels, by which `auto` chose then.

use std::fmt::Write as _;

use param::Choice as _;
use scene::{IndirectBy, Method, Settings};

use crate::plan::{PlannedTarget, TARGET};
use crate::results::{FRAME_MS, Row, STILL_DELTA_E, STILL_PIXELS, STILL_WORSE_DELTA_E, Spread, TARGET_MS};
use crate::still::Target;

/// A time is kept to if a frame takes at most so much more.
const TIME_TOLERANCE: f64 = 1.15;
/// The error for a time is good if it is at most so many times that of the best setting that is as fast.
const ERROR_FACTOR: f64 = 1.25;
/// The time for an error is good if it is at most so many times that of the fastest setting that is as accurate.
const TIME_FACTOR: f64 = 1.3;

/// How `auto` did for one target in one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged<'a> {
    pub row: &'a Row,
    /// The time in milliseconds or the error that was to be kept to.
    pub target: f64,
    pub is_time: bool,
    pub milliseconds: f64,
    /// The error that counts for the target.
    pub error: f64,
    pub is_kept: bool,
    /// The error of the best setting for a time, the time of the best for an error; `None` if no setting keeps to it.
    pub best: Option<f64>,
}

impl Judged<'_> {
    /// How many times the best setting's error or time is that of `auto`.
    pub fn ratio(&self) -> Option<f64> {
        let own = if self.is_time { self.error } else { self.milliseconds };
        self.best.map(|best| if own <= best { 1.0 } else { own / best })
    }

    /// Whether `auto` did well: it keeps to the target, and no setting is much better. Where no setting keeps to the
    /// target, `auto` need not either.
    pub fn is_good(&self) -> bool {
        let most = if self.is_time { ERROR_FACTOR } else { TIME_FACTOR };
        self.ratio().is_none_or(|ratio| self.is_kept && ratio <= most)
    }
}

/// Judges all rows with targets.
pub fn judged(rows: &[Row]) -> Vec<Judged<'_>> {
    let is_apart = rows.iter().any(|row| row.value(STILL_WORSE_DELTA_E).is_some());
    let colors = if is_apart { STILL_WORSE_DELTA_E } else { STILL_DELTA_E };
    rows.iter().filter_map(|row| judge(row, rows, colors)).collect()
}

/// Judges a row; `colors` is the figure of colours that counts.
fn judge<'a>(row: &'a Row, rows: &'a [Row], colors: &str) -> Option<Judged<'a>> {
    let planned = row.case.target.filter(|_| row.error.is_none())?;
    let (figure, target) = match planned {
        PlannedTarget::Fixed(Target::Pixels(error)) => (STILL_PIXELS, error),
        PlannedTarget::Fixed(Target::DeltaE(error)) => (colors, error),
        PlannedTarget::Fixed(Target::Milliseconds(_)) | PlannedTarget::Share(_) => (colors, row.value(TARGET_MS)?),
    };
    let own = settings_of(row);
    let same_light = matches!(planned, PlannedTarget::Fixed(Target::Pixels(_)));
    let is_time = !matches!(planned, PlannedTarget::Fixed(Target::Pixels(_) | Target::DeltaE(_)));
    let values = |row: &Row| Some((row.value(FRAME_MS)?, row.value(figure)?));
    let is_other = |other: &&Row| {
        let is_same_view = other.case.scene == row.case.scene && other.case.size == row.case.size;
        let has_light = !same_light || settings_of(other).gi == own.gi;
        is_same_view && other.case.target.is_none() && other.error.is_none() && has_light
    };
    let target = match planned {
        PlannedTarget::Share(share) => {
            // Of light by rays, the share is that of the time with virtual lights in their place.
            let is_lit_so = |other: &&Row| settings_of(other).gi.by == IndirectBy::Lights;
            let mut others = rows.iter().filter(is_other).filter(is_lit_so);
            let unchanged = others.find(|other| is_unchanged(other) && other.case.set == row.case.set);
            unchanged.and_then(|other| other.value(FRAME_MS)).map_or(target, |time| time * share)
        }
        PlannedTarget::Fixed(_) => target,
    };
    let others = rows.iter().filter(is_other).filter_map(values);
    let best = if is_time {
        others.filter(|(time, _)| *time <= target).map(|(_, error)| error).reduce(f64::min)
    } else {
        others.filter(|(_, error)| *error <= target).map(|(time, _)| time).reduce(f64::min)
    };
    let (milliseconds, error) = values(row)?;
    let is_kept = if is_time { milliseconds <= target * TIME_TOLERANCE } else { error <= target };
    Some(Judged { row, target, is_time, milliseconds, error, is_kept, best })
}

/// The settings of a row, as far as they differ from the defaults.
pub fn settings_of(row: &Row) -> Settings {
    let mut settings = Settings::default();
    let set = row.set.split(' ').filter_map(|pair| pair.split_once('='));
    let swept = row.case.swept.iter().map(|(key, value)| (key.as_str(), value.as_str()));
    for (key, value) in set.chain(swept.filter(|(key, _)| key.contains('.'))) {
        // A text with a space in it is cut off in the table; it changes neither time nor light.
        let _ = settings.set_text(key, value);
    }
    settings
}

/// Whether a row has the settings as they are: the method that `auto` stands for, with the defaults of all that is swept.
fn is_unchanged(row: &Row) -> bool {
    let mut settings = Settings::default();
    let mut swept = row.case.swept.iter().filter(|(key, _)| key.contains('.'));
    let is_set = swept.all(|(key, value)| settings.set_text(key, value).is_ok());
    let is_auto = [Method::Auto, Method::Auto.chosen()].iter().any(|method| row.case.method == method.name());
    is_set && is_auto && settings == Settings::default()
}

/// A time is used well within this share of it, more or less.
const NEAR_TIME: f64 = 0.05;
/// An error is as good as that of an oracle if it is at most so many times that.
const ORACLE_FACTOR: f64 = 1.15;

/// A table of the times that `auto` was to keep to, beside an oracle that knows all other settings of the plan: the share
/// of the time that is used, whether it is kept to within 5 %, the errors of both, their ratio, and whether that is at most
/// 1.15. The last row has the median of the share, and how many times are kept and how many are that good.
pub fn oracle_table(judged: &[Judged<'_>]) -> String {
    let mut table = "scene,target,target_ms,frame_ms,used,kept,error,oracle_error,ratio,good\n".to_owned();
    let (mut shares, mut kept, mut good) = (Vec::new(), 0, 0);
    for judged in judged.iter().filter(|judged| judged.is_time) {
        // What no other setting reaches cannot be asked for.
        let Some(best) = judged.best else { continue };
        let Judged { row, target, milliseconds, error, .. } = judged;
        let (used, ratio) = (milliseconds / target, if *error <= best { 1.0 } else { error / best });
        let is_kept = used <= 1.0 + NEAR_TIME;
        shares.push(used);
        let is_good = ratio <= ORACLE_FACTOR;
        (kept, good) = (kept + usize::from(is_kept), good + usize::from(is_good));
        let asked = row.case.swept.iter().find(|(key, _)| key == TARGET).map_or("", |(_, value)| value);
        let (scene, kept, good) = (&row.case.scene, u8::from(is_kept), u8::from(is_good));
        let _ = writeln!(
            table,
            "{scene},{asked},{target:.1},{milliseconds:.1},{used:.3},{kept},{error:.3},{best:.3},{ratio:.3},{good}"
        );
    }
    let used = Spread::of(shares).map_or(f64::NAN, |spread| spread.median);
    let _ = writeln!(table, "all,all,,,{used:.3},{kept},,,,{good}");
    table
}

/// A line for people: how many of the targets that a setting keeps to `auto` keeps to, and how many it does well.
pub fn summary(judged: &[Judged<'_>]) -> String {
    let of = |is_time: bool| {
        let reachable = || judged.iter().filter(|judged| judged.is_time == is_time && judged.best.is_some());
        let kept = reachable().filter(|judged| judged.is_kept).count();
        let good = reachable().filter(|judged| judged.is_good()).count();
        [reachable().count(), kept, good]
    };
    let ([times, kept_times, good_times], [errors, kept_errors, good_errors]) = (of(true), of(false));
    let unreachable = judged.len() - times - errors;
    format!(
        "Times: {kept_times} of {times} are kept to within 15 %, {good_times} of them with an error of at most {ERROR_FACTOR} times \
         the best setting's. Errors: {kept_errors} of {errors} are kept to, {good_errors} of them in at most {TIME_FACTOR} times the \
         best setting's time. No other setting keeps to the remaining {unreachable} targets, which judge nothing."
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::results::{self, Run};

    #[test]
    fn targets_are_judged_by_the_best_of_the_other_settings() {
        let plan = Plan::parse(
            "test",
            "title = \"x\"\nstill = true\ntruths = []\n[[group]]\nname = \"grid\"\nscenes = [\"five-mirrors/none\"]\n\
             sweep = { \"gi.vpls\" = [16, 64, 256] }\n[[group]]\nname = \"targets\"\nscenes = [\"five-mirrors/none\"]\n\
             sweep = { target = [\"0.5x\", \"20ms\", \"2dE\", \"1px\", \"0.1dE\"] }",
        )
        .unwrap();
        let run = |case: usize, milliseconds: f64, delta_e: f64, target: Option<f64>| {
            let figures = [(STILL_DELTA_E, Some(delta_e)), (STILL_PIXELS, Some(0.5)), (TARGET_MS, target)];
            let figures = figures.into_iter().filter_map(|(name, value)| Some((name.to_owned(), value?))).collect();
            let judged = Run { case, figures, ..Run::default() };
            [judged, Run { case, round: 1, frame_ms: Some(milliseconds), ..Run::default() }]
        };
        let runs: Vec<Run> = [
            run(0, 30.0, 4.0, None),
            run(1, 50.0, 2.0, None),
            run(2, 100.0, 1.0, None),
            // The time is kept to, which is half of the time of 256 lights in these rounds; but one setting in it is better.
            run(3, 55.0, 3.0, Some(10.0)),
            run(4, 25.0, 9.0, Some(20.0)),
            run(5, 40.0, 1.9, None),
            run(6, 60.0, 9.0, None),
            run(7, 90.0, 0.5, None),
        ]
        .concat();
        let rows = results::rows(&plan, &plan.cases(), &runs);
        let judged = judged(&rows);
        let told: Vec<_> = judged.iter().map(|judged| (judged.is_kept, judged.ratio(), judged.is_good())).collect();
        assert_eq!(
            told,
            [
                (true, Some(1.5), false),
                (false, None, true),
                (true, Some(1.0), true),
                (true, Some(1.0), true),
                (false, None, true),
            ]
        );
        assert_eq!(
            summary(&judged),
            "Times: 1 of 1 are kept to within 15 %, 0 of them with an error of at most 1.25 times the best setting's. \
             Errors: 2 of 2 are kept to, 2 of them in at most 1.3 times the best setting's time. No other setting keeps to the \
             remaining 2 targets, which judge nothing."
        );
        // Where mirrors and the rest are judged apart, the worse of the two counts, and not the mean of all pixels.
        let apart: Vec<Run> = runs
            .iter()
            .cloned()
            .map(|mut run| {
                if let Some(error) = run.figures.get(STILL_DELTA_E).copied() {
                    run.figures.insert(STILL_WORSE_DELTA_E.to_owned(), 2.0 * error);
                }
                run
            })
            .collect();
        let rows = results::rows(&plan, &plan.cases(), &apart);
        let errors: Vec<(f64, bool)> =
            super::judged(&rows).iter().map(|judged| (judged.error, judged.is_kept)).collect();
        assert_eq!(errors[..3], [(6.0, true), (18.0, false), (3.8, false)]);
        // Half of 100 ms is used in full and a tenth more, for one and a half times the error of 64 lights; what no setting
        // reaches is left out.
        assert_eq!(
            oracle_table(&judged),
            "scene,target,target_ms,frame_ms,used,kept,error,oracle_error,ratio,good\n\
             five-mirrors/none,0.5x,50.0,55.0,1.100,0,3.000,2.000,1.500,0\n\
             all,all,,,1.100,0,,,,0\n"
        );
    }
}
