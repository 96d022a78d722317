//! Reads the numbers that a person types, in both languages alike but for one thing: see [`typed_number`].

use crate::shared::language::is_english;

/// What separates thousands, besides a point or a comma. Tabs and ends of lines separate numbers.
fn is_gap(letter: char) -> bool {
    letter.is_whitespace() && !letter.is_control() || matches!(letter, '\'' | '’')
}

/// The number that a person typed, with a decimal point or comma; `None` where that is not sure. Of points and commas, the
/// last is the decimal one, unless it occurs several times. A single one is always that, but for a comma that may separate
/// thousands, which it does in English.
pub fn typed_number(text: &str) -> Option<f64> {
    let (sign, text) = sign(text);
    let marks: Vec<&str> = text.matches(['.', ',']).collect();
    let decimal = marks.last().filter(|last| marks.iter().filter(|mark| mark == last).count() == 1);
    let (whole, rest) = decimal.and_then(|mark| text.split_once(mark)).unwrap_or((text, ""));
    if is_english() && marks == [","] && is_unclear(text) {
        return None;
    }
    let (whole, rest) = (without_thousands(whole)?, without_gaps(rest)?);
    let text = format!("{sign}{whole}{}{rest}", decimal.map_or("", |_| "."));
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

/// Whether the only point or comma of a number may be the decimal one and that of thousands: three digits follow, and one to
/// three are before it, without a zero at their front.
pub fn is_unclear(text: &str) -> bool {
    let (_, text) = sign(text);
    text.matches(['.', ',']).count() == 1 && without_thousands(text).is_some()
}

/// The whole number that a person typed, whose thousands may be separated by points or commas in every language.
pub fn typed_whole_number(text: &str) -> Option<f64> {
    let (sign, digits) = sign(text);
    let number = without_thousands(digits).and_then(|digits| format!("{sign}{digits}").parse().ok());
    number.or_else(|| typed_number(text)).filter(|number| number.is_finite() && number.fract() == 0.0)
}

/// The number that a person typed for what is whole, but for a limit that may lie between: a whole one where it may be.
pub fn typed_limit(text: &str) -> Option<f64> {
    typed_whole_number(text).or_else(|| typed_number(text))
}

fn are_digits(text: &str) -> bool {
    text.bytes().all(|letter| letter.is_ascii_digit())
}

/// The sign before a number, and what follows it.
fn sign(text: &str) -> (&str, &str) {
    let text = text.trim();
    match text.strip_prefix(['-', '−']) {
        Some(rest) => ("-", rest.trim_start()),
        None => ("", text.strip_prefix('+').unwrap_or(text)),
    }
}

/// A text without what separates its thousands; `None` where what separates stands elsewhere than before three digits.
fn without_thousands(text: &str) -> Option<String> {
    let is_mark = |letter: char| matches!(letter, '.' | ',') || is_gap(letter);
    let mut marks = text.chars().filter(|letter| is_mark(*letter)).map(|mark| if is_gap(mark) { ' ' } else { mark });
    let Some(mark) = marks.next() else { return Some(text.to_owned()) };
    let is_same = marks.all(|other| other == mark);
    let mut groups = text.split(is_mark);
    let first = groups.next().unwrap_or_default();
    let is_first = (1..=3).contains(&first.len()) && are_digits(first) && !first.starts_with('0');
    let are_thousands = is_same && is_first && groups.all(|group| group.len() == 3 && are_digits(group));
    are_thousands.then(|| text.split(is_mark).collect())
}

/// Decimals without the gaps between them; `None` where a gap stands elsewhere than behind three digits.
fn without_gaps(decimals: &str) -> Option<String> {
    let Some((groups, last)) = decimals.rsplit_once(is_gap) else { return Some(decimals.to_owned()) };
    let are_groups = groups.split(is_gap).all(|group| group.len() == 3 && are_digits(group));
    let is_last = (1..=3).contains(&last.len()) && are_digits(last);
    (are_groups && is_last).then(|| decimals.split(is_gap).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::language::speak;

    #[test]
    fn whole_numbers_have_separators_of_thousands_in_each_language() {
        let typed = [
            ("500.000", 500_000.0),
            ("750,000", 750_000.0),
            ("16.384", 16_384.0),
            ("2.500.000", 2_500_000.0),
            ("2 500 000", 2_500_000.0),
            ("2\u{202f}500\u{a0}000", 2_500_000.0),
            ("2'500'000", 2_500_000.0),
            (" −1,000 ", -1000.0),
            ("1e7", 1e7),
            ("1,5e6", 1_500_000.0),
            ("12", 12.0),
            ("12,0", 12.0),
        ];
        for language in [scene::Language::German, scene::Language::English] {
            speak(language);
            for (text, number) in typed {
                assert_eq!(typed_whole_number(text), Some(number), "{text}");
            }
            assert_eq!(["500.000", "2.5", "0,125"].map(typed_limit), [500_000.0, 2.5, 0.125].map(Some));
            for text in ["2.7", "0,500", "1.234,567", "1234.567", "1.23.456", "12 34", "two", "", "inf", "."] {
                assert_eq!(typed_whole_number(text), None, "{text}");
            }
        }
    }

    #[test]
    fn numbers_have_a_decimal_point_or_comma_and_thousands_and_what_is_not_sure_is_none() {
        let typed = [
            ("1.5", 1.5),
            (" −2,25 ", -2.25),
            ("1e3", 1000.0),
            ("1 234.5", 1234.5),
            ("-0,125", -0.125),
            (".5", 0.5),
            ("1.234", 1.234),
            ("0.123 456", 0.123_456),
            ("1.234'567’8\t", 1.234_567_8),
            ("1,234.5", 1234.5),
            ("1.250,5", 1250.5),
            ("636.710,25", 636_710.25),
            ("3.636.710", 3_636_710.0),
            ("5,413,587.34", 5_413_587.34),
            ("5 413 587,34", 5_413_587.34),
            ("2'600'000.5", 2_600_000.5),
        ];
        for language in [scene::Language::German, scene::Language::English] {
            speak(language);
            for (text, number) in typed {
                assert_eq!(typed_number(text), Some(number), "{text}");
            }
            let lists =
                ["10.5 20", "1,5 3", "100, 200", "1, 5", "0.5 200", "0.123 4567", "12\t345", "12\n345", "1.5\t2"];
            let others =
                ["1,2,3", "1.2.345", "12.34,5", "1.234.567,8,9", "12 34", "nan", "inf", "1e999", "", ".", "two"];
            for text in lists.into_iter().chain(others) {
                assert_eq!(typed_number(text), None, "{text}");
            }
        }
        assert_eq!(["1,234", "-12,345"].map(typed_number), [None, None]);
        let sure = ["0,123", ",125", "1234,567", "12 345,678"];
        assert_eq!(sure.map(typed_number), [0.123, 0.125, 1234.567, 12_345.678].map(Some));
        speak(scene::Language::German);
        let german = typed_number("636,712");
        speak(scene::Language::English);
        assert_eq!(german, Some(636.712));
    }
}
