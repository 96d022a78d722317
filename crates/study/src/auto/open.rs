//! The changes that are worth a trial: those that may be part of the choice.

use rayon::prelude::*;

use super::changes::{Change, Combination, combinations, least_error, squares_of};
use super::search::{SLOW, slow};
use super::stills::small_size;
use super::{Explored, Judged, MARGIN, Tried, promising};
use crate::still::Target;

impl Explored {
    /// The changes that were not tried yet and may be part of the choice: those of which nothing is known, and those of a
    /// combination that may be better than the best one that was `found`, or is expected, if its changes add less to the
    /// errors than they did in views before ([`least_error`]), with what lies between.
    pub(super) fn open(&self, target: Target, judged: &Judged, found: Option<&Tried>) -> Vec<Change> {
        let costs = self.local.costs();
        let is_slow =
            slow(&costs, (&self.base, &self.work), self.stills.whole.reflection.method, small_size(self.size));
        let is_of_target = |change: &Change| !matches!(target, Target::Pixels(_)) || !change.is_of_light();
        let open = judged.open.iter().filter(|(change, _)| is_of_target(change) && !is_slow(change));
        let tried = judged.changes.iter().filter(|change| is_of_target(change)).cloned();
        let (mut wanted, mut known, mut all): (Vec<Change>, Vec<&Change>, Vec<Change>) =
            (Vec::new(), Vec::new(), tried.collect());
        for (change, squares) in open {
            let settings = change.of(&self.base);
            match (squares, self.expected_time(&costs, &settings)) {
                // The own method is one of the methods, and needs no picture.
                _ if settings == self.base => {
                    all.push(Change { milliseconds: self.milliseconds, ..change.clone() });
                    wanted.push(change.clone());
                }
                (Some(squares), Some(milliseconds)) => {
                    all.push(Change { squares: *squares, milliseconds, ..change.clone() });
                    known.push(change);
                }
                _ => wanted.push(change.clone()),
            }
        }
        if known.is_empty() {
            return wanted;
        }
        all.sort_by_key(|change| self.changes.iter().position(|own| own.set == change.set));
        let is_open: Vec<bool> = all.iter().map(|change| known.iter().any(|known| known.set == change.set)).collect();
        let combinations = combinations(&self.base, &all);
        let base = squares_of(&judged.drawn[0].error);
        let best = match found {
            Some(found) => (found.milliseconds, found.error),
            None => {
                let expected = |combination: &_| least_error(target, base, (combination, &all), |_| false);
                let expected = self.candidates(&costs, &combinations, &[], expected);
                match promising(target, 1.0, &expected) {
                    Some(best) => (best.milliseconds, best.error),
                    None => return wanted,
                }
            }
        };
        let may_be_better = |combination: &Combination| {
            let milliseconds = self.expected_time(&costs, &combination.settings);
            let error = least_error(target, base, (combination, &all), |index| is_open[index]);
            // Of a method that this view did not draw, the time is known from other scenes alone.
            let is_new = combination.changes.iter().any(|index| is_open[*index] && all[*index].is_of_method());
            let margin = if is_new { 1.0 / SLOW } else { MARGIN };
            milliseconds.is_some_and(|milliseconds| may_be_better(target, (milliseconds * margin, error), best))
        };
        let promising: Vec<&Combination> =
            combinations.par_iter().filter(|combination| may_be_better(combination)).collect();
        let is_promising = |index: usize| promising.iter().any(|combination| combination.changes.contains(&index));
        let is_tried: Vec<bool> = (0..all.len()).map(|index| !is_open[index] || is_promising(index)).collect();
        // A value between two that are tried is tried, too: it costs little, and views differ.
        let is_between = |index: usize| {
            let is_of_key = |other: &usize| is_tried[*other] && all[*other].set[0].0 == all[index].set[0].0;
            let has = |mut others: std::ops::Range<usize>| others.any(|other| is_of_key(&other));
            !all[index].is_of_method() && has(0..index) && has(index..all.len())
        };
        if is_tried.iter().zip(&is_open).any(|(is_tried, is_open)| *is_tried && *is_open) {
            let more = (0..all.len()).filter(|index| is_open[*index] && (is_tried[*index] || is_between(*index)));
            wanted.extend(more.map(|index| all[index].clone()));
        }
        wanted
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
