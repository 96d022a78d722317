//! Rows that a file does not have as such: of another format, or compressed.

use std::io;

use cloud::ColumnType;

use super::header::{Element, Kind};
use super::rows::{Block, scalar_text_le};
use crate::bytes::Bytes;

/// Makes packed rows of a file. All else that is done with rows is the same for all formats.
pub trait RowMaker: Send + Sync {
    /// The points, with the properties of a row in order, all scalars.
    fn element(&self) -> &Element;

    /// The size of a row in the file in bytes, where blocks may begin at any row.
    fn stride(&self) -> Option<usize> {
        None
    }

    /// What a damaged row is, as the end of a sentence about points.
    fn damage(&self) -> &'static str {
        "have text that is not a number, or too few numbers; NaN or 0 stands for it, and points without a place are left \
         out"
    }

    /// What else there is to say of damaged rows that were made since this was last asked, as the rest of that sentence.
    fn doubt(&self) -> String {
        String::new()
    }

    /// Makes the first `block.rows` rows of a block, with the properties that `keep` names, packed little-endian, and passes
    /// them to `give` in pieces. Returns how many rows there were, and how many of them were damaged.
    ///
    /// # Errors
    /// If the file cannot be read there, or is damaged.
    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)>;

    /// Every property of a row as text; `None` if the row is gone.
    ///
    /// # Errors
    /// Those of `make`.
    fn record(&self, file: &Bytes, block: Block, row: u64) -> io::Result<Option<Vec<(String, String)>>> {
        let element = self.element();
        let stride = element.stride().unwrap_or(0) as usize;
        let wanted = (row - block.first_row) as usize;
        let (mut before, mut found) = (0, None);
        let block = Block { rows: wanted as u64 + 1, ..block };
        self.make(file, block, &vec![true; element.properties.len()], &mut |piece| {
            let rows = piece.len() / stride.max(1);
            if found.is_none() && wanted < before + rows {
                found = Some(piece[(wanted - before) * stride..][..stride].to_vec());
            }
            before += rows;
        })?;
        let Some(found) = found else { return Ok(None) };
        let mut at = 0;
        let values = element.properties.iter().filter_map(|property| {
            let Kind::Scalar(scalar) = property.kind else { return None };
            at += scalar.size();
            Some((property.name.clone(), scalar_text_le(&found[at - scalar.size()..at], scalar)))
        });
        Ok(Some(values.collect()))
    }
}

/// Writes a number in its type, little-endian; one beyond the type becomes the nearest value of it.
pub fn put_number(row: &mut [u8], column_type: ColumnType, value: f64) {
    match column_type {
        ColumnType::F32 => put(row, (value as f32).to_le_bytes()),
        ColumnType::F64 => put(row, value.to_le_bytes()),
        _ => put_integer(row, column_type, value as i64),
    }
}

/// Writes a whole number in its type, little-endian; one beyond the type becomes the nearest value of it.
pub fn put_integer(row: &mut [u8], column_type: ColumnType, value: i64) {
    let within = |least: i64, most: i64| value.clamp(least, most);
    match column_type {
        ColumnType::U8 => put(row, (within(0, 0xff) as u8).to_le_bytes()),
        ColumnType::I8 => put(row, (within(-0x80, 0x7f) as i8).to_le_bytes()),
        ColumnType::U16 => put(row, (within(0, 0xffff) as u16).to_le_bytes()),
        ColumnType::I16 => put(row, (within(-0x8000, 0x7fff) as i16).to_le_bytes()),
        ColumnType::U32 => put(row, (within(0, 0xffff_ffff) as u32).to_le_bytes()),
        ColumnType::I32 => put(row, (within(-0x8000_0000, 0x7fff_ffff) as i32).to_le_bytes()),
        ColumnType::U64 => put(row, (value.max(0) as u64).to_le_bytes()),
        ColumnType::I64 => put(row, value.to_le_bytes()),
        ColumnType::F32 => put(row, (value as f32).to_le_bytes()),
        ColumnType::F64 => put(row, (value as f64).to_le_bytes()),
    }
}

fn put<const N: usize>(row: &mut [u8], bytes: [u8; N]) {
    row[..N].copy_from_slice(&bytes);
}
