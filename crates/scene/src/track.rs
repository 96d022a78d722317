//! Tracks: what changes along a path besides the camera. A track names a parameter, or a value of a mirror, a light, a
//! clip volume or a profile, and says what it is at which time.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::curve::{derivatives, hermite};
use crate::{Object, Settings};

/// The key of the track that moves the lines between states.
pub const WIPE: &str = "wipe";

/// How values and places go from one time to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Ease {
    /// Without a jump in speed, and never beyond a value that was given.
    #[default]
    Smooth,
    /// Evenly from one to the next.
    Linear,
    /// From a stop to a stop.
    InOut,
    /// Not at all: each lasts until the next.
    Hold,
}

impl Ease {
    pub(crate) fn is_smooth(&self) -> bool {
        *self == Self::Smooth
    }
}

/// What one parameter or object does along a path, as `[[paths.tracks]]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Track {
    /// A parameter's key, or `mirrors.NAME.VALUE`, `lights.NUMBER.VALUE`, `clips.NAME.VALUE`,
    /// `profiles.NAME.VALUE`, or `wipe`.
    pub key: String,
    /// Seconds from the beginning of the path, rising.
    pub times: Vec<f64>,
    /// A value for each time.
    pub values: Vec<toml::Value>,
    #[serde(default, skip_serializing_if = "Ease::is_smooth")]
    pub ease: Ease,
}

/// What a track changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle<'a> {
    Parameter(&'a str),
    /// The lines between the states of its path.
    Wipe,
    Object {
        /// The name of its kind: mirror, light, clip or profile.
        kind: &'static str,
        /// The name of the object; a light's number from 1.
        name: &'a str,
        value: &'a str,
    },
}

/// The objects that tracks change: the list in scene files, the name of the kind, and their values with the count of
/// numbers of each. Values of no numbers are switches.
type Values = &'static [(&'static str, usize)];
const KINDS: [(&str, &str, Values); 4] = [
    (
        "mirrors",
        "mirror",
        &[
            ("position", 3),
            ("rotation", 4),
            ("size", 1),
            ("color", 3),
            ("specular_intensity", 1),
            ("specular_power", 1),
            ("refraction", 1),
        ],
    ),
    (
        "lights",
        "light",
        &[("position", 3), ("target", 3), ("intensity", 3), ("inner_degrees", 1), ("outer_degrees", 1)],
    ),
    ("clips", "clip", &[("position", 3), ("rotation", 4), ("size", 3), ("on", 0)]),
    ("profiles", "profile", &[("position", 3), ("width", 1), ("color", 3), ("on", 0)]),
];

impl Track {
    /// What the track changes.
    ///
    /// # Errors
    /// The key names nothing, in words.
    pub fn handle(&self) -> Result<Handle<'_>, String> {
        if self.key == WIPE {
            return Ok(Handle::Wipe);
        }
        let Some((first, rest)) = self.key.split_once('.') else { return Ok(Handle::Parameter(&self.key)) };
        let Some((list, kind, values)) = KINDS.iter().find(|(list, ..)| *list == first) else {
            return Ok(Handle::Parameter(&self.key));
        };
        let names: Vec<&str> = values.iter().map(|(name, _)| *name).collect();
        let expected = format!("expected {list}.NAME.VALUE with a value of {}", names.join(", "));
        let Some((name, value)) = rest.rsplit_once('.') else { return Err(format!("`{}`: {expected}", self.key)) };
        if !names.contains(&value) {
            return Err(format!("`{}`: a {kind} has no `{value}`; {expected}", self.key));
        }
        Ok(Handle::Object { kind, name, value })
    }

    /// Why it is not valid, with the key of what is wrong.
    pub(crate) fn problem(&self) -> Option<(&'static str, String)> {
        let handle = match self.handle() {
            Ok(handle) => handle,
            Err(problem) => return Some(("key", problem)),
        };
        let (times, values) = (self.times.len(), self.values.len());
        if times == 0 {
            return Some(("times", "a track needs at least one time".into()));
        }
        if values != times {
            return Some(("values", format!("{values} values for {times} times")));
        }
        // Comparisons that a NaN fails.
        let is_rising = self.times.windows(2).all(|pair| pair[0] < pair[1]);
        if !(is_rising && self.times[0] >= 0.0 && self.times.iter().all(|time| time.is_finite())) {
            return Some(("times", "expected seconds from 0 on, each more than the one before".into()));
        }
        match handle {
            Handle::Parameter(key) => parameter_problem(key, &self.values),
            // How many lines there are depends on the path.
            Handle::Wipe => {
                let is_share = |share: &f64| (0.0..=1.0).contains(share);
                let is_fine = |value: &&toml::Value| numbers(value).is_some_and(|lines| lines.iter().all(is_share));
                let odd = self.values.iter().find(|value| !is_fine(value))?.to_string();
                Some(("values", format!("{}, expected shares of the width, 0 to 1", param::shortened(&odd, 60))))
            }
            Handle::Object { kind, value, .. } => {
                let counts = KINDS.iter().find(|(_, name, _)| *name == kind).map_or(&[][..], |(.., counts)| counts);
                let count = counts.iter().find(|(name, _)| *name == value).map_or(0, |(_, count)| *count);
                let is_fine = |given: &toml::Value| match count {
                    0 => given.is_bool(),
                    _ => numbers(given).is_some_and(|numbers| numbers.len() == count),
                };
                let expected = match count {
                    0 => "true or false".to_owned(),
                    1 => "a number".to_owned(),
                    count => format!("{count} numbers"),
                };
                let odd = self.values.iter().find(|given| !is_fine(given))?;
                Some(("values", format!("{}, expected {expected} each", param::shortened(&odd.to_string(), 60))))
            }
        }
    }

    /// The values of objects that tracks change, by the name of their kind.
    pub fn values_of(kind: &str) -> impl Iterator<Item = &'static str> {
        KINDS
            .into_iter()
            .filter(move |(_, known, _)| *known == kind)
            .flat_map(|(.., values)| values)
            .map(|(name, _)| *name)
    }

    /// The key of an object's value. `name` is the object's; a light's number from 1.
    pub fn key_of(kind: &str, name: &str, value: &str) -> Option<String> {
        let (list, ..) = KINDS.into_iter().find(|(_, known, _)| *known == kind)?;
        Some(format!("{list}.{name}.{value}"))
    }

    /// What a parameter is now, as a value of a track.
    pub fn value_of_parameter(key: &str, settings: &Settings) -> Option<toml::Value> {
        let (group, name) = key.split_once('.')?;
        let params = settings.groups().into_iter().find(|params| params.group().name == group)?;
        let (field, value) = params.group().fields.iter().zip(params.values()).find(|(field, _)| field.name == name)?;
        let text = field.format(&value);
        Some(match value {
            param::Value::Text(_) | param::Value::Choice(_) => toml::Value::String(text),
            _ => (text.parse().map(toml::Value::Boolean))
                .or_else(|_| text.parse().map(toml::Value::Integer))
                .or_else(|_| text.parse().map(toml::Value::Float))
                .unwrap_or(toml::Value::String(text)),
        })
    }

    /// What a value of an object is now, as a value of a track.
    pub fn value_of_object(name: &str, object: &Object) -> Option<toml::Value> {
        let number = |value: f32| toml::Value::Float(f64::from(value));
        let place = |place: DVec3| list(&place.to_array());
        let color = |color: [f32; 3]| list(&color.map(f64::from));
        Some(match (object, name) {
            (Object::Mirror(mirror), "position") => place(mirror.position),
            (Object::Mirror(mirror), "rotation") => list(&mirror.rotation.to_array()),
            (Object::Mirror(mirror), "size") => toml::Value::Float(mirror.size),
            (Object::Mirror(mirror), "color") => color(mirror.color),
            (Object::Mirror(mirror), "specular_intensity") => number(mirror.specular_intensity),
            (Object::Mirror(mirror), "specular_power") => number(mirror.specular_power),
            (Object::Mirror(mirror), "refraction") => number(mirror.refraction?),
            (Object::Light(light), "position") => place(light.position),
            (Object::Light(light), "target") => place(light.target),
            (Object::Light(light), "intensity") => color(light.intensity),
            (Object::Light(light), "inner_degrees") => number(light.inner_degrees),
            (Object::Light(light), "outer_degrees") => number(light.outer_degrees),
            (Object::Clip(clip), "position") => place(clip.position),
            (Object::Clip(clip), "rotation") => list(&clip.rotation.to_array()),
            (Object::Clip(clip), "size") => place(clip.size),
            (Object::Clip(clip), "on") => toml::Value::Boolean(clip.on),
            (Object::Profile(profile), "position") => place(profile.middle()),
            (Object::Profile(profile), "width") => toml::Value::Float(profile.width),
            (Object::Profile(profile), "color") => color(profile.color),
            (Object::Profile(profile), "on") => toml::Value::Boolean(profile.on),
            _ => return None,
        })
    }

    /// The value at a time: that of the first time before it, and that of the last one after it.
    pub fn value(&self, time: f64) -> toml::Value {
        let next = self.times.partition_point(|known| *known <= time);
        let last = next.saturating_sub(1);
        let (from, to) = (&self.values[last], self.values.get(next));
        let between = to.filter(|_| next > 0 && self.ease != Ease::Hold && self.times[last] < time);
        let (Some(_), Some(start)) = (between, numbers(from)) else { return from.clone() };
        let points: Option<Vec<Vec<f64>>> = self.values.iter().map(numbers).collect();
        let Some(points) = points.filter(|points| points.iter().all(|point| point.len() == start.len())) else {
            return from.clone();
        };
        let span = self.times[next] - self.times[last];
        let share = (time - self.times[last]) / span;
        if matches!(self.handle(), Ok(Handle::Object { value: "rotation", .. })) {
            let [from, to] = [last, next].map(|at| rotation(&points[at]));
            let share = if self.ease == Ease::Linear { share } else { hermite(share)[1] };
            return list(&from.slerp(to, share).to_array());
        }
        let spans: Vec<f64> = self.times.windows(2).map(|ends| ends[1] - ends[0]).collect();
        let component = |index: usize| {
            let [from, to] = [points[last][index], points[next][index]];
            let speeds = match self.ease {
                Ease::Smooth => {
                    let slopes = points.windows(2).zip(&spans);
                    let slopes: Vec<f64> =
                        slopes.map(|(ends, span)| (ends[1][index] - ends[0][index]) / span).collect();
                    let speeds = derivatives(&slopes, &spans, false);
                    [speeds[last], speeds[next]]
                }
                Ease::Linear => [(to - from) / span; 2],
                Ease::InOut | Ease::Hold => [0.0; 2],
            };
            let [start, end, leaving, arriving] = hermite(share);
            from * start + to * end + (speeds[0] * leaving + speeds[1] * arriving) * span
        };
        let values: Vec<f64> = (0..start.len()).map(component).collect();
        if from.is_array() { list(&values) } else { toml::Value::Float(values[0]) }
    }

    /// Sets the parameter that the track changes to its value at a time.
    ///
    /// # Errors
    /// The parameter takes no such value.
    pub fn set_parameter(&self, key: &str, settings: &mut Settings, time: f64) -> Result<(), param::Error> {
        let value = self.value(time);
        let whole = |number: f64| number.round().to_string();
        match (&value, settings.set_text(key, &text(&value))) {
            // Between whole numbers lie others.
            (toml::Value::Float(number), Err(_)) => settings.set_text(key, &whole(*number)),
            (_, result) => result,
        }
    }

    /// Gives an object the value that it has at a time. An object of another kind stays as it is.
    pub fn set_object(&self, name: &str, object: &mut Object, time: f64) {
        let value = self.value(time);
        let numbers = numbers(&value).unwrap_or_default();
        let first = numbers.first().copied().unwrap_or_default();
        let place = || DVec3::from_slice(&numbers);
        let color = || [0, 1, 2].map(|index| numbers[index] as f32);
        match (object, name) {
            (Object::Mirror(mirror), "position") => mirror.position = place(),
            (Object::Mirror(mirror), "rotation") => mirror.rotation = rotation(&numbers),
            (Object::Mirror(mirror), "size") => mirror.size = first,
            (Object::Mirror(mirror), "color") => mirror.color = color(),
            (Object::Mirror(mirror), "specular_intensity") => mirror.specular_intensity = first as f32,
            (Object::Mirror(mirror), "specular_power") => mirror.specular_power = first as f32,
            (Object::Mirror(mirror), "refraction") => mirror.refraction = Some(first as f32),
            (Object::Light(light), "position") => light.position = place(),
            (Object::Light(light), "target") => light.target = place(),
            (Object::Light(light), "intensity") => light.intensity = color(),
            (Object::Light(light), "inner_degrees") => light.inner_degrees = first as f32,
            (Object::Light(light), "outer_degrees") => light.outer_degrees = first as f32,
            (Object::Clip(clip), "position") => clip.position = place(),
            (Object::Clip(clip), "rotation") => clip.rotation = rotation(&numbers),
            (Object::Clip(clip), "size") => clip.size = place(),
            (Object::Clip(clip), "on") => clip.on = value.as_bool().unwrap_or(clip.on),
            (Object::Profile(profile), "position") => {
                let shift = place() - profile.middle();
                profile.line.iter_mut().for_each(|corner| *corner += shift);
            }
            (Object::Profile(profile), "width") => profile.width = first,
            (Object::Profile(profile), "color") => profile.color = color(),
            (Object::Profile(profile), "on") => profile.on = value.as_bool().unwrap_or(profile.on),
            _ => {}
        }
    }
}

/// Why a parameter cannot have these values along a path: `key` or `values`, and the reason.
pub(crate) fn parameter_problem(key: &str, values: &[toml::Value]) -> Option<(&'static str, String)> {
    let mut settings = Settings::default();
    for value in values {
        if let Err(error) = settings.set_text(key, &text(value)) {
            let what = if matches!(error, param::Error::UnknownKey { .. }) { "key" } else { "values" };
            return Some((what, error.to_string()));
        }
    }
    let (group, name) = key.split_once('.')?;
    let groups = settings.groups();
    let fields = groups.iter().filter(|params| params.group().name == group).flat_map(|params| &params.group().fields);
    let is_of_points = fields.into_iter().any(|field| field.name == name && field.affects.points);
    is_of_points
        .then(|| ("key", format!("`{key}` says how points are read, which is done once; it does not change in a path")))
}

/// A value in the form in which `--set` takes it.
pub(crate) fn text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(number) => number.to_string(),
        other => other.to_string(),
    }
}

/// The finite numbers of a value: one, or those of a list.
pub(crate) fn numbers(value: &toml::Value) -> Option<Vec<f64>> {
    let number = |value: &toml::Value| value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64));
    let numbers: Option<Vec<f64>> = match value {
        toml::Value::Array(list) => list.iter().map(number).collect(),
        one => number(one).map(|number| vec![number]),
    };
    numbers.filter(|numbers| numbers.iter().all(|number| number.is_finite()))
}

fn list(numbers: &[f64]) -> toml::Value {
    toml::Value::Array(numbers.iter().copied().map(toml::Value::Float).collect())
}

/// A rotation of any length but zero.
fn rotation(numbers: &[f64]) -> DQuat {
    let turn = DQuat::from_slice(numbers);
    if turn.length() > 0.0 { turn.normalize() } else { DQuat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mirror, Shape, five_mirrors};

    fn track(key: &str, times: &[f64], values: &str, ease: Ease) -> Track {
        let table: toml::Table = toml::from_str(&format!("values = {values}")).unwrap();
        let values = table["values"].as_array().unwrap().clone();
        Track { key: key.into(), times: times.to_vec(), values, ease }
    }

    fn number(track: &Track, time: f64) -> f64 {
        track.value(time).as_float().unwrap_or_else(|| track.value(time).as_integer().unwrap() as f64)
    }

    #[test]
    fn values_are_met_at_their_times_and_never_passed_between_them() {
        let values = [3.0, 4.0, 4.0, 9.0, 1.0, 1.5];
        let times = [0.0, 1.0, 2.0, 2.1, 5.0, 9.0];
        for ease in [Ease::Smooth, Ease::Linear, Ease::InOut, Ease::Hold] {
            let track = track("sun.elevation", &times, &format!("{values:?}"), ease);
            assert_eq!(track.problem(), None);
            for (time, value) in times.iter().zip(values) {
                assert_eq!(number(&track, *time), value, "{ease:?} at {time}");
            }
            for (ends, between) in values.windows(2).zip(times.windows(2)) {
                let at = |step: u32| between[0] + (between[1] - between[0]) * f64::from(step) / 50.0;
                let (low, high) = (ends[0].min(ends[1]) - 1e-9, ends[0].max(ends[1]) + 1e-9);
                assert!((0..50).all(|step| (low..=high).contains(&number(&track, at(step)))), "{ease:?} {ends:?}");
            }
            assert_eq!([number(&track, -1.0), number(&track, 99.0)], [3.0, 1.5]);
            let middle = number(&track, 3.55);
            assert_eq!(middle == 9.0, ease == Ease::Hold, "{middle}");
        }
        let line = track("sun.elevation", &[0.0, 1.0, 3.0], "[1, 2, 4.0]", Ease::Smooth);
        assert!((0..30).all(|step| (number(&line, f64::from(step) * 0.1) - 1.0 - f64::from(step) * 0.1).abs() < 1e-9));
    }

    #[test]
    fn parameters_take_numbers_whole_numbers_names_and_switches() {
        let mut settings = Settings::default();
        let mut set = |key: &str, values: &str, time: f64| {
            let track = track(key, &[0.0, 1.0], values, Ease::Linear);
            assert_eq!(track.problem(), None, "{key}");
            track.set_parameter(key, &mut settings, time).unwrap();
            settings.clone()
        };
        assert_eq!(set("sun.elevation", "[10, 20]", 0.25).sun.elevation, 12.5);
        assert_eq!(set("gi.vpls", "[16, 33]", 0.5).gi.vpls, 25);
        let method = set("reflection.method", "[\"surfel_trace\", \"sscr\"]", 0.99).reflection.method;
        assert_eq!(method, crate::Method::SurfelTrace);
        assert!(!set("splat.back_faces", "[false, true]", 0.5).splat.back_faces);
    }

    #[test]
    fn objects_move_turn_and_change() {
        let mut ball = Object::Mirror(Mirror::standing(Shape::Sphere, DVec3::ZERO, DVec3::Z, DVec3::Z, 1.0));
        let half = |key: &str, values: &str| track(key, &[0.0, 2.0], values, Ease::Linear);
        let place = half("mirrors.a.b.position", "[[0, 0, 0], [2, 4, 6.0]]");
        assert_eq!(place.handle(), Ok(Handle::Object { kind: "mirror", name: "a.b", value: "position" }));
        place.set_object("position", &mut ball, 1.0);
        half("mirrors.a.rotation", "[[0, 0, 0, 1], [0, 0, 1, 0]]").set_object("rotation", &mut ball, 1.0);
        half("mirrors.a.size", "[1, 2]").set_object("size", &mut ball, 1.0);
        let Object::Mirror(mirror) = &ball else { panic!("no mirror") };
        assert_eq!((mirror.position, mirror.size), (DVec3::new(1.0, 2.0, 3.0), 1.5));
        assert!((mirror.rotation * DVec3::X).abs_diff_eq(DVec3::Y, 1e-9) && mirror.rotation.is_normalized());
        let mut light = Object::Light(five_mirrors::light());
        half("lights.1.intensity", "[[0, 0, 0], [2, 4, 6]]").set_object("intensity", &mut light, 0.5);
        let Object::Light(light) = light else { panic!("no light") };
        assert_eq!(light.intensity, [0.5, 1.0, 1.5]);
        let mut slice = Object::Profile(crate::Profile::new(vec![DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0)], 0.5));
        half("profiles.a.position", "[[1, 0, 0], [1, 4, 2]]").set_object("position", &mut slice, 1.0);
        assert_eq!(slice.places()[1..], [DVec3::new(0.0, 2.0, 1.0), DVec3::new(2.0, 2.0, 1.0)]);
    }

    #[test]
    fn what_anything_is_now_is_a_key_that_leaves_it_as_it_is() {
        let settings = Settings::default();
        let mut count = 0;
        for params in settings.groups() {
            let group = params.group();
            for field in group.fields.iter().filter(|field| !field.affects.points) {
                let key = format!("{}.{}", group.name, field.name);
                let value = Track::value_of_parameter(&key, &settings).unwrap();
                let track = Track { key: key.clone(), times: vec![1.0], values: vec![value], ease: Ease::Hold };
                assert_eq!(track.problem(), None, "{key}");
                let mut changed = settings.clone();
                track.set_parameter(&key, &mut changed, 0.0).unwrap();
                assert_eq!(changed, settings, "{key}");
                count += 1;
            }
        }
        assert!(count > 100, "{count}");
        let mirror =
            Mirror { refraction: Some(1.5), ..Mirror::standing(Shape::Sphere, DVec3::ONE, DVec3::X, DVec3::Z, 0.3) };
        let clip = crate::Clip::around(crate::ClipShape::Box, cloud::Bounds { min: DVec3::ZERO, max: DVec3::ONE });
        let profile = crate::Profile::new(vec![DVec3::ZERO, DVec3::new(0.1, 0.7, -3.0), DVec3::ONE], 0.5);
        let others = [Object::Clip(clip), Object::Profile(profile)];
        for object in [Object::Mirror(mirror), Object::Light(five_mirrors::light())].into_iter().chain(others) {
            let kind = object.kind().name;
            for name in Track::values_of(kind) {
                let (key, value) = (Track::key_of(kind, "a", name).unwrap(), Track::value_of_object(name, &object));
                let value = value.unwrap_or_else(|| panic!("{key}"));
                let track = Track { key, times: vec![1.0], values: vec![value], ease: Ease::Hold };
                assert_eq!(track.problem(), None, "{}", track.key);
                let mut changed = object.clone();
                track.set_object(name, &mut changed, 0.0);
                assert_eq!(changed, object, "{}", track.key);
            }
        }
    }

    #[test]
    fn what_is_no_track_is_refused_by_key() {
        let problem = |key: &str, times: &[f64], values: &str| {
            let (what, problem) = track(key, times, values, Ease::Smooth).problem().unwrap();
            format!("{what}: {problem}")
        };
        assert!(problem("sun.elevatio", &[0.0], "[1]").starts_with("key: sun.elevatio"));
        assert!(problem("sun.elevation", &[0.0], "[1000]").starts_with("values: sun.elevation"));
        for key in ["scene.points", "surface.neighbours", "stream.cache_bytes"] {
            assert!(problem(key, &[0.0], "[1000000000]").contains(key), "{key}");
        }
        assert!(problem("scene.points", &[0.0], "[1000]").contains("is done once"));
        let followed = [("view.point_budget", "[200000]"), ("stream.detail", "[2.0]"), ("stream.overlay", "[true]")];
        for (key, values) in followed {
            assert_eq!(track(key, &[0.0], values, Ease::Smooth).problem(), None, "{key} is followed at once");
        }
        assert!(problem("mirrors.ball", &[0.0], "[1]").starts_with("key: `mirrors.ball`: expected mirrors.NAME.VALUE"));
        assert!(problem("mirrors.ball.shape", &[0.0], "[1]").contains("a mirror has no `shape`"));
        assert!(problem("mirrors.ball.position", &[0.0], "[[1, 2]]").contains("expected 3 numbers each"));
        assert!(problem("mirrors.ball.size", &[0.0], "[nan]").contains("expected a number each"));
        assert!(problem("clips.room.on", &[0.0], "[1]").contains("expected true or false each"));
        assert!(problem("sun.elevation", &[], "[]").starts_with("times: "));
        assert!(problem("sun.elevation", &[0.0, 1.0], "[1]").contains("1 values for 2 times"));
        for times in [[0.0, 0.0], [-1.0, 0.0], [0.0, f64::NAN], [1.0, f64::INFINITY]] {
            assert!(problem("sun.elevation", &times, "[1, 2]").starts_with("times: expected seconds"), "{times:?}");
        }
    }
}
