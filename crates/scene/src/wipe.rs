//! The states of a wipe: the pictures of a path show two or three of them side by side, divided by upright lines that
//! move (`path_wipe.rs`). All have the path's camera and points, and differ in parameters.

use std::collections::BTreeMap;

use param::Choice as _;
use serde::{Deserialize, Serialize};

use crate::track::{WIPE, numbers, parameter_problem, text};
use crate::{METHODS, Method, RAY_TRACE, Settings, Track};

/// The most states side by side: more leave each too little of the picture.
pub const MOST_STATES: usize = 3;
/// The most characters of a name, which has one line.
const MOST_LETTERS: usize = 100;
/// A limit above the number of parameters.
const MOST_PARAMETERS: usize = 1000;
/// The parameter that `method` sets.
const METHOD_KEY: &str = "reflection.method";

/// What a part of the picture is drawn with, as `[[paths.states]]`, from left to right.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WipeState {
    /// What is written over its part of the picture; nothing if it is empty.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// A reflection method, or `ray_trace`: the mirrors show what the ray tracer finds. `None` for the path's method.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Parameters that it has instead of those of the path.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, toml::Value>,
}

/// The lines and the names of a wipe, as they are drawn over a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WipeMarks {
    /// Where the lines stand, from the left to the right, as shares of the picture's width.
    pub lines: Vec<f64>,
    /// The names of the states: one more than there are lines.
    pub names: Vec<String>,
}

impl WipeState {
    /// The state in which the mirrors are drawn by a method, with its name.
    pub fn of_method(method: &str) -> Self {
        Self { name: method.into(), method: Some(method.into()), ..Self::default() }
    }

    /// Whether the ray tracer finds what the mirrors show.
    pub fn is_traced(&self) -> bool {
        self.method.as_deref() == Some(RAY_TRACE)
    }

    /// Gives the settings of the path the values of this state. A traced state is drawn without reflections, which the
    /// ray tracer adds.
    ///
    /// # Errors
    /// A parameter takes no such value, which no state of a scene file has.
    pub fn apply(&self, settings: &mut Settings) -> Result<(), param::Error> {
        for (key, value) in &self.parameters {
            settings.set_text(key, &text(value))?;
        }
        match self.method.as_deref() {
            Some(RAY_TRACE) => settings.reflection.method = Method::None,
            Some(method) => {
                settings.set_text(METHOD_KEY, method)?;
                settings.reflection.own_methods = false;
            }
            None => {}
        }
        Ok(())
    }

    /// Why it is not valid, with the key of what is wrong.
    pub(crate) fn problem(&self) -> Option<(&'static str, String)> {
        let letters = self.name.chars().count();
        if letters > MOST_LETTERS || self.name.contains('\n') {
            return Some(("name", format!("expected one line of at most {MOST_LETTERS} characters")));
        }
        if let Some(method) = self.method.as_deref().filter(|method| *method != RAY_TRACE)
            && Method::from_name(method).is_none()
        {
            let known = METHODS.iter().map(|row| row.name).collect::<Vec<_>>().join(", ");
            let method = param::shortened(method, param::MOST_QUOTED);
            return Some(("method", format!("`{method}` is unknown; available: {known}, {RAY_TRACE}")));
        }
        if self.parameters.len() > MOST_PARAMETERS {
            return Some(("parameters", format!("{}, expected at most {MOST_PARAMETERS}", self.parameters.len())));
        }
        if self.parameters.contains_key(METHOD_KEY) {
            return Some(("parameters", format!("`{METHOD_KEY}` stands in `method`")));
        }
        let mut odd =
            self.parameters.iter().filter_map(|(key, value)| parameter_problem(key, std::slice::from_ref(value)));
        odd.next().map(|(_, problem)| ("parameters", problem))
    }
}

/// A list of a path and a number in it; `None` for the path as a whole.
type Place = Option<(&'static str, usize)>;

/// Why the states of a path, or the track that moves the lines between them, are not valid: where, the key of what is
/// wrong, and the reason.
pub(crate) fn problem(states: &[WipeState], tracks: &[Track]) -> Option<(Place, &'static str, String)> {
    let count = states.len();
    if count == 1 || count > MOST_STATES {
        return Some((None, "states", format!("{count}, expected two or three, or none")));
    }
    let of_state = |(index, state): (usize, &WipeState)| {
        let (key, problem) = state.problem()?;
        Some((Some(("states", index)), key, problem))
    };
    let of_track = |(index, track): (usize, &Track)| {
        let odd = |key, problem| Some((Some(("tracks", index)), key, problem));
        if track.key != WIPE {
            return None;
        }
        if count == 0 {
            return odd("key", format!("`{WIPE}` divides states, and the path has none"));
        }
        let is_fine = |value: &toml::Value| numbers(value).is_some_and(|lines| lines.len() == count - 1);
        let value = track.values.iter().find(|value| !is_fine(value))?.to_string();
        let (value, expected) = (param::shortened(&value, 60), if count == 2 { "a number" } else { "two numbers" });
        odd("values", format!("{value}, expected {expected} each for {count} states"))
    };
    states.iter().enumerate().find_map(of_state).or_else(|| tracks.iter().enumerate().find_map(of_track))
}
