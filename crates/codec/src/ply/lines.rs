//! Tells from some lines of text from all over a file whether its text is what the header says.

use std::io;

use super::header::{Element, Header, Kind};
use super::number;
use super::reader::{Reader, is_blank};
use super::rows::{Rows, sample_blocks};
use crate::brief::brief;
use crate::bytes::Bytes;

/// The scalars of a line: the index of each property, and its text.
fn scalars_of<'a>(line: &'a [u8], element: &Element) -> Vec<(usize, &'a [u8])> {
    let mut tokens = line.split(|&byte| byte <= b' ').filter(|token| !token.is_empty());
    let mut scalars = Vec::new();
    for (index, property) in element.properties.iter().enumerate() {
        let Some(token) = tokens.next() else { break };
        match property.kind {
            Kind::Scalar(_) => scalars.push((index, token)),
            Kind::List { .. } => {
                let items = number::parse_integer(token).0.unwrap_or(0).clamp(0, line.len() as i128);
                tokens.by_ref().take(items as usize).for_each(drop);
            }
        }
    }
    scalars
}

/// A line that tells that nothing of the text can be read as it is, counted from 1 in the file, and what is wrong with
/// it: numbers with decimal commas, or coordinates of which none is a number in any sampled line. `position` are the
/// properties of these.
pub fn unreadable_line(
    file: &Bytes,
    rows: &Rows,
    header: &Header,
    element: &Element,
    position: [usize; 3],
) -> io::Result<Option<(u64, String)>> {
    let is_number = |token: &[u8]| number::parse_f64(token).0.is_some();
    let text = |token: &[u8]| brief(&String::from_utf8_lossy(token));
    let with_comma = |line: &[u8]| {
        let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
        let has_comma = |token: &[u8]| {
            let comma = token.iter().position(|&byte| byte == b',');
            !is_number(token)
                && comma.is_some_and(|at| at > 0 && is_digit(token.get(at - 1)) && is_digit(token.get(at + 1)))
        };
        let scalars = scalars_of(line, element);
        let token = scalars.into_iter().find(|(_, token)| has_comma(token));
        token.map(|(_, token)| format!("`{}` has a decimal comma; numbers of PLY have a point", text(token)))
    };
    let no_number = |line: &[u8]| {
        let scalars = scalars_of(line, element);
        let coordinate = scalars.into_iter().find(|(index, token)| position.contains(index) && !is_number(token));
        coordinate.map(|(_, token)| format!("`{}` is no number", text(token)))
    };
    let (mut sampled, mut bad, mut commas) = (0, 0, 0);
    for block in sample_blocks(file, rows, header, None)? {
        let mut reader = Reader::new(file, block.offset, block.end);
        let Some((line, _)) = reader.line(header.newline)? else { continue };
        sampled += 1;
        commas += u64::from(with_comma(line).is_some());
        bad += u64::from(no_number(line).is_some());
    }
    if commas == 0 && (bad == 0 || bad < sampled) {
        return Ok(None);
    }
    let Some(start) = rows.blocks.first().map(|block| block.offset) else { return Ok(None) };
    let mut number = 0;
    let mut before = Reader::new(file, 0, start);
    loop {
        match before.lines(header.newline)? {
            [] => break,
            run => number += run.iter().filter(|&&byte| byte == header.newline).count() as u64,
        }
    }
    let mut reader = Reader::new(file, start, rows.end);
    loop {
        let run = reader.lines(header.newline)?;
        if run.is_empty() {
            return Ok(None);
        }
        for line in run.split_inclusive(|&byte| byte == header.newline) {
            number += 1;
            let problem = if commas > 0 { with_comma(line) } else { no_number(line) };
            if let Some(problem) = problem {
                return Ok(Some((number, problem)));
            }
        }
    }
}

/// What is wrong with the first sampled line whose number of values differs from the header's.
pub fn check_lines(file: &Bytes, rows: &Rows, header: &Header, element: &Element) -> io::Result<Option<String>> {
    let name = brief(&element.name);
    for block in sample_blocks(file, rows, header, None)? {
        let mut reader = Reader::new(file, block.offset, block.end);
        let run = reader.lines(header.newline)?;
        let Some(line) = run.split(|&byte| byte == header.newline).find(|line| !is_blank(line)) else { continue };
        let mut tokens = line.split(|&byte| byte <= b' ').filter(|token| !token.is_empty());
        for property in &element.properties {
            let needed = match (tokens.next(), property.kind) {
                (Some(_), Kind::Scalar(_)) => 0,
                (Some(length), Kind::List { .. }) => number::parse_integer(length).0.unwrap_or(0).max(0),
                (None, _) => 1,
            };
            if needed > 0 && (tokens.by_ref().take(line.len().min(needed as usize)).count() as i128) < needed {
                return Ok(Some(format!("lines of {name} end before its property {}", brief(&property.name))));
            }
        }
        if tokens.next().is_some() {
            return Ok(Some(format!("lines of {name} have more numbers than the header declares properties")));
        }
    }
    Ok(None)
}
