//! Round numbers for people: 1, 2 or 5 times a power of ten.

/// The largest of 1, 2 or 5 times a power of ten that is not larger than `most`; `None` if there is none.
pub fn round_below(most: f64) -> Option<f64> {
    if !(most > 0.0 && most.is_finite()) {
        return None;
    }
    let decade = 10_f64.powi(most.log10().floor() as i32);
    // The logarithm may be rounded to the next decade.
    let steps = [10.0, 5.0, 2.0, 1.0, 0.5].into_iter().map(|step| step * decade);
    steps.into_iter().find(|step| *step <= most * (1.0 + 1e-12)).filter(|step| *step > 0.0)
}

/// The number of decimals that multiples of a step need.
pub fn decimals(step: f64) -> usize {
    (-(step * (1.0 + 1e-9)).log10().floor()).clamp(0.0, 12.0) as usize
}

/// A multiple of a step as text: with the decimals that it needs, or with an exponent where these would be too many, or
/// `largest` too long.
pub fn text(value: f64, step: f64, largest: f64) -> String {
    if largest < LONGEST && step >= FINEST {
        return format!("{value:.*}", decimals(step));
    }
    let digits = (largest / step * (1.0 - 1e-9)).log10().ceil().clamp(0.0, 16.0) as usize;
    let text = format!("{value:.digits$e}");
    match text.split_once('e') {
        _ if value.abs() < step * 1e-6 => "0".into(),
        Some((digits, exponent)) if digits.contains('.') => {
            format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.'))
        }
        _ => text,
    }
}

/// A number alone, with four digits and an exponent.
fn alone(value: f64) -> String {
    let text = format!("{value:.3e}");
    let Some((digits, exponent)) = text.split_once('e') else { return text };
    format!("{}e{exponent}", digits.trim_end_matches('0').trim_end_matches('.'))
}

/// Numbers from this one on are not written out.
const LONGEST: f64 = 1e16;
/// The finest step whose decimals are written out.
const FINEST: f64 = 1e-12;

/// The multiples of a round step from `low` to `high` with their texts, at most `most` of them; one of them alone where
/// the two are the same.
pub fn ticks(low: f64, high: f64, most: usize) -> Vec<(f64, String)> {
    let (range, largest) = (high - low, low.abs().max(high.abs()));
    let Some(below) = round_below(range / most.max(2) as f64) else {
        let is_plain = largest == 0.0 || (1e-2..LONGEST).contains(&largest);
        return vec![(low, if is_plain { text(low, 1e-3, largest) } else { alone(low) })];
    };
    // The next round numbers above it.
    let step = [1.0, 2.0, 2.5, 4.0, 5.0, 10.0].into_iter().map(|factor| below * factor);
    let count = |step: f64| ((high / step + 1e-9).floor() - (low / step - 1e-9).ceil()) as i64 + 1;
    let is_round = |step: &f64| round_below(*step).is_some_and(|round| (round / step - 1.0).abs() < 1e-9);
    let step = step.into_iter().filter(is_round).find(|step| count(*step) <= most as i64).unwrap_or(range);
    let first = (low / step - 1e-9).ceil();
    let values = (0..count(step).clamp(0, most as i64)).map(|index| (first + index as f64) * step);
    values.map(|value| (value, text(value, step, largest))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_one_two_or_five_and_as_large_as_fit() {
        for (most, expected) in
            [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (5.0, 5.0), (9.99, 5.0), (0.034, 0.02), (7300.0, 5000.0)]
        {
            assert!((round_below(most).unwrap() / expected - 1.0).abs() < 1e-9, "{most}");
        }
        for exponent in -12..=12 {
            let most = 10_f64.powi(exponent);
            assert!((round_below(most).unwrap() / most - 1.0).abs() < 1e-9, "{most}");
        }
        assert_eq!([0.0, -1.0, f64::NAN, f64::INFINITY].map(round_below), [None; 4]);
        assert_eq!([0.05, 0.2, 1.0, 50.0].map(decimals), [2, 1, 0, 0]);
    }

    #[test]
    fn ticks_lie_in_the_range_at_equal_round_distances() {
        for (low, high) in [(0.0, 1.0), (-3.2, 17.9), (247_570.1, 247_570.9), (1e8, 1e8 + 3.0), (2.0, 255.0)] {
            let ticks: Vec<f64> = ticks(low, high, 6).into_iter().map(|(tick, _)| tick).collect();
            assert!((2..=6).contains(&ticks.len()), "{low} {high}: {ticks:?}");
            let step = ticks[1] - ticks[0];
            assert!(ticks.iter().all(|tick| (low - step * 1e-6..=high + step * 1e-6).contains(tick)), "{ticks:?}");
        }
        assert_eq!(ticks(4.0, 4.0, 6), [(4.0, "4.000".into())]);
        assert_eq!(
            ticks(0.0, 10.0, 6).iter().map(|(tick, _)| *tick).collect::<Vec<_>>(),
            [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
        );
    }

    #[test]
    fn ticks_far_from_one_have_exponents() {
        let texts = |low, high| -> Vec<String> { ticks(low, high, 6).into_iter().map(|(_, text)| text).collect() };
        assert_eq!(texts(0.0, 10.0), ["0", "2", "4", "6", "8", "10"]);
        assert_eq!(texts(0.0, 0.5), ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5"]);
        assert_eq!(texts(1e-30, 1e30), ["0", "2e29", "4e29", "6e29", "8e29", "1e30"]);
        assert_eq!(texts(-1e30, 1e30), ["-1e30", "-5e29", "0", "5e29", "1e30"]);
        assert_eq!(texts(1e20, 1.01e20)[..2], ["1e20", "1.002e20"]);
        assert_eq!(texts(1e-30, 1e-29)[..2], ["2e-30", "4e-30"]);
        assert_eq!([texts(1e30, 1e30), texts(3e-20, 3e-20), texts(0.5, 0.5)].concat(), ["1e30", "3e-20", "0.500"]);
        let alone = [6.18e33, f64::from(1.1e30_f32), -2e-7, 0.0].map(|value| texts(value, value).concat());
        assert_eq!(alone, ["6.18e33", "1.1e30", "-2e-7", "0.000"]);
    }
}
