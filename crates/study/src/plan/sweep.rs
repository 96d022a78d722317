//! The values that a group sweeps, and the scenes that contain them.

use param::Kind;
use scene::Settings;
use serde::Deserialize;

/// Evenly spaced values, or values of equal ratios.
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

/// The value in the form that `--set` takes.
pub(super) fn scalar_text(value: &toml::Value) -> Option<String> {
    match value {
        toml::Value::String(text) => Some(text.clone()),
        toml::Value::Integer(number) => Some(number.to_string()),
        toml::Value::Float(number) => Some(number.to_string()),
        toml::Value::Boolean(switch) => Some(switch.to_string()),
        _ => None,
    }
}

pub(super) fn plain_text(value: &toml::Value) -> String {
    scalar_text(value).unwrap_or_default()
}

/// The number of values, without making them.
pub(super) fn sweep_length(sweep: &toml::Value) -> Result<usize, String> {
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

/// The values of a list or range, as text. They are whole numbers if the parameter is one.
pub(super) fn swept_values(key: &str, sweep: &toml::Value) -> Result<Vec<String>, String> {
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

/// A number with 4 significant digits, which is finer than any chart shows.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The texts of a scene between the names of variables: each name precedes its text, none precedes the first.
pub(super) fn parts(scene: &str) -> impl Iterator<Item = (Option<&str>, &str)> {
    let (first, rest) = scene.split_once('{').map_or((scene, None), |(first, rest)| (first, Some(rest)));
    let named = rest.into_iter().flat_map(|rest| rest.split('{'));
    let named = named.map(|part| part.split_once('}').map_or((Some(part), ""), |(name, text)| (Some(name), text)));
    std::iter::once((None, first)).chain(named)
}

/// A scene with the values of variables in place of their names. The content of a value is not replaced again.
pub(super) fn filled(scene: &str, swept: &[(String, String)]) -> String {
    let mut filled = String::new();
    for (name, text) in parts(scene) {
        let value = name.and_then(|name| swept.iter().find(|(key, _)| key == name));
        filled += value.map_or("", |(_, value)| value);
        filled += text;
    }
    filled
}

/// The length in bytes of a scene with values of these lengths.
pub(super) fn filled_length(scene: &str, lengths: &[(&str, usize)]) -> usize {
    parts(scene).fold(0, |total, (name, text)| {
        let value = name.and_then(|name| lengths.iter().find(|(key, _)| *key == name));
        total.saturating_add(value.map_or(0, |(_, length)| *length)).saturating_add(text.len())
    })
}
