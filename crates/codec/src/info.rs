//! What is known of a file before and after it is read, and what of it is to be read.

use std::path::PathBuf;

use cloud::{Attribute, Bounds, Grid, Placement};

use crate::units::Units;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Las,
    Laz,
    Ply,
}

/// The content of a header, checked against the file.
#[derive(Clone, Debug)]
pub struct Info {
    pub path: PathBuf,
    pub format: Format,
    /// `1.2` for LAS; `ascii 1.0`, `binary_little_endian 1.0`, `binary_big_endian 1.0` for PLY.
    pub version: String,
    /// The LAS point format, 0 to 10.
    pub point_format: Option<u8>,
    /// The number of points that a full read yields: the header's count, less the points that the file is too short
    /// for.
    pub points: u64,
    /// The world bounds from the header, if they are believable.
    pub bounds: Option<Bounds>,
    /// All properties of a point in the file, coordinates and colours included, in file order and file types.
    pub properties: Vec<Attribute>,
    /// The scalar attributes that `Selection::attributes` may name, in the order of `Chunk::columns`.
    pub attributes: Vec<Attribute>,
    pub grid: Option<Grid>,
    /// How points are moved when they are read or exported; bounds and grid are moved already.
    pub placement: Option<Placement>,
    pub has_colors: bool,
    pub has_normals: bool,
    /// The number of polygons that the file declares (PLY meshes).
    pub faces: u64,
    /// The coordinate reference system as the file has it: WKT or the GeoTIFF citation.
    pub crs: Option<String>,
    /// The units of the coordinates, as far as the file tells them.
    pub units: Units,
    pub warnings: Vec<String>,
}

impl Info {
    /// Moves what the header tells of places. `Source::read` moves the points.
    pub(crate) fn place(&mut self, placement: Placement) {
        self.bounds = self.bounds.map(|bounds| placement.bounds(bounds));
        self.grid = self.grid.map(|grid| grid.placed(placement));
        self.placement = Some(placement);
    }
}

/// The columns to decode. Others are not decoded (layered LAZ) or not kept.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Whether to decode positions. Without them, chunks come with empty `positions`: to read a column for chunks that
    /// are already loaded.
    pub positions: bool,
    pub colors: bool,
    pub normals: bool,
    /// One entry per `Info::attributes`; attributes beyond its end are not decoded.
    pub attributes: Vec<bool>,
}

/// The result of a read.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    pub points: u64,
    /// The world bounds of all finite points read.
    pub bounds: Option<Bounds>,
    pub warnings: Vec<String>,
    pub cancelled: bool,
}
