//! Finds the line of a plan's file that an error is about.

use toml::de::{DeTable, DeValue};

pub(super) fn at_line(place: &str, line: Option<usize>) -> String {
    line.map_or(place.to_owned(), |line| format!("{place}:{line}"))
}

pub(super) fn line_at(text: &str, offset: usize) -> usize {
    text.as_bytes().iter().take(offset).filter(|byte| **byte == b'\n').count() + 1
}

/// The line of the value at `path`, or of the last part of the path that the file has.
pub(super) fn line_of(text: &str, table: &DeTable<'_>, path: &[String]) -> Option<usize> {
    let (first, rest) = path.split_first()?;
    let (key, value) = table.iter().find(|(key, _)| key.get_ref().as_ref() == first.as_str())?;
    let (mut line, mut value, mut rest) = (line_at(text, key.span().start), value, rest);
    while let Some((step, after)) = rest.split_first() {
        value = match value.get_ref() {
            DeValue::Array(array) => match step.parse::<usize>().ok().and_then(|index| array.get(index)) {
                Some(item) => item,
                None => break,
            },
            DeValue::Table(table) => return line_of(text, table, rest).or(Some(line)),
            _ => break,
        };
        (line, rest) = (line_at(text, value.span().start), after);
    }
    Some(line)
}
