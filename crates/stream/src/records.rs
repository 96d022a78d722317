//! The records of points in the builder: a few bytes each, which are sorted, sampled and cut into pages.

use cloud::{Attribute, Chunk, Column, ColumnType, NO_NORMAL};
use glam::{DVec3, Vec3};

use crate::lattice::Lattice;

/// The content of a record, in this order: lattice integers, colours, normal, attributes. Little-endian, without gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Whether lattice integers have 64 bits; else they have 32.
    pub wide: bool,
    /// The number of bytes: 0, 3 (red, green, blue) or 4 (with opacity).
    pub color_bytes: usize,
    pub normals: bool,
    pub attributes: Vec<Attribute>,
}

/// Runs `$body` with `$values` bound to the vector in a column and `$number` to its type.
macro_rules! each_type {
    ($column:expr, $number:ident, $values:ident => $body:expr) => {
        match $column {
            Column::U8($values) => each_type!(@ u8, $number, $body),
            Column::I8($values) => each_type!(@ i8, $number, $body),
            Column::U16($values) => each_type!(@ u16, $number, $body),
            Column::I16($values) => each_type!(@ i16, $number, $body),
            Column::U32($values) => each_type!(@ u32, $number, $body),
            Column::I32($values) => each_type!(@ i32, $number, $body),
            Column::U64($values) => each_type!(@ u64, $number, $body),
            Column::I64($values) => each_type!(@ i64, $number, $body),
            Column::F32($values) => each_type!(@ f32, $number, $body),
            Column::F64($values) => each_type!(@ f64, $number, $body),
        }
    };
    (@ $type:ty, $number:ident, $body:expr) => {{
        type $number = $type;
        $body
    }};
}
pub(crate) use each_type;

/// Coordinates beyond this, in world units, are damage: no measurement is so large, and f32 ends soon after.
pub const MOST_COORDINATE: f64 = 1e30;
/// The limit of a point's lattice integers; the distance of any two below it is an i64.
pub const MOST_STEPS: f64 = (3_u64 << 60) as f64;

/// Whether a point may really be at this place.
pub fn is_believable(place: DVec3) -> bool {
    place.abs().cmple(DVec3::splat(MOST_COORDINATE)).all()
}

/// The records of a chunk.
pub struct Encoded {
    pub records: Vec<u8>,
    /// The number of points left out because they are not finite, or too far away to be true.
    pub skipped: u64,
    /// The number of points whose integers do not fit 32 bits although the layout says so; their records are wrong.
    pub misfits: u64,
    /// The least lattice integers; `greatest` has the greatest.
    pub least: [f64; 3],
    pub greatest: [f64; 3],
}

impl Layout {
    pub fn position_bytes(&self) -> usize {
        if self.wide { 24 } else { 12 }
    }

    /// The sizes in bytes of the columns after the position, which a page keeps unchanged: colours, normal, attributes.
    pub fn widths(&self) -> impl Iterator<Item = usize> {
        let normal = if self.normals { 4 } else { 0 };
        [self.color_bytes, normal]
            .into_iter()
            .chain(self.attributes.iter().map(|attribute| attribute.column_type.size()))
    }

    /// The size of a record in bytes.
    pub fn stride(&self) -> usize {
        self.position_bytes() + self.widths().sum::<usize>()
    }

    /// The lattice integers of a record.
    #[inline]
    pub fn at(&self, record: &[u8]) -> [i64; 3] {
        if self.wide {
            let mut bytes = [0; 24];
            bytes.copy_from_slice(&record[..24]);
            std::array::from_fn(|axis| {
                let mut value = [0; 8];
                value.copy_from_slice(&bytes[axis * 8..axis * 8 + 8]);
                i64::from_le_bytes(value)
            })
        } else {
            let mut bytes = [0; 12];
            bytes.copy_from_slice(&record[..12]);
            std::array::from_fn(|axis| {
                let mut value = [0; 4];
                value.copy_from_slice(&bytes[axis * 4..axis * 4 + 4]);
                i64::from(i32::from_le_bytes(value))
            })
        }
    }

    /// The records of the finite points of a chunk. `columns` has the index of each attribute's column in the chunk, if
    /// it has one.
    pub fn encode(&self, chunk: &Chunk, lattice: &Lattice, columns: &[Option<usize>]) -> Encoded {
        let stride = self.stride();
        let mut records = vec![0; chunk.len() * stride];
        let (mut least, mut greatest) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        let (unfit, misfits) = self.encode_positions(chunk, lattice, &mut records, &mut least, &mut greatest);
        let mut start = self.position_bytes();
        if self.color_bytes > 0 {
            for (index, record) in records.chunks_exact_mut(stride).enumerate() {
                let color = chunk.colors.as_ref().map_or([255; 4], |colors| colors[index]);
                record[start..start + self.color_bytes].copy_from_slice(&color[..self.color_bytes]);
            }
            start += self.color_bytes;
        }
        if self.normals {
            for (index, record) in records.chunks_exact_mut(stride).enumerate() {
                let normal = chunk.normals.as_ref().map_or(NO_NORMAL, |normals| normals[index]);
                record[start..start + 4].copy_from_slice(&normal.to_le_bytes());
            }
            start += 4;
        }
        for (attribute, column) in self.attributes.iter().zip(columns) {
            let size = attribute.column_type.size();
            let column = column.and_then(|column| chunk.columns.get(column)?.as_deref());
            let none;
            // Only files that lack it make its type one of floats, so others have it in every chunk.
            let column = match (column, attribute.column_type) {
                (Some(column), _) => Some(column),
                (None, ColumnType::F32) => {
                    none = Column::F32(vec![f32::NAN; chunk.len()]);
                    Some(&none)
                }
                (None, ColumnType::F64) => {
                    none = Column::F64(vec![f64::NAN; chunk.len()]);
                    Some(&none)
                }
                (None, _) => None,
            };
            if let Some(column) = column {
                let converted;
                let column = if column.column_type() == attribute.column_type {
                    column
                } else {
                    converted = joined(&[column], attribute.column_type);
                    &converted
                };
                each_type!(column, Number, values => {
                    for (record, value) in records.chunks_exact_mut(stride).zip(values) {
                        record[start..start + size_of::<Number>()].copy_from_slice(&value.to_le_bytes());
                    }
                });
            }
            start += size;
        }
        let skipped = unfit.len() as u64;
        if skipped > 0 {
            let mut unfit = unfit.into_iter().peekable();
            let mut kept = 0;
            for index in 0..chunk.len() {
                if unfit.next_if_eq(&index).is_none() {
                    records.copy_within(index * stride..(index + 1) * stride, kept);
                    kept += stride;
                }
            }
            records.truncate(kept);
        }
        Encoded { records, skipped, misfits, least, greatest }
    }

    /// Writes lattice integers. Returns the indices of the points that are not finite, and the number of those that do
    /// not fit.
    fn encode_positions(
        &self,
        chunk: &Chunk,
        lattice: &Lattice,
        records: &mut [u8],
        least: &mut [f64; 3],
        greatest: &mut [f64; 3],
    ) -> (Vec<usize>, u64) {
        let inverse = 1.0 / lattice.grid.scale;
        let origin = chunk.origin - lattice.grid.offset;
        let mut unfit = Vec::new();
        let mut misfits = 0;
        for (index, record) in records.chunks_exact_mut(self.stride()).enumerate() {
            let world = match &chunk.exact_positions {
                Some(exact) => DVec3::from(exact[index]) - lattice.grid.offset,
                None => Vec3::from(chunk.positions[index]).as_dvec3() + origin,
            };
            let at = (world * inverse).to_array().map(f64::round_ties_even);
            if !(is_believable(world) && at.iter().all(|value| value.abs() <= MOST_STEPS)) {
                unfit.push(index);
                continue;
            }
            for axis in 0..3 {
                least[axis] = least[axis].min(at[axis]);
                greatest[axis] = greatest[axis].max(at[axis]);
            }
            if self.wide {
                for axis in 0..3 {
                    record[axis * 8..axis * 8 + 8].copy_from_slice(&(at[axis] as i64).to_le_bytes());
                }
            } else {
                for axis in 0..3 {
                    let value = at[axis] as i32;
                    misfits += u64::from(f64::from(value) != at[axis]);
                    record[axis * 4..axis * 4 + 4].copy_from_slice(&value.to_le_bytes());
                }
            }
        }
        (unfit, misfits)
    }
}

/// Joins columns into one of another type, converting values as nearly as possible.
pub fn joined(columns: &[&Column], column_type: ColumnType) -> Column {
    let mut joined = Column::with_capacity(column_type, columns.iter().map(|column| column.len()).sum());
    each_type!(&mut joined, Number, values => {
        for column in columns {
            values.extend((0..column.len()).map(|index| column.value(index) as Number));
        }
    });
    joined
}
