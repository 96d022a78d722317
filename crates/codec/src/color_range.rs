//! Tells from a sample what value of a file's colours stands for full brightness.
//!
//! A high share of the values decides, not the largest: files have single values beyond their range, from rounding or
//! from a filter that ran over them. What lies above the range is shown at full brightness.

/// The share of the values that may lie above a range that files commonly have.
const ABOVE: f64 = 0.05;
/// That share for ranges of 10 and 12 bits, for which dark colours of 16 bits could be mistaken: these have highlights.
const ABOVE_RARE: f64 = 0.01;
/// The share of the values that are multiples of 256 or 257 where bytes were made 16 bits wide.
const WIDENED: f64 = 0.95;
/// Floats that nearly all lie below this, and are no whole numbers, are brightness from 0 to 1, of which some are
/// overexposed. As bytes they would be black.
const OVEREXPOSED: f64 = 4.0;
/// The share of whole numbers in floats that hold bytes.
const WHOLE: f64 = 0.95;
/// Values up to so many times the range are rounding errors, which need no word.
const ROUNDING: f64 = 1.01;

/// The sampled values of colours; those of black points, which say nothing about a range, are left out.
#[derive(Default)]
pub struct ColorSample {
    values: Vec<f64>,
}

/// The value that stands for full brightness, and what is worth a word about it.
pub struct ColorRange {
    pub full: f64,
    pub warning: Option<String>,
}

impl ColorSample {
    /// Adds a value; its sign does not count.
    pub fn add(&mut self, value: f64) {
        if value.is_finite() && value != 0.0 {
            self.values.push(value.abs());
        }
    }

    pub fn merge(mut self, mut other: Self) -> Self {
        self.values.append(&mut other.values);
        self
    }

    /// Whether no value has any brightness.
    pub fn is_black(&self) -> bool {
        self.values.is_empty()
    }

    /// The range of values of a whole type that is wider than a byte.
    pub fn of_integers(&self) -> ColorRange {
        let is_widened = |factor: u64| self.share(|value| (value as u64).is_multiple_of(factor)) >= WIDENED;
        let usual = |bits: u32| f64::from(u32::MAX >> (32 - bits));
        let bits = if is_widened(256) || is_widened(257) {
            if self.fits(usual(16), ABOVE) { 16 } else { 32 }
        } else {
            let ranges = [(8, ABOVE), (10, ABOVE_RARE), (12, ABOVE_RARE), (16, ABOVE)];
            ranges.into_iter().find(|(bits, above)| self.fits(usual(*bits), *above)).map_or(32, |(bits, _)| bits)
        };
        let range = self.range(usual(bits));
        if matches!(bits, 10 | 12) {
            let most = usual(bits);
            let warning = format!("colours hardly exceed {most} in wider fields: they count as colours of {bits} bits");
            return ColorRange { warning: Some(warning), ..range };
        }
        range
    }

    /// The range of floats.
    pub fn of_floats(&self) -> ColorRange {
        let is_overexposed = self.fits(OVEREXPOSED, ABOVE) && self.share(|value| value.fract() == 0.0) < WHOLE;
        let usual = [(1.0, ABOVE), (255.0, ABOVE), (1023.0, ABOVE_RARE), (4095.0, ABOVE_RARE)];
        let full = usual.into_iter().find(|(full, above)| self.fits(*full, *above)).map_or(65_535.0, |(full, _)| full);
        let range = self.range(if is_overexposed { 1.0 } else { full });
        if matches!(range.full, 1023.0 | 4095.0) {
            let warning = format!("colours hardly exceed {full}: this counts as full brightness");
            return ColorRange { warning: Some(warning), ..range };
        }
        range
    }

    fn range(&self, full: f64) -> ColorRange {
        let share = 100.0 * self.share(|value| value > full * ROUNDING);
        let warning = format!("about {share:.1} % of the values of colours exceed {full}, and count as {full}");
        ColorRange { full, warning: (share > 0.0).then_some(warning) }
    }

    fn fits(&self, full: f64, above: f64) -> bool {
        self.share(|value| value > full) <= above
    }

    fn share(&self, is_counted: impl Fn(f64) -> bool) -> f64 {
        let counted = self.values.iter().filter(|value| is_counted(**value)).count();
        counted as f64 / self.values.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use cloud::Random;

    use super::*;

    /// So many values of which each `every`-th is another one.
    fn sample(value: impl Fn(f64) -> f64, other: f64, every: usize) -> ColorSample {
        let (mut random, mut sample) = (Random(11), ColorSample::default());
        for index in 0..4000 {
            let unit = (random.below(1 << 30) as f64 + 1.0) / f64::from(1 << 30);
            sample.add(if index % every == every - 1 { other } else { value(unit) });
        }
        sample
    }

    #[test]
    fn a_few_values_beyond_the_range_do_not_change_it() {
        for every in [40, 100, 3999] {
            let bytes = |unit: f64| (unit * 255.0).round();
            for other in [256.0, 300.0, 65_535.0, f64::NAN] {
                assert_eq!(sample(bytes, other, every).of_integers().full, 255.0, "{other} each {every}");
                assert_eq!(sample(|unit| unit * 255.0, other, every).of_floats().full, 255.0, "{other} each {every}");
            }
            for other in [1.000_000_1, 1.5, 255.0, 1e30, f64::INFINITY, f64::NAN] {
                assert_eq!(sample(|unit| unit, other, every).of_floats().full, 1.0, "{other} each {every}");
            }
            let wide = |unit: f64| (unit * 65_535.0).round();
            assert_eq!(sample(wide, 7e8, every).of_integers().full, 65_535.0, "each {every}");
        }
        assert!(sample(|unit| unit, 1.000_000_1, 100).of_floats().warning.is_none());
        let warning = sample(|unit| (unit * 255.0).round(), 400.0, 100).of_integers().warning.unwrap();
        assert!(warning.contains("1.0 %") && warning.contains("exceed 255"), "{warning}");
    }

    #[test]
    fn dark_colours_keep_their_range() {
        // Of 16 bits: bytes that were made wide, and a dusk with lamps; black points say nothing.
        for factor in [256.0, 257.0] {
            let dark = sample(|unit| (unit * 12.0).ceil() * factor, 0.0, 7).of_integers();
            assert!(dark.full == 65_535.0 && dark.warning.is_none(), "{factor}");
        }
        assert_eq!(sample(|unit| (unit * 2500.0).round(), 40_000.0, 40).of_integers().full, 65_535.0);
        assert_eq!(sample(|unit| (unit * 6000.0).round(), 0.0, 2).of_integers().full, 65_535.0);
        // Of 8 bits, and of floats.
        assert_eq!(sample(|unit| (unit * 30.0).ceil(), 0.0, 2).of_integers().full, 255.0);
        assert_eq!(sample(|unit| unit * 0.05, 0.0, 2).of_floats().full, 1.0);
        assert_eq!(sample(|unit| unit * 60.0, 0.0, 2).of_floats().full, 255.0);
        assert_eq!(sample(|unit| (unit * 3.0).ceil(), 0.0, 2).of_floats().full, 255.0);
        assert!(ColorSample::default().is_black() && ColorSample::default().of_integers().full == 255.0);
    }

    #[test]
    fn ten_and_twelve_bits_in_wider_fields_are_told_with_a_word() {
        for bits in [10_u32, 12] {
            let full = f64::from((1 << bits) - 1);
            for other in [0.0, 65_535.0] {
                let range = sample(|unit| (unit * full).round(), other, 200).of_integers();
                assert_eq!(range.full, full);
                assert!(range.warning.is_some_and(|warning| warning.contains(&format!("{bits} bits"))));
                let range = sample(|unit| unit * full, other, 200).of_floats();
                assert!(range.full == full && range.warning.is_some());
            }
        }
        let overexposed = sample(|unit| unit * 2.0, 7.0, 40).of_floats();
        assert!(overexposed.full == 1.0 && overexposed.warning.is_some_and(|warning| warning.contains("exceed 1,")));
    }
}
