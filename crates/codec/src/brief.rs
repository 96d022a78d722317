//! Shortens a file's text and numbers for messages of one line.

use glam::DVec3;

/// The number of characters of a file's text that are quoted.
const QUOTED: usize = 40;
/// The length of the longest number that is written out: 17 digits, a point, a sign.
const WRITTEN_OUT: usize = 19;

/// The start of a text, long enough to recognise it, without control characters.
pub fn brief(text: &str) -> String {
    let mut characters = text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c });
    let mut quoted: String = characters.by_ref().take(QUOTED).collect();
    if characters.next().is_some() {
        quoted.push('…');
    }
    quoted
}

/// An error of another crate with its causes, which may quote the file, in one line.
pub fn message(error: &dyn std::error::Error) -> String {
    const MOST: usize = 200;
    let causes = std::iter::successors(Some(error), |error| error.source()).map(ToString::to_string);
    let mut whole = causes.collect::<Vec<_>>().join(": ").replace(char::is_control, " ");
    if whole.chars().count() > MOST {
        whole = whole.chars().take(MOST).chain(['…']).collect();
    }
    whole
}

/// A number in full, with an exponent where it would be long: 1e-310 instead of 312 characters.
pub fn number(value: f64) -> String {
    let text = value.to_string();
    if text.len() <= WRITTEN_OUT { text } else { format!("{value:e}") }
}

/// Three numbers in the form in which `DVec3` writes them.
pub fn vector(value: DVec3) -> String {
    format!("[{}]", value.to_array().map(number).join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_says_takes_no_more_than_a_part_of_a_line() {
        assert_eq!(brief("red"), "red");
        assert_eq!(brief(&"x".repeat(40)).chars().count(), 40);
        assert_eq!(brief(&"x".repeat(1 << 20)), format!("{}…", "x".repeat(40)));
        assert_eq!(brief("a\u{1b}[31m"), "a\u{fffd}[31m");
        assert_eq!(vector(DVec3::new(0.001, -5e-324, 1.0)), "[0.001, -5e-324, 1]");
        for value in [f64::MIN, f64::MAX, -f64::MIN_POSITIVE, 1.0 / 3.0, f64::NAN, f64::NEG_INFINITY] {
            let text = number(value);
            assert!(text.len() <= 24 && text.parse::<f64>().unwrap().total_cmp(&value).is_eq(), "{text}");
        }
    }
}
