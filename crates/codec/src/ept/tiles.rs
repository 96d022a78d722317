//! The tiles of EPT: LAZ files, or rows of numbers.

use std::io;
use std::sync::Arc;

use cloud::{Chunk, ColumnType, Progress};
use glam::DVec3;
use serde::Deserialize;

use crate::bytes::Bytes;
use crate::ept::zstandard;
use crate::export::columns::{Colors, Field, Piece, Reading};
use crate::in_order::InOrder;
use crate::las::LasSource;
use crate::ply::columns::Scale;
use crate::ply::header::{Element, Kind, Property};
use crate::ply::maker::{RowMaker, put_number};
use crate::ply::rows::{Block, Rows};
use crate::ply::{Made, RowSource};
use crate::{Error, Info, Result, Selection, Summary};

/// The number of points whose rows are made at a time.
const POINTS_AT_ONCE: usize = 4096;

/// The points of one node.
#[allow(clippy::large_enum_variant, reason = "few are open at a time, and they are not moved around")]
pub enum Tile {
    Las(LasSource),
    Rows(RowSource),
}

/// A number of each point, as `ept.json` describes it.
#[derive(Clone, Debug, Deserialize)]
pub struct Dimension {
    pub name: String,
    #[serde(rename = "type")]
    pub kind: String,
    pub size: usize,
    pub scale: Option<f64>,
    pub offset: Option<f64>,
}

impl Dimension {
    /// The type of its numbers in a tile.
    fn stored(&self) -> Option<ColumnType> {
        Some(match (self.kind.as_str(), self.size) {
            ("unsigned", 1) => ColumnType::U8,
            ("unsigned", 2) => ColumnType::U16,
            ("unsigned", 4) => ColumnType::U32,
            ("unsigned", 8) => ColumnType::U64,
            ("signed", 1) => ColumnType::I8,
            ("signed", 2) => ColumnType::I16,
            ("signed", 4) => ColumnType::I32,
            ("signed", 8) => ColumnType::I64,
            ("float" | "floating", 4) => ColumnType::F32,
            ("float" | "floating", 8) => ColumnType::F64,
            _ => return None,
        })
    }

    fn is_scaled(&self) -> bool {
        self.scale.is_some() || self.offset.is_some()
    }

    /// Our name for it: EPT has those of PDAL, such as `GpsTime`.
    fn own_name(&self) -> String {
        if self.name == "ScanAngleRank" {
            return "scan_angle".into();
        }
        let mut own = String::new();
        let mut before = '_';
        for character in self.name.chars() {
            if character.is_ascii_uppercase() && (before.is_ascii_lowercase() || before.is_ascii_digit()) {
                own.push('_');
            }
            own.extend(character.to_lowercase());
            before = character;
        }
        own
    }
}

impl Tile {
    /// Opens a tile as a LAZ file. Its colours have the range of those of `model`.
    ///
    /// # Errors
    /// If the file is none, or its points are not like those of `model`.
    pub fn open_las(file: Bytes, memory: u64, model: Option<&Self>) -> Result<Self> {
        let model = match model {
            Some(Self::Las(model)) => Some(model),
            _ => None,
        };
        LasSource::open_like(file, memory, model).map(Self::Las)
    }

    /// Opens a tile of rows.
    ///
    /// # Errors
    /// If the file cannot be read or holds another number of points.
    pub fn open_rows(file: Bytes, rows: &TileRows, info: Info, model: Option<&Self>) -> Result<Self> {
        let color_scale: Option<[Scale; 3]> = match model {
            Some(Self::Rows(model)) => model.color_scale(),
            _ => None,
        };
        let stride = rows.stride as u64;
        let (count, rest) = (file.length() / stride, file.length() % stride);
        if rest > 0 {
            return Err(Error::malformed(file.path(), format!("byte {}", count * stride), "a point that is cut short"));
        }
        let block = Block { offset: 0, end: file.length(), first_row: 0, rows: count };
        let blocks = if count > 0 { vec![block] } else { Vec::new() };
        let found = Rows { blocks, count, end: file.length(), problem: None };
        let maker = Box::new(rows.clone());
        let made = Made { maker, rows: found, is_text: false, newline: b'\n', color_scale, info };
        RowSource::made(Arc::new(file), made).map(Self::Rows)
    }

    pub fn info(&self) -> &Info {
        match self {
            Self::Las(tile) => tile.info(),
            Self::Rows(tile) => tile.info(),
        }
    }

    pub fn info_mut(&mut self) -> &mut Info {
        match self {
            Self::Las(tile) => &mut tile.info,
            Self::Rows(tile) => &mut tile.info,
        }
    }

    pub fn has_wide_colors(&self) -> bool {
        match self {
            Self::Las(tile) => tile.has_wide_colors(),
            Self::Rows(tile) => tile.has_wide_colors(),
        }
    }

    /// What is different about the points of another tile, if anything is.
    pub fn difference(&self, other: &Self) -> Option<&'static str> {
        let (own, other) = (self.info(), other.info());
        if own.attributes != other.attributes || own.has_normals != other.has_normals {
            return Some("other attributes");
        }
        if own.grid != other.grid {
            return Some("another grid");
        }
        (own.has_colors != other.has_colors).then_some("other colours")
    }

    pub fn read(&self, selection: &Selection, progress: &Progress, emit: &(dyn Fn(Chunk) + Sync)) -> Result<Summary> {
        match self {
            Self::Las(tile) => tile.read(selection, progress, emit),
            Self::Rows(tile) => tile.read(selection, progress, emit),
        }
    }

    /// All points in one chunk.
    ///
    /// # Errors
    /// If some of them cannot be read.
    pub fn read_whole(&self, selection: &Selection) -> Result<Chunk> {
        match self {
            Self::Las(tile) => tile.read_whole(selection),
            Self::Rows(tile) => tile.read_whole(selection),
        }
    }

    pub fn record(&self, point: u64) -> Result<Vec<(String, String)>> {
        match self {
            Self::Las(tile) => tile.record(point),
            Self::Rows(tile) => tile.record(point),
        }
    }

    pub fn column_fields(&self, colors: Colors) -> Vec<Field> {
        match self {
            Self::Las(tile) => tile.column_fields(colors),
            Self::Rows(tile) => tile.column_fields(colors),
        }
    }

    pub fn read_columns_in_order(
        &self,
        wish: &Reading<'_>,
        progress: &Progress,
        order: &InOrder<'_>,
        rows_of: &(dyn Fn(Piece) -> Vec<u8> + Sync),
    ) -> Vec<String> {
        match self {
            Self::Las(tile) => tile.read_columns_in_order(wish, progress, order, rows_of),
            Self::Rows(tile) => tile.read_columns_in_order(wish, progress, order, rows_of),
        }
    }
}

/// A number in a row of a tile: its place, its type, and its scale and offset.
type Stored = (usize, ColumnType, Option<(f64, f64)>);

/// How the rows of binary tiles become rows of our own.
#[derive(Clone)]
pub struct TileRows {
    element: Element,
    /// The numbers of a row of the file, one for each property.
    stored: Vec<Stored>,
    stride: usize,
}

impl TileRows {
    /// # Errors
    /// Says which dimension cannot be read.
    pub fn new(schema: &[Dimension]) -> std::result::Result<Self, String> {
        let (mut stored, mut properties, mut stride) = (Vec::new(), Vec::new(), 0);
        for dimension in schema {
            let own = dimension.stored().ok_or_else(|| {
                let name = crate::brief::brief(&dimension.name);
                let kind = crate::brief::brief(&dimension.kind);
                format!("dimension {name} is {kind} of {} bytes, expected signed, unsigned or float", dimension.size)
            })?;
            let scaling =
                dimension.is_scaled().then_some((dimension.scale.unwrap_or(1.0), dimension.offset.unwrap_or(0.0)));
            stored.push((stride, own, scaling));
            stride += own.size();
            let kind = Kind::Scalar(if scaling.is_some() { ColumnType::F64 } else { own });
            properties.push(Property { name: dimension.own_name(), kind });
        }
        Ok(Self { element: Element { name: "point".into(), count: 0, properties }, stored, stride: stride.max(1) })
    }

    /// The rows of a compressed tile of so many points, which must fit in `memory` bytes.
    ///
    /// # Errors
    /// If the file cannot be read, or is not a compressed tile of so many points.
    pub fn decompressed(&self, file: &Bytes, points: u32, memory: u64) -> Result<Bytes> {
        let fail = |problem: String| Error::malformed(file.path(), "tile", problem);
        let length = u64::from(points) * self.stride as u64;
        if length > memory {
            return Err(fail(format!("{length} bytes of points, and {memory} fit in the memory for one tile")));
        }
        let compressed = file.all(zstandard::most_compressed(length))?;
        let rows = zstandard::decompressed(&compressed, length).map_err(fail)?;
        Ok(Bytes::of_memory(file.path(), rows))
    }

    /// The grid of the coordinates, if they are whole steps of one.
    pub fn grid(schema: &[Dimension]) -> Option<cloud::Grid> {
        let axis = |name: &str| {
            let own = schema.iter().find(|dimension| dimension.name == name)?;
            let is_whole = own.stored().is_some_and(ColumnType::is_whole);
            own.scale
                .filter(|scale| is_whole && scale.is_finite() && *scale != 0.0)
                .map(|scale| (scale, own.offset.unwrap_or(0.0)))
        };
        let [x, y, z] = [axis("X")?, axis("Y")?, axis("Z")?];
        Some(cloud::Grid::new(DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1)))
    }
}

impl RowMaker for TileRows {
    fn element(&self) -> &Element {
        &self.element
    }

    fn stride(&self) -> Option<usize> {
        Some(self.stride)
    }

    fn damage(&self) -> &'static str {
        "are damaged"
    }

    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)> {
        let kept: Vec<Stored> =
            self.stored.iter().zip(keep).filter(|(_, keep)| **keep).map(|(stored, _)| *stored).collect();
        let (mut source, mut rows) = (vec![0; POINTS_AT_ONCE * self.stride], Vec::new());
        let mut done = 0;
        while done < block.rows {
            let count = (block.rows - done).min(POINTS_AT_ONCE as u64) as usize;
            let source = &mut source[..count * self.stride];
            let read = file.read_at(block.offset + done * self.stride as u64, source)? / self.stride;
            rows.clear();
            for row in source.chunks_exact(self.stride).take(read) {
                for (at, column_type, scaling) in &kept {
                    let bytes = &row[*at..at + column_type.size()];
                    match scaling {
                        None => rows.extend_from_slice(bytes),
                        Some((scale, offset)) => {
                            let mut scaled = [0; 8];
                            put_number(&mut scaled, ColumnType::F64, number(bytes, *column_type) * scale + offset);
                            rows.extend_from_slice(&scaled);
                        }
                    }
                }
            }
            give(&rows);
            done += read as u64;
            if read < count {
                break;
            }
        }
        Ok((done, 0))
    }
}

/// A number of a row, little-endian.
fn number(bytes: &[u8], column_type: ColumnType) -> f64 {
    let mut all = [0; 8];
    all[..bytes.len()].copy_from_slice(bytes);
    let raw = u64::from_le_bytes(all);
    match column_type {
        ColumnType::I8 => f64::from(raw as i8),
        ColumnType::I16 => f64::from(raw as i16),
        ColumnType::I32 => f64::from(raw as i32),
        ColumnType::I64 => raw as i64 as f64,
        ColumnType::F32 => f64::from(f32::from_bits(raw as u32)),
        ColumnType::F64 => f64::from_bits(raw),
        _ => raw as f64,
    }
}
