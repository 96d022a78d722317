//! One scalar attribute of every point of a chunk, in the type that the file has. A point without a value has NaN, so an
//! attribute that some points lack has a type of floats (`ColumnType::with_none`).

use std::fmt::{Display, LowerExp};

/// The scalar types of columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColumnType {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl ColumnType {
    /// `u8`, `i8`, ... `f64`: the name shown to people and written by `glint info`.
    pub fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// Whether all values are whole numbers.
    pub fn is_whole(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// The smallest type of floats that holds its numbers and "no value"; whole numbers beyond 2^53 are rounded.
    pub fn with_none(self) -> Self {
        match self {
            Self::U8 | Self::I8 | Self::U16 | Self::I16 | Self::F32 => Self::F32,
            Self::U32 | Self::I32 | Self::U64 | Self::I64 | Self::F64 => Self::F64,
        }
    }

    /// The type that holds the numbers of both.
    pub fn with(self, other: Self) -> Self {
        if self == other { self } else { Self::F64 }
    }

    /// The size of one value in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

/// The values from `low` to `high` in columns of any type. A value that differs from an end by rounding alone is inside:
/// 0.3 as f32 is a little more than 0.3, and 57 steps of 0.01 are a little more than 0.57. Steps from an offset that is
/// larger than the value may be rounded by more. Whole numbers are told apart, up to 2^53 in a column of f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Both ends for whole numbers, for f32 and for f64.
    whole: [f64; 2],
    singles: [f64; 2],
    doubles: [f64; 2],
    /// The numbers of f32 that are written as the ends are.
    written_alike: [Option<f64>; 2],
}

impl ValueRange {
    pub fn new(low: f64, high: f64) -> Self {
        let single = |end: f64| f64::from(end as f32);
        // A step and its multiple are rounded by half of an epsilon each.
        let slack = |end: f64| if end.is_finite() { (2.0 * f64::EPSILON * end.abs()).min(0.25) } else { 0.0 };
        let is_alike = |end: &f64| end.fract() != 0.0 && (*end as f32).to_string() == end.to_string();
        Self {
            whole: [low, high],
            singles: [low, high].map(single),
            doubles: [low - slack(low), high + slack(high)],
            written_alike: [low, high].map(|end| Some(end).filter(is_alike).map(single)),
        }
    }

    /// Whether the value of point `index` of a column is one of these.
    pub fn has(&self, column: &Column, index: usize) -> bool {
        let is_between = |[low, high]: [f64; 2], value: f64| (low..=high).contains(&value);
        match column {
            Column::F32(values) => is_between(self.singles, values[index].into()),
            // A column of f64 may hold numbers of f32: those of another file, or of other points.
            Column::F64(values) => {
                is_between(self.doubles, values[index]) || self.written_alike.contains(&Some(values[index]))
            }
            column => is_between(self.whole, column.value(index)),
        }
    }
}

/// The name and the type of an attribute that a file has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attribute {
    pub name: String,
    pub column_type: ColumnType,
}

/// The values of one attribute, one per point.
#[derive(Clone, Debug, PartialEq)]
pub enum Column {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

/// Runs `$body` with `$values` bound to the vector inside, whatever its type.
macro_rules! each_type {
    ($column:expr, $values:ident => $body:expr) => {
        match $column {
            Column::U8($values) => $body,
            Column::I8($values) => $body,
            Column::U16($values) => $body,
            Column::I16($values) => $body,
            Column::U32($values) => $body,
            Column::I32($values) => $body,
            Column::U64($values) => $body,
            Column::I64($values) => $body,
            Column::F32($values) => $body,
            Column::F64($values) => $body,
        }
    };
}

impl Column {
    pub fn with_capacity(column_type: ColumnType, capacity: usize) -> Self {
        match column_type {
            ColumnType::U8 => Self::U8(Vec::with_capacity(capacity)),
            ColumnType::I8 => Self::I8(Vec::with_capacity(capacity)),
            ColumnType::U16 => Self::U16(Vec::with_capacity(capacity)),
            ColumnType::I16 => Self::I16(Vec::with_capacity(capacity)),
            ColumnType::U32 => Self::U32(Vec::with_capacity(capacity)),
            ColumnType::I32 => Self::I32(Vec::with_capacity(capacity)),
            ColumnType::U64 => Self::U64(Vec::with_capacity(capacity)),
            ColumnType::I64 => Self::I64(Vec::with_capacity(capacity)),
            ColumnType::F32 => Self::F32(Vec::with_capacity(capacity)),
            ColumnType::F64 => Self::F64(Vec::with_capacity(capacity)),
        }
    }

    pub fn column_type(&self) -> ColumnType {
        match self {
            Self::U8(_) => ColumnType::U8,
            Self::I8(_) => ColumnType::I8,
            Self::U16(_) => ColumnType::U16,
            Self::I16(_) => ColumnType::I16,
            Self::U32(_) => ColumnType::U32,
            Self::I32(_) => ColumnType::I32,
            Self::U64(_) => ColumnType::U64,
            Self::I64(_) => ColumnType::I64,
            Self::F32(_) => ColumnType::F32,
            Self::F64(_) => ColumnType::F64,
        }
    }

    pub fn len(&self) -> usize {
        each_type!(self, values => values.len())
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[allow(clippy::unnecessary_cast, reason = "one of the ten types is f64 already")]
    /// The value of point `index` as f64, NaN if it has none (64-bit integers above 2^53 lose digits; `text` does not).
    pub fn value(&self, index: usize) -> f64 {
        each_type!(self, values => values[index] as f64)
    }

    /// The value of point `index` as a person reads it, in full precision; nothing if it has none.
    pub fn text(&self, index: usize) -> String {
        match self {
            Self::F32(values) if values[index].is_nan() => String::new(),
            Self::F64(values) if values[index].is_nan() => String::new(),
            Self::F32(values) => number(values[index]),
            Self::F64(values) => number(values[index]),
            column => each_type!(column, values => values[index].to_string()),
        }
    }

    /// The values of some points, in the order of `indices`.
    pub fn select(&self, indices: &[u32]) -> Self {
        macro_rules! selected {
            ($($Variant:ident),*) => {
                match self {
                    $( Self::$Variant(values) => Self::$Variant(indices.iter().map(|i| values[*i as usize]).collect()), )*
                }
            };
        }
        selected!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64)
    }

    /// Columns of one type, one after the other; `None` if they are of several types, or there are none.
    pub fn joined(parts: &[&Self]) -> Option<Self> {
        macro_rules! joined {
            ($($Variant:ident),*) => {
                match parts.first()? {
                    $( Self::$Variant(_) => {
                        let mut all = Vec::new();
                        for part in parts {
                            let Self::$Variant(values) = part else { return None };
                            all.extend_from_slice(values);
                        }
                        Some(Self::$Variant(all))
                    } )*
                }
            };
        }
        joined!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64)
    }

    pub fn size_in_bytes(&self) -> usize {
        self.len() * self.column_type().size()
    }
}

/// A number in the fewest digits that say exactly it, with an exponent where it is so large or small that zeros would be
/// most of them: `1e30`.
pub fn number<T: Copy + Display + LowerExp + Into<f64>>(value: T) -> String {
    let size: f64 = value.into().abs();
    let is_long = size.is_finite() && size != 0.0 && !(1e-6..1e16).contains(&size);
    if is_long { format!("{value:e}") } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::{Chunk, Cloud, Filter, PointTest};

    #[test]
    fn a_point_without_a_value_has_no_text_and_its_type_is_one_of_floats() {
        let columns = [Column::F32(vec![0.5, f32::NAN, -0.0]), Column::F64(vec![0.5, -f64::NAN, f64::INFINITY])];
        let texts = columns.map(|column| [0, 1, 2].map(|index| column.text(index)));
        assert_eq!(texts, [["0.5", "", "-0"], ["0.5", "", "inf"]]);
        use ColumnType::{F32, F64, I16, I32, U8, U64};
        assert_eq!([U8, I16, F32, I32, U64, F64].map(ColumnType::with_none), [F32, F32, F32, F64, F64, F64]);
        assert_eq!((U8.with(U8), U8.with(I16), F32.with(F64)), (U8, F64, F64));
    }

    #[test]
    fn numbers_of_many_zeros_have_an_exponent_and_are_exact() {
        let texts = [1e30, -2.5e16, 9e15, 1e-6, 3e-7, 0.0, f64::MAX].map(number);
        assert_eq!(texts, ["1e30", "-2.5e16", "9000000000000000", "0.000001", "3e-7", "0", "1.7976931348623157e308"]);
        assert_eq!(Column::F32(vec![1e30]).text(0), "1e30");
        assert_eq!([f64::NAN, f64::NEG_INFINITY].map(number), ["NaN", "-inf"]);
        for value in [1e30, f64::MIN_POSITIVE, 1.0 / 3.0 * 1e20, -7.0e-9] {
            assert_eq!(number(value).parse::<f64>(), Ok(value));
        }
    }

    #[test]
    fn a_range_ends_at_the_numbers_that_a_column_of_f32_can_hold() {
        let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]; 4]);
        // Of 0.1 and 0.3, f32 holds a little more, of 19.95 and -20.034 a little more and less.
        chunk.columns = vec![Some(Arc::new(Column::F32(vec![0.1, 0.3, 19.95, -20.034])))];
        let attributes = vec![Attribute { name: "heat".into(), column_type: ColumnType::F32 }];
        let cloud = Cloud { attributes, chunks: vec![chunk], ..Cloud::default() };
        let shown = |low: f64, high: f64| {
            let filter = Filter { attribute: "heat".into(), low, high };
            cloud.shown(&PointTest::new([], vec![filter], Vec::new())).len()
        };
        assert_eq!((shown(0.1, 0.3), shown(-20.034, 19.95), shown(0.3, 0.3)), (2, 4, 1));
        assert_eq!((shown(0.100_001, 0.299_999), shown(f64::NEG_INFINITY, -20.0)), (0, 1));
    }

    #[test]
    fn rounding_alone_puts_no_value_outside_of_a_range() {
        let is_within = |low, high, value| ValueRange::new(low, high).has(&Column::F64(vec![value]), 0);
        // Numbers of a file that has steps of a scale.
        assert!((1..1000_u32).all(|steps| {
            let end: f64 = format!("0.{steps:03}").parse().unwrap();
            is_within(end, end, f64::from(steps) * 0.001) && is_within(-end, -end, f64::from(steps) * -0.001)
        }));
        // Numbers of f32 among those of f64, on both sides of the end.
        for (end, f32_value) in [(0.3, 0.3_f32), (19.95, 19.95), (-20.034, -20.034)] {
            assert!(is_within(end, end, f32_value.into()) && is_within(end, end, end), "{end}");
        }
        // Others are as far apart as they are written.
        assert!(!is_within(0.0, 0.3, 0.300_000_005) && !is_within(0.570_000_000_000_01, 1.0, 0.57));
        assert!(!is_within(300_000_000.123, f64::INFINITY, 300_000_000.0));
        assert!(!ValueRange::new(16_777_217.0, f64::INFINITY).has(&Column::U32(vec![16_777_216]), 0));
        assert!(is_within(f64::NEG_INFINITY, f64::INFINITY, 1e300) && !is_within(0.0, 1.0, f64::NAN));
        for end in [2.0_f64.powi(30), 2.0_f64.powi(50), 2.0_f64.powi(52), 2.0_f64.powi(53) - 1.0] {
            let others = [end - 1.0, end + 1.0];
            assert!(is_within(end, end, end) && !others.iter().any(|other| is_within(end, end, *other)), "{end}");
        }
        // f32 writes 2^30 so.
        assert!(!is_within(1_073_741_800.0, 1_073_741_800.0, 2.0_f64.powi(30)));
    }

    #[test]
    fn each_chunk_is_tested_by_the_type_of_its_own_column() {
        let columns = [Column::F32(vec![0.3]), Column::F64(vec![0.3])];
        let chunks = columns.map(|column| {
            let mut chunk = Chunk::new(0, DVec3::ZERO, vec![[0.0; 3]]);
            chunk.columns = vec![Some(Arc::new(column))];
            chunk
        });
        for column_type in [ColumnType::F32, ColumnType::F64, ColumnType::U8] {
            let attributes = vec![Attribute { name: "heat".into(), column_type }];
            let cloud = Cloud { attributes, chunks: chunks.to_vec(), ..Cloud::default() };
            let filter = Filter { attribute: "heat".into(), low: 0.3, high: 0.3 };
            assert_eq!(cloud.shown(&PointTest::new([], vec![filter], Vec::new())).len(), 2, "{column_type:?}");
        }
    }
}
