//! The values of parameters, and the Rust types that represent them.

use std::ops::RangeInclusive;

use crate::Kind;

/// A parameter's value, whatever its type.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    Bool(bool),
    U32(u32),
    F32(f32),
    /// The index in the names of the choice.
    Choice(u32),
    Color(Color),
    Bytes(Bytes),
    Text(String),
}

/// An sRGB colour, `0xrrggbbaa`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Color(pub u32);

impl Color {
    /// Red, green, blue and opacity, each 0 to 255, in sRGB.
    pub fn bytes(self) -> [u8; 4] {
        self.0.to_be_bytes()
    }

    pub fn from_bytes(bytes: [u8; 4]) -> Self {
        Self(u32::from_be_bytes(bytes))
    }
}

/// An amount of memory or disk space. People read and write it in binary units: `512MiB`, `1.5 GiB`, or a plain number
/// of bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bytes(pub u64);

/// The names of the powers of 1024, from 0.
const BINARY_UNITS: [&str; 7] = ["B", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"];

impl std::fmt::Display for Bytes {
    /// Writes the amount in the largest unit that leaves a whole number.
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let power = if self.0 == 0 { 0 } else { self.0.trailing_zeros() / 10 };
        write!(formatter, "{}{}", self.0 >> (10 * power), BINARY_UNITS[power as usize])
    }
}

impl std::str::FromStr for Bytes {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let text = text.trim();
        let (number, unit) = text.split_at(text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len()));
        let unit = unit.trim();
        let power = BINARY_UNITS.iter().position(|known| known.eq_ignore_ascii_case(unit));
        let power = if unit.is_empty() { 0 } else { power.ok_or(())? };
        let (number, scale) = (number.trim(), 1_u64 << (10 * power));
        if let Ok(whole) = number.parse::<u64>() {
            return whole.checked_mul(scale).map(Self).ok_or(());
        }
        let bytes = number.parse::<f64>().map_err(|_| ())? * scale as f64;
        if (0.0..u64::MAX as f64).contains(&bytes) { Ok(Self(bytes.round() as u64)) } else { Err(()) }
    }
}

/// A Rust type that a field of a `params!` block may have.
pub trait Type: Sized {
    fn kind(default: Self, range: Option<RangeInclusive<Self>>) -> Kind;
    fn to_value(&self) -> Value;
    fn from_value(value: &Value) -> Option<Self>;
}

/// An enum made by `choices!`.
pub trait Choice: Copy {
    const NAMES: &'static [&'static str];
    fn index(self) -> u32;
    fn from_index(index: u32) -> Option<Self>;
    fn name(self) -> &'static str {
        Self::NAMES[self.index() as usize]
    }
    fn from_name(name: &str) -> Option<Self> {
        Self::from_index(Self::NAMES.iter().position(|known| *known == name)? as u32)
    }
    /// All choices, in order.
    fn all() -> impl Iterator<Item = Self> {
        (0..Self::NAMES.len() as u32).filter_map(Self::from_index)
    }
}

impl Type for bool {
    fn kind(default: Self, _: Option<RangeInclusive<Self>>) -> Kind {
        Kind::Bool { default }
    }
    fn to_value(&self) -> Value {
        Value::Bool(*self)
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::Bool(value) = value { Some(*value) } else { None }
    }
}

impl Type for u32 {
    fn kind(default: Self, range: Option<RangeInclusive<Self>>) -> Kind {
        let range = range.unwrap_or(0..=u32::MAX);
        Kind::U32 { default, min: *range.start(), max: *range.end() }
    }
    fn to_value(&self) -> Value {
        Value::U32(*self)
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::U32(value) = value { Some(*value) } else { None }
    }
}

impl Type for f32 {
    fn kind(default: Self, range: Option<RangeInclusive<Self>>) -> Kind {
        let range = range.unwrap_or(f32::MIN..=f32::MAX);
        Kind::F32 { default, min: *range.start(), max: *range.end() }
    }
    fn to_value(&self) -> Value {
        Value::F32(*self)
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::F32(value) = value { Some(*value) } else { None }
    }
}

impl Type for Color {
    fn kind(default: Self, _: Option<RangeInclusive<Self>>) -> Kind {
        Kind::Color { default }
    }
    fn to_value(&self) -> Value {
        Value::Color(*self)
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::Color(value) = value { Some(*value) } else { None }
    }
}

impl Type for Bytes {
    fn kind(default: Self, range: Option<RangeInclusive<Self>>) -> Kind {
        let range = range.unwrap_or(Self(0)..=Self(u64::MAX));
        Kind::Bytes { default, min: *range.start(), max: *range.end() }
    }
    fn to_value(&self) -> Value {
        Value::Bytes(*self)
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::Bytes(value) = value { Some(*value) } else { None }
    }
}

impl Type for String {
    fn kind(default: Self, _: Option<RangeInclusive<Self>>) -> Kind {
        Kind::Text { default }
    }
    fn to_value(&self) -> Value {
        Value::Text(self.clone())
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::Text(value) = value { Some(value.clone()) } else { None }
    }
}

impl<C: Choice> Type for C {
    fn kind(default: Self, _: Option<RangeInclusive<Self>>) -> Kind {
        Kind::Choice { default: default.index(), names: C::NAMES }
    }
    fn to_value(&self) -> Value {
        Value::Choice(self.index())
    }
    fn from_value(value: &Value) -> Option<Self> {
        if let Value::Choice(index) = value { C::from_index(*index) } else { None }
    }
}
