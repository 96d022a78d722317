//! Makes records of point formats 6 to 8 of columns: standard fields where the names and types of columns fit them,
//! extra dimensions else.

use std::io;

use cloud::{Attribute, Column, ColumnType, Grid};

use super::layout::Layout;
use super::output_records::{Target, far_outside};
use crate::export::columns::{Piece, put};

/// The number of steps of an angle in a degree.
const ANGLE_STEPS: f64 = 1.0 / 0.006;

/// Where a field is in a record.
#[derive(Clone, Debug, PartialEq)]
enum Place {
    Coordinate { axis: usize },
    Number { at: usize, column_type: ColumnType },
    Bits { at: usize, shift: u8, mask: u8 },
    Angle { at: usize },
}

/// The format of records, and where each field is in them.
pub struct RecordFormat {
    pub target: Target,
    pub grid: Grid,
    /// The descriptors of extra dimensions.
    pub descriptors: Vec<u8>,
    pub fields: Vec<Attribute>,
    places: Vec<Place>,
}

impl RecordFormat {
    pub fn new(fields: Vec<Attribute>, grid: Grid) -> Self {
        let has = |name: &str| fields.iter().any(|field| field.name == name && field.column_type == ColumnType::U16);
        let format = match (["red", "green", "blue"].into_iter().all(has), has("nir")) {
            (_, true) => 8,
            (true, false) => 7,
            (false, false) => 6,
        };
        let base = Layout::base_length(format).unwrap_or(0);
        let (mut places, mut descriptors, mut length) = (Vec::new(), Vec::new(), base);
        for field in &fields {
            let place = standard(field, format).unwrap_or_else(|| {
                descriptors.extend(descriptor(field));
                let place = Place::Number { at: length, column_type: field.column_type };
                length += field.column_type.size();
                place
            });
            places.push(place);
        }
        Self { target: Target { format, extra: length - base }, grid, descriptors, fields, places }
    }

    /// The records of the kept points. `columns` says which column of the piece each field is.
    ///
    /// # Errors
    /// A point that the grid does not reach.
    pub fn rows(&self, piece: &Piece, columns: &[Option<usize>]) -> io::Result<Vec<u8>> {
        let length = self.target.record_length();
        let mut rows = vec![0; piece.kept.len() * length];
        // A point is the first return of one, unless its file says something else.
        rows.chunks_exact_mut(length).for_each(|row| row[14] = 1 | 1 << 4);
        for (place, column) in self.places.iter().zip(columns) {
            let Some(column) = column.and_then(|column| piece.columns.get(column)) else { continue };
            self.put(&mut rows, place, column, &piece.kept)?;
        }
        Ok(rows)
    }

    fn put(&self, rows: &mut [u8], place: &Place, column: &Column, kept: &[u32]) -> io::Result<()> {
        let length = self.target.record_length();
        match *place {
            Place::Coordinate { axis } => {
                let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
                for (row, index) in rows.chunks_exact_mut(length).zip(kept) {
                    let step = ((column.value(*index as usize) - offset) / scale).round();
                    // NaN fails the comparison.
                    let is_reached = step.abs() <= f64::from(i32::MAX);
                    if !is_reached {
                        return Err(far_outside());
                    }
                    row[4 * axis..4 * axis + 4].copy_from_slice(&(step as i32).to_le_bytes());
                }
            }
            Place::Angle { at } => {
                for (row, index) in rows.chunks_exact_mut(length).zip(kept) {
                    let step = (column.value(*index as usize) * ANGLE_STEPS).round();
                    row[at..at + 2].copy_from_slice(&(step as i16).to_le_bytes());
                }
            }
            Place::Number { at, column_type } => put(rows, length, at, column, kept, column_type),
            Place::Bits { at, shift, mask } => {
                for (row, index) in rows.chunks_exact_mut(length).zip(kept) {
                    let bits = column.value(*index as usize) as u8 & mask;
                    row[at] = row[at] & !(mask << shift) | bits << shift;
                }
            }
        }
        Ok(())
    }
}

/// The place of a field that records of formats 6 to 8 have, if its type fits.
fn standard(field: &Attribute, format: u8) -> Option<Place> {
    use ColumnType::{F32, F64, U8, U16};
    let bits = |at, shift, mask| (&[U8][..], Place::Bits { at, shift, mask });
    let number = |at, column_type| Place::Number { at, column_type };
    let color = |at| Layout::red_of(format).map(|_| (&[U16][..], number(at, U16)));
    let (types, place): (&[ColumnType], Place) = match field.name.as_str() {
        "x" => return Some(Place::Coordinate { axis: 0 }),
        "y" => return Some(Place::Coordinate { axis: 1 }),
        "z" => return Some(Place::Coordinate { axis: 2 }),
        "intensity" => (&[U8, U16], number(12, U16)),
        "return_number" => bits(14, 0, 15),
        "number_of_returns" => bits(14, 4, 15),
        "synthetic" => bits(15, 0, 1),
        "key_point" => bits(15, 1, 1),
        "withheld" => bits(15, 2, 1),
        "overlap" => bits(15, 3, 1),
        "scanner_channel" => bits(15, 4, 3),
        "scan_direction_flag" => bits(15, 6, 1),
        "edge_of_flight_line" => bits(15, 7, 1),
        "classification" => (&[U8], number(16, U8)),
        "user_data" => (&[U8], number(17, U8)),
        "scan_angle" => (&[F32], Place::Angle { at: 18 }),
        "point_source_id" => (&[U8, U16], number(20, U16)),
        "gps_time" => (&[F64, F32], number(22, F64)),
        "red" => color(30)?,
        "green" => color(32)?,
        "blue" => color(34)?,
        "nir" if format == 8 => (&[U16], number(36, U16)),
        _ => return None,
    };
    types.contains(&field.column_type).then_some(place)
}

/// The descriptor of an extra dimension (LAS 1.4 R15, table 24).
pub fn descriptor(field: &Attribute) -> [u8; 192] {
    let mut descriptor = [0; 192];
    descriptor[2] = match field.column_type {
        ColumnType::U8 => 1,
        ColumnType::I8 => 2,
        ColumnType::U16 => 3,
        ColumnType::I16 => 4,
        ColumnType::U32 => 5,
        ColumnType::I32 => 6,
        ColumnType::U64 => 7,
        ColumnType::I64 => 8,
        ColumnType::F32 => 9,
        ColumnType::F64 => 10,
    };
    let mut name = field.name.as_str();
    while name.len() > 32 {
        name = &name[..name.floor_char_boundary(name.len() - 1)];
    }
    descriptor[4..4 + name.len()].copy_from_slice(name.as_bytes());
    descriptor
}
