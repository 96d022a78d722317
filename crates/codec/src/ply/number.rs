//! Parses decimal text: the short decimals that fill ASCII files are converted exactly and fast, all others by `std`.
//! The result always equals that of `str::parse`.

/// A decimal `mantissa * 10^exponent` of at most 19 digits.
struct Decimal {
    negative: bool,
    mantissa: u64,
    exponent: i32,
}

/// 10^0 to 10^22: the powers of ten that an f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

impl Decimal {
    /// The number at the start of `text`, up to white space or the end, and its length.
    #[inline]
    fn scan(text: &[u8]) -> Option<(Self, usize)> {
        let negative = text.first() == Some(&b'-');
        let mut at = usize::from(negative || text.first() == Some(&b'+'));
        let mut mantissa = 0_u64;
        let whole = scan_digits(text, &mut at, &mut mantissa);
        let mut fraction = 0;
        if text.get(at) == Some(&b'.') {
            at += 1;
            fraction = scan_digits(text, &mut at, &mut mantissa);
        }
        // 19 digits fit a u64; more have overflowed it.
        if !(1..=19).contains(&(whole + fraction)) {
            return None;
        }
        let mut exponent = -(fraction as i32);
        if matches!(text.get(at), Some(b'e' | b'E')) {
            at += 1;
            let down = text.get(at) == Some(&b'-');
            at += usize::from(down || text.get(at) == Some(&b'+'));
            let mut power = 0_u64;
            if !(1..=4).contains(&scan_digits(text, &mut at, &mut power)) {
                return None;
            }
            exponent += if down { -(power as i32) } else { power as i32 };
        }
        let ended = text.get(at).is_none_or(|&byte| byte <= b' ');
        ended.then_some((Self { negative, mantissa, exponent }, at))
    }

    /// The correctly rounded f64, where one operation on exact operands gives it (Clinger 1990).
    #[inline]
    fn to_f64(&self) -> Option<f64> {
        if self.mantissa > 1 << 53 {
            return None;
        }
        let power = POWERS.get(self.exponent.unsigned_abs() as usize)?;
        let mantissa = self.mantissa as f64;
        let value = if self.exponent < 0 { mantissa / power } else { mantissa * power };
        Some(if self.negative { -value } else { value })
    }

    /// The correctly rounded f32, through the f64: rounding twice is wrong only if the f64 is in the middle between two
    /// f32, or outside their normal range.
    #[inline]
    fn to_f32(&self) -> Option<f32> {
        let wide = self.to_f64()?;
        let is_middle = wide.to_bits() & 0x1fff_ffff == 0x1000_0000;
        let is_normal = wide.abs() >= f64::from(f32::MIN_POSITIVE) && wide.abs() <= f64::from(f32::MAX);
        ((is_normal && !is_middle) || self.mantissa == 0).then_some(wide as f32)
    }
}

/// Appends digits to `value` (wrapping) and returns their number.
#[inline]
fn scan_digits(text: &[u8], at: &mut usize, value: &mut u64) -> usize {
    let start = *at;
    while let Some(digit) = text.get(*at).map(|byte| byte.wrapping_sub(b'0')).filter(|&digit| digit < 10) {
        *value = value.wrapping_mul(10).wrapping_add(u64::from(digit));
        *at += 1;
    }
    *at - start
}

/// The length of the token at the start of `text`: up to white space or the end.
#[inline]
pub fn token_length(text: &[u8]) -> usize {
    text.iter().position(|&byte| byte <= b' ').unwrap_or(text.len())
}

/// The number at the start of `text` and the length of its token; `None` for a token that is no number.
#[inline]
pub fn parse_f32(text: &[u8]) -> (Option<f32>, usize) {
    if let Some((decimal, length)) = Decimal::scan(text)
        && let Some(value) = decimal.to_f32()
    {
        return (Some(value), length);
    }
    parse_by_std(text)
}

/// The f64 at the start of `text` and the length of its token; `None` for a token that is no number.
#[inline]
pub fn parse_f64(text: &[u8]) -> (Option<f64>, usize) {
    if let Some((decimal, length)) = Decimal::scan(text)
        && let Some(value) = decimal.to_f64()
    {
        return (Some(value), length);
    }
    parse_by_std(text)
}

/// A whole number; `255.0` and `1e3` are accepted, and a fraction is cut off.
#[inline]
pub fn parse_integer(text: &[u8]) -> (Option<i128>, usize) {
    if let Some((Decimal { negative, mantissa, exponent: 0 }, length)) = Decimal::scan(text) {
        let value = i128::from(mantissa);
        return (Some(if negative { -value } else { value }), length);
    }
    let (value, length) = parse_f64(text);
    (value.filter(|value| !value.is_nan()).map(|value| value as i128), length)
}

#[cold]
fn parse_by_std<T: std::str::FromStr>(text: &[u8]) -> (Option<T>, usize) {
    let length = token_length(text);
    (std::str::from_utf8(&text[..length]).ok().and_then(|token| token.parse().ok()), length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn agrees_with_std(text: &str) {
        let bytes = text.as_bytes();
        assert_eq!(parse_f32(bytes).0.map(f32::to_bits), text.parse::<f32>().ok().map(f32::to_bits), "f32 {text}");
        assert_eq!(parse_f64(bytes).0.map(f64::to_bits), text.parse::<f64>().ok().map(f64::to_bits), "f64 {text}");
        assert_eq!(parse_f32(bytes).1, text.len());
    }

    #[test]
    fn odd_numbers_parse_as_std_does() {
        for text in [
            "0",
            "-0",
            "+0.0",
            "1.",
            ".5",
            ".",
            "-",
            "+",
            "-.",
            "e5",
            "1e",
            "1e+",
            "1e-45",
            "1.4e-45",
            "7e-46",
            "3.4028235e38",
            "3.4028236e38",
            "3.5e38",
            "1e308",
            "1e309",
            "nan",
            "-NaN",
            "inf",
            "-Infinity",
            "1..2",
            "1,5",
            "0x10",
            "--1",
            "16777217",
            "16777217.0000000001",
            "9007199254740993",
            "1.1754943e-38",
            "1.17549429e-38",
            "8388608.5",
            "0.00000000000000000000000000001",
            "123456789012345678901234567890",
            "1_000",
            "1.#QNAN",
            "5e-324",
            "2e22",
            "1e23",
        ] {
            agrees_with_std(text);
        }
    }

    proptest! {
        #[test]
        fn decimals_parse_as_std_does(text in "[-+]?[0-9]{0,12}(\\.[0-9]{0,12})?([eE][-+]?[0-9]{1,3})?") {
            if !text.is_empty() {
                agrees_with_std(&text);
            }
        }

        #[test]
        fn printed_floats_parse_as_std_does(bits in any::<u32>(), wide in any::<u64>()) {
            agrees_with_std(&f32::from_bits(bits).to_string());
            agrees_with_std(&format!("{:e}", f64::from_bits(wide)));
        }

        /// The middle between two neighbouring f32, where rounding twice is wrong, and the decimals beside it.
        #[test]
        fn decimals_beside_the_middle_of_two_floats_parse_as_std_does(mantissa in 1_u32 << 23..1 << 24, down in 0_u32..8) {
            let middle = (f64::from(mantissa) + 0.5) / f64::from(1 << down);
            agrees_with_std(&format!("{middle}"));
            agrees_with_std(&format!("{middle}1"));
            agrees_with_std(&format!("{middle}000001"));
        }
    }
}
