//! Numbers as text, for people.

use glam::DVec3;

/// Groups the digits of a number: `1234567` becomes `1,234,567`.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let groups: Vec<&str> =
        digits.as_bytes().rchunks(3).rev().filter_map(|group| std::str::from_utf8(group).ok()).collect();
    groups.join(",")
}

/// Formats a positive number with two digits that count: `0.0016`, `12`.
pub fn two_digits(value: f64) -> String {
    let decimals = (1.0 - value.log10().floor()).clamp(0.0, 12.0) as usize;
    coordinate(value, decimals)
}

/// Formats a number with at most `decimals` decimals, without zeros at the end.
pub fn coordinate(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    if decimals == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').to_owned() }
}

/// A seed of draws.
///
/// # Errors
/// Says what is expected.
pub fn parse_seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| format!("expected a whole number from 0 to {}", u64::MAX))
}

/// Reads a place, `X,Y,Z`.
pub fn parse_place(text: &str) -> Result<DVec3, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let place = numbers.ok().and_then(|numbers| <[f64; 3]>::try_from(numbers).ok()).map(DVec3::from);
    place.filter(|place| place.is_finite()).ok_or_else(|| "expected X,Y,Z, as in 1.5,-2,0.75".into())
}
