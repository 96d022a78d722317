//! Writes PLY files: binary, the points as vertices.

use std::io::{self, BufWriter, Seek as _, SeekFrom, Write as _};
use std::sync::{Mutex, PoisonError};

use cloud::{Attribute, Chunk, ColumnType};
use tempfile::NamedTempFile;

use super::columns::{Field, Piece, loses_digits, put, put_none};
use super::merging::Origin;
use super::names::Names;

/// The number of points that are written at once.
pub const PIECE_POINTS: usize = 65_536;

/// The fields of a file and their places in a row.
pub struct RowFormat {
    /// The names and types of the fields in the file.
    pub fields: Vec<Attribute>,
    /// The length of a row in bytes.
    pub length: usize,
    lost_digits: Mutex<Vec<String>>,
}

impl RowFormat {
    /// Few programs know whole numbers of 64 bits in PLY files, so they become doubles, and some read no headers but
    /// those of ASCII.
    pub fn new(fields: &[Field]) -> Self {
        let mut names = Names::with_case();
        let attribute = |field: &Field| {
            let name: String = field.name().chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).collect();
            let column_type = match field.column_type() {
                ColumnType::U64 | ColumnType::I64 => ColumnType::F64,
                own => own,
            };
            Attribute { name: names.take(&name, usize::MAX), column_type }
        };
        let fields: Vec<Attribute> = fields.iter().map(attribute).collect();
        let length = fields.iter().map(|field| field.column_type.size()).sum();
        Self { fields, length, lost_digits: Mutex::default() }
    }

    /// The rows of the kept points. `origins` says where in the piece the values of each field are.
    pub fn rows(&self, piece: &Piece, origins: &[Option<Origin>]) -> Vec<u8> {
        let mut rows = vec![0; piece.kept.len() * self.length];
        let mut at = 0;
        for (field, origin) in self.fields.iter().zip(origins) {
            let mut own = None;
            match origin.as_ref().and_then(|origin| origin.values(&piece.columns, &mut own)) {
                Some(column) => {
                    put(&mut rows, self.length, at, column, &piece.kept, field.column_type);
                    if field.column_type == ColumnType::F64 && loses_digits(column, &piece.kept) {
                        let mut lost = self.lost_digits.lock().unwrap_or_else(PoisonError::into_inner);
                        if !lost.contains(&field.name) {
                            lost.push(field.name.clone());
                        }
                    }
                }
                None => put_none(&mut rows, self.length, at, field.column_type),
            }
            at += field.column_type.size();
        }
        rows
    }

    /// The names of fields of whole numbers that lost digits.
    pub fn lost_digits(&self) -> Vec<String> {
        self.lost_digits.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// A file that is being written.
pub struct PlyFile {
    out: BufWriter<NamedTempFile>,
    /// The header without the number of points: what is before it, and what is after it.
    header: [String; 2],
    length: usize,
}

impl PlyFile {
    /// Leaves room for the header of a file with `most_points` points at most.
    pub fn start(file: NamedTempFile, format: &RowFormat, crs: Option<&str>, most_points: u64) -> io::Result<Self> {
        let mut before = format!("ply\nformat binary_little_endian 1.0\ncomment glint {}\n", env!("CARGO_PKG_VERSION"));
        if let Some(crs) = crs {
            let ascii = |c: char| if c.is_ascii_graphic() { c } else { ' ' };
            let line: String = crs.chars().map(ascii).collect();
            before += &format!("comment crs {line}\n");
        }
        before += "element vertex ";
        let property = |field: &Attribute| format!("property {} {}\n", type_name(field.column_type), field.name);
        let after = format!("\n{}", format.fields.iter().map(property).collect::<String>());
        let header = [before, after];
        let length = Self::text(&header, most_points, 0).len();
        let mut out = BufWriter::with_capacity(1 << 20, file);
        out.write_all(&vec![0; length])?;
        Ok(Self { out, header, length })
    }

    /// A comment of blanks makes a header of few points as long as one of many.
    fn text([before, after]: &[String; 2], points: u64, blanks: usize) -> String {
        format!("{before}{points}{after}comment {:blanks$}\nend_header\n", "")
    }

    pub fn push(&mut self, rows: &[u8]) -> io::Result<()> {
        self.out.write_all(rows)
    }

    pub fn finish(mut self, points: u64) -> io::Result<NamedTempFile> {
        let shortest = Self::text(&self.header, points, 0).len();
        self.out.seek(SeekFrom::Start(0))?;
        self.out.write_all(Self::text(&self.header, points, self.length - shortest).as_bytes())?;
        let file = self.out.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.as_file().sync_data()?;
        Ok(file)
    }
}

/// Writes the places, as floats, and the colours of chunks as a whole file.
pub fn write_chunks(file: NamedTempFile, chunks: &[Chunk]) -> io::Result<NamedTempFile> {
    let columns = |names: [&str; 3], column_type| names.map(|name| Attribute { name: name.into(), column_type });
    let fields =
        [columns(["x", "y", "z"], ColumnType::F32), columns(["red", "green", "blue"], ColumnType::U8)].concat();
    let length = fields.iter().map(|field| field.column_type.size()).sum();
    let format = RowFormat { fields, length, lost_digits: Mutex::default() };
    let points = chunks.iter().map(Chunk::len).sum::<usize>() as u64;
    let mut out = PlyFile::start(file, &format, None, points)?;
    for chunk in chunks {
        let mut rows = Vec::with_capacity(format.length * chunk.len());
        for index in 0..chunk.len() {
            let color = chunk.colors.as_ref().map_or([255; 4], |colors| colors[index]);
            rows.extend(chunk.position(index).as_vec3().to_array().into_iter().flat_map(f32::to_le_bytes));
            rows.extend(&color[..3]);
        }
        out.push(&rows)?;
    }
    out.finish(points)
}

/// The name of 1994, which every program reads. The 64-bit integers have none, and are no columns of PLY files.
fn type_name(column_type: ColumnType) -> &'static str {
    match column_type {
        ColumnType::U8 => "uchar",
        ColumnType::I8 => "char",
        ColumnType::U16 => "ushort",
        ColumnType::I16 => "short",
        ColumnType::U32 => "uint",
        ColumnType::I32 => "int",
        ColumnType::F32 => "float",
        ColumnType::F64 | ColumnType::U64 | ColumnType::I64 => "double",
    }
}
