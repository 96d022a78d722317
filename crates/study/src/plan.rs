//! Plans: the settings that a study measures. A plan is a TOML file of groups; each group stands for all combinations
//! of its scenes, methods and swept values. docs/study/README.md describes the format.
//!
//! Everything that can be checked without a scene is checked here, with the line of the file that is wrong, before
//! anything runs.

mod check;
mod lines;
mod sweep;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use lines::{at_line, line_at};
use param::Choice as _;
use scene::{Method, Preset, Settings};
use serde::{Deserialize, Serialize};
use sweep::{filled, plain_text, swept_values};
use toml::de::DeTable;

use crate::metrics::Truth;
use crate::results::{self, Figure};
use crate::still::Target;

pub use scene::RAY_TRACE;

/// The key of the picture's size, as in `640x480`; it is swept like a parameter.
pub const SIZE: &str = "size";

/// The key of the target that `auto` is to keep to, as in `50ms`, `2dE` or `0.5x`; it is swept like a parameter.
pub const TARGET: &str = "target";

/// The key of the camera's distance from its pivot, as a share of the scene's own; it is swept like a parameter.
pub const DISTANCE: &str = "distance";

/// The key of the degrees by which the camera turns about its pivot from frame to frame, and ends at the scene's own view;
/// it is swept like a parameter.
pub const ORBIT: &str = "orbit";

/// The most characters of a message about a plan, which may quote it.
const MOST_TOLD: usize = 400;

/// An error in a plan, and its place.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {problem}")]
pub struct PlanError {
    /// The file and the line.
    pub place: String,
    pub problem: String,
}

/// The width and height of a picture in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Size(pub [u32; 2]);

impl std::str::FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once(['x', 'X']).map(|(width, height)| [width.parse(), height.parse()]);
        match sides {
            // The largest picture that software Vulkan draws.
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

/// A target of `auto` in a plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlannedTarget {
    Fixed(Target),
    /// A time, as a share of that of a frame with the settings as they are.
    Share(f64),
}

impl PlannedTarget {
    /// The target for a frame that takes `milliseconds` with the settings as they are.
    pub fn target(self, milliseconds: f64) -> Target {
        match self {
            Self::Fixed(target) => target,
            Self::Share(share) => Target::Milliseconds(milliseconds * share),
        }
    }
}

impl std::str::FromStr for PlannedTarget {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let share = text.strip_suffix('x').and_then(|number| number.parse::<f64>().ok());
        match share.filter(|share| share.is_finite() && *share > 0.0) {
            Some(share) => Ok(Self::Share(share)),
            None => text.parse().map(Self::Fixed).map_err(|_| {
                format!("target `{text}`: expected a time as in 50ms or 0.5x, or an error as in 1px or 2dE, above 0")
            }),
        }
    }
}

/// The time axis of charts of time against error.
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

/// Passes whose times are reported together, as a figure of the plan.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// The figure's name, as `search_ms`.
    pub name: String,
    /// The name for people.
    pub label: String,
    /// The passes, by the names of `FrameStats`.
    pub passes: Vec<String>,
}

/// Which settings of a group are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "toml::Value", into = "toml::Value")]
pub enum Pictures {
    #[default]
    None,
    /// The worst of each scene and method: what was drawn, the truth, and their difference.
    Worst,
    /// Each one, as it was drawn, cut to the mirrors.
    Each,
}

impl Part {
    pub fn figure(&self) -> Figure {
        Figure { name: self.name.clone(), label: format!("time of {}", self.label), unit: "ms" }
    }
}

impl TryFrom<toml::Value> for Pictures {
    type Error = &'static str;

    fn try_from(value: toml::Value) -> Result<Self, Self::Error> {
        match value {
            toml::Value::Boolean(false) => Ok(Self::None),
            toml::Value::Boolean(true) => Ok(Self::Worst),
            toml::Value::String(word) if word == "each" => Ok(Self::Each),
            _ => Err("expected true, false or \"each\" for pictures"),
        }
    }
}

impl From<Pictures> for toml::Value {
    fn from(pictures: Pictures) -> Self {
        match pictures {
            Pictures::None => Self::Boolean(false),
            Pictures::Worst => Self::Boolean(true),
            Pictures::Each => Self::String("each".into()),
        }
    }
}

/// A study to be made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    pub title: String,
    /// An explanation for the report.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    #[serde(default = "default_size")]
    pub size: Size,
    /// The number of timed frames of each setting.
    #[serde(default = "default_repeats")]
    pub repeats: u32,
    /// The truths by which pictures are judged. The exact truth is left out for scenes whose surfaces are unknown.
    #[serde(default = "default_truths")]
    pub truths: Vec<Truth>,
    /// The number of paths per pixel of the truth's indirect light.
    #[serde(default = "default_truth_samples")]
    pub truth_samples: u32,
    /// Whether to measure how much mirrors flicker, too.
    #[serde(default)]
    pub flicker: bool,
    /// Whether to measure the error of indirect light by each truth, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub light: bool,
    /// Whether to measure how far the surface of each scene is from its points, by those that are held out, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub sightlines: bool,
    /// Whether to measure errors against the still picture, which `auto` keeps to, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub still: bool,
    /// The figures charted against time, a chart each. If not given, two of each truth.
    #[serde(default)]
    pub errors: Vec<String>,
    /// The figures charted over each swept key, a chart each.
    #[serde(default = "default_figures")]
    pub figures: Vec<String>,
    #[serde(default)]
    pub time: Time,
    /// The preset of screen-space curved reflections that all settings start from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// The parameters of all settings.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub set: BTreeMap<String, toml::Value>,
    /// The parameters of the still picture that differ from those of the picture that it judges.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub still_set: BTreeMap<String, toml::Value>,
    /// Figures of the plan's own: sums of passes.
    #[serde(default, rename = "part", skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<Part>,
    #[serde(rename = "group")]
    pub groups: Vec<Group>,
}

/// All combinations of scenes, methods and swept values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// The name; `group-1` and so on if not given.
    #[serde(default)]
    pub name: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// What would mend the failure that this group shows.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub mends: String,
    /// The inputs for `glint render`; `{name}` is replaced by the value of the variable `name`.
    pub scenes: Vec<String>,
    #[serde(default = "default_methods")]
    pub methods: Vec<String>,
    /// The figures charted over the swept keys instead of the plan's; only the bound's figure if there is a bound.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub figures: Vec<String>,
    /// Whether to measure how much mirrors flicker in this group, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub flicker: bool,
    /// The preset that the group's settings start from, in place of the plan's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// The times that are charted on top of one another, a column for each setting; a chart for each list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stacked: Vec<Vec<String>>,
    /// How many frames are drawn of each setting before the one that is measured, for what learns from frame to frame.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub frames_before: u32,
    /// Whether all but the first of these frames may do with what frames before them made, as those of the viewer may
    /// while something moves.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub lags: bool,
    /// Which settings to show.
    #[serde(default, skip_serializing_if = "is_none")]
    pub pictures: Pictures,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub set: BTreeMap<String, toml::Value>,
    /// Lists of values, or ranges `{ from, to, count, scale }`. A key without a dot is a variable, except `size`,
    /// `target`, `distance` and `orbit`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sweep: BTreeMap<String, toml::Value>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bound: Option<Bound>,
}

/// The limit of a group's figure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bound {
    pub figure: String,
    /// The methods to which it applies; all if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub methods: Vec<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_least: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_most: Option<f64>,
    /// The least swept value to which it applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<f64>,
    /// The largest swept value to which it applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up_to: Option<f64>,
}

impl Bound {
    /// Whether a value of the figure is within the bound.
    pub fn holds(&self, value: f64) -> bool {
        self.at_least.is_none_or(|least| value >= least) && self.at_most.is_none_or(|most| value <= most)
    }

    /// Whether it applies to a setting.
    pub fn is_about(&self, case: &Case) -> bool {
        let is_of_method = self.methods.is_empty() || self.methods.contains(&case.method);
        let swept = case.swept.first().and_then(|(_, value)| value.parse::<f64>().ok());
        let is_in_range =
            |value: f64| self.from.is_none_or(|from| value >= from) && self.up_to.is_none_or(|up_to| value <= up_to);
        is_of_method && swept.is_none_or(is_in_range)
    }
}

/// One setting of a plan.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The index in the plan, equal in every expansion.
    pub index: usize,
    /// The index of its group.
    pub group: usize,
    /// The scene as in the group, with the names of variables.
    pub scene_pattern: String,
    /// The scene with the variables' values.
    pub scene: String,
    pub method: String,
    pub size: [u32; 2],
    /// The target for which `auto` chooses the settings.
    pub target: Option<PlannedTarget>,
    /// The preset that its parameters start from.
    pub preset: Option<&'static Preset>,
    /// The camera's distance from its pivot, as a share of the scene's own.
    pub distance: f64,
    /// The degrees by which the camera turns from one of the frames before to the next; 0 if it stands still.
    pub orbit: f64,
    /// The swept keys and variables with their values, sorted by key.
    pub swept: Vec<(String, String)>,
    /// The parameters that plan and group set; one list for all settings of a group.
    pub set: Arc<[(String, String)]>,
}

impl Case {
    /// The parameters with which it is drawn; `base` are those of its scene with its preset. The ray tracer starts from a surface
    /// without reflections.
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
        // The case is about this method alone.
        settings.reflection.own_methods = false;
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

/// Whether there are no frames before.
fn is_zero(count: &u32) -> bool {
    *count == 0
}

/// Whether nothing is shown.
fn is_none(pictures: &Pictures) -> bool {
    *pictures == Pictures::None
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

/// The default figures: the place of a reflection and its look.
fn default_errors(truths: &[Truth]) -> Vec<String> {
    let errors = truths.iter().map(|truth| results::truth_name(*truth));
    errors.flat_map(|truth| ["pixel_error_p95", "delta_e"].map(|error| format!("{truth}_{error}"))).collect()
}

fn default_figures() -> Vec<String> {
    ["hit_rate", "coverage", "method_ms"].map(str::to_owned).into()
}

/// The word for every method of the renderer; `auto` is one of them.
const ALL_METHODS: &str = "all";

fn default_methods() -> Vec<String> {
    vec![Method::Auto.name().to_owned()]
}

/// A plan that cannot be read; the error already names the plan.
fn unreadable(place: &str, error: &scene::Error) -> PlanError {
    let problem =
        if let scene::Error::Unreadable { problem, .. } = error { problem.clone() } else { error.to_string() };
    PlanError { place: place.to_owned(), problem }
}

impl Plan {
    /// Reads a plan and checks it. Scenes given by a relative path are relative to the file's folder; addresses stay.
    ///
    /// # Errors
    /// Not readable, or no plan: with the file and line, and what was expected.
    pub fn read(path: &Path) -> Result<Self, PlanError> {
        let place = path.display().to_string();
        let text = scene::whole_file::read(path).map_err(|error| unreadable(&place, &error))?;
        let mut plan = Self::parse(&place, &text)?;
        // Absolute, so that the copy of the plan beside the results still finds the scenes.
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        for scene in plan.groups.iter_mut().flat_map(|group| &mut group.scenes) {
            let beside = folder.join(&*scene);
            let is_beside = !Path::new(scene).is_absolute() && !codec::is_address(Path::new(scene));
            if is_path(scene) && is_beside {
                *scene = beside.canonicalize().unwrap_or(beside).to_string_lossy().into_owned();
            }
        }
        Ok(plan)
    }

    /// Parses a plan; `place` names the text in errors.
    ///
    /// # Errors
    /// Those of [`Plan::read`].
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
        plan.check(place, text)?;
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

    /// Replaces the presets of the plan and its groups.
    pub fn replace_preset(&mut self, preset: &Preset) {
        self.preset = Some(preset.name.to_owned());
        self.groups.iter_mut().for_each(|group| group.preset = None);
    }

    /// Names of the groups that sweep a key.
    pub fn groups_sweeping(&self, key: &str) -> Vec<&str> {
        let sweeping = self.groups.iter().filter(|group| group.sweep.contains_key(key));
        sweeping.map(|group| group.name.as_str()).collect()
    }

    /// The figure of this name: one of the plan's own, or one that any plan has.
    pub fn figure(&self, name: &str) -> Option<Figure> {
        let own = self.parts.iter().find(|part| part.name == name);
        own.map(Part::figure).or_else(|| results::figure(name).cloned())
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
            let preset = group.preset.as_ref().or(self.preset.as_ref());
            let preset = preset.and_then(|name| Preset::named(name).ok());
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
                        let target = swept.iter().find(|(key, _)| key == TARGET);
                        let target = target.and_then(|(_, value)| value.parse().ok());
                        let distance = swept.iter().find(|(key, _)| key == DISTANCE);
                        let distance = distance.and_then(|(_, value)| value.parse().ok()).unwrap_or(1.0);
                        let orbit = swept.iter().find(|(key, _)| key == ORBIT);
                        let orbit = orbit.and_then(|(_, value)| value.parse().ok()).unwrap_or(0.0);
                        cases.push(Case {
                            index: cases.len(),
                            group: index,
                            scene_pattern: scene_pattern.clone(),
                            scene,
                            method: method.clone(),
                            size,
                            target,
                            preset,
                            distance,
                            orbit,
                            swept,
                            set: set.clone(),
                        });
                    }
                }
            }
        }
        cases
    }

    /// The parameters of a scene with those that the plan sets for all groups.
    ///
    /// # Errors
    /// A parameter that does not exist, or a value out of range; plans that were checked have none.
    pub fn base(&self, scene: &Settings) -> Result<Settings, param::Error> {
        let mut settings = scene.clone();
        self.set.iter().try_for_each(|(key, value)| settings.set_text(key, &plain_text(value)))?;
        Ok(settings.drawn())
    }

    /// A setting as its still picture is loaded and drawn: with the plan's own parameters for it, swept or not.
    pub fn of_still(&self, case: &Case) -> Case {
        let is_own = |key: &String| self.still_set.contains_key(key);
        let set = case.set.iter().filter(|(key, _)| !is_own(key)).cloned();
        let own = self.still_set.iter().map(|(key, value)| (key.clone(), plain_text(value)));
        let swept = case.swept.iter().filter(|(key, _)| !is_own(key)).cloned();
        Case { set: set.chain(own).collect(), swept: swept.collect(), ..case.clone() }
    }

    /// Adds scenes to all groups whose scenes have no variables.
    pub fn add_scenes(&mut self, scenes: &[String]) {
        let plain = self.groups.iter_mut().filter(|group| !group.scenes.iter().any(|scene| scene.contains('{')));
        for group in plain {
            let new = scenes.iter().filter(|scene| !group.scenes.contains(scene)).cloned().collect::<Vec<_>>();
            group.scenes.extend(new);
        }
    }

    /// The plan as a file.
    pub fn to_text(&self) -> String {
        toml::to_string(self).unwrap_or_default()
    }
}

/// Whether a scene is named by a path, as opposed to a built-in scene's name.
fn is_path(scene: &str) -> bool {
    let extension = Path::new(scene).extension().and_then(|extension| extension.to_str());
    extension.is_some_and(|extension| {
        codec::Format::all_endings().chain(["toml"]).any(|known| extension.eq_ignore_ascii_case(known))
    })
}

#[cfg(test)]
mod tests;
