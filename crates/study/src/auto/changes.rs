//! Changes of single settings: their errors, which are kept from scene to scene, and what combinations of them are
//! expected to show.

use std::collections::BTreeMap;

use param::{Choice as _, Field, Params, Value};
use scene::{Gi, IndirectBy, METHODS, Method, Settings};
use serde::{Deserialize, Serialize};

use crate::still::{StillError, Target};

pub const METHOD: &str = "reflection.method";

/// The beginning of the keys of indirect light.
const LIGHT: &str = "gi.";

/// The values that are tried of each parameter besides the one that it has. Those that need other shadow maps come last.
const LEVERS: [(&str, &[&str]); 8] = [
    ("view.resolution", &["0.75", "0.5", "0.25"]),
    ("splat.step", &["2", "8"]),
    ("splat.quality", &["nearest"]),
    ("mirror.surface", &["exact"]),
    ("reflection.bounces", &["1"]),
    ("gi.bounces", &["0", "1"]),
    ("gi.interleave", &["1", "2", "8"]),
    ("gi.vpls", &["1024", "128", "64", "32", "16"]),
];

/// What brings light, and the numbers of rays that are tried where the settings have more.
const BY: &str = "gi.by";
const RAYS: &str = "gi.rays_per_pixel";
const FEWER_RAYS: [u32; 3] = [16, 4, 1];

/// What changes little of light by rays: the lights where their paths end.
const OF_LIGHTS: [&str; 2] = ["gi.interleave", "gi.vpls"];

/// What the still picture's settings change besides.
const OF_STILL: [&str; 3] = ["gi.sky_lights", "reflection.least_weight", "reflection.own_methods"];

/// Whether `auto` may change a parameter that nothing fixes.
pub fn may_change(key: &str) -> bool {
    let of_methods = METHODS.iter().flat_map(|row| row.variants).map(|(key, _)| *key);
    let levers = LEVERS.iter().map(|(key, _)| *key);
    of_methods.chain(levers).chain(OF_STILL).chain([METHOD, BY, RAYS]).any(|known| known == key)
}

/// Times of equal work differ by some hundredths.
const NOISE: f64 = 1.05;

/// The errors of views before may be so many times those of this one.
const DOUBT: f64 = 3.0;

/// The squares of errors, or parts of them: of the colours of mirrors, of those of the rest, and of pixels.
pub type Squares = [f64; 3];

/// The places of the squares of mirrors' colours and of pixels.
const OF_MIRRORS: usize = 0;
const OF_PIXELS: usize = 2;

pub fn squares_of(error: &StillError) -> Squares {
    let [mirrors, rest] = error.means();
    [mirrors, rest, error.pixels].map(|error| error.powi(2))
}

/// A change of one parameter, or of the method with its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    pub set: Vec<(&'static str, String)>,
    /// The change's part of the squares of the errors.
    pub squares: Squares,
    /// The milliseconds that a frame with it is expected to take.
    pub milliseconds: f64,
}

impl Change {
    pub fn is_of_method(&self) -> bool {
        self.set[0].0 == METHOD
    }

    pub fn is_of_light(&self) -> bool {
        self.set[0].0.starts_with(LIGHT)
    }

    /// The settings with this change; the same values were set before, when the change was made.
    pub fn of(&self, base: &Settings) -> Settings {
        let mut changed = base.clone();
        let set = self.set.iter().try_for_each(|(key, value)| changed.set_text(key, value));
        debug_assert!(set.is_ok(), "{set:?}");
        changed
    }
}

/// The settings in which single parameters are changed: those of a person, with the method that `auto` stands for, and
/// with virtual lights in the place of rays of light, or with few rays where lights are `fixed`. Many rays take long, so
/// that they are among the changes ([`of_rays`]). Light that does not count stays as it is.
pub fn base_of(settings: &Settings, fixed: &[String], light_counts: bool) -> Settings {
    let mut base = settings.clone();
    base.reflection.method = base.reflection.method.chosen();
    let is_free = |key: &str| light_counts && !fixed.iter().any(|fixed| fixed == key);
    let gi = &mut base.gi;
    match gi.by {
        IndirectBy::Rays if is_free(BY) => gi.by = IndirectBy::Lights,
        IndirectBy::Rays if is_free(RAYS) => gi.rays_per_pixel = gi.rays_per_pixel.min(FEWER_RAYS[1]),
        _ => {}
    }
    base
}

/// The changes of `base` to light by rays, if the `settings` that it was made of have rays: to as many, and to fewer.
fn of_rays(settings: &Settings, base: &Settings, is_free: impl Fn(&str) -> bool) -> Vec<Vec<(&'static str, String)>> {
    if settings.gi.by != IndirectBy::Rays {
        return Vec::new();
    }
    let own = settings.gi.rays_per_pixel;
    let fewer = FEWER_RAYS.into_iter().filter(|number| *number < own && is_free(RAYS));
    let number = |number: u32| (RAYS, number.to_string());
    let by = (BY, settings.gi.by.name().to_owned());
    let all = std::iter::once(own).chain(fewer);
    match base.gi.by {
        IndirectBy::Lights if is_free(RAYS) => all.map(|rays| vec![by.clone(), number(rays)]).collect(),
        IndirectBy::Lights => vec![vec![by]],
        IndirectBy::Rays => all.map(|rays| vec![number(rays)]).collect(),
    }
}

/// The changes that may be tried of `base`, which [`base_of`] made of `settings`; parameters of `fixed` stay as they are.
/// Methods are tried where there are mirrors, and light where light between surfaces is drawn. None has more bounces
/// than `base`, or more rays of light than `settings`.
pub fn changes_of(
    settings: &Settings,
    base: &Settings,
    fixed: &[String],
    has_mirrors: bool,
    is_lit: bool,
) -> Vec<Change> {
    let is_free = |key: &str| !fixed.iter().any(|fixed| fixed == key);
    let mut sets: Vec<Vec<(&'static str, String)>> = Vec::new();
    if has_mirrors && is_free(METHOD) {
        for row in METHODS.iter().filter(|row| row.method != Method::Auto) {
            let alone = vec![(METHOD, row.name.to_owned())];
            let own = row.variants.iter().filter(|(key, _)| is_free(key));
            let with = own.map(|(key, value)| [alone.clone(), vec![(*key, (*value).to_owned())]].concat());
            sets.extend(std::iter::once(alone.clone()).chain(with));
        }
    }
    if is_lit {
        sets.extend(of_rays(settings, base, is_free));
    }
    // Where paths end, the still picture's lights are shared as those of `base`: nothing is more accurate.
    let is_shared = |key: &str| base.gi.by == IndirectBy::Rays && key == "gi.interleave";
    let is_lever = |key: &str| is_free(key) && (is_lit || !key.starts_with(LIGHT)) && !is_shared(key);
    for (key, values) in LEVERS.iter().filter(|(key, _)| is_lever(key)) {
        sets.extend(values.iter().map(|value| vec![(*key, (*value).to_owned())]));
    }
    let change = |set| Change { set, squares: Squares::default(), milliseconds: 0.0 };
    let is_tried = |change: &Change| {
        let settings = change.of(base);
        let is_more = settings.reflection.bounces > base.reflection.bounces || settings.gi.bounces > base.gi.bounces;
        // The own method is one of the methods.
        change.is_of_method() || settings != *base && !is_more
    };
    sets.into_iter().map(change).filter(is_tried).collect()
}

/// The errors of changes in the views before, by what is changed, and from what.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KnownErrors {
    squares: BTreeMap<String, Squares>,
}

/// The weight of one view beside all views before.
const OF_A_VIEW: f64 = 0.5;

/// What a change had in views before counts by this share where it is left out: after some views it is tried again.
const OF_LEFT_OUT: f64 = 0.7;

/// The most changes that are known: those of some dozen values that a person gave the parameters.
const MOST_KNOWN: usize = 2000;

/// The kind of a view and of its still picture: errors of one kind say nothing of another.
#[derive(Clone, Debug)]
pub struct Kind(String);

impl Kind {
    /// `fixed` names the parameters that the still picture keeps of `settings`, of which `base` is made.
    pub fn new(settings: &Settings, base: &Settings, has_mirrors: bool, fixed: &[String]) -> Self {
        let view = if has_mirrors { "mirrors" } else { "no mirrors" };
        let Gi { by, rays_per_pixel, .. } = settings.gi;
        let view = match by {
            IndirectBy::Rays => {
                let few = if base.gi.by == by { base.gi.rays_per_pixel } else { 0 };
                format!("{view} {rays_per_pixel} rays from {few} shared {}", settings.gi.interleave)
            }
            IndirectBy::Lights => view.to_owned(),
        };
        let is_lever = |key: &&String| LEVERS.iter().any(|(lever, _)| lever == key);
        Self(fixed.iter().filter(is_lever).fold(view, |kind, key| format!("{kind} {key}")))
    }
}

impl KnownErrors {
    /// What is changed and from what; for no change, what could be changed and its values.
    fn key(kind: &Kind, base: &Settings, change: Option<&Change>) -> String {
        let changed = |(key, value): &(&str, String)| format!(" {key}={value} from {}", text_of(base, key));
        let own = |(key, _): &(&str, &[&str])| format!(" {key}={}", text_of(base, key));
        let parts: String = match change {
            Some(change) => change.set.iter().map(changed).collect(),
            None => LEVERS.iter().chain([&(METHOD, &[][..])]).map(own).collect(),
        };
        format!("{}:{parts}", kind.0)
    }

    /// The squares that a change adds to those of `base`; the squares of `base` itself for no change.
    pub fn of(&self, kind: &Kind, base: &Settings, change: Option<&Change>) -> Option<Squares> {
        self.squares.get(&Self::key(kind, base, change)).copied()
    }

    /// Learns from a view the squares of the errors of `base`, and of what changes add to them.
    pub fn learn(&mut self, kind: &Kind, base: &Settings, squares: Squares, changes: &[Change]) {
        self.learn_one(Self::key(kind, base, None), squares);
        self.learn_changes(kind, base, changes);
    }

    /// Learns from a view the squares of what changes add to the errors of `base`.
    pub fn learn_changes(&mut self, kind: &Kind, base: &Settings, changes: &[Change]) {
        for change in changes {
            self.learn_one(Self::key(kind, base, Some(change)), change.squares);
        }
    }

    fn learn_one(&mut self, key: String, squares: Squares) {
        if self.squares.len() > MOST_KNOWN {
            self.squares.clear();
        }
        let kept = self.squares.entry(key).or_insert(squares);
        for (kept, square) in kept.iter_mut().zip(squares) {
            *kept += OF_A_VIEW * (square - *kept);
        }
    }

    /// Learns that a view left a change out because of what it had in views before.
    pub fn doubt(&mut self, kind: &Kind, base: &Settings, change: &Change) {
        for square in self.squares.get_mut(&Self::key(kind, base, Some(change))).into_iter().flatten() {
            *square *= OF_LEFT_OUT;
        }
    }

    /// Whether all numbers are finite.
    pub fn are_sound(&self) -> bool {
        self.squares.values().flatten().all(|square| square.is_finite())
    }
}

/// The parameters of `to` that differ from `from`, and its method.
pub fn differing(from: &Settings, to: &Settings) -> BTreeMap<String, String> {
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
pub fn without_dominated(changes: Vec<Change>, target: Target) -> (Vec<String>, Vec<Change>) {
    // A method changes nothing but mirrors.
    let part = if matches!(target, Target::Pixels(_)) { OF_PIXELS } else { OF_MIRRORS };
    let square = |change: &Change| change.squares[part];
    let methods: Vec<Change> = changes.iter().filter(|change| change.is_of_method()).cloned().collect();
    let is_dominated = |change: &Change| {
        let beats = |other: &&Change| {
            let (own, others) = (change.milliseconds, other.milliseconds);
            let better = square(change) - square(other);
            own > NOISE * others && better >= 0.0 || own >= others && better > 0.0
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

/// A combination of changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    pub settings: Settings,
    /// The indices of the changes.
    pub changes: Vec<usize>,
}

impl Combination {
    /// What the changes add to the squares of the errors.
    pub fn squares(&self, changes: &[Change]) -> Squares {
        let sum = |part: usize| self.changes.iter().map(|index| changes[*index].squares[part]).sum();
        std::array::from_fn(sum)
    }
}

/// All combinations of changes, that without any change first. Of each parameter a combination has at most one change.
pub fn combinations(base: &Settings, changes: &[Change]) -> Vec<Combination> {
    let mut keys: Vec<&str> = changes.iter().map(|change| change.set[0].0).collect();
    keys.dedup();
    let mut all = vec![Combination { settings: base.clone(), changes: Vec::new() }];
    for key in keys {
        let is_of_key = |(_, change): &(usize, &Change)| change.set[0].0 == key;
        let mut next = Vec::new();
        for combination in all {
            // The own method is among the changes, unless another one beats it.
            if key != METHOD {
                next.push(combination.clone());
            }
            for (index, change) in changes.iter().enumerate().filter(is_of_key) {
                let settings = change.of(&combination.settings);
                // Without light between surfaces, what brings it changes nothing.
                let brings = |gi: &Gi| (gi.by, gi.rays_per_pixel, gi.vpls);
                let is_lit = settings.gi.bounces > 0 || brings(&settings.gi) == brings(&base.gi);
                let is_by_rays = combination.settings.gi.by != base.gi.by;
                if is_lit && !(is_by_rays && OF_LIGHTS.contains(&key)) {
                    let changes = [&combination.changes[..], &[index]].concat();
                    next.push(Combination { settings, changes });
                }
            }
        }
        all = next;
    }
    all
}

/// Moves the squares of changes so that those of a combination that was measured come out right: `measured` is what its
/// changes add. Half of the factor goes to all changes, for errors of one scene are larger or smaller than those of
/// others together. What remains goes to the changes of the combination, each by its share.
pub fn correct(changes: &mut [Change], combination: &Combination, measured: Squares) {
    for (part, measured) in measured.into_iter().enumerate() {
        let expected = combination.squares(changes)[part];
        if expected > 0.0 && measured > 0.0 {
            let factor = (measured / expected).sqrt().clamp(0.25, 4.0);
            changes.iter_mut().for_each(|change| change.squares[part] *= factor);
        }
        let left = measured - combination.squares(changes)[part];
        let share = |square: f64| square.abs() + 1e-9;
        let all: f64 = combination.changes.iter().map(|index| share(changes[*index].squares[part])).sum();
        for index in &combination.changes {
            let square = &mut changes[*index].squares[part];
            *square += left * share(*square) / all;
        }
    }
}

/// The error of a combination, from the squares without any change: of colours the worse of mirrors and of the rest.
pub fn predicted_error(target: Target, base: Squares, squares: Squares) -> f64 {
    error_of(target, std::array::from_fn(|part| base[part] + squares[part]))
}

/// The least error that a combination may have in this view: changes that are `open` may add the [`DOUBT`]th part of what
/// they added to the errors of views before, and improve it [`DOUBT`] times as much. Of reflections they may have none:
/// their error is that of nearly the worst pixel, of which another view says nothing.
pub fn least_error(
    target: Target,
    base: Squares,
    (combination, changes): (&Combination, &[Change]),
    is_open: impl Fn(usize) -> bool,
) -> f64 {
    let least = |part: usize| {
        let squares = combination.changes.iter().map(|index| (*index, changes[*index].squares[part]));
        let (mut left, mut added) = (base[part], 0.0);
        for (index, square) in squares {
            match (square > 0.0, is_open(index)) {
                (true, true) if part == OF_PIXELS => {}
                (true, true) => added += square / (DOUBT * DOUBT),
                (true, false) => added += square,
                (false, true) => left += square * DOUBT * DOUBT,
                (false, false) => left += square,
            }
        }
        left.max(0.0) + added
    };
    error_of(target, std::array::from_fn(least))
}

/// The error of these squares.
fn error_of(target: Target, squares: Squares) -> f64 {
    let [mirrors, rest, pixels] = squares.map(|square| square.max(0.0).sqrt());
    match target {
        Target::Pixels(_) => pixels,
        Target::Milliseconds(_) | Target::DeltaE(_) => f64::max(mirrors, rest),
    }
}

/// The value of a parameter as text.
fn text_of(settings: &Settings, key: &str) -> String {
    let value = |params: &dyn Params| {
        let group = params.group();
        let is_it = |(field, _): &(&Field, Value)| key.split_once('.') == Some((group.name, field.name));
        let found = group.fields.iter().zip(params.values()).find(is_it);
        found.map(|(field, value)| field.format(&value))
    };
    settings.groups().into_iter().find_map(value).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = METHODS[2].name;
    const SSCR: &str = METHODS[4].name;
    const BEAMS: &str = METHODS[5].name;
    const TRACE: &str = METHODS[6].name;

    fn change(set: &[(&'static str, &str)], squares: Squares, milliseconds: f64) -> Change {
        let set = set.iter().map(|(key, value)| (*key, (*value).to_owned())).collect();
        Change { set, squares, milliseconds }
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
    fn what_a_change_improves_makes_up_for_nothing_that_others_add() {
        let changes = [
            change(&[("mirror.surface", "exact")], [-90.0, 0.0, 0.0], 0.0),
            change(&[(METHOD, MAP)], [36.0, 0.0, 0.0], 0.0),
        ];
        let combination = Combination { settings: Settings::default(), changes: vec![0, 1] };
        let least = |is_open: bool| {
            least_error(Target::DeltaE(1.0), [90.0, 1.0, 0.0], (&combination, &changes), |index| index == 1 && is_open)
        };
        assert_eq!((least(false), least(true)), (6.0, 2.0));
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
        assert_eq!(all[0], Combination { settings: base.clone(), changes: vec![0] });
        let mut mapped = base.clone();
        for (key, value) in [(METHOD, MAP), ("environment_map.size", "64"), ("gi.vpls", "16")] {
            mapped.set_text(key, value).unwrap();
        }
        let found = all.iter().find(|combination| combination.settings == mapped).unwrap();
        let squares = found.squares(&changes);
        assert_eq!(squares, [3.0, 7.0, 4.0]);
        let of_base = [1.0, 9.0, 0.0];
        assert_eq!(predicted_error(Target::Milliseconds(9.0), of_base, squares), 4.0, "the rest is worse");
        assert_eq!(predicted_error(Target::DeltaE(9.0), of_base, [24.0, 7.0, 4.0]), 5.0, "the mirrors are worse");
        assert_eq!(predicted_error(Target::Pixels(9.0), of_base, squares), 2.0);
        // A change that makes it better than perfect is not trusted.
        assert_eq!(predicted_error(Target::DeltaE(9.0), of_base, [-4.0, -10.0, 0.0]), 0.0);
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
    fn lights_take_the_place_of_rays_that_are_free_and_rays_are_among_the_changes() {
        let mut settings = Settings::default();
        (settings.gi.by, settings.gi.rays_per_pixel) = (IndirectBy::Rays, 64);
        let of = |settings: &Settings, fixed: &[&str]| {
            let fixed: Vec<String> = fixed.iter().map(|key| (*key).to_owned()).collect();
            let base = base_of(settings, &fixed, true);
            let mut changes = changes_of(settings, &base, &fixed, false, true);
            changes.retain(|change| change.is_of_light() && change.set[0].0 != "gi.bounces");
            let rays = changes.iter().filter(|change| [BY, RAYS].contains(&change.set[0].0));
            let rays: Vec<String> =
                rays.map(|change| change.set.iter().map(|(_, value)| format!("{value} ")).collect()).collect();
            (base, changes, rays.concat())
        };
        let (base, changes, rays) = of(&settings, &["gi.interleave"]);
        assert_eq!((base.gi.by, rays.as_str()), (IndirectBy::Lights, "rays 64 rays 16 rays 4 rays 1 "));
        // Six numbers of lights, or one of four numbers of rays.
        let combined = combinations(&base, &changes);
        let count = |by: IndirectBy| combined.iter().filter(|found| found.settings.gi.by == by).count();
        assert_eq!([IndirectBy::Lights, IndirectBy::Rays].map(count), [6, 4]);
        let all: Vec<&Settings> = combined.iter().map(|found| &found.settings).collect();
        assert!(all.iter().enumerate().all(|(index, own)| !all[..index].contains(own)));
        let (base, _, rays) = of(&settings, &[RAYS]);
        assert_eq!((base.gi.by, base.gi.rays_per_pixel, rays.as_str()), (IndirectBy::Lights, 64, "rays "));
        let (base, _, rays) = of(&settings, &[BY]);
        assert_eq!((base.gi.by, base.gi.rays_per_pixel, rays.as_str()), (IndirectBy::Rays, 4, "64 16 1 "));
        let (base, _, rays) = of(&settings, &[BY, RAYS]);
        assert_eq!((base.gi.rays_per_pixel, rays.as_str()), (64, ""));
        assert_eq!(base_of(&settings, &[], false).gi, settings.gi, "light that does not count stays");
        // Without light between surfaces, rays cost nothing and bring nothing.
        let base = base_of(&settings, &[], true);
        let all = combinations(&base, &changes_of(&settings, &base, &[], false, true));
        let dark = all.iter().filter(|found| found.settings.gi.bounces == 0);
        assert!(dark.clone().count() > 0 && dark.clone().all(|found| found.settings.gi.by == IndirectBy::Lights));
        // What is known from lights says nothing of what is known from rays.
        let few = base_of(&settings, &[BY.to_owned()], true);
        let kinds = [&base, &few, &settings].map(|base| Kind::new(&settings, base, true, &[]).0);
        assert!(kinds[0] != kinds[1] && kinds[1] != kinds[2] && kinds[0] != kinds[2], "{kinds:?}");
        settings.gi.by = IndirectBy::Lights;
        assert_eq!(of(&settings, &[]).2, "");
    }

    #[test]
    fn a_combination_that_was_measured_is_expected_as_it_was_and_others_move_along() {
        let mut base = Settings::default();
        base.reflection.method = Method::SscrHierarchical;
        let mut changes = [
            change(&[("view.resolution", "0.5")], [4.0, 8.0, 0.0], 0.0),
            change(&[("gi.vpls", "64")], [0.0, 1.0, 0.0], 0.0),
            change(&[("gi.vpls", "16")], [2.0, 4.0, 0.0], 0.0),
        ];
        let coarse_and_few = Combination { settings: base.clone(), changes: vec![0, 2] };
        let measured = [6.0, 3.0, 0.25];
        correct(&mut changes, &coarse_and_few, measured);
        for (is, should) in coarse_and_few.squares(&changes).into_iter().zip(measured) {
            assert!((is - should).abs() < 1e-9, "{changes:?}");
        }
        // What the views before said of mirrors was right, and of the rest four times too much.
        let expected = [[4.0, 2.0], [0.0, 0.5], [2.0, 1.0]];
        for (change, expected) in changes.iter().zip(expected) {
            let close = change.squares.iter().zip(expected).all(|(is, should)| (is - should).abs() < 1e-6);
            assert!(close, "{changes:?}");
        }
    }

    #[test]
    fn errors_are_kept_for_the_values_that_were_changed_and_apart_for_views_without_mirrors() {
        let base = Settings::default();
        let few = change(&[("gi.vpls", "16")], [1.0, 2.0, 3.0], 5.0);
        let mut known = KnownErrors::default();
        let [mirrors, bare] =
            [true, false].map(|has_mirrors| Kind::new(&base, &base, has_mirrors, &["scene.seed".to_owned()]));
        known.learn(&mirrors, &base, [4.0; 3], std::slice::from_ref(&few));
        assert_eq!(known.of(&mirrors, &base, Some(&few)), Some([1.0, 2.0, 3.0]));
        assert_eq!(known.of(&mirrors, &base, None), Some([4.0; 3]));
        assert_eq!(known.of(&bare, &base, Some(&few)), None);
        // The still picture keeps what is fixed, so its errors are others.
        assert_eq!(known.of(&Kind::new(&base, &base, true, &["view.resolution".to_owned()]), &base, Some(&few)), None);
        let mut other = base.clone();
        other.gi.vpls = 128;
        assert_eq!((known.of(&mirrors, &other, Some(&few)), known.of(&mirrors, &other, None)), (None, None));
        known.learn(&mirrors, &base, [0.0; 3], &[Change { squares: [3.0, 2.0, 1.0], ..few.clone() }]);
        assert_eq!(known.of(&mirrors, &base, Some(&few)), Some([2.0; 3]));
        assert_eq!(known.of(&mirrors, &base, None), Some([2.0; 3]));
    }
}
