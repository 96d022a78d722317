//! Tells decimals from thousands where a table has numbers with points beside numbers with commas, so that 8.780 beside
//! 336,563 does not become 8.78 without a word.

use super::table::{SKIP, Style, decoded};
use crate::brief::brief;

/// What is to be done about such a table.
const REMEDY: &str = "write numbers without separators of thousands, or leave a column out: --columns skip,x,y,z";

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
    number: &'a [u8],
    line: &'a [u8],
    /// Whether the sign stands before decimals: in one of the numbers at least it cannot set thousands apart.
    is_decimal: bool,
}

impl<'a> Signed<'a> {
    /// `None` if there is no such number in the columns that are read.
    fn of(lines: &[&'a [u8]], style: Style, names: &[String], sign: u8) -> Option<Self> {
        let is_own = |(number, name): &(&[u8], &String)| {
            name.as_str() != SKIP && number.contains(&sign) && style.number(number).is_some()
        };
        let of_line =
            |line: &'a [u8]| std::iter::zip(style.tokens(line), names).filter(is_own).map(move |own| (own.0, line));
        let all = lines.iter().flat_map(|line| of_line(line));
        let (number, line) = all.clone().next()?;
        let is_decimal = all.into_iter().any(|(number, _)| !may_be_of_thousands(number, sign));
        Some(Self { number, line, is_decimal })
    }

    /// The number and its place in a text that begins so.
    fn told(&self, start: &[u8], newline: u8) -> String {
        let line = start.split_inclusive(|byte| *byte == newline).position(|line| std::ptr::eq(line, self.line));
        let number = brief(&decoded(self.number));
        line.map_or_else(|| format!("`{number}`"), |line| format!("`{number}` in line {}", line + 1))
    }
}

/// The commas of a table in whose first lines no number has a point.
#[derive(Clone, Debug, PartialEq)]
pub struct Commas {
    /// A number with one.
    example: String,
    /// Whether they stand before decimals. They could set thousands apart as well if they always stand before three digits.
    are_decimal: bool,
}

impl Commas {
    /// Whether a number with a point leaves open which sign stands before decimals.
    #[inline]
    pub fn contradict(&self, number: &[u8]) -> bool {
        number.contains(&b'.') && (!self.are_decimal || may_be_of_thousands(number, b'.'))
    }

    /// What is wrong with such a number of a row, in words.
    pub fn problem(&self, number: &[u8], row: u64) -> String {
        let (number, line, example) = (brief(&decoded(number)), row + 1, &self.example);
        format!(
            "`{number}` in line {line} of the points is taken for no number, since it has a point, and numbers before it a \
             comma, like `{example}`; {REMEDY}"
        )
    }
}

/// What is known of the commas and points of a table.
#[derive(Debug)]
pub enum Signs {
    /// What the numbers behind the first lines must agree with; `None` if they may have points.
    Clear(Option<Commas>),
    /// Both signs stand before decimals, and where they do.
    Both(String),
}

/// Looks at the numbers of the first lines of a table, which begins with `start`, in the columns that have names.
///
/// # Errors
/// In words, if it cannot be told which sign stands before decimals.
pub fn signs(lines: &[&[u8]], style: Style, names: &[String], (start, newline): (&[u8], u8)) -> Result<Signs, String> {
    let of = |sign| style.has_decimal_comma.then(|| Signed::of(lines, style, names, sign)).flatten();
    match (of(b'.'), of(b',')) {
        (Some(point), Some(comma)) => {
            let told = format!("{} has a point, {} a comma", point.told(start, newline), comma.told(start, newline));
            match point.is_decimal && comma.is_decimal {
                true => Ok(Signs::Both(format!("{told}; both are taken for decimals"))),
                false => Err(format!("{told}, and one of them may set thousands apart; {REMEDY}")),
            }
        }
        (None, Some(comma)) => {
            let example = brief(&decoded(comma.number));
            Ok(Signs::Clear(Some(Commas { example, are_decimal: comma.is_decimal })))
        }
        (_, None) => Ok(Signs::Clear(None)),
    }
}
