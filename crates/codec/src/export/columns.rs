//! Points of files of any kind as columns, and rows of a file of another kind that are made of them.

use cloud::{Attribute, Column, ColumnType};

/// A number of each point that the files do not have, and that the new one gets.
pub struct Added {
    pub name: String,
    /// One list for each file, with a value for each of its points.
    pub values: Vec<Vec<f32>>,
}

impl Added {
    /// The values of a file from a point on. Points beyond the list have no number.
    pub fn of(&self, file: usize, first_point: u64, points: usize) -> Vec<f32> {
        let values = self.values.get(file).map_or(&[][..], Vec::as_slice);
        let value = |point: u64| values.get(point as usize).copied().unwrap_or(f32::NAN);
        (first_point..first_point + points as u64).map(value).collect()
    }

    pub fn field(&self) -> Attribute {
        Attribute { name: self.name.clone(), column_type: ColumnType::F32 }
    }
}

/// Some points of a file, in its order.
pub struct Piece {
    /// The index in the file of the first point.
    pub first_point: u64,
    pub points: usize,
    /// One for each field of the file, with the values of all points.
    pub columns: Vec<Column>,
    /// The indices of the points that are shown.
    pub kept: Vec<u32>,
}

/// The fields of all files, each once, in the order in which they come. Where files have a field in different types, it
/// is a double.
pub fn all_fields(files: &[Vec<Attribute>]) -> Vec<Attribute> {
    let mut all: Vec<Attribute> = Vec::new();
    for field in files.iter().flatten() {
        match all.iter_mut().find(|known| known.name == field.name) {
            None => all.push(field.clone()),
            Some(known) if known.column_type != field.column_type => known.column_type = ColumnType::F64,
            Some(_) => {}
        }
    }
    all
}

/// For each of `fields`, the column of a file that has it.
pub fn columns_of(fields: &[Attribute], file: &[Attribute]) -> Vec<Option<usize>> {
    fields.iter().map(|field| file.iter().position(|own| own.name == field.name)).collect()
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
                $( (column, ColumnType::$Variant) => put!(|index: usize| column.value(index), $number), )*
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
        assert_eq!(rows, [row(1, 0, -1.0), row(0x304, 255, 3.0), row(4, 4, 4.0)].concat());
    }

    #[test]
    fn files_share_their_fields_by_name() {
        let field = |name: &str, column_type| Attribute { name: name.into(), column_type };
        let files = [
            vec![field("x", ColumnType::F32), field("class", ColumnType::U8)],
            vec![field("class", ColumnType::U8), field("x", ColumnType::F64), field("time", ColumnType::F64)],
        ];
        let all = all_fields(&files);
        assert_eq!(all, [field("x", ColumnType::F64), field("class", ColumnType::U8), field("time", ColumnType::F64)]);
        assert_eq!(columns_of(&all, &files[0]), [Some(0), Some(1), None]);
        assert_eq!(columns_of(&all, &files[1]), [Some(1), Some(0), Some(2)]);
    }
}
