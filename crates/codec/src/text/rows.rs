//! Makes rows of the lines of a text.

use std::io;
use std::sync::{Mutex, PoisonError};

use cloud::ColumnType;
use glam::{DAffine3, DVec3};

use super::decimals::Sign;
use super::table::Style;
use crate::bytes::Bytes;
use crate::ply::header::{Element, Kind, Property};
use crate::ply::maker::{RowMaker, put_integer, put_number};
use crate::ply::reader::{Reader, has_content};
use crate::ply::rows::Block;

/// Packed rows are passed on when they have this many bytes.
const PACKED_BYTES: usize = 1 << 20;

/// The cells of a scanner's grid, which come column by column; empty ones are zeros.
#[derive(Clone, Copy, Debug)]
pub struct Cells {
    /// The number of cells of a column of the grid.
    pub rows: u64,
    /// From the scanner's own coordinates to those of all scans.
    pub pose: DAffine3,
}

/// Lines of numbers that are points.
pub struct TextRows {
    element: Element,
    style: Style,
    /// For each column of a line the property that it is.
    columns: Vec<Option<usize>>,
    newline: u8,
    has_comments: bool,
    cells: Option<Cells>,
    /// The sign before decimals, which numbers with the other one may contradict.
    sign: Option<Sign>,
    /// The properties whose numbers must agree with it.
    agree: Vec<bool>,
    /// The first row with such a number of those that were made since `doubt` was asked, and what is wrong with that.
    doubt: Mutex<Option<Doubt>>,
    /// The types of properties that are whole numbers of 64 bits, which a double does not hold.
    long: Vec<Option<ColumnType>>,
}

/// A row with a number of which it cannot be told which sign stands before decimals, and that in words.
type Doubt = (u64, String);

/// The bits of a whole number of 64, and whether its text is one.
fn long_number(token: &[u8], value: f64, column_type: ColumnType) -> (u64, bool) {
    let text = std::str::from_utf8(token).unwrap_or_default();
    let (exact, rounded, is_exact) = match column_type {
        ColumnType::U64 => {
            let rounded = value.round() as u64;
            (text.parse().ok(), rounded, rounded as f64 == value && rounded < u64::MAX)
        }
        _ => {
            let rounded = value.round() as i64;
            (
                text.parse::<i64>().ok().map(i64::cast_unsigned),
                rounded.cast_unsigned(),
                rounded as f64 == value && rounded < i64::MAX,
            )
        }
    };
    exact.map_or((rounded, is_exact), |exact| (exact, true))
}

/// Whether a text is a whole number beyond 2^53 that a double does not hold.
fn loses_digits(token: &[u8], value: f64) -> bool {
    let text = || std::str::from_utf8(token).unwrap_or_default();
    value.abs() >= 2_f64.powi(53) && text().parse::<i128>().is_ok_and(|whole| whole != value as i128)
}

impl TextRows {
    /// `columns` are the names and types of a line's columns; the first of these names are those of the place.
    pub fn new(
        style: Style,
        columns: &[Option<(String, ColumnType)>],
        newline: u8,
        has_comments: bool,
        cells: Option<Cells>,
        sign: Option<Sign>,
    ) -> Self {
        let property = |(name, column_type): &(String, ColumnType)| Property {
            name: name.clone(),
            kind: Kind::Scalar(*column_type),
        };
        let mut properties: Vec<Property> = columns.iter().flatten().map(property).collect();
        let mut next = 0..properties.len();
        let columns = columns.iter().map(|column| column.as_ref().and_then(|_| next.next())).collect();
        if cells.is_some() {
            let index = |name: &str| property(&(name.to_owned(), ColumnType::U32));
            properties.extend(["row_index", "column_index"].map(index));
        }
        let long = properties.iter().map(|property| match property.kind {
            Kind::Scalar(own @ (ColumnType::I64 | ColumnType::U64)) => Some(own),
            _ => None,
        });
        let long = long.collect();
        let agree = properties.iter().map(|property| sign.as_ref().is_some_and(|sign| sign.is_of(&property.name)));
        let agree = agree.collect();
        let element = Element { name: "points".into(), count: 0, properties };
        Self { element, style, columns, newline, has_comments, cells, sign, agree, doubt: Mutex::default(), long }
    }

    /// The values of a line, NaN for those that are missing, and the bits of those that are whole numbers of 64. Returns
    /// whether all that are `wanted` are there; those in doubt are missing.
    fn values(
        &self,
        line: &[u8],
        number: u64,
        wanted: &[bool],
        (values, long): (&mut [f64], &mut [u64]),
        doubt: &mut Option<Doubt>,
    ) -> bool {
        values.fill(f64::NAN);
        long.fill(0);
        let mut is_whole = true;
        let mut found = 0;
        for (column, token) in std::iter::zip(&self.columns, self.style.tokens(line)) {
            found += 1;
            if let Some(property) = column.filter(|property| wanted[*property]) {
                let mut value = self.style.number(token);
                if let Some(sign) = self.sign.as_ref().filter(|_| value.is_some() && self.agree[property])
                    && sign.is_contradicted(token)
                {
                    value = None;
                    doubt.get_or_insert_with(|| (number, sign.problem(token, number)));
                }
                is_whole &= value.is_some();
                values[property] = value.unwrap_or(f64::NAN);
                is_whole &= match self.long[property] {
                    Some(column_type) => {
                        let (bits, is_exact) = long_number(token, values[property], column_type);
                        long[property] = bits;
                        is_exact
                    }
                    None => !loses_digits(token, values[property]),
                };
            }
        }
        is_whole &= self.columns[found..].iter().flatten().all(|property| !wanted[*property]);
        if let Some(cells) = self.cells {
            let place = DVec3::new(values[0], values[1], values[2]);
            let is_empty = place == DVec3::ZERO;
            is_whole &= !is_empty;
            let moved = if is_empty { DVec3::NAN } else { cells.pose.transform_point3(place) };
            values[..3].copy_from_slice(&moved.to_array());
            let count = values.len();
            values[count - 2] = (number % cells.rows.max(1)) as f64;
            values[count - 1] = (number / cells.rows.max(1)) as f64;
        }
        is_whole
    }
}

impl RowMaker for TextRows {
    fn element(&self) -> &Element {
        &self.element
    }

    fn damage(&self) -> &'static str {
        match self.cells {
            Some(_) => "are empty cells of the scanner's grid, or have no number, and are left out",
            None => {
                "have text that is not a number, too few numbers, or a number that its column cannot hold, as a whole one \
                 beyond 2^53 among doubles; NaN, 0 or the nearest number that it holds stands for it, and points without a \
                 place are left out"
            }
        }
    }

    fn doubt(&self) -> String {
        let doubt = self.doubt.lock().unwrap_or_else(PoisonError::into_inner).take();
        doubt.map_or_else(String::new, |(_, problem)| format!("; {problem}"))
    }

    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)> {
        let kept: Vec<(usize, ColumnType)> = std::iter::zip(0.., &self.element.properties)
            .filter(|(index, _)| keep[*index])
            .filter_map(|(index, property)| match property.kind {
                Kind::Scalar(scalar) => Some((index, scalar)),
                Kind::List { .. } => None,
            })
            .collect();
        let mut wanted = keep.to_vec();
        if self.cells.is_some() && keep[..3].iter().any(|keep| *keep) {
            // A place is moved as a whole.
            wanted[..3].fill(true);
        }
        let mut values = vec![f64::NAN; self.element.properties.len()];
        let mut long = vec![0; values.len()];
        let mut reader = Reader::new(file, block.offset, block.end);
        let (mut rows, mut damaged, mut doubt) = (0, 0, None);
        let mut packed: Vec<u8> = Vec::new();
        while rows < block.rows {
            let run = reader.lines(self.newline)?;
            if run.is_empty() {
                break;
            }
            for line in run.split(|byte| *byte == self.newline) {
                if !has_content(line, self.has_comments) {
                    continue;
                }
                if rows == block.rows {
                    break;
                }
                let row = block.first_row + rows;
                let is_whole = self.values(line, row, &wanted, (&mut values, &mut long), &mut doubt);
                damaged += u64::from(!is_whole);
                rows += 1;
                for (index, column_type) in &kept {
                    let (at, value) = (packed.len(), values[*index]);
                    packed.resize(at + column_type.size(), 0);
                    match column_type {
                        ColumnType::I64 | ColumnType::U64 => packed[at..].copy_from_slice(&long[*index].to_le_bytes()),
                        ColumnType::U16 => put_integer(&mut packed[at..], *column_type, value.round() as i64),
                        _ => put_number(&mut packed[at..], *column_type, value),
                    }
                }
                if packed.len() >= PACKED_BYTES {
                    give(&packed);
                    packed.clear();
                }
            }
        }
        if !packed.is_empty() {
            give(&packed);
        }
        if doubt.is_some() {
            let mut first = self.doubt.lock().unwrap_or_else(PoisonError::into_inner);
            *first = first.take().into_iter().chain(doubt).min();
        }
        Ok((rows, damaged))
    }
}
