//! The table of a parameter group, and everything that is derived from it: parsing, printing, checking, WGSL.

use std::fmt::Write as _;

use crate::{Bytes, Color, Value};

/// The type of a field, with its default and its range.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    Bool { default: bool },
    U32 { default: u32, min: u32, max: u32 },
    F32 { default: f32, min: f32, max: f32 },
    Choice { default: u32, names: &'static [&'static str] },
    Color { default: Color },
    Bytes { default: Bytes, min: Bytes, max: Bytes },
    Text { default: String },
}

/// One parameter.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// The unit; empty for a pure number or a choice.
    pub unit: &'static str,
    pub kind: Kind,
    pub affects: Affects,
    pub uses: Uses,
}

/// What a change of a parameter makes out of date.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Affects {
    /// The points that are read, sampled and estimated before anything is drawn.
    pub points: bool,
    /// The surfaces that points make in the picture.
    pub surface: bool,
    /// What mirrors show of them; every parameter that affects surfaces affects this, too.
    pub found: bool,
    /// The light on them.
    pub shading: bool,
    /// The final display of the picture.
    pub view: bool,
    /// The ray-traced truth of a view.
    pub truth: bool,
}

/// The uses of a parameter besides setting it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Uses {
    /// Whether it is a preference of the person and kept from run to run; otherwise it belongs to the open data.
    pub kept: bool,
    /// Whether other values of it can be seen in the current view.
    pub swept: bool,
}

impl Default for Uses {
    fn default() -> Self {
        Self { kept: true, swept: true }
    }
}

/// A group of parameters: `group.name` is a parameter's key.
#[derive(Clone, Debug)]
pub struct Group {
    pub name: &'static str,
    pub help: &'static str,
    /// The title of the panel section that shows the group.
    pub section: &'static str,
    pub fields: Vec<Field>,
}

/// A wrong key or value that a person gave.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    #[error("{key}: {problem}")]
    Value { key: String, problem: String },
    #[error("{key}: no such parameter{hint}")]
    UnknownKey { key: String, hint: String },
}

impl Field {
    pub fn default(&self) -> Value {
        match &self.kind {
            Kind::Bool { default } => Value::Bool(*default),
            Kind::U32 { default, .. } => Value::U32(*default),
            Kind::F32 { default, .. } => Value::F32(*default),
            Kind::Choice { default, .. } => Value::Choice(*default),
            Kind::Color { default } => Value::Color(*default),
            Kind::Bytes { default, .. } => Value::Bytes(*default),
            Kind::Text { default } => Value::Text(default.clone()),
        }
    }

    /// Whether pictures with several of its values can be compared side by side.
    pub fn can_be_swept(&self) -> bool {
        self.uses.swept && !matches!(self.kind, Kind::Color { .. } | Kind::Bytes { .. } | Kind::Text { .. })
    }

    /// The allowed values as a person reads them: `0.1 to 10 m`, `fast, best`, `on, off`.
    pub fn range_text(&self) -> String {
        let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
        match &self.kind {
            Kind::Bool { .. } => "true, false".into(),
            Kind::U32 { min, max, .. } => format!("{min} to {max}{unit}"),
            Kind::F32 { min, max, .. } => format!("{min} to {max}{unit}"),
            Kind::Choice { names, .. } => names.join(", "),
            Kind::Color { .. } => "#rrggbb".into(),
            Kind::Bytes { min, max, .. } => format!("{min} to {max}"),
            Kind::Text { .. } => "text".into(),
        }
    }

    /// The value in the form that `parse` reads.
    pub fn format(&self, value: &Value) -> String {
        match (value, &self.kind) {
            (Value::Bool(value), _) => value.to_string(),
            (Value::U32(value), _) => value.to_string(),
            (Value::F32(value), _) => value.to_string(),
            (Value::Choice(index), Kind::Choice { names, .. }) => {
                names.get(*index as usize).copied().unwrap_or_default().to_string()
            }
            (Value::Choice(index), _) => index.to_string(),
            (Value::Color(color), _) => {
                let [red, green, blue, _] = color.bytes();
                format!("#{red:02x}{green:02x}{blue:02x}")
            }
            (Value::Bytes(bytes), _) => bytes.to_string(),
            (Value::Text(text), _) => text.clone(),
        }
    }

    /// Reads a value.
    ///
    /// # Errors
    /// What is wrong with `text` and what was expected, without the key.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        let (expected, quoted) = (self.range_text(), shortened(text, MOST_QUOTED));
        let value = match &self.kind {
            Kind::Bool { .. } => match text {
                "true" | "on" | "yes" | "1" => Value::Bool(true),
                "false" | "off" | "no" | "0" => Value::Bool(false),
                _ => return Err(format!("`{quoted}` is none of {expected}")),
            },
            Kind::U32 { .. } => {
                Value::U32(text.parse().map_err(|_| format!("`{quoted}` is not a whole number, expected {expected}"))?)
            }
            Kind::F32 { .. } => {
                Value::F32(text.parse().map_err(|_| format!("`{quoted}` is not a number, expected {expected}"))?)
            }
            Kind::Choice { names, .. } => {
                let index = names.iter().position(|name| *name == text);
                Value::Choice(index.ok_or_else(|| format!("`{quoted}` is none of {expected}"))? as u32)
            }
            Kind::Color { .. } => {
                let digits = text.strip_prefix('#').unwrap_or(text);
                let rgb = (digits.len() == 6).then(|| u32::from_str_radix(digits, 16).ok()).flatten();
                Value::Color(Color(
                    rgb.ok_or_else(|| format!("`{quoted}` is not a colour, expected {expected}"))? << 8 | 0xff,
                ))
            }
            Kind::Bytes { .. } => Value::Bytes(
                text.parse().map_err(|()| format!("`{quoted}` is not an amount like 512MiB, expected {expected}"))?,
            ),
            Kind::Text { .. } => Value::Text(text.to_string()),
        };
        self.check(&value)?;
        Ok(value)
    }

    /// Checks a value.
    ///
    /// # Errors
    /// If the value is of another type or out of range.
    pub fn check(&self, value: &Value) -> Result<(), String> {
        let fits = match (&self.kind, value) {
            (Kind::U32 { min, max, .. }, Value::U32(value)) => (min..=max).contains(&value),
            (Kind::F32 { min, max, .. }, Value::F32(value)) => (min..=max).contains(&value),
            (Kind::Bytes { min, max, .. }, Value::Bytes(value)) => (min..=max).contains(&value),
            (Kind::Choice { names, .. }, Value::Choice(index)) => (*index as usize) < names.len(),
            (Kind::Bool { .. }, Value::Bool(_))
            | (Kind::Color { .. }, Value::Color(_))
            | (Kind::Text { .. }, Value::Text(_)) => true,
            _ => return Err(format!("wrong type, expected {}", self.range_text())),
        };
        if fits {
            Ok(())
        } else {
            Err(format!("{} is out of range, expected {}", self.format(value), self.range_text()))
        }
    }

    /// Whether a slider for the field is logarithmic: its range spans three decades or more, or begins at 0 with a
    /// default so near to it that a linear slider would leave no room below.
    pub fn is_logarithmic(&self) -> bool {
        match self.kind {
            Kind::F32 { min: 0.0, max, default } => default > 0.0 && max / default >= 32.0,
            Kind::F32 { min, max, .. } => min > 0.0 && max / min >= 1000.0,
            Kind::U32 { min, max, .. } => min > 0 && max / min >= 1000,
            Kind::Bytes { .. } => true,
            _ => false,
        }
    }
}

impl Group {
    /// The group as a WGSL struct of 4-byte scalars (so Rust words and WGSL offsets agree by construction), with a
    /// constant for each choice. Text and amounts of memory stay on the CPU.
    pub fn wgsl(&self) -> String {
        let mut wgsl = String::new();
        let mut constants = String::new();
        let _ = writeln!(wgsl, "// {}\nstruct {} {{", self.help, capitalized(self.name));
        for field in &self.fields {
            let scalar = match &field.kind {
                Kind::Text { .. } | Kind::Bytes { .. } => continue,
                Kind::F32 { .. } => "f32",
                _ => "u32",
            };
            let _ = writeln!(wgsl, "    {}: {scalar},", field.name);
            if let Kind::Choice { names, .. } = &field.kind {
                for (index, name) in names.iter().enumerate() {
                    let constant = format!("{}_{}_{}", self.name, field.name, name).to_uppercase().replace('-', "_");
                    let _ = writeln!(constants, "const {constant}: u32 = {index}u;");
                }
            }
        }
        wgsl + "}\n" + &constants
    }
}

fn capitalized(name: &str) -> String {
    name.split('_').map(|word| word[..1].to_uppercase() + &word[1..]).collect()
}

/// A group of parameters with values: the interface of the `params!` structs.
pub trait Params {
    fn group(&self) -> &'static Group;
    /// The values in the order of the table.
    fn values(&self) -> Vec<Value>;
    /// Sets all values, in the order of the table; the caller has checked them (`set`, `set_text`).
    fn set_values(&mut self, values: &[Value]);

    /// Sets one parameter.
    ///
    /// # Errors
    /// Unknown name, wrong type, out of range.
    fn set(&mut self, name: &str, value: Value) -> Result<(), Error> {
        let group = self.group();
        let index = index_of(group, name)?;
        let key = || format!("{}.{name}", group.name);
        group.fields[index].check(&value).map_err(|problem| Error::Value { key: key(), problem })?;
        let mut values = self.values();
        values[index] = value;
        self.set_values(&values);
        Ok(())
    }

    /// Sets one parameter from text.
    ///
    /// # Errors
    /// Unknown name, not parsable, out of range.
    fn set_text(&mut self, name: &str, text: &str) -> Result<(), Error> {
        let group = self.group();
        let field = &group.fields[index_of(group, name)?];
        let value =
            field.parse(text).map_err(|problem| Error::Value { key: format!("{}.{name}", group.name), problem })?;
        self.set(name, value)
    }

    /// The values for the GPU: one 4-byte word a field, without text and amounts of memory. The caller pads it.
    fn words(&self) -> Vec<u32> {
        let word = |value: Value| match value {
            Value::Bool(value) => Some(u32::from(value)),
            Value::U32(value) | Value::Choice(value) => Some(value),
            Value::F32(value) => Some(value.to_bits()),
            Value::Color(color) => Some(color.0),
            Value::Text(_) | Value::Bytes(_) => None,
        };
        self.values().into_iter().filter_map(word).collect()
    }
}

fn index_of(group: &Group, name: &str) -> Result<usize, Error> {
    group.fields.iter().position(|field| field.name == name).ok_or_else(|| {
        let hint = nearest(name, group.fields.iter().map(|field| field.name));
        Error::UnknownKey {
            key: shortened(&format!("{}.{name}", group.name), MOST_QUOTED),
            hint: hint.map_or(String::new(), |near| format!("; did you mean `{}.{near}`?", group.name)),
        }
    })
}

/// The keys and values that differ from the defaults, as a session file and a command line need them.
pub fn differing(params: &dyn Params) -> Vec<(String, Value)> {
    let group = params.group();
    let pairs = group.fields.iter().zip(params.values());
    let differing = pairs.filter(|(field, value)| field.default() != *value);
    differing.map(|(field, value)| (format!("{}.{}", group.name, field.name), value)).collect()
}

/// The most characters that a message quotes of its input: enough to find the place again.
pub const MOST_QUOTED: usize = 80;

/// `text` if it is short enough, else its two ends, with `most` characters in all.
pub fn shortened(text: &str, most: usize) -> String {
    let count = text.chars().count();
    if count <= most {
        return text.to_owned();
    }
    let kept = most.saturating_sub(3);
    let (head, tail) = (kept.div_ceil(3) * 2, kept / 3);
    let head: String = text.chars().take(head.min(kept)).collect();
    let tail: String = text.chars().skip(count - tail).collect();
    format!("{head}...{tail}")
}

/// The first few of many messages of one kind, and the number of the others; `what` names the kind.
pub fn few(mut messages: Vec<String>, what: &str) -> Vec<String> {
    const FEW: usize = 3;
    // One more message takes no more room than the line with the number.
    if messages.len() > FEW + 1 {
        let untold = messages.len() - FEW;
        messages.truncate(FEW);
        messages.push(format!("and {untold} more {what}"));
    }
    messages
}

/// What may stand in place of a word that is none of the known ones: the nearest, if one is near, and those that there
/// are, as far as a message has room for them.
pub fn instead<'a>(word: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    const MOST: usize = 48;
    let hint = nearest(word, known.clone()).map_or(String::new(), |near| format!("did you mean `{near}`? "));
    let names: Vec<&str> = known.clone().take(MOST).collect();
    let more = match known.count() - names.len() {
        0 => String::new(),
        more => format!(", and {more} more"),
    };
    if names.is_empty() { "there is none".into() } else { format!("{hint}Known: {}{more}", names.join(", ")) }
}

/// The candidate that a person most likely meant, if one is within a third of the word's letters (edit distance). Capitals
/// count as small letters.
pub fn nearest<'a>(word: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let distance = |other: &str| {
        let other: Vec<char> = other.chars().collect();
        let mut row: Vec<usize> = (0..=other.len()).collect();
        for (i, a) in word.chars().enumerate() {
            let mut diagonal = row[0];
            row[0] = i + 1;
            for (j, b) in other.iter().enumerate() {
                let substituted = diagonal + usize::from(!a.to_lowercase().eq(b.to_lowercase()));
                diagonal = row[j + 1];
                row[j + 1] = substituted.min(row[j] + 1).min(row[j + 1] + 1);
            }
        }
        row[other.len()]
    };
    let length = word.chars().count();
    let limit = length.div_ceil(3);
    candidates
        .filter(|other| other.chars().count().abs_diff(length) <= limit)
        .map(|other| (distance(other), other))
        .filter(|(distance, _)| *distance <= limit)
        .min()
        .map(|(_, other)| other)
}
