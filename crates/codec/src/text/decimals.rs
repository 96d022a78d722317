//! Tells decimals from thousands where a table has numbers with points beside numbers with commas, so that 8.780 beside
//! 336,563 does not become 8.78 without a word.

use super::table::{SKIP, Style, decoded, is_place};
use crate::brief::brief;

/// What is to be done about such a table.
const REMEDY: &str =
    "write numbers without separators of thousands, or leave out a column that is no coordinate: --columns skip,x,y,z";

/// Whether the sign could stand before three digits of thousands, as in 8.780 or -12,345.
fn may_be_of_thousands(number: &[u8], sign: u8) -> bool {
    let number = number.strip_prefix(b"-").or_else(|| number.strip_prefix(b"+")).unwrap_or(number);
    let Some(at) = number.iter().position(|byte| *byte == sign) else { return false };
    let (whole, rest) = (&number[..at], &number[at + 1..]);
    let are_digits = [whole, rest].into_iter().all(|part| part.iter().all(u8::is_ascii_digit));
    are_digits && (1..=3).contains(&whole.len()) && whole[0] != b'0' && rest.len() == 3
}

/// The numbers of some lines in which a sign stands.
struct Signed<'a> {
    sign: u8,
    number: &'a [u8],
    line: &'a [u8],
    /// Whether the sign stands before decimals: in one of the numbers at least it cannot set thousands apart.
    is_decimal: bool,
}

impl<'a> Signed<'a> {
    /// `None` if there is no such number in the columns that are looked at.
    fn of(
        lines: &[&'a [u8]],
        style: Style,
        names: &[String],
        is_looked_at: fn(&str) -> bool,
        sign: u8,
    ) -> Option<Self> {
        let is_own = |(number, name): &(&[u8], &String)| {
            is_looked_at(name) && number.contains(&sign) && style.number(number).is_some()
        };
        let of_line =
            |line: &'a [u8]| std::iter::zip(style.tokens(line), names).filter(is_own).map(move |own| (own.0, line));
        let all = lines.iter().flat_map(|line| of_line(line));
        let (number, line) = all.clone().next()?;
        let is_decimal = all.into_iter().any(|(number, _)| !may_be_of_thousands(number, sign));
        Some(Self { sign, number, line, is_decimal })
    }

    /// The number and its place in a text that begins so.
    fn told(&self, start: &[u8], newline: u8) -> String {
        let line = start.split_inclusive(|byte| *byte == newline).position(|line| std::ptr::eq(line, self.line));
        let number = brief(&decoded(self.number));
        line.map_or_else(|| format!("`{number}`"), |line| format!("`{number}` in line {}", line + 1))
    }
}

/// The sign of a table that is taken for that before decimals, where no number of the first lines has the other one, or no
/// coordinate has.
#[derive(Clone, Debug, PartialEq)]
pub struct Sign {
    sign: u8,
    /// A number with it.
    example: String,
    /// Whether it stands before decimals. It could set thousands apart as well if it always stands before three digits.
    is_decimal: bool,
    /// Whether attributes have the other one.
    is_of_places: bool,
}

impl Sign {
    fn new(signed: &Signed, is_of_places: bool) -> Self {
        let Signed { sign, is_decimal, .. } = *signed;
        Self { sign, example: brief(&decoded(signed.number)), is_decimal, is_of_places }
    }

    /// Whether numbers of a column with this name must agree with it.
    pub fn is_of(&self, column: &str) -> bool {
        !self.is_of_places || is_place(column)
    }

    /// Whether a number with the other sign leaves open which one stands before decimals.
    #[inline]
    pub fn is_contradicted(&self, number: &[u8]) -> bool {
        let other = if self.sign == b',' { b'.' } else { b',' };
        number.contains(&other) && (!self.is_decimal || may_be_of_thousands(number, other))
    }

    /// What is wrong with such a number of a row, in words.
    pub fn problem(&self, number: &[u8], row: u64) -> String {
        let (number, line, example) = (brief(&decoded(number)), row + 1, &self.example);
        let [other, own] = if self.sign == b',' { ["point", "comma"] } else { ["comma", "point"] };
        format!(
            "`{number}` in line {line} of the points is taken for no number, since it has a {other}, and numbers before it a \
             {own}, like `{example}`; {REMEDY}"
        )
    }
}

/// Looks at the numbers of the first lines of a table, which begins with `start`, in the columns that have names. Returns
/// what the numbers behind them must agree with, and a warning if some have points and others commas.
///
/// # Errors
/// In words, if it cannot be told which sign of the coordinates stands before decimals.
pub fn signs(
    lines: &[&[u8]],
    style: Style,
    names: &[String],
    (start, newline): (&[u8], u8),
) -> Result<(Option<Sign>, Option<String>), String> {
    if !style.has_decimal_comma {
        return Ok((None, None));
    }
    let of =
        |is_looked_at: fn(&str) -> bool| [b'.', b','].map(|sign| Signed::of(lines, style, names, is_looked_at, sign));
    let told = |point: &Signed, comma: &Signed| {
        format!("{} has a point, {} a comma", point.told(start, newline), comma.told(start, newline))
    };
    let sign = match of(is_place) {
        [Some(point), Some(comma)] if !(point.is_decimal && comma.is_decimal) => {
            return Err(format!("{}, and one of them may set thousands apart; {REMEDY}", told(&point, &comma)));
        }
        [Some(one), None] | [None, Some(one)] => Some(Sign::new(&one, true)),
        _ => None,
    };
    Ok(match of(|name| name != SKIP) {
        [Some(point), Some(comma)] => {
            let doubt = match point.is_decimal && comma.is_decimal {
                true => String::new(),
                false => format!(", but one of them may set thousands apart; {REMEDY}"),
            };
            (sign, Some(format!("{}; both are taken for decimals{doubt}", told(&point, &comma))))
        }
        [Some(one), None] | [None, Some(one)] => (Some(Sign::new(&one, false)), None),
        [None, None] => (None, None),
    })
}
