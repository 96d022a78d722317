//! Plans: which settings a study measures. A plan is a TOML file of groups; each group stands for all combinations of its
//! scenes, methods and swept values. docs/study/README.md describes the format.
//!
//! Everything that can be told without a scene is checked here, with the line of the file that is wrong, before anything runs.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use param::{Choice as _, Kind};
use scene::{Method, Settings};
use serde::{Deserialize, Serialize};
use toml::de::{DeTable, DeValue};

use crate::file_name::file_name;
use crate::metrics::Truth;
use crate::results;

pub use scene::RAY_TRACE;

/// Most settings of a plan: at a second each it would run for a day on the fastest machine.
const MOST_CASES: usize = 100_000;

/// Bytes that the settings of a plan take, at most: what names and values a few lines repeat may be long.
const MOST_CASE_BYTES: usize = 32 << 20;

/// Keys that a group sweeps, at most: each doubles the number of settings, or sweeps nothing.
const MOST_SWEPT: usize = 64;

/// Swept in place of a parameter: the picture's size, as in `640x480`.
pub const SIZE: &str = "size";

/// Characters of a message about a plan, which may quote it.
const MOST_TOLD: usize = 400;

/// What is wrong with a plan, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct PlanError {
    /// File and line.
    pub place: String,
    pub problem: String,
}

/// Width and height of a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Size(pub [u32; 2]);

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once(['x', 'X']).map(|(width, height)| [width.parse(), height.parse()]);
        match sides {
            // What software Vulkan draws at most.
            Some([Ok(width), Ok(height)]) if [width, height].iter().all(|side| (1..=16_384).contains(side)) => {
                Ok(Self([width, height]))
            }
            _ => Err(format!("`{text}` is no size, expected WIDTHxHEIGHT with 1 to 16384 pixels a side")),
        }
    }
}

impl TryFrom<String> for Size {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Size> for String {
    fn from(Size([width, height]): Size) -> Self {
        format!("{width}x{height}")
    }
}

/// What stands on the time axis of charts of time against error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Time {
    /// All passes that find what mirrors show.
    #[default]
    MethodMs,
    /// The whole frame.
    FrameMs,
}

impl Time {
    /// The figure's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::MethodMs => results::METHOD_MS,
            Self::FrameMs => results::FRAME_MS,
        }
    }
}

/// A study to be made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    pub title: String,
    /// For the report.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    #[serde(default = "default_size")]
    pub size: Size,
    /// Timed frames of each setting.
    #[serde(default = "default_repeats")]
    pub repeats: u32,
    /// What pictures are judged by. The exact truth is left out for scenes whose surfaces nobody knows.
    #[serde(default = "default_truths")]
    pub truths: Vec<Truth>,
    /// Paths per pixel of the truth's indirect light.
    #[serde(default = "default_truth_samples")]
    pub truth_samples: u32,
    /// Also measure how much mirrors flicker.
    #[serde(default)]
    pub flicker: bool,
    /// Figures that time is charted against, a chart each. If not given, two of each truth.
    #[serde(default)]
    pub errors: Vec<String>,
    /// Figures that are charted over each swept key, a chart each.
    #[serde(default = "default_figures")]
    pub figures: Vec<String>,
    #[serde(default)]
    pub time: Time,
    /// Parameters of all settings.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub set: BTreeMap<String, toml::Value>,
    #[serde(rename = "group")]
    pub groups: Vec<Group>,
}

/// All combinations of scenes, methods and swept values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// `group-1` and so on if not given.
    #[serde(default)]
    pub name: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// What would mend the failure that this group shows.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub mends: String,
    /// What `glint render` takes as input; `{name}` stands for the value of the variable `name`.
    pub scenes: Vec<String>,
    #[serde(default = "default_methods")]
    pub methods: Vec<String>,
    /// Figures charted over the swept keys in place of the plan's; the bound's figure alone if there is a bound.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<String>,
    /// Also measure how much mirrors flicker in this group.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub flicker: bool,
    /// Show the worst setting: what was drawn, the truth, and their difference.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub pictures: bool,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub set: BTreeMap<String, toml::Value>,
    /// Lists of values, or ranges; see [`Range`]. A key without a dot is a variable, `size` the picture's size.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sweep: BTreeMap<String, toml::Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound: Option<Bound>,
}

/// Evenly spaced values, or values of even ratios.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Range {
    from: f64,
    to: f64,
    count: u32,
    #[serde(default)]
    scale: Scale,
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Scale {
    #[default]
    Linear,
    Log,
}

impl Range {
    fn problem(&self) -> Option<&'static str> {
        let is_log = matches!(self.scale, Scale::Log);
        if !self.from.is_finite() || !self.to.is_finite() {
            Some("`from` and `to` must be finite")
        } else if self.count < 2 {
            Some("`count` must be 2 or more")
        } else if is_log && !(self.from > 0.0 && self.to > 0.0) {
            Some("a log scale needs `from` and `to` above 0")
        } else {
            None
        }
    }

    fn value(&self, index: u32) -> f64 {
        let share = f64::from(index) / f64::from(self.count - 1);
        match self.scale {
            Scale::Linear => self.from + (self.to - self.from) * share,
            Scale::Log => self.from * (self.to / self.from).powf(share),
        }
    }
}

/// What a group's figure must not pass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    pub figure: String,
    /// Those that it holds for; all if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub methods: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
    /// Least swept value that it holds for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<f64>,
    /// Largest swept value that it holds for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up_to: Option<f64>,
}

impl Bound {
    /// Whether a value of the figure keeps within it.
    pub fn holds(&self, value: f64) -> bool {
        self.at_least.is_none_or(|least| value >= least) && self.at_most.is_none_or(|most| value <= most)
    }

    /// Whether it says anything about a setting.
    pub fn is_about(&self, case: &Case) -> bool {
        let is_of_method = self.methods.is_empty() || self.methods.contains(&case.method);
        let swept = case.swept.first().and_then(|(_, value)| value.parse::<f64>().ok());
        let is_in_range =
            |value: f64| self.from.is_none_or(|from| value >= from) && self.up_to.is_none_or(|up_to| value <= up_to);
        is_of_method && swept.is_none_or(is_in_range)
    }
}

/// One setting of a plan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// Its place in the plan: the same for whoever expands it.
    pub index: usize,
    /// Index of its group.
    pub group: usize,
    /// As the group has it, with the names of variables.
    pub scene_pattern: String,
    /// With their values.
    pub scene: String,
    pub method: String,
    pub size: [u32; 2],
    /// Swept keys and variables with their values, sorted by key.
    pub swept: Vec<(String, String)>,
    /// Parameters that plan and group set; one list for all settings of a group.
    pub set: Arc<[(String, String)]>,
}

impl Case {
    /// The parameters it is drawn with; `base` are those of its scene. The ray tracer starts from a surface without reflections.
    ///
    /// # Errors
    /// A parameter that does not exist, or a value out of range; plans that were checked have none.
    pub fn settings(&self, base: &Settings) -> Result<Settings, param::Error> {
        let mut settings = base.clone();
        for (key, value) in self.set.iter().chain(self.parameters_swept()) {
            settings.set_text(key, value)?;
        }
        let method = if self.method == RAY_TRACE { Method::None.name() } else { &self.method };
        settings.set_text("reflection.method", method)?;
        Ok(settings.drawn())
    }

    fn parameters_swept(&self) -> impl Iterator<Item = &(String, String)> {
        self.swept.iter().filter(|(key, _)| key.contains('.'))
    }

    /// The value of a swept key.
    pub fn swept_value(&self, key: &str) -> Option<&str> {
        self.swept.iter().find(|(swept, _)| swept == key).map(|(_, value)| value.as_str())
    }
}

fn default_size() -> Size {
    Size([800, 600])
}

fn default_repeats() -> u32 {
    3
}

fn default_truths() -> Vec<Truth> {
    vec![Truth::SameInput]
}

fn default_truth_samples() -> u32 {
    64
}

/// Where a reflection is and how it looks.
fn default_errors(truths: &[Truth]) -> Vec<String> {
    let errors = truths.iter().map(|truth| results::truth_name(*truth));
    errors.flat_map(|truth| ["pixel_error_p95", "delta_e"].map(|error| format!("{truth}_{error}"))).collect()
}

fn default_figures() -> Vec<String> {
    ["hit_rate", "coverage", "method_ms"].map(str::to_owned).into()
}

/// Stands for every method of the renderer; `auto` is one of them.
const ALL_METHODS: &str = "all";

fn default_methods() -> Vec<String> {
    vec![Method::Auto.name().to_owned()]
}

/// A plan that cannot be read; the error names it already.
fn unreadable(place: &str, error: &scene::Error) -> PlanError {
    let problem =
        if let scene::Error::Unreadable { problem, .. } = error { problem.clone() } else { error.to_string() };
    PlanError { place: place.to_owned(), problem }
}

/// A problem, and the keys and indices that lead to its place in the file.
struct Problem {
    path: Vec<String>,
    text: String,
}

fn problem(path: &[&str], text: impl Into<String>) -> Problem {
    Problem { path: path.iter().map(|step| (*step).to_owned()).collect(), text: text.into() }
}

impl Plan {
    /// Reads a plan and checks it. Scenes given by a relative path are taken to be beside the file.
    ///
    /// # Errors
    /// Not readable, or no plan: with the file and line, and what was expected.
    pub fn read(path: &Path) -> Result<Self, PlanError> {
        let place = path.display().to_string();
        let text = scene::whole_file::read(path).map_err(|error| unreadable(&place, &error))?;
        let mut plan = Self::parse(&place, &text)?;
        // Absolute, so that the plan that is kept beside the results still finds them.
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        for scene in plan.groups.iter_mut().flat_map(|group| &mut group.scenes) {
            let beside = folder.join(&*scene);
            if is_path(scene) && !Path::new(scene).is_absolute() {
                *scene = beside.canonicalize().unwrap_or(beside).to_string_lossy().into_owned();
            }
        }
        Ok(plan)
    }

    /// `place` names the text in errors.
    ///
    /// # Errors
    /// As for [`Plan::read`].
    pub fn parse(place: &str, text: &str) -> Result<Self, PlanError> {
        let mut plan: Self = scene::whole_file::from_toml(text).map_err(|error| {
            let line = error.span().map(|span| line_at(text, span.start));
            let problem = param::shortened(&error.message().trim().replace('\n', "; "), MOST_TOLD);
            PlanError { place: at_line(place, line), problem }
        })?;
        let table = DeTable::parse(text).ok();
        let has_errors = |table: &DeTable<'_>| table.keys().any(|key| key.get_ref().as_ref() == "errors");
        if !table.as_ref().is_some_and(|table| has_errors(table.get_ref())) {
            plan.errors = default_errors(&plan.truths);
        }
        for (index, group) in plan.groups.iter_mut().enumerate() {
            if group.name.is_empty() {
                group.name = format!("group-{}", index + 1);
            }
            if let Some(at) = group.methods.iter().position(|method| method == ALL_METHODS) {
                let methods = Method::NAMES.iter().filter(|name| **name != Method::Auto.name());
                group.methods.splice(at..=at, methods.map(|name| (*name).to_owned()));
            }
        }
        plan.check().map_err(|Problem { path, text: problem }| {
            let line = table.as_ref().and_then(|table| line_of(text, table.get_ref(), &path));
            PlanError { place: at_line(place, line), problem: param::shortened(&problem, MOST_TOLD) }
        })?;
        Ok(plan)
    }

    /// Replaces a parameter of all settings: the plan's own value and those of its groups. Groups that sweep it go on doing so;
    /// their names are given back.
    ///
    /// # Errors
    /// A parameter that does not exist, or a value out of range.
    pub fn replace(&mut self, key: &str, value: &str) -> Result<Vec<&str>, param::Error> {
        Settings::default().set_text(key, value)?;
        let value = toml::Value::String(value.to_owned());
        for group in &mut self.groups {
            if let Some(own) = group.set.get_mut(key) {
                own.clone_from(&value);
            }
        }
        self.set.insert(key.to_owned(), value);
        Ok(self.groups_sweeping(key))
    }

    /// Names of the groups that sweep a key.
    pub fn groups_sweeping(&self, key: &str) -> Vec<&str> {
        let sweeping = self.groups.iter().filter(|group| group.sweep.contains_key(key));
        sweeping.map(|group| group.name.as_str()).collect()
    }

    /// All swept keys and variables, sorted.
    pub fn swept_keys(&self) -> Vec<&str> {
        let keys: BTreeSet<&str> =
            self.groups.iter().flat_map(|group| group.sweep.keys().map(String::as_str)).collect();
        keys.into_iter().collect()
    }

    /// All settings, in an order that depends on the plan alone: groups, scenes, methods, swept values, the last key fastest.
    pub fn cases(&self) -> Vec<Case> {
        let mut cases = Vec::new();
        for (index, group) in self.groups.iter().enumerate() {
            let sweeps: Vec<(&String, Vec<String>)> =
                group.sweep.iter().map(|(key, sweep)| (key, swept_values(key, sweep).unwrap_or_default())).collect();
            let combinations: usize = sweeps.iter().map(|(_, values)| values.len()).product();
            let set = self.set.iter().filter(|(key, _)| !group.set.contains_key(*key)).chain(&group.set);
            let set = set.filter(|(key, _)| !group.sweep.contains_key(*key));
            let set: Arc<[(String, String)]> = set.map(|(key, value)| (key.clone(), plain_text(value))).collect();
            // Exactly: a list that grows is there twice while it does.
            cases.reserve_exact(group.scenes.len() * group.methods.len() * combinations);
            for scene_pattern in &group.scenes {
                for method in &group.methods {
                    for combination in 0..combinations {
                        let mut rest = combination;
                        let mut swept: Vec<(String, String)> = Vec::with_capacity(sweeps.len());
                        for (key, values) in sweeps.iter().rev() {
                            swept.push(((*key).clone(), values[rest % values.len()].clone()));
                            rest /= values.len();
                        }
                        swept.reverse();
                        let scene = filled(scene_pattern, &swept);
                        let size = swept.iter().find(|(key, _)| key == SIZE);
                        let Size(size) = size.and_then(|(_, value)| value.parse().ok()).unwrap_or(self.size);
                        cases.push(Case {
                            index: cases.len(),
                            group: index,
                            scene_pattern: scene_pattern.clone(),
                            scene,
                            method: method.clone(),
                            size,
                            swept,
                            set: set.clone(),
                        });
                    }
                }
            }
        }
        cases
    }

    /// The plan as a file.
    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), Problem> {
        if !(1..=1000).contains(&self.repeats) {
            return Err(problem(&["repeats"], format!("repeats is {}, expected 1 to 1000", self.repeats)));
        }
        if !(1..=65_536).contains(&self.truth_samples) {
            let text = format!("truth_samples is {}, expected 1 to 65536 paths", self.truth_samples);
            return Err(problem(&["truth_samples"], text));
        }
        for (list, names) in [("errors", &self.errors), ("figures", &self.figures)] {
            // A group that measures flicker shows it in charts of all.
            let has_flicker = self.flicker || self.groups.iter().any(|group| group.flicker);
            let check = |name| check_figure(name, &self.truths, has_flicker);
            names.iter().try_for_each(|name| check(name).map_err(|text| problem(&[list], text)))?;
        }
        check_set(&self.set, &["set"])?;
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
}

impl Group {
    /// The number of its settings, and the bytes that they take at most.
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
        let check = |name: &String| check_figure(name, &plan.truths, plan.flicker || self.flicker);
        self.figures.iter().try_for_each(|name| check(name).map_err(|text| at(&["figures"], text)))?;
        check_set(&self.set, &[path, &["set"]].concat())?;
        let mut count = self.scenes.len().saturating_mul(self.methods.len());
        if self.sweep.len() > MOST_SWEPT {
            let text = format!("{} keys are swept, expected at most {MOST_SWEPT}", self.sweep.len());
            return Err(at(&["sweep"], text));
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

/// The texts of a scene between the names of variables: each name stands before its text, none before the first.
fn parts(scene: &str) -> impl Iterator<Item = (Option<&str>, &str)> {
    let (first, rest) = scene.split_once('{').map_or((scene, None), |(first, rest)| (first, Some(rest)));
    let named = rest.into_iter().flat_map(|rest| rest.split('{'));
    let named = named.map(|part| part.split_once('}').map_or((Some(part), ""), |(name, text)| (Some(name), text)));
    std::iter::once((None, first)).chain(named)
}

/// A scene with the values of variables in place of their names. What a value holds is not replaced again.
fn filled(scene: &str, swept: &[(String, String)]) -> String {
    let mut filled = String::new();
    for (name, text) in parts(scene) {
        let value = name.and_then(|name| swept.iter().find(|(key, _)| key == name));
        filled += value.map_or("", |(_, value)| value);
        filled += text;
    }
    filled
}

/// Bytes of a scene with values of these lengths.
fn filled_length(scene: &str, lengths: &[(&str, usize)]) -> usize {
    parts(scene).fold(0, |total, (name, text)| {
        let value = name.and_then(|name| lengths.iter().find(|(key, _)| *key == name));
        total.saturating_add(value.map_or(0, |(_, length)| *length)).saturating_add(text.len())
    })
}

/// Whether a scene is named by a path, as opposed to a built-in scene's name.
fn is_path(scene: &str) -> bool {
    let extensions = ["toml", "las", "laz", "ply"];
    let extension = Path::new(scene).extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| extensions.iter().any(|known| extension.eq_ignore_ascii_case(known)))
}

fn check_method(name: &str) -> Result<(), String> {
    if Method::NAMES.contains(&name) || name == RAY_TRACE {
        return Ok(());
    }
    Err(format!("method `{name}` is unknown; available: {}, {RAY_TRACE}", Method::NAMES.join(", ")))
}

/// The first item that is there before.
fn twice(items: &[String]) -> Option<&String> {
    let mut known = HashSet::new();
    items.iter().find(|item| !known.insert(*item))
}

/// There is such a figure, and something that it is measured by.
fn check_figure(name: &str, truths: &[Truth], has_flicker: bool) -> Result<(), String> {
    if let Some(figure) = results::figure(name) {
        return match figure.truth() {
            Some((truth, known)) if !truths.contains(&truth) => {
                Err(format!("figure `{name}` is never measured, expected \"{known}\" among the `truths`"))
            }
            _ if figure.is_of_flicker() && !has_flicker => {
                Err(format!("figure `{name}` is never measured, expected `flicker = true` in the plan or its group"))
            }
            _ => Ok(()),
        };
    }
    let near = param::nearest(name, results::figures().iter().map(|figure| figure.name.as_str()));
    let hint = near.map_or("docs/study/README.md lists them".to_owned(), |near| format!("did you mean `{near}`?"));
    Err(format!("figure `{name}` is unknown; {hint}"))
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
        _ => Settings::default().set_text(key, value).map_err(|error| error.to_string()),
    }
}

/// As `--set` takes it.
fn scalar_text(value: &toml::Value) -> Option<String> {
    match value {
        toml::Value::String(text) => Some(text.clone()),
        toml::Value::Integer(number) => Some(number.to_string()),
        toml::Value::Float(number) => Some(number.to_string()),
        toml::Value::Boolean(switch) => Some(switch.to_string()),
        _ => None,
    }
}

fn plain_text(value: &toml::Value) -> String {
    scalar_text(value).unwrap_or_default()
}

/// The number of values, without making them.
fn sweep_length(sweep: &toml::Value) -> Result<usize, String> {
    match sweep {
        toml::Value::Array(values) if values.is_empty() => Err("the list is empty, expected one or more".into()),
        toml::Value::Array(values) => Ok(values.len()),
        toml::Value::Table(_) => Ok(range(sweep)?.count as usize),
        _ => Err("expected a list, or a range { from, to, count, scale }".into()),
    }
}

fn range(sweep: &toml::Value) -> Result<Range, String> {
    let range: Range = sweep.clone().try_into().map_err(|error: toml::de::Error| error.message().to_owned())?;
    range.problem().map_or(Ok(range), |text| Err(text.into()))
}

/// The values of a list or range, as text. Whole numbers where the parameter is one.
fn swept_values(key: &str, sweep: &toml::Value) -> Result<Vec<String>, String> {
    if let toml::Value::Array(values) = sweep {
        let text = |value| scalar_text(value).ok_or("expected numbers, texts, true or false in the list");
        return Ok(values.iter().map(text).collect::<Result<_, _>>()?);
    }
    let range = range(sweep)?;
    let settings = Settings::default();
    let is_whole = settings.groups().iter().any(|params| {
        let group = params.group();
        let mut fields = group.fields.iter();
        fields.any(|field| format!("{}.{}", group.name, field.name) == key && matches!(field.kind, Kind::U32 { .. }))
    });
    let mut values: Vec<String> = (0..range.count)
        .map(|index| {
            let value = range.value(index);
            if is_whole { format!("{}", value.round()) } else { rounded(value).to_string() }
        })
        .collect();
    values.dedup();
    Ok(values)
}

/// To 4 significant digits, which is finer than any chart shows.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

fn at_line(place: &str, line: Option<usize>) -> String {
    line.map_or(place.to_owned(), |line| format!("{place}:{line}"))
}

fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes().iter().take(offset).filter(|byte| **byte == b'\n').count() + 1
}

/// The line of what `path` leads to, or of the last part of it that the file has.
fn line_of(text: &str, table: &DeTable<'_>, path: &[String]) -> Option<usize> {
    let (first, rest) = path.split_first()?;
    let (key, value) = table.iter().find(|(key, _)| key.get_ref().as_ref() == first.as_str())?;
    let (mut line, mut value, mut rest) = (line_at(text, key.span().start), value, rest);
    while let Some((step, after)) = rest.split_first() {
        value = match value.get_ref() {
            DeValue::Array(array) => match step.parse::<usize>().ok().and_then(|index| array.get(index)) {
                Some(item) => item,
                None => break,
            },
            DeValue::Table(table) => return line_of(text, table, rest).or(Some(line)),
            _ => break,
        };
        (line, rest) = (line_at(text, value.span().start), after);
    }
    Some(line)
}

#[cfg(test)]
mod tests;
