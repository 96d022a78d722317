//! Parses the header of a PLY file: its elements and their properties (G. Turk, "The PLY Polygon File Format", 1994).

use cloud::ColumnType;

use crate::brief::brief;
use crate::export::names::tell_apart;

/// The longest header that is read. Scanners write kilobytes of comments, nobody a megabyte; a file without
/// `end_header` is refused after this much instead of being searched to its end.
pub const MAX_HEADER_BYTES: usize = 1 << 20;
/// The most properties of an element: splats have 62, learned features some hundreds. A line of text may leave out all
/// of them, so nothing else bounds the memory of a point.
const MOST_PROPERTIES: usize = 4096;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Scalar(ColumnType),
    List { length: ColumnType, item: ColumnType },
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    /// The number of rows that the header states, not checked against the file.
    pub count: u64,
    pub properties: Vec<Property>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    pub encoding: Encoding,
    /// The format as in the file, like `ascii 1.0`.
    pub format: String,
    pub elements: Vec<Element>,
    /// The length of the header in bytes.
    pub length: u64,
    /// The end of a line: `\n` (also after `\r`), or `\r` if the file has nothing else.
    pub newline: u8,
}

/// The 1-based line in which the header is wrong, and how.
#[derive(Debug, PartialEq, Eq)]
pub struct HeaderError {
    pub line: usize,
    pub problem: String,
}

/// The bytes before `ply`, which editors leave there: a byte order mark and blanks.
fn before_ply(start: &[u8]) -> usize {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    start.len() - text.trim_ascii_start().len()
}

/// Whether a file that starts so is PLY.
pub fn is_ply(start: &[u8]) -> bool {
    let signature = &start[before_ply(start)..];
    signature.starts_with(b"ply") && signature.get(3).is_some_and(u8::is_ascii_whitespace)
}

impl Element {
    /// The size of a row in a binary file in bytes; `None` if a list makes rows differ.
    pub fn stride(&self) -> Option<u64> {
        self.properties
            .iter()
            .map(|property| match property.kind {
                Kind::Scalar(scalar) => Some(scalar.size() as u64),
                Kind::List { .. } => None,
            })
            .sum()
    }

    /// Gives each scalar that has the name of an earlier one a name that no other has. `what` says what has the names.
    /// Returns what is to be said of that.
    pub fn tell_apart(&mut self, what: &str) -> Vec<String> {
        let scalars = self.properties.iter_mut().filter(|property| matches!(property.kind, Kind::Scalar(_)));
        tell_apart(scalars.map(|property| &mut property.name), what)
    }

    fn has_scalar(&self, name: &str) -> bool {
        self.properties
            .iter()
            .any(|property| property.name.eq_ignore_ascii_case(name) && matches!(property.kind, Kind::Scalar(_)))
    }
}

impl Header {
    /// The index of the element whose rows are the points: the first `vertex` that has any, or the first one, else the first
    /// element that has x, y and z.
    pub fn points_element(&self) -> Option<usize> {
        let is_vertex = |element: &Element| element.name.eq_ignore_ascii_case("vertex");
        let filled = self.elements.iter().position(|element| is_vertex(element) && element.count > 0);
        filled.or_else(|| self.elements.iter().position(is_vertex)).or_else(|| {
            self.elements.iter().position(|element| ["x", "y", "z"].iter().all(|axis| element.has_scalar(axis)))
        })
    }

    /// The number of points of elements `vertex` besides the one that is read.
    pub fn further_vertices(&self, read: usize) -> u64 {
        let is_further =
            |(index, element): &(usize, &Element)| *index != read && element.name.eq_ignore_ascii_case("vertex");
        let rows = self.elements.iter().enumerate().filter(is_further).map(|(_, element)| element.count);
        rows.fold(0, u64::saturating_add)
    }

    /// Parses the start of a file. A name is the remainder of its line, whatever bytes that has, since writers put
    /// brackets, dots and spaces into names; comments may hold any bytes.
    pub fn parse(start: &[u8]) -> Result<Self, HeaderError> {
        // A lone CR (old Mac writers) shows in the first line: `ply`, CR, no LF.
        let own = &start[before_ply(start)..];
        let end = own.iter().position(|byte| matches!(byte, b'\r' | b'\n')).unwrap_or(own.len());
        let newline = if own.get(end) == Some(&b'\r') && own.get(end + 1) != Some(&b'\n') { b'\r' } else { b'\n' };
        let mut format: Option<(Encoding, String)> = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut rest = own;
        let mut line_number = 0;
        while let Some(length) = rest.iter().position(|&byte| byte == newline) {
            line_number += 1;
            let fail = |problem: String| HeaderError { line: line_number, problem };
            let (line, after) = (rest[..length].trim_ascii(), &rest[length + 1..]);
            rest = after;
            let line = String::from_utf8_lossy(line);
            let (keyword, arguments) = split_word(&line);
            match keyword {
                "ply" if line_number == 1 => {}
                _ if line_number == 1 => return Err(fail("expected `ply`".into())),
                "" | "comment" | "obj_info" => {}
                "format" => {
                    let encoding = match split_word(arguments).0 {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        other => {
                            return Err(fail(format!(
                                "format `{}` is none of ascii, binary_little_endian, binary_big_endian",
                                brief(other)
                            )));
                        }
                    };
                    if format.replace((encoding, brief(arguments))).is_some() {
                        return Err(fail("a second format line".into()));
                    }
                }
                "element" => {
                    let (name, count) = split_word(arguments);
                    let count = count.parse().map_err(|_| {
                        fail(format!("element {} has the count `{}`, not a whole number", brief(name), brief(count)))
                    })?;
                    elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
                }
                "property" => {
                    let Some(element) = elements.last_mut() else {
                        return Err(fail("a property before the first element".into()));
                    };
                    if element.properties.len() == MOST_PROPERTIES {
                        let name = brief(&element.name);
                        return Err(fail(format!("element {name} has more than {MOST_PROPERTIES} properties")));
                    }
                    element.properties.push(parse_property(arguments).map_err(fail)?);
                }
                "end_header" => {
                    let (encoding, format) = format.ok_or_else(|| fail("the header has no format line".into()))?;
                    let length = (start.len() - rest.len()) as u64;
                    return Ok(Self { encoding, format, elements, length, newline });
                }
                other => return Err(fail(format!("`{}` is not a PLY keyword", brief(other)))),
            }
        }
        let problem = if start.len() >= MAX_HEADER_BYTES {
            format!("no end_header in the first {MAX_HEADER_BYTES} bytes")
        } else {
            "the file ends before end_header".into()
        };
        Err(HeaderError { line: line_number + 1, problem })
    }
}

fn parse_property(arguments: &str) -> Result<Property, String> {
    let (first, rest) = split_word(arguments);
    let (kind, name) = if first == "list" {
        let (length, rest) = split_word(rest);
        let (item, name) = split_word(rest);
        let (length, item) = (scalar_type(length)?, scalar_type(item)?);
        if matches!(length, ColumnType::F32 | ColumnType::F64) {
            return Err(format!("list {} has a length that is not of an integer type", brief(name)));
        }
        (Kind::List { length, item }, name)
    } else {
        (Kind::Scalar(scalar_type(first)?), rest)
    };
    if name.is_empty() {
        return Err("a property without a name".into());
    }
    Ok(Property { name: name.to_owned(), kind })
}

/// The type names of the 1994 text, the sized ones that followed, and the 64-bit integers that some writers add.
fn scalar_type(name: &str) -> Result<ColumnType, String> {
    Ok(match name {
        "char" | "int8" => ColumnType::I8,
        "uchar" | "uint8" => ColumnType::U8,
        "short" | "int16" => ColumnType::I16,
        "ushort" | "uint16" => ColumnType::U16,
        "int" | "int32" => ColumnType::I32,
        "uint" | "uint32" => ColumnType::U32,
        "long" | "int64" => ColumnType::I64,
        "ulong" | "uint64" => ColumnType::U64,
        "float" | "float32" => ColumnType::F32,
        "double" | "float64" => ColumnType::F64,
        other => return Err(format!("`{}` is not a PLY type", brief(other))),
    })
}

/// The first word of a line, and the text after it.
fn split_word(line: &str) -> (&str, &str) {
    let line = line.trim_start();
    let (word, rest) = line.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((line, ""));
    (word, rest.trim())
}
