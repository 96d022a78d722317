//! Reads E57 (ASTM E2807): each scan of a file is a cloud of its own, turned and moved by its pose.
//!
//! The crate `e57` reads the description of a file, once its length has been checked. Points are read by code of our own,
//! because the crate decodes a file on one thread from its start, keeps streams that run ahead of others in memory, and
//! does not end for points without bits.

mod layout;
mod packets;
mod pages;

use std::io;
use std::sync::Arc;

use e57::{DateTime, E57Reader, PointCloud, Projection, Transform};
use glam::{DQuat, DVec3};

use crate::bytes::Bytes;
use crate::error::AS_BEFORE;
use crate::format::Format;
use crate::info::{Image, Info, Scan};
use crate::ply::header::{Element, Kind};
use crate::ply::maker::{RowMaker, put_integer, put_number};
use crate::ply::rows::{Block, chunk_points};
use crate::ply::{Made, RowSource};
use crate::units::{Unit, Units, wkt};
use crate::{Error, Result};
use layout::{Layout, Origin, Stored, name_of};
use packets::{Bits, Packets};
use pages::physical;

/// The longest description that is read: a thousand scans have some megabytes, and its tree takes ten times as much.
const MOST_DESCRIPTION: u64 = 16 << 20;
/// The most scans of a file.
const MOST_SCANS: usize = 10_000;
/// The number of points whose rows are made at a time.
const POINTS_AT_ONCE: usize = 4096;

/// Whether a file that starts so is E57.
pub fn is_e57(start: &[u8]) -> bool {
    start.starts_with(b"ASTM-E57")
}

/// Opens all scans of a file that can be read; the first of them has what is wrong with the others. Where scans or points
/// are lost, what a server has sent is fetched once more.
///
/// # Errors
/// If its description cannot be read, it has no scans, or none of them can be read.
pub fn open(file: &Arc<Bytes>) -> Result<Vec<RowSource>> {
    let (mut sources, mut lost) = open_once(file)?;
    let is_damaged = |source: &RowSource| source.info.missing > 0;
    let is_doubtful = !lost.is_empty() || sources.iter().any(is_damaged);
    // Where the server has no answer now, what was read stays.
    if is_doubtful && file.is_short_remote() && file.fetch_again(0..file.length()) && file.fetch_all().is_ok() {
        (sources, lost) = open_once(file)?;
        lost = lost.into_iter().map(Error::same_again).collect();
        let damaged = sources.iter_mut().filter(|source| is_damaged(source));
        damaged.filter_map(|source| source.info.warnings.first_mut()).for_each(|told| told.push_str(AS_BEFORE));
    }
    if let Some(first) = sources.first_mut() {
        first.lose(lost.iter().map(Error::to_string).collect());
    }
    Ok(sources)
}

/// Opens all scans of a file that can be read, of which there is at least one. Returns what is wrong with the others, too.
fn open_once(file: &Arc<Bytes>) -> Result<(Vec<RowSource>, Vec<Error>)> {
    let path = file.path().to_owned();
    let fail = |place: &str, problem: String| Error::malformed(&path, place, problem);
    let words: [u8; 48] = file
        .bytes_at(0)
        .map_err(|error| Error::io(&path, error))?
        .ok_or_else(|| fail("header", format!("{} bytes, expected at least 48", file.length())))?;
    let word = |at: usize| words[at..at + 8].iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte));
    let (place, length) = (word(24), word(32));
    if length > MOST_DESCRIPTION || place.saturating_add(length) > file.length() {
        let told = format!("a description of {length} bytes at byte {place} of {}", file.length());
        return Err(fail("header", format!("{told}, expected at most {MOST_DESCRIPTION} inside of the file")));
    }
    let reader = E57Reader::new(file.section(0, file.length()))
        .map_err(|error| fail("description", crate::brief::message(&error)))?;
    let scans = reader.pointclouds();
    if scans.is_empty() {
        let images = reader.images().len();
        return Err(Error::unsuitable(&path, format!("an E57 file without scans; it holds {images} pictures")));
    }
    let images: Vec<Image> = reader.images().iter().enumerate().map(|(number, image)| picture(image, number)).collect();
    let version = format!("{}.{}", reader.header().major, reader.header().minor);
    let crs = reader.coordinate_metadata().map(str::trim).filter(|crs| !crs.is_empty()).map(str::to_owned);
    let of = scans.len();
    if of > MOST_SCANS {
        return Err(fail("description", format!("{of} scans, expected at most {MOST_SCANS}")));
    }
    let (mut sources, mut lost) = (Vec::new(), Vec::new());
    for (number, scan) in scans.iter().enumerate() {
        let name = name_of(scan.name.as_ref(), "scan", number);
        let place = if name.starts_with("scan ") { name } else { format!("scan {name}") };
        let mut info = Info::of_rows(&path, Format::E57, version.clone());
        info.crs = crs.clone();
        info.epsg = crs.as_deref().and_then(wkt::level_code);
        // The standard has metres alone.
        info.units = Units { level: Some(Unit::Metre), height: Some(Unit::Metre) };
        info.images = if sources.is_empty() { images.clone() } else { Vec::new() };
        let opened = open_scan(file, scan, (number, of), info).map_err(|problem| fail(&place, problem));
        match opened.and_then(std::convert::identity) {
            Ok(source) => sources.push(source),
            Err(error) => lost.push(error),
        }
    }
    if sources.is_empty() && !lost.is_empty() {
        return Err(lost.swap_remove(0));
    }
    Ok((sources, lost))
}

fn open_scan(
    file: &Arc<Bytes>,
    scan: &PointCloud,
    (number, of): (usize, usize),
    mut info: Info,
) -> std::result::Result<Result<RowSource>, String> {
    let pose = scan.transform.as_ref().map(Pose::of).transpose()?;
    let is_moved = pose.is_some_and(|pose| pose != Pose::NONE);
    let layout = Layout::of(scan, is_moved)?;
    let widths = layout.stored.iter().map(|stored| stored.width()).collect();
    let block_points = chunk_points(&layout.element) as u64;
    let (packets, rows) = Packets::find(file, scan.file_offset, scan.records, widths, block_points)?;
    if rows.count < scan.records {
        let reason = rows.problem.as_deref().unwrap_or("the file ends early");
        info.missing = scan.records - rows.count;
        info.warnings.push(format!("{} of {} points are missing: {reason}", info.missing, scan.records));
    }
    // Coordinates of a scan count from its scanner. Clouds that were put together have neither a pose nor a grid.
    let is_of_scanner = scan.transform.is_some() || layout.is_spherical || scan.has_row_column();
    let position = is_of_scanner.then(|| pose.unwrap_or(Pose::NONE).shift);
    let turn = pose.unwrap_or(Pose::NONE).turn;
    let time = |time: &Option<DateTime>| Some((time.as_ref()?.gps_time, time.as_ref()?.atomic_reference));
    let times = [time(&scan.acquisition_start), time(&scan.acquisition_end)];
    let times = times.map(|time| time.filter(|(seconds, _)| seconds.is_finite()));
    info.scan = Some(Scan { name: name_of(scan.name.as_ref(), "scan", number), number, of, position, turn, times });
    info.limits = layout.intensity_limits.map(|limits| ("intensity".to_owned(), limits)).into_iter().collect();
    let color_scale = layout.color_scale;
    // A range counts from the scanner by what it is; coordinates may be those of the world all the same.
    let is_sure = layout.is_spherical;
    let maker = Box::new(Maker { layout, packets, pose: pose.filter(|_| is_moved) });
    let made = Made { maker, rows, is_text: false, newline: b'\n', color_scale, info };
    Ok(RowSource::made(file.clone(), made).map(|source| if is_sure { source } else { source.doubting_scanner() }))
}

/// How a scan is turned and moved.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pose {
    turn: DQuat,
    shift: DVec3,
}

impl Pose {
    const NONE: Self = Self { turn: DQuat::IDENTITY, shift: DVec3::ZERO };

    fn of(transform: &Transform) -> std::result::Result<Self, String> {
        let Transform { rotation: e57::Quaternion { w, x, y, z }, translation } = transform;
        let (turn, shift) = (DQuat::from_xyzw(*x, *y, *z, *w), DVec3::new(translation.x, translation.y, translation.z));
        // A turn of no length stands for none.
        let turn = if turn.length_squared() > 0.0 { turn.normalize() } else { DQuat::IDENTITY };
        if !turn.is_finite() || !shift.is_finite() {
            return Err("its pose has numbers that are not finite".into());
        }
        Ok(Self { turn, shift })
    }
}

fn picture(image: &e57::Image, number: usize) -> Image {
    let (projection, width, height, blob) = match (&image.projection, &image.visual_reference) {
        (Some(Projection::Pinhole(own)), _) => {
            ("pinhole", own.properties.width, own.properties.height, Some(&own.blob))
        }
        (Some(Projection::Spherical(own)), _) => {
            ("spherical", own.properties.width, own.properties.height, Some(&own.blob))
        }
        (Some(Projection::Cylindrical(own)), _) => {
            ("cylindrical", own.properties.width, own.properties.height, Some(&own.blob))
        }
        (None, Some(own)) => ("preview", own.properties.width, own.properties.height, Some(&own.blob)),
        (None, None) => ("preview", 0, 0, None),
    };
    let pose = image.transform.as_ref().and_then(|transform| Pose::of(transform).ok());
    Image {
        name: name_of(image.name.as_ref(), "image", number),
        projection,
        size: [width, height],
        bytes: blob.map_or(0, |blob| blob.data.length),
        position: pose.map(|pose| pose.shift),
    }
}

/// Makes the rows of a scan.
struct Maker {
    layout: Layout,
    packets: Packets,
    pose: Option<Pose>,
}

impl Maker {
    /// The streams that some properties are made of.
    fn needed(&self, keep: &[bool]) -> Vec<bool> {
        let layout = &self.layout;
        let mut needed = vec![false; layout.stored.len()];
        let mut need = |stream: usize| needed[stream] = true;
        for (origin, _) in std::iter::zip(&layout.origins, keep).filter(|(_, keep)| **keep) {
            match *origin {
                Origin::Stream { stream, invalid } => {
                    need(stream);
                    invalid.into_iter().for_each(|(invalid, _)| need(invalid));
                }
                Origin::Number(stream) | Origin::Without(stream) => need(stream),
                Origin::Place(_) => layout.place.into_iter().chain(layout.invalid).for_each(&mut need),
                Origin::Normal(_) => layout.normal.into_iter().flatten().for_each(&mut need),
            }
        }
        needed
    }

    /// The place of a point; `None` if it is marked as invalid.
    fn place(&self, streams: &[Bits], index: usize) -> Option<DVec3> {
        let layout = &self.layout;
        let value = |stream: usize| layout.stored[stream].number(streams[stream].value(index));
        if layout.invalid.is_some_and(|invalid| value(invalid) != 0.0) {
            return None;
        }
        let [a, b, c] = layout.place.map(value);
        let own = match layout.is_spherical {
            true => DVec3::new(a * c.cos() * b.cos(), a * c.cos() * b.sin(), a * c.sin()),
            false => DVec3::new(a, b, c),
        };
        Some(self.pose.map_or(own, |pose| pose.turn * own + pose.shift))
    }

    fn normal(&self, streams: &[Bits], index: usize) -> DVec3 {
        let value = |stream: usize| self.layout.stored[stream].number(streams[stream].value(index));
        let own = self.layout.normal.map_or(DVec3::ZERO, |normal| DVec3::from_array(normal.map(value)));
        self.pose.map_or(own, |pose| pose.turn * own)
    }

    /// Writes the values of one property into rows of `stride` bytes, from `at` of each.
    fn fill(&self, number: usize, made: &Batch<'_>, rows: &mut [u8], (at, stride): (usize, usize)) {
        let layout = &self.layout;
        let Kind::Scalar(column_type) = layout.element.properties[number].kind else { return };
        let rows = rows.chunks_exact_mut(stride).enumerate();
        let raw = |stream: usize, index: usize| made.streams[stream].value(made.first + index);
        let stored = |stream: usize| layout.stored[stream];
        match layout.origins[number] {
            Origin::Stream { stream, invalid: None } if matches!(stored(stream), Stored::Integer { .. }) => {
                rows.for_each(|(index, row)| {
                    put_integer(&mut row[at..], column_type, stored(stream).integer(raw(stream, index)));
                });
            }
            Origin::Stream { stream, invalid } => rows.for_each(|(index, row)| {
                let other = invalid.filter(|(invalid, _)| stored(*invalid).integer(raw(*invalid, index)) != 0);
                let own = || stored(stream).number(raw(stream, index));
                put_number(&mut row[at..], column_type, other.map_or_else(own, |(_, other)| other));
            }),
            Origin::Number(stream) => rows.for_each(|(index, row)| {
                let own = stored(stream).integer(raw(stream, index)).saturating_add(1);
                put_integer(&mut row[at..], column_type, own);
            }),
            Origin::Without(stream) => rows.for_each(|(index, row)| {
                let own = stored(stream).integer(raw(stream, index)) == 0;
                put_integer(&mut row[at..], column_type, i64::from(own));
            }),
            Origin::Place(axis) => rows.for_each(|(index, row)| {
                put_number(&mut row[at..], column_type, made.places[index][axis]);
            }),
            Origin::Normal(axis) => rows.for_each(|(index, row)| {
                put_number(&mut row[at..], column_type, self.normal(made.streams, made.first + index)[axis]);
            }),
        }
    }
}

/// Points whose rows are made together: the streams of a block, the first of the points in it, and their places.
struct Batch<'a> {
    streams: &'a [Bits],
    first: usize,
    places: Vec<DVec3>,
}

impl RowMaker for Maker {
    fn element(&self) -> &Element {
        &self.layout.element
    }

    fn damage(&self) -> &'static str {
        "are marked as invalid by the scanner and are left out"
    }

    fn make(&self, file: &Bytes, block: Block, keep: &[bool], give: &mut dyn FnMut(&[u8])) -> io::Result<(u64, u64)> {
        let layout = &self.layout;
        let needed = self.needed(keep);
        let streams = match self.packets.streams(file, block, &needed) {
            // What a server has sent may have been damaged on its way.
            Err(error)
                if error.kind() == io::ErrorKind::InvalidData
                    && file.fetch_again(physical(block.offset..block.end)) =>
            {
                self.packets.streams(file, block, &needed)
            }
            streams => streams,
        }?;
        let kept: Vec<(usize, usize)> = {
            let properties = layout.element.properties.iter().zip(keep).enumerate().filter(|(_, (_, keep))| **keep);
            properties
                .map(|(number, (property, _))| match property.kind {
                    Kind::Scalar(scalar) => (number, scalar.size()),
                    Kind::List { .. } => (number, 0),
                })
                .collect()
        };
        let stride: usize = kept.iter().map(|(_, size)| size).sum();
        let has_places = kept.iter().any(|(number, _)| matches!(layout.origins[*number], Origin::Place(_)));
        let (mut damaged, total) = (0, block.rows as usize);
        let mut rows = Vec::new();
        for first in (0..total).step_by(POINTS_AT_ONCE) {
            let count = POINTS_AT_ONCE.min(total - first);
            let places = (0..if has_places { count } else { 0 }).map(|index| {
                let place = self.place(&streams, first + index);
                damaged += u64::from(place.is_none());
                place.unwrap_or(DVec3::NAN)
            });
            let batch = Batch { streams: &streams, first, places: places.collect() };
            rows.resize(count * stride, 0);
            let mut at = 0;
            for (number, size) in &kept {
                self.fill(*number, &batch, &mut rows, (at, stride));
                at += size;
            }
            give(&rows);
        }
        Ok((block.rows, damaged))
    }
}
