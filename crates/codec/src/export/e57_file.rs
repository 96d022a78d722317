//! Writes E57 files: each input is a scan of its own, at the place of its scanner where that is known.

use std::collections::BTreeSet;
use std::io::{self, Read, Seek, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use cloud::{Column, ColumnType, is_length};
use e57::{DateTime, E57Writer, Extension, IntensityLimits, PointCloudWriter, Quaternion, Record, RecordDataType};
use e57::{RecordName, RecordValue, Transform, Translation};
use glam::{DQuat, DVec3};
use tempfile::NamedTempFile;

use super::columns::{Colors, Field, Meaning, Piece};
use super::merging::{Merged, Origin};
use super::names::Names;
use super::ply_file::{PIECE_POINTS, RowFormat};
use super::words::Words;
use super::{Job, OwnFields};
use crate::brief::message;
use crate::error::{Error, Result};
use crate::format::{E57_NORMALS, E57_OTHERS};
use crate::in_order::InOrder;
use crate::las::record_export::Written;
use crate::units::Unit;

/// The columns of a scan.
struct ScanFormat {
    rows: RowFormat,
    records: Vec<Record>,
    /// Where the scanner stood, and the turn from its axes to those of the coordinates. Coordinates count from there,
    /// along these axes.
    pose: Option<(DVec3, DQuat)>,
    /// The records of coordinates, and of normals if there are any.
    places: [usize; 3],
    normals: Option<[usize; 3]>,
    /// The column that counts returns from 1, where the file counts from 0, and whether a point had 0.
    returns: Option<usize>,
    has_no_return: AtomicBool,
    /// The names that XML does not allow, and what stands for them.
    renamed: Vec<[String; 2]>,
}

impl ScanFormat {
    fn new(fields: &[Field], pose: Option<(DVec3, DQuat)>) -> Self {
        let rows = RowFormat::new(fields);
        let has = |name: &str| fields.iter().any(|field| field.name() == name && field.column_type().is_whole());
        let has_returns = has("return_number") && has("number_of_returns");
        let has_normals = ["nx", "ny", "nz"].iter().all(|axis| fields.iter().any(|field| field.name() == *axis));
        let (mut names, mut taken, mut renamed) = (Names::with_case(), Vec::new(), Vec::new());
        let mut records = Vec::new();
        for (field, own) in fields.iter().zip(&rows.fields) {
            let is_whole = own.column_type.is_whole();
            let known = match (field.meaning, field.name()) {
                (Meaning::Coordinate, "x") => Some(RecordName::CartesianX),
                (Meaning::Coordinate, "y") => Some(RecordName::CartesianY),
                (Meaning::Coordinate, "z") => Some(RecordName::CartesianZ),
                (Meaning::Color, "red") => Some(RecordName::ColorRed),
                (Meaning::Color, "green") => Some(RecordName::ColorGreen),
                (Meaning::Color, "blue") => Some(RecordName::ColorBlue),
                (_, "return_number") if has_returns => Some(RecordName::ReturnIndex),
                (_, "number_of_returns") if has_returns => Some(RecordName::ReturnCount),
                (_, name) if name.eq_ignore_ascii_case("intensity") => Some(RecordName::Intensity),
                (_, "row_index") if is_whole => Some(RecordName::RowIndex),
                (_, "column_index") if is_whole => Some(RecordName::ColumnIndex),
                (_, "nx" | "ny" | "nz") if has_normals => {
                    let name = format!("normal{}", field.name()[1..].to_uppercase());
                    Some(RecordName::Unknown { namespace: E57_NORMALS.0.into(), name })
                }
                _ => None,
            };
            let known = known.filter(|name| !taken.contains(name));
            let name = known.unwrap_or_else(|| {
                let name = names.take(&xml_name(field.name()), usize::MAX);
                if name != field.name() {
                    renamed.push([field.name().to_owned(), name.clone()]);
                }
                RecordName::Unknown { namespace: E57_OTHERS.0.into(), name }
            });
            taken.push(name.clone());
            let is_place = field.meaning == Meaning::Coordinate;
            let is_normal = has_normals && ["nx", "ny", "nz"].contains(&field.name());
            let data_type = match own.column_type {
                _ if is_place && pose.is_some() => RecordDataType::Double { min: None, max: None },
                ColumnType::F32 => RecordDataType::Single { min: None, max: None },
                _ if is_normal && pose.is_some() => RecordDataType::Double { min: None, max: None },
                ColumnType::U8 => whole(0, 0xff),
                ColumnType::I8 => whole(-0x80, 0x7f),
                ColumnType::U16 => whole(0, 0xffff),
                ColumnType::I16 => whole(-0x8000, 0x7fff),
                ColumnType::U32 => whole(0, 0xffff_ffff),
                ColumnType::I32 if !is_place => whole(-0x8000_0000, 0x7fff_ffff),
                _ => RecordDataType::Double { min: None, max: None },
            };
            records.push(Record { name, data_type });
        }
        let places = ["x", "y", "z"].map(|axis| {
            let is_axis = |field: &Field| field.meaning == Meaning::Coordinate && field.name() == axis;
            fields.iter().position(is_axis).unwrap_or_default()
        });
        let normal = |axis: &str| fields.iter().position(|field| field.name() == axis);
        let normals = || Some([normal("nx")?, normal("ny")?, normal("nz")?]);
        let normals = normals();
        let returns = records.iter().position(|record| record.name == RecordName::ReturnIndex);
        Self { rows, records, pose, places, normals, returns, has_no_return: AtomicBool::new(false), renamed }
    }

    /// The least and the greatest intensity that a sensor gives, as values of the column, if a file says them.
    fn intensity_limits(&self, limits: &[(String, [f64; 2])]) -> Option<(Option<RecordValue>, Option<RecordValue>)> {
        let (_, [least, most]) = limits.iter().find(|(name, _)| name == "intensity")?;
        let record = self.records.iter().find(|record| record.name == RecordName::Intensity)?;
        let value = |value: f64| match record.data_type {
            RecordDataType::Single { .. } => RecordValue::Single(value as f32),
            RecordDataType::Integer { .. } => RecordValue::Integer(value as i64),
            _ => RecordValue::Double(value),
        };
        Some((Some(value(*least)), Some(value(*most))))
    }

    /// The values of a packed row.
    fn values(&self, row: &[u8]) -> Vec<RecordValue> {
        let mut at = 0;
        let mut values = Vec::with_capacity(self.records.len());
        for (index, (record, own)) in self.records.iter().zip(&self.rows.fields).enumerate() {
            let bytes = &row[at..at + own.column_type.size()];
            at += bytes.len();
            let number = number_of(bytes, own.column_type);
            values.push(match record.data_type {
                RecordDataType::Single { .. } => RecordValue::Single(number as f32),
                RecordDataType::Integer { .. } if self.returns == Some(index) => {
                    if number == 0.0 {
                        self.has_no_return.store(true, Ordering::Relaxed);
                    }
                    RecordValue::Integer((number as i64 - 1).max(0))
                }
                RecordDataType::Integer { .. } => RecordValue::Integer(number as i64),
                _ => RecordValue::Double(number),
            });
        }
        if let Some((place, turn)) = self.pose {
            let back = turn.conjugate();
            // A place alone rounds once.
            let own = |point: DVec3| if turn == DQuat::IDENTITY { point - place } else { back * (point - place) };
            change(&mut values, self.places, own);
            if let Some(normals) = self.normals.filter(|_| turn != DQuat::IDENTITY) {
                change(&mut values, normals, |normal| back * normal);
            }
        }
        values
    }
}

/// Changes three floats of a row together.
fn change(values: &mut [RecordValue], places: [usize; 3], to: impl Fn(DVec3) -> DVec3) {
    let before = places.map(|place| match values[place] {
        RecordValue::Single(value) => f64::from(value),
        RecordValue::Double(value) => value,
        _ => f64::NAN,
    });
    for (place, value) in places.into_iter().zip(to(DVec3::from(before)).to_array()) {
        values[place] = match values[place] {
            RecordValue::Single(_) => RecordValue::Single(value as f32),
            _ => RecordValue::Double(value),
        };
    }
}

fn whole(min: i64, max: i64) -> RecordDataType {
    RecordDataType::Integer { min, max }
}

/// A number of a row, little-endian. Rows have no whole numbers of 64 bits.
fn number_of(bytes: &[u8], column_type: ColumnType) -> f64 {
    let raw = bytes.iter().rev().fold(0_u64, |raw, byte| raw << 8 | u64::from(*byte));
    match column_type {
        ColumnType::F32 => f64::from(f32::from_bits(raw as u32)),
        ColumnType::F64 => f64::from_bits(raw),
        ColumnType::I8 => f64::from(raw as i8),
        ColumnType::I16 => f64::from(raw as i16),
        ColumnType::I32 => f64::from(raw as i32),
        _ => raw as f64,
    }
}

/// A name that nothing else has: a random UUID of version 4.
fn new_guid() -> io::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    let random = u128::from_be_bytes(bytes) & !(0xf << 76 | 3 << 62) | 4 << 76 | 2 << 62;
    let digits = format!("{random:032X}");
    let parts = [&digits[..8], &digits[8..12], &digits[12..16], &digits[16..20], &digits[20..]];
    Ok(format!("{{{}}}", parts.join("-")))
}

/// A name that XML allows.
fn xml_name(name: &str) -> String {
    let own: String = name.chars().map(|c| if c.is_ascii_alphanumeric() || c == '_' { c } else { '_' }).collect();
    let is_name = own.starts_with(|c: char| c.is_ascii_alphabetic()) && !own.to_lowercase().starts_with("xml");
    if is_name { own } else { format!("a_{own}") }
}

fn failed(error: e57::Error) -> io::Error {
    match error {
        e57::Error::Write { source: Some(source), .. } => match source.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(error) => io::Error::other(error.to_string()),
        },
        error => io::Error::other(message(&error)),
    }
}

impl Job<'_> {
    /// What makes metres of x, y and z, which E57 has alone; `None` if they are metres, or nobody knows.
    ///
    /// # Errors
    /// Angles, which are no lengths.
    pub(super) fn metres(&self) -> Result<Option<DVec3>> {
        for info in self.sources.iter().map(|source| source.info()) {
            if let Some(unit) = info.units.level.filter(|unit| unit.is_angle()) {
                let unit = unit.short_name();
                let problem = format!(
                    "x and y are in {unit}, and E57 has metres alone: bring the file to a system in metres first, or write \
                     .laz"
                );
                return Err(Error::unsuitable(&info.path, problem));
            }
        }
        let units = self.units();
        let metres = |unit: Option<Unit>| unit.and_then(Unit::metres).unwrap_or(1.0);
        let (level, rise) = (metres(units.level), metres(units.rise()));
        let scale = DVec3::new(level, level, rise);
        Ok((scale != DVec3::ONE).then_some(scale))
    }

    pub(super) fn write_e57(&self, mut file: NamedTempFile) -> Result<Option<Written>> {
        let unwritten = |error: io::Error| Error::not_written(self.output, error);
        let mut crs = self.crs()?.map(str::to_owned);
        let is_wide = self.sources.iter().any(|source| source.has_wide_colors());
        let own = self.fields(if is_wide { Colors::Words } else { Colors::Bytes }, false);
        let mut words = Words::default();
        self.say_left_out(&mut words);
        if self.scale.is_some() {
            let lost =
                if crs.take().is_some() { "; the coordinate system, which has other units, is left out" } else { "" };
            let scaled = |field: &&Field| {
                let scale = self.scale.and_then(|scale| scale_of(field, scale));
                field.meaning != Meaning::Coordinate && scale.is_some()
            };
            let lengths: BTreeSet<&str> =
                own.iter().flat_map(|own| &own.fields).filter(scaled).map(Field::name).collect();
            let what: Vec<&str> = std::iter::once("coordinates").chain(lengths).collect();
            let (what, units) = (what.join(", "), self.units().text());
            let word = format!("{what} in {units} became metres, which E57 has alone{lost}");
            words.say(self.output, word);
        }
        let mut warnings = self.warnings();
        let mut points = 0;
        let guid = new_guid().map_err(unwritten)?;
        let mut writer = E57Writer::new(&mut file, &guid).map_err(failed).map_err(unwritten)?;
        for (name, url) in [E57_NORMALS, E57_OTHERS] {
            writer.register_extension(Extension::new(name, url)).map_err(failed).map_err(unwritten)?;
        }
        writer.set_coordinate_metadata(crs);
        for (number, own) in own.iter().enumerate() {
            let info = self.sources[number].info();
            let pose = info
                .scan
                .as_ref()
                .and_then(|scan| Some((scan.position? * self.scale.unwrap_or(DVec3::ONE), scan.turn)));
            // Colours that are zero everywhere are none: other programs would show black points.
            let has_place = |field: &Field| field.meaning != Meaning::Color || info.has_colors;
            let fields: Vec<Field> = own.fields.iter().filter(|field| has_place(field)).cloned().collect();
            let format = ScanFormat::new(&fields, pose);
            for [before, after] in &format.renamed {
                words.say(&info.path, format!("{before} became the column {after}"));
            }
            let guid = new_guid().map_err(unwritten)?;
            let mut scan = writer.add_pointcloud(&guid, format.records.clone()).map_err(failed).map_err(unwritten)?;
            let name = info.scan.as_ref().map_or_else(|| info.name(), |scan| scan.name.clone());
            scan.set_name(Some(name.replace("]]>", "]] >")));
            scan.set_transform(pose.map(|(place, turn)| Transform {
                rotation: Quaternion { w: turn.w, x: turn.x, y: turn.y, z: turn.z },
                translation: Translation { x: place.x, y: place.y, z: place.z },
            }));
            let [start, end] = info.scan.as_ref().map_or([None; 2], |scan| scan.times);
            let time = |(gps_time, atomic_reference)| DateTime { gps_time, atomic_reference };
            scan.set_acquisition_start(start.map(time));
            scan.set_acquisition_end(end.map(time));
            if let Some((intensity_min, intensity_max)) = format.intensity_limits(&info.limits) {
                scan.set_intensity_limits(Some(IntensityLimits { intensity_min, intensity_max }));
            }
            points += self.write_scan(number, own, is_wide, &format, &mut scan, &mut warnings).map_err(unwritten)?;
            if self.progress.is_cancelled() {
                return Ok(None);
            }
            scan.finalize().map_err(failed).map_err(unwritten)?;
            self.say_lost_digits(&format.rows.lost_digits(), &mut words);
            if format.has_no_return.into_inner() {
                words.say(&info.path, "points without a return number became the first return");
            }
        }
        writer.finalize().map_err(failed).map_err(unwritten)?;
        drop(writer);
        file.as_file().sync_data().map_err(unwritten)?;
        Ok(Some(Written { file, points, changes: words.lines(), warnings }))
    }

    /// Writes the points of one input; returns how many there were.
    fn write_scan<T: Read + Write + Seek + Send>(
        &self,
        number: usize,
        own: &OwnFields,
        is_wide: bool,
        format: &ScanFormat,
        scan: &mut PointCloudWriter<'_, T>,
        warnings: &mut Vec<String>,
    ) -> io::Result<u64> {
        let merged = Merged::by_name(std::slice::from_ref(&own.fields));
        let has_colors = self.sources[number].info().has_colors;
        let origins = std::iter::zip(&own.fields, &merged.origins[0]);
        let origins = origins.filter(|(field, _)| field.meaning != Meaning::Color || has_colors);
        let origins: Vec<Option<Origin>> = origins.map(|(_, origin)| *origin).collect();
        let length = format.rows.length;
        let points = Mutex::new(0);
        let encode = |rows: Vec<u8>| {
            *points.lock().unwrap_or_else(PoisonError::into_inner) += (rows.len() / length) as u64;
            Ok(rows)
        };
        let mut write = |rows: Vec<u8>| {
            rows.chunks_exact(length).try_for_each(|row| scan.add_point(format.values(row)).map_err(failed))
        };
        let is_cancelled = || self.progress.is_cancelled();
        let order = InOrder::new(PIECE_POINTS * length, &encode, &mut write, &is_cancelled);
        let rows_of = |piece: &Piece| {
            self.widen_by(own, piece);
            format.rows.rows(piece, &origins)
        };
        let colors = if is_wide { Colors::Words } else { Colors::Bytes };
        warnings.append(&mut self.read_one(number, own, colors, None, &order, &rows_of));
        order.finish()?;
        Ok(points.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}

/// What a column is multiplied by, if coordinates are; `None` for one that is no length. Lengths of places whose heights
/// have another unit have none.
pub(super) fn scale_of(field: &Field, scale: DVec3) -> Option<f64> {
    if field.meaning == Meaning::Coordinate {
        return ["x", "y", "z"].iter().position(|axis| *axis == field.name()).map(|axis| scale[axis]);
    }
    (is_length(field.name()) && scale.x == scale.z).then_some(scale.x)
}

/// Multiplies coordinates and lengths among the columns of a file, which become doubles.
pub(super) fn scale_lengths(fields: &[Field], columns: &mut [Column], scale: DVec3) {
    for (field, column) in fields.iter().zip(columns) {
        if let Some(scale) = scale_of(field, scale) {
            *column = Column::F64((0..column.len()).map(|index| column.value(index) * scale).collect());
        }
    }
}
