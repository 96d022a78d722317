//! The properties of records as columns, for files of another kind.

use cloud::{Attribute, Column, ColumnType, PointTest, Progress};

use super::LasSource;
use super::columns::ColorDepth;
use super::layout::{Property, Reading};
use crate::export::columns::{Piece, place};
use crate::in_order::InOrder;

const COLORS: [&str; 3] = ["red", "green", "blue"];

impl LasSource {
    /// The properties that have a type, with colours of 8 bits or, if they are `wide`, of 16.
    pub fn column_fields(&self, wide: bool) -> Vec<Attribute> {
        let of = |property: &Property| {
            let is_color = COLORS.contains(&property.name.as_str());
            let narrow = is_color && !wide;
            let column_type = if narrow { ColumnType::U8 } else { property.reading.column_type() };
            Attribute { name: property.name.clone(), column_type }
        };
        self.typed().map(of).collect()
    }

    fn typed(&self) -> impl Iterator<Item = &Property> {
        self.layout.properties.iter().filter(|property| !matches!(property.reading, Reading::Opaque { .. }))
    }

    /// Passes the columns of `column_fields` to `rows_of`; the rows that it makes of the points that are shown go to
    /// `order`, in the order of the file. Returns what could not be read.
    pub fn read_columns_in_order(
        &self,
        test: &PointTest,
        wide: bool,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let test = self.record_test(test);
        let (length, grid) = (self.layout.record_length, self.grid);
        let depth = self.colors.unwrap_or(ColorDepth::Sixteen);
        self.read_records_in_order(progress, order, |first_point, records| {
            let points = records.len() / length;
            let kept: Vec<u32> = match test.as_ref().map(|test| test.shown(records)) {
                None => (0..points as u32).collect(),
                Some(shown) => shown.indices(points).map(|index| index as u32).collect(),
            };
            if kept.is_empty() {
                return Ok(Vec::new());
            }
            let column = |property: &Property| {
                let mut column = Column::with_capacity(property.reading.column_type(), points);
                property.reading.append(&mut column, records, length, &grid);
                match column {
                    Column::U16(values) if COLORS.contains(&property.name.as_str()) => match wide {
                        false => Column::U8(values.into_iter().map(|value| depth.narrow(value)).collect()),
                        true => Column::U16(values.into_iter().map(|value| depth.widen(value)).collect()),
                    },
                    column => column,
                }
            };
            let mut columns: Vec<Column> = self.typed().map(column).collect();
            if let Some(placement) = &self.info.placement {
                let is_axis = |axis| move |property: &Property| property.reading == (Reading::Coordinate { axis });
                let coordinates = [0, 1, 2].map(|axis| self.typed().position(is_axis(axis)).unwrap_or(usize::MAX));
                place(&mut columns, coordinates, None, placement);
            }
            Ok(rows_of(Piece { first_point, points, columns, kept }))
        })
    }
}
