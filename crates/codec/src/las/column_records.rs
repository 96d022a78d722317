//! Makes records of point formats 6 to 8 of columns: standard fields, and extra dimensions for all others.

use std::io;
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Column, ColumnType, Grid};
use glam::DVec3;

use super::layout::Layout;
use super::output_records::{Target, far_outside};
use crate::export::columns::{Field, Meaning, Piece, loses_digits, put, put_none};
use crate::export::grid::rounding;
use crate::export::merging::Origin;
use crate::export::standard::ANGLE_STEPS;

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
    fields: Vec<Field>,
    places: Vec<Place>,
    losses: Mutex<Losses>,
}

/// What records hold otherwise than the columns that they were made of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Losses {
    /// The farthest that coordinates were moved to a step of the grid.
    pub moved: DVec3,
    /// The names of fields of whole numbers of 64 bits that became doubles and lost digits.
    pub digits: Vec<String>,
}

impl RecordFormat {
    /// Fields other than those of LAS have different names of 32 bytes at most.
    pub fn new(fields: Vec<Field>, grid: Grid) -> Self {
        let has = |name: &str| fields.iter().any(|field| field.name() == name && field.meaning != Meaning::Other);
        let format = match (has("red"), has("nir")) {
            (_, true) => 8,
            (true, false) => 7,
            (false, false) => 6,
        };
        let base = Layout::base_length(format).unwrap_or(0);
        let (mut places, mut descriptors, mut length) = (Vec::new(), Vec::new(), base);
        for field in &fields {
            let place = standard(field).unwrap_or_else(|| {
                descriptors.extend(descriptor(&field.attribute));
                let place = Place::Number { at: length, column_type: field.column_type() };
                length += field.column_type().size();
                place
            });
            places.push(place);
        }
        let target = Target { format, extra: length - base };
        Self { target, grid, descriptors, fields, places, losses: Mutex::default() }
    }

    /// The records of the kept points. `origins` says where in the piece the values of each field are.
    ///
    /// # Errors
    /// A point that the grid does not reach.
    pub fn rows(&self, piece: &Piece, origins: &[Option<Origin>]) -> io::Result<Vec<u8>> {
        let length = self.target.record_length();
        let mut rows = vec![0; piece.kept.len() * length];
        let has = |name: &str| {
            let is_named = |(field, origin): (&Field, &Option<Origin>)| field.name() == name && origin.is_some();
            self.fields.iter().zip(origins).any(is_named)
        };
        if !has("return_number") && !has("number_of_returns") {
            // A point is the first return of one, unless its file says something else.
            rows.chunks_exact_mut(length).for_each(|row| row[14] = 1 | 1 << 4);
        }
        let mut losses = Losses::default();
        for ((field, place), origin) in self.fields.iter().zip(&self.places).zip(origins) {
            let mut own = None;
            match (origin.as_ref().and_then(|origin| origin.values(&piece.columns, &mut own)), place) {
                (Some(column), place) => {
                    self.put(&mut rows, place, column, &piece.kept, &mut losses)?;
                    if field.column_type() == ColumnType::F64 && loses_digits(column, &piece.kept) {
                        losses.digits.push(field.name().into());
                    }
                }
                (None, Place::Number { at, column_type }) if field.meaning == Meaning::Other => {
                    put_none(&mut rows, length, *at, *column_type);
                }
                (None, _) => {}
            }
        }
        if losses != Losses::default() {
            let mut all = self.losses.lock().unwrap_or_else(PoisonError::into_inner);
            all.moved = all.moved.max(losses.moved);
            losses.digits.retain(|name| !all.digits.contains(name));
            all.digits.append(&mut losses.digits);
        }
        Ok(rows)
    }

    /// What the records that were made hold otherwise than their columns.
    pub fn losses(&self) -> Losses {
        self.losses.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn put(
        &self,
        rows: &mut [u8],
        place: &Place,
        column: &Column,
        kept: &[u32],
        losses: &mut Losses,
    ) -> io::Result<()> {
        let length = self.target.record_length();
        match *place {
            Place::Coordinate { axis } => {
                let (scale, offset) = (self.grid.scale[axis], self.grid.offset[axis]);
                let mut moved = 0.0_f64;
                for (row, index) in rows.chunks_exact_mut(length).zip(kept) {
                    let value = column.value(*index as usize);
                    let step = ((value - offset) / scale).round();
                    // NaN fails the comparison.
                    let is_reached = step.abs() <= f64::from(i32::MAX);
                    if !is_reached {
                        return Err(far_outside());
                    }
                    moved = moved.max(rounding(column, value, step * scale + offset));
                    row[4 * axis..4 * axis + 4].copy_from_slice(&(step as i32).to_le_bytes());
                }
                losses.moved[axis] = losses.moved[axis].max(moved);
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

/// The place of a field that records of formats 6 to 8 have.
fn standard(field: &Field) -> Option<Place> {
    use ColumnType::{F64, U8, U16};
    if field.meaning == Meaning::Other {
        return None;
    }
    let bits = |at, shift, mask| Place::Bits { at, shift, mask };
    let number = |at, column_type| Place::Number { at, column_type };
    Some(match field.name() {
        "x" => Place::Coordinate { axis: 0 },
        "y" => Place::Coordinate { axis: 1 },
        "z" => Place::Coordinate { axis: 2 },
        "intensity" => number(12, U16),
        "return_number" => bits(14, 0, 15),
        "number_of_returns" => bits(14, 4, 15),
        "synthetic" => bits(15, 0, 1),
        "key_point" => bits(15, 1, 1),
        "withheld" => bits(15, 2, 1),
        "overlap" => bits(15, 3, 1),
        "scanner_channel" => bits(15, 4, 3),
        "scan_direction_flag" => bits(15, 6, 1),
        "edge_of_flight_line" => bits(15, 7, 1),
        "classification" => number(16, U8),
        "user_data" => number(17, U8),
        "scan_angle" => Place::Angle { at: 18 },
        "point_source_id" => number(20, U16),
        "gps_time" => number(22, F64),
        "red" => number(30, U16),
        "green" => number(32, U16),
        "blue" => number(34, U16),
        "nir" => number(36, U16),
        _ => return None,
    })
}

/// The descriptor of an extra dimension (LAS 1.4 R15, table 24), whose name has 32 bytes at most.
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
    let name = &field.name[..field.name.floor_char_boundary(32)];
    descriptor[4..4 + name.len()].copy_from_slice(name.as_bytes());
    descriptor
}
