//! Writes PLY files: binary, the points as vertices.

use std::io::{self, BufWriter, Seek as _, SeekFrom, Write as _};

use cloud::{Attribute, ColumnType};
use tempfile::NamedTempFile;

use super::columns::{Piece, put};

/// The number of points that are written at once.
pub const PIECE_POINTS: usize = 65_536;

/// The fields of a file and their places in a row.
pub struct RowFormat {
    pub fields: Vec<Attribute>,
    /// The length of a row in bytes.
    pub length: usize,
}

impl RowFormat {
    pub fn new(fields: Vec<Attribute>) -> Self {
        let length = fields.iter().map(|field| field.column_type.size()).sum();
        Self { fields, length }
    }

    /// The rows of the kept points. `columns` says which column of the piece each field is.
    pub fn rows(&self, piece: &Piece, columns: &[Option<usize>]) -> Vec<u8> {
        let mut rows = vec![0; piece.kept.len() * self.length];
        let mut at = 0;
        for (field, column) in self.fields.iter().zip(columns) {
            if let Some(column) = column.and_then(|column| piece.columns.get(column)) {
                put(&mut rows, self.length, at, column, &piece.kept, field.column_type);
            }
            at += field.column_type.size();
        }
        rows
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
            let line: String =
                crs.chars().map(|character| if character.is_control() { ' ' } else { character }).collect();
            before += &format!("comment crs {line}\n");
        }
        before += "element vertex ";
        let property = |field: &Attribute| {
            let name: String = field.name.chars().map(|c| if c.is_control() || c == ' ' { '_' } else { c }).collect();
            format!("property {} {name}\n", type_name(field.column_type))
        };
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

/// The name of 1994, which every program reads; the 64-bit integers had none then.
fn type_name(column_type: ColumnType) -> &'static str {
    match column_type {
        ColumnType::U8 => "uchar",
        ColumnType::I8 => "char",
        ColumnType::U16 => "ushort",
        ColumnType::I16 => "short",
        ColumnType::U32 => "uint",
        ColumnType::I32 => "int",
        ColumnType::U64 => "uint64",
        ColumnType::I64 => "int64",
        ColumnType::F32 => "float",
        ColumnType::F64 => "double",
    }
}
