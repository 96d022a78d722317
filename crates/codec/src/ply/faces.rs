//! Reads the triangles of a mesh: polygons (`face`) as fans, `tristrips` as strips. They are read index by index, so
//! that a list's length is never trusted.

use std::io;

use cloud::ColumnType;

use super::header::{Element, Encoding, Header, Kind};
use super::number;
use super::reader::Reader;
use super::rows::{Rows, integer, list_length, next_token, skip_elements};
use crate::brief::brief;
use crate::bytes::Bytes;

/// The names of the list of a face's vertices.
const INDEX_NAMES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Whether the element makes surfaces: polygons or strips.
pub fn is_surface(element: &Element) -> bool {
    is_strips(element) || is_polygons(element)
}

pub fn is_polygons(element: &Element) -> bool {
    element.name.eq_ignore_ascii_case("face")
}

fn is_strips(element: &Element) -> bool {
    element.name.eq_ignore_ascii_case("tristrips")
}

/// Where the faces are wrong and how, or that the file could not be read.
pub enum FaceError {
    Io(io::Error),
    Malformed { place: String, problem: String },
}

impl From<io::Error> for FaceError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// All triangles of the file, with checked vertex numbers. A file that is cut short gives its whole triangles.
///
/// `vertex` is the index of the vertex element, `rows` is where its rows are.
pub fn read(file: &Bytes, header: &Header, vertex: usize, rows: &Rows) -> Result<Vec<[u32; 3]>, FaceError> {
    let mut triangles = Vec::new();
    let mut reader = Reader::new(file, header.length, file.length());
    for (index, element) in header.elements.iter().enumerate() {
        if index == vertex {
            if rows.count < element.count {
                // Nothing follows an incomplete list of vertices.
                break;
            }
            reader = Reader::new(file, rows.end, file.length());
        } else if is_surface(element) {
            let mut surface = Surface {
                is_strips: is_strips(element),
                declared: header.elements[vertex].count,
                there: rows.count,
                triangles: &mut triangles,
                corners: [0; 2],
                count: 0,
            };
            if !read_element(&mut reader, header, element, &mut surface)? {
                break;
            }
        } else if skip_elements(&mut reader, header, std::slice::from_ref(element))?.1.is_some() {
            break;
        }
    }
    Ok(triangles)
}

/// Turns the vertex numbers of one list after the other into triangles.
struct Surface<'a> {
    is_strips: bool,
    /// The number of vertices that the header declares, and of those that are in the file.
    declared: u64,
    there: u64,
    triangles: &'a mut Vec<[u32; 3]>,
    /// The fan's first corner and its last, or the strip's last two.
    corners: [u32; 2],
    /// The number of corners since the start of the polygon or strip.
    count: u64,
}

impl Surface<'_> {
    fn begin(&mut self) {
        self.count = 0;
    }

    fn add(&mut self, index: i128) -> Result<(), String> {
        if self.is_strips && index == -1 {
            self.count = 0;
            return Ok(());
        }
        let corner = u32::try_from(index).ok().filter(|&corner| u64::from(corner) < self.declared);
        let corner = corner.ok_or_else(|| format!("vertex {index} of {}", self.declared))?;
        if self.count >= 2 {
            let [first, last] = self.corners;
            // Every other triangle of a strip is wound the other way.
            let turned = self.is_strips && self.count % 2 == 1;
            let triangle = if turned { [last, first, corner] } else { [first, last, corner] };
            let is_degenerate = first == last || last == corner || first == corner;
            if !is_degenerate && triangle.iter().all(|&corner| u64::from(corner) < self.there) {
                self.triangles.push(triangle);
            }
        }
        match (self.count, self.is_strips) {
            (0, _) => self.corners[0] = corner,
            (1, _) | (_, false) => self.corners[1] = corner,
            (_, true) => self.corners = [self.corners[1], corner],
        }
        self.count += 1;
        Ok(())
    }
}

/// Reads one element; returns false if the file ends in it.
fn read_element(
    reader: &mut Reader,
    header: &Header,
    element: &Element,
    surface: &mut Surface,
) -> Result<bool, FaceError> {
    if element.properties.is_empty() {
        return Ok(true);
    }
    for row in 0..element.count {
        let fail = |problem| FaceError::Malformed { place: format!("{} {row}", brief(&element.name)), problem };
        let whole = if header.encoding == Encoding::Ascii {
            read_text_row(reader, header.newline, element, row + 1 == element.count, surface)?
        } else {
            read_binary_row(reader, header.encoding, element, surface)?
        };
        match whole {
            Row::Whole => {}
            Row::Cut => return Ok(false),
            Row::Wrong(problem) => return Err(fail(problem)),
        }
    }
    Ok(true)
}

enum Row {
    Whole,
    /// The file ends within the row.
    Cut,
    Wrong(String),
}

fn holds_indices(name: &str) -> bool {
    INDEX_NAMES.iter().any(|known| name.eq_ignore_ascii_case(known))
}

fn read_binary_row(
    reader: &mut Reader,
    encoding: Encoding,
    element: &Element,
    surface: &mut Surface,
) -> io::Result<Row> {
    for property in &element.properties {
        let whole = match property.kind {
            Kind::Scalar(scalar) => reader.skip(scalar.size() as u64)?,
            Kind::List { length, item } => {
                let Some(bytes) = reader.take(length.size())? else { return Ok(Row::Cut) };
                let items = match list_length(bytes, length, encoding) {
                    Ok(items) => items,
                    Err(items) => return Ok(Row::Wrong(format!("list {} of length {items}", brief(&property.name)))),
                };
                if holds_indices(&property.name) && !matches!(item, ColumnType::F32 | ColumnType::F64) {
                    surface.begin();
                    for _ in 0..items {
                        let Some(bytes) = reader.take(item.size())? else { return Ok(Row::Cut) };
                        if let Err(problem) = surface.add(integer(bytes, item, encoding)) {
                            return Ok(Row::Wrong(problem));
                        }
                    }
                    true
                } else {
                    reader.skip(items.saturating_mul(item.size() as u64))?
                }
            }
        };
        if !whole {
            return Ok(Row::Cut);
        }
    }
    Ok(Row::Whole)
}

fn read_text_row(
    reader: &mut Reader,
    newline: u8,
    element: &Element,
    is_last_row: bool,
    surface: &mut Surface,
) -> io::Result<Row> {
    let Some((line, is_last_line)) = reader.line(newline)? else { return Ok(Row::Cut) };
    if is_last_line && !is_last_row {
        // The file ends in this line, perhaps inside a number.
        return Ok(Row::Cut);
    }
    let short =
        |name: &str| if is_last_line { Row::Cut } else { Row::Wrong(format!("the line ends in {}", brief(name))) };
    let mut at = 0;
    for property in &element.properties {
        at = next_token(line, at, newline);
        let (items, length) = number::parse_integer(&line[at..]);
        if length == 0 {
            return Ok(short(&property.name));
        }
        at += length;
        if matches!(property.kind, Kind::Scalar(_)) {
            continue;
        }
        let is_index = holds_indices(&property.name);
        let Some(items) = items else {
            return Ok(Row::Wrong(format!("the length of list {} is not a number", brief(&property.name))));
        };
        surface.begin();
        for _ in 0..items {
            at = next_token(line, at, newline);
            let (index, length) = number::parse_integer(&line[at..]);
            if length == 0 {
                return Ok(short(&property.name));
            }
            at += length;
            if is_index {
                let added = match index {
                    Some(index) => surface.add(index),
                    None => Err(format!("a vertex number of list {} is not a number", brief(&property.name))),
                };
                if let Err(problem) = added {
                    return Ok(Row::Wrong(problem));
                }
            }
        }
    }
    Ok(Row::Whole)
}
