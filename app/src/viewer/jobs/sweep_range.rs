//! The values that a sweep gives to one parameter.

use param::{Field, Kind, Value};
use scene::Settings;

use crate::shared::language::text;

/// The most values of a sweep: more do not fit a sheet and take longer than a person waits.
pub const MOST_VALUES: u32 = 64;

/// The parameter and the range of a sweep that is being set up.
#[derive(Clone, Debug)]
pub struct SweepRange {
    pub key: String,
    pub field: Field,
    /// The ends of the range, for numbers.
    pub from: f64,
    pub to: f64,
    pub count: u32,
    pub is_logarithmic: bool,
}

impl SweepRange {
    /// The range of a parameter; `None` if the parameter cannot be swept.
    pub fn of(settings: &Settings, key: &str) -> Option<Self> {
        let (group, name) = key.split_once('.')?;
        let group = settings.groups().into_iter().map(param::Params::group).find(|known| known.name == group)?;
        let field = group.fields.iter().find(|field| field.name == name && field.can_be_swept())?;
        Some(Self::new(key, field))
    }

    fn new(key: &str, field: &Field) -> Self {
        let (from, to, is_logarithmic) = match field.kind {
            // The range is that of the parameter's slider. A logarithmic slider that begins at 0 covers four decades.
            Kind::F32 { min, max, .. } => {
                let least = if field.is_logarithmic() && min == 0.0 { max * 1e-4 } else { min };
                (f64::from(least), f64::from(max), field.is_logarithmic())
            }
            // A parameter without an upper limit, such as a seed, takes its first six values.
            Kind::U32 { min, max: u32::MAX, .. } => (f64::from(min), f64::from(min) + 5.0, false),
            Kind::U32 { min, max, .. } => (f64::from(min), f64::from(max), field.is_logarithmic()),
            _ => (0.0, 0.0, false),
        };
        Self { key: key.into(), field: field.clone(), from, to, count: 6, is_logarithmic }
    }

    pub fn is_number(&self) -> bool {
        matches!(self.field.kind, Kind::F32 { .. } | Kind::U32 { .. })
    }

    /// The values as text, each once, in order.
    pub fn values(&self) -> Result<Vec<String>, String> {
        let number = |share: f64| match self.is_logarithmic {
            true => self.from * (self.to / self.from).powf(share),
            false => self.from + (self.to - self.from) * share,
        };
        let shares = (0..self.count).map(|index| f64::from(index) / f64::from(self.count.max(2) - 1));
        let values: Vec<Value> = match self.field.kind {
            Kind::Bool { .. } => vec![Value::Bool(false), Value::Bool(true)],
            Kind::Choice { names, .. } => (0..names.len() as u32).map(Value::Choice).collect(),
            _ if self.is_logarithmic && !(self.from > 0.0 && self.to > 0.0) => {
                return Err(text!("a logarithmic sweep needs ends above 0").into());
            }
            Kind::U32 { .. } => shares.map(|share| Value::U32(number(share).round() as u32)).collect(),
            Kind::F32 { min, max, .. } => {
                // Four digits are enough to read, unless rounding leaves the range.
                let rounded = |exact: f64| format!("{exact:.3e}").parse().unwrap_or(exact as f32);
                let within = |exact: f64| Some(rounded(exact)).filter(|value| (min..=max).contains(value));
                shares.map(number).map(|exact| Value::F32(within(exact).unwrap_or(exact as f32))).collect()
            }
            Kind::Color { .. } | Kind::Bytes { .. } | Kind::Text { .. } => Vec::new(),
        };
        values.iter().try_for_each(|value| self.field.check(value))?;
        let mut texts: Vec<String> = values.iter().map(|value| self.field.format(value)).collect();
        texts.dedup();
        Ok(texts)
    }
}

/// Two fields are equal if their keys are.
impl PartialEq for SweepRange {
    fn eq(&self, other: &Self) -> bool {
        let ends = |range: &Self| (range.from, range.to, range.count, range.is_logarithmic);
        self.key == other.key && ends(self) == ends(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(key: &str) -> SweepRange {
        let settings = Settings::default();
        SweepRange::of(&settings, key).unwrap()
    }

    #[test]
    fn values_are_spread_as_the_slider_is_and_within_the_range() {
        let mut step = range("sscr.initial_step");
        (step.from, step.to, step.count, step.is_logarithmic) = (0.02, 0.5, 3, true);
        let values = step.values().unwrap();
        assert_eq!((values.len(), values[0].as_str(), values[2].as_str()), (3, "0.02", "0.5"));
        assert!((values[1].parse::<f64>().unwrap() - 0.1).abs() < 1e-6, "{values:?}");
        let mut attempts = range("sscr.seed_attempts");
        (attempts.from, attempts.to, attempts.count, attempts.is_logarithmic) = (0.0, 2.0, 6, false);
        assert_eq!(attempts.values().unwrap(), ["0", "1", "2"]);
        attempts.to = 1e9;
        assert!(attempts.values().is_err());
        step.from = 0.0;
        assert!(step.values().is_err(), "no ratio leads to 0");
        assert_eq!(range("sscr.cull_points").values().unwrap(), ["false", "true"]);
    }
}
