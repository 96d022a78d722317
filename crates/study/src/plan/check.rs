//! Checks a plan without its scenes.

use std::collections::{BTreeMap, HashMap, HashSet};

use param::Choice as _;
use scene::{Method, Preset, Settings};
use toml::de::DeTable;

use super::lines::{at_line, line_of};
use super::sweep::{filled_length, parts, scalar_text, sweep_length, swept_values};
use super::{
    Bound, Case, DISTANCE, Group, MOST_TOLD, ORBIT, Plan, PlanError, PlannedTarget, RAY_TRACE, SIZE, Size, TARGET,
};
use crate::auto;
use crate::file_name::file_name;
use crate::results;

/// The most settings of a plan: at a second each it would run for a day on the fastest machine.
const MOST_CASES: usize = 100_000;

/// The most bytes of the settings of a plan: a few lines may repeat long names and values.
const MOST_CASE_BYTES: usize = 32 << 20;

/// The most keys that a group sweeps: each at least doubles the number of settings, or sweeps nothing.
const MOST_SWEPT: usize = 64;

/// The most frames before the one that is measured: what learns from frame to frame has learned by then.
const MOST_FRAMES_BEFORE: u32 = 1000;

/// A problem, and the keys and indices that lead to its place in the file.
struct Problem {
    path: Vec<String>,
    text: String,
}

fn problem(path: &[&str], text: impl Into<String>) -> Problem {
    Problem { path: path.iter().map(|step| (*step).to_owned()).collect(), text: text.into() }
}

impl Plan {
    /// Checks the plan; `place` names the text from which it was read in errors.
    pub(super) fn check(&self, place: &str, text: &str) -> Result<(), PlanError> {
        self.odd().map_err(|Problem { path, text: problem }| {
            let table = DeTable::parse(text).ok();
            let line = table.as_ref().and_then(|table| line_of(text, table.get_ref(), &path));
            PlanError { place: at_line(place, line), problem: param::shortened(&problem, MOST_TOLD) }
        })
    }

    fn odd(&self) -> Result<(), Problem> {
        if !(1..=1000).contains(&self.repeats) {
            return Err(problem(&["repeats"], format!("repeats is {}, expected 1 to 1000", self.repeats)));
        }
        if !(1..=65_536).contains(&self.truth_samples) {
            let text = format!("truth_samples is {}, expected 1 to 65536 paths", self.truth_samples);
            return Err(problem(&["truth_samples"], text));
        }
        if self.light && self.truths.is_empty() {
            return Err(problem(&["light"], "light = true has no effect without `truths`"));
        }
        self.check_parts()?;
        for (list, names) in [("errors", &self.errors), ("figures", &self.figures)] {
            // A group that measures flicker shows it in charts of all.
            let has_flicker = self.flicker || self.groups.iter().any(|group| group.flicker);
            let check = |name| check_figure(name, self, has_flicker);
            names.iter().try_for_each(|name| check(name).map_err(|text| problem(&[list], text)))?;
        }
        check_preset(self.preset.as_deref(), &["preset"])?;
        check_set(&self.set, &["set"])?;
        check_set(&self.still_set, &["still_set"])?;
        if !self.still_set.is_empty() && !self.still {
            return Err(problem(&["still_set"], "still_set has no effect without `still = true`"));
        }
        if self.groups.is_empty() {
            return Err(problem(&["group"], "no [[group]], expected one or more"));
        }
        let (mut total, mut total_bytes) = (0_usize, 0_usize);
        let mut files: HashMap<String, &str> = HashMap::new();
        for (index, group) in self.groups.iter().enumerate() {
            let number = index.to_string();
            let group_path = ["group", number.as_str()];
            let file = file_name(&group.name);
            let text = match files.get(&file) {
                Some(other) if *other == group.name => {
                    Some(format!("a second group is called `{other}`, names must be unique"))
                }
                Some(other) => Some(format!("`{}` and `{other}` give files the same name `{file}`", group.name)),
                None if file.is_empty() => {
                    Some(format!("`{}` names no file, expected a letter from a to z or a digit", group.name))
                }
                None => None,
            };
            if let Some(text) = text {
                return Err(problem(&[&group_path[..], &["name"]].concat(), text));
            }
            files.insert(file, &group.name);
            let (settings, bytes) = group.check(&group_path, self)?;
            (total, total_bytes) = (total.saturating_add(settings), total_bytes.saturating_add(bytes));
            if total > MOST_CASES {
                let text = format!("the plan has {total} settings or more, expected at most {MOST_CASES}");
                return Err(problem(&[&group_path[..], &["sweep"]].concat(), text));
            }
            if total_bytes > MOST_CASE_BYTES {
                let (bytes, most) = (total_bytes >> 20, MOST_CASE_BYTES >> 20);
                let text =
                    format!("the plan's settings take {bytes} MB, expected at most {most}: fewer, or shorter names");
                return Err(problem(&[&group_path[..], &["scenes"]].concat(), text));
            }
        }
        Ok(())
    }

    /// Names of parts are columns of the table, which no other part and no figure may have.
    fn check_parts(&self) -> Result<(), Problem> {
        let mut known = HashSet::new();
        for (index, part) in self.parts.iter().enumerate() {
            let at = |key: &str, text: String| problem(&["part", &index.to_string(), key], text);
            let is_word =
                |name: &str| name.chars().all(|letter| letter.is_ascii_lowercase() || "_0123456789".contains(letter));
            if !part.name.ends_with("_ms") || !is_word(&part.name) {
                return Err(at(
                    "name",
                    format!("`{}` is no name of a time, expected one as in `search_ms`", part.name),
                ));
            }
            if results::figure(&part.name).is_some() || !known.insert(part.name.as_str()) {
                return Err(at("name", format!("`{}` is the name of another figure", part.name)));
            }
            if part.passes.is_empty() {
                return Err(at("passes", "passes is empty, expected one or more".into()));
            }
        }
        Ok(())
    }
}

impl Group {
    /// The number of its settings, and the most bytes that they take.
    fn check(&self, path: &[&str], plan: &Plan) -> Result<(usize, usize), Problem> {
        let at = |rest: &[&str], text: String| problem(&[path, rest].concat(), text);
        for (key, list) in [("scenes", &self.scenes), ("methods", &self.methods)] {
            if list.is_empty() {
                return Err(at(&[key], format!("{key} is empty, expected one or more")));
            }
            if let Some(name) = twice(list) {
                return Err(at(&[key], format!("`{name}` is named twice")));
            }
        }
        for (index, method) in self.methods.iter().enumerate() {
            check_method(method).map_err(|text| at(&["methods", &index.to_string()], text))?;
        }
        let check = |name: &String| check_figure(name, plan, plan.flicker || self.flicker);
        self.figures.iter().try_for_each(|name| check(name).map_err(|text| at(&["figures"], text)))?;
        check_preset(self.preset.as_deref(), &[path, &["preset"]].concat())?;
        for name in self.stacked.iter().flatten() {
            let time = check(name).and_then(|()| match plan.figure(name).is_some_and(|figure| figure.unit == "ms") {
                true => Ok(()),
                false => Err(format!("figure `{name}` is no time, and only times are stacked")),
            });
            time.map_err(|text| at(&["stacked"], text))?;
        }
        if self.frames_before > MOST_FRAMES_BEFORE {
            let text = format!("frames_before is {}, expected at most {MOST_FRAMES_BEFORE}", self.frames_before);
            return Err(at(&["frames_before"], text));
        }
        if self.lags && self.frames_before == 0 {
            return Err(at(&["lags"], "lags: there is no frame to lag behind without `frames_before`".into()));
        }
        check_set(&self.set, &[path, &["set"]].concat())?;
        let mut count = self.scenes.len().saturating_mul(self.methods.len());
        if self.sweep.len() > MOST_SWEPT {
            let text = format!("{} keys are swept, expected at most {MOST_SWEPT}", self.sweep.len());
            return Err(at(&["sweep"], text));
        }
        if self.sweep.contains_key(TARGET) {
            let mut own = self.set.keys().map(|key| ("set", key)).chain(self.sweep.keys().map(|key| ("sweep", key)));
            if let Some((place, key)) = own.find(|(_, key)| auto::may_change(key)) {
                let text = format!("{key}: `auto` chooses it for the `target`, expected it in a group without one");
                return Err(at(&[place, key], text));
            }
        }
        if let Some(key) = self.sweep.keys().find(|key| self.set.contains_key(*key)) {
            return Err(at(&["set", key], format!("{key}: the group sweeps it, expected one value or a sweep")));
        }
        let mut longest = Vec::new();
        for (key, sweep) in &self.sweep {
            let values = sweep_length(sweep).map_err(|text| at(&["sweep", key], format!("{key}: {text}")))?;
            count = count.saturating_mul(values);
            if count > MOST_CASES {
                let text = format!("the plan has {count} settings or more, expected at most {MOST_CASES}");
                return Err(at(&["sweep", key], text));
            }
            let length = self.check_sweep(key, sweep).map_err(|text| at(&["sweep", key], text))?;
            longest.push((key.as_str(), length));
        }
        for (index, scene) in self.scenes.iter().enumerate() {
            self.check_names(scene).map_err(|text| at(&["scenes", &index.to_string()], text))?;
        }
        if let Some(bound) = &self.bound {
            check(&bound.figure).and_then(|()| self.check_bound(bound)).map_err(|text| at(&["bound"], text))?;
        }
        let swept =
            longest.iter().map(|(key, length)| size_of::<(String, String)>() + key.len() + length).sum::<usize>();
        let scene = |scene: &String| scene.len().saturating_add(filled_length(scene, &longest));
        let scene = self.scenes.iter().map(scene).max().unwrap_or(0);
        Ok((count, count.saturating_mul((size_of::<Case>() + swept).saturating_add(scene))))
    }

    /// The length of the longest value.
    fn check_sweep(&self, key: &str, sweep: &toml::Value) -> Result<usize, String> {
        let values = swept_values(key, sweep).map_err(|text| format!("{key}: {text}"))?;
        if let Some(value) = twice(&values) {
            return Err(format!("{key}: the value {value} occurs twice"));
        }
        if key == SIZE {
            values.iter().try_for_each(|value| value.parse::<Size>().map(|_| ()))?;
        } else if key == TARGET {
            values.iter().try_for_each(|value| value.parse::<PlannedTarget>().map(|_| ()))?;
            if let Some(method) = self.methods.iter().find(|method| *method != Method::Auto.name()) {
                return Err(format!("only `auto` keeps to a target, the group has the method `{method}`"));
            }
        } else if key == DISTANCE {
            let is_share = |value: &&String| value.parse().is_ok_and(|share: f64| share.is_finite() && share > 0.0);
            if let Some(value) = values.iter().find(|value| !is_share(value)) {
                return Err(format!("distance `{value}`: expected a share of the camera's distance, above 0"));
            }
        } else if key == ORBIT {
            let is_turn = |value: &&String| value.parse().is_ok_and(|degrees: f64| degrees.abs() <= 180.0);
            if let Some(value) = values.iter().find(|value| !is_turn(value)) {
                return Err(format!("orbit `{value}`: expected the degrees from frame to frame, -180 to 180"));
            }
            if self.frames_before == 0 {
                return Err("orbit: there is nothing to turn through without `frames_before`".into());
            }
        } else if key.contains('.') {
            values.iter().try_for_each(|value| check_parameter(key, value))?;
        } else if !self.scenes.iter().any(|scene| scene.contains(&format!("{{{key}}}"))) {
            return Err(format!(
                "the variable `{key}` is in no scene, expected {{{key}}} in one, or a parameter `group.name`"
            ));
        }
        Ok(values.iter().map(String::len).max().unwrap_or(0))
    }

    fn check_names(&self, scene: &str) -> Result<(), String> {
        for name in parts(scene).filter_map(|(name, _)| name) {
            if !self.sweep.contains_key(name) {
                return Err(format!("`{scene}`: the variable `{name}` is not swept, expected it as a key of `sweep`"));
            }
        }
        Ok(())
    }

    fn check_bound(&self, bound: &Bound) -> Result<(), String> {
        if let Some(method) = bound.methods.iter().find(|method| !self.methods.contains(method)) {
            return Err(format!("the bound is of `{method}`, which is none of the group's methods"));
        }
        if bound.at_least.is_some() == bound.at_most.is_some() {
            return Err("expected either at_least or at_most in a bound".into());
        }
        let has_range = bound.from.is_some() || bound.up_to.is_some();
        if has_range && self.sweep.len() != 1 {
            return Err("`from` and `up_to` of a bound need exactly one swept key".into());
        }
        Ok(())
    }
}

fn check_method(name: &str) -> Result<(), String> {
    if Method::NAMES.contains(&name) || name == RAY_TRACE {
        return Ok(());
    }
    Err(format!("method `{name}` is unknown; available: {}, {RAY_TRACE}", Method::NAMES.join(", ")))
}

/// The first item that occurred before.
fn twice(items: &[String]) -> Option<&String> {
    let mut known = HashSet::new();
    items.iter().find(|item| !known.insert(*item))
}

/// Checks that the figure exists and that something measures it.
fn check_figure(name: &str, plan: &Plan, has_flicker: bool) -> Result<(), String> {
    if let Some(figure) = plan.figure(name) {
        return match figure.truth() {
            Some((truth, known)) if !plan.truths.contains(&truth) => {
                Err(format!("figure `{name}` is never measured, expected \"{known}\" among the `truths`"))
            }
            _ if figure.is_of_flicker() && !has_flicker => {
                Err(format!("figure `{name}` is never measured, expected `flicker = true` in the plan or its group"))
            }
            _ if figure.is_of_light() && !plan.light => {
                Err(format!("figure `{name}` is never measured, expected `light = true` in the plan"))
            }
            _ if figure.is_of_sightlines() && !plan.sightlines => {
                Err(format!("figure `{name}` is never measured, expected `sightlines = true` in the plan"))
            }
            _ if figure.is_of_still() && !plan.still => {
                Err(format!("figure `{name}` is never measured, expected `still = true` in the plan"))
            }
            _ => Ok(()),
        };
    }
    let own = plan.parts.iter().map(|part| part.name.as_str());
    let near = param::nearest(name, own.chain(results::figures().iter().map(|figure| figure.name.as_str())));
    let hint = near.map_or("docs/study/README.md lists them".to_owned(), |near| format!("did you mean `{near}`?"));
    Err(format!("figure `{name}` is unknown; {hint}"))
}

fn check_preset(name: Option<&str>, path: &[&str]) -> Result<(), Problem> {
    name.map_or(Ok(()), |name| Preset::named(name).map(|_| ()).map_err(|text| problem(path, text)))
}

fn check_set(set: &BTreeMap<String, toml::Value>, path: &[&str]) -> Result<(), Problem> {
    set.iter().try_for_each(|(key, value)| {
        let value = scalar_text(value).ok_or_else(|| format!("{key}: expected a number, a text, true or false"));
        value.and_then(|value| check_parameter(key, &value)).map_err(|text| problem(&[path, &[key]].concat(), text))
    })
}

fn check_parameter(key: &str, value: &str) -> Result<(), String> {
    match key {
        "reflection.method" => Err("reflection.method: name methods in the group's `methods`".into()),
        _ => {
            let mut settings = Settings::default();
            settings.set_text(key, value).map_err(|error| error.to_string())?;
            if key == "reflection.own_methods" && settings.reflection.own_methods {
                return Err(format!("{key}: a study measures each method in all mirrors, expected false"));
            }
            Ok(())
        }
    }
}
