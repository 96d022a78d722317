//! Points of files of any kind as columns, and rows of a file of another kind that are made of them.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use cloud::{Attribute, Column, ColumnType, Placement, PointTest};
use glam::DVec3;

/// The points that are written.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// Decides by place, class and attributes.
    pub test: &'a PointTest,
    /// The points of each file that are left out whatever the test says: their indices in the file, ascending. Files
    /// beyond the end of the list have none.
    pub left_out: &'a [Vec<u64>],
}

impl<'a> From<&'a PointTest> for Wanted<'a> {
    fn from(test: &'a PointTest) -> Self {
        Self { test, left_out: &[] }
    }
}

impl Wanted<'_> {
    /// Which of the `points` points of a file from the `first_point` on are left out of the export.
    pub fn left_out(&self, file: usize, first_point: u64, points: usize) -> LeftOut<'_> {
        let all = self.left_out.get(file).map_or(&[][..], Vec::as_slice);
        let start = all.partition_point(|index| *index < first_point);
        let end = all.partition_point(|index| *index < first_point.saturating_add(points as u64));
        LeftOut { first_point, indices: &all[start..end] }
    }
}

/// The points that are left out of some in a row.
#[derive(Clone, Copy)]
pub struct LeftOut<'a> {
    first_point: u64,
    indices: &'a [u64],
}

impl LeftOut<'_> {
    /// Whether one of them is left out, by its index among them.
    pub fn has(self, index: usize) -> bool {
        !self.indices.is_empty() && self.indices.binary_search(&(self.first_point + index as u64)).is_ok()
    }
}

/// The values of runs of points, by the index in the file of the first point of each run. Runs do not overlap. A list of
/// all points would be as long as a damaged file claims to be.
pub type Runs = BTreeMap<u64, Arc<Column>>;

/// A number of each point that the files do not have, and that the new one gets.
pub struct Added {
    name: String,
    /// The values of each file.
    values: Vec<Runs>,
    column_type: ColumnType,
}

impl Added {
    /// Takes the values of each file. They are written as floats, or as doubles where a run has these.
    pub fn new(name: String, values: Vec<Runs>) -> Self {
        let is_double = values.iter().flat_map(Runs::values).any(|run| run.column_type() == ColumnType::F64);
        Self { name, values, column_type: if is_double { ColumnType::F64 } else { ColumnType::F32 } }
    }

    /// The values of a file from a point on; NaN for points that are in no run.
    pub fn of(&self, file: usize, first_point: u64, points: usize) -> Column {
        let values = self.values_of(file, first_point, points);
        match self.column_type {
            ColumnType::F64 => Column::F64(values),
            _ => Column::F32(values.into_iter().map(|value| value as f32).collect()),
        }
    }

    fn values_of(&self, file: usize, first_point: u64, points: usize) -> Vec<f64> {
        let mut values = vec![f64::NAN; points];
        let Some(runs) = self.values.get(file) else { return values };
        let end = first_point.saturating_add(points as u64);
        // The run before may reach into this one.
        let begin = runs.range(..=first_point).next_back().map_or(first_point, |(start, _)| *start);
        for (start, run) in runs.range(begin..end) {
            let (from, to) = ((*start).max(first_point), (start + run.len() as u64).min(end));
            if from < to {
                let places = &mut values[(from - first_point) as usize..(to - first_point) as usize];
                let skipped = (from - start) as usize;
                places.iter_mut().enumerate().for_each(|(index, place)| *place = run.value(skipped + index));
            }
        }
        values
    }

    pub fn field(&self) -> Attribute {
        Attribute { name: self.name.clone(), column_type: self.column_type }
    }
}

/// A property of points of several files, some without colours: 1 for those with one, 0 for those that are black because
/// they have none.
pub const HAS_COLOR: &str = "has_color";

/// The scale of the colours among the columns of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colors {
    /// The numbers of the file.
    Own,
    /// 0 to 255.
    Bytes,
    /// 0 to 65535.
    Words,
}

/// What a column of a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    Coordinate,
    /// One of the three channels of colour.
    Color,
    /// A field that records of LAS have in each point format, or a time, or near infrared, by its name in LAS.
    Standard,
    /// A part of a wave packet.
    Wave,
    /// Anything else, by the name that the file gives it.
    Other,
}

/// A column of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    pub attribute: Attribute,
    pub meaning: Meaning,
}

impl Field {
    pub fn new(name: impl Into<String>, column_type: ColumnType, meaning: Meaning) -> Self {
        Self { attribute: Attribute { name: name.into(), column_type }, meaning }
    }

    pub fn name(&self) -> &str {
        &self.attribute.name
    }

    pub fn column_type(&self) -> ColumnType {
        self.attribute.column_type
    }
}

/// How the columns of a file are read.
pub struct Reading<'a> {
    pub test: &'a PointTest,
    pub colors: Colors,
    /// Whether each column is read; those that are not are empty. `None` for all columns.
    pub needed: Option<&'a [bool]>,
}

impl Reading<'_> {
    pub fn needs(&self, column: usize) -> bool {
        self.needed.is_none_or(|needed| needed.get(column) == Some(&true))
    }
}

/// Some points of a file, in its order.
pub struct Piece {
    /// The index in the file of the first point.
    pub first_point: u64,
    pub points: usize,
    /// One for each field of the file, with the values of all points, or empty if it is not needed.
    pub columns: Vec<Column>,
    /// The indices of the points that are shown.
    pub kept: Vec<u32>,
}

/// Turns and moves the coordinates among the columns of a file, which become doubles, and turns the normals. The numbers
/// are those of the columns of x, y and z.
pub fn place(columns: &mut [Column], coordinates: [usize; 3], normals: Option<[usize; 3]>, placement: &Placement) {
    let mut change = |places: [usize; 3], of: &dyn Fn(DVec3) -> DVec3, is_double: bool| {
        if places.iter().any(|place| *place >= columns.len()) {
            return;
        }
        let points = columns[places[0]].len();
        let changed: Vec<DVec3> =
            (0..points).map(|index| of(DVec3::from(places.map(|place| columns[place].value(index))))).collect();
        for (axis, place) in places.into_iter().enumerate() {
            let values = changed.iter().map(|value| value[axis]);
            columns[place] = match &columns[place] {
                Column::F32(_) if !is_double => Column::F32(values.map(|value| value as f32).collect()),
                _ => Column::F64(values.collect()),
            };
        }
    };
    change(coordinates, &|own| placement.point(own), true);
    if let Some(normals) = normals {
        change(normals, &|own| placement.direction(own), false);
    }
}

/// The fields of all files, each once, in the order in which they come. Where files have a field in different types, it
/// is a double.
pub fn all_fields(files: &[Vec<Field>]) -> Vec<Field> {
    let mut all: Vec<Field> = Vec::new();
    let mut places: HashMap<&str, usize> = HashMap::new();
    for field in files.iter().flatten() {
        match places.get(field.name()).map(|place| &mut all[*place]) {
            None => {
                places.insert(field.name(), all.len());
                all.push(field.clone());
            }
            Some(known) if known.column_type() != field.column_type() => known.attribute.column_type = ColumnType::F64,
            Some(_) => {}
        }
    }
    all
}

/// For each of `fields`, the column of a file that has it.
pub fn columns_of(fields: &[Field], file: &[Field]) -> Vec<Option<usize>> {
    let places: HashMap<&str, usize> = file.iter().enumerate().map(|(place, own)| (own.name(), place)).collect();
    fields.iter().map(|field| places.get(field.name()).copied()).collect()
}

/// The type that holds all values of another one, and NaN.
pub fn with_none(column_type: ColumnType) -> ColumnType {
    use ColumnType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
    match column_type {
        U8 | I8 | U16 | I16 | F32 => F32,
        U32 | I32 | U64 | I64 | F64 => F64,
    }
}

/// Fills the places of a field that a file does not have: NaN where the type has it, else 0.
pub fn put_none(rows: &mut [u8], length: usize, at: usize, column_type: ColumnType) {
    let none: &[u8] = match column_type {
        ColumnType::F32 => &f32::NAN.to_le_bytes(),
        ColumnType::F64 => &f64::NAN.to_le_bytes(),
        _ => return,
    };
    rows.chunks_exact_mut(length).for_each(|row| row[at..at + none.len()].copy_from_slice(none));
}

/// Whether doubles do not hold all kept values of a column.
pub fn loses_digits(column: &Column, kept: &[u32]) -> bool {
    let mut kept = kept.iter().map(|index| *index as usize);
    match column {
        Column::U64(values) => kept.any(|index| values[index] as f64 as u128 != u128::from(values[index])),
        Column::I64(values) => kept.any(|index| values[index] as f64 as i128 != i128::from(values[index])),
        _ => false,
    }
}

/// Writes the kept values of a column to rows of `length` bytes, at byte `at`, as numbers of `column_type`, the least
/// significant byte first.
pub fn put(rows: &mut [u8], length: usize, at: usize, column: &Column, kept: &[u32], column_type: ColumnType) {
    macro_rules! put {
        ($values:expr, $number:ty) => {
            for (row, index) in rows.chunks_exact_mut(length).zip(kept) {
                let bytes = ($values(*index as usize) as $number).to_le_bytes();
                row[at..at + bytes.len()].copy_from_slice(&bytes);
            }
        };
    }
    macro_rules! same {
        ($($Variant:ident $number:ty),*) => {
            match (column, column_type) {
                $( (Column::$Variant(values), ColumnType::$Variant) => put!(|index: usize| values[index], $number), )*
                $( (column, ColumnType::$Variant) => {
                    let is_whole = ColumnType::$Variant.is_whole();
                    let rounded = |value: f64| if is_whole { value.round() } else { value };
                    put!(|index: usize| rounded(column.value(index)), $number)
                } )*
            }
        };
    }
    same!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64, F32 f32, F64 f64);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_put_in_their_places_and_types() {
        let mut rows = vec![9; 3 * 8];
        put(&mut rows, 8, 1, &Column::U16(vec![1, 2, 0x304, 4]), &[0, 2, 3], ColumnType::U16);
        put(&mut rows, 8, 3, &Column::F64(vec![-1.0, 0.0, 300.0, 4.6]), &[0, 2, 3], ColumnType::U8);
        put(&mut rows, 8, 4, &Column::I8(vec![-1, 0, 3, 4]), &[0, 2, 3], ColumnType::F32);
        let row =
            |short: u16, byte: u8, float: f32| [&[9][..], &short.to_le_bytes(), &[byte], &float.to_le_bytes()].concat();
        assert_eq!(rows, [row(1, 0, -1.0), row(0x304, 255, 3.0), row(4, 5, 4.0)].concat());
    }

    #[test]
    fn coordinates_become_doubles_where_they_are_moved_and_normals_turn() {
        let column = |values: [f32; 2]| Column::F32(values.to_vec());
        let mut columns = vec![column([1.0, 2.0]), column([0.0, 0.0]), column([3.0, 4.0]), Column::U8(vec![7, 8])];
        columns.extend([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]].map(column));
        let turn = glam::DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let placement = Placement::new(turn, DVec3::new(1.0, 0.0, 0.0), DVec3::new(1e6, 0.0, 0.001));
        place(&mut columns, [0, 1, 2], Some([4, 5, 6]), &placement);
        let values = |index: usize, places: [usize; 3]| DVec3::from(places.map(|place| columns[place].value(index)));
        assert!((values(0, [0, 1, 2]) - DVec3::new(1_000_001.0, 0.0, 3.001)).length() < 1e-9);
        assert!((values(1, [0, 1, 2]) - DVec3::new(1_000_001.0, 1.0, 4.001)).length() < 1e-9);
        assert!((values(0, [4, 5, 6]) - DVec3::Y).length() < 1e-6 && values(1, [4, 5, 6]) == DVec3::Z);
        let types: Vec<ColumnType> = columns.iter().map(Column::column_type).collect();
        use ColumnType::{F32, F64, U8};
        assert_eq!(types, [F64, F64, F64, U8, F32, F32, F32]);
    }

    #[test]
    fn points_are_left_out_by_their_index_in_their_file() {
        let (test, far) = (PointTest::default(), u64::MAX - 1);
        let left_out = [vec![], vec![2, 3, 9, far]];
        let wanted = Wanted { test: &test, left_out: &left_out };
        let of = |file, first_point, points| -> Vec<usize> {
            let left_out = wanted.left_out(file, first_point, points);
            (0..points).filter(|index| left_out.has(*index)).collect()
        };
        assert_eq!((of(1, 0, 3), of(1, 3, 7), of(1, far, 2)), (vec![2], vec![0, 6], vec![0]));
        assert!(of(0, 0, 10).is_empty() && of(2, 0, 10).is_empty() && of(1, 4, 5).is_empty());
    }

    #[test]
    fn values_are_those_of_their_runs_wherever_a_file_claims_them_to_be() {
        let far = 1_u64 << 60;
        let run = |values: &[f32]| Arc::new(Column::F32(values.to_vec()));
        let mut runs: Runs = [(2, run(&[2.0, 3.0, 4.0])), (5, run(&[5.0])), (far, run(&[6.0, 7.0]))].into();
        let added = Added::new("distance".into(), vec![Runs::new(), runs.clone()]);
        assert_eq!(added.field().column_type, ColumnType::F32);
        let of = |file, first_point, points| -> Vec<Option<f64>> {
            let values = added.of(file, first_point, points);
            let value = |index: usize| Some(values.value(index)).filter(|value| !value.is_nan());
            (0..values.len()).map(value).collect()
        };
        assert_eq!(of(1, 0, 3), [None, None, Some(2.0)]);
        assert_eq!(of(1, 3, 4), [Some(3.0), Some(4.0), Some(5.0), None]);
        assert_eq!(of(1, far + 1, 2), [Some(7.0), None]);
        assert_eq!(of(0, 2, 1), [None]);
        assert_eq!(of(7, 2, 1), [None]);
        assert_eq!(of(1, 2, 0), []);
        runs.insert(9, Arc::new(Column::F64(vec![4_424_000.125])));
        let added = Added::new("distance".into(), vec![runs]);
        assert_eq!((added.of(0, 9, 1), added.of(0, 5, 1)), (Column::F64(vec![4_424_000.125]), Column::F64(vec![5.0])));
    }

    #[test]
    fn files_share_their_fields_by_name() {
        let field = |name: &str, column_type| Field::new(name, column_type, Meaning::Other);
        let files = [
            vec![field("x", ColumnType::F32), field("class", ColumnType::U8)],
            vec![field("class", ColumnType::U8), field("x", ColumnType::F64), field("time", ColumnType::F64)],
        ];
        let all = all_fields(&files);
        assert_eq!(all, [field("x", ColumnType::F64), field("class", ColumnType::U8), field("time", ColumnType::F64)]);
        assert_eq!(columns_of(&all, &files[0]), [Some(0), Some(1), None]);
        assert_eq!(columns_of(&all, &files[1]), [Some(1), Some(0), Some(2)]);
    }

    #[test]
    fn integers_that_a_double_does_not_hold_are_found() {
        let column = Column::U64(vec![1 << 53, (1 << 53) + 1, u64::MAX]);
        assert!(!loses_digits(&column, &[0]) && loses_digits(&column, &[1]) && loses_digits(&column, &[2]));
        let column = Column::I64(vec![-(1 << 53), i64::MAX, i64::MIN]);
        assert!(!loses_digits(&column, &[0, 2]) && loses_digits(&column, &[0, 1]));
    }

    #[test]
    fn a_missing_value_is_no_number() {
        let mut rows = vec![0; 10];
        put_none(&mut rows, 5, 1, with_none(ColumnType::U16));
        assert!(rows.chunks_exact(5).all(|row| f32::from_le_bytes([row[1], row[2], row[3], row[4]]).is_nan()));
    }
}
