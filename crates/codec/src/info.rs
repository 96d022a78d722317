//! What is known of a file before and after it is read, and what of it is to be read.

use std::path::PathBuf;

use cloud::{Attribute, Bounds, Grid, Placement};

use glam::{DMat3, DQuat, DVec3};

use crate::address::last_part;
use crate::format::Format;
use crate::units::Units;

/// The content of a header, checked against the file.
#[derive(Clone, Debug)]
pub struct Info {
    pub path: PathBuf,
    pub format: Format,
    /// `1.2` for LAS; `ascii 1.0`, `binary_little_endian 1.0`, `binary_big_endian 1.0` for PLY; the columns of a table, as
    /// `--columns` gives them.
    pub version: String,
    /// The LAS point format, 0 to 10.
    pub point_format: Option<u8>,
    /// The number of points that a full read yields: the header's count, less the points that the file is too short
    /// for.
    pub points: u64,
    /// The number of points that the file announces, and that are not read: it is too short or too damaged for them.
    pub missing: u64,
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
    /// The code of the EPSG of the system on the map, if the file names it.
    pub epsg: Option<u32>,
    /// The units of the coordinates, as far as the file names them.
    pub units: Units,
    /// Which scan of the file this cloud is, in formats that hold several.
    pub scan: Option<Scan>,
    /// The pictures that the file holds beside its points.
    pub images: Vec<Image>,
    /// The least and the greatest value that a sensor gives, for attributes for which the file gives them.
    pub limits: Vec<(String, [f64; 2])>,
    pub warnings: Vec<String>,
    /// What is wrong with tiles of the same catalogue, or scans of the same file, that cannot be opened. The first one that
    /// can be has it.
    pub lost: Vec<String>,
}

/// One of the scans of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Scan {
    pub name: String,
    /// The place of the scan among those of the file, from 0, and how many scans there are.
    pub number: usize,
    pub of: usize,
    /// Where the scanner stood, in the coordinates of the points.
    pub position: Option<DVec3>,
    /// From the scanner's own axes to those of the coordinates.
    pub turn: DQuat,
    /// When the scan began and ended, if the file says so: seconds of GPS time, and whether an atomic clock gave them.
    pub times: [Option<(f64, bool)>; 2],
}

/// A picture that a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    pub name: String,
    /// `pinhole`, `spherical`, `cylindrical` or `preview`.
    pub projection: &'static str,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// The length of its PNG or JPEG file in bytes.
    pub bytes: u64,
    /// Where the camera stood.
    pub position: Option<DVec3>,
}

/// Whether two names, or texts, are of different coordinate systems. One that names the system of the heights, too, as in
/// `EPSG:26910+5703`, is that of one that does not.
pub(crate) fn are_other_systems(one: &str, other: &str) -> bool {
    let (one, other) = (one.trim(), other.trim());
    let adds_heights =
        |long: &str, short: &str| long.strip_prefix(short).is_some_and(|end| end.trim().starts_with('+'));
    one != other && !adds_heights(one, other) && !adds_heights(other, one)
}

/// How a coordinate system, of which the name and the units may be known, differs from another one, in words that `than`
/// can follow.
pub fn system_difference(
    (own, units): (Option<&str>, &Units),
    (other, other_units): (Option<&str>, &Units),
) -> Option<String> {
    match own.zip(other) {
        Some((own, other)) if are_other_systems(own, other) => Some("another coordinate system".into()),
        _ => units.difference(other_units),
    }
}

impl Info {
    /// How its coordinate system differs from that of another file, in words that `than` can follow.
    pub fn system_difference(&self, other: &Self) -> Option<String> {
        system_difference((self.crs.as_deref(), &self.units), (other.crs.as_deref(), &other.units))
    }

    /// Where the scanner stood, if the file says so.
    pub fn scanner(&self) -> Option<DVec3> {
        self.scan.as_ref().and_then(|scan| scan.position)
    }

    /// What is known of a cloud of this format before its rows are looked at.
    pub(crate) fn of_rows(path: &std::path::Path, format: Format, version: String) -> Self {
        Self {
            path: path.to_owned(),
            format,
            version,
            point_format: None,
            points: 0,
            missing: 0,
            bounds: None,
            properties: Vec::new(),
            attributes: Vec::new(),
            grid: None,
            placement: None,
            has_colors: false,
            has_normals: false,
            faces: 0,
            crs: None,
            epsg: None,
            units: Units::default(),
            scan: None,
            images: Vec::new(),
            limits: Vec::new(),
            warnings: Vec::new(),
            lost: Vec::new(),
        }
    }

    /// The name of the cloud: that of its file, or of the folder of an EPT, and of the scan where the file holds several.
    pub fn name(&self) -> String {
        let folder = self.path.parent().filter(|folder| self.format == Format::Ept && folder.file_name().is_some());
        let own = folder.unwrap_or(&self.path);
        let last = last_part(own);
        let file = if last.is_empty() { self.path.to_string_lossy().into_owned() } else { last };
        match &self.scan {
            Some(scan) if scan.of > 1 => format!("{file}, {}", scan.name),
            _ => file,
        }
    }

    /// The number of the scan in its file, from 0.
    pub fn scan_number(&self) -> usize {
        self.scan.as_ref().map_or(0, |scan| scan.number)
    }

    /// Moves the places that the header names. `Source::read` moves the points.
    pub(crate) fn place(&mut self, placement: Placement) {
        self.bounds = self.bounds.map(|bounds| placement.bounds(bounds));
        self.grid = self.grid.map(|grid| grid.placed(placement));
        let scanner = self.scan.as_mut().and_then(|scan| scan.position.as_mut());
        let cameras = self.images.iter_mut().filter_map(|image| image.position.as_mut());
        scanner.into_iter().chain(cameras).for_each(|place| *place = placement.point(*place));
        if let Some(scan) = &mut self.scan {
            let axes = DVec3::AXES.map(|axis| placement.direction(scan.turn * axis));
            scan.turn = DQuat::from_mat3(&DMat3::from_cols(axes[0], axes[1], axes[2])).normalize();
        }
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
    /// The number of points that `Info::points` promises and that could not be read; 0 of a read that was cancelled.
    pub missing: u64,
    /// The world bounds of all finite points read.
    pub bounds: Option<Bounds>,
    pub warnings: Vec<String>,
    pub cancelled: bool,
}
