//! The properties of records as columns, for files of another kind.

use cloud::{Column, ColumnType, Progress};

use super::LasSource;
use super::columns::ColorDepth;
use super::layout::{Layout, Property, Reading};
use crate::export::columns::{Colors, Field, Meaning, Piece, Reading as Wish, place};
use crate::in_order::InOrder;

impl LasSource {
    /// The properties that have a type.
    pub fn column_fields(&self, colors: Colors) -> Vec<Field> {
        let of = |property: &Property| {
            let meaning = self.meaning(property);
            let is_byte = meaning == Meaning::Color && colors == Colors::Bytes;
            let column_type = if is_byte { ColumnType::U8 } else { property.reading.column_type() };
            Field::new(&property.name, column_type, meaning)
        };
        self.typed().map(of).collect()
    }

    /// What a property is. An extra dimension may have the name of a standard one that the point format lacks.
    fn meaning(&self, property: &Property) -> Meaning {
        let at = property.reading.at();
        let waves = self.info.point_format.and_then(Layout::wave_packet);
        match property.reading {
            Reading::Coordinate { .. } => Meaning::Coordinate,
            _ if at >= self.base_length() => Meaning::Other,
            _ if waves.is_some_and(|waves| at >= waves) => Meaning::Wave,
            _ if self.layout.red.is_some_and(|red| (red..red + 6).contains(&at)) => Meaning::Color,
            _ => Meaning::Standard,
        }
    }

    /// The range of its colours; `None` if all points are black or have no colour.
    pub fn color_depth(&self) -> Option<ColorDepth> {
        self.colors
    }

    /// Whether some of its points have another colour than black.
    pub fn has_colors(&self) -> bool {
        self.colors.is_some()
    }

    /// The number of bytes of each record that have no type, which no column holds.
    pub fn opaque_bytes(&self) -> usize {
        let length = |property: &Property| match property.reading {
            Reading::Opaque { length, .. } => length,
            _ => 0,
        };
        self.layout.properties.iter().map(length).sum()
    }

    /// Passes the columns of `column_fields` to `rows_of`; the rows that it makes of the points that are shown go to
    /// `order`, in the order of the file. Returns what could not be read.
    pub fn read_columns_in_order(
        &self,
        wish: &Wish<'_>,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        let test = self.record_test(wish.test);
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
            let column = |(number, property): (usize, &Property)| {
                if !wish.needs(number) {
                    return Column::with_capacity(property.reading.column_type(), 0);
                }
                let mut column = Column::with_capacity(property.reading.column_type(), points);
                property.reading.append(&mut column, records, length, &grid);
                match (column, wish.colors) {
                    (column, Colors::Own) => column,
                    (Column::U16(values), colors) if self.meaning(property) == Meaning::Color => match colors {
                        Colors::Bytes => Column::U8(values.into_iter().map(|value| depth.narrow(value)).collect()),
                        _ => Column::U16(values.into_iter().map(|value| depth.widen(value)).collect()),
                    },
                    (column, _) => column,
                }
            };
            let mut columns: Vec<Column> = self.typed().enumerate().map(column).collect();
            if let Some(placement) = &self.info.placement {
                let is_axis = |axis| move |property: &Property| property.reading == (Reading::Coordinate { axis });
                let coordinates = [0, 1, 2].map(|axis| self.typed().position(is_axis(axis)).unwrap_or(usize::MAX));
                place(&mut columns, coordinates, None, placement);
            }
            Ok(rows_of(Piece { first_point, points, columns, kept }))
        })
    }

    fn typed(&self) -> impl Iterator<Item = &Property> {
        self.layout.properties.iter().filter(|property| !matches!(property.reading, Reading::Opaque { .. }))
    }
}
