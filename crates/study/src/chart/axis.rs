//! Axes: the place of a value along the line, and the labels beside it.

/// Values that span more than this many decades get a logarithmic axis.
const LOG_FROM: f64 = 1.5;
/// The share of a logarithmic axis that is reserved for the value zero.
const FLOOR: f64 = 0.08;
/// The room beyond the outermost values as a share of the axis.
const MARGIN: f64 = 0.05;

#[derive(Clone, Debug, PartialEq)]
enum Scale {
    Linear,
    Log,
    /// A place for each of these words.
    Words(Vec<String>),
}

/// Maps values to places along a line.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    low: f64,
    high: f64,
    scale: Scale,
    /// The values at the beginning of a logarithmic axis, which have no other place on it.
    floor: Floor,
    /// The values that are ticks, instead of round ones.
    stops: Vec<f64>,
}

/// The kind of values at the beginning of a logarithmic axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Floor {
    /// None.
    None,
    /// Only zeros.
    Zero,
    /// Zeros, and values above zero that are negligible beside the others.
    NearZero,
}

/// The decades of a logarithmic axis: a value of a ten-thousandth of another one might as well be zero.
const MOST_DECADES: f64 = 4.0;
/// The length of the shortest logarithmic axis: it contains two round values.
const LEAST_DECADES: f64 = 0.7;
/// Up to this many values are ticks themselves.
const MOST_STOPS: usize = 10;

/// A mark on an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// The place, 0 to 1.
    pub share: f64,
    pub label: String,
}

impl Axis {
    /// An axis for any values: linear, or logarithmic if no value is negative and they span more than one and a half
    /// decades.
    pub fn of(values: &[f64]) -> Self {
        let positive = || values.iter().copied().filter(|value| *value > 0.0);
        let (least, most) = (positive().fold(f64::INFINITY, f64::min), positive().fold(0.0, f64::max));
        let is_negative = values.iter().any(|value| *value < 0.0);
        if !is_negative && most > 0.0 && (most / least).log10() > LOG_FROM {
            Self::log(values)
        } else {
            Self::linear(values)
        }
    }

    /// An axis for errors charted against time: logarithmic from one decade on, because otherwise the error of doing
    /// nothing would flatten all others.
    pub fn of_errors(values: &[f64]) -> Self {
        let positive = || values.iter().copied().filter(|value| *value > 0.0);
        let (least, most) = (positive().fold(f64::INFINITY, f64::min), positive().fold(0.0, f64::max));
        if most > 10.0 * least { Self::log(values) } else { Self::of(values) }
    }

    /// An axis for swept values: a few of them are the ticks, and they keep clear of its ends.
    pub fn swept(values: &[f64]) -> Self {
        let mut axis = Self::of(values);
        if axis.scale == Scale::Linear {
            axis.low -= (axis.high - axis.low) * MARGIN;
        }
        let stops = if values.len() <= MOST_STOPS { values.to_vec() } else { Vec::new() };
        Self { stops, ..axis }
    }

    /// Values that are not above zero are at its beginning.
    pub fn log(values: &[f64]) -> Self {
        let positive = || values.iter().copied().filter(|value| *value > 0.0 && value.is_finite());
        let (mut low, mut high) = (positive().fold(f64::INFINITY, f64::min), positive().fold(0.0, f64::max));
        if high <= 0.0 {
            (low, high) = (0.1, 10.0);
        }
        let least = high / 10_f64.powf(MOST_DECADES);
        let has_least = low < least;
        if has_least {
            low = positive().filter(|value| *value >= least).fold(high, f64::min);
        }
        // Close values, or a single one, are in the middle of an axis that contains round values.
        let decades = (high / low).log10();
        let margin = (decades * MARGIN).max((LEAST_DECADES - decades) / 2.0);
        let factor = 10_f64.powf(margin);
        let floor = match values {
            _ if has_least => Floor::NearZero,
            _ if values.iter().any(|value| *value <= 0.0) => Floor::Zero,
            _ => Floor::None,
        };
        Self { low: low / factor, high: high * factor, scale: Scale::Log, floor, stops: Vec::new() }
    }

    fn linear(values: &[f64]) -> Self {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let (mut low, mut high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        // Zero is included unless all values are far from it.
        if low >= 0.0 && low < 0.7 * high {
            low = 0.0;
        }
        if low == high {
            (low, high) = if low == 0.0 { (0.0, 1.0) } else { (low - low.abs() * 0.5, high + high.abs() * 0.5) };
        }
        let margin = (high - low) * MARGIN;
        let low = if low == 0.0 { 0.0 } else { low - margin };
        Self { low, high: high + margin, scale: Scale::Linear, floor: Floor::None, stops: Vec::new() }
    }

    /// A place for each word, in this order.
    pub fn words(words: Vec<String>) -> Self {
        Self { low: 0.0, high: 1.0, scale: Scale::Words(words), floor: Floor::None, stops: Vec::new() }
    }

    /// The value that represents a word, or the number in a text.
    pub fn value_of(&self, text: &str) -> Option<f64> {
        match &self.scale {
            Scale::Words(words) => {
                words.iter().position(|word| word == text).map(|index| (index as f64 + 0.5) / words.len() as f64)
            }
            _ => text.parse().ok(),
        }
    }

    /// The place of a value, 0 to 1 within the axis.
    pub fn share(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Log if value < self.low => 0.0,
            Scale::Log => {
                let share = (value / self.low).ln() / (self.high / self.low).ln();
                if self.floor != Floor::None { FLOOR + share * (1.0 - FLOOR) } else { share }
            }
            _ => (value - self.low) / (self.high - self.low),
        }
    }

    /// Whether a value is at the beginning of a logarithmic axis because it has no other place on it.
    pub fn is_on_floor(&self, value: f64) -> bool {
        self.scale == Scale::Log && value < self.low
    }

    /// About `count` round values.
    pub fn ticks(&self, count: usize) -> Vec<Tick> {
        let tick = |value: f64| Tick { share: self.share(value), label: number(value) };
        match &self.scale {
            _ if !self.stops.is_empty() => self.stops.iter().map(|value| tick(*value)).collect(),
            Scale::Words(words) => words
                .iter()
                .map(|word| Tick { share: self.value_of(word).unwrap_or(0.0), label: word.clone() })
                .collect(),
            Scale::Linear => {
                let step = round_step((self.high - self.low) / count.max(1) as f64);
                let first = (self.low / step).ceil() as i64;
                let last = (self.high / step + 1e-9).floor() as i64;
                (first..=last).map(|index| tick(index as f64 * step)).collect()
            }
            Scale::Log => {
                let decades = (self.high / self.low).log10();
                // Between the decades as many as there is room for.
                let digits: &[u32] = match decades {
                    _ if decades < 1.0 => &[1, 2, 3, 4, 5, 6, 8],
                    _ if decades * 3.0 <= count as f64 => &[1, 2, 5],
                    _ => &[1],
                };
                let stride = ((decades / count.max(1) as f64).ceil() as i32).max(1);
                let exponents = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
                let values = exponents
                    .filter(|exponent| exponent.rem_euclid(stride) == 0)
                    .flat_map(|exponent| digits.iter().map(move |digit| f64::from(*digit) * 10_f64.powi(exponent)));
                let inside = values.filter(|value| (self.low..=self.high).contains(value));
                let label = match self.floor {
                    Floor::None => None,
                    Floor::Zero => Some("0"),
                    Floor::NearZero => Some("~0"),
                };
                let floor = label.map(|label| Tick { share: 0.0, label: label.to_owned() });
                floor.into_iter().chain(inside.map(tick)).collect()
            }
        }
    }
}

/// 1, 2 or 5 times a power of ten, at least `least`.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powf(least.log10().floor());
    let digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|digit| digit * power >= least * 0.999).unwrap_or(10.0);
    digit * power
}

/// As short as it can be read: at most 4 significant digits, thousands and millions by letters.
pub fn number(value: f64) -> String {
    let (scaled, letter) = match value.abs() {
        large if large >= 1e6 => (value / 1e6, "M"),
        large if large >= 1e4 => (value / 1e3, "k"),
        _ => (value, ""),
    };
    let rounded: f64 = format!("{scaled:.3e}").parse().unwrap_or(scaled);
    // Steps of floating point numbers meet zero only nearly.
    let rounded = if rounded.abs() < 1e-12 { 0.0 } else { rounded };
    if rounded != 0.0 && rounded.abs() < 1e-4 { format!("{rounded:e}") } else { format!("{rounded}{letter}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, count: usize) -> Vec<String> {
        axis.ticks(count).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn axes_are_logarithmic_where_values_span_more_than_one_and_a_half_decades() {
        assert_eq!(Axis::of(&[1.0, 31.0]).scale, Scale::Linear);
        assert_eq!(Axis::of(&[1.0, 32.0]).scale, Scale::Log);
        assert_eq!(Axis::of(&[-1.0, 32.0]).scale, Scale::Linear);
        assert_eq!(Axis::of(&[0.0, 0.0]).scale, Scale::Linear);
    }

    #[test]
    fn all_values_stand_within_and_in_order() {
        for values in
            [&[0.0, 3.0][..], &[5.0], &[0.0], &[0.0, 0.001, 70.0], &[99.0, 100.0], &[-3.0, 4.0], &[1e6, 6.4e6]]
        {
            for axis in [Axis::of(values), Axis::log(values)] {
                let shares: Vec<f64> = values.iter().map(|value| axis.share(*value)).collect();
                assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{values:?}: {shares:?}");
                let is_log = axis.scale == Scale::Log;
                assert!(shares.is_sorted_by(|a, b| a < b || is_log), "{values:?}: {shares:?}");
                let ticks = axis.ticks(5);
                assert!(ticks.iter().all(|tick| (-1e-9..=1.0 + 1e-9).contains(&tick.share)), "{values:?}: {ticks:?}");
                assert!(!ticks.is_empty() && ticks.len() < 20, "{values:?}: {ticks:?}");
            }
        }
    }

    #[test]
    fn values_that_are_close_have_round_ones_around_them() {
        for values in [[2.05, 2.2], [9.1, 9.2], [0.033, 0.034], [1.0, 1.0]] {
            let ticks = Axis::log(&values).ticks(6);
            assert!(ticks.len() >= 2, "{values:?}: {ticks:?}");
        }
    }

    #[test]
    fn zeros_have_the_beginning_of_a_logarithmic_axis_for_themselves() {
        let axis = Axis::of(&[0.0, 0.01, 1.0]);
        assert!(axis.is_on_floor(0.0) && axis.share(0.0) == 0.0 && axis.share(0.01) > FLOOR);
        assert_eq!(labels(&axis, 5), ["0", "0.01", "0.1", "1"]);
        let tiny = Axis::of(&[1e-7, 0.01, 1.0]);
        assert!(tiny.is_on_floor(1e-7) && !tiny.is_on_floor(0.01));
        assert_eq!(labels(&tiny, 5)[0], "~0");
        let whole = Axis::of(&[0.01, 1.0]);
        assert_eq!(whole.floor, Floor::None);
        assert_eq!(labels(&whole, 9), ["0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1"]);
    }

    #[test]
    fn ticks_are_round_and_short() {
        assert_eq!(labels(&Axis::of(&[0.0, 6.0]), 5), ["0", "2", "4", "6"]);
        assert_eq!(labels(&Axis::of(&[1e5, 6.4e6]), 5), ["100k", "1M"]);
        assert_eq!([0.1 + 0.2, 1600.0, 12_345.0, 0.000_02].map(number), ["0.3", "1600", "12.35k", "2e-5"]);
        let words = Axis::words(vec!["a".into(), "b".into()]);
        assert_eq!(words.value_of("b"), Some(0.75));
        assert_eq!(labels(&words, 5), ["a", "b"]);
    }
}
