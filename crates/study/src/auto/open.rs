//! The changes that are worth a trial: those that may be part of the choice.

use rayon::prelude::*;

use super::changes::{Change, Combination, combinations, least_error, squares_of};
use super::search::{SLOW, slow};
use super::stills::small_size;
use super::{Explored, Judged, MARGIN, Tried, promising};
use crate::cost::Costs;
use crate::still::Target;

/// The changes for a target of which errors and times are known.
struct Known {
    changes: Vec<Change>,
    /// Whether each was not tried in this view: its errors are those of views before.
    is_open: Vec<bool>,
}

impl Explored {
    /// The changes that were not tried yet and may be part of the choice: those of which nothing is known, and those of a
    /// combination that may be better than the best one that was `found`, or is expected, if its changes add less to the
    /// errors than they did in views before ([`least_error`]), with what lies between.
    pub(super) fn open(&self, target: Target, judged: &Judged, found: Option<&Tried>) -> Vec<Change> {
        let costs = self.local.costs();
        let (mut wanted, known) = self.known_and_not(target, judged, &costs);
        if known.is_open.contains(&true) {
            let is_promising = self.are_promising(target, judged, &known, found, &costs);
            wanted.extend(is_promising.into_iter().flat_map(|is_promising| known.worth_a_trial(&is_promising)));
        }
        wanted
    }

    /// The changes that must be tried because nothing is known of them, and the others: those that were tried, and those of
    /// which errors and times of views before are known.
    fn known_and_not(&self, target: Target, judged: &Judged, costs: &Costs) -> (Vec<Change>, Known) {
        let exact = self.stills.whole.reflection.method;
        let is_slow = slow(costs, (&self.base, &self.work), exact, small_size(self.size));
        let is_of_target = |change: &Change| !matches!(target, Target::Pixels(_)) || !change.is_of_light();
        let tried = judged.changes.iter().filter(|change| is_of_target(change));
        let mut unknown = Vec::new();
        let mut known: Vec<(Change, bool)> = tried.map(|change| (change.clone(), false)).collect();
        for (change, squares) in judged.open.iter().filter(|(change, _)| is_of_target(change) && !is_slow(change)) {
            let settings = change.of(&self.base);
            match (squares, self.expected_time(costs, &settings)) {
                // The own method is one of the methods, and needs no picture.
                _ if settings == self.base => {
                    known.push((Change { milliseconds: self.milliseconds, ..change.clone() }, false));
                    unknown.push(change.clone());
                }
                (Some(squares), Some(milliseconds)) => {
                    known.push((Change { squares: *squares, milliseconds, ..change.clone() }, true));
                }
                _ => unknown.push(change.clone()),
            }
        }
        known.sort_by_key(|(change, _)| self.changes.iter().position(|own| own.set == change.set));
        let (changes, is_open) = known.into_iter().unzip();
        (unknown, Known { changes, is_open })
    }

    /// Whether each change is part of a combination that may be better than the best one that was `found`, or is expected;
    /// `None` where no combination has a time to be expected.
    fn are_promising(
        &self,
        target: Target,
        judged: &Judged,
        Known { changes, is_open }: &Known,
        found: Option<&Tried>,
        costs: &Costs,
    ) -> Option<Vec<bool>> {
        let combinations = combinations(&self.base, changes);
        let of_base = squares_of(&judged.drawn[0].error);
        let to_beat = match found {
            Some(found) => (found.milliseconds, found.error),
            None => {
                let error = |combination: &_| least_error(target, of_base, (combination, changes), |_| false);
                let expected = self.candidates(costs, &combinations, &[], error);
                promising(target, 1.0, &expected).map(|best| (best.milliseconds, best.error))?
            }
        };
        let promises = |combination: &&Combination| {
            let milliseconds = self.expected_time(costs, &combination.settings);
            let error = least_error(target, of_base, (combination, changes), |index| is_open[index]);
            // Of a method that this view did not draw, the time is known from other scenes alone.
            let is_new = combination.changes.iter().any(|index| is_open[*index] && changes[*index].is_of_method());
            let margin = if is_new { 1.0 / SLOW } else { MARGIN };
            milliseconds.is_some_and(|milliseconds| may_be_better(target, (milliseconds * margin, error), to_beat))
        };
        let better: Vec<&Combination> = combinations.par_iter().filter(promises).collect();
        let is_part = |index| better.iter().any(|combination| combination.changes.contains(&index));
        Some((0..changes.len()).map(is_part).collect())
    }
}

impl Known {
    /// The open changes that are promising, and those between two of the same parameter that are promising or were tried: they
    /// cost little, and views differ.
    fn worth_a_trial(&self, is_promising: &[bool]) -> Vec<Change> {
        let Self { changes, is_open } = self;
        let is_tried = |index: usize| !is_open[index] || is_promising[index];
        let is_between = |index: usize| {
            let is_of_key = |other: usize| is_tried(other) && changes[other].set[0].0 == changes[index].set[0].0;
            !changes[index].is_of_method() && (0..index).any(is_of_key) && (index..changes.len()).any(is_of_key)
        };
        let open = || (0..changes.len()).filter(|index| is_open[*index]);
        if !open().any(|index| is_promising[index]) {
            return Vec::new();
        }
        open().filter(|index| is_tried(*index) || is_between(*index)).map(|index| changes[index].clone()).collect()
    }
}

/// Whether a combination of which these are the least time and error may be better than the best one, of which they are
/// known.
fn may_be_better(target: Target, (least, error): (f64, f64), best: (f64, f64)) -> bool {
    let is_kept = target.is_kept(best.0, best.1);
    match target {
        Target::Milliseconds(most) if is_kept => least <= most && error <= best.1,
        Target::Milliseconds(_) => least <= best.0,
        Target::Pixels(most) | Target::DeltaE(most) if is_kept => error <= most && least <= best.0,
        Target::Pixels(_) | Target::DeltaE(_) => error <= best.1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_combination_may_be_better_if_it_keeps_to_the_target_or_comes_nearer() {
        let time = Target::Milliseconds(100.0);
        let better = |own| may_be_better(time, own, (90.0, 1.0));
        assert!(better((80.0, 1.0)) && better((98.0, 0.5)));
        assert!(!better((80.0, 1.1)) && !better((105.0, 0.5)));
        let faster = |own| may_be_better(time, own, (140.0, 1.0));
        assert!(faster((135.0, 9.0)) && !faster((145.0, 0.0)), "nothing keeps to it so far");
        let error = Target::DeltaE(2.0);
        let better = |own| may_be_better(error, own, (90.0, 1.5));
        assert!(better((80.0, 2.0)) && better((89.0, 0.5)) && !better((80.0, 2.1)) && !better((95.0, 0.5)));
        assert!(may_be_better(error, (900.0, 2.9), (90.0, 3.0)) && !may_be_better(error, (9.0, 3.1), (90.0, 3.0)));
    }
}
