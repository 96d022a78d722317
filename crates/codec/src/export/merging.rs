//! How the fields of several files become those of one: by their names, or by their meaning in LAS.

use std::collections::HashMap;

use cloud::{Column, ColumnType};

use super::columns::{Field, Meaning, all_fields, columns_of, with_none};
use super::names::{EXTRA_LENGTH, Names};
use super::standard::{Values, is_reserved, scaled, standard};

/// Where a field's values are in a file: its column, and the factor that brings it to the field's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin {
    pub column: usize,
    pub factor: f64,
}

impl Origin {
    /// The values of the field among the columns of a piece of the file.
    pub fn values<'a>(&self, columns: &'a [Column], own: &'a mut Option<Column>) -> Option<&'a Column> {
        let column = columns.get(self.column)?;
        Some(if self.factor == 1.0 { column } else { own.insert(scaled(column, self.factor)) })
    }
}

/// The fields of a file that is made of several.
#[derive(Clone, Debug)]
pub struct Merged {
    pub fields: Vec<Field>,
    /// For each file and field where its values come from; `None` if the file has none.
    pub origins: Vec<Vec<Option<Origin>>>,
}

impl Merged {
    /// Fields of one name become one.
    pub fn by_name(files: &[Vec<Field>]) -> Self {
        let fields = all_fields(files);
        let origin = |column: Option<usize>| column.map(|column| Origin { column, factor: 1.0 });
        let of_file = |file: &Vec<Field>| columns_of(&fields, file).into_iter().map(origin).collect();
        let origins = files.iter().map(of_file).collect();
        Self { fields, origins }
    }

    /// Fields of one meaning become the field of LAS that has it, if it holds the values; others become extra dimensions.
    /// `values` describes the columns of files that are not LAS. Words are said of files by their number.
    pub fn for_las(files: &[Vec<Field>], values: &[Vec<Option<Values>>], say: &mut dyn FnMut(usize, String)) -> Self {
        // What each column of each file becomes: names of fields, with factors.
        let mut becomes: Vec<Vec<Vec<(Field, f64)>>> = Vec::new();
        for (number, file) in files.iter().enumerate() {
            let mut taken: Vec<&str> = Vec::new();
            let mut of_file = vec![Vec::new(); file.len()];
            // A column of the very name of a field comes first.
            let mut order: Vec<usize> = (0..file.len()).collect();
            order.sort_by_key(|column| {
                standard(file[*column].name()).is_none_or(|own| own.name != file[*column].name())
            });
            for column in order {
                let field = &file[column];
                let rest = Field { meaning: Meaning::Other, ..field.clone() };
                let values = values.get(number).and_then(|values| values.get(column)?.as_ref());
                of_file[column] = match (field.meaning, standard(field.name()), values) {
                    (Meaning::Coordinate | Meaning::Color | Meaning::Standard, ..) => vec![(field.clone(), 1.0)],
                    (Meaning::Wave, ..) => Vec::new(),
                    (Meaning::Other, Some(own), Some(values)) if !taken.contains(&own.name) => {
                        match own.fit(field.name(), field.column_type(), values) {
                            Some(fit) => {
                                taken.push(own.name);
                                fit.word.into_iter().for_each(|word| say(number, word));
                                let mut all =
                                    vec![(Field::new(own.name, field.column_type(), Meaning::Standard), fit.factor)];
                                all.extend(fit.is_clamped.then_some((rest, 1.0)));
                                all
                            }
                            None => vec![(rest, 1.0)],
                        }
                    }
                    (Meaning::Other, ..) => vec![(rest, 1.0)],
                };
            }
            becomes.push(of_file);
        }
        let key = |field: &Field| (field.name().to_owned(), field.meaning == Meaning::Other);
        let mut fields: Vec<Field> = Vec::new();
        let mut places: HashMap<(String, bool), usize> = HashMap::new();
        for field in becomes.iter().flatten().flatten().map(|(field, _)| field) {
            match places.get(&key(field)).map(|place| &mut fields[*place]) {
                None => {
                    places.insert(key(field), fields.len());
                    fields.push(field.clone());
                }
                Some(known) if known.column_type() != field.column_type() => {
                    known.attribute.column_type = ColumnType::F64;
                }
                Some(_) => {}
            }
        }
        let of_file = |file: &Vec<Vec<(Field, f64)>>| {
            let mut origins = vec![None; fields.len()];
            for (column, (field, factor)) in
                file.iter().enumerate().flat_map(|(column, all)| all.iter().map(move |own| (column, own)))
            {
                if let Some(place) = places.get(&key(field)) {
                    origins[*place] = Some(Origin { column, factor: *factor });
                }
            }
            origins
        };
        let origins = becomes.iter().map(of_file).collect();
        let mut merged = Self { fields, origins };
        merged.rename(say);
        merged
    }

    /// Gives extra dimensions names that differ within their length, and from those of standard ones.
    fn rename(&mut self, say: &mut dyn FnMut(usize, String)) {
        let mut names = Names::default();
        for (number, field) in self.fields.iter_mut().enumerate().filter(|(_, field)| field.meaning == Meaning::Other) {
            let wanted =
                if is_reserved(field.name()) { format!("{}_extra", field.name()) } else { field.name().into() };
            let name = names.take(&wanted, EXTRA_LENGTH);
            if name != field.name() {
                let file = self.origins.iter().position(|origins| origins[number].is_some()).unwrap_or(0);
                say(file, format!("{} became the extra dimension {name}", field.name()));
                field.attribute.name = name;
            }
        }
    }

    /// Gives fields that some files do not have a type with NaN, where values may be of any type.
    pub fn leave_room_for_none(&mut self) {
        for (number, field) in self.fields.iter_mut().enumerate() {
            let is_missing = self.origins.iter().any(|origins| origins[number].is_none());
            if is_missing && !matches!(field.meaning, Meaning::Coordinate | Meaning::Color) {
                field.attribute.column_type = with_none(field.column_type());
            }
        }
    }

    /// The names of the fields that a file does not have, colours apart.
    pub fn missing(&self, file: usize, is_meant: impl Fn(&Field) -> bool) -> Vec<&str> {
        let is_missing = |(number, field): &(usize, &Field)| {
            self.origins[file][*number].is_none() && field.meaning != Meaning::Color && is_meant(field)
        };
        self.fields.iter().enumerate().filter(is_missing).map(|(_, field)| field.name()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cloud::ColumnType::{F32, F64, I32, U8, U16};

    fn field(name: &str, column_type: ColumnType, meaning: Meaning) -> Field {
        Field::new(name, column_type, meaning)
    }

    fn values(column: &Column) -> Option<Values> {
        let mut values = Values::default();
        values.add(column, &(0..column.len() as u32).collect::<Vec<u32>>());
        Some(values)
    }

    fn merged(files: &[Vec<Field>], columns: &[&[Option<Values>]]) -> (Merged, Vec<String>) {
        let mut words = Vec::new();
        let columns: Vec<_> = columns.iter().map(|columns| columns.to_vec()).collect();
        let merged = Merged::for_las(files, &columns, &mut |file, word| words.push(format!("{file}: {word}")));
        (merged, words)
    }

    #[test]
    fn properties_go_to_the_fields_that_hold_their_values_and_to_extra_dimensions_else() {
        use Meaning::{Coordinate, Other, Standard};
        let las = vec![field("x", F64, Coordinate), field("intensity", U16, Standard)];
        let ply = vec![
            field("x", F32, Coordinate),
            field("scalar_Intensity", F32, Other),
            field("intensity", U16, Other),
            field("classification", I32, Other),
        ];
        let of_ply =
            [None, values(&Column::F32(vec![0.5])), values(&Column::U16(vec![7])), values(&Column::I32(vec![-1]))];
        let (merged, words) = merged(&[las, ply], &[&[], &of_ply]);
        let names: Vec<&str> = merged.fields.iter().map(Field::name).collect();
        assert_eq!(names, ["x", "intensity", "scalar_Intensity_extra", "classification_extra"]);
        assert_eq!(merged.fields[2].column_type(), F32);
        let columns =
            |file: usize| merged.origins[file].iter().map(|own| own.map(|own| own.column)).collect::<Vec<_>>();
        assert_eq!(columns(0), [Some(0), Some(1), None, None]);
        assert_eq!(columns(1), [Some(0), Some(2), Some(1), Some(3)]);
        assert!(
            words.len() == 2 && words[1] == "1: classification became the extra dimension classification_extra",
            "{words:?}"
        );
        assert_eq!(merged.missing(0, |_| true), ["scalar_Intensity_extra", "classification_extra"]);
    }

    #[test]
    fn each_file_has_its_own_scale() {
        use Meaning::Other;
        let files = [vec![field("intensity", F32, Other)], vec![field("scalar_Intensity", F32, Other)]];
        let (light, whole) = (values(&Column::F32(vec![0.25, 1.0])), values(&Column::F32(vec![300.0, 20.0])));
        let (merged, words) = merged(&files, &[&[light], &[whole]]);
        assert_eq!(merged.fields.len(), 1);
        assert_eq!(merged.origins[0][0], Some(Origin { column: 0, factor: 65535.0 }));
        assert_eq!(merged.origins[1][0], Some(Origin { column: 0, factor: 1.0 }));
        assert_eq!(words, ["0: intensity: 0 to 1 became 0 to 65535 of intensity"]);
    }

    #[test]
    fn a_field_that_a_file_lacks_has_room_for_none() {
        use Meaning::{Color, Other};
        let files = [vec![field("red", U8, Color), field("label", U8, Other)], vec![field("c2m", F64, Other)]];
        let mut merged = Merged::by_name(&files);
        merged.leave_room_for_none();
        let types: Vec<ColumnType> = merged.fields.iter().map(Field::column_type).collect();
        assert_eq!(types, [U8, F32, F64]);
        assert_eq!(merged.missing(1, |_| true), ["label"]);
    }
}
